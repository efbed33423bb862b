//! A leaf in the rain with the drops on it, and the result of one of its steps.

use std::sync::Arc;

use glam::{DVec2, DVec3};

use super::drop::SurfaceDrop;
use crate::rain::event::RainEvent;
use crate::rain::leaf::surface::{LeafSurface, SurfacePoint};
use crate::rain::leaf::wetness::WetnessGrid;
use crate::rain::params::DropParams;
use crate::rain::target::LeafPose;
use osier_scene::DropEventKind;

/// A leaf with the drops on it.
#[derive(Debug, Clone)]
pub struct RainLeaf {
    /// Its blade, shared by all leaves of one form.
    pub sheet: Arc<LeafSurface>,
    /// Factor on the size of the blade.
    pub scale: f64,
    /// Drops on the leaf, ordered by identifier.
    pub drops: Vec<SurfaceDrop>,
    /// Where the leaf is wet.
    pub dew: WetnessGrid,
    /// Index that addresses the leaf's random draws.
    pub number: u64,
}

/// What acts on a leaf during one step.
#[derive(Debug, Clone, Copy)]
pub struct LeafStep<'a> {
    /// Pose and motion of the leaf at the end of the step.
    pub pose: LeafPose,
    /// Time at the end of the step, s.
    pub t: f64,
    /// Length of the step, s.
    pub h: f64,
    /// How drops behave.
    pub params: &'a DropParams,
}

/// Water that has left a leaf and falls from now on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DetachedDrop {
    /// Identifier of the drop that it was, or was a part of.
    pub id: u64,
    /// World position, m.
    pub p: DVec3,
    /// World velocity, m/s.
    pub v: DVec3,
    /// Volume, m^3.
    pub volume: f64,
    /// Whether nothing of the drop remains on the leaf.
    pub is_whole: bool,
}

/// A spot of a leaf that was under water at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WetSpot {
    /// Center, texture coordinates.
    pub uv: DVec2,
    /// Base radius of the drop that covered it, m.
    pub a: f64,
    /// Time, s.
    pub t: f64,
}

/// Numbers of events, and the largest impulse, since the simulation began.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct DropCounters {
    /// Impacts on leaves.
    pub struck: u64,
    /// Drops that merged into others.
    pub merged: u64,
    /// Beads left behind by tails.
    pub beads: u64,
    /// Drops that became pendant.
    pub hung: u64,
    /// Detachments, whole or partial.
    pub fell: u64,
    /// Largest impulse on a leaf, N s.
    pub hardest: f64,
}

impl DropCounters {
    /// Sums of the counts, and the larger of the impulses.
    pub fn combine(self, o: Self) -> Self {
        Self {
            struck: self.struck + o.struck,
            merged: self.merged + o.merged,
            beads: self.beads + o.beads,
            hung: self.hung + o.hung,
            fell: self.fell + o.fell,
            hardest: self.hardest.max(o.hardest),
        }
    }
}

/// A force, N, at a world position, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointForce {
    /// Where it acts.
    pub point: DVec3,
    /// The force.
    pub force: DVec3,
}

/// Water that is attached to a leaf.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct AttachedWater {
    /// Mass, kg.
    pub mass: f64,
    /// Center of mass in the world, m.
    pub center: DVec3,
}

/// What a step of a leaf's drops produced.
#[derive(Debug, Clone, Default)]
pub struct LeafStepResult {
    /// Water that left the leaf.
    pub detached: Vec<DetachedDrop>,
    /// Spots that became wet.
    pub wet_spots: Vec<WetSpot>,
    /// Events by number.
    pub counters: DropCounters,
    /// Events one by one, in their order.
    pub events: Vec<RainEvent>,
    /// Forces on the leaf beyond the weight of the attached water.
    pub forces: Vec<PointForce>,
    /// The water on the leaf after the step.
    pub attached: AttachedWater,
}

impl LeafStep<'_> {
    /// World position of a point of leaf space, m.
    pub fn world_point(&self, local: DVec3) -> DVec3 {
        self.pose.position + self.pose.orientation * local
    }
}

impl LeafStepResult {
    /// Records that a drop at a point of leaf space has reached the margin, once per visit.
    pub(super) fn reach_margin(&mut self, step: &LeafStep<'_>, drop: &mut SurfaceDrop, local: DVec3) {
        if !std::mem::replace(&mut drop.at_margin, true) {
            let p = step.world_point(local);
            self.events.push(RainEvent::new(DropEventKind::Edge, drop.id, step.t, p, drop.volume));
        }
    }

    /// Records that a drop has become pendant at a point of leaf space.
    pub(super) fn hang(&mut self, step: &LeafStep<'_>, drop: &SurfaceDrop, local: DVec3) {
        self.counters.hung += 1;
        let p = step.world_point(local);
        self.events.push(RainEvent::new(DropEventKind::Hung, drop.id, step.t, p, drop.volume));
    }
}

impl RainLeaf {
    /// A dry leaf.
    pub fn new(sheet: Arc<LeafSurface>, scale: f64, number: u64) -> Self {
        Self { sheet, scale, drops: Vec::new(), dew: WetnessGrid::default(), number }
    }

    /// The surface point at texture coordinates, in m of leaf space; none beyond the blade.
    pub fn at(&self, uv: DVec2) -> Option<SurfacePoint> {
        self.sheet.at(uv, self.scale)
    }

    /// Volume of all water on the leaf, m^3.
    pub fn volume(&self) -> f64 {
        self.drops.iter().map(|d| d.volume).sum()
    }

    /// Wetness of the leaf as a whole at time `t`, s: 0 to 1. The mean of its drying tracks, plus the fraction of its area that
    /// sessile drops of the upper side cover.
    pub fn wetness(&self, t: f64, params: &DropParams) -> f64 {
        let tracks = self.dew.mean_wetness(self.sheet.occupied_cells(), t, params.drying());
        let base = |d: &SurfaceDrop| {
            let a = d.head_cap(params, 1.0).a;
            std::f64::consts::PI * a * a
        };
        let sessile = self.drops.iter().filter(|d| d.pendant.is_none() && d.side > 0.0).map(base);
        let area = self.sheet.area() * self.scale * self.scale;
        (tracks + sessile.fold(0.0, |sum, b| sum + b) / area.max(f64::MIN_POSITIVE)).min(1.0)
    }
}
