//! Leaves of a plant that grows over the clip and has too many for a node each: meshes that morph from shape to shape.
//!
//! At evenly spaced ones of the written frames the leaves of the smallest keys among those that are alive are recorded. As many of each frame are
//! written as the budget of bytes allows, enlarged to cover the area of all. Each run of recorded frames of a leaf is a blade of
//! a few triangles. While its leaf is not recorded, a blade is a point at the place where the leaf appears or disappears. Blades
//! that appear and disappear at the same frames are a mesh, whose targets are only the shapes in which they are seen, and those
//! beside them.
//!
//! Between two shapes a blade that appears, or disappears, changes its area linearly: its size is the square root of the
//! elapsed, or remaining, share of the time. Where leaves are replaced by as many others the area of all is constant.
//!
//! ```text
//! frame of the clip   0     5     10    15    20
//! leaf 7              .     o     O     O     .      one run: shapes 1 to 3; a point before and after
//! leaf 9              O     O     .     O     O      two runs, two blades
//! ```

use glam::Vec3;

use super::options::GltfOptions;
use super::rig::rotation_angle;
use super::simplify::{BLADE_DEVIATION, area, compact, with_fewer_triangles};
use crate::merge::transform_normal;
use osier_base::Result;
use osier_base::convert::{limit, saturating_index};
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
/// Bytes of a vertex beside its position: normal, texture coordinates, indices of its triangles.
const VERTEX_BYTES: usize = 20;
/// Most shapes of a blade. Own: a mesh has a target for each shape of its run, so longer runs are divided. Between the two shapes
/// at which a run is divided one blade shrinks while the next grows; leaves are divided at different shapes.
const LONGEST_RUN: usize = 6;
/// Targets of a blade, and shapes of the clip for each blade of an instance, for estimates. Own: leaves of birches and oaks of 8 to 20
/// years over 8 to 48 frames take 0.93 to 1.12 times what follows from these numbers.
const TARGETS_OF_A_BLADE: usize = 2;
const SHAPES_PER_BLADE: u64 = 11;
/// Parts of the time between a shape in which blades are points and one in which they are leaves at which their size is that part
/// of the leaf's: the square of the part. Own: between these keys the area is at most 0.016 of the leaf's off a linear change.
const APPEARING_SIZES: [f32; 3] = [0.25, 0.5, 0.75];
/// Largest angle, rad, by which a leaf turns between two shapes, and largest ratio of its sizes, as the same blade. Own: corners
/// that move linearly shrink a blade that turns by 0.42 rad to 0.96 of its area halfway, and leaves of which half grow and half
/// shrink by 1.5 to 0.96 of theirs. Beyond, another blade replaces it.
const LARGEST_TURN: f32 = 0.42;
const LARGEST_RATIO: f32 = 1.5;
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

    /// Factor on the size of the first `most` leaves with which they have the area of all, as area grows with the square of
    /// the size; 1 to [`MOST_GROWTH`].
    fn growth(&self, most: usize) -> f32 {
        let ratio = self.alive as f64 / self.first(most).len().max(1) as f64;
        math::narrow(math::sqrt(ratio)).clamp(1.0, MOST_GROWTH)
    }
}

/// Numbers of leaves and shapes that the budget allows.
#[derive(Debug, Clone, Copy)]
struct LeafBudget {
    /// Leaves of a shape, if each were in all shapes.
    leaves: usize,
    /// Shapes besides the last one.
    shapes: usize,
    /// Bytes of a position in a target.
    position: usize,
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
    budget: LeafBudget,
    /// Of the scene, which the keys depend on.
    seed: u64,
}

/// A key between two frames of a track that shows a blend of their shapes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct MorphBlend {
    /// Index, in the track's list, of the frame before the key.
    pub after: usize,
    /// Its time as a share of the interval to the next frame of the track, within 0 and 1.
    pub time: f32,
    /// Weight of the next frame's shape; the rest is that of the shape before.
    pub weight: f32,
}

