//! Light transport: the radiance that surfaces send to the camera, by direct light of sun and sky and one diffuse
//! bounce; water refracts and reflects recursively.

use glam::Vec3;

use super::light::{Light, sample_cosine};
use super::materials::ShadingParams;
use super::quality::LightDepth;
use super::render_scene::{RenderScene, SceneHit, ray};
use super::sampler::Sampler;
use super::surface::SurfaceInteraction;
use osier_base::math;

/// Most refractions and reflections of a path; beyond them it is assumed to reach the sky.
const MAX_DEPTH: u32 = 6;
/// Radiance of one sample at most. Clamping loses the energy of rare fireflies: a glint on water is bright, not a
/// speck of noise.
const MAX_SAMPLE_RADIANCE: f32 = 6.0;
/// Visible fraction of sky and sun around a point, assumed where no ray tests it. Own: chosen by eye.
const SURROUNDINGS_OPENNESS: f32 = 0.3;
/// Visible fraction of the sky, assumed where it is not looked up. Own: chosen by eye.
const DEFAULT_SKY_VISIBILITY: f32 = 0.8;
/// Rays to the sky for each sample of the floor.
const FLOOR_SKY_RAYS: u32 = 4;
/// Sample dimensions reserved for each depth of the path.
const DIMENSIONS_PER_DEPTH: u32 = 8;
/// Mean cosine at which light from one side meets the visible half of a hair, over all directions of hairs.
const MEAN_HAIR_COSINE: f32 = 0.4;

/// Parameters of one sample of a pixel.
#[derive(Debug, Clone, Copy)]
pub(super) struct SampleContext<'a> {
    pub(super) sampler: &'a Sampler,
    pub(super) index: u32,
    /// Width of the sample at unit distance.
    pub(super) spread: f32,
    /// Which occluders and bounces of light are traced.
    pub(super) light_depth: LightDepth,
    /// Whether a ray samples ambient light; false if other samples of the pixel have determined it well enough.
    pub(super) samples_ambient: bool,
    /// Visibility of sun and sky, if it was computed beforehand.
    pub(super) precomputed: Option<PrecomputedLight>,
}

/// Light that reaches a point, looked up without rays.
#[derive(Debug, Clone, Copy)]
pub(super) struct PrecomputedLight {
    /// Whether the middle of the sun is visible.
    pub(super) sun: bool,
    /// Fraction of the sky that is visible, 0 to 1.
    pub(super) sky: f32,
}

/// Radiance towards the viewer in two parts. The ambient part is noisy with few samples but smooth over a surface, so
/// a picture may share it between pixels.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ScatteredLight {
    /// From the sun, from mirror reflections and from haze.
    pub(super) direct: Vec3,
    /// Fraction of `ambient` that is scattered towards the viewer.
    pub(super) diffuse: Vec3,
    /// Radiance of the sky, or of its occluder, from one random direction.
    pub(super) ambient: Vec3,
    /// 1 if `ambient` was sampled, else 0.
    pub(super) ambient_samples: f32,
    /// Index of the instance that the camera ray hit, for the filter of ambient light.
    pub(super) instance: u32,
}

impl ScatteredLight {
    pub(super) fn radiance(self) -> Vec3 {
        self.direct + self.diffuse * self.ambient
    }
}

/// Light of sun and sky that a white, level floor reflects.
struct FloorLight {
    sun: Vec3,
    sky: Vec3,
}

