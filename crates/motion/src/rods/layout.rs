//! From points and radii to sections with springs and masses.

use std::ops::Range;

use glam::DVec3;

use crate::rods::prism::{SectionCorners, SectionFrame};
use crate::rods::springs::{
    CORNER_RADIUS_RATIO, RodInterval, SPRINGS_PER_SECTION, spring_lengths, spring_stiffnesses, spring_vectors,
};
use osier_base::math;
use osier_scene::plant::NONE;

/// Points that each stretch between two given points is drawn with.
const SPLINE_SUBDIVISIONS: usize = 24;
/// Fewest and most sections, if nothing is said.
const SECTION_COUNT_RANGE: [usize; 2] = [5, 16];
/// An interval is so many radii long, if nothing is said.
const INTERVAL_RADII: f64 = 3.0;

/// What a rod is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RodMaterial {
    /// Young's modulus, Pa, 1e4..1e13.
    pub young: f64,
    /// Shear modulus over it, 0.02..0.5.
    pub shear: f64,
    /// kg/m^3, > 0.
    pub density: f64,
    /// Share of critical damping of its slowest swing, 0..1.
    pub damping_ratio: f64,
    /// Strength of the springs back to the rest places over what makes the slowest swing, 0..4.
    pub recovery: f64,
    /// Its prisms are spread until it twists as its material does, however thin it is; it is then softer along itself.
    pub spread_for_torsion: bool,
}

/// A rod to be built.
#[derive(Debug, Clone)]
pub struct RodDescription {
    /// From base to tip, m, two or more; a smooth curve goes through them.
    pub points: Vec<DVec3>,
    /// At the points, m, > 0.
    pub radii: Vec<f64>,
    /// Material.
    pub material: RodMaterial,
    /// Sections, 2..64; `None` chooses by length and radius.
    pub sections: Option<usize>,
    /// Rod that its base is fixed in, below its own number, and where on that, m from its base.
    pub parent: Option<(usize, f64)>,
}

/// Sections of one rod at rest.
#[derive(Debug, Clone)]
pub(crate) struct SampledRod {
    /// One per section.
    pub frames: Vec<SectionFrame>,
    /// Corners, one per section.
    pub corners: Vec<SectionCorners>,
    /// Radii, m.
    pub radii: Vec<f64>,
    /// Arc length from the base, m.
    pub s: Vec<f64>,
    /// Between the sections.
    pub intervals: Vec<RodInterval>,
}

impl RodDescription {
    /// Length along its points, m.
    pub fn length(&self) -> f64 {
        self.sample_spline().last().map_or(0.0, |p| p.2)
    }

    /// Sections it gets: an interval of three mean radii, 5 to 16, unless it says so itself.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
    pub fn section_count(&self) -> usize {
        let mean = self.radii.iter().fold(0.0, |s, r| s + r) / self.radii.len().max(1) as f64;
        let wanted = (self.length() / (INTERVAL_RADII * mean)).ceil().min(1e6) as usize + 1;
        self.sections.unwrap_or_else(|| wanted.clamp(SECTION_COUNT_RANGE[0], SECTION_COUNT_RANGE[1])).max(2)
    }

    /// Places, radii and arc lengths along a curve through the points.
    /// Source: E. Catmull, R. Rom, "A class of local interpolating splines", 1974, with tangents by arc length.
    fn sample_spline(&self) -> Vec<(DVec3, f64, f64)> {
        let p = &self.points;
        let n = p.len();
        let radius = |k: usize| self.radii.get(k).or(self.radii.last()).copied().unwrap_or(0.01);
        let Some(first) = p.first() else { return Vec::new() };
        let mut out = vec![(*first, radius(0), 0.0)];
        let gap = |k: usize| (p[k + 1] - p[k]).length().max(1e-12);
        // Velocity of a curve by arc length at a point: the mean of both sides' slopes, each weighted by the other's length.
        let slope = |k: usize| match (k, k + 1 == n) {
            (0, _) => (p[1] - p[0]) / gap(0),
            (_, true) => (p[k] - p[k - 1]) / gap(k - 1),
            _ => {
                let (a, b) = (gap(k - 1), gap(k));
                ((p[k] - p[k - 1]) / a * b + (p[k + 1] - p[k]) / b * a) / (a + b)
            }
        };
        for k in 0..n.saturating_sub(1) {
            let (d, a, b) = (gap(k), slope(k), slope(k + 1));
            for i in 1..=SPLINE_SUBDIVISIONS {
                let t = i as f64 / SPLINE_SUBDIVISIONS as f64;
                let (t2, t3) = (t * t, t * t * t);
                let at = p[k] * (2.0 * t3 - 3.0 * t2 + 1.0)
                    + p[k + 1] * (3.0 * t2 - 2.0 * t3)
                    + a * (d * (t3 - 2.0 * t2 + t))
                    + b * (d * (t3 - t2));
                let last = out[out.len() - 1];
                out.push((at, radius(k) * (1.0 - t) + radius(k + 1) * t, last.2 + (at - last.0).length()));
            }
        }
        out
    }

