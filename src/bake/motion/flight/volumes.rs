//! Catkins as voxel grids: those in flight per volume, those at rest per area.

use std::collections::BTreeMap;

use crate::recipe::scene::{VdbGrid, WindModel};
use crate::recipe::{Recipe, word_of};
use osier_base::geometry::Bounds;
use osier_base::math::narrow;
use osier_motion::flight::{CatkinState, FlightSimulation};
use osier_scene::{VolumeFrame, VolumeGrid};

/// The voxel grids of a flight and the catkins that each counts.
#[derive(Debug, Clone, Default)]
pub(super) struct FlightVolumes {
    /// Declarations of the grids, as in the scene.
    pub grids: Vec<VolumeGrid>,
    /// Which catkins each grid counts, parallel to `grids`.
    counted: Vec<CatkinPhase>,
}

/// Phase of the catkins that a grid counts; it determines the unit of the grid, 1/m^3 or 1/m^2.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum CatkinPhase {
    /// In flight, per volume of a cell.
    Airborne,
    /// At rest, per area of a cell's face, in the cell that contains them.
    Deposited,
}

impl FlightVolumes {
    /// The grids that a recipe requests for a flight of `count` catkins; empty without a domain for volumes. `inside`: box of the
    /// flight, m, whose base is that of the cells.
    pub(super) fn from_recipe(recipe: &Recipe, count: u32, inside: Bounds) -> Self {
        let output = &recipe.output;
        let Some(domain) = output.vdb.domain.as_ref().filter(|_| output.writes_vdb()) else { return Self::default() };
        // The cells of a lattice have its base in f64 already.
        let lattice = recipe.wind.model == WindModel::Lattice;
        let corner = if lattice { domain.corner } else { domain.corner.with_y(f64::from(inside.min.y)) };
        let all = [
            (VdbGrid::Density, CatkinPhase::Airborne, "1/m^3"),
            (VdbGrid::Deposition, CatkinPhase::Deposited, "1/m^2"),
        ];
        let wanted = all.into_iter().filter(|(grid, ..)| output.vdb.keys.grids.contains(grid));
        let grid = |(grid, counted, unit): (VdbGrid, CatkinPhase, &'static str)| {
            let volume = VolumeGrid {
                file: "flock",
                name: word_of(grid),
                unit,
                is_vector: false,
                origin: corner + domain.side / 2.0,
                cell: domain.side,
                every: domain.every,
                max_cells: u64::from(count),
            };
            (volume, counted)
        };
        let (grids, counted) = wanted.map(grid).unzip();
        Self { grids, counted }
    }

    /// Values of all grids in a state, in their order. The sum of the density times the volume of a cell is the number of
    /// catkins in flight; the sum of the deposition times the area of a cell's face is the number of catkins at rest.
    pub(super) fn fill(&self, simulation: &FlightSimulation) -> Vec<VolumeFrame> {
        if self.grids.is_empty() {
            return Vec::new();
        }
        let catkins = simulation.frame();
        let fill = |(grid, counted): (&VolumeGrid, &CatkinPhase)| {
            let counts = |state: CatkinState| match counted {
                CatkinPhase::Airborne => state == CatkinState::Airborne,
                CatkinPhase::Deposited => state.is_deposited(),
            };
            // Volume of a cell, m^3, or area of its face, m^2, by which its count is divided.
            let extent = match counted {
                CatkinPhase::Airborne => grid.cell * grid.cell * grid.cell,
                CatkinPhase::Deposited => grid.cell * grid.cell,
            };
            let mut cells: BTreeMap<[i32; 3], u32> = BTreeMap::new();
            for (position, _) in catkins.positions.iter().zip(&catkins.states).filter(|(_, state)| counts(**state)) {
                *cells.entry(grid.cell_of(position.as_dvec3())).or_default() += 1;
            }
            VolumeFrame::scalars(cells.into_iter().map(|(cell, n)| (cell, narrow(f64::from(n) / extent))))
        };
        self.grids.iter().zip(&self.counted).map(fill).collect()
    }
}
