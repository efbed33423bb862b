//! Death and replacement: cuts, crown lifting, falling wood, new leaders, and dormant buds that break.

use glam::Vec3;

use super::light::LightField;
use super::season::Season;
use super::shoots::axis_elevation;
use super::site::Prune;
use super::tree::{Bud, CutThrough, Loss, NONE, Purpose, Tree, flag, index_of};
use osier_base::math::GOLDEN_ANGLE_F32;
use osier_base::noise;

/// Radius of dead wood that stands for `linger` years before it falls, m.
const LINGER_RADIUS: f32 = 0.02;
/// Longest time that dead wood stands, as a multiple of `linger`.
const LINGER_MAX: f32 = 1.5;
/// Year of the tree's life after which low branches of all axes are removed, not only those of the stem.
const LIFT_ALL_YEAR: u32 = 8;
/// Least and greatest height below which branches of an axis are removed, as a share of the clear stem; they differ, so that no
/// crown ends at one level.
const LIFT_ALL_SHARE: [f32; 2] = [0.35, 2.2];
/// Distance over which the height of removal varies horizontally, m: the whole foliage below a limb ends higher or lower.
const HEM_LENGTH: f32 = 2.2;
/// Period of the noise that varies this height, in units of [`HEM_LENGTH`]: longer than any crown.
const HEM_PERIOD: [i32; 2] = [256, 256];
/// Factor on this noise, whose magnitude is below 1 and mostly below 0.4.
const HEM_CONTRAST: f32 = 2.4;
/// Weight of the noise in the height of removal; the rest is a random draw for each axis.
const HEM_WEIGHT: f32 = 0.7;
/// Number of limbs above a low limb with which it is compared.
const LIMBS_ABOVE: usize = 4;
/// A limb stands alone if it bears fewer tips than this share of the mean of the limbs above it.
struct LoneShare {
    /// Share if the tips of the next limb are as high as those of the limb.
    level: f32,
    /// Increase of the share if the gap below the next limb is as high as the tree; in proportion for smaller gaps.
    per_gap: f32,
}

const LONE_SHARE: LoneShare = LoneShare { level: 0.3, per_gap: 6.0 };
/// Length of the axis below a dead tip in which a side axis may become the leader, m.
const SUCCESSION_REACH: f32 = 2.0;
/// Most dormant buds of a node.
const DORMANT_MAX: u8 = 3;
/// Most buds that wake at a node in a year.
const WAKE_AT_NODE: u8 = 2;
/// Most buds that wake in a year for a cut, or on an axis that receives more light.
const WAKE_AT_CUT: u8 = 6;
/// Share of its light that a node must lose for its dormant buds to wake.
const WAKE_LOSS: f32 = 0.5;
/// Gain of light at which dormant buds wake.
const WAKE_LIGHT: f32 = 0.3;
/// Years between two examinations of the light of dormant buds: crowns open slowly, and most wood has such buds.
const LOOK_YEARS: u32 = 3;
/// Number of the first woken bud at its node; smaller numbers belong to the buds that grew with the shoot.
const FIRST_WOKEN: u8 = 16;
/// Most buds that wake at a node in its life: their numbers end at 63.
const WOKEN_MAX: u8 = 47;
/// Smallest loss of light that wakes buds; smaller losses are those of starved tips.
const LEAST_LOSS: f32 = 0.01;
/// Steps of the bisection for the place of a cut: 1e-5 of an internode.
const BISECTIONS: usize = 16;
/// Shortest internode that a cut leaves, as a share of its length.
const SHORTEST_STUB: f32 = 0.02;

/// A branch of the stem.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limb {
    /// Its first internode.
    pub first: u32,
    /// Number of open tips that it bears.
    pub open_tips: u32,
    /// Mean height of its tips above the tree's base, m.
    pub height: f32,
}

