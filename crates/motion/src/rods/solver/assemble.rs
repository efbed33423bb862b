//! Forces of all springs at once, and the matrix of their stiffness.

use pulp::{Arch, NullaryFnOnce};

use crate::rods::layout::Tree;
use crate::rods::prism::{Block, Corners, Frame, Grip, times, transposed_times};
use crate::rods::solver::block::{OVER, Rows, UP};
use crate::rods::springs::{BEND, LANES, LINK, Strain, pulls, scatter, spans, strain};
use osier_scene::plant::NONE;

/// A base that rides on a section of another rod, at one moment.
#[derive(Debug, Clone)]
pub(crate) struct Rider {
    x: Corners,
    v: Corners,
    /// How it moves with that section.
    j: Block,
}

impl Default for Rider {
    fn default() -> Self {
        Self { x: [0.0; 9], v: [0.0; 9], j: [[0.0; 9]; 9] }
    }
}

/// What the springs of a tree do in a place and motion.
pub(crate) struct Assembly<'a> {
    pub tree: &'a Tree,
    pub x: &'a [Corners],
    pub v: &'a [Corners],
    /// Damping by stiffness of each rod, s.
    pub damping: &'a [f64],
    pub riders: &'a mut [Rider],
    /// Forces on the sections, N.
    pub force: &'a mut [Corners],
    /// Where stiffness goes, and its factor for each rod.
    pub rows: Option<(&'a mut [Rows], &'a [f64])>,
}

impl Assembly<'_> {
    /// Fills forces, and rows if they are wanted. Allocates nothing.
    pub(crate) fn run(self) {
        Arch::new().dispatch(self);
    }
}

impl NullaryFnOnce for Assembly<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { tree, x, v, damping, riders, force, mut rows } = self;
        ride(tree, (x, v), riders);
        force.fill([0.0; 9]);
        if let Some((rows, _)) = &mut rows {
            rows.fill(Rows::default());
        }
        for (i, section) in tree.sections.iter().enumerate() {
            let ends = [0, 1].map(|k| match (section.base[k], tree.above[i][k]) {
                (NONE, NONE) => (&x[i], &v[i]),
                (NONE, on) => (&x[on as usize], &v[on as usize]),
                (base, _) => (&riders[base as usize].x, &riders[base as usize].v),
            });
            let state = strain(&spans(&x[i], ends[0].0, ends[1].0), &section.k, &section.l);
            let dv = spans(&v[i], ends[0].1, ends[1].1);
            let f = pulls(&state, &section.k, &dv, damping[section.rod]);
            let (mut own, mut others) = ([0.0; 9], [[0.0; 9]; 2]);
            let [up, over] = &mut others;
            scatter(&f, &mut own, up, over);
            gain(&mut force[i], &own);
            for k in 0..2 {
                match (section.base[k], tree.above[i][k]) {
                    (NONE, NONE) => {}
                    (NONE, on) => gain(&mut force[on as usize], &others[k]),
                    (base, on) => {
                        gain(&mut force[on as usize], &transposed_times(&riders[base as usize].j, &others[k]))
                    }
                }
            }
            if let Some((rows, factors)) = &mut rows {
                let parts = parts(&state, &section.k, factors[section.rod]);
                stiffen(&parts, (tree, i), riders, rows);
            }
        }
    }
}

#[inline(always)]
fn gain(to: &mut Corners, by: &Corners) {
    for k in 0..9 {
        to[k] += by[k];
    }
}

fn ride(tree: &Tree, (x, v): (&[Corners], &[Corners]), riders: &mut [Rider]) {
    for (rider, base) in riders.iter_mut().zip(&tree.bases) {
        let on = base.on as usize;
        rider.x = Frame::of(&x[on]).carry(&base.local);
        rider.j = Grip::of(&x[on]).carried(&rider.x);
        rider.v = times(&rider.j, &v[on]);
    }
}

/// xx, yy, zz, xy, xz, yz of each spring's stiffness.
type Parts = [[f64; LANES]; 6];

