//! The record tables `drops`, `events` and `leaves` of each frame, and the slots of falling drops in the point cloud.

use std::collections::{BTreeMap, BTreeSet};

use glam::{DVec3, Quat, Vec3};

use osier_base::Result;
use osier_base::convert::index;
use osier_base::math::narrow;
use osier_motion::rain::{DropEventKind, RainEvent, RainFrame, RainLeaf, SessileDrop, sphere_diameter};
use osier_scene::{CodeList, RecordColumn, RecordTable, attribute_number};

/// Number of frames for which a slot stays empty after its drop is gone, so that motion blur does not draw a streak to the next
/// drop in it.
const SLOT_PAUSE: u64 = 2;
/// Speed above which a drop on a leaf counts as running, m/s. Own: by eye; a smaller speed counts creeping drops too.
pub(super) const RUNNING_SPEED: f64 = 1e-3;
/// Cubic millimetres in a cubic metre; point tables have volumes in mm^3.
const CUBIC_MM_PER_M3: f64 = 1e9;
/// Value of a signed column that means "no leaf" or "no second drop".
const MISSING: i32 = -1;

/// State of a drop; the discriminant is the number in the column `state`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum DropState {
    Airborne,
    /// On a leaf, at most as fast as [`RUNNING_SPEED`].
    Resting,
    /// On a leaf, faster than [`RUNNING_SPEED`].
    Running,
    /// Pendant at a leaf's margin.
    Hanging,
    /// A cap of the tail of the drop that precedes it in the list; it contains a share of that drop's water.
    Tail,
}

