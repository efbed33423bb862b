//! Leaves of a plant that grows over the clip and has too many for a node each: one mesh that morphs from shape to shape.
//!
//! At evenly spaced frames the leaves of the smallest keys among those that are alive are recorded. As many of each frame are
//! written as the budget of bytes allows, enlarged to cover the area of all. Each run of recorded frames of a leaf is a blade of a few triangles. While its leaf is not recorded, a blade is a point at
//! the place where the leaf appears or disappears.
//!
//! ```text
//! frame of the clip   0     5     10    15    20
//! leaf 7              .     o     O     O     .      one run: shapes 1 to 3; a point before and after
//! leaf 9              O     O     .     O     O      two runs, two blades
//! ```

use glam::Vec3;

use super::options::GltfOptions;
use super::simplify::{BLADE_DEVIATION, area, compact, with_fewer_triangles};
use super::tracks::MorphShape;
use crate::merge::transform_normal;
use osier_base::Result;
use osier_base::convert::saturating_index;
use osier_base::math;
use osier_base::rng::mix64;
use osier_scene::{
    Asset, AssetFrame, AssetKind, Instancer, InstancerMotion, LEAF_COLOR, MaterialClass, Mesh, Scene, Trs, bent_normal,
    instance_states,
};

/// Bytes of all shapes of the leaves of a plant. Own: 20,000 to 30,000 blades in 24 shapes, which web viewers and Blender draw
/// without delay.
const LEAF_BUDGET: usize = 24 << 20;
/// Shapes over the clip. Own: of a tree of 40 years one for every second year; more shapes leave fewer leaves to each.
const MOST_SHAPES: usize = 24;
/// Triangles and vertices of a simplified blade: a quadrilateral.
const BLADE_TRIANGLES: usize = 2;
const BLADE_VERTICES: usize = 4;
/// Largest factor by which leaves are enlarged to replace those left out; a larger one is conspicuous.
const MOST_GROWTH: f32 = 3.0;
/// A leaf that moves farther between two shapes, as a share of the diagonal of the plant's box, is another leaf of the same
/// instance.
const LONGEST_MOVE: f32 = 0.1;

/// One leaf in one shape.
#[derive(Debug, Clone, Copy)]
struct RecordedLeaf {
    /// Hash of the seed and the leaf's id: those of the smallest keys are written.
    key: u64,
    /// Index of the instancer in the asset, and of the instance in it.
    id: [u32; 2],
    /// In the space of the asset.
    place: Trs,
}

/// The leaves of one frame.
#[derive(Debug, Default)]
struct RecordedShape {
    /// Number of leaves that are alive.
    alive: usize,
    /// Those of the smallest keys, by rising key.
    leaves: Vec<RecordedLeaf>,
}

impl RecordedShape {
    /// The leaves of the smallest keys, at most `most`.
    fn first(&self, most: usize) -> &[RecordedLeaf] {
        &self.leaves[..most.min(self.leaves.len())]
    }

    /// Factor on the size of `most` leaves that cover the area of all, which grows with the square of the size.
    fn growth(&self, most: usize) -> f32 {
        let ratio = self.alive as f64 / self.first(most).len().max(1) as f64;
        math::narrow(math::sqrt(ratio)).clamp(1.0, MOST_GROWTH)
    }
}

/// Largest numbers of blades and shapes that the budget allows.
#[derive(Debug, Clone, Copy)]
struct Limits {
    /// Blades in the mesh.
    blades: usize,
    /// Shapes besides the last one.
    shapes: usize,
}

/// The recorded leaves of an asset.
#[derive(Debug)]
pub(super) struct LeafShapes {
    /// Indices of the recorded frames, increasing.
    frames: Vec<usize>,
    /// One for each of `frames`.
    shapes: Vec<RecordedShape>,
    /// The last frame, if it is not a recorded one.
    waiting: Option<RecordedShape>,
    /// Number of frames so far.
    seen: usize,
    /// Interval of the recorded frames.
    stride: usize,
    limits: Limits,
    /// Of the scene, which the keys depend on.
    seed: u64,
}

/// The mesh of the leaves with its shapes, and the frame of each.
pub(super) struct LeafMesh {
    /// The leaves at the shape that has most of them.
    pub mesh: Mesh,
    pub shapes: Vec<MorphShape>,
    pub blades: usize,
    /// Largest number of leaves that are alive in a shape, and largest factor by which those written are enlarged.
    pub most_alive: usize,
    pub most_growth: f32,
}

/// A run of shapes in which an instance is the same leaf.
struct Run {
    id: [u32; 2],
    /// Index of its first shape.
    first: usize,
    /// Its places in consecutive shapes; not empty.
    places: Vec<Trs>,
}

impl Run {
    /// Its place in a shape: a point before its first and after its last one.
    fn place(&self, shape: usize) -> Trs {
        let last = self.places.len() - 1;
        let k = shape.saturating_sub(self.first).min(last);
        let inside = shape >= self.first && shape - self.first <= last;
        Trs { s: if inside { self.places[k].s } else { Vec3::ZERO }, ..self.places[k] }
    }
}

