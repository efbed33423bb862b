//! Leaves of a growing plant that has too many of them for a node each: one mesh that morphs from shape to shape.
//!
//! Leaves are recorded at evenly spaced frames, at all written frames if the budget of bytes allows it; of each frame,
//! the live leaves with the smallest keys. As many leaves of each recorded frame are written as the budget allows,
//! enlarged so that they cover the area of all. A run of recorded frames in which an instance is the same leaf is shown
//! by a blade of a few triangles, which is collapsed to a point otherwise: targets contain the vertices that are
//! visible in their shape or in a neighbouring one ([`HiddenParts`]). A blade can show several runs one after another,
//! if it is a point at both ends of at least one interval between them, in which it moves to its next place.
//!
//! ```text
//! shape               0     1     2     3     4     5     6
//! leaf 7              .     o     O     O     .     -     -     run of shapes 1 to 3; a point before and after
//! leaf 9              -     -     -     -     -     .     O     run of shape 6, by the same blade
//! ```

use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};

use glam::Vec3;

use super::blades::enlarged_blade;
use super::hidden_parts::{HiddenParts, ShownVertices};
use super::options::{GltfOptions, Profile};
use super::rig::rotation_angle;
use super::simplify::{area, triangle_area};
use crate::merge::transform_normal;
use osier_base::Result;
use osier_base::convert::{limit, saturating_index};
use osier_base::math;
use osier_base::rng::mix64;
use osier_scene::{
    Asset, AssetFrame, AssetKind, Instancer, InstancerMotion, LEAF_COLOR, Material, MaterialClass, Mesh, Prototype,
    Scene, Subset, Trs, bent_normal, instance_states,
};

/// Most bytes of the leaves of a plant for viewers and engines; for Blender the limit is [`GltfOptions::leaf_bytes`].
/// Own: some 30,000 blades in 60 shapes, which web viewers draw without delay.
const LEAF_BUDGET: usize = 40 << 20;
/// Most bytes of the targets in the memory of a viewer, where each has all vertices, divided by [`LEAF_BUDGET`]. Own:
/// less than a fifth of a graphics card of 1 GB.
const MEMORY_RATIO: usize = 5;
/// As [`MEMORY_RATIO`], for Blender and [`GltfOptions::leaf_bytes`]. Own: half a gigabyte of 8 GB.
const BLENDER_MEMORY_RATIO: usize = 3;
/// Bytes of a position in the memory of a viewer, whose textures have four numbers.
const VIEWER_POINT: usize = 16;
/// Bytes of a position in the memory of Blender.
const BLENDER_POINT: usize = 12;
/// Least number of intervals between shapes if frames are left out. Own: leaves unfold within a twelfth of a year.
/// Measured on a tree of 20 years: halfway between two shapes the area of its leaves drops to 0.7 (60 shapes) or 0.6
/// (30 shapes) of that at a shape.
const LEAST_SHAPES: usize = 48;
/// Most shapes of a mesh: importers and viewers keep a list entry for each.
const MOST_SHAPES: usize = 256;
/// Triangles of a simplified blade: a quadrilateral.
const BLADE_TRIANGLES: usize = 2;
/// Vertices of a simplified blade.
const BLADE_VERTICES: usize = 4;
/// Bytes of a vertex without the targets of shapes: position, normal, tangent and texture coordinates; indices of its
/// triangles; its entry in the target that hides all parts.
const VERTEX_BYTES: usize = 48 + 6 + 12;
/// As [`VERTEX_BYTES`], for quantized vertices.
const QUANTIZED_VERTEX_BYTES: usize = 20 + 6 + 12;
/// For estimates: share, as numerator and denominator, of the targets that contain a leaf instance, out of the shapes of
/// the clip plus [`TARGETS_BESIDE`]. Own: birches of 10 to 20 years and oaks of 8 and 20 years over 8 to 120 frames take
/// 0.92 to 1.12 times the estimated bytes.
const SHARE_OF_TARGETS: [u64; 2] = [4, 17];
/// See [`SHARE_OF_TARGETS`].
const TARGETS_BESIDE: u64 = 6;
/// Largest angle, rad, by which a leaf may turn between two shapes and still be the same blade. Own: at this angle the
/// linear motion of its corners halves its area in between, as replacing it by another blade would.
const LARGEST_TURN: f32 = std::f32::consts::FRAC_PI_2;
/// Largest factor by which leaves are enlarged to replace those left out; a larger one is conspicuous.
const MOST_GROWTH: f32 = 3.0;
/// Longest move of a leaf between two shapes, as a share of the diagonal of the plant's box; a leaf that moves farther
/// counts as another leaf of the same instance.
const LONGEST_MOVE: f32 = 0.1;

