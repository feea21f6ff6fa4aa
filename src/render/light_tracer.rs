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
//! pixel on a film at distance 1, and θ′ the angle to the axis (Veach 1997, §4.7 and §10.3). It is
//! unbiased, and finds caustics as photons do. It does not find what is seen through smooth glass or in mirrors, which send
//! nothing towards a given point. Emitters and the sky, seen directly, are left to camera rays.

use std::ops::{ControlFlow, Range};

use super::camera::Camera;
use super::eye::{BRIGHTEST, Component, First};
use super::plan::Plan;
use super::splat::{Splat, join};
use crate::math::random::Purpose;
use crate::math::{Ray, Rgb, Stream};
use crate::photon::{Sources, Start};
use crate::scene::Scene;
use crate::surface::{Nature, Side};
use crate::transport::{
    Ahead, Events, Heading, Luggage, Part, Parts, Segment, Tally, Traveller, Vertex, Walk, survive, travel,
};

/// Paths that one task traces, at most.
const CHUNK: u64 = 4096;

/// Traces the light of a pass.
pub(super) struct LightTracer<'s> {
    scene: &'s Scene,
    camera: Camera,
    sources: Sources<'s>,
    max_events: Events,
    seed: u64,
    pass: u64,
}

/// What some light paths have left.
pub(super) struct Sent {
    /// No more than one for each pixel and component.
    pub splats: Vec<Splat>,
    /// The paths, those included that were lost.
    pub paths: u64,
    pub tally: Tally,
}

impl<'s> LightTracer<'s> {
    pub fn new(scene: &'s Scene, camera: &Camera, plan: &Plan, pass: u32) -> Self {
        let (sources, camera) = (Sources::new(scene), camera.clone());
        LightTracer { scene, camera, sources, max_events: plan.max_events, seed: plan.seed, pass: pass as u64 }
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

    /// Traces the paths of a task of a sample. `parts` is room for its work.
    pub fn trace(&self, (sample, task): (u32, u64), parts: &mut Parts<'s, Origin>) -> Sent {
        let paths = self.paths(sample, task);
        let mut sent = Sent { splats: Vec::new(), paths: paths.end - paths.start, tally: Tally::default() };
        for path in paths {
            let mut stream = Stream::new(self.seed, Purpose::Light, path, self.pass);
            self.emit(&mut stream, &mut sent, parts);
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
        let luggage = Luggage::new(power, Origin { from_light, ahead: Ahead::default() });
        let start = Part { walk: Walk::start(self.scene, ray, inside), luggage, collision: None };
        travel(&mut Sending { tracer: self, sent, stream }, start, parts);
    }
}

/// What a light path remembers.
pub(super) struct Origin {
    /// Whether it comes from a light, not from a glowing medium.
    from_light: bool,
    /// How far it flies, once that is drawn.
    ahead: Ahead,
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

    fn farthest(&mut self, medium: u32, _: &Ray, luggage: &mut Luggage<Origin>) -> f64 {
        let medium = &self.tracer.scene.media[medium as usize];
        luggage.own.ahead.draw(medium, luggage.weight, self.stream)
    }

    fn segment(
        &mut self,
        segment: &Segment<'_>,
        luggage: &mut Luggage<Origin>,
        _: &mut Parts<'s, Origin>,
    ) -> ControlFlow<f64> {
        let medium = &self.tracer.scene.media[segment.medium as usize];
        let (range, weight) = ((segment.a, segment.b), &mut luggage.weight);
        let collision =
            luggage.own.ahead.collide(medium, segment.ray, range, weight, self.stream, &mut self.sent.tally);
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
        if at.nature() != Nature::Specular {
            self.connect(at, luggage);
        }
        if !self.tracer.max_events.allows(luggage.events) {
            return None;
        }
        let onward = at.onward(Side::Light, None, &mut luggage.weight, self.stream, survive)?;
        Some(Heading { direction: onward.direction, clearance: None })
    }

    fn stopped(&mut self) {
        self.sent.tally.stopped += 1;
    }
}

impl Sending<'_, '_> {
    /// Sends to the camera what a vertex scatters there.
    fn connect(&mut self, at: Vertex<'_>, luggage: &Luggage<Origin>) {
        let LightTracer { scene, camera, .. } = self.tracer;
        let Some(view) = camera.view(at.point(), self.stream) else { return };
        let mut weight = Rgb::ZERO;
        at.toward(view.direction, Side::Light, false, luggage.weight, self.stream, |arriving, sent| {
            weight += arriving * sent.value;
        });
        if weight.max_element() <= 0.0 {
            return;
        }
        at.transmit(scene, (view.direction, view.distance, -view.direction), &mut weight, self.stream);
        if weight.max_element() <= 0.0 {
            return;
        }
        let radiance = weight * view.importance;
        if !radiance.is_finite() || radiance.max_element() > BRIGHTEST {
            self.sent.tally.broken += 1;
            return;
        }
        let first = match at.nature() {
            Nature::Diffuse if matches!(at, Vertex::Medium(_)) => First::Medium,
            Nature::Diffuse => First::Diffuse,
            Nature::Glossy | Nature::Specular => First::Specular,
        };
        let component = Component::of(Some(first), luggage.events, luggage.own.from_light, false);
        camera.spread(&view, |pixel, part| {
            self.sent.splats.push(Splat { pixel, component, radiance: part * radiance });
        });
    }
}