impl LeafShapes {
    /// `None` for an asset whose moving leaves are few enough for a node each, or none.
    pub(super) fn new(asset: &Asset, scene: &Scene, options: &GltfOptions) -> Option<Self> {
        let leaves: usize = asset.instancers.iter().filter(|i| grows(asset, i, scene)).map(Instancer::len).sum();
        let all =
            asset.instancers.iter().filter(|i| i.motion == InstancerMotion::Free).map(Instancer::len).sum::<usize>();
        if leaves == 0 || all <= options.nodes {
            return None;
        }
        let limits = limits(leaves, scene.clip.len(), options);
        Some(Self {
            frames: Vec::new(),
            shapes: Vec::new(),
            waiting: None,
            seen: 0,
            stride: scene.clip.len().saturating_sub(1).div_ceil(limits.shapes.max(1)).max(1),
            limits,
            seed: scene.seed,
        })
    }

    /// Whether an instancer's leaves are among the recorded ones.
    pub(super) fn holds(asset: &Asset, instancer: &Instancer, scene: &Scene) -> bool {
        grows(asset, instancer, scene)
    }

    /// Records the next frame.
    pub(super) fn push(&mut self, asset: &Asset, frame: &AssetFrame, scene: &Scene) {
        let leaves = self.leaves_at(asset, frame, scene);
        if self.seen.is_multiple_of(self.stride) {
            self.frames.push(self.seen);
            self.shapes.push(leaves);
            self.waiting = None;
        } else {
            self.waiting = Some(leaves);
        }
        self.seen += 1;
    }

    /// Ends the clip: its last frame has a shape.
    pub(super) fn close(&mut self) {
        if let Some(last) = self.waiting.take() {
            self.frames.push(self.seen - 1);
            self.shapes.push(last);
        }
    }

    /// Indices of the recorded frames, increasing.
    pub(super) fn frames(&self) -> &[usize] {
        &self.frames
    }

    /// The leaves of the smallest keys that are alive at a frame: no more than there may be blades.
    fn leaves_at(&self, asset: &Asset, frame: &AssetFrame, scene: &Scene) -> RecordedShape {
        let mut leaves: Vec<RecordedLeaf> = Vec::new();
        for (n, instancer) in asset.instancers.iter().enumerate().filter(|(_, i)| grows(asset, i, scene)) {
            let state = instance_states(asset, instancer, n, frame);
            let live = (0..instancer.len()).filter(|i| state.is_alive(*i) && state.size(*i) > 0.0);
            leaves.extend(live.map(|i| RecordedLeaf {
                key: mix64(&[self.seed, instancer.ids[i]]),
                id: [n, i].map(saturating_index),
                place: instancer.transform(&state, i),
            }));
        }
        let alive = leaves.len();
        // The same leaves stay from shape to shape, spread over the crown: keys are hashes of their ids.
        leaves.sort_unstable_by_key(|leaf| (leaf.key, leaf.id));
        leaves.truncate(self.limits.blades);
        RecordedShape { alive, leaves }
    }

    /// The mesh of all blades and its shapes, one for each of [`Self::frames`]; `None` without leaves.
    /// # Errors
    /// `Export` X005 if a blade can't be simplified.
    pub(super) fn mesh(&self, asset: &Asset, label: &str) -> Result<Option<LeafMesh>> {
        let places = self.shapes.iter().flat_map(|shape| shape.leaves.iter().map(|leaf| leaf.place.t));
        let longest = LONGEST_MOVE * osier_base::geometry::Bounds::of(places).size().length();
        let most = self.most_at_once(longest);
        let runs = self.runs(most, longest);
        let Some(full) = (0..self.shapes.len()).max_by_key(|k| (self.shapes[*k].alive, *k)) else { return Ok(None) };
        // Simplified blades have a smaller area than the full ones: they are scaled to the same.
        let blade = |mesh: &Mesh| -> Result<Mesh> {
            let mut simple = compact(&with_fewer_triangles(mesh, BLADE_TRIANGLES, BLADE_DEVIATION, label)?);
            let factor = math::narrow(math::sqrt(area(mesh) / area(&simple).max(1e-12)));
            simple.points.iter_mut().for_each(|p| *p *= factor.clamp(1.0, MOST_GROWTH));
            Ok(simple)
        };
        let blades: Vec<Vec<Mesh>> = (asset.instancers.iter())
            .map(|instancer| instancer.prototypes.iter().map(|p| blade(&p.mesh)).collect())
            .collect::<Result<_>>()?;
        let blade_of = |run: &Run| {
            let [n, i] = run.id.map(|k| k as usize);
            let proto = asset.instancers.get(n).and_then(|instancer| instancer.protos.get(i));
            proto.and_then(|proto| blades.get(n)?.get(*proto as usize))
        };
        let mut mesh = Mesh::default();
        for run in &runs {
            let Some(blade) = blade_of(run) else { continue };
            let [n, i] = run.id.map(|k| k as usize);
            let place = run.place(full);
            // A blade that is a point in this shape has the normals of its nearest shape.
            let upright = Trs { s: Vec3::ONE, ..place };
            let toward = asset.instancers[n].rest.canopy_normal(i);
            mesh.append(&Mesh {
                points: blade.points.iter().map(|p| place.apply(*p)).collect(),
                normals: blade.normals.iter().map(|v| bent_normal(transform_normal(&upright, *v), toward)).collect(),
                ..blade.clone()
            });
        }
        mesh.join_subsets();
        if mesh.triangles.is_empty() {
            return Ok(None);
        }
        let points_at = |k: usize| {
            let of = |run: &Run| {
                let place = run.place(k);
                blade_of(run).into_iter().flat_map(move |blade| blade.points.iter().map(move |p| place.apply(*p)))
            };
            runs.iter().flat_map(of).collect()
        };
        let shape = |k: usize| MorphShape { points: points_at(k), normals: Vec::new(), unseen: Vec::new() };
        Ok(Some(LeafMesh {
            mesh,
            shapes: (0..self.shapes.len()).map(shape).collect(),
            blades: runs.len(),
            most_alive: self.shapes[full].alive,
            most_growth: self.shapes.iter().map(|shape| shape.growth(most)).fold(1.0, f32::max),
        }))
    }

