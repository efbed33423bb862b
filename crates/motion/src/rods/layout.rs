//! Discretization of rods: from points and radii to sections with springs and masses.

use std::ops::Range;

use glam::DVec3;

use crate::rods::prism::{SectionFrame, Vector9};
use crate::rods::springs::{
    CORNER_RADIUS_RATIO, RodInterval, SPRINGS_PER_SECTION, spring_lengths, spring_stiffnesses, spring_vectors,
};
use crate::rods::tuning::{INTERVAL_RADII, SECTION_COUNT_RANGE, SPLINE_SUBDIVISIONS};
use osier_base::convert::saturating_index;
use osier_base::math;
use osier_scene::plant::NONE;

/// Elastic material and damping of a rod, the same over its length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RodMaterial {
    /// Young's modulus, Pa, 1e4..1e13.
    pub young: f64,
    /// Shear modulus divided by Young's modulus, 0.02..0.5.
    pub shear: f64,
    /// Density, kg/m^3, > 0.
    pub density: f64,
    /// Damping ratio of the fundamental mode, 0..1.
    pub damping_ratio: f64,
    /// Stiffness of the restoring springs towards the rest positions, divided by the stiffness of the fundamental mode, 0..4.
    pub recovery: f64,
    /// Whether the prisms of slender rods are widened until their torsional stiffness matches the material, at the cost of axial
    /// stiffness.
    pub spread_for_torsion: bool,
}

/// Centreline, radii, material and attachment of a rod before its discretization.
#[derive(Debug, Clone)]
pub struct RodDescription {
    /// Two or more points from base to tip, m, joined by a Catmull-Rom spline.
    pub points: Vec<DVec3>,
    /// Radius at each point, m, > 0.
    pub radii: Vec<f64>,
    /// Elasticity, density and damping of the whole rod.
    pub material: RodMaterial,
    /// Number of sections, 2..64; `None` chooses it from length and radius.
    pub sections: Option<usize>,
    /// Parent rod, of a lower index, and arc length on it, m, at which the base is fixed.
    pub parent: Option<(usize, f64)>,
}

/// One rod discretized into sections, in its reference shape.
#[derive(Debug, Clone)]
pub(crate) struct SampledRod {
    pub frames: Vec<SectionFrame>,
    pub corners: Vec<Vector9>,
    pub radii: Vec<f64>,
    /// Arc length from the base, m.
    pub s: Vec<f64>,
    /// One per pair of neighbouring sections.
    pub intervals: Vec<RodInterval>,
}

impl RodDescription {
    /// Arc length of the spline, m.
    pub fn spline_length(&self) -> f64 {
        self.sample_spline().last().map_or(0.0, |p| p.2)
    }

    /// Number of sections: intervals of three mean radii, 5 to 16 of them, unless the description sets it.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
    pub fn section_count(&self) -> usize {
        let mean = self.radii.iter().fold(0.0, |s, r| s + r) / self.radii.len().max(1) as f64;
        let wanted = (self.spline_length() / (INTERVAL_RADII * mean)).ceil().min(1e6) as usize + 1;
        self.sections.unwrap_or_else(|| wanted.clamp(SECTION_COUNT_RANGE[0], SECTION_COUNT_RANGE[1])).max(2)
    }

