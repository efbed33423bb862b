//! Light: a sun with an angular size, a sky of two colours, and what surfaces make of them.

use glam::Vec3;

use super::looks::ShadingParams;
use super::sampler::Sampler;
use super::surface::Surface;
use super::world::{Hit, World, ray};
use osier_base::math;
use osier_scene::{Fog, Sky, Sun};

/// Refractions and reflections in a row.
const DEPTH: u32 = 6;
/// Radiance of one sample at most: a glint on water is bright, not a speck of noise.
const BRIGHTEST: f32 = 6.0;
/// PrimitiveRange of the surfaces around that see the sky and the sun, where it is not looked up.
const OPENNESS: f32 = 0.3;
/// PrimitiveRange of the sky that things see, where it is not looked up.
const OPEN_SKY: f32 = 0.8;
/// Looks at the sky for each sample of the floor.
const FLOOR_LOOKS: u32 = 4;
/// How far the sky is, as haze has it, m.
const FAR: f32 = 1e6;
/// Purposes of samples at each depth.
const PURPOSES: u32 = 8;

/// Sun and sky.
#[derive(Debug, Clone, Copy)]
pub struct Light {
    toward: Vec3,
    /// Irradiance on a surface that faces the sun.
    sun: Vec3,
    /// Cosine of half the sun's angular size.
    cone: f32,
    horizon: Vec3,
    zenith: Vec3,
    /// The sky, its strength already in its colours.
    sky: Sky,
    /// Colour of the bright air around the sun.
    glow: Vec3,
    fog: Option<Fog>,
}

/// One sample of a pixel.
#[derive(Debug, Clone, Copy)]
pub(super) struct SampleContext<'a> {
    pub(super) sampler: &'a Sampler,
    pub(super) index: u32,
    /// Width of the sample at unit distance.
    pub(super) spread: f32,
    /// How far light is followed.
    pub(super) light_depth: LightDepth,
    /// False if the light around is known well enough from other samples.
    pub(super) around: bool,
    /// What was found out beforehand.
    pub(super) known: Option<PrecomputedLight>,
}

/// Light that reaches a place, looked up without rays.
#[derive(Debug, Clone, Copy)]
pub(super) struct PrecomputedLight {
    /// True if the middle of the sun is seen.
    pub(super) sun: bool,
    /// PrimitiveRange of the sky that is seen.
    pub(super) sky: f32,
}

/// How far light is followed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum LightDepth {
    /// The sun and its shadows; the sky as an open place has it.
    Sun,
    /// What hides the sky, too.
    Sky,
    /// What shines on that, too.
    Around,
}

impl Light {
    /// Light of a scene.
    pub fn new(sun: &Sun, sky: &Sky) -> Self {
        Self {
            toward: sun.direction(),
            sun: Vec3::from_array(sun.color) * sun.strength,
            cone: math::cos_f32(sun.angle * 0.5).min(1.0 - 1e-7),
            horizon: Vec3::from_array(sky.horizon) * sky.strength,
            zenith: Vec3::from_array(sky.zenith) * sky.strength,
            sky: Sky {
                horizon: sky.horizon.map(|c| c * sky.strength),
                zenith: sky.zenith.map(|c| c * sky.strength),
                below: sky.below.map(|b| b.map(|c| c * sky.strength)),
                strength: 1.0,
                ..*sky
            },
            glow: Vec3::from_array(sun.color) * sky.glow,
            fog: sky.fog,
        }
    }

    /// Unit vector to the middle of the sun.
    pub(super) fn direction(&self) -> Vec3 {
        self.toward
    }

    /// Radiance of the sky in a unit direction, seen from the ground through the haze.
    pub(super) fn sky(&self, direction: Vec3) -> Vec3 {
        let clear = self.sky.toward(direction, self.toward, self.glow);
        let (share, added) = self.haze(Vec3::ZERO, direction, FAR);
        clear * share + added
    }

    /// What the haze makes of light that comes to `eye` from `length` m along `direction`: the share that arrives, and
    /// what is added to it.
    fn haze(&self, eye: Vec3, direction: Vec3, length: f32) -> (f32, Vec3) {
        self.fog.map_or((1.0, Vec3::ZERO), |fog| {
            let clear = fog.clear(eye, direction, length);
            (clear, Vec3::from_array(fog.color) * (1.0 - clear))
        })
    }

    /// Mean radiance of the sky, weighted as a level surface sees it.
    pub(super) fn mean_sky(&self) -> Vec3 {
        self.horizon.lerp(self.zenith, 2.0 / 3.0)
    }

    /// Radiance of a white, level, open floor that comes from the sun.
    pub(super) fn open_sun(&self) -> Vec3 {
        self.sun * (self.toward.y.max(0.0) * std::f32::consts::FRAC_1_PI)
    }

