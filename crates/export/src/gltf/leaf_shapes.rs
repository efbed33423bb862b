//! Leaves of a plant that grows over the clip and has too many for a node each: one mesh that morphs from shape to shape.
//!
//! At evenly spaced frames the leaves of the smallest keys among those that are alive are recorded, enlarged to cover the area of
//! all. Each run of recorded frames of a leaf is a blade of a few triangles. While its leaf is not recorded, a blade is a point at
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
/// Share of the blades that are seen at once; the others are leaves that have fallen or have not appeared yet.
const SEEN_AT_ONCE: f64 = 0.75;
/// Largest factor by which leaves are enlarged to replace those left out; a larger one is conspicuous.
const MOST_GROWTH: f32 = 3.0;
/// A leaf that moves farther between two shapes, as a share of the diagonal of the plant's box, is another leaf of the same
/// instance.
const LONGEST_MOVE: f32 = 0.1;

/// One leaf in one shape.
#[derive(Debug, Clone, Copy)]
struct RecordedLeaf {
    /// Index of the instancer in the asset, and of the instance in it.
    id: [u32; 2],
    /// In the space of the asset; the scale includes the enlargement.
    place: Trs,
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
    /// Per recorded frame: its leaves by rising id.
    shapes: Vec<Vec<RecordedLeaf>>,
    /// The last frame, if it is not a recorded one.
    waiting: Option<Vec<RecordedLeaf>>,
    /// Number of frames so far.
    seen: usize,
    /// Interval of the recorded frames.
    stride: usize,
    limits: Limits,
    /// Largest number of leaves that were alive at a frame, and largest enlargement.
    pub most_alive: usize,
    pub most_growth: f32,
    /// Of the scene, which the keys depend on.
    seed: u64,
}

/// The mesh of the leaves with its shapes, and the frame of each.
pub(super) struct LeafMesh {
    /// The leaves at the shape that has most of them.
    pub mesh: Mesh,
    pub shapes: Vec<MorphShape>,
    pub blades: usize,
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
            most_alive: 0,
            most_growth: 1.0,
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

    /// The leaves of the smallest keys that are alive at a frame, enlarged to cover the area of all.
    fn leaves_at(&mut self, asset: &Asset, frame: &AssetFrame, scene: &Scene) -> Vec<RecordedLeaf> {
        let mut alive: Vec<(u64, [u32; 2])> = Vec::new();
        let states: Vec<_> = (asset.instancers.iter().enumerate())
            .map(|(n, instancer)| grows(asset, instancer, scene).then(|| instance_states(asset, instancer, n, frame)))
            .collect();
        for (n, (instancer, state)) in asset.instancers.iter().zip(&states).enumerate() {
            let Some(state) = state else { continue };
            let live = (0..instancer.len()).filter(|i| state.is_alive(*i) && state.size(*i) > 0.0);
            alive.extend(live.map(|i| (mix64(&[self.seed, instancer.ids[i]]), [n, i].map(saturating_index))));
        }
        let all = alive.len();
        // The same leaves stay from shape to shape, spread over the crown: keys are hashes of their ids.
        let most = self.most_at_once();
        if all > most {
            alive.select_nth_unstable(most);
            alive.truncate(most);
        }
        alive.sort_unstable_by_key(|(_, id)| *id);
        // The area grows with the square of the size.
        let growth = math::narrow(math::sqrt(all as f64 / alive.len().max(1) as f64)).min(MOST_GROWTH);
        self.most_alive = self.most_alive.max(all);
        self.most_growth = self.most_growth.max(growth);
        let leaf = |(_, id): &(u64, [u32; 2])| {
            let [n, i] = id.map(|k| k as usize);
            let mut place = states[n].as_ref().map_or(Trs::IDENTITY, |state| asset.instancers[n].transform(state, i));
            place.s *= growth;
            RecordedLeaf { id: *id, place }
        };
        alive.iter().map(leaf).collect()
    }

    fn most_at_once(&self) -> usize {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of a count")]
        let seen = (self.limits.blades as f64 * SEEN_AT_ONCE) as usize;
        seen.max(1)
    }

    /// The mesh of all blades and its shapes, one for each of [`Self::frames`]; `None` without leaves.
    /// # Errors
    /// `Export` X005 if a blade can't be simplified.
    pub(super) fn mesh(&self, asset: &Asset, label: &str) -> Result<Option<LeafMesh>> {
        let runs = self.runs(asset);
        let Some(full) = (0..self.shapes.len()).max_by_key(|k| (self.shapes[*k].len(), *k)) else { return Ok(None) };
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
        Ok(Some(LeafMesh { mesh, shapes: (0..self.shapes.len()).map(shape).collect(), blades: runs.len() }))
    }

    /// The runs of all recorded leaves by id and first shape; of too many, those of the smallest keys.
    fn runs(&self, asset: &Asset) -> Vec<Run> {
        let places = self.shapes.iter().flatten().map(|leaf| leaf.place.t);
        let longest = LONGEST_MOVE * osier_base::geometry::Bounds::of(places).size().length();
        let mut list: Vec<([u32; 2], usize, Trs)> = (self.shapes.iter().enumerate())
            .flat_map(|(k, leaves)| leaves.iter().map(move |leaf| (leaf.id, k, leaf.place)))
            .collect();
        list.sort_unstable_by_key(|(id, k, _)| (*id, *k));
        let mut runs: Vec<Run> = Vec::new();
        for (id, k, place) in list {
            match runs.last_mut() {
                Some(run)
                    if run.id == id
                        && run.first + run.places.len() == k
                        && run.places.last().is_some_and(|last| last.t.distance(place.t) <= longest) =>
                {
                    run.places.push(place);
                }
                _ => runs.push(Run { id, first: k, places: vec![place] }),
            }
        }
        if runs.len() > self.limits.blades {
            let key = |run: &Run| {
                let [n, i] = run.id.map(|k| k as usize);
                mix64(&[self.seed, asset.instancers.get(n).and_then(|list| list.ids.get(i)).copied().unwrap_or(0)])
            };
            runs.sort_by_key(|run| (key(run), run.first));
            runs.truncate(self.limits.blades);
            runs.sort_by_key(|run| (run.id, run.first));
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
