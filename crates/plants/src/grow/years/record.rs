//! A tree through the years of a clip: the state of its wood at any time between two ages. Own.

use glam::{Quat, Vec3};

use super::tree::{FALL_DELAY, NONE, Scratch, Tree, flag};
use osier_base::math;

/// Years over which a branch that falls or is cut off thins out. At 24 frames a year a leaf on it shrinks by .28 a frame.
const FALL_YEARS: f32 = 0.15;
/// Largest number of years that are stored. If every year is stored, the tree of each year is shown within a centimetre; with
/// every second year, 99 of 100 leaves are within 0.11 m.
const MAX_KEYS: u32 = 40;
/// Part of the clip during which wood that has thinned out keeps its position, before it is moved to its base. Own: formats that
/// keep fewer shapes than frames, at least 16, interpolate between them; if the wood moved at once, a branch would shrink into
/// its base between two shapes instead of thinning out.
const KEPT_PART: f32 = 0.1;
/// Years before the start over which the seedling appears.
const SPROUTING: f32 = 0.1;
/// Year of fall of a node that has not fallen.
const STANDS: u16 = u16::MAX;

/// Ages at which a clip begins and ends, years; before age 0 nothing is shown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClipSpan {
    /// Age at the first frame, years.
    pub from: f64,
    /// Age at the last frame, years; below `from` the clip runs backwards.
    pub to: f64,
}

impl ClipSpan {
    /// Last year that must be computed.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "ages are at most 500 years")]
    pub(super) fn last_year(self) -> u32 {
        self.from.max(self.to).max(0.0).ceil() as u32
    }

    /// Smaller and larger of the two ages, years.
    fn ordered(self) -> [f32; 2] {
        [self.from.min(self.to), self.from.max(self.to)].map(math::narrow)
    }
}

/// Frames and pipe areas of all nodes at the end of a year.
#[derive(Debug, Clone)]
struct Key {
    year: f32,
    frames: Vec<Quat>,
    areas: Vec<f32>,
}

/// A tree that was recorded while it grew, with every node that it ever had.
#[derive(Debug, Clone)]
pub struct GrowthRecord {
    /// The tree in its last year, from which no fallen node was removed.
    pub(super) tree: Tree,
    pub(super) id: u32,
    pub(super) seed: u64,
    span: ClipSpan,
    /// Years between two keys.
    spacing: u32,
    keys: Vec<Key>,
    /// Frame and area of each node at the end of its first year.
    first_frames: Vec<Quat>,
    first_areas: Vec<f32>,
    /// Year in which each node fell, or [`STANDS`].
    fell: Vec<u16>,
    /// Last year at whose end each node lived.
    last_living: Vec<u16>,
    /// Last year at whose end each node was an open tip; 0 if it never was, as for the seedling.
    last_open: Vec<u16>,
}

/// State of the wood at a time, by node of the recorded tree.
#[derive(Debug, Clone, Default)]
pub(super) struct Wood {
    /// End of the internode, m.
    pub p: Vec<Vec3>,
    /// Frame of the internode, +Y along it.
    pub q: Vec<Quat>,
    /// Radius, m, also of nodes that are not visible at this time.
    pub r: Vec<f32>,
    /// Visible share, 0..1: 0 before birth and after the fall, between 0 and 1 while the node grows or thins out.
    pub shown: Vec<f32>,
    /// Length that has grown, m.
    pub length: Vec<f32>,
}

impl GrowthRecord {
    /// A record that begins with the seedling; years are added by `note_year`.
    pub(super) fn new(tree: &Tree, span: ClipSpan, id: u32, seed: u64) -> Self {
        let mut record = Self {
            tree: tree.clone(),
            id,
            seed,
            span,
            spacing: span.last_year().div_ceil(MAX_KEYS).max(1),
            keys: Vec::new(),
            first_frames: Vec::new(),
            first_areas: Vec::new(),
            fell: Vec::new(),
            last_living: Vec::new(),
            last_open: Vec::new(),
        };
        record.note_year(tree);
        record
    }

