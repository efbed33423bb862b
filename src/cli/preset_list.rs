//! `osier list presets` and `osier list species`: descriptions of presets, and small pictures of them.

use std::path::Path;

use serde_json::{Value, json};

use super::Context;
use super::progress::ProgressDisplay;
use crate::bake::BakeContext;
use crate::bake::assets::layered_picture;
use crate::presets::{self, PRESETS, Preset};
use crate::recipe::{Recipe, resolve};
use crate::scene_preview::{PreviewOptions, PreviewScene, preview};
use crate::single_file::canvas_image;
use crate::source::preset_scene;
use osier_base::Result;
use osier_base::files::{Folder, WriteOptions};
use osier_base::par::par_map;
use osier_base::progress::{Progress as _, Silent};
use osier_export::{GENERATOR, textures};
use osier_preview::Quality;

/// Width and height of a thumbnail, pixels.
const THUMBNAIL: [u32; 2] = [192, 192];

/// A preset with the recipe of its scene; `None` if the given flags, such as lower limits, make it unreadable.
struct Shown {
    preset: Preset,
    recipe: Option<Recipe>,
    /// Path of its picture, if one was written.
    thumbnail: Option<String>,
}

/// Whether `word` begins a word of a text: "rain" that of "raindrops" and not that of "terrain". Both are in lower case.
pub fn begins_a_word(text: &str, word: &str) -> bool {
    text.match_indices(word).any(|(at, _)| !text[..at].ends_with(char::is_alphanumeric))
}

/// Whether each of the words begins a word of a text, in any case.
fn has_words(text: &str, words: &[String]) -> bool {
    let text = text.to_lowercase();
    words.iter().all(|word| begins_a_word(&text, &word.to_lowercase()))
}

/// The presets in whose name or description each of the words begins a word; all without words.
pub fn matching_presets(words: &[String]) -> Vec<Preset> {
    let fits = |preset: &&Preset| has_words(&format!("{} {}", preset.name, presets::about(preset)), words);
    PRESETS.iter().filter(fits).copied().collect()
}

/// Name and description of presets, one line each, below a line on their use.
pub fn as_text(chosen: &[Preset]) -> String {
    let mut out = String::from("Grow one with `osier grow NAME -o NAME.glb`, bake one with `osier bake NAME`.\n\n");
    for p in chosen {
        out += &format!("  {:18} {}\n", p.name, presets::about(p));
    }
    out
}

/// Presets as JSON: kind, description, what their scenes contain and, with `thumbnails`, a picture of each in that folder.
/// # Errors
/// `Io` and `Foreign` if a picture cannot be written, `Cancelled`.
pub fn as_json(context: &Context, chosen: &[Preset], thumbnails: Option<&Path>) -> Result<Value> {
    let mut shown = par_map(chosen, |preset| read(context, preset));
    if let Some(folder) = thumbnails {
        write_thumbnails(context, &mut shown, folder)?;
    }
    Ok(shown.iter().map(row).collect())
}

/// Writes a thumbnail `NAME.png` of each preset into a folder, for the listing as text.
/// # Errors
/// As [`as_json`].
pub fn write_pictures(context: &Context, chosen: &[Preset], folder: &Path) -> Result<()> {
    let mut shown = par_map(chosen, |preset| read(context, preset));
    write_thumbnails(context, &mut shown, folder)
}

/// A species, and the scene that shows it with fitting leaves and bark.
#[derive(Debug)]
pub struct ListedSpecies {
    name: &'static str,
    /// Age in scenes that do not set the key `age`, years.
    age: f64,
    about: String,
    /// Name of the preset scene whose only plant it is, if there is one.
    scene: Option<&'static str>,
}

/// The species in whose name or description each of the words begins a word; all without words.
pub fn matching_species(words: &[String]) -> Vec<ListedSpecies> {
    species().into_iter().filter(|s| has_words(&format!("{} {}", s.name, s.about), words)).collect()
}

/// Name of the preset scene whose only plant is this species, without its ending.
pub fn scene_of_species(name: &str) -> Option<&'static str> {
    let grows_it_alone = |scene: &&Preset| {
        // Presets have a uniform layout: the lines that say of a plant what it grows from; those of a scene with a second plant are
        // two or more.
        let key = |line: &&str| {
            ["grammar = ", "species = ", "shapes = ", "ifs = ", "mesh = "].iter().any(|k| line.starts_with(k))
        };
        let mut sources = scene.text.lines().filter(key);
        scene.name.ends_with(".toml")
            && sources.next().is_some_and(|line| line.starts_with(&format!("species = \"{name}\"")))
            && sources.next().is_none()
    };
    PRESETS.iter().find(grows_it_alone).and_then(|scene| scene.name.strip_suffix(".toml"))
}

fn species() -> Vec<ListedSpecies> {
    let listed = |preset: &'static Preset| {
        let name = preset.name.strip_suffix(".species")?;
        // Presets have a uniform layout: searching lines is enough to find a key.
        let age = preset.text.lines().find_map(|line| line.strip_prefix("age = ")?.trim().parse().ok());
        let scene = scene_of_species(name);
        let default = f64::from(osier_plants::grow::years::Habit::default().age);
        Some(ListedSpecies { name, age: age.unwrap_or(default), about: presets::about(preset), scene })
    };
    PRESETS.iter().filter_map(listed).collect()
}

