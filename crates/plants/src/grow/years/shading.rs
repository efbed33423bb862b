//! Objects that shade the trees of a field besides their own leaves: solids and invisible neighbours.

use glam::{Vec2, Vec3};

use super::light::{Grid, LeafAreas};
use osier_base::geometry::Bounds;
use osier_scene::solid::{Form, LandForm, Solid, Solids};

/// Distance from living wood beyond which solids cast no shade, m: light comes from 25 degrees and more, so that only walls
/// higher than half of this distance would.
const SHADE_REACH: f32 = 12.0;
/// Thickness of the ring of neighbours, m.
const RING_THICKNESS: f32 = 3.0;
/// Heights of the ring's lower and upper edges as shares of the tree's height.
const RING_HEIGHTS: [f32; 2] = [0.3, 0.92];
/// Share of a cell's side that the surface of a thin solid may lie beyond its center and still make it opaque.
const OPAQUE_REACH: f32 = 0.25;

/// Invisible neighbours of a tree: a ring of leaves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Neighbours {
    /// Inner radius of the ring, m.
    pub radius: f32,
    /// Leaf area per volume, m2/m3.
    pub density: f32,
    /// Year of the tree's life in which they are felled.
    pub until: f32,
}

impl Neighbours {
    /// Box of the ring around a tree of the given height, in the space of the tree.
    pub(super) fn bounds(&self, height: f32) -> Bounds {
        let r = self.radius + RING_THICKNESS;
        Bounds { min: Vec3::new(-r, 0.0, -r), max: Vec3::new(r, height * RING_HEIGHTS[1], r) }
    }

    /// Adds the ring's leaves to the field. `base`: base of the tree in the field, m; `extinction`: extinction of its
    /// species.
    pub(super) fn deposit(&self, areas: &mut LeafAreas, base: Vec3, height: f32, extinction: f32) {
        let grid = areas.grid;
        // The field holds leaf areas times extinction, because species absorb light differently.
        let area = self.density * grid.cell * grid.cell * grid.cell * extinction;
        let [nx, ny, nz] = grid.size;
        for y in 0..ny {
            for z in 0..nz {
                for x in 0..nx {
                    let at = grid.center(x, y, z) - base;
                    let away = (at.x * at.x + at.z * at.z).sqrt();
                    // A cell lies in the ring if its center does.
                    let ring = (self.radius..self.radius + RING_THICKNESS).contains(&away);
                    if ring && (RING_HEIGHTS[0] * height..RING_HEIGHTS[1] * height).contains(&at.y) {
                        areas.add_to_cell((y * nz + z) * nx + x, area);
                    }
                }
            }
        }
    }
}

/// Extends a box of the field by the solids that may shade it, clipped to the reach of their shade. `anchor`: the field's origin
/// in the scene.
pub(super) fn with_shading_solids(bounds: Bounds, solids: Option<&Solids>, anchor: Vec3) -> Bounds {
    let Some(solids) = solids else { return bounds };
    let reach = bounds.expanded(SHADE_REACH);
    solids.list().iter().filter(|s| !matches!(s.form, Form::Land(_))).fold(bounds, |all, solid| {
        let b = solid.bounds();
        let (min, max) = ((b.min - anchor).max(reach.min), (b.max - anchor).min(reach.max));
        if min.cmple(max).all() { all.union(Bounds { min, max }) } else { all }
    })
}

/// Indices of the cells that let no light pass, in ascending order: cells whose centers lie in a solid or close in front of a
/// thin solid, and cells that lie entirely below a land. Seedlings grow in cells that the land only crosses; these let light
/// pass. Level ground needs no opaque cells, since light comes from above.
pub(super) fn opaque_cells(grid: &Grid, solids: Option<&Solids>, anchor: Vec3) -> Vec<u32> {
    let mut cells = Vec::new();
    let Some(solids) = solids else { return cells };
    let boxes: Vec<Bounds> = solids.list().iter().map(|s| s.bounds().expanded(OPAQUE_REACH * grid.cell)).collect();
    let [nx, ny, nz] = grid.size;
    for y in 0..ny {
        for z in 0..nz {
            for x in 0..nx {
                let center = grid.center(x, y, z);
                let at = anchor + center;
                let inside = solids.list().iter().zip(&boxes).any(|(solid, b)| {
                    let near = at.cmpge(b.min).all() && at.cmple(b.max).all();
                    near && match &solid.form {
                        Form::Land(land) => lies_below(land, at, grid.cell),
                        _ => shades_cell(solid, solids, at, grid.cell),
                    }
                });
                if inside {
                    cells.push(grid.cell_of(center));
                }
            }
        }
    }
    cells
}

/// Whether a solid makes a cell opaque: either it contains the cell's center, or its surface is near the center and the
/// next cell behind the surface is in no solid. The second case holds for a solid that is thinner than a cell and does
/// not cover another solid, as the slabs of a roof cover a house. Tips in front of a thick wall stand in cells that let
/// light pass. `all`: all solids, including this one; `center`: center of the cell in the scene, m; `side`: side of the
/// cell, m.
fn shades_cell(solid: &Solid, all: &Solids, center: Vec3, side: f32) -> bool {
    let near = solid.nearest(center);
    if near.distance < 0.0 || near.distance >= OPAQUE_REACH * side {
        return near.distance < 0.0;
    }
    // The neighbour of the cell that lies most nearly behind the surface.
    let [x, y, z] = near.normal.abs().to_array();
    let axis = if x >= y && x >= z {
        Vec3::X
    } else if y >= z {
        Vec3::Y
    } else {
        Vec3::Z
    };
    let behind = center - axis * (side * near.normal.dot(axis).signum());
    // A cell that land only crosses lets light pass.
    !all.list().iter().any(|s| !matches!(s.form, Form::Land(_)) && s.contains(behind))
}