    /// Adds the state of the tree at the end of a year; years after the last of the clip are not recorded.
    pub(super) fn note_year(&mut self, tree: &Tree) {
        let last = tree.year == self.span.last_year();
        if tree.year > self.span.last_year() {
            return;
        }
        let nodes = &tree.nodes;
        // Nodes of a recorded tree are only appended: those with indices from `known` grew this year.
        let known = self.fell.len();
        self.first_frames.extend_from_slice(&nodes.q[known..]);
        self.first_areas.extend_from_slice(&nodes.area[known..]);
        self.fell.resize(nodes.len(), STANDS);
        self.last_living.resize(nodes.len(), 0);
        self.last_open.resize(nodes.len(), 0);
        let year = tree.stored_year();
        for i in 0..nodes.len() {
            if nodes.flags[i] & flag::FALLEN != 0 {
                self.fell[i] = self.fell[i].min(year);
            } else if nodes.lives(i) {
                self.last_living[i] = year;
                if nodes.flags[i] & flag::OPEN != 0 {
                    self.last_open[i] = year;
                }
            }
        }
        // Store the state of all nodes only for some years, so that the number of keys, and with it the memory, does not grow
        // with the age of the tree.
        if tree.year > 0 && (last || tree.year.is_multiple_of(self.spacing)) {
            self.keys.push(Key { year: tree.year as f32, frames: nodes.q.clone(), areas: nodes.area.clone() });
        }
        // Properties that do not change are taken from the tree at the end of the clip: parents, births, cuts.
        if last {
            self.tree = Tree { scratch: Scratch::default(), ..tree.clone() };
            // Each frame looks up the cuts of every node. The sort is stable, so that the cuts of a node stay in the order of
            // years.
            self.tree.cuts.sort_by_key(|cut| cut.node);
        }
    }

    /// The ages that the clip shows, from its first frame to its last one.
    pub fn span(&self) -> ClipSpan {
        self.span
    }

    /// Smallest and largest age that the clip shows, years, also for a clip that runs backwards.
    pub(super) fn ages(&self) -> [f32; 2] {
        self.span.ordered()
    }

    /// Whether the clip contains a node: it is visible at some time of the clip, or is a seedling.
    pub(super) fn is_shown(&self, i: usize) -> bool {
        let [first, last] = self.span.ordered();
        // A plant needs an axis: a tree that is sown after the end of the clip therefore keeps its seedling, which is never
        // visible.
        let begins = self.start(i) < last || self.tree.nodes.birth[i] <= 0.0;
        begins && self.fall_window(i).is_none_or(|[_, end]| end > first)
    }

    /// Whether a node has fallen by the end of the record.
    pub(super) fn has_fallen(&self, i: usize) -> bool {
        self.fell[i] != STANDS
    }

    /// First year of a node: the earliest at whose end it exists.
    pub(super) fn first_year(&self, i: usize) -> f32 {
        self.tree.nodes.birth[i].ceil()
    }

    /// Last year at whose end a node was alive.
    pub(super) fn last_living_year(&self, i: usize) -> f32 {
        f32::from(self.last_living[i])
    }

    /// Last year at whose end a node was an open tip, if it ever was one.
    pub(super) fn last_open_year(&self, i: usize) -> Option<f32> {
        let is_seedling = self.tree.nodes.parent[i] == NONE;
        (self.last_open[i] > 0 || is_seedling).then(|| f32::from(self.last_open[i]))
    }

    /// Time at which a node's internode begins to grow, years: when the internode before it is complete, but not before its year.
    pub(super) fn start(&self, i: usize) -> f32 {
        let nodes = &self.tree.nodes;
        // Births within a year are spread over it along each shoot, so that internodes follow each other. `NONE` lies beyond the
        // array.
        match nodes.birth.get(nodes.parent[i] as usize) {
            Some(carrier) => carrier.max(self.first_year(i) - 1.0),
            None => nodes.birth[i] - SPROUTING,
        }
    }

    /// Ages between which a node thins out because it falls, years; `None` if it still stands at the end of the record.
    pub(super) fn fall_window(&self, i: usize) -> Option<[f32; 2]> {
        let start = f32::from(self.fell[i]) - 1.0 + FALL_DELAY;
        (self.fell[i] != STANDS).then_some([start, start + FALL_YEARS])
    }

    /// State of the wood at an age, years, interpolated between stored years.
    pub(super) fn wood(&self, time: f32) -> Wood {
        self.posed(time, false)
    }

    /// The wood of all nodes that the clip shows, at once: in its state at the end of the clip, or, for fallen nodes, when they
    /// fell.
    pub(super) fn wood_of_all(&self) -> Wood {
        self.posed(self.span.ordered()[1], true)
    }

