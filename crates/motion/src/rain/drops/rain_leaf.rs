//! A leaf in the rain with the drops on it, and the result of one of its steps.

use std::sync::Arc;

use glam::{DVec2, DVec3};

use super::surface_drop::LeafDrop;
use crate::rain::event::{DropEventKind, RainEvent};
use crate::rain::leaf::surface::{LeafSurface, SurfacePoint};
use crate::rain::leaf::wetness::WetnessGrid;
use crate::rain::params::DropParams;
use crate::rain::target::LeafPose;
use crate::rain::triangle_hierarchy::TriangleHit;

/// A leaf in the rain: its blade, the drops on it and where it is wet.
#[derive(Debug, Clone)]
pub struct RainLeaf {
    /// Blade at scale 1, shared by all leaves of one shape.
    pub blade: Arc<LeafSurface>,
    /// Factor on the size of the blade.
    pub scale: f64,
    /// Drops on the leaf, ordered by identifier.
    pub drops: Vec<LeafDrop>,
    /// Wetness that acts on drops: tracks and places where drops have been.
    pub wetness_grid: WetnessGrid,
    /// Index that addresses the leaf's random draws.
    pub index: u64,
}

/// The motion of a leaf during one step, and the parameters of its drops.
#[derive(Debug, Clone, Copy)]
pub struct LeafStep<'a> {
    /// Pose and motion of the leaf at the end of the step.
    pub pose: LeafPose,
    /// Time at the end of the step, s.
    pub t: f64,
    /// Length of the step, s.
    pub h: f64,
    /// Parameters of drops and wetting, the same for all leaves.
    pub params: &'a DropParams,
}

/// Water that has left a leaf as a falling drop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DetachedDrop {
    /// Identifier of the drop that left the leaf, or of which this is a part.
    pub id: u64,
    /// Position in the world, m.
    pub p: DVec3,
    /// Velocity in the world, m/s.
    pub v: DVec3,
    /// Volume of the water that has left, m^3.
    pub volume: f64,
    /// Whether nothing of the drop remains on the leaf.
    pub is_whole: bool,
}

/// A part of a leaf that a drop has covered: its footprint, swept along a short straight path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WetSpot {
    /// Center of the footprint at the end of the path, texture coordinates.
    pub uv: DVec2,
    /// Center of the footprint at the beginning of the path, texture coordinates; `uv` for a drop that has not moved.
    pub from: DVec2,
    /// Base radius of the drop that covered it, m.
    pub a: f64,
    /// Time at the end of the path, s.
    pub t: f64,
}

/// Counts of events, and the largest impulse, since the simulation began or of one step.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct DropCounters {
    /// Impacts of drops on leaves.
    pub impacts: u64,
    /// Drops that another, heavier one absorbed.
    pub mergers: u64,
    /// Beads left behind by tails.
    pub beads: u64,
    /// Drops that became pendant.
    pub pendants: u64,
    /// Detachments, whole or partial.
    pub detachments: u64,
    /// Largest impulse on a leaf, N s.
    pub max_impulse: f64,
}

impl DropCounters {
    /// Sums of the counts, and the larger of the impulses.
    pub fn combine(self, o: Self) -> Self {
        Self {
            impacts: self.impacts + o.impacts,
            mergers: self.mergers + o.mergers,
            beads: self.beads + o.beads,
            pendants: self.pendants + o.pendants,
            detachments: self.detachments + o.detachments,
            max_impulse: self.max_impulse.max(o.max_impulse),
        }
    }
}

/// A force of the water on a leaf beyond the weight of the attached water, for the model that moves the leaf.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointForce {
    /// Point of application in the world, m.
    pub point: DVec3,
    /// Force in the world, N.
    pub force: DVec3,
}

/// An impulse of a drop on its leaf.
///
/// [`AttachedWater`] gives the leaf the inertia and weight of the water on it, as if the water were rigid with the leaf. The
/// momentum that a drop gains relative to the leaf is therefore taken from the leaf, which conserves the momentum of both: a
/// running drop then loads the leaf with the normal part of its weight and the resistance to its motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointImpulse {
    /// Point of application in the world, m.
    pub point: DVec3,
    /// Impulse in the world, N s.
    pub impulse: DVec3,
}

/// The water on a leaf as a rigid body attached to it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct AttachedWater {
    /// Mass of all drops on the leaf, kg; 0 for a dry leaf.
    pub mass: f64,
    /// Center of mass in the world, m.
    pub center: DVec3,
}

