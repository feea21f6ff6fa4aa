//! Stands for JPEG files in builds without the feature `png`.

use super::Image;
use crate::Error;

pub(super) fn decode(_: &[u8], _: bool) -> Result<Image, String> {
    Err(Error::left_out("JPEG files", "png"))
}
