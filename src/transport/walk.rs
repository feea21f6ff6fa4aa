//! The walk of light or of an eye path, from one surface to the next, through the media between.

use std::ops::ControlFlow;

use super::segment::{Crossing, Segment};
use super::surface::Interaction;
use crate::geometry::{Cluster, Hit};
use crate::math::{DVec3, Ray, Stream, error_bound};
use crate::scene::{Finish, Inside, Scene, Surface};
use crate::surface::{Bsdf, Coat, Coated, Incidence, Material, Paint, Parameter, Rough, Smooth, TexturePoint};

/// A photon or an eye path on its way.
#[derive(Clone)]
pub struct Walk<'s> {
    scene: &'s Scene,
    /// The line it is on.
    pub ray: Ray,
    /// How far along that line it has come.
    pub t: f64,
    /// Crossings up to here have been taken.
    crossed: f64,
    /// Nothing beyond is of interest.
    limit: f64,
    /// Whether it has yet to find out on which side of a boundary it starts.
    starts: bool,
    /// The solids around it.
    pub inside: Inside,
    cluster: Cluster,
    /// Whether the cluster holds all crossings on the line up to the limit.
    collected: bool,
    /// How wide what it stands for was at the ray's origin, and by how much that grows with distance.
    cone: [f64; 2],
}

