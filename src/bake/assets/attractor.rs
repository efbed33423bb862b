//! Attractors as assets of a scene and as pictures.

use std::borrow::Cow;
use std::sync::Arc;

use glam::{DVec3, Quat, Vec3};

use crate::bake::BakeContext;
use crate::bake::assets::attractor_color::color_mode;
use crate::bake::motion::AssetMotion;
use crate::bake::motion::attractor_morph::AttractorMorph;
use crate::bake::scene::builder::SceneBuilder;
use crate::recipe::scene::{AttractorOrigin, ColorBy, PictureFit, PictureKeys};
use crate::recipe::{AttractorRecipe, Recipe};
use osier_base::convert::index;
use osier_base::geometry::Bounds;
use osier_base::limits::grouped;
use osier_base::math::narrow;
use osier_base::{Error, Result};
use osier_ifs::affine::{Affine, turn_z};
use osier_ifs::cloud::{AttractorPoints, DrawRequest, cloud, drop_hidden, thin_to_voxels};
use osier_ifs::color::ColorLabels;
use osier_ifs::game::{Escapes, InstructionSet};
use osier_ifs::histogram::{Histogram, PictureWindow, histogram};
use osier_ifs::picture::{Density, DensityEstimator, ToneMapping, density};
use osier_ifs::{Ifs, PictureView};
use osier_scene::{Asset, AssetKind, Attribute, AttributeData, Material, MaterialClass, Points, Trs};

/// Points drawn per pixel of a picture whose `points` key is not set. Own: by eye; noise falls with its square root.
pub(crate) const DEFAULT_POINTS_PER_PIXEL: u64 = 20;
/// Bytes for each pixel of a picture of an attractor: counts, sums of colours, densities, samples. Pictures of 17 million pixels take 70
/// (density alone, two threads) to 97 (colours, one thread).
const BYTES_PER_PIXEL: u64 = 97;
/// Size of an attractor over the default width of its points. Own: by eye; a smaller number draws coarser points.
const SIZE_PER_POINT_WIDTH: f64 = 800.0;
/// Largest share of escape tests that may fail: above it the system does not contract to an attractor.
const MAX_ESCAPED_SHARE: f64 = 1e-3;

/// The still points of an attractor (those of frame 0) as an asset, with its material, place and morph, before it is added to
/// the scene.
struct AttractorAsset {
    asset: Asset,
    /// The asset's only material.
    material: Material,
    /// World from asset space.
    transform: Trs,
    motion: Option<AttractorMorph>,
}

/// Adds the attractors of a recipe, each at the place that its keys give; a morph moves the points only in clips of several
/// frames.
/// # Errors
/// I023 if points escape, `Limit` beyond the points allowed, `Cancelled`.
pub(crate) fn add_ifs_attractors(recipe: &Recipe, builder: &mut SceneBuilder, context: &BakeContext<'_>) -> Result<()> {
    for attractor in &recipe.clouds {
        let material = index(builder.materials.len(), "materials of a scene")?;
        let moving = recipe.clip.len() > 1;
        let mut new = build_attractor(attractor, recipe.general.seed, moving, material, context)?;
        builder.make_id_unique(&mut new.asset.id, "_cloud");
        builder.materials.push(new.material);
        let motion = new.motion.map(|morph| Arc::new(morph) as Arc<dyn AssetMotion>);
        builder.add_placed(new.asset, new.transform, motion);
    }
    Ok(())
}

