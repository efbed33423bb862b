//! The state of a growing tree: internodes as a structure of arrays, parents before their children, and buds.

use std::ops::Range;

use glam::{Quat, Vec3};

use super::habit::{Habit, whole};
use super::shading::Neighbours;
use super::site::Prune;
use osier_base::math;
use osier_base::rng::{Rng, child, mix64, word};

/// Missing index: the parent of a root, the new index of a removed node.
pub(super) const NONE: u32 = u32::MAX;
/// Length of the internode from which a tree grows, m.
const SEED_LENGTH: f32 = 0.05;
/// Share of the stems that sprout in the first year if others sprout later. Own.
const SPROUT_AT_ONCE: f32 = 0.4;
/// The golden ratio minus 1.
const GOLDEN_SHARE: f32 = 0.618_034;

/// Marks of an internode, as bits of its `flags`.
pub(super) mod flag {
    /// The tip is open: it bears leaves and may grow on.
    pub const OPEN: u8 = 1;
    /// Its tip made a short shoot last year.
    pub const SHORT: u8 = 2;
    /// Dead wood that still stands.
    pub const DEAD: u8 = 4;
    /// The internode fell or was cut off; its node stays until the arrays are compacted.
    pub const FALLEN: u8 = 8;
    /// It continues the axis of its parent.
    pub const MAIN: u8 = 16;
    /// Its tip died of shade.
    pub const SHADE: u8 = 32;
    /// It was cut through.
    pub const CUT: u8 = 64;
    /// Its tip ended at a solid.
    pub const OBSTACLE: u8 = 128;
    /// Mask of internodes that no longer live, standing or fallen.
    pub const GONE: u8 = DEAD | FALLEN;
}

/// Purposes of random draws, one for each rule.
#[derive(Debug, Clone, Copy)]
pub(super) enum Purpose {
    Extend = 1,
    Wander = 2,
    Buds = 3,
    Leave = 4,
    Stem = 5,
    Azimuth = 6,
    Dormant = 7,
    Lift = 8,
}

