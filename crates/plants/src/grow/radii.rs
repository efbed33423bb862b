//! Radii of a plant's nodes from its branching alone: the pipe model and tapers.

use osier_base::math::{narrow, pow};
use osier_scene::plant::{NONE, Plant};

/// A leaf counts as a pipe of this radius, m: half the width of a petiole. Larger values thicken wood with many leaves.
const LEAF_RADIUS: f64 = 0.0005;
/// Radii grow towards the base by at least this per metre, so that axes without branches are not cylinders.
const MIN_TAPER: f64 = 0.002;
/// Half width of the box filter along an axis, in radii: the step of radius at a fork spreads over the girth of the wood.
const SMOOTHING_RADII: f64 = 1.5;
/// Radius of a tapered child at its base, as a share of its parent's radius at the site.
pub(super) const CHILD_RADIUS: f64 = 0.6;

/// Pipe model (Shinozaki 1964): at a fork the parent's radius to the power n is the sum of the children's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pipe {
    /// Exponent of r^n, 2 (equal areas) to 3.
    pub exponent: f64,
    /// Radius at the tips of axes, m; limited to at least 1e-6 m.
    pub tip: f64,
    /// Radius at the base, m; `None`: the radius to which the tips add up.
    pub base: Option<f64>,
}

impl Default for Pipe {
    fn default() -> Self {
        Self { exponent: 2.3, tip: 0.0015, base: None }
    }
}

/// Taper along each axis, whatever it bears.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Taper {
    /// Radius of root axes at their base, m.
    pub base: f64,
    /// Radius at the tips of axes, m.
    pub tip: f64,
    /// Exponent of the taper, 0.3..3; 1 is linear.
    pub exponent: f64,
}

impl Default for Taper {
    fn default() -> Self {
        Self { base: 0.02, tip: 0.0015, exponent: 1.0 }
    }
}

/// Sets all radii by the pipe model, from the tips to the base; axes must come after their parents.
/// Radii never grow along an axis; the thinnest are `tip`, and the thickest root is `base` if given.
/// Source: acc = tip^n at tips, + r_child^n per attachment, + 0.0005^n per leaf; r = max(acc^(1/n), r_next + 0.002 ds);
/// steps box-filtered over +-1.5 r, then mapped linearly so that the base fits.
pub fn pipe(plant: &mut Plant, options: &Pipe) {
    let n = if options.exponent.is_finite() { options.exponent.clamp(1.0, 6.0) } else { 2.3 };
    let tip = options.tip.max(1e-6);
    // Sum the n-th powers from the tips to the base, then smooth the steps that forks leave, axis by axis.
    let thickest = set_all_axis_radii(plant, tip, n);
    let mut smoothing = Smoothing::default();
    for i in 0..plant.axes.len() {
        smoothing.smooth(plant, i);
    }
    // Map radii linearly, tip to tip, so that the thickest root gets the base radius asked for.
    match options.base {
        Some(base) if thickest > tip * 1.000_001 => {
            let factor = (base - tip) / (thickest - tip);
            for r in &mut plant.nodes.r {
                *r = narrow((tip + (f64::from(*r) - tip) * factor).max(1e-6));
            }
        }
        Some(base) => taper(plant, &Taper { base, tip, exponent: 1.0 }),
        None => {}
    }
}

/// Computes powers with one exponent and caches the results, because few different twigs make up most of a plant.
struct CachedPower {
    exponent: f64,
    /// Cache: the bits of a base and its power, at an index that follows from the bits.
    known: Vec<(u64, f64)>,
}

impl CachedPower {
    /// Number of results that are kept, as a power of two.
    const BITS: u32 = 12;

    fn new(exponent: f64) -> Self {
        Self { exponent, known: vec![(1.0_f64.to_bits(), 1.0); 1 << Self::BITS] }
    }

    #[allow(clippy::cast_possible_truncation, reason = "the bits that the shift leaves fit")]
    fn pow(&mut self, base: f64) -> f64 {
        let bits = base.to_bits();
        // The top bits of a product with an odd number depend on all bits of the base.
        let place = (bits.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> (u64::BITS - Self::BITS)) as usize;
        let Some(known) = self.known.get_mut(place) else { return pow(base, self.exponent) };
        if known.0 != bits {
            *known = (bits, pow(base, self.exponent));
        }
        known.1
    }
}

/// Loads of each axis besides its own tip: the arc lengths of its branches and leaves, and the n-th powers of their
/// radii.
struct Loads {
    /// Index in `list` where the loads of each axis begin, and number of those that are known.
    first: Vec<u32>,
    known: Vec<u32>,
    list: Vec<(f32, f64)>,
}

