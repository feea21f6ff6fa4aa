//! Splatting against gathering: the photons of one map drawn into a picture of 256 × 256 pixels, four rays each, and
//! the same picture gathered by bundles. One thread. `cargo bench --bench splat`.
//!
//! Each photon is put into lists of the tiles of 8 × 8 pixels that its disc may touch; then tile by tile, whose
//! sums stay in the nearest cache, each photon's disc is drawn into the vectors of 2 × 2 pixels, sixteen rays, that a
//! rectangle around it covers. Distances are exact; so are phase function and transmittance, or they are taken once a
//! photon, in the direction of its own place: the least that splatting can cost, as bundles have them vary from ray to
//! ray.

#[path = "photons/mod.rs"]
mod photons;

#[cfg(target_arch = "x86_64")]
fn main() {
    if is_x86_feature_detected!("avx512f") {
        splat::compare_all();
    } else {
        println!("needs AVX-512");
    }
}

#[cfg(not(target_arch = "x86_64"))]
fn main() {
    println!("needs AVX-512");
}

#[cfg(target_arch = "x86_64")]
mod splat {
    use super::photons;
    use glam::{DVec3, Vec3};
    use std::arch::x86_64::*;
    use std::f32::consts::{FRAC_1_PI, PI};
    use volpm::gather::{Bundle, BundleScratch, GatherStats, PhaseLanes};
    use volpm::math::random::{Purpose, Stream};
    use volpm::math::{Frame, Ray};
    use volpm::medium::phase::HenyeyGreenstein;
    use volpm::photon::{Disc, MapSettings, Photon, PhotonMap, Radius};

    const SIGMA: f32 = 0.4;
    const G: f32 = 0.75;
    const PIXELS: usize = 256;
    /// Along an edge of the picture.
    const TILES: usize = PIXELS / 8;
    /// Vectors of a tile, and along an edge of it.
    const VECTORS: usize = 16;
    const EDGE: usize = 4;

    struct View {
        from: DVec3,
        frame: Frame,
        /// The tangent of half the angle of view.
        reach: f64,
    }

    /// The rays of a tile: slopes along x and y, 1/(1 + s²) and its root, sixteen a vector.
    #[repr(C, align(64))]
    struct Tile {
        slopes: [[[f32; 16]; 4]; VECTORS],
        sums: [[[f32; 16]; 3]; VECTORS],
    }

    /// A photon in the view's frame, and the vectors that its disc may touch: from column and row up to column and row.
    #[derive(Clone, Copy)]
    struct Splat {
        x: [f32; 3],
        inverse_square: f32,
        direction: [f32; 3],
        power: [f32; 3],
        /// Phase function and transmittance at its own place.
        weight: f32,
        vectors: [u8; 4],
    }

    impl View {
        /// All rays, tile by tile, those of 2 × 2 pixels next to one another.
        fn rays(&self) -> Vec<Ray> {
            let mut stream = Stream::new(3, Purpose::Test, 0, 0);
            let mut all = Vec::with_capacity(4 * PIXELS * PIXELS);
            for tile in 0..TILES * TILES {
                let corner = [tile % TILES, tile / TILES].map(|x| (8 * x) as f64);
                for i in 0..256 {
                    let (vector, pixel, [a, b]) = (i / 16, i / 4 % 4, stream.uniform2());
                    let x = corner[0] + (2 * (vector % EDGE) + pixel % 2) as f64 + a;
                    let y = corner[1] + (2 * (vector / EDGE) + pixel / 2) as f64 + b;
                    let slope = |x: f64| self.reach * (2.0 * x / PIXELS as f64 - 1.0);
                    let across = slope(x) * self.frame.x + slope(y) * self.frame.y;
                    all.push(Ray::new(self.from, (self.frame.z + across).normalize()));
                }
            }
            all
        }

        fn tile(&self, rays: &[Ray]) -> Tile {
            let mut tile = Tile { slopes: [[[0.0; 16]; 4]; VECTORS], sums: [[[0.0; 16]; 3]; VECTORS] };
            for (vector, rays) in tile.slopes.iter_mut().zip(rays.chunks(16)) {
                for (lane, ray) in rays.iter().enumerate() {
                    let along = self.frame.z.dot(ray.direction);
                    vector[0][lane] = (self.frame.x.dot(ray.direction) / along) as f32;
                    vector[1][lane] = (self.frame.y.dot(ray.direction) / along) as f32;
                    vector[2][lane] = (along * along) as f32;
                    vector[3][lane] = along as f32;
                }
            }
            tile
        }

