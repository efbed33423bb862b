//! Faces through which air comes and goes, and what the wind asks of each.

use glam::DVec3;

use super::domain::{Domain, FaceCondition};
use super::flow::FlowState;
use super::inlet::{InletNodes, InletStep, InletWind};
use super::setup::LatticeSetup;
use osier_base::math::narrow;

/// The wind before each open face.
#[derive(Debug, Clone, Copy)]
pub(super) struct OutletTargets {
    /// Mean speed that is asked for there, cells a step; 0 for other faces.
    speed: [f64; 6],
    /// Places outside it.
    count: [f64; 6],
}

impl OutletTargets {
    pub(super) fn new(flow: &FlowState, inlet: &InletWind, setup: &LatticeSetup) -> Self {
        let (mut sum, mut count) = ([0.0_f64; 6], [0.0_f64; 6]);
        for (place, face) in flow.exchange.open_boundary.face_nodes() {
            let height =
                setup.cell_center(place).y - setup.origin.y - ground_height(&flow.domain, place, setup.spacing);
            sum[face] += inlet.mean_speed(height, 1.0) / setup.speed_unit();
            count[face] += 1.0;
        }
        Self { speed: std::array::from_fn(|f| if count[f] > 0.0 { sum[f] / count[f] } else { 0.0 }), count }
    }

    /// Mean outward velocity at each outlet when what comes in goes out, cells a step: shared out as the profile has it.
    pub(super) fn outlet_velocity(&self, faces: [FaceCondition; 6], now: InletStep) -> [f32; 6] {
        let out: [f64; 6] = std::array::from_fn(|f| {
            let outward = if f.is_multiple_of(2) { -1.0 } else { 1.0 };
            outward * f64::from(now.toward[f / 2]) * self.speed[f]
        });
        let all =
            |face: FaceCondition| (0..6).filter(|f| faces[*f] == face).map(|f| out[f] * self.count[f]).sum::<f64>();
        let (coming, going) = (-all(FaceCondition::Inlet), all(FaceCondition::Outlet));
        let share = if going > 0.0 { coming / going } else { 0.0 };
        out.map(|out| narrow(share * out) * now.share)
    }
}

/// The wind at every place where it comes in.
pub(super) fn inlet_nodes(flow: &FlowState, inlet: &InletWind, setup: &LatticeSetup) -> InletNodes {
    let place = |p| (setup.cell_center(p), ground_height(&flow.domain, p, setup.spacing));
    let places: Vec<_> = flow.exchange.open_boundary.inlet_positions().into_iter().map(place).collect();
    InletNodes::new(inlet, &places, |height| setup.tau_at(height), setup.dt / setup.spacing)
}

/// Height of the solid cells at the foot of the column before an open face, m.
fn ground_height(domain: &Domain, position: [isize; 3], spacing: f64) -> f64 {
    let [x, _, z] = domain.nearest_cell(position);
    let solid = (0..domain.grid.n[1]).take_while(|y| domain.is_solid([x, *y, z])).count();
    spacing * solid as f64
}

/// What the profile has more than its mean, by height, and how it leans, both along the wind, cells a step.
pub(super) fn profile_deviation(inlet: &InletWind, setup: &LatticeSetup) -> Vec<[f64; 2]> {
    let heights: Vec<f64> = (0..setup.n[1]).map(|y| setup.spacing * (y as f64 + 0.5)).collect();
    let of = |height: &f64| inlet.mean_speed(*height, 1.0) / setup.speed_unit();
    let mean = heights.iter().map(of).sum::<f64>() / setup.n[1] as f64;
    heights.iter().map(|h| [of(h) - mean, inlet.shear_at(setup.tau_at(*h), *h) / setup.speed_unit()]).collect()
}

impl LatticeSetup {
    #[allow(clippy::cast_precision_loss, reason = "numbers of cells")]
    fn cell_center(&self, p: [isize; 3]) -> DVec3 {
        self.origin + (DVec3::new(p[0] as f64, p[1] as f64, p[2] as f64) + 0.5) * self.spacing
    }
}
