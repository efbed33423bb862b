//! Nearest-bark queries: samples of centrelines with radii, in a binary bounding volume hierarchy.

use glam::Vec3;

use osier_base::geometry::Bounds;

/// Most samples in a leaf of the hierarchy.
const MAX_LEAF_SAMPLES: usize = 8;

/// A sample of the wood: a sphere about a point of a centreline.
#[derive(Debug, Clone, Copy)]
pub(super) struct WoodSample<T> {
    pub p: Vec3,
    /// Radius of the wood there, m.
    pub r: f32,
    /// Axis position or node at which it was taken; queries return it.
    pub owner: T,
}

/// Samples in a median-split hierarchy, node k having the children 2 k + 1 and 2 k + 2 (a heap layout).
#[derive(Debug)]
pub(super) struct WoodSearch<T> {
    samples: Vec<WoodSample<T>>,
    /// For each node, the box around its sample points and their largest radius, m.
    boxes: Vec<(Bounds, f32)>,
}

impl<T: Copy> WoodSearch<T> {
    pub fn new(mut samples: Vec<WoodSample<T>>) -> Self {
        let mut boxes = Vec::new();
        build_node(&mut samples, &mut boxes, 0);
        Self { samples, boxes }
    }

    /// The owner of the sample whose bark is nearest to `p`, with the signed distance |p - q| - r, m: negative inside the wood.
    pub fn nearest(&self, p: Vec3) -> Option<(f32, T)> {
        self.within(p, f32::INFINITY, |_| true)
    }

    /// As [`Self::nearest`], but only among samples for which `accepts` is true and whose bark is nearer than `reach`,
    /// m.
    pub fn within(&self, p: Vec3, reach: f32, accepts: impl Fn(&T) -> bool) -> Option<(f32, T)> {
        // Branch and bound: skip nodes whose lower bound is no better than the best distance so far.
        let mut best: Option<(f32, T)> = None;
        let mut stack = vec![(0, 0, self.samples.len(), f32::NEG_INFINITY)];
        while let Some((node, from, to, lower_bound)) = stack.pop() {
            if lower_bound >= best.map_or(reach, |(d, _)| d) {
                continue;
            }
            if to - from <= MAX_LEAF_SAMPLES {
                for sample in self.samples[from..to].iter().filter(|q| accepts(&q.owner)) {
                    let d = sample.p.distance(p) - sample.r;
                    if d < best.map_or(reach, |(b, _)| b) {
                        best = Some((d, sample.owner));
                    }
                }
                continue;
            }
            let middle = from + (to - from) / 2;
            let side = |node: usize, from: usize, to: usize| (node, from, to, self.lower_bound(node, p));
            let (a, b) = (side(2 * node + 1, from, middle), side(2 * node + 2, middle, to));
            // The nearer half is searched first.
            if a.3 <= b.3 { stack.extend([b, a]) } else { stack.extend([a, b]) }
        }
        best
    }

    /// Lower bound of the distance to any bark below a node: distance to its box minus the largest radius in it.
    fn lower_bound(&self, node: usize, p: Vec3) -> f32 {
        self.boxes.get(node).map_or(f32::INFINITY, |(b, r)| (p.clamp(b.min, b.max) - p).length() - r)
    }
}

/// Sorts the samples of a node along the longest side of their box and recurses into both halves.
fn build_node<T: Copy>(samples: &mut [WoodSample<T>], boxes: &mut Vec<(Bounds, f32)>, node: usize) {
    let bounds = Bounds::of(samples.iter().map(|q| q.p));
    let thickest = samples.iter().fold(0.0_f32, |m, q| m.max(q.r));
    if boxes.len() <= node {
        boxes.resize(node + 1, (Bounds::default(), 0.0));
    }
    boxes[node] = (bounds, thickest);
    if samples.len() <= MAX_LEAF_SAMPLES {
        return;
    }
    let size = bounds.size();
    let axis = if size.x >= size.y && size.x >= size.z { 0 } else { 1 + usize::from(size.z > size.y) };
    samples.sort_by(|a, b| a.p[axis].total_cmp(&b.p[axis]));
    let (low, high) = samples.split_at_mut(samples.len() / 2);
    build_node(low, boxes, 2 * node + 1);
    build_node(high, boxes, 2 * node + 2);
}

#[cfg(test)]
mod tests {
    use super::*;
    use osier_base::rng::Rng;

    #[test]
    fn the_search_finds_what_a_look_at_all_of_them_finds() {
        let mut rng = Rng::at(7, &["near".into()]);
        let mut draw = || osier_base::math::narrow(rng.range(-1.0, 1.0));
        let samples: Vec<WoodSample<usize>> = (0..500)
            .map(|owner| WoodSample { p: Vec3::new(draw(), draw(), draw()), r: 0.1 * draw().abs(), owner })
            .collect();
        let near = WoodSearch::new(samples.clone());
        for _ in 0..200 {
            let p = Vec3::new(draw(), draw(), draw()) * 1.5;
            let odd = |w: &usize| w % 2 == 1;
            let all = samples.iter().filter(|q| odd(&q.owner)).map(|q| q.p.distance(p) - q.r).fold(f32::MAX, f32::min);
            let (lower_bound, owner) = near.within(p, 9.0, odd).expect("some");
            assert!((lower_bound - all).abs() < 1e-6 && odd(&owner));
            assert!(near.within(p, all, odd).is_none());
        }
    }
}
