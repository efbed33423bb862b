//! Trees of iterated function systems: the words of the system (compositions of its maps) become axes, nodes and organs of a
//! [`Plant`].

mod axes;
mod billboards;
pub mod branchlets;

use std::collections::BTreeMap;

use glam::{DVec3, Vec3};

use super::turtle::{OrganSpec, set_exposed_lengths};
use super::{pick_prototype, radii};
use axes::WordSkeleton;
pub use billboards::{SubtreeBillboards, SubtreeClass, subtree_classes};
use osier_base::diagnostic::Diagnostic;
use osier_base::limits::Limits;
use osier_base::math::narrow;
use osier_base::rng::{Rng, mix64, word};
use osier_base::{Error, Result};
use osier_ifs::affine::Affine;
use osier_ifs::stems::TreeSystem;
use osier_ifs::words::{self, Expansion, Variation, Word};
use osier_scene::plant::{Organ, Plant, Proto};

/// Greatest number of words of a tree, whatever the limits: with their nodes about a gigabyte.
const MAX_SEGMENTS: u64 = 5_000_000;
/// Bytes of a word together with the cut words that it may cause.
const WORD_BYTES: u64 = (size_of::<Word>() as u64) * (1 + words::CUTS_PER_WORD);
/// Spread of the further leaves of a site: standard deviation of each component added to the unit direction of the first.
const LEAF_SPREAD: f32 = 0.55;
/// Standard deviation of the sizes of leaves, as a share of the mean.
const LEAF_SIZE_DEVIATION: f64 = 0.12;

/// Size, detail, leaves and materials of a tree of an iterated function system.
#[derive(Debug, Clone)]
pub struct TreeOptions {
    /// Height of the tree at full detail, m.
    pub height: f64,
    /// Words whose size falls below this are not expanded further; the trunk has size 1.
    pub eps: f64,
    /// Most letters of a word; growth is cut at longer ones.
    pub max_depth: u16,
    /// Highest branching order; growth is cut at higher ones. The trunk has order 0.
    pub max_order: u16,
    /// Factor on the deviations of maps from word to word: 0 (all individuals alike) to 2.
    pub variation: f64,
    /// Radius at the base of the trunk, m; `None`: that of the system, scaled.
    pub radius: Option<f64>,
    /// Radii by the pipe model instead of the maps' factors.
    pub pipe: bool,
    /// Probability of each leaf of a site, 0..1; another value adds or removes leaves and moves none.
    pub leaf_density: f64,
    /// Most leaves at a site, where growth was cut; 0 counts as 1.
    pub leaves_per_site: u32,
    /// The leaf; `None`: the tree is bare.
    pub leaf: Option<OrganSpec>,
    /// The meshes of the table's condensation sets, in table units: every word carries a copy of each.
    pub sets: Vec<OrganSpec>,
    /// Billboards for branches below their cut, for a tree seen from afar.
    pub cards: Option<SubtreeBillboards>,
    /// Names of the plant's materials, which `bark` and the subsets of organs index.
    pub materials: Vec<String>,
    /// Material of axes, of thin ones, and the radius below which they are thin.
    pub bark: (u16, u16, f64),
    /// Description of the plant's origin, for manifests.
    pub source: String,
    /// Unit vector that leaves turn their upper sides to: +Y, or another for branchlets whose instances are rotated.
    pub up: Vec3,
}

/// Grows a tree. `plant`: its id and seed.
/// Returns it validated. Topology and ids do not depend on the seed; a smaller eps moves nothing.
/// Source: [zhao-zhang] 2.2: trees as words of contractions of a trunk.
/// Differs: tapered tubes that bend with their axis in place of joined cylinders; growth cut by size.
/// # Errors
/// `Input` with I040 beyond the words allowed; the errors of `plant::validate`.
pub fn grow(stems: &TreeSystem, plant: (u32, u64), options: &TreeOptions, limits: &Limits) -> Result<Plant> {
    let fine = word_limits(options, limits);
    // With billboards the expansion stops earlier, at the size of the branches that they replace.
    let cut = words::ExpansionLimits { eps: options.cards.as_ref().map_or(fine.eps, |c| c.eps), ..fine };
    let expanded = expand_words(stems, plant, options, &cut)?;
    build_plant(stems, &expanded, plant, TreeSize::new(stems, options), options, |_, _, _| {})
}

