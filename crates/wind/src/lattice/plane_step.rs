//! A step of one plane of cells: what arrives is put, cells collide, what leaves is taken.

use pulp::Simd;

use super::collide::{Collided, FAST, FASTEST, Relax, collide, moments};
use super::domain::Cells;
use super::exchange::{Arriving, Leaving, Planes};
use super::grid::{BLOCK, Grid, Parity};
use super::ground::hold;
use super::row_halo::{End, Ends, NONE};
use super::snapshot::{Field, Plane};
use super::stencil::{Q, opposite};
use super::stepper::Sweep;
use osier_base::simd::{F32Lanes, Lane as _};

/// What a thread has at hand from plane to plane.
pub(super) struct Desk<'a> {
    ends: Ends,
    /// Velocity by component and density less 1 of a plane, where a snapshot is made.
    air: [Vec<f32>; 4],
    /// Where it is written: the field, m/s of one cell a step, and planes of values.
    snapshot: Option<(&'a Field, f32)>,
    pages: Vec<(usize, &'a mut [[f32; 4]])>,
    /// What was seen in each.
    pub seen: Vec<(usize, Plane)>,
}

impl<'a> Desk<'a> {
    /// `pages`: of which planes, from the last to the first.
    pub(super) fn new(
        grid: &Grid,
        snapshot: Option<(&'a Field, f32)>,
        pages: Vec<(usize, &'a mut [[f32; 4]])>,
    ) -> Self {
        let length = if pages.is_empty() { 0 } else { grid.span().next_multiple_of(BLOCK) };
        Self {
            ends: Ends::new(grid),
            air: std::array::from_fn(|_| vec![0.0; length]),
            snapshot,
            pages,
            seen: Vec::new(),
        }
    }

    /// Writes down the plane that was computed.
    #[inline(always)]
    fn write(&mut self, cells: &Cells, z: usize) {
        let (Some((field, speed)), Some((_, page))) = (self.snapshot, self.pages.pop_if(|(of, _)| *of == z)) else {
            return;
        };
        let (row, [nx, ny, _]) = (cells.grid.row, cells.grid.n);
        let mut plane = Plane::default();
        for y in 0..ny {
            let part = self.air.each_mut().map(|part| &mut part[y * row..y * row + nx]);
            plane.row(cells, (y, z), part, Some((field, speed, page)));
        }
        field.edge(page);
        self.seen.push((z, plane));
    }
}

/// A plane in hand.
#[derive(Clone, Copy)]
pub(super) struct Place<'a> {
    pub sweep: &'a Sweep,
    pub cells: &'a Cells,
    pub arriving: Arriving<'a>,
    pub z: usize,
    /// The step is the one that a snapshot is of.
    pub last: bool,
}

/// The fifteen arrays of a plane under names of their own, all of one length that the compiler knows to be one.
macro_rules! bind {
    ($simd:ty, $arrays:expr, $start:expr, $length:expr; $($name:ident $k:literal)*) => {
        let [$($name),*] = $arrays else { return 0.0 };
        let count = $length / <$simd>::F32_LANES;
        $(let $name = &mut <$simd>::as_mut_simd_f32s(&mut $name[$start($k)..][..$length]).0[..count];)*
    };
}

impl Place<'_> {
    /// A step of the plane, from what arrives at it to what leaves it. `fastest`: square of the largest speed in the step
    /// before, and then in this one.
    #[inline(always)]
    pub(super) fn step<S: Simd, const ODD: bool, const EDDIES: bool, const FORCE: bool>(
        self,
        simd: S,
        planes: &mut Planes<'_>,
        desk: &mut Desk<'_>,
        (room, fastest): (&mut Leaving<'_>, &mut f32),
    ) -> u64 {
        let parity = if ODD { Parity::Odd } else { Parity::Even };
        self.arriving.put(planes, &mut desk.ends, (parity, self.z));
        let mut clamped = 0;
        // To look at the speed in the middle of a collision, or to ask whether air is noted, takes a tenth of its time.
        let noted = self.last && desk.pages.last().is_some_and(|(of, _)| *of == self.z);
        if noted || f64::from(*fastest) > FAST * FAST {
            let counted = &mut clamped;
            *fastest = self.collide::<S, ODD, EDDIES, FORCE, true>(simd, planes, desk, (room, counted));
        } else {
            *fastest = self.collide::<S, ODD, EDDIES, FORCE, false>(simd, planes, desk, (room, &mut 0));
        }
        if self.last {
            desk.write(self.cells, self.z);
        }
        self.arriving.take(planes, (parity, self.z), room);
        self.vent(simd, planes, parity, room);
        clamped
    }

    #[inline(always)]
    fn collide<S: Simd, const ODD: bool, const EDDIES: bool, const FORCE: bool, const CAREFUL: bool>(
        self,
        simd: S,
        planes: &mut Planes<'_>,
        desk: &mut Desk<'_>,
        (room, clamped): (&mut Leaving<'_>, &mut u64),
    ) -> f32 {
        let Self { sweep, cells, z, .. } = self;
        let Desk { ends, air, pages, .. } = desk;
        let grid = &sweep.grid;
        let length = grid.span().next_multiple_of(BLOCK);
        let first = planes.before(grid, z) + grid.first;
        let parity = if ODD { Parity::Odd } else { Parity::Even };
        let start = |k: usize| first.wrapping_add_signed(grid.aside(parity, k));
        let mut fastest = F32Lanes::from_scalar(simd, 0.0);
        let parts = BLOCK / S::F32_LANES;
        let v = &sweep.viscosity;
        let deep = F32Lanes::from_scalar(simd, v.sponge[1].get(z).copied().unwrap_or(0.0));
        let plain = Relax::new(
            F32Lanes::from_scalar(simd, v.tau),
            F32Lanes::from_scalar(simd, v.eddies),
            [
                F32Lanes::from_scalar(simd, v.force[0]),
                F32Lanes::from_scalar(simd, v.force[1]),
                F32Lanes::from_scalar(simd, v.force[2]),
            ],
        );
        bind!(S, planes.arrays.as_mut_slice(), start, length;
            a0 0 a1 1 a2 2 a3 3 a4 4 a5 5 a6 6 a7 7 a8 8 a9 9 a10 10 a11 11 a12 12 a13 13 a14 14);
        let last = length / S::F32_LANES;
        // The lowest row, if ground drags.
        let low = sweep.drag[0].len().saturating_sub(BLOCK);
        let mut noted = if CAREFUL && self.last && pages.last().is_some_and(|(of, _)| *of == z) {
            let [x, y, z, drho] = air.each_mut().map(|part| &mut S::as_mut_simd_f32s(&mut part[..length]).0[..last]);
            Some((x, y, z, drho))
        } else {
            None
        };
        let mut next = 0;
        for run in sweep.runs(z) {
            let mut relax = plain;
            let (from, to) = (run.from as usize * parts, (run.to as usize * parts).min(length / S::F32_LANES));
            next += sweep.ends[next..].iter().take_while(|end| end.block < from).count();
            let mut due = sweep.ends[next].block;
            for b in from..to {
                let node = b * S::F32_LANES;
                if run.varied {
                    let (along, sponge) = (lanes(simd, &sweep.least[0], node), lanes(simd, &sweep.least[1], node));
                    relax = plain.with(along.max(deep.mul_add(sponge, plain.tau)));
                }
                let read = [
                    a0[b], a1[b], a2[b], a3[b], a4[b], a5[b], a6[b], a7[b], a8[b], a9[b], a10[b], a11[b], a12[b],
                    a13[b], a14[b],
                ];
                let mut g = [relax.tau; Q];
                for i in 0..Q {
                    g[i] = F32Lanes::new(simd, read[if ODD { opposite(i) } else { i }]);
                }
                if b == due {
                    for end in sweep.ends[next..].iter().take_while(|end| end.block == b) {
                        ends.hand(simd, *end, &mut g);
                    }
                }
                if node < low {
                    let (drag, share) = (lanes(simd, &sweep.drag[0], node), lanes(simd, &sweep.drag[1], node));
                    hold(&mut g, drag, share.max(deep) * F32Lanes::from_scalar(simd, v.ground.more));
                }
                let limit = if CAREFUL { FASTEST * FASTEST } else { f64::INFINITY };
                let after = collide::<_, EDDIES, FORCE>(&g, relax, limit);
                fastest = fastest.max(after.square);
                if CAREFUL && after.square.any_gt(FASTEST * FASTEST) {
                    *clamped += too_fast(cells, &spelt(after.square)[..S::F32_LANES], node, z);
                }
                let mut done = [after.g[0].value; Q];
                for i in 0..Q {
                    done[if ODD { i } else { opposite(i) }] = after.g[i].value;
                }
                [
                    a0[b], a1[b], a2[b], a3[b], a4[b], a5[b], a6[b], a7[b], a8[b], a9[b], a10[b], a11[b], a12[b],
                    a13[b], a14[b],
                ] = done;
                if CAREFUL && let Some((x, y, z, drho)) = &mut noted {
                    (x[b], y[b], z[b], drho[b]) =
                        (after.u[0].value, after.u[1].value, after.u[2].value, after.drho.value);
                }
                if b == due {
                    while due == b {
                        self.vent_end(sweep.ends[next], &after, room);
                        next += 1;
                        due = sweep.ends[next].block;
                    }
                }
            }
        }
        spelt(fastest).into_iter().fold(0.0, f32::max)
    }

    /// Takes the air in the cells at open ends of a row in a block.
    #[inline(always)]
    fn vent_end<S: Simd>(self, end: End, after: &Collided<F32Lanes<S>>, room: &mut Leaving<'_>) {
        let plan = self.arriving.plan;
        for (column, lane) in plan.joints[self.z].columns.into_iter().zip(end.lanes) {
            let Some(column) = column.filter(|_| lane != NONE) else { continue };
            let (lane, number) = (lane as usize, column + end.y as usize - room.air.1);
            let air = [after.drho, after.u[0], after.u[1], after.u[2]];
            for (to, from) in room.air.0.iter_mut().zip(air) {
                to[number] = spelt(from)[lane];
            }
            if plan.rest {
                for (to, from) in room.parts[number].iter_mut().zip(&after.g) {
                    *to = spelt(*from)[lane];
                }
            }
        }
    }

    /// Takes the air in the other cells before open faces.
    #[inline(always)]
    fn vent<S: Simd>(self, simd: S, planes: &Planes<'_>, parity: Parity, room: &mut Leaving<'_>) {
        let plan = self.arriving.plan;
        let joint = &plan.joints[self.z];
        let mut number = joint.first_run(plan.grid.n[1]) - room.air.1;
        for run in &plan.near[joint.near.clone()] {
            for skip in (0..run.count as usize).step_by(BLOCK) {
                let count = BLOCK.min(run.count as usize - skip);
                let mut g = [[0.0_f32; BLOCK]; Q];
                self.arriving.vent(planes, (parity, self.z), (*run, skip), &mut g);
                for part in 0..count.div_ceil(S::F32_LANES) {
                    let mut all = [F32Lanes::from_scalar(simd, 0.0); Q];
                    for i in 0..Q {
                        all[i] = lanes(simd, &g[i], part * S::F32_LANES);
                    }
                    let (drho, u) = moments(&all);
                    let from = part * S::F32_LANES;
                    let some = S::F32_LANES.min(count - from);
                    for (to, value) in room.air.0.iter_mut().zip([drho, u[0], u[1], u[2]]) {
                        to[number + from..][..some].copy_from_slice(&spelt(value)[..some]);
                    }
                }
                if plan.rest {
                    for (k, parts) in room.parts[number..number + count].iter_mut().enumerate() {
                        parts.iter_mut().zip(&g).for_each(|(to, from)| *to = from[k]);
                    }
                }
                number += count;
            }
        }
    }
}

#[inline(always)]
fn lanes<S: Simd>(simd: S, from: &[f32], at: usize) -> F32Lanes<S> {
    F32Lanes::new(simd, S::as_simd_f32s(&from[at..at + S::F32_LANES]).0[0])
}

/// Lanes as numbers.
#[inline(always)]
fn spelt<S: Simd>(value: F32Lanes<S>) -> [f32; BLOCK] {
    let mut numbers = [0.0; BLOCK];
    S::as_mut_simd_f32s(&mut numbers).0[0] = value.value;
    numbers
}

/// Fluid cells among some nodes whose squared speed is over the limit. `at`: the first node's number in its plane, from the
/// first cell.
#[cold]
#[inline(never)]
fn too_fast(cells: &Cells, squares: &[f32], at: usize, z: usize) -> u64 {
    let limit = osier_base::math::narrow(FASTEST * FASTEST);
    let hit = |(k, uu): (usize, &f32)| {
        let (x, y) = ((at + k) % cells.grid.row, (at + k) / cells.grid.row);
        *uu > limit && x < cells.grid.n[0] && y < cells.grid.n[1] && !cells.is_solid([x, y, z])
    };
    squares.iter().enumerate().filter(|s| hit(*s)).count() as u64
}
