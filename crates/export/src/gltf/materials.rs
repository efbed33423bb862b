//! Surfaces as metallic-roughness materials, pictures embedded or beside the file.

use super::buffer::last;
use super::document::Document;
use super::json::{
    Image, Index, Ior, Material, MaterialExtensions, Pbr, Texture, TextureRef, TextureSampler, Transmission, Volume,
};
use super::{Pictures, Profile, percent};
use crate::textures::jpeg;
use osier_base::Result;
use osier_scene::{Asset, Instancer, MaterialClass, MaterialId, Mesh, Scene};

/// A material as some kind of geometry shows it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Surface {
    pub material: MaterialId,
    pub shown: Shown,
}

/// What shows a material.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Shown {
    /// A mesh.
    Mesh,
    /// A flat ribbon: visible from both sides.
    Ribbon,
    /// Points with a colour each: no pictures, no colour of its own.
    Colored,
    /// Points without colours: no pictures.
    Plain,
}

const MAG_LINEAR: u32 = 9729;
const MIN_LINEAR_MIPMAP_LINEAR: u32 = 9987;

/// True if the material needs texture coordinates.
pub(super) fn textured(scene: &Scene, material: MaterialId) -> bool {
    let maps = scene.materials.get(material as usize).map(|m| m.maps).unwrap_or_default();
    maps.color.is_some() || maps.normal.is_some() || maps.roughness.is_some()
}

/// True if the material has a normal map.
pub(super) fn relief(scene: &Scene, material: MaterialId) -> bool {
    scene.materials.get(material as usize).is_some_and(|m| m.maps.normal.is_some())
}

impl Document<'_> {
    /// Index of a surface in the file; `None` for a material that the scene does not have.
    pub(super) fn surface(&mut self, surface: Surface) -> Result<Option<Index>> {
        if let Some(index) = self.surfaces.get(&surface) {
            return Ok(Some(*index));
        }
        let scene = self.from.scene;
        let Some(source) = scene.materials.get(surface.material as usize) else { return Ok(None) };
        let material = self.material(source, surface)?;
        self.root.materials.push(material);
        let index = last(self.root.materials.len())?;
        self.surfaces.insert(surface, index);
        Ok(Some(index))
    }

    fn material(&mut self, source: &osier_scene::Material, surface: Surface) -> Result<Material> {
        let pictures = matches!(surface.shown, Shown::Mesh | Shown::Ribbon);
        let maps = if pictures { source.maps } else { osier_scene::Maps::default() };
        let name = match surface.shown {
            Shown::Mesh => source.name.clone(),
            Shown::Ribbon => format!("{}_ribbon", source.name),
            Shown::Colored | Shown::Plain => format!("{}_points", source.name),
        };
        let white = maps.color.is_some() || surface.shown == Shown::Colored;
        let [r, g, b] = source.base_color;
        let rough = if maps.roughness.is_some() { 1.0 } else { source.roughness };
        let pbr_metallic_roughness = Pbr {
            base_color_factor: (!white && source.base_color.iter().any(|c| differs(*c, 1.0))).then_some([r, g, b, 1.0]),
            base_color_texture: self.texture(maps.color)?,
            metallic_factor: 0.0,
            roughness_factor: differs(rough, 1.0).then_some(rough),
            metallic_roughness_texture: self.texture(maps.roughness)?,
        };
        let cutoff = source.alpha_cutoff.filter(|_| maps.color.is_some());
        let solid = pictures && source.class == MaterialClass::Water;
        Ok(Material {
            name,
            pbr_metallic_roughness,
            normal_texture: self.texture(maps.normal)?,
            alpha_mode: cutoff.map(|_| "MASK"),
            alpha_cutoff: cutoff.filter(|c| differs(*c, 0.5)),
            double_sided: source.double_sided || surface.shown == Shown::Ribbon,
            extensions: if solid { self.water(source, surface.material) } else { MaterialExtensions::default() },
        })
    }

    fn water(&mut self, source: &osier_scene::Material, id: MaterialId) -> MaterialExtensions {
        for extension in ["KHR_materials_ior", "KHR_materials_transmission", "KHR_materials_volume"] {
            self.uses(extension, false);
        }
        MaterialExtensions {
            ior: Some(Ior { ior: source.ior }),
            transmission: Some(Transmission { transmission_factor: 1.0 }),
            volume: Some(Volume {
                thickness_factor: mean_height(self.from.scene, id),
                attenuation_distance: 1.0,
                attenuation_color: [0.9, 0.95, 1.0],
            }),
        }
    }

    fn texture(&mut self, image: Option<u32>) -> Result<Option<TextureRef>> {
        let Some(image) = image else { return Ok(None) };
        if let Some(index) = self.textures.get(&image) {
            return Ok(Some(TextureRef { index: *index }));
        }
        let Some(source) = self.from.scene.images.get(image as usize) else { return Ok(None) };
        let name = source.name.clone();
        let entry = match &mut self.pictures {
            Pictures::Inside => {
                let small = if self.from.profile == Profile::Web { jpeg(source)? } else { None };
                let mime_type = Some(if small.is_some() { "image/jpeg" } else { "image/png" });
                let bytes = small.as_deref().unwrap_or(self.from.textures.png(image));
                Image { name, uri: None, mime_type, buffer_view: Some(self.buffer.file(bytes)?) }
            }
            Pictures::Beside { folder, written } => {
                let path = format!("{folder}/{name}.png");
                let uri = Some(percent(&path));
                written.push((name.clone(), image));
                Image { name, uri, mime_type: None, buffer_view: None }
            }
        };
        self.root.images.push(entry);
        if self.root.samplers.is_empty() {
            self.root.samplers.push(TextureSampler { mag_filter: MAG_LINEAR, min_filter: MIN_LINEAR_MIPMAP_LINEAR });
        }
        self.root.textures.push(Texture { sampler: 0, source: last(self.root.images.len())? });
        let index = last(self.root.textures.len())?;
        self.textures.insert(image, index);
        Ok(Some(TextureRef { index }))
    }
}

/// True unless the value is the very default, which is then left out.
fn differs(value: f32, default: f32) -> bool {
    value.to_bits() != default.to_bits()
}

/// Mean height of everything that shows a material, m: meshes count once, instances each with their scale.
/// Own: the thickness that light passes in a drop, for viewers that do not trace it.
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
