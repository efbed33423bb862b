//! Third pass: points, normals, texture coordinates, bindings and triangles, filled in place.

use glam::Vec2;

use super::flare::Ridges;
use super::junction;
use super::layout::{CircleTables, MaterialRun, SkinLayout, v_scale};
use super::rings::Ring;
use super::tube::{SkinContext, TubeInputs};
use super::tube_plan::{TubeCap, TubePlans, TubeStart};
use super::tuning::POINTS_PER_TASK;
use super::writer::{PointRing, TubeWriter};
use super::{AxisBinding, PlantSkin, SkinOptions, TubeRange, UvMode};
use osier_base::par::par_each;
use osier_scene::plant::Plant;
use osier_scene::{Mesh, Subset};

/// Fills the arrays of `skin`, whose buffers are reused where they are large enough.
pub(super) fn emit(plant: &Plant, options: &SkinOptions, plans: &TubePlans, layout: SkinLayout, skin: &mut PlantSkin) {
    let circles = CircleTables::new(options.sides.1);
    let (points, triangles) = (layout.points as usize, layout.triangles as usize);
    // Reuse the old buffers: a skin of a million points costs more in page faults than in arithmetic.
    let old = std::mem::take(&mut skin.mesh);
    skin.mesh = Mesh {
        points: resized(old.points, points),
        normals: resized(old.normals, points),
        uvs: resized(old.uvs, points),
        triangles: resized(old.triangles, triangles),
        subsets: subsets(&layout.subsets),
        ..Mesh::default()
    };
    skin.bindings = resized(std::mem::take(&mut skin.bindings), points);
    let context = SkinContext { plant, options, plans, params: &layout.params, circles: &circles };
    let mut tasks = split_arrays(&layout.tubes, &mut skin.mesh, &mut skin.bindings);
    par_each(&mut tasks, |(tubes, out)| {
        for tube in *tubes {
            write_tube(&TubeInputs::new(context, tube.axis), out);
        }
    });
    skin.tubes = layout.tubes;
}

/// Resizes a buffer to `n` entries. The caller overwrites all of them, so old entries are not cleared.
fn resized<T: bytemuck::Zeroable + Clone>(mut buffer: Vec<T>, n: usize) -> Vec<T> {
    if buffer.capacity() < n {
        drop(buffer);
        return bytemuck::zeroed_vec(n);
    }
    buffer.resize(n, T::zeroed());
    buffer
}

/// Runs of triangles as subsets of a mesh, one after the other from triangle 0 on.
fn subsets(runs: &[MaterialRun]) -> Vec<Subset> {
    let mut first = 0;
    let subset = |run: &MaterialRun| {
        let subset = Subset { material: run.material.into(), first, count: run.triangles };
        first += run.triangles;
        subset
    };
    runs.iter().map(subset).collect()
}

/// Splits the arrays into tasks of whole tubes, about [`POINTS_PER_TASK`] points each.
fn split_arrays<'a>(
    tubes: &'a [TubeRange],
    mesh: &'a mut Mesh,
    bindings: &'a mut [AxisBinding],
) -> Vec<(&'a [TubeRange], TubeWriter<'a>)> {
    let (mut points, mut normals) = (mesh.points.as_mut_slice(), mesh.normals.as_mut_slice());
    let (mut uvs, mut triangles) = (mesh.uvs.as_mut_slice(), mesh.triangles.as_mut_slice());
    let mut bindings = bindings;
    let mut rest = tubes;
    let mut tasks = Vec::new();
    // Cut between tubes, so that the ranges of tasks are disjoint and no synchronization is needed.
    while let Some(first) = rest.first() {
        let first_point = first.points.0;
        let n = rest.partition_point(|t| t.points.0 - first_point < POINTS_PER_TASK).max(1);
        let (run, after) = rest.split_at(n);
        let p = run.iter().map(|t| t.points.1 as usize).sum();
        let t = run.iter().map(|t| t.triangles.1 as usize).sum();
        tasks.push((
            run,
            TubeWriter {
                points: split_off(&mut points, p),
                normals: split_off(&mut normals, p),
                uvs: split_off(&mut uvs, p),
                bindings: split_off(&mut bindings, p),
                triangles: split_off(&mut triangles, t),
                first_point,
                points_written: 0,
                triangles_written: 0,
            },
        ));
        rest = after;
    }
    tasks
}

