//! A sample of the film, told event by event.

use super::camera::Camera;
use super::eye::{Context, Eye, Sample, Told};
use super::limits::Limits;
use super::plan::Plan;
use super::tile::{by_paths, eye_settings, set_out};
use crate::gather::Queue;
use crate::math::Ray;
use crate::scene::description::Method;
use crate::scene::{Scene, Settings};
use crate::transport::{Parts, Tally};
use crate::{Error, Result};

/// Draws samples of a scene by paths, one by one, as its film would: with the same random numbers.
pub struct Replayer<'s> {
    scene: &'s Scene,
    camera: Camera,
    plan: Plan,
}

/// A sample as it was drawn.
#[derive(Clone, Debug)]
pub struct Replayed {
    /// What it saw.
    pub sample: Sample,
    /// The camera ray.
    pub ray: Ray,
    /// What happened to its path.
    pub told: Vec<Told>,
    /// Mishaps.
    pub tally: Tally,
}

impl<'s> Replayer<'s> {
    /// Of this scene and these settings.
    ///
    /// # Errors
    /// [`Error::Usage`] where these have another method than paths; as [`Plan::new`].
    pub fn new(scene: &'s Scene, settings: &Settings) -> Result<Replayer<'s>> {
        if settings.render.method != Method::Path {
            return Err(Error::Usage(format!(
                "a replay tells of paths, but the method is {:?}: add --set render.method=path",
                settings.render.method.name()
            )));
        }
        let camera = Camera::new(&scene.camera, &settings.film);
        let plan = Plan::new(scene, settings, &camera, &Limits::default())?;
        Ok(Replayer { scene, camera, plan })
    }

    /// Sample number `sample`, counted through all passes from 0, of the pixel in column `x` and row `y` of the picture.
    ///
    /// # Errors
    /// [`Error::Usage`] where the picture has no such pixel.
    pub fn replay(&self, (x, y): (u32, u32), sample: u64) -> Result<Replayed> {
        let window = self.camera.window();
        if x >= window.width || y >= window.height {
            return Err(Error::Usage(format!(
                "pixel {x},{y} is not in the picture of {} × {} pixels: they count from 0, from the top left",
                window.width, window.height
            )));
        }
        let samples = u64::from(self.plan.samples);
        let pass = u32::try_from(sample / samples)
            .map_err(|_| Error::Usage(format!("sample {sample} is in no pass: there are too many before it")))?;
        let place = (window.x + x, window.y + y);
        let number = (pass, (sample % samples) as u32);
        let (mut stream, ray, inside) = set_out((self.scene, &self.camera, &self.plan), place, number);
        let settings = eye_settings(&self.plan, &self.camera, (by_paths(&self.plan), None), &|| false);
        let eye = Eye::new(self.scene, settings);
        let (mut queue, mut parts, mut tally) = (Queue::default(), Parts::new(), Tally::default());
        let mut context =
            Context { stream: &mut stream, queue: &mut queue, pixel: 0, tally: &mut tally, parts: &mut parts };
        let (sample, told) = eye.tell(ray, inside, &mut context);
        Ok(Replayed { sample, ray, told, tally })
    }
}
