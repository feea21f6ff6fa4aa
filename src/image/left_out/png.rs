//! Stands for PNG files in builds without the feature `png`.

use std::io::{self, Write};

use super::{Format, Image, ToneSettings};

pub(super) fn encode(_: &Image, _: &ToneSettings, _: &mut impl Write) -> io::Result<()> {
    Err(io::Error::other(Format::Png.left_out()))
}

pub(super) fn encode_pixels(_: &[[u8; 3]], _: usize, _: &mut impl Write) -> io::Result<()> {
    Err(io::Error::other(Format::Png.left_out()))
}

pub(super) fn decode(_: &[u8], _: bool) -> Result<Image, String> {
    Err(Format::Png.left_out())
}
