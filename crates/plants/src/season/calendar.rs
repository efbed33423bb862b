//! When each leaf unfolds, turns and falls.

use std::collections::BTreeSet;

use super::{FallOrder, LeafColor, LeafHabit, LeafLook, LeafShape, mixed};
use crate::crown::CrownLight;
use osier_base::math::{lerp, narrow, pow_f32, smoothstep};
use osier_base::rng::Rng;
use osier_scene::plant::{NONE, Organ, Plant};

/// Constants of the year, guessed from photographs of one tree through the seasons.
mod tuning {
    /// Seasons at which the first and the last bud open, and the time from then to the full size of its leaf.
    pub(super) const BURST: [f32; 2] = [0.0, 0.06];
    pub(super) const UNFOLDING: f32 = 0.13;
    /// Time after bud burst in which a fresh leaf becomes as green as in summer.
    pub(super) const GREENING: [f32; 2] = [0.12, 0.36];
    /// Size of the needles of a young shoot at bud burst: the shoots of the year are there already.
    pub(super) const FIRST_NEEDLES: f32 = 0.6;
    /// Size of a leaf that has just left its bud.
    pub(super) const FIRST_SIZE: f32 = 0.16;
    /// Seasons at which the first and the last leaf begin to turn, and how long that takes.
    pub(super) const TURN: [f32; 2] = [0.55, 0.8];
    pub(super) const TURNING: f32 = 0.09;
    /// Few leaves turn early: a leaf of rank r turns at r^0.55 of the time, so that the first tenth takes as long as
    /// the next quarter.
    pub(super) const EARLY: f32 = 0.55;
    /// Seasons at which the first and the last leaf fall; with the exponent most leaves fall late.
    pub(super) const FALL: [f32; 2] = [0.66, 0.99];
    pub(super) const HELD: f32 = 0.6;
    /// A leaf does not fall before it has had its colour for this long.
    pub(super) const LEAST_COLOR: f32 = 0.04;
    /// Time before its fall in which a leaf dries.
    pub(super) const DRYING: f32 = 0.05;
    /// Season at which leaves that stay through the winter begin to dry.
    pub(super) const MARCESCENT_DRY: f32 = 0.86;
}

/// Weights of the quantities that decide the order of leaves in one event of the year; their absolute values sum to 1.
struct Shares {
    /// Occlusion by the crown, 0 in the sun: a positive weight delays leaves in the shade.
    sun: f64,
    /// Random numbers of the limb, of the twig and of the leaf itself.
    limb: f64,
    twig: f64,
    chance: f64,
    /// Position on the shoot, by [`from_tip`].
    tip: f64,
}

/// Own: by eye. Lower limbs break their buds first, sunlit leaves and single branches turn first.
const SPRING: Shares = Shares { sun: -0.3, limb: 0.25, twig: 0.2, chance: 0.25, tip: 0.0 };
const TURN: Shares = Shares { sun: 0.4, limb: 0.22, twig: 0.2, chance: 0.18, tip: 0.0 };
const FALL: Shares = Shares { sun: 0.2, limb: 0.1, twig: 0.1, chance: 0.25, tip: 0.35 };
const HUE: Shares = Shares { sun: 0.45, limb: 0.15, twig: 0.15, chance: 0.25, tip: 0.0 };

/// Events in the year of one leaf, as seasons from 0, bud burst, to 1, winter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeafCalendar {
    /// Season at which its bud opens.
    pub burst: f32,
    /// Season at which the leaf begins to turn from green to the autumn colour.
    pub turn: f32,
    /// Season at which it falls; above 1 for a leaf that stays through the winter.
    pub fall: f32,
    /// Index of its autumn colour in [`LeafHabit::autumn`].
    pub hue: u8,
    /// Whether it is on one of the youngest shoots of an evergreen, which are fresh in spring.
    pub youngest: bool,
}

/// State of a leaf on the plant at a season.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeafNow {
    /// Steps of colour and shape, by which the prototype is selected.
    pub look: LeafLook,
    /// Factor on the size of the summer leaf, above 0, at most 1.
    pub size: f32,
    /// Share of the rotation from its direction in the bud to that of summer, 0..1.
    pub opening: f32,
    /// Linear colour, which changes smoothly and not in the steps of [`LeafColor`].
    pub color: [f32; 3],
}

