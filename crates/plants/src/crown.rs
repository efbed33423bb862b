//! Light in a crown: how much the crown shades each leaf, and the direction out of it.
//!
//! The leaf area of a crown is summed in a coarse grid of cubic cells. Light is attenuated along 26 directions from each cell to
//! the edge of the grid by the leaf area that it passes. A leaf's occlusion is the share of skylight that does not reach it; its
//! outward direction is the mean of the directions around it, each weighted by the light that comes from there.
//!
//! ```
//! use glam::Vec3;
//! use osier_plants::crown::{CrownLeaf, crown_light};
//!
//! // A ball of leaves: those in its middle are shaded, those at its top look up.
//! let place = |i: u16| {
//!     let [x, y, z] = [i % 11, i / 11 % 11, i / 121].map(|k| f32::from(k) / 5.0 - 1.0);
//!     Vec3::new(x, y, z)
//! };
//! let ball: Vec<Vec3> = (0..1331).map(place).filter(|p| p.length() <= 1.0).collect();
//! let leaves: Vec<CrownLeaf> = ball.iter().map(|p| CrownLeaf { position: *p, area: 0.02 }).collect();
//! let light = crown_light(&leaves);
//! let of = |wanted: Vec3| light[ball.iter().position(|p| p.distance(wanted) < 1e-3).expect("a leaf")];
//! assert!(of(Vec3::ZERO).occlusion > 0.6 && of(Vec3::Y).occlusion < 0.4);
//! assert!(of(Vec3::Y).outward.y > 0.9);
//! ```

use glam::{IVec3, Vec3};

use osier_base::math::normalize_or;
use osier_base::par::par_map;
use osier_scene::plant::Plant;
use osier_scene::{Attribute, AttributeData, CANOPY_NORMAL, CANOPY_OCCLUSION, Mesh};

/// Cells along the longest side of a crown. Own: a cell of a tree then holds a branchlet; finer cells resolve single twigs,
/// coarser ones only the crown as a whole.
const CELLS: f32 = 24.0;
/// Least edge of a cell in diameters of a mean leaf, so that the cells of a small plant hold more than one leaf.
const LEAST_CELL: f32 = 2.0;
/// Projected area divided by one-sided area of leaves that face all directions alike (G function of a spherical
/// distribution).
/// Source: Monteith and Unsworth, Principles of Environmental Physics, 2013, chapter 8.
const PROJECTED: f32 = 0.5;
/// Weight of light from the horizon relative to that from the zenith. Own: most light of an overcast sky comes from above.
const HORIZON: f32 = 0.15;
/// Weight of the direction away from the middle of the crown, relative to the mean direction of the incoming light. Own: it
/// matters only deep inside, where all directions are equally dark.
const AWAY: f32 = 0.3;

/// A leaf as [`crown_light`] reads it: a point with an area, without shape or orientation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CrownLeaf {
    /// Pivot of the leaf in the plant's space, m.
    pub position: Vec3,
    /// Area of one of its sides, m^2.
    pub area: f32,
}

/// Share of skylight that a leaf loses to its crown, and the direction out of the crown; computed by [`crown_light`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CrownLight {
    /// Share of the skylight that other leaves take, 0 on the outside to 1 in deep shade.
    pub occlusion: f32,
    /// Unit direction out of the crown in the plant's space, towards which shading normals are bent.
    pub outward: Vec3,
}

/// Input for [`crown_light`]: one leaf for each organ of the plant, in the order of its organs. The area is that of the
/// prototype's triangles at the scale of the organ; 0 for an organ without a prototype.
pub fn crown_leaves(plant: &Plant) -> Vec<CrownLeaf> {
    let areas: Vec<f32> = plant.protos.iter().map(|p| mesh_area(&p.mesh)).collect();
    let leaf = |o: &osier_scene::plant::Organ| {
        let area = areas.get(usize::from(o.proto)).copied().unwrap_or(0.0);
        CrownLeaf { position: plant.organ_site(o).0, area: area * o.scale * o.scale }
    };
    plant.organs.iter().map(leaf).collect()
}

/// Attributes of a plant's organs for shading: [`CANOPY_OCCLUSION`] if `occlusion`, and [`CANOPY_NORMAL`], the outward direction
/// times `normals`, if that is above 0. `normals`: share 0..1 by which shading normals are bent.
pub fn crown_attributes(plant: &Plant, occlusion: bool, normals: f32) -> Vec<Attribute> {
    let light = crown_light(&crown_leaves(plant));
    let mut attributes = Vec::new();
    if occlusion {
        let shares = light.iter().map(|l| l.occlusion).collect();
        attributes.push(Attribute::instance(CANOPY_OCCLUSION, AttributeData::Unit1(shares)));
    }
    if normals > 0.0 {
        let bends = light.iter().map(|l| (l.outward * normals).to_array()).collect();
        attributes.push(Attribute::instance(CANOPY_NORMAL, AttributeData::Vector(bends)));
    }
    attributes
}

