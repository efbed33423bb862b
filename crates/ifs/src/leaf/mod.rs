//! Leaves drawn by a system: silhouette, veins, relief and colours as maps, and a blade cut along the outline.
//!
//! # Examples
//! ```
//! use osier_base::limits::Limits;
//! use osier_ifs::leaf::{LeafSpec, leaf};
//! use osier_ifs::read::read;
//!
//! let text = b"fern { 0 0 0 .16 0 0 .01  .85 .04 -.04 .85 0 1.6 .85  .2 -.26 .23 .22 0 1.6 .07  -.15 .28 .26 .24 0 .44 .07 }";
//! let (systems, _) = read("fern.ifs", text, &Limits::default())?;
//! let traced = leaf(&systems[0], &LeafSpec { side: 64, ..LeafSpec::default() }).expect("an attractor");
//! assert!(!traced.flat.triangles.is_empty() && traced.raster.mask.cover() > 0.0);
//! # Ok::<(), osier_base::Error>(())
//! ```

mod blade;
mod drawn;
pub mod edt;
mod maps;
mod mask;
mod outline;
mod raster;
mod rib;

use crate::affine::AxisScaling;
use glam::{DMat3, DVec2, DVec3};

pub use blade::{BladePlacement, BladePose, FlatBlade, bent};
pub use drawn::{DrawnLeaf, LazyLeaf, hash, mapped};
pub use maps::{LeafColors, LeafFields, fields, normals};
pub use mask::{CleaningReport, Mask};

use super::Ifs;
use super::affine::{Affine, turn_z};
use super::cloud::DrawRequest;
use super::color::is_squash;
use super::dynamics::{SystemAnalysis, study};
use super::game::{InstructionSet, extent};
use super::weights::WeightRule;
use super::window::PictureWindow;
use osier_base::diagnostic::Diagnostic;
use rib::VeinPaths;

/// Share of the set pixels below which the largest part does not count as the whole leaf (I060).
const MIN_LARGEST_PART: f64 = 0.98;
/// Distance of a given anchor from the leaf, as a share of the side, from which I061 is reported.
const MAX_ANCHOR_OFFSET: f64 = 0.02;
/// Side of the picture, pixels, that lengths of [`LeafSpec`] refer to.
const REFERENCE_SIDE: f64 = 1024.0;

/// Parameters of tracing a leaf. Lengths in pixels are those of a picture of 1024 pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct LeafSpec {
    /// Pixels along a side of the maps, 64..=4096.
    pub side: usize,
    /// Points drawn per pixel of the map.
    pub points: u64,
    /// Least hits of a pixel inside the silhouette; 0 counts as 1.
    pub min_hits: u32,
    /// Gaps up to twice this wide are closed, pixels.
    pub close: f64,
    /// Area of the largest hole that is filled, as a share of the picture.
    pub fill: f64,
    /// Where the stalk meets the blade, table units; `None`: found.
    pub anchor: Option<[f64; 2]>,
    /// Largest distance between the outline of the mesh and that of the leaf, pixels.
    pub detail: f64,
    /// Points of the midrib, at equal distances; between them the mesh has edges to fold along.
    pub rib: usize,
    /// Strength of the veins that the density of points shows.
    pub vein: f32,
    /// Whether holes of the leaf are cut into the mesh as well.
    pub holes: bool,
}

impl Default for LeafSpec {
    fn default() -> Self {
        Self {
            side: 1024,
            points: 20,
            min_hits: 1,
            close: 2.0,
            fill: 5e-3,
            anchor: None,
            detail: 8.0,
            rib: 8,
            vein: 1.0,
            holes: false,
        }
    }
}

/// A leaf on its pixels, turned so that its tip points up; rows from the top.
#[derive(Debug, Clone, PartialEq)]
pub struct LeafRaster {
    /// Silhouette: closed gaps, only the largest part, small holes filled.
    pub mask: Mask,
    /// Points counted by pixel, without those beyond the picture.
    pub hits: Vec<u32>,
    /// The most frequent map of each pixel, modulo 4.
    pub letter: Vec<u8>,
    /// Signed distance to the margin, pixels, above 0 inside.
    pub sd: Vec<f32>,
    /// Index of the nearest pixel inside the silhouette: y times the side plus x.
    pub nearest: Vec<u32>,
    /// Place along the midrib, 0 at the anchor to 1 at the tip.
    pub along: Vec<f32>,
    /// Cover of traced veins, 0..1.
    pub vein: Vec<f32>,
}

