//! Converts materials and their textures.

use std::collections::BTreeMap;

use gltf::json::material::{AlphaMode, Material as Given};
use gltf::json::validation::Checked;

use super::buffers::{Buffers, resource};
use super::document::{GltfDocument, TextureCoordinates};
use super::wrap::{MaterialWraps, wraps_of_texture};
use crate::images::{self, DecodedImage, MapCache, MapUse};
use crate::{ImportContext, ImportResult, table_index};
use osier_base::files::Names;
use osier_base::math;
use osier_scene::{Image, Material};

/// Materials and images of a file.
pub(super) struct FinishedMaterials {
    pub(super) materials: Vec<Material>,
    pub(super) images: Vec<Image>,
    /// Wrap modes of the maps of each material.
    pub(super) wraps: Vec<MaterialWraps>,
    /// Bytes of the images, as counted against the limit.
    pub(super) spent: u64,
}

/// Materials in the order in which the meshes use them.
pub(super) struct GltfMaterials<'a> {
    document: &'a GltfDocument,
    buffers: &'a Buffers<'a>,
    names: Names,
    materials: Vec<Material>,
    /// Wrap modes of the maps of each material.
    wraps: Vec<MaterialWraps>,
    /// Index of a material by its number in the file.
    index_of: BTreeMap<Option<usize>, usize>,
    cache: MapCache,
    spent: u64,
}

impl<'a> GltfMaterials<'a> {
    pub(super) fn new(document: &'a GltfDocument, buffers: &'a Buffers<'a>) -> Self {
        Self {
            document,
            buffers,
            names: Names::default(),
            materials: Vec::new(),
            wraps: Vec::new(),
            index_of: BTreeMap::new(),
            cache: MapCache::default(),
            spent: 0,
        }
    }

    /// Set of the texture coordinates of a material's maps, and its transform.
    pub(super) fn texture_coordinates(&self, material: Option<usize>) -> TextureCoordinates {
        let given = material.and_then(|i| self.document.texture_coordinates.get(&i));
        given.copied().unwrap_or_default()
    }

    /// Index of the material that the file numbers `id` (none: glTF's default, named after the file).
    pub(super) fn material_index(&mut self, context: &mut ImportContext<'_>, id: Option<usize>) -> ImportResult<u32> {
        let index = match self.index_of.get(&id) {
            Some(index) => *index,
            None => {
                let material = self.convert_material(context, id)?;
                self.materials.push(material);
                let wraps = self.wraps_of(id);
                self.wraps.push(wraps);
                self.index_of.insert(id, self.materials.len() - 1);
                self.materials.len() - 1
            }
        };
        Ok(table_index(index))
    }

    /// Wrap modes of the maps of a material, from the samplers of their textures.
    fn wraps_of(&self, id: Option<usize>) -> MaterialWraps {
        let root = &self.document.root;
        let Some(given) = id.and_then(|i| root.materials.get(i)) else { return MaterialWraps::default() };
        let wraps = |texture: Option<usize>| texture.map_or_else(Default::default, |t| wraps_of_texture(root, t));
        let pbr = &given.pbr_metallic_roughness;
        MaterialWraps {
            color: wraps(pbr.base_color_texture.as_ref().map(|t| t.index.value())),
            roughness: wraps(pbr.metallic_roughness_texture.as_ref().map(|t| t.index.value())),
            normal: wraps(given.normal_texture.as_ref().map(|t| t.index.value())),
        }
    }

