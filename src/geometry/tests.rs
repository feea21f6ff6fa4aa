//! All shapes against the same promises: hits, insides, samples and distances.

mod placed;

use super::*;
use crate::math::random::{Purpose, Stream};
use crate::math::{DAffine3, DMat3, DVec2, Frame, Ray, Vec3, error_bound, sampling};
use std::f64::consts::PI;
use std::sync::Arc;

fn random(index: u64) -> Stream {
    Stream::new(7, Purpose::Test, index, 0)
}

fn in_cube(r: &mut Stream) -> DVec3 {
    DVec3::new(r.uniform(), r.uniform(), r.uniform()) * 2.0 - 1.0
}

fn direction(r: &mut Stream) -> DVec3 {
    sampling::sphere(r.uniform2())
}

/// A sphere of 20 · 4ⁿ triangles with vertices at distance 1 (up to `f32`), wound inward if asked.
fn icosphere(levels: u32, inward: bool) -> Mesh {
    let (positions, mut triangles) = icosphere_parts(levels);
    if inward {
        triangles.iter_mut().for_each(|t| t.swap(0, 1));
    }
    Mesh::new(positions, triangles, true).unwrap()
}

fn icosphere_parts(levels: u32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let g = 0.5 * (1.0 + 5f64.sqrt());
    let mut points: Vec<DVec3> = Vec::new();
    for (a, b) in [(1.0, g), (-1.0, g), (1.0, -g), (-1.0, -g)] {
        points.extend([DVec3::new(0.0, a, b), DVec3::new(a, b, 0.0), DVec3::new(b, 0.0, a)]);
    }
    let near = |a: usize, b: usize| points[a].distance(points[b]) < 2.1;
    let mut triangles = Vec::new();
    for (a, b, c) in (0..12).flat_map(|a| (a + 1..12).flat_map(move |b| (b + 1..12).map(move |c| (a, b, c)))) {
        if near(a, b) && near(b, c) && near(c, a) {
            let out = points[a].dot(points[b].cross(points[c])) > 0.0;
            triangles.push(if out { [a as u32, b as u32, c as u32] } else { [a as u32, c as u32, b as u32] });
        }
    }
    let mut points: Vec<DVec3> = points.iter().map(|p| p.normalize()).collect();
    for _ in 0..levels {
        let mut middles = std::collections::HashMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                points.push((points[a as usize] + points[b as usize]).normalize());
                points.len() as u32 - 1
            })
        };
        triangles = triangles
            .iter()
            .flat_map(|&[a, b, c]| {
                let [ab, bc, ca] = [middle(a, b), middle(b, c), middle(c, a)];
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    (points.iter().map(|p| p.as_vec3()).collect(), triangles)
}

fn box_mesh() -> Mesh {
    let corner = |i: u32| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2 & 1) as f32) * 2.0 - 1.0;
    let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let triangles = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    Mesh::new((0..8).map(corner).collect(), triangles, false).unwrap()
}

/// A spindle with a waist, a ring of a slant edge, and discs; half of it above the equator.
const SPINDLE: [[f64; 2]; 8] =
    [[0.0, -0.8], [0.5, -0.8], [0.7, -0.3], [0.3, 0.0], [0.3, 0.3], [0.6, 0.35], [0.2, 0.35], [0.0, 0.7]];
/// A ring with a square hole in the line's sense: closed without the axis.
const TORUS: [[f64; 2]; 5] = [[0.4, -0.2], [0.8, -0.1], [0.7, 0.3], [0.5, 0.3], [0.4, -0.2]];
const CUP: [[f64; 2]; 4] = [[0.0, -0.5], [0.4, -0.5], [0.4, 0.1], [0.7, 0.6]];

fn lathe(profile: &[[f64; 2]]) -> Shape {
    let profile: Vec<DVec2> = profile.iter().map(|p| DVec2::from_array(*p)).collect();
    Shape::Lathe(Arc::new(Lathe::new(&profile, 0.5).unwrap()))
}

fn shapes() -> Vec<Shape> {
    let v = DVec3::new;
    vec![
        lathe(&SPINDLE),
        lathe(&TORUS),
        lathe(&CUP),
        Shape::Sphere(Sphere::new(v(0.1, -0.2, 0.3), 0.7).unwrap()),
        Shape::Cuboid(Cuboid::new(v(-0.5, -0.9, -0.2), v(0.4, 0.3, 0.8)).unwrap()),
        Shape::Cylinder(Cylinder::new(v(-0.2, -0.6, 0.1), v(0.3, 0.7, -0.2), 0.45, true).unwrap()),
        Shape::Mesh(Arc::new(icosphere(2, true))),
        Shape::Cylinder(Cylinder::new(v(-0.2, -0.6, 0.1), v(0.3, 0.7, -0.2), 0.45, false).unwrap()),
        Shape::Quad(Quad::new(v(-0.7, -0.3, 0.1), v(1.1, 0.2, 0.0), v(0.3, 0.8, 0.4)).unwrap()),
        Shape::Disk(Disk::new(v(0.2, 0.1, -0.1), v(0.3, -1.0, 0.5), 0.8).unwrap()),
    ]
}

