//! Options of points as CSV.

use crate::up_axis::UpAxis;

/// Which tables are written, and in which axes.
#[derive(Debug, Clone)]
pub struct PointsOptions {
    /// Names of the tables that are written, where the scene has them.
    pub tables: Vec<&'static str>,
    /// Axis that points up in the files; by default Z, as in Blender.
    pub up: UpAxis,
}

impl Default for PointsOptions {
    fn default() -> Self {
        Self { tables: Vec::new(), up: UpAxis::Z }
    }
}

impl PointsOptions {
    /// Whether [`Self::tables`] has this name; the scene may lack the table.
    pub fn writes(&self, table: &str) -> bool {
        self.tables.contains(&table)
    }
}
