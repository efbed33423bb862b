//! Growth of all axes, level by level: particles step until their axis ends, then its buds begin the next level.

use glam::DVec3;

use super::axis::{ROOT, ShapeAxis, ShapeNode};
use super::guide::CrownGuide;
use super::params::{ShapeParams, Variant};
use super::particle::{Influence, PAPER_STEP, Particle, StepRates};
use super::region::Region;
use super::shade::ShadeGrid;
use super::spawn::{self, AxisStart};
use osier_base::math::exp;
use osier_base::par::{par_each, par_map};
use osier_base::rng::Rng;
use osier_scene::plant::AxisEnd;

/// Steps between updates of shade and crown guide, which are frozen meanwhile.
const ROUND: usize = 8;
/// An axis ends after this many steps in a row that are shorter than [`STALL_LENGTH`] of a step.
const STALL_STEPS: u32 = 8;
const STALL_LENGTH: f64 = 1e-3;
/// An axis ends after this multiple of the steps that its length needs at full speed; a creeping axis would never end.
const MAX_STEPS_FACTOR: f64 = 64.0;
/// Distance that axes keep from solids, m, in addition to their assumed radius.
const CONTACT_MARGIN: f64 = 0.005;
/// Attempts to move a particle out of all solids.
const CONTACT_TRIES: u32 = 4;

/// Inputs that all axes of a plant share while they grow.
struct Surroundings<'a> {
    params: &'a ShapeParams,
    seed: u64,
    shade: Option<ShadeGrid>,
    guide: Option<CrownGuide>,
}

/// The axes of a plant, the level that was not grown, and the number of velocities that were cut.
#[derive(Debug, Default)]
pub(super) struct GrownShapes {
    /// Parents before their children.
    pub axes: Vec<ShapeAxis>,
    /// The first level that was not grown because its nodes would have exceeded the limit.
    pub refused: Option<RefusedLevel>,
    /// Steps whose velocity was cut; only with [`Variant::Paper`].
    pub cut_velocities: u64,
}

/// The first level that was not grown, for warning S035.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct RefusedLevel {
    pub level: u8,
    /// Nodes of the plant with the level, as predicted from the lengths of its axes; a lower bound.
    pub predicted: u64,
}

/// Grows the axes of all levels, beginning with `starts`. `plant`: its id and seed.
pub(super) fn grow_axes(params: &ShapeParams, starts: Vec<AxisStart>, plant: (u32, u64)) -> GrownShapes {
    let reads_shade = params.motion.light.any() || params.limits.max_shade.is_some();
    let guide = params.limits.envelope.as_ref().filter(|_| params.motion.attract.any());
    let first_level = starts.first().map_or(0, |s| s.level);
    // Roots begin in their disc, twigs that fill a plant anywhere in it.
    let start = match first_level {
        0 => params.roots.radius,
        _ => starts.iter().map(|s| s.p.length()).fold(0.0, f64::max),
    };
    // Longest path from the start to a tip. The lengths of the first level are known; those of further levels are drawn
    // later and assumed to lie two standard deviations above the median, which one in fifty exceeds.
    let longest = starts.iter().map(|s| s.length).fold(0.0, f64::max);
    let most = exp(2.0 * params.limits.length_deviation);
    let further = (first_level + 1..params.limits.levels).map(|l| (l, params.limits.length.at(l) * most));
    let lengths = std::iter::once((first_level, longest)).chain(further);
    let drawn: f64 = lengths.map(|(l, length)| length * spawn::fork_reach(params, l)).sum();
    let reach = drawn.max((0..params.limits.levels).map(|level| params.limits.length.at(level)).sum());
    let mut around = Surroundings {
        params,
        seed: plant.1,
        shade: reads_shade.then(|| ShadeGrid::new(reach + start)),
        guide: guide.map(|envelope| CrownGuide::new(envelope, plant.0, plant.1)),
    };
    let mut out = GrownShapes::default();
    let (mut starts, mut nodes, mut forks) = (starts, 0_u64, 0_u32);
    for level in first_level..params.limits.levels {
        let first = out.axes.len();
        // Axes of one level, and the axes of the same level into which they fork.
        while !starts.is_empty() {
            let predicted = nodes + starts.iter().map(|s| predicted_nodes(params, s)).sum::<u64>();
            if predicted > params.limits.max_nodes {
                out.refused = Some(RefusedLevel { level, predicted });
                return out;
            }
            // A fork ends an axis and begins two of the same level, which grow in the next turn of this loop.
            let generation = out.axes.len();
            let (axes, cut) = grow_generation(&mut around, std::mem::take(&mut starts));
            out.axes.extend(axes);
            out.cut_velocities += cut;
            nodes += out.axes[generation..].iter().map(|a| a.nodes.len() as u64).sum::<u64>();
            for i in generation..out.axes.len() {
                if let Some(halves) = spawn::fork(params, &out.axes[i], i, plant.1, forks) {
                    starts.extend(halves);
                    forks += 1;
                }
            }
        }
        // Buds of all axes of the level start the next one. The nodes that these will have are summed in the same loop,
        // so that a level over `max_nodes` is refused before it grows.
        if level + 1 < params.limits.levels {
            let mut predicted = nodes;
            for i in first..out.axes.len() {
                starts.extend(spawn::children(params, &out.axes[i], i, plant.1).into_iter().inspect(|child| {
                    predicted += predicted_nodes(params, child);
                }));
                if predicted > params.limits.max_nodes {
                    out.refused = Some(RefusedLevel { level: level + 1, predicted });
                    return out;
                }
            }
        }
    }
    out
}