impl Tree {
    /// Makes this year's cuts and, on one-stemmed trees, removes branches below the clear stem and limbs that stand alone above it.
    pub fn cut(&mut self, season: &Season) {
        let prunes: Vec<Prune> = self.prunes.iter().filter(|p| p.happens(season.year)).cloned().collect();
        for prune in &prunes {
            self.prune(prune);
        }
        let bears = !self.buds.is_empty() || (0..self.nodes.len()).any(|i| self.nodes.grows(i));
        // Keep the year of the cut that took the last tips and buds: later cuts find the tree without light (`dark` > 0).
        if bears {
            self.bared = None;
        } else if !prunes.is_empty() && self.dark == 0 {
            self.bared = Some(season.year);
        }
        if season.clear_stem > 0.0 {
            self.lift_crown(season);
            if season.year > LIFT_ALL_YEAR {
                self.shed_lone_limbs();
            }
        }
        if !self.losses.is_empty() {
            let nodes = &self.nodes;
            self.buds.retain(|bud| nodes.lives(bud.node as usize));
        }
    }

    /// Cuts through every internode that leaves the kept region, and removes all wood that the internode bears.
    fn prune(&mut self, prune: &Prune) {
        let mut severed = vec![false; self.nodes.len()];
        for i in 0..self.nodes.len() {
            let carrier_lost = severed.get(self.nodes.parent[i] as usize).copied().unwrap_or(false);
            if self.nodes.flags[i] & flag::FALLEN != 0 {
                severed[i] = true;
            } else if carrier_lost {
                self.mark_fallen(i);
                severed[i] = true;
            } else if !prune.keep.holds(self.base, self.nodes.p[i]) {
                let base = self.base;
                self.cut_through(i, |p| prune.keep.holds(base, p));
                severed[i] = true;
            }
        }
        let nodes = &mut self.nodes;
        // The buds at the end of an internode that was cut through are lost too.
        self.buds.retain(|bud| !severed[bud.node as usize]);
        for (dormant, _) in nodes.dormant.iter_mut().zip(&severed).filter(|(_, severed)| **severed) {
            *dormant = 0;
        }
    }

    /// Shortens an internode to the point at which it leaves the kept region, or removes it if almost all of it is outside.
    fn cut_through(&mut self, i: usize, holds: impl Fn(Vec3) -> bool) {
        let (base, d, length) = (self.nodes.base(i), self.nodes.direction(i), self.nodes.length[i]);
        // Bisection for the last point inside the region.
        let (mut low, mut high) = (0.0_f32, 1.0_f32);
        for _ in 0..BISECTIONS {
            let middle = 0.5 * (low + high);
            if holds(base + d * (length * middle)) { low = middle } else { high = middle }
        }
        let is_root = self.nodes.parent[i] == NONE;
        if low < SHORTEST_STUB && !is_root {
            self.remove_subtree(i);
            return;
        }
        // The root always stays as a stump.
        let part = low.max(SHORTEST_STUB);
        if self.recorded {
            self.cuts.push(CutThrough { node: index_of(i), year: self.stored_year(), length });
        }
        let nodes = &mut self.nodes;
        let gone = length * (1.0 - part);
        nodes.length[i] = length * part;
        nodes.p[i] = base + d * nodes.length[i];
        nodes.path[i] -= gone;
        nodes.s[i] -= gone;
        nodes.flags[i] = nodes.flags[i] & !(flag::OPEN | flag::SHORT) | flag::CUT;
        self.losses.push(Loss { at: index_of(i), light: nodes.gathered[i] });
    }

    /// Removes an internode that has a parent, and its subtree with it.
    fn remove_subtree(&mut self, i: usize) {
        let nodes = &mut self.nodes;
        if nodes.lives(i) {
            nodes.lost[nodes.parent[i] as usize] += self.habit.pipe_memory * nodes.area[i];
            self.losses.push(Loss { at: nodes.parent[i], light: nodes.gathered[i] });
        }
        self.mark_fallen(i);
    }

