//! What rough dielectric boundaries let pass.

/// Nodes along the square root of the cosine, from 0 to 1,
const COSINES: usize = 16;
/// along the square root of α, from 0 to 1,
const ALPHAS: usize = 9;
/// and along (n − 1)/(n + 1), from that of the index n = 15/13
const INDICES: usize = 7;
const RAREST: f64 = 1.0 / 14.0;
/// to that of n = 3.
const DENSEST: f64 = 0.5;

/// The parts of light that pass a boundary of GGX facets from outside, after all events among its facets, in units of 10⁻⁴: by index, α and
/// cosine; and, last, that of diffuse light, 2∫T(μ) μ dμ, of the values as they are interpolated. Found by following light among the facets
/// (as Heitz et al. 2016, "Multiple-scattering microfacet BSDFs with the Smith model", do), 131 072 ways for each; a test makes them
/// again.
#[rustfmt::skip]
const PASSED: [[[u16; COSINES + 1]; ALPHAS]; INDICES] = [
    [
        [0, 353, 1339, 2760, 4358, 5897, 7207, 8215, 8922, 9380, 9656, 9811, 9892, 9930, 9945, 9949, 9636],
        [3132, 2995, 2969, 3581, 4720, 6060, 7271, 8217, 8920, 9364, 9656, 9812, 9886, 9927, 9942, 9950, 9641],
        [6180, 6179, 6176, 6279, 6617, 7154, 7787, 8482, 9005, 9391, 9644, 9804, 9894, 9927, 9946, 9949, 9692],
        [7941, 7969, 7964, 8051, 8197, 8393, 8682, 8965, 9265, 9497, 9681, 9805, 9877, 9921, 9940, 9952, 9762],
        [8833, 8856, 8864, 8923, 9017, 9117, 9252, 9381, 9529, 9650, 9760, 9840, 9894, 9925, 9943, 9951, 9831],
        [9267, 9285, 9314, 9355, 9408, 9470, 9552, 9637, 9708, 9774, 9837, 9879, 9907, 9935, 9949, 9954, 9880],
        [9516, 9513, 9529, 9580, 9609, 9659, 9706, 9757, 9806, 9850, 9883, 9913, 9931, 9951, 9959, 9963, 9915],
        [9639, 9641, 9652, 9679, 9715, 9758, 9797, 9837, 9866, 9887, 9915, 9936, 9953, 9961, 9968, 9971, 9938],
        [9718, 9726, 9740, 9764, 9789, 9814, 9851, 9872, 9900, 9922, 9933, 9947, 9965, 9968, 9976, 9978, 9952],
    ],
    [
        [0, 276, 1055, 2209, 3565, 4951, 6228, 7310, 8162, 8788, 9219, 9496, 9660, 9747, 9786, 9796, 9329],
        [2642, 2508, 2494, 2943, 3903, 5123, 6285, 7326, 8161, 8792, 9216, 9499, 9657, 9746, 9794, 9799, 9338],
        [5500, 5460, 5443, 5528, 5796, 6286, 6925, 7675, 8291, 8841, 9223, 9484, 9647, 9736, 9795, 9800, 9393],
        [7301, 7329, 7324, 7382, 7486, 7723, 8001, 8340, 8700, 9009, 9296, 9509, 9665, 9734, 9785, 9802, 9494],
        [8345, 8368, 8354, 8434, 8511, 8633, 8775, 8924, 9103, 9290, 9446, 9572, 9685, 9750, 9784, 9802, 9598],
        [8926, 8914, 8947, 8985, 9045, 9111, 9215, 9306, 9407, 9501, 9594, 9673, 9732, 9775, 9815, 9828, 9693],
        [9222, 9239, 9262, 9284, 9334, 9395, 9458, 9518, 9588, 9648, 9707, 9752, 9785, 9819, 9848, 9857, 9767],
        [9414, 9420, 9445, 9463, 9506, 9549, 9604, 9644, 9694, 9736, 9786, 9815, 9845, 9863, 9878, 9888, 9825],
        [9539, 9534, 9560, 9592, 9615, 9655, 9693, 9732, 9775, 9798, 9829, 9857, 9881, 9900, 9911, 9919, 9868],
    ],
    [
        [0, 252, 964, 2022, 3271, 4561, 5772, 6824, 7682, 8341, 8820, 9146, 9353, 9470, 9526, 9541, 9009],
        [2468, 2347, 2291, 2711, 3617, 4711, 5823, 6839, 7716, 8342, 8824, 9147, 9355, 9475, 9531, 9540, 9020],
        [5136, 5137, 5092, 5165, 5418, 5858, 6490, 7198, 7824, 8389, 8831, 9145, 9351, 9465, 9520, 9536, 9072],
        [6927, 6944, 6944, 7005, 7117, 7315, 7587, 7913, 8276, 8634, 8921, 9163, 9348, 9475, 9526, 9546, 9186],
        [7999, 7991, 8021, 8075, 8144, 8264, 8409, 8555, 8764, 8960, 9125, 9284, 9406, 9493, 9541, 9562, 9320],
        [8615, 8607, 8616, 8668, 8728, 8800, 8903, 9002, 9115, 9226, 9313, 9416, 9486, 9541, 9589, 9607, 9445],
        [8959, 8970, 8992, 9013, 9063, 9124, 9179, 9266, 9348, 9425, 9473, 9554, 9591, 9620, 9655, 9676, 9563],
        [9187, 9200, 9206, 9237, 9279, 9335, 9387, 9440, 9503, 9552, 9598, 9649, 9679, 9703, 9738, 9754, 9663],
        [9337, 9346, 9371, 9395, 9429, 9465, 9525, 9567, 9612, 9658, 9693, 9732, 9749, 9782, 9812, 9820, 9746],
    ],
    [
        [0, 248, 946, 1973, 3175, 4404, 5548, 6539, 7349, 7977, 8442, 8766, 8979, 9105, 9167, 9184, 8652],
        [2375, 2249, 2238, 2622, 3510, 4535, 5607, 6550, 7375, 7970, 8446, 8778, 8965, 9099, 9165, 9196, 8660],
        [4959, 4927, 4894, 4993, 5234, 5673, 6241, 6910, 7518, 8041, 8472, 8769, 8972, 9089, 9165, 9191, 8718],
        [6677, 6666, 6707, 6743, 6852, 7030, 7285, 7604, 7949, 8297, 8571, 8816, 8987, 9101, 9169, 9195, 8834],
        [7669, 7704, 7724, 7770, 7837, 7923, 8085, 8237, 8434, 8619, 8784, 8948, 9062, 9151, 9196, 9239, 8982],
        [8294, 8301, 8318, 8355, 8439, 8482, 8599, 8683, 8794, 8918, 9028, 9118, 9195, 9244, 9289, 9304, 9146],
        [8671, 8675, 8702, 8738, 8791, 8846, 8901, 8982, 9064, 9126, 9200, 9271, 9330, 9388, 9404, 9434, 9303],
        [8908, 8928, 8947, 8996, 9021, 9080, 9130, 9183, 9273, 9318, 9370, 9417, 9461, 9499, 9524, 9564, 9445],
        [9093, 9110, 9141, 9162, 9218, 9249, 9308, 9351, 9406, 9464, 9508, 9549, 9596, 9625, 9657, 9676, 9578],
    ],
    [
        [0, 256, 972, 2009, 3196, 4381, 5455, 6364, 7093, 7650, 8059, 8346, 8536, 8650, 8708, 8724, 8245],
        [2380, 2257, 2238, 2650, 3526, 4528, 5534, 6405, 7100, 7669, 8067, 8347, 8541, 8646, 8711, 8724, 8256],
        [4882, 4874, 4803, 4891, 5141, 5575, 6120, 6701, 7252, 7713, 8092, 8359, 8528, 8654, 8710, 8721, 8311],
        [6456, 6473, 6472, 6509, 6610, 6823, 7050, 7355, 7666, 7974, 8207, 8413, 8563, 8683, 8737, 8734, 8435],
        [7418, 7416, 7428, 7459, 7537, 7656, 7785, 7923, 8092, 8262, 8430, 8555, 8678, 8732, 8773, 8799, 8586],
        [7992, 7985, 8022, 8044, 8110, 8168, 8277, 8346, 8472, 8559, 8680, 8762, 8815, 8863, 8903, 8922, 8776],
        [8366, 8350, 8376, 8415, 8461, 8534, 8592, 8664, 8738, 8803, 8895, 8946, 9000, 9050, 9085, 9098, 8978],
        [8608, 8616, 8651, 8685, 8716, 8769, 8830, 8889, 8959, 9017, 9079, 9129, 9182, 9235, 9274, 9301, 9171],
        [8829, 8837, 8843, 8877, 8916, 8983, 9037, 9090, 9165, 9201, 9263, 9318, 9373, 9411, 9456, 9488, 9358],
    ],
    [
        [0, 275, 1035, 2111, 3304, 4449, 5444, 6250, 6869, 7325, 7650, 7873, 8018, 8106, 8150, 8163, 7776],
        [2393, 2304, 2297, 2732, 3584, 4580, 5505, 6276, 6855, 7324, 7648, 7887, 8014, 8111, 8164, 8160, 7787],
        [4825, 4807, 4779, 4891, 5116, 5536, 5994, 6553, 7000, 7394, 7690, 7880, 8020, 8126, 8161, 8186, 7846],
        [6268, 6308, 6289, 6350, 6472, 6631, 6875, 7091, 7368, 7596, 7781, 7949, 8057, 8130, 8191, 8190, 7953],
        [7130, 7122, 7161, 7183, 7266, 7346, 7501, 7627, 7772, 7892, 8007, 8109, 8182, 8233, 8258, 8261, 8119],
        [7641, 7666, 7664, 7715, 7750, 7821, 7894, 8001, 8104, 8196, 8256, 8328, 8377, 8404, 8437, 8434, 8336],
        [7991, 7976, 8006, 8049, 8087, 8144, 8215, 8270, 8349, 8435, 8493, 8561, 8600, 8640, 8684, 8699, 8580],
        [8248, 8265, 8269, 8315, 8329, 8409, 8463, 8532, 8601, 8662, 8742, 8799, 8852, 8887, 8936, 8970, 8831],
        [8482, 8498, 8523, 8548, 8600, 8645, 8701, 8776, 8845, 8904, 8962, 9041, 9078, 9145, 9172, 9228, 9073],
    ],
    [
        [0, 306, 1138, 2278, 3487, 4585, 5481, 6157, 6640, 6970, 7189, 7330, 7417, 7467, 7493, 7500, 7234],
        [2492, 2385, 2408, 2902, 3733, 4702, 5527, 6170, 6622, 6956, 7193, 7353, 7422, 7476, 7494, 7506, 7244],
        [4789, 4780, 4795, 4881, 5156, 5543, 5976, 6385, 6749, 7022, 7213, 7329, 7421, 7471, 7506, 7507, 7290],
        [6097, 6106, 6139, 6178, 6298, 6443, 6666, 6842, 7050, 7210, 7318, 7402, 7463, 7524, 7522, 7536, 7395],
        [6799, 6817, 6829, 6881, 6964, 7057, 7140, 7257, 7363, 7471, 7571, 7595, 7622, 7649, 7647, 7630, 7577],
        [7234, 7248, 7281, 7293, 7300, 7408, 7497, 7559, 7636, 7728, 7754, 7831, 7843, 7876, 7869, 7871, 7812],
        [7540, 7543, 7543, 7593, 7653, 7709, 7742, 7839, 7915, 7976, 8040, 8103, 8124, 8160, 8194, 8188, 8105],
        [7799, 7818, 7844, 7867, 7918, 7982, 8032, 8094, 8178, 8255, 8313, 8375, 8437, 8486, 8513, 8560, 8414],
        [8078, 8062, 8101, 8158, 8185, 8222, 8318, 8360, 8447, 8525, 8600, 8652, 8728, 8804, 8850, 8897, 8721],
    ],
];