/// Nodes of an axis that grows to its length in full steps.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a float to integer cast saturates")]
fn predicted_nodes(params: &ShapeParams, start: &AxisStart) -> u64 {
    (start.length / params.step_length(start.level)).ceil() as u64 + 1
}

/// Grows axes of one level at the same time, in rounds if they shade each other or are guided. Returns them with the number of
/// steps whose velocity was cut.
fn grow_generation(around: &mut Surroundings<'_>, starts: Vec<AxisStart>) -> (Vec<ShapeAxis>, u64) {
    let mut growing: Vec<GrowingAxis> = starts.into_iter().map(|start| GrowingAxis::new(around, start)).collect();
    let interact = around.shade.is_some() || around.guide.is_some();
    if interact {
        let mut grown: Vec<usize> = vec![0; growing.len()];
        while growing.iter().any(|g| !g.done) {
            // The guide assigns its points to the tips that still grow, in their order.
            let tips: Vec<DVec3> = growing.iter().filter(|g| !g.done).map(|g| g.particle.p).collect();
            let mut pulls = around.guide.as_ref().map(|guide| guide.pulls(&tips).into_iter());
            for g in growing.iter_mut().filter(|g| !g.done) {
                g.pull = pulls.as_mut().and_then(Iterator::next).unwrap_or_default();
            }
            let frozen = &*around;
            par_each(&mut growing, |g| g.advance(frozen, ROUND));
            // The nodes of this round shade other axes and reach points of the guide only after the round.
            let mut new = Vec::new();
            for (g, seen) in growing.iter().zip(&mut grown) {
                new.extend(g.axis.nodes[*seen..].iter().map(|n| (g.axis.level, n.p)));
                *seen = g.axis.nodes.len();
            }
            if let Some(shade) = &mut around.shade {
                // Axes of level 0, the trunks, shade nothing.
                shade.add(new.iter().filter(|n| n.0 >= 1).map(|n| n.1));
            }
            if let Some(guide) = &mut around.guide {
                guide.reach(&new.iter().map(|n| n.1).collect::<Vec<_>>());
            }
        }
    } else {
        let frozen = &*around;
        par_each(&mut growing, |g| g.advance(frozen, usize::MAX));
    }
    let cut = growing.iter().map(|g| g.cut_velocities).sum();
    // An axis that ended before its first step has no length and bears nothing.
    let axes: Vec<ShapeAxis> = growing.into_iter().map(|g| g.axis).filter(|a| a.nodes.len() >= 2).collect();
    let (params, seed) = (around.params, around.seed);
    let axes = par_map(&axes, |axis| {
        let mut axis = axis.clone();
        axis.sites = spawn::sites(params, &axis, seed);
        // Only axes that bear children can be continued by one.
        if axis.level + 1 < params.limits.levels {
            axis.lose_apex(params.spawning.apex_death.at(axis.level), seed);
        }
        axis
    });
    (axes, cut)
}

/// An axis whose tip is still moving.
struct GrowingAxis {
    axis: ShapeAxis,
    particle: Particle,
    rates: StepRates,
    draws: Rng,
    /// Growth time at which the axis began, t.
    start_time: f64,
    /// Unit pull of the crown guide, or zero.
    pull: DVec3,
    /// Whether the ground stops the axis; false for one that begins below the ground, such as a twig of a hanging
    /// plant.
    stops_at_ground: bool,
    /// Whether the tip has been inside the envelope: the envelope cuts an axis only when its tip leaves.
    was_inside: bool,
    short_steps: u32,
    steps_left: u64,
    done: bool,
    cut_velocities: u64,
}

