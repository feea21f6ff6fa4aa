//! Stands for Radiance files in builds without the feature `png`.

use std::io::{self, Write};

use super::{Format, Image};

pub(super) fn encode(_: &Image, _: &mut impl Write) -> io::Result<()> {
    Err(io::Error::other(Format::Hdr.left_out()))
}

pub(super) fn decode(_: &[u8]) -> Result<Image, String> {
    Err(Format::Hdr.left_out())
}
