//! Levels of detail of a plant: wood simplified by edge collapse, leaves by simpler blades, then by fewer and larger ones.
//!
//! A level holds wood and leaves as one mesh, so that an engine draws it in one call for each material.

use glam::{Vec2, Vec3};

use crate::gltf::blades::{seen_area, simpler_blade};
use crate::gltf::meshes::SkinInfluences;
use crate::gltf::rig::JointSelection;
use crate::gltf::simplify::{
    BLADE_DEVIATION, area, index_in, padded, share_of, triangle_area, vertices_of, with_fewer_triangles,
};
use crate::gltf::wind_channels::{VertexWind, number_of_id, wind_of_mesh};
use crate::merge::transform_normal;
use osier_base::Result;
use osier_base::math::{narrow, sqrt};
use osier_base::neighbours::NeighbourGrid;
use osier_base::par::par_map;
use osier_base::rng::mix64;
use osier_scene::{Asset, Instancer, InstancerMotion, MaterialId, Mesh, MeshMotion, MeshObject, Trs, bent_normal};

/// Constants of the levels, guessed or measured.
mod tuning {
    /// Edge of the cells of the neighbour grid of wood, m: about the distance between vertices of a twig.
    pub(super) const WOOD_CELL: f32 = 0.1;
    /// Largest distance from a leaf at which the wood that carries it is searched, m.
    pub(super) const WOOD_REACH: f32 = 3.0;
    /// Smallest and largest share of the triangles of a level for wood. Without a minimum, bare limbs would lose their shape;
    /// without a maximum, a crown of many fine twigs would lose its leaves.
    pub(super) const WOOD_SHARE: [f64; 2] = [0.25, 0.5];
    /// Largest deviation of simplified wood as a share of the plant's size. It is seldom reached: the number of triangles
    /// decides.
    pub(super) const WOOD_DEVIATION: f32 = 0.05;
    /// Fewest triangles of a simplified blade: two form a quadrilateral.
    pub(super) const LEAST_BLADE: usize = 2;
    /// Largest factor by which leaves are enlarged to replace those left out; a larger one is conspicuous.
    pub(super) const MOST_GROWTH: f32 = 8.0;
}

/// A plant at one level of detail, in the space of its asset.
#[derive(Debug, Default)]
pub(super) struct PlantLevel {
    /// Wood and leaves, a subset for each material.
    pub mesh: Mesh,
    /// Joints of the vertices; empty for a plant without joints.
    pub joints: Vec<[u16; 4]>,
    pub weights: Vec<[f32; 4]>,
    /// Parameters of the wind for each vertex, in the order of the points of `mesh`.
    pub wind: Vec<VertexWind>,
    /// Size of the leaves relative to those of the plant, above 1 if fewer leaves cover the area of all; 0 without leaves.
    pub leaf_size: f32,
}

/// A mesh to append to a level, and its transform to the space of the asset.
struct Piece<'a> {
    mesh: &'a Mesh,
    place: Trs,
    /// Vector that normals are bent by, see [`bent_normal`]; zero leaves them unchanged.
    toward: Vec3,
    wind: &'a [VertexWind],
}

impl PlantLevel {
    /// Appends the vertices and triangles of a piece; the caller has appended the joints and weights of its vertices.
    fn add(&mut self, piece: &Piece<'_>) {
        let Piece { mesh, place, toward, wind } = piece;
        let moved = Mesh {
            points: mesh.points.iter().map(|p| place.apply(*p)).collect(),
            normals: mesh.normals.iter().map(|n| bent_normal(transform_normal(place, *n), *toward)).collect(),
            uvs: padded(&mesh.uvs, mesh.points.len(), Vec2::ZERO),
            colors: padded(&mesh.colors, mesh.points.len(), [1.0; 4]),
            attributes: Vec::new(),
            triangles: mesh.triangles.clone(),
            subsets: mesh.subsets.clone(),
        };
        self.mesh.append(&moved);
        self.wind.extend_from_slice(wind);
    }

    /// Joins the subsets of a material, so that it is drawn once.
    fn join_subsets(&mut self) {
        self.mesh.join_subsets();
        // White vertices are the default and need no colours.
        if self.mesh.colors.as_flattened().iter().all(|c| c.to_bits() == 1.0_f32.to_bits()) {
            self.mesh.colors.clear();
        }
    }