/// Draws the points of an attractor. `moving`: whether a morph moves them through the clip; `material`: index in the scene of
/// the attractor's material.
/// # Errors
/// I023 if points escape, `Limit` beyond the points allowed, `Cancelled`.
fn build_attractor(
    recipe: &AttractorRecipe,
    seed: u64,
    moving: bool,
    material: u32,
    context: &BakeContext<'_>,
) -> Result<AttractorAsset> {
    context.cancel.check()?;
    let keys = &recipe.keys;
    context.limits.check("points", u64::from(keys.points), "the number of points")?;
    // Metres per table unit, and the table point that becomes the asset's origin.
    let (low, high) = trimmed_bounds(recipe);
    let size = high - low;
    let scale = match keys.height {
        Some(h) if size.y > 0.0 => h / size.y,
        // A flat attractor that lies on the ground has no height: its widest extent takes its place.
        Some(h) => h / size.max_element().max(1e-30),
        None => 1.0,
    };
    let foot = match keys.foot {
        AttractorOrigin::Box => DVec3::new(0.5 * (low.x + high.x), low.y, 0.5 * (low.z + high.z)),
        AttractorOrigin::Origin => DVec3::ZERO,
    };
    let morph = recipe.morph.as_ref().map(|m| AttractorMorph::new(recipe, m, seed, foot, scale));
    // A morph draws the points of the first frame here; without a morph they are those of all frames.
    let mut cloud = match &morph {
        Some(morph) => morph.points_at(0.0),
        None => {
            let request = DrawRequest {
                system: &recipe.system,
                study: &recipe.study,
                seed,
                points: u64::from(keys.points),
                tier: InstructionSet::Best,
            };
            let mut drawn = cloud(&request, &color_labels(recipe), &recipe.extent, foot, scale);
            drop_hidden(&mut drawn, &recipe.system, seed);
            drawn
        }
    };
    check_escapes(recipe, cloud.escapes)?;
    // Points of one voxel are merged into one that carries their number; morph points must keep their order.
    let thin = keys.voxel > 0.0 && morph.is_none();
    let density = if thin { thin_to_voxels(&mut cloud, narrow(keys.voxel)) } else { Vec::new() };
    let default_width = size.max_element() * scale / SIZE_PER_POINT_WIDTH;
    let width = narrow(keys.point.unwrap_or(default_width)).max(1e-9);
    let color = mean_color(&cloud);
    let mut points = point_cloud(cloud, density, width, material);
    if let Some(morph) = morph.as_ref().filter(|_| moving) {
        points.moving = true;
        // Exporters write one extent for the whole clip.
        points.reach = morph.swept_bounds().union(Bounds::of(points.positions.iter().copied()));
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
        rigged: None,
    };
    let position = Vec3::from_array(keys.at.map(narrow));
    let transform = Trs { t: position, r: Quat::from_rotation_y(narrow(keys.turn)), ..Trs::IDENTITY };
    let material = point_material(&recipe.id, color);
    Ok(AttractorAsset { asset, material, transform, motion: morph.filter(|_| moving) })
}

