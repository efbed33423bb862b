//! How the points of an attractor are coloured.

use crate::recipe::scene::ColorBy;
use osier_ifs::color::ColorMode;

/// The color mode of a scene's word. `prefix`: letters of the address that `word` looks at.
pub(crate) fn color_mode(by: ColorBy, prefix: u32) -> ColorMode {
    match by {
        ColorBy::Map => ColorMode::Map,
        ColorBy::Word => ColorMode::Prefix(prefix),
        ColorBy::Palette => ColorMode::Coord,
        ColorBy::Depth => ColorMode::Depth,
        ColorBy::Order => ColorMode::Order,
        ColorBy::Density => ColorMode::Density,
    }
}