    fn mark_fallen(&mut self, i: usize) {
        self.nodes.flags[i] |= flag::FALLEN;
        self.fallen += 1;
    }

    /// Removes low branches: side axes of the stem below the clear stem and, in older trees, side axes that hang down
    /// from any branch below [`Self::lift_share`] of the clear stem.
    fn lift_crown(&mut self, season: &Season) {
        let lift = season.clear_stem;
        let highest = if season.year > LIFT_ALL_YEAR { LIFT_ALL_SHARE[1] * lift } else { f32::NEG_INFINITY };
        // Skip higher nodes: they are neither the first internode of a low branch, nor do they hang low enough.
        let reach = lift.max(highest) + self.habit.internode.iter().copied().fold(0.0, f32::max);
        let mut any = false;
        for i in 0..self.nodes.len() {
            let nodes = &self.nodes;
            if nodes.p[i].y >= reach || nodes.flags[i] & flag::FALLEN != 0 || nodes.parent[i] == NONE {
                continue;
            }
            let parent = nodes.parent[i] as usize;
            let on_stem = nodes.flags[i] & flag::MAIN == 0 && nodes.order[parent] == 0 && nodes.s[parent] < lift;
            // Limbs that rise from the stem stay; axes that hang down from them are removed.
            let sinks = nodes.order[i] > 0 && nodes.p[i].y < nodes.p[parent].y;
            let low = sinks && nodes.p[i].y < highest && nodes.flags[parent] & flag::FALLEN == 0;
            let hangs = low && nodes.p[i].y < lift * self.lift_share(i);
            if on_stem || hangs {
                self.remove_subtree(i);
                any = true;
            }
        }
        if any {
            self.fall_with_carriers();
        }
    }

    /// Marks all wood on a removed branch as fallen.
    fn fall_with_carriers(&mut self) {
        for i in 0..self.nodes.len() {
            let carrier = self.nodes.flags.get(self.nodes.parent[i] as usize).copied().unwrap_or(0);
            if carrier & flag::FALLEN != 0 && self.nodes.flags[i] & flag::FALLEN == 0 {
                self.mark_fallen(i);
            }
        }
    }

    /// Removes limbs that stand alone below the crown: beginning with the lowest, those that bear few tips compared with the
    /// [`LIMBS_ABOVE`] limbs above them. The farther a limb is below the next one, the more tips it must bear. Own: the crown
    /// shades limbs that live below it.
    fn shed_lone_limbs(&mut self) {
        let limbs = self.limbs();
        let top = limbs.iter().fold(0.0_f32, |top, limb| top.max(limb.height));
        let this_year = self.year as f32;
        let mut any = false;
        for (k, limb) in limbs.iter().enumerate() {
            let Some(above) = limbs.get(k + 1..k + 1 + LIMBS_ABOVE) else { break };
            let first = limb.first as usize;
            if this_year - self.nodes.birth[first] < self.habit.shed_age {
                continue;
            }
            let mean = above.iter().map(|limb| limb.open_tips as f32).sum::<f32>() / LIMBS_ABOVE as f32;
            let gap = above.first().map_or(0.0, |next| next.height - limb.height) / top.max(1e-6);
            if limb.open_tips as f32 >= mean * (LONE_SHARE.level + LONE_SHARE.per_gap * gap) {
                break;
            }
            self.remove_subtree(first);
            any = true;
        }
        if any {
            self.fall_with_carriers();
        }
    }

