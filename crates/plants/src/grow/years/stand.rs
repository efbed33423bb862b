//! The years of all trees that share one field of light.

use glam::Vec3;

use super::light::{CellMarks, Grid, LeafAreas, LightField, SkyDirection, sky};
use super::season::Season;
use super::shading::{opaque_cells, with_shading_solids};
use super::site::{Obstacles, Site};
use super::tree::Tree;
use osier_base::Result;
use osier_base::geometry::Bounds;
use osier_base::limits::Limits;
use osier_base::par::par_map_mut;

/// Arrays are compacted when more than one node in this many has fallen.
const COMPACT_SHARE: usize = 4;

/// Trees that share one field of light, with its sky and its solids.
#[derive(Debug)]
pub(super) struct Stand<'a> {
    pub trees: Vec<Tree>,
    /// Years that the field has computed so far.
    pub year: u32,
    site: &'a Site,
    sky: Vec<SkyDirection>,
    /// Origin of the field of light in the scene: the base of one of the trees, so that a moved tree grows in the same way.
    anchor: Vec3,
    limits: &'a Limits,
}

impl<'a> Stand<'a> {
    pub fn new(mut trees: Vec<Tree>, site: &'a Site, limits: &'a Limits) -> Self {
        // Select the tree by its position, because the order of the list must not matter.
        let key = |t: &&Tree| (t.base.x, t.base.z, t.base.y);
        let first = trees.iter().min_by(|a, b| {
            let (a, b) = (key(a), key(b));
            a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.total_cmp(&b.2))
        });
        let anchor = first.map_or(Vec3::ZERO, |t| t.base);
        for tree in &mut trees {
            tree.offset = tree.base - anchor;
        }
        Self { sky: sky(site), trees, year: 0, site, anchor, limits }
    }

    /// Grows all trees by a year. Without `compact` no node is removed from the arrays; recorded trees always keep theirs.
    /// # Errors
    /// `Limit` of the first tree that would have too many nodes.
    pub fn grow_year(&mut self, compact: bool) -> Result<()> {
        let field = self.light();
        self.year += 1;
        let (year, site, limits) = (self.year, self.site, self.limits);
        let grown = par_map_mut(&mut self.trees, |tree| {
            if tree.sown >= year {
                return Ok(());
            }
            let obstacles = Obstacles { base: tree.base, solids: site.solids.as_deref() };
            tree.grow_year(&field, obstacles, limits)?;
            if compact && !tree.recorded && tree.fallen * COMPACT_SHARE > tree.nodes.len() {
                tree.compact();
            }
            Ok(())
        });
        grown.into_iter().collect()
    }

    /// Computes the field of light from the leaves of last year.
    fn light(&mut self) -> LightField {
        let solids = self.site.solids.as_deref();
        // The box of all living wood, of neighbours, and of the solids that shade it.
        let mut bounds = Bounds::default();
        let mut heights = Vec::new();
        for tree in &self.trees {
            let living = tree.living_bounds();
            heights.push(living.max.y.max(0.0));
            bounds = bounds.union(Bounds { min: living.min + tree.offset, max: living.max + tree.offset });
            if let Some(ring) = tree.neighbours.filter(|ring| (tree.year as f32) < ring.until) {
                let b = ring.bounds(living.max.y);
                bounds = bounds.union(Bounds { min: b.min + tree.offset, max: b.max + tree.offset });
            }
        }
        if bounds.is_empty() {
            bounds = Bounds { min: Vec3::ZERO, max: Vec3::ZERO };
        }
        let grid = Grid::over(with_shading_solids(bounds, solids, self.anchor));
        // Neighbours shade a tree until the year of its life in which they are felled.
        let mut areas = LeafAreas::new(grid);
        for (tree, height) in self.trees.iter().zip(&heights) {
            tree.deposit_leaves(&mut areas);
            if let Some(ring) = tree.neighbours.filter(|ring| (tree.year as f32) < ring.until) {
                ring.deposit(&mut areas, tree.offset, *height, tree.habit.extinction);
            }
        }
        let mut marks = CellMarks::new(&grid);
        for tree in &mut self.trees {
            tree.mark_cells(&grid, &mut marks);
        }
        LightField::compute(&areas, &self.sky, &opaque_cells(&grid, solids, self.anchor), &marks)
    }
}

impl Tree {
    /// The box of the ends of living internodes, in the space of the tree.
    fn living_bounds(&self) -> Bounds {
        let nodes = &self.nodes;
        (0..nodes.len()).filter(|i| nodes.lives(*i)).fold(Bounds::default(), |b, i| b.with(nodes.p[i]))
    }

    /// Grows by a year, in the order of the passes.
    fn grow_year(&mut self, field: &LightField, obstacles: Obstacles<'_>, limits: &Limits) -> Result<()> {
        self.year += 1;
        if self.died.is_some() {
            return Ok(());
        }
        let season = Season::new(&self.habit, self.year);
        self.losses.clear();

        // Cuts come first, because only the remaining wood receives light.
        self.cut(&season);
        self.gather_light(field);
        self.sum_light(true);
        self.note_darkness();

        // Wood on dead wood dies too; axes without a tip get a new leader; dormant buds break, to shoot next year.
        self.shed_dead_wood();
        if self.replace_leaders(&season) {
            self.sum_light_again();
        }
        self.wake_buds(field, &season);

        // Vigour becomes shoots, shoots become wood, and wood bends.
        self.share_vigour(&season);
        self.shoot(&season, field, obstacles, limits)?;
        self.thicken(&season);
        self.bend();
        self.sprout();
        Ok(())
    }

    /// Counts successive years in which the roots receive no light; in the second such year the tree counts as dead.
    fn note_darkness(&mut self) {
        let nodes = &self.nodes;
        let roots = (0..nodes.len()).take_while(|i| nodes.parent[*i] == super::tree::NONE);
        let lit = roots.into_iter().any(|i| nodes.gathered[i] > 0.0);
        self.dark = if lit { 0 } else { self.dark + 1 };
        if self.dark == 2 {
            self.died = Some(self.year - 1);
        }
    }
}
