//! Sizes of scenes, from which formats estimate the bytes they will write.
//!
//! ```
//! use osier_export::estimate::MergedSize;
//! use osier_export::registry::by_word;
//!
//! let empty = MergedSize::default();
//! assert_eq!((empty.vertices, empty.triangles), (0, 0));
//! assert!(by_word("obj").is_some());
//! ```

use std::collections::BTreeSet;

use osier_scene::{Asset, InstancerMotion, MapSequence, Material, MeshMotion, Scene};

use super::options::ExportOptions;

/// What an estimate is made from.
#[derive(Debug, Clone, Copy)]
pub struct EstimateInput<'a> {
    /// The scene; in a plan, one individual stands for many.
    pub scene: &'a Scene,
    /// Sizes of its assets, in order.
    pub assets: &'a [AssetSize],
    /// Frames that are written; 0 for a still scene.
    pub frames: u64,
    /// Bytes of all textures as PNG.
    pub pictures: u64,
    /// Options of the formats.
    pub options: &'a ExportOptions,
    /// A single file with the whole scene at rest, instead of a bake.
    pub single: bool,
}

impl EstimateInput<'_> {
    /// Sum over the assets, each counted as often as it stands for others.
    pub fn per_asset(&self, bytes: impl Fn(&AssetSize) -> u64) -> u64 {
        self.assets.iter().map(|a| a.weight * bytes(a)).sum()
    }

    /// Texels of one map of every map sequence.
    pub fn map_texels(&self) -> u64 {
        self.scene.map_sequences.iter().map(|s| s.texels() as u64).sum()
    }

    /// Texels of one map of every map sequence that shows the relief of its material beside the water.
    pub fn relief_texels(&self) -> u64 {
        let has_relief = |i: usize| {
            let shows = |m: &Material| m.maps.height.is_some() && m.coat.is_some_and(|c| c.sequence as usize == i);
            self.scene.materials.iter().any(shows)
        };
        let sequences = self.scene.map_sequences.iter().enumerate();
        sequences.filter(|(i, _)| has_relief(*i)).map(|(_, s)| s.texels() as u64).sum()
    }

    /// Numbers in all maps of every map sequence at one frame.
    pub fn map_samples(&self) -> u64 {
        // Normals have three channels, heights and weights one: numbers, not texels, decide on the bytes.
        let channels = |s: &MapSequence| s.layers.iter().map(|l| l.encoding.channels() as u64).sum::<u64>();
        self.scene.map_sequences.iter().map(|s| s.texels() as u64 * channels(s)).sum()
    }
}

/// Counts of the elements of an asset.
#[derive(Debug, Clone, Default)]
pub struct AssetSize {
    /// Assets that this one stands for, itself included.
    pub weight: u64,
    /// Vertices of its meshes.
    pub vertices: u64,
    /// Triangles of its meshes.
    pub triangles: u64,
    /// Vertices of meshes whose frames carry points.
    pub deforming_vertices: u64,
    /// Vertices of meshes that frames carry whole, in a typical frame.
    pub varying_vertices: u64,
    /// Vertices that move, by joints or with points of their own.
    pub moving_vertices: u64,
    /// Instances of its instancers.
    pub instances: u64,
    /// Instances that frames carry one by one.
    pub free_instances: u64,
    /// Vertices of all instances, each counted.
    pub instance_vertices: u64,
    /// Triangles of all instances, each counted.
    pub instance_triangles: u64,
    /// Vertices of prototypes, counted once.
    pub prototype_vertices: u64,
    /// Triangles of prototypes, counted once.
    pub prototype_triangles: u64,
    /// Points of its clouds.
    pub points: u64,
    /// Points of clouds that move.
    pub moving_points: u64,
    /// Points of curves that move.
    pub moving_curve_points: u64,
    /// Joints of its skeleton.
    pub joints: u64,
    /// Different times of the clip at which placements show it, at least 1.
    pub phases: u64,
    /// Placements that stand still and share its meshes, at least 1.
    pub still_copies: u64,
}

