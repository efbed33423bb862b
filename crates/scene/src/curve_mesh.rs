//! Curves as meshes, for formats without curves: flat ribbons, thin tubes.

use std::f32::consts::TAU;

use glam::{Quat, Vec2, Vec3};

use super::{Curves, Mesh};
use osier_base::math;

/// Sides of the tube that a curve becomes.
const SIDES: u32 = 3;

/// A ribbon along each curve, two vertices per point, as wide as the curve. `points`: the curve points of one frame.
/// The topology is the same for all frames; the ribbon of a moved curve turns with its first segment.
/// u runs across, v along in repeats of `tile` metres at rest.
pub fn ribbons(curves: &Curves, points: &[Vec3], tile: f32) -> Mesh {
    let mut mesh = Mesh::default();
    let mut first = 0_usize;
    for count in &curves.counts {
        let end = first + *count as usize;
        if let (Some(rest), Some(line), Some(widths)) =
            (curves.points.get(first..end), points.get(first..end), curves.widths.get(first..end))
            && line.len() >= 2
        {
            ribbon(&mut mesh, rest, line, widths);
        }
        first = end;
    }
    let tile = if tile > 0.0 { tile } else { 1.0 };
    mesh.uvs.iter_mut().for_each(|uv| uv.y /= tile);
    mesh.with_material(curves.material)
}

/// [`ribbons`] at rest, each rotated about its curve by the angle that `turn` returns for the index of the curve, rad, so that
/// from any side some show their faces and some their edges. v in metres.
pub fn turned_ribbons(curves: &Curves, turn: impl Fn(usize) -> f32) -> Mesh {
    let mut mesh = Mesh::default();
    each(curves, |i, line, widths| {
        let first = mesh.points.len();
        ribbon(&mut mesh, line, line, widths);
        let turn = turn(i);
        let (s, c) = (math::sin_f32(turn), math::cos_f32(turn));
        let pairs = mesh.points[first..].chunks_exact_mut(2).zip(mesh.normals[first..].chunks_exact_mut(2));
        for ((p, n), middle) in pairs.zip(line) {
            // Side and normal turn together in the plane across the curve.
            let half = p[1] - *middle;
            let width = half.length();
            let side = half / width.max(1e-12);
            let turned = side * c + n[0] * s;
            n.fill(n[0] * c - side * s);
            (p[0], p[1]) = (*middle - turned * width, *middle + turned * width);
        }
    });
    mesh.with_material(curves.material)
}

/// A three-sided tube along each curve, without caps, three vertices per point, inscribed in the round tube of the curve's
/// width. Its normals are radial, so that it is shaded as round.
pub fn tubes(curves: &Curves) -> Mesh {
    let mut mesh = Mesh::default();
    each(curves, |_, line, widths| tube(&mut mesh, line, widths));
    mesh.with_material(curves.material)
}

/// Calls `f` with index, points and widths of every curve at rest; curves of fewer than two points are skipped.
fn each(curves: &Curves, mut f: impl FnMut(usize, &[Vec3], &[f32])) {
    let mut first = 0_usize;
    for (i, count) in curves.counts.iter().enumerate() {
        let end = first + *count as usize;
        if let (Some(line), Some(widths)) = (curves.points.get(first..end), curves.widths.get(first..end))
            && line.len() >= 2
        {
            f(i, line, widths);
        }
        first = end;
    }
}

fn tube(mesh: &mut Mesh, line: &[Vec3], widths: &[f32]) {
    let base = mesh.next_point();
    let tangents = tangents(line);
    let mut side = math::perpendicular(tangents[0]);
    let mut along = 0.0;
    for (i, p) in line.iter().enumerate() {
        if i > 0 {
            // Parallel transport keeps the rings from twisting about the line.
            side = math::transport(line[i - 1], tangents[i - 1], side, *p, tangents[i]);
            along += (*p - line[i - 1]).length();
        }
        let across = tangents[i].cross(side);
        for k in 0..SIDES {
            let angle = TAU * k as f32 / SIDES as f32;
            let out = side * math::cos_f32(angle) + across * math::sin_f32(angle);
            mesh.points.push(*p + out * (widths[i] * 0.5));
            mesh.normals.push(out);
            mesh.uvs.push(Vec2::new(k as f32 / SIDES as f32, along));
        }
    }
    // Two triangles between each side of a ring and the next ring; the last side joins the first.
    for i in (0_u32..).take(line.len() - 1) {
        for k in 0..SIDES {
            let [a, b] = [k, (k + 1) % SIDES].map(|k| base + SIDES * i + k);
            let [c, d] = [a + SIDES, b + SIDES];
            mesh.triangles.extend([[a, d, c], [a, b, d]]);
        }
    }
}

