//! Materials as declared identifiers: `F_` finish, `C_` texture without maps, `M_` texture with maps, `I_` interior of water.
//! Coated ones have three more: `V_` finish of the coat, `D_` bare and `W_` coated texture with maps; frames mix the two into
//! `M_`.

use super::space::write_rgb;
use crate::text::TextBuffer;
use osier_base::{Error, Result};
use osier_scene::{Material, MaterialClass, Scene};

/// Declares all materials. `pictures`: folder of the textures, relative to POV-Ray's library path, with its `/`.
/// # Errors
/// X012 if a material refers to an image that the scene does not have.
pub(super) fn declare_materials(text: &mut TextBuffer, scene: &Scene, pictures: &str) -> Result<()> {
    // F, C, V, D, W, M: each declaration refers only to identifiers above it.
    for (i, own) in (0_u32..).zip(&scene.materials) {
        let material = &Material { base_color: scene.flat_color(i), ..own.clone() };
        text.put("\n// ").put(&material.name).put("\n#declare F_").int(i).put(" = finish { ");
        write_finish(text, material);
        text.put(" }\n#declare C_").int(i).put(" = texture { pigment { ");
        if material.class == MaterialClass::Water {
            text.put("rgbf <0.985,0.995,0.99,1>");
        } else {
            write_rgb(text, material.base_color);
        }
        text.put(" } finish { F_").int(i).put(" } }\n");
        if material.coat.is_some() {
            text.put("#declare V_").int(i).put(" = finish { ");
            write_coat_finish(text, material);
            text.put(" }\n");
            // Materials that differ in name only refer to the first one's texture, so that POV-Ray loads its images once.
            let before = scene.materials.iter().take(i as usize);
            let equal =
                (0_u32..).zip(before).find(|(_, m)| m.coat.is_some() && equal_but_for_name(m, own)).map(|(j, _)| j);
            for (name, layering) in [("D_", Layering::Bare), ("W_", Layering::Coated)] {
                text.put("#declare ").put(name).int(i).put(" = ");
                match equal {
                    Some(j) => drop(text.put("texture { ").put(name).int(j).put(" }\n")),
                    None => write_mapped_texture(text, scene, i, layering, material, pictures)?,
                }
            }
            text.put("#declare M_").int(i).put(" = texture { D_").int(i).put(" }\n");
        } else {
            text.put("#declare M_").int(i).put(" = ");
            write_mapped_texture(text, scene, i, Layering::Bare, material, pictures)?;
        }
        if material.class == MaterialClass::Water {
            text.put("#declare I_").int(i).put(" = interior { ior ").num(material.ior).put(" }\n");
        }
    }
    Ok(())
}

/// Factor on the brightness of hairs, 1 to 2, for the scattering between hairs that POV-Ray does not trace. Own: chosen by
/// eye against path-traced images.
const HAIR_BRIGHTNESS: f32 = 1.5;

/// Writes the contents of a finish. Leaves transmit the share `translucency`, which is POV-Ray's second diffuse value; the
/// highlight is that of a rough dielectric.
/// Source: Fresnel at normal incidence F0 = ((n - 1) / (n + 1))^2; exponent e = 2 / r^4 - 2 of a GGX lobe of roughness r; POV-Ray's
/// `roughness` is 1 / e. POV-Ray multiplies the colour of a light by p cos^e of the angle between normal and half vector, and not by the
/// cosine of incidence: a uniform sky of radiance L, seen at a right angle, adds p L 8 (1 - 2^(-(e + 2) / 2)) / (e + 2). The peak p makes
/// this F0 L, so that rough ground has no grey veil.
fn write_finish(text: &mut TextBuffer, m: &Material) {
    if m.class == MaterialClass::Water {
        // A low specular value: the lights of the sky would each show as a highlight in every drop; the sun is ten times
        // brighter.
        text.put("diffuse 0 specular 0.3 roughness 0.0008 reflection { 0, 1 fresnel on } conserve_energy");
        return;
    }
    if m.class == MaterialClass::Catkin {
        let back = m.translucency.clamp(0.0, 0.9);
        // Multiple scattering between hairs is not traced, so both diffuse values are raised.
        // Front and back together reflect the share 0.9 of a plain surface times the factor; `back` is the part sent through.
        let all = 0.9 * HAIR_BRIGHTNESS;
        text.put("diffuse ").num(((all - back * HAIR_BRIGHTNESS) * 1000.0).round() / 1000.0);
        text.put(", ").num(((back * HAIR_BRIGHTNESS) * 1000.0).round() / 1000.0).put(" specular 0 roughness 1");
        return;
    }
    write_diffuse(text, m);
    // The lower bound keeps the exponent below 2 / 0.1^4 = 20000.
    let r = m.roughness.clamp(0.1, 1.0);
    let exponent = (2.0 / (r * r * r * r) - 2.0).max(1.0);
    let f0 = (m.ior - 1.0) / (m.ior + 1.0);
    // Part of the lobe within the half sphere of lights: 1 - 2^(-(e + 2) / 2).
    let part = 1.0 - osier_base::math::exp_f32(-0.5 * std::f32::consts::LN_2 * (exponent + 2.0));
    // f0 holds the root of the Fresnel reflectance, so it is squared here.
    let peak = (f0 * f0 * (exponent + 2.0) / (8.0 * part)).min(0.6);
    text.put(" specular ").num((peak * 1000.0).round() / 1000.0);
    // Rounded to four decimals, at least 1e-4, so that a mirror-like material does not get a roughness of 0.
    text.put(" roughness ").num((1e4 / exponent).round().max(1.0) / 1e4);
}