impl AssetSize {
    /// Counts an asset that stands for itself alone.
    pub fn of(asset: &Asset) -> Self {
        let mut size = Self {
            weight: 1,
            joints: asset.skeleton.as_ref().map_or(0, |k| k.joints.len() as u64),
            phases: 1,
            still_copies: 1,
            ..Self::default()
        };
        // Meshes count as moving by joints, by points of their frames (deforming), or both.
        for object in &asset.meshes {
            let vertices = object.mesh.points.len() as u64;
            size.vertices += vertices;
            size.triangles += object.mesh.triangles.len() as u64;
            size.moving_vertices += if object.motion == MeshMotion::Still { 0 } else { vertices };
            size.varying_vertices += if object.motion == MeshMotion::Varying { vertices } else { 0 };
            size.deforming_vertices += if object.motion == MeshMotion::Deforming { vertices } else { 0 };
        }
        for cloud in &asset.points {
            let points = cloud.positions.len() as u64;
            size.points += points;
            size.moving_points += if cloud.moving { points } else { 0 };
        }
        size.moving_curve_points = asset.curves.iter().filter(|c| c.moving).map(|c| c.points.len() as u64).sum();
        // Formats with instancing write prototypes once, the others write the geometry of every instance: both are counted.
        for instancer in &asset.instancers {
            let sizes: Vec<(u64, u64)> = instancer
                .prototypes
                .iter()
                .map(|p| (p.mesh.points.len() as u64, p.mesh.triangles.len() as u64))
                .collect();
            let instances = instancer.len() as u64;
            size.instances += instances;
            size.free_instances += if instancer.motion == InstancerMotion::Free { instances } else { 0 };
            size.prototype_vertices += sizes.iter().map(|p| p.0).sum::<u64>();
            size.prototype_triangles += sizes.iter().map(|p| p.1).sum::<u64>();
            for prototype in &instancer.protos {
                let (vertices, triangles) = sizes.get(*prototype as usize).copied().unwrap_or_default();
                size.instance_vertices += vertices;
                size.instance_triangles += triangles;
            }
        }
        size
    }

    /// Counts all assets of a scene of which `frames` frames are written (0: still).
    /// `weights`: how many assets each of the first stands for, itself included; 1 for the others.
    pub fn of_scene(scene: &Scene, frames: u64, weights: &[u64]) -> Vec<Self> {
        // For each asset the phases at which placements show it, and the number of placements.
        let mut shown: Vec<(BTreeSet<u32>, u64)> = vec![Default::default(); scene.assets.len()];
        for placement in &scene.placements {
            if let Some((phases, copies)) = shown.get_mut(placement.asset) {
                phases.insert(placement.phase);
                *copies += 1;
            }
        }
        let size = |(i, (asset, (phases, copies))): (usize, (&Asset, (BTreeSet<u32>, u64)))| {
            let weight = weights.get(i).copied().unwrap_or(1);
            // Copies that stand still share meshes; in a plan they are those of all individuals that this one stands for.
            let still_copies = if asset.moves() && frames > 0 { 1 } else { copies.div_ceil(weight.max(1)).max(1) };
            Self { weight, phases: phases.len().max(1) as u64, still_copies, ..Self::of(asset) }
        };
        scene.assets.iter().zip(shown).enumerate().map(size).collect()
    }

    /// Frames that change the asset's joints, of `frames`.
    pub fn posed_frames(&self, frames: u64) -> u64 {
        if self.joints > 0 { frames } else { 0 }
    }
}

/// Counts of a scene as one mesh with its instances merged in.
#[derive(Debug, Default)]
pub struct MergedSize {
    /// Vertices of all placements, each instance counted.
    pub vertices: u64,
    /// Triangles of all placements, each instance counted.
    pub triangles: u64,
    /// Vertices of assets that have texture coordinates in some mesh.
    pub mapped_vertices: u64,
    /// Points of the clouds of all placements.
    pub points: u64,
}

impl MergedSize {
    /// Counts all placements.
    pub fn of(scene: &Scene) -> Self {
        let each: Vec<Self> = scene.assets.iter().map(Self::of_asset).collect();
        let mut all = Self::default();
        for one in scene.placements.iter().filter_map(|p| each.get(p.asset)) {
            all.vertices += one.vertices;
            all.triangles += one.triangles;
            all.mapped_vertices += one.mapped_vertices;
            all.points += one.points;
        }
        all
    }

    /// Counts an asset without its placements.
    pub fn of_asset(asset: &Asset) -> Self {
        let mut all = Self { points: asset.points.iter().map(|p| p.positions.len() as u64).sum(), ..Self::default() };
        let mut mapped = false;
        // Each instance contributes its prototype's mesh once, as formats without instancing write it.
        let instances = asset
            .instancers
            .iter()
            .flat_map(|i| i.protos.iter().filter_map(|p| i.prototypes.get(*p as usize)).map(|p| &p.mesh));
        for mesh in asset.meshes.iter().map(|m| &m.mesh).chain(instances) {
            all.vertices += mesh.points.len() as u64;
            all.triangles += mesh.triangles.len() as u64;
            mapped |= !mesh.uvs.is_empty();
        }
        // If one mesh has coordinates, the merged mesh has them at all vertices, zero elsewhere.
        all.mapped_vertices = if mapped { all.vertices } else { 0 };
        all
    }
}