impl RenderScene<'_> {
    /// Radiance towards the viewer along a ray, if it hits anything before `far`, in lengths of the direction.
    pub(super) fn radiance(
        &self,
        light: &Light,
        origin: Vec3,
        direction: Vec3,
        far: f32,
        sample: &SampleContext<'_>,
    ) -> Option<ScatteredLight> {
        LightPath { world: self, light, sample, depth: 0 }.trace(origin, direction, far)
    }

    /// Radiance that the surface at the hit of a camera ray scatters to the camera.
    pub(super) fn shade(
        &self,
        light: &Light,
        origin: Vec3,
        direction: Vec3,
        hit: &SceneHit,
        sample: &SampleContext<'_>,
    ) -> Option<ScatteredLight> {
        LightPath { world: self, light, sample, depth: 0 }.scattered(origin, direction, hit)
    }

    /// Luminance of a point just above the floor relative to that of a floor without any object, about 0 to 1.
    pub(super) fn floor_light(&self, light: &Light, p: Vec3, sample: &SampleContext<'_>) -> f32 {
        let luminance = |c: Vec3| c.dot(Vec3::new(0.2126, 0.7152, 0.0722));
        let FloorLight { sun, sky } = self.light_on_floor(light, p, sample);
        let unshaded = luminance(light.open_sun() + light.mean_sky());
        if unshaded > 0.0 { luminance(sun + sky) / unshaded } else { 1.0 }
    }

    /// Light of sun and sky that reaches a white, level floor.
    fn light_on_floor(&self, light: &Light, p: Vec3, sample: &SampleContext<'_>) -> FloorLight {
        if let Some(known) = sample.precomputed {
            let sun = light.open_sun() * f32::from(u8::from(known.sun));
            return FloorLight { sun, sky: light.mean_sky() * known.sky };
        }
        let is_visible = |d: Vec3| self.is_unoccluded(ray(p, d, [0.0, f32::INFINITY]));
        let l = light.sample_sun(sample.sampler.point(sample.index, 1));
        let has_sun = l.y > 0.0 && light.sun_irradiance() != Vec3::ZERO && is_visible(l);
        let sun = if has_sun { light.open_sun() } else { Vec3::ZERO };
        // Paper has no texture that could hide noise, so each sample of it takes several rays to
        // the sky. With density cos / pi the estimate of the radiance is their plain mean.
        let rays = if sample.light_depth == LightDepth::Sun { 1 } else { FLOOR_SKY_RAYS };
        let sky = (0..rays).fold(Vec3::ZERO, |sum, i| {
            let d = sample_cosine(Vec3::Y, sample.sampler.point(sample.index * rays + i, 2));
            sum + if is_visible(d) { light.sky(d) } else { Vec3::ZERO }
        });
        #[allow(clippy::cast_precision_loss, reason = "a few")]
        let sky = sky / rays as f32;
        FloorLight { sun, sky }
    }
}

/// A path from the camera, at one of its vertices.
#[derive(Clone, Copy)]
struct LightPath<'p, 'w> {
    world: &'p RenderScene<'w>,
    light: &'p Light,
    sample: &'p SampleContext<'p>,
    /// Number of refractions and reflections so far.
    depth: u32,
}

impl LightPath<'_, '_> {
    /// Sample point of one of the dimensions of this depth.
    fn point(&self, dimension: u32) -> [f32; 2] {
        self.sample.sampler.point(self.sample.index, self.depth * DIMENSIONS_PER_DEPTH + dimension)
    }

    /// Origin of a ray that leaves the surface along `d`: offset along the geometric normal, so that the ray does not
    /// hit the surface that it starts from. Light that goes through a hair starts on its far side.
    fn offset_origin(&self, s: &SurfaceInteraction, d: Vec3) -> Vec3 {
        s.p + s.normal * if d.dot(s.normal) > 0.0 { self.world.gap } else { -self.world.gap - s.thickness }
    }

    fn is_unoccluded(&self, from: Vec3, d: Vec3) -> bool {
        self.world.is_unoccluded(ray(from, d, [0.0, f32::INFINITY]))
    }

    fn is_sunlit(&self, s: &SurfaceInteraction, l: Vec3) -> bool {
        self.sample.precomputed.map_or_else(|| self.is_unoccluded(self.offset_origin(s, l), l), |known| known.sun)
    }

    fn trace(&self, o: Vec3, d: Vec3, far: f32) -> Option<ScatteredLight> {
        self.scattered(o, d, &self.world.closest_hit(ray(o, d, [0.0, far]))?)
    }

