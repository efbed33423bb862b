//! Leaves drawn by IFS tables, cached in the bake's folder for the next bake.
//!
//! `leaves/NAME/leaf.toml` holds the blade and the hashes of table, parameters and maps; the maps are the leaf's textures.
//! A leaf of which any byte has changed is drawn again.

use std::path::Path;

use glam::DVec2;
use serde::Deserialize;

use crate::bake::assets::ifs_leaf;
use crate::bake::assets::plant_materials;
use crate::recipe::Recipe;
use osier_base::Result;
use osier_base::files::{Folder, read_below};
use osier_base::limits::Limits;
use osier_base::par::par_map;
use osier_export::{GENERATOR, textures};
use osier_ifs::leaf::{BladePlacement, DrawnLeaf, FlatBlade, LazyLeaf};
use osier_scene::Pixels;

/// Maps of a leaf by their endings, with their channels.
const MAPS: [(&str, u8); 4] = [("color", 4), ("normal", 3), ("rough", 1), ("height", 1)];

/// Contents of `leaf.toml` below the line `check`, which hashes the rest of the file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct LeafFile {
    hash: String,
    anchor: [f64; 2],
    tip: [f64; 2],
    /// Distance from anchor to tip, written for readers of the file; loading ignores it.
    #[serde(rename = "length")]
    _length: f64,
    side: u32,
    maps: CachedMapHashes,
    blade: CachedBlade,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CachedMapHashes {
    color: String,
    normal: String,
    rough: String,
    height: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CachedBlade {
    anchor: [f64; 2],
    solid: [f64; 2],
    start: f64,
    midrib: Vec<[f64; 2]>,
    points: Vec<[f64; 2]>,
    triangles: Vec<[u32; 3]>,
}

/// A leaf of a recipe drawn from an IFS table, and the cell that loading fills.
struct CacheableLeaf<'a> {
    /// Name of its material, which is also the folder of its cache and the prefix of its maps.
    name: String,
    hash: String,
    drawn: &'a LazyLeaf,
}

fn cacheable_leaves(recipe: &Recipe) -> Vec<CacheableLeaf<'_>> {
    let mut all = Vec::new();
    for plant in &recipe.plants {
        for (organ, name) in plant.organs.iter().zip(plant_materials::organ_names(plant)) {
            if let Some(hash) = ifs_leaf::drawn_leaf_hash(organ) {
                all.push(CacheableLeaf { name: format!("{}_{name}", plant.id), hash, drawn: &organ.drawn });
            }
        }
    }
    all
}

/// Names of the materials of leaves drawn from IFS tables, whose textures keep their full size because the cache reads them.
pub fn material_names(recipe: &Recipe) -> Vec<String> {
    cacheable_leaves(recipe).into_iter().map(|leaf| leaf.name).collect()
}

/// Loads the leaves that an earlier bake stored below `root`; those missing, damaged or of other keys are drawn when they are
/// needed.
pub fn load(recipe: &Recipe, root: &Path, limits: &Limits) {
    let cacheable_leaves = cacheable_leaves(recipe);
    par_map(&cacheable_leaves, |leaf| {
        if let Some(drawn) = load_leaf(leaf, root, limits) {
            // Two organs with one table and equal keys share the leaf: the second finds it set, to the same value.
            let _ = leaf.drawn.set(Ok(drawn));
        }
    });
}