fn transforms() -> Vec<DAffine3> {
    let turned = DMat3::from_axis_angle(DVec3::new(2.0, 1.0, -3.0).normalize(), 0.8);
    let sheared = DMat3::from_cols_array(&[0.8, 0.1, 0.3, -0.4, 0.9, 0.0, 0.2, 0.5, 1.2]);
    let mirror = DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0));
    let shift = DVec3::new(0.3, 0.2, -0.4);
    [DMat3::IDENTITY, turned * 0.9, mirror * turned, sheared, mirror * sheared]
        .map(|m| DAffine3::from_mat3_translation(m, if m == DMat3::IDENTITY { DVec3::ZERO } else { shift }))
        .to_vec()
}

/// How far a point in object space is from the surface, and whether it is inside: from the shapes'
/// definitions alone. Meshes are convex here.
fn offset(shape: &Shape, p: DVec3) -> (f64, bool) {
    let v = DVec3::new;
    let round = |p: DVec3, caps: bool| {
        let (base, top) = (v(-0.2, -0.6, 0.1), v(0.3, 0.7, -0.2));
        let z = (p - base).dot((top - base).normalize());
        let across = (p - base).cross((top - base).normalize()).length() - 0.45;
        let ends = (-z).max(z - base.distance(top));
        if caps { (across.max(ends).abs(), across < 0.0 && ends < 0.0) } else { (across.abs().max(ends), false) }
    };
    match shape {
        Shape::Sphere(_) => {
            let d = p.distance(v(0.1, -0.2, 0.3)) - 0.7;
            (d.abs(), d < 0.0)
        }
        Shape::Cuboid(_) => {
            let d = (v(-0.5, -0.9, -0.2) - p).max(p - v(0.4, 0.3, 0.8)).max_element();
            (d.abs(), d < 0.0)
        }
        Shape::Cylinder(c) => round(p, c.is_closed()),
        Shape::Lathe(l) => {
            let profile = match (l.is_closed(), l.bounds(&DAffine3::IDENTITY).min.y < -0.4) {
                (false, _) => &CUP[..],
                (true, true) => &SPINDLE,
                (true, false) => &TORUS,
            };
            let q = DVec2::new(p.x.hypot(p.z), p.y);
            let pieces = || profile.windows(2).map(|pair| [DVec2::from_array(pair[0]), DVec2::from_array(pair[1])]);
            let distance = |[a, b]: [DVec2; 2]| {
                let share = ((q - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
                q.distance(a.lerp(b, share))
            };
            // How often the line, closed by its mirror image, goes around: a sum of angles.
            let turn = |[a, b]: [DVec2; 2]| (a - q).angle_to(b - q);
            let mirror = |p: DVec2| DVec2::new(-p.x, p.y);
            let (here, there): (f64, f64) =
                (pieces().map(turn).sum(), pieces().map(|[a, b]| turn([mirror(b), mirror(a)])).sum());
            let inside = l.is_closed() && (here + there).abs() > PI;
            (pieces().map(distance).fold(f64::INFINITY, f64::min), inside)
        }
        Shape::Mesh(m) => {
            let plane = |i| {
                let [a, b, c] = m.corners(i);
                (p - a).dot((b - a).cross(c - a).normalize())
            };
            let d = (0..m.triangle_count() as u32).map(plane).fold(f64::NEG_INFINITY, f64::max);
            (d.abs(), d < 0.0)
        }
        Shape::Quad(_) => {
            let n = v(1.1, 0.2, 0.0).cross(v(0.3, 0.8, 0.4));
            ((p - v(-0.7, -0.3, 0.1)).dot(n.normalize()).abs(), false)
        }
        Shape::Disk(_) => {
            let d = p - v(0.2, 0.1, -0.1);
            (d.dot(v(0.3, -1.0, 0.5).normalize()).abs().max(d.length() - 0.8), false)
        }
    }
}

fn each_placed(mut test: impl FnMut(&Shape, &DAffine3, &Geometry, &mut Stream)) {
    for (i, shape) in shapes().iter().enumerate() {
        for (j, transform) in transforms().iter().enumerate() {
            let geometry = Geometry::new(vec![Placed::new(shape.clone(), *transform).unwrap()]);
            test(shape, transform, &geometry, &mut random((i * 16 + j) as u64));
        }
    }
}

/// A line, uniform and isotropic among those that meet the ball of `radius`, as a ray from outside.
fn random_line(r: &mut Stream, center: DVec3, radius: f64) -> Ray {
    let frame = Frame::around(direction(r));
    let (x, y) = sampling::disc(r.uniform2());
    Ray::new(center + frame.to_world(DVec3::new(x, y, -2.0) * radius), frame.z)
}

#[test]
fn hits_lie_on_the_surface_and_bound_what_is_inside() {
    each_placed(|shape, transform, geometry, r| {
        let back = transform.inverse();
        let mut crossed = 0;
        for _ in 0..400 {
            let origin = 3.0 * in_cube(r);
            let target = transform.transform_point3(0.6 * in_cube(r));
            let ray = Ray::new(origin, (target - origin).normalize());
            let mut hits = Vec::new();
            geometry.all_hits(&ray, 0.0, 100.0, |hit| hits.push(hit));
            hits.sort_by(|a, b| a.t.total_cmp(&b.t));
            crossed += hits.len();
            for hit in &hits {
                let (distance, _) = offset(shape, back.transform_point3(ray.at(hit.t)));
                assert!(distance <= error_bound(&ray, hit.t), "{shape:?} off by {distance}");
                assert!((hit.normal.length() - 1.0).abs() < 1e-12 && hit.shading_normal.dot(hit.normal) > 0.0);
                let side = |h: f64| offset(shape, back.transform_point3(ray.at(hit.t) + h * hit.normal)).1;
                assert!(!geometry.is_closed(0) || side(-1e-6) && !side(1e-6), "the normal points in");
            }
            // ---- what lies before, between and behind
            let mut ends: Vec<f64> = hits.iter().map(|hit| hit.t).collect();
            ends.insert(0, 0.0);
            ends.push(10.0);
            for (i, pair) in ends.windows(2).enumerate().filter(|(_, pair)| pair[1] - pair[0] > 1e-6) {
                let p = ray.at(0.5 * (pair[0] + pair[1]));
                let inside = offset(shape, back.transform_point3(p)).1;
                assert_eq!(geometry.contains(0, p), inside);
                let leaves = hits.get(i).is_some_and(|hit| hit.normal.dot(ray.direction) > 0.0);
                assert!(!geometry.is_closed(0) || inside == leaves, "parity of {shape:?}");
            }
        }
        assert!(crossed > 30);
    });
}

#[test]
fn areas_and_area_samples_agree_with_random_lines() {
    // Cauchy and Crofton: a uniform line through a ball of radius R crosses a surface of area A inside
    // 2A/4πR² times in the mean, at places uniform by area.
    const N: usize = 20_000;
    each_placed(|shape, _, geometry, r| {
        let bounds = geometry.all_bounds().grown(1e-9);
        let (center, radius) = (bounds.center(), 0.5 * bounds.diagonal());
        let cell = |p: DVec3| {
            let q = ((p - bounds.min) / bounds.size() * 3.0).floor().clamp(DVec3::ZERO, DVec3::splat(2.0));
            (q.x + 3.0 * q.y + 9.0 * q.z) as usize
        };
        // ---- area in each cell of a 3³ grid, with variances, once by lines and once by samples
        let mut lines = [(0.0, 0.0); 28];
        let mut samples = [(0.0, 0.0); 28];
        for _ in 0..N {
            let ray = random_line(r, center, radius);
            let mut counts = [0.0; 28];
            geometry.all_hits(&ray, 0.0, f64::INFINITY, |hit| {
                assert!(bounds.contains(ray.at(hit.t)));
                counts[cell(ray.at(hit.t))] += 2.0 * PI * radius * radius;
                counts[27] += 2.0 * PI * radius * radius;
            });
            let sample = geometry.sample_area(0, r.uniform2());
            let mut weights = [0.0; 28];
            weights[cell(sample.point)] = sample.pdf.recip();
            weights[27] = sample.pdf.recip();
            for (sums, new) in [(&mut lines, counts), (&mut samples, weights)] {
                for (sum, x) in sums.iter_mut().zip(new) {
                    *sum = (sum.0 + x, sum.1 + x * x);
                }
            }
        }
        let n = N as f64;
        let estimate = |(sum, squares): (f64, f64)| (sum / n, (squares / n - (sum / n) * (sum / n)).max(0.0) / n);
        let (total, variance) = estimate(lines[27]);
        let area = geometry.area(0);
        assert!((total - area).abs() < 4.5 * variance.sqrt(), "{shape:?}: {area}, by lines {total}");
        let (total, variance) = estimate(samples[27]);
        assert!((total - area).abs() <= 4.5 * variance.sqrt() + 1e-9 * area, "{shape:?}: {area}, by samples {total}");
        let (mut chi2, mut cells) = (0.0, 0.0);
        for (line, sample) in lines.iter().zip(&samples).take(27).filter(|(line, _)| line.0 > 0.0) {
            let ((a, va), (b, vb)) = (estimate(*line), estimate(*sample));
            if va + vb > (1e-3 * area / n.sqrt()).powi(2) {
                chi2 += (a - b) * (a - b) / (va + vb);
                cells += 1.0;
            }
        }
        let limit = cells + 4.5 * (2.0f64 * cells).sqrt() + 8.0;
        assert!(chi2 < limit, "{shape:?}: χ² {chi2} over {cells} cells");
    });
}

#[test]
fn directions_towards_shapes_match_their_density() {
    const N: usize = 20_000;
    each_placed(|shape, _, geometry, r| {
        let bounds = geometry.all_bounds();
        let outside = bounds.center() + 0.9 * bounds.diagonal() * DVec3::new(0.6, 0.0, 0.8);
        for from in [outside, bounds.center() + 0.05] {
            // ---- what is drawn is hit, with the density claimed
            for _ in 0..200 {
                let Some(s) = geometry.sample_toward(0, from, r.uniform2()) else { continue };
                assert!((from + s.distance * s.direction).distance(s.point) < 1e-9);
                let mut found = f64::INFINITY;
                geometry.all_hits(&Ray::new(from, s.direction), 0.0, 100.0, |hit| {
                    if (hit.t - s.distance).abs() < 1e-6 {
                        let pdf = geometry.pdf_toward(0, from, s.direction, hit.t, hit.normal);
                        found = found.min((pdf / s.pdf - 1.0).abs());
                    }
                });
                let grazing = s.direction.dot(s.normal).abs() < 1e-2;
                assert!(found < 1e-4 || grazing, "{shape:?}: density off by {found}");
            }
            // ---- the density integrates to 1
            let (mut sum, mut squares) = (0.0, 0.0);
            for _ in 0..N {
                let ray = Ray::new(from, direction(r));
                let mut x = 0.0;
                geometry.all_hits(&ray, 0.0, 100.0, |hit| {
                    x += 4.0 * PI * geometry.pdf_toward(0, from, ray.direction, hit.t, hit.normal);
                });
                sum += x;
                squares += x * x;
            }
            let n = N as f64;
            let (mean, deviation) = (sum / n, ((squares / n - (sum / n).powi(2)) / n).sqrt());
            assert!((mean - 1.0).abs() < 5.0 * deviation + 1e-9, "{shape:?}: ∫ = {mean} ± {deviation}");
        }
    });
}

#[test]
fn spheres_tiny_and_huge_are_drawn_in_their_cone() {
    for (radius, gap) in [(1e-7, 1.0), (1.0, 1e-9), (1e7, 1e-2), (1.0, 1e5), (1e-3, 1e-3)] {
        let center = DVec3::new(0.0, 0.0, -(radius + gap));
        let sphere = Shape::Sphere(Sphere::new(center, radius).unwrap());
        let geometry = Geometry::new(vec![Placed::new(sphere, DAffine3::IDENTITY).unwrap()]);
        let mut r = random(radius.to_bits());
        for i in 0..1000 {
            let u = if i == 0 {
                [0.0, 0.0]
            } else if i == 1 {
                [1.0 - f64::EPSILON / 2.0, 0.5]
            } else {
                r.uniform2()
            };
            let s = geometry.sample_toward(0, DVec3::ZERO, u).unwrap();
            assert!(s.pdf.is_finite() && (s.normal.length() - 1.0).abs() < 1e-12);
            assert!(s.normal.dot(s.direction) <= 1e-7, "seen from behind");
            let rounding = 512.0 * f64::EPSILON * (radius + gap);
            assert!((s.distance * s.direction).distance(s.point) <= rounding);
            assert!(s.distance >= gap - rounding);
        }
    }
}

fn crowd(r: &mut Stream, count: usize) -> Vec<Placed> {
    let shapes = shapes();
    (0..count)
        .map(|i| {
            let m = DMat3::from_axis_angle(direction(r), 6.0 * r.uniform()) * (0.02 + 0.3 * r.uniform().powi(4));
            let flip = if r.uniform() < 0.5 { DVec3::NEG_ONE } else { DVec3::new(1.0, 1.5, 0.7) };
            let m = DAffine3::from_mat3_translation(m * DMat3::from_diagonal(flip), 2.0 * in_cube(r));
            Placed::new(shapes[i % shapes.len()].clone(), m).unwrap()
        })
        .collect()
}

#[test]
fn the_tree_finds_what_a_loop_finds() {
    let mut r = random(1);
    for count in [1, 2, 30, 300] {
        let placed = crowd(&mut r, count);
        let alone: Vec<Geometry> = placed.iter().map(|p| Geometry::new(vec![p.clone()])).collect();
        let tree = Geometry::new(placed);
        let mut cluster = Cluster::default();
        for i in 0..1000 {
            let mut ray = Ray::new(if i % 2 == 0 { 3.0 } else { 300.0 } * in_cube(&mut r), direction(&mut r));
            if i % 2 == 1 {
                ray.direction = (2.0 * in_cube(&mut r) - ray.origin).normalize();
            }
            // Along an axis, with zeros of both signs.
            if i % 5 == 0 {
                ray.direction = DVec3::AXES[i % 3] * if i % 4 < 2 { 1.0 } else { -1.0 };
                ray.origin = 2.0 * in_cube(&mut r) - 5.0 * ray.direction;
            }
            // ---- all hits
            let (mut found, mut expected) = (Vec::new(), Vec::new());
            tree.all_hits(&ray, 0.1, 600.0, |hit| found.push((hit.t.to_bits(), hit.id, hit.primitive)));
            for (id, shape) in tree.placed().iter().enumerate() {
                shape.crossings(&ray, 0.1, 600.0, &mut |t, primitive, _| {
                    expected.push((t.to_bits(), id as u32, primitive));
                    600.0
                });
            }
            found.sort_unstable();
            expected.sort_unstable();
            assert_eq!(found, expected);
            // ---- the nearest with its company, and whether anything is in the way
            let nearest = expected.first().map_or(f64::INFINITY, |hit| f64::from_bits(hit.0));
            expected.retain(|hit| f64::from_bits(hit.0) <= nearest + error_bound(&ray, nearest));
            assert_eq!(tree.intersect(&ray, 0.1, 600.0, &mut cluster), nearest < 600.0);
            let key = |hit: &Hit| (hit.t.to_bits(), hit.id, hit.primitive);
            assert!(cluster.hits().iter().map(key).eq(expected));
            // ---- the same one by one, of all that were collected
            let mut collected = Cluster::default();
            assert!(tree.collect(&ray, 0.1, 600.0, |_| false, &mut collected));
            let mut t = 0.1;
            while tree.intersect(&ray, t, 600.0, &mut cluster) {
                assert!(tree.intersect_next(&ray, t, 600.0, &mut collected));
                assert!(cluster.hits().iter().map(key).eq(collected.hits().iter().map(key)));
                t = cluster.hits().last().unwrap().t;
            }
            assert!(!tree.intersect_next(&ray, t, 600.0, &mut collected));
            let blocks = |id: u32| id % 3 == 1;
            assert_eq!(tree.collect(&ray, 0.1, 600.0, blocks, &mut collected), !found.iter().any(|hit| blocks(hit.1)));
            assert_eq!(tree.occluded(&ray, 0.1, 600.0, blocks), found.iter().any(|hit| blocks(hit.1)));
            // ---- what is around a point
            let p = 2.0 * in_cube(&mut r);
            let mut inside = SmallVec::new();
            tree.containing(p, &mut inside);
            assert!((0..count as u32).filter(|&id| tree.contains(id, p)).eq(inside));
            let nearest = alone.iter().map(|one| one.clearance(p, 0.3)).fold(0.3, f64::min);
            assert_eq!(tree.clearance(p, 0.3), nearest);
            let (mut found, mut expected) = (Vec::new(), Vec::new());
            tree.nearest_surfaces(p, 0.3, |near| found.push((near.id, near.primitive, near.distance.to_bits())));
            for (id, one) in alone.iter().enumerate() {
                one.nearest_surfaces(p, 0.3, |near| {
                    expected.push((id as u32, near.primitive, near.distance.to_bits()));
                });
            }
            found.sort_unstable();
            expected.sort_unstable();
            assert_eq!(found, expected);
        }
    }
}

#[test]
fn no_ray_slips_through_edges_and_corners_of_a_mesh() {
    let mesh = Arc::new(icosphere(3, false));
    let skew = DAffine3::from_mat3_translation(
        DMat3::from_cols_array(&[1.1, 0.3, 0.0, -0.2, 0.7, 0.4, 0.1, 0.0, -0.9]),
        DVec3::new(1e3, -2e3, 3e3),
    );
    for transform in [DAffine3::IDENTITY, skew] {
        let geometry = Geometry::new(vec![Placed::new(Shape::Mesh(mesh.clone()), transform).unwrap()]);
        let mut r = random(2);
        let mut cluster = Cluster::default();
        for triangle in 0..mesh.triangle_count() as u32 {
            let corners = mesh.corners(triangle);
            for k in 0..12 {
                let (a, b) = (corners[k % 3], corners[(k + 1) % 3]);
                let target = if k < 3 { a } else { a.lerp(b, r.uniform()) };
                let target = transform.transform_point3(target);
                let from = transform.transform_point3(if k == 5 { DVec3::ZERO } else { 0.5 * in_cube(&mut r) });
                let ray = Ray::new(from, (target - from).normalize());
                assert!(geometry.intersect(&ray, 0.0, 1e9, &mut cluster), "slipped out");
                assert!(geometry.occluded(&ray, 0.0, 1e9, |_| true));
                let distance = from.distance(target);
                assert!((cluster.nearest().unwrap().t - distance).abs() < 1e-2);
                // Seen from outside, the ray must not come through to the far side first.
                let out = Ray::new(from + 4.0 * distance * ray.direction, -ray.direction);
                assert!(geometry.intersect(&out, 0.0, 1e9, &mut cluster), "slipped in");
                assert!((cluster.nearest().unwrap().t - 3.0 * distance).abs() < 1e-2);
            }
        }
    }
}

#[test]
fn no_ray_leaves_a_room_of_quads_through_its_edges() {
    let (low, high) = (DVec3::new(0.1, -0.7, 1.3), DVec3::new(5.7, 2.2, 4.9));
    let e = (high - low).to_array();
    for transform in transforms() {
        let walls = (0..6).map(|i| {
            let (u, v) = ((i + 1) % 3, (i + 2) % 3);
            let (u, v) = (DVec3::AXES[u] * e[u], DVec3::AXES[v] * e[v]);
            let shape = Quad::new(if i < 3 { low } else { high - u - v }, u, v).unwrap();
            Placed::new(Shape::Quad(shape), transform).unwrap()
        });
        let geometry = Geometry::new(walls.collect());
        let mut r = random(5);
        for i in 0..20_000 {
            let from = low.lerp(high, 0.5) + 0.4 * (high - low) * in_cube(&mut r);
            let pick = |r: &mut Stream| DVec3::new(r.uniform(), r.uniform(), r.uniform()).round();
            // A corner, or a point of the edge there.
            let mut share = pick(&mut r).to_array();
            if i % 4 > 0 {
                share[i % 3] = r.uniform();
            }
            let target = low + DVec3::from_array(share) * (high - low);
            let [from, target] = [from, target].map(|p| transform.transform_point3(p));
            let ray = Ray::new(from, (target - from).normalize());
            assert!(geometry.occluded(&ray, 0.0, 100.0, |_| true), "a gap at {target}");
        }
    }
}

#[test]
fn far_and_scaled_scenes_give_the_same_hits() {
    let mut r = random(3);
    let placed = crowd(&mut r, 60);
    let here = Geometry::new(placed.clone());
    for (scale, shift) in [(1.0, 1e5), (1e4, 0.0), (1e-4, 0.0), (1e4, 1e5), (1e-2, 1e3)] {
        let shift = shift * DVec3::new(0.7, -1.0, 0.4);
        let m = DAffine3::from_scale(DVec3::splat(scale));
        let moved = DAffine3::from_translation(shift) * m;
        let there = placed.iter().map(|p| Placed::new(p.shape().clone(), moved * *p.to_world()).unwrap()).collect();
        let there = Geometry::new(there);
        let (mut a, mut b) = (Cluster::default(), Cluster::default());
        let mut hits = 0;
        for _ in 0..1000 {
            let mut ray = Ray::new(3.0 * in_cube(&mut r), direction(&mut r));
            let id = (60.0 * r.uniform()) as u32;
            ray.direction = (here.bounds(id).center() + 0.05 * in_cube(&mut r) - ray.origin).normalize();
            let far = Ray::new(moved.transform_point3(ray.origin), ray.direction);
            here.intersect(&ray, 0.0, 100.0, &mut a);
            there.intersect(&far, 0.0, 100.0 * scale, &mut b);
            let (Some(x), Some(y)) = (a.nearest(), b.nearest()) else {
                // Only a ray that grazes may differ.
                assert_eq!(a.nearest().is_some(), b.nearest().is_some());
                continue;
            };
            hits += 1;
            let cosine = y.normal.dot(far.direction).abs();
            let rounding = (error_bound(&far, y.t) + scale * error_bound(&ray, x.t)) / cosine;
            assert!(x.id == y.id && (scale * x.t - y.t).abs() <= 4.0 * rounding, "{x:?} {y:?} {rounding}");
        }
        assert!(hits > 100);
    }
    // ---- a small sphere seen from 10⁵ radii away
    let sphere = Placed::new(Shape::Sphere(Sphere::new(DVec3::ZERO, 1.0).unwrap()), DAffine3::IDENTITY).unwrap();
    let geometry = Geometry::new(vec![sphere]);
    let mut cluster = Cluster::default();
    for _ in 0..1000 {
        let target = direction(&mut r) * r.uniform().sqrt() * 0.999;
        let from = 1e5 * direction(&mut r);
        let ray = Ray::new(from, (target - from).normalize());
        assert!(geometry.intersect(&ray, 0.0, f64::INFINITY, &mut cluster));
        let t = cluster.nearest().unwrap().t;
        assert!((ray.at(t).length() - 1.0).abs() < error_bound(&ray, t));
    }
}

#[test]
fn faces_that_coincide_are_one_event() {
    let v = DVec3::new;
    for transform in transforms() {
        let place = |shape| Placed::new(shape, transform).unwrap();
        let geometry = Geometry::new(vec![
            place(Shape::Cuboid(Cuboid::new(v(-1.0, -1.0, -1.0), v(0.3, 1.0, 1.0)).unwrap())),
            place(Shape::Cuboid(Cuboid::new(v(0.3, -1.0, -1.0), v(2.0, 1.0, 1.0)).unwrap())),
            place(Shape::Quad(Quad::new(v(0.3, -1.0, -1.0), v(0.0, 2.0, 0.0), v(0.0, 0.0, 2.0)).unwrap())),
            place(Shape::Disk(Disk::new(v(0.3, 0.0, 0.0), v(1.0, 0.0, 0.0), 2.0).unwrap())),
            place(Shape::Cylinder(Cylinder::new(v(0.3, 0.0, 0.0), v(1.0, 0.0, 0.0), 2.0, true).unwrap())),
            // Its face lies apart.
            place(Shape::Cuboid(Cuboid::new(v(0.3 + 1e-9, -1.0, -1.0), v(3.0, 1.0, 1.0)).unwrap())),
        ]);
        let mut r = random(4);
        let mut cluster = Cluster::default();
        for _ in 0..1000 {
            let from = transform.transform_point3(v(-0.9, 0.0, 0.0) + 0.05 * in_cube(&mut r));
            let to = transform.transform_point3(v(0.3, 1.8 * r.uniform() - 0.9, 1.8 * r.uniform() - 0.9));
            let ray = Ray::new(from, (to - from).normalize());
            assert!(geometry.intersect(&ray, 0.0, 100.0, &mut cluster));
            let mut ids: Vec<u32> = cluster.hits().iter().map(|hit| hit.id).collect();
            ids.sort_unstable();
            assert_eq!(ids, [0, 1, 2, 3, 4]);
        }
    }
}

#[test]
fn nearest_points_are_nearest() {
    each_placed(|shape, transform, geometry, r| {
        let dense: Vec<DVec3> = (0..20_000).map(|_| geometry.sample_area(0, r.uniform2()).point).collect();
        let spacing = (geometry.area(0) / dense.len() as f64).sqrt();
        for _ in 0..40 {
            let p = 1.5 * in_cube(r);
            let sampled = dense.iter().map(|q| q.distance(p)).fold(f64::INFINITY, f64::min);
            let mut nearest = f64::INFINITY;
            geometry.nearest_surfaces(p, 10.0, |near| {
                assert!((near.point.distance(p) - near.distance).abs() < 1e-12);
                assert!((p - near.point).dot(near.normal) >= 0.0);
                let (apart, _) = offset(shape, transform.inverse().transform_point3(near.point));
                assert!(apart < 1e-6, "not on the surface");
                nearest = nearest.min(near.distance);
            });
            assert!(nearest <= sampled + 1e-9, "{shape:?}: {nearest}, but {sampled} is as near");
            assert!(nearest >= sampled - 6.0 * spacing);
            let mut any = false;
            geometry.nearest_surfaces(p, 0.99 * nearest, |_| any = true);
            assert!(!any);
            assert!((geometry.clearance(p, 10.0) - nearest).abs() < 1e-9);
            assert_eq!(geometry.clearance(p, 0.5 * nearest), 0.5 * nearest);
        }
    });
}

/// Parts of a mesh that a search passes by hold no wall: on a ball with waves of many directions and sizes.
#[test]
fn walls_of_a_mesh_are_all_found() {
    let (mut positions, triangles) = icosphere_parts(4);
    for p in &mut positions {
        *p *= 1.0 + 0.15 * (9.0 * p.x).sin() * (7.0 * p.y).cos() + 0.02 * (40.0 * p.z).sin();
    }
    let mesh = Mesh::new(positions, triangles, false).unwrap();
    let mut r = random(11);
    let mut walls = 0;
    for _ in 0..2000 {
        let (p, radius) = (1.3 * in_cube(&mut r), 0.6 * r.uniform());
        let all: Vec<(f64, DVec3, bool)> = (0..mesh.triangle_count() as u32)
            .map(|i| {
                let way = p - face::Face::Triangle(mesh.corners(i)).closest(p);
                let distance = way.length();
                (distance, mesh.normal(i), way.dot(mesh.normal(i)).abs() >= mesh::SAME_WAY * distance)
            })
            .filter(|&(distance, ..)| distance <= radius)
            .collect();
        let mut found = Vec::new();
        mesh.faces_near(p, radius, &mut |_, on, normal| found.push((on.distance(p), normal)));
        let nearest = |distances: &mut dyn Iterator<Item = f64>| distances.fold(f64::INFINITY, f64::min);
        assert_eq!(nearest(&mut found.iter().map(|f| f.0)), nearest(&mut all.iter().map(|f| f.0)));
        if found.len() >= 6 {
            continue;
        }
        for (distance, normal, _) in all.iter().filter(|&&(_, _, over)| over) {
            // What hid it may have been hidden itself, by one that faces up to twice as far away.
            let hides = |f: &&(f64, DVec3)| f.0 <= *distance && f.1.dot(*normal) > 0.8;
            assert!(found.iter().any(|f| hides(&f)), "{distance} from {p}, of {found:?}");
            walls += 1;
        }
    }
    assert!(walls > 1000, "{walls}");
}

#[test]
fn a_corner_has_three_planes() {
    let v = DVec3::new;
    let cuboid = Shape::Cuboid(Cuboid::new(DVec3::NEG_ONE, DVec3::ONE).unwrap());
    let walls = DVec3::AXES.map(|n| {
        let (a, b) = (v(n.y, n.z, n.x), v(n.z, n.x, n.y));
        Shape::Quad(Quad::new(DVec3::ONE - 2.0 * a - 2.0 * b, 2.0 * a, 2.0 * b).unwrap())
    });
    for transform in transforms() {
        for shapes in [vec![cuboid.clone()], vec![Shape::Mesh(Arc::new(box_mesh()))], walls.to_vec()] {
            let geometry = Geometry::new(shapes.into_iter().map(|s| Placed::new(s, transform).unwrap()).collect());
            let p = transform.transform_point3(v(0.9, 0.92, 0.94));
            let mut seen = 0;
            geometry.nearest_surfaces(p, 0.2, |near| {
                let local = transform.inverse().transform_point3(near.point);
                assert!((local.max_element() - 1.0).abs() < 1e-9);
                seen += 1;
            });
            assert_eq!(seen, 3);
        }
    }
}

#[test]
fn sides_of_open_shapes_follow_the_transform() {
    for transform in transforms() {
        let m = transform.matrix3;
        for shape in shapes() {
            let mesh = Mesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::new(0.2, 1.0, 0.3)], vec![[0, 1, 2]], true).unwrap();
            let (expected, shape) = match shape {
                Shape::Quad(q) => {
                    let [_, u, v] = q.face();
                    ((m * u).cross(m * v), Shape::Quad(q))
                }
                Shape::Disk(d) => (m.inverse().transpose() * d.normal(), Shape::Disk(d)),
                // In place of the sphere, an open mesh.
                Shape::Sphere(_) => (m.inverse().transpose() * mesh.normal(0), Shape::Mesh(Arc::new(mesh))),
                _ => continue,
            };
            let geometry = Geometry::new(vec![Placed::new(shape, transform).unwrap()]);
            let sample = geometry.sample_area(0, [0.3, 0.6]);
            assert!(sample.normal.distance(expected.normalize()) < 1e-6);
            for side in [1.0, -1.0] {
                let ray = Ray::new(sample.point + side * sample.normal, -side * sample.normal);
                let mut cluster = Cluster::default();
                assert!(geometry.intersect(&ray, 0.0, 2.0, &mut cluster));
                assert!(cluster.nearest().unwrap().normal.distance(sample.normal) < 1e-12);
            }
        }
    }
}

