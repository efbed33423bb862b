//! Which materials the leaves of a plant have at its season.

use std::collections::BTreeMap;

use osier_plants::season::{BudOrgan, LeafColor, LeafHabit};

/// The materials of a plant's leaves at a season.
#[derive(Debug, Clone, Default)]
pub struct SeasonMaterials {
    pub(crate) organs: Vec<OrganSeason>,
}

/// Habit and materials of one organ at the season.
#[derive(Debug, Clone)]
pub(crate) struct OrganSeason {
    /// Name of the organ, as in the material set.
    pub(crate) name: String,
    pub(crate) habit: LeafHabit,
    /// Material of each colour, by the material of summer.
    pub(crate) materials: BTreeMap<(u32, LeafColor), u32>,
    pub(crate) bud: Option<BudOrgan>,
}