    /// State of the wood at an age, years. With `all`, fallen nodes stand, and nodes that are still to grow have their full
    /// length.
    fn posed(&self, time: f32, all: bool) -> Wood {
        let nodes = &self.tree.nodes;
        let count = nodes.len();
        let root = 1.0 / self.tree.habit.pipe_exponent;
        let [first, last] = self.span.ordered();
        let kept = KEPT_PART * (last - first);
        let tip_area = math::pow_f32(self.tree.habit.tip_radius, self.tree.habit.pipe_exponent);
        // Stored years before and after this time.
        let after = self.keys.partition_point(|k| k.year < time);
        let (before, after) = (after.checked_sub(1).and_then(|k| self.keys.get(k)), self.keys.get(after));
        let mut wood = Wood {
            p: Vec::with_capacity(count),
            q: Vec::with_capacity(count),
            r: Vec::with_capacity(count),
            shown: Vec::with_capacity(count),
            length: Vec::with_capacity(count),
        };
        for i in 0..count {
            let parent = nodes.parent[i] as usize;
            // Parents come first, so that the positions of their ends are known: forward kinematics along the tree.
            let base = match wood.p.get(parent) {
                Some(p) => *p,
                // Roots stay in their place.
                None => nodes.base(i),
            };
            let (start, end) = (self.start(i), nodes.birth[i]);
            let grown = if all { 1.0 } else { ((time - start) / (end - start).max(1e-6)).clamp(0.0, 1.0) };
            let (q, area) = self.frame_and_area(i, time, tip_area, before, after);
            // An infinite time gives the length after all cuts.
            let mut length = self.length(i, if all { f32::INFINITY } else { time }) * grown;
            let mut shown = grown;
            if let Some([start, end]) = self.fall_window(i).filter(|_| !all) {
                // Falling wood thins out in place; later, after a time in which it is not visible, it lies at its base.
                shown *= 1.0 - ((time - start) / (end - start)).clamp(0.0, 1.0);
                // The first internode of a fallen axis end retracts at once; otherwise it would protrude from the standing wood
                // like a thorn.
                let carrier_stands = self.fell.get(parent).is_some_and(|year| *year > self.fell[i]);
                let is_end = carrier_stands && nodes.axis[parent] == nodes.axis[i];
                length *= f32::from(u8::from(time < end + if is_end { 0.0 } else { kept }));
            }
            wood.p.push(base + super::tree::y_axis(q) * length);
            wood.q.push(q);
            wood.r.push(math::pow_f32(area, root));
            wood.shown.push(shown);
            wood.length.push(length);
        }
        wood
    }

    /// Frame and pipe area of a node at a time: interpolated between the end of its first year and the keys after it.
    fn frame_and_area(
        &self,
        i: usize,
        time: f32,
        tip_area: f32,
        before: Option<&Key>,
        after: Option<&Key>,
    ) -> (Quat, f32) {
        let first = self.first_year(i).max(1.0);
        if time <= first {
            // In its first year it thickens from the radius of a tip.
            let part = (time - (first - 1.0)).clamp(0.0, 1.0);
            return (self.first_frames[i], math::lerp(tip_area, self.first_areas[i], part));
        }
        let stored = |key: Option<&Key>| {
            let key = key.filter(|k| k.year >= first)?;
            Some((key.year, *key.frames.get(i)?, *key.areas.get(i)?))
        };
        let from = stored(before).unwrap_or((first, self.first_frames[i], self.first_areas[i]));
        let Some(to) = stored(after) else { return (from.1, from.2) };
        // The denominator is 0 if both keys are the same.
        let part = ((time - from.0) / (to.0 - from.0).max(1e-6)).clamp(0.0, 1.0);
        (math::nlerp(from.1, to.1, part), math::lerp(from.2, to.2, part))
    }

    /// Length of a node's internode at a time, m: a cut shortens it while the wood beyond the cut thins out.
    fn length(&self, i: usize, time: f32) -> f32 {
        let length = self.tree.nodes.length[i];
        // The first cut that is in the future or in progress; later cuts begin from the length that it leaves.
        let mut cuts = self.tree.cuts_through(i);
        let pending = cuts.find(|cut| cut.time() + FALL_YEARS > time);
        let Some(cut) = pending else { return length };
        let left = cuts.next().map_or(length, |next| next.length);
        let part = ((time - cut.time()) / FALL_YEARS).clamp(0.0, 1.0);
        math::lerp(cut.length, left, part)
    }
}