    /// Sections at equal steps of arc length, with frames that do not twist.
    pub(crate) fn sample(&self) -> SampledRod {
        let curve = self.sample_spline();
        let n = self.section_count();
        let length = curve.last().map_or(0.0, |p| p.2);
        let mut k = 0;
        let mut at = |s: f64| {
            while k + 2 < curve.len() && curve[k + 1].2 < s {
                k += 1;
            }
            let (a, b) = (curve[k], curve[k + 1]);
            let t = ((s - a.2) / (b.2 - a.2).max(1e-12)).clamp(0.0, 1.0);
            (a.0.lerp(b.0, t), a.1 * (1.0 - t) + b.1 * t)
        };
        let s: Vec<f64> = (0..n).map(|i| length * i as f64 / (n - 1) as f64).collect();
        let (p, radii): (Vec<DVec3>, Vec<f64>) = s.iter().map(|s| at(*s)).unzip();
        let frames = frames(&p);
        let interval = |i: usize| RodInterval {
            length: (p[i + 1] - p[i]).length(),
            radius: 0.5 * (radii[i] + radii[i + 1]),
            young: self.material.young,
            shear: self.material.shear,
            spread: 1.0,
        };
        let mut intervals: Vec<RodInterval> = (0..n - 1).map(interval).collect();
        let wide = intervals.iter().fold(1.0, |m, l| l.wanted_spread().max(m));
        let spread = if self.material.spread_for_torsion { wide } else { 1.0 };
        intervals.iter_mut().for_each(|l| l.spread = spread);
        let corners = frames.iter().zip(&radii).map(|(f, r)| f.corners(CORNER_RADIUS_RATIO * spread * r)).collect();
        SampledRod { frames, corners, radii, s, intervals }
    }
}

/// Frames along points, transported without twist; tangents lie between the neighbours.
/// Source: the rotation-minimising frame of `math::transport`, here by projection, which for steps this small is the same
/// to second order.
fn frames(p: &[DVec3]) -> Vec<SectionFrame> {
    let n = p.len();
    let tangent = |i: usize| {
        let (a, b) = (i.saturating_sub(1), (i + 1).min(n - 1));
        let before = (p[i] - p[a]).normalize_or_zero();
        let after = (p[b] - p[i]).normalize_or_zero();
        (before + after).normalize_or(DVec3::Y)
    };
    let mut out: Vec<SectionFrame> = Vec::with_capacity(n);
    for (i, p) in p.iter().enumerate() {
        let w = tangent(i);
        let before = out.last().map_or_else(|| math::perpendicular(w.as_vec3()).as_dvec3(), |f| f.u);
        let u = (before - w * w.dot(before)).normalize_or(w.any_orthonormal_vector());
        out.push(SectionFrame { p: *p, u, v: w.cross(u), w });
    }
    out
}

/// A section in a tree of rods.
#[derive(Debug, Clone)]
pub(crate) struct RodSection {
    /// Its rod.
    pub rod: usize,
    /// Radius, m.
    pub radius: f64,
    /// Arc length on its rod, m.
    pub s: f64,
    /// Mass of each corner, kg.
    pub mass: f64,
    /// Base that the section before, and the one before that, is, if it rides on another rod; else [`NONE`].
    pub base: [u32; 2],
    /// Springs: N/m and lengths at rest, m.
    pub k: [f64; SPRINGS_PER_SECTION],
    pub l: [f64; SPRINGS_PER_SECTION],
}

/// The base of a rod that is fixed in a section of another one.
#[derive(Debug, Clone)]
pub(crate) struct RodAttachment {
    /// That section.
    pub on: u32,
    /// Its corners in that section's frame, m.
    pub local: SectionCorners,
}

/// A rod among the sections.
#[derive(Debug, Clone)]
pub(crate) struct RodExtent {
    /// Its sections, without one that rides on another rod.
    pub sections: Range<usize>,
    /// Its own base, if it rides on another rod.
    pub base: Option<usize>,
    /// Material.
    pub material: RodMaterial,
    /// Length, m.
    pub length: f64,
    /// Between its sections, that of the base included.
    pub intervals: Vec<RodInterval>,
}

