//! The place of a tree: sky, solids that shade it and stop its shoots, unseen neighbours, cuts.

use std::sync::Arc;

use glam::Vec3;

use super::light::{Grid, LeafAreas};
use osier_base::geometry::Bounds;
use osier_scene::solid::{Form, Solid, Solids};

/// Least distance of a shoot's bark from a solid, m.
const CLEARANCE: f32 = 0.02;
/// Share of a step that must be left after sliding along a solid; otherwise the axis ends.
const LEAST_STEP: f32 = 0.3;
/// Solids farther than this from living wood, m, cast no shade: light comes from 25 degrees and more, so that only walls higher
/// than half of this distance would.
const SHADE_REACH: f32 = 12.0;
/// Thickness of the ring of neighbours, m.
const RING_THICKNESS: f32 = 3.0;
/// Heights of the ring's lower and upper edges as shares of the tree's height.
const RING_HEIGHTS: [f32; 2] = [0.3, 0.92];
/// Share of a cell's side that a solid's surface may lie beyond its center and still make it opaque; thin walls need it.
const OPAQUE_REACH: f32 = 0.25;
/// Points of the top of a cell at which it is tested for air, x and z from its middle in halves of its side.
const TOP_POINTS: [[f32; 2]; 9] =
    [[0.0, 0.0], [-1.0, -1.0], [0.0, -1.0], [1.0, -1.0], [-1.0, 0.0], [1.0, 0.0], [-1.0, 1.0], [0.0, 1.0], [1.0, 1.0]];

/// Sky, sunlight and solids around the trees that grow in one field of light.
#[derive(Debug, Clone, Default)]
pub struct Site {
    /// Vector towards the brighter side of the sky: light from the direction d is multiplied by 1 + side . d. Its length is below 1.
    pub side: Vec3,
    /// Geographic latitude, degrees, for direct light.
    pub latitude: f64,
    /// Share of direct sunlight, 0 to 0.8.
    pub direct: f64,
    /// Ground and solids, in the space of the scene; `None`: level ground at the height of the tree's base.
    pub solids: Option<Arc<Solids>>,
}

/// Unseen neighbours of a tree: a ring of leaves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Neighbours {
    /// Inner radius of the ring, m.
    pub radius: f32,
    /// Leaf area per volume, m2/m3.
    pub density: f32,
    /// Year of the field of light in which they are felled: the age of its oldest tree.
    pub until: f32,
}

impl Neighbours {
    /// Box of the ring around a tree of the given height, in the space of the tree.
    pub(super) fn bounds(&self, height: f32) -> Bounds {
        let r = self.radius + RING_THICKNESS;
        Bounds { min: Vec3::new(-r, 0.0, -r), max: Vec3::new(r, height * RING_HEIGHTS[1], r) }
    }

    /// Adds the ring's leaves to the field. `base`: of the tree, in the field; `extinction`: of its species.
    pub(super) fn deposit(&self, areas: &mut LeafAreas, base: Vec3, height: f32, extinction: f32) {
        let grid = areas.grid;
        // The field holds areas times extinction: species absorb light differently.
        let area = self.density * grid.cell * grid.cell * grid.cell * extinction;
        let [nx, ny, nz] = grid.size;
        for y in 0..ny {
            for z in 0..nz {
                for x in 0..nx {
                    let at = grid.center(x, y, z) - base;
                    let away = (at.x * at.x + at.z * at.z).sqrt();
                    // A cell counts as a whole: it lies in the ring if its center does.
                    let ring = (self.radius..self.radius + RING_THICKNESS).contains(&away);
                    if ring && (RING_HEIGHTS[0] * height..RING_HEIGHTS[1] * height).contains(&at.y) {
                        areas.add_to_cell((y * nz + z) * nx + x, area);
                    }
                }
            }
        }
    }
}

/// Region that a cut leaves standing; wood outside of it is removed.
#[derive(Debug, Clone)]
pub enum Keep {
    /// A box in the space of the tree, from its base, m.
    Box {
        /// Corner with the smallest coordinates.
        min: Vec3,
        /// Corner with the largest coordinates.
        max: Vec3,
    },
    /// The inside of a solid of the scene.
    Solid(Arc<Solid>),
}

impl Keep {
    /// Whether the point `p`, relative to the tree's base, is kept. `base`: in the scene.
    pub(super) fn holds(&self, base: Vec3, p: Vec3) -> bool {
        match self {
            Self::Box { min, max } => p.cmpge(*min).all() && p.cmple(*max).all(),
            Self::Solid(solid) => solid.contains(base + p),
        }
    }
}

