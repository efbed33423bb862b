//! Vertex clustering: details of instanced meshes that are smaller than a pixel are merged before the scene is built.

use std::collections::BTreeMap;

use glam::{Affine3A, Vec3};

use super::perspective::PerspectiveCamera;
use super::quality::Quality;
use super::request::RenderRequest;
use osier_base::disjoint_sets::DisjointSets;
use osier_base::geometry::Bounds;
use osier_base::math;
use osier_scene::Mesh;

/// Triangles of the smallest mesh that is clustered: in smaller ones there is little to save.
const MIN_TRIANGLES: usize = 12;
/// Triangles of the largest mesh that is clustered: larger ones are branches rather than leaves, whose thin twigs
/// would break.
const MAX_TRIANGLES: usize = 2_000;

/// Least share of its area that a mesh, or a long part of it, must keep when its vertices are clustered. Own: leaves keep more than
/// nine tenths.
pub(super) const MIN_CLUSTERED_AREA: f32 = 0.6;
/// Extent of a thin part, in cells, from which it is kept: over the gap that a shorter one leaves one sees a leaf on its twig. Own:
/// chosen by eye.
const MIN_THIN_CELLS: f32 = 6.0;

/// Widths of the smallest details that the cameras of some pictures resolve, depending on distance.
#[derive(Debug, Clone, Default)]
pub(super) struct DetailLimit {
    cameras: Vec<CameraResolution>,
}

/// Position of a camera and width of the details that it resolves.
#[derive(Debug, Clone, Copy)]
struct CameraResolution {
    eye: Vec3,
    /// Width of the smallest visible detail at unit distance.
    detail: f32,
}

/// Resolution that a mesh needs, as widths in its local space.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct MeshDetail {
    /// Width of the smallest visible detail; 0 if every detail is drawn.
    pub(super) smallest: f32,
    /// Side of the cells whose vertices are merged; 0 if none are.
    pub(super) cluster_size: f32,
}

impl DetailLimit {
    pub(super) fn new(requests: &[RenderRequest], quality: Quality) -> Self {
        let pixels = quality.smallest_detail();
        let resolution = |request: &RenderRequest| CameraResolution {
            eye: request.camera.eye,
            detail: PerspectiveCamera::new(&request.camera, request.size).spread * pixels,
        };
        Self { cameras: if pixels > 0.0 { requests.iter().map(resolution).collect() } else { Vec::new() } }
    }

    /// The detail of a mesh that its closest instance needs. Widths are rounded down to steps of a quarter octave, so
    /// that the clusters of a moving leaf do not change from frame to frame.
    pub(super) fn for_mesh(&self, mesh: &Mesh, transforms: impl Iterator<Item = Affine3A>) -> MeshDetail {
        if self.cameras.is_empty() {
            return MeshDetail::default();
        }
        let radius = mesh.points.iter().fold(0.0_f32, |r, p| r.max(p.length()));
        // Visible width in the space of the mesh: the distance to the nearest point of its bounding
        // sphere times the width at unit distance, divided by the mean scale of the instance.
        let visible_width = |transform: Affine3A| {
            let scale = math::pow_f32(transform.matrix3.determinant().abs(), 1.0 / 3.0);
            let for_camera = |camera: &CameraResolution| {
                let d = Vec3::from(transform.translation).distance(camera.eye) - radius * scale;
                d.max(0.0) * camera.detail / scale.max(f32::MIN_POSITIVE)
            };
            self.cameras.iter().map(for_camera).fold(f32::INFINITY, f32::min)
        };
        let least = transforms.map(visible_width).fold(f32::INFINITY, f32::min);
        let smallest = if least.is_finite() && least > 0.0 { rounded_to_step(least) } else { 0.0 };
        // The alpha test of every mesh filters its texture by the smallest detail; vertices are
        // clustered only in leaves.
        let is_clustered = (MIN_TRIANGLES..=MAX_TRIANGLES).contains(&mesh.triangles.len());
        MeshDetail { smallest, cluster_size: if is_clustered { smallest } else { 0.0 } }
    }
}

/// The largest step not above a width; four steps double it.
fn rounded_to_step(width: f32) -> f32 {
    const STEPS_PER_OCTAVE: f32 = 4.0;
    math::exp_f32(
        (math::ln_f32(width) / std::f32::consts::LN_2 * STEPS_PER_OCTAVE).floor() / STEPS_PER_OCTAVE
            * std::f32::consts::LN_2,
    )
}

