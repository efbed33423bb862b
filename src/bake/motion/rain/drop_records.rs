//! Drops as numbers: what frames say of each, and which point of the cloud of falling ones shows it.

use std::collections::{BTreeMap, BTreeSet};

use glam::{DVec3, Vec3};

use osier_base::math::narrow;
use osier_motion::rain::{RainEvent, RainFrame, RainLeaf, SessileDrop, sphere_diameter};
use osier_scene::{DropEvent, DropNow, DropState, Drops, LeafNow};

/// Frames for which a point's slot stays empty after its drop is gone, so that no blur joins two drops.
const PAUSE: u64 = 2;
/// Speed from which a drop on a leaf counts as running, m/s.
pub(super) const RUNS: f64 = 1e-3;

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

/// What a frame says of drops. `start`: time of the clip's first frame, s.
pub(super) fn drops(moment: &RainFrame, leaves: &[RainLeaf], numbers: &BTreeMap<u64, u32>, start: f64) -> Drops {
    let number = |id: &u64| numbers.get(id).copied().unwrap_or(u32::MAX);
    let mut now = Vec::new();
    for d in &moment.sessile {
        lies(moment, (d, &leaves[d.leaf]), number(&d.id), &mut now);
    }
    now.extend(moment.pendant.iter().map(|d| {
        let blade = &moment.leaf_poses[d.leaf];
        let p = blade.position + blade.orientation * d.p;
        DropNow {
            leaf: u32::try_from(d.leaf).ok(),
            place: p.as_vec3(),
            velocity: blade.velocity_at(p).as_vec3(),
            a: narrow(d.radius),
            axis: (blade.orientation * d.axis).as_vec3(),
            thin: narrow(d.necking),
            ..plain(number(&d.id), DropState::Hangs, d.volume)
        }
    }));
    now.extend(moment.airborne.iter().map(|d| DropNow {
        place: d.p.as_vec3(),
        velocity: d.v.as_vec3(),
        a: narrow(sphere_diameter(d.volume) / 2.0),
        ..plain(number(&d.id), DropState::Falls, d.volume)
    }));
    let events = moment.events.iter().map(|e| event(e, number(&e.id), e.other.map(|id| number(&id)), start));
    let leaves = moment.leaf_poses.iter().zip(&moment.wetness).map(|(blade, wetness)| LeafNow {
        drops: 0,
        volume: 0.0,
        wetness: narrow(*wetness),
        place: blade.position.as_vec3(),
        turn: blade.orientation.as_quat(),
    });
    let mut leaves: Vec<LeafNow> = leaves.collect();
    let lying = moment.sessile.iter().map(|d| (d.leaf, d.volume));
    for (leaf, volume) in lying.chain(moment.pendant.iter().map(|d| (d.leaf, d.volume))) {
        leaves[leaf].drops += 1;
        leaves[leaf].volume += volume;
    }
    Drops { now, events: events.collect(), leaves }
}

/// A drop on nothing.
fn plain(id: u32, state: DropState, volume: f64) -> DropNow {
    DropNow {
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
fn lies(moment: &RainFrame, (d, leaf): (&SessileDrop, &RainLeaf), id: u32, out: &mut Vec<DropNow>) {
    let blade = &moment.leaf_poses[d.leaf];
    let running = d.v.length() > RUNS;
    let head = if running { DropState::Runs } else { DropState::Rests };
    for (k, bead) in d.caps.iter().enumerate() {
        let p = blade.position + blade.orientation * leaf.point_at(bead.uv).map_or(DVec3::ZERO, |s| s.p);
        let tail = u32::try_from(d.caps.len() - 1).unwrap_or(u32::MAX);
        let (q, s) = if k == 0 { (d.footprint.stretch, d.footprint.skew) } else { (1.0, 0.0) };
        out.push(DropNow {
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

fn event(e: &RainEvent, id: u32, other: Option<u32>, start: f64) -> DropEvent {
    DropEvent {
        what: e.kind,
        t: e.t - start,
        id,
        other,
        leaf: e.leaf.and_then(|l| u32::try_from(l).ok()),
        place: e.p.as_vec3(),
        volume: e.volume,
        blow: narrow(e.impulse),
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
