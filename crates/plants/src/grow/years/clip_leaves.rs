//! Leaves of a recorded tree: the times at which each unfolds and falls, and slots for as many leaves as are visible at once.
//! Own.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::{Quat, Vec3};

use super::plant::{BladeTurn, Foliage, MeanLeaf, NodeSite, PlacedLeaf, TreeFoliage};
use super::record::{GrowthRecord, Wood};
use super::tree::{FALL_DELAY, NONE as NO_NODE, Tree, index_of, y_axis};
use osier_base::Result;
use osier_base::limits::Limits;
use osier_base::math;
use osier_base::rng::{mix64, word};
use osier_scene::plant::{NONE, Organ, Plant};

/// When leaves begin to unfold and to fall, as parts of a year.
const SPRING: f32 = 0.05;
const AUTUMN: f32 = 0.8;
/// Years that a leaf takes to unfold and to fall. At 24 frames a year its size grows by 0.21 and shrinks by 0.28 a frame.
const UNFOLDING: f32 = 0.2;
const FALLING: f32 = 0.15;
/// Overlap of two successive leaves of a species whose leaves stay over winter, years: the new leaf begins to unfold this long
/// before the old one begins to fall, so that the area of both together is never below that of one leaf.
const OVERLAP: f32 = FALL_DELAY - SPRING;
/// Least time, years, from the unfolding of such a leaf to the end of its year: more than `OVERLAP` and `FALLING` together.
const LEAD: f32 = 0.26;
/// Latest part of its year in which a leaf that falls in autumn begins to unfold.
const LATEST_SPRING: f32 = 0.55;
/// Part of a year in which the leaves of a tip turn to the direction of its new shoot.
const TURNING: f32 = 0.25;
/// Frames between the fall of a leaf and the next leaf in its slot, so that motion blur does not join them.
const FRAMES_BETWEEN: f64 = 2.0;
/// Leaves that live longer than this stay over winter, years: `leaf_years` are rounded up, and the tree of each age bears as many years
/// of leaves.
const DECIDUOUS_YEARS: f32 = 1.0;
/// Age of fall of a leaf that does not fall within the record.
const STAYS: f32 = f32::INFINITY;

/// Whether the leaves of a clip follow the seasons.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ClipLeaves {
    /// Leaves unfold in spring and fall in autumn on species whose leaves live one year; leaves of other species
    /// (`leaf_years` above 1) fall at the end of their last year, when new ones have unfolded.
    Seasons,
    /// Crowns are in leaf all year: tips keep their leaves as they grow.
    Summer,
}

/// How leaves appear and vanish in a clip, and the time between its frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClipOptions {
    /// Whether leaves follow the seasons or remain all year.
    pub leaves: ClipLeaves,
    /// Years of growth between two frames; the sign has no effect.
    pub frame_years: f64,
}

/// Pose and size of a leaf at one time of a clip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeafNow {
    /// Pivot, plant space, m.
    pub position: Vec3,
    /// Rotation into plant space.
    pub orientation: Quat,
    /// Factor on the size of the plant's organ; 0 if the leaf does not exist at this time.
    pub size: f32,
}

/// Site of a leaf, which determines how it moves as the tree grows.
#[derive(Debug, Clone, Copy)]
enum LeafSite {
    /// In the rosette at the tip of an axis, which moves with the tip.
    Tip { axis: u32 },
    /// Along an internode, where it stays.
    Along { node: u32 },
}

/// A leaf from its unfolding to its fall.
#[derive(Debug, Clone, Copy)]
struct LeafLife {
    site: LeafSite,
    /// Number of the leaf at its site, and number of leaves there.
    k: u16,
    count: u16,
    /// Ages at which it begins to unfold and to fall, years.
    unfolds: f32,
    falls: f32,
}

/// A node that becomes the tip of an axis in a year.
#[derive(Debug, Clone, Copy)]
struct TipStop {
    axis: u32,
    year: f32,
    node: u32,
}

pub(super) struct SlotOptions<'a> {
    pub clip: ClipOptions,
    /// Limits the number of slots.
    pub limits: &'a Limits,
}

/// Slots of leaves. The organ of a slot shows several leaves in succession.
#[derive(Debug, Clone)]
pub(super) struct LeafSlots {
    foliage: Foliage,
    mean: MeanLeaf,
    /// Tips of all axes, sorted by axis, then by year.
    tips: Vec<TipStop>,
    /// Index of the first tip of each axis, then the number of all tips.
    first_tip: Vec<u32>,
    /// Length of the internode of each node before any cut, m.
    whole_lengths: Vec<f32>,
    /// Lives sorted by slot, then by time.
    lives: Vec<LeafLife>,
    /// Index of the first life of each slot, then the number of all lives.
    first_life: Vec<u32>,
    /// Size factor of the plant's organ in each slot.
    scales: Vec<f32>,
    /// Pose of each slot before its first leaf: that of the plant's organ, with size 0. It does not move, so that formats which
    /// omit redundant samples write none of it.
    pub waiting: Vec<LeafNow>,
}