impl Loads {
    /// Reserves memory for the organs and branches of all axes of a plant, which has fewer than 2^32 of them.
    fn new(plant: &Plant) -> Self {
        let mut first = vec![0_u32; plant.axes.len()];
        let organs = plant.organs.iter().map(|o| o.axis);
        for axis in organs.chain(plant.axes.iter().map(|a| a.parent)) {
            if let Some(number) = first.get_mut(axis as usize) {
                *number += 1;
            }
        }
        let mut sum = 0;
        for first in &mut first {
            sum += std::mem::replace(first, sum);
        }
        let known = vec![0; first.len()];
        Self { first, known, list: vec![(0.0, 0.0); sum as usize] }
    }

    fn range(&self, axis: usize) -> std::ops::Range<usize> {
        let first = self.first[axis] as usize;
        first..first + self.known[axis] as usize
    }

    /// Adds a load to an axis, if that exists.
    fn add(&mut self, axis: u32, load: (f32, f64)) {
        let axis = axis as usize;
        if let (Some(first), Some(known)) = (self.first.get(axis), self.known.get_mut(axis)) {
            self.list[(first + *known) as usize] = load;
            *known += 1;
        }
    }

    /// The loads of an axis, sorted from the tip.
    fn sorted(&mut self, axis: usize) -> &[(f32, f64)] {
        let range = self.range(axis);
        let list = &mut self.list[range];
        if list.len() > 1 {
            list.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.total_cmp(&b.1)));
        }
        list
    }
}

/// Radii of all axes before smoothing: sums of `n`-th powers, carried from the tips down. Returns the radius of the thickest
/// root.
fn set_all_axis_radii(plant: &mut Plant, tip: f64, n: f64) -> f64 {
    let (leaf, pow_tip) = (pow(LEAF_RADIUS, n), pow(tip, n));
    // Leaves first; branches follow once they are summed.
    let mut loads = Loads::new(plant);
    for o in &plant.organs {
        loads.add(o.axis, (o.s, leaf));
    }
    let mut thickest = 0.0_f64;
    let (mut area, mut radius) = (CachedPower::new(n), CachedPower::new(1.0 / n));
    // Axes come after their parents, so the reverse order has every child summed before its parent.
    for i in (0..plant.axes.len()).rev() {
        let base = set_axis_radii(plant, i, loads.sorted(i), pow_tip, &mut radius).unwrap_or(tip);
        let axis = &plant.axes[i];
        if axis.parent == NONE {
            thickest = thickest.max(base);
        } else {
            loads.add(axis.parent, (axis.parent_s, area.pow(base)));
        }
    }
    thickest
}

/// Radii of one axis before smoothing, from its tip down; returns that of its base. `loads`: arc lengths and n-th
/// powers of the radii of its branches and leaves, sorted from the tip; `pow_tip`: n-th power of the tip's radius;
/// `root`: the n-th root.
fn set_axis_radii(
    plant: &mut Plant,
    axis: usize,
    loads: &[(f32, f64)],
    pow_tip: f64,
    root: &mut CachedPower,
) -> Option<f64> {
    let range = plant.nodes_of(&plant.axes[axis]);
    let (s, r) = (&plant.nodes.s, &mut plant.nodes.r);
    let mut acc = pow_tip;
    let mut loads = loads.iter().peekable();
    let mut above: Option<(f64, f32)> = None;
    // A millionth of the length, because attachments and nodes were rounded separately.
    let slack = plant.axes[axis].length * 1e-6;
    for k in range.rev() {
        // By the pipe model, the n-th power of the radius is the sum of all loads at or above the node.
        while let Some((_, amount)) = loads.next_if(|l| l.0 >= s[k] - slack) {
            acc += amount;
        }
        let mut radius = root.pow(acc);
        if let Some((r_next, s_next)) = above {
            radius = radius.max(r_next + MIN_TAPER * f64::from(s_next - s[k]));
        }
        above = Some((radius, s[k]));
        r[k] = narrow(radius);
    }
    above.map(|a| a.0)
}

/// Buffers of one axis at a time, from its base on: arc lengths, radii and the integrals of the radii.
#[derive(Default)]
struct Smoothing {
    s: Vec<f64>,
    r: Vec<f64>,
    sums: Vec<f64>,
}

