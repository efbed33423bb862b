//! A grown tree as a [`Plant`]: chains of internodes become axes, leaves organs.

use glam::{Quat, Vec3};

use super::GrownTree;
use super::tree::{NONE as NO_NODE, Tree, flag, index_of, y_axis};
use crate::grow::pick_prototype;
use crate::grow::turtle::{OrganSpec, set_exposed_lengths};
use osier_base::Result;
use osier_base::limits::Limits;
use osier_base::math::{self, GOLDEN_ANGLE_F32, narrow};
use osier_base::rng::{Rng, mix64, word};
use osier_scene::Mesh;
use osier_scene::plant::{Axis, AxisEnd, AxisKind, NONE, Organ, Plant};

/// Cosine of the angle within which a side branch continues the skin of an axis that lost its tip: 60 degrees.
const TAKEOVER_COSINE: f32 = 0.5;
/// Least radius of a side branch that continues the skin of an axis, as a share of the radius of the axis.
const TAKEOVER_RADIUS: f32 = 0.5;
/// Radius of a branch at the end of an axis, as a share of the radius of the axis, above which both form a fork.
const FORK_RADIUS: f32 = 0.7;
/// Cosine of the bend and share of the radius below which a node is left out of the skin: 2 degrees, 5 percent.
const STRAIGHT: [f32; 2] = [0.999_391, 0.05];
/// Largest distance of the next node from the chord over nodes that were left out, in radii.
const MAX_DRIFT: f32 = 0.25;
/// Angles between a rosette's axis and its innermost and outermost leaves, degrees.
const ROSETTE: [f32; 2] = [35.0, 80.0];
/// Distance between successive leaves of a rosette along the tip, as a share of a leaf's length: leaves that all begin at one
/// point would look like the lobes of one leaf.
const ROSETTE_STEP: f32 = 0.06;
/// Standard deviation of the azimuth of leaves of a rosette, degrees.
const ROSETTE_AZIMUTH_DEVIATION: f32 = 18.0;
/// Standard deviation of a blade's rotation about its midrib, degrees, and the weight of the downward direction in that of the
/// midrib: without them the level blades of a rosette would merge to stars.
const BLADE_ROLL_DEVIATION: f32 = 22.0;
const BLADE_DROOP: f32 = 0.25;
/// Angle between a shoot and its leaves, degrees.
const SHOOT_LEAF_ANGLE: f32 = 55.0;
/// Angles between a shoot and the pieces of needles that diverge from it as side twigs, degrees; the first piece continues the
/// shoot.
const NEEDLE_TWIGS: [f32; 2] = [25.0, 60.0];
/// Distance behind the tip at which the tuft of a conifer begins, as a share of the length of its pieces.
const TUFT: f32 = 0.5;
/// Standard deviation of the angle of leaves, degrees.
const LEAF_ANGLE_DEVIATION: f32 = 10.0;
/// Standard deviation of the sizes of leaves, as a share of the mean.
const LEAF_SIZE_DEVIATION: f32 = 0.12;

/// Kind of foliage that a tree bears: single blades, or pieces of shoot with needles.
#[derive(Debug, Clone)]
pub enum Foliage {
    /// Blades in rosettes at tips and along young shoots; their number follows from the leaf area of the model.
    Blades(OrganSpec),
    /// Pieces of shoot with their needles, at tips and along the internodes that still bear needles; their number follows from
    /// the leaf area of the model.
    Needles(OrganSpec),
}

impl Foliage {
    pub(super) fn organ(&self) -> &OrganSpec {
        match self {
            Self::Blades(organ) | Self::Needles(organ) => organ,
        }
    }
}

/// Leaves and materials of the plant made from a grown tree.
#[derive(Debug, Clone, Default)]
pub struct PlantOptions {
    /// Its leaves; `None`: the tree is bare.
    pub foliage: Option<Foliage>,
    /// Names of the plant's materials, which the indices below and the leaves' subsets refer to.
    pub materials: Vec<String>,
    /// Index of the material of living axes that are not thin.
    pub bark: u16,
    /// Index of the material of living axes thinner than `shoot_radius` at their base.
    pub shoot: u16,
    /// Radius below which an axis takes the material of shoots, m.
    pub shoot_radius: f32,
    /// Index of the material of axes whose first internode is dead.
    pub dead: u16,
    /// Description of the plant's origin, for manifests.
    pub source: String,
}

