//! Simulation results as numbers: each record table of the frames as `tracks/NAME.bin`, records of fixed size one after the
//! other, the joints of all skeletons as `tracks/rods.bin`, and `tracks/index.json`, which describes the columns of each file
//! and where each frame begins. The tables' names and columns are those that the simulations give them.

use std::collections::BTreeMap;
use std::sync::Arc;

use serde_json::{Value, json};

use super::format::{FormatInfo, TextureUse};
use super::world_joints::{WorldJoint, world_joints};
use super::{Exporter, GENERATOR, Summary};
use osier_base::files::{Folder, Output};
use osier_base::{Error, Result};
use osier_scene::{Frame, RecordColumn, RecordTable, Scene};

/// Parent of a root joint in `index.json`.
const NO_PARENT: i32 = -1;

/// Registry entry of binary records, of which the size is known only for joints.
pub const FORMAT: FormatInfo = FormatInfo {
    word: "tracks",
    about: "binary records of drops, rain events, wet leaves and joints",
    folder: "tracks",
    names_assets: false,
    notes_missing_files: true,
    endings: &[],
    pictures_beside: false,
    textures: TextureUse::Unused,
    memory_percent: 0,
    // Only joints are counted: the number of records that simulations write is unknown before they run.
    estimate: |input| input.per_asset(|a| input.frames * a.joints * a.placements * 36),
    open: |job| vec![Box::new(TracksExporter::new(job.folder.clone()))],
};

/// Writes the record tables of the frames as `tracks/<name>.bin` and the joints of all placements as `tracks/rods.bin`.
pub struct TracksExporter {
    folder: Folder,
    scene: Option<Arc<Scene>>,
    files: BTreeMap<&'static str, RecordFile>,
}

/// Entry of a column in `index.json`.
#[derive(Debug, Clone, PartialEq, Eq)]
struct ColumnInfo {
    name: &'static str,
    /// `u4`, `i4`, `f4` or `f8`, little-endian.
    type_code: &'static str,
    unit: &'static str,
    bytes: usize,
}

#[derive(Debug, Clone, Copy)]
struct FrameRecords {
    frame: u32,
    /// Index of its first record in the file.
    first: u64,
    count: u64,
}

/// A file of records of one table, and where each frame begins in it.
struct RecordFile {
    columns: Vec<ColumnInfo>,
    /// None if an interrupted bake has left the file complete.
    out: Option<Output>,
    /// Records written so far, of all frames: the index of the next one.
    records: u64,
    frames: Vec<FrameRecords>,
}

impl TracksExporter {
    /// An exporter that writes below `folder`; the file of a table is created with its first records.
    pub fn new(folder: Folder) -> Self {
        Self { folder, scene: None, files: BTreeMap::new() }
    }

    /// Appends a frame's records to the file of their table; X001 if the columns differ from those of earlier frames.
    fn append(&mut self, table: &RecordTable, frame: u32) -> Result<()> {
        let name = table.name;
        let columns: Vec<ColumnInfo> = table.columns.iter().map(ColumnInfo::of).collect();
        if !self.files.contains_key(name) {
            let out = self.folder.create(&format!("tracks/{name}.bin"), "tracks", None)?;
            self.files.insert(name, RecordFile { columns: columns.clone(), out, records: 0, frames: Vec::new() });
        }
        let Some(file) = self.files.get_mut(name) else { return Ok(()) };
        // Records have a fixed size and the index describes them once for the whole file: columns must not change within it.
        if file.columns != columns {
            let message = format!("record table {name}, frame {frame}: columns differ from those of the frames before");
            return Err(Error::export("X001", message));
        }
        let count = table.len() as u64;
        file.frames.push(FrameRecords { frame, first: file.records, count });
        file.records += count;
        file.out.as_mut().map_or(Ok(()), |out| out.put(&table.to_le_bytes()))
    }
}