/// What a step of a leaf's drops produced.
#[derive(Debug, Clone, Default)]
pub struct LeafStepResult {
    /// Water that left the leaf in this step.
    pub detached: Vec<DetachedDrop>,
    /// Spots that drops have wetted in this step.
    pub wet_spots: Vec<WetSpot>,
    /// Places on the tracks of running drops that have become wet, for the wetness grid; empty after a step.
    pub tracks: Vec<WetSpot>,
    /// Counts of the events of this step, and its largest impulse.
    pub counters: DropCounters,
    /// Events of the drops in the order in which they occurred; their `leaf` is not yet set.
    pub events: Vec<RainEvent>,
    /// Impulses on the leaf by drops that change their velocity relative to it; empty after a step,
    /// which turns them into `forces`.
    pub reactions: Vec<PointImpulse>,
    /// Forces on the leaf beyond the weight of the attached water; the reactions are among them.
    pub forces: Vec<PointForce>,
    /// The water on the leaf after the step, as one rigid body.
    pub attached: AttachedWater,
}

impl LeafStep<'_> {
    /// World position of a point of leaf space, m, in the pose at the end of the step.
    pub fn world_point(&self, local: DVec3) -> DVec3 {
        self.pose.position + self.pose.orientation * local
    }
}

impl LeafStepResult {
    /// Records the reaction on the leaf to a drop's gain of relative momentum `gain`, kg m/s, in leaf space, at a world position.
    pub(super) fn record_reaction(&mut self, step: &LeafStep<'_>, point: DVec3, gain: DVec3) {
        if gain != DVec3::ZERO {
            self.reactions.push(PointImpulse { point, impulse: step.pose.orientation * -gain });
        }
    }

    /// Records the event `edge` of a drop at a point of leaf space, m, unless it already was at the margin.
    pub(super) fn record_margin_contact(&mut self, step: &LeafStep<'_>, drop: &mut LeafDrop, local: DVec3) {
        if !std::mem::replace(&mut drop.at_margin, true) {
            let p = step.world_point(local);
            self.events.push(RainEvent::new(DropEventKind::Edge, drop.id, step.t, p, drop.volume));
        }
    }

    /// Records the event `hung` of a drop that has become pendant at a point of leaf space, m.
    pub(super) fn record_hung_event(&mut self, step: &LeafStep<'_>, drop: &LeafDrop, local: DVec3) {
        self.counters.pendants += 1;
        let p = step.world_point(local);
        self.events.push(RainEvent::new(DropEventKind::Hung, drop.id, step.t, p, drop.volume));
    }
}

impl RainLeaf {
    /// A dry leaf: a blade scaled by `scale`. `index` addresses its random draws, so it differs from leaf to leaf.
    pub fn new(blade: Arc<LeafSurface>, scale: f64, index: u64) -> Self {
        Self { blade, scale, drops: Vec::new(), wetness_grid: WetnessGrid::default(), index }
    }

    /// The surface point at texture coordinates, in leaf space; `None` beyond the blade.
    pub fn point_at(&self, uv: DVec2) -> Option<SurfacePoint> {
        self.blade.point_at(uv, self.scale)
    }

    /// Texture coordinates and surface point at which a drop strikes; `None` in a hole of the alpha mask, or at the very edge of a
    /// triangle at the margin, where no surface is found.
    pub(crate) fn struck_point(&self, hit: &TriangleHit) -> Option<(DVec2, SurfacePoint)> {
        let uv = self.blade.interpolate_uv(hit.triangle, hit.weights);
        Some((uv, self.point_at(uv).filter(|_| self.blade.is_solid(uv))?))
    }

    /// The surface point under a drop, in leaf space; `None` beyond the blade.
    pub(super) fn surface_under(&self, drop: &LeafDrop) -> Option<SurfacePoint> {
        drop.located_surface().or_else(|| self.point_at(drop.uv))
    }

    /// Volume of all drops on the leaf, tails and pendant drops included, m^3.
    pub fn volume(&self) -> f64 {
        self.drops.iter().map(|d| d.volume).sum()
    }

    /// Wetness of the leaf as a whole at time `t`, s: 0 to 1. The mean of its drying tracks, plus the fraction of its area that
    /// sessile drops of the upper side cover.
    pub fn mean_wetness(&self, t: f64, params: &DropParams) -> f64 {
        let tracks = self.wetness_grid.mean_wetness(self.blade.occupied_cell_count(), t, params.drying_law());
        // Base areas pi a^2 of the heads; tails add little.
        let law = params.wetting.cap_law();
        let base = |d: &LeafDrop| {
            let a = d.head_cap_by_law(&law, params).a;
            std::f64::consts::PI * a * a
        };
        // Pendant drops cover almost nothing of the blade.
        let sessile = self.drops.iter().filter(|d| d.pendant.is_none() && d.side > 0.0).map(base);
        // The area is stored at scale 1.
        let area = self.blade.area() * self.scale * self.scale;
        (tracks + sessile.fold(0.0, |sum, b| sum + b) / area.max(f64::MIN_POSITIVE)).min(1.0)
    }
}
