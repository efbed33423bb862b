//! Collects segments and organs in the order of drawing and builds the plant in its canonical order.

use glam::{DVec3, Quat, Vec3};

use super::frame::{TurtlePose, narrow, narrow_quat};
use super::options::TurtleOptions;
use osier_base::math;
use osier_base::rng::{child, mix64, word};
use osier_scene::plant::{Axis, AxisEnd, AxisKind, NONE, Organ, Plant, Proto};

/// Nodes nearer to each other than this are merged, m. Shorter segments have no reliable direction in single precision.
const MIN_SEGMENT: f64 = 1e-6;
/// Thinnest radius, m; keeps rings of the loft from collapsing to points.
const MIN_RADIUS: f64 = 1e-6;
/// Length of the axis that carries the organs of a string without axes, m.
const STUB: f64 = 1e-3;

/// One node as drawn. The nodes of an axis form a linked list, because branches are drawn between them.
#[derive(Debug, Clone, Copy)]
pub(super) struct RawNode {
    pub p: DVec3,
    /// Left vector of the segment that ends here (that begins here, for the first).
    pub left: DVec3,
    /// Diameters of the segments that end and begin here, m.
    pub width_in: Option<f64>,
    pub width_out: Option<f64>,
    pub birth: u32,
    pub color: u16,
    /// Arc length on its axis, m.
    pub s: f64,
    next: u32,
}

/// An axis as drawn, before it has its place in the plant.
#[derive(Debug, Clone, Copy)]
struct RawAxis {
    /// Indices of the parent axis and of its node that carries this axis, or [`NONE`].
    parent: u32,
    parent_node: u32,
    /// Lineage of the module that opened the axis; orders siblings at one place.
    ordinal: u64,
    /// First and last node of its linked list.
    first: u32,
    last: u32,
    /// Number of nodes; an axis of one node has no segment yet.
    count: u32,
}

/// A node of an axis as drawn, by indices into the builder's lists.
#[derive(Debug, Clone, Copy)]
pub(super) struct NodeSite {
    pub axis: u32,
    pub node: u32,
}

/// Consecutive prototypes, one of which is picked per organ.
#[derive(Debug, Clone, Copy)]
pub(super) struct ProtoRange {
    pub first: u16,
    pub count: u16,
}

impl ProtoRange {
    /// The range of a prototype without variants.
    pub fn single(proto: u16) -> Self {
        Self { first: proto, count: 1 }
    }

    /// The prototype that a hash picks, by its remainder.
    #[allow(clippy::cast_possible_truncation, reason = "a remainder by a 16-bit number")]
    pub fn pick(self, hash: u64) -> u16 {
        self.first.saturating_add((hash % u64::from(self.count.max(1))) as u16)
    }
}

/// Size of a placed organ, and its distance from the wood.
#[derive(Debug, Clone, Copy)]
pub(super) struct OrganSize {
    /// Uniform scale of the prototype.
    pub scale: f64,
    /// Distance from the centreline to the pivot, m.
    pub petiole: f64,
}

/// An organ as drawn, in plant space.
#[derive(Debug, Clone, Copy)]
pub(super) struct RawOrgan {
    /// The node that carries it; `None`: the base of the first axis.
    pub site: Option<NodeSite>,
    pub pose: TurtlePose,
    pub size: OrganSize,
    pub protos: ProtoRange,
    pub lineage: u64,
    pub birth: u32,
}

/// Axes, nodes, organs and prototypes in the order of drawing.
#[derive(Debug, Default)]
pub(super) struct PlantBuilder {
    axes: Vec<RawAxis>,
    nodes: Vec<RawNode>,
    organs: Vec<RawOrgan>,
    pub protos: Vec<Proto>,
}

/// An index in 32 bits. The limits of nodes and organs are checked before anything is added, and lie far below.
#[allow(clippy::cast_possible_truncation, reason = "the limits keep counts below 2^32")]
fn index32(i: usize) -> u32 {
    debug_assert!(i < NONE as usize, "a count beyond its limit");
    i as u32
}

