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
use std::fmt::Debug;

use osier_base::par::par_map;
use osier_scene::{Asset, AssetFrame, InstancerMotion, Material, MeshMotion, Scene, instance_states};

use super::options::ExportOptions;

/// Input of [`FormatInfo::estimate`](super::format::FormatInfo::estimate), the same for all formats of a bake.
#[derive(Debug, Clone, Copy)]
pub struct EstimateInput<'a> {
    /// The scene to write. In a plan, one individual may represent many, see [`AssetSize::weight`].
    pub scene: &'a Scene,
    /// Sizes of the scene's assets, one for each in the order of the scene.
    pub assets: &'a [AssetSize],
    /// Number of frames that are written, which may be fewer than the clip has; 0 for a still scene.
    pub frames: u64,
    /// Mean speed of the wind that leaves flutter in, m/s; drops that shake leaves count as a wind.
    pub wind_speed: f64,
    /// Estimated bytes of all images of the scene, each counted once as a PNG file.
    pub pictures: u64,
    /// Estimated bytes of the height maps of all materials as half floats.
    pub heights: u64,
    /// Options of all formats; the estimate of a format reads only those of the format.
    pub options: &'a ExportOptions,
    /// Whether the output is a single file with the whole scene at rest, instead of a bake.
    pub single: bool,
    /// Frames of the assets that grow, if any does.
    pub growth: Option<&'a dyn GrowthFrames>,
}

/// Source of the frames of assets that grow over the clip, for formats that leave out what interpolation restores.
pub trait GrowthFrames: Debug + Sync {
    /// State of an asset at one of the written frames, counted from 0; `None` for an asset that does not grow.
    fn frame(&self, asset: usize, nth: u64) -> Option<AssetFrame>;
}

/// Shift of the sample positions from one plant to the next, as a share of the clip. Own: the golden section spreads
/// them evenly.
const NEXT_PLANT_SHIFT: f64 = 0.618;

/// Position in the clip, 0 to below 1, of sample `k` of `count` of a growing plant: the middle of the k-th of equal
/// intervals, shifted from plant to plant, so that the samples of many plants cover the clip.
pub(crate) fn sample_place(plant: usize, k: usize, count: usize) -> f64 {
    ((k as f64 + 0.5) / count as f64 + plant as f64 * NEXT_PLANT_SHIFT).fract()
}

/// Most frames of the clip at which the instances of a growing plant are counted. Own: the mean of five is within a tenth
/// of that of all frames.
const GROWTH_FRAMES: usize = 5;
/// Most frames at which instances are counted for all plants together, though at least one per plant.
const GROWTH_FRAMES_OF_ALL: usize = 24;

/// Index of the frame at a position in the clip, 0 to below 1.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "not negative, below the number of frames")]
fn frame_at(place: f64, frames: u64) -> u64 {
    (place * frames as f64) as u64
}

/// Number of freely moving instances that an asset shows in a frame.
fn shown_instances(asset: &Asset, frame: &AssetFrame) -> u64 {
    let free = asset.instancers.iter().enumerate().filter(|(_, instancer)| instancer.motion == InstancerMotion::Free);
    let shown = free.map(|(i, instancer)| {
        let state = instance_states(asset, instancer, i, frame);
        (0..instancer.len()).filter(|k| state.is_alive(*k)).count() as u64
    });
    shown.sum()
}

impl EstimateInput<'_> {
    /// For each asset the mean number of freely moving instances that its frames show; `None` for an asset that does not grow.
    pub(crate) fn instances_of_growth(&self) -> Vec<Option<u64>> {
        let mut means = vec![None; self.assets.len()];
        let Some(source) = self.growth.filter(|_| self.frames > 0) else { return means };
        let growing: Vec<usize> = (0..self.assets.len()).filter(|i| self.assets[*i].deforms()).collect();
        let count = (GROWTH_FRAMES_OF_ALL / growing.len().max(1)).clamp(1, GROWTH_FRAMES);
        let jobs: Vec<usize> = (0..growing.len() * count).collect();
        let found = par_map(&jobs, |job| {
            let (plant, k) = (job / count, job % count);
            let asset = growing[plant];
            let frame = source.frame(asset, frame_at(sample_place(plant, k, count), self.frames))?;
            Some(shown_instances(&self.scene.assets[asset], &frame))
        });
        for (asset, of_asset) in growing.iter().zip(found.chunks(count)) {
            let sum: Option<u64> = of_asset.iter().copied().sum();
            means[*asset] = sum.map(|sum| sum / count as u64);
        }
        means
    }

    /// Sum of `bytes` over the assets, each multiplied by [`AssetSize::weight`].
    pub fn per_asset(&self, bytes: impl Fn(&AssetSize) -> u64) -> u64 {
        self.assets.iter().map(|a| a.weight * bytes(a)).sum()
    }

    /// Texels of one frame if every map sequence had a single map: the sum of the squares of their sides.
    pub fn map_texels(&self) -> u64 {
        self.scene.map_sequences.iter().map(|s| s.texels() as u64).sum()
    }

    /// Texels of one map of each map sequence that is the coat of a material with a height map: its
    /// maps also contain that relief.
    pub fn relief_texels(&self) -> u64 {
        let has_relief = |i: usize| {
            let shows = |m: &Material| m.maps.height.is_some() && m.coat.is_some_and(|c| c.sequence as usize == i);
            self.scene.materials.iter().any(shows)
        };
        let sequences = self.scene.map_sequences.iter().enumerate();
        sequences.filter(|(i, _)| has_relief(*i)).map(|(_, s)| s.texels() as u64).sum()
    }
}

