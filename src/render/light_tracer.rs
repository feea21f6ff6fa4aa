//! Light tracing: paths that start at lights and glowing media, and are connected to the camera wherever they turn.
//!
//! Where a path of power Φ turns at a point p and sends the share f |cos θ| (or albedo times phase function) per steradian
//! towards a point of the camera's lens at distance d, a pixel receives
//!
//! ```text
//! Φ · f |cos θ| · T · W,   W = h(x) / (d² s² cos³ θ′)
//! ```
//!
//! with T what passes on the way, h the pixel's filter at the place x of the film where p is seen, s the edge of a
//! pixel on a film at distance 1, and θ′ the angle to the axis (Veach 1997, §4.7 and §10.3). Of a camera with parallel
//! rays, W = h(x) / (s² cos θ′). It is unbiased, and finds caustics as photons do. It does not find what is seen through
//! smooth boundaries or in mirrors, which send nothing towards a given point; sheets let connections pass. Emitters and the sky, seen
//! directly or through sheets, are left to camera rays.
//!
//! Collisions are rare in thin media, and near the camera each counts for 1/d². So all that passes through such a medium is also
//! connected from the middle of its flights, at a place drawn in proportion to the angle that the lens sees
//! (Kulla and Fajardo 2012). Both ways to find light share by the balance heuristic.

use std::ops::{ControlFlow, Range};

use super::camera::{Camera, View};
use super::eye::{BRIGHTEST, Component, First};
use super::plan::Plan;
use super::splat::{Splat, join};
use crate::math::random::{Dimension, Purpose};
use crate::math::{Ray, Rgb, Stream};
use crate::medium::Medium;
use crate::photon::{History, Sources, Start};
use crate::scene::Scene;
use crate::surface::{Nature, Side};
use crate::transport::{
    self, Ahead, Collision, Event, Events, Flight, Heading, Luggage, Part, Parts, Segment, Tally, Traveller, Vertex,
    Walk, balance, equiangular, survive, travel,
};

/// Paths that one task traces, at most.
const CHUNK: u64 = 4096;
/// Media of fewer mean free paths across the scene are thin.
const THIN: f64 = 8.0;

/// Traces the light of a pass.
pub(super) struct LightTracer<'s> {
    scene: &'s Scene,
    camera: Camera,
    sources: Sources<'s>,
    max_events: Events,
    seed: u64,
    pass: u64,
    /// By medium, how close to the camera a flight is connected from its middle; infinite in thin media, negative in those that
    /// do not scatter.
    reach: Vec<f64>,
    /// Whether to break off long paths.
    stop: &'s (dyn Fn() -> bool + Sync),
}

/// What some light paths have left.
pub(super) struct Sent {
    /// No more than one for each pixel and component.
    pub splats: Vec<Splat>,
    /// The paths, those included that were lost.
    pub paths: u64,
    pub tally: Tally,
    /// Whether a path was broken off, so that none of it counts.
    pub is_broken_off: bool,
}

impl<'s> LightTracer<'s> {
    pub fn new(scene: &'s Scene, camera: &Camera, plan: &Plan, pass: u32, stop: &'s (dyn Fn() -> bool + Sync)) -> Self {
        let (sources, camera) = (Sources::new(scene), camera.clone());
        let extent = scene.bounds().diagonal();
        // No place of a flight is nearer to parallel rays.
        let reach = |medium: &Medium| match equiangular::mean_free_path(medium) {
            _ if !medium.scatters() || camera.is_orthographic() => -1.0,
            path if extent < THIN * path => f64::INFINITY,
            path => path + camera.aperture(),
        };
        let reach = scene.media.iter().map(reach).collect();
        LightTracer {
            scene,
            camera,
            sources,
            max_events: plan.max_events,
            seed: plan.seed,
            pass: pass as u64,
            reach,
            stop,
        }
    }

    /// The paths that one sample of all pixels takes.
    fn paths_in_sample(&self) -> u64 {
        let (width, height) = self.camera.size();
        width as u64 * height as u64
    }

    /// Into how many tasks these are divided.
    pub fn tasks_in_sample(&self) -> u64 {
        if self.sources.is_empty() { 0 } else { self.paths_in_sample().div_ceil(CHUNK) }
    }

