//! The ground in the rain, where drops end that have struck nothing else.

use glam::DVec3;

use crate::rain::tuning::GROUND_BISECTIONS;

/// Height of the ground at each position; drops that reach it end there. Implemented for `f64` as level ground.
pub trait GroundHeight: std::fmt::Debug + Send + Sync {
    /// Height of the ground at `x` and `z`, m.
    fn height(&self, x: f64, z: f64) -> f64;

    /// A height that the ground nowhere exceeds, m.
    fn max_height(&self) -> f64;
}

/// Level ground at this height, m.
impl GroundHeight for f64 {
    fn height(&self, _: f64, _: f64) -> f64 {
        *self
    }

    fn max_height(&self) -> f64 {
        *self
    }
}

/// Fraction of the straight path between two world positions at which it reaches the ground; `None` if its end is above the ground.
pub(crate) fn ground_crossing(ground: &dyn GroundHeight, [from, to]: [DVec3; 2]) -> Option<f64> {
    let is_below = |p: DVec3| p.y < ground.height(p.x, p.z);
    if !is_below(to) {
        return None;
    }
    // Bisection between a position above and one below; a path that starts below the ground ends at its start.
    let (mut above, mut below) = (0.0, 1.0);
    if is_below(from) {
        return Some(0.0);
    }
    for _ in 0..GROUND_BISECTIONS {
        let middle = 0.5 * (above + below);
        *(if is_below(from.lerp(to, middle)) { &mut below } else { &mut above }) = middle;
    }
    Some(0.5 * (above + below))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Slopes that rise by one in two along +X.
    #[derive(Debug)]
    struct Slope;

    impl GroundHeight for Slope {
        fn height(&self, x: f64, _: f64) -> f64 {
            0.5 * x
        }

        fn max_height(&self) -> f64 {
            f64::INFINITY
        }
    }

    #[test]
    fn paths_end_on_the_slope() {
        let path = [DVec3::new(2.0, 1.02, 0.0), DVec3::new(2.03, 0.95, 0.1)];
        let end = path[0].lerp(path[1], ground_crossing(&Slope, path).expect("it crosses"));
        assert!((end.y - 0.5 * end.x).abs() < 1e-6, "{end}");
        assert_eq!(ground_crossing(&Slope, [path[0], path[0] + DVec3::Y]), None);
        assert_eq!(ground_crossing(&0.0, [-DVec3::Y, -DVec3::Y * 2.0]), Some(0.0));
    }
}
