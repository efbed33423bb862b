//! Bending elements of a plant: which stretches of axes bend, how stiff and heavy they are, and where the wind acts on
//! them.

use std::ops::Range;

use glam::{DVec3, Quat};

use super::beam::{CantileverBeam, SlopeProfile, rotation_f32, second_mode_slope};
use super::segments::{AxisSegment, AxisSegments, BranchLoad};
use super::wood::{WoodParams, damping_ratio};
use crate::sway::tuning::{
    CROWN_SHELTER, FREQUENCY_SPREAD, MIN_HZ, MODE_SPLIT, SELF_WEIGHT_SLOPE, SELF_WEIGHT_STIFFENING, WIND_SLOPE,
    WIND_STIFFENING,
};
use osier_base::math;
use osier_base::rng;
use osier_scene::plant::{Axis, AxisKind, NONE, Plant};

/// A stretch of an axis that bends as one cantilever.
#[derive(Debug, Clone)]
pub struct BeamElement {
    /// Index of the plant's axis that it is a part of.
    pub axis: u32,
    /// Range of arc length on the axis, m.
    pub span: [f32; 2],
    /// Index of the carrying element, which is lower than that of this element, or [`NONE`] for the ground.
    pub parent: u32,
    /// Position on the carrier, 0 at its base to 1 at its tip.
    pub at: f64,
    /// Branching order of its axis; 0 is the trunk.
    pub order: u8,
    /// Random key, stable while the plant is edited elsewhere.
    pub id: u64,
    /// Base at rest in the plant's space, m.
    pub base: DVec3,
    /// Direction of growth at its base, at rest.
    pub up: DVec3,
    /// Rotation axes of its two bending directions, at rest, perpendicular to `up`.
    pub bend_axes: [DVec3; 2],
    /// Length from base to tip at rest, m.
    pub length: f64,
    /// Vector from its base to its tip at rest, m.
    pub chord: DVec3,
    /// Slope of its tip per unit force across it there, 1/N.
    pub tip_compliance: f64,
    /// Slope of its tip under a dynamic pressure of 1 Pa on everything that it carries, rad/Pa.
    pub pressure_slope: f64,
    /// Range of its stations in [`BeamElements::stations`].
    pub stations: Range<usize>,
    /// Tip slope of the carrier per unit force at this element's base, 1/N.
    pub carrier_compliance: f64,
    /// Natural angular frequency of both bending directions, rad/s.
    pub w: [f64; 2],
    /// Damping ratio of both bending directions, 1 at critical damping.
    pub damping_ratio: f64,
    /// Slope along it relative to that of its tip, in the first mode.
    pub shape: SlopeProfile,
    /// Index of its second mode among all bends, behind the first modes of all elements.
    pub second_mode: Option<usize>,
}

/// A stretch of an element over which wind and inertia are lumped.
#[derive(Debug, Clone, Copy)]
pub struct LoadStation {
    /// Middle of the stretch along the element, 0 to 1.
    pub middle: f64,
    /// Position at rest, m.
    pub p: DVec3,
    /// Unit direction of growth at rest.
    pub along: DVec3,
    /// Start of the stretch at rest, m.
    pub from: DVec3,
    /// Vector from start to end of the stretch at rest, m.
    pub chord: DVec3,
    /// Drag areas, m^2, and mass, kg, of the stretch.
    pub load: BranchLoad,
    /// Tip slope per unit force, 1/N, of drag and of inertia, weighted by area and by mass.
    pub tip_compliances: [f64; 2],
    /// Share of the undisturbed wind that reaches it.
    pub open: f32,
}

/// A position on a plant in terms of bending elements.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ElementLocation {
    /// Index of the element, or [`NONE`] for a position that does not move.
    pub element: u32,
    /// Position along it, 0 to 1.
    pub at: f64,
}

/// An [`ElementLocation`] with the relative slopes there, evaluated once for all frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoundLocation {
    /// Index of the element, or [`NONE`] for a position that does not move.
    element: u32,
    /// Slope here divided by that of the tip, in the first and in the second mode; 0 without a second mode.
    relative_slopes: [f64; 2],
}

