//! A recorded tree as a plant whose wood and leaves can be posed at any time of a clip. Own.
//!
//! The plant holds every axis that is visible at some time, so that its skin has one topology. Before its birth a node lies at
//! the tip that its axis has reached; a branch that falls thins out and then lies at its base.

use std::sync::Arc;

use glam::{Quat, Vec3};

use super::GrownTree;
use super::clip_leaves::{ClipOptions, LeafNow, LeafSlots, SlotOptions};
use super::plant::{AxisBuilder, ClipNodes, NodeSource, PlantOptions, TreeFoliage};
use super::record::{GrowthRecord, Wood};
use super::tree::{Tree, flag, y_axis};
use crate::grow::turtle::set_exposed_lengths;
use osier_base::limits::Limits;
use osier_base::math::{self, narrow};
use osier_base::{Error, Result};
use osier_scene::plant::Plant;

/// Pose of a plant at a time of a clip: its nodes, in the order of those of [`GrowthClip::plant`], and its leaves, in the order
/// of its organs.
#[derive(Debug, Clone, Default)]
pub struct PoseNow {
    /// Positions of all nodes that are visible at some time of the clip, m.
    pub p: Vec<Vec3>,
    /// Rotations into plant space, +Y along the axis.
    pub q: Vec<Quat>,
    /// Radii, m; 0 for nodes that do not exist at this time.
    pub r: Vec<f32>,
    /// Leaves, in the order of the organs of [`GrowthClip::plant`].
    pub leaves: Vec<LeafNow>,
}

/// A recorded tree as a plant, with the sources from which its nodes and leaves are posed.
#[derive(Debug, Clone)]
pub struct GrowthClip {
    /// All axes that are visible at some time: in their state at the end of the clip, or, for fallen ones, when they fell. The
    /// plant has as many organs as leaves are visible at once.
    pub plant: Plant,
    record: Arc<GrowthRecord>,
    options: PlantOptions,
    sources: Vec<NodeSource>,
    /// Radius of each node of the plant divided by that of its source; below 1 where validation made a branch thinner
    /// than its parent.
    thinning: Vec<f32>,
    slots: Option<LeafSlots>,
}

impl GrowthRecord {
    /// The record as a validated plant that can be posed at any age.
    /// # Errors
    /// `Limit` for more organs than allowed; the errors of `plant::validate`.
    pub fn clip(self: &Arc<Self>, options: &PlantOptions, clip: ClipOptions, limits: &Limits) -> Result<GrowthClip> {
        let all = self.wood_of_all();
        let tree = self.tree_of_all(&all);
        let nodes = &tree.nodes;

        // Axes of all nodes that the clip shows; an axis that falls during the clip has no parent.
        let mut plant = options.plant_without_axes(self.id, self.seed);
        let leaves = options.foliage.as_ref().and_then(|foliage| TreeFoliage::new(&tree, foliage));
        if let Some(leaves) = &leaves {
            plant.protos = leaves.foliage.organ().prototypes();
        }
        let age = narrow(self.span().from.max(self.span().to)).max(0.1);
        let mut builder = AxisBuilder::new(&tree, age, options, plant);
        let gone = (0..nodes.len()).map(|i| self.has_fallen(i)).collect();
        builder.clip = Some(ClipNodes { gone });
        builder.add_axes(None);
        let (sources, at) = (builder.sources, builder.at);
        let mut plant = builder.plant;
        let posed: Vec<_> = sources.iter().map(|source| posed_node(&tree, &all, *source)).collect();
        plant.nodes.q = posed.iter().map(|n| n.q).collect();

        // Validation must not drop nodes, because each is bound to nodes of the tree.
        osier_scene::plant::validate(&mut plant)?;
        if plant.nodes.len() != sources.len() {
            return Err(Error::export("X001", format!("plant \"{}\" has internodes of no length", self.tree.name)));
        }
        set_exposed_lengths(&mut plant);
        let thinning = plant.nodes.r.iter().zip(&posed).map(|(r, n)| r / n.r.max(f32::MIN_POSITIVE)).collect();

        // There are as many organs as leaves are visible at once; each shows several leaves in succession.
        let slot_options = SlotOptions { clip, limits };
        let mut slots = leaves.map(|leaves| LeafSlots::new(self, &leaves, slot_options)).transpose()?;
        if let Some(slots) = &mut slots {
            plant.organs = slots.organs(&plant, self, &all, &at);
            let waiting = |(position, orientation)| LeafNow { position, orientation, size: 0.0 };
            slots.waiting = plant.organs.iter().map(|organ| waiting(plant.organ_site(organ))).collect();
        }
        Ok(GrowthClip { plant, record: Arc::clone(self), options: options.clone(), sources, thinning, slots })
    }

