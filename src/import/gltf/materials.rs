//! Materials and their pictures.

use std::collections::BTreeMap;

use gltf::json::material::{AlphaMode, Material as Given};
use gltf::json::validation::Checked;

use super::buffers::{Buffers, resource};
use super::document::{Document, UvTransform};
use crate::fence::Names;
use crate::import::pictures::{self, Raw};
use crate::import::{Job, Outcome};
use crate::math;
use crate::scene::{Image, ImageKind, Material};

/// Materials in the order in which the meshes use them.
pub(super) struct Surfaces<'a> {
    document: &'a Document,
    buffers: &'a Buffers<'a>,
    names: Names,
    made: Vec<(Option<usize>, Material)>,
    images: Vec<Image>,
    decoded: BTreeMap<usize, Option<Raw>>,
    spent: u64,
}

impl<'a> Surfaces<'a> {
    pub(super) fn new(document: &'a Document, buffers: &'a Buffers<'a>) -> Self {
        let (names, made, images) = (Names::default(), Vec::new(), Vec::new());
        Self { document, buffers, names, made, images, decoded: BTreeMap::new(), spent: 0 }
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
        let index = match self.made.iter().position(|(i, _)| *i == id) {
            Some(index) => index,
            None => {
                let material = self.make(job, id)?;
                self.made.push((id, material));
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
            && let Some(color) = self.picture(job, texture.index.value())?
        {
            let is_white = [r, g, b, a].iter().all(|v| *v >= 1.0);
            let color = if is_white { color } else { color.tinted([r, g, b, a]) };
            material.alpha_cutoff = cutoff(given).filter(|_| color.channels == 4);
            material.maps.color = Some(self.keep(color, format!("{name}_color"), ImageKind::Color));
        }
        if let Some(texture) = &pbr.metallic_roughness_texture
            && let Some(packed) = self.picture(job, texture.index.value())?
        {
            // Roughness is the green channel, times the factor.
            let grey = packed.channel(1, 255).scaled(material.roughness);
            material.maps.roughness = Some(self.keep(grey, format!("{name}_rough"), ImageKind::Data));
        }
        if let Some(texture) = &given.normal_texture
            && let Some(normal) = self.picture(job, texture.index.value())?.filter(|n| n.channels >= 3)
        {
            material.maps.normal = Some(self.keep(normal, format!("{name}_normal"), ImageKind::Data));
        }
        Ok(material)
    }

    fn keep(&mut self, raw: Raw, name: String, kind: ImageKind) -> u32 {
        self.images.push(raw.into_image(name, kind));
        u32::try_from(self.images.len() - 1).unwrap_or(u32::MAX)
    }

    /// The decoded picture of a texture; `None` if its file is absent.
    fn picture(&mut self, job: &mut Job<'_>, texture: usize) -> Outcome<Option<Raw>> {
        let Some(index) = self.document.root.textures.get(texture).map(|t| t.source.value()) else { return Ok(None) };
        if let Some(known) = self.decoded.get(&index) {
            return Ok(known.clone());
        }
        let place = format!("images[{index}]");
        let raw = match self.bytes(job, index, &place)? {
            Some(bytes) => Some(pictures::decode(job, &place, &bytes, &mut self.spent)?),
            None => None,
        };
        self.decoded.insert(index, raw.clone());
        Ok(raw)
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
        (self.made.into_iter().map(|(_, m)| m).collect(), self.images)
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
