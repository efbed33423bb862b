//! Animation keys of one property: quaternions without sign changes, and the reduction of keys that interpolation restores.

use glam::{Quat, Vec3};

use super::rig::rotation_angle;

/// Largest error of omitted keys, m and rad: below what is visible, above the rounding of f32. Larger values make files of the
/// `web` profile smaller and motion less exact.
pub(super) const KEY_TOLERANCE: f32 = 1e-5;
/// Most frames between two kept keys. It bounds the search, whose work is quadratic in the gap.
const MAX_GAP: usize = 256;

/// Values of an animated property at the frames of a clip.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum KeyedValues<T> {
    /// The value is the same at all frames.
    Constant(T),
    /// Keys: increasing indices of frames, with the first and the last one of the clip, and their values.
    Keys(Vec<usize>, Vec<T>),
}

/// Reduces keys of positions or scales. `drop_keys`: omit those that LINEAR interpolation restores within
/// [`KEY_TOLERANCE`].
pub(super) fn reduce_positions(times: &[f32], values: &[Vec3], drop_keys: bool) -> KeyedValues<Vec3> {
    let near = |a: &Vec3, b: &Vec3| (*a - *b).length() <= KEY_TOLERANCE;
    let between = |a: &Vec3, b: &Vec3, t: f32| *a + (*b - *a) * t;
    reduce_keys(times, values, drop_keys, near, between)
}

/// Reduces keys of rotations to unit quaternions without sign changes.
pub(super) fn reduce_rotations(times: &[f32], values: &[Quat], drop_keys: bool) -> KeyedValues<Quat> {
    // The error of a rotation is the angle of a^-1 b, rad, the same for q and -q.
    let near = |a: &Quat, b: &Quat| rotation_angle(*a, *b) <= KEY_TOLERANCE;
    let between = |a: &Quat, b: &Quat, t: f32| slerp(*a, *b, t);
    reduce_keys(times, &continuous_quaternions(values), drop_keys, near, between)
}

/// Unit quaternions with signs chosen so that w >= 0 in the first, and the dot product of neighbours is not negative: LINEAR
/// interpolation then takes the short way.
fn continuous_quaternions(values: &[Quat]) -> Vec<Quat> {
    let mut last = Quat::IDENTITY;
    let step = |q: &Quat| {
        // The result is the reference of the next frame, so that the choice of sign runs along the clip.
        let q = renormalized(*q);
        last = if q.dot(last) < 0.0 { -q } else { q };
        last
    };
    values.iter().map(step).collect()
}

/// The quaternion at unit length; unchanged if its squared length is within 1e-6 of 1.
pub(super) fn renormalized(q: Quat) -> Quat {
    // Dividing by a length of 1 +- 1 ulp would change the last bits of a quaternion that is good already.
    if (q.length_squared() - 1.0).abs() <= 1e-6 { q } else { q.normalize() }
}

/// Spherical linear interpolation of unit quaternions whose dot product is not negative: LINEAR for rotations
/// (glTF 2.0, appendix C.4). Below an angle of 1e-4 rad the normalised chord is as exact, and sin in the denominator is not.
fn slerp(a: Quat, b: Quat, t: f32) -> Quat {
    // Between quaternions the angle is half that of the rotations: slerp = (sin((1 - t) h) a + sin(t h) b) / sin h.
    let half_angle = rotation_angle(a, b) * 0.5;
    if half_angle < 1e-4 {
        return osier_base::math::nlerp(a, b, t);
    }
    let s = osier_base::math::sin_f32(half_angle);
    let (u, v) = (osier_base::math::sin_f32(half_angle * (1.0 - t)) / s, osier_base::math::sin_f32(half_angle * t) / s);
    Quat::from_vec4(glam::Vec4::from(a) * u + glam::Vec4::from(b) * v)
}