/// A traced leaf in pixels, before it is scaled to a size.
#[derive(Debug, Clone, PartialEq)]
pub struct TracedLeaf {
    /// Silhouette, hits, distances and veins by pixel.
    pub raster: LeafRaster,
    /// Outline and, if asked for, holes; pixels, y up, outline counter-clockwise.
    pub rings: Vec<Vec<DVec2>>,
    /// Triangulated blade, pixels of the raster, y up.
    pub flat: FlatBlade,
    /// Anchor and midrib of the blade on the raster, pixels, y up.
    pub place: BladePlacement,
    /// Anchor and tip, table units, as in the table: before the leaf is turned upright.
    pub ends: [DVec2; 2],
    /// Number of parts and holes that cleaning the silhouette found, dropped or filled.
    pub cleaned: CleaningReport,
    /// Warnings about the silhouette and the anchor (I060, I061).
    pub warnings: Vec<Diagnostic>,
}

/// Traces the attractor of a plane system as a leaf: silhouette, veins and a triangulated blade.
/// Source: [wang-hao] 3.2.2: the iterated function system at the terminals of a plant.
/// Differs: the paper paints its points at every terminal; here they become one leaf that is instanced.
/// # Errors
/// I023 for a system without attractor, I060 for an empty picture.
pub fn leaf(ifs: &Ifs, spec: &LeafSpec) -> Result<TracedLeaf, Box<Diagnostic>> {
    let rule = ifs.weights.unwrap_or(WeightRule::Det);
    // First a coarse picture: anchor and tip give the direction of the leaf.
    let ends = anchor_and_tip(ifs, rule, spec)?;
    let along = ends[1] - ends[0];
    // Turn the system so that the tip points up, and draw it at full size.
    let turn = std::f64::consts::FRAC_PI_2 - osier_base::math::atan2(along.y, along.x);
    let turned = turned(ifs, turn);
    let up = |p: DVec2| (turn_z(turn) * p.extend(0.0)).truncate();
    let (counts, window) = count_hits(&turned, &study(&turned, rule), spec.side, spec.points)?;
    let (n, unit) = (spec.side, side(spec.side) / REFERENCE_SIDE);
    let mut warnings = Vec::new();
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of the pixels")]
    // Silhouette: close gaps, keep the largest part, fill small holes.
    let hole = (spec.fill * side(n * n)) as usize;
    let (mask, cleaned) = counts.mask(n, spec.min_hits).clean(spec.close * unit, hole).ok_or_else(|| empty(ifs))?;
    if cleaned.largest < MIN_LARGEST_PART {
        let text = format!(
            "the leaf consists of {} parts, the largest holds {:.1} %",
            cleaned.components,
            cleaned.largest * 100.0
        );
        let d = Diagnostic::warning("I060", text, ifs.span, "in this system");
        warnings.push(d.help("the largest is used; raise close_px to bridge the gaps"));
    }
    let (sd, nearest) = edt::signed(&mask.set, n, n);
    // The anchor must be a pixel of the leaf for paths to start from.
    let foot = pixel_index(&window, up(ends[0]));
    let anchor = if mask.set[foot] { foot } else { nearest[foot] as usize };
    if f64::from(sd[foot]) < -MAX_ANCHOR_OFFSET * side(n) && spec.anchor.is_some() {
        let d = Diagnostic::warning("I061", "the anchor lies outside the leaf", ifs.span, "in this system");
        warnings.push(d.help("it was moved to the nearest point of the leaf"));
    }
    let paths = VeinPaths::new(&mask, &sd, anchor);
    // The tip is the farthest pixel that a path connects to the anchor.
    let reached = |i: &usize| mask.set[*i] && (*i == anchor || paths.path_to_anchor(*i).len() > 1);
    let far = |i: &usize| paths.point(*i).distance_squared(paths.point(anchor));
    let tip =
        (0..n * n).filter(|i| mask.set[*i]).max_by(|a, b| far(a).total_cmp(&far(b))).filter(reached).unwrap_or(anchor);
    let outline = outline_of(&mask, unit);
    // Veins run from the tips of the lobes to the anchor and are wider where more of them join.
    let tips = lobe_tips(&outline, &mask, &nearest, unit);
    let vein = veins(&paths, &tips, unit);
    let (a, t) = (paths.point(anchor), paths.point(tip));
    let length = (a.y - t.y).max(1.0);
    #[allow(clippy::cast_precision_loss, reason = "rows")]
    let place_of = |i: usize| osier_base::math::narrow((a.y - (i / n) as f64 - 0.5) / length).clamp(0.0, 1.0);
    let flip = |p: DVec2| DVec2::new(p.x, side(n) - p.y);
    // Midrib: the path from the anchor to the tip, smoothed and resampled at even steps.
    let mut line: Vec<DVec2> = paths.path_to_anchor(tip).iter().rev().map(|i| flip(paths.point(*i))).collect();
    line = smoothed_line(&line, 0.02 * side(n));
    let midrib = rib::resampled(&line, spec.rib);
    let rings: Vec<Vec<DVec2>> = outline
        .iter()
        .take(if spec.holes { usize::MAX } else { 1 })
        .map(|r| outline::simplified(&r.iter().map(|p| flip(*p)).collect::<Vec<_>>(), spec.detail * unit))
        .filter(|r| r.len() >= 3)
        .collect();
    #[allow(clippy::cast_precision_loss, reason = "a few points")]
    // The mesh: simplified rings, the midrib as an edge to fold along, points between them.
    let spacing = flip(t).distance(flip(a)) / spec.rib.max(2) as f64;
    let flat = blade::flat(&rings, &midrib, spacing.max(4.0 * unit));
    // A pixel well inside the blade near the anchor gives the petiole its colour.
    let solid = paths.path_to_anchor(tip).into_iter().rev().find(|i| f64::from(sd[*i]) > 2.5 * unit).unwrap_or(tip);
    let starts = midrib.iter().find(|p| rings.first().is_some_and(|r| outline::inside(r, **p)));
    let start = starts.map_or(0.0, |p| (p.y - flip(a).y).max(0.0));
    let place = BladePlacement { side: side(n), anchor: flip(a), midrib, solid: flip(paths.point(solid)), start };
    let raster = LeafRaster {
        along: (0..n * n).map(place_of).collect(),
        hits: counts.hits(),
        letter: counts.letters(),
        mask,
        sd,
        nearest,
        vein,
    };
    Ok(TracedLeaf { raster, rings, flat, place, ends, cleaned, warnings })
}

