//! Leaves with fewer triangles for plants whose merged leaves would make a file too large for the program that opens it.
//!
//! Profile `blender` merges instances into meshes, since importers make an object of each instance. The leaves of a large tree at
//! full detail then take a gigabyte and more.

use std::borrow::Cow;

use super::super::Warning;
use super::blades::enlarged_blade;
use super::options::{GltfOptions, Profile};
use osier_base::Result;
use osier_base::convert::limit;
use osier_base::limits::grouped;
use osier_scene::{Asset, Instancer, InstancerMotion, Mesh, Scene};

/// Bytes of a vertex of merged leaves: position, normal, texture coordinates and tangent, all floats.
const VERTEX_BYTES: u64 = 48;
/// Bytes of a triangle: three indices of 32 bits.
const TRIANGLE_BYTES: u64 = 12;
/// Fewest triangles of a leaf: a quadrilateral.
const FEWEST: u64 = 2;
/// Largest factor by which a simpler leaf is enlarged to the area of the full one; a larger one is conspicuous.
const MOST_GROWTH: f32 = 1.5;

/// A scene as profile `blender` writes it.
pub(super) struct LightLeaves<'a> {
    /// The scene, with simpler leaves where they would take more than [`GltfOptions::leaf_bytes`].
    pub scene: Cow<'a, Scene>,
    /// X029 for each asset with simpler leaves.
    pub warnings: Vec<Warning>,
}

impl<'a> LightLeaves<'a> {
    /// Simplifies the leaves of each asset to the size that the options allow; the scene is unchanged in other profiles.
    /// # Errors
    /// X005 if a leaf cannot be simplified.
    pub(super) fn of(scene: &'a Scene, options: &GltfOptions) -> Result<Self> {
        let mut light = Self { scene: Cow::Borrowed(scene), warnings: Vec::new() };
        if options.profile != Profile::Blender {
            return Ok(light);
        }
        for (i, asset) in scene.assets.iter().enumerate() {
            let full: u64 = merged_instancers(asset).map(merged_bytes).sum();
            if full <= options.leaf_bytes {
                continue;
            }
            let before: u64 = merged_instancers(asset).map(merged_triangles).sum();
            let simple = &mut light.scene.to_mut().assets[i];
            for instancer in simple.instancers.iter_mut().filter(|i| is_merged(i)) {
                for prototype in &mut instancer.prototypes {
                    let label = format!("asset {}, prototype {}", asset.id, prototype.name);
                    // Each leaf is reduced to the same share of its bytes.
                    let share = mesh_bytes(&prototype.mesh).saturating_mul(options.leaf_bytes) / full;
                    let most = triangles_within(share);
                    prototype.mesh = light_leaf(&prototype.mesh, limit(most), &label)?;
                }
            }
            let [bytes, after] =
                [merged_bytes, merged_triangles].map(|sum| merged_instancers(simple).map(sum).sum::<u64>());
            light.warnings.push(Warning {
                code: "X029",
                message: format!(
                    "asset {}: merged leaves have {} triangles instead of {} and take {} MB instead of {}; \
                     output.gltf.leaves_mb = {} keeps all, as profile \"web\" and USD do",
                    asset.id,
                    grouped(after),
                    grouped(before),
                    bytes.div_ceil(1_000_000),
                    grouped(full.div_ceil(1_000_000)),
                    full.div_ceil(1_000_000),
                ),
            });
        }
        Ok(light)
    }
}

/// Estimated bytes of the merged leaves of an asset, from their vertices and triangles at full detail. `instances`:
/// number of leaves.
pub(super) fn estimate(vertices: u64, triangles: u64, instances: u64, options: &GltfOptions) -> u64 {
    let full = vertices * VERTEX_BYTES + triangles * TRIANGLE_BYTES;
    if options.profile != Profile::Blender {
        return full;
    }
    let least = instances.saturating_mul(blade_bytes(FEWEST));
    full.min(options.leaf_bytes.max(least))
}

/// Whether the instances of an instancer are merged into meshes: those that move freely have a node each.
fn is_merged(instancer: &Instancer) -> bool {
    instancer.motion != InstancerMotion::Free
}

fn merged_instancers(asset: &Asset) -> impl Iterator<Item = &Instancer> {
    asset.instancers.iter().filter(|i| is_merged(i))
}

fn mesh_bytes(mesh: &Mesh) -> u64 {
    mesh.points.len() as u64 * VERTEX_BYTES + mesh.triangles.len() as u64 * TRIANGLE_BYTES
}

/// Bytes of all live instances as copies of their prototypes.
fn merged_bytes(instancer: &Instancer) -> u64 {
    sum_over_instances(instancer, mesh_bytes)
}

fn merged_triangles(instancer: &Instancer) -> u64 {
    sum_over_instances(instancer, |mesh| mesh.triangles.len() as u64)
}

/// Sum over the live instances of a number that `of` gives for their prototypes.
fn sum_over_instances(instancer: &Instancer, of: impl Fn(&Mesh) -> u64) -> u64 {
    let numbers: Vec<u64> = instancer.prototypes.iter().map(|p| of(&p.mesh)).collect();
    let living = (0..instancer.len()).filter(|i| instancer.rest.is_alive(*i));
    living.filter_map(|i| numbers.get(instancer.protos[i] as usize)).sum()
}

/// Bytes of a blade of `triangles` triangles: a strip of n triangles has n + 2 vertices.
fn blade_bytes(triangles: u64) -> u64 {
    (triangles + 2) * VERTEX_BYTES + triangles * TRIANGLE_BYTES
}

/// Most triangles of a blade within `bytes`: the inverse of [`blade_bytes`], at least [`FEWEST`].
fn triangles_within(bytes: u64) -> u64 {
    (bytes.saturating_sub(2 * VERTEX_BYTES) / (VERTEX_BYTES + TRIANGLE_BYTES)).max(FEWEST)
}

/// A leaf of at most about `most` triangles, enlarged to the area of the full one as far as [`MOST_GROWTH`] allows.
fn light_leaf(mesh: &Mesh, most: usize, label: &str) -> Result<Mesh> {
    if mesh.triangles.len() <= most {
        return Ok(mesh.clone());
    }
    enlarged_blade(mesh, most, MOST_GROWTH, label)
}
