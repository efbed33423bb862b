//! Trees that grow year by year: light is computed, distributed among buds and converted to shoots, wood and death.
//!
//! A year consists of the passes in `stand.rs`, in this order: the light field from the leaves of last year, cuts, light of tips
//! and buds, its sums towards the base, death, vigour towards the tips, shoots, radii, bending.
//!
//! Sources: \[palubicki\] W. Palubicki et al., "Self-organizing tree models for image synthesis", SIGGRAPH 2009; \[jirasek\]
//! C. Jirasek, "A biomechanical model of branch shape in plants expressed using L-systems", 2000; \[shinozaki\] K. Shinozaki et
//! al., "A quantitative analysis of plant form: the pipe model theory", 1964; \[eloy\] C. Eloy, "Leonardo's rule,
//! self-similarity, and wind-induced stresses in trees", PRL 2011; \[mcmahon\] T. McMahon, "Size and shape in biology", 1973.

mod allocate;
mod bending;
mod clip;
mod clip_leaves;
mod death;
mod habit;
mod light;
mod measure;
mod part_year;
mod plant;
mod radii;
mod record;
mod season;
mod shading;
mod shoots;
mod site;
mod stand;
mod tree;

pub use clip::{GrowthClip, PoseNow};
pub use clip_leaves::{ClipLeaves, ClipOptions, LeafNow};
pub use habit::{Arity, HABIT_KEYS, Habit, HabitKey, ORDERS, PerOrder};
pub use measure::Measures;
pub use plant::{Foliage, PlantOptions};
pub use record::{ClipSpan, GrowthRecord};
pub use shading::Neighbours;
pub use site::{Keep, Prune, Site};

use std::sync::Arc;

use glam::Vec3;

use osier_base::limits::Limits;
use osier_base::math::narrow;
use osier_base::par::par_map;
use osier_base::{Error, Result};
use stand::Stand;
use tree::Tree;

/// Distance, as a multiple of the tree's height, beyond which trees do not shade each other: 1 / tan 25 degrees, for the lowest
/// light.
const SHADE_DISTANCE: f32 = 2.2;
/// Youngest and oldest age at which a tree can be grown, years.
const AGE_RANGE: [f64; 2] = [0.1, 500.0];

/// A tree to grow: its species, age, place and cuts.
#[derive(Debug, Clone)]
pub struct TreeSpec {
    /// Name of the plant, for messages.
    pub name: String,
    /// Parameters of its species.
    pub habit: Habit,
    /// Seed of the random draws of its growth.
    pub seed: u64,
    /// Number that identifies the plant in random draws and ids.
    pub id: u32,
    /// Place of its base in the scene, m.
    pub base: Vec3,
    /// Age, years; a fraction shows part of the last year's growth.
    pub age: f64,
    /// Invisible ring of leaves that shades the tree; `None`: it has no neighbours except the trees that grow with it.
    pub neighbours: Option<Neighbours>,
    /// Cuts at the start of years of its growth.
    pub prunes: Vec<Prune>,
}

/// A tree that has grown to its age; [`GrownTree::plant`] gives it axes and leaves.
#[derive(Debug, Clone)]
pub struct GrownTree {
    tree: Tree,
    id: u32,
    seed: u64,
    age: f64,
}

/// A tree that has grown, with its record if a clip shows its growth.
#[derive(Debug, Clone)]
pub struct RecordedTree {
    /// The tree at the age of its specification.
    pub tree: GrownTree,
    /// The recorded years, if a clip shows a span of its life.
    pub record: Option<Arc<GrowthRecord>>,
}

impl GrownTree {
    fn new(tree: Tree, spec: &TreeSpec, age: f64) -> Self {
        Self { tree, id: spec.id, seed: spec.seed, age }
    }

    /// Height, crown, stem and leaves of the tree at its age, as foresters measure them.
    pub fn measures(&self) -> Measures {
        self.tree.measures()
    }

