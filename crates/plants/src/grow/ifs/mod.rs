//! Trees of iterated function systems: words become axes, nodes and organs of a [`Plant`].

mod axes;
mod cards;
pub mod twigs;

use std::collections::BTreeMap;

use glam::{DVec3, Vec3};

use super::radii;
use super::turtle::{OrganSpec, set_exposed_lengths};
use axes::{Raw, Skeleton};
pub use cards::{Cards, Class, classes};
use osier_base::diagnostic::Report;
use osier_base::limits::Limits;
use osier_base::math::narrow;
use osier_base::rng::{Rng, child, mix64, word};
use osier_base::{Error, Result};
use osier_ifs::affine::Affine;
use osier_ifs::stems::Stems;
use osier_ifs::words::{self, Expansion, Variation, Word};
use osier_scene::plant::{NONE, Organ, Plant, Proto};

/// Most words of a tree.
const MAX_SEGMENTS: u64 = 5_000_000;

/// How a system becomes a tree.
#[derive(Debug, Clone)]
pub struct TreeOptions {
    /// Height at full growth, m.
    pub height: f64,
    /// Words smaller than this are cut; the trunk has size 1.
    pub eps: f64,
    /// Longest word.
    pub max_depth: u16,
    /// Highest order of branches.
    pub max_order: u16,
    /// How much individuals differ, 0..2.
    pub variation: f64,
    /// Radius of the trunk at its foot, m; `None`: the system's.
    pub radius: Option<f64>,
    /// Radii by the pipe model instead of the maps' factors.
    pub pipe: bool,
    /// Share of the leaf sites that bear a leaf.
    pub leaf_density: f64,
    /// Leaves at a site.
    pub leaves_per_site: u32,
    /// The leaf.
    pub leaf: Option<OrganSpec>,
    /// The meshes of the table's condensation sets, in table units: each stands on every word.
    pub sets: Vec<OrganSpec>,
    /// Stand for what is shorter than their cut, if the tree is seen from afar.
    pub cards: Option<Cards>,
    /// Names of materials.
    pub materials: Vec<String>,
    /// Material of axes, of thin ones, and the radius below which they are thin.
    pub bark: (u16, u16, f64),
    /// What made the plant, for people.
    pub source: String,
    /// Unit vector that leaves turn their upper sides to: +Y, or elsewhere for what will be turned as a whole.
    pub up: Vec3,
}

/// Grows a tree. `plant`: its id and seed.
/// Returns it validated. Topology and ids do not depend on the seed; a smaller eps moves nothing.
/// Source: [zhao-zhang] 2.2: trees as words of contractions of a trunk.
/// Differs: tapered tubes that bend with their axis in place of joined cylinders; growth cut by size.
/// # Errors
/// `Input` with I040 beyond the words allowed; what `plant::validate` refuses.
pub fn grow(stems: &Stems, plant: (u32, u64), options: &TreeOptions, limits: &Limits) -> Result<Plant> {
    let fine = cut(options, limits);
    let cut = words::Limits { eps: options.cards.as_ref().map_or(fine.eps, |c| c.eps), ..fine };
    let expanded = expanded(stems, plant, options, &cut)?;
    let scale = scale(stems, options);
    let radius = options.radius.unwrap_or(stems.radius * scale);
    built(stems, &expanded, (plant, scale, radius), options, |_, _, _| {})
}

/// Metres per table unit.
fn scale(stems: &Stems, options: &TreeOptions) -> f64 {
    options.height / words::height(&stems.system, &stems.letters, stems.trunk)
}

fn expanded(stems: &Stems, plant: (u32, u64), options: &TreeOptions, cut: &words::Limits) -> Result<Expansion> {
    let vary = Variation::new(plant.1, plant.0.into(), options.variation);
    let vary = (options.variation > 0.0).then_some(vary);
    words::expand(&stems.system, &stems.letters, cut, vary)
        .map_err(|d| Error::Input(Box::new(Report { diagnostics: vec![*d], ..Report::default() })))
}

