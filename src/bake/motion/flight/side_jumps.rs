//! Catkins that a periodic side moves to the other side of the domain; they are hidden while they cross.

use glam::Vec3;

use osier_motion::flight::{FlightParams, FlightSimulation, SideBoundary};
use osier_scene::InstanceState;

/// Number of frames for which a catkin that crosses a side is hidden, as a recycled one: in the first it continues beyond its
/// side, in the second it is at its new position, so that interpolation between frames draws nothing across the domain.
const HIDDEN_FRAMES: u8 = 2;

/// Crossings of periodic sides, frame by frame.
#[derive(Debug, Default)]
pub(super) struct SideJumps {
    /// Positions at the last frame, m, by id; empty before the first.
    places: Vec<Vec3>,
    /// The latest crossing of each catkin, by id; empty without periodic sides.
    jumps: Vec<SideJump>,
}

/// A catkin's latest crossing of a periodic side.
#[derive(Debug, Clone, Copy, Default)]
struct SideJump {
    /// Number of frames for which the catkin remains hidden, including the present one; 0 if it is visible.
    hidden: u8,
    /// Vector from the catkin's position to its position in a domain continued beyond the side, m; 0 from the second hidden
    /// frame.
    back: Vec3,
}

impl SideJumps {
    /// Records the positions at a frame. Must be called for each frame in order.
    pub(super) fn follow(&mut self, simulation: &FlightSimulation) {
        let FlightParams { inside, edges, .. } = simulation.options();
        if !edges.contains(&SideBoundary::Periodic) {
            return;
        }
        let size = inside.size();
        // A catkin that moves by more than half of the domain along a periodic axis in a frame has crossed the side.
        let beyond = |edge: SideBoundary, way: f32, size: f32| {
            if edge == SideBoundary::Periodic && way.abs() > size / 2.0 { -size.copysign(way) } else { 0.0 }
        };
        let places: Vec<Vec3> = simulation.by_id().map(|c| c.position().as_vec3()).collect();
        let before = if self.places.is_empty() { places.clone() } else { std::mem::take(&mut self.places) };
        self.jumps.resize(places.len(), SideJump::default());
        for (((c, now), before), jump) in simulation.by_id().zip(&places).zip(&before).zip(&mut self.jumps) {
            let way = *now - *before;
            let back = Vec3::new(beyond(edges[0], way.x, size.x), 0.0, beyond(edges[1], way.z, size.z));
            // A recycled catkin is hidden already.
            *jump = if back != Vec3::ZERO && c.state().is_seen() {
                SideJump { hidden: HIDDEN_FRAMES, back }
            } else {
                SideJump { hidden: jump.hidden.saturating_sub(1), back: Vec3::ZERO }
            };
        }
        self.places = places;
    }

    /// Hides the catkins that cross a side at this frame, and moves them to the positions at which they are drawn meanwhile.
    /// `state`: state of all catkins, by id.
    pub(super) fn hide(&self, state: &mut InstanceState) {
        for ((jump, alive), position) in self.jumps.iter().zip(&mut state.alive).zip(&mut state.positions) {
            if jump.hidden > 0 {
                *alive = false;
                *position += jump.back;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::DVec3;

    use super::*;
    use osier_base::geometry::Bounds;
    use osier_motion::flight::{CatkinStart, ReleaseCondition};
    use osier_scene::solid::Solids;
    use osier_wind::UniformWind;

    fn shown(simulation: &FlightSimulation, jumps: &SideJumps) -> InstanceState {
        let positions = simulation.frame().positions;
        let mut state = InstanceState { alive: vec![true; positions.len()], positions, ..InstanceState::default() };
        jumps.hide(&mut state);
        state
    }

    /// A visible catkin, up to the frame in which it is hidden, moves continuously: nothing is drawn across the domain.
    #[test]
    fn catkins_are_hidden_while_they_change_sides() {
        let inside = Bounds { min: Vec3::new(-5.0, 0.0, -5.0), max: Vec3::new(5.0, 30.0, 5.0) };
        let options = FlightParams {
            inside,
            edges: [SideBoundary::Periodic; 2],
            stick_probability: 0.0,
            ..FlightParams::default()
        };
        let start = |i: i32| CatkinStart {
            at: DVec3::new(f64::from(i) - 4.0, 20.0, 3.0 - f64::from(i)),
            wait: ReleaseCondition::Until(0.0),
        };
        let starts: Vec<CatkinStart> = (0..8).map(start).collect();
        let mut simulation = FlightSimulation::new(options, Arc::new(Solids::default()), &starts);
        let mut jumps = SideJumps::default();
        jumps.follow(&simulation);
        let mut before = shown(&simulation, &jumps);
        let mut hidden = 0;
        for frame in 0..96 {
            simulation.advance_frame(&UniformWind(Vec3::new(4.0, 0.0, -6.0)));
            jumps.follow(&simulation);
            let now = shown(&simulation, &jumps);
            for (i, (a, b)) in before.positions.iter().zip(&now.positions).enumerate() {
                let may_jump = !before.is_alive(i) && !now.is_alive(i);
                assert!(may_jump || a.distance(*b) < 0.5, "frame {frame}: {i} from {a} to {b}");
                hidden += usize::from(!now.is_alive(i));
            }
            before = now;
        }
        // In four seconds each passes 1.6 times through the sides across x and 2.4 times through those across z.
        assert!((50..80).contains(&hidden), "{hidden}");
    }
}