/// Returns the first `n` entries of a slice and leaves the others in it.
fn split_off<'a, T>(from: &mut &'a mut [T], n: usize) -> &'a mut [T] {
    let (head, tail) = std::mem::take(from).split_at_mut(n);
    *from = tail;
    head
}

/// Writes one tube: start, rings from the base to the tip, end.
fn write_tube(tube: &TubeInputs<'_>, out: &mut TubeWriter<'_>) {
    let v_scale = v_scale(tube.context.options, &tube.params);
    let ridges = Ridges::new(tube);
    // `below`: first point of the ring under the next one. Without a junction the first ring has none under it.
    let mut below = write_start(tube, ridges.as_ref(), out);
    for (k, ring) in tube.rings.iter().enumerate() {
        let first = out.ring(&tube.point_ring(ring, v_scale), tube.circle);
        // The last ring stays round: its cap, and branches that continue from it, join it there.
        if let Some(ridges) = ridges.as_ref().filter(|_| k + 1 < tube.rings.len()) {
            ridges.shape(tube, ring, first, false, out);
        }
        if let Some(below) = below {
            out.quad_strip(below, first, tube.params.sides);
        }
        below = Some(first);
    }
    if let (Some(last), Some(first)) = (tube.rings.last(), below) {
        write_end(tube, last, first, out);
    }
}

/// Writes the cap below the first ring or, for a side branch, its junction. Returns the first point of the ring that the first
/// regular ring is joined to.
fn write_start(tube: &TubeInputs<'_>, ridges: Option<&Ridges>, out: &mut TubeWriter<'_>) -> Option<u32> {
    let first = tube.rings.first()?;
    if let TubeStart::Side(site) = &tube.plan.start {
        return Some(junction::write_junction(tube, site, out));
    }
    let ring = tube.point_ring(first, v_scale(tube.context.options, &tube.params));
    let disc = tube.write_disc(&ring, first.t, true, out);
    if let Some(ridges) = ridges {
        ridges.shape(tube, first, disc, true, out);
    }
    None
}

/// Writes the cap above the last ring. `below`: that ring's first point.
fn write_end(tube: &TubeInputs<'_>, ring: &Ring, below: u32, out: &mut TubeWriter<'_>) {
    let n = tube.params.sides;
    let base = tube.point_ring(ring, v_scale(tube.context.options, &tube.params));
    // The ring shifted along its tangent, for domes and tips; v continues as on the wall.
    let raised = |height: f32, v: f32| PointRing {
        c: base.c + ring.t * (height * ring.r),
        uv: [base.uv[0], base.uv[1], base.uv[2] + v],
        ..base
    };
    // v over one radius beyond the ring, as on the wall: 1 / (2 pi) of the repeats around, or the radius itself.
    let step = match tube.context.options.uv {
        UvMode::Conformal => 0.16 * tube.params.repeats,
        UvMode::Metric => ring.r * v_scale(tube.context.options, &tube.params),
    };
    let write_apex = |below: u32, out: &mut TubeWriter<'_>| {
        let tip = raised(1.0, step);
        let uv = Vec2::new(tip.uv[0] + 0.5 * tip.uv[1], tip.uv[2]);
        let apex = out.point(tip.c, ring.t, uv, base.binding);
        out.triangle_fan(below, apex, n, false);
    };
    match tube.params.cap {
        TubeCap::Disc => {
            tube.write_disc(&base, ring.t, false, out);
        }
        TubeCap::Point => write_apex(below, out),
        TubeCap::Dome => {
            // Rings at 30 and 60 degrees of a hemisphere.
            let mut below = below;
            for (sin, cos) in [(0.5, 0.866_025_4), (0.866_025_4, 0.5_f32)] {
                let dome = PointRing { r: ring.r * cos, axial: ring.t * sin, radial: cos, ..raised(sin, sin * step) };
                let first = out.ring(&dome, tube.circle);
                out.quad_strip(below, first, n);
                below = first;
            }
            write_apex(below, out);
        }
    }
}
