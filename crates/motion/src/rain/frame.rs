//! The state of rain at a frame: all that maps and meshes are made from.

use glam::DVec3;

use crate::rain::bark_wetness::WoodStrike;
use crate::rain::drops::rain_leaf::{DropCounters, WetSpot};
use crate::rain::drops::spherical_cap::CapDeformation;
use crate::rain::drops::surface_drop::DropCap;
use crate::rain::event::RainEvent;
use crate::rain::maps::CapOnLeaf;
use crate::rain::simulation::{ImpactMomentum, LeafWetSpot, RainSimulation, WaterBudget};
use crate::rain::target::LeafPose;
use crate::rain::tuning::NECKING_TIME;

/// A drop that rests on a leaf or runs, with its tail, as meshes and tables need it.
#[derive(Debug, Clone, PartialEq)]
pub struct SessileDrop {
    /// Identifier; stable over frames, threads and time steps. A raindrop keeps it from its emission on.
    pub id: u64,
    /// Index of the leaf that it is on.
    pub leaf: usize,
    /// Side of the leaf: 1 on the upper, -1 on the lower.
    pub side: f64,
    /// Caps of the head and the tail, the head first, in the chart of the leaf.
    pub caps: Vec<DropCap>,
    /// Stretch and skew of the head.
    pub deformation: CapDeformation,
    /// Unit tangent along which the head is stretched and sheared, in leaf space.
    pub axis: DVec3,
    /// Velocity relative to the leaf, in leaf space, m/s.
    pub v: DVec3,
    /// Volume with the tail, m^3.
    pub volume: f64,
}

/// A drop that hangs from the margin of a leaf.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PendantDrop {
    /// Identifier, the same as that of the sessile drop that it was before.
    pub id: u64,
    /// Index of the leaf that it hangs from.
    pub leaf: usize,
    /// Center of the attachment in leaf space, m.
    pub p: DVec3,
    /// Radius of the circle along which it is attached, m.
    pub radius: f64,
    /// Unit vector of the direction in which it hangs, in leaf space.
    pub axis: DVec3,
    /// Volume of all water that hangs there, m^3.
    pub volume: f64,
    /// Progress of necking: 0 while it is stable, 1 when it detaches.
    pub necking: f64,
}

/// A drop in the air at the time of the frame: raindrop, splash droplet or water that has left a leaf.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AirborneDrop {
    /// Identifier; stable over frames, threads and time steps. A part of a drop that detaches gets a new one.
    pub id: u64,
    /// Position in the world, m.
    pub p: DVec3,
    /// Velocity in the world, m/s.
    pub v: DVec3,
    /// Volume of the drop, m^3.
    pub volume: f64,
}

/// The water of one leaf at a frame, as its maps need it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LeafMapInput {
    /// Caps of the drops on the upper side.
    pub caps: Vec<CapOnLeaf>,
    /// Spots that became wet since the last frame.
    pub wet_spots: Vec<WetSpot>,
}

/// State of rain at one frame, copied from the simulation; maps, meshes and record tables are written from it.
#[derive(Debug, Clone, Default)]
pub struct RainFrame {
    /// Time since the simulation began, s.
    pub t: f64,
    /// Poses of the leaves, by leaf index.
    pub leaf_poses: Vec<LeafPose>,
    /// Mean wetness of the leaves, by leaf index: 0 (dry) to 1.
    pub wetness: Vec<f64>,
    /// Drops that rest or run on leaves, ordered by leaf.
    pub sessile: Vec<SessileDrop>,
    /// Drops that hang from margins, ordered by leaf.
    pub pendant: Vec<PendantDrop>,
    /// Drops in the air, in no particular order.
    pub airborne: Vec<AirborneDrop>,
    /// Spots that became wet since the last frame.
    pub wet_spots: Vec<LeafWetSpot>,
    /// Drops that struck wood since the last frame; for the first frame, since the simulation began.
    pub wood_strikes: Vec<WoodStrike>,
    /// Events since the last frame; for the first frame, since they were last taken from the simulation.
    pub events: Vec<RainEvent>,
    /// Counts of events, and the largest impulse, since the simulation began.
    pub counters: DropCounters,
    /// Volumes of water in the air, on leaves and elsewhere; their sum is the emitted volume.
    pub water_budget: WaterBudget,
    /// Momentum of the impacts since the simulation began.
    pub impact_momentum: ImpactMomentum,
}

