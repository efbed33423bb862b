//! Decides which axes and leaves of a plant become rods, and which are fixed rigidly to rods.

use glam::{DQuat, DVec3};

use crate::rods::layout::{RodDescription, RodMaterial};
use crate::rods::system::SupportKind;
use crate::rods::tuning::{MIN_AXIS_LENGTH, MIN_STALK_LENGTH, WOOD_SECTION_SHARE};
use crate::sway::{WoodParams, damping_ratio};
use osier_scene::Trs;
use osier_scene::plant::{Axis, AxisKind, NONE, Organ, Plant};

/// Which parts of a plant bend, and with what stiffness, density, drag and damping.
#[derive(Debug, Clone)]
pub struct RodPlantParams {
    /// Wood and leaves: stiffness, density, drag, and factor on damping.
    pub wood: WoodParams,
    /// Gravitational acceleration along -Y, m/s^2.
    pub gravity: f64,
    /// Shear modulus divided by Young's modulus, 0.02..0.5.
    pub shear: f64,
    /// Stiffness of the restoring springs divided by the stiffness of the fundamental mode, 0..4.
    pub recovery: f64,
    /// Divisor of all Young's moduli, 1..20.
    pub flexibility: f64,
    /// Young's modulus of stalks and petioles, Pa, before it is divided by `flexibility`.
    pub stalk_young: f64,
    /// Stalk radius of each prototype at scale 1, m.
    pub stalk_radii: Vec<f64>,
    /// Stalk radius of all leaves, m, in place of the prototypes'.
    pub stalk_radius: Option<f64>,
    /// Number of sections of each stalk and petiole, at least 2; they count against `max_sections`.
    pub stalk_sections: usize,
    /// Number of sections of a stem; `None` chooses it from length and radius.
    pub sections: Option<usize>,
    /// Largest radius that bends, m; thicker wood is rigid.
    pub max_rod_radius: f64,
    /// Largest number of sections of all rods; stems of low order and great length come first.
    pub max_sections: usize,
    /// Largest number of leaves with a stalk rod, spread evenly over all leaves.
    pub max_leaf_stalks: usize,
}

/// How an axis of a plant moves: not at all, as a rod, or rigidly with a rod.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum AxisMotion {
    /// Rigid with the ground.
    Still,
    /// A rod, by index, that begins at an arc length, m in the plant's unscaled space; the axis is rigid below.
    Rod(usize, f64),
    /// Moves rigidly with a rod: index of the rod, and arc length on it, m.
    Rider(usize, f64),
}

/// Attachment of a leaf: carrying rod, pivot and orientation in the world, m.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LeafPlacement {
    /// Rod of its stalk, if it has one.
    pub stalk: Option<usize>,
    /// Rod that carries it or its stalk, and arc length there, m.
    pub host: Option<(usize, f64)>,
    pub pivot: DVec3,
    pub q: DQuat,
    pub scale: f64,
}

/// Rods of a plant, with the motion of its axes and leaves, in the world.
#[derive(Debug, Default)]
pub(crate) struct RodPlantLayout {
    pub rods: Vec<RodDescription>,
    pub holds: Vec<(usize, f64, SupportKind)>,
    pub axes: Vec<AxisMotion>,
    pub leaves: Vec<LeafPlacement>,
    /// Numbers of stems and of leaves that are rigid because the budget of sections is exhausted.
    pub omitted: [usize; 2],
    scale: f64,
}

impl RodPlantLayout {
    pub(crate) fn new(plant: &Plant, stand: &Trs, params: &RodPlantParams) -> Self {
        let mut layout = Self { scale: f64::from(stand.s.x), ..Self::default() };
        // Find the axes that can be rods and select those within the budget, then add rods in the order of axes, so that a parent
        // precedes its children.
        let rods = layout.rods_of_bending_axes(plant, stand, params);
        let selected = layout.stems_within_budget(plant, &rods, params);
        for (axis, rod) in plant.axes.iter().zip(rods) {
            let host = (axis.parent != NONE).then(|| layout.host_at(axis.parent, f64::from(axis.parent_s))).flatten();
            let index = layout.axes.len();
            let carried = match (rod.filter(|_| selected[index]), host) {
                (Some((from, rod)), host) => layout.push_rod(rod, from, host),
                (None, Some((rod, at))) => AxisMotion::Rider(rod, at),
                (None, None) => AxisMotion::Still,
            };
            layout.axes.push(carried);
        }
        layout.attach_leaves(plant, stand, params);
        layout
    }