/// One leaf in one shape.
#[derive(Debug, Clone, Copy)]
struct RecordedLeaf {
    /// Hash of the seed and the leaf's id: the leaves with the smallest keys are written.
    key: u64,
    /// Index of the instancer in the asset, and index of the instance in the instancer.
    id: [u32; 2],
    /// Number of times that the instance has become alive: each time it is another leaf.
    life: u32,
    /// Transform to the space of the asset.
    place: Trs,
}

/// The leaves of one frame.
#[derive(Debug, Default)]
struct RecordedShape {
    /// Number of live leaves.
    alive: usize,
    /// The live leaves with the smallest keys, sorted by key.
    leaves: Vec<RecordedLeaf>,
}

impl RecordedShape {
    /// The leaves with the smallest keys, at most `most`.
    fn first(&self, most: usize) -> &[RecordedLeaf] {
        &self.leaves[..most.min(self.leaves.len())]
    }

    /// Factor on the size of the first `most` leaves with which they cover the area of all; area grows with the square
    /// of the size. 1 to [`MOST_GROWTH`].
    fn growth(&self, most: usize) -> f32 {
        let ratio = self.alive as f64 / self.first(most).len().max(1) as f64;
        math::narrow(math::sqrt(ratio)).clamp(1.0, MOST_GROWTH)
    }
}

/// Limits that the options set to leaves and shapes.
#[derive(Debug, Clone, Copy)]
struct LeafBudget {
    /// Interval of the recorded frames before any are left out, then the largest interval.
    strides: [usize; 2],
    /// Bytes of a vertex without the targets of shapes.
    vertex: usize,
    /// Bytes of a vertex in a target.
    entry: usize,
    /// Most bytes in the file.
    file: usize,
    /// Most bytes in the memory of the program that reads the file.
    memory: usize,
    /// Bytes that a program's memory takes for a vertex of a target.
    memory_point: usize,
}

/// The recorded leaves of an asset.
#[derive(Debug)]
pub(super) struct LeafShapes {
    /// Indices of the recorded frames, increasing.
    frames: Vec<usize>,
    /// Leaves of each of `frames`.
    shapes: Vec<RecordedShape>,
    /// Leaves of the last frame, if that frame is not recorded.
    waiting: Option<RecordedShape>,
    /// Number of frames taken so far.
    seen: usize,
    /// Interval of the recorded frames.
    stride: usize,
    /// For each instancer of the asset whether its leaves are recorded.
    held: Vec<bool>,
    /// For each instancer and instance how often it has become alive, and whether it is.
    lives: Vec<Vec<(u32, bool)>>,
    budget: LeafBudget,
    /// Most leaves that are recorded per shape.
    most_recorded: usize,
    /// Seed of the scene, on which the keys depend.
    seed: u64,
}

/// The leaves of a plant as a mesh that morphs.
pub(super) struct LeafMesh {
    /// The blades in their state in the shape with the most leaves. A blade that is hidden in that shape is in the state of the
    /// last shape in which it is visible.
    pub mesh: Mesh,
    /// Indices of the frames of which there are shapes, increasing.
    pub frames: Vec<usize>,
    /// One shape for each of `frames`.
    pub parts: HiddenParts,
    /// Number of frames of the clip.
    pub all_frames: usize,
    /// Largest number of live leaves in a shape.
    pub most_alive: usize,
    /// Largest factor by which written leaves are enlarged.
    pub most_growth: f32,
}

impl LeafMesh {
    /// Text of a message: how many leaves are written, in how many shapes, and how much they are enlarged if some are
    /// left out.
    pub(super) fn words(&self, label: &str) -> String {
        let Self { frames, all_frames, most_alive, most_growth, .. } = self;
        // Factors below this are shown as 1 with two decimals.
        let enlarged = if *most_growth < 1.005 {
            String::new()
        } else {
            format!(", enlarged up to {most_growth:.2} times where not all are written")
        };
        let shapes = frames.len();
        let of_frames =
            if shapes < *all_frames { format!("{shapes} shapes for") } else { "a shape for each of".into() };
        format!(
            "{label}: up to {most_alive} at once are simpler ones in one mesh with {of_frames} {all_frames} frames{enlarged}; USD \
             has all of every frame"
        )
    }
}

/// A run of shapes in which an instance is the same leaf.
struct Run {
    id: [u32; 2],
    life: u32,
    /// Index of its first shape.
    first: usize,
    /// Transforms of the leaf in consecutive shapes; not empty.
    places: Vec<Trs>,
}

impl Run {
    /// Index of the shape after its last one.
    fn end(&self) -> usize {
        self.first + self.places.len()
    }

    /// Transform of the leaf in a shape; before the first and after the last shape of the run, scaled to a point.
    fn place(&self, shape: usize) -> Trs {
        let last = self.places.len() - 1;
        let k = shape.saturating_sub(self.first).min(last);
        let inside = shape >= self.first && shape - self.first <= last;
        Trs { s: if inside { self.places[k].s } else { Vec3::ZERO }, ..self.places[k] }
    }
}