// One list of fields defines the columns and the row, so that `push` and `keep` cannot omit a column.
macro_rules! columns {
    ($(#[$doc:meta])* $name:ident / $row:ident { $($(#[$field_doc:meta])* $field:ident: $kind:ty,)* }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Default)]
        pub(super) struct $name {
            $($(#[$field_doc])* pub $field: Vec<$kind>,)*
        }

        /// One row of the arrays, with a value for each column.
        #[derive(Debug, Clone, Copy)]
        pub(super) struct $row {
            $(pub $field: $kind,)*
        }

        impl $name {
            pub fn push(&mut self, row: $row) {
                $(self.$field.push(row.$field);)*
            }

            /// Keeps the rows of the ranges, which ascend and do not overlap, and removes all others.
            fn keep(&mut self, ranges: &[Range<usize>]) {
                $(keep_ranges(&mut self.$field, ranges);)*
            }
        }
    };
}

columns! {
    /// Internodes of a tree, one column for each property.
    Nodes / Node {
        /// Index of the parent, or [`NONE`]; always below the index of the node.
        parent: u32,
        /// Index of the axis in [`Tree::axis_ids`].
        axis: u32,
        /// Number of the internode on the axis on which it was made.
        index: u16,
        /// Branching order of its axis, 0 for a trunk.
        order: u8,
        /// Marks, see [`flag`].
        flags: u8,
        /// Number of dormant buds that may still break at this node.
        dormant: u8,
        /// Number of dormant buds that have woken so far.
        woken: u8,
        /// Years without enough light minus the years with enough light, at least 0.
        starve: u8,
        /// Year of the tree's life in which it died; 0 while it lives.
        death: u16,
        /// End, from the tree's base, m.
        p: Vec3,
        /// Frame: +Y along the internode, +X the roll reference.
        q: Quat,
        /// Length of the internode, m; cuts shorten it.
        length: f32,
        /// Radius of the internode, m, from the pipe model.
        r: f32,
        /// r^n, the pipe area of the internode.
        area: f32,
        /// Pipe area of dead wood above that remains in this wood, by `pipe_memory`.
        lost: f32,
        /// Length of the path from the root to its end, m.
        path: f32,
        /// Arc length from the base of its axis to its end, m.
        s: f32,
        /// Moment of last year's weight about its base, N m.
        moment: f32,
        /// Time at which the internode was complete, years of the tree's life.
        birth: f32,
        /// Azimuth of its first bud, rad.
        azimuth: f32,
        /// Light at its end at the last examination; only for nodes with dormant buds.
        light: f32,
        /// Light that its living tips and buds receive, relative to a fully lit tip.
        gathered: f32,
        /// Vigour that it receives in a year, relative to a fully lit tip.
        vigour: f32,
    }
}

impl Nodes {
    pub fn len(&self) -> usize {
        self.parent.len()
    }

    /// Position of the base of a node's internode, from the tree's base, m.
    #[inline]
    pub fn base(&self, i: usize) -> Vec3 {
        // The base of a root is not stored: it lies the length of the internode below the root's end, along its
        // direction.
        match self.p.get(self.parent[i] as usize) {
            Some(p) => *p,
            None => self.p[i] - self.direction(i) * self.length[i],
        }
    }

    /// Unit direction of an internode, from its base to its end.
    #[inline]
    pub fn direction(&self, i: usize) -> Vec3 {
        y_axis(self.q[i])
    }

    /// Whether an internode is neither dead nor fallen.
    #[inline]
    pub fn lives(&self, i: usize) -> bool {
        self.flags[i] & flag::GONE == 0
    }

    /// Whether an internode ends in a living open tip.
    #[inline]
    pub fn grows(&self, i: usize) -> bool {
        self.flags[i] & (flag::GONE | flag::OPEN) == flag::OPEN
    }
}

/// The +Y axis of a frame, which points along the internode.
#[inline]
pub(super) fn y_axis(q: Quat) -> Vec3 {
    // The second column of the rotation matrix.
    Vec3::new(2.0 * (q.x * q.y - q.w * q.z), 1.0 - 2.0 * (q.x * q.x + q.z * q.z), 2.0 * (q.y * q.z + q.w * q.x))
}

/// Moves the entries of the ranges to the front of a column and cuts off the rest. Whole ranges are moved at once,
/// because the nodes that stay form long contiguous stretches.
fn keep_ranges<T: Copy>(column: &mut Vec<T>, ranges: &[Range<usize>]) {
    let mut end = 0;
    for range in ranges {
        column.copy_within(range.clone(), end);
        end += range.len();
    }
    column.truncate(end);
}

/// A bud that shoots once it receives light, or becomes dormant.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bud {
    /// Node at whose end the bud sits.
    pub node: u32,
    /// Azimuth about the node, rad.
    pub azimuth: f32,
    /// Number at the node, from which the id of the bud's axis is derived.
    pub slot: u8,
    /// Years without light.
    pub age: u8,
    /// Light that it receives, relative to a fully lit tip.
    pub gathered: f32,
}

/// Intermediate results of a year by node, which later passes read; the buffers are reused from year to year.
#[derive(Debug, Clone, Default)]
pub(super) struct Scratch {
    /// Cell of the light field, for nodes with an open tip or buds.
    pub cell: Vec<u32>,
    /// Light of the continuation, or of the node itself if its tip is open.
    pub main: Vec<f32>,
    /// Light of all other children and buds.
    pub side: Vec<f32>,
    /// Length of living wood above the base of the internode, m.
    pub wood: Vec<f32>,
    /// Length of the stretch without leaves and forks that begins at its end, m; negative if it is a fork.
    pub bare: Vec<f32>,
    /// Vigour of the node divided by its weighted light; multiplied by the light and weight of a child or bud, it gives
    /// their vigour.
    pub factor: Vec<f32>,
    /// Light lost since last year by death and cuts above.
    pub lost_light: Vec<f32>,
    /// Sum of the areas of living children.
    pub area: Vec<f32>,
    /// Length of the axis beyond its end, m.
    pub beyond: Vec<f32>,
    /// First moments along x and z, and (y) the mass, of the wood above the base of the internode; finally only the moments about
    /// that base.
    pub weight: Vec<Vec3>,
    /// Rotation by bending and righting in this year, accumulated from the root to the node.
    pub turn: Vec<Quat>,
}

/// A subtree that was lost since last year.
#[derive(Debug, Clone, Copy)]
pub(super) struct Loss {
    /// Node that carried it.
    pub at: u32,
    /// Light that it had gathered last year.
    pub light: f32,
}

/// A cut through an internode, which a clip must show.
#[derive(Debug, Clone, Copy)]
pub(super) struct CutThrough {
    /// Node whose internode was shortened.
    pub node: u32,
    /// Year of the tree's life in which it was cut.
    pub year: u16,
    /// Length of the internode before the cut, m.
    pub length: f32,
}

/// Part of a year at which a clip shows that branches and leaves fall and that wood is cut, which the model does at the beginning
/// of the year: by then the leaves of the new year have half of their size. With a smaller value crowns thin out in between, with
/// a larger one they become too dense.
pub(super) const FALL_DELAY: f32 = 0.15;

impl CutThrough {
    /// Age of the tree at which a clip shows the cut, years; the model makes it at the beginning of its year.
    pub fn time(&self) -> f32 {
        f32::from(self.year) - 1.0 + FALL_DELAY
    }
}

/// State of a tree that grows year by year, and its habit.
#[derive(Debug, Clone)]
pub(super) struct Tree {
    /// Name of the plant in the scene, for messages.
    pub name: String,
    pub habit: Habit,
    /// Key of its random draws, from seed and id of the plant.
    pub key: u64,
    /// Place of its base in the scene, m.
    pub base: Vec3,
    /// Position of its base relative to that of the stand's first tree, the origin of the field of light, m.
    pub offset: Vec3,
    /// Year of the field in which it is sown.
    pub sown: u32,
    /// Its age in full years.
    pub year: u32,
    /// Part of the last year that is shown, 0 to 1; 1: the whole year.
    pub part: f32,
    pub nodes: Nodes,
    pub axis_ids: Vec<u64>,
    /// Sine and cosine of the elevation towards which each axis turns, by index as [`Self::axis_ids`].
    pub axis_elevations: Vec<[f32; 2]>,
    pub buds: Vec<Bud>,
    pub neighbours: Option<Neighbours>,
    pub prunes: Vec<Prune>,
    /// Number of nodes marked as fallen that are still in the arrays.
    pub fallen: usize,
    /// Number of successive years without any light.
    pub dark: u8,
    /// Year of its life that was the first of two without light, after which it died.
    pub died: Option<u32>,
    /// Year of its life whose cuts left it neither tips nor buds; `None` if it has grown since, or if there were no
    /// such cuts.
    pub bared: Option<u32>,
    /// Subtrees lost this year, at whose nodes dormant buds may wake.
    pub losses: Vec<Loss>,
    /// Cuts through internodes, in the order of years; kept while the tree is recorded. Those of the tree in a finished record are
    /// sorted by node.
    pub cuts: Vec<CutThrough>,
    /// Whether the tree is recorded: its fallen nodes then stay in the arrays.
    pub recorded: bool,
    pub scratch: Scratch,
}

impl Tree {
    /// Cuts through the internode of a node, in the order of years; only of the tree in a finished record, where they are sorted by
    /// node.
    pub(super) fn cuts_through(&self, i: usize) -> impl Iterator<Item = &CutThrough> {
        let first = self.cuts.partition_point(|cut| (cut.node as usize) < i);
        self.cuts[first..].iter().take_while(move |cut| cut.node as usize == i)
    }

    /// `year` in the integer type in which nodes store the year of their death.
    pub(super) fn stored_year(&self) -> u16 {
        // Ages end at 500 years (key `age`), far below the year 65,535, which marks a node that has not fallen.
        u16::try_from(self.year).unwrap_or(u16::MAX - 1)
    }

    /// A seed with one internode for each stem. `seed`, `id`: seed and id of the plant; `base`: position in the scene,
    /// m.
    pub fn new(name: &str, habit: &Habit, seed: u64, id: u32, base: Vec3) -> Self {
        let mut tree = Self {
            name: name.to_owned(),
            habit: habit.clone(),
            key: Rng::key(seed, &["years".into(), id.into()]),
            base,
            offset: Vec3::ZERO,
            sown: 0,
            year: 0,
            part: 1.0,
            nodes: Nodes::default(),
            axis_ids: Vec::new(),
            axis_elevations: Vec::new(),
            buds: Vec::new(),
            neighbours: None,
            prunes: Vec::new(),
            fallen: 0,
            dark: 0,
            died: None,
            bared: None,
            losses: Vec::new(),
            cuts: Vec::new(),
            recorded: false,
            scratch: Scratch::default(),
        };
        let stems = whole(habit.stems).max(1);
        for i in 0..stems {
            tree.add_stem(i, stems, mix64(&[seed, u64::from(id), word("stem"), u64::from(i)]));
        }
        tree
    }

    /// Adds the seed internode of a stem.
    /// Own: with `stem_years` some sprout later, and stay stubs until then. Stems stand at golden-angle azimuths, at
    /// the distance spread sqrt((i + 0.5) / n), tilted outwards by tilt (0.4 + 0.9 U) sqrt((i + 0.5) / n).
    fn add_stem(&mut self, i: u16, stems: u16, id: u64) {
        let habit = &self.habit;
        let mut draw = self.draw(id, Purpose::Stem);
        let azimuth =
            if stems > 1 { f32::from(i) * math::GOLDEN_ANGLE_F32 } else { draw.unit_f32() * std::f32::consts::TAU };
        // sqrt((i + 0.5) / n): with the golden angle this covers the disc evenly (Vogel's spiral).
        let out = if stems > 1 { ((f32::from(i) + 0.5) / f32::from(stems)).sqrt() } else { 0.0 };
        let level = Vec3::new(math::cos_f32(azimuth), 0.0, math::sin_f32(azimuth));
        let tilt = (habit.tilt * (0.4 + 0.9 * draw.unit_f32()) * out).to_radians();
        let d = Vec3::Y * math::cos_f32(tilt) + level * math::sin_f32(tilt);
        let q = math::rotation_between(Vec3::Y, d)
            * Quat::from_xyzw(0.0, math::sin_f32(0.5 * azimuth), 0.0, math::cos_f32(0.5 * azimuth));
        let area = math::pow_f32(habit.tip_radius, habit.pipe_exponent);
        // Multiples of the golden ratio spread the late stems over the disc and over the years.
        let late = (f32::from(i) * GOLDEN_SHARE).fract() - SPROUT_AT_ONCE;
        let sprouts = (habit.stem_years * (late / (1.0 - SPROUT_AT_ONCE)).max(0.0)).ceil();
        let elevation = self.habit.elevation[0].to_radians();
        self.axis_ids.push(id);
        self.axis_elevations.push([math::sin_f32(elevation), math::cos_f32(elevation)]);
        self.nodes.push(Node {
            parent: NONE,
            axis: u32::from(i),
            index: 0,
            order: 0,
            flags: if sprouts > 0.0 { 0 } else { flag::OPEN },
            dormant: 0,
            woken: 0,
            starve: 0,
            death: 0,
            p: level * (habit.stem_spread * out) + d * SEED_LENGTH,
            q: q.normalize(),
            length: SEED_LENGTH,
            r: habit.tip_radius,
            area,
            lost: 0.0,
            path: SEED_LENGTH,
            s: SEED_LENGTH,
            moment: 0.0,
            birth: sprouts,
            azimuth: 0.0,
            light: 0.0,
            gathered: 1.0,
            vigour: 1.0,
        });
    }

    /// Opens the tips of the stems that sprout in the coming year.
    pub fn sprout(&mut self) {
        let nodes = &mut self.nodes;
        for i in 0..nodes.len() {
            if nodes.parent[i] != NONE {
                break;
            }
            let now = nodes.birth[i] > 0.0 && (nodes.birth[i] - self.year as f32).abs() < 0.5;
            if now && nodes.lives(i) && nodes.flags[i] & flag::CUT == 0 {
                nodes.flags[i] |= flag::OPEN;
            }
        }
    }

    /// The stream of random draws for a purpose at an internode or axis.
    #[inline]
    pub fn draw(&self, id: u64, purpose: Purpose) -> Rng {
        Rng::from_key(child(child(self.key, id), purpose as u64))
    }

    /// Stable id of an internode, from its axis and its number there.
    #[inline]
    pub fn node_id(&self, i: usize) -> u64 {
        child(self.axis_ids[self.nodes.axis[i] as usize], u64::from(self.nodes.index[i]))
    }

    /// One-sided area of the leaves that a node bears, m2: leaves of its open tip, and leaves along a young internode.
    #[inline]
    pub fn leaf_area(&self, i: usize) -> f32 {
        let habit = &self.habit;
        // Species without leaves along shoots bear leaves only at open tips.
        let open = self.nodes.flags[i] & flag::OPEN != 0;
        let tip = if open { habit.leaf_area_tip * self.share_at_tip(i) } else { 0.0 };
        let along = self.share_along(i);
        if along > 0.0 {
            tip + along * habit.leaf_area_of_shoot(self.nodes.birth[i]) * self.nodes.length[i]
        } else {
            tip
        }
    }

    /// Share of the leaves of an open tip that have unfolded, 0 to 1; below 1 only on an axis that begins in a year that is shown
    /// in part.
    #[inline]
    pub fn share_at_tip(&self, i: usize) -> f32 {
        if self.part < 1.0 && self.begins_this_year(i) { self.part } else { 1.0 }
    }

    /// Share of the leaves along an internode that it still bears, 0 to 1: leaves that it loses in a year that is shown in part
    /// fall over that year.
    #[inline]
    pub fn share_along(&self, i: usize) -> f32 {
        let year = self.year as f32;
        if self.bears_along_in(i, year) {
            1.0
        } else if self.part < 1.0 && self.bears_along_in(i, year - 1.0) {
            1.0 - self.part
        } else {
            0.0
        }
    }

    /// Whether an internode bears leaves along its length at the end of a year.
    #[inline]
    fn bears_along_in(&self, i: usize, year: f32) -> bool {
        let (years, most) = (year - self.nodes.birth[i], self.habit.leaf_years);
        // Tests whether the full years are below `most`; for most internodes this needs no rounding.
        self.habit.leaf_area_shoot > 0.0 && (years < most || years < most + 1.0 && years.floor() < most)
    }

    /// Whether all internodes of the axis up to one of them have grown in the last year.
    fn begins_this_year(&self, i: usize) -> bool {
        let nodes = &self.nodes;
        let mut at = i;
        while nodes.birth[at] > self.year as f32 - 1.0 {
            match nodes.axis.get(nodes.parent[at] as usize) {
                Some(axis) if *axis == nodes.axis[i] => at = nodes.parent[at] as usize,
                _ => return true,
            }
        }
        false
    }

    /// Removes the fallen nodes from the arrays, and renumbers parents and buds.
    pub fn compact(&mut self) {
        let nodes = &mut self.nodes;
        let mut new_index = vec![NONE; nodes.len()];
        let mut ranges: Vec<Range<usize>> = Vec::new();
        let mut kept = 0;
        for (i, index) in new_index.iter_mut().enumerate() {
            if nodes.flags[i] & flag::FALLEN == 0 {
                *index = kept;
                kept += 1;
                match ranges.last_mut() {
                    Some(range) if range.end == i => range.end = i + 1,
                    _ => ranges.push(i..i + 1),
                }
            }
        }
        // Renumber the indices before the rows move. NONE lies beyond the array, so that roots keep it.
        for parent in &mut nodes.parent {
            if let Some(new) = new_index.get(*parent as usize) {
                *parent = *new;
            }
        }
        nodes.keep(&ranges);
        let index_of = |node: u32| new_index.get(node as usize).copied().unwrap_or(NONE);
        // Buds of removed nodes are removed too.
        self.buds.retain_mut(|bud| {
            bud.node = index_of(bud.node);
            bud.node != NONE
        });
        self.fallen = 0;
    }
}

/// An index of a node, axis or event; the limit of nodes lies far below 2^32.
#[inline]
#[allow(clippy::cast_possible_truncation, reason = "the limit of nodes keeps counts below 2^32")]
pub(super) fn index_of(i: usize) -> u32 {
    debug_assert!(i < NONE as usize, "a count beyond its limit");
    i as u32
}
