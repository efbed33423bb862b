//! Third pass: points, normals, texture coordinates, bindings and triangles, filled in place.

use glam::{Vec2, Vec3};

use super::foot;
use super::link::{Circles, Layout, Link, rolled, v_of, v_scale};
use super::plan::{Base, Cap, Plan, Plans};
use super::rings::Ring;
use super::row::{Out, Row};
use super::{Binding, Skin, SkinOptions, Tube};
use osier_base::par::par_each;
use osier_scene::plant::Plant;
use osier_scene::{Mesh, Subset};

/// Points filled as one piece of work.
const RUN: u32 = 1 << 16;

/// What all tubes share.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shared<'a> {
    pub plant: &'a Plant,
    pub options: &'a SkinOptions,
    pub plans: &'a Plans,
    pub links: &'a [Link],
    pub circles: &'a Circles,
}

/// One tube being written.
#[derive(Debug, Clone, Copy)]
pub(super) struct Job<'a> {
    pub shared: Shared<'a>,
    pub axis: u32,
    pub plan: &'a Plan,
    pub link: Link,
    pub rings: &'a [Ring],
    pub circle: &'a [[f32; 3]],
}

/// Fills the arrays of `skin`, whose memory is used again where it suffices.
pub(super) fn emit(plant: &Plant, options: &SkinOptions, plans: &Plans, layout: Layout, skin: &mut Skin) {
    let circles = Circles::new(options.sides.1);
    let (points, triangles) = (layout.totals.0 as usize, layout.totals.1 as usize);
    let old = std::mem::take(&mut skin.mesh);
    skin.mesh = Mesh {
        points: sized(old.points, points),
        normals: sized(old.normals, points),
        uvs: sized(old.uvs, points),
        triangles: sized(old.triangles, triangles),
        subsets: subsets(&layout.subsets),
        ..Mesh::default()
    };
    skin.binding = sized(std::mem::take(&mut skin.binding), points);
    let shared = Shared { plant, options, plans, links: &layout.links, circles: &circles };
    let mut runs = split(&layout.tubes, &mut skin.mesh, &mut skin.binding);
    par_each(&mut runs, |(tubes, out)| {
        for tube in *tubes {
            write(&shared, tube.axis, out);
        }
    });
    skin.tubes = layout.tubes;
}

/// The buffer with `n` entries, all of which are written afterwards: what it held may stay in it until then.
fn sized<T: bytemuck::Zeroable + Clone>(mut buffer: Vec<T>, n: usize) -> Vec<T> {
    if buffer.capacity() < n {
        drop(buffer);
        return bytemuck::zeroed_vec(n);
    }
    buffer.resize(n, T::zeroed());
    buffer
}

fn subsets(runs: &[(u16, u32)]) -> Vec<Subset> {
    let mut first = 0;
    let subset = |&(material, count): &(u16, u32)| {
        let s = Subset { material: material.into(), first, count };
        first += count;
        s
    };
    runs.iter().map(subset).collect()
}

/// Cuts the arrays into shares for whole tubes.
fn split<'a>(tubes: &'a [Tube], mesh: &'a mut Mesh, binding: &'a mut [Binding]) -> Vec<(&'a [Tube], Out<'a>)> {
    let (mut points, mut normals) = (mesh.points.as_mut_slice(), mesh.normals.as_mut_slice());
    let (mut uvs, mut triangles) = (mesh.uvs.as_mut_slice(), mesh.triangles.as_mut_slice());
    let mut binding = binding;
    let mut rest = tubes;
    let mut runs = Vec::new();
    while let Some(first) = rest.first() {
        let base = first.points.0;
        let n = rest.partition_point(|t| t.points.0 - base < RUN).max(1);
        let (run, after) = rest.split_at(n);
        let p = run.iter().map(|t| t.points.1 as usize).sum();
        let t = run.iter().map(|t| t.triangles.1 as usize).sum();
        runs.push((
            run,
            Out {
                points: take(&mut points, p),
                normals: take(&mut normals, p),
                uvs: take(&mut uvs, p),
                binding: take(&mut binding, p),
                triangles: take(&mut triangles, t),
                base,
                at: 0,
                done: 0,
            },
        ));
        rest = after;
    }
    runs
}

