//! Flutter of leaves: oscillation about the stalk, alignment with the flow, and lag behind the twig.

use crate::sway::tuning::{
    FLOW_ALIGNMENT, FLUTTER_SPEED, LAG_TIME, MAX_LAG, MAX_NOD, MAX_TWIST, MAX_YAW, TWIST_PER_NOD,
};
use glam::{Quat, Vec3};

use osier_base::math;
use osier_base::rng;
use osier_scene::plant::Organ;
use osier_wind::TimeNoise;

/// Wind and twig motion at a leaf, in the plant's space.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct LeafAir {
    /// Wind velocity at the leaf, m/s.
    pub wind: Vec3,
    /// Angular velocity of its twig, rad/s.
    pub spin: Vec3,
}

/// Flutter of a group of leaves: noise by which each blade nods, twists and yaws in the wind.
#[derive(Debug, Clone)]
pub struct LeafFlutter {
    /// Noise of each leaf, at a frequency that differs from leaf to leaf.
    leaves: Vec<TimeNoise>,
    strength: f32,
    /// Whether the equation is evaluated as printed: amplitude independent of the wind, noise in [0, 1], neither alignment
    /// nor lag.
    printed: bool,
}

impl LeafFlutter {
    /// `speed`: mean wind at the crown, m/s; `period`: period of the wind, s; `strength`: factor on the angles, 1 for round
    /// stalks, 2 to 3 for the flat ones of poplars.
    pub fn new(organs: &[&Organ], speed: f32, period: Option<f64>, strength: f32) -> Self {
        let hertz = 2.0 + 6.0 * (1.0 - math::exp(-f64::from(speed) / 8.0));
        let leaf = |o: &&Organ| {
            let mut draw = rng::Rng::from_key(rng::child(o.id, rng::word("flutter")));
            let wanted = hertz * draw.range(0.8, 1.2);
            #[allow(clippy::cast_possible_truncation, reason = "half of a hash is a hash")]
            let seed = (draw.next_u64() >> 32) as u32;
            TimeNoise::new(seed, wanted, period)
        };
        Self { leaves: organs.iter().map(leaf).collect(), strength, printed: false }
    }

    /// Evaluates the equation of [zhao-zhang] 3.3 as printed from now on, for comparison.
    #[must_use]
    pub fn as_printed(self) -> Self {
        Self { printed: true, ..self }
    }

    /// Orientation of leaf `i`, whose rest orientation is `q`, at time `seconds` in the air around it.
    /// Source: [zhao-zhang] 3.3, with noise of either sign and an amplitude that grows with the wind.
    pub fn orientation(&self, i: usize, q: Quat, seconds: f64, air: LeafAir) -> Quat {
        let Some(leaf) = self.leaves.get(i) else { return q };
        if self.printed {
            return self.printed_orientation(*leaf, q, seconds);
        }
        // The amplitude saturates with the wind speed.
        let speed = air.wind.length();
        let amplitude = self.strength * (1.0 - math::exp_f32(-speed / FLUTTER_SPEED));
        let flutter = flutter_angles(amplitude, |k| leaf.with_seed_offset(k).at(seconds));
        // Alignment acts in the plant's space, flutter in the leaf's, and the lag turns against the twig's rotation.
        let q = align_with_flow(q, air.wind, speed) * rotation_from_vector(flutter);
        rotation_from_vector((air.spin * -LAG_TIME).clamp_length_max(MAX_LAG)) * q
    }

    /// Reference implementation of [zhao-zhang] 3.3 as printed: noise in [0, 1] and an amplitude independent of the wind.
    fn printed_orientation(&self, leaf: TimeNoise, q: Quat, seconds: f64) -> Quat {
        let noise = |k: u32| 0.5 + 0.5 * leaf.with_seed_offset(k).at(seconds);
        q * rotation_from_vector(flutter_angles(self.strength, noise))
    }
}