/// What passes a boundary of one index and α: places in the table.
pub(super) struct Transmittance {
    index: (usize, f64),
    alpha: (usize, f64),
}

/// The node below a share of so many, and how far beyond it that is.
fn place(share: f64, nodes: usize) -> (usize, f64) {
    let place = share.clamp(0.0, 1.0) * (nodes - 1) as f64;
    let below = (place as usize).min(nodes - 2);
    (below, place - below as f64)
}

fn mix(a: f64, b: f64, share: f64) -> f64 {
    a + share * (b - a)
}

impl Transmittance {
    /// Of a coat of this index against that of what is around; `None` where it is hardly denser, or not at all, or denser than what is known.
    pub(super) fn new(alpha: f64, index: f64) -> Option<Self> {
        let denser = ((index - 1.0) / (index + 1.0) - RAREST) / (DENSEST - RAREST);
        (0.0..=1.0)
            .contains(&denser)
            .then(|| Transmittance { index: place(denser, INDICES), alpha: place(alpha.sqrt(), ALPHAS) })
    }

    fn at(&self, node: usize) -> f64 {
        let Transmittance { index: (i, di), alpha: (a, da) } = *self;
        let of = |i: usize, a: usize| 1e-4 * f64::from(PASSED[i][a][node]);
        mix(mix(of(i, a), of(i, a + 1), da), mix(of(i + 1, a), of(i + 1, a + 1), da), di)
    }

