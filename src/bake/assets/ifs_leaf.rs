//! Leaves and bark grains drawn from IFS coefficient tables.

use std::sync::Arc;

use crate::bake::assets::material_set::MaterialSet;
use crate::recipe::OrganRecipe;
use crate::recipe::scene::{BladeDetail, OrganKeys};
use osier_base::diagnostic::Diagnostic;
use osier_base::math::narrow;
use osier_base::rng::{Rng, mix64, word};
use osier_base::{Error, Result};
use osier_ifs::Ifs;
use osier_ifs::leaf::{self, BladePose, DrawnLeaf, LeafColors, LeafSpec, bent};
use osier_ifs::tile::tile;
use osier_plants::grow::turtle::OrganSpec;
use osier_plants::surface::bark::BarkGrain;
use osier_scene::{Image, ImageKind, Maps, Material, MaterialClass, Pixels};

/// Height range of a leaf's relief over its length. Own: by eye; more makes veins cast harder shading.
const RELIEF_PER_LENGTH: f32 = 0.012;
/// Length of a leaf whose `size` key is not set, m.
const DEFAULT_LENGTH: f64 = 0.08;
/// Tolerance of outlines for crowns and for close-ups, pixels of a map of 1024.
const CROWN_TOLERANCE: f64 = 8.0;
const CLOSE_UP_TOLERANCE: f64 = 2.0;
/// Largest number of cells along a side of a bark grain: finer cells hold too few points and show noise.
const MAX_GRAIN_CELLS: usize = 128;

/// The leaf of a table: maps, and meshes that differ in fold, curl and twist.
/// # Errors
/// `Input` with what the table leaves undone (I023, I060).
pub fn build_ifs_leaf(
    set: &mut MaterialSet,
    recipe: &OrganRecipe,
    table: &Ifs,
    plant: &str,
    name: &str,
    seed: u64,
) -> Result<OrganSpec> {
    let keys = &recipe.keys;
    let (spec, colors) = drawn_leaf_spec(keys);
    // Drawn once for all organs with the same table and keys, whose recipes share the cell.
    let drawn = recipe.drawn.get_or_init(|| leaf::mapped(table, &spec, &colors));
    let drawn = drawn.as_ref().map_err(|d| table_error((**d).clone()))?;
    let size = keys.size.unwrap_or(DEFAULT_LENGTH);
    let (material, images) = leaf_material(drawn, &colors, keys, &format!("{plant}_{name}"), size);
    let id = set.add(material, images)?;
    let mut draw = Rng::at(mix64(&[seed, word(plant), word(name)]), &["ifs-blade".into()]);
    let petiole = keys.petiole.unwrap_or(0.18 * size);
    let meshes: Vec<_> = (0..keys.variants)
        .map(|_| {
            // Relative deviation, uniform: a pose parameter of 0 stays 0.
            let mut vary = |base: f64, by: f64| base * (1.0 + draw.range(-by, by));
            let pose = BladePose {
                size,
                width: keys.width,
                curl: vary(keys.curl.unwrap_or(0.45), 0.6),
                fold: vary(keys.fold.unwrap_or(0.22), 0.5),
                twist: vary(0.18, 2.0),
                petiole: (petiole, keys.petiole_radius.unwrap_or(0.009 * size)),
            };
            Arc::new(bent(&drawn.flat, &drawn.place, &pose).with_material(id))
        })
        .collect();
    Ok(OrganSpec { name: name.to_owned(), meshes, size: size + petiole, petiole: 0.0 })
}

/// Hash of everything that determines the leaf drawn from a table; `None` for an organ that is imported or has no table.
pub fn drawn_leaf_hash(recipe: &OrganRecipe) -> Option<String> {
    let table = recipe.ifs.as_deref().filter(|_| recipe.mesh.is_none())?;
    let (spec, colors) = drawn_leaf_spec(&recipe.keys);
    Some(leaf::hash(table, &spec, &colors))
}

/// Resolution, outline tolerance and colours of a drawn leaf; the colours that the keys leave out are derived from the given
/// ones.
fn drawn_leaf_spec(keys: &OrganKeys) -> (LeafSpec, LeafColors) {
    let spec = LeafSpec {
        side: (keys.side as usize).max(64),
        close: keys.close,
        fill: keys.fill,
        anchor: keys.anchor,
        detail: if matches!(keys.detail, BladeDetail::Hero | BladeDetail::Close) {
            CLOSE_UP_TOLERANCE
        } else {
            CROWN_TOLERANCE
        },
        holes: keys.holes,
        ..LeafSpec::default()
    };
    let own = LeafColors::default();
    let colors = match (keys.color, keys.color2) {
        (None, None) => own,
        (centre, second) => {
            let centre = centre.unwrap_or(own.centre);
            // Colours brighten from the middle of the blade to its margin. Own: factors by eye.
            let lighter = |k: f32| centre.map(|v| (v * k).min(1.0));
            LeafColors { centre, edge: lighter(1.5), tip: lighter(1.7), vein: second.unwrap_or(lighter(2.6)) }
        }
    };
    (spec, colors)
}

/// The point density of a table's attractor, tiled, as the grain of a bark whose maps have `side` pixels along a side.
/// # Errors
/// `Input` for a system without attractor (I023).
pub fn bark_grain(table: &Ifs, side: u32) -> Result<BarkGrain> {
    let side = (side as usize).min(MAX_GRAIN_CELLS);
    Ok(BarkGrain { side, values: tile(table, side).map_err(|d| table_error(*d))? })
}

/// An error without source labels: the table was parsed before, and the message names it.
fn table_error(d: Diagnostic) -> Error {
    Diagnostic { labels: Vec::new(), ..d }.into()
}

fn leaf_material(
    drawn: &DrawnLeaf,
    colors: &LeafColors,
    keys: &OrganKeys,
    name: &str,
    size: f64,
) -> (Material, Vec<Image>) {
    let image = |kind, suffix: &str, channels, pixels| Image {
        name: format!("{name}_{suffix}"),
        kind,
        width: drawn.side,
        height: drawn.side,
        channels,
        pixels,
    };
    let images = vec![
        image(ImageKind::Color, "color", 4, Pixels::U8(drawn.color.clone())),
        image(ImageKind::Data, "normal", 3, Pixels::U8(drawn.normal.clone())),
        image(ImageKind::Data, "rough", 1, Pixels::U8(drawn.rough.clone())),
        image(ImageKind::Data, "height", 1, Pixels::U16(drawn.height.clone())),
    ];
    let material = Material {
        name: name.to_owned(),
        class: MaterialClass::Leaf,
        base_color: colors.centre,
        roughness: keys.roughness.map_or(0.45, narrow),
        ior: 1.5,
        translucency: narrow(keys.translucency),
        double_sided: true,
        // The outline follows the drawn leaf loosely; the alpha of the colour map cuts it exactly.
        alpha_cutoff: Some(0.5),
        height_range: RELIEF_PER_LENGTH * narrow(size),
        tile: narrow(size),
        maps: Maps { color: Some(0), normal: Some(1), roughness: Some(2), height: Some(3) },
        coat: None,
    };
    (material, images)
}