impl Smoothing {
    /// Averages the radii of an axis over a window of 1.5 radii to each side (less near the ends, which stay as they are), then
    /// makes them fall monotonically towards the tip.
    fn smooth(&mut self, plant: &mut Plant, axis: usize) {
        let range = plant.nodes_of(&plant.axes[axis]);
        // In an axis of two nodes the windows have no width: only the order of the radii is corrected.
        if let Some([base, tip]) = plant.nodes.r.get_mut(range.clone()).and_then(|r| <&mut [f32; 2]>::try_from(r).ok())
            && plant.nodes.s.get(range.start).is_some_and(|s| *s <= 0.0)
        {
            let least = 0.0_f64.max(f64::from(*tip));
            (*tip, *base) = (narrow(least), narrow(least.max(f64::from(*base))));
            return;
        }
        let Self { s, r, sums } = self;
        for (wide, stored) in [(&mut *s, &plant.nodes.s), (&mut *r, &plant.nodes.r)] {
            wide.clear();
            wide.extend(stored[range.clone()].iter().map(|v| f64::from(*v)));
        }
        let count = s.len();
        sums.clear();
        sums.resize(count, 0.0);
        // sums[k]: integral of r over s from the base to node k, by the trapezium rule, exact for radii linear
        // between nodes.
        for k in 1..count {
            sums[k] = sums[k - 1] + 0.5 * (r[k] + r[k - 1]) * (s[k] - s[k - 1]);
        }
        // Integral of r from the base to `x`; box filtering is a difference of two of its values over the window.
        let integral = |x: f64, near: usize| {
            let k = number_up_to(s, x, near).clamp(1, count - 1);
            let (a, b) = (s[k - 1], s[k]);
            let t = if b > a { ((x - a) / (b - a)).clamp(0.0, 1.0) } else { 0.0 };
            let here = r[k - 1] + (r[k] - r[k - 1]) * t;
            sums[k - 1] + 0.5 * (r[k - 1] + here) * (b - a) * t
        };
        let last = s[count - 1];
        let mut least = 0.0_f64;
        for k in (0..count).rev() {
            // The window must fit the axis on both sides; from the tip down, the running maximum keeps radii from
            // growing upwards.
            let w = (SMOOTHING_RADII * r[k]).min(s[k]).min(last - s[k]);
            let mean = if w > 1e-9 { (integral(s[k] + w, k) - integral(s[k] - w, k)) / (2.0 * w) } else { r[k] };
            least = least.max(mean);
            plant.nodes.r[range.start + k] = narrow(least);
        }
    }
}

/// Number of values up to `x` in a sorted list, found from index `near` on.
fn number_up_to(sorted: &[f64], x: f64, near: usize) -> usize {
    // Steps to either side before a binary search is faster.
    const STEPS: usize = 4;
    let mut n = near;
    for _ in 0..STEPS {
        match (n.checked_sub(1).and_then(|k| sorted.get(k)), sorted.get(n)) {
            (Some(before), _) if *before > x => n -= 1,
            (_, Some(after)) if *after <= x => n += 1,
            _ => return n,
        }
    }
    sorted.partition_point(|v| *v <= x)
}

/// Sets all radii by the taper law; axes must come after their parents.
/// Source: r = tip + (base - tip)(1 - s/L)^e, a child's base = 0.6 of its parent's radius at the site.
pub fn taper(plant: &mut Plant, options: &Taper) {
    let tip = options.tip.max(1e-6);
    for i in 0..plant.axes.len() {
        let axis = plant.axes[i].clone();
        let base = match plant.axes.get(axis.parent as usize).filter(|_| axis.parent != NONE) {
            Some(parent) => CHILD_RADIUS * f64::from(plant.frame(parent, axis.parent_s).r),
            None => options.base,
        };
        let (base, tip) = (base.max(1e-6), tip.min(base.max(1e-6)));
        for k in plant.nodes_of(&axis) {
            // An axis without length has the radius of its base.
            let along = if axis.length > 0.0 { f64::from(plant.nodes.s[k] / axis.length) } else { 0.0 };
            let left = pow((1.0 - along).clamp(0.0, 1.0), options.exponent);
            plant.nodes.r[k] = narrow(tip + (base - tip) * left);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_counted_from_anywhere() {
        let sorted = [0.0, 0.5, 0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0];
        for near in 0..sorted.len() {
            for x in [-1.0, 0.0, 0.25, 0.5, 0.75, 2.0, 5.5, 8.0, 9.0] {
                let expected = sorted.iter().filter(|v| **v <= x).count();
                assert_eq!(number_up_to(&sorted, x, near), expected, "{x} from {near}");
            }
        }
    }

    #[test]
    fn kept_powers_are_those_of_their_base() {
        let mut cached = CachedPower::new(2.3);
        for i in (0..5000).chain(0..5000) {
            let base = 1e-3 * f64::from(i);
            assert_eq!(cached.pow(base).to_bits(), pow(base, 2.3).to_bits(), "{base}");
        }
    }
}
