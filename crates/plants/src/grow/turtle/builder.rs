//! Collects segments and organs in the order of drawing and builds the plant in its canonical order.

use glam::{DVec3, Quat, Vec3};
use pulp::{Arch, Simd, WithSimd};

use super::frame::{TurtleFrame, TurtlePose, narrow, narrow_quat};
use super::options::TurtleOptions;
use osier_base::math;
use osier_base::rng::{child, mix64, word};
use osier_base::simd::{F32Lanes, F64Lanes, Lane as _};
use osier_scene::plant::{Axis, AxisEnd, AxisKind, NONE, Nodes, Organ, Plant, Proto};

/// Nodes nearer to each other than this are merged, m. Shorter segments have no reliable direction in single precision.
const MIN_SEGMENT: f64 = 1e-6;
/// Thinnest radius, m; keeps rings of the loft from collapsing to points.
const MIN_RADIUS: f64 = 1e-6;
/// Length of the axis that carries the organs of a string without axes, m.
const STUB: f64 = 1e-3;

/// A node as the turtle draws it.
#[derive(Debug, Clone, Copy)]
pub(super) struct DrawnNode {
    pub p: DVec3,
    /// Left vector of the segment that ends here (that begins here, for the first).
    pub left: DVec3,
    pub birth: u32,
    pub color: u16,
    /// Number of the traced step that ends here (that begins here, for the first node); [`NONE`] without a trace.
    pub step: u32,
}

/// The last node of an axis. The next segment, or the width at its end, may still change it.
#[derive(Debug, Clone, Copy)]
struct OpenNode {
    drawn: DrawnNode,
    /// Direction of the segment that ends here; `None` for the first node.
    incoming: Option<DVec3>,
    /// Diameters of the segments that end and begin here, m.
    width_in: Option<f64>,
    width_out: Option<f64>,
    /// Arc length on its axis, m.
    s: f64,
    /// Position and arc length as the plant stores them.
    stored_p: Vec3,
    stored_s: f32,
}

/// A node as the plant stores it. The nodes of an axis form a linked list, because branches are drawn between them.
#[derive(Debug, Clone, Copy)]
struct StoredNode {
    p: Vec3,
    q: Quat,
    r: f32,
    s: f32,
    birth: u32,
    next: u32,
    color: u16,
}

/// An axis as drawn, before it has its place in the plant.
#[derive(Debug, Clone, Copy)]
struct RawAxis {
    /// Arc length on the parent's axis of the node that carries this axis, m.
    parent_s: f64,
    /// Lineage of the module that opened the axis; orders siblings at one place.
    ordinal: u64,
    /// Index of the parent axis, or [`NONE`].
    parent: u32,
    /// First and last node of its linked list, or [`NONE`].
    first: u32,
    last: u32,
    /// Number of nodes, including the open one; an axis of one node has no segment yet.
    count: u32,
    /// Index of its last node among the open ones; [`NONE`] once the axis is closed.
    open: u32,
}

/// A node that carries an axis or an organ: its axis as drawn, and its arc length there, m.
#[derive(Debug, Clone, Copy)]
pub(super) struct NodeSite {
    pub axis: u32,
    pub s: f64,
}

/// Nodes that no later command changes; the frames of the last ones are still to be computed.
#[derive(Debug, Default)]
struct StoredNodes {
    list: Vec<StoredNode>,
    frames: FrameBatch,
    /// For each node of `list` the number of its traced step; `None` without a trace.
    steps: Option<Vec<u32>>,
}

impl StoredNodes {
    /// Appends a node to the list of its axis; its radius follows from the mean of both widths. `outgoing`: direction
    /// of the segment that begins at the node.
    #[inline]
    fn add(&mut self, axis: &mut RawAxis, n: &OpenNode, outgoing: Option<DVec3>) {
        // A node between two segments of different widths gets their mean.
        let width = match (n.width_in, n.width_out) {
            (Some(x), Some(y)) => 0.5 * (x + y),
            (Some(x), None) | (None, Some(x)) => x,
            (None, None) => 0.0,
        };
        let i = index32(self.list.len());
        if let Some(steps) = &mut self.steps {
            steps.push(n.drawn.step);
        }
        self.list.push(StoredNode {
            p: n.stored_p,
            q: Quat::IDENTITY,
            r: math::narrow((width * 0.5).max(MIN_RADIUS)),
            s: n.stored_s,
            birth: n.drawn.birth,
            next: NONE,
            color: n.drawn.color,
        });
        match self.list.get_mut(axis.last as usize) {
            Some(last) => last.next = i,
            None => axis.first = i,
        }
        axis.last = i;
        if self.frames.push(i, FrameSource { incoming: n.incoming, outgoing, left: n.drawn.left }) {
            self.finish();
        }
    }

