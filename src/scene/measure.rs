//! What is measured in a scene, for people and other programs: tables with a row per frame, and maps.

use glam::Vec3;

/// A table with a row per frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// File name, `[a-z0-9_]+`, unique in the scene.
    pub name: String,
    /// Names of its columns, `[a-z0-9_]+`, and their units, empty for numbers.
    pub columns: Vec<(&'static str, &'static str)>,
    /// Groups of columns that are drawn into one plot each: its title, and columns by number.
    pub plots: Vec<(&'static str, Vec<usize>)>,
    /// Said once about the whole run, as JSON.
    pub about: serde_json::Value,
}

/// A map of numbers over a rectangle.
#[derive(Debug, Clone, PartialEq)]
pub struct Field {
    /// File name, `[a-z0-9_]+`, unique in the scene.
    pub name: String,
    /// What it shows: "deposition".
    pub what: &'static str,
    /// Texels in a row.
    pub width: usize,
    /// Rows from the top.
    pub height: usize,
    /// Corner of the first texel's outer edge, m, and the vectors along rows and down columns, m, over the whole map.
    pub corner: Vec3,
    /// See `corner`.
    pub along: Vec3,
    /// See `corner`.
    pub down: Vec3,
    /// Of each value.
    pub unit: &'static str,
    /// Frames between two files, or only the last.
    pub every: Option<u32>,
}

impl Field {
    /// Area of a texel, m^2.
    pub fn texel_area(&self) -> f64 {
        let whole = self.along.as_dvec3().length() * self.down.as_dvec3().length();
        whole / (self.width * self.height).max(1) as f64
    }
}