    /// Rod that carries arc length `s`, m, of an axis, and arc length on that rod, m.
    fn host_at(&self, axis: u32, s: f64) -> Option<(usize, f64)> {
        match self.axes.get(axis as usize).copied().unwrap_or(AxisMotion::Still) {
            AxisMotion::Still => None,
            AxisMotion::Rod(_, from) if s < from => None,
            AxisMotion::Rod(rod, from) => Some((rod, (s - from) * self.scale)),
            AxisMotion::Rider(rod, at) => Some((rod, at)),
        }
    }

    /// Rod (without parent) of each axis that may bend, and the arc length on the axis, m, at which the bending part begins.
    fn rods_of_bending_axes(
        &self,
        plant: &Plant,
        stand: &Trs,
        params: &RodPlantParams,
    ) -> Vec<Option<(f64, RodDescription)>> {
        let one = |axis: &Axis| {
            if axis.kind == AxisKind::Root {
                return None;
            }
            let nodes = plant.nodes_of(axis);
            let radius = |k: usize| f64::from(plant.nodes.r[k]) * self.scale;
            // The rod starts where the wood becomes thin enough to bend.
            let first = nodes.clone().find(|k| radius(*k) <= params.max_rod_radius)?;
            // Length of the bending part; short stubs are not worth a rod.
            let from = f64::from(plant.nodes.s[first]);
            let length = (f64::from(axis.length) - from) * self.scale;
            if length < MIN_AXIS_LENGTH[0].max(MIN_AXIS_LENGTH[1] * radius(first)) || first + 1 >= nodes.end {
                return None;
            }
            let part = first..nodes.end;
            let radii: Vec<f64> = part.clone().map(radius).collect();
            let mean = radii.iter().fold(0.0, |s, r| s + r) / radii.len() as f64;
            let petiole = axis.kind == AxisKind::Petiole;
            let young = if petiole { params.stalk_young } else { params.wood.elasticity_at(mean) };
            let rod = RodDescription {
                points: part.map(|k| stand.apply(plant.nodes.p[k]).as_dvec3()).collect(),
                radii,
                material: rod_material(params, young, damping_ratio(axis.order, petiole)),
                sections: if petiole { Some(params.stalk_sections) } else { params.sections },
                parent: None,
            };
            Some((from, rod))
        };
        plant.axes.iter().map(one).collect()
    }

    /// Selects stems within the section budget: lower orders first, then longer ones.
    fn stems_within_budget(
        &mut self,
        plant: &Plant,
        rods: &[Option<(f64, RodDescription)>],
        params: &RodPlantParams,
    ) -> Vec<bool> {
        let mut order: Vec<usize> = (0..rods.len()).filter(|i| rods[*i].is_some()).collect();
        let length = |i: &usize| plant.axes[*i].length;
        order.sort_by(|a, b| {
            // Lower orders carry higher ones: a bending twig on a rigid limb gains little.
            let by_order = plant.axes[*a].order.cmp(&plant.axes[*b].order);
            by_order.then(length(b).total_cmp(&length(a))).then(a.cmp(b))
        });
        let mut selected = vec![false; rods.len()];
        let most = if plant.organs.is_empty() { 1.0 } else { WOOD_SECTION_SHARE } * params.max_sections as f64;
        let mut used = 0;
        for i in order {
            let count = rods[i].as_ref().map_or(0, |r| r.1.section_count());
            if (used + count) as f64 <= most {
                used += count;
                selected[i] = true;
            } else {
                self.omitted[0] += 1;
            }
        }
        selected
    }