/// A cut at the start of one year of a tree's life, or repeated in several.
#[derive(Debug, Clone)]
pub struct Prune {
    /// Year of the tree's life of the first cut, from 1.
    pub year: u32,
    /// Years from one cut to the next; 0: only once.
    pub every: u32,
    /// Last year of the tree's life in which it may repeat; does not hold for the first cut.
    pub until: u32,
    /// Region whose wood stays.
    pub keep: Keep,
}

impl Prune {
    /// Whether the cut is made in a year of the tree's life.
    pub(super) fn happens(&self, year: u32) -> bool {
        let repeats =
            self.every > 0 && year <= self.until && (year.saturating_sub(self.year)).is_multiple_of(self.every);
        year == self.year || (year > self.year && repeats)
    }
}

/// One internode as a growing shoot places it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Step {
    /// Unit direction of the internode.
    pub d: Vec3,
    /// Length of the internode, m; less than planned after sliding.
    pub length: f32,
}

/// Obstacles to the shoots of a tree: the solids of the scene, and the tree's base there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Obstacles<'a> {
    /// Place of the tree's base in the scene, m.
    pub base: Vec3,
    /// Ground and solids; `None`: level ground at the base.
    pub solids: Option<&'a Solids>,
}

impl Obstacles<'_> {
    /// A step from `from`, in the space of the tree, that slides along what it meets; `None` if too little of it is left.
    /// Own: where the surface is nearer than the radius and a clearance, the end moves out along the normal and the direction
    /// loses its inward part.
    pub fn slide(&self, from: Vec3, step: Step, radius: f32) -> Option<Step> {
        let room = radius + CLEARANCE;
        let mut end = from + step.d * step.length;
        let Some(solids) = self.solids else {
            // Level ground: only what grows downwards can meet it.
            if end.y >= room || step.d.y >= 0.0 {
                return Some(step);
            }
            end.y = room.min(from.y);
            return Self::left(from, end, step);
        };
        // Two rounds, for a corner of two surfaces.
        let mut met = false;
        for _ in 0..2 {
            let Some(near) = solids.near(self.base + end, room) else { break };
            let inward = step.d.dot(near.nearest.normal) < 0.0;
            if near.nearest.distance >= room || !(inward || met) {
                break;
            }
            met = true;
            end += near.nearest.normal * (room - near.nearest.distance);
        }
        if met { Self::left(from, end, step) } else { Some(step) }
    }

    fn left(from: Vec3, end: Vec3, step: Step) -> Option<Step> {
        let way = end - from;
        let length = way.length();
        (length >= LEAST_STEP * step.length && length > 0.0).then(|| Step { d: way / length, length })
    }
}

/// Extends a box of the field by the solids that may shade it, clipped to the reach of their shade. `anchor`: the field's origin
/// in the scene.
pub(super) fn with_shading_solids(bounds: Bounds, solids: Option<&Solids>, anchor: Vec3) -> Bounds {
    let Some(solids) = solids else { return bounds };
    let reach = bounds.grown(SHADE_REACH);
    solids.list().iter().filter(|s| !matches!(s.form, Form::Land(_))).fold(bounds, |all, solid| {
        let b = solid.bounds();
        let (min, max) = ((b.min - anchor).max(reach.min), (b.max - anchor).min(reach.max));
        if min.cmple(max).all() { all.union(Bounds { min, max }) } else { all }
    })
}

/// Whether no light passes a cell because of a solid. `at`: center of the cell in the scene; `cell`: its side, m.
fn is_opaque(solid: &Solid, at: Vec3, cell: f32) -> bool {
    if !matches!(solid.form, Form::Land(_)) {
        return solid.nearest(at).distance < OPAQUE_REACH * cell;
    }
    // Land is thick, so that only cells without air need to be opaque: on a slope the tip of a seedling lies in a cell whose center is
    // close to the land or below it.
    let half = 0.5 * cell;
    TOP_POINTS.iter().all(|[x, z]| solid.contains(at + half * Vec3::new(*x, 1.0, *z)))
}