/// A blade and the runs that it shows, in their order.
struct Blade<'a> {
    mesh: &'a Mesh,
    runs: Vec<&'a Run>,
}

impl LeafShapes {
    /// `None` if the asset has no growing leaves, or few enough moving instances for a node each.
    pub(super) fn new(asset: &Asset, scene: &Scene, options: &GltfOptions) -> Option<Self> {
        let held: Vec<bool> = asset.instancers.iter().map(|i| is_growing_foliage(asset, i, &scene.materials)).collect();
        let leaves: usize = asset.instancers.iter().zip(&held).filter(|(_, held)| **held).map(|(i, _)| i.len()).sum();
        let all =
            asset.instancers.iter().filter(|i| i.motion == InstancerMotion::Free).map(Instancer::len).sum::<usize>();
        if leaves == 0 || all <= options.nodes {
            return None;
        }
        let budget = leaf_budget(options.written_frames(scene.clip), options);
        Some(Self {
            frames: Vec::new(),
            shapes: Vec::new(),
            waiting: None,
            seen: 0,
            stride: budget.strides[0],
            held,
            lives: asset.instancers.iter().map(|i| vec![(0, false); i.len()]).collect(),
            budget,
            most_recorded: usize::MAX,
            seed: scene.seed,
        })
    }

    /// Whether the leaves of an instancer, by its index in the asset, are among the recorded ones.
    pub(super) fn holds(&self, instancer: usize) -> bool {
        self.held.get(instancer) == Some(&true)
    }

    /// Takes the next frame of the asset.
    pub(super) fn push(&mut self, asset: &Asset, frame: &AssetFrame) {
        let leaves = self.leaves_at(asset, frame);
        self.record(leaves);
    }

    /// Takes the leaves of the next frame: records them, or holds them back in case the clip ends with this frame.
    fn record(&mut self, leaves: RecordedShape) {
        if self.seen.is_multiple_of(self.stride) {
            self.frames.push(self.seen);
            self.shapes.push(leaves);
            self.waiting = None;
        } else {
            self.waiting = Some(leaves);
        }
        self.seen += 1;
        self.thin_out();
    }

    /// Doubles the interval of the recorded frames while the budget demands and the number of frames allows it; then records fewer
    /// leaves of each, which bounds the memory.
    fn thin_out(&mut self) {
        let LeafBudget { strides: [_, longest], entry, file, .. } = self.budget;
        // A leaf also has entries in neighbouring shapes in which it is collapsed to a point: about a third more, hence the
        // factor 4/3.
        let bytes_of = |shapes: &[RecordedShape]| {
            shapes.iter().map(|shape| shape.leaves.len()).sum::<usize>() * BLADE_VERTICES * entry * 4 / 3
        };
        while self.stride * 2 <= longest && bytes_of(&self.shapes) > file {
            self.stride *= 2;
            // The last frame so far may be the last of the clip: hold it back instead of dropping it.
            if self.frames.last().is_some_and(|last| *last + 1 == self.seen && !last.is_multiple_of(self.stride)) {
                self.waiting = self.shapes.pop();
                self.frames.pop();
            }
            let stride = self.stride;
            let mut frames = self.frames.iter();
            self.shapes.retain(|_| frames.next().is_some_and(|frame| frame.is_multiple_of(stride)));
            self.frames.retain(|frame| frame.is_multiple_of(stride));
        }
        // Keep leaves for twice the budget, because some shapes have few of them.
        while self.most_recorded > 1 && bytes_of(&self.shapes) > file.saturating_mul(2) {
            let largest = self.shapes.iter().map(|shape| shape.leaves.len()).max().unwrap_or(1);
            self.most_recorded = (largest - largest / 8 - 1).max(1);
            for shape in self.shapes.iter_mut().chain(&mut self.waiting) {
                shape.leaves.truncate(self.most_recorded);
                shape.leaves.shrink_to_fit();
            }
        }
    }

    /// Ends the clip: its last frame has a shape.
    pub(super) fn close(&mut self) {
        if let Some(last) = self.waiting.take() {
            self.frames.push(self.seen - 1);
            self.shapes.push(last);
        }
    }

