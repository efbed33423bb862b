//! Expands a system into words of maps: every prefix, down to a size.
//!
//! # Examples
//! ```
//! use osier_base::limits::Limits;
//! use osier_ifs::read::read;
//! use osier_ifs::words::{ExpansionLimits, Letters, expand};
//!
//! let table = r#"
//! [ifs]
//! name = "fork"
//! dim = 3
//! map = [
//!     { branch = { h = 1.0, pitch = 25, scale = 0.7 } },
//!     { branch = { h = 1.0, roll = 180, pitch = 25, scale = 0.7 } },
//! ]
//! "#;
//! let (systems, _) = read("fork.ifs.toml", table.as_bytes(), &Limits::default())?;
//! let letters = Letters::new(&systems[0]).expect("every branch shrinks");
//! let limits = ExpansionLimits { eps: 0.3, max_depth: 64, max_order: 64, max_words: 1000, raised_by: None };
//! let expansion = expand(&systems[0], &letters, &limits, None).expect("few words");
//! // The trunk, 2 branches of size 0.7, 4 of 0.49, 8 of 0.343; the next 16 would be smaller than 0.3.
//! assert_eq!((expansion.words.len(), expansion.cuts.len()), (15, 16));
//! # Ok::<(), osier_base::Error>(())
//! ```

use glam::DVec3;

use super::affine::Affine;
use super::{Ifs, Map};
use osier_base::convert::limit;
use osier_base::diagnostic::Diagnostic;
use osier_base::math;
use osier_base::rng::{Key, Rng, child};

/// Index of no word: the parent of the root.
pub const NONE: u32 = u32::MAX;
/// Most words that an expansion cuts, for each word that it may keep. Own: a tree of m maps cuts m - 1 words for each that it keeps;
/// one of a thousand maps would cut billions before it had too many words.
pub const CUTS_PER_WORD: u64 = 4;
/// Words below this share of the trunk do not count for the size of a tree: they hardly extend beyond their parents.
const SIZE_EPS: f64 = 0.03;
/// Maximum number of words on which the size of a tree is measured; if there are more, the smallest are ignored.
const SIZE_WORDS: u64 = 5_000_000;

/// A word of maps, the outermost letter first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Word {
    /// Index of the word without its last letter, or [`NONE`].
    pub parent: u32,
    /// Its last letter; 0 for the empty word.
    pub letter: u16,
    /// Number of letters; 0 for the empty word, the trunk.
    pub depth: u16,
    /// Branching order: number of its letters that do not continue an axis; 0 on the trunk.
    pub order: u16,
    /// Product of the scales of its letters: its length divided by the trunk's.
    pub size: f64,
    /// Product of the factors on radii of its letters: its thickness divided by the trunk's.
    pub radius: f64,
    /// Composition of its maps; the first letter's map is applied last.
    pub map: Affine,
    /// Identifier computed from its letters, independent of the seed.
    pub id: u64,
}

/// Size, length and branching order of a word, which decide whether it is expanded further.
#[derive(Debug, Clone, Copy)]
struct WordMeasure {
    /// Product of the scales of its letters.
    size: f64,
    /// Number of letters: maps applied one after another.
    depth: u16,
    /// Number of letters that do not continue an axis.
    order: u16,
}

/// Where an expansion cuts growth, and how many words it may make.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExpansionLimits {
    /// Words whose size is below this are cut; the trunk has size 1.
    pub eps: f64,
    /// Most letters of a word; longer words are cut.
    pub max_depth: u16,
    /// Highest branching order; words of a higher one are cut.
    pub max_order: u16,
    /// Maximum number of words of an expansion, not counting cut words. More are the error I040, and so are more cut
    /// words than [`CUTS_PER_WORD`] times this number.
    pub max_words: u64,
    /// Flag of the command line that raises `max_words`, which I040 names; `None` where nothing raises it.
    pub raised_by: Option<&'static str>,
}

/// Random variation of the maps from word to word.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Variation {
    /// Key of the plant's random stream; the key of a word is derived from it letter by letter.
    pub key: u64,
    /// Factor on the standard deviations, 0 (none) to 2.
    pub amount: f64,
}

impl Variation {
    /// The variation of a plant: draws at (seed, plant, "ifs-tree", letters).
    pub fn new(seed: u64, plant: u64, amount: f64) -> Self {
        Self { key: Rng::key(seed, &[plant.into(), "ifs-tree".into()]), amount }
    }
}

/// Words of an expansion, and those at which growth was cut.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Expansion {
    /// Depth first, letters in the order of the file; the empty word comes first.
    pub words: Vec<Word>,
    /// Words that were too small, too long or of too high an order.
    pub cuts: Vec<Word>,
}

/// Scale and factor on radii of each letter; the scale is `None` for stems, which no word contains.
#[derive(Debug, Clone, PartialEq)]
pub struct Letters {
    scale: Vec<Option<f64>>,
    radius: Vec<f64>,
}