fn take<'a, T>(from: &mut &'a mut [T], n: usize) -> &'a mut [T] {
    let (head, tail) = std::mem::take(from).split_at_mut(n);
    *from = tail;
    head
}

fn write(shared: &Shared<'_>, axis: u32, out: &mut Out<'_>) {
    let i = axis as usize;
    let link = shared.links[i];
    let job = Job {
        shared: *shared,
        axis,
        plan: shared.plans.of(i),
        link,
        rings: shared.plans.rings(i),
        circle: shared.circles.of(link.sides),
    };
    job.tube(out);
}

impl Job<'_> {
    fn tube(&self, out: &mut Out<'_>) {
        let n = self.link.sides;
        let (rows, v) = (self.rings, v_scale(self.shared.options, &self.link));
        let mut below = self.begin(out);
        for ring in rows {
            let row = self.row(ring, v);
            let first = out.row(&row, self.circle);
            if let Some(below) = below {
                out.band(below, first, n);
            }
            below = Some(first);
        }
        if let (Some(last), Some(row)) = (rows.last(), below) {
            self.end(last, row, out);
        }
    }

    /// Cap below the first row and, for a side branch, its foot; the row that the first ring is joined to.
    fn begin(&self, out: &mut Out<'_>) -> Option<u32> {
        let first = self.rings.first()?;
        if let Base::Side(foot) = &self.plan.base {
            return Some(foot::write(self, foot, out));
        }
        let row = self.row(first, v_scale(self.shared.options, &self.link));
        self.disc(&row, first.t, true, out);
        None
    }

    /// Row of a regular ring.
    pub fn row(&self, ring: &Ring, v: f32) -> Row {
        let e = rolled(ring.t, ring.e, self.link.roll);
        let out = 1.0 / (1.0 + ring.slope * ring.slope).sqrt();
        Row {
            c: ring.c,
            e,
            b: ring.t.cross(e),
            r: ring.r,
            lean: ring.t * (-ring.slope * out),
            out,
            uv: [self.link.uv[0], self.link.repeats, self.link.uv[1] + v * v_of(self.shared.options, ring.v, ring.s)],
            bind: Binding { axis: self.axis, s: ring.s.max(0.0) },
        }
    }

    /// A flat cap on a row, with corners of its own.
    pub fn disc(&self, row: &Row, t: Vec3, down: bool, out: &mut Out<'_>) {
        let normal = if down { -t } else { t };
        let flat = Row { lean: normal, out: 0.0, ..*row };
        let first = out.row(&flat, self.circle);
        let uv = Vec2::new(row.uv[0] + 0.5 * row.uv[1], row.uv[2]);
        let middle = out.point(row.c, normal, uv, row.bind);
        out.fan(first, middle, self.link.sides, down);
    }

    fn end(&self, ring: &Ring, below: u32, out: &mut Out<'_>) {
        let n = self.link.sides;
        let row = self.row(ring, v_scale(self.shared.options, &self.link));
        let raised = |height: f32, v: f32| Row {
            c: row.c + ring.t * (height * ring.r),
            uv: [row.uv[0], row.uv[1], row.uv[2] + v],
            ..row
        };
        // One radius along the tip is this much of v.
        let step = 0.16 * self.link.repeats;
        match self.link.cap {
            Cap::Disc => self.disc(&row, ring.t, false, out),
            Cap::Point => {
                let tip = raised(1.0, step);
                let uv = Vec2::new(tip.uv[0] + 0.5 * tip.uv[1], tip.uv[2]);
                let apex = out.point(tip.c, ring.t, uv, row.bind);
                out.fan(below, apex, n, false);
            }
            Cap::Dome => {
                let mut below = below;
                for (sin, cos) in [(0.5, 0.866_025_4), (0.866_025_4, 0.5_f32)] {
                    let dome = Row { r: ring.r * cos, lean: ring.t * sin, out: cos, ..raised(sin, sin * step) };
                    let first = out.row(&dome, self.circle);
                    out.band(below, first, n);
                    below = first;
                }
                let tip = raised(1.0, step);
                let uv = Vec2::new(tip.uv[0] + 0.5 * tip.uv[1], tip.uv[2]);
                let apex = out.point(tip.c, ring.t, uv, row.bind);
                out.fan(below, apex, n, false);
            }
        }
    }
}