    /// The influences for a skin of `count` joints; `None` for a plant without joints.
    pub(super) fn influences(&self, count: usize) -> Option<SkinInfluences> {
        (!self.joints.is_empty()).then(|| SkinInfluences {
            joints: self.joints.clone(),
            weights: self.weights.clone(),
            count,
        })
    }
}

/// Leaves that are thinned out together.
enum LeafGroup<'a> {
    /// Instances of prototypes, each on a joint where the plant has joints.
    Instances { instancer: &'a Instancer, members: Vec<usize> },
    /// A mesh that holds all leaves, one after the other.
    Merged { object: &'a MeshObject, leaves: Vec<MergedLeaf>, wind: Vec<VertexWind> },
}

/// The triangles of one leaf of a mesh, with their materials.
#[derive(Debug, Default)]
struct MergedLeaf {
    triangles: Vec<(MaterialId, [u32; 3])>,
}

impl LeafGroup<'_> {
    fn triangles(&self) -> usize {
        match self {
            Self::Instances { instancer, members } => {
                let of = |i: &usize| instancer.prototypes.get(instancer.protos[*i] as usize);
                members.iter().filter_map(of).map(|p| p.mesh.triangles.len()).sum()
            }
            Self::Merged { leaves, .. } => leaves.iter().map(|l| l.triangles.len()).sum(),
        }
    }
}

impl MergedLeaf {
    /// Indices of the leaf's vertices in the mesh that holds it, increasing, each once.
    fn vertices(&self) -> Vec<u32> {
        let mut used: Vec<u32> = self.triangles.iter().flat_map(|(_, t)| *t).collect();
        used.sort_unstable();
        used.dedup();
        used
    }

    /// Extracts the leaf from `all`, the mesh that holds it; vertices are in the order of [`Self::vertices`].
    fn mesh(&self, all: &Mesh) -> Mesh {
        let used = self.vertices();
        let mut leaf = vertices_of(all, &used);
        for run in self.triangles.chunk_by(|a, b| a.0 == b.0) {
            let own = run.iter().map(|(_, t)| t.map(|i| index_in(&used, i))).collect();
            leaf.append_subset(run[0].0, own);
        }
        leaf
    }
}

/// A plant sorted into wood and leaves, from which levels of any number of triangles are made.
pub(super) struct PlantSource<'a> {
    selection: Option<&'a JointSelection>,
    wood: Vec<&'a MeshObject>,
    leaves: Vec<LeafGroup<'a>>,
    /// Positions and wind of those vertices of wood that sway; leaves sway with the nearest of them.
    wood_wind: Vec<(Vec3, VertexWind)>,
    wood_grid: NeighbourGrid,
    /// Asset and element, for errors.
    label: &'a str,
}

impl<'a> PlantSource<'a> {
    /// Sorts the parts of a plant into wood and leaves. `selection`: the joints that are written, for a plant that moves;
    /// `label`: asset and element, for errors.
    pub(super) fn new(asset: &'a Asset, selection: Option<&'a JointSelection>, label: &'a str) -> Self {
        let mut source = Self {
            selection,
            wood: Vec::new(),
            leaves: Vec::new(),
            wood_wind: Vec::new(),
            wood_grid: NeighbourGrid::default(),
            label,
        };
        for object in asset.meshes.iter().filter(|o| is_merged(o)) {
            let wind = wind_of_mesh(&object.mesh);
            // Only leaves flutter, which distinguishes a mesh of merged leaves from wood.
            if wind.iter().any(|w| w.flutter > 0.0) {
                let leaves = merged_leaves(&object.mesh, &wind);
                source.leaves.push(LeafGroup::Merged { object, leaves, wind });
            } else {
                let swaying = object.mesh.points.iter().copied().zip(wind);
                source.wood_wind.extend(swaying.filter(|(_, w)| *w != VertexWind::STILL));
                source.wood.push(object);
            }
        }
        let places = (0..).zip(source.wood_wind.iter().map(|w| w.0));
        source.wood_grid = NeighbourGrid::new(tuning::WOOD_CELL, places);
        for instancer in asset.instancers.iter().filter(|i| i.motion != InstancerMotion::Free) {
            let members = (0..instancer.len()).filter(|i| instancer.rest.is_alive(*i)).collect();
            source.leaves.push(LeafGroup::Instances { instancer, members });
        }
        source
    }