    /// Converts a material and stores its maps: base colour, roughness (green channel), normals.
    fn convert_material(&mut self, context: &mut ImportContext<'_>, id: Option<usize>) -> ImportResult<Material> {
        let given = id.and_then(|i| self.document.root.materials.get(i));
        let stem = context.path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let name = self.names.unique(given.and_then(|g| g.name.as_deref()).unwrap_or(&stem));
        let mut material = context.material(&name);
        let (Some(given), Some(id)) = (given, id) else {
            // The default material of glTF is white.
            material.base_color = [1.0; 3];
            return Ok(material);
        };
        let pbr = &given.pbr_metallic_roughness;
        // The factors multiply the pictures: below, they are applied to the pixels of those that exist.
        let [r, g, b, a] = pbr.base_color_factor.0.map(|v| v.clamp(0.0, 1.0));
        material.base_color = [r, g, b];
        material.roughness = pbr.roughness_factor.0.clamp(0.0, 1.0);
        material.double_sided |= given.double_sided;
        let ior = self.document.iors.get(&id).copied().filter(|n| (1.0..=3.0).contains(n));
        material.ior = ior.map_or(material.ior, math::narrow);
        let translucency = self.document.translucencies.get(&id).filter(|t| (0.0..=1.0).contains(*t));
        material.translucency = translucency.map_or(material.translucency, |t| math::narrow(*t));
        if let Some(texture) = &pbr.base_color_texture
            && let Some((image, channels)) = self.decoded_image(context, texture.index.value())?
        {
            material.alpha_cutoff = alpha_cutoff(given).filter(|_| channels == 4);
            // The alpha of an opaque material has no meaning; renderers that read it from the picture would show holes.
            let opaque = channels == 4 && material.alpha_cutoff.is_none();
            material.maps.color = self.store_map(context, image, MapUse::color([r, g, b, a], opaque), &name)?;
            if material.maps.color.is_some() {
                material.base_color = [1.0; 3];
            }
        }
        if let Some(texture) = &pbr.metallic_roughness_texture
            && let Some((image, _)) = self.decoded_image(context, texture.index.value())?
        {
            material.maps.roughness = self.store_map(context, image, MapUse::roughness(material.roughness), &name)?;
        }
        if let Some(texture) = &given.normal_texture
            && let Some((image, _)) = self.decoded_image(context, texture.index.value())?.filter(|n| n.1 >= 3)
        {
            material.maps.normal = self.store_map(context, image, MapUse::Normal, &name)?;
        }
        Ok(material)
    }

    /// Stores an image as a map, named after the first material that uses it.
    fn store_map(
        &mut self,
        context: &ImportContext<'_>,
        image: usize,
        map_use: MapUse,
        name: &str,
    ) -> ImportResult<Option<u32>> {
        // Materials with the same image and factors share a map.
        if let Some(index_of) = self.cache.find(image, map_use) {
            return Ok(Some(index_of));
        }
        let bytes = self.cache.additional_bytes(image, map_use);
        images::spend(context, &format!("images[{image}]"), bytes, &mut self.spent)?;
        Ok(self.cache.store(image, map_use, name))
    }

    /// Number and channels of the image of a texture, decoded; `None` if its file is absent.
    fn decoded_image(&mut self, context: &mut ImportContext<'_>, texture: usize) -> ImportResult<Option<(usize, u8)>> {
        let Some(index) = self.document.root.textures.get(texture).map(|t| t.source.value()) else { return Ok(None) };
        if !self.cache.contains(index) {
            let place = format!("images[{index}]");
            let raw: Option<DecodedImage> = match self.encoded_bytes(context, index, &place)? {
                Some(bytes) => Some(images::decode(context, &place, &bytes, &mut self.spent)?),
                None => None,
            };
            self.cache.add(index, raw);
        }
        Ok(self.cache.channels(index).map(|channels| (index, channels)))
    }

    /// The encoded bytes of an image: of a buffer view, a data URI or a file.
    fn encoded_bytes(
        &self,
        context: &mut ImportContext<'_>,
        index: usize,
        place: &str,
    ) -> ImportResult<Option<Vec<u8>>> {
        let root = &self.document.root;
        let Some(image) = root.images.get(index) else { return Ok(None) };
        let limit = context.options.limits.get("mesh-bytes");
        if let Some(view) = image.buffer_view.filter(|v| v.value() < root.buffer_views.len()) {
            let bytes = self
                .buffers
                .view(self.document, view.value())
                .ok_or_else(|| context.error_in_file("X010", format_args!("{place} passes the end of its buffer")))?;
            return Ok(Some(bytes.to_vec()));
        }
        match &image.uri {
            Some(uri) if uri.starts_with("data:") => resource(context, place, uri, limit).map(Some),
            Some(uri) => context.image_bytes(context.options.roots.read_uri(context.path, uri, limit)),
            None => Err(context.error_in_file("X010", format_args!("{place} has neither a uri nor a bufferView"))),
        }
    }

    pub(super) fn finish(self) -> FinishedMaterials {
        let Self { materials, wraps, cache, spent, .. } = self;
        FinishedMaterials { materials, images: cache.finish(), wraps, spent }
    }
}

/// Alpha cutoff of a material; blended materials, as which leaves are often exported, are cut at 0.5.
fn alpha_cutoff(given: &Given) -> Option<f32> {
    match &given.alpha_mode {
        Checked::Valid(AlphaMode::Opaque) | Checked::Invalid => None,
        Checked::Valid(AlphaMode::Mask) => Some(given.alpha_cutoff.as_ref().map_or(0.5, |c| c.0.clamp(0.0, 1.0))),
        Checked::Valid(AlphaMode::Blend) => Some(0.5),
    }
}
