//! The ends of a tree as copies of a few twigs.

use std::collections::BTreeMap;

use glam::Vec3;

use super::{Grown, Placed, TreeOptions, built, growth, stood, turn};
use osier_base::Result;
use osier_base::limits::Limits;
use osier_base::math::{self, narrow};
use osier_base::rng::{mix64, word};
use osier_ifs::stems::Stems;
use osier_ifs::words::{self, Word};
use osier_scene::Mesh;
use osier_scene::plant::{Organ, Plant, Proto};

/// Words smaller than so many cuts are copies of twigs.
const TWIG: f64 = 4.0;
/// Twigs of a class, where individuals differ; six classes that differ only by where the sky is have twelve.
const VARIANTS: usize = 2;
/// Fewer words than this have no twigs of their own.
const FEW: usize = 12;
/// Name of the prototypes of twigs.
pub const NAME: &str = "twig";

/// A twig, grown in the mean size of those that it stands for, foot at the origin of the table.
#[derive(Debug, Clone)]
pub struct Twig {
    /// It, with its leaves.
    pub plant: Plant,
    /// Shown as its mirror image in z.
    pub mirrored: bool,
}

/// Words that are shown by the same twigs: a half octave of size, an octave of thickness over size, which of the six
/// directions of their own space is nearest to the sky, the letters that are left to them, whether they are mirrored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Class {
    size: i32,
    thick: i32,
    sky: usize,
    depth: u16,
    order: u16,
    mirrored: bool,
}