impl LeafSlots {
    /// Finds the lives of all leaves that the clip shows, and assigns them to slots.
    /// # Errors
    /// `Limit` for more slots than organs are allowed.
    pub fn new(record: &GrowthRecord, leaves: &TreeFoliage<'_>, options: SlotOptions<'_>) -> Result<Self> {
        let tree = &record.tree;
        let mut tips: Vec<TipStop> = (0..tree.nodes.len())
            .filter(|i| record.is_shown(*i) && record.last_open_year(*i).is_some())
            .map(|i| TipStop { axis: tree.nodes.axis[i], year: record.first_year(i), node: index_of(i) })
            .collect();
        // Nodes are stored in the order in which they grew and the sort is stable, so that the tips of an axis stay in the order
        // of years.
        tips.sort_by_key(|tip| tip.axis);
        let mut first_tip = vec![0; tree.axis_ids.len() + 1];
        tips.iter().for_each(|tip| first_tip[tip.axis as usize + 1] += 1);
        for i in 1..first_tip.len() {
            first_tip[i] += first_tip[i - 1];
        }
        // The cuts of a node are in the order of years. Assign them in reverse, so that the first cut determines the length.
        let mut whole_lengths = tree.nodes.length.clone();
        tree.cuts.iter().rev().for_each(|cut| whole_lengths[cut.node as usize] = cut.length);
        // After prefix sums over the counts, `first_tip[a]..first_tip[a + 1]` are the tips of axis a.
        let mut slots = Self {
            foliage: leaves.foliage.clone(),
            mean: leaves.mean,
            tips,
            first_tip,
            whole_lengths,
            lives: Vec::new(),
            first_life: Vec::new(),
            scales: Vec::new(),
            waiting: Vec::new(),
        };
        let mut lives = slots.all_lives(record, options.clip.leaves);
        let [first, last] = record.ages();
        // Only leaves that are visible between the first and the last frame need a slot.
        lives.retain(|life| life.unfolds < last && life.falls + FALLING > first);
        slots.share_places(record, lives, options)?;
        Ok(slots)
    }

