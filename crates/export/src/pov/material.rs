//! Surfaces: four identifiers per material: `F_` finish, `C_` flat colour, `M_` with maps, `I_` interior of water. Coated
//! ones have three more: `V_` finish of the coat, `D_` bare and `W_` under a closed coat, with maps; frames mix the two into `M_`.

use super::space::rgb;
use crate::text::Text;
use osier_base::{Error, Result};
use osier_scene::{Material, MaterialClass, Scene};

/// Declares all materials. `pictures`: folder of the PNG files as POV-Ray finds it, with its `/`.
/// # Errors
/// X012 if a material names a picture that the scene does not have.
pub(super) fn declare(text: &mut Text, scene: &Scene, pictures: &str) -> Result<()> {
    for (i, own) in (0_u32..).zip(&scene.materials) {
        let material = &Material { base_color: scene.flat_color(i), ..own.clone() };
        text.put("\n// ").put(&material.name).put("\n#declare F_").int(i).put(" = finish { ");
        finish(text, material);
        text.put(" }\n#declare C_").int(i).put(" = texture { pigment { ");
        if material.class == MaterialClass::Water {
            text.put("rgbf <0.985,0.995,0.99,1>");
        } else {
            rgb(text, material.base_color);
        }
        text.put(" } finish { F_").int(i).put(" } }\n");
        if material.coat.is_some() {
            text.put("#declare V_").int(i).put(" = finish { ");
            coat_finish(text, material);
            text.put(" }\n");
            // Leaves of one kind share their pictures in memory.
            let before = scene.materials.iter().take(i as usize);
            let twin = (0_u32..).zip(before).find(|(_, m)| m.coat.is_some() && looks_like(m, own)).map(|(j, _)| j);
            for (name, layering) in [("D_", Layering::Bare), ("W_", Layering::Coated)] {
                text.put("#declare ").put(name).int(i).put(" = ");
                match twin {
                    Some(j) => drop(text.put("texture { ").put(name).int(j).put(" }\n")),
                    None => mapped(text, scene, i, layering, material, pictures)?,
                }
            }
            text.put("#declare M_").int(i).put(" = texture { D_").int(i).put(" }\n");
        } else {
            text.put("#declare M_").int(i).put(" = ");
            mapped(text, scene, i, Layering::Bare, material, pictures)?;
        }
        if material.class == MaterialClass::Water {
            text.put("#declare I_").int(i).put(" = interior { ior ").num(material.ior).put(" }\n");
        }
    }
    Ok(())
}

/// How much brighter a hair is among others than alone. Own: chosen by eye against pictures of path tracers, 1..2.
const FLUFF: f32 = 1.5;

/// What light does on the surface. Leaves scatter `translucency` to their other side, which is POV-Ray's second
/// diffuse value; the highlight is that of a rough dielectric.
/// Source: Fresnel at normal incidence F0 = ((n - 1) / (n + 1))^2; normalised Blinn-Phong peak F0 (e + 8) / 8 with the
/// exponent e = 2 / r^4 - 2 of a GGX lobe of roughness r; POV-Ray's `roughness` is 1 / e.
fn finish(text: &mut Text, m: &Material) {
    if m.class == MaterialClass::Water {
        // The lights that stand for the sky would each show as a star in every drop; the sun is ten times as bright.
        text.put("diffuse 0 specular 0.3 roughness 0.0008 reflection { 0, 1 fresnel on } conserve_energy");
        return;
    }
    if m.class == MaterialClass::Catkin {
        let back = m.translucency.clamp(0.0, 0.9);
        // Hairs send light on to each other and shine on all sides; POV-Ray follows none of that.
        let all = 0.9 * FLUFF;
        text.put("diffuse ").num(((all - back * FLUFF) * 1000.0).round() / 1000.0);
        text.put(", ").num(((back * FLUFF) * 1000.0).round() / 1000.0).put(" specular 0 roughness 1");
        return;
    }
    diffuse(text, m);
    let r = m.roughness.clamp(0.1, 1.0);
    let exponent = (2.0 / (r * r * r * r) - 2.0).max(1.0);
    let f0 = (m.ior - 1.0) / (m.ior + 1.0);
    let peak = (f0 * f0 * (exponent + 8.0) / 8.0).min(0.6);
    text.put(" specular ").num((peak * 1000.0).round() / 1000.0);
    text.put(" roughness ").num((1e4 / exponent).round().max(1.0) / 1e4);
}

/// Light that a sheet scatters back and on to its other side.
fn diffuse(text: &mut Text, m: &Material) {
    let back = m.translucency.clamp(0.0, 0.9);
    text.put("diffuse ").num(((0.9 - back) * 1000.0).round() / 1000.0);
    if back > 0.0 {
        text.put(", ").num(back);
    }
}

/// Share of a surface's relief that shows through a film of water. Own: chosen by eye.
const FILLED: f32 = 0.4;

