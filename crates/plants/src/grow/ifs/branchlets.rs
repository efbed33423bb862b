//! Instanced branchlets: the ends of a tree as copies of a few grown ones.

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

/// Words smaller than this many times the cut size are instances; larger values share more and vary less.
const CUT_FACTOR: f64 = 4.0;
/// Branchlets of a class, where individuals differ; six classes that differ only by where the sky is have twelve.
const VARIANTS: usize = 2;
/// A class of fewer words shares the branchlets of a similar class.
const MIN_CLASS_WORDS: usize = 12;
/// Name of the prototypes of branchlets, in files.
pub const NAME: &str = "twig";

/// A branchlet, grown in the mean size of those that it stands for, foot at the origin of the table.
#[derive(Debug, Clone)]
pub struct Branchlet {
    /// Its axes and leaves.
    pub plant: Plant,
    /// Its instances show the mirror image in z.
    pub mirrored: bool,
}

/// Words that are shown by the same twigs: a half octave of size, an octave of thickness over size, which of the six
/// directions of their own space is nearest to the sky, the letters that are left to them, whether they are mirrored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct BranchletClass {
    size: i32,
    thick: i32,
    sky: usize,
    depth: u16,
    order: u16,
    mirrored: bool,
}

impl BranchletClass {
    #[allow(clippy::cast_possible_truncation, reason = "logarithms of ratios")]
    fn of(w: &Word, options: &TreeOptions) -> Self {
        let octave =
            |ratio: f64, parts: f64| (parts * math::ln(ratio.max(1e-300)) / std::f64::consts::LN_2).floor() as i32;
        // Without a limit all words have as many letters left.
        let left = |most: u16, own: u16| if most == u16::MAX { most } else { most.saturating_sub(own) };
        Self {
            size: octave(w.size, 2.0),
            thick: octave(w.radius / w.size, 1.0),
            sky: sky(w),
            depth: left(options.max_depth, w.depth),
            order: left(options.max_order, w.order),
            mirrored: w.map.a.determinant() < 0.0,
        }
    }
}

/// Directions in which the sky may lie in the space of a branchlet.
const SKY_DIRECTIONS: [Vec3; 6] = [Vec3::Y, Vec3::X, Vec3::Z, Vec3::NEG_X, Vec3::NEG_Z, Vec3::NEG_Y];

/// The direction nearest to the sky's in the space of a word, before it is mirrored.
fn sky(w: &Word) -> usize {
    let up = map_rotation(&w.map).inverse() * Vec3::Y;
    let up = if w.map.a.determinant() < 0.0 { up * Vec3::new(1.0, 1.0, -1.0) } else { up };
    (0..SKY_DIRECTIONS.len())
        .rev()
        .max_by(|a, b| up.dot(SKY_DIRECTIONS[*a]).total_cmp(&up.dot(SKY_DIRECTIONS[*b])))
        .unwrap_or(0)
}

/// Number of words of a class, and the sums of the logarithms of their sizes and radii, for geometric means.
#[derive(Debug, Clone, Default)]
struct ClassMean {
    count: f64,
    size: f64,
    radius: f64,
}

impl ClassMean {
    fn add(&mut self, w: &Word) {
        self.count += 1.0;
        self.size += math::ln(w.size);
        self.radius += math::ln(w.radius);
    }
}

/// Branchlets of a class: index of the first, the size that they were grown in, their number, and instances so far.
struct BranchletCopies {
    first: usize,
    size: f64,
    variants: usize,
    next: usize,
}

