//! Applies a season to a grown plant: once, or for every season of a clip.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use glam::{Quat, Vec3};

use super::{LeafCalendar, LeafColor, LeafHabit, LeafLook, LeafNow, bud_mesh, leaf_calendars, shaped_leaf};
use crate::crown::{crown_leaves, crown_light};
use osier_base::Result;
use osier_base::convert::narrow;
use osier_base::math::{lerp, nlerp, rotation_between};
use osier_base::rng::{child, word};
use osier_scene::plant::{Organ, Plant, Proto};
use osier_scene::{Attribute, AttributeData, LEAF_COLOR};

/// Rotation of a leaf at bud burst, and of a bud, towards the shoot, as shares of the angle between leaf and shoot.
const YOUNG_LEAN: f32 = 0.7;
const BUD_LEAN: f32 = 0.6;
/// Growth of a bud before it bursts, as a share of its length in winter.
const SWELLING: f32 = 0.35;

/// A kind of leaf of a plant that changes over the year.
#[derive(Debug)]
pub struct SeasonalOrgan<'a> {
    /// Its prototypes are called `NAME`, or `NAME_` and a number.
    pub name: &'a str,
    /// Colours of its leaves, and the order in which they fall.
    pub habit: &'a LeafHabit,
    /// Material that replaces a material of the summer leaf in a step of colour; materials without an entry stay.
    pub materials: &'a BTreeMap<(u32, LeafColor), u32>,
    /// Buds that are shown where leaves are missing; `None`: no buds.
    pub bud: Option<BudOrgan>,
}

/// The bud that is added where a leaf is missing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BudOrgan {
    /// Length of a bud from base to tip, m.
    pub length: f32,
    /// Index of its material among those of the plant.
    pub material: u32,
}

/// Season of a plant, and which of its organs are leaves.
#[derive(Debug)]
pub struct PlantSeason<'a> {
    /// 0 bud burst to 1 bare.
    pub season: f32,
    /// Seed of the draws by which the leaves of this individual differ in time and colour.
    pub seed: u64,
    /// Its organs that are leaves; all others stay as they are.
    pub organs: &'a [SeasonalOrgan<'a>],
    /// Name of the organ that buds become, `[a-z0-9_]+`.
    pub bud_name: &'a str,
}

/// Applies a season to a grown plant: leaves get the size, shape and colour of the season, those that have fallen are removed,
/// and buds are added where leaves are missing. Sets the attribute [`LEAF_COLOR`] of the organs in place of all others: the
/// linear colour of leaves, white for other organs.
/// # Errors
/// `TooMany` beyond 65,535 prototypes.
pub fn apply_season(plant: &mut Plant, at: &PlantSeason<'_>) -> Result<()> {
    let leaves = calendars(plant, at);
    let mut prototypes = PrototypeLooks::default();
    let mut buds = Buds::default();
    let (mut organs, mut colors) = (Vec::with_capacity(plant.organs.len()), Vec::with_capacity(plant.organs.len()));
    for (organ, leaf) in std::mem::take(&mut plant.organs).into_iter().zip(leaves) {
        let Some((kind, calendar)) = leaf else {
            organs.push(organ);
            colors.push([1.0; 4]);
            continue;
        };
        let kind = &at.organs[kind];
        match calendar.at(kind.habit, at.season) {
            Some(now) => {
                let proto = prototypes.of(&mut plant.protos, organ.proto, now.look, kind)?;
                organs.push(Organ { proto, ..leaf_at(&organ, &now) });
                let [r, g, b] = now.color;
                colors.push([r, g, b, 1.0].map(|c| c.clamp(0.0, 1.0)));
            }
            // Buds are collected until all organs are known: leaves at one place share a bud.
            None => buds.note(&organ, kind.bud, at.season / calendar.burst.max(1e-3)),
        }
    }
    // Buds come after the leaves, so that leaves keep their order.
    for (organ, bud, growth) in buds.list {
        let proto = prototypes.bud(&mut plant.protos, bud, at.bud_name)?;
        organs.push(bud_at(plant, &organ, bud, growth, proto));
        colors.push([1.0; 4]);
    }
    plant.organs = organs;
    plant.organ_attributes = vec![Attribute::instance(LEAF_COLOR, AttributeData::Unit4(colors))];
    Ok(())
}

/// Meaning of an organ of a plant that [`season_slots`] has prepared.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Slot {
    /// An organ that is no leaf.
    Other,
    /// One look of a leaf; the number is the index of the leaf.
    Leaf(usize, LeafLook),
    /// The bud where a leaf is missing.
    Bud(usize),
}

/// Meanings of the organs of a plant whose leaves change over a clip. Each leaf has one organ for every look that it
/// has in the clip; at any time at most one of these has a size above 0.
#[derive(Debug, Clone)]
pub struct SeasonSlots {
    habits: Vec<LeafHabit>,
    leaves: Vec<(usize, LeafCalendar)>,
    slots: Vec<Slot>,
}