/// Name, age, scene and description of species, one line each, below lines on their use.
pub fn species_text(chosen: &[ListedSpecies]) -> String {
    let mut out = String::from(
        "Grow one with species = \"NAME\" in a scene, or see it with `osier preview SCENE`. Pictures: docs/gallery/species.md,\n\
         or `osier list presets --thumbnails FOLDER`, which draws SCENE.toml.png.\n\n",
    );
    out += &format!("  {:16} {:>5}  {:18} {}\n", "name", "age", "scene", "description");
    for s in chosen {
        out += &format!("  {:16} {:>5}  {:18} {}\n", s.name, s.age, s.scene.unwrap_or("-"), s.about);
    }
    out
}

/// Species as objects: name, age, description, and the scene that shows it with the name of its thumbnail, or null.
pub fn species_json(chosen: &[ListedSpecies]) -> Value {
    let row = |s: &ListedSpecies| {
        let thumbnail = s.scene.map(|scene| format!("{scene}.toml.png"));
        json!({ "name": s.name, "age": s.age, "about": s.about, "scene": s.scene, "thumbnail": thumbnail })
    };
    chosen.iter().map(row).collect()
}

fn read(context: &Context, preset: &Preset) -> Shown {
    // A preset refused by lowered limits is listed without its contents.
    let request = preset_scene(preset, &context.sources);
    let recipe = request.and_then(|request| resolve(&request)).ok().map(|(recipe, _)| recipe);
    Shown { preset: *preset, recipe, thumbnail: None }
}

fn row(shown: &Shown) -> Value {
    let Shown { preset, recipe, thumbnail } = shown;
    let recipe = recipe.as_ref();
    json!({
        "name": preset.name, "kind": presets::kind(preset).word(), "about": presets::about(preset),
        "frames": recipe.map(|r| r.clip.len()),
        "plants": recipe.map(|r| r.plants.iter().map(|p| p.name.as_str()).collect::<Vec<_>>()),
        "shows": recipe.map(contents), "thumbnail": thumbnail,
    })
}

/// Words for the contents of a scene besides single plants, as in the JSON field `shows`.
fn contents(recipe: &Recipe) -> Vec<&'static str> {
    // Scatters count as copies, whatever the number of their plants.
    let copies: u32 = recipe.places.iter().map(|place| place.keys.count).sum();
    let parts = [
        ("wind", recipe.moves && recipe.blows()),
        ("lattice wind", recipe.has_lattice_wind()),
        ("rain", recipe.rain.is_some()),
        ("flight", recipe.flight.is_some()),
        ("rods", !recipe.rods.is_empty() || recipe.plants.iter().any(|p| p.rods.is_some())),
        ("terrain", recipe.terrain.is_some()),
        ("copies", copies > 1 || !recipe.scatters.is_empty()),
        ("solids", !recipe.solids.is_empty()),
        ("attractors", !recipe.clouds.is_empty()),
        ("layers", !recipe.layers.is_empty()),
    ];
    parts.into_iter().filter(|(_, is_shown)| *is_shown).map(|(word, _)| word).collect()
}

/// Renders each preset at rest in draft quality into `NAME.png` of a folder. A preset without visible contents has no picture.
fn write_thumbnails(context: &Context, shown: &mut [Shown], folder: &Path) -> Result<()> {
    let display = ProgressDisplay::new(&context.console);
    let work = BakeContext { limits: &context.limits, cancel: &context.cancel, progress: &Silent, cache: None };
    let options = WriteOptions { cancel: context.cancel.clone(), ..WriteOptions::default() };
    let target = Folder::plain(folder, options)?;
    display.stage("drawing", shown.len() as u64);
    for Shown { preset, recipe, thumbnail } in shown {
        display.advance(1);
        let Some(recipe) = recipe else { continue };
        let name = format!("{}.png", preset.name);
        match draw(recipe, &work) {
            Ok(png) => {
                target.write(&name, "preview", &png)?;
                *thumbnail = Some(folder.join(&name).display().to_string());
            }
            // Cancellation ends the run; other errors concern one preset and are reported.
            Err(e) => {
                context.cancel.check()?;
                context.console.note(&format!("no picture of {}: {e}", preset.name));
            }
        }
    }
    display.done();
    target.finish()
}

/// A PNG of a scene at rest in the size of [`THUMBNAIL`], with its origin in text chunks.
fn draw(recipe: &Recipe, work: &BakeContext<'_>) -> Result<Vec<u8>> {
    let mut recipe = recipe.clone();
    if recipe.is_layered_picture() {
        [recipe.picture.width, recipe.picture.height] = THUMBNAIL;
        let canvas = layered_picture::compose(&recipe, work)?;
        return Ok(textures::png(&canvas_image(&canvas, &recipe)?)?.to_vec());
    }
    let origin = format!("scene {}, seed {}", recipe.hash, recipe.general.seed);
    let notes = [("Software", GENERATOR.to_owned()), ("Source", origin)];
    let options = PreviewOptions { size: THUMBNAIL, quality: Quality::Draft, ..PreviewOptions::default() };
    let scene = PreviewScene::of_recipe(recipe, options.quality, false, work)?;
    preview(&scene, &options, None, work)?.png(&notes, true)
}
