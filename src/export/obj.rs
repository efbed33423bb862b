//! Wavefront OBJ with MTL: still meshes, instances merged in.
//!
//! Y up, metres. A bake gets `obj/<asset>.obj` and `.mtl` in the asset's own space; a single asset `<stem>.obj` and
//! `<stem>.mtl` with everything placed, pictures in `<stem>_files/`.

use std::sync::Arc;

use super::merge::merged;
use super::text::Text;
use super::textures::Textures;
use super::{Exporter, GENERATOR, Summary};
use crate::fence::Folder;
use crate::scene::{Frame, Material, Mesh, Scene, Trs, check_scene};
use crate::{Error, Result};

/// Where the files go.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum Layout {
    /// One pair of files per asset in `obj/`.
    #[default]
    Bake,
    /// One pair for the whole scene.
    Single(String),
}

/// Exporter for OBJ.
#[derive(Debug)]
pub struct Obj {
    folder: Folder,
    textures: Textures,
    layout: Layout,
}

impl Obj {
    /// Writes into `folder`; `textures`: the scene's pictures.
    pub fn new(folder: Folder, textures: Textures, layout: Layout) -> Self {
        Self { folder, textures, layout }
    }

    /// Writes one pair of files. `path`: without ending; `pictures`: their folder as seen from there.
    fn pair(&self, scene: &Scene, path: &str, pictures: &str, objects: &[(&str, Mesh)]) -> Result<()> {
        let stem = path.rsplit('/').next().unwrap_or(path);
        let mut text = Text::default();
        text.put(&format!("# {GENERATOR}\n# seed {}\nmtllib {stem}.mtl\n", scene.seed));
        let mut base = 1;
        let mut used = std::collections::BTreeSet::new();
        for (name, mesh) in objects {
            object(&mut text, name, mesh, base, &scene.materials);
            base += u32::try_from(mesh.points.len()).unwrap_or(u32::MAX);
            used.extend(mesh.subsets.iter().map(|s| s.material));
        }
        self.save(&format!("{path}.obj"), "obj", &text)?;
        let mut library = Text::default();
        library.put(&format!("# {GENERATOR}\n"));
        for id in used {
            if let Some(own) = scene.materials.get(id as usize) {
                let m = Material { base_color: scene.flat_color(id), ..own.clone() };
                material(&mut library, scene, &m, pictures);
            }
        }
        self.save(&format!("{path}.mtl"), "mtl", &library)
    }

    fn save(&self, path: &str, kind: &'static str, text: &Text) -> Result<()> {
        if !text.is_finite() {
            return Err(Error::export("X001", format!("\"{path}\" would hold a number that is not finite")));
        }
        self.folder.write(path, kind, text.bytes())
    }
}

impl Exporter for Obj {
    fn begin(&mut self, scene: &Arc<Scene>) -> Result<()> {
        check_scene(scene)?;
        match &self.layout {
            Layout::Bake => {
                self.textures.write(scene, &self.folder, "textures/")?;
                for asset in &scene.assets {
                    let mesh = merged(asset, &Trs::IDENTITY);
                    if !mesh.triangles.is_empty() {
                        let path = format!("obj/{}", asset.id);
                        self.pair(scene, &path, "../textures/", &[(&asset.id, mesh)])?;
                    }
                }
                Ok(())
            }
            Layout::Single(stem) => {
                let pictures = format!("{stem}_files/");
                self.textures.write(scene, &self.folder, &pictures)?;
                let place = |p: &'_ crate::scene::Placement| {
                    scene.assets.get(p.asset).map(|asset| merged(asset, &p.transform)).unwrap_or_default()
                };
                let objects: Vec<(&str, Mesh)> = scene
                    .placements
                    .iter()
                    .map(|p| (p.name.as_str(), place(p)))
                    .filter(|(_, mesh)| !mesh.triangles.is_empty())
                    .collect();
                self.pair(scene, stem, &pictures, &objects)
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

/// One object: `o`, `v`, `vt`, `vn`, then runs of one material. `base`: number of its first vertex.
/// Source: Wavefront "Object Files (.obj)", version 3.0: indices count from one over the whole file.
fn object(text: &mut Text, name: &str, mesh: &Mesh, base: u32, materials: &[Material]) {
    text.put("o ").put(name).put("\n");
    text.lines(&mesh.points, |t, _, p| {
        t.put("v ").list(&p.to_array(), " ").put("\n");
    });
    text.lines(&mesh.uvs, |t, _, v| {
        t.put("vt ").list(&v.to_array(), " ").put("\n");
    });
    text.lines(&mesh.normals, |t, _, n| {
        t.put("vn ").list(&n.to_array(), " ").put("\n");
    });
    let has_uvs = !mesh.uvs.is_empty();
    for subset in &mesh.subsets {
        if let Some(m) = materials.get(subset.material as usize) {
            text.put("usemtl ").put(&m.name).put("\n");
        }
        text.lines(mesh.subset_triangles(subset), |t, _, corners| {
            t.put("f");
            for v in corners {
                let v = v.saturating_add(base);
                t.put(" ").int(v).put("/");
                if has_uvs {
                    t.int(v);
                }
                t.put("/").int(v);
            }
            t.put("\n");
        });
    }
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
