//! Statistics of simulations: `stats/<table>.csv`, a row for each frame, `stats/<table>.json` with parameters, totals, means and
//! warnings, and `stats/<table>.svg`, the plots.
//!
//! ```
//! use osier_export::stats::{Run, Sweep, Whole};
//!
//! let run = |seed, exited| {
//!     let whole = Whole { last: vec![("exited".into(), exited)], ..Whole::default() };
//!     Run { values: vec!["2".into()], seed, hash: String::new(), whole }
//! };
//! let sweep = Sweep {
//!     title: "walls".into(),
//!     keys: vec!["solid.0.size.1".into()],
//!     outcome: vec!["exited".into()],
//!     runs: vec![run(1, 10.0), run(2, 14.0)],
//!     ..Sweep::default()
//! };
//! let exited = sweep.means()[0].outcome[0].expect("a column of the run");
//! assert_eq!([exited.mean, exited.least, exited.most], [12.0, 10.0, 14.0], "over the seeds");
//! ```

mod maps;
mod plot;
mod sweep;

pub use maps::MapStatistics;
pub use sweep::{Mean, MissingRun, Run, Spread, Sweep};

use std::fmt::Write as _;
use std::sync::Arc;

use serde_json::json;

use super::format::{FormatInfo, TextureUse};
use super::{Exporter, Summary};
use osier_base::files::Folder;
use osier_scene::{Frame, Scene, Table, largest};

/// Registry entry of statistics: tables, summaries and plots of simulations, no geometry.
pub const FORMAT: FormatInfo = FormatInfo {
    word: "csv",
    about: "statistics of flights and rain: tables, JSON and plots",
    folder: "stats",
    names_assets: false,
    notes_missing_files: true,
    endings: &[],
    pictures_beside: false,
    textures: TextureUse::Unused,
    memory_percent: 0,
    estimate: |input| input.scene.tables.len() as u64 * input.frames * 200,
    open: |job| vec![Box::new(StatsExporter::new(job.folder.clone()))],
};

/// Writes each table of a scene with its summary at the end: `stats/<name>.csv`, `.json` and, of several rows, `.svg`.
#[derive(Debug)]
pub struct StatsExporter {
    folder: Folder,
    scene: Option<Arc<Scene>>,
    /// For each table the rows so far, with their frame numbers.
    rows: Vec<Vec<(u32, Vec<f64>)>>,
}

impl StatsExporter {
    /// An exporter that writes into `stats/` below `folder`; nothing is written before the last frame.
    pub fn new(folder: Folder) -> Self {
        Self { folder, scene: None, rows: Vec::new() }
    }

    fn write(&self, scene: &Scene, table: &Table, rows: &[(u32, Vec<f64>)]) -> osier_base::Result<()> {
        let path = |ending: &str| format!("stats/{}.{ending}", table.name);
        self.folder.write(&path("csv"), "stats.csv", csv(scene, table, rows).as_bytes())?;
        let said = json(scene, table, rows).to_string();
        self.folder.write(&path("json"), "stats.json", (said + "\n").as_bytes())?;
        if rows.len() > 1 {
            let drawn = plot::draw_table(&scene.title, table, scene.clip, rows);
            self.folder.write(&path("svg"), "stats.svg", drawn.as_bytes())?;
        }
        Ok(())
    }
}

impl Exporter for StatsExporter {
    fn begin(&mut self, scene: &Arc<Scene>) -> osier_base::Result<()> {
        self.rows = vec![Vec::new(); scene.tables.len()];
        self.scene = Some(Arc::clone(scene));
        Ok(())
    }

    fn frame(&mut self, frame: &Frame) -> osier_base::Result<()> {
        for (rows, row) in self.rows.iter_mut().zip(&frame.rows) {
            rows.push((frame.number, row.clone()));
        }
        Ok(())
    }

