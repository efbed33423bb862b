//! One step of the whole domain: collision and streaming in place, many nodes at once.

use pulp::{Arch, Simd, WithSimd};

use super::cells::Cells;
use super::collide::moments;
use super::collide::{FASTEST, Relax, collide};
use super::grid::{BLOCK, Grid, Parity, Populations};
use super::lane::{Lane as _, Wide};
use super::links::{Arriving, BAND, Leaving, Links};
use super::open::lanes;
use super::stencil::{C, Q, opposite};
use crate::par;

/// Planes that are computed by one thread at a time.
const SLAB: usize = 4;

/// Blocks of a band that are computed, from the first to before the last.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Run {
    from: u32,
    to: u32,
    /// Relaxation times are those of the tables.
    sponge: bool,
}

/// How air relaxes.
#[derive(Debug, Clone)]
pub(super) struct Viscosity {
    /// Relaxation time without eddies, steps.
    pub tau: f32,
    /// As [`super::collide::eddies`].
    pub eddies: f32,
    /// Least relaxation times by x and by z, where a sponge lies before an outlet; `tau` elsewhere.
    pub sponge: [Vec<f32>; 2],
    /// Body force, cells a step squared; 0 in every wind.
    pub force: [f32; 3],
}

/// What is computed, and how.
#[derive(Debug)]
pub(super) struct Sweep {
    grid: Grid,
    viscosity: Viscosity,
    /// Those of every band, as the joints of [`Links`] are ordered.
    bands: Vec<Vec<Run>>,
    /// As `viscosity.sponge`, in the order of memory: a row of numbers, and a block more of the next.
    across: Vec<f32>,
    pub(super) arch: Arch,
}

impl Sweep {
    pub(super) fn new(cells: &Cells, viscosity: Viscosity) -> Self {
        let grid = cells.grid;
        let bands = (0..grid.n[2] * grid.bands()).map(|band| runs(cells, &viscosity, band)).collect();
        let across = |k: usize| viscosity.sponge[0].get(k % grid.row).copied().unwrap_or(viscosity.tau);
        let across = (0..grid.row + BLOCK).map(across).collect();
        Self { grid, viscosity, bands, across, arch: Arch::new() }
    }

    /// Computes every fluid cell once. Returns how many were too fast and clamped.
    /// `wind`, `wanted`: as [`Links::meet`].
    pub(super) fn step(
        &self,
        populations: &mut Populations,
        links: &mut Links,
        (parity, cells): (Parity, &Cells),
        (wind, wanted): (&[Vec<f32>; 3], [f32; 6]),
    ) -> u64 {
        let (arriving, rooms) = links.meet(wind, wanted, SLAB * self.grid.bands(), self.arch);
        let mut slabs = self.slabs(populations, parity);
        for (slab, room) in slabs.iter_mut().zip(rooms) {
            slab.leaving = Some(room);
        }
        let eddies = self.viscosity.eddies > 0.0;
        let forced = self.viscosity.force.iter().any(|f| f.abs() > 0.0);
        par::par_each(&mut slabs, |slab| {
            let turn = Turn { sweep: self, slab, cells, arriving };
            match (parity, eddies, forced) {
                (Parity::Even, true, false) => self.arch.dispatch(Even::<true, false>(turn)),
                (Parity::Odd, true, false) => self.arch.dispatch(Odd::<true, false>(turn)),
                (Parity::Even, false, false) => self.arch.dispatch(Even::<false, false>(turn)),
                (Parity::Odd, false, false) => self.arch.dispatch(Odd::<false, false>(turn)),
                (Parity::Even, _, true) => self.arch.dispatch(Even::<false, true>(turn)),
                (Parity::Odd, _, true) => self.arch.dispatch(Odd::<false, true>(turn)),
            }
        });
        let clamped = slabs.iter().map(|s| s.clamped).sum();
        links.turn();
        clamped
    }

    /// The arrays cut into slabs that share nothing: a step touches array k at node x, or at x + c_k alone.
    #[allow(clippy::cast_sign_loss, reason = "from 0 to 2")]
    fn slabs<'a>(&self, populations: &'a mut Populations, parity: Parity) -> Vec<Slab<'a>> {
        let plane = self.grid.plane;
        let count = self.grid.n[2].div_ceil(SLAB);
        let mut slabs: Vec<Slab<'a>> = (0..count)
            .map(|s| Slab { z: s * SLAB, arrays: Vec::with_capacity(Q), leaving: None, clamped: 0 })
            .collect();
        for (k, array) in populations.arrays_mut().into_iter().enumerate() {
            let skip = if parity == Parity::Odd { 1 + C[k][2] } else { 1 } as usize;
            let parts = array[skip * plane..].chunks_mut(SLAB * plane);
            slabs.iter_mut().zip(parts).for_each(|(slab, part)| slab.arrays.push(part));
        }
        slabs
    }
}