    /// Position, m, radius, m, and arc length, m, of samples along a spline through the points;
    /// [`SPLINE_SUBDIVISIONS`] per segment.
    /// Source: E. Catmull, R. Rom, "A class of local interpolating splines", 1974, with tangents by arc length.
    fn sample_spline(&self) -> Vec<(DVec3, f64, f64)> {
        let p = &self.points;
        let n = p.len();
        let radius = |k: usize| self.radii.get(k).or(self.radii.last()).copied().unwrap_or(0.01);
        let Some(first) = p.first() else { return Vec::new() };
        let mut out = vec![(*first, radius(0), 0.0)];
        let gap = |k: usize| (p[k + 1] - p[k]).length().max(1e-12);
        // Tangent at a point: the mean of the slopes on both sides, each weighted by the length of the other side.
        let slope = |k: usize| match (k, k + 1 == n) {
            (0, _) => (p[1] - p[0]) / gap(0),
            (_, true) => (p[k] - p[k - 1]) / gap(k - 1),
            _ => {
                let (a, b) = (gap(k - 1), gap(k));
                ((p[k] - p[k - 1]) / a * b + (p[k + 1] - p[k]) / b * a) / (a + b)
            }
        };
        // Cubic Hermite interpolation on each segment, with the slopes scaled to its chord length d.
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

    /// Sections at equal steps of arc length, with rotation-minimizing frames.
    pub(crate) fn sample(&self) -> SampledRod {
        let curve = self.sample_spline();
        let n = self.section_count();
        let length = curve.last().map_or(0.0, |p| p.2);
        let mut k = 0;
        // Arc lengths are queried in ascending order: the sample before s is found by moving forward only.
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
        let frames = rotation_minimizing_frames(&p);
        let interval = |i: usize| RodInterval {
            length: (p[i + 1] - p[i]).length(),
            radius: 0.5 * (radii[i] + radii[i + 1]),
            young: self.material.young,
            shear: self.material.shear,
            spread: 1.0,
        };
        let mut intervals: Vec<RodInterval> = (0..n - 1).map(interval).collect();
        // One spread for the whole rod, the largest that any interval needs, keeps the prisms of neighbouring
        // intervals equal.
        let wide = intervals.iter().fold(1.0, |m, l| l.spread_ratio_for_full_torsion().max(m));
        let spread = if self.material.spread_for_torsion { wide } else { 1.0 };
        intervals.iter_mut().for_each(|l| l.spread = spread);
        let corners =
            frames.iter().zip(&radii).map(|(f, r)| f.corner_positions(CORNER_RADIUS_RATIO * spread * r)).collect();
        SampledRod { frames, corners, radii, s, intervals }
    }
}

/// Rotation-minimizing frames along points; the tangent is the mean of the directions to both neighbours.
/// Source: the rotation-minimising frame of `math::transport`, here by projection, which for steps this small is the
/// same to second order.
fn rotation_minimizing_frames(p: &[DVec3]) -> Vec<SectionFrame> {
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
        // Project the last frame's u onto the plane across the new tangent.
        let before = out.last().map_or_else(|| math::perpendicular(w.as_vec3()).as_dvec3(), |f| f.u);
        let u = (before - w * w.dot(before)).normalize_or(w.any_orthonormal_vector());
        out.push(SectionFrame { p: *p, u, v: w.cross(u), w });
    }
    out
}

/// A free section in a tree of rods: nine degrees of freedom, the positions of three corners.
#[derive(Debug, Clone)]
pub(crate) struct SectionProperties {
    pub rod: usize,
    pub radius: f64,
    /// Arc length on its rod, m.
    pub s: f64,
    /// Mass of each corner, kg.
    pub mass: f64,
    /// Indices of the attached bases that replace the first and the second predecessor; [`NONE`] where the predecessor is a free section.
    pub base: [u32; 2],
    /// Stiffness, N/m, and rest length, m, of its springs, in the order of [`crate::rods::springs`].
    pub stiffness: [f64; SPRINGS_PER_SECTION],
    pub rest_lengths: [f64; SPRINGS_PER_SECTION],
}

/// Base of a rod, fixed to a section of its parent rod and therefore without degrees of freedom.
#[derive(Debug, Clone)]
pub(crate) struct AttachedBase {
    /// Index of the carrying section.
    pub on: u32,
    /// Corners of the base in the frame of that section, m.
    pub local: Vector9,
}

/// Range and properties of one rod in a [`SectionTree`].
#[derive(Debug, Clone)]
pub(crate) struct RodInTree {
    /// Free sections; the attached base of a child rod is not among them.
    pub sections: Range<usize>,
    /// Index of its attached base, if it has a parent rod.
    pub base: Option<usize>,
    pub material: RodMaterial,
    pub length: f64,
    /// One per pair of neighbouring sections, the attached base included.
    pub intervals: Vec<RodInterval>,
}

/// All free sections of connected rods, parents first.
#[derive(Debug, Clone, Default)]
pub(crate) struct SectionTree {
    pub sections: Vec<SectionProperties>,
    /// Index of the preceding section and of the one before that, as springs couple them; see
    /// [`crate::rods::solver::block::solve_block_system`].
    pub predecessors: Vec<[u32; 2]>,
    pub bases: Vec<AttachedBase>,
    pub rods: Vec<RodInTree>,
    /// Corners of the reference shape, which is the pose as drawn, m.
    pub reference: Vec<Vector9>,
}

