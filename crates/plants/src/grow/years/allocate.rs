//! From light to vigour: sums the light of tips and buds towards the base, then distributes vigour to each of them.

use super::light::{CellMarks, Grid, LeafAreas, LightField};
use super::season::Season;
use super::tree::{Loss, NONE, Tree, flag};
use osier_base::math;

/// Smallest light assumed for an open tip in deep shade, so that it stays alive until its patience ends.
const DARK_TIP: f32 = 0.002;
/// Mean of 1 / sin e over the directions of the sky; e: elevation.
const MEAN_PATH: f32 = 1.47;
/// Largest optical depth of a tip's leaves that is removed from the light of the tip.
const OWN_SHADE_MAX: f32 = 2.0;
/// Range to which apical control is limited after `reiterate` has changed it.
const CONTROL_RANGE: [f32; 2] = [0.02, 0.98];
/// Light per metre of living wood, relative to a fully lit tip, above which `reiterate` has no effect.
const FULL_LIGHT_PER_METRE: f32 = 3.0;

/// Years in which a late stem is fed by the reserves of the older stems, and the light to which these reserves correspond,
/// relative to a fully lit tip. Own: hazel grows shoots of a metre in deep shade.
const SPROUT_YEARS: f32 = 5.0;
const SPROUT_LIGHT: f32 = 2.0;

/// Marks, in `Scratch::bare`, a node that bears several living branches: such a fork ends the bare stretch below it.
const BORNE_TWICE: f32 = -1.0;

impl Tree {
    /// Adds the leaf area of living nodes, times the extinction of the species, to the field.
    pub fn deposit_leaves(&self, areas: &mut LeafAreas) {
        let nodes = &self.nodes;
        for i in 0..nodes.len() {
            if !nodes.lives(i) {
                continue;
            }
            let area = self.leaf_area(i);
            if area > 0.0 {
                areas.deposit(self.offset + nodes.p[i], area * self.habit.extinction);
            }
        }
    }

    /// Marks the cells whose light is needed this year: those of open tips, of buds and, in some years, of dormant buds.
    pub fn mark_cells(&mut self, grid: &Grid, marks: &mut CellMarks) {
        let looks = self.looks_at_dormant_buds(self.year + 1);
        let (nodes, offset) = (&self.nodes, self.offset);
        let cell = &mut self.scratch.cell;
        cell.clear();
        cell.resize(nodes.len(), NONE);
        for (i, cell) in cell.iter_mut().enumerate() {
            if nodes.lives(i) && (nodes.flags[i] & flag::OPEN != 0 || looks && nodes.dormant[i] > 0) {
                *cell = grid.cell_of(offset + nodes.p[i]);
            }
        }
        for bud in &self.buds {
            let i = bud.node as usize;
            if cell[i] == NONE {
                cell[i] = grid.cell_of(offset + nodes.p[i]);
            }
        }
        cell.iter().filter(|c| **c != NONE).for_each(|c| marks.mark(*c));
    }

