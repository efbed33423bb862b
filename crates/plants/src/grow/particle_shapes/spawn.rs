//! Where axes begin: root axes, buds along an axis, forks at its tip.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::DVec3;

use super::axis::{ROOT, ShapeAxis, ShapeNode};
use super::params::ShapeParams;
use super::particle::rotated;
use osier_base::math::{GOLDEN_ANGLE, cos, exp, sin, sqrt};
use osier_base::rng::{Rng, mix64, word};
use osier_scene::plant::NONE;

/// Least and greatest distance between sites, as a factor of the median.
const SPACING_RANGE: [f64; 2] = [0.3, 3.0];
/// Least and greatest angle between an axis and its child, rad: at least 5 degrees, so that a child leaves the wood of
/// its parent; at most the largest value of the scene's key.
const ANGLE_RANGE: [f64; 2] = [5.0 * PI / 180.0, 175.0 * PI / 180.0];
/// Length of each half of a fork, as a share of the length of the axis that forks.
const FORK_LENGTH: f64 = 0.75;
/// Most forks in a lineage of one level.
pub(super) const MAX_FORKS: u8 = 4;
/// A child shorter than this number of steps is not grown.
const MIN_STEPS: f64 = 2.0;
/// Random displacement of a root axis, as a share of the mean distance between root axes.
const ROOT_JITTER: f64 = 0.35;

/// Place, direction and length with which an axis begins, and its identity in the plant.
#[derive(Debug, Clone)]
pub(super) struct AxisStart {
    pub id: u64,
    /// Index of the parent among the grown axes, or [`ROOT`].
    pub parent: usize,
    /// Arc length of the site on the parent, m.
    pub parent_s: f64,
    /// Number of the bud on the parent.
    pub ordinal: u64,
    pub level: u8,
    /// Number of forks of this level among its ancestors.
    pub forks: u8,
    /// Number shared by the halves of a fork, or [`NONE`].
    pub fork: u32,
    /// Length that it grows to, m.
    pub length: f64,
    pub p: DVec3,
    /// Unit target direction.
    pub direction: DVec3,
    /// Unit direction of its first velocity.
    pub heading: DVec3,
    /// Growth time at which it begins, t.
    pub time: f64,
    /// Assumed arc length within the parent, m.
    pub exposed: f64,
}

/// A log-normal random factor with median 1. `deviation`: standard deviation of its logarithm.
fn log_normal(draws: &mut Rng, deviation: f64) -> f64 {
    exp(deviation * draws.normal_by_quantile())
}

/// Starts of the root axes, spread over the root disc. `plant`: its id and seed.
pub(super) fn roots(params: &ShapeParams, plant: (u32, u64)) -> Vec<AxisStart> {
    let roots = &params.roots;
    let start = |i: u32| {
        let id = mix64(&[plant.1, plant.0.into(), i.into()]);
        let mut draws = Rng::at(plant.1, &[plant.0.into(), "root".into(), i.into()]);
        // Golden-angle spiral: equal areas for any number of axes; jitter breaks up its arms.
        let n = f64::from(roots.count);
        let distance = if roots.count > 1 { roots.radius * sqrt((f64::from(i) + 0.5) / n) } else { 0.0 };
        let azimuth = f64::from(i) * GOLDEN_ANGLE;
        let jitter = if roots.count > 1 { ROOT_JITTER * roots.radius * sqrt(PI / n) } else { 0.0 };
        let x = distance * cos(azimuth) + jitter * draws.range(-1.0, 1.0);
        let z = distance * sin(azimuth) + jitter * draws.range(-1.0, 1.0);
        let tilt = draws.range(roots.tilt[0], roots.tilt[1]);
        let toward = azimuth + (1.0 - roots.outward) * draws.range(-PI, PI);
        let direction = DVec3::new(sin(tilt) * cos(toward), cos(tilt), sin(tilt) * sin(toward));
        let length = params.limits.length.at(0) * log_normal(&mut draws, params.limits.length_deviation);
        AxisStart {
            id,
            parent: ROOT,
            parent_s: 0.0,
            ordinal: i.into(),
            level: 0,
            forks: 0,
            fork: NONE,
            length,
            p: DVec3::new(x, 0.0, z),
            direction,
            heading: direction,
            time: 0.0,
            exposed: 0.0,
        }
    };
    (0..roots.count).map(start).collect()
}

/// Arc lengths of the sites of an axis, m, rising from its bare base to where it ended. They do not depend on its nodes.
pub(super) fn sites(params: &ShapeParams, axis: &ShapeAxis, seed: u64) -> Vec<f64> {
    let spacing = params.spawning.spacing.at(axis.level);
    let mut draws = Rng::at(seed, &[axis.id.into(), "sites".into()]);
    let end = axis.grown_length();
    // The first site lies a random part of a spacing beyond the bare base.
    let mut s = (params.spawning.base.at(axis.level) * axis.length).max(axis.exposed) + spacing * draws.unit_f64();
    let mut sites = Vec::new();
    while s < end {
        sites.push(s);
        let factor = log_normal(&mut draws, params.spawning.spacing_sigma);
        s += spacing * factor.clamp(SPACING_RANGE[0], SPACING_RANGE[1]);
    }
    sites
}