    /// The largest number of leaves in a shape with which all runs are blades: shapes with fewer have all of their leaves.
    fn most_at_once(&self, longest: f32) -> usize {
        let (mut low, mut high) = (1, self.limits.blades);
        // With more leaves in each shape there are more runs: bisection.
        while low < high {
            let middle = low + (high - low).div_ceil(2);
            if self.runs(middle, longest).len() <= self.limits.blades {
                low = middle;
            } else {
                high = middle - 1;
            }
        }
        low
    }

    /// The runs of leaves by id and first shape, with at most `most` leaves in each shape, which are enlarged to cover the area of
    /// all. `longest`: distance, m, beyond which a leaf is another one.
    fn runs(&self, most: usize, longest: f32) -> Vec<Run> {
        let mut list: Vec<([u32; 2], usize, Trs)> = Vec::new();
        for (k, shape) in self.shapes.iter().enumerate() {
            let growth = shape.growth(most);
            let place = |leaf: &RecordedLeaf| Trs { s: leaf.place.s * growth, ..leaf.place };
            list.extend(shape.first(most).iter().map(|leaf| (leaf.id, k, place(leaf))));
        }
        list.sort_unstable_by_key(|(id, k, _)| (*id, *k));
        let mut runs: Vec<Run> = Vec::new();
        for (id, k, place) in list {
            let goes_on = |run: &&mut Run| {
                let near = run.places.last().is_some_and(|last| last.t.distance(place.t) <= longest);
                run.id == id && run.first + run.places.len() == k && near
            };
            match runs.last_mut().filter(goes_on) {
                Some(run) => run.places.push(place),
                None => runs.push(Run { id, first: k, places: vec![place] }),
            }
        }
        runs
    }
}

/// Whether the instances of an instancer are leaves that growth moves, and whose colours do not change over the clip.
fn grows(asset: &Asset, instancer: &Instancer, scene: &Scene) -> bool {
    let is_leaf = |mesh: &Mesh| {
        let class = |s: &osier_scene::Subset| scene.materials.get(s.material as usize).map(|m| m.class);
        !mesh.subsets.is_empty() && mesh.subsets.iter().all(|s| class(s) != Some(MaterialClass::Bark))
    };
    asset.kind == AssetKind::Plant
        && instancer.motion == InstancerMotion::Free
        && instancer.rest.attribute(LEAF_COLOR).is_none()
        && instancer.prototypes.iter().all(|p| is_leaf(&p.mesh))
}

/// Numbers of blades and shapes for so many leaves and frames.
fn limits(leaves: usize, frames: usize, options: &GltfOptions) -> Limits {
    let shapes = frames.saturating_sub(1).clamp(1, MOST_SHAPES);
    let blade = BLADE_VERTICES * options.target_position_bytes() * (shapes + 1);
    Limits { blades: (LEAF_BUDGET / blade).min(leaves.saturating_mul(2)).max(1), shapes }
}

/// Estimated bytes of the shapes of so many growing leaves over so many frames.
pub(super) fn estimate(leaves: u64, frames: u64, options: &GltfOptions) -> u64 {
    let count = |n: u64| usize::try_from(n).unwrap_or(usize::MAX);
    let Limits { blades, shapes } = limits(count(leaves), count(frames), options);
    (blades * BLADE_VERTICES * options.target_position_bytes() * (shapes + 1)) as u64
}