        /// What there is to draw of a disc.
        fn project(&self, disc: &Disc) -> Option<Splat> {
            let to = disc.photon.position.as_dvec3() - self.from;
            let x = [self.frame.x, self.frame.y, self.frame.z].map(|axis| axis.dot(to) as f32);
            if x[2] <= 0.0 {
                return None;
            }
            let r = disc.radius;
            let scale = 0.25 * PIXELS as f32 / self.reach as f32;
            let middle = 0.25 * PIXELS as f32;
            let most = middle * 2.0 - 1.0;
            let mut vectors = [0, 0, most as u8, most as u8];
            for axis in 0..2 {
                // Beside the pyramid of view.
                let reach = self.reach as f32;
                if x[axis].abs() - reach * x[2] > r * (1.0 + reach * reach).sqrt() {
                    return None;
                }
                // Where lines from the eye touch the ball around the photon.
                let denominator = x[2] * x[2] - r * r;
                if x[2] > r {
                    let root = r * (x[axis] * x[axis] + denominator).sqrt();
                    let edges = [-root, root].map(|root| middle + scale * (x[axis] * x[2] + root) / denominator);
                    if edges[1] < 0.0 || edges[0] > most + 1.0 {
                        return None;
                    }
                    vectors[axis] = edges[0].clamp(0.0, most) as u8;
                    vectors[2 + axis] = edges[1].clamp(0.0, most) as u8;
                }
            }
            let distance = to.length() as f32;
            let cosine = -disc.photon.direction.dot(to.as_vec3()) / distance;
            let base = 1.0 + G * G - 2.0 * G * cosine;
            let weight = (-SIGMA * distance).exp() / (base * base.sqrt());
            let inverse_square = 1.0 / (r * r);
            let constant = 3.0 / PI * inverse_square * (1.0 - G * G) * 0.25 * FRAC_1_PI;
            let power = (constant * disc.photon.power).to_array();
            let to = disc.photon.direction.as_dvec3();
            let direction = [self.frame.x, self.frame.y, self.frame.z].map(|axis| axis.dot(to) as f32);
            Some(Splat { x, inverse_square, direction, power, weight, vectors })
        }
    }

    /// Minimax coefficients of (2^f − 1)/f on [−½, ½].
    const EXP2: [f32; 6] =
        [std::f32::consts::LN_2, 0.240_226_53, 0.055_503_106, 0.009_617_693, 0.001_340_664_4, 0.000_155_946_77];

    /// Henyey and Greenstein's function without its constant, and transmittance.
    #[target_feature(enable = "avx512f")]
    #[inline]
    fn phase_and_transmittance(t: __m512, cosine: __m512) -> __m512 {
        let base = _mm512_fmadd_ps(cosine, _mm512_set1_ps(2.0 * G), _mm512_set1_ps(1.0 + G * G));
        let y = _mm512_rsqrt14_ps(base);
        let half = _mm512_mul_ps(_mm512_mul_ps(base, _mm512_set1_ps(0.5)), y);
        let y = _mm512_mul_ps(y, _mm512_fnmadd_ps(half, y, _mm512_set1_ps(1.5)));
        let exponents = _mm512_mul_ps(t, _mm512_set1_ps(-SIGMA * std::f32::consts::LOG2_E));
        let n = _mm512_roundscale_ps::<8>(exponents);
        let f = _mm512_sub_ps(exponents, n);
        let mut p = _mm512_set1_ps(EXP2[5]);
        for index in (0..5).rev() {
            p = _mm512_fmadd_ps(p, f, _mm512_set1_ps(EXP2[index]));
        }
        let passed = _mm512_scalef_ps(_mm512_fmadd_ps(p, f, _mm512_set1_ps(1.0)), n);
        let ahead = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(_mm512_setzero_ps(), t);
        _mm512_maskz_mul_ps(ahead, passed, _mm512_mul_ps(_mm512_mul_ps(y, y), y))
    }

