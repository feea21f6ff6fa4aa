//! What a scene's parts are called: as its file says, or by where they are.

use crate::light::Light;
use crate::math::DVec3;
use crate::render::{Happening, Replayed};
use crate::scene::{Description, Scene};

/// Names of what a scene holds by its indices.
pub struct Names<'s> {
    scene: &'s Scene,
    /// Of placed shapes, in their order; lamps come after them.
    shapes: Vec<String>,
    materials: Vec<String>,
}

impl<'s> Names<'s> {
    /// Of a scene that was built from this description.
    pub fn new(description: &Description, scene: &'s Scene) -> Self {
        let placed = || description.shapes.iter().filter(|shape| shape.visible);
        let shape = |shape: &crate::scene::description::Shape| shape.place.key().to_string();
        let material =
            |shape: &crate::scene::description::Shape| description.materials[shape.material.value].name.clone();
        Names { scene, shapes: placed().map(shape).collect(), materials: placed().map(material).collect() }
    }

    /// A placed shape.
    pub fn shape(&self, id: u32) -> String {
        let lamp = || format!("the lamp at {}", self.place(self.scene.geometry.bounds(id).center()));
        self.shapes.get(id as usize).cloned().unwrap_or_else(lamp)
    }

    /// What a placed shape is made of.
    pub fn material(&self, id: u32) -> &str {
        self.materials.get(id as usize).map_or("", String::as_str)
    }

    /// A medium.
    pub fn medium(&self, index: u32) -> &str {
        &self.scene.media[index as usize].name
    }

    /// A light.
    pub fn light(&self, index: u32) -> String {
        let light = &self.scene.lights[index as usize];
        let at = |position: DVec3| format!("the {} light at {}", light.kind(), self.place(position));
        match light {
            Light::Point(point) => at(point.position),
            Light::Spot(spot) => at(spot.position),
            Light::Goniometric(lamp) => at(lamp.position),
            Light::Directional(light) => format!("the directional light along {}", numbers(light.direction)),
            Light::Environment(_) => "the environment".to_string(),
            Light::Area(area) => format!("the emission of {}", self.shape(area.shape)),
        }
    }

    /// A point in the file's coordinates.
    pub fn place(&self, point: DVec3) -> String {
        numbers(point + self.scene.center)
    }

    /// A path in words: a line for each event.
    pub fn story(&self, replayed: &Replayed) -> String {
        let mut lines = vec![format!(
            "a camera ray from {} along {}",
            self.place(replayed.ray.origin),
            numbers(replayed.ray.direction)
        )];
        for told in &replayed.told {
            let place = || self.place(told.place);
            let on = |onward: Option<DVec3>| {
                onward.map_or("ends there".to_string(), |direction| format!("goes on along {}", numbers(direction)))
            };
            let what = match &told.what {
                Happening::Segment { medium, length } => {
                    format!("passes {length:.6} of medium {} to {}", self.medium(*medium), place())
                }
                Happening::Surface { shapes, nature, onward } => {
                    let name = |&id: &u32| match self.material(id) {
                        "" => self.shape(id),
                        material => format!("{} of {material:?}", self.shape(id)),
                    };
                    let names: Vec<String> = shapes.iter().map(name).collect();
                    let nature = format!("{nature:?}").to_lowercase();
                    format!("meets {} ({nature}) at {}, {}", names.join(" and "), place(), on(*onward))
                }
                Happening::Collision { medium, onward } => {
                    format!("collides in medium {} at {}, {}", self.medium(*medium), place(), on(*onward))
                }
                Happening::Light { light, .. } => format!("meets {} at {}", self.light(*light), place()),
                Happening::Escape => format!("leaves the scene along {}", numbers(told.place)),
            };
            if told.begins_part {
                lines.push("a part that was split off goes on".to_string());
            }
            let counted = match told.counted.abs().max_element() > 0.0 {
                true => format!("; counted {}", numbers(told.counted)),
                false => String::new(),
            };
            lines.push(format!("{:>4}  {what}{counted}; throughput {}", told.events, numbers(told.throughput)));
        }
        let total = replayed.sample.radiance.iter().sum();
        lines.push(format!("radiance {}", numbers(total)));
        if replayed.tally.broken > 0 {
            lines.push("dropped from the picture: not finite, or too bright for it".to_string());
        }
        lines.join("\n") + "\n"
    }
}

/// Three numbers as scene files have them.
fn numbers(v: DVec3) -> String {
    let number = |x: f64| match x.abs() {
        0.0 => "0".to_string(),
        1e-3..1e5 => format!("{x:.6}").trim_end_matches('0').trim_end_matches('.').to_string(),
        _ => format!("{x:.4e}"),
    };
    format!("({}, {}, {})", number(v.x), number(v.y), number(v.z))
}
