//! Point caches for deforming meshes: `cache/<asset>.pc2`, or `cache/<asset>.<mesh>.pc2` where an asset has several, beside the
//! glTF file of profile `blender`.
//!
//! Little endian: `POINTCACHE2\0`, i32 version 1, i32 vertices, f32 first frame, f32 frames per sample, i32 samples, then
//! samples x vertices x 3 f32. Vertices are in the order of that glTF file (submeshes by material, each with the
//! vertices it uses), which Blender's importer keeps; axes are Blender's, (x, -z, y).

use std::sync::Arc;

use glam::Vec3;

use super::format::{FormatInfo, TextureUse};
use super::gltf::submeshes::split_by_material;
use super::{Exporter, Summary, Warning};
use osier_base::files::{Folder, Output};
use osier_base::{Error, Result};
use osier_scene::{Asset, AssetFrame, Frame, MeshMotion, MeshObject, Scene, check_frame, mesh_points};

/// Registry entry of point caches, which hold points over time and no topology.
pub const FORMAT: FormatInfo = FormatInfo {
    word: "pc2",
    about: "point caches for the glb of profile blender, of plants with motion = \"cache\"",
    folder: "cache",
    names_assets: true,
    notes_missing_files: true,
    endings: &[],
    pictures_beside: false,
    textures: TextureUse::Unused,
    memory_percent: 0,
    // Growing plants have no joints but points in every frame, as plants with motion = "cache" do.
    estimate: |input| input.per_asset(|a| input.frames * a.deforming_vertices * 12),
    open: |job| vec![Box::new(Pc2Exporter::new(job.folder.clone()))],
};

/// Writes point caches: a file for each deforming mesh, frames as they arrive.
#[derive(Debug)]
pub struct Pc2Exporter {
    folder: Folder,
    scene: Option<Arc<Scene>>,
    caches: Vec<PointCache>,
    numbers: Vec<u32>,
}

/// The cache file of one deforming mesh, open until the end of the clip.
#[derive(Debug)]
struct PointCache {
    asset: usize,
    mesh: usize,
    /// For each vertex of the file its index in the mesh.
    order: Vec<usize>,
    out: Option<Output>,
    /// The header that was written when the file was opened.
    header: Pc2Header,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Pc2Header {
    vertices: i32,
    first: u32,
    step: u32,
    samples: usize,
}

impl Pc2Exporter {
    /// An exporter into `folder`. Scenes without animation or without deforming meshes have no file.
    pub fn new(folder: Folder) -> Self {
        Self { folder, scene: None, caches: Vec::new(), numbers: Vec::new() }
    }