/// Area of all triangles, m^2: that of one side for a leaf modelled as a single sheet.
fn mesh_area(mesh: &Mesh) -> f32 {
    let area = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|i| mesh.points.get(i as usize).copied().unwrap_or_default());
        0.5 * (b - a).cross(c - a).length()
    };
    mesh.triangles.iter().map(area).sum()
}

/// Light of each leaf of one crown in the shade of the others, in the order of `leaves`. Costs 26 passes over a grid of at most
/// 27^3 cells.
pub fn crown_light(leaves: &[CrownLeaf]) -> Vec<CrownLight> {
    if leaves.is_empty() {
        return Vec::new();
    }
    let grid = CrownGrid::new(leaves);
    let directions = directions();
    let depths = par_map(&directions, |d| grid.optical_depths(*d));
    let cells = grid.cell_light(&directions, &depths);
    leaves.iter().map(|leaf| grid.at(leaf.position, &cells)).collect()
}

/// Steps from a cell to its 26 neighbours, in cells.
fn directions() -> Vec<IVec3> {
    let all = (-1..=1).flat_map(|x| (-1..=1).flat_map(move |y| (-1..=1).map(move |z| IVec3::new(x, y, z))));
    all.filter(|d| *d != IVec3::ZERO).collect()
}

/// Leaf area by cell, with one layer of empty cells around the crown.
struct CrownGrid {
    low: Vec3,
    cell: f32,
    size: IVec3,
    /// Leaf area in a cubic metre, by cell; x varies fastest, then y.
    density: Vec<f32>,
    /// Middle and half sides of the box around the leaves, m; half sides are at least half a cell.
    middle: Vec3,
    half: Vec3,
}

/// Light at the middle of a cell.
#[derive(Clone, Copy, Default)]
struct CellLight {
    /// Share of skylight, 0 to 1.
    sky: f32,
    /// Mean of the 26 directions, weighted by their transmittance; short where light comes from all sides alike.
    outward: Vec3,
}

impl CrownGrid {
    fn new(leaves: &[CrownLeaf]) -> Self {
        let first = leaves[0].position;
        let (low, high) = leaves.iter().fold((first, first), |b, l| (b.0.min(l.position), b.1.max(l.position)));
        let mean = leaves.iter().map(|l| l.area).sum::<f32>() / leaves.len() as f32;
        let side = (high - low).max_element();
        let cell = (side / CELLS).max(LEAST_CELL * mean.max(1e-8).sqrt()).max(1e-4);
        // `whole(v / cell) + 1` cells span the leaves; one empty cell is added at each end.
        let count = |v: f32| whole(v / cell) + 3;
        let size = IVec3::new(count(high.x - low.x), count(high.y - low.y), count(high.z - low.z));
        let mut grid = Self {
            low: low - Vec3::splat(cell),
            cell,
            size,
            density: Vec::new(),
            middle: (low + high) * 0.5,
            half: ((high - low) * 0.5).max(Vec3::splat(0.5 * cell)),
        };
        grid.density = vec![0.0; (size.x * size.y * size.z).unsigned_abs() as usize];
        for leaf in leaves {
            let at = grid.index(grid.cell_of(leaf.position));
            if let Some(cell) = at.and_then(|i| grid.density.get_mut(i)) {
                *cell += leaf.area / (grid.cell * grid.cell * grid.cell);
            }
        }
        grid
    }

    fn cell_of(&self, p: Vec3) -> IVec3 {
        let q = (p - self.low) / self.cell;
        IVec3::new(whole(q.x), whole(q.y), whole(q.z))
    }

    fn index(&self, c: IVec3) -> Option<usize> {
        let inside = c.cmpge(IVec3::ZERO).all() && c.cmplt(self.size).all();
        inside.then(|| (c.x + self.size.x * (c.y + self.size.y * c.z)).unsigned_abs() as usize)
    }

    /// Optical depth from the middle of each cell to the edge of the grid along `d`, a step to a neighbouring cell.
    fn optical_depths(&self, d: IVec3) -> Vec<f32> {
        let length = d.as_vec3().length() * self.cell;
        let mut depths = vec![0.0; self.density.len()];
        // The next cell along the direction is visited first, since its depth is read here.
        let order =
            |n: i32, towards: i32| -> Vec<i32> { if towards > 0 { (0..n).rev().collect() } else { (0..n).collect() } };
        for z in order(self.size.z, d.z) {
            for y in order(self.size.y, d.y) {
                for x in order(self.size.x, d.x) {
                    let here = IVec3::new(x, y, z);
                    let Some(i) = self.index(here) else { continue };
                    // Half of the step lies in this cell, half in the next one.
                    let own = 0.5 * PROJECTED * self.density[i] * length;
                    let beyond = self.index(here + d);
                    depths[i] = own + beyond.map_or(0.0, |k| 0.5 * PROJECTED * self.density[k] * length + depths[k]);
                }
            }
        }
        depths
    }

