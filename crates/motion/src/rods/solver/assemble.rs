//! Assembly of spring forces and of their tangent stiffness matrix.

use pulp::{Arch, NullaryFnOnce};

use crate::rods::layout::SectionTree;
use crate::rods::prism::{CornerRigidMotion, Matrix9, SectionFrame, Vector9, matrix_vector, transposed_matrix_vector};
use crate::rods::solver::block::{BlockRow, PREDECESSOR, SECOND_PREDECESSOR};
use crate::rods::springs::{
    FIRST_BEND_SPRING, FIRST_LINK_SPRING, SPRINGS_PER_SECTION, SpringStates, add_spring_forces, spring_forces,
    spring_state, spring_vectors,
};
use osier_scene::plant::NONE;

/// Positions, m, and velocities, m/s, of the corners of a base that is rigid with a section of the parent rod.
#[derive(Debug, Clone)]
pub(crate) struct AttachedBaseState {
    x: Vector9,
    v: Vector9,
    /// Jacobian of its corners with respect to those of the carrying section.
    j: Matrix9,
}

impl Default for AttachedBaseState {
    fn default() -> Self {
        Self { x: [0.0; 9], v: [0.0; 9], j: [[0.0; 9]; 9] }
    }
}

/// Inputs and outputs of one assembly over all springs of a tree.
pub(crate) struct SpringAssembly<'a> {
    pub tree: &'a SectionTree,
    pub x: &'a [Vector9],
    pub v: &'a [Vector9],
    /// Stiffness-proportional damping coefficient of each rod, s.
    pub damping: &'a [f64],
    pub attached_bases: &'a mut [AttachedBaseState],
    /// Forces on the sections, N.
    pub force: &'a mut [Vector9],
    /// Block rows of the tangent stiffness, and its factor for each rod; `None` to compute forces only.
    pub rows: Option<(&'a mut [BlockRow], &'a [f64])>,
}

impl SpringAssembly<'_> {
    /// Computes forces, and block rows if they are given, with the widest instructions of the machine. Allocates
    /// nothing.
    pub(crate) fn assemble(self) {
        Arch::new().dispatch(self);
    }
}

impl NullaryFnOnce for SpringAssembly<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { tree, x, v, damping, attached_bases, force, mut rows } = self;
        // Bases that are attached to a section of another rod follow it rigidly: x = p + R x_local, v = J v_section.
        update_attached_bases(tree, x, v, attached_bases);
        force.fill([0.0; 9]);
        if let Some((rows, _)) = &mut rows {
            rows.fill(BlockRow::default());
        }
        for (i, section) in tree.sections.iter().enumerate() {
            // Corners at the far ends of the springs: the previous section and the one before it, each a free section or
            // the attached base of the rod. Where there is none the springs have zero stiffness and may end anywhere.
            let ends = [0, 1].map(|k| match (section.base[k], tree.predecessors[i][k]) {
                (NONE, NONE) => (&x[i], &v[i]),
                (NONE, on) => (&x[on as usize], &v[on as usize]),
                (base, _) => (&attached_bases[base as usize].x, &attached_bases[base as usize].v),
            });
            // Tension k (|d| - L0) along e = d/|d|; damping acts as b K v with the same tangent stiffness K.
            let state =
                spring_state(&spring_vectors(&x[i], ends[0].0, ends[1].0), &section.stiffness, &section.rest_lengths);
            let dv = spring_vectors(&v[i], ends[0].1, ends[1].1);
            let f = spring_forces(&state, &section.stiffness, &dv, damping[section.rod]);
            // Newton's third law: each spring pulls with +f at this section and -f at its far end.
            let (mut own, mut others) = ([0.0; 9], [[0.0; 9]; 2]);
            let [up, over] = &mut others;
            add_spring_forces(&f, &mut own, up, over);
            add_corners(&mut force[i], &own);
            for k in 0..2 {
                match (section.base[k], tree.predecessors[i][k]) {
                    (NONE, NONE) => {}
                    (NONE, on) => add_corners(&mut force[on as usize], &others[k]),
                    (base, on) => add_corners(
                        &mut force[on as usize],
                        &transposed_matrix_vector(&attached_bases[base as usize].j, &others[k]),
                    ),
                }
            }
            // Tangent stiffness blocks, scaled per rod by 1 + b/ht for the implicit damping.
            if let Some((rows, factors)) = &mut rows {
                let spring_tangents = spring_tangents(&state, &section.stiffness, factors[section.rod]);
                add_spring_blocks(&spring_tangents, tree, i, attached_bases, rows);
            }
        }
    }
}

#[inline(always)]
fn add_corners(to: &mut Vector9, by: &Vector9) {
    for k in 0..9 {
        to[k] += by[k];
    }
}

/// Updates corners, velocities and Jacobians of the rod bases that are rigid with a section of another rod. `x`, m, `v`, m/s:
/// all sections.
fn update_attached_bases(tree: &SectionTree, x: &[Vector9], v: &[Vector9], attached_bases: &mut [AttachedBaseState]) {
    for (rider, base) in attached_bases.iter_mut().zip(&tree.bases) {
        let on = base.on as usize;
        rider.x = SectionFrame::from_corners(&x[on]).local_positions_to_world(&base.local);
        rider.j = CornerRigidMotion::from_corners(&x[on]).attachment_jacobian(&rider.x);
        rider.v = matrix_vector(&rider.j, &v[on]);
    }
}

