//! Converts grown axes to a [`Plant`]: canonical order, frames, radii, leaves.

use glam::{Mat3, Quat, Vec3};

use super::ShapeMaterials;
use super::axis::{ROOT, ShapeAxis, ShapeNode};
use super::growth::{depth_first, last_time};
use super::leaves::place_leaves;
use super::params::{ShapeParams, ThicknessRule, WeightedRatio};
use crate::grow::radii::{self, CHILD_RADIUS, Pipe, Taper};
use crate::grow::turtle::{OrganSpec, set_exposed_lengths};
use osier_base::Result;
use osier_base::convert::index;
use osier_base::math::narrow;
use osier_base::rng::Rng;
use osier_scene::plant::{Axis, AxisKind, NONE, Nodes, Plant};

/// Provisional radius of nodes until [`set_radii`], m: leaves are placed on the centreline before it runs.
const NO_RADIUS: f32 = 1e-4;
/// Half width of the tip of a blade, m: a ribbon needs some width up to its end.
const BLADE_TIP: f64 = 1e-4;

/// Where an axis is attached in a plant, and its branching order there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Attachment {
    /// Index of the parent in the plant, or [`NONE`].
    pub parent: u32,
    /// Arc length on the parent, m.
    pub parent_s: f32,
    /// Branching order in the plant, 0 for roots.
    pub order: u8,
}

/// Appends an axis to a plant, without radii. `last`: growth time, t, that the plant stores as 1.
pub(super) fn push_axis(plant: &mut Plant, axis: &ShapeAxis, at: Attachment, kind: AxisKind, last: f64) -> Result<()> {
    let first = index(plant.nodes.len(), "nodes of a plant")?;
    let birth = |time: f64| if last > 0.0 { narrow(time / last).clamp(0.0, 1.0) } else { 0.0 };
    // Arc lengths are those of the stored, rounded positions.
    let (mut s, mut before) = (0.0, None::<Vec3>);
    for node in &axis.nodes {
        let p = Vec3::from_array(node.p.to_array().map(narrow));
        s += before.map_or(0.0, |b| b.distance(p));
        before = Some(p);
        plant.nodes.p.push(p);
        plant.nodes.q.push(frame(node));
        plant.nodes.r.push(NO_RADIUS);
        plant.nodes.s.push(s);
        plant.nodes.birth.push(birth(node.time));
        plant.nodes.color.push(0);
    }
    plant.axes.push(Axis {
        id: axis.id,
        parent: at.parent,
        parent_s: at.parent_s,
        order: at.order,
        kind,
        first,
        count: index(axis.nodes.len(), "nodes of an axis")?,
        length: s,
        s_exposed: 0.0,
        material: 0,
        fork: axis.fork,
        end: axis.end,
        birth: axis.nodes.first().map_or(0.0, |n| birth(n.time)),
    });
    Ok(())
}

/// Frame of a node: +Y along the tangent, +X the roll reference.
fn frame(node: &ShapeNode) -> Quat {
    let single = |v: glam::DVec3| Vec3::from_array(v.to_array().map(narrow));
    let (x, y) = (single(node.reference), single(node.tangent));
    Quat::from_mat3(&Mat3::from_cols(x, y, x.cross(y))).normalize()
}

/// Arc length on an axis of the plant that corresponds to `s` on the grown axis. Lengths in the plant are those of rounded
/// positions, so the site keeps its share of the length.
pub(super) fn rounded_s(grown: &ShapeAxis, s: f64, in_plant: &Axis) -> f32 {
    let whole = grown.grown_length();
    let share = if whole > 0.0 { (s / whole).clamp(0.0, 1.0) } else { 0.0 };
    narrow(share) * in_plant.length
}

/// Builds the plant of grown axes. `plant`: its id and seed.
/// # Errors
/// The errors of `plant::validate`, `TooMany` beyond 2^32 nodes.
pub(super) fn build_plant(
    axes: &[ShapeAxis],
    params: &ShapeParams,
    plant: (u32, u64),
    organ: Option<&OrganSpec>,
    materials: &ShapeMaterials,
) -> Result<Plant> {
    let mut out = Plant {
        id: plant.0,
        seed: plant.1,
        materials: materials.names.clone(),
        source: materials.source.clone(),
        ..Plant::default()
    };
    let nodes = axes.iter().map(|a| a.nodes.len()).sum();
    out.nodes = reserved(nodes);
    let order = depth_first(axes);
    let last = last_time(axes);
    let kind = if params.blade_width.is_some() { AxisKind::Blade } else { AxisKind::Stem };
    let mut place = vec![NONE; axes.len()];
    for (i, grown) in (0_u32..).zip(&order) {
        let axis = &axes[*grown];
        place[*grown] = i;
        let at = match axes.get(axis.parent).filter(|_| axis.parent != ROOT) {
            Some(parent) => {
                let index = place[axis.parent];
                let parent_s = rounded_s(parent, axis.parent_s, &out.axes[index as usize]);
                Attachment { parent: index, parent_s, order: axis.level }
            }
            None => Attachment { parent: NONE, parent_s: 0.0, order: axis.level },
        };
        push_axis(&mut out, axis, at, kind, last)?;
    }
    let in_order: Vec<&ShapeAxis> = order.iter().map(|i| &axes[*i]).collect();
    // Leaves of the last level thicken the wood that bears them; leaves on thin wood of other levels need its radii first.
    let highest = params.limits.levels.saturating_sub(1);
    place_leaves(&mut out, params, organ, |axis, _| axis.order == highest);
    set_radii(&mut out, &in_order, params);
    seat_leaves(&mut out);
    place_leaves(&mut out, params, organ, |axis, r| axis.order != highest && f64::from(r) < params.leaves.max_radius);
    finish(&mut out, materials)?;
    Ok(out)
}

