//! Turns words into axes: a letter whose map continues the axis extends its parent's, any other opens an axis of its own.

use glam::{DVec3, Vec3};

use super::{TreeSize, WordSite};
use crate::grow::polyline::{self, NewAxis};
use osier_base::math::{self, narrow};
use osier_base::rng::{mix64, word};
use osier_ifs::stems::TreeSystem;
use osier_ifs::words::{Expansion, NONE as ROOT, Word};
use osier_scene::plant::{NONE, Plant};

/// Thinnest radius, m; keeps rings of the loft from collapsing to points.
const MIN_RADIUS: f64 = 1e-6;

/// Node of an axis: position and radius, m, and arc length in table units.
#[derive(Debug, Clone, Copy)]
struct AxisNode {
    p: DVec3,
    r: f64,
    s: f64,
}

/// Axis as words make it, before it is numbered and added to the plant.
#[derive(Debug, Clone)]
pub(super) struct WordAxis {
    parent: usize,
    /// Arc length on the parent, table units.
    parent_s: f64,
    order: u8,
    ordinal: u64,
    fork: u32,
    nodes: Vec<AxisNode>,
    /// Index in the plant; `NONE` until `order_axes` has numbered the axes.
    pub plant_index: u32,
}

/// Part of an axis that a word covers.
#[derive(Debug, Clone, Copy)]
struct WordSegment {
    /// Index into `WordSkeleton::raw`.
    axis: usize,
    /// Arc lengths of its base and its end, table units.
    start: f64,
    end: f64,
}

/// All axes, and the part of an axis that each word covers.
#[derive(Debug)]
pub(super) struct WordSkeleton {
    raw: Vec<WordAxis>,
    /// Segment of each word, in the order of the expansion.
    segments: Vec<WordSegment>,
}

/// Builds the axes of all words: a word continues the axis of its parent or begins an axis.
/// Own: a word's segment ends as thick as the word that continues its axis begins; without such a word, its end has the summed
/// cross-section of its children (Leonardo's rule), at most that of its base.
pub(super) fn build_word_skeleton(stems: &TreeSystem, expanded: &Expansion, size: TreeSize) -> WordSkeleton {
    let TreeSize { scale, radius } = size;
    let maps = &stems.system.maps;
    // Ratio of the radii at the end and at the base of a segment: rho of the map that continues the axis, otherwise
    // sqrt(sum of rho_i^2) over all maps.
    let (mut lead, mut sum) = (None, 0.0);
    for m in maps.iter().filter(|m| !m.stem) {
        let rho = m.radius.unwrap_or_else(|| m.branch.map_or_else(|| m.affine.norm(), |b| b.scale));
        sum += rho * rho;
        if m.axis {
            lead = Some(rho);
        }
    }
    let end = lead.unwrap_or_else(|| math::sqrt(sum).min(1.0));
    let mut out = WordSkeleton { raw: Vec::new(), segments: Vec::with_capacity(expanded.words.len()) };
    let mut forks = 0;
    let mut fork_of = vec![NONE; expanded.words.len()];
    for w in &expanded.words {
        // The segment of a word is the image of the trunk under its map; radii scale by the product of the maps'
        // ratios.
        let foot = w.map.apply(stems.trunk.0) * scale;
        let tip = w.map.apply(stems.trunk.1) * scale;
        let (r0, r1) = (radius * w.radius, radius * w.radius * end);
        let parent = out.segments.get(w.parent as usize).copied();
        let axis = match parent {
            Some(WordSegment { axis, end: last, .. }) if maps[usize::from(w.letter)].axis => {
                // A continuation begins at the end of its parent's segment; if it begins lower, it shortens that segment.
                let at = out.attachment_s(stems, expanded, w).min(last);
                let nodes = &mut out.raw[axis].nodes;
                if at < last - 1e-9
                    && let Some(n) = nodes.last_mut()
                {
                    (n.p, n.s, n.r) = (foot, at, r0);
                }
                axis
            }
            _ => {
                let (parent_axis, parent_s) = match parent {
                    Some(segment) => (segment.axis, out.attachment_s(stems, expanded, w)),
                    None => (usize::MAX, 0.0),
                };
                // Systems without a continuing map fork: all children of a word share a fork number, by which the
                // loft joins them.
                let fork = if lead.is_none() && w.parent != ROOT {
                    let slot = &mut fork_of[w.parent as usize];
                    if *slot == NONE {
                        *slot = forks;
                        forks += 1;
                    }
                    *slot
                } else {
                    NONE
                };
                // Orders beyond 255 count as 255, as in every plant.
                #[allow(clippy::cast_possible_truncation, reason = "limited to 255 before the cast")]
                let order = w.order.min(255) as u8;
                let nodes = vec![AxisNode { p: foot, r: r0, s: 0.0 }];
                out.raw.push(WordAxis {
                    parent: parent_axis,
                    parent_s,
                    order,
                    ordinal: w.id,
                    fork,
                    nodes,
                    plant_index: NONE,
                });
                out.raw.len() - 1
            }
        };
        let start = out.raw[axis].nodes.last().map_or(0.0, |n| n.s);
        let stop = start + (tip - foot).length() / scale;
        out.raw[axis].nodes.push(AxisNode { p: tip, r: r1, s: stop });
        out.segments.push(WordSegment { axis, start, end: stop });
    }
    out.order_axes();
    out
}