/// All bending elements of a plant; a carrier precedes the elements on it.
#[derive(Debug, Clone, Default)]
pub struct BeamElements {
    /// Elements; [`BeamElement::parent`] names them by index.
    pub list: Vec<BeamElement>,
    /// Stations of all elements; [`BeamElement::stations`] names those of one.
    pub stations: Vec<LoadStation>,
    /// Indices of the elements by branching order, then by falling length of their axis.
    pub ranked: Vec<u32>,
    /// Per axis: end of each segment, m, and its element or [`NONE`].
    parts: Vec<Vec<(f32, u32)>>,
    /// Per axis: location of its base.
    carriers: Vec<ElementLocation>,
    /// Per element: location of its base on the element that carries it.
    bases: Vec<BoundLocation>,
}

impl BeamElements {
    /// Selects and measures the elements of a plant, at most `budget`. Segments beyond the budget are rigid with their carrier
    /// and add to its load.
    /// Source: the hierarchy of [zhao-zhang] 3.2, one element for a branch instead of for an internode.
    pub fn build(plant: &Plant, wood: &WoodParams, budget: usize) -> Self {
        // Rank all segments by size, then select within the budget.
        let segments = AxisSegments::from_plant(plant, wood);
        let ranked = segments.ranked_by_size(plant);
        let kept = segments.select(&ranked, budget);
        let source =
            ElementContext { plant, wood, segments: &segments, kept: &kept, crown: CrownEllipsoid::from_plant(plant) };
        let mut all = Self {
            parts: vec![Vec::new(); plant.axes.len()],
            carriers: vec![ElementLocation { element: NONE, at: 0.0 }; plant.axes.len()],
            ..Self::default()
        };
        let mut index = vec![NONE; segments.list.len()];
        // Tip compliance along each element, by segment; the compliance of the carrier at the base of a child is looked up in it.
        let mut slopes = vec![None; segments.list.len()];
        let mut next = 0_u32..;
        for (i, segment) in segments.list.iter().enumerate() {
            // Parents precede their children, so that their element exists already.
            if kept[i] {
                index[i] = next.next().unwrap_or(NONE);
                let parent = segment.parent.map_or(NONE, |p| index[p]);
                let carrier = segment.parent.and_then(|p| slopes[p].as_ref());
                slopes[i] = Some(all.add_element(&source, i, parent, carrier));
            }
            all.parts[segment.axis as usize].push((segment.span[1], index[i]));
        }
        all.number_second_modes(wood);
        all.bases = all.list.iter().map(|e| all.bind(ElementLocation { element: e.parent, at: e.at })).collect();
        all.ranked = ranked.iter().filter(|i| kept[**i]).map(|i| index[*i]).collect();
        all.find_carriers(plant);
        all
    }

    /// Adds the element of segment `i` and returns its tip compliance. `parent`: index of the carrying element, or
    /// [`NONE`]; `carrier`: tip compliance of that element.
    fn add_element(
        &mut self,
        source: &ElementContext<'_>,
        i: usize,
        parent: u32,
        carrier: Option<&TipCompliance>,
    ) -> TipCompliance {
        let segment = &source.segments.list[i];
        let axis = source.axis(segment);
        // Beam properties first: they need the loads of everything that the segment carries.
        let measured = ElementBeam::new(source, i);
        let site = source.plant.frame(axis, segment.span[0]);
        let frame = site.q.as_dquat();
        let id = rng::child(axis.id, u64::from(segment.number));
        let (at, carrier_compliance) = self.locate_on_carrier(segment, parent, carrier);
        let first = self.stations.len();
        self.stations.extend(measured.load_stations(source, segment));
        let bare = if source.crown.bare { 0.5 } else { 1.0 };
        self.list.push(BeamElement {
            axis: segment.axis,
            span: segment.span,
            parent,
            at,
            order: axis.order,
            id,
            base: site.p.as_dvec3(),
            up: frame * DVec3::Y,
            bend_axes: [frame * DVec3::X, frame * DVec3::Z],
            length: f64::from(segment.span[1] - segment.span[0]),
            chord: (source.plant.frame(axis, segment.span[1]).p - site.p).as_dvec3(),
            tip_compliance: measured.compliance.last().copied().unwrap_or(0.0),
            pressure_slope: measured.pressure_slope,
            stations: first..self.stations.len(),
            carrier_compliance,
            w: measured.mode_frequencies(source, segment, id),
            damping_ratio: source.wood.damping * damping_ratio(axis.order, axis.kind == AxisKind::Petiole) * bare,
            shape: measured.shape,
            second_mode: None,
        });
        TipCompliance { x: measured.beam.x, compliance: measured.compliance }
    }