/// Blades that appear in one shape and disappear after another.
pub(super) struct LeafMesh {
    /// The blades in the shape that has most leaves; points if they are not leaves then.
    pub mesh: Mesh,
    /// Indices of the frames at which it has a shape, increasing, including the first and the last recorded one.
    pub frames: Vec<usize>,
    /// Points of the mesh, one list for each of `frames`.
    pub shapes: Vec<Vec<Vec3>>,
    /// Keys between those frames, where blades appear or disappear.
    pub blends: Vec<MorphBlend>,
}

/// The leaves of a plant as meshes that morph.
pub(super) struct LeafMeshes {
    /// By the shapes in which their blades appear and disappear.
    pub meshes: Vec<LeafMesh>,
    pub blades: usize,
    /// Largest number of leaves that are alive in a shape, and largest factor by which those written are enlarged.
    pub most_alive: usize,
    pub most_growth: f32,
}

impl LeafMeshes {
    /// How many leaves are written, and how large where that is a part of them.
    pub(super) fn words(&self, label: &str) -> String {
        let Self { meshes, blades, most_alive, most_growth } = self;
        // Up to this factor two decimals show 1.
        let enlarged = if *most_growth < 1.005 {
            String::new()
        } else {
            format!(", enlarged up to {most_growth:.2} times where not all are written")
        };
        let count = meshes.len();
        format!(
            "{label}: up to {most_alive} at once are {blades} simpler ones in {count} meshes that morph{enlarged}; USD has all of \
             every frame"
        )
    }
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
    /// Its first shape, and the number of its shapes.
    fn span(&self) -> [usize; 2] {
        [self.first, self.places.len()]
    }

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
        let written = options.written_frames(scene.clip);
        let budget = leaf_budget(written, options);
        Some(Self {
            frames: Vec::new(),
            shapes: Vec::new(),
            waiting: None,
            seen: 0,
            stride: written.saturating_sub(1).div_ceil(budget.shapes.max(1)).max(1),
            budget,
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
        let (alive, most) = (leaves.len(), self.budget.leaves);
        // The same leaves stay from shape to shape, spread over the crown: keys are hashes of their ids.
        let by_key = |leaf: &RecordedLeaf| (leaf.key, leaf.id);
        if alive > most {
            leaves.select_nth_unstable_by_key(most, by_key);
            leaves.truncate(most);
            // Shapes are held until the end of the clip, each with room for all leaves otherwise.
            leaves.shrink_to_fit();
        }
        leaves.sort_unstable_by_key(by_key);
        RecordedShape { alive, leaves }
    }

    /// The blades of all leaves; no meshes without leaves.
    /// # Errors
    /// `Export` X005 if a blade can't be simplified.
    pub(super) fn meshes(&self, asset: &Asset, label: &str) -> Result<LeafMeshes> {
        let places = self.shapes.iter().flat_map(|shape| shape.leaves.iter().map(|leaf| leaf.place.t));
        let longest = LONGEST_MOVE * osier_base::geometry::Bounds::of(places).size().length();
        let blades = simple_blades(asset, label)?;
        let vertices = |run: &Run| simple_blade(run, asset, &blades).map_or(0, |blade| blade.points.len());
        let most = self.most_at_once(longest, &vertices);
        let runs = self.runs(most, longest);
        let full = (0..self.shapes.len()).max_by_key(|k| (self.shapes[*k].alive, *k)).unwrap_or(0);
        let mut meshes = Vec::new();
        for group in runs.chunk_by(|a, b| a.span() == b.span()) {
            meshes.extend(self.group_mesh(group, full, asset, &blades));
        }
        Ok(LeafMeshes {
            meshes,
            blades: runs.len(),
            most_alive: self.shapes.get(full).map_or(0, |shape| shape.alive),
            most_growth: self.shapes.iter().map(|shape| shape.growth(most)).fold(1.0, f32::max),
        })
    }

    /// The mesh of runs of the same shapes. `full`: the shape in which it is at rest; `blades`: per instancer and prototype.
    fn group_mesh(&self, group: &[Run], full: usize, asset: &Asset, blades: &[Vec<Mesh>]) -> Option<LeafMesh> {
        let blade_of = |run: &Run| simple_blade(run, asset, blades);
        let mut mesh = Mesh::default();
        for run in group {
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
            return None;
        }
        // Before the first and after the last of these shapes all blades are points: two keys hold them until the ends of the clip.
        let ([first, count], last) = (group[0].span(), self.shapes.len() - 1);
        let end = first + count;
        let near = first.saturating_sub(1)..=end.min(last);
        let mut kept: Vec<usize> = [0, last].into_iter().chain(near.clone()).collect();
        kept.sort_unstable();
        kept.dedup();
        let points_at = |k: &usize| -> Vec<Vec3> {
            // Where all blades are points, at rest and here, it is not seen where these lie: the mesh at rest needs no target.
            if !(first..end).contains(&full) && !near.contains(k) {
                return mesh.points.clone();
            }
            let of = |run: &Run| {
                let place = run.place(*k);
                blade_of(run).into_iter().flat_map(move |blade| blade.points.iter().map(move |p| place.apply(*p)))
            };
            group.iter().flat_map(of).collect()
        };
        let shapes = kept.iter().map(points_at).collect();
        // Appearing, size^2 = t at the share t of the time; disappearing, size^2 = 1 - t.
        let index_of = |shape: usize| kept.binary_search(&shape).ok();
        let mut blends = Vec::new();
        if let Some(after) = first.checked_sub(1).and_then(index_of) {
            blends.extend(APPEARING_SIZES.map(|size| MorphBlend { after, time: size * size, weight: size }));
        }
        if let Some(after) = index_of(end - 1).filter(|_| end <= last) {
            let shrinks = |size: f32| MorphBlend { after, time: 1.0 - size * size, weight: 1.0 - size };
            blends.extend(APPEARING_SIZES.into_iter().rev().map(shrinks));
        }
        Some(LeafMesh { mesh, shapes, frames: kept.iter().map(|k| self.frames[*k]).collect(), blends })
    }

    /// The largest number of leaves in a shape with which all runs are within the budget: shapes with fewer have all of their
    /// leaves. `vertices`: number of vertices of a run's blade.
    fn most_at_once(&self, longest: f32, vertices: &dyn Fn(&Run) -> usize) -> usize {
        let (mut low, mut high) = (1, self.budget.leaves);
        // With more leaves in each shape there are more runs: bisection.
        while low < high {
            let middle = low + (high - low).div_ceil(2);
            if self.bytes(&self.runs(middle, longest), vertices) <= LEAF_BUDGET {
                low = middle;
            } else {
                high = middle - 1;
            }
        }
        low
    }

    /// Estimated bytes of the meshes of runs. `vertices`: number of vertices of a run's blade.
    fn bytes(&self, runs: &[Run], vertices: &dyn Fn(&Run) -> usize) -> usize {
        let position = self.budget.position;
        let of_group = |group: &[Run]| {
            // Besides the shapes in which they are seen, blades have one as points where they appear or disappear.
            let targets = 1 + group[0].places.len();
            group.iter().map(vertices).sum::<usize>() * (VERTEX_BYTES + position * (1 + targets))
        };
        runs.chunk_by(|a, b| a.span() == b.span()).map(of_group).sum()
    }

    /// The runs of leaves by first shape, number of shapes and id, with at most `most` leaves in each shape, which are enlarged to cover the area of
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
                let is_like = run.places.last().is_some_and(|last| keeps_its_area(last, &place, longest));
                let is_divided = (k + id[1] as usize).is_multiple_of(LONGEST_RUN);
                run.id == id && run.first + run.places.len() == k && is_like && !is_divided
            };
            match runs.last_mut().filter(goes_on) {
                Some(run) => run.places.push(place),
                None => runs.push(Run { id, first: k, places: vec![place] }),
            }
        }
        runs.sort_unstable_by_key(|run| (run.span(), run.id));
        runs
    }
}