/// What light does on a film of water: it mirrors, most at flat angles. Not by POV-Ray's own fresnel, which asks for an
/// interior: that would bend what is seen through the parts that are cut out.
fn coat_finish(text: &mut Text, m: &Material) {
    diffuse(text, m);
    text.put(" specular 0.7 roughness 0.005 reflection { 0.02, 0.35 falloff 4 } conserve_energy");
}

/// True if two materials differ in nothing but their names and the water on them.
fn looks_like(a: &Material, b: &Material) -> bool {
    let numbers = |m: &Material| {
        let [r, g, b] = m.base_color;
        [r, g, b, m.roughness, m.ior, m.translucency, m.height_range, m.tile, m.alpha_cutoff.unwrap_or(-1.0)]
            .map(f32::to_bits)
    };
    (a.class, a.double_sided, a.maps) == (b.class, b.double_sided, b.maps) && numbers(a) == numbers(b)
}

/// A surface as it is, or under a closed coat.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Layering {
    Bare,
    Coated,
}

/// Albedo under the closed coat of a material as a share of the bare one.
fn darkening(m: &Material) -> f32 {
    m.coat.map_or(1.0, |c| c.darkening)
}

/// The texture with its pictures, looked up by the mesh's texture coordinates.
fn mapped(text: &mut Text, scene: &Scene, i: u32, layering: Layering, m: &Material, pictures: &str) -> Result<()> {
    if m.maps.color.is_none() && m.maps.height.is_none() && layering == Layering::Bare {
        text.put("texture { C_").int(i).put(" }\n");
        return Ok(());
    }
    // A transparent pigment alone would keep its highlight: where the picture's alpha is below the cutoff nothing is left.
    let cut = m.alpha_cutoff.zip(m.maps.color).filter(|(_, image)| has_alpha(scene, *image));
    if let Some((cutoff, image)) = cut {
        text.put("texture { uv_mapping ");
        picture(text, scene, m, image, ("image_pattern", pictures))?;
        // The pattern rises with transparency.
        text.put(" texture_map { [").num(1.0 - cutoff).put(" ");
        surface(text, scene, i, layering, m, pictures)?;
        text.put("] [").num(1.0 - cutoff).put(" pigment { rgbt 1 } finish { ambient 0 diffuse 0 }] } }\n");
        return Ok(());
    }
    text.put("texture { ");
    surface(text, scene, i, layering, m, pictures)?;
    text.put(" }\n");
    Ok(())
}

fn has_alpha(scene: &Scene, image: u32) -> bool {
    scene.images.get(image as usize).is_some_and(|p| matches!(p.channels, 2 | 4))
}

/// Pigment, relief and finish.
fn surface(text: &mut Text, scene: &Scene, i: u32, layering: Layering, m: &Material, pictures: &str) -> Result<()> {
    text.put("uv_mapping pigment { ");
    match (m.maps.color, layering) {
        (Some(image), Layering::Bare) => picture(text, scene, m, image, ("image_map", pictures))?,
        (Some(image), Layering::Coated) => {
            // A mean with black is the one way to darken a picture.
            text.put("average pigment_map { [").num(darkening(m)).put(" ");
            picture(text, scene, m, image, ("image_map", pictures))?;
            text.put("] [").num(1.0 - darkening(m)).put(" rgb 0] }");
        }
        (None, Layering::Bare) => rgb(text, m.base_color),
        (None, Layering::Coated) => rgb(text, m.base_color.map(|c| c * darkening(m))),
    }
    text.put(" }");
    if let Some(image) = m.maps.height {
        text.put(" normal { ");
        picture(text, scene, m, image, ("bump_map", pictures))?;
        let width = scene.images.get(image as usize).map_or(0, |p| p.width);
        // The map's slope counts in pixels: one step of height is range / (tile / width) pixels of the surface.
        #[allow(clippy::cast_precision_loss, reason = "picture widths are far below 2^24")]
        let slope =
            m.height_range * width as f32 / m.tile.max(1e-6) * if layering == Layering::Coated { FILLED } else { 1.0 };
        text.put(" bump_size ").num(slope).put(" }");
    }
    text.put(if layering == Layering::Coated { " finish { V_" } else { " finish { F_" }).int(i).put(" }");
    Ok(())
}

/// `image_map { png ".." interpolate 2 }`, left open for `bump_map` so that its size can follow outside.
fn picture(text: &mut Text, scene: &Scene, m: &Material, image: u32, place: (&str, &str)) -> Result<()> {
    let (pattern, folder) = place;
    let Some(p) = scene.images.get(image as usize) else {
        return Err(Error::export("X012", format!("material {}: picture {image} is missing", m.name)));
    };
    text.put(pattern).put(" { png ").put(&quoted(&format!("{folder}{}.png", p.name))).put(" interpolate 2");
    text.put(if pattern == "image_pattern" { " use_alpha }" } else { " }" });
    Ok(())
}

/// A string literal of the scene language.
pub(super) fn quoted(s: &str) -> String {
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