    /// Position of a segment on its carrier, 0 to 1, and the carrier's tip slope per unit force there, 1/N.
    fn locate_on_carrier(&self, segment: &AxisSegment, parent: u32, carrier: Option<&TipCompliance>) -> (f64, f64) {
        let Some((element, slopes)) = self.list.get(parent as usize).zip(carrier) else { return (0.0, 0.0) };
        // Arc length from the base of the carrier, whose compliance is interpolated between its stations.
        let s = f64::from(segment.parent_s - element.span[0]);
        let at = if element.length > 0.0 { (s / element.length).clamp(0.0, 1.0) } else { 0.0 };
        (at, interpolate(&slopes.x, &slopes.compliance, s))
    }

    /// Numbers the second modes of trunks and main branches, behind the first modes of all elements.
    fn number_second_modes(&mut self, wood: &WoodParams) {
        let behind = self.list.len()..;
        for (place, element) in behind.zip(self.list.iter_mut().filter(|e| wood.second_modes && e.order <= 1)) {
            element.second_mode = Some(place);
        }
    }

    /// Number of bends: first modes of all elements, then second modes.
    pub fn bend_count(&self) -> usize {
        self.list.len() + self.list.iter().filter(|e| e.second_mode.is_some()).count()
    }

    fn find_carriers(&mut self, plant: &Plant) {
        for (i, axis) in plant.axes.iter().enumerate() {
            if axis.parent != NONE {
                self.carriers[i] = self.locate(axis.parent, axis.parent_s);
            }
        }
    }

    /// Location of arc length `s`, m, of an axis; on a rigid part, the nearest location below it that bends.
    pub fn locate(&self, axis: u32, s: f32) -> ElementLocation {
        let Some(parts) = self.parts.get(axis as usize) else { return ElementLocation { element: NONE, at: 0.0 } };
        // Walk along the segments of the axis; a segment without an element follows the last one that has an element.
        let mut last = self.carriers[axis as usize];
        for (end, element) in parts {
            let Some(e) = self.list.get(*element as usize) else { break };
            let at = f64::from(s - e.span[0]) / e.length.max(1e-9);
            last = ElementLocation { element: *element, at: at.clamp(0.0, 1.0) };
            if s < *end {
                break;
            }
        }
        last
    }

    /// Rotations of the bases of all elements from rest. `bends`: both angles of each element, rad, then those of second modes.
    pub fn base_rotations(&self, bends: &[[f32; 2]]) -> Vec<Quat> {
        let mut bases: Vec<Quat> = Vec::with_capacity(self.list.len());
        for location in &self.bases {
            let base = self.rotation_at(&bases, bends, *location);
            bases.push(base);
        }
        bases
    }

    /// [`Self::base_rotations`] of `chosen` elements, in rising order with all elements that carry them; the identity for the
    /// others.
    pub(crate) fn base_rotations_of(&self, bends: &[[f32; 2]], chosen: &[u32]) -> Vec<Quat> {
        let mut bases = vec![Quat::IDENTITY; self.list.len()];
        for element in chosen.iter().map(|e| *e as usize) {
            bases[element] = self.rotation_at(&bases, bends, self.bases[element]);
        }
        bases
    }

