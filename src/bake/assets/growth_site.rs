//! What a plant needs to know of its scene while it grows.

use osier_plants::grow::years::RecordedTree;
use osier_scene::Trs;
use osier_scene::solid::Solid;

/// Where a plant grows: the solids of its scene and its own place among them.
#[derive(Debug, Clone, Copy, Default)]
pub struct GrowthSite<'a> {
    /// All solids of the scene, in world space; none if no plant grows round solids.
    pub solids: &'a [Solid],
    /// World from plant space.
    pub transform: Trs,
    /// The tree of a species, which has grown before, together with others that shade it.
    pub tree: Option<&'a RecordedTree>,
    /// Intervals between the frames of the clip.
    pub frames: f64,
}
