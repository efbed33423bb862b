//! Coefficient tables of attractors and trees, written as `.ifs` or `.flame`.

use crate::recipe::{AttractorRecipe, Growth, Recipe};
use osier_base::diagnostic::Report;
use osier_base::{Error, Result};
use osier_ifs::PictureView;
use osier_ifs::weights::probabilities;
use osier_ifs::write::{TableItem, entries, flames, squashed};

/// File format for the coefficients of iterated function systems.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TableFormat {
    /// Fractint's columns, `.ifs`.
    Fractint,
    /// XML of flam3 and Apophysis, `.flame`: systems of the plane only.
    Flame,
}

/// The coefficient tables of a recipe encoded as the text of one file.
#[derive(Debug)]
pub struct CoefficientTables {
    /// Text of the whole file in the chosen format, systems in the order of the recipe.
    pub text: String,
    /// Number of attractors and trees whose coefficients the text holds.
    pub systems: usize,
    /// Warnings I011 about properties of the systems that the notation cannot hold.
    pub report: Report,
}

impl CoefficientTables {
    /// Encodes every attractor and every table-grown tree of a recipe, in its order.
    /// # Errors
    /// X030 if the recipe has none; `Input` if the notation cannot hold one of them.
    pub fn encode(recipe: &Recipe, format: TableFormat) -> Result<Self> {
        let items = ifs_systems(recipe);
        if items.is_empty() {
            let reason =
                format!("\"{}\" holds no coefficients; .ifs and .flame are for tables and their trees", recipe.name);
            return Err(Error::export("X030", reason));
        }
        let encoded = match format {
            TableFormat::Fractint => Ok(entries(&items)),
            TableFormat::Flame => flames(&items),
        };
        let (text, losses) = encoded.map_err(|d| Error::from(*d))?;
        let mut report = Report::default();
        losses.into_iter().for_each(|d| report.push(d));
        Ok(Self { text, systems: items.len(), report })
    }
}

/// All attractors, then all IFS trees of a recipe; the trunk of a tree becomes one of its maps.
fn ifs_systems(recipe: &Recipe) -> Vec<TableItem> {
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