    /// Evaluates the slopes of an element at a location, for [`Self::rotation_at`].
    pub fn bind(&self, spot: ElementLocation) -> BoundLocation {
        let relative_slopes = self.list.get(spot.element as usize).map_or([0.0; 2], |e| {
            [e.shape.at(spot.at), if e.second_mode.is_some() { second_mode_slope(spot.at) } else { 0.0 }]
        });
        BoundLocation { element: spot.element, relative_slopes }
    }

    /// Rotation of a location from rest. `bases`: from [`BeamElements::base_rotations`] for the same bends.
    pub fn rotation_at(&self, bases: &[Quat], bends: &[[f32; 2]], spot: BoundLocation) -> Quat {
        let k = spot.element as usize;
        let (Some(e), Some(base)) = (self.list.get(k), bases.get(k)) else { return Quat::IDENTITY };
        let Some(b) = bends.get(k) else { return *base };
        let along =
            |b: &[f32; 2], share: f64| (e.bend_axes[0] * f64::from(b[0]) + e.bend_axes[1] * f64::from(b[1])) * share;
        // Small-angle composition: rotation vectors of both directions and both modes add up before the exponential.
        let [first, second] = spot.relative_slopes;
        let mut bend = along(b, first);
        if let Some(b) = e.second_mode.and_then(|k| bends.get(k)) {
            bend += along(b, second);
        }
        *base * rotation_f32(bend.as_vec3())
    }

    /// Slopes of the elements' bases under a dynamic pressure of 1 Pa, rad/Pa: sums over the elements that carry them.
    pub(crate) fn base_slopes(&self) -> Vec<f64> {
        let mut bases: Vec<f64> = Vec::with_capacity(self.list.len());
        for e in &self.list {
            let base = self.slope_at(&bases, ElementLocation { element: e.parent, at: e.at });
            bases.push(base);
        }
        bases
    }

    /// Slope of a location under a dynamic pressure of 1 Pa, rad/Pa. `bases`: from [`Self::base_slopes`].
    pub(crate) fn slope_at(&self, bases: &[f64], spot: ElementLocation) -> f64 {
        let k = spot.element as usize;
        let (Some(e), Some(base)) = (self.list.get(k), bases.get(k)) else { return 0.0 };
        base + e.pressure_slope * e.shape.at(spot.at)
    }

    /// Share of the undisturbed wind at a location, 0 to 1: the mean over the stations of its element; 1 where nothing bends.
    pub fn wind_exposure(&self, spot: ElementLocation) -> f32 {
        let stations = self.list.get(spot.element as usize).and_then(|e| self.stations.get(e.stations.clone()));
        stations.map_or(1.0, |list| list.iter().map(|s| s.open).sum::<f32>() / list.len().max(1) as f32)
    }
}

/// Ellipsoid around the foliage, inside of which the wind is weaker.
struct CrownEllipsoid {
    middle: DVec3,
    radii: DVec3,
    bare: bool,
}

impl CrownEllipsoid {
    fn from_plant(plant: &Plant) -> Self {
        let places = plant.organs.iter().map(|o| plant.organ_site(o).0);
        let b = osier_base::geometry::Bounds::of(places);
        if b.is_empty() {
            return Self { middle: DVec3::ZERO, radii: DVec3::ZERO, bare: true };
        }
        Self { middle: b.center().as_dvec3(), radii: b.size().as_dvec3() * 0.5, bare: false }
    }

    /// Share of the undisturbed wind at a position in plant space, m: 1 at the surface of the crown, least at its centre.
    fn wind_exposure(&self, p: DVec3) -> f32 {
        if self.radii.min_element() <= 0.0 {
            return 1.0;
        }
        // 0 at the surface of the ellipsoid, 1 at its centre.
        let depth = (1.0 - ((p - self.middle) / self.radii).length()).clamp(0.0, 1.0);
        math::narrow(1.0 - CROWN_SHELTER * depth)
    }
}

