//! Keys of one animated quantity: continuous quaternions, and keys left out where the rest restores them.

use glam::{Quat, Vec3};

use super::rig::angle;

/// Largest error of left-out keys, m and rad.
pub(super) const TOLERANCE: f32 = 1e-5;
/// Longest run of keys left out: bounds the work of finding it.
const LONGEST: usize = 256;

/// A quantity over the clip.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Keys<T> {
    /// The same all the time.
    Constant(T),
    /// Values at indices of the clip's frames, rising, first and last included.
    At(Vec<usize>, Vec<T>),
}

/// Keys of positions. `thin`: leave out what LINEAR restores within [`TOLERANCE`].
pub(super) fn positions(times: &[f32], values: &[Vec3], thin: bool) -> Keys<Vec3> {
    let near = |a: &Vec3, b: &Vec3| (*a - *b).length() <= TOLERANCE;
    let between = |a: &Vec3, b: &Vec3, t: f32| *a + (*b - *a) * t;
    reduce(times, values, thin, near, between)
}

/// Keys of rotations: unit, first w >= 0, each on the side of the one before.
pub(super) fn rotations(times: &[f32], values: &[Quat], thin: bool) -> Keys<Quat> {
    let near = |a: &Quat, b: &Quat| angle(*a, *b) <= TOLERANCE;
    let between = |a: &Quat, b: &Quat, t: f32| slerp(*a, *b, t);
    reduce(times, &continuous(values), thin, near, between)
}

/// Unit quaternions of which each lies on the side of its predecessor and the first has w >= 0.
fn continuous(values: &[Quat]) -> Vec<Quat> {
    let mut last = Quat::IDENTITY;
    let step = |q: &Quat| {
        let q = unit(*q);
        last = if q.dot(last) < 0.0 { -q } else { q };
        last
    };
    values.iter().map(step).collect()
}

/// The quaternion at length 1; as it is if it already is within 1e-6.
pub(super) fn unit(q: Quat) -> Quat {
    if (q.length_squared() - 1.0).abs() <= 1e-6 { q } else { q.normalize() }
}

/// Spherical blend of unit quaternions on one side, as viewers play LINEAR rotations.
fn slerp(a: Quat, b: Quat, t: f32) -> Quat {
    let whole = angle(a, b) * 0.5;
    if whole < 1e-4 {
        return osier_base::math::nlerp(a, b, t);
    }
    let s = osier_base::math::sin_f32(whole);
    let (u, v) = (osier_base::math::sin_f32(whole * (1.0 - t)) / s, osier_base::math::sin_f32(whole * t) / s);
    Quat::from_vec4(glam::Vec4::from(a) * u + glam::Vec4::from(b) * v)
}

fn reduce<T: Copy + PartialEq>(
    times: &[f32],
    values: &[T],
    thin: bool,
    near: impl Fn(&T, &T) -> bool,
    between: impl Fn(&T, &T, f32) -> T,
) -> Keys<T> {
    let Some(first) = values.first() else { return Keys::At(Vec::new(), Vec::new()) };
    if values.iter().all(|v| v == first || (thin && near(v, first))) {
        return Keys::Constant(*first);
    }
    if !thin {
        return Keys::At((0..values.len()).collect(), values.to_vec());
    }
    let restored = |a: usize, b: usize| {
        (a + 1..b).all(|i| {
            let t = (times[i] - times[a]) / (times[b] - times[a]);
            near(&between(&values[a], &values[b], t), &values[i])
        })
    };
    let mut kept = vec![0];
    let mut a = 0;
    while a + 1 < values.len() {
        let mut b = a + 1;
        while b + 1 < values.len() && b + 1 - a <= LONGEST && restored(a, b + 1) {
            b += 1;
        }
        kept.push(b);
        a = b;
    }
    let values = kept.iter().map(|&i| values[i]).collect();
    Keys::At(kept, values)
}

/// Keys of a scale that is `scale` while alive and 0 otherwise, for STEP: at changes and at both ends of the clip.
pub(super) fn appearances(alive: &[bool], scale: Vec3) -> Keys<Vec3> {
    let shown = |a: bool| if a { scale } else { Vec3::ZERO };
    let Some(first) = alive.first() else { return Keys::Constant(scale) };
    if alive.iter().all(|a| a == first) {
        return Keys::Constant(shown(*first));
    }
    let end = alive.len() - 1;
    let kept: Vec<usize> = (0..alive.len()).filter(|&i| i == 0 || i == end || alive[i] != alive[i - 1]).collect();
    let values = kept.iter().map(|&i| shown(alive[i])).collect();
    Keys::At(kept, values)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_straight_move_keeps_its_ends_and_a_rest_has_no_keys() {
        let times: Vec<f32> = (0..9).map(|i| i as f32 / 24.0).collect();
        let line: Vec<Vec3> = times.iter().map(|t| Vec3::new(*t, 1.0, -2.0 * t)).collect();
        assert!(matches!(positions(&times, &line, true), Keys::At(k, _) if k == [0, 8]));
        assert!(matches!(positions(&times, &line, false), Keys::At(k, _) if k.len() == 9));
        assert_eq!(positions(&times, &[Vec3::Y; 9], false), Keys::Constant(Vec3::Y));
    }

    #[test]
    fn appearances_have_keys_at_changes_and_ends() {
        let keys = appearances(&[false, false, true, true, false, false], Vec3::ONE);
        assert_eq!(keys, Keys::At(vec![0, 2, 4, 5], vec![Vec3::ZERO, Vec3::ONE, Vec3::ZERO, Vec3::ZERO]));
    }

    #[test]
    fn rotations_take_the_short_way() {
        let q = Quat::from_rotation_y(0.3);
        let Keys::At(_, v) =
            rotations(&[0.0, 1.0, 2.0], &[-q, Quat::from_rotation_y(0.4), -Quat::from_rotation_y(0.5)], false)
        else {
            panic!("moves")
        };
        assert!(v[0].w > 0.0 && v.windows(2).all(|p| p[0].dot(p[1]) > 0.0));
    }

    proptest! {
        #[test]
        fn left_out_keys_come_back_within_the_tolerance(steps in proptest::collection::vec((-1.0_f32..1.0, 0.0_f32..0.2), 2..60)) {
            let times: Vec<f32> = (0..steps.len()).map(|i| i as f32 / 24.0).collect();
            let mut turn = 0.0;
            let turns: Vec<Quat> = steps.iter().map(|(s, d)| {
                if *s > 0.3 { turn += d; }
                Quat::from_rotation_z(turn)
            }).collect();
            if let Keys::At(kept, values) = rotations(&times, &turns, true) {
                for w in kept.windows(2).zip(values.windows(2)) {
                    let ([a, b], [va, vb]) = w else { continue };
                    for i in *a..=*b {
                        let t = (times[i] - times[*a]) / (times[*b] - times[*a]);
                        prop_assert!(angle(slerp(*va, *vb, t), turns[i]) <= TOLERANCE * 1.5);
                    }
                }
                prop_assert_eq!((kept[0], kept[kept.len() - 1]), (0, steps.len() - 1));
            }
        }
    }
}
