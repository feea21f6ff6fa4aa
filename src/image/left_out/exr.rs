//! Stands for OpenEXR files in builds without the feature `exr`.

use std::io::{self, Seek, Write};

use super::{Format, Picture};

pub(super) fn encode(_: &Picture, _: &mut (impl Write + Seek)) -> io::Result<()> {
    Err(io::Error::other(Format::Exr.left_out()))
}

pub(super) fn decode(_: &[u8]) -> Result<Picture, String> {
    Err(Format::Exr.left_out())
}
