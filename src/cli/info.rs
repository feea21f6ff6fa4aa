//! `volpm info`.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::{Value, json};

use super::planned::refuse;
use crate::geometry::Mesh;
use crate::image::{self, Attribute, LayerData};
use crate::medium::density::{npy, vdb};
use crate::medium::{Albedo, Phases};
use crate::render::Checkpoint;
use crate::scene;
use crate::{Error, Result};

#[derive(Args)]
pub struct Arguments {
    /// A scene (.toml), volume (.vdb, .npy), mesh (.obj, .obj.gz), image (.exr, .png, .pfm, .hdr) or checkpoint.
    file: PathBuf,
    /// As JSON.
    #[arg(long)]
    json: bool,
    /// Warnings of a scene are errors.
    #[arg(long)]
    strict: bool,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let path = &arguments.file;
    let ending_of = |path: &Path| path.extension().map(|ending| ending.to_string_lossy().to_lowercase());
    let ending = match ending_of(path) {
        Some(packed) if packed == "gz" => ending_of(&path.with_extension("")).unwrap_or_default() + ".gz",
        ending => ending.unwrap_or_default(),
    };
    let facts = match ending.as_str() {
        "toml" => scene_facts(path, arguments.strict)?,
        "vdb" => vdb_facts(path)?,
        "npy" => npy_facts(path)?,
        "obj" | "obj.gz" => mesh_facts(path)?,
        "exr" | "png" | "pfm" | "hdr" => image_facts(path)?,
        _ if path.is_file() && Checkpoint::is_one(path) => checkpoint_facts(path)?,
        _ => {
            return Err(Error::Usage(format!(
                "{}: nothing is known of files ending in {ending:?}; expected .toml, .vdb, .npy, .obj, .obj.gz, .exr, .png, .pfm, .hdr, or a checkpoint",
                path.display()
            )));
        }
    };
    if arguments.json {
        return super::print(&super::json(&facts)?);
    }
    let mut text = String::new();
    outline(&mut text, &facts, 0);
    super::print(&text)
}

/// Facts as indented lines.
fn outline(text: &mut String, value: &Value, depth: usize) {
    let indent = "  ".repeat(depth);
    let Value::Object(entries) = value else { return };
    for (key, value) in entries {
        match value {
            Value::Object(_) => {
                let _ = writeln!(text, "{indent}{key}");
                outline(text, value, depth + 1);
            }
            Value::Array(items) if items.iter().any(Value::is_object) => {
                let _ = writeln!(text, "{indent}{key}");
                for item in items {
                    outline(text, item, depth + 1);
                    let _ = writeln!(text);
                }
            }
            Value::Array(items) => {
                let items: Vec<String> = items.iter().map(plain).collect();
                let _ = writeln!(text, "{indent}{key}: {}", items.join(", "));
            }
            value => {
                let _ = writeln!(text, "{indent}{key}: {}", plain(value));
            }
        }
    }
}

fn plain(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Null => "-".to_string(),
        Value::Array(items) => items.iter().map(plain).collect::<Vec<_>>().join(" "),
        other => other.to_string(),
    }
}

fn checkpoint_facts(path: &Path) -> Result<Value> {
    let Checkpoint { subject, film, stats } = Checkpoint::read(path)?;
    let (width, height) = film.size();
    let passes = |(seed, (first, last)): (u64, (u32, u32))| json!({ "seed": seed, "first": first, "last": last });
    Ok(json!({
        "file": path.display().to_string(),
        "scene": subject.scene,
        "method": subject.method,
        "width": width,
        "height": height,
        "passes": film.done().ranges().map(passes).collect::<Vec<_>>(),
        "parts_of_a_pass": subject.parts,
        "samples": stats.samples,
        "volume_photons": stats.volume,
        "standard_error": stats.error,
    }))
}

fn vdb_facts(path: &Path) -> Result<Value> {
    let file = vdb::File::open(path)?;
    let mut grids = Vec::new();
    for (index, info) in file.grids().iter().enumerate() {
        let mut facts = json!({
            "grid": info.name,
            "type": info.tree_type,
            "class": format!("{:?}", info.class),
            "half": info.half,
            "compression": compression(info.compression),
            "background": info.background,
        });
        let mut add = |key: &str, value: Value| facts[key] = value;
        match &info.index_to_world {
            Ok(transform) => {
                let m = glam::DMat4::from(*transform).transpose().to_cols_array_2d();
                add("index_to_world", json!(m[..3].iter().map(|row| json!(row)).collect::<Vec<_>>()));
            }
            Err(why) => add("index_to_world", json!(why)),
        }
        let channels =
            (0..info.channels().unwrap_or(1)).map(|channel| Ok(file.read_channel(index, channel)?.statistics()));
        match channels.collect::<Result<Vec<vdb::Statistics>>>().as_deref() {
            Ok([]) => {}
            Ok(statistics @ [first, ..]) => {
                // A number, or one for each channel.
                let each = |number: fn(&vdb::Statistics) -> Value| match statistics {
                    [only] => number(only),
                    channels => Value::Array(channels.iter().map(number).collect()),
                };
                add("active_voxels", json!(first.active_voxels));
                if let Some((low, high)) = first.bounds {
                    add("bounds", json!([low, high]));
                    add("sum", each(|channel| json!(channel.sum)));
                    add("minimum", each(|channel| json!(channel.min)));
                    add("maximum", each(|channel| json!(channel.max)));
                    add("mean", each(|channel| json!(channel.sum / channel.active_voxels as f64)));
                }
            }
            Err(error) => add("values", json!(error.to_string())),
        }
        for (key, value) in &info.metadata {
            facts["metadata"][key] = match value {
                vdb::MetaValue::Text(text) | vdb::MetaValue::Other(text) => json!(text),
                vdb::MetaValue::Bool(value) => json!(value),
                vdb::MetaValue::Int(value) => json!(value),
                vdb::MetaValue::Float(value) => json!(value),
                vdb::MetaValue::Vec3i(value) => json!(value),
                vdb::MetaValue::Vec3(value) => json!(value),
            };
        }
        grids.push(facts);
    }
    let (major, minor) = file.library_version();
    let library = format!("{major}.{minor}");
    Ok(
        json!({ "file": path.display().to_string(), "format": "OpenVDB", "version": file.version(), "library": library, "grids": grids }),
    )
}