impl LeafCalendar {
    /// The leaf at a season; `None` while it is in its bud, or has fallen.
    pub fn at(&self, habit: &LeafHabit, season: f32) -> Option<LeafNow> {
        let shape = |bent: LeafShape| if habit.bends { bent } else { LeafShape::Open };
        let summer = LeafNow { look: LeafLook::SUMMER, size: 1.0, opening: 1.0, color: habit.green };
        // Spring: size, direction and folds by how far the leaf has unfolded, colour by its age.
        let unfolded = smoothstep(self.burst, self.burst + tuning::UNFOLDING, season);
        let [start, end] = tuning::GREENING.map(|t| self.burst + t);
        let green = smoothstep(start, end, season);
        // Steps of the colour, each with a separate material; `color` itself changes smoothly.
        let fresh_color = match green {
            g if g < 0.34 => LeafColor::Fresh,
            g if g < 0.8 => LeafColor::Young,
            _ => LeafColor::Green,
        };
        if habit.evergreen {
            let look = LeafLook { color: fresh_color, shape: LeafShape::Open };
            let size = lerp(tuning::FIRST_NEEDLES, 1.0, unfolded);
            let fresh = LeafNow { look, size, color: mixed(habit.spring, habit.green, green), ..summer };
            return Some(if self.youngest { fresh } else { summer });
        }
        if unfolded <= 0.0 || season >= self.fall {
            return None;
        }
        let young = LeafNow {
            look: LeafLook {
                color: fresh_color,
                shape: match unfolded {
                    u if u < 0.35 => shape(LeafShape::Furled),
                    u if u < 0.8 => shape(LeafShape::Unfolding),
                    _ => LeafShape::Open,
                },
            },
            size: lerp(tuning::FIRST_SIZE, 1.0, unfolded),
            opening: unfolded,
            color: mixed(habit.spring, habit.green, green),
        };
        if season <= self.turn || habit.autumn.is_empty() {
            return Some(young);
        }
        // Autumn: the colour comes between the veins first, and the leaf dries before it falls.
        let hue = habit.autumn_color(self.hue);
        let turned = smoothstep(self.turn, self.turn + tuning::TURNING, season);
        // Leaves that stay through the winter dry in late autumn.
        let dries_at = if self.fall > 1.0 { tuning::MARCESCENT_DRY } else { self.fall - tuning::DRYING };
        let dry = smoothstep(dries_at, dries_at + tuning::DRYING, season);
        let (color, shape) = match (turned, dry) {
            (_, dry) if dry > 0.5 && turned > 0.7 => (LeafColor::Aged(self.hue), shape(LeafShape::Withered)),
            (turned, _) if turned > 0.7 => (LeafColor::Turned(self.hue), LeafShape::Open),
            (turned, _) if turned > 0.2 => (LeafColor::Turning(self.hue), LeafShape::Open),
            _ => (LeafColor::Green, LeafShape::Open),
        };
        let now = mixed(mixed(habit.green, hue, turned), habit.dry, dry * super::AGED_SHARE);
        Some(LeafNow { look: LeafLook { color, shape }, color: now, ..summer })
    }
}

/// The colours, besides green, that leaves of a habit have at some time between two seasons.
pub fn colors_between(habit: &LeafHabit, seasons: [f32; 2]) -> BTreeSet<LeafColor> {
    let mut colors = BTreeSet::new();
    // Calendars and seasons on a grid that is finer than the shortest time for which a leaf has a colour.
    let steps = 60_u8;
    let grid = |k: u8| f32::from(k) / f32::from(steps);
    let seasons: Vec<f32> = (0..=steps).map(|k| lerp(seasons[0], seasons[1], grid(k))).collect();
    // Turning and unfolding get the same rank here: which colours occur does not depend on their combination.
    for (rank, falling) in (0..=steps).flat_map(|k| (0..=steps).step_by(3).map(move |f| (grid(k), grid(f)))) {
        let falls = calendar(rank, rank, falling, 0);
        let falls = LeafCalendar { youngest: habit.evergreen, ..falls };
        let stays = Some(LeafCalendar { fall: 2.0, ..falls }).filter(|_| habit.keeps > 0.0);
        for leaf in std::iter::once(falls).chain(stays) {
            colors.extend(seasons.iter().filter_map(|s| leaf.at(habit, *s)).map(|now| now.look.color));
        }
    }
    // The times do not depend on the hue, so that calendars of hue 0 represent all hues.
    // At most 100 colours: see `LeafHabit::autumn`.
    let hues = u8::try_from(habit.autumn.len()).unwrap_or(u8::MAX);
    let with_all_hues = |color: LeafColor| -> Vec<LeafColor> {
        match color {
            LeafColor::Turning(_) => (0..hues).map(LeafColor::Turning).collect(),
            LeafColor::Turned(_) => (0..hues).map(LeafColor::Turned).collect(),
            LeafColor::Aged(_) => (0..hues).map(LeafColor::Aged).collect(),
            other => vec![other],
        }
    };
    colors.remove(&LeafColor::Green);
    colors.into_iter().flat_map(with_all_hues).collect()
}