/// Writes the shares of light that a leaf reflects and transmits diffusely; together 0.9.
fn write_diffuse(text: &mut TextBuffer, m: &Material) {
    let back = m.translucency.clamp(0.0, 0.9);
    text.put("diffuse ").num(((0.9 - back) * 1000.0).round() / 1000.0);
    if back > 0.0 {
        text.put(", ").num(back);
    }
}

/// Share of a surface's relief that remains under a coat, 0 to 1. Own: chosen by eye.
const COATED_RELIEF: f32 = 0.4;

/// Writes the finish of a film of water: reflection that increases at grazing angles. It uses `falloff`, since `fresnel` needs an
/// interior, which would also refract light behind the cut-out parts of the texture.
fn write_coat_finish(text: &mut TextBuffer, m: &Material) {
    write_diffuse(text, m);
    if m.class == MaterialClass::Bark {
        // Water in the pores shines without a mirror image: the highlight of `write_finish` for the roughness 0.35 and the index of water.
        text.put(" specular 0.33 roughness 0.0076");
        return;
    }
    text.put(" specular 0.7 roughness 0.005 reflection { 0.02, 0.35 falloff 4 } conserve_energy");
}

/// Whether two materials are equal except for their names and coats.
fn equal_but_for_name(a: &Material, b: &Material) -> bool {
    // Bits make equality total; -1 represents a missing cutoff, as cutoffs are never negative.
    let numbers = |m: &Material| {
        let [r, g, b] = m.base_color;
        [r, g, b, m.roughness, m.ior, m.translucency, m.height_range, m.tile, m.alpha_cutoff.unwrap_or(-1.0)]
            .map(f32::to_bits)
    };
    (a.class, a.double_sided, a.maps) == (b.class, b.double_sided, b.maps) && numbers(a) == numbers(b)
}

/// Whether a texture shows the bare surface, or the surface fully covered by its coat.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Layering {
    Bare,
    Coated,
}

/// Albedo under the closed coat of a material as a share of the bare one.
fn darkening(m: &Material) -> f32 {
    m.coat.map_or(1.0, |c| c.darkening)
}

/// Writes a texture with the material's maps, looked up by texture coordinates.
fn write_mapped_texture(
    text: &mut TextBuffer,
    scene: &Scene,
    i: u32,
    layering: Layering,
    m: &Material,
    pictures: &str,
) -> Result<()> {
    if m.maps.color.is_none() && m.maps.height.is_none() && layering == Layering::Bare {
        text.put("texture { C_").int(i).put(" }\n");
        return Ok(());
    }
    // Alpha cutout by a texture map over the transparency of the image: with a transparent pigment, the cut
    // area would still have highlights.
    let cut = m.alpha_cutoff.zip(m.maps.color).filter(|(_, image)| has_alpha(scene, *image));
    if let Some((cutoff, image)) = cut {
        text.put("texture { uv_mapping ");
        write_image(text, scene, m, image, "image_pattern", pictures)?;
        // The pattern's value is the transparency, 1 - alpha.
        text.put(" texture_map { [").num(1.0 - cutoff).put(" ");
        write_surface(text, scene, i, layering, m, pictures)?;
        text.put("] [").num(1.0 - cutoff).put(" pigment { rgbt 1 } finish { ambient 0 diffuse 0 }] } }\n");
        return Ok(());
    }
    text.put("texture { ");
    write_surface(text, scene, i, layering, m, pictures)?;
    text.put(" }\n");
    Ok(())
}