impl PlantBuilder {
    pub fn node_count(&self) -> u64 {
        self.nodes.len() as u64
    }

    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty() && self.organs.is_empty()
    }

    pub fn organ_count(&self) -> u64 {
        self.organs.len() as u64
    }

    /// Begins an axis with its first node; returns its index.
    pub fn begin_axis(&mut self, parent: Option<NodeSite>, ordinal: u64, node: RawNode) -> u32 {
        let i = index32(self.nodes.len());
        self.nodes.push(node);
        let NodeSite { axis: parent, node: parent_node } = parent.unwrap_or(NodeSite { axis: NONE, node: NONE });
        self.axes.push(RawAxis { parent, parent_node, ordinal, first: i, last: i, count: 1 });
        index32(self.axes.len() - 1)
    }

    /// A node that is not linked yet and has no widths.
    pub fn node(p: DVec3, left: DVec3, birth: u32, color: u16) -> RawNode {
        RawNode { p, left, width_in: None, width_out: None, birth, color, s: 0.0, next: NONE }
    }

    /// Index of the last node of an axis; [`NONE`] for an axis that is not there.
    pub fn last_node(&self, axis: u32) -> u32 {
        self.axes.get(axis as usize).map_or(NONE, |a| a.last)
    }

    /// A node by its index; `None` for [`NONE`].
    pub fn node_mut(&mut self, node: u32) -> Option<&mut RawNode> {
        self.nodes.get_mut(node as usize)
    }

    /// Adds a node at the end of an axis, unless it lies within [`MIN_SEGMENT`] of the last one.
    pub fn extend(&mut self, axis: u32, mut node: RawNode) {
        let i = index32(self.nodes.len());
        let Some(a) = self.axes.get_mut(axis as usize) else { return };
        let Some(last) = self.nodes.get_mut(a.last as usize) else { return };
        // Coincident nodes are dropped: the segment between them would have no direction.
        let length = (node.p - last.p).length();
        if length < MIN_SEGMENT {
            return;
        }
        node.s = last.s + length;
        last.next = i;
        (a.last, a.count) = (i, a.count + 1);
        self.nodes.push(node);
    }

    /// Records an organ; [`finish`](Self::finish) determines its axis and arc length.
    pub fn add_organ(&mut self, organ: RawOrgan) {
        self.organs.push(organ);
    }

    /// Builds the plant: axes depth first, organs by axis and arc length. `steps`: derivation steps, which become growth time
    /// 0..1.
    pub fn finish(mut self, plant_id: u32, seed: u64, steps: u32, options: &TurtleOptions) -> Plant {
        // A string that draws organs but no segment still needs an axis to carry them.
        self.add_stub_axis();
        self.reattach_children_of_single_nodes();
        let order = self.canonical_order();
        let mut plant = Plant {
            id: plant_id,
            seed,
            materials: options.materials.clone(),
            source: options.source.clone(),
            ..Plant::default()
        };
        let growth = GrowthClock { last: f64::from(steps.max(1)) };
        // Index in the plant of each axis as drawn.
        let mut plant_axis = vec![NONE; self.axes.len()];
        let mut roots = 0_u64;
        for &raw in &order {
            plant_axis[raw] = index32(plant.axes.len());
            self.add_axis(&mut plant, &self.axes[raw], &plant_axis, &mut roots, growth);
        }
        // Organs last: their frames come from the nodes that are now in place.
        self.add_organs(&mut plant, &plant_axis, growth);
        plant.protos = self.protos;
        plant
    }

    /// Adds a short axis if the string places organs but draws no segment, since organs need an axis.
    fn add_stub_axis(&mut self) {
        // The stub points along the first organ, so that its frame is that of the organ.
        let has_axis = self.axes.iter().any(|a| a.count > 1);
        let Some(first) = self.organs.first().copied().filter(|_| !has_axis) else { return };
        let h = first.pose.q * DVec3::Y;
        let node = Self::node(first.pose.p, first.pose.q * DVec3::NEG_X, first.birth, 0);
        let axis = self.begin_axis(None, first.lineage, RawNode { width_out: Some(STUB), ..node });
        self.extend(axis, RawNode { p: first.pose.p + h * STUB, width_in: Some(STUB), ..node });
    }

    /// Attaches the branches of axes of one node, which are left out, to the node that carries such an axis, at the same
    /// position; branches of a root of one node become roots.
    fn reattach_children_of_single_nodes(&mut self) {
        // A parent precedes its children, so that its own attachment is final when a child reads it.
        for i in 0..self.axes.len() {
            let parent = self.axes.get(self.axes[i].parent as usize).copied();
            if let Some(parent) = parent.filter(|parent| parent.count == 1) {
                (self.axes[i].parent, self.axes[i].parent_node) = (parent.parent, parent.parent_node);
            }
        }
    }

    /// Indices of the axes depth first, siblings by arc length on the parent, then ordinal, without axes of one node.
    fn canonical_order(&self) -> Vec<usize> {
        let s = |a: &RawAxis| self.nodes.get(a.parent_node as usize).map_or(0.0, |n| n.s);
        let is_child = |i: &usize| self.axes[*i].parent != NONE && self.axes[*i].count > 1;
        // A counting sort by parent: `children[first[p]..first[p + 1]]` are the children of axis p.
        let mut first = vec![0_usize; self.axes.len() + 1];
        for c in (0..self.axes.len()).filter(is_child) {
            first[self.axes[c].parent as usize + 1] += 1;
        }
        for i in 1..first.len() {
            first[i] += first[i - 1];
        }
        let mut children = vec![0_usize; first.last().copied().unwrap_or(0)];
        let mut next = first.clone();
        for c in (0..self.axes.len()).filter(is_child) {
            let slot = &mut next[self.axes[c].parent as usize];
            children[*slot] = c;
            *slot += 1;
        }
        // Order the children of each axis by their place on it; equal places by lineage, which does not depend on
        // threads.
        for family in first.windows(2) {
            children[family[0]..family[1]].sort_unstable_by(|&x, &y| {
                let (a, b) = (&self.axes[x], &self.axes[y]);
                s(a).total_cmp(&s(b)).then(a.ordinal.cmp(&b.ordinal)).then(x.cmp(&y))
            });
        }
        // Depth-first traversal with an explicit stack: plants may be deeper than the call stack.
        let is_root = |i: &usize| self.axes[*i].parent == NONE && self.axes[*i].count > 1;
        let mut stack: Vec<usize> = (0..self.axes.len()).filter(is_root).rev().collect();
        let mut order = Vec::with_capacity(self.axes.len());
        while let Some(i) = stack.pop() {
            order.push(i);
            stack.extend(children[first[i]..first[i + 1]].iter().rev());
        }
        order
    }

    /// Appends an axis and its nodes to the plant. `roots`: number of root axes so far, which gives roots their ids.
    fn add_axis(&self, plant: &mut Plant, a: &RawAxis, plant_axis: &[u32], roots: &mut u64, growth: GrowthClock) {
        let parent = plant_axis.get(a.parent as usize).copied().unwrap_or(NONE);
        let (id, order, parent_s) = match plant.axes.get(parent as usize) {
            Some(p) => {
                // Ids hash the path from the root, so that a new branch elsewhere changes none.
                let s = self.nodes.get(a.parent_node as usize).map_or(0.0, |n| n.s);
                let id = mix64(&[p.id, word("axis"), a.ordinal]);
                (id, p.order.saturating_add(1), math::narrow(s).clamp(0.0, p.length))
            }
            None => {
                *roots += 1;
                (mix64(&[u64::from(plant.id), *roots - 1]), 0, 0.0)
            }
        };
        let first = plant.nodes.len();
        self.add_nodes(plant, a, growth);
        let last = plant.nodes.len() - 1;
        plant.axes.push(Axis {
            id,
            parent,
            parent_s,
            order,
            kind: AxisKind::Stem,
            first: index32(first),
            count: index32(last + 1 - first),
            length: plant.nodes.s[last],
            s_exposed: 0.0,
            material: 0,
            fork: NONE,
            end: AxisEnd::Tip,
            birth: plant.nodes.birth[first],
        });
    }

    /// Appends the nodes of an axis: tangents are the mean directions of both segments, radii the mean of both widths.
    fn add_nodes(&self, plant: &mut Plant, a: &RawAxis, growth: GrowthClock) {
        let mut i = a.first;
        let mut incoming: Option<DVec3> = None;
        let mut previous = None;
        while let Some(n) = self.nodes.get(i as usize) {
            let outgoing = self.nodes.get(n.next as usize).and_then(|m| (m.p - n.p).try_normalize());
            // Tangent at a node: the bisector of its two segments; at the ends the direction of the only one.
            let tangent = match (incoming, outgoing) {
                (Some(c), Some(g)) => (c + g).try_normalize().unwrap_or(c),
                (Some(c), None) => c,
                (None, g) => g.unwrap_or(DVec3::Y),
            };
            let p = narrow(n.p);
            // Arc lengths are those of the stored, rounded positions.
            let s = match previous {
                Some(q) => plant.nodes.s.last().copied().unwrap_or(0.0) + p.distance(q),
                None => 0.0,
            };
            // A node between two segments of different widths gets their mean.
            let width = match (n.width_in, n.width_out) {
                (Some(x), Some(y)) => 0.5 * (x + y),
                (Some(x), None) | (None, Some(x)) => x,
                (None, None) => 0.0,
            };
            plant.nodes.p.push(p);
            plant.nodes.q.push(node_frame(tangent, n.left));
            plant.nodes.r.push(math::narrow((width * 0.5).max(MIN_RADIUS)));
            plant.nodes.s.push(s);
            plant.nodes.birth.push(growth.time(n.birth));
            plant.nodes.color.push(n.color);
            (incoming, previous, i) = (outgoing, Some(p), n.next);
        }
    }

    /// Appends the organs in their canonical order, relative to the frame of their axis and with the prototype that their id
    /// picks.
    fn add_organs(&self, plant: &mut Plant, plant_axis: &[u32], growth: GrowthClock) {
        let mut placed: Vec<(u32, f32, usize)> = Vec::with_capacity(self.organs.len());
        for (i, o) in self.organs.iter().enumerate() {
            // An axis of one node is not in the plant: its organs belong to the node that carries it.
            let mut site = o.site;
            while let Some(NodeSite { axis, .. }) = site
                && plant_axis.get(axis as usize).is_none_or(|p| *p == NONE)
            {
                let raw = self.axes.get(axis as usize).filter(|raw| raw.parent != NONE);
                site = raw.map(|raw| NodeSite { axis: raw.parent, node: raw.parent_node });
            }
            let axis = site.map_or(0, |site| plant_axis[site.axis as usize]);
            let Some(on) = plant.axes.get(axis as usize) else { continue };
            let s = site.and_then(|site| self.nodes.get(site.node as usize)).map_or(0.0, |n| n.s);
            placed.push((axis, math::narrow(s).clamp(0.0, on.length), i));
        }
        // Canonical order: axis, arc length, lineage. The index in the order of drawing breaks the remaining ties.
        placed.sort_unstable_by(|a, b| {
            let ordinal = |k: usize| self.organs[k].lineage;
            a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(ordinal(a.2).cmp(&ordinal(b.2))).then(a.2.cmp(&b.2))
        });
        plant.organs.reserve(placed.len());
        for (axis, s, i) in placed {
            let o = &self.organs[i];
            let on = &plant.axes[axis as usize];
            let site = plant.frame(on, s);
            let id = mix64(&[on.id, word("organ"), o.lineage]);
            // Organs are stored relative to the frame of their axis, so that they follow when the axis moves.
            let back = site.q.inverse();
            let organ = Organ {
                id,
                axis,
                s,
                offset: back * (narrow(o.pose.p) - site.p),
                q: (back * narrow_quat(o.pose.q)).normalize(),
                scale: math::narrow(o.size.scale),
                proto: o.protos.pick(child(id, word("proto"))),
                petiole: math::narrow(o.size.petiole),
                tint: osier_base::rng::Rng::from_key(child(id, word("tint"))).unit_f32(),
                birth: growth.time(o.birth),
            };
            plant.organs.push(organ);
        }
    }
}