fn ribbon(mesh: &mut Mesh, rest: &[Vec3], line: &[Vec3], widths: &[f32]) {
    let base = mesh.next_point();
    let tangents = tangents(line);
    let start = math::normalize_or(rest[1] - rest[0], Vec3::Y);
    let turn: Quat = math::rotation_between(start, tangents[0]);
    let mut side = turn * math::perpendicular(start);
    let mut along = 0.0;
    for (i, p) in line.iter().enumerate() {
        if i > 0 {
            side = math::transport(line[i - 1], tangents[i - 1], side, *p, tangents[i]);
            along += (rest[i] - rest[i - 1]).length();
        }
        let half = side * (widths[i] * 0.5);
        let normal = math::normalize_or(side.cross(tangents[i]), Vec3::Y);
        mesh.points.extend([*p - half, *p + half]);
        mesh.normals.extend([normal; 2]);
        mesh.uvs.extend([Vec2::new(0.0, along), Vec2::new(1.0, along)]);
    }
    for i in (0_u32..).take(line.len() - 1).map(|i| base + 2 * i) {
        mesh.triangles.extend([[i, i + 1, i + 2], [i + 2, i + 1, i + 3]]);
    }
}

/// Unit tangents: along the segment at either end, elsewhere from the previous to the next point. Where these coincide, the
/// previous tangent.
fn tangents(line: &[Vec3]) -> Vec<Vec3> {
    let mut last = Vec3::Y;
    let of = |i: usize| {
        let (a, b) = (line[i.saturating_sub(1)], line[(i + 1).min(line.len() - 1)]);
        last = math::normalize_or(b - a, last);
        last
    };
    (0..line.len()).map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curves() -> Curves {
        Curves {
            name: "hair".into(),
            material: 0,
            counts: vec![3, 2],
            points: vec![Vec3::ZERO, Vec3::Y, Vec3::new(0.5, 2.0, 0.0), Vec3::X, Vec3::new(1.0, 0.0, 1.0)],
            widths: vec![0.2, 0.2, 0.1, 0.1, 0.1],
            moving: true,
        }
    }

    #[test]
    fn a_ribbon_has_its_width_around_the_curve_and_faces_its_normals() {
        let curves = curves();
        let mesh = ribbons(&curves, &curves.points, 0.5);
        assert_eq!((mesh.points.len(), mesh.triangles.len()), (10, 6));
        for (pair, (p, w)) in mesh.points.chunks_exact(2).zip(curves.points.iter().zip(&curves.widths)) {
            assert!(((pair[0] + pair[1]) * 0.5 - *p).length() < 1e-6);
            assert!(((pair[1] - pair[0]).length() - w).abs() < 1e-6);
        }
        for t in &mesh.triangles {
            let [a, b, c] = t.map(|i| mesh.points[i as usize]);
            assert!((b - a).cross(c - a).dot(mesh.normals[t[0] as usize]) > 0.0);
        }
        assert_eq!(mesh.uvs[3], Vec2::new(1.0, 2.0));
    }

    #[test]
    fn tubes_face_outwards_and_turned_ribbons_keep_their_widths() {
        let curves = curves();
        let mesh = tubes(&curves);
        assert_eq!((mesh.points.len(), mesh.triangles.len()), (15, 18));
        for t in &mesh.triangles {
            let [a, b, c] = t.map(|i| mesh.points[i as usize]);
            let out: Vec3 = t.iter().map(|i| mesh.normals[*i as usize]).sum();
            assert!((b - a).cross(c - a).dot(out) > 0.0);
        }
        let turned = turned_ribbons(&curves, |i| i as f32 + 1.0);
        for (i, pair) in turned.points.chunks_exact(2).enumerate() {
            assert!(((pair[1] - pair[0]).length() - curves.widths[i]).abs() < 1e-6);
            assert!(((pair[0] + pair[1]) * 0.5 - curves.points[i]).length() < 1e-6);
            assert!((pair[1] - pair[0]).dot(turned.normals[2 * i]).abs() < 1e-6);
        }
        for t in &turned.triangles {
            let [a, b, c] = t.map(|i| turned.points[i as usize]);
            assert!((b - a).cross(c - a).dot(turned.normals[t[0] as usize]) > 0.0);
        }
    }

    #[test]
    fn a_moved_ribbon_keeps_its_topology_and_does_not_flip() {
        let curves = curves();
        let rest = ribbons(&curves, &curves.points, 0.5);
        let bent: Vec<Vec3> = curves.points.iter().map(|p| *p + Vec3::Z * (0.1 * p.y)).collect();
        let moved = ribbons(&curves, &bent, 0.5);
        assert_eq!(rest.triangles, moved.triangles);
        assert!(rest.points.iter().zip(&moved.points).all(|(a, b)| (*a - *b).length() < 0.25));
    }
}