#[test]
fn degenerate_shapes_are_refused() {
    let (zero, one, nan) = (DVec3::ZERO, DVec3::ONE, DVec3::NAN);
    assert!(Sphere::new(zero, 0.0).is_err() && Sphere::new(nan, 1.0).is_err() && Sphere::new(zero, -1.0).is_err());
    assert!(Cuboid::new(one, one).is_err() && Cuboid::new(zero, nan).is_err());
    assert!(Quad::new(zero, one, 2.0 * one).is_err() && Quad::new(zero, zero, one).is_err());
    assert!(Disk::new(zero, zero, 1.0).is_err() && Disk::new(zero, one, f64::INFINITY).is_err());
    assert!(Cylinder::new(one, one, 1.0, true).is_err() && Cylinder::new(zero, one, f64::NAN, true).is_err());
    assert!(Mesh::new(vec![Vec3::ZERO; 3], vec![[0, 1, 2]], true).is_err());
    assert!(Mesh::new(vec![Vec3::ZERO; 3], vec![[0, 1, 3]], true).is_err());
    assert!(Mesh::new(Vec::new(), Vec::new(), true).is_err());
    let sphere = || Shape::Sphere(Sphere::new(zero, 1.0).unwrap());
    for scale in [DVec3::new(1.0, 0.0, 1.0), DVec3::splat(1e-200), DVec3::splat(f64::INFINITY), nan] {
        assert!(Placed::new(sphere(), DAffine3::from_scale(scale)).is_err(), "{scale}");
    }
    let empty = Geometry::new(Vec::new());
    let mut cluster = Cluster::default();
    assert!(!empty.intersect(&Ray::new(zero, DVec3::X), 0.0, f64::INFINITY, &mut cluster));
}