/// Size, direction and colour of an organ at a season.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlotNow {
    /// Factor on the size of the organ; 0 at seasons at which the leaf has another look, or none.
    pub size: f32,
    /// Its rotation relative to its axis.
    pub q: Quat,
    /// Linear RGBA colour of the leaf at this time; white for an organ that is no leaf.
    pub color: [f32; 4],
}

impl SeasonSlots {
    /// State of an organ of the prepared plant at a season. `number`: its index among the plant's organs.
    pub fn at(&self, organ: &Organ, number: usize, season: f32) -> SlotNow {
        let shown = SlotNow { size: 1.0, q: organ.q, color: [1.0; 4] };
        let now = |leaf: usize| {
            let (kind, calendar) = self.leaves.get(leaf)?;
            Some((calendar, calendar.at(self.habits.get(*kind)?, season)))
        };
        match self.slots.get(number) {
            None | Some(Slot::Other) => shown,
            Some(Slot::Leaf(leaf, look)) => match now(*leaf) {
                Some((_, Some(now))) if now.look == *look => {
                    let [r, g, b] = now.color.map(|c| c.clamp(0.0, 1.0));
                    SlotNow { size: now.size, q: leaf_at(organ, &now).q, color: [r, g, b, 1.0] }
                }
                _ => SlotNow { size: 0.0, ..shown },
            },
            Some(Slot::Bud(leaf)) => match now(*leaf) {
                Some((calendar, None)) => {
                    let growth = bud_growth(season / calendar.burst.max(1e-3));
                    SlotNow { size: lerp(1.0, 1.0 + SWELLING, growth), ..shown }
                }
                _ => SlotNow { size: 0.0, ..shown },
            },
        }
    }
}

/// Replaces each leaf by one organ for every look that it has at any of `seasons`, and adds buds; attributes of organs are
/// copied. `at.season` has no effect.
/// # Errors
/// `TooMany` beyond 65,535 prototypes.
pub fn season_slots(plant: &mut Plant, at: &PlantSeason<'_>, seasons: &[f32]) -> Result<SeasonSlots> {
    let calendars = calendars(plant, at);
    let mut prototypes = PrototypeLooks::default();
    let mut known_buds = BTreeSet::new();
    let (mut organs, mut sources) = (Vec::new(), Vec::new());
    let habits = at.organs.iter().map(|o| o.habit.clone()).collect();
    let mut out = SeasonSlots { habits, leaves: Vec::new(), slots: Vec::new() };
    for (source, (organ, leaf)) in (0_u32..).zip(std::mem::take(&mut plant.organs).into_iter().zip(calendars)) {
        let Some((number, calendar)) = leaf else {
            organs.push(organ);
            sources.push(source);
            out.slots.push(Slot::Other);
            continue;
        };
        let kind = &at.organs[number];
        // The leaf at every season of the clip; `None` while it is missing.
        let states: Vec<Option<LeafNow>> = seasons.iter().map(|s| calendar.at(kind.habit, *s)).collect();
        let looks: BTreeSet<LeafLook> = states.iter().flatten().map(|now| now.look).collect();
        for (k, look) in (0_u64..).zip(looks) {
            let proto = prototypes.of(&mut plant.protos, organ.proto, look, kind)?;
            // The first look keeps the identifier of the leaf.
            let id = if k == 0 { organ.id } else { child(organ.id, k) };
            organs.push(Organ { id, proto, ..organ.clone() });
            sources.push(source);
            out.slots.push(Slot::Leaf(out.leaves.len(), look));
        }
        let bare = states.iter().any(Option::is_none);
        if let Some(bud) = kind.bud.filter(|_| bare && known_buds.insert((organ.axis, organ.s.to_bits()))) {
            let proto = prototypes.bud(&mut plant.protos, bud, at.bud_name)?;
            organs.push(bud_at(plant, &organ, bud, 0.0, proto));
            sources.push(source);
            out.slots.push(Slot::Bud(out.leaves.len()));
        }
        out.leaves.push((number, calendar));
    }
    plant.organs = organs;
    plant.organ_attributes.iter_mut().for_each(|a| a.data = a.data.gather(&sources));
    Ok(out)
}

/// Share of the swelling that a bud has reached, 0..1. `burst`: the season divided by that at which it opens; above 1 after the
/// fall of the leaf.
fn bud_growth(burst: f32) -> f32 {
    if burst > 1.0 { 0.0 } else { burst }
}

/// For each organ of a plant the number of its kind and its calendar; `None` for other organs.
fn calendars(plant: &Plant, at: &PlantSeason<'_>) -> Vec<Option<(usize, LeafCalendar)>> {
    let light = crown_light(&crown_leaves(plant));
    let kinds: Vec<Option<usize>> =
        plant.protos.iter().map(|p| at.organs.iter().position(|o| is_variant(&p.name, o.name))).collect();
    let mut all = vec![None; plant.organs.len()];
    for (kind, organ) in at.organs.iter().enumerate() {
        let is_of_kind = |i: &usize| kinds.get(usize::from(plant.organs[*i].proto)) == Some(&Some(kind));
        let leaves: Vec<usize> = (0..plant.organs.len()).filter(is_of_kind).collect();
        let calendars = leaf_calendars(plant, &light, &leaves, organ.habit, at.seed);
        leaves.iter().zip(calendars).for_each(|(i, calendar)| all[*i] = Some((kind, calendar)));
    }
    all
}