fn compression(compression: vdb::Compression) -> String {
    let mut parts = Vec::new();
    parts.extend(compression.zip().then_some("zip"));
    parts.extend(compression.blosc().then_some("blosc"));
    parts.extend(compression.active_mask().then_some("active mask"));
    if parts.is_empty() { "none".to_string() } else { parts.join(" + ") }
}

fn npy_facts(path: &Path) -> Result<Value> {
    let array = npy::read(path)?;
    let finite = array.values.iter().filter(|value| value.is_finite());
    let (min, max) = finite.clone().fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), &v| (a.min(v), b.max(v)));
    let sum: f64 = finite.clone().map(|&v| v as f64).sum();
    Ok(json!({
        "file": path.display().to_string(),
        "format": "NumPy",
        "samples": array.dims,
        "minimum": min,
        "maximum": max,
        "mean": sum / array.values.len().max(1) as f64,
        "not_finite": array.values.len() - finite.count(),
    }))
}

fn mesh_facts(path: &Path) -> Result<Value> {
    let mesh = Mesh::load(path, true)?;
    let bounds = mesh.bounds();
    Ok(json!({
        "file": path.display().to_string(),
        "format": "Wavefront OBJ",
        "triangles": mesh.triangle_count(),
        "bounds": [bounds.min.to_array(), bounds.max.to_array()],
        "closed": mesh.is_closed(),
        "area": mesh.area(),
        "volume": mesh.volume(),
    }))
}

fn image_facts(path: &Path) -> Result<Value> {
    let picture = image::read(path)?;
    let layers: Vec<Value> = picture
        .layers
        .iter()
        .map(|layer| {
            let kind = match layer.channels {
                LayerData::Rgb(_) => "colour",
                LayerData::Normal(_) => "vector",
                LayerData::Scalar(_) => "number",
            };
            json!(format!("{} ({kind})", layer.name))
        })
        .collect();
    let mut facts = json!({
        "file": path.display().to_string(),
        "width": picture.image.width,
        "height": picture.image.height,
        "mean": picture.image.channel_means(),
        "layers": layers,
    });
    for (key, value) in &picture.attributes {
        facts["attributes"][key] = match value {
            Attribute::Text(text) => json!(text),
            Attribute::Number(number) => json!(number),
        };
    }
    Ok(facts)
}

fn scene_facts(path: &Path, strict: bool) -> Result<Value> {
    let description = scene::read(path, &[])?;
    let (scene, settings) = scene::build(&description)?;
    if strict {
        refuse(&scene.warnings)?;
    }
    let bounds = scene.bounds();
    let media: Vec<Value> = scene
        .media
        .iter()
        .map(|medium| {
            let density = medium.density.max();
            json!({
                "medium": medium.name,
                "extinction": (medium.extinction * density).to_array(),
                "albedo": match medium.albedo.even() {
                    Some(albedo) => json!(albedo.to_array()),
                    None => {
                        let (least, most) = medium.albedo.range();
                        let what = if matches!(medium.albedo, Albedo::Mixed(_)) { "mixed" } else { "a grid" };
                        json!(format!("{what}, from {:?} to {:?}", least.to_array(), most.to_array()))
                    }
                },
                "mean_cosine": match &medium.phase {
                    Phases::Even(phase) => json!(phase.mean_cosine()),
                    Phases::HenyeyGreenstein(_) => json!(format!("a grid, up to {}", medium.phase.greatest_cosine())),
                    Phases::Mixed(_) => json!(format!("mixed, up to {}", medium.phase.greatest_cosine())),
                },
                "glows": medium.glows(),
            })
        })
        .collect();
    Ok(json!({
        "file": path.display().to_string(),
        "format": "scene",
        "film": settings.film.size(),
        "samples": settings.render.samples,
        "bounds": [(bounds.min + scene.center).to_array(), (bounds.max + scene.center).to_array()],
        "surfaces": scene.surfaces.len(),
        "solids": scene.surfaces.iter().filter(|surface| surface.solid.is_some()).count(),
        "lights": scene.lights.iter().map(|light| light.kind()).collect::<Vec<_>>(),
        "media": media,
        "warnings": scene.warnings,
    }))
}
