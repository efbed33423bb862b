//! Wavefront OBJ with MTL: still meshes, instances merged in.
//!
//! Y up, metres. A bake gets `obj/<asset>.obj` and `.mtl` in the asset's own space; a single asset `<stem>.obj` and
//! `<stem>.mtl` with everything placed, pictures in `<stem>_files/`.

use std::sync::Arc;

use super::estimate::{EstimateInput, MergedSize};
use super::file_target::FileTarget;
use super::format::FormatInfo;
use super::merge::{Flat, Piece, stream};
use super::text::Text;
use super::textures::Textures;
use super::{Exporter, GENERATOR, Summary};
use osier_base::files::{Folder, Output};
use osier_base::{Error, Result};
use osier_scene::{Frame, Material, Scene, Trs, check_scene};

/// OBJ in the registry.
pub const FORMAT: FormatInfo = FormatInfo {
    word: "obj",
    about: "Wavefront meshes at rest",
    asset_folder: Some("obj"),
    endings: &[("obj", "Wavefront mesh with .mtl and pictures")],
    pictures_beside: true,
    memory_percent: 0,
    estimate,
    open: |job| vec![Box::new(ObjExporter::new(job.folder.clone(), Arc::clone(&job.textures), job.target()))],
};

/// Bytes of the lines of a vertex, a normal and a texture coordinate, and of a face without its numbers. Own: as measured on
/// trees.
const POINT_LINE: u64 = 33;
const NORMAL_LINE: u64 = 36;
const UV_LINE: u64 = 24;
const FACE_LINE: u64 = 11;

/// Own: bytes as the lines have them; indices of faces grow with the number of vertices.
fn estimate(input: &EstimateInput) -> u64 {
    if !input.single {
        return input
            .per_asset(|a| (a.vertices + a.instance_vertices) * 80 + (a.triangles + a.instance_triangles) * 40);
    }
    let size = MergedSize::of(input.scene);
    let digits = size.vertices.max(1).ilog10() + 1;
    let numbers = if size.mapped_vertices > 0 { 9 } else { 6 };
    // Of each index: a blank or a slash and its digits, of which those of the first vertices have fewer.
    let fewer = numbers * 10_u64.pow(digits - 1) / size.vertices.max(1);
    let face = FACE_LINE + numbers * u64::from(digits) - fewer;
    size.vertices * (POINT_LINE + NORMAL_LINE) + size.mapped_vertices * UV_LINE + size.triangles * face
}

/// Exporter for OBJ.
#[derive(Debug)]
pub struct ObjExporter {
    folder: Folder,
    textures: Arc<Textures>,
    target: FileTarget,
}

impl ObjExporter {
    /// Writes into `folder`; `textures`: the scene's pictures.
    pub fn new(folder: Folder, textures: Arc<Textures>, target: FileTarget) -> Self {
        Self { folder, textures, target }
    }

    /// Writes one pair of files. `path`: without ending; `pictures`: their folder as seen from there; `finish`: what
    /// else belongs to them, written before the mesh appears under its name.
    fn pair(
        &self,
        scene: &Scene,
        path: &str,
        pictures: &str,
        objects: &[Object<'_>],
        finish: impl FnOnce() -> Result<()>,
    ) -> Result<()> {
        let stem = path.rsplit('/').next().unwrap_or(path);
        let count = objects.iter().map(|o| o.flat.vertices).sum::<u64>();
        if u32::try_from(count).is_err() {
            return Err(Error::export("X010", "more vertices than OBJ files can number; write .usdc or .glb"));
        }
        let name = format!("{path}.obj");
        let out = self.folder.create(&name, "obj", None)?;
        let mut lines = Lines { out, name: &name };
        lines.put(Text::default().put(&format!("# {GENERATOR}\n# seed {}\nmtllib {stem}.mtl\n", scene.seed)))?;
        let mut base = 1;
        let mut used = std::collections::BTreeSet::new();
        for object in objects {
            object.write(&mut lines, base, &scene.materials)?;
            base += object.flat.vertices;
            used.extend(object.flat.materials.iter().copied());
        }
        finish()?;
        if let Some(out) = lines.out {
            out.commit()?;
        }
        let mut library = Text::default();
        library.put(&format!("# {GENERATOR}\n"));
        for id in used {
            if let Some(own) = scene.materials.get(id as usize) {
                let m = Material { base_color: scene.flat_color(id), ..own.clone() };
                material(&mut library, scene, &m, pictures);
            }
        }
        let path = format!("{path}.mtl");
        finite(&library, &path)?;
        self.folder.write(&path, "mtl", library.bytes())
    }
}

fn finite(text: &Text, path: &str) -> Result<()> {
    if text.is_finite() {
        Ok(())
    } else {
        Err(Error::export("X001", format!("\"{path}\" would hold a number that is not finite")))
    }
}

/// A file being written, unless it is finished already.
struct Lines<'a> {
    out: Option<Output>,
    name: &'a str,
}