    fn leaves(&self) -> TreeFoliage<'_> {
        TreeFoliage { foliage: &self.foliage, mean: self.mean }
    }

    fn tips_of(&self, axis: u32) -> &[TipStop] {
        &self.tips[self.first_tip[axis as usize] as usize..self.first_tip[axis as usize + 1] as usize]
    }

    /// Lives of the leaves of all tips and internodes of the record, by site.
    fn all_lives(&self, record: &GrowthRecord, come_and_go: ClipLeaves) -> Vec<LeafLife> {
        let tree = &record.tree;
        let sheds = come_and_go == ClipLeaves::Seasons && tree.habit.leaf_years <= DECIDUOUS_YEARS;
        let leaves = self.leaves();
        let mut lives = Vec::new();
        for axis in 0..index_of(tree.axis_ids.len()) {
            self.add_tip_lives(record, axis, sheds, &mut lives);
        }
        for i in (0..tree.nodes.len()).filter(|i| tree.habit.leaf_area_shoot > 0.0 && record.is_shown(*i)) {
            let site = LeafSite::Along { node: index_of(i) };
            let [unfolds, falls] = self.shoot_life(record, i, sheds);
            let whole = self.whole_lengths[i];
            let count = narrow_count(leaves.count_along(tree, i, whole));
            let cuts = cuts_of_leaves(tree, i);
            lives.extend((0..count).filter_map(|k| {
                // Leaves beyond a cut fall with it.
                let at = whole * (f32::from(k) + 0.5) / f32::from(count);
                let cut = cuts.iter().find(|cut| cut.left < at).map_or(STAYS, |cut| cut.time);
                (cut > unfolds).then_some(LeafLife { site, k, count, unfolds, falls: falls.min(cut) })
            }));
        }
        lives
    }

    /// Adds the lives of the rosette of an axis: one life per leaf as long as the axis has a tip or, if leaves are shed, one for
    /// each year.
    fn add_tip_lives(&self, record: &GrowthRecord, axis: u32, sheds: bool, lives: &mut Vec<LeafLife>) {
        let tree = &record.tree;
        let tips = self.tips_of(axis);
        let (Some(first), Some(last)) = (tips.first(), tips.last()) else { return };
        let count = narrow_count(self.leaves().count_at_tip(tree, axis));
        let open_until = record.last_open_year(last.node as usize).unwrap_or(0.0);
        let mut add = |unfolds: f32, falls: f32| {
            let site = LeafSite::Tip { axis };
            lives.extend((0..count).map(|k| LeafLife { site, k, count, unfolds, falls }));
        };
        // A stem emerges from the ground at the end of its year, without a shoot; other axes begin with a shoot.
        let is_stem = tree.nodes.parent[first.node as usize] == NO_NODE;
        if sheds {
            // One rosette each year, as long as the axis has an open tip.
            let mut year = first.year + f32::from(u8::from(is_stem));
            while year <= open_until {
                add(year - 1.0 + SPRING, year - 1.0 + AUTUMN);
                year += 1.0;
            }
        } else {
            let unfolds = if is_stem { first.year - UNFOLDING } else { first.year - 1.0 + SPRING };
            add(unfolds, end_of_life(record, open_until));
        }
    }

    /// Ages at which the leaves along an internode begin to unfold and to fall, years.
    fn shoot_life(&self, record: &GrowthRecord, i: usize, sheds: bool) -> [f32; 2] {
        let tree = &record.tree;
        let year = record.first_year(i).max(1.0);
        let born = record.start(i).max(year - 1.0);
        if sheds {
            // An internode that grows late in the summer unfolds its leaves at once, but not after `LATEST_SPRING`, so that they
            // are fully unfolded before they fall.
            return [born.clamp(year - 1.0 + SPRING, year - 1.0 + LATEST_SPRING), year - 1.0 + AUTUMN];
        }
        let years = tree.habit.leaf_years.ceil().max(1.0);
        // The new leaf unfolds early enough for the leaf before it to have fallen by the end of the year.
        let unfolds = born.min(year - LEAD);
        let living = record.last_living_year(i);
        // Three cases: the branch dies first, the leaf does not fall within the record, or the leaf falls at its age.
        let falls = if living < year + years - 1.0 {
            end_of_life(record, living)
        } else if year + years > tree.year as f32 {
            STAYS
        } else {
            unfolds + years + OVERLAP
        };
        // No leaf outlives its branch.
        let falls = record.fall_window(i).map_or(falls, |[start, _]| falls.min(start));
        [unfolds, falls]
    }

    /// Assigns each life to a slot that is free at its beginning, or to a new slot; each slot has one prototype.
    fn share_places(&mut self, record: &GrowthRecord, lives: Vec<LeafLife>, options: SlotOptions<'_>) -> Result<()> {
        let wood = record.wood_of_all();
        let last = record.ages()[1];
        let mut sorted: Vec<(LeafLife, PlacedLeaf)> =
            lives.into_iter().map(|life| (life, self.placed(record, &wood, &life, last).leaf)).collect();
        // Greedy interval colouring: lives in the order of their beginning, each in the slot that became free first. The number
        // of slots is then the largest number of leaves that are visible at once.
        sorted.sort_by_key(|(life, _)| ticks(life.unfolds));
        let pause = FALLING + math::narrow(FRAMES_BETWEEN * options.clip.frame_years.abs());

        // For each prototype, a heap of its slots by the time from which they are free, the earliest on top.
        let mut free: Vec<BinaryHeap<Reverse<(i64, u32)>>> = vec![BinaryHeap::new(); self.foliage.organ().meshes.len()];
        let mut places: Vec<u32> = Vec::with_capacity(sorted.len());
        self.scales.clear();
        for (life, leaf) in &sorted {
            let pool = &mut free[usize::from(leaf.proto)];
            let place = match pool.peek() {
                Some(Reverse((from, place))) if *from <= ticks(life.unfolds) => {
                    let place = *place;
                    pool.pop();
                    place
                }
                _ => {
                    self.scales.push(leaf.scale);
                    index_of(self.scales.len() - 1)
                }
            };
            places.push(place);
            // A leaf that does not fall keeps its slot.
            if life.falls < STAYS {
                pool.push(Reverse((ticks(life.falls + pause), place)));
            }
        }
        let what = format!("leaves of plant \"{}\" that its clip shows at once", record.tree.name);
        options.limits.check("organs", self.scales.len() as u64, &what)?;

        // A counting sort by slot, which keeps the order of time.
        self.first_life = vec![0; self.scales.len() + 1];
        places.iter().for_each(|place| self.first_life[*place as usize + 1] += 1);
        for i in 1..self.first_life.len() {
            self.first_life[i] += self.first_life[i - 1];
        }
        let mut order: Vec<u32> = (0..index_of(sorted.len())).collect();
        order.sort_by_key(|i| places[*i as usize]);
        self.lives = order.into_iter().map(|i| sorted[i as usize].0).collect();
        Ok(())
    }

    fn lives_of(&self, place: usize) -> &[LeafLife] {
        &self.lives[self.first_life[place] as usize..self.first_life[place + 1] as usize]
    }

    /// The leaf that a slot shows at an age: the present one, otherwise the next one, otherwise the last one.
    fn life_at(&self, place: usize, age: f32) -> Option<&LeafLife> {
        let lives = self.lives_of(place);
        let begun = lives.partition_point(|life| life.unfolds <= age);
        let current = begun.checked_sub(1).and_then(|k| lives.get(k));
        let is_there = current.is_some_and(|life| age < life.falls + FALLING);
        if is_there { current } else { lives.get(begun).or(current) }
    }

    /// All leaves at an age, by slot.
    pub fn leaves_at(&self, record: &GrowthRecord, wood: &Wood, age: f32) -> Vec<LeafNow> {
        let absent = LeafNow { position: Vec3::ZERO, orientation: Quat::IDENTITY, size: 0.0 };
        let now = |place: usize| {
            let Some(life) = self.life_at(place, age) else { return absent };
            if let Some(waiting) = self.waiting.get(place).filter(|_| age < self.lives_of(place)[0].unfolds) {
                return *waiting;
            }
            // Both ramps are linear. The rotation follows the wood, so that only the size shows how far a leaf has unfolded.
            let unfolded = ((age - life.unfolds) / UNFOLDING).clamp(0.0, 1.0);
            let left = 1.0 - ((age - life.falls) / FALLING).clamp(0.0, 1.0);
            let site = self.placed(record, wood, life, age);
            LeafNow {
                position: site.position + site.leaf.q * Vec3::Y * site.leaf.petiole,
                orientation: site.leaf.q,
                size: unfolded * left * site.leaf.scale / self.scales[place].max(f32::MIN_POSITIVE),
            }
        };
        (0..self.scales.len()).map(now).collect()
    }

    /// The slots as organs of a plant, at the sites of their last leaves. `at`: for each node of the tree, its axis and arc
    /// length in the plant.
    pub fn organs(&self, plant: &Plant, record: &GrowthRecord, all: &Wood, at: &[NodeSite]) -> Vec<Organ> {
        let last = record.ages()[1];
        let mut organs = Vec::with_capacity(self.scales.len());
        for place in 0..self.scales.len() {
            // Each slot gives one organ, since it has a life, and each visible node lies on an axis.
            let Some(life) = self.life_at(place, last) else { continue };
            let site = self.placed(record, all, life, last);
            let Some(on) = at.get(site.node as usize).filter(|on| on.axis != NONE) else { continue };
            let axis = &plant.axes[on.axis as usize];
            let frame = plant.frame(axis, on.s);
            let back = frame.q.inverse();
            organs.push(Organ {
                id: mix64(&[record.seed, u64::from(record.id), word("leaf-place"), place as u64]),
                axis: on.axis,
                s: on.s.clamp(0.0, axis.length),
                offset: back * (site.position - frame.p),
                q: (back * site.leaf.q).normalize(),
                scale: self.scales[place],
                proto: site.leaf.proto,
                petiole: site.leaf.petiole,
                tint: site.leaf.tint,
                birth: 0.0,
            });
        }
        debug_assert_eq!(organs.len(), self.scales.len(), "a place without an organ");
        organs
    }

    /// Position and rotation of a leaf on given wood at an age, years.
    fn placed(&self, record: &GrowthRecord, wood: &Wood, life: &LeafLife, age: f32) -> LeafOnWood {
        let tree = &record.tree;
        let leaves = self.leaves();
        let (k, count) = (u32::from(life.k), u32::from(life.count));
        let has_needles = matches!(self.foliage, Foliage::Needles(_));
        let stand = match life.site {
            LeafSite::Tip { axis } => {
                let (node, q) = self.tip_at(axis, wood, age);
                let id = TreeFoliage::tip_leaf_id(tree, axis, k);
                if has_needles {
                    let turn = TreeFoliage::needle_turn(tree, node as usize, k, count);
                    LeafStand { node, q, id, turn, behind: leaves.tuft_behind(k, count) }
                } else {
                    let turn = TreeFoliage::tip_leaf_turn(tree, axis, k, count);
                    LeafStand { node, q, id, turn, behind: leaves.rosette_behind(k) }
                }
            }
            LeafSite::Along { node } => {
                let i = node as usize;
                let (q, id) = (wood.q[i], TreeFoliage::shoot_leaf_id(tree, i, k));
                // The rest of an internode that was cut keeps its leaves in place; `beyond` is the length that was cut off.
                let (whole, length) = (self.whole_lengths[i], wood.length[i]);
                let was_cut = whole > tree.nodes.length[i] && age >= tree.nodes.birth[i];
                let reach = if was_cut { whole } else { length };
                let beyond = reach - length;
                if has_needles {
                    let turn = TreeFoliage::needle_turn(tree, i, k, count);
                    LeafStand { node, q, id, turn, behind: leaves.needles_behind(k, count, reach) - beyond }
                } else {
                    let part = (k as f32 + 0.5) / count as f32;
                    let turn = TreeFoliage::shoot_leaf_turn(tree, i, k);
                    LeafStand { node, q, id, turn, behind: (1.0 - part) * reach - beyond }
                }
            }
        };
        let i = stand.node as usize;
        let leaf = match has_needles {
            true => leaves.needle_piece(stand.id, stand.turn, stand.q),
            false => leaves.blade(stand.id, stand.turn, stand.q, wood.r[i] * wood.shown[i]),
        };
        LeafOnWood { node: stand.node, position: wood.p[i] - y_axis(wood.q[i]) * stand.behind, leaf }
    }

    /// The node that is the tip of an axis at an age, and the frame of its leaves.
    fn tip_at(&self, axis: u32, wood: &Wood, age: f32) -> (u32, Quat) {
        let tips = self.tips_of(axis);
        // The current year at this age; a tip that appeared in an earlier year has already turned.
        let year = age.ceil().max(1.0);
        let reached = tips.partition_point(|tip| tip.year <= year).max(1) - 1;
        let Some(tip) = tips.get(reached) else { return (0, Quat::IDENTITY) };
        let q = wood.q[tip.node as usize];
        let before = reached.checked_sub(1).and_then(|k| tips.get(k)).filter(|_| tip.year >= year);
        let Some(before) = before else { return (tip.node, q) };
        // In the year of its growth the rosette turns from the frame of the previous tip to that of the new one.
        let turned = ((age - (year - 1.0)) / TURNING).clamp(0.0, 1.0);
        (tip.node, math::nlerp(wood.q[before.node as usize], q, turned))
    }
}