    /// Radiance that the surface at a hit scatters towards the origin of the ray, with haze for camera rays.
    fn scattered(&self, o: Vec3, d: Vec3, hit: &SceneHit) -> Option<ScatteredLight> {
        let surface = self.world.surface(hit, o, d, self.sample.spread)?;
        let mut light = if surface.shading.water {
            ScatteredLight { direct: self.shade_water(d, &surface), ..ScatteredLight::default() }
        } else {
            self.shade_surface(d, &surface)
        };
        light.direct = light.direct.min(Vec3::splat(MAX_SAMPLE_RADIANCE));
        // Haze lies between camera and surface only; paths behind a refraction are too short for
        // it.
        if self.depth == 0 {
            let haze = self.light.haze(o, d, hit.primitive.t);
            light.direct = light.direct * haze.transmittance + haze.in_scattered;
            light.diffuse *= haze.transmittance;
        }
        light.instance = hit.instance;
        Some(light)
    }

    /// Light that an opaque or thin surface scatters against the direction `d`: a diffuse lobe, of which a fraction
    /// `translucency` leaves on the other side, under the gloss of a rough dielectric. The gloss reduces the diffuse lobe
    /// by the light that it reflects.
    fn shade_surface(&self, d: Vec3, s: &SurfaceInteraction) -> ScatteredLight {
        let f = &s.shading;
        let to_viewer = -math::normalize_or(d, Vec3::Z);
        // Mirror-like fraction: Fresnel reflectance, less the rougher the surface. Own: (1 - roughness)^2 approximates the
        // directional albedo of the microfacet lobe.
        let smoothness = 1.0 - f.roughness;
        let gloss = fresnel(f.f0, s.shading_normal.dot(to_viewer).max(0.0)) * smoothness * smoothness;
        let diffuse = f.albedo * (1.0 - gloss);
        let sun = self.sunlight(s, to_viewer, diffuse);
        if self.sample.light_depth == LightDepth::Sun {
            let sky = self.estimated_sky(s) * (diffuse + Vec3::splat(gloss));
            return ScatteredLight { direct: sun + sky, ..ScatteredLight::default() };
        }
        // One ambient ray serves both sides: its first coordinate chooses the side with probability
        // `translucency` and is then stretched to 0 to 1 again, so that it stays well distributed.
        let u = self.point(2);
        let is_transmitted = u[0] < f.translucency;
        let rescaled = if is_transmitted {
            u[0] / f.translucency
        } else {
            (u[0] - f.translucency) / (1.0 - f.translucency).max(1e-6)
        };
        let n = if is_transmitted { -s.shading_normal } else { s.shading_normal };
        let samples_ambient = self.sample.samples_ambient || self.depth > 0;
        let d = sample_cosine(n, [rescaled.clamp(0.0, 0.999_999), u[1]]);
        let ambient =
            if samples_ambient { self.incident(s, d).min(Vec3::splat(MAX_SAMPLE_RADIANCE)) } else { Vec3::ZERO };
        let ambient_samples = f32::from(u8::from(samples_ambient));
        // A rough gloss blurs its reflection about as much as the diffuse lobe does, so it uses the ambient sample; only a smooth
        // one in the best quality traces a separate mirror ray.
        let traces_mirror = gloss > 0.0 && self.sample.light_depth == LightDepth::Surroundings && f.roughness < 0.5;
        if !traces_mirror {
            let diffuse = diffuse + Vec3::splat(gloss);
            return ScatteredLight { direct: sun, diffuse, ambient, ambient_samples, ..ScatteredLight::default() };
        }
        let mirrored = math::normalize_or(
            s.shading_normal * (2.0 * s.shading_normal.dot(to_viewer)) - to_viewer,
            s.shading_normal,
        );
        let r = if mirrored.dot(s.normal) > 0.0 { mirrored } else { s.shading_normal };
        let direct = sun + self.incident(s, r) * gloss;
        ScatteredLight { direct, diffuse, ambient, ambient_samples, ..ScatteredLight::default() }
    }

