//! Wavefront OBJ with MTL: meshes at rest, instances merged in.
//!
//! Y up, metres. A bake gets `obj/<asset>.obj` and `.mtl` for each asset, in the space of the asset. A single file is
//! `<stem>.obj` and `<stem>.mtl` with all placements, textures in `<stem>_files/`.
//! Sources: Wavefront "Object Files (.obj)", version 3.0; "MTL material format", 1995.
//!
//! ```
//! assert_eq!(osier_export::obj::FORMAT.folder, "obj");
//! ```

use std::sync::Arc;

use super::estimate::{AssetSize, EstimateInput, MergedSize};
use super::file_target::{FileTarget, file_stem};
use super::format::{FormatInfo, TextureUse};
use super::merge::{FlattenedAsset, PartRange, format_in_parallel};
use super::text::TextBuffer;
use super::textures::Textures;
use super::{Exporter, GENERATOR, Summary};
use osier_base::files::{Folder, Output};
use osier_base::{Error, Result};
use osier_scene::{Asset, Frame, Material, Scene, Trs, check_scene};

/// Registry entry of OBJ: meshes at rest, so it writes everything before the first frame.
pub const FORMAT: FormatInfo = FormatInfo {
    word: "obj",
    about: "Wavefront meshes at rest",
    folder: "obj",
    names_assets: true,
    notes_missing_files: true,
    endings: &[("obj", "Wavefront mesh with .mtl and pictures")],
    pictures_beside: true,
    textures: TextureUse::Written,
    memory_percent: 8,
    estimate,
    open: |job| vec![Box::new(ObjExporter::new(job.folder.clone(), Arc::clone(&job.textures), job.target()))],
};

/// Mean bytes of the line of a vertex. Own: measured on trees, like the next three; only estimates use them.
const POINT_LINE: u64 = 33;
/// Mean bytes of the line of a normal.
const NORMAL_LINE: u64 = 36;
/// Mean bytes of the line of a texture coordinate.
const UV_LINE: u64 = 24;
/// Mean bytes of the line of a face without its indices.
const FACE_LINE: u64 = 11;

/// Estimate from bytes per line. A bake has a file for each asset, whose vertices nearly all have texture coordinates.
fn estimate(input: &EstimateInput) -> u64 {
    if input.single {
        let size = MergedSize::of(input.scene);
        return file_bytes(size.vertices, size.mapped_vertices, size.triangles);
    }
    let of_asset = |(a, asset): (&AssetSize, &Asset)| {
        let [hidden_vertices, hidden_triangles] = hidden_geometry(asset);
        let vertices = (a.vertices + a.instance_vertices).saturating_sub(hidden_vertices);
        let triangles = (a.triangles + a.instance_triangles).saturating_sub(hidden_triangles);
        a.weight * file_bytes(vertices, vertices, triangles)
    };
    input.assets.iter().zip(&input.scene.assets).map(of_asset).sum()
}

/// Vertices and triangles of the instances that are not alive at rest, such as catkins before their release; no file
/// contains them.
fn hidden_geometry(asset: &Asset) -> [u64; 2] {
    let mut sum = [0; 2];
    for instancer in &asset.instancers {
        let hidden = instancer.protos.iter().enumerate().filter(|(k, _)| !instancer.rest.is_alive(*k));
        for prototype in hidden.filter_map(|(_, p)| instancer.prototypes.get(*p as usize)) {
            sum[0] += prototype.mesh.points.len() as u64;
            sum[1] += prototype.mesh.triangles.len() as u64;
        }
    }
    sum
}

/// Bytes of a file of `vertices` vertices, `mapped` of them with texture coordinates; larger indices of faces take more digits.
fn file_bytes(vertices: u64, mapped: u64, triangles: u64) -> u64 {
    // Decimal digits of the largest index.
    let digits = vertices.max(1).ilog10() + 1;
    // Indices of a face: three corners with point and normal, and a coordinate where there are any.
    let numbers = if mapped > 0 { 9 } else { 6 };
    // An index takes its digits and a blank or a slash; the vertices before 10^(digits - 1) have one digit less.
    let fewer = numbers * 10_u64.pow(digits - 1) / vertices.max(1);
    let face = FACE_LINE + numbers * u64::from(digits) - fewer;
    vertices * (POINT_LINE + NORMAL_LINE) + mapped * UV_LINE + triangles * face
}

/// Writes meshes as OBJ with their materials as MTL and textures as PNG; instances become copies of their prototypes.
#[derive(Debug)]
pub struct ObjExporter {
    folder: Folder,
    textures: Arc<Textures>,
    target: FileTarget,
}

