//! Drops as numbers: the record tables `drops`, `events` and `leaves` of each frame, and which point of the cloud of falling
//! drops shows which drop.

use std::collections::{BTreeMap, BTreeSet};

use glam::{DVec3, Quat, Vec3};

use osier_base::math::narrow;
use osier_motion::rain::{DropEventKind, RainEvent, RainFrame, RainLeaf, SessileDrop, sphere_diameter};
use osier_scene::{CodeList, RecordColumn, RecordTable};

/// Frames for which a point's slot stays empty after its drop is gone, so that no blur joins two drops.
const PAUSE: u64 = 2;
/// Speed from which a drop on a leaf counts as running, m/s.
pub(super) const RUNS: f64 = 1e-3;
/// What is written for a leaf or a second drop where there is none.
const NONE: i32 = -1;

/// What a drop does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum DropState {
    /// It falls.
    Falls,
    /// It lies on a leaf.
    Rests,
    /// It moves over a leaf, faster than 1 mm/s.
    Runs,
    /// It hangs at a leaf's margin.
    Hangs,
    /// It is a cap of the tail of the drop before it in the list, with a share of that one's water.
    Tail,
}

impl DropState {
    /// All, in the order of their numbers, with the words for them.
    const ALL: [(Self, &'static str); 5] = [
        (Self::Falls, "falls"),
        (Self::Rests, "rests"),
        (Self::Runs, "runs"),
        (Self::Hangs, "hangs"),
        (Self::Tail, "tail"),
    ];
}

/// A drop at a frame. Places and directions in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
struct DropRecord {
    /// Its number, the same at all frames: counted from 0 as drops are first seen in the clip.
    id: u32,
    /// What it does.
    state: DropState,
    /// The leaf that it is on, counted from 0 over all plants in the order of their places.
    leaf: Option<u32>,
    /// Caps of its tail that follow it in the list.
    tail: u32,
    /// Where on the leaf, texture coordinates; 0 in the air.
    uv: [f32; 2],
    /// Side of the leaf: 1 the upper one, -1 the lower one; 0 in the air and at the margin.
    side: f32,
    /// Middle, m: of the base on the leaf, of the circle that it hangs from, of the drop in the air.
    place: Vec3,
    /// m^3: of a head without its tail.
    volume: f64,
    /// m/s, the leaf's own motion in it.
    velocity: Vec3,
    /// Radius, m: of the base, of the circle that it hangs from, of the drop in the air.
    a: f32,
    /// Height over the leaf in its middle, m; 0 where it does not lie.
    height: f32,
    /// How much longer than round its footprint is, 1 or more.
    q: f32,
    /// How far it leans along its axis, 0 and more.
    s: f32,
    /// Long axis of its footprint, or where it hangs to; unit, 0 in the air.
    axis: Vec3,
    /// How far what hangs has thinned, 0 to 1, when it falls.
    thin: f32,
}

/// A leaf in the rain at a frame.
#[derive(Debug, Clone, Copy)]
struct LeafRecord {
    /// Its number, as [`DropRecord::leaf`].
    leaf: u32,
    /// Drops that lie, run or hang on it.
    drops: u32,
    /// Their water, m^3.
    volume: f64,
    /// Share of it that is wet, by how much.
    wetness: f32,
    /// Its pivot in the world, m.
    place: Vec3,
    /// World from leaf space.
    turn: Quat,
}

/// Small numbers for the drops of a clip, in the order in which its frames show them and tell of them.
pub(super) fn numbers(moments: &[RainFrame]) -> BTreeMap<u64, u32> {
    let mut known = BTreeMap::new();
    for m in moments {
        let seen =
            m.sessile.iter().map(|d| d.id).chain(m.pendant.iter().map(|d| d.id)).chain(m.airborne.iter().map(|d| d.id));
        let told = m.events.iter().flat_map(|e| e.other.into_iter().chain([e.id]));
        for id in seen.chain(told) {
            let next = u32::try_from(known.len()).unwrap_or(u32::MAX);
            known.entry(id).or_insert(next);
        }
    }
    known
}

/// The code lists of the columns `state` and `what`. Scenes without rain have them, too, so that their readers find the keys.
pub fn code_lists() -> Vec<CodeList> {
    vec![
        CodeList { name: "states", words: DropState::ALL.map(|(_, word)| word).to_vec() },
        CodeList { name: "events", words: DropEventKind::ALL.map(|(_, word)| word).to_vec() },
    ]
}

/// The tables of a frame: all drops, what happened to drops since the frame before in order of time steps, and all leaves.
/// `start`: time of the clip's first frame, s; the columns of times count from it.
pub(super) fn tables(
    moment: &RainFrame,
    leaves: &[RainLeaf],
    numbers: &BTreeMap<u64, u32>,
    start: f64,
) -> Vec<RecordTable> {
    let number = |id: &u64| numbers.get(id).copied().unwrap_or(u32::MAX);
    let drops = drop_table(&drops(moment, leaves, &number));
    vec![drops, event_table(&moment.events, &number, start), leaf_table(moment)]
}

/// All drops: on leaves with each head's tail right behind it, at margins, in the air.
fn drops(moment: &RainFrame, leaves: &[RainLeaf], number: &impl Fn(&u64) -> u32) -> Vec<DropRecord> {
    let mut now = Vec::new();
    for d in &moment.sessile {
        record_sessile_drop(moment, d, &leaves[d.leaf], number(&d.id), &mut now);
    }
    now.extend(moment.pendant.iter().map(|d| {
        let blade = &moment.leaf_poses[d.leaf];
        let p = blade.position + blade.orientation * d.p;
        DropRecord {
            leaf: u32::try_from(d.leaf).ok(),
            place: p.as_vec3(),
            velocity: blade.velocity_at(p).as_vec3(),
            a: narrow(d.radius),
            axis: (blade.orientation * d.axis).as_vec3(),
            thin: narrow(d.necking),
            ..plain(number(&d.id), DropState::Hangs, d.volume)
        }
    }));
    now.extend(moment.airborne.iter().map(|d| DropRecord {
        place: d.p.as_vec3(),
        velocity: d.v.as_vec3(),
        a: narrow(sphere_diameter(d.volume) / 2.0),
        ..plain(number(&d.id), DropState::Falls, d.volume)
    }));
    now
}

fn drop_table(drops: &[DropRecord]) -> RecordTable {
    let f32s = |name, unit, value: fn(&DropRecord) -> f32| RecordColumn::f32(name, unit, drops, value);
    let columns = vec![
        RecordColumn::u32("id", "", drops, |d| d.id),
        RecordColumn::u32("state", "", drops, |d| d.state as u32),
        RecordColumn::i32("leaf", "", drops, |d| number_or_none(d.leaf)),
        RecordColumn::u32("tail", "", drops, |d| d.tail),
        RecordColumn::f64("volume", "m^3", drops, |d| d.volume),
        f32s("u", "", |d| d.uv[0]),
        f32s("v", "", |d| d.uv[1]),
        f32s("side", "", |d| d.side),
        f32s("x", "m", |d| d.place.x),
        f32s("y", "m", |d| d.place.y),
        f32s("z", "m", |d| d.place.z),
        f32s("vx", "m/s", |d| d.velocity.x),
        f32s("vy", "m/s", |d| d.velocity.y),
        f32s("vz", "m/s", |d| d.velocity.z),
        f32s("a", "m", |d| d.a),
        f32s("height", "m", |d| d.height),
        f32s("q", "", |d| d.q),
        f32s("s", "", |d| d.s),
        f32s("ax", "", |d| d.axis.x),
        f32s("ay", "", |d| d.axis.y),
        f32s("az", "", |d| d.axis.z),
        f32s("thin", "", |d| d.thin),
    ];
    RecordTable { name: "drops", columns }
}

fn event_table(events: &[RainEvent], number: &impl Fn(&u64) -> u32, start: f64) -> RecordTable {
    let columns = vec![
        RecordColumn::f64("t", "s", events, |e| e.t - start),
        RecordColumn::f64("volume", "m^3", events, |e| e.volume),
        RecordColumn::u32("what", "", events, |e| e.kind as u32),
        RecordColumn::u32("id", "", events, |e| number(&e.id)),
        RecordColumn::i32("other", "", events, |e| number_or_none(e.other.map(|id| number(&id)))),
        RecordColumn::i32("leaf", "", events, |e| number_or_none(e.leaf.and_then(|l| u32::try_from(l).ok()))),
        RecordColumn::f32("x", "m", events, |e| e.p.as_vec3().x),
        RecordColumn::f32("y", "m", events, |e| e.p.as_vec3().y),
        RecordColumn::f32("z", "m", events, |e| e.p.as_vec3().z),
        RecordColumn::f32("blow", "N s", events, |e| narrow(e.impulse)),
    ];
    RecordTable { name: "events", columns }
}

/// All leaves with the drops that lie, run or hang on them.
fn leaf_table(moment: &RainFrame) -> RecordTable {
    let blades = (0_u32..).zip(&moment.leaf_poses).zip(&moment.wetness);
    let mut leaves: Vec<LeafRecord> = blades
        .map(|((leaf, blade), wetness)| LeafRecord {
            leaf,
            drops: 0,
            volume: 0.0,
            wetness: narrow(*wetness),
            place: blade.position.as_vec3(),
            turn: blade.orientation.as_quat(),
        })
        .collect();
    let lying = moment.sessile.iter().map(|d| (d.leaf, d.volume));
    for (leaf, volume) in lying.chain(moment.pendant.iter().map(|d| (d.leaf, d.volume))) {
        leaves[leaf].drops += 1;
        leaves[leaf].volume += volume;
    }
    let f32s = |name, unit, value: fn(&LeafRecord) -> f32| RecordColumn::f32(name, unit, &leaves, value);
    let columns = vec![
        RecordColumn::u32("leaf", "", &leaves, |l| l.leaf),
        RecordColumn::u32("drops", "", &leaves, |l| l.drops),
        RecordColumn::f64("volume", "m^3", &leaves, |l| l.volume),
        f32s("wetness", "", |l| l.wetness),
        f32s("x", "m", |l| l.place.x),
        f32s("y", "m", |l| l.place.y),
        f32s("z", "m", |l| l.place.z),
        f32s("qx", "", |l| l.turn.x),
        f32s("qy", "", |l| l.turn.y),
        f32s("qz", "", |l| l.turn.z),
        f32s("qw", "", |l| l.turn.w),
    ];
    RecordTable { name: "leaves", columns }
}

/// A number in a signed column, where something may be missing.
fn number_or_none(number: Option<u32>) -> i32 {
    number.and_then(|n| i32::try_from(n).ok()).unwrap_or(NONE)
}

/// A drop on nothing.
fn plain(id: u32, state: DropState, volume: f64) -> DropRecord {
    DropRecord {
        id,
        state,
        leaf: None,
        tail: 0,
        uv: [0.0; 2],
        side: 0.0,
        place: Vec3::ZERO,
        volume,
        velocity: Vec3::ZERO,
        a: 0.0,
        height: 0.0,
        q: 1.0,
        s: 0.0,
        axis: Vec3::ZERO,
        thin: 0.0,
    }
}

/// A drop on a leaf, and its tail.
fn record_sessile_drop(moment: &RainFrame, d: &SessileDrop, leaf: &RainLeaf, id: u32, out: &mut Vec<DropRecord>) {
    let blade = &moment.leaf_poses[d.leaf];
    let running = d.v.length() > RUNS;
    let head = if running { DropState::Runs } else { DropState::Rests };
    for (k, bead) in d.caps.iter().enumerate() {
        let p = blade.position + blade.orientation * leaf.point_at(bead.uv).map_or(DVec3::ZERO, |s| s.p);
        let tail = u32::try_from(d.caps.len() - 1).unwrap_or(u32::MAX);
        let (q, s) = if k == 0 { (d.deformation.stretch, d.deformation.skew) } else { (1.0, 0.0) };
        out.push(DropRecord {
            leaf: u32::try_from(d.leaf).ok(),
            tail: if k == 0 { tail } else { 0 },
            uv: bead.uv.as_vec2().to_array(),
            side: narrow(d.side),
            place: p.as_vec3(),
            velocity: (blade.velocity_at(p) + blade.orientation * d.v).as_vec3(),
            a: narrow(bead.cap.a),
            height: narrow(bead.cap.top()),
            q: narrow(q),
            s: narrow(s),
            axis: (blade.orientation * d.axis).as_vec3(),
            ..plain(id, if k == 0 { head } else { DropState::Tail }, bead.volume)
        });
    }
}

/// Slots of what is in the air, and how many are needed: a slot rests before it shows another drop.
pub(super) fn slots(moments: &[RainFrame]) -> (Vec<Vec<u32>>, usize) {
    let mut held: BTreeMap<u64, (u32, u64)> = BTreeMap::new();
    let mut free: BTreeSet<u32> = BTreeSet::new();
    let mut resting: Vec<(u64, u32)> = Vec::new();
    let mut count = 0_u32;
    let mut all = Vec::new();
    for (frame, moment) in (0_u64..).zip(moments) {
        resting.retain(|(until, slot)| *until > frame || !free.insert(*slot));
        let mut now = Vec::with_capacity(moment.airborne.len());
        for drop in &moment.airborne {
            let slot = held.get(&drop.id).map_or_else(
                || {
                    free.pop_first().unwrap_or_else(|| {
                        count += 1;
                        count - 1
                    })
                },
                |s| s.0,
            );
            held.insert(drop.id, (slot, frame));
            now.push(slot);
        }
        held.retain(|_, (slot, seen)| {
            let stays = *seen == frame;
            if !stays {
                resting.push((frame + PAUSE, *slot));
            }
            stays
        });
        all.push(now);
    }
    (all, count as usize)
}