    /// Sets the light of open tips and buds from the field; tips that have starved longer than `patience` close.
    pub fn gather_light(&mut self, field: &LightField) {
        let habit = &self.habit;
        let nodes = &mut self.nodes;
        let count = nodes.len();
        let scratch = &mut self.scratch;
        for values in [&mut scratch.main, &mut scratch.side, &mut scratch.wood, &mut scratch.lost_light] {
            values.clear();
            values.resize(count, 0.0);
        }
        // Light above the compensation point, scaled so that the open sky gives 1; below it is negative.
        let net = |q: f32| (q - habit.shade_point) / (1.0 - habit.shade_point);
        // A tip's own leaves do not shade it: half of the depth that they add to its cell is removed.
        let area = habit.leaf_area_tip * habit.extinction;
        let own = 0.5 * MEAN_PATH * area / (field.grid.cell * field.grid.cell);
        for i in 0..count {
            if !nodes.grows(i) {
                continue;
            }
            let share = field.grid.own_share(self.offset + nodes.p[i]);
            let q = field.in_cell(scratch.cell[i]).q;
            let q = (q * math::exp_f32((own * share).min(OWN_SHADE_MAX))).min(1.0);
            let light = net(q);
            // The counter decreases in lit years: one lit year compensates one dark year.
            if light < 0.0 {
                nodes.starve[i] = nodes.starve[i].saturating_add(1);
            } else {
                nodes.starve[i] = nodes.starve[i].saturating_sub(1);
            }
            if f32::from(nodes.starve[i]) > habit.patience {
                nodes.flags[i] = nodes.flags[i] & !flag::OPEN | flag::SHADE;
            } else {
                scratch.main[i] = light.max(DARK_TIP);
            }
        }
        for bud in &mut self.buds {
            let i = bud.node as usize;
            let order = usize::from(nodes.order[i]) + 1;
            let share = habit.bud_share.get(order).copied().unwrap_or(0.0);
            bud.gathered = net(field.in_cell(scratch.cell[i]).q).max(0.0) * share;
            scratch.side[i] += bud.gathered;
        }
    }

    /// Sums light and length of living wood towards the base. With `shed`, three kinds of wood die: subtrees without light, side
    /// axes with too little light per length of wood, and wood that is bare over a stretch too long for the light beyond it.
    pub fn sum_light(&mut self, shed: bool) {
        let habit = &self.habit;
        let year = self.year as f32;
        let this_year = self.stored_year();
        let nodes = &mut self.nodes;
        let scratch = &mut self.scratch;
        scratch.bare.clear();
        scratch.bare.resize(nodes.len(), 0.0);
        // Children have higher indices than their parent: from the end, each node is complete before it is added to its parent.
        for i in (0..nodes.len()).rev() {
            if !nodes.lives(i) {
                continue;
            }
            let total = scratch.main[i] + scratch.side[i];
            let wood = scratch.wood[i] + nodes.length[i];
            // An internode with leaves ends the bare stretch; at a fork the stretch has ended already (`BORNE_TWICE`).
            let years = year - nodes.birth[i];
            let leafy = habit.leaf_area_shoot > 0.0 && years < habit.leaf_years + 1.0;
            let bears = nodes.flags[i] & flag::OPEN != 0 || leafy;
            let bare = if bears { 0.0 } else { scratch.bare[i].max(0.0) + nodes.length[i] };
            let parent = nodes.parent[i] as usize;
            if nodes.parent[i] == NONE {
                nodes.gathered[i] = total;
                scratch.wood[i] = wood;
                // One of several stems dies like a branch, unless it has not sprouted yet.
                if shed && total <= 0.0 && habit.stems > 1.5 && nodes.birth[i] < year {
                    nodes.flags[i] |= flag::DEAD;
                    nodes.death[i] = this_year;
                }
                continue;
            }
            let is_main = nodes.flags[i] & flag::MAIN != 0;
            // [palubicki] 4.2, shedding: light per length of wood below a threshold. Continuations are exempt: an axis is shed as
            // a whole.
            let old = years > habit.shed_age;
            // Own: a long shoot with leaves only at its end gathers too little light for the wood below them. The whole bare
            // stretch dies, since without those leaves it receives no light.
            let whip = old && nodes.order[i] > 0 && bare > habit.bare_max * total;
            if shed && (total <= 0.0 || whip || old && !is_main && total < habit.shed * wood) {
                nodes.flags[i] |= flag::DEAD;
                nodes.death[i] = this_year;
                // The share `pipe_memory` of the cross-section that supplied the dead branch remains in the wood below.
                nodes.lost[parent] += habit.pipe_memory * nodes.area[i];
                self.losses.push(Loss { at: nodes.parent[i], light: nodes.gathered[i] });
                continue;
            }
            nodes.gathered[i] = total;
            scratch.wood[i] = wood;
            scratch.wood[parent] += wood;
            // A bare stretch of length 0 is stored as a positive number, so that only the second child marks the node as a fork.
            let first = scratch.bare[parent].abs() < f32::MIN_POSITIVE;
            scratch.bare[parent] = if first { bare.max(f32::MIN_POSITIVE) } else { BORNE_TWICE };
            if is_main {
                scratch.main[parent] += total;
            } else {
                scratch.side[parent] += total;
            }
        }
    }

