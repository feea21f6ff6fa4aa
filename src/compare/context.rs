//! What is common to all parts of a comparison.

use std::sync::atomic::AtomicBool;

use serde::Serialize;

use super::machine;
use super::request::Request;
use super::results::Setting;
use super::watch::Watch;
use crate::render::checkpoint::Subject;
use crate::render::{Component, SharedPhotons};
use crate::scene;
use crate::scene::description::{Description, Method};
use crate::{Error, Result};

/// A key of the scene file and its value.
pub type Pair = (String, String);

/// What is common to all parts of a comparison.
pub struct Context<'r> {
    pub request: &'r Request,
    /// Overrides for all variants.
    pub set: Vec<String>,
    /// The scene as it is for all.
    pub base: Description,
    pub watch: &'r dyn Watch,
    pub stop: &'r AtomicBool,
    pub photons: Option<SharedPhotons>,
    /// What differs between builds of the program.
    pub build: u128,
}

/// What everything in the folder of a comparison depends on, besides what it is of.
#[derive(Serialize)]
struct Made<'c, T> {
    build: u128,
    layer: &'c Option<String>,
    threads: usize,
    of: &'c T,
}

impl<'r> Context<'r> {
    pub fn new(request: &'r Request, watch: &'r dyn Watch, stop: &'r AtomicBool) -> Result<Context<'r>> {
        // Samples that go where the noise is make estimates unlike in more than what is compared.
        let mut set = vec!["render.adaptive=false".to_string()];
        set.extend(request.set.iter().cloned());
        // Layers cost time and memory; only one kind of scattering cannot be told without.
        let components = request.components()?.unwrap_or_default();
        let tells = components.contains(&Component::VolumeSingle) != components.contains(&Component::VolumeMultiple);
        set.push(format!("film.layers={tells}"));
        let base = scene::read(&request.scene, &set)?;
        Ok(Context { request, set, base, watch, stop, photons: None, build: machine::build() })
    }

    /// The scene with further settings; errors name the variant they are of.
    pub fn describe(&self, variant: &str, set: &[Pair]) -> Result<Description> {
        let mut all = self.set.clone();
        all.extend(set.iter().map(|(key, value)| format!("{key}={value}")));
        scene::read(&self.request.scene, &all).map_err(|error| match error {
            Error::Scene(message) => Error::Scene(format!("variant {variant}: {message}")),
            other => other,
        })
    }

    /// The photons that all variants share, or that tell how wide kernels should be.
    pub fn photons(&mut self) -> Result<&SharedPhotons> {
        if self.photons.is_none() {
            self.watch.begins("photons");
            let mut base = self.base.clone();
            base.render.method = Method::Photon;
            let (scene, settings) = scene::build(&base)?;
            self.photons = Some(SharedPhotons::trace(&scene, &settings, &self.watch, self.stop)?);
        }
        self.photons.as_ref().ok_or(Error::Interrupted)
    }

    /// The photons of the common map, if there is one.
    pub fn shared(&self) -> Option<&SharedPhotons> {
        self.photons.as_ref().filter(|_| self.request.same_map)
    }

    /// A short text that differs where anything named in `of` does, or the program, its threads, or what is measured.
    ///
    /// # Errors
    /// [`Error::Output`] for what has no JSON.
    pub fn digest(&self, of: &impl Serialize) -> Result<String> {
        let all = Made { build: self.build, layer: &self.request.layer, threads: rayon::current_num_threads(), of };
        let text = serde_json::to_vec(&all).map_err(|error| Error::output("a digest", error))?;
        Ok(format!("{:032x}", xxhash_rust::xxh3::xxh3_128(&text)))
    }

    /// What the common map is of: its settings and seed; `None` without one.
    pub fn map(&self) -> Option<(String, u64)> {
        self.request.same_map.then(|| (Subject::new(&self.base, 1).fingerprint(), self.base.render.seed))
    }
}

/// Key and value of `key=value`, if it is that.
pub fn pair(text: &str) -> Option<Pair> {
    text.split_once('=').map(|(key, value)| (key.trim().to_string(), value.trim().to_string()))
}

/// Those of whatever among `texts` has them.
pub fn pairs(texts: &[String]) -> Vec<Pair> {
    texts.iter().filter_map(|text| pair(text)).collect()
}

/// Key and value as results hold them.
pub fn settings(pairs: &[Pair]) -> Vec<Setting> {
    pairs.iter().map(|(key, value)| Setting { key: key.clone(), value: value.clone() }).collect()
}