/// All sections of rods that hang together, parents first.
#[derive(Debug, Clone, Default)]
pub(crate) struct RodTree {
    pub sections: Vec<RodSection>,
    /// Section above, and the one above that, as they couple; see [`crate::rods::solver::block::solve`].
    pub above: Vec<[u32; 2]>,
    pub bases: Vec<RodAttachment>,
    pub spans: Vec<RodExtent>,
    /// Corners at rest, as drawn.
    pub drawn: Vec<SectionCorners>,
}

impl RodTree {
    /// Lays out rods, of which parents stand before their children.
    pub(crate) fn new(rods: &[RodDescription]) -> Self {
        let mut tree = Self::default();
        rods.iter().enumerate().for_each(|(number, rod)| tree.add(number, rod));
        tree.set_rest_lengths(&tree.drawn.clone());
        tree
    }

    fn add(&mut self, number: usize, rod: &RodDescription) {
        let line = rod.sample();
        let first = self.sections.len();
        let parent = rod.parent.map(|(rod, s)| self.nearest_section(rod, s));
        let own = usize::from(parent.is_some());
        let stiff = spring_stiffnesses(&line.intervals);
        let masses = masses(&line, rod.material.density);
        let base = parent.map(|on| {
            let frame = SectionFrame::from_corners(&self.drawn[on]);
            self.bases.push(RodAttachment { on: index(on), local: frame.to_local(&line.corners[0]) });
            // The half interval at the base moves with the parent.
            self.sections[on].mass += masses[0];
            self.bases.len() - 1
        });
        for j in own..line.frames.len() {
            let before = |k: usize| match (j.checked_sub(k), parent) {
                (Some(at), Some(on)) if at < own => index(on),
                (Some(at), _) => index(first + at - own),
                (None, _) => NONE,
            };
            let rides = |k: usize| if j == k { base.map_or(NONE, index) } else { NONE };
            // The section after a base is coupled to one section only.
            let over = if own == 1 && j == 1 { NONE } else { before(2) };
            self.above.push([before(1), over]);
            self.drawn.push(line.corners[j]);
            self.sections.push(RodSection {
                rod: number,
                radius: line.radii[j],
                s: line.s[j],
                mass: masses[j],
                base: [rides(1), rides(2)],
                k: stiff[j],
                l: [0.0; SPRINGS_PER_SECTION],
            });
        }
        self.spans.push(RodExtent {
            sections: first..self.sections.len(),
            base,
            material: rod.material,
            length: line.s.last().copied().unwrap_or(0.0),
            intervals: line.intervals,
        });
    }

    /// The section of a rod that is nearest to an arc length, m.
    pub(crate) fn nearest_section(&self, rod: usize, s: f64) -> usize {
        let range = self.spans[rod].sections.clone();
        let away = |i: usize| (self.sections[i].s - s).abs();
        range.clone().fold(range.start, |best, i| if away(i) < away(best) { i } else { best })
    }

    /// Corners of the sections before one, by those of all: they may ride on another rod.
    pub(crate) fn predecessor_corners(&self, i: usize, x: &[SectionCorners]) -> [SectionCorners; 2] {
        [0, 1].map(|k| match (self.above[i][k], self.sections[i].base[k]) {
            (_, base) if base != NONE => {
                let base = &self.bases[base as usize];
                SectionFrame::from_corners(&x[base.on as usize]).to_world(&base.local)
            }
            (NONE, _) => x[i],
            (on, _) => x[on as usize],
        })
    }

    /// Makes these corners the shape without load.
    pub(crate) fn set_rest_lengths(&mut self, x: &[SectionCorners]) {
        for i in 0..self.sections.len() {
            let [up, over] = self.predecessor_corners(i, x);
            self.sections[i].l = spring_lengths(&spring_vectors(&x[i], &up, &over));
        }
    }
}

/// Mass of each corner, kg: a third of the wood halfway to both neighbours.
fn masses(line: &SampledRod, density: f64) -> Vec<f64> {
    let half = |i: usize| line.intervals.get(i).map_or(0.0, |l| 0.5 * l.length);
    let one = |(i, r): (usize, &f64)| {
        let length = if i > 0 { half(i - 1) } else { 0.0 } + half(i);
        density * std::f64::consts::PI * r * r * length / 3.0
    };
    line.radii.iter().enumerate().map(one).collect()
}

pub(crate) fn index(i: usize) -> u32 {
    u32::try_from(i).unwrap_or(NONE)
}