impl ObjExporter {
    /// An exporter into `folder`. `textures`: the encoded images of the scene that `begin` will get.
    pub fn new(folder: Folder, textures: Arc<Textures>, target: FileTarget) -> Self {
        Self { folder, textures, target }
    }

    /// Writes an .obj and its .mtl. `path`: of the .obj; `pictures`: folder of the textures relative to it; `finish`:
    /// writes the other files that belong to them, before the mesh appears under its final name.
    fn write_pair(
        &self,
        scene: &Scene,
        path: &str,
        pictures: &str,
        objects: &[Object<'_>],
        finish: impl FnOnce() -> Result<()>,
    ) -> Result<()> {
        let library_path = format!("{}.mtl", file_stem(path));
        let library_name = library_path.rsplit('/').next().unwrap_or(&library_path);
        let count = objects.iter().map(|o| o.flat.vertices).sum::<u64>();
        if u32::try_from(count).is_err() {
            return Err(Error::export("X010", "more vertices than OBJ files can number; write .usdc or .glb"));
        }
        // Refuse to overwrite a library that osier did not write, before the pictures are written.
        self.folder.check_name(&library_path)?;
        let out = self.folder.create(path, "obj", None)?;
        let mut lines = LineSink { out, name: path };
        let header = format!("# {GENERATOR}\n# seed {}\nmtllib {library_name}\n", scene.seed);
        lines.put(TextBuffer::default().put(&header))?;
        // Objects follow each other with consecutive vertex numbers; the library lists the materials that any of them uses.
        let (mut base, mut plain) = (1, 0);
        let mut used = std::collections::BTreeSet::new();
        for object in objects {
            object.write(&mut lines, base, plain, &scene.materials)?;
            base += object.flat.vertices;
            plain += if object.flat.has_uvs { 0 } else { object.flat.vertices };
            used.extend(object.flat.materials.iter().copied());
        }
        finish()?;
        let mut library = TextBuffer::default();
        library.put(&format!("# {GENERATOR}\n"));
        for id in used {
            if let Some(source) = scene.materials.get(id as usize) {
                let m = Material { base_color: scene.flat_color(id), ..source.clone() };
                write_material(&mut library, scene, &m, pictures);
            }
        }
        check_finite(&library, &library_path)?;
        self.folder.write(&library_path, "mtl", library.bytes())?;
        // The mesh comes last, since it names the others.
        if let Some(out) = lines.out {
            out.commit()?;
        }
        Ok(())
    }
}

/// X001 if a text received a number that is not finite.
fn check_finite(text: &TextBuffer, path: &str) -> Result<()> {
    if text.is_finite() {
        Ok(())
    } else {
        Err(Error::export("X001", format!("\"{path}\" would hold a number that is not finite")))
    }
}

/// The file that takes the lines; `None` if an interrupted bake has completed it.
struct LineSink<'a> {
    out: Option<Output>,
    name: &'a str,
}

impl LineSink<'_> {
    fn put(&mut self, text: &TextBuffer) -> Result<()> {
        check_finite(text, self.name)?;
        self.out.as_mut().map_or(Ok(()), |out| out.put(text.bytes()))
    }
}

impl Exporter for ObjExporter {
    fn begin(&mut self, scene: &Arc<Scene>) -> Result<()> {
        check_scene(scene)?;
        match &self.target {
            FileTarget::Bake => {
                self.textures.write(scene, &self.folder, "textures/")?;
                for asset in &scene.assets {
                    let object = Object { name: &asset.id, flat: &FlattenedAsset::of(asset), world: Trs::IDENTITY };
                    if object.flat.triangles > 0 {
                        let path = format!("obj/{}.obj", asset.id);
                        self.write_pair(scene, &path, "../textures/", &[object], || Ok(()))?;
                    }
                }
                Ok(())
            }
            FileTarget::Single(file) => {
                let pictures = format!("{}_files/", file_stem(file));
                let flats: Vec<FlattenedAsset<'_>> = scene.assets.iter().map(FlattenedAsset::of).collect();
                let placed = scene.placements.iter().filter_map(|p| Some((p, flats.get(p.asset)?)));
                let objects: Vec<Object<'_>> = placed
                    .filter(|(_, flat)| flat.triangles > 0)
                    .map(|(p, flat)| Object { name: &p.name, flat, world: p.transform })
                    .collect();
                // Textures are written last, so that a mesh that cannot be written leaves no folder of textures.
                let finish = || self.textures.write(scene, &self.folder, &pictures);
                self.write_pair(scene, file, &pictures, &objects, finish)
            }
        }
    }