    /// Sums light and wood again after leaders were replaced; no wood is shed.
    pub fn sum_light_again(&mut self) {
        let nodes = &self.nodes;
        let scratch = &mut self.scratch;
        // Start from the light of tips and buds: only open tips, which have no continuation, keep their value in `main`.
        scratch.wood.fill(0.0);
        scratch.factor.clear();
        scratch.factor.extend_from_slice(&scratch.main);
        for i in 0..nodes.len() {
            if nodes.flags[i] & flag::OPEN == 0 {
                scratch.factor[i] = 0.0;
            }
        }
        std::mem::swap(&mut scratch.main, &mut scratch.factor);
        scratch.side.fill(0.0);
        for bud in &self.buds {
            scratch.side[bud.node as usize] += bud.gathered;
        }
        self.sum_light(false);
    }

    /// Distributes vigour from the base towards the tips.
    /// Source: [palubicki] 4.2, the extended model of Borchert and Honda. Own: the apical control depends on order and age.
    pub fn share_vigour(&mut self, season: &Season) {
        let habit = &self.habit;
        let nodes = &mut self.nodes;
        let scratch = &mut self.scratch;
        scratch.factor.clear();
        scratch.factor.resize(nodes.len(), 0.0);
        let control = season.apical_control;
        for i in 0..nodes.len() {
            if !nodes.lives(i) {
                continue;
            }
            let own =
                apical_share(habit.reiterate, control[usize::from(nodes.order[i])], nodes.gathered[i], scratch.wood[i]);
            let parent = nodes.parent[i] as usize;
            nodes.vigour[i] = if nodes.parent[i] == NONE {
                let fed = sprout_reserve(nodes.birth[i], self.year);
                habit.vigour * math::pow_f32(nodes.gathered[i].max(fed), habit.vigour_exponent)
            } else {
                let of_parent = control[usize::from(nodes.order[parent])];
                let share = apical_share(habit.reiterate, of_parent, nodes.gathered[parent], scratch.wood[parent]);
                let weight = if nodes.flags[i] & flag::MAIN != 0 { share } else { 1.0 - share };
                scratch.factor[parent] * weight * nodes.gathered[i]
            };
            let wanted = own * scratch.main[i] + (1.0 - own) * scratch.side[i];
            scratch.factor[i] = if wanted > 0.0 { nodes.vigour[i] / wanted } else { 0.0 };
        }
    }

    /// Apical control at a node: the weight of its continuation relative to its side branches and buds.
    pub(super) fn control_at(&self, season: &Season, i: usize) -> f32 {
        let control = season.apical_control[usize::from(self.nodes.order[i])];
        apical_share(self.habit.reiterate, control, self.nodes.gathered[i], self.scratch.wood[i])
    }
}

/// Smallest light assumed for a stem in its first years, in which older stems feed it; 0 for stems of the first year.
#[inline]
fn sprout_reserve(birth: f32, year: u32) -> f32 {
    let fed = birth > 0.0 && year as f32 - birth <= SPROUT_YEARS;
    if fed { SPROUT_LIGHT } else { 0.0 }
}

/// Apical control, increased by up to `reiterate` where the light per metre of wood is poor.
#[inline]
fn apical_share(reiterate: f32, control: f32, light: f32, wood: f32) -> f32 {
    if reiterate.abs() > 0.0 {
        let poor = 1.0 - (light / (FULL_LIGHT_PER_METRE * wood.max(1e-6))).min(1.0);
        (control + reiterate * poor).clamp(CONTROL_RANGE[0], CONTROL_RANGE[1])
    } else {
        control
    }
}
