//! Motions of the assets of a scene, frame by frame.
//!
//! ```text
//! sway            recorded bends of elements ┐
//! rod             recorded poses             │
//! rod_plant       steps from frame to frame  ├─ AssetMotion::frame ─► AssetFrame ┐
//! flight          steps from frame to frame  │                                   ├─ evaluate_frame ─► Frame ─► exporters
//! rain            recorded drops and plants  ├─ row, fields, maps, records, ─────┘
//! attractor_morph coefficients at a time     │  point_tables, volumes
//! growth          births of nodes            │
//! years           recorded years of a tree   │
//! season          calendars of leaves        ┘
//! ```
//!
//! A new motion is a type that implements [`AssetMotion`] and is given to the scene together with its asset.

pub mod attractor_morph;
pub mod flight;
pub mod growth;
pub mod rain;
pub mod rod;
pub mod rod_plant;
pub mod season;
pub mod sway;
pub mod years;

use std::collections::BTreeSet;
use std::fmt::Debug;
use std::sync::Arc;

use glam::Vec3;

use osier_base::Result;
use osier_base::par::par_map;
use osier_scene::plant::Plant;
use osier_scene::{Asset, AssetFrame, Frame, MapFrame, RecordTable, Scene, VolumeFrame};

/// A point on the axis of a plant, at rest, that a motion can carry.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointOnAxis {
    /// Position in plant space, m.
    pub position: Vec3,
    /// Index into the plant's axes.
    pub axis: u32,
    /// Arc length of the point on its axis, m.
    pub arc_length: f32,
}

/// Points of a plant that its motion carries along.
pub trait CarriedPoints: Debug + Send + Sync {
    /// Positions of the points at a time, plant space, m, in the order in which they were bound.
    /// # Errors
    /// As [`AssetMotion::frame`].
    fn positions(&self, time: FrameTime) -> Result<Vec<Vec3>>;
}

/// A time of the clip at which an asset is evaluated.
#[derive(Debug, Clone, Copy)]
pub struct FrameTime {
    /// Time since the first frame, s.
    pub seconds: f64,
    /// Time between two frames, s.
    pub step: f64,
}

impl FrameTime {
    /// The time of frame `number` of a scene's clip.
    pub fn of_frame(scene: &Scene, number: u32) -> Self {
        Self { seconds: scene.clip.seconds(number), step: scene.clip.fps().recip() }
    }

    /// Index of the nearest frame, counted from the first of the clip; 0 for times before it.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "frames of a clip")]
    pub fn index(self) -> u64 {
        (self.seconds / self.step).round().max(0.0) as u64
    }
}

/// A row of one of the scene's tables.
#[derive(Debug, Clone, PartialEq)]
pub struct TableRow {
    /// Name of the table that the row belongs to, as declared in the scene.
    pub table: &'static str,
    /// One value per column, in the order of the table's columns.
    pub values: Vec<f64>,
}

/// Moves one asset of a scene. Frames may be requested in any order and from several threads; motions that step from frame to
/// frame need one step for each frame in ascending order. `frame` numbers count from the first frame of the clip.
pub trait AssetMotion: Debug + Send + Sync {
    /// State of `asset` at a time, in asset space; parts that it leaves empty stay at rest.
    /// # Errors
    /// `Simulation` where a solver diverges, `Cancelled`.
    fn frame(&self, asset: &Asset, time: FrameTime) -> Result<AssetFrame>;

    /// Whether the motion is growth, each frame of which is evaluated independently; an estimate evaluates only some of its
    /// frames.
    fn is_growth(&self) -> bool {
        false
    }

    /// Whether the motion holds the record of all years of a tree, whose memory estimates count.
    fn keeps_year_record(&self) -> bool {
        false
    }

    /// Row of the motion's table at a frame; `None` if it keeps no table.
    /// # Errors
    /// As [`AssetMotion::frame`].
    fn row(&self, _frame: u64) -> Result<Option<TableRow>> {
        Ok(None)
    }

    /// Texels of the scene's fields that this motion fills, such as deposition maps, in the order of their declarations.
    /// # Errors
    /// As [`AssetMotion::frame`].
    fn fields(&self, _frame: u64) -> Result<Vec<Vec<f32>>> {
        Ok(Vec::new())
    }

    /// Values of the scene's map sequences, one for each; empty if the motion fills none.
    fn maps(&self, _frame: u64) -> Vec<MapFrame> {
        Vec::new()
    }

    /// Record tables of single elements that the motion simulates, such as drops; each motion chooses the names of its tables.
    fn records(&self, _frame: u64) -> Vec<RecordTable> {
        Vec::new()
    }

