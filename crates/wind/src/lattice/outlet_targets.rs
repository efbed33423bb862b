//! Faces through which air comes and goes, and what the wind asks of each.

use glam::DVec3;

use super::domain::{Cells, Face};
use super::flow::Flow;
use super::inlet::{Blowing, InletWind, Mouth};
use super::setup::Plan;
use osier_base::math::narrow;

/// The wind before each open face.
#[derive(Debug, Clone, Copy)]
pub(super) struct Doors {
    /// Mean speed that is asked for there, cells a step; 0 for other faces.
    speed: [f64; 6],
    /// Places outside it.
    count: [f64; 6],
}

impl Doors {
    pub(super) fn of(flow: &Flow, inlet: &InletWind, plan: &Plan) -> Self {
        let (mut sum, mut count) = ([0.0_f64; 6], [0.0_f64; 6]);
        for (place, face) in flow.links.mouths.before_air() {
            let height = plan.middle(place).y - plan.origin.y - ground(&flow.cells, place, plan.spacing);
            sum[face] += inlet.steady(height, 1.0) / plan.speed();
            count[face] += 1.0;
        }
        Self { speed: std::array::from_fn(|f| if count[f] > 0.0 { sum[f] / count[f] } else { 0.0 }), count }
    }

    /// Mean outward velocity at each outlet when what comes in goes out, cells a step: shared out as the profile has it.
    pub(super) fn wanted(&self, faces: [Face; 6], now: Blowing) -> [f32; 6] {
        let out: [f64; 6] = std::array::from_fn(|f| {
            let outward = if f.is_multiple_of(2) { -1.0 } else { 1.0 };
            outward * f64::from(now.toward[f / 2]) * self.speed[f]
        });
        let all = |face: Face| (0..6).filter(|f| faces[*f] == face).map(|f| out[f] * self.count[f]).sum::<f64>();
        let (coming, going) = (-all(Face::Inlet), all(Face::Outlet));
        let share = if going > 0.0 { coming / going } else { 0.0 };
        out.map(|out| narrow(share * out) * now.share)
    }
}

/// The wind at every place where it comes in.
pub(super) fn mouth(flow: &Flow, inlet: &InletWind, plan: &Plan) -> Mouth {
    let place = |p| (plan.middle(p), ground(&flow.cells, p, plan.spacing));
    let places: Vec<_> = flow.links.mouths.inlets().into_iter().map(place).collect();
    Mouth::new(inlet, &places, |height| plan.tau_at(height), plan.dt / plan.spacing)
}

/// Height of the solid cells at the foot of the column before an open face, m.
#[allow(clippy::cast_possible_wrap, clippy::cast_sign_loss, reason = "clamped to the domain")]
fn ground(cells: &Cells, place: [isize; 3], spacing: f64) -> f64 {
    let near = |a: usize| place[a].clamp(0, cells.grid.n[a] as isize - 1) as usize;
    let (x, z) = (near(0), near(2));
    let solid = (0..cells.grid.n[1]).take_while(|y| cells.is_solid([x, *y, z])).count();
    spacing * solid as f64
}

/// What the profile has more than its mean, by height, and how it leans, both along the wind, cells a step.
pub(super) fn uneven(inlet: &InletWind, plan: &Plan) -> Vec<[f64; 2]> {
    let heights: Vec<f64> = (0..plan.n[1]).map(|y| plan.spacing * (y as f64 + 0.5)).collect();
    let of = |height: &f64| inlet.steady(*height, 1.0) / plan.speed();
    let mean = heights.iter().map(of).sum::<f64>() / plan.n[1] as f64;
    heights.iter().map(|h| [of(h) - mean, inlet.leaning(plan.tau_at(*h), *h) / plan.speed()]).collect()
}

impl Plan {
    #[allow(clippy::cast_precision_loss, reason = "numbers of cells")]
    fn middle(&self, p: [isize; 3]) -> DVec3 {
        self.origin + (DVec3::new(p[0] as f64, p[1] as f64, p[2] as f64) + 0.5) * self.spacing
    }
}