struct ElementContext<'a> {
    plant: &'a Plant,
    wood: &'a WoodParams,
    segments: &'a AxisSegments,
    kept: &'a [bool],
    crown: CrownEllipsoid,
}

impl ElementContext<'_> {
    fn axis(&self, segment: &AxisSegment) -> &Axis {
        &self.plant.axes[segment.axis as usize]
    }
}

/// Tip slope per unit force, 1/N, at positions along a segment, m.
#[derive(Debug, Clone)]
struct TipCompliance {
    x: Vec<f64>,
    compliance: Vec<f64>,
}

/// Beam of a segment with everything that it carries, lumped at its stations.
struct ElementBeam {
    beam: CantileverBeam,
    /// Per station: its wood and leaves, and the segments that are rigid with it.
    own: Vec<BranchLoad>,
    /// Tip slope per unit force at each station, 1/N.
    compliance: Vec<f64>,
    /// Tip slope under a dynamic pressure of 1 Pa, rad/Pa.
    pressure_slope: f64,
    shape: SlopeProfile,
}

impl ElementBeam {
    fn new(&ElementContext { plant, wood, segments, kept, .. }: &ElementContext<'_>, i: usize) -> Self {
        let segment = &segments.list[i];
        // The user's factor on the stiffness is applied last, to the stiffness with which the wood carries its weight.
        let mut beam = segments.beam(plant, &WoodParams { stiffness: 1.0, ..*wood }, i);
        let mut own: Vec<BranchLoad> = segments.wood_along(plant, wood, i, beam.x.len());
        for (s, load) in &segment.leaves {
            distribute_load(&beam.x, &mut own, f64::from(s - segment.span[0]), *load);
        }
        let mut hung = vec![BranchLoad::default(); beam.x.len()];
        // Loads of children. The mass of a child that is an element is carried here, but the wind acts on it at the child's own stations.
        for child in &segment.children {
            let (s, load) = (f64::from(segments.list[*child].parent_s - segment.span[0]), segments.list[*child].total);
            distribute_load(&beam.x, if kept[*child] { &mut hung } else { &mut own }, s, load);
        }
        beam.mass = own.iter().zip(&hung).map(|(o, h)| o.mass + h.mass).collect();
        let (axis, [from, to]) = (&plant.axes[segment.axis as usize], segment.span);
        let along = (plant.frame(axis, to).p - plant.frame(axis, from).p).as_dvec3().normalize_or(DVec3::Y);
        let drag = |l: &BranchLoad| wood.drag * l.wood + wood.leaf_drag * l.leaf;
        let wind: Vec<f64> = own.iter().zip(&hung).map(|(o, h)| drag(o) + drag(h)).collect();
        // Stems and blades of grass are as flexible as drawn; branches have grown under their weight and the wind.
        let by_wind = if axis.order > 0 { wind_stiffening(&beam, &wind) } else { 1.0 };
        beam.stiffen(self_weight_stiffening(&beam, along).max(by_wind) * wood.stiffness);
        let shape =
            wood.measured.then(|| beam.relative_slope(&wind)).flatten().map_or(SlopeProfile::Even, SlopeProfile::Table);
        let compliance = beam.compliance();
        // A pressure acts on drag areas; each station's force adds its part of the tip's slope.
        let pressure_slope = compliance.iter().zip(&wind).fold(0.0, |sum, (c, area)| sum + c * area);
        Self { beam, own, compliance, pressure_slope, shape }
    }

    fn mode_frequencies(&self, source: &ElementContext<'_>, segment: &AxisSegment, id: u64) -> [f64; 2] {
        const TAU: f64 = std::f64::consts::TAU;
        let (axis, wood) = (source.axis(segment), source.wood);
        // A requested trunk frequency replaces the computed one.
        let trunk = wood.trunk_hertz.filter(|_| axis.parent == NONE && segment.number == 0);
        let free = trunk.map_or_else(|| self.beam.fundamental_angular_frequency(), |f| f * TAU);
        let mut draw = rng::Rng::from_key(rng::child(id, rng::word("frequency")));
        // Detune equal branches, and both directions of one, so that they do not oscillate in unison.
        // Tree-wide factor times a random detuning of at most FREQUENCY_SPREAD.
        let w = free * wood.hertz * (1.0 + FREQUENCY_SPREAD * draw.range(-1.0, 1.0));
        let apart = MODE_SPLIT * draw.range(-1.0, 1.0);
        [w * (1.0 + apart), w * (1.0 - apart)].map(|w| w.max(MIN_HZ * TAU))
    }