/// Points of one width with the attributes that exporters write: `map` (last map), `depth`, and `density` (points merged).
fn point_cloud(cloud: AttractorPoints, density: Vec<u32>, width: f32, material: u32) -> Points {
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

fn point_material(id: &str, color: [f32; 3]) -> Material {
    Material { double_sided: true, ..Material::plain(id.to_owned(), MaterialClass::Leaf, color, 0.8) }
}

/// Mean colour of the first 4096 points, for formats that show one colour.
fn mean_color(cloud: &AttractorPoints) -> [f32; 3] {
    let some = cloud.colors.get(..cloud.colors.len().min(4096)).unwrap_or_default();
    let sum = some.iter().fold([0.0_f32; 3], |s, c| std::array::from_fn(|i| s[i] + c[i]));
    #[allow(clippy::cast_precision_loss, reason = "at most 4096")]
    let n = some.len().max(1) as f32;
    sum.map(|v| v / n)
}

/// Lower and upper corner, table units, of the part of an attractor that scales and fits refer to: its bounds, or the box of
/// its quantiles if it is unbounded.
pub(crate) fn trimmed_bounds(recipe: &AttractorRecipe) -> (DVec3, DVec3) {
    if recipe.study.unbounded { recipe.extent.quantile } else { recipe.extent.bounds }
}

/// # Errors
/// I023 if the share of points that escaped to infinity is above [`MAX_ESCAPED_SHARE`].
pub(crate) fn check_escapes(recipe: &AttractorRecipe, escapes: Escapes) -> Result<()> {
    #[allow(clippy::cast_precision_loss, reason = "a share")]
    let share = escapes.found as f64 / escapes.tests.max(1) as f64;
    if share <= MAX_ESCAPED_SHARE {
        return Ok(());
    }
    let reason =
        format!("\"{}\" diverges: {:.1} % of the tests find a point that escapes", recipe.system.name, share * 100.0);
    Err(Error::input("I023", reason))
}

/// Draws an attractor into a histogram and estimates its densities and colours from it. Also returns the tone mapping of the
/// keys and the linear colour of pixels where points are coloured by density only.
/// # Errors
/// I050 beyond the memory allowed, I023 if points escape, `Limit`, `Cancelled`.
pub fn ifs_density(
    recipe: &AttractorRecipe,
    scene: &Recipe,
    context: &BakeContext<'_>,
) -> Result<(Density, ToneMapping, [f32; 3])> {
    context.cancel.check()?;
    let keys = &scene.picture;
    // Refuse what would not fit before memory is spent.
    let side = u64::from(keys.width.max(keys.height)) * u64::from(keys.oversample);
    context.limits.check("image-side", side, "a side of the picture in pixels")?;
    let pixels = u64::from(keys.width) * u64::from(keys.height) * u64::from(keys.oversample * keys.oversample);
    check_picture_memory("the picture", pixels, context)?;
    let small = u64::from(keys.width) * u64::from(keys.height);
    let count = keys.points.map_or(DEFAULT_POINTS_PER_PIXEL * small, u64::from).max(1);
    context.limits.check("points", count, "the number of points")?;
    let colors = picture_labels(recipe);
    let cloud_keys = &recipe.keys;
    // Count the points that fall into each oversampled pixel, then estimate densities from the counts.
    let view = recipe.system.view.filter(|_| keys.fit == PictureFit::View);
    let system = system_turned_by_view(&recipe.system, view.as_ref());
    let request = DrawRequest {
        system: &system,
        study: &recipe.study,
        seed: scene.general.seed,
        points: count,
        tier: InstructionSet::Best,
    };
    let counts = histogram(&request, colors.as_ref(), &picture_window(recipe, keys, view.as_ref()));
    check_escapes(recipe, counts.escapes)?;
    context.cancel.check()?;
    let estimator = DensityEstimator { radius: keys.spread, minimum: keys.spread_min, curve: keys.spread_curve };
    let estimator = (keys.spread > 0.0).then_some(estimator);
    let drawn = picture_density(recipe, &counts, keys.oversample as usize, estimator, context)?;
    let tone = ToneMapping { exposure: keys.exposure, gamma: keys.gamma, background: keys.background };
    let flat = cloud_keys.colors.first().copied().unwrap_or([0.05, 0.15, 0.03]);
    Ok((drawn, tone, flat))
}

/// Refuses a picture of an attractor that takes more memory than the limit allows. `what`: the picture, for the message.
/// # Errors
/// I050.
pub(crate) fn check_picture_memory(what: &str, pixels: u64, context: &BakeContext<'_>) -> Result<()> {
    let subject = format!("the memory of {what} of {} pixels, in bytes,", grouped(pixels));
    let checked = context.limits.check("memory", pixels.saturating_mul(BYTES_PER_PIXEL), &subject);
    checked.map_err(|refused| Error::input("I050", refused.to_string()))
}

fn is_colored_by_density(recipe: &AttractorRecipe) -> bool {
    recipe.keys.color_by == ColorBy::Density
}

/// Labels of the points of a picture. A picture of the density alone needs them only where maps draw a share of their points.
pub(crate) fn picture_labels(recipe: &AttractorRecipe) -> Option<ColorLabels> {
    let is_shared = recipe.system.maps.iter().any(|m| m.opacity < 1.0);
    (is_shared || !is_colored_by_density(recipe)).then(|| color_labels(recipe))
}

/// The density of counts, with colours unless the recipe colours by density.
/// # Errors
/// `Cancelled`.
pub(crate) fn picture_density(
    recipe: &AttractorRecipe,
    counts: &Histogram,
    oversample: usize,
    estimator: Option<DensityEstimator>,
    context: &BakeContext<'_>,
) -> Result<Density> {
    let mut drawn = density(counts, oversample, estimator, context.cancel)?;
    if is_colored_by_density(recipe) {
        drawn.color.clear();
    }
    Ok(drawn)
}

fn color_labels(recipe: &AttractorRecipe) -> ColorLabels {
    ColorLabels::new(&recipe.system, color_mode(recipe.keys.color_by, recipe.keys.prefix), &recipe.keys.colors)
}

/// The system with a view's rotation about its centre as a last map.
/// Source: flam3 turns its points by `rotate` about the centre, with y down.
fn system_turned_by_view<'a>(system: &'a Ifs, view: Option<&PictureView>) -> Cow<'a, Ifs> {
    let Some(view) = view.filter(|v| v.rotate != 0.0) else { return Cow::Borrowed(system) };
    let center = DVec3::new(view.center[0], view.center[1], 0.0);
    let turn = turn_z(-view.rotate);
    let about = Affine { a: turn, b: center - turn * center };
    let last = system.last.map_or(about, |last| about.after(&last));
    Cow::Owned(Ifs { last: Some(last), ..system.clone() })
}

/// The window of a picture in table units: the view of a flame, or fitted to the attractor; the keys `center` and `span`
/// override either.
fn picture_window(recipe: &AttractorRecipe, keys: &PictureKeys, view: Option<&PictureView>) -> PictureWindow {
    let k = keys.oversample.max(1);
    let (width, height) = ((keys.width * k) as usize, (keys.height * k) as usize);
    let corners = if keys.fit == PictureFit::Quantile { recipe.extent.quantile } else { trimmed_bounds(recipe) };
    let mut fitted = PictureWindow::fitted(corners.0, corners.1, width, height);
    if let Some(v) = view {
        // The larger pixel of both axes shows all of the view in a picture of other proportions.
        let (across, down) = (v.width / f64::from(keys.width * k), v.width / v.aspect / f64::from(keys.height * k));
        fitted = PictureWindow { center: v.center, pixel: across.max(down), ..fitted };
    }
    let center = keys.center.unwrap_or(fitted.center);
    let pixel = keys.span.map_or(fitted.pixel, |s| s / f64::from(keys.width * k));
    PictureWindow { center, pixel, ..fitted }
}
