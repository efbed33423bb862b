//! Attractors as assets of a scene and as pictures.

use std::borrow::Cow;

use glam::{DVec3, Quat, Vec3};

use crate::bake::BakeContext;
use crate::bake::assets::attractor_color::color_mode;
use crate::bake::motion::attractor_morph::AttractorMorph;
use crate::recipe::scene::{AttractorOrigin, ColorBy, PictureFit, PictureKeys};
use crate::recipe::{AttractorRecipe, Recipe};
use osier_base::geometry::Bounds;
use osier_base::math::narrow;
use osier_base::{Error, Result};
use osier_ifs::affine::{Affine, turn_z};
use osier_ifs::cloud::{AttractorPoints, DrawRequest, cloud, voxels};
use osier_ifs::color::ColorLabels;
use osier_ifs::game::{Escapes, InstructionSet};
use osier_ifs::histogram::{PictureWindow, histogram};
use osier_ifs::picture::{Density, DensityEstimator, ToneMapping, density};
use osier_ifs::{Ifs, PictureView};
use osier_scene::{Asset, AssetKind, Attribute, AttributeData, Material, MaterialClass, Points, Trs};

/// Points of a pixel in a picture without a number of points.
pub(crate) const PER_PIXEL: u64 = 20;
/// Memory that the counts of a picture may take, bytes.
pub(crate) const MEMORY: u64 = 4 << 30;
/// Bytes per pixel of counts with colours.
const CELL: u64 = 48;
/// Widths of a point in the size of its attractor.
const FINENESS: f64 = 800.0;
/// Escaped share of the tests that is still an attractor.
const MAX_ESCAPES: f64 = 1e-3;

/// A cloud ready for the scene.
pub struct AttractorAsset {
    /// It.
    pub asset: Asset,
    /// Its one material.
    pub surface: Material,
    /// Where it stands.
    pub stand: Trs,
    /// What moves it.
    pub morphing: Option<AttractorMorph>,
}

/// Makes a cloud; `moving`: with what moves it.
/// # Errors
/// I023 if points escape, `Limit` beyond the points allowed, `Cancelled`.
pub fn build_attractor(
    recipe: &AttractorRecipe,
    seed: u64,
    moving: bool,
    material: u32,
    context: &BakeContext<'_>,
) -> Result<AttractorAsset> {
    context.cancel.check()?;
    let keys = &recipe.keys;
    context.limits.check("points", u64::from(keys.points), "the number of points")?;
    let (low, high) = bounds(recipe);
    let size = high - low;
    let scale = match keys.height {
        Some(h) if size.y > 0.0 => h / size.y,
        Some(h) => h / size.max_element().max(1e-30),
        None => 1.0,
    };
    let foot = match keys.foot {
        AttractorOrigin::Box => DVec3::new(0.5 * (low.x + high.x), low.y, 0.5 * (low.z + high.z)),
        AttractorOrigin::Origin => DVec3::ZERO,
    };
    let morphing = recipe.morph.as_ref().map(|m| AttractorMorph::new(recipe, m, seed, foot, scale));
    let mut cloud = match &morphing {
        Some(morphing) => morphing.cloud(0.0),
        None => {
            let request = DrawRequest {
                system: &recipe.system,
                study: &recipe.study,
                seed,
                points: u64::from(keys.points),
                tier: InstructionSet::Best,
            };
            cloud(&request, &labels(recipe), &recipe.extent, foot, scale)
        }
    };
    check_escapes(recipe, cloud.escapes)?;
    let thin = keys.voxel > 0.0 && morphing.is_none();
    let density = if thin { voxels(&mut cloud, narrow(keys.voxel)) } else { Vec::new() };
    let own = size.max_element() * scale / FINENESS;
    let width = narrow(keys.point.unwrap_or(own)).max(1e-9);
    let average = average(&cloud);
    let mut points = points(cloud, density, width, material);
    if let Some(morphing) = morphing.as_ref().filter(|_| moving) {
        points.moving = true;
        points.reach = morphing.reach().union(Bounds::of(points.positions.iter().copied()));
    }
    let asset = Asset {
        id: recipe.id.clone(),
        kind: AssetKind::Cloud,
        group: String::new(),
        skeleton: None,
        meshes: Vec::new(),
        instancers: Vec::new(),
        points: vec![points],
        curves: Vec::new(),
    };
    let at = Vec3::from_array(keys.at.map(narrow));
    let stand = Trs { t: at, r: Quat::from_rotation_y(narrow(keys.turn)), ..Trs::IDENTITY };
    let surface = surface(&recipe.id, average);
    Ok(AttractorAsset { asset, surface, stand, morphing: morphing.filter(|_| moving) })
}

fn points(cloud: AttractorPoints, density: Vec<u32>, width: f32, material: u32) -> Points {
    let mut attributes = vec![
        Attribute::point("map", AttributeData::U32(cloud.maps.iter().map(|m| u32::from(*m)).collect())),
        Attribute::point("depth", AttributeData::U32(cloud.depths.iter().map(|d| u32::from(*d)).collect())),
    ];
    if !density.is_empty() {
        attributes.push(Attribute::point("density", AttributeData::U32(density)));
    }
    Points {
        name: "points".into(),
        material,
        widths: vec![width; cloud.positions.len()],
        positions: cloud.positions,
        colors: cloud.colors,
        attributes,
        moving: false,
        reach: Bounds::default(),
    }
}

fn surface(id: &str, color: [f32; 3]) -> Material {
    Material { double_sided: true, ..Material::plain(id.to_owned(), MaterialClass::Leaf, color, 0.8) }
}