/// Whether corners that move linearly from one place of a leaf to another keep nearly the area of a blade between them, and the
/// places are at most `longest` apart, m.
fn keeps_its_area(from: &Trs, to: &Trs, longest: f32) -> bool {
    let [a, b] = [from, to].map(|place| place.s.abs().max_element());
    from.t.distance(to.t) <= longest
        && a.max(b) <= LARGEST_RATIO * a.min(b)
        && rotation_angle(from.r, to.r) <= LARGEST_TURN
}

/// Whether the instances of an instancer are leaves that growth moves, and whose colours do not change over the clip. A plant that
/// grows has no joints, and all of its instancers are free; in the rain those of leaves with maps are free as well.
fn grows(asset: &Asset, instancer: &Instancer, scene: &Scene) -> bool {
    let is_leaf = |mesh: &Mesh| {
        let class = |s: &osier_scene::Subset| scene.materials.get(s.material as usize).map(|m| m.class);
        !mesh.subsets.is_empty() && mesh.subsets.iter().all(|s| class(s) != Some(MaterialClass::Bark))
    };
    asset.kind == AssetKind::Plant
        && asset.skeleton.is_none()
        && asset.instancers.iter().all(|i| i.motion == InstancerMotion::Free)
        && instancer.rest.attribute(LEAF_COLOR).is_none()
        && instancer.prototypes.iter().all(|p| is_leaf(&p.mesh))
}

