//! Exporters of a recipe's formats, and their options from its keys.

use std::sync::Arc;

use crate::bake::output::frame_loop::NamedExporter;
use crate::bake::scene::animated::AnimatedScene;
use crate::recipe::scene::{CopyStyle, GltfProfile, UpAxis, WindWord};
use crate::recipe::{OutputRecipe, Recipe, word_of};
use osier_base::files::Folder;
use osier_export::format::{ExportJob, FormatInfo};
use osier_export::options::ExportOptions;
use osier_export::registry;
use osier_export::textures::Textures;
use osier_export::{air, exr, gltf, manifest, points, pov, usd, vdb};

/// Opens the exporters of a bake: those of all formats, and that of the wind if it is exported. `frames`: numbers of the frames
/// to write.
pub fn bake_exporters(
    folder: &Folder,
    textures: &Arc<Textures>,
    recipe: &Recipe,
    animated: &AnimatedScene,
    frames: &[u32],
) -> Vec<NamedExporter> {
    let mut options = export_options(recipe);
    // Formats with one file per frame refer to the first frame of this bake, which need not be the clip's.
    options.usd.first = frames.first().copied();
    // Morph targets are spread over the frames that are written, which may be a selection.
    options.gltf.frames = Some(frames.len()).filter(|n| *n > 0);
    options.gltf.loop_frames = loop_frames(recipe, animated);
    let job = ExportJob { folder: folder.clone(), textures: Arc::clone(textures), options: &options, file: None };
    let mut writers: Vec<NamedExporter> =
        recipe.output.keys.formats.iter().flat_map(|f| open_format_writers(f.0, &job)).collect();
    if !recipe.output.wind.grids.is_empty() {
        // The exporter of the wind is last, since its files belong to no format of the list.
        writers.push(NamedExporter { name: "wind", exporter: Box::new(air::Air::new(folder.clone())) });
    }
    writers
}

/// Opens the exporter of a single file `name` in a folder; `None` for an unknown ending. `profile`: of a glTF.
pub fn file_exporter(
    folder: Folder,
    name: &str,
    textures: &Arc<Textures>,
    recipe: &Recipe,
    profile: gltf::Profile,
) -> Option<NamedExporter> {
    let (_, ending) = name.rsplit_once('.')?;
    let format = registry::by_ending(&ending.to_ascii_lowercase())?;
    let mut options = export_options(recipe);
    options.gltf_profiles = vec![profile];
    let job = ExportJob { folder, textures: Arc::clone(textures), options: &options, file: Some(name) };
    // A single file has one writer; formats of several profiles got one above.
    open_format_writers(format, &job).into_iter().next()
}

/// Opens the exporters of a format, one per profile, under the format's word.
fn open_format_writers(format: &FormatInfo, job: &ExportJob) -> Vec<NamedExporter> {
    (format.open)(job).into_iter().map(|exporter| NamedExporter { name: format.word, exporter }).collect()
}

/// Options of all formats from the keys of `[output]` and `[maps]`, whether or not a format is written.
pub fn export_options(recipe: &Recipe) -> ExportOptions {
    let output = &recipe.output;
    let pov = pov_options(output);
    let [width, height] = output.pov.size.map(f64::round);
    ExportOptions {
        usd: usd::UsdOptions {
            up: up_axis(output.usd.up),
            aspect: osier_base::math::narrow(width / height),
            maps: output.writes(&exr::FORMAT),
            volumes: output.writes(&vdb::FORMAT),
            copies: copy_style(output),
            tolerance: usd_tolerance(output),
            ..usd::UsdOptions::default()
        },
        gltf: gltf::GltfOptions {
            frame: output.gltf.frame,
            size: Some([pov.size.0, pov.size.1]),
            nodes: output.gltf.nodes as usize,
            skins: output.gltf.skins as usize,
            assets: output.gltf.assets,
            quantize: output.gltf.quantize,
            meshopt: output.gltf.meshopt,
            leaf_bytes: u64::from(output.gltf.leaves_mb) * 1_000_000,
            level_triangles: output.gltf.triangles as usize,
            joints: output.gltf.joints as usize,
            channels: wind_channels(&output.gltf.channels),
            ..gltf::GltfOptions::default()
        },
        gltf_profiles: output.gltf.profiles.iter().map(|p| gltf_profile(*p)).collect(),
        pov,
        points: points::PointsOptions {
            tables: output.points.tables.iter().map(|table| word_of(*table)).collect(),
            up: up_axis(output.points.up),
        },
        vdb: vdb::VdbOptions {
            half: output.vdb.keys.half,
            zip: output.vdb.keys.zip,
            // A USD stage converts the axes of its volumes with everything else; without a stage, volumes have the axes of
            // Houdini (+Y up).
            up: if output.writes(&usd::FORMAT) { up_axis(output.usd.up) } else { usd::UpAxis::Y },
        },
        exr: exr::ExrOptions { atlas: recipe.maps.atlas },
    }
}

/// The settings that the manifest records, for a bake of these frames in rising order.
pub fn manifest_settings(recipe: &Recipe, animated: &AnimatedScene, frames: &[u32]) -> manifest::Settings {
    let output = &recipe.output;
    let pov = pov_options(output);
    manifest::Settings {
        hash: Some(recipe.hash_of_frames(frames)),
        up_axis: if output.usd.up == UpAxis::Z { "Z".into() } else { "Y".into() },
        substeps: 1,
        step: frame_stride(frames),
        written: frames.first().zip(frames.last()).map(|(first, last)| [*first, *last]),
        loop_frames: loop_frames(recipe, animated),
        size: [pov.size.0, pov.size.1],
        shutter: pov.shutter,
        pov_units_per_m: pov.units_per_m,
    }
}

