//! The scenes that are measured: slabs, as wide ones and as columns between mirrors; spheres; an endless medium; a room.

use std::fmt::Write;

/// A homogeneous slab from z = −τ to 0, of extinction 1.
pub struct Slab {
    pub index: f64,
    pub tau: f64,
    pub albedo: f64,
    /// What a scene file says of the phase function.
    pub phase: String,
    /// The reflectance of the ground right below.
    pub ground: f64,
}

/// What lights a slab: radiance 1 from all of a half space, or a beam whose direction has this cosine to the normal, of irradiance 1 on a plane that faces it.
#[derive(Clone, Copy, PartialEq)]
pub enum Light {
    Sky,
    Beam(f64),
}

/// One picture of a slab: what lights it, whether from below, and the cosine to the normal under which it is seen from above.
#[derive(Clone, Copy, PartialEq)]
pub struct View {
    pub light: Light,
    pub from_below: bool,
    pub cosine: f64,
}

/// How wide columns are, and half of it.
const HALF: f64 = 1.0;
/// How much wider what is between the mirrors is made, so that nothing leaks.
const MARGIN: f64 = 1e-4;
/// The widest discs in columns, which mirrors cut.
const WIDEST: f64 = 0.3;
/// Where the sky of columns is above and below them, and where their cameras are.
const SKY: f64 = 3.0;
const CAMERA: f64 = 1.5;

fn quad(x: f64, z: f64, rest: &str) -> String {
    format!(
        "[[shapes]]\ntype = \"quad\"\norigin = [{}, {}, {z}]\nedge_u = [{}, 0, 0]\nedge_v = [0, {}, 0]\n{rest}\n",
        -x,
        -x,
        2.0 * x,
        2.0 * x
    )
}

impl Slab {
    pub fn new(index: f64, tau: f64, albedo: f64, phase: &str) -> Slab {
        Slab { index, tau, albedo, phase: phase.to_string(), ground: 0.0 }
    }

    pub fn hg(index: f64, tau: f64, albedo: f64, g: f64) -> Slab {
        Slab::new(index, tau, albedo, &format!("{{ type = \"hg\", g = {g} }}"))
    }

    fn matter(&self, half: f64) -> String {
        let [tau, index] = [self.tau, self.index];
        let material = if index == 1.0 { "none" } else { "glass" };
        format!(
            "[media.fog]\nsigma_t = 1.0\nalbedo = {}\nphase = {}\n\
             [materials.ground]\ntype = \"lambert\"\nreflectance = {}\n[materials.black]\ntype = \"lambert\"\nreflectance = 0\n\
             [materials.glass]\ntype = \"dielectric\"\nior = {index}\n[materials.mirror]\ntype = \"mirror\"\nreflectance = 1\n\
             [[shapes]]\ntype = \"box\"\nmin = [{}, {}, {}]\nmax = [{half}, {half}, 0]\nmaterial = \"{material}\"\ninterior = \"fog\"\n",
            self.albedo, self.phase, self.ground, -half, -half, -tau
        )
    }

    /// The slab 100 times as wide as thick, for paths.
    pub fn wide(&self, view: View) -> String {
        let half = 50.0 * self.tau.max(1.0);
        let sin = (1.0 - view.cosine * view.cosine).sqrt();
        let mut text = format!(
            "[film]\nwidth = 8\nheight = 8\nlayers = false\n\
             [camera]\nposition = [{}, 0, {}]\ntarget = [0, 0, 0]\nup = [0, 1, 0]\nprojection = \"orthographic\"\nfov = 20\n{}",
            2.0 * sin,
            2.0 * view.cosine,
            self.matter(half)
        );
        if !view.from_below {
            text += &quad(half, -self.tau - MARGIN, "material = \"ground\"");
        }
        match view.light {
            Light::Sky => {
                text += "[[lights]]\ntype = \"environment\"\nradiance = 1.0\n";
                // One half of the sky is hidden.
                let sheet = if view.from_below { SKY } else { -self.tau - 2.0 * MARGIN };
                text += &quad(40.0 * half, sheet, "material = \"black\"");
            }
            Light::Beam(cosine) => text += &beam(cosine, view.from_below),
        }
        text
    }