impl PlantOptions {
    /// A plant with these materials but no axes yet.
    pub(super) fn plant_without_axes(&self, id: u32, seed: u64) -> Plant {
        Plant { id, seed, materials: self.materials.clone(), source: self.source.clone(), ..Plant::default() }
    }
}

impl GrownTree {
    /// The tree as a validated plant, in its own space: the origin is the tree's base.
    /// # Errors
    /// `Limit` for more organs than allowed; the errors of `plant::validate`.
    pub fn plant(&self, options: &PlantOptions, limits: &Limits) -> Result<Plant> {
        let mut plant = options.plant_without_axes(self.id, self.seed);
        let leaves = options.foliage.as_ref().and_then(|foliage| TreeFoliage::new(&self.tree, foliage));
        if let Some(leaves) = &leaves {
            plant.protos = leaves.foliage.organ().prototypes();
            let wanted = leaves.expected_count(&self.tree);
            limits.check("organs", wanted, &format!("organs of plant \"{}\"", self.tree.name))?;
        }
        let mut builder = AxisBuilder::new(&self.tree, narrow(self.age), options, plant);
        builder.add_axes(leaves.as_ref());
        let mut plant = builder.plant;
        osier_scene::plant::validate(&mut plant)?;
        set_exposed_lengths(&mut plant);
        Ok(plant)
    }
}

/// Children of all standing nodes, in compressed rows by node.
struct Children {
    first: Vec<u32>,
    list: Vec<u32>,
}

impl Children {
    fn new(tree: &Tree) -> Self {
        let nodes = &tree.nodes;
        let stands = |i: &usize| nodes.flags[*i] & flag::FALLEN == 0 && nodes.parent[*i] != NO_NODE;
        // A counting sort by parent.
        let mut first = vec![0_u32; nodes.len() + 1];
        for i in (0..nodes.len()).filter(stands) {
            first[nodes.parent[i] as usize + 1] += 1;
        }
        for i in 1..first.len() {
            first[i] += first[i - 1];
        }
        let mut list = vec![0_u32; first.last().map_or(0, |n| *n as usize)];
        let mut next = first.clone();
        for i in (0..nodes.len()).filter(stands) {
            let slot = &mut next[nodes.parent[i] as usize];
            list[*slot as usize] = index_of(i);
            *slot += 1;
        }
        Self { first, list }
    }

    fn of(&self, node: usize) -> &[u32] {
        &self.list[self.first[node] as usize..self.first[node + 1] as usize]
    }
}

/// Axis and arc length, m, at which a node of the tree lies in the plant.
#[derive(Debug, Clone, Copy)]
pub(super) struct NodeSite {
    pub axis: u32,
    pub s: f32,
}

/// Data of a tree in a clip that the builder needs, by node.
#[derive(Debug, Clone, Default)]
pub(super) struct ClipNodes {
    /// True for a node that falls before the end of the clip. It begins a separate tube, because its parent becomes thicker after
    /// the fall.
    pub gone: Vec<bool>,
}

/// Nodes of the tree that determine the pose of a node of the plant.
#[derive(Debug, Clone, Copy)]
pub(super) struct NodeSource {
    /// Node whose end gives the position; without one, it is the base of the tree.
    pub place: u32,
    /// Node that gives frame and radius.
    pub node: u32,
    /// Next node of the axis, with which frame and radius are averaged.
    pub next: u32,
}

/// First node of an axis to be added, and the fork to which it belongs.
#[derive(Debug, Clone, Copy)]
struct AxisStart {
    node: u32,
    fork: u32,
}

pub(super) struct AxisBuilder<'a> {
    tree: &'a Tree,
    age: f32,
    options: &'a PlantOptions,
    pub plant: Plant,
    /// For each node of the tree, its site in the plant; no axis if it was not added.
    pub at: Vec<NodeSite>,
    /// Set only for a tree that is shown in a clip.
    pub clip: Option<ClipNodes>,
    /// For each node of the plant, the nodes of the tree from which it is posed.
    pub sources: Vec<NodeSource>,
}

impl<'a> AxisBuilder<'a> {
    /// `age`: age of the tree, years; a birth at this age becomes 1.
    pub fn new(tree: &'a Tree, age: f32, options: &'a PlantOptions, plant: Plant) -> Self {
        Self { tree, age, options, plant, at: Vec::new(), clip: None, sources: Vec::new() }
    }

    /// Whether a node falls before the end of the clip; false without a clip.
    fn has_fallen(&self, i: usize) -> bool {
        self.clip.as_ref().is_some_and(|clip| clip.gone[i])
    }

