//! The surroundings of a plant that its growth depends on.

use osier_plants::grow::years::RecordedTree;
use osier_scene::Trs;
use osier_scene::solid::Solid;

/// The solids around a growing plant, its transform, and the record of its species' growth.
#[derive(Debug, Clone, Copy, Default)]
pub struct GrowthSite<'a> {
    /// All solids of the scene, in world space; none if no plant grows round solids.
    pub solids: &'a [Solid],
    /// World from plant space.
    pub transform: Trs,
    /// The tree of a species, grown before all other plants; `None` for plants of other sources.
    pub tree: Option<&'a RecordedTree>,
    /// Number of intervals between the frames of the clip; 0 for a still picture.
    pub frames: f64,
}
