//! How a picture is computed: `[film]`, `[render]`, `[photons]`, `[volume]` and `[surface]`.

use serde::Serialize;

/// `[film]`: the image.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Film {
    /// Pixels across, at least 1.
    pub width: u32,
    /// Pixels down, at least 1.
    pub height: u32,
    /// The part that is made, inside of the film; `None`: all of it.
    pub crop: Option<Window>,
    /// How samples are weighted into pixels.
    pub filter: Filter,
    /// Stops by which PNG files are brightened; `None`: chosen from the image.
    pub exposure: Option<f64>,
    /// The tone curve of PNG files.
    pub tone_map: ToneMap,
    /// Whether EXR files carry the components of light transport as layers.
    pub layers: bool,
    /// Whether a single pass splits its photons to estimate the standard error.
    pub standard_error: bool,
}

impl Film {
    /// The part of the film that is made.
    pub fn window(&self) -> Window {
        self.crop.unwrap_or(Window { x: 0, y: 0, width: self.width, height: self.height })
    }

    /// The pixels across and down of the picture.
    pub fn size(&self) -> (u32, u32) {
        let Window { width, height, .. } = self.window();
        (width, height)
    }
}

/// A rectangle of pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Window {
    /// Its first column from the left,
    pub x: u32,
    /// and its first row from the top.
    pub y: u32,
    /// Pixels across, at least 1.
    pub width: u32,
    /// Pixels down, at least 1.
    pub height: u32,
}

impl Window {
    /// The place in the window of a pixel of the film, if it is there.
    pub fn place(&self, x: u32, y: u32) -> Option<(u32, u32)> {
        let (x, y) = (x.checked_sub(self.x)?, y.checked_sub(self.y)?);
        (x < self.width && y < self.height).then_some((x, y))
    }
}

/// The reconstruction filter of the film.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Filter {
    /// The mean over the pixel's square.
    Box,
    /// A tent two pixels wide.
    Tent,
    /// A truncated Gaussian.
    Gaussian,
}

/// How radiance becomes the values of a PNG file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ToneMap {
    /// Exposure, then clipping.
    Linear,
    /// A curve with toe and shoulder.
    Filmic,
}

/// `[render]`: the method, and how much work it does.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Render {
    /// How the image is computed.
    pub method: Method,
    /// Whether the scene leaves that to the plan: then [`choose`](crate::render::choose) says what suits it.
    pub automatic: bool,
    /// What numbers that the scene does not give are chosen for.
    pub quality: Quality,
    /// Camera samples per pixel and pass, on average, at least 1; of [`Method::Light`] as many light paths, too.
    pub samples: u32,
    /// Whether pixels take more of them where a pilot finds noise, and fewer elsewhere; none do by [`Method::Light`], nor where there are fewer than 4.
    pub adaptive: bool,
    /// Shadow rays for each question for light at the first surface of a camera ray that spreads light, at least 1.
    pub light_samples: u32,
    /// Passes, each with fresh photons in narrower discs, at least 1.
    pub passes: u32,
    /// What all random numbers derive from.
    pub seed: u64,
    /// The number of events between light and eye; 0: unlimited.
    pub max_depth: u32,
}

/// What numbers that the scene does not give are chosen for: photons, neighbours, samples and passes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Quality {
    /// A quick look: a quarter of the photons and samples.
    Draft,
    /// A picture.
    Normal,
    /// Four passes of that, in ever narrower discs.
    High,
}

impl Quality {
    /// Photons of a map, where a picture has `normal`.
    pub fn photons(self, normal: u64) -> u64 {
        if self == Quality::Draft { normal / 4 } else { normal }
    }

    /// Camera samples per pixel and pass.
    pub fn samples(self) -> u32 {
        if self == Quality::Draft { 4 } else { 16 }
    }

    /// Passes.
    pub fn passes(self) -> u32 {
        if self == Quality::High { 4 } else { 1 }
    }
}

/// How the image is computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// Photon mapping.
    Photon,
    /// The unbiased path tracer.
    Path,
    /// The unbiased light tracer: paths from the lights, connected to the camera.
    Light,
    /// Whitted's ray tracing: mirrors, glass, and light straight from lights, and no other.
    Whitted,
}