    /// Adds all axes depth first, siblings by their place on the parent, and their leaves.
    pub fn add_axes(&mut self, leaves: Option<&TreeFoliage<'_>>) {
        let nodes = &self.tree.nodes;
        let children = Children::new(self.tree);
        self.at = vec![NodeSite { axis: NONE, s: 0.0 }; nodes.len()];
        // Stems that have not sprouted yet are left out; a clip shows some as they come out of the ground.
        let is_root = |i: &usize| {
            let has_sprouted = self.clip.is_some() || nodes.birth[*i] <= self.age;
            nodes.parent[*i] == NO_NODE && nodes.flags[*i] & flag::FALLEN == 0 && has_sprouted
        };
        // Roots are the first nodes of a tree, so that the search ends at the first node with a parent.
        let roots = (0..nodes.len()).take_while(|i| nodes.parent[*i] == NO_NODE).filter(is_root);
        let mut stack: Vec<AxisStart> = roots.map(|i| AxisStart { node: index_of(i), fork: NONE }).collect();
        stack.reverse();
        let mut chain = Vec::new();
        while let Some(start) = stack.pop() {
            // Collect the chain of continuations from here, and the branches that leave it.
            chain.clear();
            let mut branches = Vec::new();
            let mut node = start.node as usize;
            loop {
                chain.push(index_of(node));
                let next = self.continuation(&children, node);
                for other in children.of(node).iter().filter(|c| Some(**c) != next) {
                    // At the end of an axis, a branch that is nearly as thick as the node joins the skin as a fork instead of
                    // piercing it.
                    let thick = nodes.r[*other as usize] > FORK_RADIUS * nodes.r[node];
                    let forks = next.is_none() && thick && !self.has_fallen(*other as usize);
                    let fork = if forks { index_of(self.plant.axes.len()) } else { NONE };
                    branches.push(AxisStart { node: *other, fork });
                }
                match next {
                    Some(next) => node = next as usize,
                    None => break,
                }
            }
            self.add_axis(start, &chain);
            if let Some(leaves) = leaves {
                leaves.add_to_axis(&mut self.plant, self.tree, &chain, &self.at, self.age);
            }
            // The branches come in the order of their places on this axis; the stack reverses it.
            stack.extend(branches.into_iter().rev());
        }
    }

    /// The child that continues the skin of a node's axis: its continuation if that lives or all children are dead, otherwise the
    /// thickest living child that is thick and straight enough. Wood that remains standing is preferred to wood that falls during
    /// a clip.
    fn continuation(&self, children: &Children, node: usize) -> Option<u32> {
        let nodes = &self.tree.nodes;
        let stays = |c: usize| self.has_fallen(c) == self.has_fallen(node);
        let same_state = |c: usize| nodes.lives(c) == nodes.lives(node) && stays(c);
        let is_main = |c: &&u32| nodes.flags[**c as usize] & flag::MAIN != 0;
        // A living axis continues in living wood, a dead one in dead wood: the material changes only between axes.
        let main = children.of(node).iter().filter(is_main).find(|c| same_state(**c as usize));
        let falling = children.of(node).iter().filter(is_main).find(|c| self.has_fallen(**c as usize));
        if main.is_some() || !nodes.lives(node) || nodes.flags[node] & (flag::OPEN | flag::CUT) != 0 {
            return main.or(falling).copied();
        }
        // The leader has died. A side branch continues the skin only if the bend would not be visible.
        let d = nodes.direction(node);
        let fits = |c: &&u32| {
            let c = **c as usize;
            let straight = nodes.direction(c).dot(d) > TAKEOVER_COSINE;
            nodes.lives(c) && stays(c) && straight && nodes.r[c] > TAKEOVER_RADIUS * nodes.r[node]
        };
        // Of equal radii, take the lower index, so that the choice does not depend on the order of children.
        let thicker = |a: &&u32, b: &&u32| nodes.r[**a as usize].total_cmp(&nodes.r[**b as usize]).then(b.cmp(a));
        children.of(node).iter().filter(fits).max_by(thicker).or(falling).copied()
    }