/// Grows a tree whose words below four times `eps` are copies: twigs are grown once by classes of size and thickness,
/// so that their branches and leaves are those that the whole tree would have there, and the words of a class show up
/// to two of them in turn. The last prototypes of the plant, `twig_0`, `twig_1` ..., have no mesh yet: that of the twig
/// with their number. Arguments and result otherwise as [`super::grow`].
/// Source: J. Hart, T. DeFanti, "Efficient antialiased rendering of 3-D linear fractals", 1991: object instancing of
/// the attractor's own parts.
/// Differs: a part is as deep as its size asks, so that leaves keep their size to a half octave, and is grown anew for
/// each side that may lie up, so that leaves face the sky.
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
    let whole = words::ExpansionLimits { eps: (CUT_FACTOR * options.eps).min(1.0), ..fine };
    let mut expanded = super::expand_words(stems, plant, options, &whole)?;
    // Below the cut of the whole tree are leaves, and where letters are used up.
    let grows = |w: &Word| w.size >= options.eps && w.size < whole.eps;
    let allowed = |w: &Word| w.depth <= options.max_depth && w.order <= options.max_order;
    let (ends, cuts): (Vec<Word>, Vec<Word>) = expanded.cuts.iter().partition(|w| grows(w) && allowed(w));
    expanded.cuts = cuts;
    let classes = branchlet_classes(&ends, options);
    let mut kinds: BTreeMap<BranchletClass, ClassMean> = BTreeMap::new();
    for (w, class) in ends.iter().zip(&classes) {
        kinds.entry(*class).or_default().add(w);
    }
    let (branchlets, mut copies) = grow_branchlets(stems, plant, tree_size, &kinds, options, limits)?;
    let tree = build_plant(stems, &expanded, plant, tree_size, options, |out, grown, placed| {
        let base = out.protos.len();
        let empty = std::sync::Arc::new(Mesh::default());
        let proto = |i| Proto { name: format!("{NAME}_{i}"), mesh: std::sync::Arc::clone(&empty) };
        out.protos.extend((0..branchlets.len()).map(proto));
        for (w, class) in ends.iter().zip(&classes) {
            if let Some(copies) = copies.get_mut(class) {
                let proto = base + copies.first + copies.next % copies.variants.max(1);
                copies.next += 1;
                place_copy(out, grown, w, proto, copies.size, placed);
            }
        }
    })?;
    limits.check("organs", tree.organs.len() as u64, "the number of leaves and grow_branchlets of a tree")?;
    Ok((tree, branchlets))
}

/// The class of each word. Few words of a class take the twigs of their fellows that are turned another way: a twig that
/// is hardly copied would only make files larger.
fn branchlet_classes(words: &[Word], options: &TreeOptions) -> Vec<BranchletClass> {
    let own: Vec<BranchletClass> = words.iter().map(|w| BranchletClass::of(w, options)).collect();
    let mut counts: BTreeMap<BranchletClass, usize> = BTreeMap::new();
    for class in &own {
        *counts.entry(*class).or_default() += 1;
    }
    let count = |class: &BranchletClass| counts.get(class).copied().unwrap_or(0);
    let kept = |class: &BranchletClass| {
        let fellows = (0..SKY_DIRECTIONS.len()).rev().map(|sky| BranchletClass { sky, ..*class });
        let most = fellows.max_by_key(count).unwrap_or(*class);
        if count(class) < MIN_CLASS_WORDS { most } else { *class }
    };
    own.iter().map(kept).collect()
}

/// Grows the branchlets of all classes, each in the geometric mean size of its words.
fn grow_branchlets(
    stems: &TreeSystem,
    plant: (u32, u64),
    tree_size: TreeSize,
    kinds: &BTreeMap<BranchletClass, ClassMean>,
    options: &TreeOptions,
    limits: &Limits,
) -> Result<(Vec<Branchlet>, BTreeMap<BranchletClass, BranchletCopies>)> {
    let (mut branchlets, mut copies) = (Vec::new(), BTreeMap::new());
    for (number, (class, kind)) in kinds.iter().enumerate() {
        let (size, thick) = (math::exp(kind.size / kind.count), math::exp(kind.radius / kind.count));
        let enough = kind.count >= 2.0 * MIN_CLASS_WORDS as f64;
        let variants = if options.variation > 0.0 && enough { VARIANTS } else { 1 };
        copies.insert(*class, BranchletCopies { first: branchlets.len(), size, variants, next: 0 });
        let own = words::ExpansionLimits {
            eps: options.eps / size,
            max_depth: class.depth,
            max_order: class.order,
            ..super::word_limits(options, limits)
        };
        let turned = TreeOptions { up: SKY_DIRECTIONS[class.sky], ..options.clone() };
        for variant in 0..variants {
            let identity = (plant.0, mix64(&[plant.1, word(NAME), number as u64, variant as u64]));
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
        id: mix64(&[plant.axes[site.axis as usize].id, word(NAME), w.id]),
        scale: narrow(volume_scale(&w.map) / size),
        proto: proto_index(proto),
        ..organ_at_word(plant, site, &w.map, grown.scale)
    };
    placed.insert((site.axis, organ.s.to_bits(), organ.id), organ);
}