impl Lines<'_> {
    fn put(&mut self, text: &Text) -> Result<()> {
        finite(text, self.name)?;
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
                    let object = Object { name: &asset.id, flat: &Flat::of(asset), world: Trs::IDENTITY };
                    if object.flat.triangles > 0 {
                        let path = format!("obj/{}", asset.id);
                        self.pair(scene, &path, "../textures/", &[object], || Ok(()))?;
                    }
                }
                Ok(())
            }
            FileTarget::Single(stem) => {
                let pictures = format!("{stem}_files/");
                let flats: Vec<Flat<'_>> = scene.assets.iter().map(Flat::of).collect();
                let placed = scene.placements.iter().filter_map(|p| Some((p, flats.get(p.asset)?)));
                let objects: Vec<Object<'_>> = placed
                    .filter(|(_, flat)| flat.triangles > 0)
                    .map(|(p, flat)| Object { name: &p.name, flat, world: p.transform })
                    .collect();
                // Where the mesh cannot be written there is no folder of pictures for it.
                let finish = || self.textures.write(scene, &self.folder, &pictures);
                self.pair(scene, stem, &pictures, &objects, finish)
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

/// One object of a file.
struct Object<'a> {
    name: &'a str,
    flat: &'a Flat<'a>,
    world: Trs,
}

impl Object<'_> {
    /// `o`, `v`, `vt`, `vn`, then runs of one material. `base`: number of its first vertex.
    /// Source: Wavefront "Object Files (.obj)", version 3.0: indices count from one over the whole file.
    fn write(&self, lines: &mut Lines<'_>, base: u64, materials: &[Material]) -> Result<()> {
        lines.put(Text::default().put("o ").put(self.name).put("\n"))?;
        self.numbers(lines, |t, piece| {
            piece.points().for_each(|p| line(t, "v ", &p.to_array()));
        })?;
        if self.flat.has_uvs {
            self.numbers(lines, |t, piece| match piece.mesh.uvs.get(piece.range.clone()) {
                Some(uvs) => uvs.iter().for_each(|v| line(t, "vt ", &v.to_array())),
                None => piece.range.clone().for_each(|_| line(t, "vt ", &[0.0; 2])),
            })?;
        }
        self.numbers(lines, |t, piece| {
            piece.normals().for_each(|n| line(t, "vn ", &n.to_array()));
        })?;
        for id in &self.flat.materials {
            if let Some(m) = materials.get(*id as usize) {
                lines.put(Text::default().put("usemtl ").put(&m.name).put("\n"))?;
            }
            let format = |pieces: &[Piece<'_>]| {
                let mut text = Text::default();
                pieces.iter().for_each(|p| p.corners().for_each(|c| face(&mut text, c, p.base, self.flat.has_uvs)));
                text
            };
            stream(self.flat.triangles(self.world, *id, base), format, |text| lines.put(&text))?;
        }
        Ok(())
    }

    /// Lines of all points.
    fn numbers(&self, lines: &mut Lines<'_>, each: impl Fn(&mut Text, &Piece<'_>) + Sync + Send) -> Result<()> {
        let format = |pieces: &[Piece<'_>]| {
            let mut text = Text::default();
            pieces.iter().for_each(|p| each(&mut text, p));
            text
        };
        stream(self.flat.points(self.world), format, |text| lines.put(&text))
    }
}

fn line(text: &mut Text, word: &str, values: &[f32]) {
    text.put(word).list(values, " ").put("\n");
}

/// `base`: number of the part's first vertex.
fn face(text: &mut Text, corners: [u32; 3], base: u64, has_uvs: bool) {
    text.put("f");
    for v in corners {
        let v = u32::try_from(u64::from(v) + base).unwrap_or(u32::MAX);
        text.put(" ").int(v).put("/");
        if has_uvs {
            text.int(v);
        }
        text.put("/").int(v);
    }
    text.put("\n");
}

/// One material. A colour map replaces the colour, so beside it `Kd` is white.
/// Source: Ns = 1000 (1 - roughness)^2, the inverse of what Blender's importer does.
fn material(text: &mut Text, scene: &Scene, m: &Material, pictures: &str) {
    let map = m.maps.color.and_then(|i| scene.images.get(i as usize));
    let smooth = 1.0 - m.roughness.clamp(0.0, 1.0);
    let color = if map.is_some() { [1.0; 3] } else { m.base_color };
    text.put("\nnewmtl ").put(&m.name).put("\nKd ").list(&color, " ");
    text.put("\nNs ").num((1e6 * smooth * smooth).round() / 1e3).put("\nd 1\n");
    if let Some(image) = map {
        text.put("map_Kd ").put(pictures).put(&image.name).put(".png\n");
        if m.alpha_cutoff.is_some() && image.channels == 4 {
            text.put("map_d ").put(pictures).put(&image.name).put(".png\n");
        }
    }
}
