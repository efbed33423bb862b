//! The nearest bark: places on centrelines, searched by the way to their surface.

use glam::Vec3;

use osier_base::geometry::Bounds;

/// Places in a leaf of the tree.
const LEAF_SAMPLES: usize = 8;

/// A place on a centreline.
#[derive(Debug, Clone, Copy)]
pub(super) struct WoodSample<T> {
    pub p: Vec3,
    /// Radius of the wood there, m.
    pub r: f32,
    /// What it is a place of.
    pub what: T,
}

/// Places in halves of halves.
#[derive(Debug)]
pub(super) struct WoodSearch<T> {
    places: Vec<WoodSample<T>>,
    boxes: Vec<(Bounds, f32)>,
}

impl<T: Copy> WoodSearch<T> {
    pub fn new(mut places: Vec<WoodSample<T>>) -> Self {
        let mut boxes = Vec::new();
        split(&mut places, &mut boxes, 0);
        Self { places, boxes }
    }

    /// The place whose bark is nearest to `p`, with the way to it, m: negative inside the wood.
    pub fn nearest(&self, p: Vec3) -> Option<(f32, T)> {
        self.within(p, f32::INFINITY, |_| true)
    }

    /// The nearest among those wanted and nearer than `reach`, m.
    pub fn within(&self, p: Vec3, reach: f32, wanted: impl Fn(&T) -> bool) -> Option<(f32, T)> {
        let mut best: Option<(f32, T)> = None;
        let mut stack = vec![(0, 0, self.places.len(), f32::NEG_INFINITY)];
        while let Some((node, from, to, gap)) = stack.pop() {
            if gap >= best.map_or(reach, |(d, _)| d) {
                continue;
            }
            if to - from <= LEAF_SAMPLES {
                for place in self.places[from..to].iter().filter(|q| wanted(&q.what)) {
                    let d = place.p.distance(p) - place.r;
                    if d < best.map_or(reach, |(b, _)| b) {
                        best = Some((d, place.what));
                    }
                }
                continue;
            }
            let middle = from + (to - from) / 2;
            let side = |node: usize, from: usize, to: usize| (node, from, to, self.gap(node, p));
            let (a, b) = (side(2 * node + 1, from, middle), side(2 * node + 2, middle, to));
            // The nearer half is searched first.
            if a.3 <= b.3 { stack.extend([b, a]) } else { stack.extend([a, b]) }
        }
        best
    }

    /// No bark in the box is nearer than this.
    fn gap(&self, node: usize, p: Vec3) -> f32 {
        self.boxes.get(node).map_or(f32::INFINITY, |(b, r)| (p.clamp(b.min, b.max) - p).length() - r)
    }
}

fn split<T: Copy>(places: &mut [WoodSample<T>], boxes: &mut Vec<(Bounds, f32)>, node: usize) {
    let bounds = Bounds::of(places.iter().map(|q| q.p));
    let thickest = places.iter().fold(0.0_f32, |m, q| m.max(q.r));
    if boxes.len() <= node {
        boxes.resize(node + 1, (Bounds::default(), 0.0));
    }
    boxes[node] = (bounds, thickest);
    if places.len() <= LEAF_SAMPLES {
        return;
    }
    let size = bounds.size();
    let axis = if size.x >= size.y && size.x >= size.z { 0 } else { 1 + usize::from(size.z > size.y) };
    places.sort_by(|a, b| a.p[axis].total_cmp(&b.p[axis]));
    let (low, high) = places.split_at_mut(places.len() / 2);
    split(low, boxes, 2 * node + 1);
    split(high, boxes, 2 * node + 2);
}

#[cfg(test)]
mod tests {
    use super::*;
    use osier_base::rng::Rng;

    #[test]
    fn the_search_finds_what_a_look_at_all_of_them_finds() {
        let mut rng = Rng::at(7, &["near".into()]);
        let mut draw = || osier_base::math::narrow(rng.range(-1.0, 1.0));
        let places: Vec<WoodSample<usize>> = (0..500)
            .map(|what| WoodSample { p: Vec3::new(draw(), draw(), draw()), r: 0.1 * draw().abs(), what })
            .collect();
        let near = WoodSearch::new(places.clone());
        for _ in 0..200 {
            let p = Vec3::new(draw(), draw(), draw()) * 1.5;
            let odd = |w: &usize| w % 2 == 1;
            let all = places.iter().filter(|q| odd(&q.what)).map(|q| q.p.distance(p) - q.r).fold(f32::MAX, f32::min);
            let (gap, what) = near.within(p, 9.0, odd).expect("some");
            assert!((gap - all).abs() < 1e-6 && odd(&what));
            assert!(near.within(p, all, odd).is_none());
        }
    }
}