/// Whether the whole upper face of a cell of the given side lies below a land, tested at the middle, the corners and the middles
/// of the edges of that face. `center`: center of the cell in the scene, m.
fn lies_below(land: &LandForm, center: Vec3, side: f32) -> bool {
    let half = 0.5 * side;
    let top = center.y + half;
    let steps = [0.0, -half, half];
    // The middle is tested first, because it excludes most cells above the land.
    steps.iter().all(|z| steps.iter().all(|x| land.height(Vec2::new(center.x + x, center.z + z)) >= top))
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use osier_scene::solid::Prism;

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

    /// Seedlings end 5 cm above a land of 35 degrees, at any place of the grid's cells: their cells let light pass, those deep in
    /// the land don't.
    #[test]
    fn seedlings_on_a_slope_stand_in_cells_that_let_light_pass() {
        let rise = 0.7_f32;
        let heights: Vec<f32> = (0..33_u16).flat_map(|_| (0..33_u16).map(|x| rise * (f32::from(x) - 16.0))).collect();
        let land = LandForm::new(33, 32.0, heights).expect("a land");
        let solid = Solid { name: "land".into(), form: Form::Land(Arc::new(land.clone())), humidity: 0.0 };
        let solids = Solids::new(vec![solid], false);
        let anchor = Vec3::new(0.0, land.height(Vec2::ZERO), 0.0);
        let grid = Grid::over(Bounds { min: Vec3::new(-3.0, -3.0, -1.0), max: Vec3::new(3.0, 3.0, 1.0) });
        let opaque = opaque_cells(&grid, Some(&solids), anchor);
        for k in 0..40_u16 {
            let (x, z) = (f32::from(k) * 0.137 - 2.7, f32::from(k) * 0.043 - 0.8);
            let ground = land.height(Vec2::new(x, z));
            let at = |y: f32| grid.cell_of(Vec3::new(x, y, z) - anchor);
            assert!(!opaque.contains(&at(ground + 0.05)), "a seedling at {x} {z}");
            assert!(opaque.contains(&at(ground - 0.7)), "the inside of the land at {x} {z}");
        }
    }

    /// A thick wall darkens no cell in front of it, and a thin one stands in at least one cell wherever it lies in the grid.
    #[test]
    fn walls_are_opaque_at_any_place_of_the_grid() {
        let grid = Grid::over(Bounds { min: Vec3::new(-3.0, 0.0, -3.0), max: Vec3::new(3.0, 3.0, 3.0) });
        let row = |from: f32, thickness: f32| -> Vec<f32> {
            let foot = Vec3::new(from + 0.5 * thickness, 0.0, 0.0);
            let block = Prism::block(foot, Vec3::new(thickness, 2.0, 4.0), 0.0);
            let wall = Solid { name: "wall".into(), form: Form::Prism(block), humidity: 0.0 };
            let opaque = opaque_cells(&grid, Some(&Solids::new(vec![wall], true)), Vec3::ZERO);
            let centers = (0..grid.size[0]).map(|x| grid.center(x, 3, grid.size[2] / 2));
            centers.filter(|c| opaque.contains(&grid.cell_of(*c))).map(|c| c.x).collect()
        };
        for k in 0..20_u16 {
            let from = 0.2 + 0.015 * f32::from(k);
            let thick = row(from, 0.6);
            assert!(!thick.is_empty() && thick.iter().all(|x| (from..=from + 0.6).contains(x)), "{from}: {thick:?}");
            assert!(!row(from, 0.16).is_empty(), "a thin wall at {from}");
        }
    }

    /// Slabs of a roof are thinner than a cell, but lie on a house: they darken no cell above it. Close to the ridge the cell behind the
    /// slab may lie beyond the other one.
    #[test]
    fn cells_above_a_roof_let_light_pass() {
        let grid = Grid::over(Bounds { min: Vec3::new(-3.0, 0.0, -3.0), max: Vec3::new(3.0, 3.0, 3.0) });
        for k in 0..20_u16 {
            let foot = Vec3::Y * (0.02 * f32::from(k));
            let house = Prism::house(foot, Vec3::new(4.0, 1.0, 4.0), 1.5, 0.0);
            let forms = house.roof_slabs(0.35, 0.16).into_iter().chain([house]);
            let solid = |form| Solid { name: "house".into(), form: Form::Prism(form), humidity: 0.0 };
            let solids = Solids::new(forms.map(solid).collect(), true);
            let opaque = opaque_cells(&grid, Some(&solids), Vec3::ZERO);
            let mut above = 0;
            for (x, z) in (0..grid.size[0]).flat_map(|x| (0..grid.size[2]).map(move |z| (x, z))) {
                for center in (0..grid.size[1]).map(|y| grid.center(x, y, z)) {
                    let is_over_house =
                        center.x.abs() < 1.5 && (0.5..1.5).contains(&center.z.abs()) && center.y > foot.y;
                    if is_over_house && !solids.contains(center) {
                        above += 1;
                        assert!(!opaque.contains(&grid.cell_of(center)), "{foot} {center}");
                    }
                }
            }
            assert!(above > 10, "{above} cells");
        }
    }
}