fn load_leaf(leaf: &CacheableLeaf<'_>, root: &Path, limits: &Limits) -> Option<DrawnLeaf> {
    let bytes = read_below(root, &leaf_path(&leaf.name), limits.get("text-bytes"), "").ok()??;
    let file = parse_leaf_file(&bytes).filter(|f| f.hash == leaf.hash)?;
    let listed = [&file.maps.color, &file.maps.normal, &file.maps.rough, &file.maps.height];
    // Maps are read in order; the first that is missing or damaged makes the whole leaf unusable.
    let mut pixels = MAPS.iter().zip(listed).map(|((map, channels), hash)| {
        let png = read_below(root, &map_path(&leaf.name, map), limits.get("image-bytes"), "").ok()??;
        let intact = blake3::hash(&png).to_hex().as_str() == hash.as_str();
        if intact { textures::unpng(&png, file.side, *channels) } else { None }
    });
    let mut bytes = || match pixels.next()? {
        Some(Pixels::U8(v)) => Some(v),
        _ => None,
    };
    let (color, normal, rough) = (bytes()?, bytes()?, bytes()?);
    let Some(Pixels::U16(height)) = pixels.next()? else { return None };
    let CachedBlade { anchor, solid, start, midrib, points, triangles } = file.blade;
    let (point, points_of) = (DVec2::from_array, |l: Vec<[f64; 2]>| l.into_iter().map(DVec2::from_array).collect());
    let flat = FlatBlade { points: points_of(points), triangles };
    let place = BladePlacement {
        side: f64::from(file.side),
        anchor: point(anchor),
        midrib: points_of(midrib),
        solid: point(solid),
        start,
    };
    let ends = [file.anchor, file.tip].map(point);
    Some(DrawnLeaf { side: file.side, color, normal, rough, height, flat, place, ends })
}

/// Parses a leaf file; `None` if its checksum fails or a triangle refers to a missing point.
fn parse_leaf_file(bytes: &[u8]) -> Option<LeafFile> {
    let text = std::str::from_utf8(bytes).ok()?;
    let (check, rest) = text.split_once("check = \"")?.1.split_once("\"\n")?;
    if blake3::hash(rest.as_bytes()).to_hex().as_str() != check {
        return None;
    }
    let file: LeafFile = toml::from_str(rest).ok()?;
    let points = file.blade.points.len();
    let inside = file.blade.triangles.iter().flatten().all(|i| (*i as usize) < points);
    inside.then_some(file)
}

/// Writes `leaf.toml` for all leaves drawn so far. Their textures must have been written, since the file lists their hashes.
/// # Errors
/// `Io` for a file that cannot be written.
pub fn store(recipe: &Recipe, folder: &Folder) -> Result<()> {
    let files = folder.files();
    let listed = |path: &str| files.iter().find(|f| f.path == path).map(|f| f.blake3.as_str());
    for leaf in cacheable_leaves(recipe) {
        let Some(Ok(drawn)) = leaf.drawn.get() else { continue };
        let hashes: Option<Vec<&str>> = MAPS.iter().map(|(map, _)| listed(&map_path(&leaf.name, map))).collect();
        let Some(hashes) = hashes else { continue };
        folder.write(&leaf_path(&leaf.name), "toml.leaf", leaf_file_text(&leaf, drawn, &hashes).as_bytes())?;
    }
    Ok(())
}

fn leaf_path(name: &str) -> String {
    format!("leaves/{name}/leaf.toml")
}

fn map_path(name: &str, map: &str) -> String {
    format!("textures/{name}_{map}.png")
}

fn leaf_file_text(leaf: &CacheableLeaf<'_>, drawn: &DrawnLeaf, hashes: &[&str]) -> String {
    // Rust prints the shortest decimals that read back to the same bits.
    let pair = |p: &DVec2| format!("[{:?}, {:?}]", p.x, p.y);
    let list = |l: &[DVec2]| l.iter().map(pair).collect::<Vec<_>>().join(", ");
    let DrawnLeaf { side, flat, place, ends, .. } = drawn;
    let triangles: Vec<String> = flat.triangles.iter().map(|t| format!("{t:?}")).collect();
    let maps: String = MAPS.iter().zip(hashes).map(|((map, _), hash)| format!("{map} = \"{hash}\"\n")).collect();
    let rest = format!(
        "hash = \"{}\"\nanchor = {}\ntip = {}\nlength = {:?}\nside = {side}\n\n\
         # Of ../../textures/{}_MAP.png.\n[maps]\n{maps}\n\
         # Pixels, y up.\n[blade]\nanchor = {}\nsolid = {}\nstart = {:?}\nmidrib = [{}]\npoints = [{}]\ntriangles = [{}]\n",
        leaf.hash,
        pair(&ends[0]),
        pair(&ends[1]),
        ends[0].distance(ends[1]),
        leaf.name,
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