/// The simple blade of a run. `blades`: per instancer and prototype.
fn simple_blade<'a>(run: &Run, asset: &Asset, blades: &'a [Vec<Mesh>]) -> Option<&'a Mesh> {
    let [n, i] = run.id.map(|k| k as usize);
    let proto = asset.instancers.get(n)?.protos.get(i)?;
    blades.get(n)?.get(*proto as usize)
}

/// A simple blade for each prototype of each instancer, scaled to the area of the full one.
fn simple_blades(asset: &Asset, label: &str) -> Result<Vec<Vec<Mesh>>> {
    let blade = |mesh: &Mesh| -> Result<Mesh> {
        let mut simple = compact(&with_fewer_triangles(mesh, BLADE_TRIANGLES, BLADE_DEVIATION, label)?);
        let factor = math::narrow(math::sqrt(area(mesh) / area(&simple).max(1e-12)));
        simple.points.iter_mut().for_each(|p| *p *= factor.clamp(1.0, MOST_GROWTH));
        Ok(simple)
    };
    let of_instancer = |i: &Instancer| i.prototypes.iter().map(|p| blade(&p.mesh)).collect();
    asset.instancers.iter().map(of_instancer).collect()
}

/// Numbers of leaves and shapes for so many frames.
fn leaf_budget(frames: usize, options: &GltfOptions) -> LeafBudget {
    let shapes = frames.saturating_sub(1).clamp(1, MOST_SHAPES);
    let position = options.target_position_bytes();
    LeafBudget { leaves: (LEAF_BUDGET / (BLADE_VERTICES * position * (shapes + 1))).max(1), shapes, position }
}

/// Estimated bytes of the shapes of so many growing leaves over so many frames.
pub(super) fn estimate(leaves: u64, frames: u64, options: &GltfOptions) -> u64 {
    let LeafBudget { shapes, position, .. } = leaf_budget(limit(frames), options);
    // An instance is one blade after the other, each at rest and in its targets.
    let blade = BLADE_VERTICES * (VERTEX_BYTES + position * (1 + TARGETS_OF_A_BLADE));
    let all = leaves.saturating_mul((blade * (shapes + 1)) as u64) / SHAPES_PER_BLADE;
    all.min(LEAF_BUDGET as u64)
}

#[cfg(test)]
mod tests {
    use super::super::options::Profile;
    use super::*;

    fn recorded(frames: &[&[(u32, f32)]]) -> LeafShapes {
        let leaf = |(i, x): &(u32, f32)| RecordedLeaf {
            key: u64::from(*i),
            id: [0, *i],
            place: Trs::translation(Vec3::X * *x),
        };
        let shape = |list: &&[(u32, f32)]| RecordedShape { alive: list.len(), leaves: list.iter().map(leaf).collect() };
        LeafShapes {
            frames: (0..frames.len()).collect(),
            shapes: frames.iter().map(shape).collect(),
            waiting: None,
            seen: frames.len(),
            stride: 1,
            budget: leaf_budget(frames.len(), &GltfOptions::default()),
            seed: 0,
        }
    }

