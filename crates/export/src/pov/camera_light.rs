//! Global settings, camera, sun, sky and fog.

use glam::Vec3;

use super::space::{PovSpace, write_rgb};
use crate::text::{Decimal, TextBuffer};
use osier_base::geometry::Bounds;
use osier_base::math;
use osier_base::{Error, Result};
use osier_scene::{Camera, Fog, Scene, Sky, Sun};

/// Number of parallel lights that approximate the sky's light. Own: more take rendering time in proportion; fewer show
/// as separate shadows.
const SKY_LIGHTS: u16 = 8;

/// Factor on all lights. POV-Ray has no tone mapping, so lights are raised here and the visible sky is compressed by
/// [`tone_map`]; at this value white bark in full sun stays below 1.
const EXPOSURE: f32 = 1.15;

/// Tone mapping of the visible sky: c to 1 - exp(-1.5 c), close to 1.5 c where it is dark and always below 1.
/// Own: chosen by eye so that horizon and sunlit ground differ.
fn tone_map(c: f32) -> f32 {
    1.0 - math::exp_f32(-1.5 * c.max(0.0))
}

/// Writes `global_settings` and defaults. `photons`: radius of the smallest target in units, if there are targets; eight photons
/// then cross its radius.
pub(super) fn write_global_settings(text: &mut TextBuffer, photons: Option<f32>) {
    text.put("#version 3.7;\nglobal_settings {\n  assumed_gamma 1.0\n  max_trace_level 16\n");
    if let Some(radius) = photons {
        text.put("  photons { spacing ")
            .num(radius / 8.0)
            .put(" autostop 1 jitter 0.4 gather 20, 80 max_trace_level 8 }\n");
    }
    text.put("}\n#default { finish { ambient 0 } }\n");
}

/// Writes haze. POV-Ray's `distance` is the distance at which 1 / e of the light remains; visibility is the distance at which
/// contrast falls to the threshold exp(-[`Fog::CONTRAST`]).
fn write_fog(text: &mut TextBuffer, space: PovSpace, fog: &Fog) {
    // exp(-visibility / distance) = exp(-CONTRAST), hence distance = visibility / CONTRAST, m, here in units of the scene.
    let distance = fog.visibility / Fog::CONTRAST * space.scale;
    text.put("fog {\n  ").put(if fog.height > 0.0 { "fog_type 2" } else { "fog_type 1" });
    text.put(" distance ").num(distance);
    if fog.height > 0.0 {
        text.put(" fog_offset 0 fog_alt ").num(fog.height * space.scale).put(" up y");
    }
    text.put("\n  ");
    write_rgb(text, fog.color.map(tone_map));
    text.put("\n}\n");
}

/// X001 if camera, sun or sky have a number that is not finite.
pub(super) fn check_finite(scene: &Scene) -> Result<()> {
    let (c, s, k) = (&scene.camera, &scene.sun, &scene.sky);
    let numbers = [c.vfov, c.roll, s.elevation, s.azimuth, s.strength, s.angle, k.strength, k.glow, k.dapple];
    let colors = [s.color, k.horizon, k.zenith, k.below.unwrap_or_default()].concat();
    let finite = c.eye.is_finite() && c.target.is_finite() && numbers.iter().chain(&colors).all(|v| v.is_finite());
    if finite { Ok(()) } else { Err(Error::export("X001", "camera, sun or sky: a number is not finite")) }
}