/// Counts of the elements of an asset, which estimates multiply by bytes per element. `weight` and placements are not
/// multiplied in.
#[derive(Debug, Clone, Default)]
pub struct AssetSize {
    /// Number of assets that this one represents in the estimate, itself included.
    pub weight: u64,
    /// Points of the meshes at rest, without those of prototypes.
    pub vertices: u64,
    /// Triangles of the meshes at rest, without those of prototypes.
    pub triangles: u64,
    /// Points of meshes with [`MeshMotion::Deforming`], whose frames carry new points of the same topology.
    pub deforming_vertices: u64,
    /// Number of those meshes.
    pub deforming_meshes: u64,
    /// Points at rest, for a typical frame, of meshes with [`MeshMotion::Varying`], whose frames carry points and triangles.
    pub varying_vertices: u64,
    /// Points of all meshes except those with [`MeshMotion::Still`], whether joints move them or frames carry them.
    pub moving_vertices: u64,
    /// Instances of all instancers, whether alive or not.
    pub instances: u64,
    /// Instances with [`InstancerMotion::Free`], for which frames carry a state each.
    pub free_instances: u64,
    /// Vertices of the prototypes, counted once per instance: what formats without instancing write.
    pub instance_vertices: u64,
    /// Triangles of the prototypes, counted once per instance: what formats without instancing write.
    pub instance_triangles: u64,
    /// Vertices of the prototypes, each counted once: what formats with instancing write.
    pub prototype_vertices: u64,
    /// Triangles of the prototypes, each counted once: what formats with instancing write.
    pub prototype_triangles: u64,
    /// Points of the prototypes' meshes at all levels of detail, without hairs that are written as curves: used by
    /// formats with curves.
    pub drawn_vertices: u64,
    /// Triangles of the prototypes' meshes at all levels of detail, without hairs that are written as curves.
    pub drawn_triangles: u64,
    /// Points of the curves that represent hairs of the prototypes, at all levels of detail.
    pub hair_points: u64,
    /// Instances that are tracked one by one; they are included in the free ones.
    pub tracked_instances: u64,
    /// Points of its clouds, those that move and those that stand still.
    pub points: u64,
    /// Points of the clouds that move: these have new positions at each frame.
    pub moving_points: u64,
    /// Points of the curves that move; curves that stand still are not counted.
    pub moving_curve_points: u64,
    /// Joints of its skeleton, or 0 if it has none.
    pub joints: u64,
    /// Number of different phases of its placements (frames by which their motion is ahead), at least 1.
    pub phases: u64,
    /// Number of its placements; in a plan, the mean over the assets that it represents, rounded up.
    pub placements: u64,
    /// Placements that stand still and share its meshes, at least 1.
    pub still_copies: u64,
}

impl AssetSize {
    /// Whether frames carry the points of the asset's meshes without joints, as those of plants that grow do.
    pub(crate) fn deforms(&self) -> bool {
        self.joints == 0 && self.deforming_vertices > 0
    }

    /// Counts the elements of one asset; weight, phases and still copies are 1.
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
            size.deforming_meshes += u64::from(object.motion == MeshMotion::Deforming);
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
            size.tracked_instances += if instancer.tracked { instances } else { 0 };
            for drawn in instancer.prototypes.iter().flat_map(|p| std::iter::once(p).chain(&p.others)) {
                let mesh = drawn.fine.as_ref().map_or(&drawn.mesh, |fine| &fine.mesh);
                size.drawn_vertices += mesh.points.len() as u64;
                size.drawn_triangles += mesh.triangles.len() as u64;
                size.hair_points += drawn.fine.as_ref().map_or(0, |fine| fine.curves.points.len() as u64);
            }
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
    /// `weights[i]`: number of assets that asset i represents, itself included; 1 for assets beyond the end of the slice.
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
            // In a plan, `copies` counts the placements of all individuals that this asset represents.
            let placements = copies.div_ceil(weight.max(1));
            // Copies that stand still share meshes.
            let still_copies = if asset.moves() && frames > 0 { 1 } else { placements.max(1) };
            Self { weight, phases: phases.len().max(1) as u64, placements, still_copies, ..Self::of(asset) }
        };
        scene.assets.iter().zip(shown).enumerate().map(size).collect()
    }

    /// Number of frames, out of `frames`, with a pose of the joints: all of them, or 0 for an asset without joints.
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
    /// Vertices that get texture coordinates: all of an asset if one of its meshes has some, else none.
    pub mapped_vertices: u64,
    /// Points of the clouds of all placements.
    pub points: u64,
}

impl MergedSize {
    /// Sums the assets over all placements; a placement of an asset that does not exist counts nothing.
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

    /// Counts one placement of an asset: its meshes, and each instance as a copy of its prototype.
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