    /// Up to four written joints that move a vertex, and their weights; the root if the mesh has no skin.
    fn influence(&self, object: &MeshObject, vertex: usize) -> ([u16; 4], [f32; 4]) {
        match (self.selection, &object.skin) {
            (Some(selection), Some(skin)) => match (skin.joints.get(vertex), skin.weights.get(vertex)) {
                (Some(j), Some(w)) => selection.merge_influences(*j, *w),
                _ => ROOT,
            },
            _ => ROOT,
        }
    }

    /// Number of triangles without simplification.
    pub(super) fn triangles(&self) -> usize {
        self.wood_triangles() + self.leaves.iter().map(LeafGroup::triangles).sum::<usize>()
    }

    fn wood_triangles(&self) -> usize {
        self.wood.iter().map(|o| o.mesh.triangles.len()).sum()
    }

    /// The plant with at most about `budget` triangles.
    /// # Errors
    /// X005 if a part cannot be simplified.
    pub(super) fn level(&self, budget: usize) -> Result<PlantLevel> {
        let mut level = PlantLevel::default();
        let (wood, leaves) = self.shares(budget);
        for object in &self.wood {
            let share = share_of(wood, object.mesh.triangles.len(), self.wood_triangles());
            self.add_wood(&mut level, object, share)?;
        }
        let all: usize = self.leaves.iter().map(LeafGroup::triangles).sum();
        for group in &self.leaves {
            self.add_leaves(&mut level, group, share_of(leaves, group.triangles(), all))?;
        }
        level.join_subsets();
        Ok(level)
    }

    /// Triangles of wood and of leaves within a budget for both: all if they fit, else in proportion, with wood
    /// clamped to [`tuning::WOOD_SHARE`].
    fn shares(&self, budget: usize) -> (usize, usize) {
        let (wood, all) = (self.wood_triangles(), self.triangles());
        let leaves = all - wood;
        if all <= budget {
            return (wood, leaves);
        }
        if leaves == 0 || wood == 0 {
            return (budget.min(wood), budget.min(leaves));
        }
        let [least, most] = tuning::WOOD_SHARE.map(|s| share_of(budget, to_count(s * 1e6), 1_000_000));
        let own = share_of(budget, wood, all).clamp(least, most).min(wood);
        // Triangles that the wood does not use go to the leaves.
        let for_leaves = (budget - own).min(leaves);
        ((budget - for_leaves).min(wood), for_leaves)
    }

    fn add_wood(&self, level: &mut PlantLevel, object: &MeshObject, budget: usize) -> Result<()> {
        let mesh = &object.mesh;
        let simple = with_fewer_triangles(mesh, budget, tuning::WOOD_DEVIATION, self.label)?;
        self.add_object_influences(level, object, 0..mesh.points.len());
        level.add(&Piece { mesh: &simple, place: Trs::IDENTITY, toward: Vec3::ZERO, wind: &wind_of_mesh(mesh) });
        Ok(())
    }

    fn add_object_influences(
        &self,
        level: &mut PlantLevel,
        object: &MeshObject,
        vertices: impl Iterator<Item = usize>,
    ) {
        if self.selection.is_some() {
            let (joints, weights): (Vec<_>, Vec<_>) = vertices.map(|i| self.influence(object, i)).unzip();
            level.joints.extend(joints);
            level.weights.extend(weights);
        }
    }

    fn add_leaves(&self, level: &mut PlantLevel, group: &LeafGroup<'_>, budget: usize) -> Result<()> {
        match group {
            LeafGroup::Instances { instancer, members } => self.add_instances(level, instancer, members, budget),
            LeafGroup::Merged { object, leaves, wind } => self.add_merged_leaves(level, object, leaves, wind, budget),
        }
    }