    /// Adds a rod that begins at arc length `from`, m, of its axis. Without a host its base is clamped to the world.
    fn push_rod(&mut self, rod: RodDescription, from: f64, host: Option<(usize, f64)>) -> AxisMotion {
        let index = self.rods.len();
        if host.is_none() {
            self.holds.push((index, 0.0, SupportKind::Fixed));
        }
        self.rods.push(RodDescription { parent: host, ..rod });
        AxisMotion::Rod(index, from)
    }

    /// Attaches all leaves, with stalk rods as far as the budget allows.
    fn attach_leaves(&mut self, plant: &Plant, stand: &Trs, params: &RodPlantParams) {
        let used = self.rods.iter().fold(0, |s, r| s + r.section_count());
        let affordable = params.max_sections.saturating_sub(used) / params.stalk_sections.max(1);
        let (all, max_stalks) = (plant.organs.len(), affordable.min(params.max_leaf_stalks));
        let own = all.min(max_stalks);
        self.omitted[1] = all - own;
        for (i, organ) in plant.organs.iter().enumerate() {
            // Stalks are distributed evenly over the leaves.
            let chosen = (i + 1) * own / all > i * own / all;
            let attachment = self.attach_leaf(plant, organ, stand, params, chosen);
            self.leaves.push(attachment);
        }
    }

    /// Attachment of a leaf. `with_stalk`: adds a rod as its stalk, unless the leaf sits on a petiole axis, which is its stalk already.
    fn attach_leaf(
        &mut self,
        plant: &Plant,
        organ: &Organ,
        stand: &Trs,
        params: &RodPlantParams,
        with_stalk: bool,
    ) -> LeafPlacement {
        let (pivot, q) = plant.organ_site(organ);
        let site = plant.frame(&plant.axes[organ.axis as usize], organ.s);
        let (pivot, q) = (stand.apply(pivot).as_dvec3(), (stand.r * q).normalize().as_dquat().normalize());
        let scale = f64::from(organ.scale) * self.scale;
        // A leaf on a petiole axis follows the rod of that axis and needs no stalk.
        let host = self.host_at(organ.axis, f64::from(organ.s));
        let on_petiole = plant.axes[organ.axis as usize].kind == AxisKind::Petiole;
        let mut attachment = LeafPlacement { stalk: None, host, pivot, q, scale };
        if !with_stalk || on_petiole {
            return attachment;
        }
        let length = (f64::from(organ.petiole) * self.scale).max(MIN_STALK_LENGTH);
        // The stalk runs from the wood to the blade's pivot, along the leaf's +Y.
        let along = q * DVec3::Y;
        let foot = pivot - along * (f64::from(organ.petiole) * self.scale);
        // The part of the stalk inside the wood is rigid.
        let inside = (f64::from(site.r) * self.scale).min(0.5 * length);
        let points = [inside, 0.5 * (inside + length), length].map(|s| foot + along * s);
        let prototype_radius = params.stalk_radii.get(usize::from(organ.proto)).copied().unwrap_or(8e-4) * scale;
        let radius = params.stalk_radius.unwrap_or(prototype_radius).max(1e-4);
        attachment.stalk = Some(self.rods.len());
        let rod = RodDescription {
            points: points.to_vec(),
            radii: vec![radius; 3],
            material: rod_material(params, params.stalk_young, damping_ratio(0, true)),
            sections: Some(params.stalk_sections),
            parent: None,
        };
        self.push_rod(rod, 0.0, host);
        attachment
    }
}

fn rod_material(params: &RodPlantParams, young: f64, damping_ratio: f64) -> RodMaterial {
    RodMaterial {
        young: young / params.flexibility,
        shear: params.shear,
        density: params.wood.density,
        damping_ratio: (damping_ratio * params.wood.damping).min(1.0),
        recovery: params.recovery,
        spread_for_torsion: true,
    }
}