impl RainFrame {
    /// Copies the present state of a simulation, and takes its events and wet spots since the last frame out of it.
    pub fn capture(simulation: &mut RainSimulation) -> Self {
        let mut wet_spots = simulation.take_wet_spots();
        let params = &simulation.params;
        let (mut sessile, mut pendant) = (Vec::new(), Vec::new());
        for (i, leaf) in simulation.leaves().iter().enumerate() {
            for d in &leaf.drops {
                if let Some(anchor) = d.pendant {
                    pendant.push(PendantDrop {
                        id: d.id,
                        leaf: i,
                        p: anchor.margin.p,
                        radius: anchor.radius,
                        axis: d.axis,
                        volume: d.volume,
                        necking: anchor.necking.map_or(0.0, |t| (t / NECKING_TIME).min(1.0)),
                    });
                    continue;
                }
                let caps = d.caps(params);
                // All texels under caps are wet now. The head has also covered its path since the last recorded spot.
                wet_spots.extend(caps.iter().enumerate().map(|(k, cap)| {
                    let from = if k == 0 { d.last_wet_uv.unwrap_or(cap.uv) } else { cap.uv };
                    let spot = WetSpot { uv: cap.uv, from, a: cap.cap.a, t: simulation.time() };
                    LeafWetSpot { leaf: i, spot }
                }));
                sessile.push(SessileDrop {
                    id: d.id,
                    leaf: i,
                    side: d.side,
                    caps,
                    deformation: d.cap_deformation(params),
                    axis: d.axis,
                    v: d.v,
                    volume: d.volume,
                });
            }
        }
        let airborne =
            simulation.falling_drops().iter().map(|d| AirborneDrop { id: d.id, p: d.p, v: d.v, volume: d.volume });
        Self {
            t: simulation.time(),
            leaf_poses: simulation.poses().to_vec(),
            wetness: simulation
                .leaves()
                .iter()
                .map(|l| l.mean_wetness(simulation.time(), &simulation.params))
                .collect(),
            sessile,
            pendant,
            airborne: airborne.collect(),
            wet_spots,
            wood_strikes: simulation.take_wood_strikes(),
            events: simulation.take_events(),
            counters: simulation.counters(),
            water_budget: simulation.water_budget(),
            impact_momentum: simulation.impact_momentum(),
        }
    }

    /// Bytes of memory that its lists use, for the memory limit of a clip.
    pub fn memory_bytes(&self) -> u64 {
        let caps: usize = self.sessile.iter().map(|d| d.caps.len()).sum();
        // Lengths, not capacities: all frames of a clip together must fit the limit.
        let lists = [
            self.leaf_poses.len() * (size_of::<LeafPose>() + size_of::<f64>()),
            self.sessile.len() * size_of::<SessileDrop>(),
            caps * size_of::<DropCap>(),
            self.pendant.len() * size_of::<PendantDrop>(),
            self.airborne.len() * size_of::<AirborneDrop>(),
            self.wet_spots.len() * size_of::<LeafWetSpot>(),
            self.wood_strikes.len() * size_of::<WoodStrike>(),
            self.events.len() * size_of::<RainEvent>(),
        ];
        lists.iter().sum::<usize>() as u64
    }

    /// The water on one leaf. Only drops of the upper side have caps in it, as only that side has maps.
    pub fn leaf_map_input(&self, leaf: usize) -> LeafMapInput {
        let mut caps = Vec::new();
        for d in self.sessile.iter().filter(|d| d.leaf == leaf && d.side > 0.0) {
            for (k, cap) in d.caps.iter().enumerate() {
                // Only the head is deformed.
                let deformation = if k == 0 { d.deformation } else { CapDeformation::ROUND };
                caps.push(CapOnLeaf { uv: cap.uv, cap: cap.cap, deformation, axis: d.axis });
            }
        }
        let wet_spots = self.wet_spots.iter().filter(|s| s.leaf == leaf).map(|s| s.spot).collect();
        LeafMapInput { caps, wet_spots }
    }
}
