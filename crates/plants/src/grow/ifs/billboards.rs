//! Trees at low detail: billboards (impostors) replace the branches below a size.

use super::{GrownTree, PlacedOrgans, TreeOptions, organ_at_word, proto_index, volume_scale};
use crate::grow::pick_prototype;
use crate::grow::turtle::OrganSpec;
use osier_base::diagnostic::Diagnostic;
use osier_base::math::{self, narrow};
use osier_base::rng::{mix64, word};
use osier_ifs::stems::TreeSystem;
use osier_ifs::words::{self, Word};
use osier_scene::plant::{Organ, Plant, Proto};

/// Billboards that stand for whole branches, grouped into classes of subtrees of about one size.
#[derive(Debug, Clone)]
pub struct SubtreeBillboards {
    /// Meshes of billboards, in metres: all variants of the first class, then those of the next.
    pub spec: OrganSpec,
    /// Representative size of the subtrees of each class, as a share of the trunk's.
    pub sizes: Vec<f64>,
    /// Number of meshes of each class; 0 counts as 1.
    pub variants: usize,
    /// Branches shorter than this share of the trunk are replaced.
    pub eps: f64,
}

/// A class of subtrees of about one size that share billboards.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SubtreeClass {
    /// Representative size as a share of the trunk's: the geometric middle of the class.
    pub size: f64,
    /// Mean radius of the bases of its subtrees, as a share of the trunk's.
    pub radius: f64,
    /// Lowest order of their first branch.
    pub order: u16,
}

/// The classes of subtrees that a cut at `coarse` removes from a tree cut at `limits.eps`: `count` steps of equal ratio, without
/// those that hold no subtree.
/// # Errors
/// I040 beyond the words allowed.
pub fn subtree_classes(
    stems: &TreeSystem,
    limits: &words::ExpansionLimits,
    coarse: f64,
    count: u32,
) -> Result<Vec<SubtreeClass>, Box<Diagnostic>> {
    let cut = words::ExpansionLimits { eps: coarse, ..*limits };
    // The subtrees that a coarse cut would replace, gathered into classes of equal size ratio: number, sum of radii,
    // lowest order.
    let cuts = words::expand(&stems.system, &stems.letters, &cut, None)?.cuts;
    let mut sums = vec![(0.0, 0.0, u16::MAX); count.max(1) as usize];
    let ratio = coarse / limits.eps;
    let steps = f64::from(count.max(1));
    for w in cuts.iter().filter(|w| w.size >= limits.eps) {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "one of a few subtree_classes")]
        let class = (math::ln(w.size / limits.eps) / math::ln(ratio) * steps).clamp(0.0, steps - 1.0) as usize;
        let sum = &mut sums[class];
        *sum = (sum.0 + 1.0, sum.1 + w.radius, sum.2.min(w.order));
    }
    let class = |(k, (n, radius, order)): (u32, (f64, f64, u16))| {
        // A class is represented by the geometric middle of its range.
        let size = limits.eps * math::pow(ratio, (f64::from(k) + 0.5) / steps);
        (n > 0.0).then_some(SubtreeClass { size, radius: radius / n, order })
    };
    Ok((0..).zip(sums).filter_map(class).collect())
}

/// Whether a cut word grows on at full detail, so that a billboard replaces it.
pub(super) fn is_replaced(cut: &Word, options: &TreeOptions) -> bool {
    let grows = cut.size >= options.eps && cut.depth <= options.max_depth && cut.order <= options.max_order;
    grows && options.cards.is_some()
}

/// Places a billboard at each cut word that would have grown on, rotated by its map, at the size of the branch that it replaces.
pub(super) fn place_billboards(
    plant: &mut Plant,
    grown: GrownTree<'_>,
    options: &TreeOptions,
    placed: &mut PlacedOrgans,
) {
    let GrownTree { stems, expanded, skeleton, scale } = grown;
    let Some(cards) = options.cards.as_ref().filter(|c| !c.spec.meshes.is_empty()) else { return };
    let first = plant.protos.len();
    let named = |(i, mesh): (usize, &std::sync::Arc<osier_scene::Mesh>)| Proto {
        name: format!("{}_{i}", cards.spec.name),
        mesh: std::sync::Arc::clone(mesh),
    };
    plant.protos.extend(cards.spec.meshes.iter().enumerate().map(named));
    for cut in expanded.cuts.iter().filter(|c| is_replaced(c, options)) {
        let Some(site) = skeleton.site(stems, expanded, cut) else { continue };
        // The nearest class by ratio of sizes; the remaining ratio scales the billboard.
        let size_distance = |size: &f64| math::ln(cut.size / size).abs();
        let nearest = (0..cards.sizes.len())
            .min_by(|a, b| size_distance(&cards.sizes[*a]).total_cmp(&size_distance(&cards.sizes[*b])));
        let Some(class) = nearest else { continue };
        let id = mix64(&[plant.axes[site.axis as usize].id, word("card"), cut.id]);
        let variants = cards.variants.max(1);
        let variant = usize::from(pick_prototype(id, variants));
        let organ = Organ {
            id,
            scale: narrow(volume_scale(&cut.map) / cards.sizes[class]),
            proto: proto_index(first + class * variants + variant),
            ..organ_at_word(plant, site, &cut.map, scale)
        };
        placed.insert((site.axis, organ.s.to_bits(), id), organ);
    }
}