impl GrowingAxis {
    fn new(around: &Surroundings<'_>, start: AxisStart) -> Self {
        let params = around.params;
        let rates = StepRates::new(params, start.level, start.length);
        let mut particle = Particle::new(start.p, start.direction, start.heading, &rates, params.variant);
        if rates.coil != 0.0 && params.variant == Variant::Corrected {
            particle.tilt_from_home(params.motion.coil_angle);
        }
        // The axis has its first node at once; memory is reserved for those that its length predicts.
        let mut axis = ShapeAxis {
            id: start.id,
            parent: start.parent,
            parent_s: start.parent_s,
            ordinal: start.ordinal,
            level: start.level,
            forks: start.forks,
            fork: start.fork,
            length: start.length,
            exposed: start.exposed,
            end: AxisEnd::Tip,
            nodes: Vec::new(),
            sites: Vec::new(),
        };
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a float to integer cast saturates")]
        let steps_left = (MAX_STEPS_FACTOR * (start.length / rates.step_length + 1.0)) as u64;
        #[allow(clippy::cast_possible_truncation, reason = "at most 2^16")]
        axis.nodes.reserve(predicted_nodes(params, &start).min(1 << 16) as usize);
        axis.nodes.push(node(&particle, start.time));
        Self {
            axis,
            draws: Rng::at(around.seed, &[start.id.into(), "grow".into()]),
            particle,
            rates,
            start_time: start.time,
            pull: DVec3::ZERO,
            stops_at_ground: params.limits.ground && start.p.y >= -CONTACT_MARGIN,
            was_inside: false,
            short_steps: 0,
            steps_left,
            done: false,
            cut_velocities: 0,
        }
    }

    /// Makes at most `steps` steps; stops when the axis ends.
    fn advance(&mut self, around: &Surroundings<'_>, steps: usize) {
        for _ in 0..steps {
            if self.done {
                return;
            }
            self.step(around);
        }
    }

    fn end(&mut self, why: AxisEnd) {
        self.axis.end = why;
        self.done = true;
    }

    /// Makes one step: direction and velocity turn, the particle moves, solids push it out, the envelope cuts it off.
    fn step(&mut self, around: &Surroundings<'_>) {
        let params = around.params;
        // An axis that begins inside a solid leaves it with its first step, however deep it begins; an axis too short
        // for that ends.
        let enclosed = || params.limits.obstacles.iter().any(|o| o.distance(self.particle.p) < -self.axis.length);
        if self.axis.nodes.len() == 1 && enclosed() {
            return self.end(AxisEnd::Obstacle);
        }
        let shade = around.shade.as_ref().map_or(0.0, |s| s.shade(self.particle.p));
        if params.limits.max_shade.is_some_and(|most| shade > most) {
            return self.end(AxisEnd::Shade);
        }
        if self.steps_left == 0 {
            return self.end(AxisEnd::Stalled);
        }
        self.steps_left -= 1;
        let printed = params.variant == Variant::Paper;
        // With the equations as printed a step has a fixed duration, otherwise a fixed length.
        let mut dt = if printed { PAPER_STEP } else { self.particle.time_step(&self.rates) };
        let age_left = params.limits.max_age.map_or(f64::INFINITY, |most| most - self.particle.age);
        let mut roll = self.rates.twist;
        if printed {
            self.cut_velocities += u64::from(self.particle.turn_as_printed(&self.rates, &mut self.draws));
        } else {
            dt = dt.min(age_left);
            let influence = self.influence(around);
            self.particle.turn(&self.rates, &influence, dt, &mut self.draws);
            roll *= dt;
        }
        // The last step ends at the full length.
        let speed = self.particle.v.length();
        let left = self.axis.length - self.particle.s;
        let last = speed * dt >= left;
        if last {
            dt = left / speed;
        }
        let from = self.particle.p;
        let mut to = from + self.particle.v * dt;
        if (!params.limits.obstacles.is_empty() || self.stops_at_ground) && !self.slide(params, &mut to) {
            return self.end(AxisEnd::Obstacle);
        }
        let cut = params.limits.envelope.as_ref().and_then(|envelope| self.cut_at(envelope, &mut to));
        self.particle.move_to(to, dt, roll);
        // A step that a solid stopped adds no second node in the same place.
        if from.distance(to) > 0.0 {
            self.axis.nodes.push(node(&self.particle, self.start_time));
        }
        // Reasons to end: envelope, length or age, standstill.
        self.short_steps =
            if from.distance(to) < STALL_LENGTH * self.rates.step_length { self.short_steps + 1 } else { 0 };
        if cut.is_some() {
            self.end(AxisEnd::Cut);
        } else if last || self.particle.s >= self.axis.length * (1.0 - 1e-9) || age_left - dt <= 0.0 {
            self.end(AxisEnd::Tip);
        } else if self.short_steps >= STALL_STEPS {
            self.end(AxisEnd::Stalled);
        }
    }