    /// Adds instances with simpler blades; if these exceed the budget, fewer instances, enlarged to cover the same area.
    fn add_instances(
        &self,
        level: &mut PlantLevel,
        instancer: &Instancer,
        members: &[usize],
        budget: usize,
    ) -> Result<()> {
        // Triangles that the budget leaves for each blade.
        let for_each = (budget / members.len().max(1)).max(tuning::LEAST_BLADE);
        let simple = |mesh: &Mesh| simpler_blade(mesh, for_each, self.label);
        let blades: Vec<Mesh> = instancer.prototypes.iter().map(|p| simple(&p.mesh)).collect::<Result<_>>()?;
        let proto = |i: usize| instancer.protos.get(i).map_or(0, |p| *p as usize);
        let of = |list: &dyn Fn(usize) -> f64| members.iter().map(|i| list(proto(*i))).sum::<f64>();
        let areas: Vec<f64> = instancer.prototypes.iter().map(|p| seen_area(&p.mesh)).collect();
        let simple_areas: Vec<f64> = blades.iter().map(seen_area).collect();
        let at = |list: &[f64], p: usize| list.get(p).copied().unwrap_or(0.0);
        // Leaf area of the full crown, m^2, and triangles of all simpler blades. As many instances are kept as fit, nested from
        // level to level, and enlarged until they cover the full area.
        let wanted = of(&|p| at(&areas, p));
        let triangles = of(&|p| blades.get(p).map_or(0.0, |b| to_float(b.triangles.len())));
        let fits = to_count(to_float(members.len()) * (to_float(budget) / triangles.max(1.0)).min(1.0)).max(1);
        let keys: Vec<u64> = members.iter().map(|i| instancer.ids.get(*i).copied().unwrap_or(0)).collect();
        let kept: Vec<usize> = fewest_keys(&keys, fits).into_iter().map(|k| members[k]).collect();
        let covered: f64 = kept.iter().map(|i| at(&simple_areas, proto(*i))).sum();
        let growth = growth_for(wanted, covered);
        level.leaf_size = level.leaf_size.max(growth);
        for i in kept {
            let Some(mesh) = blades.get(proto(i)) else { continue };
            let mut place = instancer.transform(&instancer.rest, i);
            place.s *= growth;
            let joint = self.instance_joint(instancer, i);
            let light = 1.0 - instancer.rest.canopy_occlusion(i);
            let wind = self.leaf_wind(mesh, &place, instancer.ids.get(i).copied().unwrap_or(0), light);
            if self.selection.is_some() {
                level.joints.extend(mesh.points.iter().map(|_| [joint, 0, 0, 0]));
                level.weights.extend(mesh.points.iter().map(|_| ROOT.1));
            }
            let toward = instancer.rest.canopy_normal(i);
            level.add(&Piece { mesh, place, toward, wind: &wind });
        }
        Ok(())
    }

    /// Adds the leaves of a merged mesh: simpler blades, then fewer and larger ones as in [`Self::add_instances`].
    fn add_merged_leaves(
        &self,
        level: &mut PlantLevel,
        object: &MeshObject,
        leaves: &[MergedLeaf],
        wind: &[VertexWind],
        budget: usize,
    ) -> Result<()> {
        let for_each = (budget / leaves.len().max(1)).max(tuning::LEAST_BLADE);
        let simple = |leaf: &MergedLeaf| {
            let mesh = leaf.mesh(&object.mesh);
            with_fewer_triangles(&mesh, for_each, BLADE_DEVIATION, self.label)
        };
        let simple: Vec<Mesh> = par_map(leaves, simple).into_iter().collect::<Result<_>>()?;
        let triangles: usize = simple.iter().map(|m| m.triangles.len()).sum();
        let fits = share_of(leaves.len(), budget, triangles).clamp(1, leaves.len().max(1));
        let keys: Vec<u64> = (0..leaves.len() as u64).collect();
        let kept = fewest_keys(&keys, fits);
        let area_of =
            |leaf: &MergedLeaf| leaf.triangles.iter().map(|(_, t)| triangle_area(&object.mesh, t)).sum::<f64>();
        let growth = growth_for(leaves.iter().map(area_of).sum(), kept.iter().map(|k| area(&simple[*k])).sum());
        level.leaf_size = level.leaf_size.max(growth);
        for k in kept {
            let used = leaves[k].vertices();
            let winds: Vec<VertexWind> = used.iter().filter_map(|i| wind.get(*i as usize)).copied().collect();
            let mut leaf = simple[k].clone();
            // A leaf grows from its foot, which flutters least.
            let foot = (0..winds.len()).min_by(|a, b| winds[*a].flutter.total_cmp(&winds[*b].flutter)).unwrap_or(0);
            let foot = leaf.points.get(foot).copied().unwrap_or_default();
            leaf.points.iter_mut().for_each(|p| *p = foot + (*p - foot) * growth);
            self.add_object_influences(level, object, used.iter().map(|i| *i as usize));
            level.add(&Piece { mesh: &leaf, place: Trs::IDENTITY, toward: Vec3::ZERO, wind: &winds });
        }
        Ok(())
    }

