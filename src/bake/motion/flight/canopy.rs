//! The twigs that release catkins, and the positions of their ends in each frame.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{DVec3, Vec3};

use crate::bake::assets::plant_growth::GrownPlant;
use crate::bake::motion::{CarriedPoints, FrameTime, PointOnAxis};
use crate::bake::scene::builder::SceneBuilder;
use crate::bake::scene::plant_layout::PlantLayout;
use crate::recipe::Recipe;
use osier_base::Result;
use osier_base::math::{ln, narrow};
use osier_base::rng::Rng;
use osier_motion::flight::{CarriedPoint, CatkinStart, ReleaseCondition};
use osier_scene::Trs;
use osier_scene::plant::{Axis, AxisKind};

/// Standard deviation along each axis, m, of the start of a catkin about the end of its twig, so that the catkins of one twig do
/// not start at one point and stick together.
const CATKIN_SPREAD: f64 = 0.05;

/// The twigs of all plants that `[flight]` names as its canopy.
#[derive(Debug, Default)]
pub(crate) struct Canopy {
    plants: Vec<CanopyPlant>,
}

/// The twigs of one placement of a plant.
#[derive(Debug)]
struct CanopyPlant {
    /// World from plant space.
    transform: Trs,
    /// Number of frames by which the placement's motion leads that of its asset.
    phase: u32,
    /// Share of the catkins that start at each of its twigs, relative to those of other plants.
    weight: f64,
    twigs: BoundTwigs,
}

/// Ends of the twigs of a plant in plant space.
#[derive(Debug, Clone)]
struct BoundTwigs {
    /// Positions at rest, m.
    rest: Arc<[Vec3]>,
    /// The ends as the plant's motion carries them; `None` for a still plant.
    moving: Option<Arc<dyn CarriedPoints>>,
}

/// A twig's end and the start of a catkin relative to it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CatkinSite {
    plant: usize,
    twig: usize,
    /// Vector from the twig's end to the catkin's centre, world axes, m.
    offset: DVec3,
}

/// World positions, m, of the twigs' ends at one time, by plant.
pub(crate) type TwigPositions = Vec<Vec<Vec3>>;

impl Canopy {
    /// The canopy of the plants that `[flight]` names: the ends of all their stems except the trunks, each bound to the motion of
    /// its plant. Empty without a flight.
    pub(crate) fn of_scene(
        recipe: &Recipe,
        layout: &PlantLayout,
        grown: &[GrownPlant],
        builder: &SceneBuilder,
    ) -> Self {
        let Some(flight) = &recipe.flight else { return Self::default() };
        // Copies of an individual share its twigs and its motion.
        let mut of_individuals: BTreeMap<usize, BoundTwigs> = BTreeMap::new();
        let mut plants = Vec::new();
        for (i, instance) in layout.instances.iter().enumerate() {
            let individual = instance.individual;
            let Some((kind, grown)) = layout.individuals.get(individual).zip(grown.get(individual)) else { continue };
            let Some((_, weight)) = flight.canopy.iter().find(|(plant, _)| *plant == kind.plant) else { continue };
            let twigs = of_individuals.entry(individual).or_insert_with(|| {
                let ends = twig_ends(grown);
                let motion = builder.motions.get(individual).and_then(Option::as_ref);
                BoundTwigs {
                    rest: ends.iter().map(|end| end.position).collect(),
                    moving: motion.and_then(|motion| Arc::clone(motion).bind_points(&grown.plant, &ends)),
                }
            });
            plants.push(CanopyPlant {
                transform: instance.transform,
                phase: builder.placements.get(i).map_or(0, |placement| placement.phase),
                weight: *weight,
                twigs: twigs.clone(),
            });
        }
        Self { plants }
    }

    /// World positions, m, of the ends of all twigs at a time.
    /// # Errors
    /// Errors of the plants' motions.
    pub(crate) fn positions(&self, time: FrameTime) -> Result<TwigPositions> {
        let posed = |plant: &CanopyPlant| {
            // Copies of one individual show its motion with different phases, so that they do not sway in unison.
            let time = FrameTime { seconds: time.seconds + f64::from(plant.phase) * time.step, ..time };
            let ends = plant.twigs.moving.as_ref().map(|moving| moving.positions(time)).transpose()?;
            let ends = ends.as_deref().unwrap_or(&plant.twigs.rest);
            Ok(ends.iter().map(|end| plant.transform.apply(*end)).collect())
        };
        self.plants.iter().map(posed).collect()
    }