    /// Computes the frames of the nodes that wait for them.
    fn finish(&mut self) {
        self.frames.finish(&mut self.list);
    }
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

/// What the nodes and organs of a finished plant were drawn as.
#[derive(Debug, Default)]
pub(super) struct PlantSources {
    /// For each node of the plant the number of the traced step that ends there; that of the step that begins there for the first node
    /// of an axis.
    pub steps: Vec<u32>,
    /// For each organ of the plant its number in the order of drawing.
    pub organs: Vec<u32>,
}

/// Axes, nodes, organs and prototypes in the order of drawing.
#[derive(Debug, Default)]
pub(super) struct PlantBuilder {
    axes: Vec<RawAxis>,
    stored: StoredNodes,
    /// Last nodes of axes that are not closed, and the indices of entries that can be reused.
    open: Vec<OpenNode>,
    free: Vec<u32>,
    /// Number of nodes of all axes.
    count: u64,
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
    /// A builder with memory reserved for a string of `count` modules; lists that need more grow.
    pub fn for_modules(count: u64) -> Self {
        /// Most nodes for which memory is reserved at first; the system provides it only when it is used.
        const MOST_NODES: usize = 1 << 21;
        let mut out = Self::default();
        let nodes = usize::try_from(count).map_or(MOST_NODES, |count| count.min(MOST_NODES));
        // If memory cannot be reserved, the lists grow as needed.
        if out.stored.list.try_reserve(nodes).is_ok() && out.axes.try_reserve(nodes / 4).is_ok() {
            out
        } else {
            Self::default()
        }
    }

    /// Makes [`finish`](Self::finish) return the sources of nodes and organs.
    pub fn keep_sources(&mut self) {
        self.stored.steps = Some(Vec::new());
    }

    pub fn node_count(&self) -> u64 {
        self.count
    }

    pub fn is_empty(&self) -> bool {
        self.count == 0 && self.organs.is_empty()
    }

    pub fn organ_count(&self) -> u64 {
        self.organs.len() as u64
    }

    /// Begins an axis with its first node; returns its index.
    pub fn begin_axis(&mut self, parent: Option<NodeSite>, ordinal: u64, node: DrawnNode) -> u32 {
        let first = OpenNode {
            drawn: node,
            incoming: None,
            width_in: None,
            width_out: None,
            s: 0.0,
            stored_p: narrow(node.p),
            stored_s: 0.0,
        };
        let open = match self.free.pop() {
            Some(open) => {
                self.open[open as usize] = first;
                open
            }
            None => {
                self.open.push(first);
                index32(self.open.len() - 1)
            }
        };
        self.count += 1;
        let NodeSite { axis: parent, s: parent_s } = parent.unwrap_or(NodeSite { axis: NONE, s: 0.0 });
        self.axes.push(RawAxis { parent, parent_s, ordinal, first: NONE, last: NONE, count: 1, open });
        index32(self.axes.len() - 1)
    }

    /// The last node of an axis; `None` for an axis that is closed or does not exist.
    fn open_node(&mut self, axis: u32) -> Option<&mut OpenNode> {
        let axis = self.axes.get(axis as usize)?;
        self.open.get_mut(axis.open as usize)
    }

    /// The last node of an axis, to which branches and organs drawn there are attached.
    pub fn site(&self, axis: u32) -> NodeSite {
        let open = self.axes.get(axis as usize).and_then(|a| self.open.get(a.open as usize));
        NodeSite { axis, s: open.map_or(0.0, |n| n.s) }
    }

    /// Sets the width at the end of the last segment of an axis, m.
    pub fn set_end_width(&mut self, axis: u32, width: f64) {
        if let Some(n) = self.open_node(axis) {
            n.width_in = Some(width);
        }
    }