    /// The paths of a task of a sample.
    fn paths(&self, sample: u32, task: u64) -> Range<u64> {
        let (all, first) = (self.paths_in_sample(), sample as u64 * self.paths_in_sample());
        first + task * CHUNK..first + ((task + 1) * CHUNK).min(all)
    }

    /// Whether flights along this line are connected from their middles.
    fn connects_flights(&self, medium: u32, ray: &Ray) -> bool {
        let reach = self.reach[medium as usize];
        if reach.is_infinite() || reach < 0.0 {
            return reach > 0.0;
        }
        let offset = self.camera.position - ray.origin;
        offset.cross(ray.direction).length_squared() < reach * reach
    }

    /// Traces the paths of a task of a sample. `parts` is room for its work.
    pub fn trace(&self, (sample, task): (u32, u64), parts: &mut Parts<'s, Origin>) -> Sent {
        let paths = self.paths(sample, task);
        let mut sent =
            Sent { splats: Vec::new(), paths: paths.end - paths.start, tally: Tally::default(), is_broken_off: false };
        for path in paths {
            let mut stream = Stream::of_path(self.seed, Purpose::Light, path, self.pass);
            self.emit(&mut stream, &mut sent, parts);
            if sent.is_broken_off {
                break;
            }
        }
        join(&mut sent.splats);
        sent
    }

    fn emit(&self, stream: &mut Stream, sent: &mut Sent, parts: &mut Parts<'s, Origin>) {
        let Some(Start { ray, power, inside, from_light, .. }) = self.sources.start(stream) else { return };
        if !power.is_finite() {
            sent.tally.broken += 1;
            return;
        }
        let luggage = Luggage::new(power, Origin { history: History::new(from_light), ahead: None, flight: None });
        let start = Part { walk: Walk::start(self.scene, ray, inside), luggage, collision: None };
        travel(&mut Sending { tracer: self, sent, stream }, start, parts);
    }
}

/// What a light path remembers.
pub(super) struct Origin {
    /// Its way.
    history: History,
    /// How far it flies, once that is drawn.
    ahead: Option<Ahead>,
    /// The flight that it is on, if that is connected from its middle.
    flight: Option<Flight>,
}

/// A light path on its way.
struct Sending<'t, 's> {
    tracer: &'t LightTracer<'s>,
    sent: &'t mut Sent,
    stream: &'t mut Stream,
}

impl<'s> Traveller<'s> for Sending<'_, 's> {
    type Own = Origin;

    fn scene(&self) -> &'s Scene {
        self.tracer.scene
    }

    fn stream(&mut self) -> &mut Stream {
        self.stream
    }

    fn farthest(&mut self, medium: u32, ray: &Ray, luggage: &mut Luggage<Origin>) -> f64 {
        if self.tracer.connects_flights(medium, ray) {
            return f64::INFINITY;
        }
        let medium = &self.tracer.scene.media[medium as usize];
        luggage.own.ahead.insert(Ahead::default()).draw(medium, luggage.weight, self.stream)
    }

    fn segment(
        &mut self,
        segment: &Segment<'_>,
        luggage: &mut Luggage<Origin>,
        _: &mut Parts<'s, Origin>,
    ) -> ControlFlow<f64> {
        let medium = &self.tracer.scene.media[segment.medium as usize];
        let ahead = luggage.own.ahead.take();
        let connects = ahead.is_none() && self.tracer.connects_flights(segment.medium, segment.ray);
        luggage.own.flight = connects.then(|| Flight::new(segment, medium, luggage.weight));
        if let Some(flight) = &luggage.own.flight {
            self.connect_flight(segment, flight, luggage);
        }
        let (range, weight) = ((segment.a, segment.b), &mut luggage.weight);
        let tally = &mut self.sent.tally;
        let mut ahead = ahead.unwrap_or_default();
        let collision = ahead.collide(medium, segment.ray, range, weight, self.stream, tally);
        collision.map_or(ControlFlow::Continue(()), ControlFlow::Break)
    }

    fn turn(
        &mut self,
        at: Vertex<'_>,
        _: &Walk<'s>,
        luggage: &mut Luggage<Origin>,
        _: &mut Parts<'s, Origin>,
    ) -> Option<Heading> {
        luggage.events += 1;
        let flight = luggage.own.flight.take();
        let left_out = matches!(at, Vertex::Surface(at) if luggage.own.history.is_left_out(at));
        if at.nature() != Nature::Specular && !left_out {
            self.connect(at, flight.as_ref(), luggage);
        }
        if !self.tracer.max_events.allows(luggage.events) {
            return None;
        }
        let onward = at.onward(Side::Light, None, &mut luggage.weight, self.stream, survive)?;
        let event = at.event(&onward);
        if left_out && event == Event::Scattered {
            return None;
        }
        luggage.own.history = luggage.own.history.after(event, &at);
        Some(Heading { direction: onward.direction })
    }

    fn breaks_off(&mut self) -> bool {
        self.sent.is_broken_off |= (self.tracer.stop)();
        self.sent.is_broken_off
    }

    fn stopped(&mut self) {
        self.sent.tally.stopped += 1;
    }
}