    /// Light of the sky without a ray: the mean sky times 0.12 to 1 for normals from straight down to straight up. For a
    /// translucent surface, the other side counts as well.
    fn estimated_sky(&self, s: &SurfaceInteraction) -> Vec3 {
        let visibility = self.sample.precomputed.map_or(DEFAULT_SKY_VISIBILITY, |known| known.sky);
        let up = s.shading_normal.y * (1.0 - 2.0 * s.shading.translucency);
        self.light.mean_sky() * (visibility * (0.56 + 0.44 * up))
    }

    /// Radiance of sunlight that the surface scatters to the viewer.
    fn sunlight(&self, s: &SurfaceInteraction, to_viewer: Vec3, diffuse: Vec3) -> Vec3 {
        let light = self.light;
        let l = if self.sample.precomputed.is_some() { light.sun_direction() } else { light.sample_sun(self.point(1)) };
        // Reflected if the sun is on the viewer's side for both normals, transmitted if it is on
        // the far side for both.
        let (cos, is_front) = (s.shading_normal.dot(l), s.normal.dot(l) > 0.0);
        let fraction = match (cos > 0.0, is_front) {
            (true, true) => 1.0 - s.shading.translucency,
            (false, false) => s.shading.translucency,
            _ => 0.0,
        };
        if light.sun_irradiance() == Vec3::ZERO
            || (fraction <= 0.0 && !(is_front && cos > 0.0))
            || !self.is_sunlit(s, l)
        {
            return Vec3::ZERO;
        }
        let mut brdf = diffuse * (fraction * std::f32::consts::FRAC_1_PI);
        if is_front {
            brdf += Vec3::splat(ggx_specular(&s.shading, s.shading_normal, to_viewer, l));
        }
        // In a tuft half of the light has been scattered by neighbouring hairs and no longer comes
        // from the sun's direction.
        let cosine = if s.thickness > 0.0 { 0.5 * (cos.abs() + MEAN_HAIR_COSINE) } else { cos.abs() };
        light.sun_irradiance() * brdf * cosine
    }

    /// Radiance that arrives along a ray from the surface in direction `d`: the sky, or the estimated radiance of
    /// what occludes it.
    fn incident(&self, s: &SurfaceInteraction, d: Vec3) -> Vec3 {
        let (light, from) = (self.light, self.offset_origin(s, d));
        let bounce = ray(from, d, [0.0, f32::INFINITY]);
        // For an estimate any occluder will do; it need not be the closest.
        let hit = match self.sample.light_depth {
            LightDepth::Sun | LightDepth::Sky => self.world.any_hit(bounce),
            LightDepth::Surroundings => self.world.closest_hit(bounce),
        };
        let Some(hit) = hit else { return light.sky(d) };
        let occluder = self.world.mean_surface(&hit, d);
        // Diffuse reflection of the sun by the occluder, in full where a shadow ray reaches the
        // sun, else by its usual openness.
        let l = light.sample_sun(self.point(3));
        let cos = occluder.normal.dot(l).max(0.0) * std::f32::consts::FRAC_1_PI;
        let sun_visibility = match self.sample.light_depth {
            _ if cos <= 0.0 || light.sun_irradiance() == Vec3::ZERO => 0.0,
            LightDepth::Sun | LightDepth::Sky => SURROUNDINGS_OPENNESS,
            LightDepth::Surroundings
                if self.is_unoccluded(from + d * hit.primitive.t + occluder.normal * self.world.gap, l) =>
            {
                1.0
            }
            LightDepth::Surroundings => 0.0,
        };
        interreflected(occluder.color, light.mean_sky())
            + occluder.color * light.sun_irradiance() * (cos * sun_visibility)
    }