/// Greedy reduction: from each kept key, skips as many frames as interpolation restores within the tolerance.
fn reduce_keys<T: Copy + PartialEq>(
    times: &[f32],
    values: &[T],
    drop_keys: bool,
    near: impl Fn(&T, &T) -> bool,
    between: impl Fn(&T, &T, f32) -> T,
) -> KeyedValues<T> {
    let Some(first) = values.first() else { return KeyedValues::Keys(Vec::new(), Vec::new()) };
    // Test equality first: values with the same bits are constant whatever the profile.
    if values.iter().all(|v| v == first || (drop_keys && near(v, first))) {
        return KeyedValues::Constant(*first);
    }
    if !drop_keys {
        return KeyedValues::Keys((0..values.len()).collect(), values.to_vec());
    }
    let restored = |a: usize, b: usize| {
        (a + 1..b).all(|i| {
            // The interpolation parameter is computed in f32 from the stored key times, as a reader computes it, not from frame
            // numbers.
            let t = (times[i] - times[a]) / (times[b] - times[a]);
            near(&between(&values[a], &values[b], t), &values[i])
        })
    };
    // From the kept key a, move b on while interpolation from a to b + 1 still restores all frames between them.
    let mut kept = vec![0];
    let mut a = 0;
    while a + 1 < values.len() {
        let mut b = a + 1;
        // Each step tests all frames of the gap again, as the chord from a to b + 1 differs from that from a to b.
        while b + 1 < values.len() && b + 1 - a <= MAX_GAP && restored(a, b + 1) {
            b += 1;
        }
        kept.push(b);
        a = b;
    }
    let values = kept.iter().map(|&i| values[i]).collect();
    KeyedValues::Keys(kept, values)
}

/// Keys of the scale of an instance, for STEP interpolation: `scale` while it is alive, 0 otherwise, as glTF cannot animate
/// visibility. Keys are at the changes and at both ends of the clip.
pub(super) fn visibility_scales(alive: &[bool], scale: Vec3) -> KeyedValues<Vec3> {
    let shown = |a: bool| if a { scale } else { Vec3::ZERO };
    let Some(first) = alive.first() else { return KeyedValues::Constant(scale) };
    if alive.iter().all(|a| a == first) {
        return KeyedValues::Constant(shown(*first));
    }
    let end = alive.len() - 1;
    // STEP holds a value until the next key, so a key at each change is exact; one at the end keeps the clip's length.
    let kept: Vec<usize> = (0..alive.len()).filter(|&i| i == 0 || i == end || alive[i] != alive[i - 1]).collect();
    let values = kept.iter().map(|&i| shown(alive[i])).collect();
    KeyedValues::Keys(kept, values)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_straight_move_keeps_its_ends_and_a_rest_has_no_keys() {
        let times: Vec<f32> = (0..9).map(|i| i as f32 / 24.0).collect();
        let line: Vec<Vec3> = times.iter().map(|t| Vec3::new(*t, 1.0, -2.0 * t)).collect();
        assert!(matches!(reduce_positions(&times, &line, true), KeyedValues::Keys(k, _) if k == [0, 8]));
        assert!(matches!(reduce_positions(&times, &line, false), KeyedValues::Keys(k, _) if k.len() == 9));
        assert_eq!(reduce_positions(&times, &[Vec3::Y; 9], false), KeyedValues::Constant(Vec3::Y));
    }

    #[test]
    fn appearances_have_keys_at_changes_and_ends() {
        let keys = visibility_scales(&[false, false, true, true, false, false], Vec3::ONE);
        assert_eq!(keys, KeyedValues::Keys(vec![0, 2, 4, 5], vec![Vec3::ZERO, Vec3::ONE, Vec3::ZERO, Vec3::ZERO]));
    }

    #[test]
    fn rotations_take_the_short_way() {
        let q = Quat::from_rotation_y(0.3);
        let KeyedValues::Keys(_, v) =
            reduce_rotations(&[0.0, 1.0, 2.0], &[-q, Quat::from_rotation_y(0.4), -Quat::from_rotation_y(0.5)], false)
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
            if let KeyedValues::Keys(kept, values) = reduce_rotations(&times, &turns, true) {
                for w in kept.windows(2).zip(values.windows(2)) {
                    let ([a, b], [va, vb]) = w else { continue };
                    for i in *a..=*b {
                        let t = (times[i] - times[*a]) / (times[*b] - times[*a]);
                        prop_assert!(rotation_angle(slerp(*va, *vb, t), turns[i]) <= KEY_TOLERANCE * 1.5);
                    }
                }
                prop_assert_eq!((kept[0], kept[kept.len() - 1]), (0, steps.len() - 1));
            }
        }
    }
}
