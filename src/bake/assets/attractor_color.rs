//! How the points of an attractor are coloured.

use crate::recipe::scene::ColorBy;
use osier_ifs::color::ColorMode;

/// The colour mode that the key `color_by` names. `prefix`: number of leading letters of an address that the mode `word`
/// compares.
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