    /// Year of its life that was the first of two successive years without light, after which it died; `None` if there were none.
    pub fn died(&self) -> Option<u32> {
        self.tree.died
    }

    /// Whether it died because cuts had left it neither tips nor buds, in the year of [`Self::died`].
    pub fn died_of_cut(&self) -> bool {
        self.tree.died.is_some() && self.tree.died == self.tree.bared
    }

    /// Positions of its open living tips, from the tree's base, m.
    pub fn tips(&self) -> impl Iterator<Item = Vec3> {
        let nodes = &self.tree.nodes;
        (0..nodes.len()).filter(|i| nodes.grows(*i)).map(|i| nodes.p[i])
    }

    /// Number of living branches of each Strahler order, from order 1 on; `[0]` without living wood.
    pub fn strahler_counts(&self) -> Vec<usize> {
        self.tree.strahler_counts()
    }
}

/// Grows trees that share one light field, each to its age; all reach their ages at the same time. Trees too far apart to shade
/// each other have separate light fields.
/// # Errors
/// `Range` for an age, S003 for contradictory parameters, `Limit` for a tree of too many nodes.
pub fn grow(specs: &[TreeSpec], site: &Site, limits: &Limits) -> Result<Vec<GrownTree>> {
    let grown = grow_recorded(specs, &[], site, limits)?;
    Ok(grown.into_iter().map(|g| g.tree).collect())
}

/// As [`grow`], and records the trees that a clip will show. `spans`: by tree, the span to record, if any; it ends at the tree's
/// age or before.
/// # Errors
/// As [`grow`].
pub fn grow_recorded(
    specs: &[TreeSpec],
    spans: &[Option<ClipSpan>],
    site: &Site,
    limits: &Limits,
) -> Result<Vec<RecordedTree>> {
    specs.iter().try_for_each(check)?;
    let groups = groups_in_shade(specs);
    let grown = par_map(&groups, |group| grow_group(group, specs, spans, site, limits));
    let mut trees: Vec<(usize, RecordedTree)> = Vec::with_capacity(specs.len());
    for group in grown {
        trees.extend(group?);
    }
    // Groups are in the order of their first trees; results are in the order of the specifications.
    trees.sort_by_key(|(i, _)| *i);
    Ok(trees.into_iter().map(|(_, tree)| tree).collect())
}

/// Grows one tree and keeps it at several ages, whole years in rising order, in a single run.
/// # Errors
/// As [`grow`].
pub fn grow_through(spec: &TreeSpec, ages: &[u32], site: &Site, limits: &Limits) -> Result<Vec<GrownTree>> {
    check(spec)?;
    let mut stand = Stand::new(vec![plant_seed(spec)], site, limits);
    let mut out = Vec::with_capacity(ages.len());
    for age in ages {
        while stand.year < *age {
            stand.grow_year(true)?;
        }
        out.extend(stand.trees.iter().map(|t| GrownTree::new(t.clone(), spec, f64::from(*age))));
    }
    Ok(out)
}

fn check(spec: &TreeSpec) -> Result<()> {
    spec.habit.check()?;
    if !(AGE_RANGE[0]..=AGE_RANGE[1]).contains(&spec.age) {
        let name = format!("age of plant \"{}\"", spec.name);
        return Err(Error::Range { name, value: spec.age, min: AGE_RANGE[0], max: AGE_RANGE[1], unit: "yr" });
    }
    Ok(())
}

fn plant_seed(spec: &TreeSpec) -> Tree {
    let tree = Tree::new(&spec.name, &spec.habit, spec.seed, spec.id, spec.base);
    Tree { neighbours: spec.neighbours, prunes: spec.prunes.clone(), ..tree }
}

