//! Coefficient tables of attractors and trees, written as `.ifs` or `.flame`.

use crate::bake::output::ifs_tables::ifs_systems;
use crate::recipe::Recipe;
use osier_base::diagnostic::Report;
use osier_base::{Error, Result};
use osier_ifs::write::{entries, flames};

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