impl Method {
    /// All of them.
    pub const ALL: [Method; 4] = [Method::Photon, Method::Path, Method::Light, Method::Whitted];

    /// What a scene file calls it.
    pub fn name(self) -> &'static str {
        match self {
            Method::Photon => "photon",
            Method::Path => "path",
            Method::Light => "light",
            Method::Whitted => "whitted",
        }
    }
}

/// `[photons]`: how many photons are traced and kept.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Photons {
    /// About how many photons the volume map should hold, at least 1; `None`: chosen from the scene.
    pub volume: Option<u64>,
    /// About how many photons the caustic map should hold; 0: there is none, and caustics are left to chance. `None`: chosen from
    /// the scene.
    pub caustic: Option<u64>,
    /// About how many photons the global map should hold; 0: there is none, and paths tell indirect light. `None`: chosen from the
    /// scene.
    pub global: Option<u64>,
    /// The most photons that are emitted in a pass, at least 1.
    pub max_emitted: u64,
    /// Whether photons are aimed at what matters.
    pub projection: bool,
    /// What photons are drawn by.
    pub emission: PhotonEmission,
    /// Whether photons are drawn and kept by how much they count in the picture.
    pub importance: bool,
    /// Whether more photons are traced than kept, and hand their power to neighbours where they lie closest.
    pub density_control: bool,
}

/// What photons are drawn by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum PhotonEmission {
    /// A quasi-random sequence, whose points are spread evenly: quasi-Monte Carlo.
    Qmc,
    /// Independent numbers.
    Random,
}

/// `[volume]`: how media are gathered.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Volume {
    /// What is gathered along a ray.
    pub estimate: Estimate,
    /// How wide photons are.
    pub kernel: Kernel,
    /// How photons count from their middle to their rim; `None`: chosen by the estimate.
    pub profile: Option<Profile>,
    /// The radius of [`Kernel::Fixed`], above 0; `None`: chosen from the scene.
    pub radius: Option<f64>,
    /// The number n of photons an adaptive radius should cover, at least 1; `None`: chosen from the scene.
    pub neighbours: Option<u32>,
    /// The number m of photons from which an adaptive radius is found, at least 5; `None`: max(5, ⌈√n⌉).
    pub pilot: Option<u32>,
    /// The cap of adaptive radii, above 0; `None`: chosen from the scene.
    pub max_radius: Option<f64>,
    /// What is done about walls near photons.
    pub boundaries: Boundaries,
    /// How rays are stepped through, where they are.
    pub march: Option<March>,
    /// Where light comes from that is scattered once.
    pub single_scattering: SingleScattering,
    /// Who finds light in the peaks of phase functions.
    pub peaks: Peaks,
}

/// Who finds light that a medium hardly turns, in the peak of a phase function that has a high one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Peaks {
    /// Paths or photons, chosen from the scene.
    Auto,
    /// Paths that go on from collisions.
    Paths,
    /// Photons, like all other.
    Photons,
}

/// What is gathered along a ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Estimate {
    /// All photons around the ray at once.
    Beam,
    /// The photons around points on the ray.
    Point,
}

/// What is done about walls near photons: opaque surfaces, and boundaries of their medium.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Boundaries {
    /// Nothing: each photon is spread over the whole of its disc or ball (Jarosz, Zwicker and Jensen 2008, Eqs. 21 and 22).
    None,
    /// It is spread over the share on its side of the walls.
    Share,
    /// And discs lie along the nearest boundary of their medium where they are wide against its mean free path.
    Lean,
}

/// How photons count from their middle to their rim.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Profile {
    /// All photons within the radius count alike.
    Constant,
    /// 1 − x².
    Epanechnikov,
    /// (1 − x²)².
    Biweight,
}

/// `volume.march`: how rays are stepped through.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct March {
    /// How long steps are.
    pub step: Step,
    /// The length of the smallest step, above 0; `None`: chosen from the scene.
    pub size: Option<f64>,
    /// What the ends of an adaptive step may differ by, above 0, as a share.
    pub contrast: f64,
}

impl March {
    /// What holds unless the scene file says otherwise. The contrast is about the noise of some tens of photons: with less,
    /// all steps would be halved; with more, what is small and bright is missed too often (`scenes/volume-caustic.toml`).
    pub const DEFAULT: March = March { step: Step::Exponential, size: None, contrast: 0.2 };
}

