//! Materials and their pictures.

use std::collections::BTreeMap;

use gltf::json::material::{AlphaMode, Material as Given};
use gltf::json::validation::Checked;

use super::buffers::{Buffers, resource};
use super::document::{Document, UvTransform};
use crate::pictures::{self, Raw, Shelf, Use};
use crate::{Job, Outcome};
use osier_base::files::Names;
use osier_base::math;
use osier_scene::{Image, Material};

/// Materials in the order in which the meshes use them.
pub(super) struct Surfaces<'a> {
    document: &'a Document,
    buffers: &'a Buffers<'a>,
    names: Names,
    made: Vec<Material>,
    /// Index of a material by its number in the file.
    known: BTreeMap<Option<usize>, usize>,
    shelf: Shelf,
    spent: u64,
}

impl<'a> Surfaces<'a> {
    pub(super) fn new(document: &'a Document, buffers: &'a Buffers<'a>) -> Self {
        Self {
            document,
            buffers,
            names: Names::default(),
            made: Vec::new(),
            known: BTreeMap::new(),
            shelf: Shelf::default(),
            spent: 0,
        }
    }

    /// Set of texture coordinates that a material's colour uses, and their transform.
    pub(super) fn transform(&self, material: Option<usize>) -> (u32, Option<UvTransform>) {
        let transform = material.and_then(|i| self.document.transforms.get(&i)).copied();
        let given = material.and_then(|i| self.document.root.materials.get(i));
        let texture = given.and_then(|g| g.pbr_metallic_roughness.base_color_texture.as_ref());
        let set = transform.and_then(|t| t.set).or(texture.map(|t| t.tex_coord)).unwrap_or(0);
        (set, transform)
    }

    /// Index of the material that the file numbers `id` (none: glTF's default, named after the file).
    pub(super) fn of(&mut self, job: &mut Job<'_>, id: Option<usize>) -> Outcome<u32> {
        let index = match self.known.get(&id) {
            Some(index) => *index,
            None => {
                let material = self.make(job, id)?;
                self.made.push(material);
                self.known.insert(id, self.made.len() - 1);
                self.made.len() - 1
            }
        };
        Ok(u32::try_from(index).unwrap_or(u32::MAX))
    }

    fn make(&mut self, job: &mut Job<'_>, id: Option<usize>) -> Outcome<Material> {
        let given = id.and_then(|i| self.document.root.materials.get(i));
        let stem = job.path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let name = self.names.unique(given.and_then(|g| g.name.as_deref()).unwrap_or(&stem));
        let mut material = job.material(&name);
        let (Some(given), Some(id)) = (given, id) else {
            material.base_color = [1.0; 3];
            return Ok(material);
        };
        let pbr = &given.pbr_metallic_roughness;
        let [r, g, b, a] = pbr.base_color_factor.0.map(|v| v.clamp(0.0, 1.0));
        material.base_color = [r, g, b];
        material.roughness = pbr.roughness_factor.0.clamp(0.0, 1.0);
        material.double_sided |= given.double_sided;
        let ior = self.document.iors.get(&id).copied().filter(|n| (1.0..=3.0).contains(n));
        material.ior = ior.map_or(material.ior, math::narrow);
        if let Some(texture) = &pbr.base_color_texture
            && let Some((image, channels)) = self.picture(job, texture.index.value())?
        {
            material.alpha_cutoff = cutoff(given).filter(|_| channels == 4);
            material.maps.color = self.keep(job, image, Use::color([r, g, b, a]), &name)?;
        }
        if let Some(texture) = &pbr.metallic_roughness_texture
            && let Some((image, _)) = self.picture(job, texture.index.value())?
        {
            material.maps.roughness = self.keep(job, image, Use::rough(material.roughness), &name)?;
        }
        if let Some(texture) = &given.normal_texture
            && let Some((image, _)) = self.picture(job, texture.index.value())?.filter(|n| n.1 >= 3)
        {
            material.maps.normal = self.keep(job, image, Use::Normal, &name)?;
        }
        Ok(material)
    }

    /// Keeps a picture for one use, named after the first material that has it.
    fn keep(&mut self, job: &Job<'_>, image: usize, way: Use, name: &str) -> Outcome<Option<u32>> {
        if let Some(known) = self.shelf.find(image, way) {
            return Ok(Some(known));
        }
        let bytes = self.shelf.more(image, way);
        pictures::spend(job, &format!("images[{image}]"), bytes, &mut self.spent)?;
        Ok(self.shelf.keep(image, way, name))
    }

    /// Number and channels of the picture of a texture, decoded; `None` if its file is absent.
    fn picture(&mut self, job: &mut Job<'_>, texture: usize) -> Outcome<Option<(usize, u8)>> {
        let Some(index) = self.document.root.textures.get(texture).map(|t| t.source.value()) else { return Ok(None) };
        if !self.shelf.knows(index) {
            let place = format!("images[{index}]");
            let raw: Option<Raw> = match self.bytes(job, index, &place)? {
                Some(bytes) => Some(pictures::decode(job, &place, &bytes, &mut self.spent)?),
                None => None,
            };
            self.shelf.add(index, raw);
        }
        Ok(self.shelf.channels(index).map(|channels| (index, channels)))
    }

    fn bytes(&self, job: &mut Job<'_>, index: usize, place: &str) -> Outcome<Option<Vec<u8>>> {
        let root = &self.document.root;
        let Some(image) = root.images.get(index) else { return Ok(None) };
        let limit = job.options.limits.get("mesh-bytes");
        if let Some(view) = image.buffer_view.and_then(|v| root.buffer_views.get(v.value())) {
            let bytes = self
                .buffers
                .view(view)
                .ok_or_else(|| job.inside("X010", format_args!("{place} passes the end of its buffer")))?;
            return Ok(Some(bytes.to_vec()));
        }
        match &image.uri {
            Some(uri) if uri.starts_with("data:") => resource(job, place, uri, limit).map(Some),
            Some(uri) => job.picture(job.options.roots.read_uri(job.path, uri, limit)),
            None => Err(job.inside("X010", format_args!("{place} has neither a uri nor a bufferView"))),
        }
    }

    pub(super) fn finish(self) -> (Vec<Material>, Vec<Image>) {
        (self.made, self.shelf.finish())
    }
}

/// Where alpha cuts out: as the file says; blended surfaces, which leaves are often exported as, are cut in the middle.
fn cutoff(given: &Given) -> Option<f32> {
    match &given.alpha_mode {
        Checked::Valid(AlphaMode::Opaque) | Checked::Invalid => None,
        Checked::Valid(AlphaMode::Mask) => Some(given.alpha_cutoff.as_ref().map_or(0.5, |c| c.0.clamp(0.0, 1.0))),
        Checked::Valid(AlphaMode::Blend) => Some(0.5),
    }
}