    /// Adds an axis with the nodes of a chain, and chooses its material and kind of end.
    fn add_axis(&mut self, start: AxisStart, chain: &[u32]) {
        let tree = self.tree;
        let nodes = &tree.nodes;
        let (head, tail) = (start.node as usize, chain.last().copied().unwrap_or(start.node) as usize);
        let carrier = nodes.parent[head] as usize;
        // An axis that falls during the clip has no parent: it must not thicken with one that continues to grow.
        let breaks_off = self.has_fallen(head) && carrier < nodes.len() && !self.has_fallen(carrier);
        let on = self.at.get(carrier).copied().filter(|_| !breaks_off);
        let parent = on.and_then(|on| self.plant.axes.get(on.axis as usize));
        // The axis begins on the parent's centreline in the skin, in which nodes of straight stretches were left out.
        let from = match (parent, on) {
            (Some(parent), Some(on)) => self.plant.frame(parent, on.s).p,
            _ => nodes.base(head),
        };
        let first = self.plant.nodes.len();
        let axis = index_of(self.plant.axes.len());
        self.add_nodes(from, chain, axis);
        let last = self.plant.nodes.len() - 1;
        let base_radius = nodes.r[head];
        let options = self.options;
        let material = if !nodes.lives(head) {
            options.dead
        } else if base_radius < options.shoot_radius {
            options.shoot
        } else {
            options.bark
        };
        // The chain of an old leader begins in the middle of an axis that now continues elsewhere.
        let axis_id = tree.axis_ids[nodes.axis[head] as usize];
        let index = nodes.index[head];
        let id = if index == 0 { axis_id } else { mix64(&[axis_id, word("stub"), u64::from(index)]) };
        self.plant.axes.push(Axis {
            id,
            parent: on.map_or(NONE, |on| on.axis),
            parent_s: on.map_or(0.0, |on| on.s),
            // An axis of order 0 without a parent would be a trunk, with a root flare.
            order: nodes.order[head].max(u8::from(breaks_off)),
            kind: AxisKind::Stem,
            first: index_of(first),
            count: index_of(last + 1 - first),
            length: self.plant.nodes.s[last],
            s_exposed: 0.0,
            material,
            fork: start.fork,
            end: self.end_of(tail),
            birth: self.plant.nodes.birth[first],
        });
    }

    fn end_of(&self, node: usize) -> AxisEnd {
        let flags = self.tree.nodes.flags[node];
        if flags & flag::CUT != 0 {
            AxisEnd::Cut
        } else if flags & flag::OBSTACLE != 0 {
            AxisEnd::Obstacle
        } else if flags & (flag::SHADE | flag::DEAD) != 0 || self.tree.died.is_some() {
            AxisEnd::Shade
        } else {
            AxisEnd::Tip
        }
    }

    /// Adds the nodes of an axis: one at its base, then the ends of its internodes. Nodes between nearly collinear internodes of
    /// nearly equal radius are left out.
    fn add_nodes(&mut self, from: Vec3, chain: &[u32], axis: u32) {
        let tree = self.tree;
        let nodes = &tree.nodes;
        let Some(&head) = chain.first() else { return };
        let head = head as usize;
        let first_birth = match nodes.birth.get(nodes.parent[head] as usize) {
            // A branch begins in the first year of its own wood, not with the node that carries it.
            Some(carrier) => carrier.max(nodes.birth[head].ceil() - 1.0),
            None => nodes.birth[head],
        };
        let out = &mut self.plant.nodes;
        self.sources.push(NodeSource { place: nodes.parent[head], node: index_of(head), next: NO_NODE });
        let mut push = |p: Vec3, d: Vec3, node: usize, r: f32, s: f32, birth: f32| {
            out.p.push(p);
            out.q.push((math::rotation_between(y_axis(nodes.q[node]), d) * nodes.q[node]).normalize());
            out.r.push(r);
            out.s.push(s);
            out.birth.push((birth / self.age).clamp(0.0, 1.0));
            out.color.push(0);
        };
        // The first node of the axis, on its parent's centreline.
        let to_first = nodes.p[head] - from;
        push(from, math::normalize_or(to_first, nodes.direction(head)), head, nodes.r[head], 0.0, first_birth);
        // The last node that was kept, and the nodes left out since then.
        let (mut kept, mut kept_r, mut s) = (from, nodes.r[head], 0.0_f32);
        let mut skipped = 0;
        for (k, &node) in chain.iter().enumerate() {
            let i = node as usize;
            let here = nodes.p[i];
            let way = here - kept;
            let next = chain.get(k + 1).map(|n| *n as usize);
            // Radii belong to internodes. At a node, the mean of the radii of both internodes avoids steps.
            let r = next.map_or(nodes.r[i], |n| 0.5 * (nodes.r[i] + nodes.r[n]));
            let straight = next.is_some_and(|n| {
                let ahead = nodes.p[n] - here;
                let cosine = way.dot(ahead) / (way.length() * ahead.length()).max(1e-12);
                // Distance of the next node from the chord so far: on a long arc of small bends the skin would drift away from
                // its branches.
                let beside = way.length() * (1.0 - cosine * cosine).max(0.0).sqrt();
                cosine > STRAIGHT[0] && beside < MAX_DRIFT * r && (r - kept_r).abs() < STRAIGHT[1] * kept_r
            });
            if straight {
                skipped += 1;
                continue;
            }
            // Nodes left out get the arc length of their projection onto the chord, clamped to its ends.
            let chord = way.length();
            for &left_out in &chain[k - skipped..=k] {
                let part = (nodes.p[left_out as usize] - kept).dot(way) / (chord * chord).max(1e-12);
                self.at[left_out as usize] = NodeSite { axis, s: s + chord * part.clamp(0.0, 1.0) };
            }
            skipped = 0;
            s += chord;
            // The tangent halves the angle between the chord and the next internode.
            let tangent = match next {
                Some(n) => math::normalize_or(way.normalize_or_zero() + nodes.direction(n), nodes.direction(i)),
                None => math::normalize_or(way, nodes.direction(i)),
            };
            push(here, tangent, i, r, s, nodes.birth[i]);
            self.sources.push(NodeSource { place: node, node, next: next.map_or(NO_NODE, index_of) });
            self.at[i].s = s;
            (kept, kept_r) = (here, r);
        }
    }
}