/// The calendar of a leaf by its ranks among all leaves, 0..1.
fn calendar(spring: f32, turning: f32, falling: f32, hue: u8) -> LeafCalendar {
    let turn = lerp(tuning::TURN[0], tuning::TURN[1], pow_f32(turning, tuning::EARLY));
    let fall = lerp(tuning::FALL[0], tuning::FALL[1], pow_f32(falling, tuning::HELD));
    LeafCalendar {
        burst: lerp(tuning::BURST[0], tuning::BURST[1], spring),
        turn,
        fall: fall.max(turn + tuning::TURNING + tuning::LEAST_COLOR),
        hue,
        youngest: false,
    }
}

/// The calendars of some organs of a plant. `light`: light of all organs of the plant, in their order; `leaves`:
/// indices of these organs.
pub fn leaf_calendars(
    plant: &Plant,
    light: &[CrownLight],
    leaves: &[usize],
    habit: &LeafHabit,
    seed: u64,
) -> Vec<LeafCalendar> {
    let limbs = limbs(plant);
    // Ranks are used instead of scores, so that at a given season every plant has the same share of its leaves.
    let rank = |word: &'static str, shares: &Shares| {
        let score = |i: &usize| {
            let organ = &plant.organs[*i];
            let draw = |what: &'static str, id: u64| Rng::at(seed, &[word.into(), what.into(), id.into()]).unit_f64();
            let shade = f64::from(light.get(*i).map_or(0.0, |l| l.occlusion));
            shares.sun * shade
                + shares.tip * f64::from(from_tip(plant, organ, habit.falls))
                + shares.limb * draw("limb", limbs[organ.axis as usize])
                + shares.twig * draw("twig", plant.axes[organ.axis as usize].id)
                + shares.chance * draw("leaf", organ.id)
        };
        let scores: Vec<f64> = leaves.iter().map(score).collect();
        ranks(&scores, &leaves.iter().map(|i| plant.organs[*i].id).collect::<Vec<_>>())
    };
    let (spring, turning) = (rank("bud burst", &SPRING), rank("turning", &TURN));
    let (falling, hues) = (rank("fall", &FALL), rank("hue", &HUE));
    // The leaves that stay through the winter are those of the shaded inner and lower branches.
    let kept = rank("kept", &Shares { sun: -0.5, limb: 0.2, twig: 0.2, chance: 0.1, tip: 0.0 });
    let weights: Vec<f64> = habit.autumn.iter().map(|c| c.weight).collect();
    let births = || leaves.iter().map(|i| plant.organs[*i].birth);
    let (first, last) = births().fold((1.0_f32, 0.0_f32), |b, birth| (b.0.min(birth), b.1.max(birth)));
    let leaf = |k: usize| {
        let youngest = last > first && plant.organs[leaves[k]].birth >= last - habit.last_year;
        let calendar = calendar(spring[k], turning[k], falling[k], by_share(&weights, hues[k]));
        let fall = if kept[k] < habit.keeps { 2.0 } else { calendar.fall };
        LeafCalendar { fall, youngest, ..calendar }
    };
    (0..leaves.len()).map(leaf).collect()
}

/// Position of a leaf on its shoot, from 0 at the end where leaves fall first to 1 at the other; 0 for a random order.
fn from_tip(plant: &Plant, organ: &Organ, order: FallOrder) -> f32 {
    let along = (organ.s / plant.axes[organ.axis as usize].length.max(1e-6)).clamp(0.0, 1.0);
    match order {
        FallOrder::Tips => 1.0 - along,
        FallOrder::Bases => along,
        FallOrder::Random => 0.0,
    }
}

/// For each axis the identifier of the limb that it is part of: its ancestor on the trunk.
fn limbs(plant: &Plant) -> Vec<u64> {
    let mut limbs: Vec<u64> = Vec::with_capacity(plant.axes.len());
    // Parents come before their children.
    for axis in &plant.axes {
        let parent = plant.axes.get(axis.parent as usize).filter(|_| axis.parent != NONE);
        let carried = parent.filter(|p| p.parent != NONE && p.order > 0);
        limbs.push(carried.and_then(|_| limbs.get(axis.parent as usize).copied()).unwrap_or(axis.id));
    }
    limbs
}

/// Ranks of scores, evenly from 0 to 1, the lowest first; equal scores by their keys.
fn ranks(scores: &[f64], keys: &[u64]) -> Vec<f32> {
    let mut order: Vec<usize> = (0..scores.len()).collect();
    order.sort_by(|a, b| scores[*a].total_cmp(&scores[*b]).then(keys[*a].cmp(&keys[*b])));
    let mut ranks = vec![0.0; scores.len()];
    for (rank, i) in order.into_iter().enumerate() {
        // The middle of each of n equal intervals, so that no rank is 0 or 1.
        ranks[i] = narrow((rank as f64 + 0.5) / scores.len() as f64);
    }
    ranks
}

