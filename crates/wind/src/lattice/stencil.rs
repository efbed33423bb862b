//! The D3Q15 stencil: fifteen discrete velocities and their weights.

/// Number of discrete velocities: rest, six along the axes, eight along the space diagonals.
pub(super) const Q: usize = 15;

/// Discrete velocities c_i, cells per step; opposite directions are adjacent.
/// Source: \[catkin\] eq. 3.
/// Differs: it counts "six diagonal lines"; a cube has eight corners.
pub(super) const VELOCITIES: [[i32; 3]; Q] = [
    [0, 0, 0],
    [1, 0, 0],
    [-1, 0, 0],
    [0, 1, 0],
    [0, -1, 0],
    [0, 0, 1],
    [0, 0, -1],
    [1, 1, 1],
    [-1, -1, -1],
    [1, 1, -1],
    [-1, -1, 1],
    [1, -1, 1],
    [-1, 1, -1],
    [-1, 1, 1],
    [1, -1, -1],
];

/// Weights w_i of rest, axes and diagonals.
pub(super) const WEIGHTS: [f64; 3] = [2.0 / 9.0, 1.0 / 9.0, 1.0 / 72.0];

/// Weight of direction `i`: its share of the density at rest.
pub(super) const fn weight(i: usize) -> f64 {
    match i {
        0 => WEIGHTS[0],
        1..=6 => WEIGHTS[1],
        _ => WEIGHTS[2],
    }
}

/// Direction with the opposite velocity, to which bounce-back reverses a population; 0, at rest, stays 0.
pub(super) const fn opposite(i: usize) -> usize {
    match i {
        0 => 0,
        _ if i % 2 == 1 => i + 1,
        _ => i - 1,
    }
}

/// Direction `i` with its component along an axis reversed, as by specular reflection.
pub(super) fn reflected_direction(i: usize, axis: usize) -> usize {
    let mut c = VELOCITIES[i];
    c[axis] = -c[axis];
    // Every reflection of a D3Q15 velocity is one of the fifteen, so that the search always succeeds.
    VELOCITIES.iter().position(|d| *d == c).unwrap_or(i)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn velocities_are_isotropic_to_fourth_order() {
        let sum =
            |f: &dyn Fn([f64; 3]) -> f64| (0..Q).map(|i| weight(i) * f(VELOCITIES[i].map(f64::from))).sum::<f64>();
        assert!((sum(&|_| 1.0) - 1.0).abs() < 1e-15);
        for a in 0..3 {
            assert!(sum(&|c| c[a]).abs() < 1e-15);
            for b in 0..3 {
                let delta = |p: usize, q: usize| f64::from(u8::from(p == q));
                assert!((sum(&|c| c[a] * c[b]) - delta(a, b) / 3.0).abs() < 1e-15);
                for (k, l) in [(0, 0), (0, 1), (1, 1), (1, 2), (2, 2), (0, 2)] {
                    let wanted = delta(a, b) * delta(k, l) + delta(a, k) * delta(b, l) + delta(a, l) * delta(b, k);
                    assert!((sum(&|c| c[a] * c[b] * c[k] * c[l]) - wanted / 9.0).abs() < 1e-15);
                }
            }
        }
    }

    #[test]
    fn opposite_and_reflected_directions_match_the_velocities() {
        for i in 0..Q {
            assert_eq!(VELOCITIES[opposite(i)], VELOCITIES[i].map(|c| -c));
            for axis in 0..3 {
                let mut c = VELOCITIES[i];
                c[axis] = -c[axis];
                assert_eq!(VELOCITIES[reflected_direction(i, axis)], c);
            }
        }
        let pairs = [(3, 4), (7, 11), (8, 12), (9, 14), (10, 13)];
        assert!(pairs.iter().all(|&(a, b)| reflected_direction(a, 1) == b && reflected_direction(b, 1) == a));
    }
}