    /// Contribution of light, crown guide and solids to the rate of change of the target direction, 1/t.
    fn influence(&self, around: &Surroundings<'_>) -> Influence {
        let (params, level, p) = (around.params, self.axis.level, self.particle.p);
        let motion = &params.motion;
        let mut out = Influence::default();
        if let Some(shade) = around.shade.as_ref().filter(|_| motion.light.at(level) != 0.0) {
            out.light = shade.way_out(p) * motion.light.at(level);
        }
        out.other = self.pull * motion.attract.at(level);
        // Climbing is negative avoidance.
        let rate = motion.avoid.at(level) - motion.climb.at(level);
        if rate != 0.0 {
            out.other += params.limits.obstacles.iter().map(|o| o.repulsion(p, rate)).sum::<DVec3>();
        }
        out
    }

    /// Moves the end of a step out of the ground and of all solids, and removes the inward part of velocity and direction, so
    /// that the axis slides along them. False if the end is still inside after [`CONTACT_TRIES`] attempts.
    fn slide(&mut self, params: &ShapeParams, to: &mut DVec3) -> bool {
        let radius = params.assumed_radius(self.axis.level) + CONTACT_MARGIN;
        let ground = Region::HalfSpace { point: DVec3::ZERO, normal: DVec3::Y };
        let stops_at_ground = self.stops_at_ground;
        let solids = || params.limits.obstacles.iter().chain(stops_at_ground.then_some(&ground));
        for _ in 0..CONTACT_TRIES {
            let mut clear = true;
            for solid in solids() {
                let near = solid.clearance(*to);
                let inward = self.particle.v.dot(near.normal).min(0.0);
                // Axes may begin in contact with a solid, as roots do: outside it, only those that move inwards are
                // pushed out.
                if near.distance >= radius || (inward >= 0.0 && near.distance >= 0.0) {
                    continue;
                }
                clear = false;
                *to += near.normal * (radius - near.distance);
                // `inward` is negative or 0: the velocity keeps its part along the surface.
                self.particle.v -= near.normal * inward;
                let d = self.particle.d - near.normal * self.particle.d.dot(near.normal).min(0.0);
                self.particle.d = d.try_normalize().map_or(self.particle.d, |d| d * self.particle.d.length());
            }
            if clear {
                return true;
            }
        }
        solids().all(|solid| solid.distance(*to) >= 0.0)
    }

    /// Shortens a step that leaves the envelope to the envelope's surface; `None` if the step does not leave it.
    fn cut_at(&mut self, envelope: &Region, to: &mut DVec3) -> Option<()> {
        let (before, after) = (envelope.distance(self.particle.p), envelope.distance(*to));
        self.was_inside |= before <= 0.0;
        if !self.was_inside || after <= 0.0 {
            return None;
        }
        // Linear root of the signed distance between both ends of the step.
        let share = (before / (before - after)).clamp(0.0, 1.0);
        *to = self.particle.p.lerp(*to, share);
        Some(())
    }
}

fn node(particle: &Particle, start_time: f64) -> ShapeNode {
    ShapeNode {
        p: particle.p,
        tangent: particle.tangent,
        reference: particle.reference,
        s: particle.s,
        time: start_time + particle.age,
    }
}

/// Greatest growth time of all nodes, t; 0 without axes. Plants store times as shares of it.
pub(super) fn last_time(axes: &[ShapeAxis]) -> f64 {
    axes.iter().filter_map(|a| a.nodes.last()).fold(0.0, |latest: f64, n| latest.max(n.time))
}

/// The axes in canonical order: depth first, siblings by arc length on the parent, then by ordinal.
pub(super) fn depth_first(axes: &[ShapeAxis]) -> Vec<usize> {
    let mut children: Vec<Vec<usize>> = vec![Vec::new(); axes.len()];
    let mut stack: Vec<usize> = Vec::new();
    for (i, axis) in axes.iter().enumerate() {
        if axis.parent == ROOT {
            stack.push(i);
        } else {
            children[axis.parent].push(i);
        }
    }
    for list in &mut children {
        list.sort_by(|a, b| {
            axes[*a].parent_s.total_cmp(&axes[*b].parent_s).then(axes[*a].ordinal.cmp(&axes[*b].ordinal))
        });
    }
    stack.reverse();
    let mut order = Vec::with_capacity(axes.len());
    while let Some(i) = stack.pop() {
        order.push(i);
        stack.extend(children[i].iter().rev());
    }
    order
}
