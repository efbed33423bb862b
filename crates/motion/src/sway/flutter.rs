//! Leaves in the wind: they flutter about their stalks, turn with the flow and lag behind their twigs.

use glam::{Quat, Vec3};

use osier_base::math;
use osier_base::rng;
use osier_scene::plant::Organ;
use osier_wind::TimeNoise;

/// Largest turns, rad: about the width of the blade, about its normal, about its midrib.
/// [zhao-zhang] 3.3 leaves them open; these are a beech's.
const MAX_NOD: f32 = 0.611;
const MAX_YAW: f32 = 0.436;
const MAX_TWIST: f32 = 0.785;
/// Twist that a nod brings with it: the printed lambda.
const TWIST_PER_NOD: f32 = 0.4;
/// Wind in which a leaf flutters with about two thirds of its strength, m/s.
const FLUTTER_SPEED: f32 = 4.0;
/// Share of the way into the flow that a leaf turns in a storm.
const FLOW_ALIGNMENT: f32 = 0.6;
/// How far a leaf lags behind its twig, s and rad.
const LAG_TIME: f32 = 0.06;
const MAX_LAG: f32 = 0.349;

/// What moves a leaf, in the plant's space.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct LeafAir {
    /// Wind at the leaf, m/s.
    pub wind: Vec3,
    /// Turning of its twig, rad/s.
    pub spin: Vec3,
}

/// How the leaves of one kind move.
#[derive(Debug, Clone)]
pub struct LeafFlutter {
    /// Each leaf's own time.
    leaves: Vec<TimeNoise>,
    strength: f32,
    /// As printed: as much in a calm as in a storm, noise in [0, 1], neither flow nor lag.
    printed: bool,
}

impl LeafFlutter {
    /// `speed`: mean wind at the crown, m/s; `period`: of the wind, s; `strength`: factor on the turns: 1 for a round
    /// stalk, 2 to 3 for the flat ones of poplars.
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

    /// The same by the formula as it is printed.
    #[must_use]
    pub fn as_printed(self) -> Self {
        Self { printed: true, ..self }
    }

    /// Turns leaf `i`, which sits on its twig as `q`, as the air around it has it.
    /// Source: [zhao-zhang] 3.3, with noise that goes both ways and an amplitude that grows with the wind.
    pub fn turned(&self, i: usize, q: Quat, seconds: f64, air: LeafAir) -> Quat {
        let Some(leaf) = self.leaves.get(i) else { return q };
        let speed = air.wind.length();
        let lively = self.strength * if self.printed { 1.0 } else { 1.0 - math::exp_f32(-speed / FLUTTER_SPEED) };
        let noise = |k: u32| {
            let n = leaf.with_seed_offset(k).at(seconds);
            if self.printed { 0.5 + 0.5 * n } else { n }
        };
        let nod = MAX_NOD * lively * noise(0);
        let turn = Vec3::new(nod, MAX_TWIST * lively * noise(1) + TWIST_PER_NOD * nod, MAX_YAW * lively * noise(2));
        if self.printed {
            return q * turned(turn);
        }
        let q = into_flow(q, air.wind, speed) * turned(turn);
        turned((air.spin * -LAG_TIME).clamp_length_max(MAX_LAG)) * q
    }
}

/// The blade's tip turned towards where the air goes.
fn into_flow(q: Quat, air: Vec3, speed: f32) -> Quat {
    let tip = q * Vec3::Y;
    let axis = tip.cross(air);
    let (sin, cos) = (axis.length(), tip.dot(air));
    if sin < 1e-6 {
        return q;
    }
    let apart = math::narrow(math::atan2(f64::from(sin), f64::from(cos)));
    let share = FLOW_ALIGNMENT * math::atan_f32(speed * speed / (FLUTTER_SPEED * FLUTTER_SPEED));
    turned(axis / sin * apart.min(share)) * q
}

/// The turn about a vector by its length, rad.
fn turned(v: Vec3) -> Quat {
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
    fn leaves_flutter_each_in_their_own_time_and_repeat() {
        let plant = leafy(5);
        let organs: Vec<&Organ> = plant.organs.iter().collect();
        let flutter = LeafFlutter::new(&organs, 5.0, Some(4.0), 1.0);
        let air = LeafAir { wind: Vec3::X * 5.0, spin: Vec3::ZERO };
        let at =
            |t: f64| -> Vec<Quat> { (0..organs.len()).map(|i| flutter.turned(i, Quat::IDENTITY, t, air)).collect() };
        let (a, b, c) = (at(0.3), at(4.3), at(0.4));
        assert!(a.iter().zip(&b).all(|(x, y)| x.dot(*y).abs() > 1.0 - 1e-5), "repeats");
        assert!(a.iter().zip(&c).all(|(x, y)| x.dot(*y).abs() < 1.0 - 1e-9), "moves");
        let up = a.iter().filter(|q| q.x > 0.0).count();
        assert!((20..80).contains(&up), "{up} of 100 nod the same way");
    }

    #[test]
    fn calm_air_leaves_them_as_they_grew_and_storms_turn_them_downwind() {
        let plant = leafy(5);
        let organs: Vec<&Organ> = plant.organs.iter().collect();
        let flutter = LeafFlutter::new(&organs, 5.0, None, 1.0);
        let grown = Quat::from_rotation_x(0.7);
        assert_eq!(flutter.turned(3, grown, 2.0, LeafAir::default()), grown);
        assert_ne!(
            flutter.clone().as_printed().turned(3, grown, 2.0, LeafAir::default()),
            grown,
            "printed, they always do"
        );
        let lean = |speed: f32| {
            let flow = LeafAir { wind: Vec3::X * speed, spin: Vec3::ZERO };
            (0..100).map(|i| (flutter.turned(i, grown, 2.0, flow) * Vec3::Y).x).sum::<f32>() / 100.0
        };
        assert!(lean(2.0) < lean(6.0) && lean(6.0) < lean(20.0) && lean(20.0) > 0.6, "{}", lean(20.0));
        let lagging = flutter.turned(3, grown, 2.0, LeafAir { wind: Vec3::ZERO, spin: Vec3::Z * 100.0 });
        assert!((grown.angle_between(lagging) - MAX_LAG).abs() < 1e-3);
    }
}