    /// Adds a segment of a width, m, at the end of an axis, unless it is shorter than [`MIN_SEGMENT`]; returns whether it was
    /// added.
    pub fn extend(&mut self, axis: u32, node: DrawnNode, width: f64) -> bool {
        let Some(axis) = self.axes.get_mut(axis as usize) else { return false };
        let Some(open) = self.open.get_mut(axis.open as usize) else { return false };
        // Both segments at a node keep their own width there; the node gets the mean.
        open.width_out = Some(width);
        // Coincident nodes are dropped: the segment between them would have no direction.
        let step = node.p - open.drawn.p;
        let length = step.length();
        if length < MIN_SEGMENT {
            return false;
        }
        let direction = step.try_normalize();
        self.stored.add(axis, open, direction);
        axis.count += 1;
        self.count += 1;
        let stored_p = narrow(node.p);
        // Arc lengths are those of the stored, rounded positions.
        open.stored_s += stored_p.distance(open.stored_p);
        open.stored_p = stored_p;
        open.s += length;
        (open.drawn, open.incoming) = (node, direction);
        (open.width_in, open.width_out) = (Some(width), None);
        true
    }

    /// Ends an axis, to which no segment is added any more.
    pub fn close_axis(&mut self, axis: u32) {
        let Some(a) = self.axes.get_mut(axis as usize) else { return };
        let open = std::mem::replace(&mut a.open, NONE);
        let Some(last) = self.open.get(open as usize) else { return };
        self.free.push(open);
        // An axis of one node is left out of the plant.
        if a.count > 1 {
            self.stored.add(a, last, None);
        }
    }

    /// Records an organ; [`finish`](Self::finish) determines its axis and arc length.
    pub fn add_organ(&mut self, organ: RawOrgan) {
        self.organs.push(organ);
    }

    /// Builds the plant: axes depth first, organs by axis and arc length. `steps`: derivation steps, which become growth time
    /// 0..1. The sources of nodes and organs are empty unless [`keep_sources`](Self::keep_sources) was called.
    pub fn finish(mut self, plant_id: u32, seed: u64, steps: u32, options: &TurtleOptions) -> (Plant, PlantSources) {
        // A string that draws organs but no segment still needs an axis to carry them.
        self.add_stub_axis();
        for axis in 0..index32(self.axes.len()) {
            self.close_axis(axis);
        }
        self.stored.finish();
        self.reattach_children_of_single_nodes();
        let order = self.canonical_order();
        let mut plant = Plant {
            id: plant_id,
            seed,
            nodes: zeroed_nodes(self.stored.list.len()),
            axes: Vec::with_capacity(order.len()),
            materials: options.materials.clone(),
            source: options.source.clone(),
            ..Plant::default()
        };
        let mut growth = GrowthClock::new(steps);
        let mut sources = PlantSources::default();
        // Index in the plant of each axis as drawn.
        let mut plant_axis = vec![NONE; self.axes.len()];
        let mut roots = 0_u64;
        let mut filled = 0;
        for &raw in &order {
            let raw = raw as usize;
            plant_axis[raw] = index32(plant.axes.len());
            let first = filled;
            filled = self.fill_nodes(&mut plant.nodes, first, &self.axes[raw], &mut growth);
            if let Some(steps) = &self.stored.steps {
                sources.steps.extend(self.steps_of(&self.axes[raw], steps));
            }
            add_axis(&mut plant, &self.axes[raw], first..filled, &plant_axis, &mut roots);
        }
        // Organs last: their frames come from the nodes that are now in place.
        let drawn = self.add_organs(&mut plant, &plant_axis, growth);
        if self.stored.steps.is_some() {
            sources.organs = drawn;
        }
        plant.protos = self.protos;
        (plant, sources)
    }

    /// The numbers in `steps` of the nodes of an axis, from its base on.
    fn steps_of<'a>(&'a self, axis: &RawAxis, steps: &'a [u32]) -> impl Iterator<Item = u32> + 'a {
        let next = |i: &u32| self.stored.list.get(*i as usize).map(|node| node.next);
        let nodes = std::iter::successors(Some(axis.first), next).filter(|i| *i != NONE);
        nodes.map(|i| steps.get(i as usize).copied().unwrap_or(NONE))
    }

