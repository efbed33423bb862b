//! Motion of a plant's leaves and wood in the wind without rain, at any time between the frames at which it is recorded.

use glam::{DQuat, DVec3};

use osier_base::par::par_chunks;

use super::tuning::LEAVES_PER_TASK;

/// Position and orientation of a leaf in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeafPlace {
    /// Origin of leaf space (the end of the petiole), m.
    pub position: DVec3,
    /// Rotation from leaf space to the world.
    pub orientation: DQuat,
}

/// Pose of a plant in the wind, without rain, at one frame.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct WindPose {
    /// Places of the leaves, in the order of the leaves in the rain.
    pub leaves: Vec<LeafPlace>,
    /// Positions of the plant's nodes in the world, m.
    pub nodes: Vec<DVec3>,
}

/// A source of the poses of a plant in the wind, such as its recorded sway.
pub trait WindPoses: std::fmt::Debug + Send + Sync {
    /// The pose at a frame, counted from the first of the clip, also before it and after its last frame.
    fn at_frame(&self, frame: i64) -> WindPose;
}

/// A leaf's place and its rate of change, in world space.
#[derive(Debug, Clone, Copy)]
pub(super) struct MovingPlace {
    pub place: LeafPlace,
    /// Velocity of the origin, m/s.
    pub velocity: DVec3,
    /// Angular velocity, rad/s.
    pub angular_velocity: DVec3,
}

/// Poses around the present time, between which the plant moves with continuous velocity: cubic Hermite splines whose tangents are
/// central differences of the frames (Catmull and Rom 1974).
#[derive(Debug)]
pub(super) struct WindMotion {
    source: Box<dyn WindPoses>,
    /// Frame rate of the clip, frames per second, above 0.
    fps: f64,
    /// Frame at the beginning of the present interval.
    frame: i64,
    /// Poses at the frames `frame` - 1 to `frame` + 2.
    keys: [WindPose; 4],
    /// Present fraction of the interval, 0 to 1.
    fraction: f64,
}

/// Values of the basis of a Hermite spline and their derivatives by the fraction of the interval: weights of the four keys.
struct SplineWeights {
    value: [f64; 4],
    rate: [f64; 4],
}

impl SplineWeights {
    fn at(x: f64) -> Self {
        // Catmull-Rom: p(x) = sum of w_k p_k with tangents (p_{k+1} - p_{k-1}) / 2 at the two inner keys.
        let (x2, x3) = (x * x, x * x * x);
        Self {
            value: [
                0.5 * (-x3 + 2.0 * x2 - x),
                0.5 * (3.0 * x3 - 5.0 * x2 + 2.0),
                0.5 * (-3.0 * x3 + 4.0 * x2 + x),
                0.5 * (x3 - x2),
            ],
            rate: [
                0.5 * (-3.0 * x2 + 4.0 * x - 1.0),
                0.5 * (9.0 * x2 - 10.0 * x),
                0.5 * (-9.0 * x2 + 8.0 * x + 1.0),
                0.5 * (3.0 * x2 - 2.0 * x),
            ],
        }
    }
}

impl WindMotion {
    /// The plant at time `t` of the clip, s, negative before it.
    pub fn new(source: Box<dyn WindPoses>, fps: f64, t: f64) -> Self {
        let (frame, fraction) = frame_and_fraction(t * fps);
        let before = source.at_frame(frame - 1);
        let from = aligned(source.at_frame(frame), &before);
        let to = aligned(source.at_frame(frame + 1), &from);
        let after = aligned(source.at_frame(frame + 2), &to);
        Self { source, fps, frame, keys: [before, from, to, after], fraction }
    }

    /// Moves to time `t` of the clip, s, which must not be before the present time.
    pub fn advance_to(&mut self, t: f64) {
        let (wanted, fraction) = frame_and_fraction(t * self.fps);
        while self.frame < wanted {
            self.frame += 1;
            self.keys.rotate_left(1);
            self.keys[3] = aligned(self.source.at_frame(self.frame + 2), &self.keys[2]);
        }
        self.fraction = fraction;
    }