    /// Stations of the element: three on trunks and main branches, one on others, each a mean over its stretch.
    fn load_stations(&self, source: &ElementContext<'_>, segment: &AxisSegment) -> Vec<LoadStation> {
        let (axis, wood) = (source.axis(segment), source.wood);
        // Sampled at 0.2, 0.5 and 0.85 of limbs and at 0.75 of twigs, where most of the load is.
        let places: &[f64] = if axis.order <= 1 { &[0.2, 0.5, 0.85] } else { &[0.75] };
        let n = places.len() as f64;
        let length = segment.span[1] - segment.span[0];
        let site = |at: f64| source.plant.frame(axis, segment.span[0] + length * math::narrow(at));
        let one = |(k, at): (usize, &f64)| {
            let (low, high) = (k as f64 / n, (k + 1) as f64 / n);
            let (mut load, mut tip_compliances, mut weight) = (BranchLoad::default(), [0.0; 2], 0.0);
            let last = self.own.len() - 1;
            // Lump the beam's stations within the stretch, with force-weighted means of their compliances.
            for (j, own) in self.own.iter().enumerate() {
                let x = j as f64 / last as f64;
                if x >= low && (x < high || (k + 1 == places.len() && j == last)) {
                    let drag = wood.drag * own.wood + wood.leaf_drag * own.leaf;
                    load = load + *own;
                    tip_compliances[0] += drag * self.compliance[j];
                    tip_compliances[1] += own.mass * self.compliance[j];
                    weight += drag;
                }
            }
            // Rest geometry of the stretch, and the shelter of the crown at its sample.
            let s = site(*at);
            let from = site(low).p.as_dvec3();
            LoadStation {
                middle: (low + high) * 0.5,
                p: s.p.as_dvec3(),
                along: (s.q * glam::Vec3::Y).as_dvec3(),
                from,
                chord: site(high).p.as_dvec3() - from,
                load,
                tip_compliances: [
                    ratio_or_zero(tip_compliances[0], weight),
                    ratio_or_zero(tip_compliances[1], load.mass),
                ],
                open: source.crown.wind_exposure(s.p.as_dvec3()),
            }
        };
        places.iter().enumerate().map(one).collect()
    }
}

/// Factor on the stiffness of a beam that grew along `along`, if its weight would bend its tip farther than
/// [`SELF_WEIGHT_SLOPE`]: the plant has grown under its weight, and wood of a drawn thickness that could not carry it would not
/// have grown so. Weight does not bend an upright stem, and it stabilizes a hanging twig as stiffness does.
/// Source: T. A. McMahon and R. E. Kronauer, "Tree structures: deducing the principle of mechanical design", Journal of
/// Theoretical Biology 59, 1976: branches of a tree deflect alike for their length under their weight.
fn self_weight_stiffening(beam: &CantileverBeam, along: DVec3) -> f64 {
    let across = if along.y > 0.0 { math::sqrt((1.0 - along.y * along.y).max(0.0)) } else { 1.0 };
    let slope = beam.compliance().iter().zip(&beam.mass).fold(0.0, |sum, (c, m)| sum + c * m);
    math::pow((osier_base::physics::GRAVITY * across * slope / SELF_WEIGHT_SLOPE).max(1.0), SELF_WEIGHT_STIFFENING)
}