/// Scale from the table to metres, and thickness at the base of the trunk.
#[derive(Debug, Clone, Copy)]
struct TreeSize {
    /// Metres per table unit.
    scale: f64,
    /// Radius at the base of the trunk, m.
    radius: f64,
}

impl TreeSize {
    fn new(stems: &TreeSystem, options: &TreeOptions) -> Self {
        let scale = options.height / words::height(&stems.system, &stems.letters, stems.trunk);
        Self { scale, radius: options.radius.unwrap_or(stems.radius * scale) }
    }
}

/// The words of a plant; with `variation` above 0 its seed varies the maps from word to word. `plant`: its id and seed.
fn expand_words(
    stems: &TreeSystem,
    plant: (u32, u64),
    options: &TreeOptions,
    cut: &words::ExpansionLimits,
) -> Result<Expansion> {
    let variation = Variation::new(plant.1, plant.0.into(), options.variation);
    let variation = (options.variation > 0.0).then_some(variation);
    words::expand(&stems.system, &stems.letters, cut, variation).map_err(|d| expansion_error(*d))
}

/// Error of an expansion, without source locations: they point into the text of the table, which is not available here.
/// The message names the table.
pub fn expansion_error(d: Diagnostic) -> Error {
    Diagnostic { labels: Vec::new(), ..d }.into()
}