    /// Draws photons into a tile.
    #[target_feature(enable = "avx512f")]
    fn draw<const EXACT: bool>(tile: &mut Tile, corner: [u8; 2], splats: &[Splat], list: &[u32]) {
        let zero = _mm512_setzero_ps();
        for &index in list {
            let splat = &splats[index as usize];
            let x = [_mm512_set1_ps(splat.x[0]), _mm512_set1_ps(splat.x[1]), _mm512_set1_ps(splat.x[2])];
            let inverse_square = _mm512_set1_ps(splat.inverse_square);
            let [dx, dy, dz] = splat.direction;
            let d = [_mm512_set1_ps(dx), _mm512_set1_ps(dy), _mm512_set1_ps(dz)];
            let [r, g, b] = splat.power;
            let power = [_mm512_set1_ps(r), _mm512_set1_ps(g), _mm512_set1_ps(b)];
            let [x0, y0, x1, y1] = splat.vectors;
            let (x0, y0) = (x0.saturating_sub(corner[0]), y0.saturating_sub(corner[1]));
            let most = EDGE as u8 - 1;
            let (x1, y1) = ((x1 - corner[0]).min(most), (y1 - corner[1]).min(most));
            for row in y0..=y1 {
                for column in x0..=x1 {
                    let vector = (EDGE * row as usize + column as usize) % VECTORS;
                    let [sx, sy, inverse, along] = &tile.slopes[vector];
                    // SAFETY: each is sixteen numbers.
                    let (sx, sy, inverse) = unsafe {
                        (_mm512_load_ps(sx.as_ptr()), _mm512_load_ps(sy.as_ptr()), _mm512_load_ps(inverse.as_ptr()))
                    };
                    let a = _mm512_fnmadd_ps(x[2], sx, x[0]);
                    let b = _mm512_fnmadd_ps(x[2], sy, x[1]);
                    let c = _mm512_fmsub_ps(a, sy, _mm512_mul_ps(b, sx));
                    let square = _mm512_fmadd_ps(a, a, _mm512_fmadd_ps(b, b, _mm512_mul_ps(c, c)));
                    let x2 = _mm512_mul_ps(square, _mm512_mul_ps(inverse, inverse_square));
                    let q = _mm512_max_ps(_mm512_sub_ps(_mm512_set1_ps(1.0), x2), zero);
                    let rest = if EXACT {
                        // SAFETY: sixteen numbers.
                        let along = unsafe { _mm512_load_ps(along.as_ptr()) };
                        let t = _mm512_fmadd_ps(x[0], sx, _mm512_fmadd_ps(x[1], sy, x[2]));
                        let cosine = _mm512_fmadd_ps(d[0], sx, _mm512_fmadd_ps(d[1], sy, d[2]));
                        phase_and_transmittance(_mm512_mul_ps(t, along), _mm512_mul_ps(cosine, along))
                    } else {
                        _mm512_set1_ps(splat.weight)
                    };
                    let weight = _mm512_mul_ps(_mm512_mul_ps(q, q), rest);
                    let [red, green, blue] = &mut tile.sums[vector];
                    add(red, weight, power[0]);
                    add(green, weight, power[1]);
                    add(blue, weight, power[2]);
                }
            }
        }
    }

    #[target_feature(enable = "avx512f")]
    #[inline]
    fn add(sum: &mut [f32; 16], weight: __m512, power: __m512) {
        // SAFETY: sixteen numbers, of a whole cache line.
        unsafe {
            let before = _mm512_load_ps(sum.as_ptr());
            _mm512_store_ps(sum.as_mut_ptr(), _mm512_fmadd_ps(weight, power, before));
        }
    }

    /// Seconds that this thread has run.
    fn seconds() -> f64 {
        let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
        // SAFETY: the call writes one timespec, which `time` is.
        unsafe { libc::clock_gettime(libc::CLOCK_THREAD_CPUTIME_ID, &mut time) };
        time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
    }