/// Components xx, yy, zz, xy, xz, yz of each spring's symmetric 3x3 stiffness.
type SpringStiffnessMatrices = [[f64; SPRINGS_PER_SECTION]; 6];

/// Tangent stiffness K = k [e e^T + max(0, 1 - L0/|d|) (1 - e e^T)] of each spring, times `factor`.
#[inline(always)]
fn spring_tangents(s: &SpringStates, k: &[f64; SPRINGS_PER_SECTION], factor: f64) -> SpringStiffnessMatrices {
    let mut out = [[0.0; SPRINGS_PER_SECTION]; 6];
    for i in 0..SPRINGS_PER_SECTION {
        // across 1 + (k - across) e e^T, the same expression with one product per component.
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
fn unpack_spring_matrix(p: &SpringStiffnessMatrices, lane: usize) -> [[f64; 3]; 3] {
    let [xx, yy, zz, xy, xz, yz] = [p[0][lane], p[1][lane], p[2][lane], p[3][lane], p[4][lane], p[5][lane]];
    [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
}

/// Adds the stiffness blocks of the springs of section `i` to its block row and to those of its predecessors.
#[inline(always)]
fn add_spring_blocks(
    p: &SpringStiffnessMatrices,
    tree: &SectionTree,
    i: usize,
    attached_bases: &[AttachedBaseState],
    rows: &mut [BlockRow],
) {
    // A spring between corners c and o adds its 3x3 block B to (c, c) and (o, o) and -B to (c, o) and (o, c); only
    // the blocks of a section with itself and with its predecessors are stored, as the matrix is symmetric.
    let mut own: Matrix9 = [[0.0; 9]; 9];
    let mut cross = [[[0.0; 9]; 9]; 2];
    let mut other = [[[[0.0; 3]; 3]; 3]; 2];
    // Springs around the section join corners c and c + 1 of the same section.
    for c in 0..3 {
        let (n, b) = ((c + 1) % 3, unpack_spring_matrix(p, c));
        for r in 0..3 {
            for q in 0..3 {
                own[3 * c + r][3 * c + q] += b[r][q];
                own[3 * n + r][3 * n + q] += b[r][q];
                own[3 * c + r][3 * n + q] -= b[r][q];
                own[3 * n + r][3 * c + q] -= b[r][q];
            }
        }
    }
    let mut tie = |lane: usize, which: usize, c: usize, o: usize| {
        let b = unpack_spring_matrix(p, lane);
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
            tie(FIRST_LINK_SPRING + 3 * c + o, 0, c, o);
        }
        tie(FIRST_BEND_SPRING + c, 1, c, c);
    }
    // Blocks are accumulated locally first, so that each block row is accessed once per section instead of once per spring.
    for r in 0..9 {
        for q in 0..9 {
            rows[i].0[r][q] += own[r][q];
        }
    }
    let section = &tree.sections[i];
    for (which, at) in [PREDECESSOR, SECOND_PREDECESSOR].into_iter().enumerate() {
        let on = tree.predecessors[i][which];
        if on == NONE {
            continue;
        }
        let j = (section.base[which] != NONE).then(|| &attached_bases[section.base[which] as usize].j);
        let coupling = PredecessorStiffness { cross: &cross[which], other: &other[which], column: at };
        add_predecessor_stiffness(&coupling, j, rows, i, on as usize);
    }
}

/// Stiffness blocks of the springs between a section and one predecessor, with respect to the corners at the far end: the
/// predecessor's own, or those of an attached base.
struct PredecessorStiffness<'a> {
    /// Rows of the section, columns of the corners at the far end.
    cross: &'a Matrix9,
    /// Diagonal 3x3 blocks of the corners at the far end.
    other: &'a [[[f64; 3]; 3]; 3],
    /// First column of the predecessor in a block row.
    column: usize,
}

/// Adds the block that couples section `i` to its predecessor `on`, and the predecessor's diagonal share. `j`:
/// Jacobian of the attached base at which the springs end; `None` if they end at the corners of the predecessor.
#[inline(always)]
fn add_predecessor_stiffness(
    coupling: &PredecessorStiffness<'_>,
    j: Option<&Matrix9>,
    rows: &mut [BlockRow],
    i: usize,
    on: usize,
) {
    let PredecessorStiffness { cross, other, column } = *coupling;
    // Without an attached base the far ends are the corners of the predecessor: the Jacobian is the identity.
    let Some(j) = j else {
        for r in 0..9 {
            for q in 0..9 {
                rows[i].0[r][column + q] += cross[r][q];
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
    // Off-diagonal block A J: the far corners move as dX = J dx of the predecessor.
    for r in 0..9 {
        for a in 0..9 {
            for q in 0..9 {
                rows[i].0[r][column + q] += cross[r][a] * j[a][q];
            }
        }
    }
    // J^T A J, where A has a block of three by three for each corner.
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
