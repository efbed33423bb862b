//! OpenVDB: the volumes of a scene as `vdb/FILE_####.vdb`, sparse grids of densities and velocities for Blender, Houdini and
//! renderers. Y up, metres; with a USD stage beside them in the axes of that stage.

use std::sync::Arc;

mod file;
pub(crate) mod options;
mod tree;

pub use options::VdbOptions;

use super::estimate::EstimateInput;
use super::format::{FormatInfo, TextureUse};
use super::{Exporter, Summary};
use file::{FilledGrid, MAX_VOXELS, too_many_voxels, vdb_bytes};
use osier_base::Result;
use osier_base::files::Folder;
use osier_scene::{Frame, Scene, VolumeGrid};

/// Bytes of a grid without voxels: inner nodes, descriptor and metadata, measured.
const GRID_BYTES: u64 = 10_000;
/// Bytes per element and scalar grid, measured. An element lies in one of two grids. It takes 100 bytes there if all
/// elements are scattered, 7 if most lie side by side; half of 100 is counted for each grid.
const SCALAR_CELL: u64 = 50;
/// Bytes per cell of a dense, zipped grid of vectors for each byte of a number; measured.
const VECTOR_CELL: u64 = 3;

/// Registry entry of OpenVDB: sparse grids, at each frame a file for each `VolumeGrid::file`.
pub const FORMAT: FormatInfo = FormatInfo {
    word: "vdb",
    about: "OpenVDB: wind, catkins in flight and at rest as voxel grids, a file per frame",
    folder: "vdb",
    names_assets: false,
    notes_missing_files: true,
    endings: &[],
    pictures_beside: false,
    textures: TextureUse::Unused,
    memory_percent: 0,
    estimate,
    open: |job| vec![Box::new(VdbExporter::new(job.folder.clone(), job.options.vdb))],
};

/// Estimate from cells of every grid, at the frames at which the grid is written.
fn estimate(input: &EstimateInput) -> u64 {
    let bytes_per_number = if input.options.vdb.half { 2 } else { 4 };
    let of = |grid: &VolumeGrid| {
        let cell = if grid.is_vector { VECTOR_CELL * bytes_per_number } else { SCALAR_CELL };
        input.frames.div_ceil(u64::from(grid.every.max(1))).saturating_mul(GRID_BYTES + cell * grid.max_cells)
    };
    input.scene.volumes.iter().map(of).sum()
}

/// Path of a file of volumes at a frame, relative to the output folder.
pub(crate) fn volume_path(scene: &Scene, file: &str, frame: u32) -> String {
    format!("vdb/{file}_{}.vdb", scene.clip.tag(frame))
}

/// Fails for a dense grid (of vectors) with more cells than a file may have. `frame`: number for the message.
/// # Errors
/// X010.
pub fn check_dense_grid(grid: &VolumeGrid, frame: u32) -> Result<()> {
    if grid.is_vector && grid.max_cells > MAX_VOXELS {
        return Err(too_many_voxels(grid.file, frame, grid.max_cells));
    }
    Ok(())
}

/// Names of the files of a scene's volumes, in the order of their grids.
pub(crate) fn volume_files(scene: &Scene) -> Vec<&'static str> {
    let mut files: Vec<&'static str> = scene.volumes.iter().map(|g| g.file).collect();
    files.dedup();
    files
}

/// Writes the volumes of a scene: at each frame a file for each name in its grids, `vdb/<file>_<frame>.vdb`.
#[derive(Debug)]
pub struct VdbExporter {
    folder: Folder,
    options: VdbOptions,
    scene: Option<Arc<Scene>>,
}

impl VdbExporter {
    /// An exporter that writes into `vdb/` below `folder`.
    pub fn new(folder: Folder, options: VdbOptions) -> Self {
        Self { folder, options, scene: None }
    }
}

impl Exporter for VdbExporter {
    fn begin(&mut self, scene: &Arc<Scene>) -> Result<()> {
        // Refuse a dense grid here, before anything is simulated, as its size is known.
        scene.volumes.iter().try_for_each(|grid| check_dense_grid(grid, scene.clip.start))?;
        self.scene = Some(Arc::clone(scene));
        Ok(())
    }

    fn frame(&mut self, frame: &Frame) -> Result<()> {
        let Some(scene) = &self.scene else { return Ok(()) };
        let since = frame.number.saturating_sub(scene.clip.start);
        for file in volume_files(scene) {
            let filled = scene.volumes.iter().zip(&frame.volumes);
            let grids: Vec<FilledGrid<'_>> = filled
                .filter(|(grid, _)| grid.file == file && grid.is_due(since))
                .map(|(grid, values)| FilledGrid { grid, values })
                .collect();
            if grids.is_empty() {
                continue;
            }
            // A file without active voxels is written too: sequences must not have gaps.
            let path = volume_path(scene, file, frame.number);
            let Some(mut out) = self.folder.create(&path, "vdb", Some(frame.number))? else { continue };
            out.put(&vdb_bytes(scene, file, frame.number, &grids, self.options)?)?;
            out.commit()?;
        }
        Ok(())
    }

    fn finish(&mut self) -> Result<Summary> {
        self.scene = None;
        Ok(Summary::default())
    }
}