/// Node, frame and angles that determine the pose of a leaf.
struct LeafStand {
    /// Node of the tree that bears the leaf.
    node: u32,
    /// Frame of the wood, relative to which the leaf is turned.
    q: Quat,
    id: u64,
    turn: BladeTurn,
    /// Distance of its base behind the end of the node's internode, m.
    behind: f32,
}

/// Place of a leaf on the wood at one moment of the clip.
struct LeafOnWood {
    /// Node of the tree that bears the leaf.
    node: u32,
    /// Point of the centreline at which it begins, from the tree's base, m.
    position: Vec3,
    leaf: PlacedLeaf,
}

/// A cut through an internode, as its leaves need it.
struct CutOfLeaves {
    /// Age of the tree at the cut, years.
    time: f32,
    /// Length of the internode after the cut, m.
    left: f32,
}

/// Cuts through the internode of a node, in the order of years.
fn cuts_of_leaves(tree: &Tree, i: usize) -> Vec<CutOfLeaves> {
    // Each later cut started from the length after the cut before it.
    let left = tree.cuts_through(i).skip(1).map(|next| next.length).chain([tree.nodes.length[i]]);
    tree.cuts_through(i).zip(left).map(|(cut, left)| CutOfLeaves { time: cut.time(), left }).collect()
}

/// Age at which a leaf begins to fall, if `last_year` is the last year at whose end it exists: in the spring after that year, or
/// with its branch if that falls.
fn end_of_life(record: &GrowthRecord, last_year: f32) -> f32 {
    if last_year >= record.tree.year as f32 { STAYS } else { last_year + FALL_DELAY }
}

/// A number of leaves at one site; more than 65,535 leaves of one internode would be cut to that number.
fn narrow_count(count: u32) -> u16 {
    u16::try_from(count).unwrap_or(u16::MAX)
}

/// Time in millionths of a year, which can be ordered.
#[allow(clippy::cast_possible_truncation, reason = "ages are at most 500 years")]
fn ticks(age: f32) -> i64 {
    (f64::from(age) * 1e6).round() as i64
}