/// Indices of the cells that lie in a solid, in rising order. Level ground needs none, since light comes from above.
pub(super) fn opaque_cells(grid: &Grid, solids: Option<&Solids>, anchor: Vec3) -> Vec<u32> {
    let mut cells = Vec::new();
    let Some(solids) = solids else { return cells };
    let boxes: Vec<Bounds> = solids.list().iter().map(|s| s.bounds().grown(OPAQUE_REACH * grid.cell)).collect();
    let [nx, ny, nz] = grid.size;
    for y in 0..ny {
        for z in 0..nz {
            for x in 0..nx {
                let center = grid.center(x, y, z);
                let at = anchor + center;
                let inside = solids.list().iter().zip(&boxes).any(|(solid, b)| {
                    let near = at.cmpge(b.min).all() && at.cmple(b.max).all();
                    near && is_opaque(solid, at, grid.cell)
                });
                if inside {
                    cells.push(grid.cell_of(center));
                }
            }
        }
    }
    cells
}

#[cfg(test)]
mod tests {
    use super::*;
    use osier_scene::solid::{LandForm, Prism};

    #[test]
    fn steps_slide_along_a_wall_and_end_at_it() {
        let block = Prism::block(Vec3::new(1.0, 0.0, 0.0), Vec3::new(1.0, 4.0, 4.0), 0.0);
        let wall = Solid { name: "wall".into(), form: Form::Prism(block), humidity: 0.0 };
        let solids = Solids::new(vec![wall], true);
        let obstacles = Obstacles { base: Vec3::ZERO, solids: Some(&solids) };
        let from = Vec3::new(0.4, 1.0, 0.0);
        let along = Vec3::new(0.6, 0.8, 0.0);
        let slid = obstacles.slide(from, Step { d: along, length: 0.2 }, 0.01).expect("slides");
        let end = from + slid.d * slid.length;
        assert!((end.x - 0.47).abs() < 1e-5 && slid.d.y > along.y, "{slid:?} {end}");
        assert!(obstacles.slide(from, Step { d: Vec3::X, length: 0.5 }, 0.01).is_none());
        let free = obstacles.slide(from, Step { d: -Vec3::X, length: 0.2 }, 0.01).expect("free");
        assert!((free.length - 0.2).abs() < 1e-6);
        let level = Obstacles { base: Vec3::ZERO, solids: None };
        let down = Vec3::new(0.8, -0.6, 0.0);
        let slid = level.slide(Vec3::new(0.0, 0.1, 0.0), Step { d: down, length: 0.3 }, 0.0).expect("slides");
        assert!((0.1 + slid.d.y * slid.length - 0.02).abs() < 1e-6);
    }

    #[test]
    fn the_foot_of_a_seedling_on_a_slope_is_in_the_light() {
        // Slopes of 40 degrees towards each side; the foot lies at a corner of four cells.
        for rise in [Vec3::X, Vec3::NEG_X, Vec3::Z, Vec3::NEG_Z].map(|d| 0.84 * d) {
            let step = |i: usize| i as f32 * 2.0 - 4.0;
            let heights = (0..25).map(|i| rise.dot(Vec3::new(step(i % 5), 0.0, step(i / 5)))).collect();
            let land = LandForm::new(5, 8.0, heights).expect("fits");
            let land = Solid { name: "land".into(), form: Form::Land(Arc::new(land)), humidity: 0.0 };
            let solids = Solids::new(vec![land], false);
            let grid = Grid::over(Bounds { min: Vec3::ZERO, max: 0.2 * Vec3::Y });
            let opaque = opaque_cells(&grid, Some(&solids), Vec3::ZERO);
            for (x, z) in [(0.05, 0.05), (-0.05, 0.05), (0.05, -0.05), (-0.05, -0.05)] {
                let tip = Vec3::new(x, rise.dot(Vec3::new(x, 0.0, z)) + 0.05, z);
                assert!(!opaque.contains(&grid.cell_of(tip)), "{rise} {tip}");
                assert!(opaque.contains(&grid.cell_of(Vec3::new(x, -0.5, z))), "{rise} {tip}");
            }
        }
    }

    #[test]
    fn cuts_repeat_until_their_end() {
        let keep = Keep::Box { min: Vec3::ZERO, max: Vec3::ONE };
        let prune = Prune { year: 12, every: 3, until: 20, keep };
        let years: Vec<u32> = (0..30).filter(|y| prune.happens(*y)).collect();
        assert_eq!(years, [12, 15, 18]);
        let once = Prune { every: 0, ..prune };
        assert_eq!((0..30).filter(|y| once.happens(*y)).count(), 1);
    }
}
