//! The place of a tree: sky, solids that stop its shoots, and cuts.

use std::sync::Arc;

use glam::Vec3;

use osier_scene::solid::{Solid, Solids};

/// Least distance of a shoot's bark from a solid, m.
const CLEARANCE: f32 = 0.02;
/// Share of a step that must remain after sliding along a solid; otherwise the axis ends.
const LEAST_STEP: f32 = 0.3;

/// Sky, sunlight and solids around the trees that grow in one field of light.
#[derive(Debug, Clone, Default)]
pub struct Site {
    /// Vector towards the brighter side of the sky: light from the direction d is multiplied by 1 + side . d. Its length is below 1.
    pub side: Vec3,
    /// Geographic latitude, degrees, for direct light.
    pub latitude: f64,
    /// Share of direct sunlight, 0 to 0.8.
    pub direct: f64,
    /// Ground and solids, in the space of the scene; `None`: level ground at the height of the tree's base.
    pub solids: Option<Arc<Solids>>,
}

/// Region that a cut leaves standing; wood outside of it is removed.
#[derive(Debug, Clone)]
pub enum Keep {
    /// A box in the space of the tree, from its base, m.
    Box {
        /// Corner with the smallest coordinates.
        min: Vec3,
        /// Corner with the largest coordinates.
        max: Vec3,
    },
    /// The inside of a solid of the scene.
    Solid(Arc<Solid>),
}

impl Keep {
    /// Whether the point `p`, relative to the tree's base, is kept. `base`: base of the tree in the scene, m.
    pub(super) fn holds(&self, base: Vec3, p: Vec3) -> bool {
        match self {
            Self::Box { min, max } => p.cmpge(*min).all() && p.cmple(*max).all(),
            Self::Solid(solid) => solid.contains(base + p),
        }
    }
}

/// A cut at the start of one year of a tree's life, or repeated in several.
#[derive(Debug, Clone)]
pub struct Prune {
    /// Year of the tree's life of the first cut, from 1.
    pub year: u32,
    /// Years from one cut to the next; 0: only once.
    pub every: u32,
    /// Last year of the tree's life in which the cut may repeat; it does not limit the first cut.
    pub until: u32,
    /// Region whose wood stays.
    pub keep: Keep,
}

impl Prune {
    /// Whether the cut is made in a year of the tree's life.
    pub(super) fn happens(&self, year: u32) -> bool {
        let repeats =
            self.every > 0 && year <= self.until && (year.saturating_sub(self.year)).is_multiple_of(self.every);
        year == self.year || (year > self.year && repeats)
    }
}

/// One internode of a growing shoot.
#[derive(Debug, Clone, Copy)]
pub(super) struct Step {
    /// Unit direction of the internode.
    pub d: Vec3,
    /// Length of the internode, m; less than planned after sliding.
    pub length: f32,
}

/// Obstacles to the shoots of a tree: the solids of the scene, and the tree's base there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Obstacles<'a> {
    /// Place of the tree's base in the scene, m.
    pub base: Vec3,
    /// Ground and solids; `None`: level ground at the base.
    pub solids: Option<&'a Solids>,
}

impl Obstacles<'_> {
    /// The step from `from`, in the space of the tree, after it has slid along obstacles; `None` if too little of its
    /// length is left.
    /// Own: where the surface is nearer than the radius and a clearance, the end moves out along the normal and the direction
    /// loses its inward part.
    pub fn slide(&self, from: Vec3, step: Step, radius: f32) -> Option<Step> {
        let room = radius + CLEARANCE;
        let mut end = from + step.d * step.length;
        let Some(solids) = self.solids else {
            // Level ground: only a step downwards can meet it.
            if end.y >= room || step.d.y >= 0.0 {
                return Some(step);
            }
            end.y = room.min(from.y);
            return Self::left(from, end, step);
        };
        // Two passes, for a corner of two surfaces.
        let mut met = false;
        for _ in 0..2 {
            let Some(near) = solids.near(self.base + end, room) else { break };
            let inward = step.d.dot(near.nearest.normal) < 0.0;
            if near.nearest.distance >= room || !(inward || met) {
                break;
            }
            met = true;
            end += near.nearest.normal * (room - near.nearest.distance);
        }
        if met { Self::left(from, end, step) } else { Some(step) }
    }

    fn left(from: Vec3, end: Vec3, step: Step) -> Option<Step> {
        let way = end - from;
        let length = way.length();
        (length >= LEAST_STEP * step.length && length > 0.0).then(|| Step { d: way / length, length })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use osier_scene::solid::{Form, Prism};

    #[test]
    fn steps_slide_along_a_wall_and_end_at_it() {
        let block = Prism::block(Vec3::new(1.0, 0.0, 0.0), Vec3::new(1.0, 4.0, 4.0), 0.0);
        let wall = Solid { name: "wall".into(), form: Form::Prism(block), humidity: 0.0 };
        let solids = Solids::new(vec![wall], true);
        let obstacles = Obstacles { base: Vec3::ZERO, solids: Some(&solids) };
        let from = Vec3::new(0.4, 1.0, 0.0);
        let along = Vec3::new(0.6, 0.8, 0.0);
        let slid = obstacles.slide(from, Step { d: along, length: 0.2 }, 0.01).expect("slides");
        let end = from + slid.d * slid.length;
        assert!((end.x - 0.47).abs() < 1e-5 && slid.d.y > along.y, "{slid:?} {end}");
        assert!(obstacles.slide(from, Step { d: Vec3::X, length: 0.5 }, 0.01).is_none());
        let free = obstacles.slide(from, Step { d: -Vec3::X, length: 0.2 }, 0.01).expect("free");
        assert!((free.length - 0.2).abs() < 1e-6);
        let level = Obstacles { base: Vec3::ZERO, solids: None };
        let down = Vec3::new(0.8, -0.6, 0.0);
        let slid = level.slide(Vec3::new(0.0, 0.1, 0.0), Step { d: down, length: 0.3 }, 0.0).expect("slides");
        assert!((0.1 + slid.d.y * slid.length - 0.02).abs() < 1e-6);
    }

    #[test]
    fn cuts_repeat_until_their_end() {
        let keep = Keep::Box { min: Vec3::ZERO, max: Vec3::ONE };
        let prune = Prune { year: 12, every: 3, until: 20, keep };
        let years: Vec<u32> = (0..30).filter(|y| prune.happens(*y)).collect();
        assert_eq!(years, [12, 15, 18]);
        let once = Prune { every: 0, ..prune };
        assert_eq!((0..30).filter(|y| once.happens(*y)).count(), 1);
    }
}