impl Class {
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

/// Directions in which the sky may lie for a twig.
const SKIES: [Vec3; 6] = [Vec3::Y, Vec3::X, Vec3::Z, Vec3::NEG_X, Vec3::NEG_Z, Vec3::NEG_Y];

/// The direction nearest to the sky's in the space of a word, before it is mirrored.
fn sky(w: &Word) -> usize {
    let up = turn(&w.map).inverse() * Vec3::Y;
    let up = if w.map.a.determinant() < 0.0 { up * Vec3::new(1.0, 1.0, -1.0) } else { up };
    (0..SKIES.len()).rev().max_by(|a, b| up.dot(SKIES[*a]).total_cmp(&up.dot(SKIES[*b]))).unwrap_or(0)
}

/// Words of a class and the sums of the logarithms of their sizes and radii.
#[derive(Debug, Clone, Default)]
struct Kind {
    count: f64,
    size: f64,
    radius: f64,
}

impl Kind {
    fn add(&mut self, w: &Word) {
        self.count += 1.0;
        self.size += math::ln(w.size);
        self.radius += math::ln(w.radius);
    }
}

/// Twigs of a class: the first, the size that they were grown in, how many, and copies so far.
struct Copies {
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
pub fn grow(stems: &Stems, plant: (u32, u64), options: &TreeOptions, limits: &Limits) -> Result<(Plant, Vec<Twig>)> {
    let scale = super::scale(stems, options);
    let radius = options.radius.unwrap_or(stems.radius * scale);
    let fine = super::cut(options, limits);
    let whole = words::Limits { eps: (TWIG * options.eps).min(1.0), ..fine };
    let mut expanded = super::expanded(stems, plant, options, &whole)?;
    // Below the cut of the whole tree are leaves, and where letters are used up.
    let grows = |w: &Word| w.size >= options.eps && w.size < whole.eps;
    let allowed = |w: &Word| w.depth <= options.max_depth && w.order <= options.max_order;
    let (ends, cuts): (Vec<Word>, Vec<Word>) = expanded.cuts.iter().partition(|w| grows(w) && allowed(w));
    expanded.cuts = cuts;
    let classes = classes(&ends, options);
    let mut kinds: BTreeMap<Class, Kind> = BTreeMap::new();
    for (w, class) in ends.iter().zip(&classes) {
        kinds.entry(*class).or_default().add(w);
    }
    let (twigs, mut copies) = twigs(stems, (plant, scale, radius), &kinds, options, limits)?;
    let tree = built(stems, &expanded, (plant, scale, radius), options, |out, grown, placed| {
        let base = out.protos.len();
        let empty = std::sync::Arc::new(Mesh::default());
        let proto = |i| Proto { name: format!("{NAME}_{i}"), mesh: std::sync::Arc::clone(&empty) };
        out.protos.extend((0..twigs.len()).map(proto));
        for (w, class) in ends.iter().zip(&classes) {
            if let Some(copies) = copies.get_mut(class) {
                let proto = base + copies.first + copies.next % copies.variants.max(1);
                copies.next += 1;
                place(out, grown, (w, proto, copies.size), placed);
            }
        }
    })?;
    limits.check("organs", tree.organs.len() as u64, "the number of leaves and twigs of a tree")?;
    Ok((tree, twigs))
}

/// The class of each word. Few words of a class take the twigs of their fellows that are turned another way: a twig that
/// is hardly copied would only make files larger.
fn classes(words: &[Word], options: &TreeOptions) -> Vec<Class> {
    let own: Vec<Class> = words.iter().map(|w| Class::of(w, options)).collect();
    let mut counts: BTreeMap<Class, usize> = BTreeMap::new();
    for class in &own {
        *counts.entry(*class).or_default() += 1;
    }
    let count = |class: &Class| counts.get(class).copied().unwrap_or(0);
    let kept = |class: &Class| {
        let fellows = (0..SKIES.len()).rev().map(|sky| Class { sky, ..*class });
        let most = fellows.max_by_key(count).unwrap_or(*class);
        if count(class) < FEW { most } else { *class }
    };
    own.iter().map(kept).collect()
}

/// Grows the twigs of all kinds of a plant. `scale`, m per table unit, and `radius`, m, are those of the tree.
fn twigs(
    stems: &Stems,
    (plant, scale, radius): ((u32, u64), f64, f64),
    kinds: &BTreeMap<Class, Kind>,
    options: &TreeOptions,
    limits: &Limits,
) -> Result<(Vec<Twig>, BTreeMap<Class, Copies>)> {
    let (mut twigs, mut copies) = (Vec::new(), BTreeMap::new());
    for (number, (class, kind)) in kinds.iter().enumerate() {
        let (size, thick) = (math::exp(kind.size / kind.count), math::exp(kind.radius / kind.count));
        let enough = kind.count >= 2.0 * FEW as f64;
        let variants = if options.variation > 0.0 && enough { VARIANTS } else { 1 };
        copies.insert(*class, Copies { first: twigs.len(), size, variants, next: 0 });
        let own = words::Limits {
            eps: options.eps / size,
            max_depth: class.depth,
            max_order: class.order,
            ..super::cut(options, limits)
        };
        let turned = TreeOptions { up: SKIES[class.sky], ..options.clone() };
        for variant in 0..variants {
            let of = (plant.0, mix64(&[plant.1, word(NAME), number as u64, variant as u64]));
            let words = super::expanded(stems, of, options, &own)?;
            let grown = built(stems, &words, (of, scale * size, radius * thick), &turned, |_, _, _| {})?;
            twigs.push(Twig { plant: grown, mirrored: class.mirrored });
        }
    }
    Ok((twigs, copies))
}

/// Puts a copy of prototype `proto`, which was grown in `size`, in the place of a word.
fn place(
    plant: &mut Plant,
    (stems, expanded, skeleton, scale): Grown<'_>,
    (w, proto, size): (&Word, usize, f64),
    placed: &mut Placed,
) {
    let Some((axis, s)) = skeleton.site(stems, expanded, w) else { return };
    let organ = Organ {
        id: mix64(&[plant.axes[axis as usize].id, word(NAME), w.id]),
        scale: narrow(growth(&w.map) / size),
        proto: u16::try_from(proto).unwrap_or(u16::MAX),
        ..stood(plant, (axis, s), &w.map, scale)
    };
    placed.insert((axis, organ.s.to_bits(), organ.id), organ);
}
