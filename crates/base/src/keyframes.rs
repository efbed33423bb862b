//! Values keyed by time or another coordinate, linear between the keys and constant outside of them.

/// Keys in ascending order of their coordinate, each with `N` values.
///
/// # Examples
/// ```
/// use osier_base::keyframes::Keyframes;
///
/// let speed = Keyframes(vec![(0.0, [2.0]), (4.0, [6.0])]);
/// assert_eq!(speed.at(1.0), Some([3.0]));
/// assert_eq!(speed.at(9.0), Some([6.0]));
/// assert_eq!(Keyframes::<1>::default().at(0.0), None);
/// ```
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Keyframes<const N: usize>(pub Vec<(f64, [f64; N])>);

impl<const N: usize> Keyframes<N> {
    /// Values at `x`, a + s (b - a) with s = (x - xa) / (xb - xa) between two keys; `None` without keys.
    pub fn at(&self, x: f64) -> Option<[f64; N]> {
        // The first key beyond x and the one before it enclose x; one of them is absent outside of the keys.
        let next = self.0.partition_point(|key| key.0 <= x);
        Some(match (next.checked_sub(1).and_then(|k| self.0.get(k)), self.0.get(next)) {
            (Some(a), Some(b)) => {
                let s = (x - a.0) / (b.0 - a.0);
                std::array::from_fn(|i| a.1[i] + s * (b.1[i] - a.1[i]))
            }
            (Some(only), None) | (None, Some(only)) => only.1,
            (None, None) => return None,
        })
    }
}

/// Value at `x` by linear interpolation, a + (b - a) (x - xa) / (xb - xa), between rows of coordinate and value in ascending order
/// of the coordinate; `None` without rows. It multiplies before it divides and differs from [`Keyframes::at`] in the last bits.
pub fn interpolate(rows: &[[f64; 2]], x: f64) -> Option<f64> {
    let next = rows.partition_point(|row| row[0] <= x);
    match (next.checked_sub(1).and_then(|k| rows.get(k)), rows.get(next)) {
        (Some(a), Some(b)) => Some(a[1] + (b[1] - a[1]) * (x - a[0]) / (b[0] - a[0])),
        (Some(only), None) | (None, Some(only)) => Some(only[1]),
        (None, None) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_linear_between_keys_and_constant_outside() {
        let keys = Keyframes(vec![(1.0, [0.0, 3.0]), (2.0, [10.0, 3.0]), (4.0, [0.0, -1.0])]);
        let rows = [[1.0, 0.0], [2.0, 10.0], [4.0, 0.0]];
        for (x, wanted) in
            [(0.0, [0.0, 3.0]), (1.5, [5.0, 3.0]), (2.0, [10.0, 3.0]), (3.0, [5.0, 1.0]), (9.0, [0.0, -1.0])]
        {
            assert_eq!(keys.at(x), Some(wanted), "{x}");
            assert_eq!(interpolate(&rows, x), Some(wanted[0]), "{x}");
        }
        assert_eq!(interpolate(&[], 0.0), None);
    }
}