    /// The part that passes from outside of light from an angle of this cosine.
    pub(super) fn from(&self, cos: f64) -> f64 {
        let (c, dc) = place(cos.max(0.0).sqrt(), COSINES);
        mix(self.at(c), self.at(c + 1), dc)
    }

    /// The part that passes from outside of diffuse light.
    pub(super) fn diffuse(&self) -> f64 {
        self.at(COSINES)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Purpose;
    use crate::math::{DVec3, Rgb, Stream};
    use crate::surface::coat::{Coat, Varnish};
    use crate::surface::fresnel::fresnel;

    /// The part that passes of so many ways from outside, and its standard error.
    fn walked(cos: f64, alpha: f64, index: f64, ways: u32, stream: &mut Stream) -> (f64, f64) {
        if alpha == 0.0 {
            return (1.0 - fresnel(cos, 1.0, index), 0.0);
        }
        let coat = Coat::Dielectric(Varnish::new(index, alpha));
        let travel = DVec3::new((1.0 - cos * cos).sqrt(), 0.0, -cos.max(1e-6));
        let (mut sum, mut squares) = (0.0, 0.0);
        for _ in 0..ways {
            let mut weight = Rgb::ONE;
            let crossed = coat.cross(Some(1.0), travel, &mut weight, stream, None, |_, _| {});
            let passed = if crossed.is_some_and(|crossed| crossed.through) { weight.x } else { 0.0 };
            (sum, squares) = (sum + passed, squares + passed * passed);
        }
        let mean = sum / f64::from(ways);
        (mean, ((squares / f64::from(ways) - mean * mean) / f64::from(ways)).sqrt())
    }

    /// Between the nodes, too, what the table says is what light finds that is followed.
    #[test]
    fn the_table_says_what_is_found() {
        let mut stream = Stream::new(2, Purpose::Test, 0, 0);
        for _ in 0..60 {
            let [cos, alpha] = stream.uniform2();
            let index = 1.16 + 1.8 * stream.uniform();
            let (mean, error) = walked(cos, alpha, index, 20_000, &mut stream);
            let told = Transmittance::new(alpha, index).unwrap().from(cos);
            assert!((told - mean).abs() < 4.0 * error + 0.004, "{told}, not {mean} at {cos}, {alpha}, {index}");
        }
        for (alpha, index) in [(0.2, 1.5), (0.7, 2.2)] {
            const STEPS: u32 = 2000;
            let of = |step: u32| (f64::from(step) + 0.5) / f64::from(STEPS);
            let passes = Transmittance::new(alpha, index).unwrap();
            let sum: f64 = (0..STEPS).map(|step| 2.0 * of(step) * passes.from(of(step))).sum();
            let diffuse = passes.diffuse();
            assert!((sum / f64::from(STEPS) - diffuse).abs() < 5e-4, "{diffuse}, not {sum} for {alpha}, {index}");
        }
        for index in [0.9, 1.1, 3.5] {
            assert!(Transmittance::new(0.3, index).is_none(), "{index}");
        }
    }

    /// The table, from as many ways for each number as it was made of.
    fn made_anew(ways: u32) -> Vec<Vec<f64>> {
        let mut stream = Stream::new(1, Purpose::Test, 0, 0);
        let share = |node: usize, nodes: usize| node as f64 / (nodes - 1) as f64;
        let mut rows = Vec::new();
        for i in 0..INDICES {
            let denser = RAREST + (DENSEST - RAREST) * share(i, INDICES);
            let index = (1.0 + denser) / (1.0 - denser);
            for a in 0..ALPHAS {
                let alpha = share(a, ALPHAS).powi(2);
                let mut row: Vec<f64> = (0..COSINES)
                    .map(|c| walked(share(c, COSINES).powi(2), alpha, index, ways, &mut stream).0)
                    .collect();
                // Of T that is linear in s = √μ between nodes: ∫ T 4 s³ ds.
                let moment = |s: f64, n: i32| s.powi(n + 4) / f64::from(n + 4);
                let piece = |c: usize| {
                    let (from, to) = (share(c, COSINES), share(c + 1, COSINES));
                    let slope = (row[c + 1] - row[c]) / (to - from);
                    let part = |n: i32| moment(to, n) - moment(from, n);
                    4.0 * ((row[c] - slope * from) * part(0) + slope * part(1))
                };
                row.push((0..COSINES - 1).map(piece).sum());
                rows.push(row);
            }
        }
        rows
    }

    /// Made anew, the table is the same but for chance.
    #[test]
    #[ignore = "by hand: makes the table anew, in two minutes"]
    fn the_table_can_be_made_again() {
        let rows = made_anew(1 << 17);
        for (row, told) in rows.iter().zip(PASSED.as_flattened()) {
            let off =
                row.iter().zip(told).map(|(found, &told)| (found - 1e-4 * f64::from(told)).abs()).fold(0.0, f64::max);
            assert!(off < 0.008, "{row:?}, not {told:?}");
        }
    }
}
