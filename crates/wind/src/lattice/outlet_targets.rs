//! Target velocities of the outlets, computed from the mean wind at each open face, and the inlet nodes.

use glam::DVec3;

use super::domain::{Domain, FaceCondition};
use super::flow::FlowState;
use super::inlet::{InletNode, InletNodes, InletStep, InletWind};
use super::setup::LatticeSetup;
use osier_base::math::narrow;

/// Mean wind at each open face, from which the outward velocities of outlets follow by conservation of mass.
#[derive(Debug, Clone, Copy)]
pub(super) struct OutletTargets {
    /// Mean speed of the profile over the face, cells per step; 0 for faces without ghost nodes.
    speed: [f64; 6],
    /// Number of ghost nodes outside the face, as a measure of its open area.
    count: [f64; 6],
}

impl OutletTargets {
    /// Averages the mean speed over the ghost nodes of each open face.
    pub(super) fn new(flow: &FlowState, inlet: &InletWind, setup: &LatticeSetup) -> Self {
        let (mut sum, mut count) = ([0.0_f64; 6], [0.0_f64; 6]);
        for (node, face) in flow.exchange.open_boundary.single_face_nodes() {
            // Heights are measured from the local ground, where the profile begins.
            let height = setup.cell_center(node).y - setup.origin.y - ground_height(&flow.domain, node, setup.spacing);
            sum[face] += inlet.speed_at(height, 1.0) / setup.speed_unit();
            count[face] += 1.0;
        }
        Self { speed: std::array::from_fn(|f| if count[f] > 0.0 { sum[f] / count[f] } else { 0.0 }), count }
    }

    /// Mean outward velocity at each outlet, cells per step, at which the outflow equals the inflow. The outflow is distributed
    /// over the outlets in proportion to the undisturbed wind through them.
    pub(super) fn outlet_velocity(&self, faces: [FaceCondition; 6], step: InletStep) -> [f32; 6] {
        // Outward normal velocity of the undisturbed mean wind at each face; velocity times node count is the flux.
        let normal_velocity: [f64; 6] = std::array::from_fn(|f| {
            let outward = if f.is_multiple_of(2) { -1.0 } else { 1.0 };
            outward * f64::from(step.direction[f / 2]) * self.speed[f]
        });
        let flux = |condition: FaceCondition| {
            (0..6).filter(|f| faces[*f] == condition).map(|f| normal_velocity[f] * self.count[f]).sum::<f64>()
        };
        // One factor on all outlets balances the fluxes.
        let (inflow, outflow) = (-flux(FaceCondition::Inlet), flux(FaceCondition::Outlet));
        let balance = if outflow > 0.0 { inflow / outflow } else { 0.0 };
        normal_velocity.map(|v| narrow(balance * v) * step.mean_factor)
    }
}

/// Prepares the inflow at every ghost node outside an inlet face.
pub(super) fn inlet_nodes(flow: &FlowState, inlet: &InletWind, setup: &LatticeSetup) -> InletNodes {
    let node = |p| InletNode { position: setup.cell_center(p), ground: ground_height(&flow.domain, p, setup.spacing) };
    let nodes: Vec<_> = flow.exchange.open_boundary.inlet_positions().into_iter().map(node).collect();
    InletNodes::new(inlet, &nodes, |height| setup.tau_without_sponge(height), setup.dt / setup.spacing)
}

/// Height, m, of the ground before an open face: the solid cells from the bottom up in the column nearest to a node.
fn ground_height(domain: &Domain, node: [isize; 3], spacing: f64) -> f64 {
    let [x, _, z] = domain.nearest_cell(node);
    let solid = (0..domain.grid.n[1]).take_while(|y| domain.is_solid([x, *y, z])).count();
    spacing * solid as f64
}

/// By height of cell: mean speed less its average over all heights, and shear coefficient, both along the wind, cells per step.
pub(super) fn ramp_velocity_by_height(inlet: &InletWind, setup: &LatticeSetup) -> Vec<[f64; 2]> {
    let heights: Vec<f64> = (0..setup.n[1]).map(|y| setup.spacing * (y as f64 + 0.5)).collect();
    let speed = |height: &f64| inlet.speed_at(*height, 1.0) / setup.speed_unit();
    let mean = heights.iter().map(speed).sum::<f64>() / setup.n[1] as f64;
    heights
        .iter()
        .map(|h| [speed(h) - mean, inlet.mean_shear_coefficient(setup.tau_without_sponge(*h), *h) / setup.speed_unit()])
        .collect()
}

impl LatticeSetup {
    #[allow(clippy::cast_precision_loss, reason = "numbers of cells")]
    /// Centre of a cell or ghost node, m.
    fn cell_center(&self, p: [isize; 3]) -> DVec3 {
        self.origin + (DVec3::new(p[0] as f64, p[1] as f64, p[2] as f64) + 0.5) * self.spacing
    }
}