impl SectionTree {
    /// Discretizes rods; a parent must precede its children in `rods`.
    pub(crate) fn discretize(rods: &[RodDescription]) -> Self {
        let mut tree = Self::default();
        rods.iter().enumerate().for_each(|(number, rod)| tree.add_rod(number, rod));
        tree.set_rest_lengths(&tree.reference.clone());
        tree
    }

    fn add_rod(&mut self, number: usize, rod: &RodDescription) {
        let line = rod.sample();
        let first = self.sections.len();
        let parent = rod.parent.map(|(rod, s)| self.section_at_arc_length(rod, s));
        let own = usize::from(parent.is_some());
        let stiff = spring_stiffnesses(&line.intervals);
        let masses = mass_per_corner_by_section(&line, rod.material.density);
        // The base section of a child rod has no degrees of freedom: it is stored by its corners in the frame of the
        // parent's section.
        let base = parent.map(|on| {
            let frame = SectionFrame::from_corners(&self.reference[on]);
            self.bases.push(AttachedBase { on: to_stored_index(on), local: frame.corners_to_local(&line.corners[0]) });
            // The half interval at the base moves with the parent.
            self.sections[on].mass += masses[0];
            self.bases.len() - 1
        });
        for j in own..line.frames.len() {
            // Predecessors of section j: sections of the same rod, or the carrying section where the attached base replaces them.
            let before = |k: usize| match (j.checked_sub(k), parent) {
                (Some(at), Some(on)) if at < own => to_stored_index(on),
                (Some(at), _) => to_stored_index(first + at - own),
                (None, _) => NONE,
            };
            let rides = |k: usize| if j == k { base.map_or(NONE, to_stored_index) } else { NONE };
            // The section after a base is coupled to one section only.
            let over = if own == 1 && j == 1 { NONE } else { before(2) };
            self.predecessors.push([before(1), over]);
            self.reference.push(line.corners[j]);
            self.sections.push(SectionProperties {
                rod: number,
                radius: line.radii[j],
                s: line.s[j],
                mass: masses[j],
                base: [rides(1), rides(2)],
                stiffness: stiff[j],
                rest_lengths: [0.0; SPRINGS_PER_SECTION],
            });
        }
        self.rods.push(RodInTree {
            sections: first..self.sections.len(),
            base,
            material: rod.material,
            length: line.s.last().copied().unwrap_or(0.0),
            intervals: line.intervals,
        });
    }

    /// The section of a rod that is nearest to an arc length, m.
    pub(crate) fn section_at_arc_length(&self, rod: usize, s: f64) -> usize {
        let range = self.rods[rod].sections.clone();
        let away = |i: usize| (self.sections[i].s - s).abs();
        range.clone().fold(range.start, |best, i| if away(i) < away(best) { i } else { best })
    }

    /// Corners of both predecessors of section `i`, given the corners `x` of all sections; an attached base is carried
    /// along rigidly.
    pub(crate) fn predecessor_corner_positions(&self, i: usize, x: &[Vector9]) -> [Vector9; 2] {
        [0, 1].map(|k| match (self.predecessors[i][k], self.sections[i].base[k]) {
            (_, base) if base != NONE => {
                let base = &self.bases[base as usize];
                SectionFrame::from_corners(&x[base.on as usize]).local_positions_to_world(&base.local)
            }
            (NONE, _) => x[i],
            (on, _) => x[on as usize],
        })
    }

    /// Sets the rest lengths of all springs so that the shape `x` is free of stress.
    pub(crate) fn set_rest_lengths(&mut self, x: &[Vector9]) {
        for i in 0..self.sections.len() {
            let [up, over] = self.predecessor_corner_positions(i, x);
            self.sections[i].rest_lengths = spring_lengths(&spring_vectors(&x[i], &up, &over));
        }
    }
}

/// Mass of each corner, kg: a third of the mass of the wood between the middles of the two adjoining intervals.
fn mass_per_corner_by_section(line: &SampledRod, density: f64) -> Vec<f64> {
    let half = |i: usize| line.intervals.get(i).map_or(0.0, |l| 0.5 * l.length);
    let one = |(i, r): (usize, &f64)| {
        let length = if i > 0 { half(i - 1) } else { 0.0 } + half(i);
        density * std::f64::consts::PI * r * r * length / 3.0
    };
    line.radii.iter().enumerate().map(one).collect()
}

/// Index of a section or base as the tree stores it, in 32 bits.
pub(crate) fn to_stored_index(i: usize) -> u32 {
    // A section takes hundreds of bytes: 2^32 of them exceed the memory long before the index overflows.
    saturating_index(i)
}
