//! Trees of coefficient tables: from keys to options of growth.

use glam::Vec3;

use crate::bake::assets::material_set::MaterialSet;
use crate::bake::assets::skin_options::{BARK, SHOOT, SHOOT_RADIUS};
use crate::recipe::PlantRecipe;
use crate::recipe::scene::{BranchRadii, IfsTreeKeys, set_letters};
use osier_ifs::stems::TreeSystem;
use osier_plants::grow::ifs;

/// Options of an IFS tree from the keys of `[plants.NAME.tree]` and from the organs and materials in `set`.
pub(crate) fn ifs_tree_options(
    recipe: &PlantRecipe,
    stems: &TreeSystem,
    keys: &IfsTreeKeys,
    set: &MaterialSet,
) -> ifs::TreeOptions {
    ifs::TreeOptions {
        height: keys.height,
        eps: keys.eps,
        max_depth: saturating_u16(keys.max_depth),
        max_order: saturating_u16(keys.max_order),
        variation: keys.variation,
        radius: keys.radius,
        pipe: keys.radii == BranchRadii::Pipe,
        leaf_density: keys.leaf_density,
        leaves_per_site: keys.leaves,
        leaf: set.organs.get(&'l').cloned(),
        sets: set_letters(&stems.system).filter_map(|letter| set.organs.get(&letter)).cloned().collect(),
        cards: set.cards.clone(),
        materials: set.materials.iter().map(|m| m.name.clone()).collect(),
        bark: (BARK, SHOOT, f64::from(SHOOT_RADIUS)),
        source: recipe.source.clone(),
        up: Vec3::Y,
    }
}

/// A depth limit in 16 bits; beyond them it is no limit in practice.
#[allow(clippy::cast_possible_truncation, reason = "at most u16::MAX after the minimum")]
fn saturating_u16(limit: u32) -> u16 {
    limit.min(u32::from(u16::MAX)) as u16
}