    /// Places and velocities of all leaves at the present time, in their order.
    pub fn leaves(&self) -> Vec<MovingPlace> {
        let weights = SplineWeights::at(self.fraction);
        let rate = self.fps;
        let [before, from, to, after] = &self.keys;
        let place = |k: usize| {
            let keys = [before.leaves[k], from.leaves[k], to.leaves[k], after.leaves[k]];
            let blend = |weights: [f64; 4]| {
                let mut sum = (DVec3::ZERO, [0.0; 4]);
                for (key, w) in keys.iter().zip(weights) {
                    sum.0 += key.position * w;
                    let q = key.orientation.to_array();
                    (0..4).for_each(|i| sum.1[i] += q[i] * w);
                }
                sum
            };
            let ((position, q), (velocity, dq)) = (blend(weights.value), blend(weights.rate));
            let (q, dq) = (DQuat::from_array(q), DQuat::from_array(dq));
            let length = q.length();
            let orientation = q / length;
            // Angular velocity of a rotation q / |q|: twice the vector part of q' q*; the change of length is along the real part.
            let angular_velocity = ((dq / length) * orientation.conjugate()).xyz() * (2.0 * rate);
            MovingPlace { place: LeafPlace { position, orientation }, velocity: velocity * rate, angular_velocity }
        };
        let indices: Vec<usize> = (0..from.leaves.len()).collect();
        par_chunks(&indices, LEAVES_PER_TASK, |_, part| part.iter().map(|k| place(*k)).collect::<Vec<_>>()).concat()
    }

    /// Position of node `k` in the world, m, and its velocity, m/s; wood moves in straight lines between frames.
    pub fn node(&self, k: usize) -> [DVec3; 2] {
        let (from, to) = (self.keys[1].nodes[k], self.keys[2].nodes[k]);
        [from.lerp(to, self.fraction), (to - from) * self.fps]
    }
}

/// The frame before a time, in frames, and the fraction of the interval that has passed.
#[allow(clippy::cast_possible_truncation, reason = "frames of a clip")]
fn frame_and_fraction(frames: f64) -> (i64, f64) {
    (frames.floor() as i64, frames - frames.floor())
}

/// The pose with the sign of each quaternion chosen so that it is nearest to that of the pose before: components can then be
/// interpolated.
fn aligned(mut pose: WindPose, before: &WindPose) -> WindPose {
    for (leaf, last) in pose.leaves.iter_mut().zip(&before.leaves) {
        if leaf.orientation.dot(last.orientation) < 0.0 {
            leaf.orientation = -leaf.orientation;
        }
    }
    pose
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A leaf that moves on a circle of radius 0.1 m and rotates with it.
    #[derive(Debug)]
    struct Circle;

    impl WindPoses for Circle {
        fn at_frame(&self, frame: i64) -> WindPose {
            let turn = DQuat::from_rotation_y(0.3 * frame as f64);
            WindPose {
                leaves: vec![LeafPlace { position: turn * DVec3::X * 0.1, orientation: turn }],
                nodes: vec![turn * DVec3::X],
            }
        }
    }

    #[test]
    fn velocities_are_the_rates_of_positions_and_orientations() {
        let mut motion = WindMotion::new(Box::new(Circle), 24.0, -0.2);
        let h = 1e-4;
        let mut last: Option<MovingPlace> = None;
        for k in 0..5000 {
            motion.advance_to(f64::from(k) * h - 0.2);
            let now = motion.leaves()[0];
            if let Some(last) = last {
                let v = (now.place.position - last.place.position) / h;
                assert!(v.distance(0.5 * (now.velocity + last.velocity)) < 1e-3, "{k}: {v} {}", now.velocity);
                let turned = now.place.orientation * last.place.orientation.conjugate();
                let spin = turned.xyz() * (2.0 * turned.w.signum() / h);
                assert!(spin.distance(now.angular_velocity) < 0.02, "{k}: {spin} {}", now.angular_velocity);
                assert!(now.velocity.distance(last.velocity) < 0.02, "{k}: no jump at frames");
            }
            last = Some(now);
        }
        let speed = 0.3 * 24.0;
        let spin = last.expect("some").angular_velocity;
        assert!((spin.y / speed - 1.0).abs() < 0.02, "{spin}");
    }

    #[test]
    fn places_at_frames_are_those_of_the_record_before_and_in_the_clip() {
        for (start, t) in [(-3.0, -3.0), (-3.0, -1.5), (-3.0, 2.0), (0.0, 0.0)] {
            let mut motion = WindMotion::new(Box::new(Circle), 24.0, start);
            motion.advance_to(t);
            let turn = DQuat::from_rotation_y(0.3 * t * 24.0);
            assert!(motion.leaves()[0].place.position.distance(turn * DVec3::X * 0.1) < 1e-12, "{start} {t}");
        }
    }
}