/// Blocks of a band that hold air, joined while they are of one kind.
fn runs(cells: &Cells, viscosity: &Viscosity, band: usize) -> Vec<Run> {
    let grid = cells.grid;
    let (z, first) = (band / grid.bands(), band % grid.bands() * BAND);
    let deep = viscosity.sponge[1].get(z).is_some_and(|t| *t > viscosity.tau);
    let rises: Vec<bool> =
        (0..grid.n[0]).map(|x| viscosity.sponge[0].get(x).is_some_and(|t| *t > viscosity.tau)).collect();
    let mut runs: Vec<Run> = Vec::new();
    for block in 0..BAND.min(grid.span() - first).div_ceil(BLOCK) {
        let from = first + block * BLOCK;
        let air = |k: usize| {
            let (x, y) = (k % grid.row, k / grid.row);
            (x < grid.n[0] && y < grid.n[1] && !cells.is_solid([x, y, z])).then_some(x)
        };
        if !(from..from + BLOCK).any(|k| air(k).is_some()) {
            continue;
        }
        let at = u32::try_from(block).unwrap_or(u32::MAX);
        let sponge = deep || (from..from + BLOCK).filter_map(air).any(|x| rises[x]);
        match runs.last_mut() {
            Some(last) if last.to == at && last.sponge == sponge => last.to += 1,
            _ => runs.push(Run { from: at, to: at + 1, sponge }),
        }
    }
    runs
}

/// Some planes of every array.
struct Slab<'a> {
    /// First plane.
    z: usize,
    arrays: Vec<&'a mut [f32]>,
    leaving: Option<Leaving<'a>>,
    clamped: u64,
}

struct Turn<'a, 'b> {
    sweep: &'a Sweep,
    slab: &'a mut Slab<'b>,
    cells: &'a Cells,
    arriving: Arriving<'a>,
}

struct Even<'a, 'b, const EDDIES: bool, const FORCE: bool>(Turn<'a, 'b>);
struct Odd<'a, 'b, const EDDIES: bool, const FORCE: bool>(Turn<'a, 'b>);

impl<const EDDIES: bool, const FORCE: bool> WithSimd for Even<'_, '_, EDDIES, FORCE> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.0.run::<S, false, EDDIES, FORCE>(simd);
    }
}

impl<const EDDIES: bool, const FORCE: bool> WithSimd for Odd<'_, '_, EDDIES, FORCE> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.0.run::<S, true, EDDIES, FORCE>(simd);
    }
}

/// The fifteen arrays of a plane under names of their own, all of one length that the compiler knows to be one.
macro_rules! bind {
    ($simd:ty, $arrays:expr, $start:expr, $length:expr; $($name:ident $k:literal)*) => {
        let [$($name),*] = $arrays else { return };
        let count = $length / <$simd>::F32_LANES;
        $(let $name = &mut <$simd>::as_mut_simd_f32s(&mut $name[$start($k)..][..$length]).0[..count];)*
    };
}

impl Turn<'_, '_> {
    #[inline(always)]
    fn run<S: Simd, const ODD: bool, const EDDIES: bool, const FORCE: bool>(self, simd: S) {
        let Self { sweep, slab, cells, arriving } = self;
        let parity = if ODD { Parity::Odd } else { Parity::Even };
        let bands = sweep.grid.bands();
        let first = slab.z * bands;
        for plane in 0..SLAB.min(sweep.grid.n[2] - slab.z) {
            for k in 0..bands {
                let band = first + plane * bands + k;
                arriving.put(&mut slab.arrays, parity, band, plane);
                band_step::<S, ODD, EDDIES, FORCE>(simd, (sweep, cells), slab, (plane, band));
                if let Some(room) = &mut slab.leaving {
                    arriving.take(&slab.arrays, parity, (first, band, plane), room);
                    vent(simd, (&slab.arrays, arriving), parity, (first, band, plane), room);
                }
            }
        }
    }
}