#[allow(clippy::cast_precision_loss, reason = "pixels")]
fn side(n: usize) -> f64 {
    n as f64
}

fn empty(ifs: &Ifs) -> Box<Diagnostic> {
    let d = Diagnostic::about("I060", format!("\"{}\" leaves no mark on its picture", ifs.name));
    Box::new(d.help("fewer min_hits, or more points"))
}

/// The same system turned about the origin.
fn turned(ifs: &Ifs, angle: f64) -> Ifs {
    let (r, back) = (turn_z(angle), turn_z(-angle));
    // The third row and column of plane maps stay 0.
    let plane = DMat3::from_diagonal(DVec3::new(1.0, 1.0, 0.0));
    let mut out = ifs.clone();
    for m in &mut out.maps {
        m.affine = Affine { a: plane * r * m.affine.a * back * plane, b: r * m.affine.b };
    }
    out
}

/// Hit counts of a square picture that shows the whole attractor.
fn count_hits(
    ifs: &Ifs,
    study: &SystemAnalysis,
    n: usize,
    points: u64,
) -> Result<(raster::MapHitCounts, PictureWindow), Box<Diagnostic>> {
    let extent = extent(ifs, study)?;
    let bounds = if study.unbounded { extent.quantile } else { extent.bounds };
    let window = PictureWindow::fitted(bounds.0, bounds.1, n, n);
    let points = points.max(1) * (n * n) as u64;
    let request = DrawRequest { system: ifs, study, seed: 0, points, tier: InstructionSet::Best };
    Ok((raster::count(&request, &window), window))
}