impl Sending<'_, '_> {
    /// Sends to the camera what a vertex scatters there. `flight`: that which led there, if it was connected from its middle.
    fn connect(&mut self, at: Vertex<'_>, flight: Option<&Flight>, luggage: &Luggage<Origin>) {
        let camera = &self.tracer.camera;
        let lens = camera.lens(self.stream);
        let Some(view) = camera.view(at.point(), lens) else { return };
        let share = match (at, flight) {
            (Vertex::Medium(at), Some(flight)) => {
                let by_chance = flight.flight_density(at.medium, at.t);
                balance(by_chance, flight.distance_density(camera.position + lens, (flight.a, flight.b), at.t))
            }
            _ => 1.0,
        };
        self.send(at, &view, share * luggage.weight, (luggage.events, luggage.own.history));
    }

    /// Sends to the camera what a flight scatters there, at a place drawn for the lens.
    fn connect_flight(&mut self, segment: &Segment<'_>, flight: &Flight, luggage: &Luggage<Origin>) {
        let LightTracer { scene, camera, .. } = self.tracer;
        let lens = camera.lens(self.stream);
        let u = self.stream.draw(Dimension::Equiangular, Stream::uniform);
        let Some((t, density)) = flight.draw_distance(camera.position + lens, (flight.a, flight.b), u) else { return };
        let point = segment.ray.at(t);
        let Some(view) = camera.view(point, lens) else { return };

        // What collides there, over the density of both ways to find it.
        let medium = &scene.media[segment.medium as usize];
        let both = density + flight.flight_density(medium, t);
        let mut weight = flight.weight * medium.extinction * (medium.density.at(point) / both);
        if weight.max_element() <= 0.0 {
            return;
        }
        transport::pass(medium, segment.ray, (segment.a, t), &mut weight, self.stream);
        let (direction, index, inside) = (segment.ray.direction, segment.medium, segment.inside);
        let at = Collision { point, direction, t, medium, index, inside, peak: None };
        self.send(Vertex::Medium(&at), &view, weight, (luggage.events + 1, luggage.own.history));
    }

    /// Sends to the camera what a vertex scatters there of light that arrives with this weight; with its events, that at the vertex
    /// included, and the way before it.
    fn send(&mut self, at: Vertex<'_>, view: &View, arriving: Rgb, (events, history): (u64, History)) {
        let LightTracer { scene, camera, .. } = self.tracer;
        let mut weight = Rgb::ZERO;
        at.toward(view.direction, Side::Light, false, arriving, self.stream, |arriving, sent| {
            weight += arriving * sent.value;
        });
        if weight.max_element() <= 0.0 {
            return;
        }
        let Some(most) = self.tracer.max_events.left_after(events) else { return };
        let way = (view.direction, view.distance, -view.direction);
        let sheets = at.transmit(scene, way, most, &mut weight, self.stream);
        if weight.max_element() <= 0.0 {
            return;
        }
        let radiance = weight * view.importance;
        if !radiance.is_finite() || radiance.max_element() > BRIGHTEST {
            self.sent.tally.broken += 1;
            return;
        }
        let first = match at.nature() {
            _ if sheets > 0 => First::Specular,
            Nature::Diffuse if matches!(at, Vertex::Medium(_)) => First::Medium,
            Nature::Diffuse => First::Diffuse,
            Nature::Glossy | Nature::Narrow | Nature::Specular => First::Specular,
        };
        let component = Component::of(Some(first), events + sheets, history.from_light, history.is_caustic());
        camera.spread(view, |pixel, part| {
            self.sent.splats.push(Splat { pixel, component, radiance: part * radiance });
        });
    }
}
