//! What is too small to be told apart in a picture is merged before anything is drawn.

use std::collections::BTreeMap;

use glam::{Affine3A, Vec3};

use super::film::RenderRequest;
use super::lens::Lens;
use super::quality::Quality;
use osier_base::math;
use osier_scene::Mesh;

/// Meshes of fewer triangles than this are drawn as they are: little is left to be won.
const PLAIN: usize = 12;
/// Meshes of more triangles stay as well: they are no leaves, and thin twigs of theirs would break.
const WHOLE: usize = 2_000;

/// How small a detail some pictures show, by where it is.
#[derive(Debug, Clone, Default)]
pub(super) struct Grain {
    /// Eyes, each with the width at unit distance of the smallest detail.
    eyes: Vec<(Vec3, f32)>,
}

/// Widths in a mesh's own space.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Detail {
    /// Of the smallest detail that is seen; 0 where all of it is.
    pub(super) seen: f32,
    /// Within which points are merged; 0 where each is drawn.
    pub(super) merged: f32,
}

impl Grain {
    pub(super) fn new(requests: &[RenderRequest], quality: Quality) -> Self {
        let share = quality.grain();
        let eye =
            |request: &RenderRequest| (request.camera.eye, Lens::new(&request.camera, request.size).spread * share);
        Self { eyes: if share > 0.0 { requests.iter().map(eye).collect() } else { Vec::new() } }
    }

    /// The smallest detail of a mesh that is seen in some places. Widths are of few steps, so that they stay from frame to
    /// frame.
    pub(super) fn of(&self, mesh: &Mesh, places: impl Iterator<Item = Affine3A>) -> Detail {
        if self.eyes.is_empty() {
            return Detail::default();
        }
        let reach = mesh.points.iter().fold(0.0_f32, |r, p| r.max(p.length()));
        let seen = |place: Affine3A| {
            let scale = math::pow_f32(place.matrix3.determinant().abs(), 1.0 / 3.0);
            let near = |(eye, share): &(Vec3, f32)| {
                let d = Vec3::from(place.translation).distance(*eye) - reach * scale;
                d.max(0.0) * share / scale.max(f32::MIN_POSITIVE)
            };
            self.eyes.iter().map(near).fold(f32::INFINITY, f32::min)
        };
        let least = places.map(seen).fold(f32::INFINITY, f32::min);
        let seen = if least.is_finite() && least > 0.0 { stepped(least) } else { 0.0 };
        let merges = (PLAIN..=WHOLE).contains(&mesh.triangles.len());
        Detail { seen, merged: if merges { seen } else { 0.0 } }
    }
}

/// The step below a width: four to an octave.
fn stepped(width: f32) -> f32 {
    const STEPS: f32 = 4.0;
    math::exp_f32((math::ln_f32(width) / std::f32::consts::LN_2 * STEPS).floor() / STEPS * std::f32::consts::LN_2)
}

/// For each point the number of the one that stands for it: of all in a cell that one which lies farthest out, so that a leaf
/// keeps its outline. Empty where nothing is merged.
pub(super) fn merged(points: &[Vec3], cell: f32) -> Vec<u32> {
    if cell <= 0.0 || points.is_empty() {
        return Vec::new();
    }
    #[allow(clippy::cast_precision_loss, reason = "thousands")]
    let middle = points.iter().sum::<Vec3>() / points.len() as f32;
    #[allow(clippy::cast_possible_truncation, reason = "cells that far out share one")]
    let key = |p: &Vec3| (*p / cell).to_array().map(|v| (v + 0.5).floor() as i32);
    let mut best: BTreeMap<[i32; 3], (u32, f32)> = BTreeMap::new();
    for (i, p) in (0..).zip(points) {
        let out = p.distance_squared(middle);
        let own = best.entry(key(p)).or_insert((i, out));
        if out > own.1 {
            *own = (i, out);
        }
    }
    points.iter().map(|p| best.get(&key(p)).map_or(0, |b| b.0)).collect()
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

    fn area(mesh: &Mesh, stand_ins: &[u32]) -> (usize, f32) {
        let corner = |i: u32| mesh.points[stand_ins.get(i as usize).copied().unwrap_or(i) as usize];
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
        let ((many, whole), (few, kept)) = (area(&mesh, &[]), area(&mesh, &merged(&mesh.points, 0.4)));
        assert!(few * 2 < many, "{few} of {many}");
        assert!((kept / whole - 1.0).abs() < 0.1, "{kept} of {whole}");
        assert!(merged(&mesh.points, 0.0).is_empty());
    }

    #[test]
    fn the_nearest_place_and_eye_decide_and_small_moves_change_nothing() {
        let (mesh, at) = (disc(4, 24), |z: f32| Affine3A::from_translation(Vec3::Z * z));
        let grain = |far: &[f32], places: &[f32]| {
            let requests: Vec<RenderRequest> = far.iter().map(|d| request(*d)).collect();
            Grain::new(&requests, Quality::Normal).of(&mesh, places.iter().map(|z| at(*z))).merged
        };
        let one = grain(&[100.0], &[0.0]);
        // 0.75 of a pixel 99 m away, less up to a quarter of an octave.
        let pixel = 99.0 * 2.0 * math::tan_f32(0.3) / 100.0 * 0.75;
        assert!(one <= pixel && one > pixel * 0.8, "{one} of {pixel}");
        assert_eq!(one.to_bits(), grain(&[100.0], &[0.0, -50.0]).to_bits());
        assert_eq!(one.to_bits(), grain(&[400.0, 100.0], &[0.0]).to_bits());
        assert!(grain(&[100.0], &[0.0, 80.0]) < 0.3 * one);
        assert_eq!(one.to_bits(), grain(&[100.5], &[0.0]).to_bits());
        assert!(grain(&[100.0], &[100.0]) <= 0.0 && grain(&[], &[0.0]) <= 0.0);
        assert!(Grain::new(&[request(100.0)], Quality::Fine).of(&mesh, std::iter::once(at(0.0))).seen <= 0.0);
    }
}