/// K = k [e e^T + max(0, 1 - L0/|d|) (1 - e e^T)].
#[inline(always)]
fn parts(s: &Strain, k: &[f64; LANES], factor: f64) -> Parts {
    let mut out = [[0.0; LANES]; 6];
    for i in 0..LANES {
        let across = factor * s.across[i];
        let along = factor * k[i] - across;
        let e = [s.e[0][i], s.e[1][i], s.e[2][i]];
        for axis in 0..3 {
            out[axis][i] = across + along * e[axis] * e[axis];
        }
        out[3][i] = along * e[0] * e[1];
        out[4][i] = along * e[0] * e[2];
        out[5][i] = along * e[1] * e[2];
    }
    out
}

#[inline(always)]
fn part(p: &Parts, lane: usize) -> [[f64; 3]; 3] {
    let [xx, yy, zz, xy, xz, yz] = [p[0][lane], p[1][lane], p[2][lane], p[3][lane], p[4][lane], p[5][lane]];
    [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
}

/// Adds the stiffness of one section's springs to the rows.
#[inline(always)]
fn stiffen(p: &Parts, (tree, i): (&Tree, usize), riders: &[Rider], rows: &mut [Rows]) {
    let mut own: Block = [[0.0; 9]; 9];
    let mut cross = [[[0.0; 9]; 9]; 2];
    let mut other = [[[[0.0; 3]; 3]; 3]; 2];
    for c in 0..3 {
        let (n, b) = ((c + 1) % 3, part(p, c));
        for r in 0..3 {
            for q in 0..3 {
                own[3 * c + r][3 * c + q] += b[r][q];
                own[3 * n + r][3 * n + q] += b[r][q];
                own[3 * c + r][3 * n + q] -= b[r][q];
                own[3 * n + r][3 * c + q] -= b[r][q];
            }
        }
    }
    let mut tie = |lane: usize, which: usize, (c, o): (usize, usize)| {
        let b = part(p, lane);
        for r in 0..3 {
            for q in 0..3 {
                own[3 * c + r][3 * c + q] += b[r][q];
                cross[which][3 * c + r][3 * o + q] -= b[r][q];
                other[which][o][r][q] += b[r][q];
            }
        }
    };
    for c in 0..3 {
        for o in 0..3 {
            tie(LINK + 3 * c + o, 0, (c, o));
        }
        tie(BEND + c, 1, (c, c));
    }
    for r in 0..9 {
        for q in 0..9 {
            rows[i].0[r][q] += own[r][q];
        }
    }
    let section = &tree.sections[i];
    for (which, at) in [UP, OVER].into_iter().enumerate() {
        let on = tree.above[i][which];
        if on == NONE {
            continue;
        }
        let j = (section.base[which] != NONE).then(|| &riders[section.base[which] as usize].j);
        tie_to(&cross[which], &other[which], j, (rows, i, on as usize, at));
    }
}

/// Adds what couples section `i` to another, and that one's own share; `j`: if the springs end on a base that rides on it.
#[inline(always)]
fn tie_to(
    cross: &Block,
    other: &[[[f64; 3]; 3]; 3],
    j: Option<&Block>,
    (rows, i, on, at): (&mut [Rows], usize, usize, usize),
) {
    let Some(j) = j else {
        for r in 0..9 {
            for q in 0..9 {
                rows[i].0[r][at + q] += cross[r][q];
            }
        }
        for c in 0..3 {
            for r in 0..3 {
                for q in 0..3 {
                    rows[on].0[3 * c + r][3 * c + q] += other[c][r][q];
                }
            }
        }
        return;
    };
    for r in 0..9 {
        for a in 0..9 {
            for q in 0..9 {
                rows[i].0[r][at + q] += cross[r][a] * j[a][q];
            }
        }
    }
    // J^T A J, A made of a block of three for each corner.
    let mut aj = [[0.0; 9]; 9];
    for c in 0..3 {
        for r in 0..3 {
            for a in 0..3 {
                for q in 0..9 {
                    aj[3 * c + r][q] += other[c][r][a] * j[3 * c + a][q];
                }
            }
        }
    }
    for r in 0..9 {
        for a in 0..9 {
            for q in 0..9 {
                rows[on].0[r][q] += j[a][r] * aj[a][q];
            }
        }
    }
}
