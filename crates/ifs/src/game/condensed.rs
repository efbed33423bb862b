//! Steps of systems with condensation: with a certain chance a lane jumps into the set instead of being mapped.

use glam::DVec3;

use super::lanes::Lanes;
use super::{ChaosGame, Chunk, LANES};
use crate::CondensationShape;
use crate::faces::within;
use osier_base::math::{self, narrow};

/// Advances all lanes of a block by the steps of `chunk` and records every point.
/// Source: M. Barnsley, "Fractals Everywhere", 1988: K = C u w_1(K) u ... u w_m(K).
pub(super) fn advance(game: &ChaosGame, lanes: &mut Lanes, chunk: &mut Chunk) {
    let total = game.condensation.iter().fold(0.0, |s, c| s + c.weight).clamp(0.0, 1.0);
    for step in 0..chunk.steps {
        for lane in 0..LANES {
            // One draw decides between a jump into a set and a map; the map takes a second draw.
            let chance = uniform(lanes, lane);
            if chance < total {
                jump_into_set(game, lanes, lane, chance);
            } else {
                let draw = lanes.draw(lane) >> 1;
                if lanes.map[lane] as usize >= game.maps.len() {
                    // After a jump no map was the last one: use the map that counts as the last one at the start of the chain.
                    lanes.map[lane] = game.first;
                }
                lanes.step(game, lane, draw);
            }
        }
        (chunk.x[step], chunk.y[step], chunk.z[step]) = (lanes.x, lanes.y, lanes.z);
        chunk.map[step] = lanes.map;
    }
}

/// A uniform draw in [0, 1) from 31 random bits of a lane.
fn uniform(lanes: &mut Lanes, lane: usize) -> f64 {
    f64::from(lanes.draw(lane) >> 1) / 2_147_483_648.0
}

/// Moves a lane to a random point of the condensation set that `chance`, uniform in [0, sum of weights), picks.
fn jump_into_set(game: &ChaosGame, lanes: &mut Lanes, lane: usize, chance: f64) {
    let mut sum = 0.0;
    let set = game.condensation.iter().find(|c| {
        sum += c.weight;
        chance < sum
    });
    let Some(set) = set.or(game.condensation.last()) else { return };
    // Always three draws, whatever the shape, so that streams stay aligned.
    let draws = [uniform(lanes, lane), uniform(lanes, lane), uniform(lanes, lane)];
    let p = point(&set.shape, draws, game.dim) * game.frame.scale + game.frame.shift;
    [lanes.x[lane], lanes.y[lane], lanes.z[lane]] = p.to_array().map(narrow);
    lanes.map[lane] = game.map_count;
}

/// A point of the set, uniform by three uniform draws.
fn point(shape: &CondensationShape, [u, v, w]: [f64; 3], dim: usize) -> DVec3 {
    // Uniform on a disc: angle uniform, radius with the square root of a uniform draw.
    let around = |radius: f64| {
        let (angle, r) = (v * std::f64::consts::TAU, radius * math::sqrt(w));
        (math::cos(angle) * r, math::sin(angle) * r)
    };
    match shape {
        CondensationShape::Segment { from, to, radius } => {
            let (a, b) = (DVec3::from_array(*from), DVec3::from_array(*to));
            // A capsule without its caps: a point on the axis plus an offset across it; in the plane only to the sides.
            let axis = (b - a).try_normalize().unwrap_or(DVec3::Y);
            let side = if dim == 2 { DVec3::new(-axis.y, axis.x, 0.0) } else { axis.any_orthonormal_vector() };
            let (s, t) = if dim == 2 { (radius * (2.0 * v - 1.0), 0.0) } else { around(*radius) };
            a.lerp(b, u) + side * s + axis.cross(side) * t
        }
        CondensationShape::Disc { center, radius } => {
            let (x, y) = around(*radius);
            DVec3::from_array(*center) + DVec3::new(x, y, 0.0)
        }
        CondensationShape::Polygon { points } => polygon_point(points, [u, v, w]),
        CondensationShape::Mesh(model) => model.faces.point([u, v, w]),
    }
}

/// A uniformly distributed point of a polygon: picks a triangle of the fan from the first corner by area, then a point
/// in it.
fn polygon_point(points: &[[f64; 2]], [u, v, w]: [f64; 3]) -> DVec3 {
    let corner = |i: usize| points.get(i).map_or(DVec3::ZERO, |p| DVec3::new(p[0], p[1], 0.0));
    let area = |i: usize| (corner(i) - corner(0)).cross(corner(i + 1) - corner(0)).z.abs();
    let last = points.len().saturating_sub(1);
    // The fan covers polygons that are seen whole from their first corner; readers refuse others.
    let total = (1..last).fold(0.0, |s, i| s + area(i));
    let mut left = u * total;
    let mut pick = 1;
    for i in 1..last {
        pick = i;
        left -= area(i);
        if left < 0.0 {
            break;
        }
    }
    within([corner(0), corner(pick), corner(pick + 1)], v, w)
}
