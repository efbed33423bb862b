//! Plants that can be posed at any time of a clip of their growth, with one topology.

use glam::Vec3;

use super::years::{GrowthClip, PoseNow};
use osier_base::Result;
use osier_base::limits::Limits;
use osier_scene::plant::Plant;

/// The times that a clip shows: years of a tree, or steps of a derivation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClipTimes {
    /// Time at the first frame.
    pub from: f64,
    /// Time at the last frame; it may be earlier than `from`.
    pub to: f64,
}

/// A plant over the times of a clip.
pub trait PosedGrowth: std::fmt::Debug + Send + Sync {
    /// The plant with every axis and organ that is seen at some time of the clip.
    fn plant(&self) -> &Plant;

    /// The times of the first and the last frame.
    fn times(&self) -> ClipTimes;

    /// Pose of the plant at a time.
    /// # Errors
    /// `Input` with L051 beyond a limit.
    fn pose(&self, time: f32) -> Result<PoseNow>;

    /// Positions of the plant's nodes at a time, as in [`Self::pose`], m.
    /// # Errors
    /// As [`Self::pose`].
    fn node_positions(&self, time: f32) -> Result<Vec<Vec3>>;

    /// The plant as it is at the latest time of the clip, validated, without what has gone by then.
    /// # Errors
    /// `Limit`, and the errors of `plant::validate`.
    fn plant_at_end(&self, limits: &Limits) -> Result<Plant>;
}

impl PosedGrowth for GrowthClip {
    fn plant(&self) -> &Plant {
        &self.plant
    }

    fn times(&self) -> ClipTimes {
        let span = self.span();
        ClipTimes { from: span.from, to: span.to }
    }

    fn pose(&self, time: f32) -> Result<PoseNow> {
        Ok(GrowthClip::pose(self, time))
    }

    fn node_positions(&self, time: f32) -> Result<Vec<Vec3>> {
        Ok(GrowthClip::node_positions(self, time))
    }

    fn plant_at_end(&self, limits: &Limits) -> Result<Plant> {
        GrowthClip::plant_at_end(self, limits)
    }
}