    /// Adds a short axis if the string places organs but draws no segment, since organs need an axis.
    fn add_stub_axis(&mut self) {
        // The stub points along the first organ, so that its frame is that of the organ.
        let has_axis = self.axes.iter().any(|a| a.count > 1);
        let Some(first) = self.organs.first().copied().filter(|_| !has_axis) else { return };
        let h = first.pose.q * DVec3::Y;
        let left = first.pose.q * DVec3::NEG_X;
        let node = DrawnNode { p: first.pose.p, left, birth: first.birth, color: 0, step: NONE };
        let axis = self.begin_axis(None, first.lineage, node);
        self.extend(axis, DrawnNode { p: first.pose.p + h * STUB, ..node }, STUB);
    }

    /// Axes of one node are left out of the plant. Attaches their branches to the node that carries such an axis, which
    /// has the same position; branches of a root of one node become roots.
    fn reattach_children_of_single_nodes(&mut self) {
        // A parent precedes its children, so that its own attachment is final when a child reads it.
        for i in 0..self.axes.len() {
            let parent = self.axes.get(self.axes[i].parent as usize).copied();
            if let Some(parent) = parent.filter(|parent| parent.count == 1) {
                (self.axes[i].parent, self.axes[i].parent_s) = (parent.parent, parent.parent_s);
            }
        }
    }

    /// Indices of the axes depth first, siblings by arc length on the parent, then ordinal, without axes of one node.
    fn canonical_order(&self) -> Vec<u32> {
        let is_child = |a: &&(u32, &RawAxis)| a.1.parent != NONE && a.1.count > 1;
        let axes = || (0_u32..).zip(&self.axes);
        // A counting sort by parent: `ends` counts the children of each axis, then holds where they begin, and finally
        // where they end.
        let mut ends = vec![0_u32; self.axes.len()];
        for (_, a) in axes().filter(|a| is_child(&a)) {
            ends[a.parent as usize] += 1;
        }
        let mut sum = 0;
        for end in &mut ends {
            sum += std::mem::replace(end, sum);
        }
        let mut children = vec![0_u32; sum as usize];
        for (c, a) in axes().filter(|a| is_child(&a)) {
            let slot = &mut ends[a.parent as usize];
            children[*slot as usize] = c;
            *slot += 1;
        }
        // Order the children of each axis by their place on it; equal places by lineage, which does not depend on
        // threads.
        let mut first = 0;
        for &end in &ends {
            children[first as usize..end as usize].sort_unstable_by(|&x, &y| {
                let (a, b) = (&self.axes[x as usize], &self.axes[y as usize]);
                a.parent_s.total_cmp(&b.parent_s).then(a.ordinal.cmp(&b.ordinal)).then(x.cmp(&y))
            });
            first = end;
        }
        // Depth-first traversal with an explicit stack: plants may be deeper than the call stack.
        let is_root = |a: &(u32, &RawAxis)| a.1.parent == NONE && a.1.count > 1;
        let mut stack: Vec<u32> = axes().filter(is_root).map(|a| a.0).collect();
        stack.reverse();
        let mut order = Vec::with_capacity(self.axes.len());
        while let Some(i) = stack.pop() {
            order.push(i);
            let first = i.checked_sub(1).map_or(0, |before| ends[before as usize]);
            stack.extend(children[first as usize..ends[i as usize] as usize].iter().rev());
        }
        order
    }

    /// Copies the nodes of an axis into those of the plant, from index `first` on; returns the index after them.
    fn fill_nodes(&self, nodes: &mut Nodes, first: usize, a: &RawAxis, growth: &mut GrowthClock) -> usize {
        let n = nodes.p.len();
        // For slices of equal length one bounds check per index is enough.
        let (p, q) = (&mut nodes.p[..n], &mut nodes.q[..n]);
        let (r, s) = (&mut nodes.r[..n], &mut nodes.s[..n]);
        let (birth, color) = (&mut nodes.birth[..n], &mut nodes.color[..n]);
        let (mut i, mut k) = (a.first, first);
        while let Some(node) = self.stored.list.get(i as usize) {
            (p[k], q[k]) = (node.p, node.q);
            (r[k], s[k]) = (node.r, node.s);
            (birth[k], color[k]) = (growth.time(node.birth), node.color);
            (i, k) = (node.next, k + 1);
        }
        k
    }