    /// The recorded tree with the given wood, and with all nodes that the clip never shows marked as fallen.
    fn tree_of_all(&self, all: &Wood) -> Tree {
        let mut tree = self.tree.clone();
        tree.nodes.p.clone_from(&all.p);
        tree.nodes.q.clone_from(&all.q);
        tree.nodes.r.clone_from(&all.r);
        for i in 0..tree.nodes.len() {
            tree.nodes.flags[i] &= !flag::FALLEN;
            if !self.is_shown(i) {
                tree.nodes.flags[i] |= flag::FALLEN;
            }
        }
        tree
    }
}

/// Place, frame and radius of a node of the plant at one age.
struct PosedNode {
    p: Vec3,
    q: Quat,
    r: f32,
}

/// Pose of a node of the plant on given wood: its radius is the mean of those of the internodes on both sides, and its frame
/// halves the angle between them.
fn posed_node(tree: &Tree, wood: &Wood, source: NodeSource) -> PosedNode {
    let i = source.node as usize;
    let p = match wood.p.get(source.place as usize) {
        Some(p) => *p,
        None => tree.nodes.base(i),
    };
    let (q, own) = (wood.q[i], wood.r[i] * wood.shown[i]);
    let Some(next) = wood.q.get(source.next as usize) else { return PosedNode { p, q, r: own } };
    // Wood that does not exist at this time has weight 0 in the mean direction.
    let n = source.next as usize;
    let (here, ahead) = (y_axis(q), y_axis(*next) * wood.shown[n]);
    let tangent = math::normalize_or(here + ahead, here);
    PosedNode {
        p,
        q: (math::rotation_between(here, tangent) * q).normalize(),
        r: own + 0.5 * (wood.r[n] - wood.r[i]) * wood.shown[n] * wood.shown[i],
    }
}

impl GrowthClip {
    /// Pose of the plant at an age, years. The cost is proportional to the number of all nodes that the tree ever had, whatever
    /// the age.
    pub fn pose(&self, age: f32) -> PoseNow {
        let wood = self.record.wood(age);
        let mut pose = PoseNow::default();
        for (source, thinning) in self.sources.iter().zip(&self.thinning) {
            let node = posed_node(&self.record.tree, &wood, *source);
            pose.p.push(node.p);
            pose.q.push(node.q);
            pose.r.push(node.r * thinning);
        }
        if let Some(slots) = &self.slots {
            pose.leaves = slots.leaves_at(&self.record, &wood, age);
        }
        pose
    }

    /// Positions of the plant's nodes at an age, years, as in [`Self::pose`].
    pub fn node_positions(&self, age: f32) -> Vec<Vec3> {
        let wood = self.record.wood(age);
        self.sources.iter().map(|source| posed_node(&self.record.tree, &wood, *source).p).collect()
    }

    /// The tree at the end of the last year that the clip shows, without wood that has fallen by then, validated.
    /// # Errors
    /// As [`GrownTree::plant`].
    pub fn plant_at_end(&self, limits: &Limits) -> Result<Plant> {
        let GrowthRecord { tree, id, seed, .. } = &*self.record;
        let age = f64::from(tree.year).max(0.1);
        GrownTree { tree: tree.clone(), id: *id, seed: *seed, age }.plant(&self.options, limits)
    }

    /// The ages that the clip shows, from its first frame to its last one.
    pub fn span(&self) -> super::ClipSpan {
        self.record.span()
    }
}