/// Foliage of a tree: number, ids and rotations of its leaves.
#[derive(Debug, Clone)]
pub(super) struct TreeFoliage<'a> {
    pub foliage: &'a Foliage,
    pub mean: MeanLeaf,
}

/// The leaf of mean size.
#[derive(Debug, Clone, Copy)]
pub(super) struct MeanLeaf {
    /// Scale of the prototypes.
    scale: f32,
    /// One-sided area of a leaf of this scale, m^2.
    area: f32,
}

/// A leaf on wood of known position: all values but its own position.
#[derive(Debug, Clone, Copy)]
pub(super) struct PlacedLeaf {
    /// Rotation into plant space.
    pub q: Quat,
    /// Uniform size factor on the prototype.
    pub scale: f32,
    pub proto: u16,
    /// Distance of its pivot from the centreline, m.
    pub petiole: f32,
    /// Random in [0, 1], for colour.
    pub tint: f32,
}

/// Angles at which a blade leaves its wood.
#[derive(Debug, Clone, Copy)]
pub(super) struct BladeTurn {
    /// Azimuth about the wood, rad.
    pub azimuth: f32,
    /// Angle to the wood, rad.
    pub angle: f32,
}

/// Site of a leaf on an axis of the plant, and the angles at which it leaves the axis.
#[derive(Debug, Clone, Copy)]
struct LeafPlace {
    axis: u32,
    s: f32,
    turn: BladeTurn,
    id: u64,
    birth: f32,
}

impl<'a> TreeFoliage<'a> {
    /// `None` for a tree without leaf area or an organ without a mesh.
    pub fn new(tree: &Tree, foliage: &'a Foliage) -> Option<Self> {
        let organ = foliage.organ();
        let first = organ.meshes.first()?;
        // Needles extend beyond the ends of their piece, whose length is the organ's size.
        let length = match foliage {
            Foliage::Blades(_) => first.bounds().max.y.max(1e-9),
            Foliage::Needles(_) => narrow(organ.size).max(1e-9),
        };
        let scale = narrow(organ.size) / length;
        let total: f32 = organ.meshes.iter().map(|m| surface_area(m)).sum();
        // Sizes vary: the mean of squares is a little more than the square of the mean.
        let spread = 1.0 + LEAF_SIZE_DEVIATION * LEAF_SIZE_DEVIATION;
        let area = total / organ.meshes.len() as f32 * scale * scale * spread;
        let bears = tree.habit.leaf_area_tip > 0.0 || tree.habit.leaf_area_shoot > 0.0;
        (bears && area > 0.0).then_some(Self { foliage, mean: MeanLeaf { scale, area } })
    }

    /// Expected number of organs, compared with the limit: leaf area of the tree divided by that of the mean leaf.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a count for a limit")]
    fn expected_count(&self, tree: &Tree) -> u64 {
        (f64::from(tree.measures().leaf_area) / f64::from(self.mean.area)) as u64
    }