    /// A direction into the sun. `at`: in the unit square.
    fn sunward(&self, at: [f32; 2]) -> Vec3 {
        let cos = 1.0 - at[0] * (1.0 - self.cone);
        turned(self.toward, cos, at[1])
    }
}

/// The unit vector at an angle of cosine `cos` from the unit vector `axis`, `turn` of the way round.
fn turned(axis: Vec3, cos: f32, turn: f32) -> Vec3 {
    let x = math::perpendicular(axis);
    let y = axis.cross(x);
    let sin = math::sqrt_f32((1.0 - cos * cos).max(0.0));
    let angle = turn * std::f32::consts::TAU;
    axis * cos + (x * math::cos_f32(angle) + y * math::sin_f32(angle)) * sin
}

/// A direction about `n`, likelier where a matt surface takes more light: its density is cos / pi.
fn cosine(n: Vec3, at: [f32; 2]) -> Vec3 {
    turned(n, math::sqrt_f32(1.0 - at[0]), at[1])
}

/// Mean cosine at which light from one side meets the seen half of a hair, over all directions of hairs.
const ABOUT: f32 = 0.4;

/// Radiance in two parts: one is noisy from few looks but smooth over a surface, so a picture may smooth it.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Scattered {
    /// Of the sun, of what is mirrored and of haze.
    pub(super) direct: Vec3,
    /// PrimitiveRange of `around` that is sent on.
    pub(super) matt: Vec3,
    /// Light of the sky and of what stands before it, from one direction drawn at random.
    pub(super) around: Vec3,
    /// 1 if it was looked for, else 0.
    pub(super) looks: f32,
    /// What was met first.
    pub(super) showing: u32,
}

impl Scattered {
    pub(super) fn whole(self) -> Vec3 {
        self.direct + self.matt * self.around
    }
}

impl World<'_> {
    /// Radiance towards the viewer along a ray, if it meets anything before `far`, in lengths of the direction.
    pub(super) fn radiance(
        &self,
        light: &Light,
        o: Vec3,
        d: Vec3,
        far: f32,
        draw: &SampleContext<'_>,
    ) -> Option<Scattered> {
        Path { world: self, light, draw, depth: 0 }.followed(o, d, far)
    }

    /// Radiance that a hit of a ray sends back along it.
    pub(super) fn sent(
        &self,
        light: &Light,
        o: Vec3,
        d: Vec3,
        hit: &Hit,
        draw: &SampleContext<'_>,
    ) -> Option<Scattered> {
        Path { world: self, light, draw, depth: 0 }.sent(o, d, hit)
    }

    /// Light of sun and sky that reaches a white, level floor.
    pub(super) fn open_light(&self, light: &Light, p: Vec3, draw: &SampleContext<'_>) -> (Vec3, Vec3) {
        if let Some(known) = draw.known {
            return (light.open_sun() * f32::from(u8::from(known.sun)), light.mean_sky() * known.sky);
        }
        let seen = |d: Vec3| self.lets_by(ray(p, d, [0.0, f32::INFINITY]));
        let l = light.sunward(draw.sampler.point(draw.index, 1));
        let sun = if l.y > 0.0 && light.sun != Vec3::ZERO && seen(l) { light.open_sun() } else { Vec3::ZERO };
        // Paper is smooth, so its few samples must agree: four looks at the sky for one at the sun.
        let looks = if draw.light_depth == LightDepth::Sun { 1 } else { FLOOR_LOOKS };
        let sky = (0..looks).fold(Vec3::ZERO, |sum, i| {
            let d = cosine(Vec3::Y, draw.sampler.point(draw.index * looks + i, 2));
            sum + if seen(d) { light.sky(d) } else { Vec3::ZERO }
        });
        #[allow(clippy::cast_precision_loss, reason = "a few")]
        (sun, sky / looks as f32)
    }
}

/// Light on its way back, one ray long.
#[derive(Clone, Copy)]
struct Path<'p, 'w> {
    world: &'p World<'w>,
    light: &'p Light,
    draw: &'p SampleContext<'p>,
    /// Refractions and reflections so far.
    depth: u32,
}

impl Path<'_, '_> {
    /// Sample point of one of the purposes of this depth.
    fn point(&self, purpose: u32) -> [f32; 2] {
        self.draw.sampler.point(self.draw.index, self.depth * PURPOSES + purpose)
    }

    /// A place just off the surface, on the side that `d` leaves by.
    fn off(&self, s: &Surface, d: Vec3) -> Vec3 {
        s.p + s.face * if d.dot(s.face) > 0.0 { self.world.gap } else { -self.world.gap - s.thick }
    }

    /// True if nothing stands between a place and the far end of a direction.
    fn is_open(&self, from: Vec3, d: Vec3) -> bool {
        self.world.lets_by(ray(from, d, [0.0, f32::INFINITY]))
    }

