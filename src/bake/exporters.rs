//! Which exporters write what a recipe asks for.

use std::sync::Arc;

use super::write::Writer;
use crate::recipe::sections::{CopyStyle, Format, Profile, Up};
use crate::recipe::{OutputRecipe, Recipe};
use osier_base::fence::Folder;
use osier_export::textures::Textures;
use osier_export::{air, exr, gltf, manifest, obj, ply, pov, stats, tracks, usd};

/// Writers of a bake's folder, which will be given these frames.
pub fn of_bake(folder: &Folder, textures: &Arc<Textures>, recipe: &Recipe, frames: &[u32]) -> Vec<Writer> {
    let of = |f: &Format| of_format(*f, (folder, textures), recipe, frames);
    let formats = recipe.output.formats.iter().flat_map(of);
    let told = !recipe.output.air.grids.is_empty();
    formats.chain(told.then(|| writer("wind", air::Air::new(folder.clone())))).collect()
}

fn of_format(
    format: Format,
    (folder, textures): (&Folder, &Arc<Textures>),
    recipe: &Recipe,
    frames: &[u32],
) -> Vec<Writer> {
    let (folder, output) = (folder.clone(), &recipe.output);
    match format {
        Format::Usd => {
            let maps = output.formats.contains(&Format::Exr);
            let first = frames.first().copied();
            let options = usd::Options {
                up: up(output),
                maps,
                first,
                copies: copies(output),
                tolerance: tolerance(output),
                ..usd::Options::default()
            };
            vec![writer("usd", usd::Usd::new(folder, Arc::clone(textures), options))]
        }
        Format::Glb => {
            let glb = |p: &Profile| {
                let layout = gltf::Layout::Bake;
                let (frame, nodes) = (output.gltf.frame, output.gltf.nodes as usize);
                let (skins, assets) = (output.gltf.skins as usize, output.gltf.assets);
                let options = gltf::Options { profile: profile(*p), layout, frame, nodes, skins, assets };
                writer("glb", gltf::Gltf::new(folder.clone(), Arc::clone(textures), options))
            };
            output.gltf.profiles.iter().map(glb).collect()
        }
        Format::Pc2 => vec![writer("pc2", osier_export::pc2::Pc2::new(folder))],
        Format::Obj => vec![writer("obj", obj::Obj::new(folder, (**textures).clone(), obj::Layout::Bake))],
        Format::Ply => vec![writer("ply", ply::Ply::new(folder, ply::Layout::Bake))],
        Format::Csv => vec![writer("csv", stats::Stats::new(folder))],
        Format::Tracks => vec![writer("tracks", tracks::Tracks::new(folder))],
        Format::Exr => vec![writer("exr", exr::Exr::new(folder, wanted_maps(recipe)))],
        Format::Pov => vec![writer("pov", pov::Pov::new(folder, (**textures).clone(), pov_options(output)))],
    }
}

/// The writer of a single file in a folder of the user's; `None` for an unknown ending.
pub fn of_file(
    folder: Folder,
    name: &str,
    textures: &Arc<Textures>,
    output: &OutputRecipe,
    web: bool,
) -> Option<Writer> {
    let (stem, ending) = name.rsplit_once('.')?;
    let stem = stem.to_owned();
    let textures = Arc::clone(textures);
    let gltf = |layout| {
        let profile = if web { gltf::Profile::Web } else { gltf::Profile::Blender };
        writer(
            "glb",
            gltf::Gltf::new(
                folder.clone(),
                Arc::clone(&textures),
                gltf::Options { profile, layout, skins: output.gltf.skins as usize, ..gltf::Options::default() },
            ),
        )
    };
    Some(match ending.to_ascii_lowercase().as_str() {
        "glb" => gltf(gltf::Layout::Glb(name.to_owned())),
        "gltf" => gltf(gltf::Layout::Gltf(name.to_owned())),
        "usda" | "usdc" | "usdz" => {
            let options =
                usd::Options { up: up(output), file: Some(name.to_owned()), look: false, ..usd::Options::default() };
            writer("usd", usd::Usd::new(folder, textures, options))
        }
        "obj" => writer("obj", obj::Obj::new(folder, (*textures).clone(), obj::Layout::Single(stem))),
        "ply" => writer("ply", ply::Ply::new(folder, ply::Layout::Single(stem))),
        "pov" => {
            let options = pov::Options { layout: pov::Layout::Single(stem), ..pov_options(output) };
            writer("pov", pov::Pov::new(folder, (*textures).clone(), options))
        }
        _ => return None,
    })
}

/// What the manifest says about the choices, for a bake of these frames in rising order.
pub fn settings(output: &OutputRecipe, frames: &[u32]) -> manifest::Settings {
    manifest::Settings {
        up_axis: if output.usd.up == Up::Z { "Z".into() } else { "Y".into() },
        substeps: 1,
        step: stride(frames),
        pov_units_per_m: osier_base::math::narrow(output.pov.units),
    }
}

/// Largest step that meets every one of the rising `frames` from the first; 1 if there is no second.
fn stride(frames: &[u32]) -> u32 {
    let gcd = |a: u32, b: u32| {
        let (mut a, mut b) = (a, b);
        while b > 0 {
            (a, b) = (b, a % b);
        }
        a
    };
    frames.windows(2).fold(0, |step, pair| gcd(step, pair[1].abs_diff(pair[0]))).max(1)
}

fn writer(name: &'static str, exporter: impl osier_export::Exporter + 'static) -> Writer {
    Writer { name, exporter: Box::new(exporter) }
}

/// Which maps of wet leaves are asked for.
fn wanted_maps(recipe: &Recipe) -> exr::Wanted {
    exr::Wanted { water: recipe.maps.water, atlas: recipe.maps.atlas }
}

fn up(output: &OutputRecipe) -> usd::UpAxis {
    if output.usd.up == Up::Z { usd::UpAxis::Z } else { usd::UpAxis::Y }
}

/// Angles and lengths of the recipe are in radians and metres.
fn tolerance(output: &OutputRecipe) -> usd::Tolerance {
    let keys = &output.usd;
    usd::Tolerance {
        metres: osier_base::math::narrow(keys.tolerance),
        radians: osier_base::math::narrow(keys.turn_tolerance),
    }
}

fn copies(output: &OutputRecipe) -> usd::CopyStyle {
    match output.usd.copies {
        CopyStyle::Instancer => usd::CopyStyle::Instancer,
        CopyStyle::References => usd::CopyStyle::References,
    }
}

fn profile(profile: Profile) -> gltf::Profile {
    match profile {
        Profile::Blender => gltf::Profile::Blender,
        Profile::Web => gltf::Profile::Web,
    }
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "pictures are 8 to 16384 pixels wide")]
fn pov_options(output: &OutputRecipe) -> pov::Options {
    pov::Options {
        step: output.pov.step,
        units_per_m: osier_base::math::narrow(output.pov.units),
        shutter: osier_base::math::narrow(output.pov.shutter),
        photons: output.photons.as_ref().map(|p| osier_base::math::narrow(p.smallest)),
        size: (output.pov.size[0] as u32, output.pov.size[1] as u32),
        ..pov::Options::default()
    }
}

#[cfg(test)]
mod tests {
    use super::stride;

    #[test]
    fn the_step_of_a_selection_meets_all_of_it() {
        assert_eq!((stride(&[]), stride(&[5]), stride(&[1, 2, 3])), (1, 1, 1));
        assert_eq!((stride(&[1, 11, 21]), stride(&[1, 5, 11]), stride(&[0, 9, 15])), (10, 2, 3));
    }
}