/// Angle between the planes of successive sites, rad: the golden angle for alternate buds, half of the angle between buds for
/// opposite and whorled ones.
fn divergence(buds: u32) -> f64 {
    match buds {
        0 | 1 => GOLDEN_ANGLE,
        2 => FRAC_PI_2,
        k => PI / f64::from(k),
    }
}

/// The children that the buds of an axis grow into, by site and bud. `index`: index of the axis among the grown axes.
pub(super) fn children(params: &ShapeParams, axis: &ShapeAxis, index: usize, seed: u64) -> Vec<AxisStart> {
    let spawning = &params.spawning;
    let level = axis.level + 1;
    let buds = spawning.buds.max(1);
    let shortest = MIN_STEPS * params.step_length(level);
    let bare = spawning.base.at(axis.level) * axis.length;
    let mut out = Vec::new();
    for (site, s) in axis.sites.iter().enumerate() {
        let at = axis.at(*s);
        // Length along the crown: w is measured from the tip at full length, so that it does not depend on where growth ended.
        let w = (axis.length - s) / (axis.length - bare).max(1e-9);
        let mean = params.limits.length.at(level) * spawning.crown.factor(w);
        for bud in 0..buds {
            let ordinal = site as u64 * u64::from(buds) + u64::from(bud);
            let id = mix64(&[axis.id, word("spawn"), ordinal]);
            let mut draws = Rng::at(seed, &[id.into(), "bud".into()]);
            // Every bud has its own random stream, so that a dormant one changes no other.
            if draws.chance(spawning.dormancy) {
                continue;
            }
            let azimuth = site as f64 * divergence(buds)
                + f64::from(bud) * TAU / f64::from(buds)
                + spawning.azimuth_deviation * draws.normal_by_quantile();
            let angle = (spawning.angle.at(axis.level) + spawning.angle_deviation * draws.normal_by_quantile())
                .clamp(ANGLE_RANGE[0], ANGLE_RANGE[1]);
            let length = mean * log_normal(&mut draws, params.limits.length_deviation);
            if length < shortest {
                continue;
            }
            // d = normalize(cos phi T + sin phi (cos psi X + sin psi Z) + up_bias Y); the first velocity is a blend of the
            // parent's tangent and d, from which the child bends out.
            let side = at.reference * cos(azimuth) + at.reference.cross(at.tangent) * sin(azimuth);
            let toward = at.tangent * cos(angle) + side * sin(angle) + DVec3::Y * spawning.up_bias;
            let direction = toward.try_normalize().unwrap_or(side);
            let blend = at.tangent * spawning.flow + direction * (1.0 - spawning.flow);
            out.push(AxisStart {
                id,
                parent: index,
                parent_s: *s,
                ordinal,
                level,
                forks: 0,
                fork: NONE,
                length,
                p: at.p,
                direction,
                heading: blend.try_normalize().unwrap_or(direction),
                time: at.time,
                exposed: 1.5 * params.assumed_radius(axis.level) * (1.0 - s / axis.length).max(0.0),
            });
        }
    }
    out
}

/// Length of an axis of a level together with the forks that follow it, divided by the length of the axis.
pub(super) fn fork_reach(params: &ShapeParams, level: u8) -> f64 {
    if params.spawning.split.at(level) <= 0.0 {
        return 1.0;
    }
    // 1 + f + f^2 + .. of `MAX_FORKS` forks, each of which has f times the length of the one before.
    let (mut sum, mut part) = (1.0, 1.0);
    for _ in 0..MAX_FORKS {
        part *= FORK_LENGTH;
        sum += part;
    }
    sum
}

/// The two axes into which an axis forks at its tip; `None` if it does not fork. `index`: index of the axis among the
/// grown axes;
/// `fork`: the number that the two share.
pub(super) fn fork(
    params: &ShapeParams,
    axis: &ShapeAxis,
    index: usize,
    seed: u64,
    fork: u32,
) -> Option<[AxisStart; 2]> {
    let split = params.spawning.split.at(axis.level);
    // Only an axis that reached its full length forks, not one that was cut, stopped or lost its apex.
    let whole = axis.grown_length() > 0.999 * axis.length && axis.forks < MAX_FORKS;
    let length = FORK_LENGTH * axis.length;
    if !whole || split <= 0.0 || length < MIN_STEPS * params.step_length(axis.level) {
        return None;
    }
    let mut draws = Rng::at(seed, &[axis.id.into(), "fork".into()]);
    if !draws.chance(split) {
        return None;
    }
    let tip: &ShapeNode = axis.nodes.last()?;
    // Both halves turn about one axis across the tip, in opposite directions.
    let hinge = rotated(tip.reference, tip.tangent, draws.range(0.0, TAU));
    let half = |ordinal: u64, sign: f64| {
        let direction = rotated(tip.tangent, hinge, sign * 0.5 * params.spawning.split_angle);
        let flow = params.spawning.flow;
        let heading = (tip.tangent * flow + direction * (1.0 - flow)).try_normalize().unwrap_or(direction);
        AxisStart {
            id: mix64(&[axis.id, word("fork"), ordinal]),
            parent: index,
            parent_s: tip.s,
            // Buds are numbered from 0: the halves of a fork come after all of them.
            ordinal: u64::from(u32::MAX) + ordinal,
            level: axis.level,
            forks: axis.forks + 1,
            fork,
            length,
            p: tip.p,
            direction,
            heading,
            time: tip.time,
            exposed: 0.0,
        }
    };
    Some([half(0, 1.0), half(1, -1.0)])
}