    fn sees_sun(&self, s: &Surface, l: Vec3) -> bool {
        self.draw.known.map_or_else(|| self.is_open(self.off(s, l), l), |known| known.sun)
    }

    fn followed(&self, o: Vec3, d: Vec3, far: f32) -> Option<Scattered> {
        self.sent(o, d, &self.world.nearest(ray(o, d, [0.0, far]))?)
    }

    /// Light that what a ray met sends back.
    fn sent(&self, o: Vec3, d: Vec3, hit: &Hit) -> Option<Scattered> {
        let surface = self.world.surface(hit, o, d, self.draw.spread)?;
        let mut seen = if surface.finish.water {
            Scattered { direct: self.water(d, &surface), ..Scattered::default() }
        } else {
            self.lit(d, &surface)
        };
        seen.direct = seen.direct.min(Vec3::splat(BRIGHTEST));
        if self.depth == 0 {
            let (share, added) = self.light.haze(o, d, hit.spot.t);
            seen.direct = seen.direct * share + added;
            seen.matt *= share;
        }
        seen.showing = hit.showing;
        Some(seen)
    }

    /// Light that an opaque or thin surface sends back along `d`.
    /// Matt light falls off with the cosine; a share `translucency` of it leaves on the other side. The gloss is that of
    /// a rough dielectric: what it takes, the matt part lacks.
    fn lit(&self, d: Vec3, s: &Surface) -> Scattered {
        let f = &s.finish;
        let toward = -math::normalize_or(d, Vec3::Z);
        let smooth = 1.0 - f.roughness;
        let gloss = fresnel(f.f0, s.n.dot(toward).max(0.0)) * smooth * smooth;
        let matt = f.albedo * (1.0 - gloss);
        let sun = self.sunlight(s, toward, matt);
        if self.draw.light_depth == LightDepth::Sun {
            let sky = self.open_sky(s) * (matt + Vec3::splat(gloss));
            return Scattered { direct: sun + sky, ..Scattered::default() };
        }
        let at = self.point(2);
        // One draw serves both sides: its first number also says which.
        let through = at[0] < f.translucency;
        let rest =
            if through { at[0] / f.translucency } else { (at[0] - f.translucency) / (1.0 - f.translucency).max(1e-6) };
        let n = if through { -s.n } else { s.n };
        let looks = self.draw.around || self.depth > 0;
        let d = cosine(n, [rest.clamp(0.0, 0.999_999), at[1]]);
        let around = if looks { self.arriving(s, d).min(Vec3::splat(BRIGHTEST)) } else { Vec3::ZERO };
        let looks = f32::from(u8::from(looks));
        // What a rough gloss mirrors is as blurred as the light around, unless there is time to look.
        let clear = gloss > 0.0 && self.draw.light_depth == LightDepth::Around && f.roughness < 0.5;
        if !clear {
            return Scattered { direct: sun, matt: matt + Vec3::splat(gloss), around, looks, ..Scattered::default() };
        }
        let mirrored = math::normalize_or(s.n * (2.0 * s.n.dot(toward)) - toward, s.n);
        let r = if mirrored.dot(s.face) > 0.0 { mirrored } else { s.n };
        Scattered { direct: sun + self.arriving(s, r) * gloss, matt, around, looks, ..Scattered::default() }
    }

    /// Light of the sky by rule of thumb: half of it to the side, and the more the higher a surface faces, on the side that
    /// lets it through as well.
    fn open_sky(&self, s: &Surface) -> Vec3 {
        let share = self.draw.known.map_or(OPEN_SKY, |known| known.sky);
        let height = s.n.y * (1.0 - 2.0 * s.finish.translucency);
        self.light.mean_sky() * (share * (0.56 + 0.44 * height))
    }

    /// Light of the sun.
    fn sunlight(&self, s: &Surface, toward: Vec3, matt: Vec3) -> Vec3 {
        let light = self.light;
        let l = if self.draw.known.is_some() { light.toward } else { light.sunward(self.point(1)) };
        let (cos, front) = (s.n.dot(l), s.face.dot(l) > 0.0);
        let share = match (cos > 0.0, front) {
            (true, true) => 1.0 - s.finish.translucency,
            (false, false) => s.finish.translucency,
            _ => 0.0,
        };
        if light.sun == Vec3::ZERO || (share <= 0.0 && !(front && cos > 0.0)) || !self.sees_sun(s, l) {
            return Vec3::ZERO;
        }
        let mut sent = matt * (share * std::f32::consts::FRAC_1_PI);
        if front {
            sent += Vec3::splat(glint(&s.finish, s.n, toward, l));
        }
        // What one hair of a tuft sends on, others send about: half of the light no longer knows where it came from.
        let fall = if s.thick > 0.0 { 0.5 * (cos.abs() + ABOUT) } else { cos.abs() };
        light.sun * sent * fall
    }