    /// The living limbs of the stem that bear open tips, from the lowest to the highest.
    pub fn limbs(&self) -> Vec<Limb> {
        let nodes = &self.nodes;
        let mut limbs: Vec<Limb> = Vec::new();
        // Index of the limb to which each node belongs.
        let mut of_node = vec![NONE; nodes.len()];
        for i in (0..nodes.len()).filter(|i| nodes.lives(*i)) {
            let Some(&order) = nodes.order.get(nodes.parent[i] as usize) else { continue };
            of_node[i] = if order == 0 && nodes.order[i] > 0 {
                limbs.push(Limb { first: index_of(i), open_tips: 0, height: 0.0 });
                index_of(limbs.len() - 1)
            } else {
                of_node[nodes.parent[i] as usize]
            };
            if nodes.grows(i)
                && let Some(limb) = limbs.get_mut(of_node[i] as usize)
            {
                limb.open_tips += 1;
                limb.height += nodes.p[i].y;
            }
        }
        limbs.retain(|limb| limb.open_tips > 0);
        for limb in &mut limbs {
            limb.height /= limb.open_tips as f32;
        }
        limbs.sort_by(|a, b| a.height.total_cmp(&b.height).then(a.first.cmp(&b.first)));
        limbs
    }

    /// Height below which a node is removed, as a share of the clear stem. It depends on the node's position and on a
    /// random draw for its axis, which is low more often than high.
    fn lift_share(&self, i: usize) -> f32 {
        let p = self.nodes.p[i] / HEM_LENGTH;
        let place = (0.5 + 0.5 * HEM_CONTRAST * noise::gradient2(self.key, [p.x, p.z], HEM_PERIOD)).clamp(0.0, 1.0);
        let draw = self.draw(self.axis_ids[self.nodes.axis[i] as usize], Purpose::Lift).unit_f32();
        let part = HEM_WEIGHT * place + (1.0 - HEM_WEIGHT) * draw * draw;
        LIFT_ALL_SHARE[0] + (LIFT_ALL_SHARE[1] - LIFT_ALL_SHARE[0]) * part
    }

    /// Marks the wood that dead wood bears as dead, and lets dead wood fall after it has stood for its time.
    pub fn shed_dead_wood(&mut self) {
        let linger = self.habit.linger;
        let year = self.year as f32;
        // The stems of a dead tree stay.
        let some_stem_lives = (0..self.nodes.len()).any(|i| self.nodes.parent[i] == NONE && self.nodes.lives(i));
        for i in 0..self.nodes.len() {
            let nodes = &mut self.nodes;
            if nodes.flags[i] & flag::FALLEN != 0 || nodes.parent[i] == NONE && !some_stem_lives {
                continue;
            }
            let parent = nodes.parent[i] as usize;
            let carrier = nodes.flags.get(parent).copied().unwrap_or(0);
            if carrier & flag::DEAD != 0 && nodes.flags[i] & flag::DEAD == 0 {
                nodes.flags[i] |= flag::DEAD;
                nodes.death[i] = nodes.death[parent];
            }
            let dead = nodes.flags[i] & flag::DEAD != 0;
            // Wood that would stand for less than a year falls in the year of its death, so that bare twigs do not hang in summer
            // crowns.
            let stands = linger * (nodes.r[i] / LINGER_RADIUS).min(LINGER_MAX);
            if carrier & flag::FALLEN != 0 || dead && year - f32::from(nodes.death[i]) + 1.0 > stands {
                self.mark_fallen(i);
            }
        }
    }