    /// Draws a twig for each of `count` catkins. Each ripens at a time uniform in `ripening`, s, then waits for a wind exposure
    /// drawn from the unit exponential distribution. `positions`: positions of the twigs' ends at the start. Both lists are empty
    /// without twigs.
    pub(crate) fn draw_catkin_starts(
        &self,
        count: u32,
        ripening: f64,
        seed: u64,
        positions: &TwigPositions,
    ) -> (Vec<CatkinStart>, Vec<CatkinSite>) {
        // Cumulative weights: a uniform draw times their total falls into one twig's interval.
        let (mut cumulative, mut twigs, mut sum) = (Vec::new(), Vec::new(), 0.0);
        for (number, plant) in self.plants.iter().enumerate() {
            for twig in 0..plant.twigs.rest.len() {
                sum += plant.weight;
                cumulative.push(sum);
                twigs.push((number, twig));
            }
        }
        if sum <= 0.0 {
            return (Vec::new(), Vec::new());
        }
        let draw_start = |id: u32| {
            let mut draw = Rng::at(seed, &["flight".into(), id.into(), 0_u64.into(), "start".into()]);
            let pick = draw.unit_f64() * sum;
            let (plant, twig) = twigs[cumulative.partition_point(|s| *s <= pick).min(twigs.len() - 1)];
            let offset = DVec3::new(draw.normal(), draw.normal(), draw.normal()) * CATKIN_SPREAD;
            let site = CatkinSite { plant, twig, offset };
            // The inverse distribution function of the unit exponential: -ln(1 - u).
            let exposure = -ln(1.0 - draw.unit_f64());
            let wait = ReleaseCondition::Wind { exposure, ripe: ripening * draw.unit_f64() };
            let at = site.position(positions).unwrap_or(DVec3::ZERO);
            (CatkinStart { at, wait }, site)
        };
        (0..count).map(draw_start).unzip()
    }
}

impl CatkinSite {
    /// World position of the catkin, m, when the twigs are at `positions`; `None` for a twig that is missing there.
    fn position(&self, positions: &TwigPositions) -> Option<DVec3> {
        Some(positions.get(self.plant)?.get(self.twig)?.as_dvec3() + self.offset)
    }

    /// Position and velocity of the catkin at a share of the time between two frames, which are `duration` s apart.
    pub(crate) fn catkin_between_frames(
        &self,
        ends: [&TwigPositions; 2],
        share: f64,
        duration: f64,
    ) -> Option<CarriedPoint> {
        let [before, after] = [self.position(ends[0])?, self.position(ends[1])?];
        Some(CarriedPoint { position: before.lerp(after, share), velocity: (after - before) / duration })
    }
}

/// Last nodes of all stems of order 1 or higher, plant space: trunks release no catkins. In a clip of its growth a plant also
/// contains wood that falls before the end of the clip, which bears no catkins.
fn twig_ends(grown: &GrownPlant) -> Vec<PointOnAxis> {
    let plant = &grown.plant;
    // Radii at the greatest age that the clip shows, at which fallen wood has radius 0.
    let radii = grown.clip.as_ref().map(|clip| {
        let times = clip.times();
        // A pose that cannot be drawn hides nothing; the frames of the clip report why.
        clip.pose(narrow(times.from.max(times.to))).map(|pose| pose.r).unwrap_or_default()
    });
    let stands = |node: &usize| radii.as_ref().and_then(|radii| radii.get(*node)).is_none_or(|radius| *radius > 0.0);
    let stems = (0..).zip(&plant.axes).filter(|(_, axis)| axis.kind == AxisKind::Stem && axis.order > 0);
    let end = |(axis, a): (u32, &Axis)| {
        let nodes = plant.nodes_of(a);
        let first = nodes.start;
        // A stem of which only the foot remains has no end.
        let node = nodes.rev().find(stands).filter(|node| *node > first)?;
        Some(PointOnAxis { position: *plant.nodes.p.get(node)?, axis, arc_length: *plant.nodes.s.get(node)? })
    };
    stems.filter_map(end).collect()
}