    /// Opens the files at the first frame. The header assumes all frames to the end of the clip; `finish` corrects it if
    /// necessary.
    fn open(&mut self, scene: &Scene, first: u32) -> Result<()> {
        let samples = (scene.clip.end.saturating_sub(first) as usize).saturating_add(1);
        for (asset, source) in scene.assets.iter().enumerate() {
            let deforming: Vec<usize> =
                (0..source.meshes.len()).filter(|&i| source.meshes[i].motion == MeshMotion::Deforming).collect();
            for mesh in deforming {
                let object = &source.meshes[mesh];
                let order = written_order(&object.mesh);
                let path = cache_path(source, object);
                let vertices = i32::try_from(order.len())
                    .map_err(|_| Error::export("X005", format!("{path}: {} vertices", order.len())))?;
                let header = Pc2Header { vertices, first, step: 1, samples };
                let mut out = self.folder.create(&path, "pc2", None)?;
                if let Some(out) = &mut out {
                    out.put(&header.bytes()?)?;
                }
                self.caches.push(PointCache { asset, mesh, order, out, header });
            }
        }
        Ok(())
    }
}

/// Path of the cache of a deforming mesh: named after the asset alone if no other mesh of it deforms. The names are
/// separated by a dot, which asset names do not contain, so that the mesh `bark` of `twig` is not mistaken for the
/// asset `twig_bark`.
pub(super) fn cache_path(asset: &Asset, object: &MeshObject) -> String {
    let deforming = asset.meshes.iter().filter(|m| m.motion == MeshMotion::Deforming).count();
    if deforming == 1 { format!("cache/{}.pc2", asset.id) } else { format!("cache/{}.{}.pc2", asset.id, object.name) }
}

impl Pc2Header {
    fn bytes(&self) -> Result<Vec<u8>> {
        let samples = i32::try_from(self.samples)
            .map_err(|_| Error::export("X005", format!("point cache of {} samples", self.samples)))?;
        let mut bytes = b"POINTCACHE2\0".to_vec();
        bytes.extend(1_i32.to_le_bytes());
        bytes.extend(self.vertices.to_le_bytes());
        bytes.extend(osier_base::math::narrow(f64::from(self.first)).to_le_bytes());
        bytes.extend(osier_base::math::narrow(f64::from(self.step)).to_le_bytes());
        bytes.extend(samples.to_le_bytes());
        Ok(bytes)
    }
}

/// For each vertex of the glTF file's primitives, in order, its index in the mesh.
fn written_order(mesh: &osier_scene::Mesh) -> Vec<usize> {
    // Splitting the identity list as the glTF writer splits the points gives the index of each written vertex.
    let all: Vec<usize> = (0..mesh.points.len()).collect();
    split_by_material(mesh).iter().flat_map(|p| p.gather(&all).into_owned()).collect()
}

impl PointCache {
    fn put(&mut self, points: &[Vec3]) -> Result<()> {
        let Some(out) = &mut self.out else { return Ok(()) };
        let mut bytes = Vec::with_capacity(self.order.len() * 12);
        for p in self.order.iter().filter_map(|&i| points.get(i)) {
            // Adding 0 turns -0 into 0: equal values have equal bytes.
            for c in [p.x, -p.z, p.y] {
                bytes.extend((c + 0.0).to_le_bytes());
            }
        }
        out.put(&bytes)
    }
}

impl Exporter for Pc2Exporter {
    fn begin(&mut self, scene: &Arc<Scene>) -> Result<()> {
        self.scene = Some(Arc::clone(scene));
        Ok(())
    }

    fn frame(&mut self, frame: &Frame) -> Result<()> {
        let Some(scene) = self.scene.clone() else { return Ok(()) };
        check_frame(&scene, frame)?;
        if self.numbers.is_empty() {
            self.open(&scene, frame.number)?;
        }
        self.numbers.push(frame.number);
        let rest = AssetFrame::default();
        for cache in &mut self.caches {
            let asset = &scene.assets[cache.asset];
            let state = frame.assets.get(cache.asset).unwrap_or(&rest);
            cache.put(&mesh_points(asset, &asset.meshes[cache.mesh], cache.mesh, state))?;
        }
        Ok(())
    }

    fn finish(&mut self) -> Result<Summary> {
        let step = match self.numbers.as_slice() {
            // The interval between samples, frames; a clip with a single sample has the interval 1.
            [a, b, ..] => b.saturating_sub(*a).max(1),
            _ => 1,
        };
        // The format has a single interval: if another interval follows, later samples are shown at wrong frames.
        let shown = std::iter::successors(self.numbers.first().copied(), |frame| Some(frame.saturating_add(step)));
        let late = self.numbers.iter().copied().zip(shown).find(|(number, shown)| number != shown);
        let warning = late.filter(|_| !self.caches.is_empty()).map(|(number, shown)| Warning {
            code: "X017",
            message: format!(
                "point caches have frames at equal distances only: they show frame {number} at frame {shown}"
            ),
        });
        for mut cache in self.caches.drain(..) {
            let header = Pc2Header { step, samples: self.numbers.len(), ..cache.header };
            if let Some(mut out) = cache.out.take() {
                // A bake that stopped early or skipped frames has other counts than those assumed.
                if header != cache.header {
                    out.put_at(0, &header.bytes()?)?;
                }
                out.commit()?;
            }
        }
        self.scene = None;
        self.numbers.clear();
        Ok(Summary { warnings: warning.into_iter().collect() })
    }
}
