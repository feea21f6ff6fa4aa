//! A shape in the world is the image of the shape in its own space, also far away, mirrored and stretched until some
//! directions are sixty times longer than others.

use super::*;

/// Transforms with a large translation: two that stretch unequally, one of them a mirror, and a mirrored similarity.
fn far_and_stretched() -> Vec<DAffine3> {
    let turned = |angle| DMat3::from_axis_angle(DVec3::new(-1.0, 2.0, 0.5).normalize(), angle);
    let stretch = |x, y, z| DMat3::from_diagonal(DVec3::new(x, y, z));
    vec![
        DAffine3::from_mat3_translation(
            turned(0.7) * stretch(3.0, 0.05, 0.8) * turned(1.9),
            DVec3::new(1e4, -7e3, 2e3),
        ),
        DAffine3::from_mat3_translation(
            turned(2.1) * stretch(0.2, 1.0, -6.0) * turned(0.3),
            DVec3::new(-3e3, 20.0, 5e3),
        ),
        DAffine3::from_mat3_translation(turned(-1.2) * stretch(-2.5, 2.5, 2.5), DVec3::new(0.0, 1e5, -4e4)),
    ]
}

fn each_image(transforms: &[DAffine3], mut test: impl FnMut(&Placed, &Placed, &mut Stream)) {
    for (i, shape) in shapes().into_iter().enumerate() {
        let here = Placed::new(shape.clone(), DAffine3::IDENTITY).unwrap();
        for (j, transform) in transforms.iter().enumerate() {
            let there = Placed::new(shape.clone(), *transform).unwrap();
            test(&here, &there, &mut random((1000 + i * 16 + j) as u64));
        }
    }
}

/// What of a shape a ray meets in a range, from near to far: parameter, primitive and weights.
fn met(placed: &Placed, ray: &Ray, t_min: f64, t_max: f64) -> Vec<(f64, u32, [f64; 2])> {
    let mut found = Vec::new();
    placed.crossings(ray, t_min, t_max, &mut |t, primitive, weights| {
        found.push((t, primitive, weights));
        t_max
    });
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    found
}

fn ray_through(r: &mut Stream) -> Ray {
    let origin = 3.0 * direction(r);
    Ray::new(origin, (0.7 * in_cube(r) - origin).normalize())
}

/// The ray that a transform makes of one in object space, and how many times longer lengths are along it.
fn image(m: &DAffine3, ray: &Ray) -> (Ray, f64) {
    let along = m.transform_vector3(ray.direction);
    (Ray::new(m.transform_point3(ray.origin), along.normalize()), along.length())
}

#[test]
fn a_ray_meets_the_image_of_what_it_meets_in_object_space() {
    each_image(&far_and_stretched(), |here, there, r| {
        let mut compared = 0;
        for _ in 0..300 {
            let local = ray_through(r);
            let (ray, longer) = image(there.to_world(), &local);
            let expected = met(here, &local, 0.0, 100.0);
            let found = met(there, &ray, 0.0, 100.0 * longer);
            assert_eq!(found.len(), expected.len(), "{:?}", here.shape());
            for (a, b) in expected.iter().zip(&found) {
                let (before, after) = (here.surface(&local, a.0, a.1, a.2), there.surface(&ray, b.0, b.1, b.2));
                let cosine = before.normal.dot(local.direction).abs();
                let rounding = error_bound(&ray, b.0) / cosine.max(1e-3);
                assert!(a.1 == b.1 && (longer * a.0 - b.0).abs() <= rounding, "{a:?} {b:?} {longer}");
                // A share of a turn is as good one turn later.
                let apart = |x: f64, y: f64| (x - y).abs().min(1.0 - (x - y).abs());
                let [u, v] = [0, 1].map(|i| apart(before.uv[i], after.uv[i]));
                assert!(u.max(v) < 1e-6 / cosine, "{:?} {:?}", before.uv, after.uv);
                compared += 1;
            }
            // ---- ends of the range are lengths in the world, too
            if let [.., (first, ..), (last, ..)] = found[..]
                && last - first > 1e-3 * longer
            {
                let middle = 0.5 * (first + last);
                let parts = [(0.0, middle), (middle, 2.0 * last)].map(|(from, to)| met(there, &ray, from, to).len());
                assert_eq!(parts, [found.len() - 1, 1]);
            }
        }
        assert!(compared > 50, "{compared}");
    });
}