impl Letters {
    /// The letters of a system; a map without a factor on radii takes its scale.
    /// # Errors
    /// I041 for a branching map that does not shrink.
    pub fn new(ifs: &Ifs) -> Result<Self, Box<Diagnostic>> {
        let mut out = Self { scale: Vec::new(), radius: Vec::new() };
        for (i, map) in ifs.maps.iter().enumerate() {
            // The norm is the greatest factor by which a map stretches a distance.
            let s = map.branch.map_or_else(|| map.affine.norm(), |b| b.scale);
            let shrinks = s > 0.0 && s < 1.0;
            if !(map.stem || shrinks) {
                let text = format!("map {} has the scale {s:.4}", i + 1);
                let d = Diagnostic::error("I041", text, map.span, "must lie between 0 and 1");
                return Err(Box::new(d.help("every branch must be smaller than its parent")));
            }
            out.scale.push((!map.stem).then_some(s));
            out.radius.push(map.radius.unwrap_or(s));
        }
        Ok(out)
    }

    /// Words and cuts that an expansion will make, or `None` beyond those allowed.
    pub fn count(&self, ifs: &Ifs, limits: &ExpansionLimits) -> Option<(u64, u64)> {
        let (mut words, mut cuts) = (0_u64, 0_u64);
        let mut stack = vec![WordMeasure { size: 1.0, depth: 0, order: 0 }];
        while let Some(word) = stack.pop() {
            words += 1;
            if words > limits.max_words {
                return None;
            }
            for (scale, map) in self.scale.iter().zip(&ifs.maps) {
                let Some(scale) = scale else { continue };
                let next = WordMeasure {
                    size: word.size * scale,
                    depth: word.depth.saturating_add(1),
                    order: word.order.saturating_add(u16::from(!map.axis)),
                };
                if limits.admit(next) { stack.push(next) } else { cuts += 1 }
            }
            if cuts > limits.max_cuts() {
                return None;
            }
        }
        Some((words, cuts))
    }
}

impl ExpansionLimits {
    /// True if a word is kept and expanded, false if growth is cut at it.
    fn admit(&self, word: WordMeasure) -> bool {
        word.size >= self.eps && word.depth <= self.max_depth && word.order <= self.max_order
    }

    /// Most words that an expansion may cut.
    fn max_cuts(&self) -> u64 {
        self.max_words.saturating_mul(CUTS_PER_WORD)
    }
}

/// Expands a system.
/// The words of a larger eps are among those of a smaller one, with the same maps and ids.
/// Source: [zhao-zhang] 2.2, which expands to a fixed level.
/// Differs: growth is cut by size; a fixed level would cut the trunk or explode where scales are as far apart as 0.9
/// and 0.4.
/// # Errors
/// I040 if it would make more than the words allowed, naming an eps that fits.
pub fn expand(
    ifs: &Ifs,
    letters: &Letters,
    limits: &ExpansionLimits,
    vary: Option<Variation>,
) -> Result<Expansion, Box<Diagnostic>> {
    let Some((words, cuts)) = letters.count(ifs, limits) else {
        return Err(Box::new(too_many(ifs, letters, limits)));
    };
    // The number of words is known: lists that grow would take up to twice the memory.
    let mut out = Expansion { words: Vec::with_capacity(limit(words)), cuts: Vec::with_capacity(limit(cuts)) };
    let root =
        Word { parent: NONE, letter: 0, depth: 0, order: 0, size: 1.0, radius: 1.0, map: Affine::IDENTITY, id: 0 };
    if !limits.admit(root.measure()) {
        out.cuts.push(root);
        return Ok(out);
    }
    out.words.push(root);
    // The words from the trunk to the one that is expanded, each with the number of maps that have been appended to it.
    // Words are made depth first in the order of the file, so that only the words of one branch are unfinished.
    let mut branch = vec![OpenWord { word: root, index: 0, key: vary.map_or(0, |v| v.key), done: 0 }];
    let mut next_index = 1_u32;
    while let Some(open) = branch.last_mut() {
        let i = open.done;
        let Some(map) = ifs.maps.get(i) else {
            branch.pop();
            continue;
        };
        open.done += 1;
        let Some(scale) = letters.scale.get(i).copied().flatten() else { continue };
        let word = open.word;
        // The readers refuse tables with more maps than the limit `maps`, 1000 unless a user raises it.
        let letter = u16::try_from(i).unwrap_or(u16::MAX);
        let key = child(open.key, Key::from(i).0);
        // The key of a word is the path of its letters: the same word varies in the same way at every eps.
        let varied_map = vary.map_or(map.affine, |v| varied(map, key, v.amount));
        let next = Word {
            parent: open.index,
            letter,
            depth: word.depth.saturating_add(1),
            order: word.order.saturating_add(u16::from(!map.axis)),
            size: word.size * scale,
            radius: word.radius * letters.radius.get(i).copied().unwrap_or(scale),
            map: word.map.after(&varied_map),
            id: child(word.id, Key::from(i).0),
        };
        if limits.admit(next.measure()) {
            out.words.push(next);
            branch.push(OpenWord { word: next, index: next_index, key, done: 0 });
            next_index += 1;
        } else {
            out.cuts.push(next);
        }
    }
    Ok(out)
}

