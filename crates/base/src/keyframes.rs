//! Values keyed by time or another coordinate, linear between the keys and constant outside of them.

/// Keys in rising order of their coordinate, each with `N` values.
///
/// # Examples
/// ```
/// use osier_base::keyframes::Keyframes;
///
/// let speed = Keyframes::new(vec![(0.0, [2.0]), (4.0, [6.0])]);
/// assert_eq!(speed.at(1.0), Some([3.0]));
/// assert_eq!(speed.at(9.0), Some([6.0]));
/// assert_eq!(Keyframes::<1>::default().at(0.0), None);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Keyframes<const N: usize>(Vec<(f64, [f64; N])>);

impl<const N: usize> Default for Keyframes<N> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

/// Where a coordinate lies among the keys.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Segment<const N: usize> {
    /// Before the first or from the last key on: the values of that key.
    Outside([f64; N]),
    /// Between two neighbouring keys.
    Between((f64, [f64; N]), (f64, [f64; N])),
}

impl<const N: usize> Keyframes<N> {
    /// Keys with coordinates that rise strictly.
    pub fn new(keys: Vec<(f64, [f64; N])>) -> Self {
        debug_assert!(keys.windows(2).all(|k| k[0].0 < k[1].0), "the coordinates of keys rise");
        Self(keys)
    }

    /// The keys.
    pub fn keys(&self) -> &[(f64, [f64; N])] {
        &self.0
    }

    /// True without keys.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    fn segment(&self, x: f64) -> Option<Segment<N>> {
        let next = self.0.partition_point(|key| key.0 <= x);
        Some(match (next.checked_sub(1).and_then(|k| self.0.get(k)), self.0.get(next)) {
            (Some(a), Some(b)) => Segment::Between(*a, *b),
            (Some(only), None) | (None, Some(only)) => Segment::Outside(only.1),
            (None, None) => return None,
        })
    }

    /// Values at `x`, a + ((b - a) (x - xa)) / (xb - xa) between two keys; `None` without keys.
    pub fn at(&self, x: f64) -> Option<[f64; N]> {
        Some(match self.segment(x)? {
            Segment::Outside(values) => values,
            Segment::Between((xa, a), (xb, b)) => std::array::from_fn(|i| a[i] + (b[i] - a[i]) * (x - xa) / (xb - xa)),
        })
    }

    /// The same as a + s (b - a), where s = (x - xa) / (xb - xa) is rounded first: it differs from [`Keyframes::at`] in the
    /// last bits. Rods use it, whose recorded motion must keep its bits.
    pub fn at_by_fraction(&self, x: f64) -> Option<[f64; N]> {
        Some(match self.segment(x)? {
            Segment::Outside(values) => values,
            Segment::Between((xa, a), (xb, b)) => {
                let s = (x - xa) / (xb - xa);
                std::array::from_fn(|i| a[i] + s * (b[i] - a[i]))
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_linear_between_keys_and_constant_outside() {
        let keys = Keyframes::new(vec![(1.0, [0.0, 3.0]), (2.0, [10.0, 3.0]), (4.0, [0.0, -1.0])]);
        for (x, wanted) in
            [(0.0, [0.0, 3.0]), (1.5, [5.0, 3.0]), (2.0, [10.0, 3.0]), (3.0, [5.0, 1.0]), (9.0, [0.0, -1.0])]
        {
            assert_eq!(keys.at(x), Some(wanted), "{x}");
            assert_eq!(keys.at_by_fraction(x), Some(wanted), "{x}");
        }
    }
}