    /// Single elements that the motion simulates as points with attributes: id, position and the values with which a node
    /// system can show them. A table has the same name and columns in every frame, with or without rows.
    /// # Errors
    /// As [`AssetMotion::frame`].
    fn point_tables(&self, _frame: u64) -> Result<Vec<RecordTable>> {
        Ok(Vec::new())
    }

    /// Values of the scene's volumes that this motion fills, in their order.
    /// # Errors
    /// As [`AssetMotion::frame`].
    fn volumes(&self, _frame: u64) -> Result<Vec<VolumeFrame>> {
        Ok(Vec::new())
    }

    /// Binds points of the asset's plant to this motion; `None` if the motion carries none. Times before the clip are those of its
    /// first frame, unless the motion repeats.
    fn bind_points(self: Arc<Self>, _plant: &Plant, _points: &[PointOnAxis]) -> Option<Arc<dyn CarriedPoints>> {
        None
    }

    /// Whether copies of the asset may show it at different phases of the clip.
    fn supports_phases(&self) -> bool {
        false
    }

    /// Whether the motion repeats after the loop of the scene's clip.
    fn is_loop(&self) -> bool {
        false
    }
}

/// Evaluates all motions at frame `number`. `motions` is parallel to the scene's assets. `phased`: also evaluates the states of
/// placements whose phase differs from 0.
/// # Errors
/// The first error of a motion, in the order of the assets.
pub fn evaluate_frame(
    scene: &Scene,
    motions: &[Option<Arc<dyn AssetMotion>>],
    number: u32,
    phased: bool,
) -> Result<Frame> {
    let time = FrameTime::of_frame(scene, number);
    let pairs: Vec<(&Asset, Option<&Arc<dyn AssetMotion>>)> =
        scene.assets.iter().zip(motions.iter().map(Option::as_ref).chain(std::iter::repeat(None))).collect();
    let assets =
        par_map(&pairs, |(asset, motion)| motion.map_or_else(|| Ok(AssetFrame::default()), |m| m.frame(asset, time)));
    let assets = assets.into_iter().collect::<Result<Vec<_>>>()?;
    // Placements with one asset and one phase share a state: each pair is evaluated once.
    let phases: BTreeSet<(usize, u32)> =
        scene.placements.iter().filter(|p| phased && p.phase > 0).map(|p| (p.asset, p.phase)).collect();
    let phases: Vec<(usize, u32)> = phases.into_iter().collect();
    let states = par_map(&phases, |(i, phase)| {
        let later = FrameTime { seconds: time.seconds + f64::from(*phase) / scene.clip.fps(), ..time };
        let (asset, motion) = pairs.get(*i)?;
        motion.map(|m| m.frame(asset, later))
    });
    let states = states.into_iter().map(Option::transpose).collect::<Result<Vec<_>>>()?;
    let shifted = phases.into_iter().zip(states).filter_map(|(key, state)| Some((key, state?))).collect();
    let index = time.index();
    let rows = table_rows(scene, motions, number)?;
    let moving = || motions.iter().flatten();
    let fields = moving().map(|m| m.fields(index)).collect::<Result<Vec<_>>>()?.concat();
    let maps = moving().map(|m| m.maps(index)).find(|maps| !maps.is_empty()).unwrap_or_default();
    let records = moving().flat_map(|m| m.records(index)).collect();
    let volumes = moving().map(|m| m.volumes(index)).collect::<Result<Vec<_>>>()?.concat();
    let point_tables = moving().map(|m| m.point_tables(index)).collect::<Result<Vec<_>>>()?.concat();
    Ok(Frame { number, assets, shifted, rows, fields, maps, records, point_tables, volumes, ..Frame::default() })
}

/// The rows of all tables of a scene at a frame, in the order of the tables.
/// # Errors
/// The first error of a motion, in the order of the assets.
pub fn table_rows(scene: &Scene, motions: &[Option<Arc<dyn AssetMotion>>], number: u32) -> Result<Vec<Vec<f64>>> {
    let index = FrameTime::of_frame(scene, number).index();
    let rows = motions.iter().flatten().map(|m| m.row(index)).collect::<Result<Vec<_>>>()?;
    let mut rows: Vec<TableRow> = rows.into_iter().flatten().collect();
    // The stable sort keeps the order of the assets among rows of one table.
    rows.sort_by_key(|row| scene.tables.iter().position(|table| table.name == row.table));
    Ok(rows.into_iter().map(|row| row.values).collect())
}