    /// The live leaves with the smallest keys at a frame, at most as many as may be recorded.
    fn leaves_at(&mut self, asset: &Asset, frame: &AssetFrame) -> RecordedShape {
        let mut leaves: Vec<RecordedLeaf> = Vec::new();
        let instancers = asset.instancers.iter().zip(&mut self.lives).zip(&self.held).enumerate();
        for (n, ((instancer, lives), _)) in instancers.filter(|(_, (_, held))| **held) {
            let state = instance_states(asset, instancer, n, frame);
            for (i, (life, was_alive)) in lives.iter_mut().enumerate() {
                let is_alive = state.is_alive(i) && state.size(i) > 0.0;
                *life += u32::from(is_alive && !*was_alive);
                *was_alive = is_alive;
                if is_alive {
                    leaves.push(RecordedLeaf {
                        key: mix64(&[self.seed, instancer.ids[i]]),
                        id: [n, i].map(saturating_index),
                        life: *life,
                        place: instancer.transform(&state, i),
                    });
                }
            }
        }
        let (alive, most) = (leaves.len(), self.most_recorded);
        // The same leaves stay from shape to shape, spread over the crown: keys are hashes of their ids.
        let by_key = |leaf: &RecordedLeaf| (leaf.key, leaf.id);
        if alive > most {
            leaves.select_nth_unstable_by_key(most, by_key);
            leaves.truncate(most);
            // Shapes are held until the end of the clip: free the memory of the leaves that were cut off.
            leaves.shrink_to_fit();
        }
        leaves.sort_unstable_by_key(by_key);
        RecordedShape { alive, leaves }
    }

    /// The blades of all leaves; `None` without leaves.
    /// # Errors
    /// `Export` X005 if a blade can't be simplified.
    pub(super) fn mesh(&self, asset: &Asset, label: &str) -> Result<Option<LeafMesh>> {
        let places = self.shapes.iter().flat_map(|shape| shape.leaves.iter().map(|leaf| leaf.place.t));
        let longest = LONGEST_MOVE * osier_base::geometry::Bounds::of(places).size().length();
        // Determine which leaves are written, and which blade shows each of them.
        let simple = simple_blades(asset, label)?;
        let most = self.most_at_once(longest, asset, &simple);
        let runs = self.runs(most, longest);
        let blades = self.blades(&runs, asset, &simple);
        let full = (0..self.shapes.len()).max_by_key(|k| (self.shapes[*k].alive, *k)).unwrap_or(0);
        let (mut mesh, mut hidden) = (Mesh::default(), Vec::new());
        let mut shapes: Vec<ShownVertices> = self.shapes.iter().map(|_| ShownVertices::default()).collect();
        // At rest a blade has the place that it has in the fullest shape, or, if it is hidden there, in its last run.
        for blade in &blades {
            let at_rest = blade.runs.iter().find(|run| (run.first..run.end()).contains(&full)).or(blade.runs.last());
            let Some(run) = at_rest else { continue };
            let place = run.place(full.clamp(run.first, run.end() - 1));
            let upright = Trs { s: Vec3::ONE, ..place };
            let [n, i] = run.id.map(|k| k as usize);
            let toward = asset.instancers[n].rest.canopy_normal(i);
            let first = saturating_index(mesh.points.len());
            mesh.append(&Mesh {
                points: blade.mesh.points.iter().map(|p| place.apply(*p)).collect(),
                normals: blade
                    .mesh
                    .normals
                    .iter()
                    .map(|v| bent_normal(transform_normal(&upright, *v), toward))
                    .collect(),
                ..blade.mesh.clone()
            });
            // A blade is a point at its foot where it is hidden; targets contain it in the shapes of its runs and in
            // those next to them.
            hidden.extend(blade.mesh.points.iter().map(|_| place.t));
            for run in &blade.runs {
                for k in run.first.saturating_sub(1)..=run.end().min(self.shapes.len() - 1) {
                    let place = run.place(k);
                    shapes[k].indices.extend((first..).zip(&blade.mesh.points).map(|(vertex, _)| vertex));
                    shapes[k].points.extend(blade.mesh.points.iter().map(|p| place.apply(*p)));
                }
            }
        }
        mesh.join_subsets();
        if mesh.triangles.is_empty() {
            return Ok(None);
        }
        Ok(Some(LeafMesh {
            mesh,
            frames: self.frames.clone(),
            parts: HiddenParts { hidden, shapes },
            all_frames: self.seen,
            most_alive: self.shapes.get(full).map_or(0, |shape| shape.alive),
            most_growth: self.shapes.iter().map(|shape| shape.growth(most)).fold(1.0, f32::max),
        }))
    }

    /// The largest number of leaves per shape for which all runs fit into the budget; shapes with fewer leaves keep all
    /// of them. `simple`: blades per instancer and prototype.
    fn most_at_once(&self, longest: f32, asset: &Asset, simple: &[Vec<Mesh>]) -> usize {
        let largest = self.shapes.iter().map(|shape| shape.leaves.len()).max().unwrap_or(0);
        let (mut low, mut high) = (1, largest.max(1));
        // Try all leaves first, then bisect, since more leaves in each shape give more runs.
        let mut middle = high;
        while low < high {
            let runs = self.runs(middle, longest);
            if self.fits(&self.blades(&runs, asset, simple)) {
                low = middle;
            } else {
                high = middle - 1;
            }
            middle = low + (high - low).div_ceil(2);
        }
        low
    }

