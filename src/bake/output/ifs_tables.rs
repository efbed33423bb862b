//! The coefficient tables of a recipe in the form in which `osier convert` and exporters write tables.

use crate::recipe::{AttractorRecipe, Growth, Recipe};
use osier_ifs::PictureView;
use osier_ifs::weights::probabilities;
use osier_ifs::write::{TableItem, squashed};

/// All attractors, then all IFS trees of a recipe; the trunk of a tree becomes one of its maps.
pub fn ifs_systems(recipe: &Recipe) -> Vec<TableItem> {
    let trees = recipe.plants.iter().filter_map(|p| match &p.growth {
        Growth::Ifs(stems, _) => Some(squashed(stems)),
        Growth::Grammar(_) | Growth::Mesh(..) | Growth::Shapes(_) | Growth::Species(_) => None,
    });
    recipe.clouds.iter().map(attractor_system).chain(trees).collect()
}

fn attractor_system(recipe: &AttractorRecipe) -> TableItem {
    let system = &recipe.system;
    let (low, high) = if recipe.study.unbounded { recipe.extent.quantile } else { recipe.extent.bounds };
    let (size, middle) = (high - low, (low + high) * 0.5);
    let view = PictureView {
        center: [middle.x, middle.y],
        width: 1.06 * size.x.max(size.y).max(1e-9),
        rotate: 0.0,
        aspect: 1.0,
        background: [0.0; 3],
    };
    TableItem { system: system.clone(), weights: probabilities(system, recipe.rule).0, view: Some(view) }
}