    /// Gives a new leader to each axis whose tip died: the living side axis with the largest vigour within [`SUCCESSION_REACH`]
    /// below the tip becomes its continuation, and the orders of its whole subtree decrease by one. Returns whether any axis got
    /// a leader.
    pub fn replace_leaders(&mut self, season: &Season) -> bool {
        // Mark the nodes below each dead tip with the index of that tip.
        let nodes = &self.nodes;
        let mut below = vec![NONE; nodes.len()];
        let mut best: Vec<u32> = Vec::new();
        for top in 0..nodes.len() {
            let leaderless = nodes.lives(top) && nodes.flags[top] & flag::OPEN == 0 && self.scratch.main[top] <= 0.0;
            if !leaderless {
                continue;
            }
            let event = index_of(best.len());
            best.push(NONE);
            let (mut i, mut away) = (top, 0.0);
            while away <= SUCCESSION_REACH {
                below[i] = event;
                if nodes.flags[i] & flag::MAIN == 0 {
                    break;
                }
                away += nodes.length[i];
                i = nodes.parent[i] as usize;
            }
        }
        if best.is_empty() {
            return false;
        }
        // Find the side axis with the largest vigour of last year; of equal ones the first.
        for i in 0..nodes.len() {
            let is_side = nodes.lives(i) && nodes.flags[i] & flag::MAIN == 0;
            let Some(&event) = below.get(nodes.parent[i] as usize) else { continue };
            let Some(best) = best.get_mut(event as usize).filter(|_| is_side) else { continue };
            if *best == NONE || nodes.vigour[i] > nodes.vigour[*best as usize] {
                *best = index_of(i);
            }
        }
        let mut leader_at = vec![NONE; nodes.len()];
        let mut any = false;
        for leader in best.into_iter().filter(|leader| *leader != NONE) {
            leader_at[nodes.parent[leader as usize] as usize] = leader;
            any = true;
        }
        if any {
            self.promote(&leader_at, season);
        }
        any
    }

    /// Makes side axes the continuations of their parents. `leader_at`: the new continuation of each node.
    fn promote(&mut self, leader_at: &[u32], season: &Season) {
        // For each node, the number by which to lower its order and the arc length to add to it; parents pass both to their
        // children.
        let mut down = vec![0_u8; self.nodes.len()];
        let mut ahead = vec![0.0_f32; self.nodes.len()];
        for i in 0..self.nodes.len() {
            let nodes = &mut self.nodes;
            let parent = nodes.parent[i] as usize;
            let Some(&leader) = leader_at.get(parent) else { continue };
            let was_main = nodes.flags[i] & flag::MAIN != 0;
            down[i] = down[parent];
            if was_main {
                ahead[i] = ahead[parent];
            }
            if leader == index_of(i) {
                nodes.flags[i] |= flag::MAIN;
                // The side axis takes the order of its parent, which has already been lowered.
                down[i] = nodes.order[i].saturating_sub(nodes.order[parent]);
                ahead[i] = nodes.s[parent];
            } else if leader != NONE && was_main {
                nodes.flags[i] &= !flag::MAIN;
            }
            nodes.order[i] = nodes.order[i].saturating_sub(down[i]);
            nodes.s[i] += ahead[i];
            // An axis of lower order turns to the elevation of its new order; all its internodes have one order.
            if down[i] > 0 && nodes.axis[i] != nodes.axis[parent] {
                let (axis, order) = (nodes.axis[i] as usize, usize::from(nodes.order[i]));
                let deviation = self.leaving_deviation(self.axis_ids[axis]);
                self.axis_elevations[axis] = axis_elevation(deviation, order, season);
            }
        }
    }

    /// Whether the light of dormant buds is examined in a year: every third year, if the species has such buds.
    pub fn looks_at_dormant_buds(&self, year: u32) -> bool {
        self.habit.epicormic > 0.0 && year.is_multiple_of(LOOK_YEARS)
    }

    /// Breaks dormant buds where a subtree has lost more than half of its light, and, in every third year, where the light at a
    /// node has risen by more than a threshold. Species without epicormic buds have none.
    pub fn wake_buds(&mut self, field: &LightField, season: &Season) {
        if self.habit.epicormic <= 0.0 {
            return;
        }
        let losses = std::mem::take(&mut self.losses);
        let mut woken = vec![0_u8; self.nodes.len()];
        self.wake_at_losses(&losses, season, &mut woken);
        if self.looks_at_dormant_buds(season.year) {
            self.wake_in_light(field, season, &mut woken);
        }
        self.losses = losses;
        self.losses.clear();
    }