/// Builds a plant from words: axes, organs and the additions of `more`, then radii and materials. `plant`: its id and seed.
fn build_plant(
    stems: &TreeSystem,
    expanded: &Expansion,
    plant: (u32, u64),
    size: TreeSize,
    options: &TreeOptions,
    more: impl FnOnce(&mut Plant, GrownTree<'_>, &mut PlacedOrgans),
) -> Result<Plant> {
    // Axes first: organs are placed on them.
    let skeleton = axes::build_word_skeleton(stems, expanded, size);
    let mut out = Plant {
        id: plant.0,
        seed: plant.1,
        materials: options.materials.clone(),
        source: options.source.clone(),
        ..Plant::default()
    };
    skeleton.add_to_plant(&mut out);
    let grown = GrownTree { stems, expanded, skeleton: &skeleton, scale: size.scale };
    let mut placed = place_organs(&mut out, grown, options);
    more(&mut out, grown, &mut placed);
    out.organs = placed.into_values().collect();
    if options.pipe {
        radii::pipe(&mut out, &radii::Pipe { base: Some(size.radius), ..radii::Pipe::default() });
    }
    // Exposed lengths depend on the validated radii, materials on the radius at the base.
    osier_scene::plant::validate(&mut out)?;
    set_exposed_lengths(&mut out);
    let (thick, thin, below) = options.bark;
    for axis in &mut out.axes {
        let base = out.nodes.r.get(axis.first as usize).copied().unwrap_or(0.0);
        axis.material = if f64::from(base) < below { thin } else { thick };
    }
    Ok(out)
}

/// Limits of the expansion at full detail. The number of words is limited by the allowed nodes, by the memory, and to 5
/// million.
pub fn word_limits(options: &TreeOptions, limits: &Limits) -> words::ExpansionLimits {
    let nodes = (limits.get("nodes"), Some("--max-nodes"));
    let memory = (limits.get("memory") / WORD_BYTES, Some("--max-memory"));
    let (max_words, raised_by) = nodes.min(memory).min((MAX_SEGMENTS, None));
    words::ExpansionLimits {
        eps: options.eps,
        max_depth: options.max_depth,
        max_order: options.max_order,
        max_words,
        raised_by,
    }
}

/// A plant's organs in canonical order: by axis, arc length (as bits) and id.
type PlacedOrgans = BTreeMap<(u32, u32, u64), Organ>;

/// Places leaves, then condensation sets, then billboards; prototypes are numbered in this order.
fn place_organs(plant: &mut Plant, grown: GrownTree<'_>, options: &TreeOptions) -> PlacedOrgans {
    let mut placed = PlacedOrgans::new();
    place_leaves(plant, grown, options, &mut placed);
    place_condensation_sets(plant, grown, options, &mut placed);
    billboards::place_billboards(plant, grown, options, &mut placed);
    placed
}

/// Places each condensation set at every word, moved and rotated by the word's map.
/// Own: K = C u w_1(K) u ..., word by word; a map's reflection and shear are left out, and its scale is the cube root of its
/// volume ratio.
fn place_condensation_sets(plant: &mut Plant, grown: GrownTree<'_>, options: &TreeOptions, placed: &mut PlacedOrgans) {
    let GrownTree { expanded, skeleton, scale, .. } = grown;
    for set in &options.sets {
        let Some(mesh) = set.meshes.first() else { continue };
        // One prototype per set; every word carries an instance, rotated and scaled by its map.
        let proto = proto_index(plant.protos.len());
        plant.protos.push(Proto { name: set.name.clone(), mesh: std::sync::Arc::clone(mesh) });
        for (i, word) in expanded.words.iter().enumerate() {
            let Some(site) = skeleton.base_site(i) else { continue };
            let id = mix64(&[plant.axes[site.axis as usize].id, self::word("set"), proto.into(), word.id]);
            let tint = Rng::at(plant.seed, &[plant.id.into(), "ifs-set".into(), id.into()]).unit_f32();
            let size = narrow(scale * volume_scale(&word.map));
            let organ = Organ { id, scale: size, proto, tint, ..organ_at_word(plant, site, &word.map, scale) };
            placed.insert((site.axis, organ.s.to_bits(), id), organ);
        }
    }
}

/// An organ at scale 1 and without an id: its origin lies where the map moves the origin, and it is rotated as the map rotates.
/// `at`: its site on the skeleton; `scale`: metres per table unit.
fn organ_at_word(plant: &Plant, at: WordSite, map: &Affine, scale: f64) -> Organ {
    let on = &plant.axes[at.axis as usize];
    let s = narrow(at.s * scale).clamp(0.0, on.length);
    let site = plant.frame(on, s);
    // The origin of the mesh goes where the map moves the origin, expressed in the frame of the axis.
    let back = site.q.inverse();
    let foot = Vec3::from_array((map.b * scale).to_array().map(narrow));
    let (offset, q) = (back * (foot - site.p), (back * map_rotation(map)).normalize());
    Organ { id: 0, axis: at.axis, s, offset, q, scale: 1.0, proto: 0, petiole: 0.0, tint: 0.5, birth: 0.0 }
}

/// Mean scale of a map: the cube root of its volume ratio |det A|.
fn volume_scale(map: &Affine) -> f64 {
    osier_base::math::pow(map.a.determinant().abs(), 1.0 / 3.0)
}

/// The rotation of a map: its images of y and x, orthonormalized in this order (Gram-Schmidt). A reflection is dropped.
fn map_rotation(map: &Affine) -> glam::Quat {
    let y = map.a.y_axis.try_normalize().unwrap_or(DVec3::Y);
    let x = (map.a.x_axis - y * y.dot(map.a.x_axis)).try_normalize().unwrap_or_else(|| y.any_orthonormal_vector());
    let column = |v: DVec3| Vec3::from_array(v.to_array().map(narrow));
    glam::Quat::from_mat3(&glam::Mat3::from_cols(column(x), column(y), column(x.cross(y)))).normalize()
}

/// Input of the placement of organs on a tree whose axes are in the plant.
#[derive(Debug, Clone, Copy)]
struct GrownTree<'a> {
    stems: &'a TreeSystem,
    expanded: &'a Expansion,
    /// Axes of the words, numbered as in the plant.
    skeleton: &'a WordSkeleton,
    /// Metres per table unit.
    scale: f64,
}

/// A position on an axis in table units, as words give it.
#[derive(Debug, Clone, Copy)]
struct WordSite {
    /// Index of the axis in the plant.
    axis: u32,
    /// Arc length, table units.
    s: f64,
}