    fn finish(&mut self) -> osier_base::Result<Summary> {
        if let Some(scene) = &self.scene {
            for (table, rows) in scene.tables.iter().zip(&self.rows).filter(|(_, rows)| !rows.is_empty()) {
                self.write(scene, table, rows)?;
            }
        }
        Ok(Summary::default())
    }
}

/// Summary of a table over all frames: pairs of a column's name and a value in its unit. NaN and infinite values count
/// as absent.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Whole {
    /// Values at the last frame of the columns that count events.
    pub totals: Vec<(String, f64)>,
    /// Values at the last frame of the other columns.
    pub last: Vec<(String, f64)>,
    /// Means of the other columns over the frames in which they have a value.
    pub mean: Vec<(String, f64)>,
    /// Largest values of the other columns.
    pub most: Vec<(String, f64)>,
}

impl Whole {
    /// Summarises rows in the order of frames; everything is empty without rows.
    pub fn of(table: &Table, rows: &[(u32, Vec<f64>)]) -> Self {
        let mut whole = Self::default();
        let Some((_, last)) = rows.last() else { return whole };
        let most = largest(rows.iter().map(|(_, row)| row.as_slice()));
        for (i, ((name, _), value)) in table.columns.iter().zip(last).enumerate() {
            // A total is cumulative: its last value is the result, and a mean over frames has no meaning.
            if table.totals.contains(&i) {
                whole.totals.push((name.clone(), *value));
                continue;
            }
            let known = || rows.iter().filter_map(|(_, row)| row.get(i)).filter(|v| !v.is_nan());
            let sum: f64 = known().fold(0.0, |sum, v| sum + v);
            whole.last.push((name.clone(), *value));
            whole.mean.push((name.clone(), sum / known().count() as f64));
            whole.most.push((name.clone(), most.get(i).copied().unwrap_or(*value)));
        }
        whole
    }
}

/// The shortest decimal that reads back equal; -0 as 0, and an empty text for NaN, an absent value.
fn number(v: f64) -> String {
    if v.is_nan() {
        return String::new();
    }
    // ryu writes whole numbers as `1.0`; the tables have them as `1`.
    let mut buffer = ryu::Buffer::new();
    let text = buffer.format(v + 0.0);
    text.strip_suffix(".0").unwrap_or(text).to_owned()
}

fn csv(scene: &Scene, table: &Table, rows: &[(u32, Vec<f64>)]) -> String {
    let named = |(name, unit): &(String, &str)| if unit.is_empty() { name.clone() } else { format!("{name} [{unit}]") };
    let heads: Vec<String> = table.columns.iter().map(named).collect();
    let mut out = format!("frame,time [s],{}\n", heads.join(","));
    for (frame, row) in rows {
        let _ = write!(out, "{frame},{}", number(scene.clip.seconds(*frame)));
        row.iter().for_each(|v| {
            let _ = write!(out, ",{}", number(*v));
        });
        out.push('\n');
    }
    out
}

/// Seed, scene hash, parameters, summary and warnings of a table.
fn json(scene: &Scene, table: &Table, rows: &[(u32, Vec<f64>)]) -> serde_json::Value {
    let whole = Whole::of(table, rows);
    let most = largest(rows.iter().map(|(_, row)| row.as_slice()));
    let warnings = table.said.iter().cloned().chain(table.warnings(&most));
    let warnings: Vec<_> = warnings.map(|(code, message)| json!({ "code": code, "message": message })).collect();
    json!({
        "scene": scene.hash, "seed": scene.seed.to_string(), "fps": [scene.clip.fps.0, scene.clip.fps.1],
        "frames": rows.len(), "parameters": table.parameters, "totals": named(&whole.totals), "last": named(&whole.last),
        "mean": named(&whole.mean), "most": named(&whole.most), "warnings": warnings,
    })
}

fn named(values: &[(String, f64)]) -> serde_json::Map<String, serde_json::Value> {
    values.iter().map(|(name, v)| (name.clone(), (*v).into())).collect()
}