impl DropState {
    /// All states in the order of their numbers, with their words in the code list.
    const ALL: [(Self, &'static str); 5] = [
        (Self::Airborne, "falls"),
        (Self::Resting, "rests"),
        (Self::Running, "runs"),
        (Self::Hanging, "hangs"),
        (Self::Tail, "tail"),
    ];
}

/// One row of the table `drops`; positions and directions in world space.
#[derive(Debug, Clone, Copy, PartialEq)]
struct DropRecord {
    /// Number of the drop, the same in all frames, counted from 0 in the order in which drops appear in the clip.
    id: u32,
    state: DropState,
    /// Number of the drop's leaf, counted from 0 over all plants in the order of their placements; `None` in the air.
    leaf: Option<u32>,
    /// Number of caps of its tail that follow it in the list.
    tail: u32,
    /// Texture coordinates on the leaf; 0 in the air.
    uv: [f32; 2],
    /// Side of the leaf: 1 the upper one, -1 the lower one; 0 in the air and at the margin.
    side: f32,
    /// Centre, m: of the footprint on the leaf, of the circle that the drop hangs from, or of the airborne drop.
    position: Vec3,
    /// Volume, m^3; for a head, without its tail.
    volume: f64,
    /// Velocity, m/s, including that of the leaf.
    velocity: Vec3,
    /// Radius, m: of the footprint, of the circle that the drop hangs from, or of the airborne drop.
    a: f32,
    /// Height of the cap above the leaf, m; 0 for drops that do not lie on a leaf.
    height: f32,
    /// Stretch q of the footprint, 1 for a circle: its semi-axes are `a` q along `axis` and `a` / q across it.
    q: f32,
    /// Skew of the cap along its axis, 0 or more.
    s: f32,
    /// Long axis of the footprint, or direction of hanging; a unit vector, 0 in the air.
    axis: Vec3,
    /// Necking of a pendant drop: 0 for none, 1 at detachment.
    thin: f32,
}

/// One row of the table `leaves`.
#[derive(Debug, Clone, Copy)]
struct LeafRecord {
    /// Number of the leaf, as [`DropRecord::leaf`].
    leaf: u32,
    /// Number of drops that rest on the leaf, run on it or hang from it.
    drops: u32,
    /// Volume of these drops, m^3.
    volume: f64,
    /// Mean wetness of the blade, 0 to 1.
    wetness: f32,
    /// Pivot in the world, m.
    position: Vec3,
    /// World from leaf space.
    rotation: Quat,
}

/// Consecutive numbers for the ids of a clip's drops, in the order in which frames contain them: first as drops, then in
/// events.
pub(super) fn number_drops(frames: &[RainFrame]) -> Result<BTreeMap<u64, u32>> {
    let mut known = BTreeMap::new();
    for frame in frames {
        // Ids are hashes. Small numbers in the order of appearance do not change when the clip is made longer.
        let on_leaves = frame.sessile.iter().map(|d| d.id).chain(frame.pendant.iter().map(|d| d.id));
        let in_frame = on_leaves.chain(frame.airborne.iter().map(|d| d.id));
        let in_events = frame.events.iter().flat_map(|e| e.other.into_iter().chain([e.id]));
        for id in in_frame.chain(in_events) {
            let next = index(known.len(), "raindrops of a clip")?;
            known.entry(id).or_insert(next);
        }
    }
    Ok(known)
}

/// The code lists of the columns `state` and `what`. Scenes without rain have them too, so that readers of the manifest can rely on
/// the keys.
pub fn enum_labels() -> Vec<CodeList> {
    vec![
        CodeList { name: "states", words: DropState::ALL.map(|(_, word)| word).to_vec() },
        CodeList { name: "events", words: DropEventKind::ALL.map(|(_, word)| word).to_vec() },
    ]
}

/// The record tables of a frame: all drops, the events since the frame before in the order of time steps, and all leaves.
/// `start`: time of the clip's first frame, s, from which the column `t` counts.
pub(super) fn record_tables(
    frame: &RainFrame,
    leaves: &[RainLeaf],
    numbers: &BTreeMap<u64, u32>,
    start: f64,
) -> Vec<RecordTable> {
    let number = |id: &u64| numbers.get(id).copied().unwrap_or(u32::MAX);
    let drops = drop_table(&drop_records(frame, leaves, &number));
    vec![drops, event_table(&frame.events, &number, start), leaf_table(frame)]
}

/// All drops of a frame as points, in the order of the table `drops`. `wetness`: the mean of the leaf that a drop is on, 0 in the air.
pub(super) fn drop_points(frame: &RainFrame, leaves: &[RainLeaf], numbers: &BTreeMap<u64, u32>) -> RecordTable {
    let number = |id: &u64| numbers.get(id).copied().unwrap_or(u32::MAX);
    let drops = drop_records(frame, leaves, &number);
    let wetness = |d: &DropRecord| d.leaf.and_then(|leaf| frame.wetness.get(leaf as usize)).copied().unwrap_or(0.0);
    let mut columns = Vec::from(identity_columns(&drops));
    columns.extend(motion_columns(&drops));
    columns.extend([
        RecordColumn::f32("radius", "m", &drops, |d| d.a),
        RecordColumn::f64("volume_mm3", "mm^3", &drops, |d| d.volume * CUBIC_MM_PER_M3),
        RecordColumn::f32("wetness", "", &drops, |d| narrow(wetness(d))),
    ]);
    RecordTable { name: "drops", columns }
}

/// Records of all drops: sessile ones, each followed by its tail, then pendant ones, then airborne ones.
fn drop_records(frame: &RainFrame, leaves: &[RainLeaf], number: &impl Fn(&u64) -> u32) -> Vec<DropRecord> {
    let mut records = Vec::new();
    for d in &frame.sessile {
        record_sessile_drop(frame, d, &leaves[d.leaf], number(&d.id), &mut records);
    }
    records.extend(frame.pendant.iter().map(|d| {
        let blade = &frame.leaf_poses[d.leaf];
        // Pendant drops are kept in leaf space, so that they follow the blade between steps.
        let p = blade.position + blade.orientation * d.p;
        DropRecord {
            leaf: u32::try_from(d.leaf).ok(),
            position: p.as_vec3(),
            velocity: blade.velocity_at(p).as_vec3(),
            a: narrow(d.radius),
            axis: (blade.orientation * d.axis).as_vec3(),
            thin: narrow(d.necking),
            ..base_record(number(&d.id), DropState::Hanging, d.volume)
        }
    }));
    records.extend(frame.airborne.iter().map(|d| DropRecord {
        position: d.p.as_vec3(),
        velocity: d.v.as_vec3(),
        a: narrow(sphere_diameter(d.volume) / 2.0),
        ..base_record(number(&d.id), DropState::Airborne, d.volume)
    }));
    records
}

/// Columns that identify each drop, common to the tables of records and of points.
fn identity_columns(drops: &[DropRecord]) -> [RecordColumn; 3] {
    [
        RecordColumn::u32("id", "", drops, |d| d.id),
        RecordColumn::u32("state", "", drops, |d| d.state as u32),
        RecordColumn::i32("leaf", "", drops, |d| number_or_none(d.leaf)),
    ]
}

/// Columns of position and velocity in world space, common to the tables of records and of points.
fn motion_columns(drops: &[DropRecord]) -> [RecordColumn; 6] {
    let f32s = |name, unit, value: fn(&DropRecord) -> f32| RecordColumn::f32(name, unit, drops, value);
    [
        f32s("x", "m", |d| d.position.x),
        f32s("y", "m", |d| d.position.y),
        f32s("z", "m", |d| d.position.z),
        f32s("vx", "m/s", |d| d.velocity.x),
        f32s("vy", "m/s", |d| d.velocity.y),
        f32s("vz", "m/s", |d| d.velocity.z),
    ]
}

fn drop_table(drops: &[DropRecord]) -> RecordTable {
    let f32s = |name, unit, value: fn(&DropRecord) -> f32| RecordColumn::f32(name, unit, drops, value);
    let mut columns = Vec::from(identity_columns(drops));
    columns.extend([
        RecordColumn::u32("tail", "", drops, |d| d.tail),
        RecordColumn::f64("volume", "m^3", drops, |d| d.volume),
        f32s("u", "", |d| d.uv[0]),
        f32s("v", "", |d| d.uv[1]),
        f32s("side", "", |d| d.side),
    ]);
    columns.extend(motion_columns(drops));
    columns.extend([
        f32s("a", "m", |d| d.a),
        f32s("height", "m", |d| d.height),
        f32s("q", "", |d| d.q),
        f32s("s", "", |d| d.s),
        f32s("ax", "", |d| d.axis.x),
        f32s("ay", "", |d| d.axis.y),
        f32s("az", "", |d| d.axis.z),
        f32s("thin", "", |d| d.thin),
    ]);
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

/// The table `leaves`: one row per leaf, with the number and volume of the drops on it.
fn leaf_table(frame: &RainFrame) -> RecordTable {
    let blades = (0_u32..).zip(&frame.leaf_poses).zip(&frame.wetness);
    let mut leaves: Vec<LeafRecord> = blades
        .map(|((leaf, blade), wetness)| LeafRecord {
            leaf,
            drops: 0,
            volume: 0.0,
            wetness: narrow(*wetness),
            position: blade.position.as_vec3(),
            rotation: blade.orientation.as_quat(),
        })
        .collect();
    // The water on a leaf is that of drops that rest or run on it, and of drops that hang from its margin.
    let sessile = frame.sessile.iter().map(|d| (d.leaf, d.volume));
    for (leaf, volume) in sessile.chain(frame.pendant.iter().map(|d| (d.leaf, d.volume))) {
        leaves[leaf].drops += 1;
        leaves[leaf].volume += volume;
    }
    let f32s = |name, unit, value: fn(&LeafRecord) -> f32| RecordColumn::f32(name, unit, &leaves, value);
    let columns = vec![
        RecordColumn::u32("leaf", "", &leaves, |l| l.leaf),
        RecordColumn::u32("drops", "", &leaves, |l| l.drops),
        RecordColumn::f64("volume", "m^3", &leaves, |l| l.volume),
        f32s("wetness", "", |l| l.wetness),
        f32s("x", "m", |l| l.position.x),
        f32s("y", "m", |l| l.position.y),
        f32s("z", "m", |l| l.position.z),
        f32s("qx", "", |l| l.rotation.x),
        f32s("qy", "", |l| l.rotation.y),
        f32s("qz", "", |l| l.rotation.z),
        f32s("qw", "", |l| l.rotation.w),
    ];
    RecordTable { name: "leaves", columns }
}

/// A number in a signed column; [`MISSING`] for `None`.
fn number_or_none(number: Option<u32>) -> i32 {
    number.map_or(MISSING, attribute_number)
}

/// A record with 0 in all columns that only some states have.
fn base_record(id: u32, state: DropState, volume: f64) -> DropRecord {
    DropRecord {
        id,
        state,
        leaf: None,
        tail: 0,
        uv: [0.0; 2],
        side: 0.0,
        position: Vec3::ZERO,
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

/// Appends the records of a sessile drop: its head, then the caps of its tail.
fn record_sessile_drop(frame: &RainFrame, d: &SessileDrop, leaf: &RainLeaf, id: u32, out: &mut Vec<DropRecord>) {
    let blade = &frame.leaf_poses[d.leaf];
    // The velocity of a sessile drop is relative to its leaf.
    let running = d.v.length() > RUNNING_SPEED;
    let head = if running { DropState::Running } else { DropState::Resting };
    #[allow(clippy::cast_possible_truncation, reason = "at most rain.drop.tail_drops caps")]
    let tail = d.caps.len().saturating_sub(1) as u32;
    // Cap 0 is the head; only it is deformed by the motion, the caps of the tail are spherical.
    for (k, bead) in d.caps.iter().enumerate() {
        // The texture coordinates determine the point on the blade; the pose of the blade transforms it to the world.
        let p = blade.position + blade.orientation * leaf.point_at(bead.uv).map_or(DVec3::ZERO, |s| s.p);
        let (q, s) = if k == 0 { (d.deformation.stretch, d.deformation.skew) } else { (1.0, 0.0) };
        out.push(DropRecord {
            leaf: u32::try_from(d.leaf).ok(),
            tail: if k == 0 { tail } else { 0 },
            uv: bead.uv.as_vec2().to_array(),
            side: narrow(d.side),
            position: p.as_vec3(),
            velocity: (blade.velocity_at(p) + blade.orientation * d.v).as_vec3(),
            a: narrow(bead.cap.a),
            height: narrow(bead.cap.top()),
            q: narrow(q),
            s: narrow(s),
            axis: (blade.orientation * d.axis).as_vec3(),
            ..base_record(id, if k == 0 { head } else { DropState::Tail }, bead.volume)
        });
    }
}

/// Slots of the airborne drops of each frame, and the number of slots that the clip needs. A drop keeps its slot while it falls;
/// a slot that becomes free is not used for [`SLOT_PAUSE`] frames, after which the lowest free slot is used first.
pub(super) fn assign_point_slots(frames: &[RainFrame]) -> (Vec<Vec<u32>>, usize) {
    // Slot of each airborne drop, and the last frame that contains it.
    let mut held: BTreeMap<u64, (u32, u64)> = BTreeMap::new();
    let mut free: BTreeSet<u32> = BTreeSet::new();
    let mut pausing: Vec<(u64, u32)> = Vec::new();
    let mut count = 0_u32;
    let mut all = Vec::new();
    for (number, frame) in (0_u64..).zip(frames) {
        // Return the slots whose pause has ended to the free slots; `insert` is true for each of them, which removes it from the
        // list.
        pausing.retain(|(until, slot)| *until > number || !free.insert(*slot));
        let mut in_frame = Vec::with_capacity(frame.airborne.len());
        for drop in &frame.airborne {
            let slot = held.get(&drop.id).map_or_else(
                || {
                    free.pop_first().unwrap_or_else(|| {
                        count += 1;
                        count - 1
                    })
                },
                |s| s.0,
            );
            held.insert(drop.id, (slot, number));
            in_frame.push(slot);
        }
        // Drops that this frame no longer contains have landed: their slots pause.
        held.retain(|_, (slot, seen)| {
            let stays = *seen == number;
            if !stays {
                pausing.push((number + SLOT_PAUSE, *slot));
            }
            stays
        });
        all.push(in_frame);
    }
    (all, count as usize)
}
