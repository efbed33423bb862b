//! Metallic-roughness materials and their textures, whose images are embedded or files beside the document.

use super::buffer::last_index;
use super::document::{GeometryKind, GltfDocument, MaterialVariant};
use super::json::{
    DiffuseTransmission, Image, Index, Ior, Material, MaterialExtensions, Pbr, Texture, TextureRef, TextureSampler,
    Transmission, Volume,
};
use super::{ImageStorage, Profile, percent_encode};
use crate::textures::jpeg;
use osier_base::Result;
use osier_scene::{Asset, Instancer, MaterialClass, MaterialId, Mesh, Scene};

const MAG_LINEAR: u32 = 9729;
const MIN_LINEAR_MIPMAP_LINEAR: u32 = 9987;

/// Whether a material has a colour, normal or roughness map; without one, texture coordinates are omitted.
pub(super) fn uses_uvs(scene: &Scene, material: MaterialId) -> bool {
    let maps = scene.materials.get(material as usize).map(|m| m.maps).unwrap_or_default();
    maps.color.is_some() || maps.normal.is_some() || maps.roughness.is_some()
}

/// Whether the variant of a material has a normal map, for which vertices get tangents.
pub(super) fn has_normal_map(scene: &Scene, variant: MaterialVariant) -> bool {
    let material = scene.materials.get(variant.material as usize);
    material.is_some_and(|m| m.maps.normal.is_some() && !is_thinned_leaf(m, variant.geometry))
}

/// Whether a material belongs to leaves that are thinned out and enlarged.
fn is_thinned_leaf(material: &osier_scene::Material, geometry: GeometryKind) -> bool {
    geometry == GeometryKind::ThinnedPlant && material.class == MaterialClass::Leaf
}

impl GltfDocument<'_> {
    /// Index of the glTF material of a variant, added at first use; `None` if the scene has no such material.
    pub(super) fn material_index(&mut self, variant: MaterialVariant) -> Result<Option<Index>> {
        if let Some(index) = self.material_indices.get(&variant) {
            return Ok(Some(*index));
        }
        let scene = self.input.scene;
        let Some(source) = scene.materials.get(variant.material as usize) else { return Ok(None) };
        let material = self.build_material(source, variant)?;
        self.root.materials.push(material);
        let index = last_index(self.root.materials.len())?;
        self.material_indices.insert(variant, index);
        Ok(Some(index))
    }

    fn build_material(&mut self, source: &osier_scene::Material, variant: MaterialVariant) -> Result<Material> {
        let shows_maps =
            matches!(variant.geometry, GeometryKind::Mesh | GeometryKind::ThinnedPlant | GeometryKind::Ribbon);
        let mut maps = if shows_maps { source.maps } else { osier_scene::Maps::default() };
        if is_thinned_leaf(source, variant.geometry) {
            maps.normal = None;
        }
        let name = match variant.geometry {
            GeometryKind::Mesh | GeometryKind::ThinnedPlant => source.name.clone(),
            GeometryKind::Ribbon => format!("{}_ribbon", source.name),
            GeometryKind::ColoredPoints | GeometryKind::PlainPoints => format!("{}_points", source.name),
        };
        // The factor multiplies vertex colours, too, so it is left at white for points that have colours.
        let factor_is_white = maps.color.is_some() || variant.geometry == GeometryKind::ColoredPoints;
        // A factor multiplies its texture, so it is 1 if there is one; values that equal the schema's default are
        // omitted.
        let [r, g, b] = source.base_color;
        let rough = if maps.roughness.is_some() { 1.0 } else { source.roughness };
        let pbr_metallic_roughness = Pbr {
            base_color_factor: (!factor_is_white && source.base_color.iter().any(|c| is_not_default(*c, 1.0)))
                .then_some([r, g, b, 1.0]),
            base_color_texture: self.texture_ref(maps.color)?,
            metallic_factor: 0.0,
            roughness_factor: is_not_default(rough, 1.0).then_some(rough),
            metallic_roughness_texture: self.texture_ref(maps.roughness)?,
        };
        // A cutoff applies to the alpha of the colour texture and has no effect without one.
        let cutoff = source.alpha_cutoff.filter(|_| maps.color.is_some());
        // Points show no texture, and neither refract nor transmit light.
        let is_water = shows_maps && source.class == MaterialClass::Water;
        Ok(Material {
            name,
            pbr_metallic_roughness,
            normal_texture: self.texture_ref(maps.normal)?,
            alpha_mode: cutoff.map(|_| "MASK"),
            alpha_cutoff: cutoff.filter(|c| is_not_default(*c, 0.5)),
            double_sided: source.double_sided || variant.geometry == GeometryKind::Ribbon,
            extensions: if is_water {
                self.water_extensions(source, variant.material)
            } else if shows_maps && source.translucency > 0.0 {
                self.translucent_extensions(source)?
            } else {
                MaterialExtensions::default()
            },
        })
    }

    /// A leaf reflects the share 1 - t of diffuse light in its colour and transmits the share t, its translucency, in the same
    /// colour.
    fn translucent_extensions(&mut self, source: &osier_scene::Material) -> Result<MaterialExtensions> {
        self.use_extension("KHR_materials_diffuse_transmission", false);
        // As with the base colour, the factor stays at its default of 1 if there is a texture.
        let textured = source.maps.color.is_some();
        Ok(MaterialExtensions {
            diffuse_transmission: Some(DiffuseTransmission {
                diffuse_transmission_factor: source.translucency.min(1.0),
                diffuse_transmission_color_factor: (!textured).then_some(source.base_color),
                diffuse_transmission_color_texture: self.texture_ref(source.maps.color)?,
            }),
            ..MaterialExtensions::default()
        })
    }

    fn water_extensions(&mut self, source: &osier_scene::Material, id: MaterialId) -> MaterialExtensions {
        for extension in ["KHR_materials_ior", "KHR_materials_transmission", "KHR_materials_volume"] {
            self.use_extension(extension, false);
        }
        MaterialExtensions {
            diffuse_transmission: None,
            ior: Some(Ior { ior: source.ior }),
            transmission: Some(Transmission { transmission_factor: 1.0 }),
            volume: Some(Volume {
                thickness_factor: mean_height(self.input.scene, id),
                attenuation_distance: 1.0,
                attenuation_color: [0.9, 0.95, 1.0],
            }),
        }
    }

    fn texture_ref(&mut self, image: Option<u32>) -> Result<Option<TextureRef>> {
        let Some(image) = image else { return Ok(None) };
        if let Some(index) = self.texture_indices.get(&image) {
            return Ok(Some(TextureRef { index: *index }));
        }
        let Some(source) = self.input.scene.images.get(image as usize) else { return Ok(None) };
        let name = source.name.clone();
        let entry = match &mut self.pictures {
            ImageStorage::Embedded => {
                // JPEG where the image has no alpha; the others stay PNG.
                let small = if self.input.options.profile != Profile::Blender { jpeg(source)? } else { None };
                let mime_type = Some(if small.is_some() { "image/jpeg" } else { "image/png" });
                let bytes = small.as_deref().unwrap_or(self.input.textures.png(image));
                Image { name, uri: None, mime_type, buffer_view: Some(self.buffer.add_file(bytes)?) }
            }
            ImageStorage::Files { folder, written } => {
                let path = format!("{folder}/{name}.png");
                let uri = Some(percent_encode(&path));
                written.push((name.clone(), image));
                Image { name, uri, mime_type: None, buffer_view: None }
            }
        };
        self.root.images.push(entry);
        if self.root.samplers.is_empty() {
            self.root.samplers.push(TextureSampler { mag_filter: MAG_LINEAR, min_filter: MIN_LINEAR_MIPMAP_LINEAR });
        }
        self.root.textures.push(Texture { sampler: 0, source: last_index(self.root.images.len())? });
        let index = last_index(self.root.textures.len())?;
        self.texture_indices.insert(image, index);
        Ok(Some(TextureRef { index }))
    }
}

