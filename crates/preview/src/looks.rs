//! Materials with their pictures, ready to be asked.

use glam::{Vec2, Vec3};

use super::quality::Quality;
use super::texture::{Decoder, Texture};
use osier_base::par::par_map;
use osier_scene::{Image, Material, MaterialClass, MaterialId, Scene};

/// All materials of a scene. Made once; frames share it.
#[derive(Debug)]
pub struct Looks {
    materials: Vec<Material>,
    textures: Vec<Option<Texture>>,
    decoder: Decoder,
    /// How well the pictures are to be.
    pub(super) quality: Quality,
}

/// What light meets at a place.
#[derive(Debug, Clone, Copy)]
pub(super) struct ShadingParams {
    /// Linear colour: share of light that is scattered.
    pub(super) albedo: Vec3,
    /// 0 mirror .. 1 matt.
    pub(super) roughness: f32,
    /// Reflected share at normal incidence.
    pub(super) f0: f32,
    /// PrimitiveRange of the scattered light that leaves on the other side.
    pub(super) translucency: f32,
    /// Refracts.
    pub(super) water: bool,
}

impl Looks {
    /// Reads a scene's materials; maps wider than [`Quality::texture_side`] are read at a smaller size.
    pub fn new(scene: &Scene, quality: Quality) -> Self {
        let side = quality.texture_side();
        let decoder = Decoder::default();
        let used =
            |i: u32| scene.materials.iter().any(|m| [m.maps.color, m.maps.normal, m.maps.roughness].contains(&Some(i)));
        let cutoff = |i: u32| scene.materials.iter().filter(|m| m.maps.color == Some(i)).find_map(|m| m.alpha_cutoff);
        let wanted: Vec<_> = (0_u32..).zip(&scene.images).map(|(i, m)| used(i).then_some((m, cutoff(i)))).collect();
        let made = |(image, cutoff): (&Image, Option<f32>)| Texture::new(image, side, cutoff, &decoder);
        let textures = par_map(&wanted, |wanted| wanted.map(made));
        Self { materials: scene.materials.clone(), textures, decoder, quality }
    }

    fn material(&self, id: MaterialId) -> Option<&Material> {
        self.materials.get(id as usize)
    }

    fn texture(&self, map: Option<u32>) -> Option<&Texture> {
        self.textures.get(map? as usize)?.as_ref()
    }

    /// True if a map decides where the material is.
    pub(super) fn is_cut(&self, id: MaterialId) -> bool {
        self.material(id).is_some_and(|m| m.alpha_cutoff.is_some() && m.maps.color.is_some())
    }

    /// False where the material is cut out; `uv` is asked only if a map decides. `footprint`: width of the smallest detail
    /// that is seen, in texture coordinates.
    #[inline]
    pub(super) fn is_kept(&self, id: MaterialId, footprint: f32, uv: impl FnOnce() -> Vec2) -> bool {
        !self.is_cut(id) || self.is_there(id, footprint, uv())
    }

    /// True if rays are cast: water bends what is seen, so even a draft of it needs them.
    pub(super) fn casts_rays(&self) -> bool {
        self.quality != Quality::Draft || self.materials.iter().any(|m| m.class == MaterialClass::Water)
    }

    /// False where the material is cut out.
    fn is_there(&self, id: MaterialId, footprint: f32, uv: Vec2) -> bool {
        let Some(m) = self.material(id) else { return true };
        match (m.alpha_cutoff, self.texture(m.maps.color)) {
            (Some(cutoff), Some(texture)) => texture.at(uv, footprint, &self.decoder).w >= cutoff,
            _ => true,
        }
    }

    /// Mean colour of a material.
    pub(super) fn mean(&self, id: MaterialId) -> Vec3 {
        let Some(m) = self.material(id) else { return Vec3::splat(0.5) };
        if m.class == MaterialClass::Water {
            return Vec3::splat(0.9);
        }
        self.texture(m.maps.color).map_or(Vec3::from_array(m.base_color), |t| t.mean.truncate())
    }

    /// The finish at a place. `footprint`: width of the sample in texture coordinates.
    pub(super) fn finish(&self, id: MaterialId, uv: Vec2, footprint: f32) -> ShadingParams {
        let Some(m) = self.material(id) else {
            return ShadingParams {
                albedo: Vec3::splat(0.5),
                roughness: 1.0,
                f0: 0.0,
                translucency: 0.0,
                water: false,
            };
        };
        let fine = self.shows_detail(footprint);
        let look = |map| self.texture(map).map(|t| t.at(uv, footprint, &self.decoder));
        let f = (m.ior - 1.0) / (m.ior + 1.0);
        ShadingParams {
            albedo: look(m.maps.color).map_or(Vec3::from_array(m.base_color), glam::Vec4::truncate),
            roughness: look(m.maps.roughness.filter(|_| fine)).map_or(m.roughness, |t| t.x),
            f0: f * f,
            translucency: m.translucency.clamp(0.0, 1.0),
            water: m.class == MaterialClass::Water,
        }
    }

    /// False in drafts where all of a texture is a few pixels of the picture: there its mean relief and gloss will do.
    fn shows_detail(&self, footprint: f32) -> bool {
        const FEW: f32 = 64.0;
        self.quality != Quality::Draft || footprint * FEW < 1.0
    }

    /// Relief: the normal in tangent space, or none without a map.
    pub(super) fn relief(&self, id: MaterialId, uv: Vec2, footprint: f32) -> Option<Vec3> {
        let m = self.material(id).filter(|_| self.shows_detail(footprint))?;
        let n = self.texture(m.maps.normal)?.at(uv, footprint, &self.decoder).truncate() * 2.0 - 1.0;
        Some(osier_base::math::normalize_or(n, Vec3::Z))
    }

    /// PrimitiveRange of the sun's light that goes on past a hair that it meets: what a translucent hair lets through, and half of
    /// what it sends back, which its neighbours send on. Without this a white tuft is dark inside.
    pub(super) fn passes(&self, id: MaterialId) -> f32 {
        let Some(m) = self.material(id).filter(|m| m.translucency > 0.0) else { return 0.0 };
        let [r, g, b] = m.base_color;
        let t = m.translucency.clamp(0.0, 1.0);
        (r + g + b) / 3.0 * (t + 0.5 * (1.0 - t))
    }

    /// True of what bends light and casts no shadow.
    pub(super) fn is_water(&self, id: MaterialId) -> bool {
        self.material(id).is_some_and(|m| m.class == MaterialClass::Water)
    }

    /// Index of refraction.
    pub(super) fn ior(&self, id: MaterialId) -> f32 {
        self.material(id).map_or(osier_base::physics::WATER_IOR, |m| m.ior)
    }
}