    /// Own: at most [`WAKE_AT_CUT`] buds for each loss, from the cut towards the base, as far as more than half of the light is
    /// lost.
    fn wake_at_losses(&mut self, losses: &[Loss], season: &Season, woken: &mut [u8]) {
        let nodes = &self.nodes;
        let lost = &mut self.scratch.lost_light;
        let large = |loss: &&Loss| loss.light > LEAST_LOSS;
        for loss in losses.iter().filter(large) {
            let mut i = loss.at as usize;
            while i < nodes.len() {
                lost[i] += loss.light;
                i = nodes.parent[i] as usize;
            }
        }
        for loss in losses.iter().filter(large) {
            let (mut i, mut count) = (loss.at as usize, 0);
            while i < self.nodes.len() && count < WAKE_AT_CUT {
                // The light of last year is the sum of the remaining and the lost light; wood that died has none left.
                let left = if self.nodes.lives(i) { self.nodes.gathered[i] } else { 0.0 };
                let lost = self.scratch.lost_light[i];
                if lost <= WAKE_LOSS * (left + lost) {
                    break;
                }
                count += self.wake_at(i, WAKE_AT_CUT - count, season, woken);
                i = self.nodes.parent[i] as usize;
            }
        }
    }

    /// Own: at most [`WAKE_AT_CUT`] buds of an axis, the highest first.
    fn wake_in_light(&mut self, field: &LightField, season: &Season, woken: &mut [u8]) {
        let mut lighter: Vec<(u32, u32)> = Vec::new();
        for i in 0..self.nodes.len() {
            if self.nodes.dormant[i] == 0 || !self.nodes.lives(i) {
                continue;
            }
            let q = field.in_cell(self.scratch.cell[i]).q;
            if q - self.nodes.light[i] > WAKE_LIGHT {
                lighter.push((self.nodes.axis[i], index_of(i)));
            }
            self.nodes.light[i] = q;
        }
        // Sort by axis, and on each axis from its tip towards its base.
        lighter.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(b.1.cmp(&a.1)));
        for axis in lighter.chunk_by(|a, b| a.0 == b.0) {
            let mut count = 0;
            for (_, i) in axis {
                count += self.wake_at(*i as usize, WAKE_AT_CUT - count, season, woken);
            }
        }
    }

    /// Breaks up to `most` dormant buds of a node and returns their number. `woken`: number of buds that broke this year, by
    /// node.
    fn wake_at(&mut self, i: usize, most: u8, season: &Season, woken: &mut [u8]) -> u8 {
        let nodes = &mut self.nodes;
        let too_thick = nodes.r[i] >= self.habit.epicormic_radius;
        let taken_away = nodes.order[i] == 0 && nodes.s[i] < season.clear_stem;
        let last_order = usize::from(nodes.order[i]) + 1 >= self.habit.orders();
        if !nodes.lives(i) || too_thick || taken_away || last_order {
            return 0;
        }
        let room = (WAKE_AT_NODE - woken[i].min(WAKE_AT_NODE)).min(WOKEN_MAX.saturating_sub(nodes.woken[i]));
        let count = nodes.dormant[i].min(most).min(room);
        for k in 0..count {
            let number = nodes.woken[i] + k;
            let azimuth = nodes.azimuth[i] + (f32::from(number) + 1.0) * GOLDEN_ANGLE_F32;
            self.buds.push(Bud { node: index_of(i), azimuth, slot: FIRST_WOKEN + number, age: 0, gathered: 0.0 });
        }
        nodes.dormant[i] -= count;
        nodes.woken[i] += count;
        woken[i] += count;
        count
    }

    /// Makes a failed bud dormant at its node, with the probability `epicormic`; a node keeps at most three. `light`:
    /// light at the node.
    pub fn add_dormant(&mut self, i: usize, draw_id: u64, light: f32) {
        let share = f64::from(self.habit.epicormic);
        let stays = share >= 1.0 || share > 0.0 && self.draw(draw_id, Purpose::Dormant).chance(share);
        if stays && self.nodes.dormant[i] < DORMANT_MAX {
            if self.nodes.dormant[i] == 0 {
                self.nodes.light[i] = light;
            }
            self.nodes.dormant[i] += 1;
        }
    }
}
