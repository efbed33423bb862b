//! Disjoint sets of numbers, such as the points of the connected parts of a mesh.

/// Disjoint sets of the numbers from 0 on (union-find with path halving). The lowest member represents a set.
/// # Examples
/// ```
/// use osier_base::disjoint_sets::DisjointSets;
///
/// let mut parts = DisjointSets::connected(7, &[[6, 4, 5], [2, 1, 4]]);
/// assert_eq!([0, 1, 2, 3, 4, 5, 6].map(|point| parts.find(point)), [0, 1, 1, 3, 1, 1, 1]);
/// ```
#[derive(Debug, Clone)]
pub struct DisjointSets {
    /// For each number a lower one of its set, or itself.
    parent: Vec<u32>,
}

impl DisjointSets {
    /// A set for each of `n` numbers, at most 2^32.
    pub fn new(n: usize) -> Self {
        Self { parent: (0..).take(n).collect() }
    }

    /// The points 0 to `points` - 1 of a mesh, one set for each connected part. A point without a triangle is a set of its own;
    /// triangles with an index of `points` or more connect nothing.
    pub fn connected(points: usize, triangles: &[[u32; 3]]) -> Self {
        let mut sets = Self::new(points);
        for [a, b, c] in triangles.iter().filter(|t| t.iter().all(|i| (*i as usize) < points)) {
            sets.join(*a, *b);
            sets.join(*b, *c);
        }
        sets
    }

    /// The lowest number in the set of `i`. `i` must be less than the count given to [`DisjointSets::new`].
    pub fn find(&mut self, i: u32) -> u32 {
        let mut i = i;
        while self.parent[i as usize] != i {
            let up = self.parent[self.parent[i as usize] as usize];
            self.parent[i as usize] = up;
            i = up;
        }
        i
    }

    /// Joins the sets of two numbers; true if they were distinct.
    pub fn join(&mut self, a: u32, b: u32) -> bool {
        let (a, b) = (self.find(a), self.find(b));
        self.parent[a.max(b) as usize] = a.min(b);
        a != b
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sets_are_joined_once_and_named_by_their_lowest_member() {
        let mut sets = DisjointSets::new(5);
        assert_eq!([(3, 4), (4, 1), (1, 3), (0, 2)].map(|(a, b)| sets.join(a, b)), [true, true, false, true]);
        assert_eq!([0, 1, 2, 3, 4].map(|i| sets.find(i)), [0, 1, 0, 1, 1]);
    }

    #[test]
    fn triangles_with_points_that_are_not_there_connect_nothing() {
        let mut sets = DisjointSets::connected(3, &[[0, 1, 3], [1, 2, 2]]);
        assert_eq!([0, 1, 2].map(|i| sets.find(i)), [0, 1, 1]);
    }
}