    /// A column of the slab between mirrors, which stand for all of its width, for photons and light paths. Beams come from infinity through its open end.
    pub fn column(&self, view: View) -> String {
        let sin = (1.0 - view.cosine * view.cosine).sqrt();
        // A film across the column, or aslant within it.
        let half = if view.cosine == 1.0 { HALF } else { 0.5 * HALF };
        let mut text = format!(
            "[film]\nwidth = 16\nheight = 16\nlayers = false\n[volume]\nmax_radius = {WIDEST}\n\
             [camera]\nposition = [0, 0, {CAMERA}]\ntarget = [{}, 0, {}]\nup = [0, 1, 0]\nprojection = \"orthographic\"\nfov = {}\n{}",
            -sin,
            CAMERA - view.cosine,
            2.0 * half.atan().to_degrees(),
            self.matter(HALF + MARGIN)
        );
        let (lowest, highest) = (-self.tau - SKY, SKY);
        let (mut bottom, mut top) = (lowest, highest);
        match view.light {
            Light::Sky => {
                let lamp = |z: f64, down: bool| {
                    let side = if down { "in" } else { "out" };
                    quad(HALF + MARGIN, z, &format!("emission = {{ radiance = 1.0, side = \"{side}\" }}"))
                };
                text += &if view.from_below { lamp(lowest, false) } else { lamp(highest, true) };
            }
            Light::Beam(cosine) => {
                text += &round_beam(cosine, view.from_below, self.tau);
                if view.from_below { bottom = -self.tau } else { top = 0.0 }
            }
        }
        if !view.from_below {
            text += &quad(HALF + MARGIN, -self.tau - MARGIN, "material = \"ground\"");
        }
        for (x, y, [u, v]) in
            [(-1.0, -1.0, [1.0, 0.0]), (-1.0, 1.0, [1.0, 0.0]), (-1.0, -1.0, [0.0, 1.0]), (1.0, -1.0, [0.0, 1.0])]
        {
            let _ = write!(
                text,
                "[[shapes]]\ntype = \"quad\"\norigin = [{}, {}, {bottom}]\nedge_u = [{}, {}, 0]\nedge_v = [0, 0, {}]\nmaterial = \"mirror\"\n",
                HALF * x,
                HALF * y,
                2.0 * HALF * u,
                2.0 * HALF * v,
                top - bottom
            );
        }
        text
    }
}

fn beam(cosine: f64, from_below: bool) -> String {
    let z = if from_below { cosine } else { -cosine };
    format!(
        "[[lights]]\ntype = \"directional\"\ndirection = [{}, 0, {z}]\nirradiance = 1.0\n",
        (1.0 - cosine * cosine).sqrt()
    )
}

/// A beam that is just wide enough for the open end of a column, on which it starts, so that few photons miss it.
fn round_beam(cosine: f64, from_below: bool, tau: f64) -> String {
    let (far, sin) = (4.0, (1.0 - cosine * cosine).sqrt());
    let z = if from_below { -tau - far * cosine } else { far * cosine };
    format!("{}center = [{}, 0, {z}]\nradius = {}\n", beam(cosine, from_below), -far * sin, 1.42 * HALF)
}

/// A sphere of extinction 1 in light of radiance 1 from all sides, which touches the film's edges. The mean over the film is 1 − π/4 (1 − A), A the share of light that
/// leaves the sphere again.
pub fn sphere(radius: f64, albedo: f64, phase: &str) -> String {
    format!(
        "[film]\nwidth = 24\nheight = 24\nlayers = false\n\
         [camera]\nposition = [0, 0, {}]\ntarget = [0, 0, 0]\nprojection = \"orthographic\"\nfov = 53.13010235415598\n\
         [media.fog]\nsigma_t = 1.0\nalbedo = {albedo}\nphase = {phase}\n\
         [[shapes]]\ntype = \"sphere\"\ncenter = [0, 0, 0]\nradius = {radius}\ninterior = \"fog\"\n\
         [[lights]]\ntype = \"environment\"\nradiance = 1.0\n",
        2.0 * radius
    )
}

/// An endless medium of extinction 1 around a lamp of power 1, as parallel rays see it that go away from it, from a square of half width d/4 at the distance d.
pub fn endless(albedo: f64, d: f64) -> String {
    format!(
        "[film]\nwidth = 8\nheight = 8\nlayers = false\n\
         [camera]\nposition = [0, 0, {d}]\ntarget = [0, 0, {}]\nprojection = \"orthographic\"\nfov = {}\n\
         [world]\nmedium = \"fog\"\n[media.fog]\nsigma_t = 1.0\nalbedo = {albedo}\n\
         [[lights]]\ntype = \"point\"\nposition = [0, 0, 0]\npower = 1.0\n",
        d + 1.0,
        2.0 * (0.25 * d).atan().to_degrees()
    )
}

/// A room whose walls reflect a half, full of a medium that scatters 0.9 of what it meets, with a lamp below the ceiling; 3 mean free paths wide.
pub fn room(phase: &str) -> String {
    format!(
        "[film]\nwidth = 8\nheight = 8\nlayers = false\n\
         [camera]\nposition = [0, 0, 1.4]\ntarget = [0, 0, 0]\nfov = 70\n\
         [media.fog]\nsigma_t = 1.0\nalbedo = 0.9\nphase = {phase}\n\
         [materials.wall]\ntype = \"lambert\"\nreflectance = 0.5\n\
         [[shapes]]\ntype = \"box\"\nmin = [-1.5, -1.5, -1.5]\nmax = [1.5, 1.5, 1.5]\nmaterial = \"wall\"\ninterior = \"fog\"\n\
         [[shapes]]\ntype = \"disk\"\ncenter = [0, 1.3, -0.5]\nnormal = [0, -1, 0]\nradius = 0.5\nemission = {{ radiance = 4.0 }}\n"
    )
}
