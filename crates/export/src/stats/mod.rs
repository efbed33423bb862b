//! What is measured, for spreadsheets and people: `stats/<table>.csv`, a row per frame, `stats/<table>.json` with what is
//! said once, and `stats/<table>.svg`, the plots.

mod plot;
mod sweep;

pub use sweep::{Mean, Run, Sweep};

use std::fmt::Write as _;
use std::sync::Arc;

use serde_json::json;

use super::format::FormatInfo;
use super::{Exporter, Summary};
use osier_base::files::Folder;
use osier_scene::{Frame, Scene, Table, largest};

/// Tables of statistics in the registry.
pub const FORMAT: FormatInfo = FormatInfo {
    word: "csv",
    about: "statistics of flights and rain: tables, JSON and plots",
    asset_folder: None,
    endings: &[],
    pictures_beside: false,
    memory_percent: 0,
    estimate: |input| input.per_asset(|_| input.frames * 200),
    open: |job| vec![Box::new(Stats::new(job.folder.clone()))],
};

/// Exporter of a scene's tables.
#[derive(Debug)]
pub struct Stats {
    folder: Folder,
    scene: Option<Arc<Scene>>,
    /// By table: frame number and row.
    rows: Vec<Vec<(u32, Vec<f64>)>>,
}

impl Stats {
    /// Writes into `folder`.
    pub fn new(folder: Folder) -> Self {
        Self { folder, scene: None, rows: Vec::new() }
    }

    fn write(&self, scene: &Scene, table: &Table, rows: &[(u32, Vec<f64>)]) -> osier_base::Result<()> {
        let path = |ending: &str| format!("stats/{}.{ending}", table.name);
        self.folder.write(&path("csv"), "stats.csv", csv(scene, table, rows).as_bytes())?;
        let said = json(scene, table, rows).to_string();
        self.folder.write(&path("json"), "stats.json", (said + "\n").as_bytes())?;
        if rows.len() > 1 {
            let drawn = plot::panels(&scene.title, table, scene.clip, rows);
            self.folder.write(&path("svg"), "stats.svg", drawn.as_bytes())?;
        }
        Ok(())
    }
}

impl Exporter for Stats {
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

/// A table in a few numbers, by column.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Whole {
    /// All that happened, of the columns that count it.
    pub totals: Vec<(String, f64)>,
    /// What is so at the last frame, of all other columns.
    pub last: Vec<(String, f64)>,
    /// Their means over the frames.
    pub mean: Vec<(String, f64)>,
    /// Their largest values.
    pub most: Vec<(String, f64)>,
}

impl Whole {
    /// Of all rows, in the order of frames.
    pub fn of(table: &Table, rows: &[(u32, Vec<f64>)]) -> Self {
        let mut whole = Self::default();
        let Some((_, last)) = rows.last() else { return whole };
        let most = largest(rows.iter().map(|(_, row)| row.as_slice()));
        for (i, ((name, _), value)) in table.columns.iter().zip(last).enumerate() {
            if table.totals.contains(&i) {
                whole.totals.push((name.clone(), *value));
                continue;
            }
            let sum: f64 = rows.iter().filter_map(|(_, row)| row.get(i)).fold(0.0, |sum, v| sum + v);
            whole.last.push((name.clone(), *value));
            whole.mean.push((name.clone(), sum / rows.len() as f64));
            whole.most.push((name.clone(), most.get(i).copied().unwrap_or(*value)));
        }
        whole
    }
}

/// A number as short as it can be said, without a zero's sign.
fn number(v: f64) -> String {
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

/// Seed, hash, what ruled the run, what it came to, and what was warned of.
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
