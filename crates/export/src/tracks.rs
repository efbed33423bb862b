//! What was computed, as numbers: `drops`, `events`, `leaves` and `rods`, each `tracks/NAME.bin`, records of fixed size one after
//! the other, and `tracks/index.json`, which tells their fields and where each frame begins.

use std::collections::BTreeMap;
use std::sync::Arc;

use serde_json::{Value, json};

use super::format::FormatInfo;
use super::{Exporter, GENERATOR, Summary};
use osier_base::Result;
use osier_base::files::{Folder, Output};
use osier_scene::{DropEvent, DropEventKind, DropNow, DropState, Drops, Frame, LeafNow, Scene};

/// A field of a record: name, type, unit. Types are little-endian: `u4` and `i4` whole numbers, `f4` and `f8` floats.
type Field = (&'static str, &'static str, &'static str);

/// Where nothing is meant.
const NONE: i32 = -1;

const DROPS: [Field; 22] = [
    ("id", "u4", ""),
    ("state", "u4", ""),
    ("leaf", "i4", ""),
    ("tail", "u4", ""),
    ("volume", "f8", "m^3"),
    ("u", "f4", ""),
    ("v", "f4", ""),
    ("side", "f4", ""),
    ("x", "f4", "m"),
    ("y", "f4", "m"),
    ("z", "f4", "m"),
    ("vx", "f4", "m/s"),
    ("vy", "f4", "m/s"),
    ("vz", "f4", "m/s"),
    ("a", "f4", "m"),
    ("height", "f4", "m"),
    ("q", "f4", ""),
    ("s", "f4", ""),
    ("ax", "f4", ""),
    ("ay", "f4", ""),
    ("az", "f4", ""),
    ("thin", "f4", ""),
];

const EVENTS: [Field; 10] = [
    ("t", "f8", "s"),
    ("volume", "f8", "m^3"),
    ("what", "u4", ""),
    ("id", "u4", ""),
    ("other", "i4", ""),
    ("leaf", "i4", ""),
    ("x", "f4", "m"),
    ("y", "f4", "m"),
    ("z", "f4", "m"),
    ("blow", "f4", "N s"),
];

const LEAVES: [Field; 11] = [
    ("leaf", "u4", ""),
    ("drops", "u4", ""),
    ("volume", "f8", "m^3"),
    ("wetness", "f4", ""),
    ("x", "f4", "m"),
    ("y", "f4", "m"),
    ("z", "f4", "m"),
    ("qx", "f4", ""),
    ("qy", "f4", ""),
    ("qz", "f4", ""),
    ("qw", "f4", ""),
];

const RODS: [Field; 9] = [
    ("placement", "u4", ""),
    ("joint", "u4", ""),
    ("x", "f4", "m"),
    ("y", "f4", "m"),
    ("z", "f4", "m"),
    ("qx", "f4", ""),
    ("qy", "f4", ""),
    ("qz", "f4", ""),
    ("qw", "f4", ""),
];

/// Records in the registry.
pub const FORMAT: FormatInfo = FormatInfo {
    word: "tracks",
    about: "binary records of drops, rain events, wet leaves and joints",
    asset_folder: None,
    endings: &[],
    pictures_beside: false,
    memory_percent: 0,
    // Joints alone: the number of drops is not known before they fall.
    estimate: |input| input.per_asset(|a| input.frames * a.joints * 36),
    open: |job| vec![Box::new(Tracks::new(job.folder.clone()))],
};

/// Exporter of drops and joints.
pub struct Tracks {
    folder: Folder,
    scene: Option<Arc<Scene>>,
    /// In the order of their names.
    files: BTreeMap<&'static str, File>,
}

/// A file of records.
struct File {
    fields: &'static [Field],
    /// None where a run that was broken off had finished it.
    out: Option<Output>,
    /// Records so far.
    records: u64,
    /// Frame number, first record, records.
    frames: Vec<(u32, u64, u64)>,
}

impl Tracks {
    /// Writes into `folder`.
    pub fn new(folder: Folder) -> Self {
        Self { folder, scene: None, files: BTreeMap::new() }
    }

    fn put(&mut self, name: &'static str, fields: &'static [Field], frame: u32, bytes: &[u8]) -> Result<()> {
        if !self.files.contains_key(name) {
            let out = self.folder.create(&format!("tracks/{name}.bin"), "tracks", None)?;
            self.files.insert(name, File { fields, out, records: 0, frames: Vec::new() });
        }
        let Some(file) = self.files.get_mut(name) else { return Ok(()) };
        let count = bytes.len() as u64 / size(fields);
        file.frames.push((frame, file.records, count));
        file.records += count;
        file.out.as_mut().map_or(Ok(()), |out| out.put(bytes))
    }
}

/// Bytes of a record.
fn size(fields: &[Field]) -> u64 {
    fields.iter().map(|(_, kind, _)| if *kind == "f8" { 8 } else { 4 }).sum()
}

/// A number of something that may be missing.
fn or_none(number: Option<u32>) -> i32 {
    number.and_then(|n| i32::try_from(n).ok()).unwrap_or(NONE)
}

/// Place of a word in a list.
fn place<T: PartialEq>(all: &[(T, &str)], one: &T) -> u32 {
    all.iter().position(|(x, _)| x == one).and_then(|k| u32::try_from(k).ok()).unwrap_or(u32::MAX)
}

fn drop_record(d: &DropNow, out: &mut Vec<u8>) {
    let floats = [d.uv[0], d.uv[1], d.side, d.place.x, d.place.y, d.place.z]
        .into_iter()
        .chain(d.velocity.to_array())
        .chain([d.a, d.height, d.q, d.s])
        .chain(d.axis.to_array())
        .chain([d.thin]);
    out.extend(d.id.to_le_bytes());
    out.extend(place(&DropState::ALL, &d.state).to_le_bytes());
    out.extend(or_none(d.leaf).to_le_bytes());
    out.extend(d.tail.to_le_bytes());
    out.extend(d.volume.to_le_bytes());
    floats.for_each(|f| out.extend(f.to_le_bytes()));
}

fn event_record(e: &DropEvent, out: &mut Vec<u8>) {
    out.extend(e.t.to_le_bytes());
    out.extend(e.volume.to_le_bytes());
    out.extend(place(&DropEventKind::ALL, &e.what).to_le_bytes());
    out.extend(e.id.to_le_bytes());
    out.extend(or_none(e.other).to_le_bytes());
    out.extend(or_none(e.leaf).to_le_bytes());
    e.place.to_array().into_iter().chain([e.blow]).for_each(|f| out.extend(f.to_le_bytes()));
}

fn leaf_record(number: u32, leaf: &LeafNow, out: &mut Vec<u8>) {
    out.extend(number.to_le_bytes());
    out.extend(leaf.drops.to_le_bytes());
    out.extend(leaf.volume.to_le_bytes());
    let floats = [leaf.wetness].into_iter().chain(leaf.place.to_array()).chain(leaf.turn.to_array());
    floats.for_each(|f| out.extend(f.to_le_bytes()));
}

/// Joints of all placements whose assets have some, in the world; none where nothing bends.
fn rods(scene: &Scene, frame: &Frame) -> Option<Vec<u8>> {
    let mut out = Vec::new();
    let mut any = false;
    for (k, placement) in (0_u32..).zip(&scene.placements) {
        let both = scene.assets.get(placement.asset).zip(frame.shown(placement));
        let Some((skeleton, state)) = both.and_then(|(asset, state)| Some((asset.skeleton.as_ref()?, state))) else {
            continue;
        };
        any = true;
        let rest = skeleton.rest_pose();
        let pose = if state.pose.len() == rest.len() { &state.pose } else { &rest };
        for (j, joint) in (0_u32..).zip(skeleton.asset_from_joint(pose)) {
            let m = placement.transform.then_inner(&joint);
            out.extend(k.to_le_bytes());
            out.extend(j.to_le_bytes());
            m.t.to_array().into_iter().chain(m.r.to_array()).for_each(|f| out.extend(f.to_le_bytes()));
        }
    }
    any.then_some(out)
}

fn drops(drops: &Drops) -> [Vec<u8>; 3] {
    let (mut now, mut events, mut leaves) = (Vec::new(), Vec::new(), Vec::new());
    drops.now.iter().for_each(|d| drop_record(d, &mut now));
    drops.events.iter().for_each(|e| event_record(e, &mut events));
    (0..).zip(&drops.leaves).for_each(|(number, leaf)| leaf_record(number, leaf, &mut leaves));
    [now, events, leaves]
}

/// What the files hold, and where.
fn index(scene: &Scene, files: &BTreeMap<&'static str, File>) -> Value {
    let words = |all: Vec<&str>| Value::from(all);
    let file = |name: &str, f: &File| {
        let mut offset = 0;
        let field = |(name, kind, unit): &Field| {
            let at = offset;
            offset += if *kind == "f8" { 8 } else { 4 };
            json!({ "name": name, "type": kind, "offset": at, "unit": unit })
        };
        let fields: Vec<Value> = f.fields.iter().map(field).collect();
        let frame = |(number, first, count): &(u32, u64, u64)| json!([number, first, count]);
        json!({
            "file": format!("{name}.bin"), "record_bytes": size(f.fields), "records": f.records, "fields": fields,
            "frames": f.frames.iter().map(frame).collect::<Vec<_>>(),
        })
    };
    let skeletons = scene.placements.iter().enumerate().filter_map(|(k, p)| {
        let skeleton = scene.assets.get(p.asset)?.skeleton.as_ref()?;
        let parents: Vec<i32> = skeleton.joints.iter().map(|j| or_none(j.parent)).collect();
        Some(json!({ "placement": k, "name": p.name, "parents": parents }))
    });
    json!({
        "generator": GENERATOR, "scene": scene.hash, "seed": scene.seed.to_string(),
        "fps": [scene.clip.fps.0, scene.clip.fps.1], "start": scene.clip.start,
        "states": words(DropState::ALL.iter().map(|s| s.1).collect()),
        "events": words(DropEventKind::ALL.iter().map(|s| s.1).collect()),
        "skeletons": skeletons.collect::<Vec<_>>(),
        "files": files.iter().map(|(name, f)| file(name, f)).collect::<Vec<_>>(),
    })
}

impl Exporter for Tracks {
    fn begin(&mut self, scene: &Arc<Scene>) -> Result<()> {
        self.scene = Some(Arc::clone(scene));
        Ok(())
    }

    fn wants_phases(&self, _: u32) -> bool {
        true
    }

    fn frame(&mut self, frame: &Frame) -> Result<()> {
        let Some(scene) = self.scene.clone() else { return Ok(()) };
        if let Some(all) = &frame.drops {
            let [now, events, leaves] = drops(all);
            self.put("drops", &DROPS, frame.number, &now)?;
            self.put("events", &EVENTS, frame.number, &events)?;
            self.put("leaves", &LEAVES, frame.number, &leaves)?;
        }
        if let Some(bytes) = rods(&scene, frame) {
            self.put("rods", &RODS, frame.number, &bytes)?;
        }
        Ok(())
    }

    fn finish(&mut self) -> Result<Summary> {
        let Some(scene) = &self.scene else { return Ok(Summary::default()) };
        if !self.files.is_empty() {
            let text = format!("{}\n", index(scene, &self.files));
            self.folder.write("tracks/index.json", "tracks.index", text.as_bytes())?;
        }
        for file in self.files.values_mut() {
            file.out.take().map_or(Ok(()), Output::commit)?;
        }
        self.files.clear();
        Ok(Summary::default())
    }
}
