//! Adds twigs and leaves to an existing plant: [hoetzlein] Figure 6c.

use std::collections::BTreeSet;

use glam::Vec3;

use super::axis::{ROOT, ShapeAxis, ShapeNode};
use super::growth::{depth_first, grow_axes, last_time};
use super::leaves::place_leaves;
use super::params::ShapeParams;
use super::plant::{Attachment, finish, push_axis, rounded_s};
use super::{ShapeMaterials, check, spawn, warnings};
use crate::grow::radii::{self, CHILD_RADIUS};
use crate::grow::turtle::OrganSpec;
use osier_base::Result;
use osier_base::diagnostic::Diagnostic;
use osier_base::math::narrow;
use osier_base::rng::mix64;
use osier_base::rng::word;
use osier_scene::plant::{AxisEnd, AxisKind, NONE, Plant};

/// Adds twigs and leaves to those axes of a plant that bear no others. These axes count as level 0 of `params`, of which only
/// spacing, base and angle are read; the twigs begin with level 1. Axes and organs of the plant keep their ids; new ids depend
/// only on the axis that bears them.
/// # Errors
/// As [`super::grow`].
pub fn fill(
    plant: &mut Plant,
    params: &ShapeParams,
    organ: Option<&OrganSpec>,
    materials: &ShapeMaterials,
) -> Result<Vec<Diagnostic>> {
    check(params)?;
    let seed = mix64(&[plant.seed, word("fill")]);
    // Only axes without children become parents of twigs.
    let mut bears = vec![false; plant.axes.len()];
    for axis in plant.axes.iter().filter(|a| a.parent != NONE) {
        bears[axis.parent as usize] = true;
    }
    let parents: Vec<ShapeAxis> =
        (0..plant.axes.len()).map(|i| parent_axis(plant, i, bears[i], params, seed)).collect();
    let starts = (0..parents.len()).flat_map(|i| spawn::children(params, &parents[i], i, seed)).collect();
    let mut grown = grow_axes(params, starts, (plant.id, seed));
    let report = warnings(&grown, params, &materials.source);
    // Twigs of level 1 grow on the plant's axes, all others on twigs: separate the two kinds of parent.
    let hosts: Vec<usize> =
        grown.axes.iter().map(|a| if a.level == 1 && a.fork == NONE { a.parent } else { ROOT }).collect();
    for (axis, host) in grown.axes.iter_mut().zip(&hosts) {
        if *host != ROOT {
            axis.parent = ROOT;
        }
    }
    take_pace(plant, &mut grown.axes);
    insert(plant, &parents, &grown.axes, &hosts, params)?;
    // As on a plant of its own, twigs of the last level bear leaves whatever their radius.
    let twigs = grown.axes.iter().filter(|a| a.level + 1 == params.limits.levels);
    let leafy: BTreeSet<u64> = twigs.map(|a| a.id).collect();
    place_leaves(plant, params, organ, |axis, r| {
        axis.kind == AxisKind::Stem && (leafy.contains(&axis.id) || f64::from(r) < params.leaves.max_radius)
    });
    finish(plant, materials)?;
    Ok(report)
}

/// Converts the growth times of twigs, t since their start, to shares of the plant's growth time, in which their start
/// is given. On average a twig lengthens as fast as the plant, whose longest path takes the whole time. A plant without
/// times is left as it is.
fn take_pace(plant: &Plant, twigs: &mut [ShapeAxis]) {
    // The longest path from the ground along the axes, m; parents precede their children.
    let mut starts = vec![0.0_f64; plant.axes.len()];
    let mut longest = 0.0_f64;
    for (i, axis) in plant.axes.iter().enumerate() {
        if axis.parent != NONE {
            starts[i] = starts[axis.parent as usize] + f64::from(axis.parent_s);
        }
        longest = longest.max(starts[i] + f64::from(axis.length));
    }
    // Length and time of all twigs: their mean speed, m/t.
    let (mut length, mut time) = (0.0, 0.0);
    for (first, last) in twigs.iter().filter_map(|a| a.nodes.first().zip(a.nodes.last())) {
        length += last.s - first.s;
        time += last.time - first.time;
    }
    if !plant.nodes.birth.iter().any(|b| *b > 0.0) || longest <= 0.0 || time <= 0.0 {
        return;
    }
    let share = length / time / longest;
    let mut begins = vec![0.0; twigs.len()];
    for i in depth_first(twigs) {
        let twig = &mut twigs[i];
        let own = twig.nodes.first().map_or(0.0, |n| n.time);
        begins[i] = if twig.parent == ROOT { own } else { begins[twig.parent] };
        for node in &mut twig.nodes {
            node.time = begins[i] + (node.time - begins[i]) * share;
        }
    }
}

/// Converts an axis of the plant to a grown axis; it has sites only if it is a stem that bears no axes.
fn parent_axis(plant: &Plant, i: usize, bears: bool, params: &ShapeParams, seed: u64) -> ShapeAxis {
    let axis = &plant.axes[i];
    let node = |k: usize| ShapeNode {
        p: plant.nodes.p[k].as_dvec3(),
        tangent: (plant.nodes.q[k] * Vec3::Y).as_dvec3().normalize_or(glam::DVec3::Y),
        reference: (plant.nodes.q[k] * Vec3::X).as_dvec3().normalize_or(glam::DVec3::X),
        s: plant.nodes.s[k].into(),
        time: plant.nodes.birth[k].into(),
    };
    let mut grown = ShapeAxis {
        id: axis.id,
        parent: ROOT,
        parent_s: 0.0,
        ordinal: 0,
        level: 0,
        forks: 0,
        fork: NONE,
        length: axis.length.into(),
        exposed: axis.s_exposed.into(),
        end: AxisEnd::Tip,
        nodes: plant.nodes_of(axis).map(node).collect(),
        sites: Vec::new(),
    };
    if !bears && axis.kind == AxisKind::Stem {
        grown.sites = spawn::sites(params, &grown, seed);
    }
    grown
}