/// Whether a value must be written: a value that equals the format's default bit for bit is omitted.
fn is_not_default(value: f32, default: f32) -> bool {
    value.to_bits() != default.to_bits()
}

/// Mean height of all geometry of a material, m: each mesh counts once, each instance with its scale.
/// Own: as `thicknessFactor` of KHR_materials_volume, an approximation of the distance that light travels in a drop.
fn mean_height(scene: &Scene, material: MaterialId) -> f32 {
    let (mut sum, mut count) = (0.0_f64, 0_u32);
    let shows = |mesh: &Mesh| mesh.subsets.iter().any(|s| s.material == material && s.count > 0);
    let mut add = |height: f32| {
        sum += f64::from(height);
        count += 1;
    };
    for asset in &scene.assets {
        asset.meshes.iter().filter(|o| shows(&o.mesh)).for_each(|o| add(o.mesh.bounds().size().y));
        instanced_heights(asset, &shows).for_each(&mut add);
    }
    if count == 0 { 0.0 } else { osier_base::math::narrow(sum / f64::from(count)) }
}

/// Heights of the instances whose prototype uses the material, m.
fn instanced_heights<'a>(asset: &'a Asset, shows: &'a impl Fn(&Mesh) -> bool) -> impl Iterator<Item = f32> + 'a {
    let of = |instancer: &'a Instancer| {
        let height = |p: &osier_scene::Prototype| shows(&p.mesh).then(|| p.mesh.bounds().size().y);
        let heights: Vec<Option<f32>> = instancer.prototypes.iter().map(height).collect();
        instancer
            .protos
            .iter()
            .zip(&instancer.scales)
            .filter_map(move |(p, s)| heights.get(*p as usize).copied().flatten().map(|h| h * s.y))
    };
    asset.instancers.iter().flat_map(of)
}