/// Factor on the stiffness of a beam whose tip would turn by more than [`WIND_SLOPE`] under a dynamic pressure of 1 Pa on its
/// drag areas `wind`, m^2: wood that the wind bends further than elsewhere grows thicker, until its strain is that of the rest of
/// the tree. A grammar that draws a bough too thin for its leaves defines its thickness, not its strength.
/// Source: C. Metzger, "Der Wind als massgebender Faktor fuer das Wachsthum der Baeume", 1893; J. Morgan and M. G. R. Cannell, "Shape of
/// tree stems: a re-examination of the uniform stress hypothesis", Tree Physiology 14, 1994.
/// Differs: a limit of the slope instead of one stress everywhere, so that the stiffness of thick wood stays as computed.
fn wind_stiffening(beam: &CantileverBeam, wind: &[f64]) -> f64 {
    let slope = beam.compliance().iter().zip(wind).fold(0.0, |sum, (c, area)| sum + c * area);
    math::pow((slope / WIND_SLOPE).max(1.0), WIND_STIFFENING)
}

fn ratio_or_zero(a: f64, b: f64) -> f64 {
    if b > 0.0 { a / b } else { 0.0 }
}

/// Distributes a load linearly to the two stations around position `s`, m.
fn distribute_load(x: &[f64], loads: &mut [BranchLoad], s: f64, load: BranchLoad) {
    let (k, t) = bracketing_stations(x, s);
    loads[k] = loads[k] + load.scaled(1.0 - t);
    if let Some(next) = loads.get_mut(k + 1) {
        *next = *next + load.scaled(t);
    }
}

/// Value at position `s`, m, linear between the stations `x`, m, with values `y`.
fn interpolate(x: &[f64], y: &[f64], s: f64) -> f64 {
    let (k, t) = bracketing_stations(x, s);
    y.get(k + 1).map_or(y[k], |next| y[k] + (next - y[k]) * t)
}