impl WordSkeleton {
    /// Arc length on the parent's axis where a word's foot lies, table units.
    fn attachment_s(&self, stems: &TreeSystem, expanded: &Expansion, w: &Word) -> f64 {
        let (Some(parent), Some(&WordSegment { start: a, end: b, .. })) =
            (expanded.words.get(w.parent as usize), self.segments.get(w.parent as usize))
        else {
            return 0.0;
        };
        let (foot, tip) = (parent.map.apply(stems.trunk.0), parent.map.apply(stems.trunk.1));
        let along = tip - foot;
        // Projection of the word's base onto its parent's segment, 0..1 along it.
        let h = (w.map.apply(stems.trunk.0) - foot).dot(along) / along.length_squared().max(1e-300);
        a + (b - a) * h.clamp(0.0, 1.0)
    }

    /// Site at the base of a word's segment, once the axes are numbered; `None` for an unknown word.
    pub fn base_site(&self, word: usize) -> Option<WordSite> {
        self.segments.get(word).map(|w| WordSite { axis: self.raw[w.axis].plant_index, s: w.start })
    }

    /// Site at which a word that was cut would begin, on its parent's axis.
    pub fn site(&self, stems: &TreeSystem, expanded: &Expansion, cut: &Word) -> Option<WordSite> {
        let parent = self.segments.get(cut.parent as usize)?;
        Some(WordSite { axis: self.raw[parent.axis].plant_index, s: self.attachment_s(stems, expanded, cut) })
    }

    /// Numbers the axes depth first, siblings by arc length on the parent, then ordinal.
    fn order_axes(&mut self) {
        let mut children: Vec<Vec<usize>> = vec![Vec::new(); self.raw.len()];
        for (i, r) in self.raw.iter().enumerate() {
            if let Some(list) = children.get_mut(r.parent) {
                list.push(i);
            }
        }
        for list in &mut children {
            // Word ids differ, so the order of siblings at one place does not depend on the expansion.
            let key = |i: &usize| (self.raw[*i].parent_s, self.raw[*i].ordinal);
            list.sort_by(|a, b| key(a).0.total_cmp(&key(b).0).then(key(a).1.cmp(&key(b).1)));
        }
        let mut stack: Vec<usize> = (0..self.raw.len()).filter(|i| self.raw[*i].parent == usize::MAX).rev().collect();
        let mut next = 0;
        while let Some(i) = stack.pop() {
            self.raw[i].plant_index = next;
            next += 1;
            stack.extend(children[i].iter().rev());
        }
    }

    /// Appends the axes in the order of their numbers: each after its parent.
    pub fn add_to_plant(&self, plant: &mut Plant) {
        let mut in_order: Vec<&WordAxis> = self.raw.iter().collect();
        in_order.sort_by_key(|r| r.plant_index);
        for raw in in_order {
            add_axis(plant, raw, &self.raw);
        }
    }
}

/// Appends an axis and its nodes; the parent, if any, must be in the plant.
fn add_axis(plant: &mut Plant, raw: &WordAxis, all: &[WordAxis]) {
    let parent = all.get(raw.parent).map_or(NONE, |r| r.plant_index);
    let points: Vec<Vec3> = raw.nodes.iter().map(|n| Vec3::from_array(n.p.to_array().map(narrow))).collect();
    let (id, parent_s) = match plant.axes.get(parent as usize) {
        Some(p) => {
            // Lengths in the plant are those of rounded positions, so the attachment keeps its share of the parent's length.
            let whole = all.get(raw.parent).and_then(|r| r.nodes.last()).map_or(1.0, |n| n.s);
            let share = if whole > 0.0 { raw.parent_s / whole } else { 0.0 };
            (mix64(&[p.id, word("axis"), raw.ordinal]), narrow(share) * p.length)
        }
        None => (mix64(&[u64::from(plant.id), 0]), 0.0),
    };
    let axis = NewAxis { id, parent, parent_s, order: raw.order, fork: raw.fork };
    polyline::push_axis(plant, axis, &points, |i| narrow(raw.nodes[i].r.max(MIN_RADIUS)), 128);
}
