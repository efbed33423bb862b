//! Catkins as points with attributes, for node systems.

use glam::{Quat, Vec3};

use crate::bake::motion::flight::FlightState;
use osier_motion::flight::CatkinState;
use osier_scene::{RecordColumn, RecordTable};

/// One row of the point table: a catkin that waits, flies or rests.
struct CatkinPoint {
    /// Index of the catkin among the starts, the same in all frames.
    id: u32,
    /// 0 waits for its release, 1 flies, 2 rests.
    state: u32,
    prototype: u32,
    /// Position at which the catkin is drawn, in the world, m.
    position: Vec3,
    /// Relative to the ground, m/s.
    velocity: Vec3,
    orientation: Quat,
    scale: f32,
}

/// All catkins of a state except those that have left the domain, in the order of their ids, at the positions where they are
/// drawn.
pub(super) fn catkin_points(state: &FlightState) -> RecordTable {
    let drawn = state.instance_state();
    let poses = drawn.positions.iter().zip(&drawn.orientations).zip(&drawn.velocities);
    let all = (0..).zip(state.simulation.by_id()).zip(poses);
    let points: Vec<CatkinPoint> = all
        .filter_map(|((id, catkin), ((position, orientation), velocity))| {
            Some(CatkinPoint {
                id,
                state: state_code(catkin.state())?,
                prototype: u32::from(catkin.kind()),
                position: *position,
                velocity: *velocity,
                orientation: *orientation,
                scale: catkin.scale(),
            })
        })
        .collect();
    let f32s = |name, unit, value: fn(&CatkinPoint) -> f32| RecordColumn::f32(name, unit, &points, value);
    let columns = vec![
        RecordColumn::u32("id", "", &points, |p| p.id),
        RecordColumn::u32("state", "", &points, |p| p.state),
        RecordColumn::u32("proto", "", &points, |p| p.prototype),
        f32s("x", "m", |p| p.position.x),
        f32s("y", "m", |p| p.position.y),
        f32s("z", "m", |p| p.position.z),
        f32s("vx", "m/s", |p| p.velocity.x),
        f32s("vy", "m/s", |p| p.velocity.y),
        f32s("vz", "m/s", |p| p.velocity.z),
        f32s("qw", "", |p| p.orientation.w),
        f32s("qx", "", |p| p.orientation.x),
        f32s("qy", "", |p| p.orientation.y),
        f32s("qz", "", |p| p.orientation.z),
        f32s("scale", "", |p| p.scale),
    ];
    RecordTable { name: "catkins", columns }
}

/// The number of a state in the table; `None` for a catkin that has left.
fn state_code(state: CatkinState) -> Option<u32> {
    match state {
        CatkinState::Pending => Some(0),
        CatkinState::Airborne => Some(1),
        CatkinState::Grounded | CatkinState::OnWall | CatkinState::Corner => Some(2),
        CatkinState::Exited => None,
    }
}
