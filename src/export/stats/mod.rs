//! What is measured, for spreadsheets and people: `stats/<table>.csv`, a row per frame, `stats/<table>.json` with what is
//! said once, and `stats/<table>.svg`, the plots.

mod plot;

use std::fmt::Write as _;
use std::sync::Arc;

use super::{Exporter, Summary};
use crate::fence::Folder;
use crate::scene::{Frame, Scene, Table};

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

    fn write(&self, scene: &Scene, table: &Table, rows: &[(u32, Vec<f64>)]) -> crate::Result<()> {
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
    fn begin(&mut self, scene: &Arc<Scene>) -> crate::Result<()> {
        self.rows = vec![Vec::new(); scene.tables.len()];
        self.scene = Some(Arc::clone(scene));
        Ok(())
    }

    fn frame(&mut self, frame: &Frame) -> crate::Result<()> {
        for (rows, row) in self.rows.iter_mut().zip(&frame.rows) {
            rows.push((frame.number, row.clone()));
        }
        Ok(())
    }

    fn finish(&mut self) -> crate::Result<Summary> {
        if let Some(scene) = &self.scene {
            for (table, rows) in scene.tables.iter().zip(&self.rows).filter(|(_, rows)| !rows.is_empty()) {
                self.write(scene, table, rows)?;
            }
        }
        Ok(Summary::default())
    }
}

/// A number as short as it can be said, without a zero's sign.
fn number(v: f64) -> String {
    let mut buffer = ryu::Buffer::new();
    let text = buffer.format(v + 0.0);
    text.strip_suffix(".0").unwrap_or(text).to_owned()
}

fn csv(scene: &Scene, table: &Table, rows: &[(u32, Vec<f64>)]) -> String {
    let named =
        |(name, unit): &(&str, &str)| if unit.is_empty() { (*name).to_owned() } else { format!("{name} [{unit}]") };
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

/// Seed, hash, what the table says of itself, and the last row.
fn json(scene: &Scene, table: &Table, rows: &[(u32, Vec<f64>)]) -> serde_json::Value {
    let last: serde_json::Map<String, serde_json::Value> = rows.last().map_or_else(Default::default, |(_, row)| {
        table.columns.iter().zip(row).map(|((name, _), v)| ((*name).to_owned(), (*v).into())).collect()
    });
    serde_json::json!({
        "scene": scene.hash, "seed": scene.seed.to_string(), "frames": rows.len(), "about": table.about, "last": last,
    })
}