    /// Appends the organs in their canonical order, relative to the frame of their axis and with the prototype that their id
    /// picks. Returns the numbers of the organs in the order of drawing.
    fn add_organs(&self, plant: &mut Plant, plant_axis: &[u32], mut growth: GrowthClock) -> Vec<u32> {
        let mut placed: Vec<(u32, f32, usize)> = Vec::with_capacity(self.organs.len());
        for (i, o) in self.organs.iter().enumerate() {
            // An axis of one node is not in the plant: its organs belong to the node that carries it.
            let mut site = o.site;
            while let Some(NodeSite { axis, .. }) = site
                && plant_axis.get(axis as usize).is_none_or(|p| *p == NONE)
            {
                let raw = self.axes.get(axis as usize).filter(|raw| raw.parent != NONE);
                site = raw.map(|raw| NodeSite { axis: raw.parent, s: raw.parent_s });
            }
            let axis = site.map_or(0, |site| plant_axis[site.axis as usize]);
            let Some(on) = plant.axes.get(axis as usize) else { continue };
            let s = site.map_or(0.0, |site| site.s);
            placed.push((axis, math::narrow(s).clamp(0.0, on.length), i));
        }
        // Canonical order: axis, arc length, lineage. The index in the order of drawing breaks the remaining ties.
        placed.sort_unstable_by(|a, b| {
            let ordinal = |k: usize| self.organs[k].lineage;
            a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(ordinal(a.2).cmp(&ordinal(b.2))).then(a.2.cmp(&b.2))
        });
        plant.organs.reserve(placed.len());
        let mut drawn = Vec::with_capacity(placed.len());
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
            drawn.push(index32(i));
        }
        drawn
    }
}

/// Columns of `n` nodes, to be filled. They are zeroed by the system, so that memory is first touched when it is
/// filled.
fn zeroed_nodes(n: usize) -> Nodes {
    Nodes {
        p: bytemuck::zeroed_vec(n),
        q: bytemuck::zeroed_vec(n),
        r: vec![0.0; n],
        s: vec![0.0; n],
        birth: vec![0.0; n],
        color: vec![0; n],
    }
}

/// Appends an axis to the plant, whose nodes `range` are in place. `roots`: number of root axes so far, which gives roots their
/// ids.
fn add_axis(plant: &mut Plant, a: &RawAxis, range: std::ops::Range<usize>, plant_axis: &[u32], roots: &mut u64) {
    const AXIS: u64 = word("axis");
    let parent = plant_axis.get(a.parent as usize).copied().unwrap_or(NONE);
    let (id, order, parent_s) = match plant.axes.get(parent as usize) {
        Some(p) => {
            // Ids hash the path from the root, so that a new branch elsewhere changes none.
            let id = mix64(&[p.id, AXIS, a.ordinal]);
            (id, p.order.saturating_add(1), math::narrow(a.parent_s).clamp(0.0, p.length))
        }
        None => {
            *roots += 1;
            (mix64(&[u64::from(plant.id), *roots - 1]), 0, 0.0)
        }
    };
    plant.axes.push(Axis {
        id,
        parent,
        parent_s,
        order,
        kind: AxisKind::Stem,
        first: index32(range.start),
        count: index32(range.len()),
        length: plant.nodes.s[range.end - 1],
        s_exposed: 0.0,
        material: 0,
        fork: NONE,
        end: AxisEnd::Tip,
        birth: plant.nodes.birth[range.start],
    });
}

/// Converts derivation steps to growth time, 0 at the axiom to 1 at the last step.
#[derive(Debug, Clone, Copy)]
struct GrowthClock {
    /// Number of derivation steps, at least 1.
    steps: f64,
    /// The step converted last, and its time.
    last: (u32, f32),
}

impl GrowthClock {
    fn new(steps: u32) -> Self {
        Self { steps: f64::from(steps.max(1)), last: (0, 0.0) }
    }

    fn time(&mut self, birth: u32) -> f32 {
        if birth != self.last.0 {
            self.last = (birth, math::narrow((f64::from(birth) / self.steps).clamp(0.0, 1.0)));
        }
        self.last.1
    }
}

/// Data from which the frame of a node is computed.
#[derive(Debug, Clone, Copy)]
pub(super) struct FrameSource {
    /// Directions of the segments that end and begin at the node.
    pub incoming: Option<DVec3>,
    pub outgoing: Option<DVec3>,
    /// Left vector of the turtle.
    pub left: DVec3,
}