    #[test]
    fn estimates_are_near_the_bytes_of_grown_trees() {
        let options = GltfOptions { quantize: true, profile: Profile::Web, ..GltfOptions::default() };
        // Instances, frames and bytes of leaves of birches of 20, 12 and 10 years and of an oak of 8, without compression.
        for (leaves, frames, bytes) in
            [(46_608, 24, 17_515_808.0), (3_845, 48, 1_721_808.0), (2_641, 8, 377_824.0), (4_099, 24, 1_533_876.0)]
        {
            let ratio = estimate(leaves, frames, &options) as f64 / bytes;
            assert!((0.85..1.15).contains(&ratio), "{leaves} leaves over {frames} frames: {ratio}");
        }
        assert_eq!(estimate(10_000_000, 24, &options), LEAF_BUDGET as u64);
    }

    #[test]
    fn enlarged_leaves_are_told_where_not_all_are_written() {
        let said =
            |most_growth: f32| LeafMeshes { meshes: Vec::new(), blades: 3, most_alive: 8, most_growth }.words("leaves");
        assert_eq!(
            said(1.0),
            "leaves: up to 8 at once are 3 simpler ones in 0 meshes that morph; USD has all of every frame"
        );
        assert!(said(1.63).contains("that morph, enlarged up to 1.63 times where not all are written; USD"));
    }

    #[test]
    fn a_leaf_that_pauses_or_jumps_begins_another_run() {
        // Leaf 3 pauses in shape 2, leaf 5 jumps to another place after shape 1.
        let shapes = recorded(&[&[(3, 0.0)], &[(3, 0.1), (5, 7.0)], &[(5, 2.0)], &[(3, 0.2), (5, 2.1)]]);
        let runs = shapes.runs(10, 1.0);
        let list: Vec<([u32; 2], usize, usize)> = runs.iter().map(|r| (r.id, r.first, r.places.len())).collect();
        assert_eq!(list, [([0, 3], 0, 2), ([0, 5], 1, 1), ([0, 5], 2, 2), ([0, 3], 3, 1)]);
        // Outside of its shapes it is a point where it appeared or disappeared.
        let late = &runs[2];
        assert_eq!((late.place(0).t, late.place(0).s), (Vec3::X * 2.0, Vec3::ZERO));
        assert_eq!((late.place(3).t, late.place(3).s), (Vec3::X * 2.1, Vec3::ONE));
        assert_eq!(runs[1].place(3).s, Vec3::ZERO);
    }

    #[test]
    fn a_leaf_that_turns_or_grows_much_is_another_blade() {
        let at =
            |turn: f32, size: f32| Trs { t: Vec3::ZERO, r: glam::Quat::from_rotation_y(turn), s: Vec3::splat(size) };
        let keeps = |turn: f32, size: f32| {
            let both = [[at(0.0, 1.0), at(turn, size)], [at(turn, size), at(0.0, 1.0)]];
            both.map(|[from, to]| keeps_its_area(&from, &to, 1.0))
        };
        assert_eq!(keeps(0.4, 1.4), [true; 2]);
        assert_eq!([keeps(0.5, 1.0), keeps(-0.5, 1.0), keeps(0.0, 1.6), keeps(0.0, 0.6)], [[false; 2]; 4]);
    }

    #[test]
    fn long_runs_are_divided_and_few_leaves_cover_the_area_of_all() {
        let many: Vec<(u32, f32)> = (0..16).map(|i| (i, 0.0)).collect();
        let shapes = recorded(&[&many[..]; 8]);
        // Of 16 leaves the four of the smallest keys, of twice the size.
        let runs = shapes.runs(4, 1.0);
        assert!(runs.iter().all(|r| r.id[1] < 4 && r.places.iter().all(|p| p.s == Vec3::splat(2.0))));
        let lengths: Vec<usize> = runs.iter().map(|r| r.places.len()).collect();
        assert_eq!(lengths, [3, 4, 5, LONGEST_RUN, 5, 4, 3, 2], "each leaf is divided at other shapes");
        assert_eq!(shapes.shapes[0].growth(16).to_bits(), 1.0_f32.to_bits());
    }
}
