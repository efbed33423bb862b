//! Blades of grass: strips along their axis, folded on the midrib, in place of tubes.

use std::f32::consts::PI;

use glam::{Quat, Vec2, Vec3};

use super::by_material::{AxisSurface, append_by_material};
use super::{AxisBinding, PlantSkin, SkinOptions};
use osier_base::convert::index;
use osier_base::{Result, math};
use osier_scene::plant::{Axis, AxisKind, NONE, Plant};

/// Angle of each half of a blade to the plane across its midrib, rad: grasses are folded by some 30 degrees in all.
const FOLD: f32 = 15.0 * PI / 180.0;
/// Least number of rows of points along a blade, about evenly spaced, so that it bends smoothly in the wind.
const MIN_ROWS: f32 = 6.0;
/// Points of a row: left edge, midrib, right edge.
const ROW: u32 = 3;

/// Cross-section of a blade, from which a row of three points is made.
struct Row {
    p: Vec3,
    q: Quat,
    /// Half the width of the ribbon at this point, m.
    half: f32,
    /// Arc length on the axis, m; below 0 under the ground.
    s: f32,
}

/// Appends the blades of a plant to its skin, as the last subsets.
/// # Errors
/// `Limit` for more points than the options allow, `TooMany` beyond 2^32 points.
pub(super) fn append_ribbons(plant: &Plant, options: &SkinOptions, skin: &mut PlantSkin) -> Result<()> {
    let is_blade = |_: &Plant, _: &SkinOptions, axis: &Axis| axis.kind == AxisKind::Blade;
    let blades = AxisSurface { is_of: is_blade, append: append_ribbon, remedy: "fewer blades or a larger turn_deg" };
    append_by_material(plant, options, &blades, skin)
}

/// The rows of a blade but the last, which is a single point: where the axis has turned or a share of its length has passed.
fn rows(plant: &Plant, options: &SkinOptions, axis: &Axis) -> Vec<Row> {
    let nodes = plant.nodes_of(axis);
    let (last, longest) = (nodes.end - 1, axis.length / MIN_ROWS);
    let mut rows = Vec::new();
    for k in nodes.start..last {
        // The frame of a node follows the segment below it; the row stands across the bisector of both.
        let (p, q) = (&plant.nodes.p, plant.nodes.q[k]);
        let along = math::normalize_or(p[k + 1] - p[k.saturating_sub(1).max(nodes.start)], q * Vec3::Y);
        let q = (math::rotation_between(q * Vec3::Y, along) * q).normalize();
        let row = Row { p: p[k], q, half: plant.nodes.r[k], s: plant.nodes.s[k] };
        let keep = rows.last().is_none_or(|before: &Row| {
            let turned = (before.q * Vec3::Y).dot(row.q * Vec3::Y) < math::cos_f32(options.turn);
            turned || row.s - before.s > longest
        });
        if keep {
            rows.push(row);
        }
    }
    // A blade without a parent is extended straight below the ground, as trunks are.
    if let Some(first) = rows.first().filter(|_| axis.parent == NONE && options.bury > 0.0) {
        let below =
            Row { p: first.p - first.q * Vec3::Y * options.bury, q: first.q, half: first.half, s: -options.bury };
        rows.insert(0, below);
    }
    rows
}

fn append_ribbon(
    plant: &Plant,
    options: &SkinOptions,
    axis: u32,
    skin: &mut PlantSkin,
    triangles: &mut Vec<[u32; 3]>,
) -> Result<()> {
    let shape = &plant.axes[axis as usize];
    let rows = rows(plant, options, shape);
    let (sin, cos) = (math::sin_f32(FOLD), math::cos_f32(FOLD));
    let [tile_w, tile_h] = options.tile_of(plant.nodes.r[shape.first as usize]);
    let mesh = &mut skin.mesh;
    let first = index(mesh.points.len(), "points of a skin")?;
    for row in &rows {
        let (x, z) = (row.q * Vec3::X, row.q * Vec3::Z);
        for (side, across) in [(-1.0, 0.0), (0.0, 0.5), (1.0, 1.0_f32)] {
            // Both halves rise from the midrib by the fold; each has its own normal at its edge, the midrib their mean.
            let out = x * (side * cos) + z * (side.abs() * sin);
            mesh.points.push(row.p + out * row.half);
            mesh.normals.push(math::normalize_or(z * cos - x * (side * sin), z));
            mesh.uvs.push(Vec2::new(across * 2.0 * row.half / tile_w, row.s / tile_h));
            skin.bindings.push(AxisBinding { axis, s: row.s.max(0.0) });
        }
    }
    // Rows are joined by two quads each, the last one by two triangles to the tip.
    let count = index(rows.len(), "rows of a blade")?;
    for r in 1..count {
        let (a, b) = (first + (r - 1) * ROW, first + r * ROW);
        for k in 0..2 {
            triangles.push([a + k, a + k + 1, b + k + 1]);
            triangles.push([a + k, b + k + 1, b + k]);
        }
    }
    let last = plant.nodes_of(shape).end - 1;
    let tip = first + count * ROW;
    mesh.points.push(plant.nodes.p[last]);
    mesh.normals.push(plant.nodes.q[last] * Vec3::Z);
    mesh.uvs.push(Vec2::new(0.0, shape.length / tile_h));
    skin.bindings.push(AxisBinding { axis, s: shape.length });
    let below = tip - ROW;
    triangles.push([below, below + 1, tip]);
    triangles.push([below + 1, below + 2, tip]);
    Ok(())
}
