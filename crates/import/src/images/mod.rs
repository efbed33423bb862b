//! Images of imported materials: decoding of PNG and JPEG within the limits, and a cache of the maps derived from them.

mod cache;
mod decode;
mod old_formats;

pub(super) use cache::{MapCache, MapUse};
pub(super) use decode::{DecodedImage, decode, decode_deep, spend};
pub(super) use old_formats::decode_old;