impl FrameSource {
    /// The frame: Y along the tangent, X as near to the turtle's right as that allows.
    pub fn frame(self) -> Quat {
        // Tangent at a node: the bisector of its two segments; at the ends the direction of the only one.
        let tangent = match (self.incoming, self.outgoing) {
            (Some(c), Some(g)) => (c + g).try_normalize().unwrap_or(c),
            (Some(c), None) => c,
            (None, g) => g.unwrap_or(DVec3::Y),
        };
        let mut frame = TurtleFrame { h: tangent, l: self.left, u: DVec3::ZERO };
        frame.orthonormalize();
        narrow_quat(frame.quat())
    }
}

/// Nodes whose frames are computed together.
const BATCH: usize = 32;

/// Nodes that wait for their frames.
#[derive(Debug, Default)]
struct FrameBatch {
    /// Indices of the nodes, of which the first `count` are in use.
    nodes: [u32; BATCH],
    count: usize,
    /// Direction of the segment that ends at the node (x, y, z), direction of the segment that begins there, left
    /// vector (x, y, z), and 1 for a node between two segments. At the ends of an axis the only direction is stored
    /// first.
    rows: [[f64; BATCH]; 10],
    /// Frames (x, y, z, w) in double precision, and the product of the reciprocals of the lengths by which vectors were divided.
    frames: [[f64; BATCH]; 5],
    /// Frames in single precision, normalized again.
    stored: [[f32; BATCH]; 4],
}

impl FrameBatch {
    /// Adds a node; returns whether the batch is full.
    fn push(&mut self, node: u32, source: FrameSource) -> bool {
        let k = self.count;
        self.nodes[k] = node;
        let (c, g, between) = match (source.incoming, source.outgoing) {
            (Some(c), Some(g)) => (c, g, 1.0),
            (Some(c), None) | (None, Some(c)) => (c, DVec3::ZERO, 0.0),
            (None, None) => (DVec3::Y, DVec3::ZERO, 0.0),
        };
        let l = source.left;
        let values = [c.x, c.y, c.z, g.x, g.y, g.z, l.x, l.y, l.z, between];
        for (row, value) in self.rows.iter_mut().zip(values) {
            row[k] = value;
        }
        self.count += 1;
        self.count == BATCH
    }

    /// Computes the frames of the nodes that wait.
    fn finish(&mut self, nodes: &mut [StoredNode]) {
        Arch::new().dispatch(&mut *self);
        for k in 0..self.count {
            // Where a length is 0 or NaN, `FrameSource::frame` uses another direction instead of the vector. Its result is the same
            // where only the product leaves the range of numbers.
            let product = self.frames[4][k];
            let is_usual = product.is_finite() && product > 0.0;
            let stored = || Quat::from_array(self.stored.each_ref().map(|row| row[k]));
            let q = if is_usual { stored() } else { self.source(k).frame() };
            if let Some(node) = nodes.get_mut(self.nodes[k] as usize) {
                node.q = q;
            }
        }
        self.count = 0;
    }

    fn source(&self, k: usize) -> FrameSource {
        let vector = |i: usize| DVec3::new(self.rows[i][k], self.rows[i + 1][k], self.rows[i + 2][k]);
        let between = self.rows[9][k] > 0.0;
        FrameSource { incoming: Some(vector(0)), outgoing: between.then(|| vector(3)), left: vector(6) }
    }
}

impl WithSimd for &mut FrameBatch {
    type Output = ();