    /// Light through the surface of water: reflected and refracted by Snell's law, weighted by the Fresnel reflectance.
    fn shade_water(&self, d: Vec3, s: &SurfaceInteraction) -> Vec3 {
        let light = self.light;
        if self.depth >= MAX_DEPTH {
            return light.sky(d);
        }
        let next = Self { depth: self.depth + 1, ..*self };
        let continued = |to: Vec3| {
            let hit = next.trace(self.offset_origin(s, to), to, f32::INFINITY);
            hit.map_or_else(|| light.sky(to), |scattered| scattered.radiance())
        };
        let d = math::normalize_or(d, -Vec3::Z);
        let (n, ior) = (s.shading_normal, self.world.materials.ior(s.material));
        let eta = if s.is_outside { 1.0 / ior } else { ior };
        let cos = -n.dot(d);
        // cos^2 of the refracted angle, 1 - eta^2 sin^2; negative beyond the critical angle, where
        // all light is reflected.
        let k = 1.0 - eta * eta * (1.0 - cos * cos);
        let reflected = d + n * (2.0 * cos);
        if k < 0.0 {
            return continued(reflected);
        }
        let refracted = math::normalize_or(d * eta + n * (eta * cos - math::sqrt_f32(k)), d);
        // Schlick's formula takes the angle on the side of air.
        let reflectance = fresnel(s.shading.f0, if s.is_outside { cos } else { -n.dot(refracted) });
        let mut radiance = continued(refracted) * (1.0 - reflectance);
        // From inside, reflections are left out: they mostly return to the same water and would
        // double the rays at each depth.
        if s.is_outside {
            radiance += continued(reflected) * reflectance;
            let l = light.sun_direction();
            let highlight = ggx_specular(&ShadingParams { roughness: 0.08, ..s.shading }, n, -d, l) * n.dot(l).max(0.0);
            if highlight > 1e-3 && self.is_unoccluded(self.offset_origin(s, s.normal), l) {
                radiance += light.sun_irradiance() * highlight;
            }
        }
        radiance
    }
}

/// Radiance in a concavity of openness o with walls of albedo c under a uniform sky L: c o L / (1 - c (1 - o)), the
/// sum of all orders of reflection. A white concavity is as bright as the sky.
fn interreflected(albedo: Vec3, sky: Vec3) -> Vec3 {
    let c = albedo.clamp(Vec3::ZERO, Vec3::ONE);
    sky * (c * SURROUNDINGS_OPENNESS / (Vec3::ONE - c * (1.0 - SURROUNDINGS_OPENNESS)))
}

/// Reflectance at an angle of cosine `cos` from the normal, zero for a material without gloss (`f0` = 0).
/// Source: C. Schlick, "An inexpensive BRDF model", Computer Graphics Forum 13(3), 1994.
fn fresnel(f0: f32, cos: f32) -> f32 {
    let m = (1.0 - cos).clamp(0.0, 1.0);
    f0 + (1.0 - f0) * m * m * m * m * m * if f0 > 0.0 { 1.0 } else { 0.0 }
}

/// Specular BRDF of a rough dielectric, 1/sr. `v`, `l`: unit vectors to viewer and light.
/// Source: B. Walter et al., "Microfacet models for refraction", EGSR 2007: GGX with the joint Smith term in Hammon's
/// approximation.
fn ggx_specular(f: &ShadingParams, n: Vec3, v: Vec3, l: Vec3) -> f32 {
    let (nv, nl) = (n.dot(v), n.dot(l));
    if nv <= 0.0 || nl <= 0.0 || f.f0 <= 0.0 {
        return 0.0;
    }
    let h = math::normalize_or(v + l, n);
    // Distribution of normals D = a^2 / (pi (cos^2 (a^2 - 1) + 1)^2) with a = roughness^2.
    let a = (f.roughness * f.roughness).max(0.003);
    let c = n.dot(h).max(0.0);
    let k = c * c * (a * a - 1.0) + 1.0;
    let distribution = a * a / (std::f32::consts::PI * k * k);
    // Hammon: G / (4 nv nl) is about 0.5 / lerp(2 nv nl, nv + nl, a).
    let visibility = 0.5 / math::lerp(2.0 * nv * nl, nv + nl, a);
    distribution * visibility * fresnel(f.f0, h.dot(v).max(0.0))
}

#[cfg(test)]
mod tests;