#[test]
fn normals_are_perpendicular_to_the_image_of_the_surface() {
    const STEP: f64 = 1e-4;
    let transforms = [transforms(), far_and_stretched()].concat();
    each_image(&transforms, |here, there, r| {
        let m = there.to_world().matrix3;
        let mut compared = 0;
        for _ in 0..100 {
            let local = ray_through(r);
            let (ray, longer) = image(there.to_world(), &local);
            for (t, primitive, weights) in met(here, &local, 0.0, 100.0) {
                let before = here.surface(&local, t, primitive, weights);
                let after = there.surface(&ray, longer * t, primitive, weights);
                // ---- to shade: perpendicular to the image of what it was perpendicular to
                let frame = Frame::around(before.shading_normal);
                for tangent in [frame.x, frame.y].map(|tangent| (m * tangent).normalize()) {
                    assert!(after.shading_normal.dot(tangent).abs() < 1e-6);
                }
                assert!(after.shading_normal.dot(after.normal) > 0.0);
                assert!(
                    (after.shading_normal.length() - 1.0).abs() < 1e-9 && (after.normal.length() - 1.0).abs() < 1e-9
                );
                // ---- of the surface: to differences of points where rays close by meet the same face
                if before.normal.dot(local.direction).abs() < 0.3 {
                    continue;
                }
                let aside = Frame::around(local.direction);
                for side in [aside.x, aside.y] {
                    let [a, b] = [-STEP, STEP].map(|step| {
                        let moved = Ray::new(local.origin + step * side, local.direction);
                        let close = met(here, &moved, t - 10.0 * STEP, t + 10.0 * STEP);
                        close.iter().find(|other| other.1 == primitive).map(|other| moved.at(other.0))
                    });
                    let (Some(a), Some(b)) = (a, b) else { continue };
                    let cosine = after.normal.dot((m * (b - a)).normalize());
                    assert!(cosine.abs() < 1e-3, "{:?}: {cosine}", here.shape());
                    compared += 1;
                }
            }
        }
        assert!(compared > 20, "{compared}");
    });
}

#[test]
fn points_drawn_lie_on_the_image_and_their_densities_make_up_its_area() {
    let transforms = [transforms(), far_and_stretched()].concat();
    each_image(&transforms, |_, there, r| {
        const BEFORE: f64 = 1e-3;
        for _ in 0..50 {
            let (point, normal, pdf) = there.sample_area(r.uniform2());
            assert!(there.bounds().grown(1e-9 * point.abs().max_element()).contains(point));
            assert_eq!(pdf, there.pdf_area(normal));
            // ---- seen from outside, a ray meets it there; it leads into what is closed
            let ray = Ray::new(point + BEFORE * normal, -normal);
            let rounding = error_bound(&ray, BEFORE);
            let hits = met(there, &ray, BEFORE - 4.0 * rounding, BEFORE + 4.0 * rounding);
            let same = |&(t, primitive, weights): &(f64, u32, [f64; 2])| {
                there.surface(&ray, t, primitive, weights).normal.distance(normal) < 1e-6
            };
            assert!(hits.iter().any(same), "{:?}: {hits:?} at {point}", there.shape());
            let [inside, outside] = [-1e-6, 1e-6].map(|h| there.contains(point + h * normal));
            assert!(!outside && inside == there.is_closed(), "{:?} at {point}", there.shape());
        }
        // ---- the mean of 1/density is the area: over points that cover the square evenly (Kronecker's sequence)
        const N: usize = 20_000;
        let points = (0..N).map(|i| [(i as f64 + 0.5) / N as f64, (i as f64 * 0.618_033_988_749_895).fract()]);
        let mean = points.map(|u| there.sample_area(u).2.recip()).sum::<f64>() / N as f64;
        assert!((mean / there.area() - 1.0).abs() < 1e-3, "{:?}: {mean}, {}", there.shape(), there.area());
    });
}