/// Anchor and tip, table units, found on a picture of a quarter of the size.
fn anchor_and_tip(ifs: &Ifs, rule: WeightRule, spec: &LeafSpec) -> Result<[DVec2; 2], Box<Diagnostic>> {
    let n = (spec.side / 4).max(64);
    let unit = side(n) / REFERENCE_SIDE;
    let (counts, window) = count_hits(ifs, &study(ifs, rule), n, spec.points)?;
    let (mask, _) = counts.mask(n, spec.min_hits).clean(spec.close * unit, 0).ok_or_else(|| empty(ifs))?;
    let set: Vec<usize> = (0..n * n).filter(|i| mask.set[*i]).collect();
    let at = |i: usize| table_point(&window, i);
    // The anchor: as given, the fixed point of the lowest stem map, or the lowest point on the principal axis.
    let stem = ifs.maps.iter().filter(|m| m.stem || is_squash(m)).filter_map(|m| m.affine.fixed_point());
    let lowest = stem.min_by(|a, b| a.y.total_cmp(&b.y)).map(|p| p.truncate());
    let anchor = match (spec.anchor, lowest) {
        (Some(a), _) => DVec2::from_array(a),
        (None, Some(p)) => p,
        (None, None) => base_point(&set.iter().map(|i| at(*i)).collect::<Vec<_>>(), window.pixel),
    };
    let far = |i: &usize| at(*i).distance_squared(anchor);
    let tip = set.iter().max_by(|a, b| far(a).total_cmp(&far(b))).map_or(anchor, |i| at(*i));
    Ok([anchor, tip])
}

/// The lowest of the points within 1.5 pixels of their principal axis, or of the vertical if that axis is nearer to horizontal;
/// their mean if none is that near.
#[allow(clippy::cast_precision_loss, reason = "pixels")]
fn base_point(points: &[DVec2], pixel: f64) -> DVec2 {
    let n = points.len().max(1) as f64;
    let mean = points.iter().fold(DVec2::ZERO, |s, p| s + *p) / n;
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for p in points {
        let d = *p - mean;
        (xx, xy, yy) = (xx + d.x * d.x, xy + d.x * d.y, yy + d.y * d.y);
    }
    // Principal axis of the second moments: tan 2a = 2 Sxy / (Sxx - Syy).
    let angle = 0.5 * osier_base::math::atan2(2.0 * xy, xx - yy);
    let axis = DVec2::new(osier_base::math::cos(angle), osier_base::math::sin(angle));
    // A leaf that is wider than long still hangs from its foot.
    let axis = if axis.y.abs() < 0.5 { DVec2::Y } else { axis };
    let on = points.iter().filter(|p| (**p - mean).perp_dot(axis).abs() < 1.5 * pixel);
    on.copied().min_by(|a, b| a.y.total_cmp(&b.y)).unwrap_or(mean)
}