/// The plant of some words, with what `more` adds to its organs. `scale`: metres per table unit; `radius`: of the
/// foot, m.
fn built(
    stems: &Stems,
    expanded: &Expansion,
    (plant, scale, radius): ((u32, u64), f64, f64),
    options: &TreeOptions,
    more: impl FnOnce(&mut Plant, Grown<'_>, &mut Placed),
) -> Result<Plant> {
    let skeleton = axes::skeleton(stems, expanded, (scale, radius));
    let mut out = Plant {
        id: plant.0,
        seed: plant.1,
        materials: options.materials.clone(),
        source: options.source.clone(),
        ..Plant::default()
    };
    skeleton.lay(&mut out);
    let grown = (stems, expanded, &skeleton, scale);
    let mut placed = bear(&mut out, grown, options);
    more(&mut out, grown, &mut placed);
    out.organs = placed.into_values().collect();
    if options.pipe {
        radii::pipe(&mut out, &radii::Pipe { base: Some(radius), ..radii::Pipe::default() });
    }
    osier_scene::plant::validate(&mut out)?;
    set_exposed_lengths(&mut out);
    let (thick, thin, below) = options.bark;
    for axis in &mut out.axes {
        let base = out.nodes.r.get(axis.first as usize).copied().unwrap_or(0.0);
        axis.material = if f64::from(base) < below { thin } else { thick };
    }
    Ok(out)
}

/// What becomes a word of the fine tree.
pub fn cut(options: &TreeOptions, limits: &Limits) -> words::Limits {
    let max_words = limits.get("nodes").min(MAX_SEGMENTS);
    words::Limits { eps: options.eps, max_depth: options.max_depth, max_order: options.max_order, max_words }
}

/// A plant's organs by axis, arc length and id.
type Placed = BTreeMap<(u32, u32, u64), Organ>;

/// What a tree bears: leaves, and the sets of its table.
fn bear(plant: &mut Plant, grown: Grown<'_>, options: &TreeOptions) -> Placed {
    let mut placed = Placed::new();
    leaves(plant, grown, options, &mut placed);
    sets(plant, grown, options, &mut placed);
    cards::stand(plant, grown, options, &mut placed);
    placed
}

/// Meshes at every word, as its map moves and turns them.
/// Own: K = C u w_1(K) u ..., word by word; a map's reflection and shear are left out, its scale is that of its volume.
fn sets(plant: &mut Plant, (_, expanded, skeleton, scale): Grown<'_>, options: &TreeOptions, placed: &mut Placed) {
    for set in &options.sets {
        let Some(mesh) = set.meshes.first() else { continue };
        let proto = u16::try_from(plant.protos.len()).unwrap_or(u16::MAX);
        plant.protos.push(Proto { name: set.name.clone(), mesh: std::sync::Arc::clone(mesh) });
        for (i, word) in expanded.words.iter().enumerate() {
            let Some((axis, s)) = skeleton.foot(i) else { continue };
            let id = mix64(&[plant.axes[axis as usize].id, self::word("set"), proto.into(), word.id]);
            let tint = Rng::at(plant.seed, &[plant.id.into(), "ifs-set".into(), id.into()]).unit_f32();
            let size = narrow(scale * growth(&word.map));
            let organ = Organ { id, scale: size, proto, tint, ..stood(plant, (axis, s), &word.map, scale) };
            placed.insert((axis, organ.s.to_bits(), id), organ);
        }
    }
}

/// An organ, still without a name and in its own size, with its foot where a map moves the origin, turned as the map turns. `s`:
/// where it stands on its axis, table units; `scale`: metres per table unit.
fn stood(plant: &Plant, (axis, s): (u32, f64), map: &Affine, scale: f64) -> Organ {
    let on = &plant.axes[axis as usize];
    let s = narrow(s * scale).clamp(0.0, on.length);
    let site = plant.frame(on, s);
    let back = site.q.inverse();
    let at = Vec3::from_array((map.b * scale).to_array().map(narrow));
    let (offset, q) = (back * (at - site.p), (back * turn(map)).normalize());
    Organ { id: 0, axis, s, offset, q, scale: 1.0, proto: 0, petiole: 0.0, tint: 0.5, birth: 0.0 }
}

/// What a map makes of lengths, on the mean: the cube root of what it makes of a volume.
fn growth(map: &Affine) -> f64 {
    osier_base::math::pow(map.a.determinant().abs(), 1.0 / 3.0)
}

/// The turn of a map: its axes made orthonormal, y first.
fn turn(map: &Affine) -> glam::Quat {
    let y = map.a.y_axis.try_normalize().unwrap_or(DVec3::Y);
    let x = (map.a.x_axis - y * y.dot(map.a.x_axis)).try_normalize().unwrap_or_else(|| y.any_orthonormal_vector());
    let column = |v: DVec3| Vec3::from_array(v.to_array().map(narrow));
    glam::Quat::from_mat3(&glam::Mat3::from_cols(column(x), column(y), column(x.cross(y)))).normalize()
}

/// A tree's system, its words, the axes that they became, and metres per table unit.
type Grown<'a> = (&'a Stems, &'a Expansion, &'a Skeleton, f64);

