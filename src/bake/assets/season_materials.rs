//! The materials of leaves by season, organ and colour.

use std::collections::BTreeMap;

use osier_plants::season::{BudOrgan, LeafColor, LeafHabit};

/// The materials that the leaves of a plant need for the seasons of a clip, organ by organ.
#[derive(Debug, Clone, Default)]
pub struct SeasonMaterials {
    pub(crate) organs: Vec<OrganSeason>,
}

/// Course of the year and materials of one organ.
#[derive(Debug, Clone)]
pub(crate) struct OrganSeason {
    /// Name of the organ in [`super::material_set::MaterialSet`], after which its prototypes are named.
    pub(crate) name: String,
    pub(crate) habit: LeafHabit,
    /// Index of the material that replaces a material of summer, for each colour that occurs.
    pub(crate) materials: BTreeMap<(u32, LeafColor), u32>,
    pub(crate) bud: Option<BudOrgan>,
}