/// The index at a share, 0..1, of the sum of some weights; 0 without weights.
fn by_share(weights: &[f64], share: f32) -> u8 {
    let mut left = f64::from(share) * weights.iter().sum::<f64>();
    let found = weights.iter().position(|w| {
        left -= w;
        left < 0.0
    });
    // There are at most 100 colours: see `LeafHabit::autumn`.
    u8::try_from(found.unwrap_or(weights.len().saturating_sub(1))).unwrap_or(u8::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::season::AutumnColor;

    fn habit() -> LeafHabit {
        LeafHabit {
            evergreen: false,
            last_year: 0.02,
            green: [0.05, 0.1, 0.02],
            spring: [0.2, 0.3, 0.05],
            dry: [0.2, 0.1, 0.05],
            autumn: vec![
                AutumnColor { color: [0.6, 0.2, 0.03], weight: 3.0 },
                AutumnColor { color: [0.7, 0.5, 0.05], weight: 1.0 },
            ],
            falls: FallOrder::Tips,
            keeps: 0.0,
            bends: true,
        }
    }

    #[test]
    fn the_year_of_a_leaf_has_all_its_stages_in_order() {
        let (habit, leaf) = (habit(), calendar(0.5, 0.5, 0.5, 1));
        let now = |s: f32| leaf.at(&habit, s);
        assert_eq!((now(0.0), now(1.0)), (None, None));
        let first = now(0.06).expect("it unfolds");
        assert!(first.size < 0.5 && first.look.color == LeafColor::Fresh && first.look.shape == LeafShape::Furled);
        assert_eq!(now(0.5).expect("summer").look, LeafLook::SUMMER);
        let colors: Vec<LeafColor> = (0..=1000_u16)
            .filter_map(|k| now(f32::from(k) / 1000.0).map(|n| n.look.color))
            .fold(Vec::new(), |mut list, c| {
                if list.last() != Some(&c) {
                    list.push(c);
                }
                list
            });
        let (turning, turned, aged) = (LeafColor::Turning(1), LeafColor::Turned(1), LeafColor::Aged(1));
        assert_eq!(colors, [LeafColor::Fresh, LeafColor::Young, LeafColor::Green, turning, turned, aged]);
        assert_eq!(LeafCalendar { fall: 2.0, ..leaf }.at(&habit, 1.0).expect("it stays").look.color, aged);
    }

    #[test]
    fn needles_stay_and_those_of_young_shoots_are_fresh_in_spring() {
        let habit = LeafHabit { evergreen: true, ..habit() };
        let old = calendar(0.5, 0.5, 0.5, 0);
        let young = LeafCalendar { youngest: true, ..old };
        for s in [0.0, 0.3, 0.8, 1.0] {
            assert_eq!(old.at(&habit, s).expect("a needle").look, LeafLook::SUMMER);
            assert_eq!(young.at(&habit, s).expect("a needle").look == LeafLook::SUMMER, s > 0.4);
        }
        assert!(colors_between(&habit, [0.5, 1.0]).is_empty() && colors_between(&habit, [0.0, 1.0]).len() == 2);
    }

    #[test]
    fn colors_of_a_season_are_those_that_leaves_have_then() {
        let habit = habit();
        assert!(colors_between(&habit, [0.5, 0.5]).is_empty());
        let spring = colors_between(&habit, [0.1, 0.1]);
        assert_eq!(spring.into_iter().collect::<Vec<_>>(), [LeafColor::Fresh]);
        assert_eq!(colors_between(&habit, [0.0, 1.0]).len(), 2 + 3 * 2);
        // Every leaf of a fine set finds its colour among them.
        for s in [0.05, 0.2, 0.6, 0.7, 0.8, 0.9, 0.97] {
            let known = colors_between(&habit, [s, s]);
            for k in 0..=500_u16 {
                let r = f32::from(k) / 500.0;
                for fall in [0.0, 0.3, r, 1.0] {
                    let color = calendar(r, r, fall, 0).at(&habit, s).map_or(LeafColor::Green, |n| n.look.color);
                    assert!(color == LeafColor::Green || known.contains(&color), "{color:?} at {s}, {r}");
                }
            }
        }
    }

    #[test]
    fn weights_are_shares() {
        let hues: Vec<u8> = (0..1000_u16).map(|k| by_share(&[3.0, 1.0], f32::from(k) / 1000.0)).collect();
        assert_eq!(hues.iter().filter(|h| **h == 0).count(), 750);
        assert_eq!(ranks(&[3.0, 1.0, 2.0, 1.0], &[0, 2, 0, 1]), [0.875, 0.375, 0.625, 0.125]);
    }
}