    /// Index of the written joint that carries an instance; 0, the root, if none does.
    fn instance_joint(&self, instancer: &Instancer, i: usize) -> u16 {
        let InstancerMotion::Joints(joints) = &instancer.motion else { return 0 };
        let carrier = |s: &JointSelection| s.carrier.get(usize::from(*joints.get(i)?)).copied();
        self.selection.and_then(carrier).unwrap_or(0)
    }

    /// Wind of a leaf's vertices: the values of the wood nearest to its foot, and flutter from 0 at the foot to 1 at the tip.
    fn leaf_wind(&self, mesh: &Mesh, place: &Trs, id: u64, light: f32) -> Vec<VertexWind> {
        let of = |i: u32| self.wood_wind[i as usize];
        let nearest = self.wood_grid.nearest(place.t, tuning::WOOD_REACH, |i| of(i).0);
        let base = nearest.map_or(VertexWind::STILL, |i| of(i).1);
        let tip = mesh.points.iter().fold(1e-9_f32, |m, p| m.max(p.y));
        let at = |p: &Vec3| VertexWind { flutter: (p.y / tip).clamp(0.0, 1.0), id: number_of_id(id), light, ..base };
        mesh.points.iter().map(at).collect()
    }
}

/// Joints and weights of a vertex that no joint moves: the root with weight 1.
const ROOT: ([u16; 4], [f32; 4]) = ([0; 4], [1.0, 0.0, 0.0, 0.0]);

/// Whether a mesh of a plant is part of its levels of detail; meshes that deform or vary are written unchanged beside them.
pub(super) fn is_merged(object: &MeshObject) -> bool {
    !object.mesh.triangles.is_empty()
        && (matches!(object.motion, MeshMotion::Still | MeshMotion::Skinned)
            || (object.motion == MeshMotion::Deforming && object.skin.is_some()))
}

#[allow(clippy::cast_precision_loss, reason = "counts of triangles and leaves are far below 2^52")]
pub(super) fn to_float(n: usize) -> f64 {
    n as f64
}

#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "never negative, and below the number of leaves"
)]
fn to_count(x: f64) -> usize {
    x as usize
}

/// Factor for the size of leaves of area `covered` to replace an area `wanted`, from 1 to [`tuning::MOST_GROWTH`].
fn growth_for(wanted: f64, covered: f64) -> f32 {
    // Area grows with the square of the size.
    let ratio = if covered > 0.0 { sqrt(wanted / covered) } else { 1.0 };
    narrow(ratio).clamp(1.0, tuning::MOST_GROWTH)
}

/// Indices of the `count` keys with the smallest hashes, increasing: the same leaves stay from level to level, spread over the
/// crown.
fn fewest_keys(keys: &[u64], count: usize) -> Vec<usize> {
    let mut order: Vec<(u64, usize)> = keys.iter().enumerate().map(|(i, k)| (mix64(&[*k]), i)).collect();
    order.sort_unstable();
    order.truncate(count);
    let mut kept: Vec<usize> = order.into_iter().map(|(_, i)| i).collect();
    kept.sort_unstable();
    kept
}

/// Splits a mesh that holds leaves one after the other. The vertices of a leaf share a random number; where it
/// changes, the next leaf begins.
fn merged_leaves(mesh: &Mesh, wind: &[VertexWind]) -> Vec<MergedLeaf> {
    let mut leaf_of: Vec<usize> = Vec::with_capacity(wind.len());
    for (i, w) in wind.iter().enumerate() {
        // A change of the random number begins the next leaf.
        let last = leaf_of.last().copied().unwrap_or(0);
        let begins = i > 0 && wind[i - 1].id.to_bits() != w.id.to_bits();
        leaf_of.push(last + usize::from(begins));
    }
    let mut leaves: Vec<MergedLeaf> = Vec::new();
    leaves.resize_with(leaf_of.last().map_or(0, |n| n + 1), MergedLeaf::default);
    for s in &mesh.subsets {
        for t in mesh.subset_triangles(s) {
            let leaf = leaf_of.get(t[0] as usize).and_then(|n| leaves.get_mut(*n));
            leaf.into_iter().for_each(|l| l.triangles.push((s.material, *t)));
        }
    }
    leaves
}