fn bracketing_stations(x: &[f64], s: f64) -> (usize, f64) {
    let k = x.partition_point(|v| *v <= s).clamp(1, x.len().max(2) - 1) - 1;
    let span = x.get(k + 1).map_or(0.0, |b| b - x[k]);
    (k, if span > 0.0 { ((s - x[k]) / span).clamp(0.0, 1.0) } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sway::testing::{leafy, rod, tree};

    #[test]
    fn rod_is_one_element_with_its_theoretical_frequency() {
        let plant = rod(3.5, 0.035, 0.035);
        let wood = WoodParams { elasticity: Some(8e9), ..WoodParams::default() };
        let all = BeamElements::build(&plant, &wood, 10);
        assert_eq!(all.list.len(), 1);
        let e = &all.list[0];
        let hertz = (e.w[0] + e.w[1]) * 0.5 / std::f64::consts::TAU;
        assert!((hertz / 2.38 - 1.0).abs() < 0.19, "{hertz}, up to the spread of branches alike");
        let area: f64 = all.stations.iter().map(|s| s.load.wood).sum();
        let mass: f64 = all.stations.iter().map(|s| s.load.mass).sum();
        assert!(
            (area - 2.0 * 0.035 * 3.5).abs() < 1e-4
                && (mass - 900.0 * std::f64::consts::PI * 0.035 * 0.035 * 3.5).abs() < 1e-3
        );
        // A uniform wind bends it by F L^2 / (6 E I).
        let bend: f64 = all.stations.iter().map(|s| s.load.wood / area * s.tip_compliances[0]).sum();
        let expected = 3.5 * 3.5 / (6.0 * wood.rigidity(0.035));
        assert!((bend / expected - 1.0).abs() < 5e-3, "{bend} {expected}");
    }

    #[test]
    fn thin_ends_are_elements_of_their_own() {
        let all = BeamElements::build(&rod(4.0, 0.04, 0.002), &WoodParams::default(), 10);
        assert!(all.list.len() == 2 && all.list[1].parent == 0 && (all.list[1].at - 1.0).abs() < 1e-9);
        assert!(all.list[1].w[0] > all.list[0].w[0]);
    }

    #[test]
    fn parents_come_first_and_segments_beyond_the_budget_ride() {
        let plant = tree(40);
        let wood = WoodParams::default();
        let full = BeamElements::build(&plant, &wood, 1000);
        let few = BeamElements::build(&plant, &wood, 20);
        assert!(full.list.len() >= 81 && few.list.len() == 20);
        for all in [&full, &few] {
            assert!(all.list.iter().enumerate().all(|(i, e)| e.parent == NONE || (e.parent as usize) < i));
            let mass: f64 = all.stations.iter().map(|s| s.load.mass).sum();
            let whole: f64 = full.stations.iter().map(|s| s.load.mass).sum();
            assert!((mass / whole - 1.0).abs() < 1e-6, "no mass is lost");
        }
        let rider = (0..100_u32).find(|a| few.parts[*a as usize].iter().all(|p| p.1 == NONE)).expect("some ride");
        let spot = few.locate(rider, plant.axes[rider as usize].length);
        assert_eq!(spot, few.carriers[rider as usize]);
        assert_ne!(spot.element, NONE);
    }

    #[test]
    fn leaves_add_drag_and_mass_to_their_twigs() {
        let (bare, leafy) = (tree(5), leafy(5));
        let wood = WoodParams::default();
        let build = |p: &Plant| BeamElements::build(p, &wood, 100);
        let (a, b) = (build(&bare), build(&leafy));
        let leaf: f64 = b.stations.iter().map(|s| s.load.leaf).sum();
        assert!((leaf - leafy.organs.len() as f64 * 0.01).abs() < 1e-6, "{leaf} m2");
        assert!(a.stations.iter().all(|s| s.load.leaf <= 0.0));
        assert!(b.list[1].w[0] < a.list[1].w[0] && a.list[1].damping_ratio < b.list[1].damping_ratio);
    }

    #[test]
    fn boughs_of_one_length_yield_to_the_wind_nearly_alike() {
        // A stem with boughs of a metre that are drawn 3 to 24 mm thick, all with the same leaves: by the drawn wood alone the thinnest
        // would bend some four thousand times as far as the thickest.
        let mut plant = rod(4.0, 0.1, 0.04);
        plant.protos = leafy(1).protos;
        for k in 0..8_u16 {
            let s = 0.5 + 0.4 * f32::from(k);
            let r = 0.0015 * math::pow_f32(8.0, f32::from(k) / 7.0);
            crate::sway::testing::axis(&mut plant, (0, s), (glam::Vec3::Y * s, glam::Vec3::X), (r, 0.7 * r));
            let bough = u32::from(k) + 1;
            for leaf in leafy(1).organs.iter().take(20) {
                plant.organs.push(osier_scene::plant::Organ { axis: bough, ..leaf.clone() });
            }
        }
        let slopes = |stiffness| {
            let wood = WoodParams { stiffness, ..WoodParams::default() };
            let all = BeamElements::build(&plant, &wood, 100);
            all.list.iter().filter(|e| e.order == 1).map(|e| e.pressure_slope).collect::<Vec<f64>>()
        };
        let own = slopes(1.0);
        let thin = own.iter().filter(|s| **s > WIND_SLOPE);
        assert!(thin.clone().count() >= 3 && own.iter().any(|s| *s < 0.2 * WIND_SLOPE), "{own:?}");
        assert!(thin.clone().all(|s| *s < 2.5 * WIND_SLOPE), "{own:?}");
        // The factor of the scene on the stiffness multiplies the result.
        assert!(own.iter().zip(slopes(0.5)).all(|(a, b)| (b / a - 2.0).abs() < 1e-9));
    }

    #[test]
    fn trunk_has_the_requested_frequency() {
        let wood = WoodParams { trunk_hertz: Some(0.51), ..WoodParams::default() };
        let all = BeamElements::build(&tree(5), &wood, 100);
        let hertz = all.list[0].w[0] / std::f64::consts::TAU;
        assert!((hertz / 0.51 - 1.0).abs() < 0.22, "{hertz}");
    }
}