    /// Adds the leaves of a chain of nodes to the axis made from it, sorted by arc length.
    fn add_to_axis(&self, plant: &mut Plant, tree: &Tree, chain: &[u32], at: &[NodeSite], age: f32) {
        let first = plant.organs.len();
        for &node in chain {
            let i = node as usize;
            if !tree.nodes.lives(i) {
                continue;
            }
            let site = at[i];
            let birth = (tree.nodes.birth[i] / age).clamp(0.0, 1.0);
            // Leaves remain along an internode for `leaf_years`; every living open tip bears a rosette. Within a year, a part of
            // the leaves that unfold or fall is shown.
            let shown = tree.share_along(i);
            match self.foliage {
                Foliage::Needles(_) => self.add_needles(plant, tree, i, site, birth),
                Foliage::Blades(_) => {
                    let base = (site.s - tree.nodes.length[i]).max(0.0);
                    let count = if shown > 0.0 { self.count_along(tree, i, tree.nodes.length[i]) } else { 0 };
                    for k in (0..count).filter(|k| is_among(Self::shoot_leaf_id(tree, i, *k), shown)) {
                        let part = (k as f32 + 0.5) / count as f32;
                        let place = LeafPlace {
                            axis: site.axis,
                            s: base + part * (site.s - base),
                            turn: Self::shoot_leaf_turn(tree, i, k),
                            id: Self::shoot_leaf_id(tree, i, k),
                            birth,
                        };
                        self.add_blade(plant, place);
                    }
                    if tree.nodes.grows(i) {
                        self.add_rosette(plant, tree, i, site, birth);
                    }
                }
            }
        }
        // Organs of an axis are sorted by arc length; ids decide between leaves of one site, so that the order does not depend on
        // how they were made.
        plant.organs[first..].sort_by(|a, b| a.s.total_cmp(&b.s).then(a.id.cmp(&b.id)));
    }

    /// Number of leaves along an internode of the given length, m.
    pub fn count_along(&self, tree: &Tree, i: usize, length: f32) -> u32 {
        self.count(
            tree.habit.leaf_area_of_shoot(tree.nodes.birth[i]) * length,
            mix64(&[tree.node_id(i), word("along")]),
        )
    }

    /// Number of leaves of the rosette at the tip of an axis; it stays the same while the axis grows.
    pub fn count_at_tip(&self, tree: &Tree, axis: u32) -> u32 {
        self.count(tree.habit.leaf_area_tip, mix64(&[tree.axis_ids[axis as usize], word("rosette")]))
    }

    /// Id of leaf `k` of the rosette of an axis; it stays the same while the axis grows.
    pub fn tip_leaf_id(tree: &Tree, axis: u32, k: u32) -> u64 {
        mix64(&[tree.axis_ids[axis as usize], word("tip-leaf"), u64::from(k)])
    }

    /// Angles of leaf `k` of `count` of a rosette: golden angle from leaf to leaf, outer leaves flatter than inner ones.
    pub fn tip_leaf_turn(tree: &Tree, axis: u32, k: u32, count: u32) -> BladeTurn {
        // A random azimuth per axis turns the rosettes of neighbouring tips differently.
        let first = Rng::from_key(mix64(&[tree.axis_ids[axis as usize], word("tip-azimuth")])).unit_f32();
        let part = (k as f32 + 0.5) / count as f32;
        let mut draw = Rng::from_key(mix64(&[Self::tip_leaf_id(tree, axis, k), word("azimuth")]));
        let jitter = ROSETTE_AZIMUTH_DEVIATION.to_radians() * narrow(draw.normal().clamp(-2.0, 2.0));
        BladeTurn {
            azimuth: first * std::f32::consts::TAU + k as f32 * GOLDEN_ANGLE_F32 + jitter,
            angle: math::lerp(ROSETTE[0], ROSETTE[1], part).to_radians(),
        }
    }

    /// Id of leaf `k` along an internode, the same in every year.
    pub fn shoot_leaf_id(tree: &Tree, i: usize, k: u32) -> u64 {
        mix64(&[tree.node_id(i), word("leaf"), u64::from(k)])
    }

    /// Angles of leaf `k` along an internode, counted from its base.
    pub fn shoot_leaf_turn(tree: &Tree, i: usize, k: u32) -> BladeTurn {
        let azimuth = tree.nodes.azimuth[i] + k as f32 * GOLDEN_ANGLE_F32;
        BladeTurn { azimuth, angle: SHOOT_LEAF_ANGLE.to_radians() }
    }

