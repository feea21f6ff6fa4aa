/// One of two materials, drawn wherever light meets a surface: f = (1 − w) f_a + w f_b on average. Either may be opaque, a mixture again, or
/// `none`: a hole. Two that only reflect are a [`Mix`](super::Mix), both of which are asked.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Mixture {
    /// The one: an index into the materials of the scene.
    pub a: u32,
    /// The other.
    pub b: u32,
    /// w, the share of `b`, in \[0, 1\].
    pub weight: f64,
    /// Whether some light passes, through `none`.
    pub has_holes: bool,
    /// Whether some light passes straight on, through sheets.
    pub has_sheets: bool,
}
