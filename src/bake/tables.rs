//! Leaves that coefficient tables draw.

use std::sync::Arc;

use super::looks::Look;
use crate::diagnostic::{Diagnostic, Report};
use crate::grow::turtle::OrganSpec;
use crate::ifs::Ifs;
use crate::ifs::leaf::{self, Colors, Leaf, Pose, Spec, bent, fields};
use crate::ifs::tile::tile;
use crate::math::narrow;
use crate::recipe::OrganRecipe;
use crate::recipe::sections::{Detail, OrganKeys};
use crate::rng::{Rng, mix64, word};
use crate::scene::{Image, ImageKind, Maps, Material, MaterialClass, Pixels};
use crate::surface::bark::Grain;
use crate::units::{byte, srgb_from_linear};
use crate::{Error, Result};

/// Relief of a leaf over its length.
const RELIEF: f32 = 0.012;
/// Length of a leaf without the key, m.
const SIZE: f64 = 0.08;
/// Tolerance of outlines for crowns and for close-ups, pixels of a map of 1024.
const LIGHT: f64 = 8.0;
const HERO: f64 = 2.0;
/// Most cells along a side of a grain: finer ones would only be noise.
const CELLS: usize = 128;

/// The leaf of a table: maps, and meshes that differ in fold, curl and twist.
/// # Errors
/// `Input` with what the table leaves undone (I023, I060).
pub fn leaves(
    look: &mut Look,
    recipe: &OrganRecipe,
    table: &Ifs,
    (plant, name, seed): (&str, &str, u64),
) -> Result<OrganSpec> {
    let keys = &recipe.keys;
    let spec = Spec {
        side: (keys.side as usize).max(64),
        close: keys.close,
        fill: keys.fill,
        anchor: keys.anchor,
        detail: if keys.detail == Detail::Hero { HERO } else { LIGHT },
        holes: keys.holes,
        ..Spec::default()
    };
    let made = leaf::leaf(table, &spec).map_err(|d| told(*d))?;
    let size = keys.size.unwrap_or(SIZE);
    let (material, images) = surface(&made, keys, &format!("{plant}_{name}"), size);
    let id = look.add(material, images);
    let mut draw = Rng::at(mix64(&[seed, word(plant), word(name)]), &["ifs-blade".into()]);
    let petiole = keys.petiole.unwrap_or(0.18 * size);
    let meshes: Vec<_> = (0..keys.variants)
        .map(|_| {
            let mut vary = |base: f64, by: f64| base * (1.0 + draw.range(-by, by));
            let pose = Pose {
                size,
                width: keys.width,
                curl: vary(keys.curl.unwrap_or(0.45), 0.6),
                fold: vary(keys.fold.unwrap_or(0.22), 0.5),
                twist: vary(0.18, 2.0),
                petiole: (petiole, keys.petiole_radius.unwrap_or(0.009 * size)),
            };
            Arc::new(bent(&made.flat, &made.place, &pose).with_material(id))
        })
        .collect();
    Ok(OrganSpec { name: name.to_owned(), meshes, size: size + petiole, petiole: 0.0 })
}

/// The density of a table as the grain of a bark whose maps have `side` pixels.
/// # Errors
/// `Input` for a system without attractor (I023).
pub fn grain(table: &Ifs, side: u32) -> Result<Grain> {
    let side = (side as usize).min(CELLS);
    Ok(Grain { side, values: tile(table, side).map_err(|d| told(*d))? })
}

/// The table was read and judged before; what is left to say names it.
fn told(d: Diagnostic) -> Error {
    let mut report = Report::default();
    report.push(Diagnostic { labels: Vec::new(), ..d });
    Error::Input(Box::new(report))
}

fn surface(made: &Leaf, keys: &OrganKeys, name: &str, size: f64) -> (Material, Vec<Image>) {
    let own = Colors::default();
    let colors = match (keys.color, keys.color2) {
        (None, None) => own,
        (centre, second) => {
            let centre = centre.unwrap_or(own.centre);
            let lighter = |k: f32| centre.map(|v| (v * k).min(1.0));
            Colors { centre, edge: lighter(1.5), tip: lighter(1.7), vein: second.unwrap_or(lighter(2.6)) }
        }
    };
    let f = fields(&made.raster, &colors, 1.0);
    let n = made.raster.mask.side;
    let side = u32::try_from(n).unwrap_or(u32::MAX);
    let image = |kind, suffix: &str, channels, pixels| Image {
        name: format!("{name}_{suffix}"),
        kind,
        width: side,
        height: side,
        channels,
        pixels,
    };
    let rgba = |c: &[f32; 4]| {
        [byte(srgb_from_linear(c[0])), byte(srgb_from_linear(c[1])), byte(srgb_from_linear(c[2])), byte(c[3])]
    };
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 16 bits before the cast")]
    let deep = |h: &f32| (h.clamp(0.0, 1.0) * 65_535.0 + 0.5) as u16;
    let images = vec![
        image(ImageKind::Color, "color", 4, Pixels::U8(f.color.iter().flat_map(rgba).collect())),
        image(ImageKind::Data, "normal", 3, Pixels::U8(leaf::normals(&f.height, &made.raster.mask.set, n))),
        image(ImageKind::Data, "rough", 1, Pixels::U8(f.rough.iter().map(|r| byte(*r)).collect())),
        image(ImageKind::Data, "height", 1, Pixels::U16(f.height.iter().map(deep).collect())),
    ];
    let material = Material {
        name: name.to_owned(),
        class: MaterialClass::Leaf,
        base_color: colors.centre,
        roughness: keys.roughness.map_or(0.45, narrow),
        ior: 1.5,
        translucency: narrow(keys.translucency),
        double_sided: true,
        alpha_cutoff: Some(0.5),
        height_range: RELIEF * narrow(size),
        tile: narrow(size),
        maps: Maps { color: Some(0), normal: Some(1), roughness: Some(2), height: Some(3) },
        wet: None,
    };
    (material, images)
}