    /// The operations of [`FrameSource::frame`] in the same order, so that the results are equal bit for bit.
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let lanes = S::F64_LANES.min(BATCH);
        for first in (0..self.count).step_by(lanes) {
            let part = first..(first + lanes).min(BATCH);
            let rows = &self.rows;
            let c = LaneVec::load(simd, [&rows[0], &rows[1], &rows[2]], &part);
            let g = LaneVec::load(simd, [&rows[3], &rows[4], &rows[5]], &part);
            let l = LaneVec::load(simd, [&rows[6], &rows[7], &rows[8]], &part);
            let between = F64Lanes::partial_load(simd, &rows[9][part.clone()]);
            let one = F64Lanes::from_scalar(simd, 1.0);
            // The tangent.
            let sum = LaneVec { x: c.x + g.x, y: c.y + g.y, z: c.z + g.z };
            let bisected = between.select_gt(0.5, one.div(sum.dot(sum).sqrt()), one);
            let mean = sum.times(bisected);
            let tangent = LaneVec {
                x: between.select_gt(0.5, mean.x, c.x),
                y: between.select_gt(0.5, mean.y, c.y),
                z: between.select_gt(0.5, mean.z, c.z),
            };
            // Heading, left and up as in `TurtleFrame::orthonormalize`.
            let along = one.div(tangent.dot(tangent).sqrt());
            let h = tangent.times(along);
            let within = h.times(l.dot(h));
            let beside = LaneVec { x: l.x - within.x, y: l.y - within.y, z: l.z - within.z };
            let across = one.div(beside.dot(beside).sqrt());
            let l = beside.times(across);
            let u = LaneVec { x: h.y * l.z - l.y * h.z, y: h.z * l.x - l.z * h.x, z: h.x * l.y - l.x * h.y };
            // The quaternion of the matrix with columns -l, h, u, as `DQuat::from_mat3` computes it: from the largest component.
            let (m00, m01, m02) = (-l.x, -l.y, -l.z);
            let (m10, m11, m12) = (h.x, h.y, h.z);
            let (m20, m21, m22) = (u.x, u.y, u.z);
            let (difference, total) = (m11 - m00, m11 + m00);
            let largest = Largest { z_or_w: m22, y_or_w: m22.select_gt(0.0, total, difference) };
            let (less, more) = (one - m22, one + m22);
            let four = largest.pick(less - difference, less + difference, more - total, more + total);
            let per = F64Lanes::from_scalar(simd, 0.5).div(four.sqrt());
            let (xy, xz, yz) = (m01 + m10, m02 + m20, m12 + m21);
            let (wx, wy, wz) = (m12 - m21, m20 - m02, m01 - m10);
            let x = largest.pick(four, xy, xz, wx) * per;
            let y = largest.pick(xy, four, yz, wy) * per;
            let z = largest.pick(xz, yz, four, wz) * per;
            let w = largest.pick(wx, wy, wz, four) * per;
            let norm = one.div((x * x + y * y + z * z + w * w).sqrt());
            let out = [x * norm, y * norm, z * norm, w * norm, bisected * along * across];
            for (row, value) in self.frames.iter_mut().zip(out) {
                value.partial_store(&mut row[part.clone()]);
            }
        }
        for (row, wide) in self.stored.iter_mut().zip(&self.frames) {
            for (value, wide) in row.iter_mut().zip(wide) {
                *value = math::narrow(*wide);
            }
        }
        let lanes = S::F32_LANES.min(BATCH);
        for first in (0..self.count).step_by(lanes) {
            let part = first..(first + lanes).min(BATCH);
            // As `narrow_quat` normalizes.
            let rows = &self.stored;
            let x = F32Lanes::partial_load(simd, &rows[0][part.clone()]);
            let y = F32Lanes::partial_load(simd, &rows[1][part.clone()]);
            let z = F32Lanes::partial_load(simd, &rows[2][part.clone()]);
            let w = F32Lanes::partial_load(simd, &rows[3][part.clone()]);
            let norm = F32Lanes::from_scalar(simd, 1.0).div((x * x + y * y + z * z + w * w).sqrt());
            for (row, value) in self.stored.iter_mut().zip([x * norm, y * norm, z * norm, w * norm]) {
                value.partial_store(&mut row[part.clone()]);
            }
        }
    }
}

/// A vector in each lane.
#[derive(Clone, Copy)]
struct LaneVec<S: Simd> {
    x: F64Lanes<S>,
    y: F64Lanes<S>,
    z: F64Lanes<S>,
}

impl<S: Simd> LaneVec<S> {
    #[inline(always)]
    fn load(simd: S, [x, y, z]: [&[f64; BATCH]; 3], part: &std::ops::Range<usize>) -> Self {
        Self {
            x: F64Lanes::partial_load(simd, &x[part.clone()]),
            y: F64Lanes::partial_load(simd, &y[part.clone()]),
            z: F64Lanes::partial_load(simd, &z[part.clone()]),
        }
    }