    /// Number of leaves of an area, m2: whole ones, and one more with the probability of the remaining fraction.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most the limit of organs")]
    fn count(&self, area: f32, id: u64) -> u32 {
        let wanted = area / self.mean.area;
        let whole = wanted.floor();
        whole as u32 + u32::from(Rng::from_key(id).unit_f32() < wanted - whole)
    }

    /// Distance of leaf `k` of a rosette from the tip, towards the base, m.
    pub fn rosette_behind(&self, k: u32) -> f32 {
        k as f32 * ROSETTE_STEP * narrow(self.foliage.organ().size)
    }

    /// Adds the rosette of a tip: leaves at intervals of [`ROSETTE_STEP`], beginning at the tip.
    fn add_rosette(&self, plant: &mut Plant, tree: &Tree, i: usize, site: NodeSite, birth: f32) {
        let axis = tree.nodes.axis[i];
        let count = self.count_at_tip(tree, axis);
        let shown = tree.share_at_tip(i);
        for k in (0..count).filter(|k| is_among(Self::tip_leaf_id(tree, axis, *k), shown)) {
            let place = LeafPlace {
                axis: site.axis,
                s: (site.s - self.rosette_behind(k)).max(0.0),
                turn: Self::tip_leaf_turn(tree, axis, k, count),
                id: Self::tip_leaf_id(tree, axis, k),
                birth,
            };
            self.add_blade(plant, place);
        }
    }

    /// Places a blade at an angle to its wood, its upper side turned up as far as the roll of the blade allows. `q`, `r`: frame and
    /// radius of the wood, m.
    pub fn blade(&self, id: u64, turn: BladeTurn, q: Quat, r: f32) -> PlacedLeaf {
        let mut draw = Rng::from_key(id);
        let deviation = LEAF_ANGLE_DEVIATION.to_radians() * narrow(draw.normal().clamp(-2.0, 2.0));
        let angle = turn.angle + deviation;
        let side = Vec3::new(math::cos_f32(turn.azimuth), 0.0, math::sin_f32(turn.azimuth));
        // Midrib at `angle` to the wood; the blade's normal is as near to the vertical as the midrib allows.
        let dir = q * (Vec3::Y * math::cos_f32(angle) + side * math::sin_f32(angle));
        let dir = math::normalize_or(dir - Vec3::Y * BLADE_DROOP, dir);
        let up = math::normalize_or(Vec3::Y - dir * dir.y, math::perpendicular(dir));
        let size = 1.0 + LEAF_SIZE_DEVIATION * narrow(draw.normal().clamp(-2.0, 2.0));
        let roll = BLADE_ROLL_DEVIATION.to_radians() * narrow(draw.normal().clamp(-2.0, 2.0));
        let up = up * math::cos_f32(roll) + dir.cross(up) * math::sin_f32(roll);
        let q = Quat::from_mat3(&glam::Mat3::from_cols(dir.cross(up), dir, up)).normalize();
        let organ = self.foliage.organ();
        PlacedLeaf {
            q,
            scale: self.mean.scale * size,
            proto: pick_prototype(id, organ.meshes.len()),
            petiole: r + narrow(organ.petiole) * size,
            tint: draw.unit_f32(),
        }
    }

    fn add_blade(&self, plant: &mut Plant, place: LeafPlace) {
        let axis = &plant.axes[place.axis as usize];
        let s = place.s.clamp(0.0, axis.length);
        let site = plant.frame(axis, s);
        let leaf = self.blade(place.id, place.turn, site.q, site.r);
        plant.organs.push(Organ {
            id: place.id,
            axis: place.axis,
            s,
            offset: Vec3::ZERO,
            q: (site.q.inverse() * leaf.q).normalize(),
            scale: leaf.scale,
            proto: leaf.proto,
            petiole: leaf.petiole,
            tint: leaf.tint,
            birth: place.birth,
        });
    }

    /// Angles of piece `k` of `count` along an internode or at a tip: the first continues the shoot, the others diverge from it
    /// like twigs.
    pub fn needle_turn(tree: &Tree, i: usize, k: u32, count: u32) -> BladeTurn {
        let part = (k as f32 + 0.5) / count as f32;
        let angle = if k == 0 { 0.0 } else { math::lerp(NEEDLE_TWIGS[0], NEEDLE_TWIGS[1], part) };
        BladeTurn { azimuth: tree.nodes.azimuth[i] + k as f32 * GOLDEN_ANGLE_F32, angle: angle.to_radians() }
    }