/// Converts derivation steps to growth time, 0 at the axiom to 1 at the last step.
#[derive(Debug, Clone, Copy)]
struct GrowthClock {
    /// Number of derivation steps, at least 1.
    last: f64,
}

impl GrowthClock {
    fn time(self, birth: u32) -> f32 {
        math::narrow((f64::from(birth) / self.last).clamp(0.0, 1.0))
    }
}

/// Frame of a node: Y along the tangent, X as near to the turtle's right as that allows.
fn node_frame(tangent: DVec3, left: DVec3) -> Quat {
    let mut frame = super::frame::TurtleFrame { h: tangent, l: left, u: DVec3::ZERO };
    frame.orthonormalize();
    narrow_quat(frame.quat())
}

/// Sets `s_exposed` of each axis: the arc length at which it leaves its parent's surface, where the distance between both
/// centrelines exceeds the parent's radius. `Own:` the parent is taken as a cylinder about its tangent at the site.
pub(in crate::grow) fn set_exposed_lengths(plant: &mut Plant) {
    for i in 0..plant.axes.len() {
        let axis = &plant.axes[i];
        let Some(parent) = plant.axes.get(axis.parent as usize) else { continue };
        let site = plant.frame(parent, axis.parent_s);
        let t = site.q * Vec3::Y;
        // Distance of a point from the parent's surface: from the line through the site along the parent's tangent,
        // less the parent's radius.
        let away = |p: Vec3| {
            let d = p - site.p;
            (d - t * d.dot(t)).length() - site.r
        };
        let range = plant.nodes_of(axis);
        let mut exposed = axis.length;
        // Find the first segment that ends outside and interpolate linearly where its distance is zero.
        for k in range.start + 1..range.end {
            let (a, b) = (away(plant.nodes.p[k - 1]), away(plant.nodes.p[k]));
            if b >= 0.0 {
                let part = if a < 0.0 { a / (a - b) } else { 0.0 };
                exposed = math::lerp(plant.nodes.s[k - 1], plant.nodes.s[k], part);
                break;
            }
        }
        plant.axes[i].s_exposed = exposed;
    }
}
