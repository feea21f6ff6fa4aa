//! OpenEXR: the image's `R`, `G`, `B` and the layers' channels (`direct.R`, `depth.Z`) in one part,
//! as viewers expect them.

use std::io::{self, Cursor, Seek, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};

use ::exr::prelude::{
    AnyChannel, AnyChannels, AttributeValue, Blocks, Compression, Encoding, FlatSamples, LineOrder, MetaData,
    ReadChannels, ReadLayers, SmallVec, Text, Vec2, WritableImage,
};

use super::{Attribute, DEFLATE, Image, Layer, LayerData, Picture, check_size};

/// Writes `picture` with all layers and attributes: 32-bit floats, ZIP-compressed blocks of 16 lines.
pub(super) fn encode(picture: &Picture, out: &mut (impl Write + Seek)) -> io::Result<()> {
    let Image { width, height, pixels } = &picture.image;
    let mut channels: Vec<AnyChannel<FlatSamples>> = Vec::new();
    let mut add = |name: String, samples: Vec<f32>| {
        channels.push(AnyChannel::new(text(&name), FlatSamples::F32(samples)));
    };
    for (c, channel) in ["R", "G", "B"].into_iter().enumerate() {
        add(channel.into(), pixels.iter().map(|pixel| pixel[c]).collect());
    }
    for Layer { name, channels } in &picture.layers {
        let (names, values) = match channels {
            LayerData::Rgb(values) => (["R", "G", "B"], values),
            LayerData::Normal(values) => (["X", "Y", "Z"], values),
            LayerData::Scalar(values) => {
                // Depth is Z by convention; Y, luminance, is what viewers show as grey.
                let channel = if name == "depth" { "Z" } else { "Y" };
                add(format!("{name}.{channel}"), values.clone());
                continue;
            }
        };
        for (c, channel) in names.into_iter().enumerate() {
            add(format!("{name}.{channel}"), values.iter().map(|value| value[c]).collect());
        }
    }
    // Readers find channels by name and expect them sorted; two of a name would make the file unreadable.
    channels.sort_unstable_by(|a, b| a.name.cmp(&b.name));
    if let Some([twice, _]) = channels.array_windows().find(|[a, b]| a.name == b.name) {
        return Err(io::Error::other(format!("there are two channels called {}", string(&twice.name))));
    }

    let mut attributes = ::exr::prelude::LayerAttributes::default();
    for (name, value) in &picture.attributes {
        let value = match value {
            Attribute::Text(value) => AttributeValue::Text(text(value)),
            Attribute::Number(value) => AttributeValue::F64(*value),
        };
        attributes.other.insert(text(name), value);
    }
    let encoding =
        Encoding { compression: Compression::ZIP16, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };
    let channels = AnyChannels { list: channels.into() };
    let layer = ::exr::prelude::Layer::new(Vec2(*width, *height), attributes, encoding, channels);
    ::exr::prelude::Image::from_layer(layer).write().to_buffered(out).map_err(|error| match error {
        ::exr::error::Error::Io(error) => error,
        other => io::Error::other(other.to_string()),
    })
}

/// Reads the image and its layers from a file of any compression and sample type.
pub(super) fn decode(bytes: &[u8]) -> Result<Picture, String> {
    // The decoders assert some of what they expect of a file (with debug assertions, overflows in B44 and
    // lines of mip levels), which only a caught panic turns into an error.
    catch_unwind(AssertUnwindSafe(|| decode_unguarded(bytes)))
        .unwrap_or_else(|_| Err("not a sound EXR file: its blocks contradict each other".into()))
}

fn decode_unguarded(bytes: &[u8]) -> Result<Picture, String> {
    let fail = |error: ::exr::error::Error| format!("not a sound EXR file: {error}");
    check_headers(&MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(fail)?, bytes.len())?;

    // On one thread: a panic in the decoder's own pool would end the process.
    let file = ::exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(bytes))
        .map_err(fail)?;

    let mut size = None;
    let mut planes = Planes::default();
    let mut attributes = Vec::new();
    for (index, part) in file.layer_data.into_iter().enumerate() {
        let part_name = part.attributes.layer_name.as_ref().map(string).unwrap_or_default();
        attributes.extend(part.attributes.other.iter().filter_map(attribute));
        let subsampled = part.channel_data.list.iter().find(|channel| channel.sampling != Vec2(1, 1));
        if let Some(channel) = subsampled {
            return Err(format!("channel {} is subsampled, which is not supported", string(&channel.name)));
        }
        if *size.get_or_insert(part.size) != part.size {
            return Err("the parts of this EXR file differ in size; one size is expected".into());
        }
        // The first part is the image unless its name says that it is a layer of one that follows.
        for channel in part.channel_data.list {
            let name = string(&channel.name);
            let full = if index == 0 || name.starts_with(&format!("{part_name}.")) || part_name.is_empty() {
                name
            } else {
                format!("{part_name}.{name}")
            };
            planes.push(full, floats(channel.sample_data));
        }
    }
    let Some(Vec2(width, height)) = size else { return Err("this EXR file holds no image".into()) };
    let (pixels, layers) = planes.assemble()?;
    attributes.sort_by(|(a, _), (b, _)| a.cmp(b));
    Ok(Picture { image: Image { width, height, pixels }, layers, attributes })
}

