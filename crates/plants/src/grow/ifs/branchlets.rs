//! Instanced branchlets: the ends of a tree are instances of a few branchlets that are grown once.

use std::collections::BTreeMap;

use glam::Vec3;

use super::{
    GrownTree, PlacedOrgans, TreeOptions, TreeSize, build_plant, map_rotation, organ_at_word, proto_index, volume_scale,
};
use osier_base::Result;
use osier_base::limits::Limits;
use osier_base::math::{self, narrow};
use osier_base::rng::{mix64, word};
use osier_ifs::stems::TreeSystem;
use osier_ifs::words::{self, Word};
use osier_scene::Mesh;
use osier_scene::plant::{Organ, Plant, Proto};

/// Words smaller than this many times the cut size are instances. Larger values share more geometry but repeat more visibly.
const CUT_FACTOR: f64 = 4.0;
/// Variants of a branchlet per class, where individuals vary. The six classes that differ only in their up direction have twelve
/// together, enough that repetition is not seen.
const VARIANTS: usize = 2;
/// Classes of fewer words use the branchlets of the largest class that differs only in its up direction, because few instances do
/// not pay for a mesh of their own.
const MIN_CLASS_WORDS: usize = 12;
/// Name prefix of the prototypes of branchlets: `twig_0`, `twig_1` and so on.
pub const NAME_PREFIX: &str = "twig";

/// A branchlet, grown at the geometric mean size of the words that it stands for.
#[derive(Debug, Clone)]
pub struct Branchlet {
    /// Axes and leaves, m, at the size at which instances have scale 1.
    pub plant: Plant,
    /// True if the caller must mirror its mesh in z, because the maps of its words have negative determinants.
    pub mirrored: bool,
}

/// Key of words that share branchlets: half an octave of size, an octave of the ratio of thickness to size, the axis of
/// their own space nearest to up, the remaining depth and order, and whether their map mirrors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct BranchletClass {
    size: i32,
    thick: i32,
    up_axis: usize,
    depth: u16,
    order: u16,
    mirrored: bool,
}

impl BranchletClass {
    #[allow(clippy::cast_possible_truncation, reason = "logarithms of ratios")]
    fn of(w: &Word, options: &TreeOptions) -> Self {
        // Logarithmic bins: log2 of the ratio, in halves of an octave for sizes.
        let octave =
            |ratio: f64, parts: f64| (parts * math::ln(ratio.max(1e-300)) / std::f64::consts::LN_2).floor() as i32;
        // Without a limit the number of remaining letters is the same for all words.
        let left = |most: u16, own: u16| if most == u16::MAX { most } else { most.saturating_sub(own) };
        Self {
            size: octave(w.size, 2.0),
            thick: octave(w.radius / w.size, 1.0),
            up_axis: nearest_up_axis(w),
            depth: left(options.max_depth, w.depth),
            order: left(options.max_order, w.order),
            mirrored: w.map.a.determinant() < 0.0,
        }
    }
}

/// Directions in which up may lie in the space of a branchlet.
const UP_DIRECTIONS: [Vec3; 6] = [Vec3::Y, Vec3::X, Vec3::Z, Vec3::NEG_X, Vec3::NEG_Z, Vec3::NEG_Y];

/// Index of the direction nearest to up in the space of a word, before it is mirrored.
fn nearest_up_axis(w: &Word) -> usize {
    // Up in the space of the word; mirrored words are compared in the space of their unmirrored branchlet.
    let up = map_rotation(&w.map).inverse() * Vec3::Y;
    let up = if w.map.a.determinant() < 0.0 { up * Vec3::new(1.0, 1.0, -1.0) } else { up };
    (0..UP_DIRECTIONS.len())
        .rev()
        .max_by(|a, b| up.dot(UP_DIRECTIONS[*a]).total_cmp(&up.dot(UP_DIRECTIONS[*b])))
        .unwrap_or(0)
}

/// Number of words of a class, and sums of the logarithms of their sizes and radii, from which geometric means follow.
#[derive(Debug, Clone, Default)]
struct LogMeans {
    count: f64,
    size: f64,
    radius: f64,
}

impl LogMeans {
    fn add(&mut self, w: &Word) {
        self.count += 1.0;
        self.size += math::ln(w.size);
        self.radius += math::ln(w.radius);
    }
}

/// Branchlets of a class: index of the first, the size at which they were grown, their number, and the number of instances so
/// far.
struct BranchletCopies {
    first: usize,
    size: f64,
    variants: usize,
    next: usize,
}