/// For each point the index of the one that replaces it: of all points in a cell of side `cell` the one farthest from
/// the centroid, so that a leaf keeps its outline. Empty if nothing is merged.
pub(super) fn cluster_vertices(points: &[Vec3], cell: f32) -> Vec<u32> {
    if cell <= 0.0 || points.is_empty() {
        return Vec::new();
    }
    #[allow(clippy::cast_precision_loss, reason = "thousands")]
    let centroid = points.iter().sum::<Vec3>() / points.len() as f32;
    #[allow(clippy::cast_possible_truncation, reason = "cells that far out share one")]
    let key = |p: &Vec3| (*p / cell).to_array().map(|v| (v + 0.5).floor() as i32);
    // Of each cell the outermost vertex, and of equally distant ones the first: independent of the
    // order of cells.
    let mut best: BTreeMap<[i32; 3], (u32, f32)> = BTreeMap::new();
    for (i, p) in (0..).zip(points) {
        let distance = p.distance_squared(centroid);
        let own = best.entry(key(p)).or_insert((i, distance));
        if distance > own.1 {
            *own = (i, distance);
        }
    }
    points.iter().map(|p| best.get(&key(p)).map_or(0, |b| b.0)).collect()
}

/// A connected part of a mesh: its box, m, and its area before and after clustering, m2.
#[derive(Debug, Clone, Copy, Default)]
struct ConnectedPart {
    bounds: Bounds,
    whole: f32,
    clustered: f32,
}

impl ConnectedPart {
    /// Whether the part is longer than some cells and would vanish.
    fn is_thin(&self, cell: f32) -> bool {
        self.clustered < MIN_CLUSTERED_AREA * self.whole && self.bounds.size().length() > MIN_THIN_CELLS * cell
    }
}