fn has_alpha(scene: &Scene, image: u32) -> bool {
    scene.images.get(image as usize).is_some_and(|p| matches!(p.channels, 2 | 4))
}

/// Writes pigment, normal and finish of the bare or the coated surface.
fn write_surface(
    text: &mut TextBuffer,
    scene: &Scene,
    i: u32,
    layering: Layering,
    m: &Material,
    pictures: &str,
) -> Result<()> {
    text.put("uv_mapping pigment { ");
    match (m.maps.color, layering) {
        (Some(image), Layering::Bare) => write_image(text, scene, m, image, "image_map", pictures)?,
        (Some(image), Layering::Coated) => {
            // POV-Ray darkens an image only by averaging it with black: weights a and 1 - a multiply it by a.
            text.put("average pigment_map { [").num(darkening(m)).put(" ");
            write_image(text, scene, m, image, "image_map", pictures)?;
            text.put("] [").num(1.0 - darkening(m)).put(" rgb 0] }");
        }
        (None, Layering::Bare) => write_rgb(text, m.base_color),
        (None, Layering::Coated) => write_rgb(text, m.base_color.map(|c| c * darkening(m))),
    }
    text.put(" }");
    if let Some(image) = m.maps.height {
        text.put(" normal { ");
        write_image(text, scene, m, image, "bump_map", pictures)?;
        let width = scene.images.get(image as usize).map_or(0, |p| p.width);
        // POV-Ray takes slopes in pixels of the map: the height range in pixels is range / (tile / width).
        #[allow(clippy::cast_precision_loss, reason = "picture widths are far below 2^24")]
        let slope = m.height_range * width as f32 / m.tile.max(1e-6)
            * if layering == Layering::Coated { COATED_RELIEF } else { 1.0 };
        text.put(" bump_size ").num(slope).put(" }");
    }
    text.put(if layering == Layering::Coated { " finish { V_" } else { " finish { F_" }).int(i).put(" }");
    Ok(())
}

/// Writes a map: `image_map { png ".." interpolate 2 }`. `pattern`: `image_map`, `bump_map`, or `image_pattern` for the alpha.
fn write_image(
    text: &mut TextBuffer,
    scene: &Scene,
    m: &Material,
    image: u32,
    pattern: &str,
    folder: &str,
) -> Result<()> {
    let Some(p) = scene.images.get(image as usize) else {
        return Err(Error::export("X012", format!("material {}: picture {image} is missing", m.name)));
    };
    text.put(pattern).put(" { png ").put(&string_literal(&format!("{folder}{}.png", p.name))).put(" interpolate 2");
    text.put(if pattern == "image_pattern" { " use_alpha }" } else { " }" });
    Ok(())
}

/// Quotes a string for the scene language: escapes quotes and backslashes, and replaces control characters by `_`.
pub(super) fn string_literal(s: &str) -> String {
    let mut out = String::from("\"");
    for c in s.chars() {
        match c {
            '"' | '\\' => out.extend(['\\', c]),
            c if c.is_control() => out.push('_'),
            c => out.push(c),
        }
    }
    out.push('"');
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use osier_base::math;

    #[test]
    fn the_gloss_of_a_uniform_sky_is_the_fresnel_reflectance_at_any_roughness() {
        for roughness in [0.45, 0.6, 0.8, 1.0] {
            let mut text = TextBuffer::default();
            write_finish(&mut text, &Material::plain("m".into(), MaterialClass::Ground, [0.2; 3], roughness));
            let finish = String::from_utf8(text.bytes().to_vec()).expect("ascii");
            let number = |word: &str| -> f32 {
                let rest = finish.split_once(word).expect("the word").1;
                rest.split_whitespace().next().and_then(|n| n.parse().ok()).expect("a number")
            };
            let (peak, exponent) = (number(" specular "), 1.0 / number(" roughness "));
            // Rings of the half sphere, each with the share of its solid angle that a light of POV-Ray has: L dw / pi.
            let step = std::f32::consts::FRAC_PI_2 / 2000.0;
            let ring = |i: u16| {
                let angle = (f32::from(i) + 0.5) * step;
                2.0 * peak * math::pow_f32(math::cos_f32(0.5 * angle), exponent) * math::sin_f32(angle) * step
            };
            let gloss: f32 = (0..2000).map(ring).sum();
            assert!((gloss - 0.04).abs() < 0.002, "roughness {roughness}: {gloss} of {finish}");
        }
    }
}