#[test]
fn the_closest_point_of_each_face_is_undercut_by_none() {
    let transforms = [transforms(), far_and_stretched()].concat();
    each_image(&transforms, |here, there, r| {
        if matches!(here.shape(), Shape::Mesh(_)) {
            return;
        }
        // ---- points of each face
        let m = there.to_world();
        let mut faces: std::collections::BTreeMap<u32, Vec<DVec3>> = Default::default();
        for _ in 0..4000 {
            let local = random_line(r, DVec3::ZERO, 1.5);
            for (t, primitive, _) in met(here, &local, 0.0, 100.0) {
                faces.entry(primitive).or_default().push(m.transform_point3(local.at(t)));
            }
        }
        let near = |p: DVec3, radius: f64| {
            let mut found = Vec::new();
            there.faces_near(p, radius, &mut |primitive, on, normal| found.push((primitive, on, normal)));
            found.sort_by_key(|face| face.0);
            found
        };
        let mut confirmed = 0;
        for _ in 0..20 {
            let p = m.transform_point3(1.3 * in_cube(r));
            let all = near(p, f64::INFINITY);
            assert!(all.iter().map(|face| face.0).eq(faces.keys().copied()), "{:?}", here.shape());
            for &(primitive, on, normal) in &all {
                let sampled = faces[&primitive].iter().map(|q| q.distance(p)).fold(f64::INFINITY, f64::min);
                let rounding = 1e-12 * p.abs().max_element();
                let distance = on.distance(p);
                assert!(distance <= sampled + 1e-9 + rounding, "{:?} {primitive}: {distance}, {sampled}", here.shape());
                let (apart, _) = offset(here.shape(), m.inverse().transform_point3(on));
                assert!(apart < 1e-6, "{:?}: {apart} off the surface", here.shape());
                // ---- a ray along the normal meets the face there, or misses its border; a tip has no normal
                let local = m.inverse().transform_point3(on);
                if matches!(here.shape(), Shape::Lathe(_)) && local.x.hypot(local.z) < 0.01 {
                    continue;
                }
                let ray = Ray::new(on + 1e-3 * normal, -normal);
                let rounding = 4.0 * error_bound(&ray, 1e-3);
                for (t, other, weights) in met(there, &ray, 1e-3 - rounding, 1e-3 + rounding) {
                    if other == primitive {
                        let apart = there.surface(&ray, t, other, weights).normal.distance(normal);
                        assert!(apart < 1e-3, "{:?} {primitive}: {normal} off by {apart}", here.shape());
                        confirmed += 1;
                    }
                }
            }
            // ---- what is farther than asked is left out
            let mut distances: Vec<f64> = all.iter().map(|face| face.1.distance(p)).collect();
            distances.sort_by(f64::total_cmp);
            let radius = 0.999 * distances[distances.len() / 2];
            let within: Vec<u32> = all.iter().filter(|face| face.1.distance(p) <= radius).map(|face| face.0).collect();
            assert_eq!(near(p, radius).iter().map(|face| face.0).collect::<Vec<_>>(), within);
        }
        assert!(confirmed > 0, "{:?}", here.shape());
    });
}

/// A step along ∂p/∂u over its length changes u, and v not, by the step's share; and the other way round.
#[test]
fn tangents_are_the_derivatives_of_u_and_v() {
    const STEP: f64 = 1e-6;
    each_image(&[DAffine3::IDENTITY], |here, _, r| {
        let mut compared = 0;
        for _ in 0..300 {
            let local = ray_through(r);
            for (t, primitive, weights) in met(here, &local, 0.0, 100.0) {
                let (p, at) = (local.at(t), here.surface(&local, t, primitive, weights));
                for (k, along) in here.tangents(p, primitive).into_iter().enumerate() {
                    let share = STEP / along.length().max(1e-3);
                    let above = Ray::new(p + share * along + 0.01 * at.normal, -at.normal);
                    let beside = met(here, &above, 0.005, 0.015);
                    let Some(&(t, _, weights)) = beside.iter().find(|(_, other, _)| *other == primitive) else {
                        continue;
                    };
                    let uv = here.surface(&above, t, primitive, weights).uv;
                    let moved = [0, 1].map(|i| (uv[i] - at.uv[i]) / share);
                    // Beside the seam, and at poles.
                    if moved.iter().any(|x| x.abs() > 0.5 / share) || at.uv[1].min(1.0 - at.uv[1]) < 0.02 {
                        continue;
                    }
                    let expected = [f64::from(k == 0), f64::from(k == 1)];
                    let off = [0, 1].map(|i| (moved[i] - expected[i]).abs());
                    assert!(off[0].max(off[1]) < 1e-2, "{:?}: {moved:?}, not {expected:?}", here.shape());
                    compared += 1;
                }
            }
        }
        assert!(compared > 100, "{compared}");
    });
}