/// Rotation vector of a leaf's flutter in leaf space, rad: nod, twist and yaw. `noise`: noise of the nod, 0, the twist, 1, and the yaw, 2.
fn flutter_angles(amplitude: f32, noise: impl Fn(u32) -> f32) -> Vec3 {
    let nod = MAX_NOD * amplitude * noise(0);
    Vec3::new(nod, MAX_TWIST * amplitude * noise(1) + TWIST_PER_NOD * nod, MAX_YAW * amplitude * noise(2))
}

/// Rotates the blade's tip towards the flow by at most an angle that grows with the dynamic pressure and saturates.
fn align_with_flow(q: Quat, air: Vec3, speed: f32) -> Quat {
    let tip = q * Vec3::Y;
    let axis = tip.cross(air);
    let (sin, cos) = (axis.length(), tip.dot(air));
    if sin < 1e-6 {
        return q;
    }
    // Angle between tip and flow, and the largest angle by which the wind can turn the leaf.
    let apart = math::narrow(math::atan2(f64::from(sin), f64::from(cos)));
    let share = FLOW_ALIGNMENT * math::atan_f32(speed * speed / (FLUTTER_SPEED * FLUTTER_SPEED));
    rotation_from_vector(axis / sin * apart.min(share)) * q
}

fn rotation_from_vector(v: Vec3) -> Quat {
    let angle = v.length();
    if angle < 1e-9 {
        return Quat::IDENTITY;
    }
    let v = v * (math::sin_f32(angle * 0.5) / angle);
    Quat::from_xyzw(v.x, v.y, v.z, math::cos_f32(angle * 0.5))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sway::testing::leafy;

    #[test]
    fn leaves_flutter_independently_and_periodically() {
        let plant = leafy(5);
        let organs: Vec<&Organ> = plant.organs.iter().collect();
        let flutter = LeafFlutter::new(&organs, 5.0, Some(4.0), 1.0);
        let air = LeafAir { wind: Vec3::X * 5.0, spin: Vec3::ZERO };
        let at = |t: f64| -> Vec<Quat> {
            (0..organs.len()).map(|i| flutter.orientation(i, Quat::IDENTITY, t, air)).collect()
        };
        let (a, b, c) = (at(0.3), at(4.3), at(0.4));
        assert!(a.iter().zip(&b).all(|(x, y)| x.dot(*y).abs() > 1.0 - 1e-5), "repeats");
        assert!(a.iter().zip(&c).all(|(x, y)| x.dot(*y).abs() < 1.0 - 1e-9), "moves");
        let up = a.iter().filter(|q| q.x > 0.0).count();
        assert!((20..80).contains(&up), "{up} of 100 nod the same way");
    }

    #[test]
    fn leaves_rest_in_calm_air_and_turn_downwind_in_storms() {
        let plant = leafy(5);
        let organs: Vec<&Organ> = plant.organs.iter().collect();
        let flutter = LeafFlutter::new(&organs, 5.0, None, 1.0);
        let grown = Quat::from_rotation_x(0.7);
        assert_eq!(flutter.orientation(3, grown, 2.0, LeafAir::default()), grown);
        assert_ne!(
            flutter.clone().as_printed().orientation(3, grown, 2.0, LeafAir::default()),
            grown,
            "printed, they always do"
        );
        let lean = |speed: f32| {
            let flow = LeafAir { wind: Vec3::X * speed, spin: Vec3::ZERO };
            (0..100).map(|i| (flutter.orientation(i, grown, 2.0, flow) * Vec3::Y).x).sum::<f32>() / 100.0
        };
        assert!(lean(2.0) < lean(6.0) && lean(6.0) < lean(20.0) && lean(20.0) > 0.6, "{}", lean(20.0));
        let lagging = flutter.orientation(3, grown, 2.0, LeafAir { wind: Vec3::ZERO, spin: Vec3::Z * 100.0 });
        assert!((grown.angle_between(lagging) - MAX_LAG).abs() < 1e-3);
    }
}