#[allow(clippy::cast_precision_loss, reason = "pixels")]
fn table_point(window: &PictureWindow, i: usize) -> DVec2 {
    let AxisScaling { scale, shift } = window.frame();
    let p = DVec2::new((i % window.width) as f64 + 0.5, (i / window.width) as f64 + 0.5);
    (p - shift.truncate()) / scale.truncate()
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped into the picture")]
fn pixel_index(window: &PictureWindow, p: DVec2) -> usize {
    let AxisScaling { scale, shift } = window.frame();
    let q = p * scale.truncate() + shift.truncate();
    let inside = |v: f64, n: usize| v.clamp(0.0, side(n) - 1.0) as usize;
    inside(q.y, window.height) * window.width + inside(q.x, window.width)
}

/// Rings of a mask in pixels, y down: the longest first, then holes inside it by size.
fn outline_of(mask: &Mask, unit: f64) -> Vec<Vec<DVec2>> {
    let n = mask.side;
    let hard: Vec<f32> = mask.set.iter().map(|s| if *s { 1.0 } else { 0.0 }).collect();
    let soft = maps::blurred(&hard, n, osier_base::math::narrow(unit));
    let mut rings = outline::rings(&soft, n);
    rings.sort_by(|a, b| outline::area2(b).abs().total_cmp(&outline::area2(a).abs()));
    let sign = rings.first().map_or(0.0, |r| outline::area2(r).signum());
    // Holes run opposite to the outline; other outer rings are leftover specks.
    let mut first = true;
    rings.retain(|r| std::mem::take(&mut first) || outline::area2(r) * sign < 0.0);
    rings
}

/// Ends of lobes: sharp corners of a coarse outline, as pixels of the leaf.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "inside the picture")]
fn lobe_tips(rings: &[Vec<DVec2>], mask: &Mask, nearest: &[u32], unit: f64) -> Vec<usize> {
    let Some(ring) = rings.first() else { return Vec::new() };
    let coarse = outline::simplified(ring, 14.0 * unit);
    let n = coarse.len();
    let sign = outline::area2(&coarse).signum();
    // A convex corner turned by more than 78 degrees between two edges of some length.
    let sharp = |i: &usize| {
        let (a, b, c) = (coarse[(i + n - 1) % n], coarse[*i], coarse[(i + 1) % n]);
        let (u, v) = ((b - a).normalize_or_zero(), (c - b).normalize_or_zero());
        u.perp_dot(v) * sign > 0.0 && u.dot(v) < 0.2 && (b - a).length().min((c - b).length()) > 16.0 * unit
    };
    let of = |i: usize| {
        let inside = |v: f64| v.clamp(0.0, side(mask.side) - 1.0) as usize;
        let p = inside(coarse[i].y) * mask.side + inside(coarse[i].x);
        if mask.set[p] { p } else { nearest[p] as usize }
    };
    (0..n).filter(sharp).map(of).collect()
}

/// Share of each pixel that veins cover, 0..1; a vein is wider the more lobes it serves.
#[allow(clippy::cast_possible_truncation, clippy::cast_possible_wrap, clippy::cast_sign_loss, reason = "a few pixels")]
fn veins(paths: &VeinPaths, tips: &[usize], unit: f64) -> Vec<f32> {
    // Draw each pixel of a path as a disc; overlapping discs keep the strongest value.
    let loads = paths.tip_counts(tips);
    let most = loads.iter().copied().max().unwrap_or(0).max(1);
    let n = osier_base::math::sqrt(side(loads.len())) as isize;
    let mut out = vec![0.0_f32; loads.len()];
    for (i, load) in loads.iter().enumerate().filter(|(_, l)| **l > 0) {
        // The width grows with the square root of the number of tips served: cross-sections add up (pipe model).
        let share = osier_base::math::sqrt(f64::from(*load) / f64::from(most));
        let radius = (0.7 + 3.6 * share) * unit;
        let strength = osier_base::math::narrow(0.45 + 0.55 * share);
        let reach = radius.ceil() as isize;
        let (x, y) = (i as isize % n, i as isize / n);
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                let (u, v) = (x + dx, y + dy);
                let near = ((dx * dx + dy * dy) as f64) <= radius * radius + 0.01;
                if near && u >= 0 && v >= 0 && u < n && v < n {
                    let cell = &mut out[(v * n + u) as usize];
                    *cell = cell.max(strength);
                }
            }
        }
    }
    out
}

/// Moving average of a line over `window` pixels to each side; its ends stay in place.
fn smoothed_line(line: &[DVec2], window: f64) -> Vec<DVec2> {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few pixels")]
    let reach = window.max(1.0) as usize;
    (0..line.len())
        .map(|i| {
            let r = reach.min(i).min(line.len() - 1 - i);
            let part = &line[i - r..=i + r];
            part.iter().fold(DVec2::ZERO, |s, p| s + *p) / side(part.len())
        })
        .collect()
}

#[cfg(test)]
mod tests;