    #[inline(always)]
    fn dot(self, other: Self) -> F64Lanes<S> {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    #[inline(always)]
    fn times(self, factor: F64Lanes<S>) -> Self {
        Self { x: self.x * factor, y: self.y * factor, z: self.z * factor }
    }
}

/// Which component of a quaternion is the largest: z or w if `z_or_w` is above 0, then y or w if `y_or_w` is.
#[derive(Clone, Copy)]
struct Largest<S: Simd> {
    z_or_w: F64Lanes<S>,
    y_or_w: F64Lanes<S>,
}

impl<S: Simd> Largest<S> {
    /// In each lane the value for its largest component.
    #[inline(always)]
    fn pick(self, x: F64Lanes<S>, y: F64Lanes<S>, z: F64Lanes<S>, w: F64Lanes<S>) -> F64Lanes<S> {
        self.z_or_w.select_gt(0.0, self.y_or_w.select_gt(0.0, w, z), self.y_or_w.select_gt(0.0, y, x))
    }
}

/// Sets `s_exposed` of each axis: the arc length at which it leaves its parent's surface, where the distance between both
/// centrelines exceeds the parent's radius. `Own:` the parent is taken as a cylinder about its tangent at the site.
pub(in crate::grow) fn set_exposed_lengths(plant: &mut Plant) {
    for i in 0..plant.axes.len() {
        let axis = &plant.axes[i];
        let Some(parent) = plant.axes.get(axis.parent as usize) else { continue };
        let site = plant.frame(parent, axis.parent_s);
        let t = site.q * Vec3::Y;
        // Distance of a point from the parent's surface: distance from the line through the site along the parent's
        // tangent minus the parent's radius.
        let away = |p: Vec3| {
            let d = p - site.p;
            (d - t * d.dot(t)).length() - site.r
        };
        let range = plant.nodes_of(axis);
        let mut exposed = axis.length;
        // Find the first segment that ends outside and interpolate linearly where its distance is zero.
        let mut b = away(plant.nodes.p[range.start]);
        for k in range.start + 1..range.end {
            let a = std::mem::replace(&mut b, away(plant.nodes.p[k]));
            if b >= 0.0 {
                let part = if a < 0.0 { a / (a - b) } else { 0.0 };
                exposed = math::lerp(plant.nodes.s[k - 1], plant.nodes.s[k], part);
                break;
            }
        }
        plant.axes[i].s_exposed = exposed;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use osier_base::rng::Rng;

    #[test]
    fn frames_in_lanes_have_the_bits_of_single_ones() {
        let mut draw = Rng::from_key(5);
        let mut vector = || DVec3::new(draw.unit_f64() - 0.5, draw.unit_f64() - 0.5, draw.unit_f64() - 0.5);
        let mut sources = Vec::new();
        for k in 0..1000 {
            let (c, g) = (vector().normalize(), vector().normalize());
            // All three kinds of nodes, and vectors that have no direction across the tangent.
            let (incoming, outgoing) = (Some(c).filter(|_| k % 5 != 0), Some(g).filter(|_| k % 7 != 0));
            let outgoing = if k % 11 == 0 { incoming.map(|c| -c) } else { outgoing };
            let left = if k % 13 == 0 { incoming.unwrap_or(g) } else { vector() };
            sources.push(FrameSource { incoming, outgoing, left });
        }
        // Each of the four components is the largest somewhere.
        let axes = [DVec3::X, DVec3::Y, DVec3::Z, DVec3::NEG_X, DVec3::NEG_Y, DVec3::NEG_Z];
        for h in axes {
            for left in axes {
                sources.push(FrameSource { incoming: Some(h), outgoing: None, left });
            }
        }
        let mut batch = FrameBatch::default();
        for some in sources.chunks(BATCH - 3) {
            let blank = StoredNode { p: Vec3::ZERO, q: Quat::IDENTITY, r: 1.0, s: 0.0, birth: 0, next: NONE, color: 0 };
            let mut nodes = vec![blank; some.len()];
            for (i, source) in some.iter().enumerate() {
                assert!(!batch.push(index32(i), *source));
            }
            batch.finish(&mut nodes);
            for (node, source) in nodes.iter().zip(some) {
                let bits = |q: Quat| q.to_array().map(f32::to_bits);
                assert_eq!(bits(node.q), bits(source.frame()), "{source:?}");
            }
        }
    }
}