/// Writes the camera. POV-Ray's angle is horizontal, so it depends on the aspect ratio of the image, which is known when
/// rendering starts.
/// Source: A = 2 atan(aspect tan(vfov / 2)); the matrix is F M F of the camera-to-world transform M, its third axis
/// pointing into the image because F reverses it.
pub(super) fn write_camera(text: &mut TextBuffer, space: PovSpace, camera: &Camera) {
    // Gram-Schmidt in double precision: POV-Ray tests whether the axes are perpendicular more strictly than single precision can
    // represent.
    let [right, _, back] = camera.axes().map(|v| v.to_array().map(f64::from));
    let back = scaled(back, 1.0 / math::sqrt(dot(back, back)));
    // Removes the component of `right` along `back`, an error of rounding to f32; then up = back x right has unit length, too.
    let across = dot(right, back);
    let right = [0, 1, 2].map(|i| right[i] - back[i] * across);
    let right = scaled(right, 1.0 / math::sqrt(dot(right, right)));
    let up = [0, 1, 2].map(|i| back[(i + 1) % 3] * right[(i + 2) % 3] - back[(i + 2) % 3] * right[(i + 1) % 3]);
    // The constant tan(vfov / 2) is computed here, the aspect ratio multiplies it when POV-Ray evaluates the expression.
    let half = math::tan_f32(camera.vfov * 0.5);
    text.put("camera {\n  perspective\n  right x*image_width/image_height\n  up y\n");
    text.put(&format!("  angle 2*degrees(atan2({}*image_width/image_height, 1))\n  matrix <", Decimal(half)));
    // The mirror F negates z of every axis; the third axis is reversed besides.
    for [x, y, z] in [right, up, scaled(back, -1.0)] {
        text.put(&format!("{x},{y},{},", -z));
    }
    let e = camera.eye * space.scale;
    text.list(&[e.x, e.y, -e.z], ",").put(">\n}\n");
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn scaled(a: [f64; 3], s: f64) -> [f64; 3] {
    a.map(|x| x * s)
}

/// Writes the sun as a parallel area light whose size is its angular diameter. `bounds`: box of the scene, m.
/// Source: a matt surface of albedo a under irradiance E has radiance a E / pi; POV-Ray renders it
/// as a under a light of colour 1.
pub(super) fn write_sun(text: &mut TextBuffer, space: PovSpace, sun: &Sun, bounds: Bounds) {
    let distance = (bounds.size().length() * 10.0).max(10.0);
    let (center, toward) = (bounds.center(), sun.direction());
    // The factor 1 / pi converts irradiance into the colour of the light, as above.
    let strength = EXPOSURE * sun.strength / std::f32::consts::PI;
    // Diameter of the disc that is seen under the sun's angle from that distance: 2 d tan(angle / 2).
    let size = 2.0 * distance * math::tan_f32(sun.angle * 0.5);
    text.put("light_source {\n  ");
    space.write_point(text, center + toward * distance);
    text.put("\n  ");
    write_rgb(text, sun.color.map(|c| c * strength));
    text.put("\n  parallel point_at ");
    space.write_point(text, center);
    if size > 0.0 {
        // `orient` rotates the area towards the lit point; only the lengths of the axes count, and they must be equal.
        text.put("\n  area_light x*").num(size).put(", y*").num(size).put(", 4, 4 adaptive 1 circular orient");
    }
    text.put("\n}\n");
}

/// Writes the glow around the sun as a layer of the sky sphere, so that drops in front of it sparkle.
fn write_sun_glow(text: &mut TextBuffer, sky: &Sky, sun: &Sun) {
    // The function is the cosine of the angle to the sun, 0 in the half of the sky behind; z is negated as all directions are.
    let d = sun.direction();
    text.put("  pigment {\n    function { max(0, x*(").num(d.x).put(") + y*(").num(d.y).put(") + z*(").num(-d.z);
    text.put(")) }\n    color_map { ");
    let color = sun.color.map(|c| c * sky.glow);
    for (at, share) in Sky::GLOW {
        let [r, g, b] = color;
        text.put("[").num(at).put(" rgbt <").list(&[r, g, b, 1.0 - share], ",").put(">] ");
    }
    text.put("}\n  }\n");
}

/// Tint of light between leaves, relative to the horizon. Own: chosen by eye.
const LEAF_LIGHT_TINT: [f32; 3] = [1.0, 1.06, 0.62];

/// Writes defocused foliage as layers of the sky sphere up to half its height: patches of shade with light between them, and
/// discs as a lens images small gaps. Drops refract this background.
/// Own: chosen by eye, after photographs of drops in gardens.
fn write_dapple(text: &mut TextBuffer, sky: &Sky) {
    let stops = sky.stops();
    let (deep, bright) = (stops[0].1, stops[stops.len() - 2].1);
    let lit = [0, 1, 2].map(|c| tone_map(bright[c] * LEAF_LIGHT_TINT[c]) * 1.1);
    let tone = |share: f32| [0, 1, 2].map(|c| math::lerp(0.5 * deep[c], lit[c], share));
    let stop = |t: &mut TextBuffer, at: f32, share: f32, cover: f32| {
        let [r, g, b] = tone(share);
        t.put("[").num(at).put(" rgbt <").list(&[r, g, b, 1.0 - cover * sky.dapple], ",").put(">] ");
    };
    text.put("  pigment {\n    gradient y pigment_map {\n");
    for at in ["0", "0.6"] {
        text.put("      [").put(at).put(" bozo turbulence 0.4 octaves 3 omega 0.4 color_map { ");
        for (at, share, cover) in
            [(0.0, 0.0, 0.85), (0.4, 0.03, 0.7), (0.55, 0.1, 0.6), (0.66, 0.4, 0.6), (0.8, 1.0, 0.7)]
        {
            stop(text, at, share, cover);
        }
        text.put("} scale 0.14]\n");
    }
    text.put("      [0.85 rgbt 1]\n    }\n    scale 2 translate -1\n  }\n");
    for (size, radius) in [(0.18, 0.22), (0.29, 0.16)] {
        text.put("  pigment {\n    crackle form <1,0,0> color_map { ");
        for (at, cover) in [(0.0, 0.13), (0.75 * radius, 0.19), (radius, 0.0)] {
            stop(text, at, 1.2, cover);
        }
        text.put("} scale ").num(size).put(" translate ").num(10.0 * size).put("\n  }\n");
    }
}

/// Writes the sky as a sky sphere, and as parallel lights that cast shadows: POV-Ray's ambient light would be as
/// bright inside a crown as outside.
/// Source: a horizontal surface of albedo a under a sky of radiance L has radiance a L; each of n directions spread evenly over
/// the half sphere represents 2 pi / n of its solid angle, so its light has colour L (2 / n).
pub(super) fn write_sky(text: &mut TextBuffer, space: PovSpace, sky: &Sky, sun: &Sun, bounds: Bounds) {
    let (horizon, zenith) = (sky.horizon.map(|c| c * sky.strength), sky.zenith.map(|c| c * sky.strength));
    text.put("sky_sphere {\n  pigment {\n    gradient y\n    color_map { ");
    for (at, color) in sky.stops() {
        text.put("[").num(at).put(" ");
        write_rgb(text, color.map(tone_map));
        text.put("] ");
    }
    text.put("}\n    scale 2 translate -1\n  }\n");
    if sky.dapple > 0.0 {
        write_dapple(text, sky);
    }
    if sky.glow > 0.0 {
        write_sun_glow(text, sky, sun);
    }
    text.put("}\n");
    if let Some(f) = &sky.fog {
        write_fog(text, space, f);
    }
    // Directions of a Fibonacci lattice on the upper half sphere: equal steps of height, turned by the golden angle each.
    let distance = (bounds.size().length() * 10.0).max(10.0);
    for i in 0..SKY_LIGHTS {
        let y = (f32::from(i) + 0.5) / f32::from(SKY_LIGHTS);
        let turn = f32::from(i) * 2.399_963_2;
        let flat = math::sqrt_f32(1.0 - y * y);
        let toward = Vec3::new(flat * math::cos_f32(turn), y, flat * math::sin_f32(turn));
        let color = [0, 1, 2].map(|c| EXPOSURE * math::lerp(horizon[c], zenith[c], y) * 2.0 / f32::from(SKY_LIGHTS));
        text.put("light_source { ");
        space.write_point(text, bounds.center() + toward * distance);
        text.put(" ");
        write_rgb(text, color);
        text.put(" parallel point_at ");
        space.write_point(text, bounds.center());
        text.put(" photons { reflection off refraction off } }\n");
    }
}

/// Share of the light of sun and sky that ground reflects. Own: between moist soil (0.1) and grass (0.2).
const GROUND_ALBEDO: f32 = 0.15;

/// Writes the light from below as one parallel light; without it, lower sides that transmit no light would be black. It
/// represents the light that the ground reflects, or the sky below the horizon in a scene without ground. It casts no
/// shadows, since the ground would block it.
/// Source: as in [`write_sky`], of a radiance L from below a level lower side of albedo a reflects a L. The mean radiance of the sky on
/// level ground has a third of its weight at the horizon and two thirds at the zenith.
pub(super) fn write_light_from_below(
    text: &mut TextBuffer,
    space: PovSpace,
    sky: &Sky,
    sun: &Sun,
    bounds: Bounds,
    has_ground: bool,
) {
    let of_sky = |height: f32| [0, 1, 2].map(|c| sky.strength * math::lerp(sky.horizon[c], sky.zenith[c], height));
    let radiance = if has_ground {
        let (of_sun, mean) = (sun.strength * sun.direction().y.max(0.0) / std::f32::consts::PI, of_sky(2.0 / 3.0));
        [0, 1, 2].map(|c| GROUND_ALBEDO * (sun.color[c] * of_sun + mean[c]))
    } else {
        sky.below.map_or_else(|| of_sky(0.0), |below| below.map(|c| c * sky.strength))
    };
    // Skip a black light, which would only take time.
    if radiance.iter().all(|c| *c <= 0.0) {
        return;
    }
    let distance = (bounds.size().length() * 10.0).max(10.0);
    text.put("light_source { ");
    space.write_point(text, bounds.center() - Vec3::Y * distance);
    text.put(" ");
    write_rgb(text, radiance.map(|c| EXPOSURE * c));
    text.put(" parallel point_at ");
    space.write_point(text, bounds.center());
    text.put(if has_ground { " shadowless" } else { "" });
    text.put(" photons { reflection off refraction off } }\n");
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(sky: &Sky) -> String {
        let mut text = TextBuffer::default();
        self::write_sky(&mut text, PovSpace { scale: 1.0 }, sky, &Sun::default(), Bounds::of([Vec3::ZERO, Vec3::ONE]));
        String::from_utf8(text.bytes().to_vec()).expect("ascii")
    }

    #[test]
    fn lower_sides_are_lit_by_ground_or_by_what_is_below_the_horizon() {
        let sun = Sun { elevation: 0.5, azimuth: 0.0, strength: 2.0, color: [1.0, 0.5, 0.0], ..Sun::default() };
        let from_below = |sky: &Sky, has_ground: bool| {
            let mut text = TextBuffer::default();
            let bounds = Bounds::of([Vec3::ZERO, Vec3::splat(2.0)]);
            write_light_from_below(&mut text, PovSpace { scale: 1.0 }, sky, &sun, bounds, has_ground);
            String::from_utf8(text.bytes().to_vec()).expect("ascii")
        };
        let color = |light: &str| -> Vec<f32> {
            let inner = light.split(['<', '>']).nth(3).expect("the second list is the colour");
            inner.split(',').map(|v| v.parse().expect("a number")).collect()
        };
        let sky = Sky { horizon: [0.3, 0.6, 0.9], zenith: [0.3, 0.6, 0.9], strength: 0.5, ..Sky::default() };
        let ground = from_below(&sky, true);
        let sunlight = 2.0 * sun.direction().y / std::f32::consts::PI;
        let wanted = [0.15 + sunlight, 0.3 + 0.5 * sunlight, 0.45].map(|c| EXPOSURE * GROUND_ALBEDO * c);
        assert!(color(&ground).iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-5), "{ground}, not {wanted:?}");
        assert!(ground.contains("shadowless") && ground.starts_with("light_source { <1,-"), "{ground}");
        let open = from_below(&sky, false);
        assert!((color(&open)[2] - EXPOSURE * 0.45).abs() < 1e-5 && !open.contains("shadowless"), "{open}");
        let dark = from_below(&Sky { below: Some([0.2, 0.1, 0.1]), ..sky }, false);
        assert!((color(&dark)[0] - EXPOSURE * 0.1).abs() < 1e-5, "{dark}");
        assert_eq!(from_below(&Sky { below: Some([0.0; 3]), ..sky }, false), "");
    }

    #[test]
    fn below_the_horizon_is_what_stands_there_and_the_sun_glows_where_asked() {
        let plain = written(&Sky::default());
        let same = [plain.find("[0 rgb <").expect("below"), plain.find("[0.5 rgb <").expect("horizon")];
        assert_eq!(plain[same[0] + 3..].split(']').next(), plain[same[1] + 5..].split(']').next(), "{plain}");
        assert_eq!(plain.matches("pigment").count(), 1, "{plain}");
        let dark = written(&Sky { below: Some([0.0; 3]), glow: 2.0, ..Sky::default() });
        assert!(dark.contains("[0.38 rgb 0]") || dark.contains("[0.38 rgb <0,0,0>]"), "{dark}");
        assert!(dark.contains("[0.55 rgb <"), "{dark}");
        assert!(!dark.contains("crackle"), "{dark}");
        // Shade and light among leaves: up to half the sky's height, half as dense where half of it is asked for.
        let cover = |dapple: f32| {
            let s = written(&Sky { below: Some([0.0; 3]), dapple, ..Sky::default() });
            assert!(s.contains("[0.85 rgbt 1]") && s.matches("crackle").count() == 2, "{s}");
            let masses = s.split("bozo").nth(1).and_then(|s| s.split("[0 rgbt <0,0,0,").nth(1)).expect("shade");
            1.0 - masses.split('>').next().and_then(|n| n.parse::<f32>().ok()).expect("a number")
        };
        assert!((cover(1.0) - 0.85).abs() < 1e-6 && (cover(0.5) - 0.425).abs() < 1e-6);
        // At its middle there is nothing but the sun's colour, twice as bright.
        let [r, g, b] = Sun::default().color.map(|c| c * 2.0);
        assert!(dark.contains(&format!("[1 rgbt <{r},{g},{b},0>]")), "{dark}");
        assert!(dark.contains("[0.82 rgbt <") && dark.matches("light_source").count() == 8, "{dark}");
    }
}
