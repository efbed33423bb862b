//! What a frame shows of rain: all that maps and meshes are made from.

use glam::DVec3;

use crate::rain::drops::drop::DropCap;
use crate::rain::drops::pendant::NECKING_TIME;
use crate::rain::drops::rain_leaf::{DropCounters, WetSpot};
use crate::rain::drops::shape::Footprint;
use crate::rain::event::RainEvent;
use crate::rain::maps::CapOnLeaf;
use crate::rain::simulation::{RainSimulation, WaterBudget};
use crate::rain::target::LeafPose;

/// A drop that lies or runs, with its tail.
#[derive(Debug, Clone, PartialEq)]
pub struct SessileDrop {
    /// By birth.
    pub id: u64,
    /// Its leaf.
    pub leaf: usize,
    /// 1 on the upper side, -1 below.
    pub side: f64,
    /// The head first.
    pub beads: Vec<DropCap>,
    /// Footprint of its head.
    pub print: Footprint,
    /// Long axis of that, of leaf space.
    pub axis: DVec3,
    /// Of leaf space, m/s.
    pub v: DVec3,
    /// m^3.
    pub volume: f64,
}

/// A drop that hangs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PendantDrop {
    /// By birth.
    pub id: u64,
    /// Its leaf.
    pub leaf: usize,
    /// Where, of leaf space, m.
    pub p: DVec3,
    /// Radius of the circle that it hangs from, m.
    pub radius: f64,
    /// Where it hangs to, unit, of leaf space.
    pub axis: DVec3,
    /// m^3.
    pub volume: f64,
    /// How far it has thinned, from 0 to 1, when it falls.
    pub thin: f64,
}

/// A drop in the air.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AirborneDrop {
    /// By birth.
    pub id: u64,
    /// m.
    pub p: DVec3,
    /// m/s.
    pub v: DVec3,
    /// m^3.
    pub volume: f64,
}

/// Rain at one frame.
#[derive(Debug, Clone, Default)]
pub struct RainFrame {
    /// s.
    pub t: f64,
    /// Where the leaves are.
    pub blades: Vec<LeafPose>,
    /// How wet each of them is as a whole, 0 to 1.
    pub wetness: Vec<f64>,
    /// On leaves.
    pub lying: Vec<SessileDrop>,
    /// At their margins.
    pub hanging: Vec<PendantDrop>,
    /// In the air.
    pub air: Vec<AirborneDrop>,
    /// Places that came under water since the last frame, by leaf.
    pub soaked: Vec<(usize, WetSpot)>,
    /// What has happened since the last frame, or since the rain began.
    pub events: Vec<RainEvent>,
    /// What has happened so far, in numbers.
    pub tally: DropCounters,
    /// Where all water is.
    pub water_budget: WaterBudget,
}

impl RainFrame {
    /// A simulation as it is.
    pub fn of(simulation: &mut RainSimulation) -> Self {
        let mut soaked = simulation.take_wet_spots();
        let params = &simulation.params;
        let (mut lying, mut hanging) = (Vec::new(), Vec::new());
        for (i, leaf) in simulation.leaves().iter().enumerate() {
            for d in &leaf.drops {
                if let Some(hang) = d.pendant {
                    let p = hang.margin.p;
                    let (id, axis, volume) = (d.id, d.axis, d.volume);
                    let thin = hang.necking.map_or(0.0, |t| (t / NECKING_TIME).min(1.0));
                    hanging.push(PendantDrop { id, leaf: i, p, radius: hang.radius, axis, volume, thin });
                    continue;
                }
                let facing = leaf.at(d.uv).map_or(1.0, |s| (simulation.poses()[i].orientation * s.n).y.abs());
                let beads = d.caps(params, facing);
                soaked.extend(beads.iter().map(|b| (i, WetSpot { uv: b.uv, a: b.cap.a, t: simulation.time() })));
                let print = d.footprint(params);
                let (id, axis, v, volume) = (d.id, d.axis, d.v, d.volume);
                lying.push(SessileDrop { id, leaf: i, side: d.side, beads, print, axis, v, volume });
            }
        }
        let air =
            |d: &crate::rain::simulation::FallingDrop| AirborneDrop { id: d.id, p: d.p, v: d.v, volume: d.volume };
        Self {
            t: simulation.time(),
            blades: simulation.poses().to_vec(),
            wetness: simulation.leaves().iter().map(|l| l.wetness(simulation.time(), &simulation.params)).collect(),
            lying,
            hanging,
            air: simulation.air().iter().map(air).collect(),
            soaked,
            events: simulation.take_events(),
            tally: simulation.counters(),
            water_budget: simulation.water_budget(),
        }
    }

    /// Bytes that it keeps.
    pub fn bytes(&self) -> u64 {
        let beads: usize = self.lying.iter().map(|d| d.beads.len()).sum();
        let parts = [
            self.blades.len() * (size_of::<LeafPose>() + size_of::<f64>()),
            self.lying.len() * size_of::<SessileDrop>(),
            beads * size_of::<DropCap>(),
            self.hanging.len() * size_of::<PendantDrop>(),
            self.air.len() * size_of::<AirborneDrop>(),
            self.soaked.len() * size_of::<(usize, WetSpot)>(),
            self.events.len() * size_of::<RainEvent>(),
        ];
        parts.iter().sum::<usize>() as u64
    }

    /// What the maps of a leaf need: its caps, and where it was soaked. Only what lies on its upper side.
    pub fn on(&self, leaf: usize) -> (Vec<CapOnLeaf>, Vec<WetSpot>) {
        let mut blobs = Vec::new();
        for d in self.lying.iter().filter(|d| d.leaf == leaf && d.side > 0.0) {
            for (k, bead) in d.beads.iter().enumerate() {
                let print = if k == 0 { d.print } else { Footprint { q: 1.0, skew: 0.0 } };
                blobs.push(CapOnLeaf { uv: bead.uv, cap: bead.cap, print, axis: d.axis });
            }
        }
        let soaks = self.soaked.iter().filter(|(i, _)| *i == leaf).map(|(_, s)| *s).collect();
        (blobs, soaks)
    }
}
