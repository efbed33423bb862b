//! Leaves of tables that a bake keeps in its folder, so that the next one need not make them again.
//!
//! `leaves/NAME/leaf.toml` holds the blade and the hashes of table, parameters and maps; the maps are the leaf's textures.
//! What does not fit in every byte is made again.

use std::path::Path;

use glam::DVec2;
use serde::Deserialize;

use super::{looks, tables};
use crate::recipe::Recipe;
use osier_base::Result;
use osier_base::fence::{Folder, read_below};
use osier_base::limits::Limits;
use osier_base::par::par_map;
use osier_export::{GENERATOR, textures};
use osier_ifs::leaf::{Drawn, Flat, Once, Place};
use osier_scene::Pixels;

/// Maps of a leaf by their endings, with their channels.
const MAPS: [(&str, u8); 4] = [("color", 4), ("normal", 3), ("rough", 1), ("height", 1)];

/// What stands in the file below its check.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Page {
    hash: String,
    anchor: [f64; 2],
    tip: [f64; 2],
    /// For people: anchor and tip say it as well.
    #[serde(rename = "length")]
    _length: f64,
    side: u32,
    maps: Hashes,
    blade: Blade,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Hashes {
    color: String,
    normal: String,
    rough: String,
    height: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Blade {
    anchor: [f64; 2],
    solid: [f64; 2],
    start: f64,
    midrib: Vec<[f64; 2]>,
    points: Vec<[f64; 2]>,
    triangles: Vec<[u32; 3]>,
}

/// A leaf of a recipe that a table draws.
struct Slot<'a> {
    /// Of its material and maps.
    name: String,
    hash: String,
    once: &'a Once,
}

fn slots(recipe: &Recipe) -> Vec<Slot<'_>> {
    let mut all = Vec::new();
    for plant in &recipe.plants {
        for (organ, name) in plant.organs.iter().zip(looks::organ_names(plant)) {
            if let Some(hash) = tables::hash(organ) {
                all.push(Slot { name: format!("{}_{name}", plant.id), hash, once: &organ.drawn });
            }
        }
    }
    all
}

/// Fetches the leaves that an earlier bake left in a folder; those that are not there, or not whole, stay to be made.
pub fn recall(recipe: &Recipe, root: &Path, limits: &Limits) {
    let slots = slots(recipe);
    par_map(&slots, |slot| {
        if let Some(drawn) = recalled(slot, root, limits) {
            // Another leaf may have the same table and keys: then it is here already, and the same.
            let _ = slot.once.set(Ok(drawn));
        }
    });
}

fn recalled(slot: &Slot<'_>, root: &Path, limits: &Limits) -> Option<Drawn> {
    let bytes = read_below(root, &file(&slot.name), limits.get("text-bytes")).ok()??;
    let page = page(&bytes).filter(|p| p.hash == slot.hash)?;
    let listed = [&page.maps.color, &page.maps.normal, &page.maps.rough, &page.maps.height];
    let mut pixels = MAPS.iter().zip(listed).map(|((map, channels), hash)| {
        let png = read_below(root, &texture(&slot.name, map), limits.get("image-bytes")).ok()??;
        let whole = blake3::hash(&png).to_hex().as_str() == hash.as_str();
        if whole { textures::unpng(&png, page.side, *channels) } else { None }
    });
    let mut bytes = || match pixels.next()? {
        Some(Pixels::U8(v)) => Some(v),
        _ => None,
    };
    let (color, normal, rough) = (bytes()?, bytes()?, bytes()?);
    let Some(Pixels::U16(height)) = pixels.next()? else { return None };
    let Blade { anchor, solid, start, midrib, points, triangles } = page.blade;
    let (at, all) = (DVec2::from_array, |l: Vec<[f64; 2]>| l.into_iter().map(DVec2::from_array).collect());
    let flat = Flat { points: all(points), triangles };
    let place = Place { side: f64::from(page.side), anchor: at(anchor), midrib: all(midrib), solid: at(solid), start };
    let ends = [page.anchor, page.tip].map(at);
    Some(Drawn { side: page.side, color, normal, rough, height, flat, place, ends })
}

/// The page of a file, if nothing below its check was changed and its triangles name points of it.
fn page(bytes: &[u8]) -> Option<Page> {
    let text = std::str::from_utf8(bytes).ok()?;
    let (check, rest) = text.split_once("check = \"")?.1.split_once("\"\n")?;
    if blake3::hash(rest.as_bytes()).to_hex().as_str() != check {
        return None;
    }
    let page: Page = toml::from_str(rest).ok()?;
    let points = page.blade.points.len();
    let inside = page.blade.triangles.iter().flatten().all(|i| (*i as usize) < points);
    inside.then_some(page)
}

/// Keeps the leaves that were made or fetched, beside their textures, which are written already.
/// # Errors
/// Whatever cannot be written.
pub fn keep(recipe: &Recipe, folder: &Folder) -> Result<()> {
    let files = folder.files();
    let listed = |path: &str| files.iter().find(|f| f.path == path).map(|f| f.blake3.as_str());
    for slot in slots(recipe) {
        let Some(Ok(drawn)) = slot.once.get() else { continue };
        let hashes: Option<Vec<&str>> = MAPS.iter().map(|(map, _)| listed(&texture(&slot.name, map))).collect();
        let Some(hashes) = hashes else { continue };
        folder.write(&file(&slot.name), "toml.leaf", text(&slot, drawn, &hashes).as_bytes())?;
    }
    Ok(())
}

fn file(name: &str) -> String {
    format!("leaves/{name}/leaf.toml")
}

fn texture(name: &str, map: &str) -> String {
    format!("textures/{name}_{map}.png")
}

fn text(slot: &Slot<'_>, drawn: &Drawn, hashes: &[&str]) -> String {
    // Rust prints the shortest decimals that read back to the same bits.
    let pair = |p: &DVec2| format!("[{:?}, {:?}]", p.x, p.y);
    let list = |l: &[DVec2]| l.iter().map(pair).collect::<Vec<_>>().join(", ");
    let Drawn { side, flat, place, ends, .. } = drawn;
    let triangles: Vec<String> = flat.triangles.iter().map(|t| format!("{t:?}")).collect();
    let maps: String = MAPS.iter().zip(hashes).map(|((map, _), hash)| format!("{map} = \"{hash}\"\n")).collect();
    let rest = format!(
        "hash = \"{}\"\nanchor = {}\ntip = {}\nlength = {:?}\nside = {side}\n\n\
         # Of ../../textures/{}_MAP.png.\n[maps]\n{maps}\n\
         # Pixels, y up.\n[blade]\nanchor = {}\nsolid = {}\nstart = {:?}\nmidrib = [{}]\npoints = [{}]\ntriangles = [{}]\n",
        slot.hash,
        pair(&ends[0]),
        pair(&ends[1]),
        ends[0].distance(ends[1]),
        slot.name,
        pair(&place.anchor),
        pair(&place.solid),
        place.start,
        list(&place.midrib),
        list(&flat.points),
        triangles.join(", "),
    );
    let check = blake3::hash(rest.as_bytes()).to_hex();
    format!(
        "# {GENERATOR}: a leaf of a table, kept for the next bake; one that was changed is made again.\ncheck = \"{check}\"\n{rest}"
    )
}