    fn compare(name: &str, photons: Vec<Photon>, radius: Radius, view: &View) {
        let map = PhotonMap::build(photons, &MapSettings::new(radius), &|_: Vec3, _: f32, _: f32, _: &mut _| ());
        let discs: Vec<Disc> = map.discs().collect();
        let rays = view.rays();
        let phase = PhaseLanes::new(HenyeyGreenstein { g: G.into() });
        let reaches: Vec<(Ray, f64, f64)> = rays.iter().map(|ray| (*ray, 0.0, f64::INFINITY)).collect();

        let mut best = [f64::INFINITY; 4];
        let (mut gathered, mut drawn, mut drawn_vectors) = (0.0, [0.0; 2], 0);
        let mut stats = GatherStats::default();
        for _ in 0..2 {
            let (mut scratch, mut out) = (BundleScratch::default(), Vec::new());
            stats = GatherStats::default();
            gathered = 0.0;
            let start = seconds();
            for rays in reaches.chunks(256) {
                let bundle = Bundle {
                    rays,
                    phase: &phase,
                    extinction: Vec3::splat(SIGMA),
                    max_events: u8::MAX,
                    pruned: false,
                    depths: None,
                };
                map.gather_bundle(&bundle, &mut scratch, &mut stats, &mut out);
                gathered += out.iter().map(|ray| f64::from(ray.total[1])).sum::<f64>();
            }
            best[0] = best[0].min(seconds() - start);

            let start = seconds();
            let splats: Vec<Splat> = discs.iter().filter_map(|disc| view.project(disc)).collect();
            let projected = seconds() - start;
            let (mut listing, mut spent) = (0.0, [0.0; 2]);
            let mut lists = vec![Vec::new(); TILES];
            drawn = [0.0; 2];
            for row in 0..TILES {
                // The lists of a row of tiles.
                let start = seconds();
                lists.iter_mut().for_each(Vec::clear);
                for (index, splat) in splats.iter().enumerate() {
                    let [x0, y0, x1, y1] = splat.vectors.map(|vector| vector as usize / EDGE);
                    if y0 <= row && row <= y1 {
                        lists[x0..=x1].iter_mut().for_each(|list| list.push(index as u32));
                    }
                }
                listing += seconds() - start;
                for (column, list) in lists.iter().enumerate() {
                    let first = 256 * (row * TILES + column);
                    let corner = [column, row].map(|x| (x * EDGE) as u8);
                    for exact in [false, true] {
                        let mut tile = view.tile(&rays[first..first + 256]);
                        let start = seconds();
                        // SAFETY: the feature is there.
                        unsafe {
                            if exact {
                                draw::<true>(&mut tile, corner, &splats, list);
                            } else {
                                draw::<false>(&mut tile, corner, &splats, list);
                            }
                        }
                        spent[usize::from(exact)] += seconds() - start;
                        let sum = tile.sums.iter().flat_map(|sums| sums[1]).map(f64::from).sum::<f64>();
                        drawn[usize::from(exact)] += sum;
                    }
                }
            }
            best[1] = best[1].min(projected + listing);
            best[2] = best[2].min(spent[0]);
            best[3] = best[3].min(spent[1]);
            drawn_vectors = splats
                .iter()
                .map(|splat| {
                    let [x0, y0, x1, y1] = splat.vectors.map(u64::from);
                    (x1 - x0 + 1) * (y1 - y0 + 1)
                })
                .sum::<u64>();
        }
        let pairs = stats.photons as f64;
        let each = |seconds: f64| seconds * 1e9 / pairs;
        println!(
            "{name}: {:.0} photons a ray, bundles {:.3} s, {:.3} ns a pair; lists {:.3} s, {:.2} tested a hit",
            pairs / rays.len() as f64,
            best[0],
            each(best[0]),
            best[1],
            16.0 * drawn_vectors as f64 / pairs,
        );
        for (what, drawing, drawn) in [("exact", best[3], drawn[1]), ("at least", best[2], drawn[0])] {
            println!(
                "  splatting, {what}: {:.3} s with lists, {:.2}× bundles; drawing {:.3} ns a pair, {:.2}×; sums differ by {:+.2} %",
                best[1] + drawing,
                (best[1] + drawing) / best[0],
                each(drawing),
                drawing / best[0],
                100.0 * (drawn / gathered - 1.0),
            );
        }
    }

    pub fn compare_all() {
        let count = std::env::args().skip(1).find_map(|a| a.parse().ok()).unwrap_or(1_000_000);
        let view = |from: DVec3, forward: DVec3, degrees: f64| View {
            from,
            frame: Frame::around(forward),
            reach: (0.5 * degrees.to_radians()).tan(),
        };
        let inside = view(DVec3::new(0.0, 0.0, -2.45), DVec3::Z, 50.0);
        let variable = Radius::Variable { neighbours: 500, pilot: 23, max_radius: 1.0 };
        compare("even, n = 500", photons::even(count), variable, &inside);
        compare(
            "six beams, n = 500",
            photons::beams(count),
            variable,
            &view(DVec3::new(0.0, -14.0, -0.5), DVec3::Y, 70.0),
        );
        compare("even, r = 0.02", photons::even(count), Radius::Fixed(0.02), &inside);
    }
}
