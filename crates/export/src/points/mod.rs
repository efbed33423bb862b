//! Single elements of a simulation as points with attributes: `points/TABLE_####.csv`, one file for each table and
//! frame, for Blender's node Import CSV and for any other program that reads tables. Metres and seconds. The tables are
//! those of the frames, and `joints`, which exists for all skeletons.

use std::sync::Arc;

mod csv;
pub(crate) mod options;

pub use options::PointsOptions;

use super::estimate::EstimateInput;
use super::format::{FormatInfo, TextureUse};
use super::world_joints::{WorldJoint, world_joints};
use super::{Exporter, Summary};
use csv::csv_text;
use osier_base::Result;
use osier_base::files::Folder;
use osier_scene::{Frame, InstancerMotion, RecordColumn, RecordTable, Scene};

/// Name of the table of joints in `[output.points] tables`; all other tables come from motions.
const JOINTS: &str = "joints";
/// `parent` of a root joint in the table; other joints have an index there.
const NO_PARENT: i32 = -1;
/// Bytes of the row of a joint; measured.
const JOINT_ROW: u64 = 88;
/// Bytes of the row of an instance that moves freely; measured.
const INSTANCE_ROW: u64 = 105;

/// Registry entry of tables of points as CSV.
pub const FORMAT: FormatInfo = FormatInfo {
    word: "points",
    about: "drops, catkins and joints as points with attributes: a CSV per table and frame",
    folder: "points",
    names_assets: false,
    notes_missing_files: true,
    endings: &[],
    pictures_beside: false,
    textures: TextureUse::Unused,
    memory_percent: 0,
    estimate,
    open: |job| vec![Box::new(PointsExporter::new(job.folder.clone(), job.options.points.clone()))],
};

/// Estimate from rows of joints and of instances that are tracked one by one. The number of raindrops is unknown before the rain.
fn estimate(input: &EstimateInput) -> u64 {
    let options = &input.options.points;
    let joints = if options.writes(JOINTS) { input.per_asset(|a| a.joints * a.placements) * JOINT_ROW } else { 0 };
    let tracked = input.scene.assets.iter().filter(|a| options.writes(&a.id)).flat_map(|a| &a.instancers);
    let instances: u64 =
        tracked.filter(|i| i.tracked && i.motion == InstancerMotion::Free).map(|i| i.len() as u64).sum();
    input.frames * (joints + instances * INSTANCE_ROW)
}

/// Writes the tables that the options name, with the joints as one of them, as `points/<table>_<frame>.csv`.
#[derive(Debug)]
pub struct PointsExporter {
    folder: Folder,
    options: PointsOptions,
    scene: Option<Arc<Scene>>,
}

impl PointsExporter {
    /// An exporter that writes into `points/` below `folder`.
    pub fn new(folder: Folder, options: PointsOptions) -> Self {
        Self { folder, options, scene: None }
    }

    /// Writes the file of a table at a frame, unless an interrupted bake has left it complete.
    fn write_table(&self, scene: &Scene, table: &RecordTable, frame: u32) -> Result<()> {
        let path = format!("points/{}_{}.csv", table.name, scene.clip.tag(frame));
        let Some(mut out) = self.folder.create(&path, "points", Some(frame))? else { return Ok(()) };
        out.put(csv_text(table, self.options.up)?.as_bytes())?;
        out.commit()
    }
}

/// The joints of all placements as points. `id` is unique over all placements, `joint` within the skeleton.
fn joint_table(joints: &[WorldJoint]) -> RecordTable {
    let numbered: Vec<(u32, &WorldJoint)> = (0..).zip(joints).collect();
    let f32s =
        |name, unit, value: fn(&WorldJoint) -> f32| RecordColumn::f32(name, unit, &numbered, move |(_, j)| value(j));
    let columns = vec![
        RecordColumn::u32("id", "", &numbered, |(id, _)| *id),
        RecordColumn::u32("plant", "", &numbered, |(_, j)| j.placement),
        RecordColumn::u32("joint", "", &numbered, |(_, j)| j.joint),
        RecordColumn::i32("parent", "", &numbered, |(_, j)| j.parent.map_or(NO_PARENT, u32::cast_signed)),
        f32s("x", "m", |j| j.world.t.x),
        f32s("y", "m", |j| j.world.t.y),
        f32s("z", "m", |j| j.world.t.z),
        f32s("qw", "", |j| j.world.r.w),
        f32s("qx", "", |j| j.world.r.x),
        f32s("qy", "", |j| j.world.r.y),
        f32s("qz", "", |j| j.world.r.z),
        f32s("radius", "m", |j| j.radius),
    ];
    RecordTable { name: JOINTS, columns }
}

impl Exporter for PointsExporter {
    fn begin(&mut self, scene: &Arc<Scene>) -> Result<()> {
        self.scene = Some(Arc::clone(scene));
        Ok(())
    }

    fn wants_phases(&self, _: u32) -> bool {
        self.options.writes(JOINTS)
    }

    fn frame(&mut self, frame: &Frame) -> Result<()> {
        let Some(scene) = self.scene.clone() else { return Ok(()) };
        let wanted = frame.point_tables.iter().filter(|t| self.options.writes(t.name));
        wanted.into_iter().try_for_each(|table| self.write_table(&scene, table, frame.number))?;
        // No motion writes the table of joints: it follows from the poses of all placements.
        if !self.options.writes(JOINTS) {
            return Ok(());
        }
        let joints = world_joints(&scene, frame).map(|joints| joint_table(&joints));
        joints.map_or(Ok(()), |table| self.write_table(&scene, &table, frame.number))
    }

    fn finish(&mut self) -> Result<Summary> {
        Ok(Summary::default())
    }
}