/// What wants to know what a walk passes.
pub trait Visitor {
    /// What it ends a walk with; [`Infallible`](std::convert::Infallible) if it never does.
    type End;
    /// How far light gets from here at most in a medium (an index into [`Scene::media`]), if that is known beforehand: surfaces
    /// beyond are not looked for. Where it is finite, the next segment begins here, and light does not pass that point on it.
    fn farthest(&mut self, _medium: u32, _ray: &Ray) -> f64 {
        f64::INFINITY
    }
    /// Passes through a medium; may end the walk inside.
    fn segment(&mut self, segment: &Segment<'_>) -> ControlFlow<Self::End>;
    /// Meets a surface that shines.
    fn crossing(&mut self, _crossing: &Crossing<'_>) {}
    /// Meets a mixture of materials, through which this share of light passes as if it were not there: `None` is to pass, a
    /// uniform number from [0, 1) chooses what is met among the others, of which some may be `sheets`.
    fn mixture(&mut self, passes: f64, sheets: bool) -> Option<f64>;
}

/// What light does that passes a mixture by chance, or is kept by it.
pub fn pass_by_chance(passes: f64, stream: &mut Stream) -> Option<f64> {
    let u = stream.uniform();
    (u >= passes).then(|| ((u - passes) / (1.0 - passes)).min(1.0f64.next_down()))
}

/// Why a walk pauses.
#[allow(clippy::large_enum_variant, reason = "lives for one step on the stack; a box would allocate at every surface")]
pub enum Stop<E> {
    /// The visitor ended it.
    Ended(E),
    /// At a surface that does something.
    Surface(Interaction),
    /// There is nothing more on the line.
    Escaped,
}

impl<'s> Walk<'s> {
    /// A walk that starts with `ray`, inside these solids.
    #[inline]
    pub fn new(scene: &'s Scene, ray: Ray, inside: Inside) -> Self {
        let cluster = Cluster::default();
        Walk {
            scene,
            ray,
            t: 0.0,
            crossed: 0.0,
            limit: f64::INFINITY,
            starts: false,
            inside,
            cluster,
            collected: false,
            cone: [0.0; 2],
        }
    }

    /// A walk from a light or a camera, which may stand on a boundary of `inside`: then the direction
    /// decides on which side it starts.
    pub fn start(scene: &'s Scene, ray: Ray, inside: Inside) -> Self {
        let starts = !scene.solids.is_empty();
        let crossed = if starts { -error_bound(&ray, 0.0) } else { 0.0 };
        Walk { starts, crossed, ..Walk::new(scene, ray, inside) }
    }

    /// This walk as the middle of a cone of rays that is so wide here, and by so much wider as it has come far: textures are taken at that
    /// width (Amanatides 1984). Events do not change by how much it grows.
    pub fn spread(self, cone: [f64; 2]) -> Self {
        Walk { cone, ..self }
    }

    /// How wide the cone is at parameter `t` of the line.
    fn width(&self, t: f64) -> f64 {
        self.cone[0] + self.cone[1] * t
    }

    /// This walk, ending at parameter `limit`: what lies beyond is escape.
    #[inline]
    pub fn until(self, limit: f64) -> Self {
        Walk { limit, ..self }
    }

    /// Looks for all surfaces on the line at once. Returns whether none is opaque; what is left to do then is to see what the
    /// others do, in their order.
    #[inline]
    pub fn is_free(&mut self) -> bool {
        let blocks = |id| self.scene.surfaces[id as usize].material.is_opaque();
        self.collected = true;
        self.scene.geometry.collect(&self.ray, self.crossed, self.limit, blocks, &mut self.cluster)
    }

    /// Goes on to the next surface that does something, through boundaries that do not.
    pub fn advance<V: Visitor>(&mut self, visitor: &mut V) -> Stop<V::End> {
        loop {
            let medium = self.scene.medium(&self.inside).filter(|&m| !self.scene.media[m as usize].is_clear());
            let farthest =
                medium.filter(|_| !self.starts).map_or(f64::INFINITY, |medium| visitor.farthest(medium, &self.ray));
            let reached = self.t + farthest;
            // Surfaces that coincide with one within reach are looked for, too.
            let limit = self.limit.min(reached + 2.0 * error_bound(&self.ray, reached));
            if !self.collected && farthest.is_finite() && self.scene.is_free(&self.inside, &self.ray, (self.t, limit)) {
                self.cluster.clear();
            } else if self.collected {
                self.scene.geometry.intersect_next(&self.ray, self.crossed, limit, &mut self.cluster);
            } else {
                self.scene.geometry.intersect(&self.ray, self.crossed, limit, &mut self.cluster);
            }
            if std::mem::take(&mut self.starts) {
                self.crossed = 0.0;
                let here = error_bound(&self.ray, 0.0);
                if self.cluster.nearest().is_some_and(|hit| hit.t <= here) {
                    self.inside = self.scene.cross(&self.inside, &self.cluster, &self.ray);
                    self.crossed = self.cluster.hits().last().map_or(0.0, |hit| hit.t) + here;
                    continue;
                }
            }
            let met = self.cluster.nearest().map(|hit| hit.t);
            let end = met.map_or(limit, |t| t.max(self.t));
            if let Some(medium) = medium {
                let segment = Segment { ray: &self.ray, a: self.t, b: end, medium, inside: &self.inside };
                if let ControlFlow::Break(end) = visitor.segment(&segment) {
                    return Stop::Ended(end);
                }
            }
            if met.is_none() {
                if limit >= self.limit {
                    return Stop::Escaped;
                }
                // By rounding only.
                (self.t, self.crossed) = (end, end.next_down());
                continue;
            }
            for hit in self.cluster.hits() {
                if let Some(light) = self.scene.surfaces[hit.id as usize].light {
                    visitor.crossing(&Crossing { ray: &self.ray, hit, light });
                }
            }
            self.t = end;
            let after = self.scene.cross(&self.inside, &self.cluster, &self.ray);
            if let Some((hit, bsdf, relief)) = self.bsdf(&after, visitor) {
                return self.stop(hit, &bsdf, relief, after);
            }
            self.cross(after);
        }
    }

    /// Goes on beyond all that there is where it has come to.
    fn cross(&mut self, after: Inside) {
        self.crossed = self.cluster.hits().last().map_or(self.t, |hit| hit.t) + error_bound(&self.ray, self.t);
        self.inside = after;
    }

    /// What the surfaces at one place do together: an opaque one decides; else a change of index.
    #[inline]
    fn bsdf<V: Visitor>(&self, after: &Inside, visitor: &mut V) -> Option<(&Hit, Bsdf, Option<u32>)> {
        let scene = self.scene;
        let mut boundary = None;
        for hit in self.cluster.hits() {
            let surface = &scene.surfaces[hit.id as usize];
            match &surface.material {
                Material::Opaque(bsdf) => return Some((hit, self.painted(hit, *bsdf, surface.paint), surface.paint)),
                Material::Mixture(_) => {
                    if let Some((bsdf, relief)) = self.mixture(hit, visitor) {
                        return Some((hit, bsdf, relief));
                    }
                }
                Material::Dielectric(dielectric) if boundary.is_none() => boundary = Some((hit, dielectric.roughness)),
                Material::Dielectric(_) | Material::None => {}
            }
        }
        let (hit, alpha) = boundary?;
        let paint = scene.surfaces[hit.id as usize].paint;
        let alpha = self.paint(hit, paint).map_or(alpha, |(paint, at)| paint.number(Parameter::Roughness, alpha, &at));
        let (from, to) = (scene.index(&self.inside), scene.index(after));
        let bsdf = if alpha > 0.0 { Bsdf::Rough(Rough { from, to, alpha }) } else { Bsdf::Smooth(Smooth { from, to }) };
        (from != to).then_some((hit, bsdf, paint))
    }

    /// An opaque surface as it is at the place that is hit.
    #[inline]
    fn painted(&self, hit: &Hit, mut bsdf: Bsdf, paint: Option<u32>) -> Bsdf {
        if let Some((paint, at)) = self.paint(hit, paint) {
            paint.put_on(&mut bsdf, &at);
        }
        if let Bsdf::Coated(Coated { coat: Coat::Dielectric(varnish), .. }) = &mut bsdf {
            varnish.put_in(self.scene.index(&self.inside).x);
        }
        bsdf
    }

    /// What a mixture does where it is hit, with what turns its normal; `None` where light passes.
    #[cold]
    fn mixture<V: Visitor>(&self, hit: &Hit, visitor: &mut V) -> Option<(Bsdf, Option<u32>)> {
        let Surface { material, paint, .. } = self.scene.surfaces[hit.id as usize];
        let (finish, at) = (Finish { material, paint }, self.texture_point(hit, true));
        let sheets = matches!(material, Material::Mixture(mixture) if mixture.has_sheets);
        let u = visitor.mixture(self.scene.passes(&finish, &at), sheets)?;
        match self.scene.met(&finish, &at, u)? {
            (Finish { material: Material::Opaque(bsdf), paint }, relief) => {
                Some((self.painted(hit, bsdf, paint), relief))
            }
            _ => None,
        }
    }

    /// What changes over the surface that is hit, and the place there.
    #[inline(always)]
    fn paint(&self, hit: &Hit, paint: Option<u32>) -> Option<(&'s Paint, TexturePoint)> {
        let paint = &self.scene.paints[paint? as usize];
        Some((paint, self.texture_point(hit, paint.filtered)))
    }

    /// The place that is hit, with its footprint where textures are `filtered`.
    #[inline(never)]
    fn texture_point(&self, hit: &Hit, filtered: bool) -> TexturePoint {
        let geometry = &self.scene.geometry;
        let object = geometry.object_point(&self.ray, hit);
        let width = self.width(hit.t);
        let footprint = if filtered && width > 0.0 {
            let [_, [along_u, along_v]] = geometry.tangents(hit, object);
            width / along_u.cross(along_v).length().sqrt()
        } else {
            0.0
        };
        TexturePoint { uv: hit.uv, object, footprint }
    }

    /// Stops where light meets this. What is large is written once: into what is returned.
    fn stop<E>(&self, hit: &Hit, bsdf: &Bsdf, relief: Option<u32>, after: Inside) -> Stop<E> {
        let direction = self.ray.direction;
        let (mut shading_normal, mut tangent) = (hit.shading_normal, DVec3::ZERO);

        // What depends on the directions of u and v.
        let turns = |paint: &u32| self.scene.paints[*paint as usize].relief.is_some();
        let relief = self.paint(hit, relief.filter(turns));
        if relief.is_some() || bsdf.is_anisotropic() {
            let object = self.scene.geometry.object_point(&self.ray, hit);
            let tangents = self.scene.geometry.tangents(hit, object);
            tangent = tangents[1][0];
            if let Some((paint, at)) = relief {
                shading_normal = paint.normal(shading_normal, tangents, &at);
            }
        }

        // On the side of arrival.
        let facing = if hit.normal.dot(direction) <= 0.0 { 1.0 } else { -1.0 };
        shading_normal *= facing;
        if shading_normal.dot(direction) >= 0.0 {
            shading_normal = facing * hit.normal;
        }
        Stop::Surface(Interaction {
            point: self.ray.at(hit.t),
            incidence: Incidence { direction, normal: facing * hit.normal, shading_normal, tangent },
            t: hit.t,
            bsdf: *bsdf,
            caustics: self.scene.surfaces[hit.id as usize].caustics,
            offset: 4.0 * error_bound(&self.ray, hit.t),
            before: self.inside.clone(),
            after,
        })
    }

    /// What it meets where it has stopped at a surface: all that coincides there.
    pub fn hits(&self) -> &[Hit] {
        self.cluster.hits()
    }

    /// Turns into `direction` at parameter `t` of its line, in the open.
    pub fn turn(&mut self, t: f64, direction: DVec3) {
        self.cone[0] = self.width(t);
        self.ray = Ray::new(self.ray.at(t), direction);
        self.t = 0.0;
        self.crossed = 0.0;
        self.collected = false;
    }

    /// Leaves a surface, at which it stopped, along `direction`, on the side that points to. What passes a sheet stays on its line: how
    /// far it has come since it turned still counts.
    pub fn leave(&mut self, at: &Interaction, direction: DVec3) {
        if at.is_passed_along(direction) {
            return self.cross(at.after.clone());
        }
        let (ray, inside) = at.departure(direction);
        self.cone[0] = self.width(at.t);
        self.ray = ray;
        self.inside = inside;
        self.t = 0.0;
        self.crossed = 0.0;
        self.collected = false;
    }

    /// A walk on the same line, in the medium of a segment that this walk passes.
    pub fn within(scene: &'s Scene, segment: &Segment<'_>) -> Self {
        Walk::new(scene, *segment.ray, segment.inside.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Purpose;
    use crate::math::{Stream, sampling};
    use crate::scene;
    use std::convert::Infallible;

    /// Where segments begin and end, and their media.
    #[derive(Default)]
    struct Passed(Vec<(f64, f64, u32)>);

    impl Visitor for Passed {
        type End = Infallible;

        fn segment(&mut self, segment: &Segment<'_>) -> ControlFlow<Infallible> {
            self.0.push((segment.a, segment.b, segment.medium));
            ControlFlow::Continue(())
        }

        fn mixture(&mut self, _: f64, _: bool) -> Option<f64> {
            None
        }
    }

    /// Solids that overlap, touch and lie in one another, in a world that is filled.
    const NESTED: &str = r#"
[camera]
position = [0, 0, 9]
target = [0, 0, 0]
[world]
medium = "air"
[media.air]
sigma_s = 0.1
[media.a]
sigma_s = 1
[media.b]
sigma_s = 2
[media.c]
sigma_s = 3
[[shapes]]
type = "sphere"
center = [0, 0, 0]
radius = 2
interior = "a"
priority = 1
[[shapes]]
type = "box"
min = [-1, -1, -1]
max = [1, 1, 1]
interior = "b"
priority = 3
[[shapes]]
type = "sphere"
center = [1.5, 0, 0]
radius = 1
interior = "c"
priority = 2
[[shapes]]
type = "box"
min = [1, -1, -1]
max = [1.5, 1, 1]
interior = "a"
priority = 3
"#;

    /// Segments follow one another without gap or overlap to the end of the line, each in the medium of the solids around its
    /// middle; a walk that starts again half-way finds the rest.
    #[test]
    fn segments_tile_the_line() {
        let (scene, _) = scene::from_text(NESTED);
        let mut stream = Stream::new(41, Purpose::Test, 0, 0);
        let mut most = 0;
        for _ in 0..3000 {
            let origin = 3.0 * (stream.uniform() - 0.2) * sampling::sphere(stream.uniform2());
            let direction = sampling::sphere(stream.uniform2()).normalize();
            let mut passed = Passed::default();
            let mut walk = Walk::new(&scene, Ray::new(origin, direction), scene.inside(origin)).until(20.0);
            assert!(matches!(walk.advance(&mut passed), Stop::Escaped));
            let mut end = 0.0;
            for &(a, b, medium) in &passed.0 {
                assert!((a - end).abs() < 1e-9 && b >= a, "{origin} {direction}: {:?}", passed.0);
                let middle = origin + 0.5 * (a + b) * direction;
                if b - a > 1e-6 {
                    assert_eq!(scene.medium(&scene.inside(middle)), Some(medium), "{origin} {direction} at {middle}");
                }
                end = b;
            }
            assert_eq!(end, 20.0);
            most = most.max(passed.0.len());

            let mut rest = Passed::default();
            walk = Walk::new(&scene, Ray::new(origin, direction), scene.inside(origin)).until(20.0);
            walk.turn(0.0, direction);
            walk.advance(&mut rest);
            assert_eq!(rest.0.len(), passed.0.len());
        }
        assert!(most >= 6, "rays met {most} segments at most");
    }
}