/// Places leaves at the cut words whose last map bears them.
fn place_leaves(plant: &mut Plant, grown: GrownTree<'_>, options: &TreeOptions, placed: &mut PlacedOrgans) {
    let GrownTree { stems, expanded, skeleton, scale } = grown;
    let Some(leaf) = options.leaf.as_ref().filter(|l| !l.meshes.is_empty()) else { return };
    plant.protos = leaf.prototypes();
    // All variants are scaled by the length of the first, so that their proportions to each other stay.
    let first = f64::from(leaf.meshes[0].bounds().max.y).max(1e-9);
    let size = leaf.size / first;
    let bears = |c: &&Word| stems.system.maps.get(usize::from(c.letter)).is_some_and(|m| m.leaf);
    for cut in expanded.cuts.iter().filter(bears).filter(|c| !billboards::is_replaced(c, options)) {
        let Some(site) = skeleton.site(stems, expanded, cut) else { continue };
        for copy in 0..options.leaves_per_site.max(1) {
            let mut draw = Rng::at(plant.seed, &[plant.id.into(), "ifs-leaf".into(), cut.id.into(), copy.into()]);
            // Each leaf has a separate random stream, keyed by word and copy: a change of density adds or removes
            // leaves and moves none.
            if !draw.chance(options.leaf_density) {
                continue;
            }
            let on = AxisSite { axis: site.axis, s: narrow(site.s * scale) };
            let (petiole, up) = (leaf.petiole, options.up);
            let organ = leaf_organ(plant, on, LeafCopy { stems, cut, copy, size, petiole, up }, &mut draw);
            // The bits of positive floats have the order of the floats.
            placed.insert((site.axis, organ.s.to_bits(), organ.id), organ);
        }
    }
}

/// A position on an axis of the plant, in metres.
#[derive(Debug, Clone, Copy)]
struct AxisSite {
    /// Index of the axis in the plant.
    axis: u32,
    /// Arc length from the base of the axis, m.
    s: f32,
}

/// Properties of a leaf that [`leaf_organ`] needs besides its site.
struct LeafCopy<'a> {
    stems: &'a TreeSystem,
    /// The word whose growth was cut here.
    cut: &'a Word,
    /// Number of the leaf at its site.
    copy: u32,
    /// Scale of the prototypes at mean size.
    size: f64,
    /// Length of a petiole that the prototypes lack, at mean size, m.
    petiole: f64,
    /// Unit vector that the upper side turns to.
    up: Vec3,
}

/// A leaf along the direction in which its word would have grown, its upper side turned up; size and spread are random.
fn leaf_organ(plant: &Plant, at: AxisSite, leaf: LeafCopy<'_>, draw: &mut Rng) -> Organ {
    let LeafCopy { stems, cut, copy, size, petiole, up: sky } = leaf;
    let axis = at.axis;
    let on = &plant.axes[axis as usize];
    let s = at.s.clamp(0.0, on.length);
    let site = plant.frame(on, s);
    // The leaf points where the cut word's own segment would have pointed: the map of the trunk's direction.
    let along = (cut.map.a * (stems.trunk.1 - stems.trunk.0)).try_normalize().unwrap_or(DVec3::Y);
    let mut dir = Vec3::from_array(along.to_array().map(narrow));
    if copy > 0 {
        // Normal deviates, clamped at two standard deviations: an isotropic spread about the first leaf.
        let mut part = || narrow(draw.normal().clamp(-2.0, 2.0)) * LEAF_SPREAD;
        dir = (dir + Vec3::new(part(), part(), part())).normalize_or(dir);
    }
    // Frame of the leaf: +Y along the midrib, +Z the part of `up` perpendicular to it.
    let up = osier_base::math::normalize_or(sky - dir * dir.dot(sky), osier_base::math::perpendicular(dir));
    let q = glam::Quat::from_mat3(&glam::Mat3::from_cols(dir.cross(up), dir, up)).normalize();
    let id = mix64(&[on.id, word("organ"), cut.id, u64::from(copy)]);
    let size_factor = 1.0 + LEAF_SIZE_DEVIATION * draw.normal().clamp(-2.0, 2.0);
    Organ {
        id,
        axis,
        s,
        offset: Vec3::ZERO,
        q: (site.q.inverse() * q).normalize(),
        scale: narrow(size * size_factor),
        proto: pick_prototype(id, plant.protos.len()),
        petiole: site.r + narrow(petiole * size_factor),
        tint: draw.unit_f32(),
        birth: 0.0,
    }
}

/// Index of a prototype; `plant::validate` refuses a plant with more prototypes than a 16-bit index can address.
fn proto_index(i: usize) -> u16 {
    u16::try_from(i).unwrap_or(u16::MAX)
}

#[cfg(test)]
mod tests;