/// Rebuilds the plant with the twigs in their canonical places. `hosts`: for each twig the axis of the plant that bears it, or
/// [`ROOT`] if a twig does.
fn insert(
    plant: &mut Plant,
    parents: &[ShapeAxis],
    twigs: &[ShapeAxis],
    hosts: &[usize],
    params: &ShapeParams,
) -> Result<()> {
    let mut old = std::mem::take(plant);
    // Twigs begin at the times of the nodes that bear them, 0..1, and may end later: all times of the plant are
    // rescaled to shares of the latest one. A plant without times gets none, so that a clip still grows it by its path
    // lengths.
    let last = if old.nodes.birth.iter().any(|b| *b > 0.0) { last_time(twigs).max(1.0) } else { 0.0 };
    if last > 0.0 {
        scale_births(&mut old, narrow(1.0 / last));
    }
    // The twigs of one host in canonical order: `depth_first` keeps each twig together with its children.
    let mut by_host: Vec<Vec<usize>> = vec![Vec::new(); old.axes.len()];
    let mut host = ROOT;
    for i in depth_first(twigs) {
        if twigs[i].parent == ROOT {
            host = hosts[i];
        }
        if let Some(list) = by_host.get_mut(host) {
            list.push(i);
        }
    }
    let mut place_of_old = vec![NONE; old.axes.len()];
    let mut place_of_twig = vec![NONE; twigs.len()];
    let mut first_new = Vec::new();
    for (i, axis) in old.axes.iter().enumerate() {
        place_of_old[i] = osier_base::convert::index(plant.axes.len(), "axes of a plant")?;
        copy_axis(plant, &old, i, &place_of_old)?;
        for &t in &by_host[i] {
            let twig = &twigs[t];
            let at = if twig.parent == ROOT {
                let host = &plant.axes[place_of_old[i] as usize];
                let parent_s = rounded_s(&parents[i], twig.parent_s, host);
                Attachment { parent: place_of_old[i], parent_s, order: axis.order.saturating_add(1) }
            } else {
                let parent = place_of_twig[twig.parent];
                let bearer = &plant.axes[parent as usize];
                let order = bearer.order.saturating_add(u8::from(twig.fork == NONE));
                Attachment { parent, parent_s: rounded_s(&twigs[twig.parent], twig.parent_s, bearer), order }
            };
            place_of_twig[t] = osier_base::convert::index(plant.axes.len(), "axes of a plant")?;
            first_new.push(plant.axes.len());
            push_axis(plant, twig, at, AxisKind::Stem, last)?;
        }
    }
    for i in first_new {
        taper_twig(plant, i, params);
    }
    plant.organs = old.organs.clone();
    for organ in &mut plant.organs {
        organ.axis = place_of_old[organ.axis as usize];
    }
    plant.protos.clone_from(&old.protos);
    plant.materials.clone_from(&old.materials);
    plant.source.clone_from(&old.source);
    (plant.id, plant.seed) = (old.id, old.seed);
    Ok(())
}

/// Multiplies all growth times of a plant.
fn scale_births(plant: &mut Plant, factor: f32) {
    let axes = plant.axes.iter_mut().map(|axis| &mut axis.birth);
    let organs = plant.organs.iter_mut().map(|organ| &mut organ.birth);
    plant.nodes.birth.iter_mut().chain(axes).chain(organs).for_each(|birth| *birth *= factor);
}

/// Copies an axis and its nodes from another plant. `places`: new index of each axis copied before, its parent included.
fn copy_axis(plant: &mut Plant, from: &Plant, i: usize, places: &[u32]) -> Result<()> {
    let axis = &from.axes[i];
    let range = from.nodes_of(axis);
    let first = osier_base::convert::index(plant.nodes.len(), "nodes of a plant")?;
    plant.nodes.p.extend_from_slice(&from.nodes.p[range.clone()]);
    plant.nodes.q.extend_from_slice(&from.nodes.q[range.clone()]);
    plant.nodes.r.extend_from_slice(&from.nodes.r[range.clone()]);
    plant.nodes.s.extend_from_slice(&from.nodes.s[range.clone()]);
    plant.nodes.birth.extend_from_slice(&from.nodes.birth[range.clone()]);
    plant.nodes.color.extend_from_slice(&from.nodes.color[range]);
    let parent = if axis.parent == NONE { NONE } else { places[axis.parent as usize] };
    plant.axes.push(osier_scene::plant::Axis { first, parent, ..axis.clone() });
    Ok(())
}

/// Tapers a twig linearly from base to tip. The base has 0.6 of the bearer's radius, at most the thickness of root axes.
fn taper_twig(plant: &mut Plant, i: usize, params: &ShapeParams) {
    let axis = plant.axes[i].clone();
    let below = f64::from(plant.frame(&plant.axes[axis.parent as usize], axis.parent_s).r);
    let most = params.thickness.base.unwrap_or(radii::Taper::default().base);
    let base = (CHILD_RADIUS * below).min(most);
    let tip = params.thickness.tip.min(base);
    for k in plant.nodes_of(&axis) {
        let t = f64::from(plant.nodes.s[k] / axis.length.max(f32::MIN_POSITIVE)).min(1.0);
        plant.nodes.r[k] = narrow((base + (tip - base) * t).max(1e-6));
    }
}