/// Takes the air in the cells before open faces.
#[inline(always)]
fn vent<S: Simd>(
    simd: S,
    (planes, arriving): (&[&mut [f32]], Arriving<'_>),
    parity: Parity,
    (first, band, plane): (usize, usize, usize),
    room: &mut Leaving<'_>,
) {
    let mut number = arriving.beside(first, band).start;
    for run in arriving.near(band) {
        for skip in (0..run.count as usize).step_by(BLOCK) {
            let count = BLOCK.min(run.count as usize - skip);
            let (mut g, mut air) = ([[0.0_f32; BLOCK]; Q], [[0.0_f32; BLOCK]; 4]);
            arriving.vent(planes, parity, (*run, skip, plane), &mut g);
            for part in 0..BLOCK / S::F32_LANES {
                let mut all = [Wide::splat(simd, 0.0); Q];
                for i in 0..Q {
                    all[i] = lanes(simd, &g[i], part);
                }
                let (drho, u) = moments(&all);
                for (to, from) in air.iter_mut().zip([drho, u[0], u[1], u[2]]) {
                    S::as_mut_simd_f32s(to).0[part] = from.value;
                }
            }
            for k in 0..count {
                room.air[number + k] = [air[0][k], air[1][k], air[2][k], air[3][k]];
                if arriving.rest() {
                    for (to, from) in room.parts[number + k].iter_mut().zip(&g) {
                        *to = from[k];
                    }
                }
            }
            number += count;
        }
    }
}

#[inline(always)]
fn band_step<S: Simd, const ODD: bool, const EDDIES: bool, const FORCE: bool>(
    simd: S,
    (sweep, cells): (&Sweep, &Cells),
    slab: &mut Slab<'_>,
    (plane, band): (usize, usize),
) {
    let grid = &sweep.grid;
    let z = slab.z + plane;
    let at = band % grid.bands() * BAND;
    let length = BAND.min(grid.span() - at).next_multiple_of(BLOCK);
    let first = plane * grid.plane + grid.first() + at;
    let parity = if ODD { Parity::Odd } else { Parity::Even };
    let start = |k: usize| first.wrapping_add_signed(grid.aside(parity, k));
    let mut clamped = 0;
    let parts = BLOCK / S::F32_LANES;
    let v = &sweep.viscosity;
    let deep = v.sponge[1].get(z).copied().unwrap_or(v.tau);
    let relax = Relax {
        tau: Wide::splat(simd, v.tau),
        eddies: Wide::splat(simd, v.eddies),
        force: [Wide::splat(simd, v.force[0]), Wide::splat(simd, v.force[1]), Wide::splat(simd, v.force[2])],
    };
    bind!(S, slab.arrays.as_mut_slice(), start, length;
        a0 0 a1 1 a2 2 a3 3 a4 4 a5 5 a6 6 a7 7 a8 8 a9 9 a10 10 a11 11 a12 12 a13 13 a14 14);
    for run in &sweep.bands[band] {
        let (from, to) = (run.from as usize * parts, (run.to as usize * parts).min(length / S::F32_LANES));
        let mut relax = relax;
        for b in from..to {
            if run.sponge {
                let x = Wide::new(simd, S::as_simd_f32s(&sweep.across[(at + b * S::F32_LANES) % grid.row..]).0[0]);
                let z = Wide::splat(simd, deep);
                relax.tau = Wide::new(simd, simd.max_f32s(x.value, z.value));
            }
            let read = [
                a0[b], a1[b], a2[b], a3[b], a4[b], a5[b], a6[b], a7[b], a8[b], a9[b], a10[b], a11[b], a12[b], a13[b],
                a14[b],
            ];
            let mut g = [relax.tau; Q];
            for i in 0..Q {
                g[i] = Wide::new(simd, read[if ODD { opposite(i) } else { i }]);
            }
            let (out, uu) = collide::<_, EDDIES, FORCE>(&g, relax);
            if uu.any_above(FASTEST * FASTEST) {
                let mut lanes = [0.0; BLOCK];
                S::as_mut_simd_f32s(&mut lanes).0[0] = uu.value;
                clamped += too_fast(cells, &lanes[..S::F32_LANES], at + b * S::F32_LANES, z);
            }
            let mut done = [out[0].value; Q];
            for i in 0..Q {
                done[if ODD { i } else { opposite(i) }] = out[i].value;
            }
            [
                a0[b], a1[b], a2[b], a3[b], a4[b], a5[b], a6[b], a7[b], a8[b], a9[b], a10[b], a11[b], a12[b], a13[b],
                a14[b],
            ] = done;
        }
    }
    slab.clamped += clamped;
}

/// Fluid cells among some nodes whose squared speed is over the limit. `at`: the first node's number in its plane, from the
/// first cell.
#[cold]
#[inline(never)]
fn too_fast(cells: &Cells, squares: &[f32], at: usize, z: usize) -> u64 {
    let limit = crate::math::narrow(FASTEST * FASTEST);
    let hit = |(k, uu): (usize, &f32)| {
        let (x, y) = ((at + k) % cells.grid.row, (at + k) / cells.grid.row);
        *uu > limit && x < cells.grid.n[0] && y < cells.grid.n[1] && !cells.is_solid([x, y, z])
    };
    squares.iter().enumerate().filter(|s| hit(*s)).count() as u64
}