/// Mean colour of the first points.
fn average(cloud: &AttractorPoints) -> [f32; 3] {
    let some = cloud.colors.get(..cloud.colors.len().min(4096)).unwrap_or_default();
    let sum = some.iter().fold([0.0_f32; 3], |s, c| std::array::from_fn(|i| s[i] + c[i]));
    #[allow(clippy::cast_precision_loss, reason = "at most 4096")]
    let n = some.len().max(1) as f32;
    sum.map(|v| v / n)
}

/// The part of an attractor that is shown.
pub(crate) fn bounds(recipe: &AttractorRecipe) -> (DVec3, DVec3) {
    if recipe.study.unbounded { recipe.extent.quantile } else { recipe.extent.bounds }
}

/// I023 if too many lanes ran away.
pub(crate) fn check_escapes(recipe: &AttractorRecipe, escapes: Escapes) -> Result<()> {
    #[allow(clippy::cast_precision_loss, reason = "a share")]
    let share = escapes.found as f64 / escapes.tests.max(1) as f64;
    if share <= MAX_ESCAPES {
        return Ok(());
    }
    let reason = format!("\"{}\" runs away: {:.1} % of the tests find a lost point", recipe.system.name, share * 100.0);
    Err(Error::input("I023", reason))
}

/// Draws an attractor as densities and colours; with the tone that the keys ask for and the colour of pictures by
/// density alone.
/// # Errors
/// I050 beyond the memory allowed, I023 if points escape, `Limit`, `Cancelled`.
pub fn render_attractor(
    recipe: &AttractorRecipe,
    scene: &Recipe,
    context: &BakeContext<'_>,
) -> Result<(Density, ToneMapping, [f32; 3])> {
    context.cancel.check()?;
    let keys = &scene.picture;
    let side = u64::from(keys.width.max(keys.height)) * u64::from(keys.oversample);
    context.limits.check("image-side", side, "a side of the picture in pixels")?;
    let pixels = u64::from(keys.width) * u64::from(keys.height) * u64::from(keys.oversample * keys.oversample);
    if pixels * CELL > MEMORY {
        let reason =
            format!("a picture of {pixels} pixels would take {} MB; make it smaller", pixels * CELL / 1_000_000);
        return Err(Error::input("I050", reason));
    }
    let small = u64::from(keys.width) * u64::from(keys.height);
    let count = keys.points.map_or(PER_PIXEL * small, u64::from).max(1);
    context.limits.check("points", count, "the number of points")?;
    let colors = if keys_by_density(recipe) { None } else { Some(labels(recipe)) };
    let cloud_keys = &recipe.keys;
    let view = recipe.system.view.filter(|_| keys.fit == PictureFit::View);
    let system = turned(&recipe.system, view.as_ref());
    let request = DrawRequest {
        system: &system,
        study: &recipe.study,
        seed: scene.general.seed,
        points: count,
        tier: InstructionSet::Best,
    };
    let counts = histogram(&request, colors.as_ref(), &window(recipe, keys, view.as_ref()));
    check_escapes(recipe, counts.escapes)?;
    context.cancel.check()?;
    let estimator = DensityEstimator { radius: keys.spread, minimum: keys.spread_min, curve: keys.spread_curve };
    let drawn = density(&counts, keys.oversample as usize, (keys.spread > 0.0).then_some(estimator));
    let tone = ToneMapping { exposure: keys.exposure, gamma: keys.gamma, background: keys.background };
    let flat = cloud_keys.colors.first().copied().unwrap_or([0.05, 0.15, 0.03]);
    Ok((drawn, tone, flat))
}

fn keys_by_density(recipe: &AttractorRecipe) -> bool {
    recipe.keys.color_by == ColorBy::Density
}

pub(crate) fn labels(recipe: &AttractorRecipe) -> ColorLabels {
    ColorLabels::new(&recipe.system, color_mode(recipe.keys.color_by, recipe.keys.prefix), &recipe.keys.colors)
}

/// The system shown as a view turns it.
/// Source: flam3 turns its points by `rotate` about the centre, with y down.
fn turned<'a>(system: &'a Ifs, view: Option<&PictureView>) -> Cow<'a, Ifs> {
    let Some(view) = view.filter(|v| v.rotate != 0.0) else { return Cow::Borrowed(system) };
    let center = DVec3::new(view.center[0], view.center[1], 0.0);
    let turn = turn_z(-view.rotate);
    let about = Affine { a: turn, b: center - turn * center };
    let last = system.last.map_or(about, |last| about.after(&last));
    Cow::Owned(Ifs { last: Some(last), ..system.clone() })
}

/// What a picture shows: the whole view of a flame, or the attractor, or what the keys say.
fn window(recipe: &AttractorRecipe, keys: &PictureKeys, view: Option<&PictureView>) -> PictureWindow {
    let k = keys.oversample.max(1);
    let (width, height) = ((keys.width * k) as usize, (keys.height * k) as usize);
    let shown = if keys.fit == PictureFit::Quantile { recipe.extent.quantile } else { bounds(recipe) };
    let mut fitted = PictureWindow::fitted(shown.0, shown.1, width, height);
    if let Some(v) = view {
        let (across, down) = (v.width / f64::from(keys.width * k), v.width / v.aspect / f64::from(keys.height * k));
        fitted = PictureWindow { center: v.center, pixel: across.max(down), ..fitted };
    }
    let center = keys.center.unwrap_or(fitted.center);
    let pixel = keys.span.map_or(fitted.pixel, |s| s / f64::from(keys.width * k));
    PictureWindow { center, pixel, ..fitted }
}