/// Grows a tree whose words smaller than four times `eps` are instances of branchlets. A branchlet is grown once per
/// class of size, thickness and up direction, with the branches and leaves that the tree would have there; the words
/// of a class use up to two variants in turn. The last prototypes of the plant, `twig_0`, `twig_1` ..., have empty
/// meshes: the caller fills in that of the branchlet with their number. Arguments and result otherwise as
/// [`super::grow`].
/// Source: J. Hart, T. DeFanti, "Efficient antialiased rendering of 3-D linear fractals", 1991: object instancing of
/// the attractor's own parts.
/// Differs: a part has the depth that its size requires, so that leaves keep their size to half an octave, and there is one part
/// for each direction that may be up, so that leaves face the sky.
/// # Errors
/// As [`super::grow`].
pub fn grow(
    stems: &TreeSystem,
    plant: (u32, u64),
    options: &TreeOptions,
    limits: &Limits,
) -> Result<(Plant, Vec<Branchlet>)> {
    let tree_size = TreeSize::new(stems, options);
    let fine = super::word_limits(options, limits);
    let tree_limits = words::ExpansionLimits { eps: (CUT_FACTOR * options.eps).min(1.0), ..fine };
    let mut expanded = super::expand_words(stems, plant, options, &tree_limits)?;
    let grows = |w: &Word| w.size >= options.eps && w.size < tree_limits.eps;
    let allowed = |w: &Word| w.depth <= options.max_depth && w.order <= options.max_order;
    // Cut words that grow on at full detail are replaced by instances; the others stay cut words of the tree and bear its leaves.
    let (ends, cuts): (Vec<Word>, Vec<Word>) = expanded.cuts.iter().partition(|w| grows(w) && allowed(w));
    expanded.cuts = cuts;
    let classes = branchlet_classes(&ends, options);
    let mut class_means: BTreeMap<BranchletClass, LogMeans> = BTreeMap::new();
    for (w, class) in ends.iter().zip(&classes) {
        class_means.entry(*class).or_default().add(w);
    }
    let (branchlets, mut copies) = grow_branchlets(stems, plant, tree_size, &class_means, options, limits)?;
    let tree = build_plant(stems, &expanded, plant, tree_size, options, |out, grown, placed| {
        let base = out.protos.len();
        let empty = std::sync::Arc::new(Mesh::default());
        let proto = |i| Proto { name: format!("{NAME_PREFIX}_{i}"), mesh: std::sync::Arc::clone(&empty) };
        out.protos.extend((0..branchlets.len()).map(proto));
        for (w, class) in ends.iter().zip(&classes) {
            if let Some(copies) = copies.get_mut(class) {
                let proto = base + copies.first + copies.next % copies.variants.max(1);
                copies.next += 1;
                place_copy(out, grown, w, proto, copies.size, placed);
            }
        }
    })?;
    limits.check("organs", tree.organs.len() as u64, "the number of leaves and branchlets of a tree")?;
    Ok((tree, branchlets))
}

/// The class of each word, in order. A class of few words is merged into the largest class that differs only in its up direction.
fn branchlet_classes(words: &[Word], options: &TreeOptions) -> Vec<BranchletClass> {
    let own: Vec<BranchletClass> = words.iter().map(|w| BranchletClass::of(w, options)).collect();
    // The counts decide which classes are too small for branchlets of their own.
    let mut counts: BTreeMap<BranchletClass, usize> = BTreeMap::new();
    for class in &own {
        *counts.entry(*class).or_default() += 1;
    }
    let count = |class: &BranchletClass| counts.get(class).copied().unwrap_or(0);
    let merged = |class: &BranchletClass| {
        let turned = (0..UP_DIRECTIONS.len()).rev().map(|up_axis| BranchletClass { up_axis, ..*class });
        let most = turned.max_by_key(count).unwrap_or(*class);
        if count(class) < MIN_CLASS_WORDS { most } else { *class }
    };
    own.iter().map(merged).collect()
}

/// Grows the branchlets of all classes, each in the geometric mean size of its words.
fn grow_branchlets(
    stems: &TreeSystem,
    plant: (u32, u64),
    tree_size: TreeSize,
    class_means: &BTreeMap<BranchletClass, LogMeans>,
    options: &TreeOptions,
    limits: &Limits,
) -> Result<(Vec<Branchlet>, BTreeMap<BranchletClass, BranchletCopies>)> {
    let (mut branchlets, mut copies) = (Vec::new(), BTreeMap::new());
    for (number, (class, mean)) in class_means.iter().enumerate() {
        // The exponential of a mean logarithm is the geometric mean, which treats ratios up and down alike.
        let (size, thick) = (math::exp(mean.size / mean.count), math::exp(mean.radius / mean.count));
        let enough = mean.count >= 2.0 * MIN_CLASS_WORDS as f64;
        let variants = if options.variation > 0.0 && enough { VARIANTS } else { 1 };
        copies.insert(*class, BranchletCopies { first: branchlets.len(), size, variants, next: 0 });
        // Sizes within a branchlet are relative to its own: the cut scales by 1 / size, so that the finest twigs are
        // as fine as the tree's.
        let own = words::ExpansionLimits {
            eps: options.eps / size,
            max_depth: class.depth,
            max_order: class.order,
            ..super::word_limits(options, limits)
        };
        let turned = TreeOptions { up: UP_DIRECTIONS[class.up_axis], ..options.clone() };
        for variant in 0..variants {
            let identity = (plant.0, mix64(&[plant.1, word(NAME_PREFIX), number as u64, variant as u64]));
            let words = super::expand_words(stems, identity, options, &own)?;
            let own_size = TreeSize { scale: tree_size.scale * size, radius: tree_size.radius * thick };
            let grown = build_plant(stems, &words, identity, own_size, &turned, |_, _, _| {})?;
            branchlets.push(Branchlet { plant: grown, mirrored: class.mirrored });
        }
    }
    Ok((branchlets, copies))
}

/// Places an instance of prototype `proto`, which was grown in `size` (share of the trunk), at a word.
fn place_copy(plant: &mut Plant, grown: GrownTree<'_>, w: &Word, proto: usize, size: f64, placed: &mut PlacedOrgans) {
    let Some(site) = grown.skeleton.site(grown.stems, grown.expanded, w) else { return };
    let organ = Organ {
        id: mix64(&[plant.axes[site.axis as usize].id, word(NAME_PREFIX), w.id]),
        scale: narrow(volume_scale(&w.map) / size),
        proto: proto_index(proto),
        ..organ_at_word(plant, site, &w.map, grown.scale)
    };
    placed.insert((site.axis, organ.s.to_bits(), organ.id), organ);
}