/// Frames after which the motion of a scene repeats: those of the sway's loop, if nothing in the scene moves in another way.
fn loop_frames(recipe: &Recipe, animated: &AnimatedScene) -> Option<u32> {
    let mut moving = animated.motions.iter().flatten().peekable();
    let all_repeat = moving.peek().is_some() && moving.all(|motion| motion.is_loop());
    let frames = recipe.sway.loop_frames(&recipe.clip).filter(|_| all_repeat)?;
    u32::try_from(frames).ok()
}

/// Greatest common divisor of the differences of the rising `frames`; 1 for fewer than two.
fn frame_stride(frames: &[u32]) -> u32 {
    // Euclid; gcd(0, b) is b, which starts the fold.
    let gcd = |a: u32, b: u32| {
        let (mut a, mut b) = (a, b);
        while b > 0 {
            (a, b) = (b, a % b);
        }
        a
    };
    frames.windows(2).fold(0, |step, pair| gcd(step, pair[1].abs_diff(pair[0]))).max(1)
}

fn up_axis(up: UpAxis) -> usd::UpAxis {
    if up == UpAxis::Z { usd::UpAxis::Z } else { usd::UpAxis::Y }
}

/// Tolerances of keyframe reduction: metres, radians and pixels.
fn usd_tolerance(output: &OutputRecipe) -> usd::Tolerance {
    let keys = &output.usd;
    usd::Tolerance {
        metres: osier_base::math::narrow(keys.tolerance),
        radians: osier_base::math::narrow(keys.turn_tolerance),
        pixels: osier_base::math::narrow(keys.picture_tolerance),
    }
}

fn copy_style(output: &OutputRecipe) -> usd::CopyStyle {
    match output.usd.copies {
        CopyStyle::Instancer => usd::CopyStyle::Instancer,
        CopyStyle::References => usd::CopyStyle::References,
    }
}

fn gltf_profile(profile: GltfProfile) -> gltf::Profile {
    match profile {
        GltfProfile::Blender => gltf::Profile::Blender,
        GltfProfile::Web => gltf::Profile::Web,
        GltfProfile::Engine => gltf::Profile::Engine,
    }
}

/// The vertex channels of `output.gltf.channels`, a preset or four words; `None` for an empty list.
fn wind_channels(words: &[WindWord]) -> Option<gltf::WindChannels> {
    let preset = match words {
        // O3DE continues CryEngine's vertex colours.
        [WindWord::Crysis | WindWord::O3de] => Some(gltf::WindChannels::CRYSIS),
        [WindWord::Unity] => Some(gltf::WindChannels::UNITY),
        [WindWord::Godot] => Some(gltf::WindChannels::GODOT),
        [WindWord::Unreal] => Some(gltf::WindChannels::UNREAL),
        _ => None,
    };
    let four = || {
        let list: Vec<gltf::WindChannel> = words.iter().filter_map(|w| wind_channel(*w)).collect();
        Some(gltf::WindChannels { color: list.try_into().ok()?, second_uv: None })
    };
    preset.or_else(four)
}

/// The channel that a word names; `None` for the name of a preset.
fn wind_channel(word: WindWord) -> Option<gltf::WindChannel> {
    use gltf::WindNumber::{Branch, Flutter, Id, Light, One, Phase, Sway, Zero};
    let (number, inverted) = match word {
        WindWord::Sway => (Sway, false),
        WindWord::NotSway => (Sway, true),
        WindWord::Branch => (Branch, false),
        WindWord::NotBranch => (Branch, true),
        WindWord::Flutter => (Flutter, false),
        WindWord::NotFlutter => (Flutter, true),
        WindWord::Phase => (Phase, false),
        WindWord::NotPhase => (Phase, true),
        WindWord::Light => (Light, false),
        WindWord::NotLight => (Light, true),
        WindWord::Id => (Id, false),
        WindWord::NotId => (Id, true),
        WindWord::Zero => (Zero, false),
        WindWord::One => (One, false),
        WindWord::Crysis | WindWord::O3de | WindWord::Unity | WindWord::Godot | WindWord::Unreal => return None,
    };
    Some(gltf::WindChannel { number, inverted })
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "pictures are 8 to 16384 pixels wide")]
fn pov_options(output: &OutputRecipe) -> pov::PovOptions {
    pov::PovOptions {
        step: output.pov.step,
        units_per_m: osier_base::math::narrow(output.pov.units),
        shutter: osier_base::math::narrow(output.pov.shutter),
        photons: output.photons.as_ref().map(|p| osier_base::math::narrow(p.smallest)),
        size: (output.pov.size[0] as u32, output.pov.size[1] as u32),
        ..pov::PovOptions::default()
    }
}

#[cfg(test)]
mod tests {
    use super::frame_stride;

    #[test]
    fn the_step_of_a_selection_meets_all_of_it() {
        assert_eq!((frame_stride(&[]), frame_stride(&[5]), frame_stride(&[1, 2, 3])), (1, 1, 1));
        assert_eq!((frame_stride(&[1, 11, 21]), frame_stride(&[1, 5, 11]), frame_stride(&[0, 9, 15])), (10, 2, 3));
    }
}
