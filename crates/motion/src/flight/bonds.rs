//! Bonds of a cluster. Each join adds one, so that they form a tree over the members; the cluster contracts along them.

use crate::flight::tuning::{CONTRACTION_TIME, NEGLIGIBLE_LENGTH_SQUARED};
use glam::DVec3;

use osier_base::math::exp;

/// Bond between two members, by index, made when they touched; the cluster contracts along it.
#[derive(Debug, Clone, Copy)]
pub(super) struct ClusterBond {
    pub ends: [u32; 2],
    /// Remaining displacement, m, of the first member and of all members on its side of the bond, towards the second.
    pub left: DVec3,
}

impl ClusterBond {
    /// Subtracts the share `gone`, 0 to 1, from the remaining displacement and returns the subtracted part, m.
    fn close(&mut self, gone: f64) -> DVec3 {
        // Exponential approach, completed at once when it becomes invisible.
        let way = if self.left.length_squared() < NEGLIGIBLE_LENGTH_SQUARED { self.left } else { self.left * gone };
        self.left -= way;
        way
    }
}

/// Connected components of `members` (ascending) under the bonds; each component ascending.
pub(super) fn bonded_groups(bonds: &[ClusterBond], members: &[u32]) -> Vec<Vec<u32>> {
    // Union-find without path compression: clusters are small.
    let mut group: Vec<usize> = (0..members.len()).collect();
    // Root of a component: its lowest position.
    let top = |group: &[usize], mut i: usize| {
        while group[i] != i {
            i = group[i];
        }
        i
    };
    for bond in bonds {
        if let [Ok(a), Ok(b)] = bond.ends.map(|id| members.binary_search(&id)) {
            let (a, b) = (top(&group, a), top(&group, b));
            group[a.max(b)] = a.min(b);
        }
    }
    let mut out: Vec<Vec<u32>> = vec![Vec::new(); members.len()];
    members.iter().enumerate().for_each(|(i, id)| out[top(&group, i)].push(*id));
    out.retain(|g| !g.is_empty());
    out
}

/// Displacement of each of `members` (ascending) in a step of contraction, m, relative to the first member; `None` if no
/// bond contracts any longer.
pub(super) fn contract_bonds(bonds: &mut [ClusterBond], members: &[u32], dt: f64) -> Option<Vec<DVec3>> {
    if bonds.iter().all(|b| b.left == DVec3::ZERO) {
        return None;
    }
    // Share of the remaining displacement that a step takes, exact for any step.
    let gone = 1.0 - exp(-dt / CONTRACTION_TIME);
    let n = members.len();
    if let ([bond], 2) = (&mut *bonds, n) {
        // Most clusters are pairs, for which no tree needs to be walked.
        let way = bond.close(gone);
        return Some(vec![DVec3::ZERO, if bond.ends[0] == members[0] { -way } else { way }]);
    }
    // Walk the tree from the first member: each bond adds its displacement to all members beyond it.
    let mut next: Vec<Vec<(usize, DVec3)>> = vec![Vec::new(); n];
    for bond in bonds {
        let way = bond.close(gone);
        let [a, b] = bond.ends.map(|id| members.binary_search(&id));
        if let (Ok(a), Ok(b)) = (a, b) {
            next[a].push((b, -way));
            next[b].push((a, way));
        }
    }
    let mut moved: Vec<Option<DVec3>> = vec![None; n];
    let mut open = vec![0];
    moved[0] = Some(DVec3::ZERO);
    while let Some(i) = open.pop() {
        let here = moved[i].unwrap_or_default();
        for (k, way) in &next[i] {
            if moved[*k].is_none() {
                moved[*k] = Some(here + *way);
                open.push(*k);
            }
        }
    }
    Some(moved.into_iter().map(Option::unwrap_or_default).collect())
}