    /// Light that arrives from a direction: the sky, or what stands before it.
    fn arriving(&self, s: &Surface, d: Vec3) -> Vec3 {
        let (light, from) = (self.light, self.off(s, d));
        let look = ray(from, d, [0.0, f32::INFINITY]);
        let met = match self.draw.light_depth {
            LightDepth::Sun | LightDepth::Sky => self.world.any(look),
            LightDepth::Around => self.world.nearest(look),
        };
        let Some(hit) = met else { return light.sky(d) };
        let (color, n) = self.world.glimpse(&hit, d);
        let l = light.sunward(self.point(3));
        let cos = n.dot(l).max(0.0) * std::f32::consts::FRAC_1_PI;
        let share = match self.draw.light_depth {
            _ if cos <= 0.0 || light.sun == Vec3::ZERO => 0.0,
            LightDepth::Sun | LightDepth::Sky => OPENNESS,
            LightDepth::Around if self.is_open(from + d * hit.spot.t + n * self.world.gap, l) => 1.0,
            LightDepth::Around => 0.0,
        };
        gathered(color, light.mean_sky()) + color * light.sun * (cos * share)
    }

    /// A drop: part of the light is reflected, part goes on bent.
    fn water(&self, d: Vec3, s: &Surface) -> Vec3 {
        let light = self.light;
        if self.depth >= DEPTH {
            return light.sky(d);
        }
        let next = Self { depth: self.depth + 1, ..*self };
        let beyond = |to: Vec3| {
            let met = next.followed(self.off(s, to), to, f32::INFINITY);
            met.map_or_else(|| light.sky(to), |sent| sent.whole())
        };
        let d = math::normalize_or(d, -Vec3::Z);
        let (n, ior) = (s.n, self.world.looks.ior(s.material));
        let eta = if s.outside { 1.0 / ior } else { ior };
        let cos = -n.dot(d);
        let k = 1.0 - eta * eta * (1.0 - cos * cos);
        let back = d + n * (2.0 * cos);
        if k < 0.0 {
            return beyond(back);
        }
        let on = math::normalize_or(d * eta + n * (eta * cos - math::sqrt_f32(k)), d);
        let share = fresnel(s.finish.f0, if s.outside { cos } else { -n.dot(on) });
        let mut seen = beyond(on) * (1.0 - share);
        if s.outside {
            seen += beyond(back) * share;
            let l = light.toward;
            let bright = glint(&ShadingParams { roughness: 0.08, ..s.finish }, n, -d, l) * n.dot(l).max(0.0);
            if bright > 1e-3 && self.is_open(self.off(s, s.face), l) {
                seen += light.sun * bright;
            }
        }
        seen
    }
}

/// Light from a surface that other surfaces light: radiance in a nook of openness o whose walls have colour c is
/// c o / (1 - c (1 - o)), all orders of reflection summed; a white nook shines like the sky.
fn gathered(color: Vec3, sky: Vec3) -> Vec3 {
    let c = color.clamp(Vec3::ZERO, Vec3::ONE);
    sky * (c * OPENNESS / (Vec3::ONE - c * (1.0 - OPENNESS)))
}

/// Reflected share of light at an angle of cosine `cos`.
/// Source: C. Schlick, "An inexpensive BRDF model", Computer Graphics Forum 13(3), 1994.
fn fresnel(f0: f32, cos: f32) -> f32 {
    let m = (1.0 - cos).clamp(0.0, 1.0);
    f0 + (1.0 - f0) * m * m * m * m * m * if f0 > 0.0 { 1.0 } else { 0.0 }
}

/// Scattering of a rough mirror per cosine, 1/sr.
/// Source: B. Walter et al., "Microfacet models for refraction", EGSR 2007: GGX with the joint Smith term in Hammon's
/// approximation.
fn glint(f: &ShadingParams, n: Vec3, v: Vec3, l: Vec3) -> f32 {
    let (nv, nl) = (n.dot(v), n.dot(l));
    if nv <= 0.0 || nl <= 0.0 || f.f0 <= 0.0 {
        return 0.0;
    }
    let h = math::normalize_or(v + l, n);
    let a = (f.roughness * f.roughness).max(0.003);
    let c = n.dot(h).max(0.0);
    let k = c * c * (a * a - 1.0) + 1.0;
    let spread = a * a / (std::f32::consts::PI * k * k);
    let shadow = 0.5 / math::lerp(2.0 * nv * nl, nv + nl, a);
    spread * shadow * fresnel(f.f0, h.dot(v).max(0.0))
}

#[cfg(test)]
mod tests;