    fn cell_light(&self, directions: &[IVec3], depths: &[Vec<f32>]) -> Vec<CellLight> {
        let unit: Vec<Vec3> = directions.iter().map(|d| d.as_vec3().normalize()).collect();
        let weights: Vec<f32> =
            // No skylight comes from below, but directions below the horizon still count for `outward`.
            unit.iter().map(|d| if d.y < 0.0 { 0.0 } else { HORIZON + (1.0 - HORIZON) * d.y }).collect();
        let whole_sky: f32 = weights.iter().sum();
        let cell = |i: usize| {
            let mut light = CellLight::default();
            let mut all = 0.0;
            for ((d, w), depth) in unit.iter().zip(&weights).zip(depths) {
                let open = osier_base::math::exp_f32(-depth[i]);
                light.sky += w * open / whole_sky;
                light.outward += *d * open;
                all += open;
            }
            light.outward /= f32::max(all, 1e-9);
            light
        };
        (0..self.density.len()).map(cell).collect()
    }

    /// Light at a point, interpolated between the middles of the eight cells around it.
    fn at(&self, p: Vec3, cells: &[CellLight]) -> CrownLight {
        let q = (p - self.low) / self.cell - Vec3::splat(0.5);
        let base = IVec3::new(whole(q.x), whole(q.y), whole(q.z));
        let t = q - base.as_vec3();
        let mut light = CellLight::default();
        for k in 0..8 {
            let step = IVec3::new(k & 1, k >> 1 & 1, k >> 2 & 1);
            let share = |t: f32, step: i32| if step > 0 { t } else { 1.0 - t };
            let weight = share(t.x, step.x) * share(t.y, step.y) * share(t.z, step.z);
            // Leaves at the edge of the crown also read the empty cells around it; clamping guards against rounding.
            let corner = (base + step).clamp(IVec3::ZERO, self.size - IVec3::ONE);
            let Some(cell) = self.index(corner).and_then(|i| cells.get(i)) else { continue };
            light.sky += weight * cell.sky;
            light.outward += cell.outward * weight;
        }
        // Outward normal of the ellipsoid with the half sides of the crown, its gradient at `p`.
        let away = normalize_or((p - self.middle) / (self.half * self.half), Vec3::Y);
        CrownLight {
            occlusion: (1.0 - light.sky).clamp(0.0, 1.0),
            outward: normalize_or(light.outward + away * AWAY, away),
        }
    }
}

/// Floor of a grid coordinate; values beyond `i32` saturate.
#[allow(clippy::cast_possible_truncation, reason = "cells of a grid of a few dozen a side; others saturate")]
fn whole(v: f32) -> i32 {
    v.floor() as i32
}

#[cfg(test)]
mod tests {
    use super::*;
    use osier_base::rng::Rng;

    fn ball(n: u32, area: f32) -> Vec<CrownLeaf> {
        let mut draw = Rng::at(7, &["ball".into()]);
        let mut point = || Vec3::from_array([0; 3].map(|_| osier_base::math::narrow(draw.range(-1.0, 1.0))));
        let all = (0..n).map(|_| point()).filter(|p| p.length() < 1.0).collect::<Vec<_>>();
        all.into_iter().map(|p| CrownLeaf { position: p * 3.0 + Vec3::Y * 8.0, area }).collect()
    }

    #[test]
    fn a_ball_is_dark_within_and_looks_outwards() {
        let leaves = ball(20_000, 0.01);
        let light = crown_light(&leaves);
        let (mut inner, mut outer) = (Vec::new(), Vec::new());
        for (leaf, light) in leaves.iter().zip(&light) {
            let from_middle = leaf.position - Vec3::Y * 8.0;
            assert!((0.0..=1.0).contains(&light.occlusion) && (light.outward.length() - 1.0).abs() < 1e-5);
            if from_middle.length() > 2.6 {
                let cosine = light.outward.dot(from_middle.normalize());
                assert!(cosine > 0.7, "{cosine} at {from_middle}");
                if from_middle.normalize().y > 0.7 {
                    outer.push(light.occlusion);
                }
            } else if from_middle.length() < 1.0 {
                inner.push(light.occlusion);
            }
        }
        let mean = |v: &[f32]| v.iter().sum::<f32>() / v.len() as f32;
        assert!(mean(&inner) > mean(&outer) + 0.3, "{} {}", mean(&inner), mean(&outer));
    }

    #[test]
    fn more_leaves_shade_more_and_none_is_no_crown() {
        let mean = |leaves: &[CrownLeaf]| {
            let light = crown_light(leaves);
            light.iter().map(|l| l.occlusion).sum::<f32>() / light.len() as f32
        };
        // A chord from a point of a ball of 3 m to its surface is 2.25 m long on average; 2,090 leaves of 0.02 m^2 in 113 m^3 attenuate
        // light by 0.5 * 0.37 / m.
        let (thin, dense) = (mean(&ball(4000, 0.002)), mean(&ball(4000, 0.02)));
        let expected = 1.0 - osier_base::math::exp_f32(-0.5 * 0.37 * 2.25);
        assert!(thin < 0.2 * dense && (dense - expected).abs() < 0.06, "{thin} {dense} {expected}");
        assert!(crown_light(&[]).is_empty());
        let alone = crown_light(&[CrownLeaf { position: Vec3::Y, area: 0.01 }]);
        assert!(alone[0].occlusion < 0.5 && alone[0].outward.is_finite());
    }
}