/// Whether a prototype is a variant of an organ: it has its name, or that with an underscore and a number.
pub(super) fn is_variant(prototype: &str, organ: &str) -> bool {
    let rest = prototype.strip_prefix(organ);
    rest.is_some_and(|r| r.is_empty() || r.strip_prefix('_').is_some_and(|n| n.parse::<u32>().is_ok()))
}

/// A leaf with the size and rotation of a season; it keeps the prototype of summer.
fn leaf_at(organ: &Organ, now: &LeafNow) -> Organ {
    let lean = YOUNG_LEAN * (1.0 - now.opening);
    let q = if lean > 0.0 { leaning(organ.q, lean) } else { organ.q };
    Organ { scale: organ.scale * now.size, q, ..organ.clone() }
}

/// A rotation relative to an axis, turned towards the axis by a share of the angle between its +Y and the axis.
fn leaning(q: Quat, share: f32) -> Quat {
    // In the frame of the axis, whose direction is +Y.
    let whole = rotation_between((q * Vec3::Y).normalize(), Vec3::Y);
    (nlerp(Quat::IDENTITY, whole, share) * q).normalize()
}

/// A bud on the bark where a leaf was.
fn bud_at(plant: &Plant, leaf: &Organ, bud: BudOrgan, growth: f32, proto: u16) -> Organ {
    let radius = plant.frame(&plant.axes[leaf.axis as usize], leaf.s).r;
    // The offset of an organ may already lead to the bark.
    let outside = (radius - leaf.offset.length()).max(0.0);
    Organ {
        id: child(leaf.id, word("bud")),
        q: leaning(leaf.q, BUD_LEAN),
        scale: bud.length * lerp(1.0, 1.0 + SWELLING, growth),
        proto,
        // A fifth of its seat is sunk into the bark.
        petiole: 0.8 * outside,
        ..leaf.clone()
    }
}

/// The buds of missing leaves: one for each place on an axis.
#[derive(Default)]
struct Buds {
    known: BTreeSet<(u32, u32)>,
    list: Vec<(Organ, BudOrgan, f32)>,
}

impl Buds {
    /// `burst`: the season as a share of that at which the bud opens; above 1 after the fall of the leaf.
    fn note(&mut self, organ: &Organ, bud: Option<BudOrgan>, burst: f32) {
        let growth = bud_growth(burst);
        if let Some(bud) = bud.filter(|_| self.known.insert((organ.axis, organ.s.to_bits()))) {
            self.list.push((organ.clone(), bud, growth));
        }
    }
}

/// Prototypes made so far: leaves by their summer prototype and look, buds by their material.
#[derive(Default)]
struct PrototypeLooks {
    known: BTreeMap<(u16, LeafLook), u16>,
    buds: BTreeMap<u32, u16>,
}

impl PrototypeLooks {
    /// Index of the prototype of a leaf in a look, which is made from the prototype `summer` at its first use.
    fn of(&mut self, protos: &mut Vec<Proto>, summer: u16, look: LeafLook, kind: &SeasonalOrgan<'_>) -> Result<u16> {
        if look == LeafLook::SUMMER {
            return Ok(summer);
        }
        if let Some(proto) = self.known.get(&(summer, look)) {
            return Ok(*proto);
        }
        let Some(source) = protos.get(usize::from(summer)) else { return Ok(summer) };
        let mut mesh = shaped_leaf(&source.mesh, look.shape);
        for subset in &mut mesh.subsets {
            subset.material = kind.materials.get(&(subset.material, look.color)).copied().unwrap_or(subset.material);
        }
        let proto = add_prototype(protos, kind.name, mesh)?;
        self.known.insert((summer, look), proto);
        Ok(proto)
    }

    fn bud(&mut self, protos: &mut Vec<Proto>, bud: BudOrgan, name: &str) -> Result<u16> {
        if let Some(proto) = self.buds.get(&bud.material) {
            return Ok(*proto);
        }
        let proto = add_prototype(protos, name, bud_mesh().with_material(bud.material))?;
        self.buds.insert(bud.material, proto);
        Ok(proto)
    }
}

/// Adds a prototype under the name of an organ and a free number; returns its index.
fn add_prototype(protos: &mut Vec<Proto>, organ: &str, mesh: osier_scene::Mesh) -> Result<u16> {
    let index: u16 = narrow(protos.len() as u64, "prototypes of a plant")?;
    // There is one number more than there are prototypes, so that at least one name is free.
    let numbers = protos.len()..=2 * protos.len();
    let name = numbers.map(|n| format!("{organ}_{n}")).find(|name| protos.iter().all(|p| p.name != *name));
    protos.push(Proto { name: name.unwrap_or_else(|| organ.to_owned()), mesh: Arc::new(mesh) });
    Ok(index)
}