/// Moves leaves that were placed before their wood had radii out to its surface.
fn seat_leaves(plant: &mut Plant) {
    let mut leaves = std::mem::take(&mut plant.organs);
    for leaf in &mut leaves {
        leaf.petiole += plant.frame(&plant.axes[leaf.axis as usize], leaf.s).r - NO_RADIUS;
    }
    plant.organs = leaves;
}

/// Validates the plant, whose radii are set, then computes exposed lengths and assigns materials by thickness.
pub(super) fn finish(plant: &mut Plant, materials: &ShapeMaterials) -> Result<()> {
    osier_scene::plant::validate(plant)?;
    set_exposed_lengths(plant);
    for axis in &mut plant.axes {
        let base = plant.nodes.r.get(axis.first as usize).copied().unwrap_or(0.0);
        axis.material = if base < materials.shoot_radius { materials.shoot } else { materials.bark };
    }
    Ok(())
}

fn reserved(nodes: usize) -> Nodes {
    Nodes {
        p: Vec::with_capacity(nodes),
        q: Vec::with_capacity(nodes),
        r: Vec::with_capacity(nodes),
        s: Vec::with_capacity(nodes),
        birth: Vec::with_capacity(nodes),
        color: Vec::with_capacity(nodes),
    }
}

/// Sets the radii of all nodes by the rule of the parameters; the radius of a blade is half its width.
fn set_radii(plant: &mut Plant, grown: &[&ShapeAxis], params: &ShapeParams) {
    if let Some(width) = params.blade_width {
        return set_blade_widths(plant, width);
    }
    let thickness = &params.thickness;
    let base = thickness.base;
    match &thickness.rule {
        ThicknessRule::Pipe => {
            let pipe = Pipe { exponent: thickness.exponent, tip: thickness.tip, base };
            radii::pipe(plant, &pipe);
        }
        ThicknessRule::Taper => {
            let base = base.unwrap_or(Taper::default().base);
            radii::taper(plant, &Taper { base, tip: thickness.tip, exponent: thickness.exponent });
        }
        ThicknessRule::Cone(ratios) => set_cones(plant, grown, ratios, params),
    }
}

/// Own: half the width of a blade, w/2 (1 - (s/L)^2).
fn set_blade_widths(plant: &mut Plant, width: f64) {
    for axis in &plant.axes {
        let nodes = plant.nodes_of(axis);
        for k in nodes {
            let t = f64::from(plant.nodes.s[k] / axis.length.max(f32::MIN_POSITIVE)).min(1.0);
            plant.nodes.r[k] = narrow((0.5 * width * (1.0 - t * t)).max(BLADE_TIP));
        }
    }
}

/// Radii of truncated cones, one between each two sites of an axis: at its upper end an internode has the drawn share of the
/// radius at its lower end. [wang-hao] 3.2.1: r_top = r_3 r_bottom.
fn set_cones(plant: &mut Plant, grown: &[&ShapeAxis], ratios: &[WeightedRatio], params: &ShapeParams) {
    let weights: Vec<f64> = ratios.iter().map(|r| r.weight).collect();
    let tip = params.thickness.tip;
    for (i, shape) in grown.iter().enumerate() {
        let axis = plant.axes[i].clone();
        let base = match plant.axes.get(axis.parent as usize) {
            Some(parent) => CHILD_RADIUS * f64::from(plant.frame(parent, axis.parent_s).r),
            None => params.thickness.base.unwrap_or(Taper::default().base),
        };
        let mut draws = Rng::at(plant.seed, &[axis.id.into(), "cone".into()]);
        // Arc length and radius at both ends of the internode that holds the node.
        let mut ends = shape.sites.iter().map(|s| f64::from(rounded_s(shape, *s, &axis)));
        let whole = f64::from(axis.length);
        let (mut below, mut above) = ((0.0, base.max(tip)), (0.0, base.max(tip)));
        for k in plant.nodes_of(&axis) {
            let s = f64::from(plant.nodes.s[k]);
            // Step on to the internode that holds the node; each draws its ratio once.
            while s > above.0 {
                below = above;
                let ratio = ratios.get(draws.pick(&weights)).map_or(1.0, |r| r.ratio);
                above = (ends.next().unwrap_or(whole).max(below.0), (below.1 * ratio).max(tip));
                if above.0 >= whole {
                    break;
                }
            }
            let t = if above.0 > below.0 { ((s - below.0) / (above.0 - below.0)).clamp(0.0, 1.0) } else { 1.0 };
            plant.nodes.r[k] = narrow(below.1 + (above.1 - below.1) * t);
        }
    }
}