impl ColumnInfo {
    fn of(column: &RecordColumn) -> Self {
        let values = &column.values;
        Self { name: column.name, type_code: values.type_code(), unit: column.unit, bytes: values.value_bytes() }
    }
}

/// World transforms of the joints of all placements; none if no asset has a skeleton.
fn joint_table(scene: &Scene, frame: &Frame) -> Option<RecordTable> {
    let joints = world_joints(scene, frame)?;
    let f32s = |name, unit, value: fn(&WorldJoint) -> f32| RecordColumn::f32(name, unit, &joints, value);
    let columns = vec![
        RecordColumn::u32("placement", "", &joints, |j| j.placement),
        RecordColumn::u32("joint", "", &joints, |j| j.joint),
        f32s("x", "m", |j| j.world.t.x),
        f32s("y", "m", |j| j.world.t.y),
        f32s("z", "m", |j| j.world.t.z),
        f32s("qx", "", |j| j.world.r.x),
        f32s("qy", "", |j| j.world.r.y),
        f32s("qz", "", |j| j.world.r.z),
        f32s("qw", "", |j| j.world.r.w),
    ];
    Some(RecordTable { name: "rods", columns })
}

/// The index: columns of each file, and the range of records of each frame.
fn index_json(scene: &Scene, files: &BTreeMap<&'static str, RecordFile>) -> Value {
    let file = |name: &str, f: &RecordFile| {
        let mut offset = 0;
        let column = |c: &ColumnInfo| {
            // Columns follow each other without padding: the offset is the sum of the sizes before.
            let at = offset;
            offset += c.bytes;
            json!({ "name": c.name, "type": c.type_code, "offset": at, "unit": c.unit })
        };
        let fields: Vec<Value> = f.columns.iter().map(column).collect();
        json!({
            "file": format!("{name}.bin"), "record_bytes": offset, "records": f.records, "fields": fields,
            "frames": f.frames.iter().map(|r| json!([r.frame, r.first, r.count])).collect::<Vec<_>>(),
        })
    };
    let skeletons = scene.placements.iter().enumerate().filter_map(|(k, p)| {
        let skeleton = scene.assets.get(p.asset)?.skeleton.as_ref()?;
        let parent = |joint: Option<u32>| joint.map_or(NO_PARENT, u32::cast_signed);
        let parents: Vec<i32> = skeleton.joints.iter().map(|j| parent(j.parent)).collect();
        Some(json!({ "placement": k, "name": p.name, "parents": parents }))
    });
    let mut index = json!({
        "generator": GENERATOR, "scene": scene.hash, "seed": scene.seed.to_string(),
        "fps": [scene.clip.fps.0, scene.clip.fps.1], "start": scene.clip.start,
        "skeletons": skeletons.collect::<Vec<_>>(),
        "files": files.iter().map(|(name, f)| file(name, f)).collect::<Vec<_>>(),
    });
    for list in &scene.enum_labels {
        index[list.name] = json!(list.words);
    }
    index
}

impl Exporter for TracksExporter {
    fn begin(&mut self, scene: &Arc<Scene>) -> Result<()> {
        self.scene = Some(Arc::clone(scene));
        Ok(())
    }

    fn wants_phases(&self, _: u32) -> bool {
        true
    }

    fn frame(&mut self, frame: &Frame) -> Result<()> {
        let Some(scene) = self.scene.clone() else { return Ok(()) };
        frame.records.iter().try_for_each(|table| self.append(table, frame.number))?;
        joint_table(&scene, frame).map_or(Ok(()), |table| self.append(&table, frame.number))
    }

    fn finish(&mut self) -> Result<Summary> {
        let Some(scene) = &self.scene else { return Ok(Summary::default()) };
        if !self.files.is_empty() {
            let text = format!("{}\n", index_json(scene, &self.files));
            self.folder.write("tracks/index.json", "tracks.index", text.as_bytes())?;
        }
        for file in self.files.values_mut() {
            file.out.take().map_or(Ok(()), Output::commit)?;
        }
        self.files.clear();
        Ok(Summary::default())
    }
}
