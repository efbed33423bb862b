//! Frames: the state of everything that changes over the clip.

use std::collections::BTreeMap;

use glam::Vec3;

use super::{InstanceState, MapFrame, Mesh, Placement, PointsFrame, RecordTable, Trs, VolumeFrame};

/// One frame of the whole scene; `assets` runs parallel to [`crate::Scene::assets`].
#[derive(Debug, Clone, Default)]
pub struct Frame {
    /// Frame number as in file names, from [`crate::Clip::start`] to [`crate::Clip::end`].
    pub number: u32,
    /// State of each asset, parallel to [`crate::Scene::assets`].
    pub assets: Vec<AssetFrame>,
    /// A row for each table of the scene, with one number per column.
    pub rows: Vec<Vec<f64>>,
    /// Values of each field of the scene, `width * height` of them, rows from the top.
    pub fields: Vec<Vec<f32>>,
    /// Velocities of the air, m/s, one list per grid of the scene. A list is empty at frames that do not sample its grid; all
    /// lists may be missing.
    pub air: Vec<Vec<Vec3>>,
    /// Values of each volume of the scene; empty if there are none.
    pub volumes: Vec<VolumeFrame>,
    /// Maps of each map sequence of the scene, or empty.
    pub maps: Vec<MapFrame>,
    /// Tables of single elements such as drops, one row each, in the order of the motions that record them.
    pub records: Vec<RecordTable>,
    /// Tables of single elements for node systems, which read a row as a point with attributes. A table of the same name has the
    /// same columns in all frames.
    pub point_tables: Vec<RecordTable>,
    /// States of assets at other times of the clip, by asset and phase; only those that were requested.
    pub shifted: BTreeMap<(usize, u32), AssetFrame>,
}

impl Frame {
    /// State of a placement's asset at the placement's phase, or at phase 0 if the frame holds no state for that phase; `None` if
    /// it holds neither.
    pub fn shown(&self, placement: &Placement) -> Option<&AssetFrame> {
        let shifted = self.shifted.get(&(placement.asset, placement.phase)).filter(|_| placement.phase > 0);
        shifted.or_else(|| self.assets.get(placement.asset))
    }
}

/// One frame of one asset. Lists run parallel to the asset's; an empty list means that nothing in it changes.
#[derive(Debug, Clone, Default)]
pub struct AssetFrame {
    /// Parent from joint, one per joint, or empty at rest.
    pub pose: Vec<Trs>,
    /// State of each mesh, parallel to [`crate::Asset::meshes`].
    pub meshes: Vec<MeshFrame>,
    /// State of each instancer, parallel to [`crate::Asset::instancers`].
    pub instancers: Vec<InstancerFrame>,
    /// State of each cloud, parallel to [`crate::Asset::points`].
    pub points: Vec<PointsFrame>,
    /// State of each set of curves, parallel to [`crate::Asset::curves`].
    pub curves: Vec<CurvesFrame>,
}

/// What a frame changes of one mesh.
#[derive(Debug, Clone, Default)]
pub enum MeshFrame {
    /// As at rest, or as its skin says.
    #[default]
    Same,
    /// New points of the same topology ([`super::MeshMotion::Deforming`]).
    Points {
        /// Positions in asset space, m, one per point of the mesh at rest.
        points: Vec<Vec3>,
        /// Unit normals, one per point.
        normals: Vec<Vec3>,
        /// Velocities of the points in asset space, m/s, one per point; empty where they are not known.
        velocities: Vec<Vec3>,
    },
    /// A whole mesh ([`super::MeshMotion::Varying`]); may be empty.
    Whole {
        /// The mesh of this frame with its attributes, which need not be those at rest.
        mesh: Mesh,
        /// Velocities of the points in asset space, m/s, one per point; empty where they are not known.
        velocities: Vec<Vec3>,
    },
}

/// What a frame changes of one instancer.
#[derive(Debug, Clone, Default)]
pub enum InstancerFrame {
    /// As at rest, or as its joints say.
    #[default]
    Same,
    /// Positions, rotations and attributes of all instances.
    State(InstanceState),
}

/// What a frame changes of one set of curves.
#[derive(Debug, Clone, Default)]
pub enum CurvesFrame {
    /// The points that the scene holds.
    #[default]
    Same,
    /// New points in asset space, m, as many as the curves of the scene have.
    Points(Vec<Vec3>),
}

impl AssetFrame {
    /// Mesh `i`; `Same` when the list is shorter.
    pub fn mesh(&self, i: usize) -> &MeshFrame {
        self.meshes.get(i).unwrap_or(&MeshFrame::Same)
    }

    /// Instancer `i`; `Same` when the list is shorter.
    pub fn instancer(&self, i: usize) -> &InstancerFrame {
        self.instancers.get(i).unwrap_or(&InstancerFrame::Same)
    }

    /// Point cloud `i`; `Same` when the list is shorter.
    pub fn points(&self, i: usize) -> &PointsFrame {
        self.points.get(i).unwrap_or(&PointsFrame::Same)
    }

    /// Curves `i`; `Same` when the list is shorter.
    pub fn curves(&self, i: usize) -> &CurvesFrame {
        self.curves.get(i).unwrap_or(&CurvesFrame::Same)
    }
}
