//! Materials with decoded textures, evaluated at texture coordinates.

use glam::{Vec2, Vec3};

use super::quality::Quality;
use super::texture::{Decoder, Texture};
use osier_base::par::par_map;
use osier_scene::{Image, Material, MaterialClass, MaterialId, Scene};

/// All materials of a scene with their textures, shared by all frames.
#[derive(Debug)]
pub struct PreviewMaterials {
    materials: Vec<Material>,
    textures: Vec<Option<Texture>>,
    decoder: Decoder,
    /// Quality of the pictures that the textures were decoded for.
    pub(super) quality: Quality,
}

/// A place in a texture at which alpha is tested.
#[derive(Debug, Clone, Copy)]
pub(super) struct AlphaSample {
    /// Texture coordinates.
    pub(super) uv: Vec2,
    /// Width of the smallest visible detail in texture coordinates.
    pub(super) footprint: f32,
}

/// Parameters of the scattering model at one point of a surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct ShadingParams {
    /// Linear colour: fraction of light that is scattered.
    pub(super) albedo: Vec3,
    /// 0 is a mirror, 1 is matt.
    pub(super) roughness: f32,
    /// Reflectance at normal incidence.
    pub(super) f0: f32,
    /// Fraction of the scattered light that leaves on the other side.
    pub(super) translucency: f32,
    /// True for water, which refracts instead of scattering.
    pub(super) water: bool,
}

impl PreviewMaterials {
    /// Decodes the textures of a scene's materials; maps wider than [`Quality::texture_side`] are reduced.
    pub fn new(scene: &Scene, quality: Quality) -> Self {
        let side = quality.texture_side();
        let decoder = Decoder::default();
        // Textures that no material uses are not decoded. The alpha cutoff belongs to the material,
        // but its mipmaps depend on it.
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

    /// Whether the alpha of its colour texture cuts parts out of the material.
    pub(super) fn has_alpha_cutout(&self, id: MaterialId) -> bool {
        self.material(id).is_some_and(|m| m.alpha_cutoff.is_some() && m.maps.color.is_some())
    }

    /// False where the alpha of a texture cuts the material out; `sample` is evaluated only if it has one.
    #[inline]
    pub(super) fn is_opaque_at(&self, id: MaterialId, sample: impl FnOnce() -> AlphaSample) -> bool {
        !self.has_alpha_cutout(id) || self.passes_alpha_test(id, sample())
    }

    /// True if pictures are ray traced: refraction by water needs rays even in a draft.
    pub(super) fn needs_rays(&self) -> bool {
        self.quality != Quality::Draft || self.materials.iter().any(|m| m.class == MaterialClass::Water)
    }

    fn passes_alpha_test(&self, id: MaterialId, sample: AlphaSample) -> bool {
        let Some(m) = self.material(id) else { return true };
        match (m.alpha_cutoff, self.texture(m.maps.color)) {
            (Some(cutoff), Some(texture)) => texture.at(sample.uv, sample.footprint, &self.decoder).w >= cutoff,
            _ => true,
        }
    }

    /// Linear mean colour of a material's texture; without a texture its base colour, and light grey for water.
    pub(super) fn mean_color(&self, id: MaterialId) -> Vec3 {
        let Some(m) = self.material(id) else { return Vec3::splat(0.5) };
        // Water has no base colour; most of the light from it is that of the bright sky.
        if m.class == MaterialClass::Water {
            return Vec3::splat(0.9);
        }
        self.texture(m.maps.color).map_or(Vec3::from_array(m.base_color), |t| t.mean.truncate())
    }

    /// Scattering parameters at texture coordinates. `footprint`: width of the sample in texture coordinates.
    pub(super) fn shading(&self, id: MaterialId, uv: Vec2, footprint: f32) -> ShadingParams {
        let Some(m) = self.material(id) else {
            return ShadingParams {
                albedo: Vec3::splat(0.5),
                roughness: 1.0,
                f0: 0.0,
                translucency: 0.0,
                water: false,
            };
        };
        let is_detailed = self.shows_detail(footprint);
        let sample = |map| self.texture(map).map(|t| t.at(uv, footprint, &self.decoder));
        // Fresnel reflectance at normal incidence, ((n - 1) / (n + 1))^2.
        let f = (m.ior - 1.0) / (m.ior + 1.0);
        ShadingParams {
            albedo: sample(m.maps.color).map_or(Vec3::from_array(m.base_color), glam::Vec4::truncate),
            roughness: sample(m.maps.roughness.filter(|_| is_detailed)).map_or(m.roughness, |t| t.x),
            f0: f * f,
            translucency: m.translucency.clamp(0.0, 1.0),
            water: m.class == MaterialClass::Water,
        }
    }

    /// False in drafts where the whole texture covers few pixels: the mean normal and roughness are then as good.
    fn shows_detail(&self, footprint: f32) -> bool {
        /// Width below which a texture counts as small, pixels.
        const SMALL_TEXTURE_PIXELS: f32 = 64.0;
        self.quality != Quality::Draft || footprint * SMALL_TEXTURE_PIXELS < 1.0
    }

    /// Unit normal in tangent space from the normal map, `None` without one.
    pub(super) fn normal_map(&self, id: MaterialId, uv: Vec2, footprint: f32) -> Option<Vec3> {
        let m = self.material(id).filter(|_| self.shows_detail(footprint))?;
        let n = self.texture(m.maps.normal)?.at(uv, footprint, &self.decoder).truncate() * 2.0 - 1.0;
        Some(osier_base::math::normalize_or(n, Vec3::Z))
    }

    /// Fraction of sunlight that continues past a hair in its way: what a translucent hair transmits, and half of
    /// what it scatters back, which its neighbours scatter forward again. Without this the inside of a white tuft is
    /// dark.
    pub(super) fn hair_transmittance(&self, id: MaterialId) -> f32 {
        let Some(m) = self.material(id).filter(|m| m.translucency > 0.0) else { return 0.0 };
        // Mean albedo times (translucency + half of the reflected rest).
        let [r, g, b] = m.base_color;
        let t = m.translucency.clamp(0.0, 1.0);
        (r + g + b) / 3.0 * (t + 0.5 * (1.0 - t))
    }

    /// Whether a material is water, which refracts light and casts no shadow.
    pub(super) fn is_water(&self, id: MaterialId) -> bool {
        self.material(id).is_some_and(|m| m.class == MaterialClass::Water)
    }

    /// Index of refraction; that of water for an unknown material.
    pub(super) fn ior(&self, id: MaterialId) -> f32 {
        self.material(id).map_or(osier_base::physics::WATER_IOR, |m| m.ior)
    }
}