/// A word on the path from the trunk to the word that is being expanded.
struct OpenWord {
    word: Word,
    /// Its index among the words.
    index: u32,
    /// Key of its random variation.
    key: u64,
    /// Number of maps that have been appended to it.
    done: usize,
}

impl Word {
    fn measure(&self) -> WordMeasure {
        WordMeasure { size: self.size, depth: self.depth, order: self.order }
    }
}

/// I040 with the smallest eps, in steps of a quarter, that keeps within the limit.
fn too_many(ifs: &Ifs, letters: &Letters, limits: &ExpansionLimits) -> Diagnostic {
    let mut fits = limits.eps.max(1e-6);
    while fits < 1.0 && letters.count(ifs, &ExpansionLimits { eps: fits, ..*limits }).is_none() {
        fits *= 1.25;
    }
    let (words, cuts) = (limits.max_words, limits.max_cuts());
    let text = format!(
        "\"{}\" expanded down to {} makes more than {words} words, or cuts more than {cuts}",
        ifs.name, limits.eps
    );
    let help =
        if fits < 1.0 { format!("eps = {fits:.4} fits") } else { "the system has too many maps for a tree".to_owned() };
    let raise = limits.raised_by.map(|flag| format!("; or raise it with {flag}")).unwrap_or_default();
    Diagnostic::error("I040", text, ifs.span, "in this system").help(help + &raise)
}

/// A map with the random variation of one word: standard deviations of 8 degrees in roll, 5 degrees in pitch and 6 % in
/// scale, normal, truncated at two deviations.
fn varied(map: &Map, key: u64, amount: f64) -> Affine {
    let mut draw = Rng::from_key(key);
    let mut n = || draw.normal().clamp(-2.0, 2.0) * amount;
    // The three draws happen in this order for every kind of map.
    let (roll, pitch, scale) = (n() * 8.0_f64.to_radians(), n() * 5.0_f64.to_radians(), 1.0 + 0.06 * n());
    match map.branch {
        Some(b) => {
            let b = super::Branch { roll: b.roll + roll, pitch: b.pitch + pitch, scale: b.scale * scale, ..b };
            Affine::branch(&b)
        }
        None => {
            // A map without branch parameters is tilted and scaled before it acts, and rolled about the parent after
            // it.
            let turned = super::affine::turn_y(roll) * map.affine.a * super::affine::turn_z(pitch) * scale;
            Affine { a: turned, b: map.affine.b }
        }
    }
}

/// Extent of a tree without variation, table units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TreeExtent {
    /// Height of the highest end of a word above the foot of the trunk, at least the trunk's length.
    pub height: f64,
    /// Largest distance of an end of a word from the foot of the trunk along x or z.
    pub half_width: f64,
}

/// Extent of the unit segment's tree: of the ends of its words at eps 0.03, or at the smallest larger eps at which there are few
/// enough of them to be measured.
pub fn tree_extent(ifs: &Ifs, letters: &Letters, trunk: (DVec3, DVec3)) -> TreeExtent {
    let (foot, tip) = trunk;
    let mut limits = ExpansionLimits {
        eps: SIZE_EPS,
        max_depth: u16::MAX,
        max_order: u16::MAX,
        max_words: SIZE_WORDS,
        raised_by: None,
    };
    while limits.eps < 1.0 && letters.count(ifs, &limits).is_none() {
        limits.eps *= 1.25;
    }
    let mut extent = TreeExtent { height: 0.0, half_width: 0.0 };
    let mut stack = vec![(Affine::IDENTITY, WordMeasure { size: 1.0, depth: 0, order: 0 })];
    while let Some((map, word)) = stack.pop() {
        // The image of the tip of the trunk under the map of a word is the end of the segment of that word.
        let end = map.apply(tip);
        let off = end - foot;
        extent.height = extent.height.max(end.y);
        extent.half_width = extent.half_width.max(off.x.abs()).max(off.z.abs());
        let next = ifs.maps.iter().zip(&letters.scale).filter_map(|(letter, scale)| {
            let size = word.size * (*scale)?;
            let next = WordMeasure { size, depth: word.depth.saturating_add(1), order: 0 };
            limits.admit(next).then(|| (map.after(&letter.affine), next))
        });
        stack.extend(next);
    }
    let trunk = math::sqrt((tip - foot).length_squared());
    TreeExtent { height: (extent.height - foot.y).max(trunk).max(1e-9), ..extent }
}

/// Height of the unit segment's tree, as [`tree_extent`] measures it.
pub fn height(ifs: &Ifs, letters: &Letters, trunk: (DVec3, DVec3)) -> f64 {
    tree_extent(ifs, letters, trunk).height
}
