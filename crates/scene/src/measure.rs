//! What is measured in a scene, for people and other programs: tables with a row per frame, and maps.

use glam::Vec3;

/// A table of statistics with a row per frame, and what is made of it: plots, totals and warnings.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// File name, `[a-z0-9_]+`, unique in the scene.
    pub name: String,
    /// Names of its columns, `[a-z0-9_]+`, and their units, empty for numbers.
    pub columns: Vec<(String, &'static str)>,
    /// Groups of columns that are drawn into one plot each: its title, and columns by number.
    pub plots: Vec<(&'static str, Vec<usize>)>,
    /// Indices of the columns that accumulate from the first frame on; the others hold the state at their frame.
    pub totals: Vec<usize>,
    /// Indices of the columns by which runs with different parameters are compared.
    pub outcome: Vec<usize>,
    /// Parameters of the run, which the file of statistics repeats.
    pub parameters: serde_json::Value,
    /// Warnings known before the first frame: code and text.
    pub said: Vec<(&'static str, String)>,
    /// Columns that bring a warning if a value exceeds a threshold.
    pub watches: Vec<Watch>,
}

/// A column whose largest value brings a warning above a threshold.
#[derive(Debug, Clone, PartialEq)]
pub struct Watch {
    /// Index of the column in [`Table::columns`].
    pub column: usize,
    /// Threshold in the column's unit; a value equal to it brings no warning.
    pub above: f64,
    /// Code of the warning, as listed in docs/codes.md.
    pub code: &'static str,
    /// Message of the warning, with `{}` for the largest value, `{once}` for how often that is: "once", "3 times".
    pub text: &'static str,
}

impl Table {
    /// Warnings of a run in which `most` was the largest value of each column.
    pub fn warnings(&self, most: &[f64]) -> Vec<(&'static str, String)> {
        let warning = |w: &Watch| {
            let value = most.get(w.column).copied().filter(|v| *v > w.above)?;
            let shown = if value >= 1.0 { format!("{value:.0}") } else { format!("{value:.1e}") };
            let often = if shown == "1" { "once".to_owned() } else { format!("{shown} times") };
            Some((w.code, w.text.replace("{once}", &often).replace("{}", &shown)))
        };
        self.watches.iter().filter_map(warning).collect()
    }
}

/// The largest value of each column, for [`Table::warnings`]; NaN is ignored. Empty without rows.
pub fn largest<'a>(rows: impl IntoIterator<Item = &'a [f64]>) -> Vec<f64> {
    let mut most: Vec<f64> = Vec::new();
    for row in rows {
        most.resize(most.len().max(row.len()), f64::NEG_INFINITY);
        most.iter_mut().zip(row).for_each(|(m, v)| *m = m.max(*v));
    }
    most
}

/// A map of measured numbers over a rectangle in the world, such as a deposition.
#[derive(Debug, Clone, PartialEq)]
pub struct Field {
    /// File name, `[a-z0-9_]+`, unique in the scene.
    pub name: String,
    /// The measured quantity, which is the name of its folder in `maps/`: "deposition".
    pub what: &'static str,
    /// Number of texels along `along`.
    pub width: usize,
    /// Number of texels along `down`; row 0 starts at `corner`.
    pub height: usize,
    /// Outer corner of the first texel, in the world, m.
    pub corner: Vec3,
    /// Vector along a whole row, m.
    pub along: Vec3,
    /// Vector down a whole column, m.
    pub down: Vec3,
    /// Unit of the values as files spell it, such as `1/m^2`.
    pub unit: &'static str,
    /// Frames from one file to the next; `None`: a file of the last frame only.
    pub every: Option<u32>,
}

impl Field {
    /// Area of a texel, m^2.
    pub fn texel_area(&self) -> f64 {
        let whole = self.along.as_dvec3().length() * self.down.as_dvec3().length();
        whole / (self.width * self.height).max(1) as f64
    }
}
