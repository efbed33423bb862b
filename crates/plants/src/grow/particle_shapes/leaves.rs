//! Leaves along axes.

use glam::{Mat3, Quat, Vec3};

use super::params::ShapeParams;
use crate::grow::pick_prototype;
use crate::grow::turtle::OrganSpec;
use osier_base::math::{GOLDEN_ANGLE, cos, exp, narrow, nlerp, normalize_or, perpendicular, sin};
use osier_base::rng::{Rng, mix64, word};
use osier_scene::plant::{Axis, Organ, Plant};

/// Random deviations are clamped to this many standard deviations; otherwise one leaf in 700 would stand out by its
/// size or angle.
const MAX_DEVIATION: f64 = 3.0;

/// Places leaves every `spacing` along the axes of a plant that bear none of the organ yet, where `bears` is true for the axis and
/// its radius at the site. Adds the prototypes of the organ if the plant has none of them; organs keep their canonical order.
pub(super) fn place_leaves(
    plant: &mut Plant,
    params: &ShapeParams,
    organ: Option<&OrganSpec>,
    bears: impl Fn(&Axis, f32) -> bool,
) {
    let leaves = &params.leaves;
    let Some(organ) = organ.filter(|o| leaves.spacing > 0.0 && !o.meshes.is_empty()) else { return };
    let first_proto = register_prototypes(plant, organ);
    // A plant that is filled may already have leaves of this kind: axes that bear some get no others in the same
    // places.
    let own = usize::from(first_proto)..usize::from(first_proto) + organ.meshes.len();
    let mut is_leafy = vec![false; plant.axes.len()];
    for leaf in plant.organs.iter().filter(|o| own.contains(&usize::from(o.proto))) {
        is_leafy[leaf.axis as usize] = true;
    }
    // All variants are scaled by the length of the longest, so that their proportions to each other stay.
    let longest = organ.meshes.iter().map(|m| m.bounds().max.y).fold(0.0_f32, f32::max);
    let unit = if longest > 1e-9 { organ.size / f64::from(longest) } else { organ.size };
    let mut placed = Vec::new();
    for ((i, axis), _) in (0_u32..).zip(&plant.axes).zip(&is_leafy).filter(|(_, leafy)| !**leafy) {
        let mut draws = Rng::at(plant.seed, &[axis.id.into(), "phyllotaxis".into()]);
        let first_azimuth = draws.range(0.0, std::f64::consts::TAU);
        let mut s = f64::from(axis.s_exposed) + leaves.spacing * draws.unit_f64();
        let mut ordinal = 0_u64;
        while s <= f64::from(axis.length) {
            let site = plant.frame(axis, narrow(s));
            if bears(axis, site.r) {
                let id = mix64(&[axis.id, word("leaf"), ordinal]);
                let mut draws = Rng::at(plant.seed, &[id.into(), "leaf".into()]);
                let mut deviate = || draws.normal_by_quantile().clamp(-MAX_DEVIATION, MAX_DEVIATION);
                let azimuth = first_azimuth + ordinal as f64 * GOLDEN_ANGLE;
                let angle = leaves.angle + leaves.angle_deviation * deviate();
                let size = exp(leaves.size_deviation * deviate());
                placed.push(Organ {
                    id,
                    axis: i,
                    s: narrow(s),
                    offset: Vec3::ZERO,
                    q: leaf_rotation(site.q, azimuth, angle, leaves.face_up),
                    scale: narrow(unit * size),
                    proto: first_proto + pick_prototype(id, organ.meshes.len()),
                    petiole: site.r + narrow(organ.petiole * size),
                    tint: draws.unit_f32(),
                    birth: birth_at(plant, axis, narrow(s)),
                });
            }
            ordinal += 1;
            s += leaves.spacing;
        }
    }
    plant.organs.append(&mut placed);
    plant.organs.sort_by(|a, b| a.axis.cmp(&b.axis).then(a.s.total_cmp(&b.s)).then(a.id.cmp(&b.id)));
}

/// Index in a plant of the first prototype of an organ; its prototypes are added if the plant has none of them.
/// `plant::validate` refuses a plant with more prototypes than a 16-bit index can address.
fn register_prototypes(plant: &mut Plant, organ: &OrganSpec) -> u16 {
    let own = organ.prototypes();
    let known = own.first().and_then(|first| plant.protos.iter().position(|p| p.name == first.name));
    let first = known.unwrap_or(plant.protos.len());
    if known.is_none() {
        plant.protos.extend(own);
    }
    u16::try_from(first).unwrap_or(u16::MAX)
}

/// Rotation of a leaf relative to the frame `q` of its axis: the midrib at `angle` to the axis, the upper side towards the tip of
/// the axis, then turned by the share `face_up` to face upwards.
fn leaf_rotation(q: Quat, azimuth: f64, angle: f64, face_up: f64) -> Quat {
    let side = Vec3::new(narrow(cos(azimuth)), 0.0, narrow(sin(azimuth)));
    let midrib = Vec3::Y * narrow(cos(angle)) + side * narrow(sin(angle));
    let own = oriented(midrib, Vec3::Y);
    if face_up <= 0.0 {
        return own;
    }
    let up = q.inverse() * Vec3::Y;
    nlerp(own, oriented(midrib, up), narrow(face_up))
}

/// The rotation that takes +Y to the midrib and +Z to the part of `up` perpendicular to it.
fn oriented(midrib: Vec3, up: Vec3) -> Quat {
    let upper = normalize_or(up - midrib * midrib.dot(up), perpendicular(midrib));
    Quat::from_mat3(&Mat3::from_cols(midrib.cross(upper), midrib, upper)).normalize()
}

/// Growth time, 0..1, at which an axis reached the arc length `s`, interpolated between its nodes.
fn birth_at(plant: &Plant, axis: &Axis, s: f32) -> f32 {
    let (i, t) = plant.segment(axis, s);
    plant.nodes.birth[i] + (plant.nodes.birth[i + 1] - plant.nodes.birth[i]) * t
}