/// Undoes the clustering of long, thin parts: without their stalks leaves would float beside their twigs. A part is what triangles
/// connect. `cell`: side of the cells of `replacements`, which are those of [`cluster_vertices`].
pub(super) fn keep_thin_parts(triangles: &[[u32; 3]], points: &[Vec3], cell: f32, replacements: &mut [u32]) {
    if replacements.is_empty() {
        return;
    }
    let mut sets = DisjointSets::connected(points.len(), triangles);
    // The box of each part, then its areas before and after.
    let mut parts: BTreeMap<u32, ConnectedPart> = BTreeMap::new();
    for (i, p) in (0_u32..).zip(points) {
        let part = parts.entry(sets.find(i)).or_default();
        part.bounds = part.bounds.union(Bounds::of([*p]));
    }
    let area = |t: [u32; 3]| {
        let [a, b, c] = t.map(|i| points.get(i as usize).copied().unwrap_or_default());
        0.5 * (b - a).cross(c - a).length()
    };
    for t in triangles.iter().filter(|t| t.iter().all(|i| (*i as usize) < points.len())) {
        let part = parts.entry(sets.find(t[0])).or_default();
        part.whole += area(*t);
        part.clustered += area(t.map(|i| replacements.get(i as usize).copied().unwrap_or(i)));
    }
    // Each point of a thin part stands for itself.
    for (i, replacement) in (0_u32..).zip(replacements.iter_mut()) {
        let part = parts.get(&sets.find(i));
        if part.is_some_and(|part| part.is_thin(cell)) {
            *replacement = i;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Backdrop, Light};
    use osier_scene::{Camera, Sky, Sun};

    /// A fan of rings, as leaves are built.
    fn disc(rings: u32, around: u32) -> Mesh {
        let mut mesh = Mesh { points: vec![Vec3::ZERO], ..Mesh::default() };
        for r in 1..=rings {
            for k in 0..around {
                let (out, turn) = (r as f32 / rings as f32, k as f32 / around as f32 * std::f32::consts::TAU);
                mesh.points.push(Vec3::new(math::cos_f32(turn), math::sin_f32(turn), 0.0) * out);
            }
        }
        let at = |r: u32, k: u32| if r == 0 { 0 } else { 1 + (r - 1) * around + k % around };
        for (r, k) in (0..rings).flat_map(|r| (0..around).map(move |k| (r, k))) {
            mesh.triangles.push([at(r, k), at(r + 1, k), at(r + 1, k + 1)]);
            if r > 0 {
                mesh.triangles.push([at(r, k), at(r + 1, k + 1), at(r, k + 1)]);
            }
        }
        mesh
    }

    fn area(mesh: &Mesh, replacements: &[u32]) -> (usize, f32) {
        let corner = |i: u32| mesh.points[replacements.get(i as usize).copied().unwrap_or(i) as usize];
        let areas = mesh.triangles.iter().map(|t| {
            let [a, b, c] = t.map(corner);
            0.5 * (b - a).cross(c - a).length()
        });
        let left: Vec<f32> = areas.filter(|a| *a > 1e-9).collect();
        (left.len(), left.iter().sum())
    }

    fn request(distance: f32) -> RenderRequest {
        RenderRequest {
            camera: Camera { eye: Vec3::Z * distance, target: Vec3::ZERO, vfov: 0.6, roll: 0.0 },
            size: [100, 100],
            light: Light::new(&Sun::default(), &Sky::default()),
            backdrop: Backdrop::Sky,
            seed: 0,
        }
    }

    #[test]
    fn merging_keeps_the_outline_and_leaves_out_most_triangles() {
        let mesh = disc(4, 24);
        let ((many, whole), (few, kept)) = (area(&mesh, &[]), area(&mesh, &cluster_vertices(&mesh.points, 0.4)));
        assert!(few * 2 < many, "{few} of {many}");
        assert!((kept / whole - 1.0).abs() < 0.1, "{kept} of {whole}");
        assert!(cluster_vertices(&mesh.points, 0.0).is_empty());
    }

    #[test]
    fn a_long_stalk_is_kept_and_a_short_one_is_not() {
        let clustered = |length: f32| {
            let mut mesh = disc(4, 24);
            let first = mesh.next_point();
            for x in [-0.01, 0.01] {
                mesh.points.extend([Vec3::new(x, -1.0, 0.1), Vec3::new(x, -1.0 - length, 0.1)]);
            }
            let stalk = [[first, first + 1, first + 2], [first + 1, first + 3, first + 2]];
            mesh.triangles.extend(stalk);
            let mut replacements = cluster_vertices(&mesh.points, 0.4);
            keep_thin_parts(&mesh.triangles, &mesh.points, 0.4, &mut replacements);
            let stalk = Mesh { triangles: stalk.to_vec(), ..mesh.clone() };
            (area(&stalk, &replacements).1, area(&mesh, &replacements).0)
        };
        let ((long, triangles), (short, _)) = (clustered(3.0), clustered(1.0));
        assert!((long - 0.02 * 3.0).abs() < 1e-4 && short < 1e-6, "{long}, {short}");
        assert!(triangles * 2 < disc(4, 24).triangles.len(), "the blade is simplified: {triangles}");
    }

    #[test]
    fn the_nearest_place_and_eye_decide_and_small_moves_change_nothing() {
        let (mesh, at) = (disc(4, 24), |z: f32| Affine3A::from_translation(Vec3::Z * z));
        let cluster_size = |far: &[f32], places: &[f32]| {
            let requests: Vec<RenderRequest> = far.iter().map(|d| request(*d)).collect();
            DetailLimit::new(&requests, Quality::Normal).for_mesh(&mesh, places.iter().map(|z| at(*z))).cluster_size
        };
        let one = cluster_size(&[100.0], &[0.0]);
        // 0.75 of a pixel 99 m away, less up to a quarter of an octave.
        let pixel = 99.0 * 2.0 * math::tan_f32(0.3) / 100.0 * 0.75;
        assert!(one <= pixel && one > pixel * 0.8, "{one} of {pixel}");
        assert_eq!(one.to_bits(), cluster_size(&[100.0], &[0.0, -50.0]).to_bits());
        assert_eq!(one.to_bits(), cluster_size(&[400.0, 100.0], &[0.0]).to_bits());
        assert!(cluster_size(&[100.0], &[0.0, 80.0]) < 0.3 * one);
        assert_eq!(one.to_bits(), cluster_size(&[100.5], &[0.0]).to_bits());
        assert!(cluster_size(&[100.0], &[100.0]) <= 0.0 && cluster_size(&[], &[0.0]) <= 0.0);
        assert!(
            DetailLimit::new(&[request(100.0)], Quality::Fine).for_mesh(&mesh, std::iter::once(at(0.0))).smallest
                <= 0.0
        );
    }
}