    fn frame(&mut self, _frame: &Frame) -> Result<()> {
        Ok(())
    }

    fn finish(&mut self) -> Result<Summary> {
        Ok(Summary::default())
    }
}

/// An asset, or a placement of it, as an object (`o`) of a file.
struct Object<'a> {
    name: &'a str,
    flat: &'a FlattenedAsset<'a>,
    world: Trs,
}

impl Object<'_> {
    /// Writes `o`, then all `v`, `vt` and `vn`, then `usemtl` and `f` for each material. `base`: number of the object's
    /// first vertex: indices count from 1 over the whole file. `plain`: number of vertices of earlier objects without a
    /// `vt`.
    fn write(&self, lines: &mut LineSink<'_>, base: u64, plain: u64, materials: &[Material]) -> Result<()> {
        lines.put(TextBuffer::default().put("o ").put(self.name).put("\n"))?;
        self.write_points(lines, |t, range| {
            range.points().for_each(|p| line(t, "v ", &p.to_array()));
        })?;
        if self.flat.has_uvs {
            self.write_points(lines, |t, range| match range.mesh.uvs.get(range.range.clone()) {
                Some(uvs) => uvs.iter().for_each(|v| line(t, "vt ", &v.to_array())),
                None => range.range.clone().for_each(|_| line(t, "vt ", &[0.0; 2])),
            })?;
        }
        self.write_points(lines, |t, range| {
            range.normals().for_each(|n| line(t, "vn ", &n.to_array()));
        })?;
        for id in &self.flat.materials {
            if let Some(m) = materials.get(*id as usize) {
                lines.put(TextBuffer::default().put("usemtl ").put(&m.name).put("\n"))?;
            }
            let plain = self.flat.has_uvs.then_some(plain);
            let format = |ranges: &[PartRange<'_>]| {
                let mut text = TextBuffer::default();
                ranges.iter().for_each(|p| p.corners().for_each(|c| face(&mut text, c, p.base, plain)));
                text
            };
            format_in_parallel(self.flat.triangles(self.world, *id, base), format, |text| lines.put(&text))?;
        }
        Ok(())
    }

    /// Writes lines for all points, formatted in parallel by `each`.
    fn write_points(
        &self,
        lines: &mut LineSink<'_>,
        each: impl Fn(&mut TextBuffer, &PartRange<'_>) + Sync + Send,
    ) -> Result<()> {
        let format = |ranges: &[PartRange<'_>]| {
            let mut text = TextBuffer::default();
            ranges.iter().for_each(|p| each(&mut text, p));
            text
        };
        format_in_parallel(self.flat.points(self.world), format, |text| lines.put(&text))
    }
}

fn line(text: &mut TextBuffer, word: &str, values: &[f32]) {
    text.put(word).list(values, " ").put("\n");
}

/// A face: `f v/vt/vn` for each corner. The indices of vertex and normal are equal: each vertex has one of each.
/// `base`: number of the part's first vertex; `plain`: number of earlier vertices without a `vt`, or `None` if the part
/// has none.
fn face(text: &mut TextBuffer, corners: [u32; 3], base: u64, plain: Option<u64>) {
    text.put("f");
    for v in corners {
        let v = u64::from(v) + base;
        text.put(" ").int(v).put("/");
        if let Some(plain) = plain {
            text.int(v - plain);
        }
        text.put("/").int(v);
    }
    text.put("\n");
}

/// Writes a material. Many readers multiply a colour texture by `Kd`, so `Kd` is white if there is a texture.
/// Ns = 1000 (1 - roughness)^2 is the inverse of what Blender's importer computes.
fn write_material(text: &mut TextBuffer, scene: &Scene, m: &Material, pictures: &str) {
    let map = m.maps.color.and_then(|i| scene.images.get(i as usize));
    let smooth = 1.0 - m.roughness.clamp(0.0, 1.0);
    let color = if map.is_some() { [1.0; 3] } else { m.base_color };
    text.put("\nnewmtl ").put(&m.name).put("\nKd ").list(&color, " ");
    // Ns rounded to three decimals: 1000 s^2 = round(10^6 s^2) / 10^3.
    text.put("\nNs ").num((1e6 * smooth * smooth).round() / 1e3).put("\nd 1\n");
    if let Some(image) = map {
        text.put("map_Kd ").put(pictures).put(&image.name).put(".png\n");
        // The alpha channel of the colour texture serves as the opacity map.
        if m.alpha_cutoff.is_some() && image.channels == 4 {
            text.put("map_d ").put(pictures).put(&image.name).put(".png\n");
        }
    }
}
