//! Tropisms: how directional growth responses (to gravity, to light) turn the heading before and after a step.

use glam::DVec3;

use super::frame::TurtleFrame;
use super::options::Tropism;
use osier_base::math;

/// Largest number of tropisms of a scene; each has an elasticity in the turtle's state.
pub(super) const MAX_TROPISMS: usize = 8;

/// Greatest turn of one step, rad. cpfg clamps at the same angle; without it a long step at high elasticity would overshoot
/// the direction sought and oscillate about it.
const MAX_TURN_PER_STEP: f64 = 1.0;

/// Turns the frame by all tropisms with their present elasticities.
/// `last`: the last drawn segment's frame, from which left and up follow unless `keep_roll`.
/// Source: V = sum I E [cos A T + sin A T x (H x T)/|H x T|], H turned about H x V by min(|H x V|, 1) rad; torque turns
/// U about H towards T by min(I E |U x T'|, 1).
pub(super) fn apply_tropisms(
    frame: &mut TurtleFrame,
    last: &TurtleFrame,
    tropisms: &[Tropism],
    elasticity: &[f64],
    keep_roll: bool,
) {
    // Directional tropisms act like one force at the tip, V = sum of I E D over all of them, D being the unit
    // direction that a tropism seeks. Their torque H x V turns the heading; its length is the angle, clamped.
    let mut stimulus = DVec3::ZERO;
    for (t, e) in tropisms.iter().zip(elasticity).filter(|(t, _)| !t.torque) {
        stimulus += sought_direction(frame, t) * (t.intensity * e);
    }
    let axis = frame.h.cross(stimulus);
    let strength = axis.length();
    if strength > 1e-12 {
        let angle = strength.min(MAX_TURN_PER_STEP);
        // Without `keep_roll`, left and up follow from the last segment by the rotation of least angle.
        let turned = frame.rotated(axis / strength, math::cos(angle), math::sin(angle));
        *frame = if keep_roll { turned } else { last.with_heading(turned.h) };
        frame.orthonormalize();
    }
    // Torques roll the frame about its heading, until up points along the projection of their direction.
    for (t, e) in tropisms.iter().zip(elasticity).filter(|(t, _)| t.torque) {
        // T', the direction projected onto the plane across the heading; |U x T'| is the sine of the remaining angle.
        let across = t.dir - frame.h * t.dir.dot(frame.h);
        let Some(aim) = across.try_normalize() else { continue };
        let turn = frame.u.cross(aim);
        let angle = (t.intensity * e * turn.length()).clamp(-MAX_TURN_PER_STEP, MAX_TURN_PER_STEP);
        let side = if turn.dot(frame.h) < 0.0 { -1.0 } else { 1.0 };
        *frame = frame.rotated(frame.h, math::cos(angle), side * math::sin(angle));
        frame.orthonormalize();
    }
}

/// The unit direction that a tropism seeks at this heading: on the cone of half angle `t.angle` around `t.dir`, nearest to the
/// heading.
fn sought_direction(frame: &TurtleFrame, t: &Tropism) -> DVec3 {
    let dir = t.dir.normalize_or(DVec3::Y);
    // The point of the cone in the plane of H and T: T turned towards H by the rest angle A. If H points along T, all of the cone
    // is equally near, and left decides.
    let n = frame.h.cross(dir);
    let n = if n.length_squared() > 1e-24 { n.normalize() } else { frame.l };
    dir * math::cos(t.angle) + dir.cross(n) * math::sin(t.angle)
}

/// The tropism of the command `_` (cpfg's older form), applied after a step: pitch towards `dir` by asin(e T.U), then
/// yaw by asin(e T.L).
pub(super) fn apply_tropism_after_step(frame: &mut TurtleFrame, dir: DVec3, e: f64) {
    let dir = dir.normalize_or(DVec3::Y);
    let sine = |x: f64| x.clamp(-1.0, 1.0);
    // Pitch: the sine of the turn is e T.U, and c = sqrt(1 - s^2) its cosine.
    let s = sine(e * dir.dot(frame.u));
    frame.pitch(math::sqrt(1.0 - s * s), -s);
    // Yaw likewise by e T.L, in the frame that the pitch has left.
    let s = sine(e * dir.dot(frame.l));
    frame.yaw(math::sqrt(1.0 - s * s), s);
}

#[cfg(test)]
mod tests {
    use super::*;
    use osier_base::units::radians;

    fn angle_from_y(t: Tropism) -> f64 {
        let mut f = TurtleFrame::START;
        f.yaw(math::cos(radians(60.0)), math::sin(radians(60.0)));
        apply_tropisms(&mut f, &TurtleFrame::START, &[t], &[t.elasticity], false);
        assert!((f.h.length() - 1.0).abs() < 1e-12);
        math::acos(f.h.y) * 180.0 / std::f64::consts::PI
    }

    #[test]
    fn one_step_bends_by_the_stated_angles() {
        let up = Tropism { elasticity: 0.1, ..Tropism::default() };
        assert!((angle_from_y(up) - 55.038).abs() < 5e-4, "{}", angle_from_y(up));
        let level = Tropism { dir: DVec3::NEG_Y, angle: radians(90.0), elasticity: 0.1, ..Tropism::default() };
        assert!((angle_from_y(level) - 62.865).abs() < 5e-4, "{}", angle_from_y(level));
    }

    #[test]
    fn roll_is_lost_unless_kept() {
        let t = Tropism { elasticity: 0.1, ..Tropism::default() };
        for keep in [false, true] {
            let mut f = TurtleFrame::START;
            f.yaw(0.6, 0.8);
            let before = f.u;
            f.roll(0.0, 1.0);
            apply_tropisms(&mut f, &TurtleFrame::START, &[t], &[0.1], keep);
            assert_eq!(f.u.dot(before).abs() > 0.9, !keep);
        }
    }

    #[test]
    fn torque_turns_up_towards_its_direction_and_old_tropism_lifts() {
        let t = Tropism { dir: DVec3::NEG_X, elasticity: 0.3, torque: true, ..Tropism::default() };
        let mut f = TurtleFrame::START;
        apply_tropisms(&mut f, &TurtleFrame::START, &[t], &[0.3], false);
        assert!((f.u.dot(DVec3::NEG_X) - math::sin(0.3)).abs() < 1e-12, "{:?}", f.u);
        let mut f = TurtleFrame::START;
        f.yaw(0.0, 1.0);
        apply_tropism_after_step(&mut f, DVec3::Y, 0.2);
        assert!((f.h.y - 0.2).abs() < 1e-12, "{:?}", f.h);
    }
}
