//! The wind field: planes as `wind/<plane>.####.exr`, velocities in m/s along x, y and z as 32-bit floats in R, G, B, and the
//! whole domain as `wind/box.####.vti` for ParaView and other programs of the VTK family.
//!
//! Orientation of a plane's image: normal y, seen from above, +X to the right and +Z down; normal x, +Z to the right and +Y up;
//! normal z, +X to the right and +Y up.

use std::sync::Arc;

use glam::{DVec3, Vec3};

use super::{Exporter, GENERATOR, Summary, exr::floats};
use osier_base::Result;
use osier_base::files::Folder;
use osier_scene::{AirGrid, Frame, Scene};

/// Writes the wind field at each frame into `wind/`: a plane as an EXR image, a box as a `.vti` volume.
#[derive(Debug)]
pub struct Air {
    folder: Folder,
    scene: Option<Arc<Scene>>,
}

impl Air {
    /// An exporter of the grids [`Scene::air`] that writes below `folder`; frames without values of a grid get no file.
    pub fn new(folder: Folder) -> Self {
        Self { folder, scene: None }
    }
}

impl Exporter for Air {
    fn begin(&mut self, scene: &Arc<Scene>) -> Result<()> {
        self.scene = Some(Arc::clone(scene));
        Ok(())
    }

    fn frame(&mut self, frame: &Frame) -> Result<()> {
        let Some(scene) = &self.scene else { return Ok(()) };
        for (grid, values) in scene.air.iter().zip(&frame.air).filter(|(_, v)| !v.is_empty()) {
            // A grid with a normal axis is a plane and becomes an image; a grid without one is a box and becomes a
            // volume.
            let (kind, ending) = if grid.across.is_some() { ("exr.wind", "exr") } else { ("vti.wind", "vti") };
            let path = format!("wind/{}.{}.{ending}", grid.name, scene.clip.tag(frame.number));
            let Some(mut out) = self.folder.create(&path, kind, Some(frame.number))? else { continue };
            let bytes = match grid.across {
                Some(across) => plane_exr(scene, grid, across, values, frame.number)?,
                None => vti(scene, grid, values, frame.number),
            };
            out.put(&bytes)?;
            out.commit()?;
        }
        Ok(())
    }

    fn finish(&mut self) -> Result<Summary> {
        self.scene = None;
        Ok(Summary::default())
    }
}

/// A plane as an EXR file. `across`: axis of its normal; `values`: m/s, x fastest, then y, then z.
fn plane_exr(scene: &Scene, grid: &AirGrid, across: usize, values: &[Vec3], frame: u32) -> Result<Vec<u8>> {
    // Order of the cells in the image, row by row from the top.
    let [nx, ny, nz] = grid.cells;
    let ((width, height), texels): ((usize, usize), Vec<usize>) = match across {
        0 => ((nz, ny), (0..ny).rev().flat_map(|y| (0..nz).map(move |z| z * ny + y)).collect()),
        1 => ((nx, nz), (0..nx * nz).collect()),
        _ => ((nx, ny), (0..ny).rev().flat_map(|y| (0..nx).map(move |x| y * nx + x)).collect()),
    };
    // Sides of the grid, m; the grid of a plane has one cell along its normal.
    let ends = DVec3::new(nx as f64, ny as f64, nz as f64) * grid.side;
    let (x, y, z) = (DVec3::X * ends.x, DVec3::Y * ends.y, DVec3::Z * ends.z);
    let (corner, along, down) = match across {
        0 => (grid.corner + y, z, -y),
        1 => (grid.corner, x, z),
        _ => (grid.corner + y, x, -y),
    };
    let samples: Vec<f32> =
        texels.iter().flat_map(|t| values.get(*t).copied().unwrap_or(Vec3::ZERO).to_array()).collect();
    // Adding 0 turns -0 into 0: equal values have equal text.
    let plain = |v: DVec3| v.to_array().map(|v| v + 0.0);
    let (axis, at) = [("x", grid.corner.x), ("y", grid.corner.y), ("z", grid.corner.z)][across.min(2)];
    let comment = serde_json::json!({
        "map": "wind", "name": grid.name, "seed": scene.seed.to_string(), "scene": scene.hash, "unit": "m/s",
        "across": axis, "at_m": at, "texel_m": grid.side,
        "corner_m": plain(corner), "along_m": plain(along), "down_m": plain(down), "frame": frame,
        "time_s": scene.clip.seconds(frame),
    });
    floats(width, height, 3, &samples, &comment.to_string())
}

/// A box as VTK ImageData with velocities as cell data: XML, then raw appended data, namely the number of bytes as u64
/// and the vectors as little-endian f32.
fn vti(scene: &Scene, grid: &AirGrid, values: &[Vec3], frame: u32) -> Vec<u8> {
    let [nx, ny, nz] = grid.cells;
    // The extent counts points, one more than cells along each axis: n cells need the points 0 to n.
    let extent = format!("0 {nx} 0 {ny} 0 {nz}");
    let (o, s) = (grid.corner, grid.side);
    let head = format!(
        "<?xml version=\"1.0\"?>\n<!-- {GENERATOR}, seed {}, scene {}, frame {frame} -->\n\
         <VTKFile type=\"ImageData\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n\
         <ImageData WholeExtent=\"{extent}\" Origin=\"{} {} {}\" Spacing=\"{s} {s} {s}\">\n\
         <FieldData><DataArray type=\"Float64\" Name=\"TimeValue\" NumberOfTuples=\"1\" format=\"ascii\">{}</DataArray></FieldData>\n\
         <Piece Extent=\"{extent}\">\n<CellData Vectors=\"velocity\">\n\
         <DataArray type=\"Float32\" Name=\"velocity\" NumberOfComponents=\"3\" format=\"appended\" offset=\"0\"/>\n\
         </CellData>\n</Piece>\n</ImageData>\n<AppendedData encoding=\"raw\">\n_",
        scene.seed,
        scene.hash,
        o.x,
        o.y,
        o.z,
        scene.clip.seconds(frame),
    );
    let mut bytes = head.into_bytes();
    bytes.reserve(12 * values.len() + 64);
    bytes.extend((12 * values.len() as u64).to_le_bytes());
    for u in values {
        u.to_array().iter().for_each(|v| bytes.extend(v.to_le_bytes()));
    }
    bytes.extend(b"\n</AppendedData>\n</VTKFile>\n");
    bytes
}