    /// Whether blades are within the budget.
    fn fits(&self, blades: &[Blade<'_>]) -> bool {
        let LeafBudget { vertex, entry, file, memory, memory_point, .. } = self.budget;
        let (mut bytes, mut vertices) = (0_usize, 0_usize);
        for blade in blades {
            let points = blade.mesh.points.len();
            // In addition to the shapes of its run, a leaf is a point in one shape before and one after.
            let shapes: usize = blade.runs.iter().map(|run| run.places.len() + 2).sum();
            vertices += points;
            bytes += points * (vertex + entry * shapes);
        }
        bytes <= file && vertices.saturating_mul(memory_point).saturating_mul(self.shapes.len()) <= memory
    }

    /// Runs of the leaves, sorted by first shape, id and life. Each shape contributes at most `most` leaves, enlarged
    /// to cover the area of all. `longest`: distance, m, beyond which a leaf counts as another one.
    fn runs(&self, most: usize, longest: f32) -> Vec<Run> {
        let mut list: Vec<([u32; 2], usize, u32, Trs)> = Vec::new();
        for (k, shape) in self.shapes.iter().enumerate() {
            let growth = shape.growth(most);
            let place = |leaf: &RecordedLeaf| Trs { s: leaf.place.s * growth, ..leaf.place };
            list.extend(shape.first(most).iter().map(|leaf| (leaf.id, k, leaf.life, place(leaf))));
        }
        list.sort_unstable_by_key(|(id, k, ..)| (*id, *k));
        let mut runs: Vec<Run> = Vec::new();
        for (id, k, life, place) in list {
            let goes_on = |run: &&mut Run| {
                let is_like = run.places.last().is_some_and(|last| keeps_its_area(last, &place, longest));
                run.id == id && run.life == life && run.end() == k && is_like
            };
            match runs.last_mut().filter(goes_on) {
                Some(run) => run.places.push(place),
                None => runs.push(Run { id, life, first: k, places: vec![place] }),
            }
        }
        runs.sort_unstable_by_key(|run| (run.first, run.id, run.life));
        runs
    }

    /// The fewest blades that show all runs. `simple`: blades per instancer and prototype.
    fn blades<'a>(&self, runs: &'a [Run], asset: &Asset, simple: &'a [Vec<Mesh>]) -> Vec<Blade<'a>> {
        let mut blades: Vec<Blade<'a>> = Vec::new();
        // For each instancer and prototype, its blades that show no leaf at the moment.
        let mut free: BTreeMap<(usize, usize), FreeBlades> = BTreeMap::new();
        for run in runs {
            let [n, i] = run.id.map(|k| k as usize);
            let Some(proto) = asset.instancers.get(n).and_then(|instancer| instancer.protos.get(i)) else { continue };
            let proto = *proto as usize;
            let Some(mesh) = simple.get(n).and_then(|list| list.get(proto)) else { continue };
            let heap = free.entry((n, proto)).or_default();
            // A blade is free if it is a point from the end of its last run to the shape before this one, and moves in
            // between.
            let is_free = |Reverse((end, _)): &&Reverse<(usize, usize)>| *end + 1 < run.first;
            let blade = match heap.peek().filter(is_free).map(|Reverse((_, blade))| *blade) {
                Some(blade) => {
                    heap.pop();
                    blade
                }
                None => {
                    blades.push(Blade { mesh, runs: Vec::new() });
                    blades.len() - 1
                }
            };
            blades[blade].runs.push(run);
            heap.push(Reverse((run.end(), blade)));
        }
        blades
    }
}

/// Free blades, as the shape after the last run of each and the index of the blade; the one that ended first is on top.
type FreeBlades = BinaryHeap<Reverse<(usize, usize)>>;

/// Whether the leaf moves by at most `longest`, m, and turns so little that a blade whose corners move linearly keeps
/// more of its area in between than one blade that disappears while another appears.
fn keeps_its_area(from: &Trs, to: &Trs, longest: f32) -> bool {
    from.t.distance(to.t) <= longest && rotation_angle(from.r, to.r) <= LARGEST_TURN
}

/// Whether the instances of an instancer are leaves that growth moves, with constant colours over the clip. A growing
/// plant has no joints and only free instancers; in rain, the instancers of leaves with maps are free as well.
fn is_growing_foliage(asset: &Asset, instancer: &Instancer, materials: &[Material]) -> bool {
    // Twigs of needles contain some wood.
    let is_leaf = |mesh: &Mesh| area_of_bark(mesh, materials) < 0.5 * area(mesh);
    asset.kind == AssetKind::Plant
        && asset.skeleton.is_none()
        && asset.instancers.iter().all(|i| i.motion == InstancerMotion::Free)
        && instancer.rest.attribute(LEAF_COLOR).is_none()
        && instancer.prototypes.iter().all(|p| is_leaf(&p.mesh))
}

/// Area of the triangles of bark, m^2.
fn area_of_bark(mesh: &Mesh, materials: &[Material]) -> f64 {
    let class = |s: &Subset| materials.get(s.material as usize).map(|m| m.class);
    let bark = mesh.subsets.iter().filter(|s| class(s) == Some(MaterialClass::Bark));
    bark.flat_map(|s| mesh.subset_triangles(s)).map(|t| triangle_area(mesh, t)).sum()
}

/// A simple blade for each prototype of each instancer, with the visible area of the full leaf.
fn simple_blades(asset: &Asset, label: &str) -> Result<Vec<Vec<Mesh>>> {
    let blade = |p: &Prototype| enlarged_blade(&p.mesh, BLADE_TRIANGLES, MOST_GROWTH, label);
    let of_instancer = |i: &Instancer| i.prototypes.iter().map(blade).collect();
    asset.instancers.iter().map(of_instancer).collect()
}

/// Limits to leaves and shapes that the options set for `frames` frames.
fn leaf_budget(frames: usize, options: &GltfOptions) -> LeafBudget {
    let intervals = frames.saturating_sub(1).max(1);
    let shortest = intervals.div_ceil(MOST_SHAPES - 1);
    let is_for_blender = options.profile == Profile::Blender;
    let (file, ratio, memory_point) = if is_for_blender {
        (limit(options.leaf_bytes), BLENDER_MEMORY_RATIO, BLENDER_POINT)
    } else {
        (LEAF_BUDGET, MEMORY_RATIO, VIEWER_POINT)
    };
    let entry = options.sparse_position_bytes();
    let vertex = if entry < 16 { QUANTIZED_VERTEX_BYTES } else { VERTEX_BYTES };
    LeafBudget {
        strides: [shortest, (intervals / LEAST_SHAPES).max(shortest)],
        vertex,
        entry,
        file,
        memory: file.saturating_mul(ratio),
        memory_point,
    }
}

/// Estimated bytes of the mesh of `leaves` growing leaves over `frames` frames.
pub(super) fn estimate(leaves: u64, frames: u64, options: &GltfOptions) -> u64 {
    let LeafBudget { strides: [shortest, longest], vertex, entry, file, .. } = leaf_budget(limit(frames), options);
    let bytes = |stride: usize| {
        let shapes = frames.saturating_sub(1) / (stride as u64) + 1;
        let [part, whole] = SHARE_OF_TARGETS;
        let entries = (shapes + TARGETS_BESIDE) * part * entry as u64 / whole;
        leaves.saturating_mul(BLADE_VERTICES as u64 * (vertex as u64 + entries))
    };
    let mut stride = shortest;
    while stride * 2 <= longest && bytes(stride) > file as u64 {
        stride *= 2;
    }
    bytes(stride).min(file as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn recorded(frames: &[&[(u32, f32)]]) -> LeafShapes {
        let leaf = |(i, x): &(u32, f32)| RecordedLeaf {
            key: u64::from(*i),
            id: [0, *i],
            life: 1,
            place: Trs::translation(Vec3::X * *x),
        };
        let shape = |list: &&[(u32, f32)]| RecordedShape { alive: list.len(), leaves: list.iter().map(leaf).collect() };
        LeafShapes {
            frames: (0..frames.len()).collect(),
            shapes: frames.iter().map(shape).collect(),
            waiting: None,
            seen: frames.len(),
            stride: 1,
            held: vec![true],
            lives: Vec::new(),
            budget: leaf_budget(frames.len(), &GltfOptions::default()),
            most_recorded: usize::MAX,
            seed: 0,
        }
    }

    /// A plant of `leaves` leaves, squares of 1 m x 1 m.
    fn plant(leaves: u32) -> Asset {
        let points = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(x, y)| Vec3::new(x, y, 0.0)).to_vec();
        let square =
            Mesh { points, normals: vec![Vec3::Z; 4], triangles: vec![[0, 1, 2], [0, 2, 3]], ..Mesh::default() };
        let instancer = Instancer {
            name: "leaves".into(),
            prototypes: vec![osier_scene::Prototype::new("leaf", square.with_material(0))],
            ids: (0..u64::from(leaves)).collect(),
            protos: vec![0; leaves as usize],
            scales: vec![Vec3::ONE; leaves as usize],
            rest: osier_scene::InstanceState::default(),
            motion: InstancerMotion::Free,
            tracked: false,
        };
        Asset {
            id: "tree".into(),
            kind: AssetKind::Plant,
            group: String::new(),
            skeleton: None,
            meshes: Vec::new(),
            instancers: vec![instancer],
            points: Vec::new(),
            curves: Vec::new(),
            rigged: None,
        }
    }

    #[test]
    fn estimates_are_near_the_bytes_of_grown_trees() {
        let options = GltfOptions { quantize: true, profile: Profile::Web, ..GltfOptions::default() };
        // Instances, frames and bytes of leaves of birches of 20, 12 and 10 years and of an oak of 8, without compression.
        for (leaves, frames, bytes) in
            [(57_472, 24, 25_085_304.0), (6_808, 48, 4_147_256.0), (5_291, 8, 1_342_752.0), (5_927, 24, 2_799_432.0)]
        {
            let ratio = estimate(leaves, frames, &options) as f64 / bytes;
            assert!((0.85..1.15).contains(&ratio), "{leaves} leaves over {frames} frames: {ratio}");
        }
        assert_eq!(estimate(10_000_000, 24, &options), LEAF_BUDGET as u64);
    }

    #[test]
    fn shapes_and_enlarged_leaves_are_told() {
        let said = |most_growth: f32, shapes: usize| {
            let frames = (0..shapes).collect();
            let (mesh, parts) = (Mesh::default(), HiddenParts::default());
            LeafMesh { mesh, frames, parts, all_frames: 40, most_alive: 8, most_growth }.words("leaves")
        };
        assert_eq!(
            said(1.0, 40),
            "leaves: up to 8 at once are simpler ones in one mesh with a shape for each of 40 frames; USD has all of every frame"
        );
        assert_eq!(
            said(1.63, 21),
            "leaves: up to 8 at once are simpler ones in one mesh with 21 shapes for 40 frames, enlarged up to 1.63 times where \
             not all are written; USD has all of every frame"
        );
    }

    #[test]
    fn a_leaf_that_pauses_or_jumps_begins_another_run() {
        // Leaf 3 pauses in shape 2, leaf 5 jumps to another place after shape 1.
        let mut shapes = recorded(&[&[(3, 0.0)], &[(3, 0.1), (5, 7.0)], &[(5, 2.0)], &[(3, 0.2), (5, 2.1)]]);
        let runs = shapes.runs(10, 1.0);
        let list: Vec<([u32; 2], usize, usize)> = runs.iter().map(|r| (r.id, r.first, r.places.len())).collect();
        assert_eq!(list, [([0, 3], 0, 2), ([0, 5], 1, 1), ([0, 5], 2, 2), ([0, 3], 3, 1)]);
        // Outside of its shapes it is a point where it appeared or disappeared.
        let late = &runs[2];
        assert_eq!((late.place(0).t, late.place(0).s), (Vec3::X * 2.0, Vec3::ZERO));
        assert_eq!((late.place(3).t, late.place(3).s), (Vec3::X * 2.1, Vec3::ONE));
        assert_eq!(runs[1].place(3).s, Vec3::ZERO);
        // A frame that was left out may have shown another leaf of the instance, wherever that is.
        shapes.shapes[3].leaves[1].life = 2;
        let lengths: Vec<usize> = shapes.runs(10, 1.0).iter().map(|r| r.places.len()).collect();
        assert_eq!(lengths, [2, 1, 1, 1, 1]);
    }

    #[test]
    fn a_leaf_that_turns_much_is_another_blade() {
        let at = |turn: f32| Trs { t: Vec3::ZERO, r: glam::Quat::from_rotation_y(turn), s: Vec3::ONE };
        let keeps =
            |turn: f32| [[at(0.0), at(turn)], [at(turn), at(0.0)]].map(|[from, to]| keeps_its_area(&from, &to, 1.0));
        assert_eq!([keeps(1.5), keeps(-1.5), keeps(1.6), keeps(-1.6)], [[true; 2], [true; 2], [false; 2], [false; 2]]);
    }

    #[test]
    fn few_leaves_cover_the_area_of_all() {
        let many: Vec<(u32, f32)> = (0..16).map(|i| (i, 0.0)).collect();
        let shapes = recorded(&[&many[..]; 8]);
        // Of 16 leaves the four of the smallest keys, of twice the size.
        let runs = shapes.runs(4, 1.0);
        assert!(runs.iter().all(|r| r.id[1] < 4 && r.places.iter().all(|p| p.s == Vec3::splat(2.0))));
        assert_eq!(runs.iter().map(|r| r.places.len()).collect::<Vec<_>>(), [8; 4]);
        assert_eq!(shapes.shapes[0].growth(16).to_bits(), 1.0_f32.to_bits());
    }

    #[test]
    fn a_blade_shows_one_leaf_after_the_other_and_is_a_point_between_them() {
        // Leaf 1 in shapes 0 and 1, leaf 2 from shape 4 on, leaf 3 in shape 4 alone.
        let shapes = recorded(&[&[(1, 0.0)], &[(1, 0.5)], &[], &[], &[(2, 8.0), (3, 16.0)], &[(2, 8.5)]]);
        let leaves = shapes.mesh(&plant(4), "leaves").expect("simplified").expect("leaves");
        // Leaf 1 is a point in shape 2, leaf 2 in shape 3: it has the blade of leaf 1.
        assert_eq!((leaves.mesh.points.len(), leaves.mesh.triangles.len()), (8, 4));
        let held: Vec<&[u32]> = leaves.parts.shapes.iter().map(|s| s.indices.as_slice()).collect();
        let both = [0, 1, 2, 3, 4, 5, 6, 7];
        assert_eq!(held, [&both[..4], &both[..4], &both[..4], &both[..], &both[..], &both[..]]);
        let at = |k: usize| leaves.parts.shapes[k].points.iter().map(|p| p.x).collect::<Vec<_>>();
        assert_eq!(at(1), [0.5, 1.5, 1.5, 0.5]);
        assert_eq!(at(2), [0.5; 4]);
        assert_eq!(at(3), [8.0, 8.0, 8.0, 8.0, 16.0, 16.0, 16.0, 16.0]);
        assert_eq!(at(5), [8.5, 9.5, 9.5, 8.5, 16.0, 16.0, 16.0, 16.0]);
        // At rest each has its size.
        assert!((area(&leaves.mesh) - 2.0).abs() < 1e-6);
    }

    #[test]
    fn twigs_of_needles_are_leaves_and_pieces_of_wood_are_none() {
        let classes = [MaterialClass::Leaf, MaterialClass::Bark];
        let materials = classes.map(|class| Material::plain("m".into(), class, [0.5; 3], 0.5));
        // A square of 1 m2 with as long a strip of bark.
        let grows_with_bark = |width: f32| {
            let mut tree = plant(1);
            let mesh = &mut tree.instancers[0].prototypes[0].mesh;
            let first = mesh.next_point();
            mesh.points
                .extend([(0.0, 0.0), (width, 0.0), (width, -1.0), (0.0, -1.0)].map(|(x, y)| Vec3::new(x, y, 0.0)));
            mesh.normals.extend([Vec3::Z; 4]);
            mesh.append_subset(1, vec![[first, first + 1, first + 2], [first, first + 2, first + 3]]);
            is_growing_foliage(&tree, &tree.instancers[0], &materials)
        };
        assert_eq!([0.0, 0.1, 0.9, 1.1].map(grows_with_bark), [true, true, true, false]);
    }

    #[test]
    fn two_triangles_have_the_area_of_a_twig_of_needles() {
        let mut twig = Mesh::default();
        let mut needles = Vec::new();
        for (i, first) in (0_u8..40).zip((0_u32..).step_by(3)) {
            let (y, x) = (f32::from(i) * 0.001, if i % 2 == 0 { 0.015 } else { -0.015 });
            twig.points.extend([Vec3::new(0.0, y, 0.0), Vec3::new(0.0, y + 0.0005, 0.0), Vec3::new(x, y + 0.01, 0.0)]);
            needles.push([first, first + 1, first + 2]);
        }
        twig.normals = vec![Vec3::Z; twig.points.len()];
        twig.append_subset(0, needles);
        let mut tree = plant(1);
        let whole = area(&twig);
        tree.instancers[0].prototypes[0].mesh = twig;
        let blades = simple_blades(&tree, "leaves").expect("simplified");
        assert_eq!(blades[0][0].triangles.len(), 2);
        let share = area(&blades[0][0]) / whole;
        assert!((share - 1.0).abs() < 0.1, "{share}");
    }

    #[test]
    fn frames_and_then_leaves_are_left_out_where_they_take_too_much() {
        let many: Vec<(u32, f32)> = (0..100).map(|i| (i, 0.0)).collect();
        let recorded_within = |shapes_of_file: usize| {
            let mut shapes = recorded(&[]);
            let file = 100 * BLADE_VERTICES * 16 * shapes_of_file;
            shapes.budget = LeafBudget { file, ..leaf_budget(241, &GltfOptions::default()) };
            for _ in 0..241 {
                shapes.record(recorded(&[&many[..]]).shapes.remove(0));
            }
            shapes.close();
            assert_eq!(shapes.frames.len(), shapes.shapes.len());
            let least = shapes.shapes.iter().map(|s| s.leaves.len()).min().unwrap_or(0);
            (shapes.frames.clone(), least)
        };
        let every = |stride: usize| (0..=240).step_by(stride).collect::<Vec<_>>();
        assert_eq!(recorded_within(400), (every(1), 100));
        assert_eq!(recorded_within(200), (every(2), 100));
        // Fewer than 48 intervals would be too few; the memory holds twice what the file does.
        let (frames, leaves) = recorded_within(20);
        assert_eq!(frames, every(4));
        assert!((25..60).contains(&leaves), "{leaves}");
    }
}
