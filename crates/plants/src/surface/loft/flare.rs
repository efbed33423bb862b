//! Root flare: the trunk widens towards the ground, most where its roots leave it.

use super::layout::CirclePoint;
use super::rings::Ring;
use super::tube::TubeInputs;
use super::tube_plan::{TubeStart, widening};
use super::tuning::{LEAST_WIDENING, RIDGE_CONTRAST, RIDGE_SHARPNESS, RIDGE_SHIFT, RIDGE_STRENGTH, SIDES_OF_RIDGE};
use super::writer::TubeWriter;
use osier_base::math::{self, narrow};
use osier_base::rng::{Rng, mix64, word};

/// The widening at a corner of the trunk's polygon.
#[derive(Debug, Clone, Copy)]
struct RidgeShape {
    /// Widening at the corner divided by the mean widening.
    share: f32,
    /// Derivative of `share` by the azimuth, 1/rad.
    slope: f32,
}

/// Ridges of the flare of one trunk.
#[derive(Debug, Clone)]
pub(super) struct Ridges {
    /// Shape at each corner of the polygon; the last repeats the first.
    shapes: Vec<RidgeShape>,
}

impl Ridges {
    /// The ridges of a tube; `None` where its flare is round. They are drawn from the id of the trunk, so that an
    /// individual keeps its ridges whatever else changes.
    pub fn new(tube: &TubeInputs<'_>) -> Option<Self> {
        let options = tube.context.options;
        // The greatest number of sides limits the number of ridges: a polygon with too few sides for its ridges would
        // look round.
        let count = options.buttresses.min(options.sides.1 / SIDES_OF_RIDGE);
        let is_trunk = matches!(tube.plan.start, TubeStart::Root) && options.flare > 0.0;
        if !is_trunk || count < 2 || tube.params.sides < SIDES_OF_RIDGE * count {
            return None;
        }
        let id = tube.context.plant.axes[tube.axis as usize].id;
        let mut draw = Rng::from_key(mix64(&[id, word("root-flare")]));
        let step = std::f32::consts::TAU / count as f32;
        let ridges: Vec<(f32, f32)> = (0..count)
            .map(|k| {
                let shift = narrow(draw.range(-RIDGE_SHIFT, RIDGE_SHIFT));
                (step * (k as f32 + shift), narrow(draw.range(RIDGE_STRENGTH[0], RIDGE_STRENGTH[1])))
            })
            .collect();
        let sharp = RIDGE_SHARPNESS * count as f32;
        // Own: the sum of bumps a exp(k (cos(x - x0) - 1)) around the trunk, and its derivative.
        let bump = |at: f32| {
            ridges.iter().fold([0.0_f32, 0.0], |[sum, slope], (azimuth, strength)| {
                let x = at - azimuth;
                let value = strength * math::exp_f32(sharp * (math::cos_f32(x) - 1.0));
                [sum + value, slope - value * sharp * math::sin_f32(x)]
            })
        };
        let corners = |c: &CirclePoint| bump(c.turn * std::f32::consts::TAU);
        let bumps: Vec<[f32; 2]> = tube.circle.iter().map(corners).collect();
        // The mean over the corners, the last of which repeats the first.
        let mean = bumps[1..].iter().map(|b| b[0]).sum::<f32>() / tube.params.sides as f32;
        let shape = |[value, slope]: [f32; 2]| RidgeShape {
            share: 1.0 + RIDGE_CONTRAST * (value / mean - 1.0),
            slope: RIDGE_CONTRAST * slope / mean,
        };
        let mut shapes: Vec<RidgeShape> = bumps.into_iter().map(shape).collect();
        // The last corner equals the first bit for bit, so that the seam closes.
        if let (Some(first), Some(last)) = (shapes.first().copied(), shapes.last_mut()) {
            *last = first;
        }
        Some(Self { shapes })
    }

    /// Moves the points of a ring, written from the mesh index `first` on, outwards at the ridges and inwards between
    /// them. Normals of caps (`flat`) stay.
    pub fn shape(&self, tube: &TubeInputs<'_>, ring: &Ring, first: u32, flat: bool, out: &mut TubeWriter<'_>) {
        let wide = widening(tube.context.options, ring.s, tube.plan.r_base);
        if wide < LEAST_WIDENING {
            return;
        }
        // The trunk without its flare.
        let core = ring.r / (1.0 + wide);
        let from = (first - out.first_point) as usize;
        for (k, shape) in self.shapes.iter().enumerate() {
            let p = &mut out.points[from + k];
            let radial = math::normalize_or(*p - ring.c, ring.e);
            let r = core * (1.0 + wide * shape.share);
            *p = ring.c + radial * r;
            if !flat {
                // Gradient of distance - r(azimuth, s): radial - (dr/da / r) tangential - (dr/ds) axial.
                let around = ring.t.cross(radial) * (core * wide * shape.slope / r);
                let n = radial - around - ring.t * (ring.slope * shape.share);
                out.normals[from + k] = math::normalize_or(n, radial);
            }
        }
    }
}