    /// Distance from the end of an internode, towards its base, at which piece `k` of `count` begins, m: pieces extend beyond the
    /// end as far as they begin below the base. `length`: length of the internode, m.
    pub fn needles_behind(&self, k: u32, count: u32, length: f32) -> f32 {
        0.5 * narrow(self.foliage.organ().size) + length * (1.0 - (k as f32 + 0.5) / count as f32)
    }

    /// Distance from the tip, towards the base, at which piece `k` of `count` of its tuft begins, m.
    pub fn tuft_behind(&self, k: u32, count: u32) -> f32 {
        TUFT * narrow(self.foliage.organ().size) * (1.0 - (k as f32 + 0.5) / count as f32)
    }

    /// Adds the pieces of needles along an internode and, at an open tip, the tuft.
    fn add_needles(&self, plant: &mut Plant, tree: &Tree, i: usize, site: NodeSite, birth: f32) {
        let shown = tree.share_along(i);
        let along = if shown > 0.0 { self.count_along(tree, i, tree.nodes.length[i]) } else { 0 };
        for k in (0..along).filter(|k| is_among(Self::shoot_leaf_id(tree, i, *k), shown)) {
            let s = site.s - self.needles_behind(k, along, tree.nodes.length[i]);
            let turn = Self::needle_turn(tree, i, k, along);
            let id = Self::shoot_leaf_id(tree, i, k);
            self.add_needle_piece(plant, LeafPlace { axis: site.axis, s, turn, id, birth });
        }
        let axis = tree.nodes.axis[i];
        let at_tip = if tree.nodes.grows(i) { self.count_at_tip(tree, axis) } else { 0 };
        let shown = tree.share_at_tip(i);
        for k in (0..at_tip).filter(|k| is_among(Self::tip_leaf_id(tree, axis, *k), shown)) {
            let s = site.s - self.tuft_behind(k, at_tip);
            let turn = Self::needle_turn(tree, i, k, at_tip);
            let id = Self::tip_leaf_id(tree, axis, k);
            self.add_needle_piece(plant, LeafPlace { axis: site.axis, s, turn, id, birth });
        }
    }

    /// Places a piece of shoot with its needles at an angle to its wood, with a random roll, so that pieces do not repeat. `q`:
    /// frame of the wood.
    pub fn needle_piece(&self, id: u64, turn: BladeTurn, q: Quat) -> PlacedLeaf {
        let mut draw = Rng::from_key(id);
        let deviation = LEAF_ANGLE_DEVIATION.to_radians() * narrow(draw.normal().clamp(-2.0, 2.0));
        let roll = draw.unit_f32() * std::f32::consts::TAU;
        // Rotate about the wood first, then away from it; the roll about the piece itself comes last.
        let tilt = math::rotation_about(Vec3::Y, turn.azimuth) * math::rotation_about(Vec3::Z, turn.angle + deviation);
        let size = 1.0 + LEAF_SIZE_DEVIATION * narrow(draw.normal().clamp(-2.0, 2.0));
        PlacedLeaf {
            q: (q * tilt * math::rotation_about(Vec3::Y, roll)).normalize(),
            scale: self.mean.scale * size,
            proto: pick_prototype(id, self.foliage.organ().meshes.len()),
            petiole: 0.0,
            tint: draw.unit_f32(),
        }
    }

    fn add_needle_piece(&self, plant: &mut Plant, place: LeafPlace) {
        let axis = &plant.axes[place.axis as usize];
        // The organ's rotation is relative to its axis.
        let leaf = self.needle_piece(place.id, place.turn, Quat::IDENTITY);
        plant.organs.push(Organ {
            id: place.id,
            axis: place.axis,
            s: place.s.clamp(0.0, axis.length),
            offset: Vec3::ZERO,
            q: leaf.q,
            scale: leaf.scale,
            proto: leaf.proto,
            petiole: leaf.petiole,
            tint: leaf.tint,
            birth: place.birth,
        });
    }
}

/// Whether the leaf with this id is visible if a share of all leaves, 0 to 1, is visible. A visible leaf stays visible with every
/// larger share.
fn is_among(id: u64, share: f32) -> bool {
    share >= 1.0 || Rng::from_key(mix64(&[id, word("share")])).unit_f32() < share
}

/// Area of all triangles, m2: that of one side for a leaf modelled as a single sheet.
fn surface_area(mesh: &Mesh) -> f32 {
    let at = |i: u32| mesh.points[i as usize];
    mesh.triangles.iter().map(|[a, b, c]| 0.5 * (at(*b) - at(*a)).cross(at(*c) - at(*a)).length()).sum()
}