/// Indices of trees that may shade each other, group by group, in the order of the first tree of each group.
fn groups_in_shade(specs: &[TreeSpec]) -> Vec<Vec<usize>> {
    let mut groups: Vec<Vec<usize>> = Vec::new();
    // `path_max` limits the length of the water path to the top, and so the height of a tree.
    let reach = |spec: &TreeSpec| SHADE_DISTANCE * spec.habit.path_max.min(spec.habit.height_max);
    for (i, spec) in specs.iter().enumerate() {
        let near = |other: &usize| {
            let other = &specs[*other];
            other.base.distance(spec.base) < reach(other).max(reach(spec))
        };
        // All groups that contain a tree near this one are merged with it.
        let (joined, apart): (Vec<_>, Vec<_>) = groups.into_iter().partition(|group| group.iter().any(near));
        let mut group: Vec<usize> = joined.into_iter().flatten().collect();
        group.push(i);
        group.sort_unstable();
        groups = apart;
        groups.push(group);
    }
    groups.sort_unstable();
    groups
}

/// Grows the trees of one light field; returns them with their indices in `specs`. If an age has a fraction, the last year is
/// computed completely and shown in part.
fn grow_group(
    group: &[usize],
    specs: &[TreeSpec],
    spans: &[Option<ClipSpan>],
    site: &Site,
    limits: &Limits,
) -> Result<Vec<(usize, RecordedTree)>> {
    let members: Vec<&TreeSpec> = group.iter().map(|i| &specs[*i]).collect();
    let span = |i: usize| spans.get(i).copied().flatten();
    let last = members.iter().map(|s| full_years(s.age)).max().unwrap_or(0);
    // All trees reach their ages at the same time, so younger trees are sown later.
    let sow = |i: &usize| {
        let spec = &specs[*i];
        Tree { sown: last - full_years(spec.age), recorded: span(*i).is_some(), ..plant_seed(spec) }
    };
    let mut stand = Stand::new(group.iter().map(sow).collect(), site, limits);
    let record_of =
        |(i, tree): (&usize, &Tree)| span(*i).map(|span| GrowthRecord::new(tree, span, specs[*i].id, specs[*i].seed));
    let mut records: Vec<Option<GrowthRecord>> = group.iter().zip(&stand.trees).map(record_of).collect();

    // Grow the full years first; the last one, shown in part, follows below.
    for year in 1..=last {
        stand.grow_year(true)?;
        let grew = stand.trees.iter().zip(&mut records).filter(|(tree, _)| tree.sown < year);
        grew.for_each(|(tree, record)| record.iter_mut().for_each(|r| r.note_year(tree)));
    }
    let part = |spec: &TreeSpec| narrow(spec.age - f64::from(full_years(spec.age)));
    if members.iter().any(|s| part(s) > 0.0) {
        // Grow the last year completely for all trees, then undo it for those whose age has no fraction.
        let before = stand.trees.clone();
        stand.grow_year(false)?;
        for (((tree, before), spec), record) in stand.trees.iter_mut().zip(before).zip(&members).zip(&mut records) {
            if part(spec) > 0.0 {
                record.iter_mut().for_each(|r| r.note_year(tree));
                tree.show_part_of_year(&before, part(spec));
            } else {
                *tree = before;
            }
        }
    }
    let grown = stand.trees.into_iter().zip(records).zip(group.iter().zip(&members));
    let together = |((tree, record), (i, spec)): ((Tree, Option<GrowthRecord>), (&usize, &&TreeSpec))| {
        (*i, RecordedTree { tree: GrownTree::new(tree, spec, spec.age), record: record.map(Arc::new) })
    };
    Ok(grown.map(together).collect())
}

/// Full years of an age within [`AGE_RANGE`].
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "ages are at most 500 years")]
fn full_years(age: f64) -> u32 {
    age.floor() as u32
}

#[cfg(test)]
mod clip_tests;
#[cfg(test)]
mod forestry_tests;
#[cfg(test)]
mod golden_tests;
#[cfg(test)]
mod rule_tests;
#[cfg(test)]
mod tests;