/// Refuses what this reader cannot use, and sizes beyond what the file can hold.
fn check_headers(metadata: &MetaData, file_length: usize) -> Result<(), String> {
    if metadata.headers.iter().any(|header| header.deep) {
        return Err("this EXR file holds deep data; a flat image is expected".into());
    }
    // Each block has an offset in the table and a place and a length where it lies: 16 bytes.
    let blocks: usize = metadata.headers.iter().map(|header| header.chunk_count).fold(0, usize::saturating_add);
    if blocks > file_length / 16 {
        return Err(format!(
            "the header claims {blocks} blocks, more than a file of {file_length} bytes can hold: \
             it is damaged or cut short"
        ));
    }
    for header in &metadata.headers {
        let Vec2(width, height) = header.layer_size;
        let bits = header.channels.list.iter().map(|channel| 8 * channel.sample_type.bytes_per_sample() as u64).sum();
        let expansion = match header.compression {
            Compression::Uncompressed => 1,
            // Two bytes stand for a run of 128 at most.
            Compression::RLE => 64,
            // DWA may keep as little as one coefficient of an 8 × 8 block, and deflates that.
            Compression::DWAA(_) | Compression::DWAB(_) => 64 * DEFLATE,
            _ => DEFLATE,
        };
        check_size(width, height, bits, expansion, file_length)?;
    }
    Ok(())
}

/// Channels by layer, in the order of the file.
#[derive(Default)]
struct Planes {
    /// Layer name (empty: the image's own), channel name, values.
    list: Vec<(String, String, Vec<f32>)>,
}

impl Planes {
    fn push(&mut self, full_name: String, values: Vec<f32>) {
        let (layer, channel) = full_name.rsplit_once('.').unwrap_or(("", &full_name));
        self.list.push((layer.to_owned(), channel.to_owned(), values));
    }

    /// Takes the channels `names` of `layer`, if all are there.
    fn take(&mut self, layer: &str, names: [&str; 3]) -> Option<Vec<[f32; 3]>> {
        let find = |name| self.list.iter().position(|(l, c, _)| l == layer && c == name);
        let [Some(a), Some(b), Some(c)] = names.map(find) else { return None };
        let [x, y, z] = [a, b, c].map(|index| &self.list[index].2);
        let pixels = x.iter().zip(y).zip(z).map(|((&x, &y), &z)| [x, y, z]).collect();
        self.list.retain(|(l, c, _)| !(l == layer && names.contains(&c.as_str())));
        Some(pixels)
    }

    /// The pixels of the image, and the layers.
    fn assemble(mut self) -> Result<(Vec<[f32; 3]>, Vec<Layer>), String> {
        let pixels = match self.take("", ["R", "G", "B"]) {
            Some(pixels) => pixels,
            None => {
                let own: Vec<&str> = self.list.iter().filter(|(l, ..)| l.is_empty()).map(|(_, c, _)| &**c).collect();
                let coloured = own.iter().any(|name| matches!(*name, "R" | "G" | "B" | "RY" | "BY"));
                let luminance = self.list.iter().position(|(l, c, _)| l.is_empty() && c == "Y");
                match luminance {
                    Some(index) if !coloured => self.list.remove(index).2.into_iter().map(|value| [value; 3]).collect(),
                    _ => {
                        let found: Vec<String> = self
                            .list
                            .iter()
                            .map(|(l, c, _)| if l.is_empty() { c.clone() } else { format!("{l}.{c}") })
                            .collect();
                        return Err(format!(
                            "an image with the channels R, G, B or Y is expected, this file has {}",
                            found.join(", ")
                        ));
                    }
                }
            }
        };
        let mut layers = Vec::new();
        while let Some((layer, channel, _)) = self.list.first() {
            let (layer, channel) = (layer.clone(), channel.clone());
            let channels = if layer.is_empty() {
                None
            } else if let Some(values) = self.take(&layer, ["R", "G", "B"]) {
                Some(LayerData::Rgb(values))
            } else {
                self.take(&layer, ["X", "Y", "Z"]).map(LayerData::Normal)
            };
            layers.push(match channels {
                Some(channels) => Layer { name: layer, channels },
                None => {
                    let alone = !self.list.iter().skip(1).any(|(other, ..)| *other == layer)
                        && !layers.iter().any(|other: &Layer| other.name == layer);
                    let name = match (layer.is_empty(), alone) {
                        (true, _) => channel,
                        (false, true) => layer,
                        (false, false) => format!("{layer}.{channel}"),
                    };
                    Layer { name, channels: LayerData::Scalar(self.list.remove(0).2) }
                }
            });
        }
        Ok((pixels, layers))
    }
}

/// Samples of any type as floats.
fn floats(samples: FlatSamples) -> Vec<f32> {
    match samples {
        FlatSamples::F16(values) => values.into_iter().map(f32::from).collect(),
        FlatSamples::F32(values) => values,
        FlatSamples::U32(values) => values.into_iter().map(|value| value as f32).collect(),
    }
}

/// A custom attribute that is a text or a number.
fn attribute((name, value): (&Text, &AttributeValue)) -> Option<(String, Attribute)> {
    let value = match value {
        AttributeValue::Text(value) => Attribute::Text(string(value)),
        AttributeValue::F32(value) => Attribute::Number(f64::from(*value)),
        AttributeValue::F64(value) => Attribute::Number(*value),
        AttributeValue::I32(value) => Attribute::Number(f64::from(*value)),
        _ => return None,
    };
    Some((string(name), value))
}

/// A text as EXR keeps it: UTF-8 bytes.
fn text(value: &str) -> Text {
    Text::from_bytes_unchecked(SmallVec::from_slice(value.as_bytes()))
}

fn string(text: &Text) -> String {
    String::from_utf8_lossy(text.as_slice()).into_owned()
}