/// How long the steps of a march are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Step {
    /// All steps are alike.
    Uniform,
    /// Short where density or light change.
    Adaptive,
    /// The longer the less light arrives from there.
    Exponential,
    /// As long as free paths.
    Random,
}

/// Where light comes from that a medium scatters straight from a light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SingleScattering {
    /// From photons, like all other.
    Photons,
    /// By rays to the lights, through index-matched boundaries.
    Traced,
    /// By rays to the lights that go straight on, through refracting boundaries, too.
    Approximate,
}

impl SingleScattering {
    /// Whether rays to the lights ask for this light, so that photons must not bring it as well.
    pub fn asks_lights(self) -> bool {
        self != SingleScattering::Photons
    }

    /// Whether these rays go straight on through refracting boundaries, which in truth turn them.
    pub fn goes_straight_on(self) -> bool {
        self == SingleScattering::Approximate
    }
}

/// How wide photons are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kernel {
    /// One radius for all.
    Fixed,
    /// As wide as the photons around are sparse.
    Variable,
}

/// `[surface]`: how light on surfaces is gathered.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Surface {
    /// Who tells what diffuse surfaces get that comes neither straight from a light nor as a caustic.
    pub indirect: Indirect,
    /// How far photons count.
    pub estimate: SurfaceEstimate,
    /// The radius of [`SurfaceEstimate::Fixed`], above 0; `None`: chosen from the scene.
    pub radius: Option<f64>,
    /// The cap of the global map's radii, above 0; `None`: chosen from the scene.
    pub max_radius: Option<f64>,
    /// Gather rays that come less far than this go on as paths; `None`: as far as the global map blurs light.
    pub accurate_distance: Option<f64>,
    /// Rays that gather indirect light where it is gathered, at least 1; `None`: one a sample.
    pub gather_rays: Option<u32>,
    /// Where gather rays of records go.
    pub gather_directions: GatherDirections,
    /// The irradiance is computed beforehand at one of so many photons of the global map; 0: at none.
    pub precomputed_irradiance: u32,
    /// Whether gathered light is kept at few places, and interpolated between them.
    pub irradiance_cache: bool,
    /// How these are spaced.
    pub records: Records,
    /// How far: of [`Records::Hessian`] the share by which interpolated light may be off at the edge of the widest, of
    /// [`Records::SplitSphere`] the share of the mean distance around; above 0.
    pub cache_error: f64,
    /// The number n of photons whose distance is the radius, at least 2.
    pub neighbours: u32,
    /// How photons count from the middle of their disc to its rim.
    pub filter: SurfaceFilter,
    /// The cap of the caustic map's radii, above 0; `None`: chosen from the scene.
    pub caustic_radius: Option<f64>,
    /// Whether shadow photons tell where no shadow ray is needed.
    pub shadow_photons: bool,
    /// Whether photons count only as far as light is even (Jensen 2001, §7.4.3).
    pub differential_checking: bool,
}

/// Who tells what diffuse surfaces get that comes neither straight from a light nor as a caustic.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Indirect {
    /// Rays to the next diffuse surfaces, where the global map tells what they reflect.
    FinalGather,
    /// The global map, of that light and of all other together.
    Map,
    /// Paths, from surface to surface.
    Path,
    /// Nobody: that light is left out.
    None,
}

/// Where gather rays of the irradiance cache go.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum GatherDirections {
    /// As the surface reflects light.
    Bsdf,
    /// Some of them where photons say that light comes from.
    Flux,
}

/// How far apart the records of the irradiance cache are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Records {
    /// As second derivatives of the irradiance allow.
    Hessian,
    /// As the distances of surfaces around allow.
    SplitSphere,
}

/// How far photons on surfaces count.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SurfaceEstimate {
    /// To the n-th nearest photon.
    Knn,
    /// To the same radius everywhere.
    Fixed,
    /// Each photon's own radius, wide where photons are sparse.
    Sheets,
}

/// How photons on surfaces count from the middle of their disc to its rim.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SurfaceFilter {
    /// All alike.
    None,
    /// 1 − x.
    Cone,
    /// A Gaussian that is 0 at the rim.
    Gaussian,
}
