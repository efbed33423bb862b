//! The fifteen velocities of the lattice.

/// Velocities: rest, six along the axes, eight along the diagonals.
pub(super) const Q: usize = 15;

/// Velocities in cells a step, opposites side by side.
/// Source: \[catkin\] eq. 3.
/// Differs: it counts "six diagonal lines"; a cube has eight corners.
pub(super) const C: [[i32; 3]; Q] = [
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

/// Weights: rest, axes, diagonals.
pub(super) const W: [f64; 3] = [2.0 / 9.0, 1.0 / 9.0, 1.0 / 72.0];

/// Weight of a velocity.
pub(super) const fn weight(i: usize) -> f64 {
    match i {
        0 => W[0],
        1..=6 => W[1],
        _ => W[2],
    }
}

/// The velocity the other way.
pub(super) const fn opposite(i: usize) -> usize {
    match i {
        0 => 0,
        _ if i % 2 == 1 => i + 1,
        _ => i - 1,
    }
}

/// The velocity with its part along an axis turned round.
pub(super) fn mirror(i: usize, axis: usize) -> usize {
    let mut c = C[i];
    c[axis] = -c[axis];
    C.iter().position(|d| *d == c).unwrap_or(i)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn velocities_are_isotropic_to_fourth_order() {
        let sum = |f: &dyn Fn([f64; 3]) -> f64| (0..Q).map(|i| weight(i) * f(C[i].map(f64::from))).sum::<f64>();
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
    fn opposites_and_mirrors_are_what_they_say() {
        for i in 0..Q {
            assert_eq!(C[opposite(i)], C[i].map(|c| -c));
            for axis in 0..3 {
                let mut c = C[i];
                c[axis] = -c[axis];
                assert_eq!(C[mirror(i, axis)], c);
            }
        }
        let pairs = [(3, 4), (7, 11), (8, 12), (9, 14), (10, 13)];
        assert!(pairs.iter().all(|&(a, b)| mirror(a, 1) == b && mirror(b, 1) == a));
    }
}