/// Leaves at the cut words of maps that bear them.
fn leaves(
    plant: &mut Plant,
    (stems, expanded, skeleton, scale): Grown<'_>,
    options: &TreeOptions,
    placed: &mut Placed,
) {
    let Some(leaf) = options.leaf.as_ref().filter(|l| !l.meshes.is_empty()) else { return };
    let many = leaf.meshes.len() > 1;
    plant.protos = (leaf.meshes.iter().enumerate())
        .map(|(i, mesh)| {
            let name = if many { format!("{}_{i}", leaf.name) } else { leaf.name.clone() };
            Proto { name, mesh: std::sync::Arc::clone(mesh) }
        })
        .collect();
    let first = f64::from(leaf.meshes[0].bounds().max.y).max(1e-9);
    let size = leaf.size / first;
    let bears = |c: &&Word| stems.system.maps.get(usize::from(c.letter)).is_some_and(|m| m.leaf);
    for cut in expanded.cuts.iter().filter(bears).filter(|c| !cards::stands_for(c, options)) {
        let Some((axis, s)) = skeleton.site(stems, expanded, cut) else { continue };
        for copy in 0..options.leaves_per_site.max(1) {
            let mut draw = Rng::at(plant.seed, &[plant.id.into(), "ifs-leaf".into(), cut.id.into(), copy.into()]);
            if !draw.chance(options.leaf_density) {
                continue;
            }
            let organ = organ(plant, (axis, narrow(s * scale)), (stems, cut, copy), (&mut draw, size), options.up);
            // Bits of a positive float order as the float does.
            placed.insert((axis, organ.s.to_bits(), organ.id), organ);
        }
    }
}

fn organ(
    plant: &Plant,
    (axis, s): (u32, f32),
    (stems, cut, copy): (&Stems, &Word, u32),
    (draw, size): (&mut Rng, f64),
    sky: Vec3,
) -> Organ {
    let on = &plant.axes[axis as usize];
    let s = s.clamp(0.0, on.length);
    let site = plant.frame(on, s);
    let along = (cut.map.a * (stems.trunk.1 - stems.trunk.0)).try_normalize().unwrap_or(DVec3::Y);
    let mut dir = Vec3::from_array(along.to_array().map(narrow));
    // Further leaves of a site spread out from the first.
    if copy > 0 {
        let mut part = || narrow(draw.normal().clamp(-2.0, 2.0)) * 0.55;
        dir = (dir + Vec3::new(part(), part(), part())).normalize_or(dir);
    }
    let up = osier_base::math::normalize_or(sky - dir * dir.dot(sky), osier_base::math::perpendicular(dir));
    let q = glam::Quat::from_mat3(&glam::Mat3::from_cols(dir.cross(up), dir, up)).normalize();
    let id = mix64(&[on.id, word("organ"), cut.id, u64::from(copy)]);
    let count = u64::try_from(plant.protos.len()).unwrap_or(1).max(1);
    let vary = 1.0 + 0.12 * draw.normal().clamp(-2.0, 2.0);
    Organ {
        id,
        axis,
        s,
        offset: Vec3::ZERO,
        q: (site.q.inverse() * q).normalize(),
        scale: narrow(size * vary),
        proto: u16::try_from(child(id, word("proto")) % count).unwrap_or(0),
        petiole: site.r,
        tint: draw.unit_f32(),
        birth: 0.0,
    }
}

/// The axis of a raw index, for tests and for sites.
fn place(raw: &[Raw], axis: usize) -> u32 {
    raw.get(axis).map_or(NONE, |r| r.place)
}

#[cfg(test)]
mod tests;
