//! Compound leaves: leaflets in pairs along a stalk, each a separate blade.

use glam::{Quat, Vec3};

use super::{BladeDetail, BladeSpec, blade};
use osier_base::math;
use osier_base::rng::Rng;
use osier_base::{Error, Result};
use osier_scene::Mesh;

/// Angle between the stalk and its lowest and its highest pair of leaflets, rad.
const LEAFLET_ANGLE: [f32; 2] = [1.15, 0.75];
/// Standard deviation of that angle and of the tilt of leaflets out of the leaf's plane, rad.
const ANGLE_DEVIATION: f32 = 0.09;
/// Length of the lowest and the highest leaflet divided by that of the longest, which is in the middle.
const LEAFLET_SHARE: [f32; 2] = [0.75, 0.85];
/// Share of the leaf's length, from the base of the stalk, at which the lowest pair sits.
const FIRST_PAIR: f32 = 0.24;
/// Sag of the stalk at its tip below the straight line from its base, as a share of its length.
const SAG: f32 = 0.06;
/// Length of the stalk of a leaflet as a share of its blade.
const LEAFLET_STALK: f32 = 0.04;

/// Number and size of the leaflets of a compound leaf.
#[derive(Debug, Clone, PartialEq)]
pub struct CompoundSpec {
    /// Number of leaflets, 1..=41: an odd number has one at the tip. 1 is a simple leaf.
    pub leaflets: u32,
    /// Length of the longest leaflet divided by the leaf's, 0.02..1.
    pub leaflet_length: f32,
}

/// A pinnate leaf in the space of [`blade`]: base of the stalk at the origin, stalk along +Y, upper side +Z. `spec` gives the
/// outline and proportions of the leaflets; its `length` is that of the whole leaf without the petiole below the lowest pair.
/// With one leaflet it is the blade itself. All leaflets share the maps of the blade.
/// # Errors
/// `Range` for a value outside its range.
pub fn compound_leaf(spec: &BladeSpec, compound: &CompoundSpec, variant: u64, detail: BladeDetail) -> Result<Mesh> {
    let rows =
        [("leaflets", compound.leaflets as f32, 1.0, 41.0), ("length of leaflets", compound.leaflet_length, 0.02, 1.0)];
    for (name, value, min, max) in rows {
        if !(min..=max).contains(&value) {
            let name = format!("leaf: {name}");
            return Err(Error::Range { name, value: value.into(), min: min.into(), max: max.into(), unit: "" });
        }
    }
    if compound.leaflets == 1 {
        return blade(spec, variant, detail);
    }
    let whole = spec.length + spec.petiole_length;
    let longest = spec.length * compound.leaflet_length;
    let scale = longest / spec.length;
    let leaflet = BladeSpec {
        length: longest,
        width: spec.width * scale,
        petiole_length: longest * LEAFLET_STALK,
        petiole_radius: (spec.petiole_radius * 0.6).max(0.000_1),
        ..spec.clone()
    };
    let mut draws = Rng::at(spec.seed, &["leaflets".into(), variant.into()]);
    let mut deviate = |deviation: f32| deviation * math::narrow(draws.normal().clamp(-2.0, 2.0));
    // The stalk: an arc that ends where the leaflet at the tip, or the last pair, begins.
    let odd = compound.leaflets % 2 == 1;
    let stalk = if odd { whole - longest } else { whole - 0.6 * longest }.max(0.3 * whole);
    let at = |t: f32| Vec3::new(0.0, stalk * t, -SAG * stalk * t * t);
    let mut mesh = Mesh::default();
    if detail.has_stalk() {
        push_stalk(&mut mesh, at, spec.petiole_radius);
    }
    let pairs = compound.leaflets / 2;
    let first = (FIRST_PAIR * whole / stalk).min(0.8);
    let last = if odd { 1.0 - 0.5 * (1.0 - first) / pairs as f32 } else { 1.0 };
    let mut add = |at: Vec3, turn: Quat, size: f32, number: u64| -> Result<()> {
        let mut part = blade(&leaflet, variant * 64 + number, detail)?;
        part.points.iter_mut().for_each(|p| *p = at + turn * (*p * size));
        part.normals.iter_mut().for_each(|n| *n = turn * *n);
        mesh.append(&part);
        Ok(())
    };
    for pair in 0..pairs {
        let part = if pairs == 1 { 0.5 } else { pair as f32 / (pairs - 1) as f32 };
        // Leaflets are longest in the middle: a parabola on each half down to the length at that end.
        let end = if part < 0.5 { LEAFLET_SHARE[0] } else { LEAFLET_SHARE[1] };
        let off = 2.0 * part - 1.0;
        let size = 1.0 - (1.0 - end) * off * off;
        for (side, number) in [(-1.0, 0), (1.0_f32, 1)] {
            let angle = math::lerp(LEAFLET_ANGLE[0], LEAFLET_ANGLE[1], part) + deviate(ANGLE_DEVIATION);
            let turn =
                math::rotation_about(Vec3::Z, -side * angle) * math::rotation_about(Vec3::Y, deviate(ANGLE_DEVIATION));
            let t = math::lerp(first, last, part) + 0.1 * deviate(ANGLE_DEVIATION);
            add(at(t.clamp(0.0, 1.0)), turn.normalize(), size, u64::from(2 * pair) + number)?;
        }
    }
    if odd {
        let turn = math::rotation_about(Vec3::Z, deviate(ANGLE_DEVIATION)) * math::rotation_about(Vec3::X, -2.0 * SAG);
        add(at(1.0), turn.normalize(), 1.0, u64::from(compound.leaflets))?;
    }
    Ok(mesh.with_material(0))
}

/// The stalk as a tube of three sides with a ring at each of its four stations. Its texture coordinates lie on the midrib.
fn push_stalk(mesh: &mut Mesh, at: impl Fn(f32) -> Vec3, radius: f32) {
    const STATIONS: u32 = 4;
    const SIDES: u32 = 3;
    for station in 0..STATIONS {
        let t = station as f32 / (STATIONS - 1) as f32;
        let r = radius * (1.3 - 0.8 * t);
        for side in 0..SIDES {
            let azimuth = side as f32 * std::f32::consts::TAU / SIDES as f32;
            let out = Vec3::new(math::cos_f32(azimuth), 0.0, math::sin_f32(azimuth));
            mesh.points.push(at(t) + out * r);
            mesh.normals.push(out);
            mesh.uvs.push(glam::Vec2::new(0.5, 0.1 + 0.05 * t));
        }
    }
    for station in 0..STATIONS - 1 {
        for side in 0..SIDES {
            let (a, b) = (station * SIDES + side, station * SIDES + (side + 1) % SIDES);
            mesh.triangles.push([a, b + SIDES, b]);
            mesh.triangles.push([a, a + SIDES, b + SIDES]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(mesh: &Mesh) -> f32 {
        let at = |i: u32| mesh.points[i as usize];
        mesh.triangles.iter().map(|[a, b, c]| 0.5 * (at(*b) - at(*a)).cross(at(*c) - at(*a)).length()).sum()
    }

    #[test]
    fn leaflets_stand_along_the_stalk() {
        let spec = BladeSpec { length: 0.25, width: 0.1, petiole_length: 0.0, ..BladeSpec::elliptic() };
        let of = |leaflets| {
            let compound = CompoundSpec { leaflets, leaflet_length: 0.32 };
            compound_leaf(&spec, &compound, 1, BladeDetail::Light).expect("in range")
        };
        let (three, eleven) = (of(3), of(11));
        // The lowest and highest of many leaflets are shorter than the few in the middle.
        let ratio = area(&eleven) / area(&three);
        assert!((2.4..3.7).contains(&ratio), "{ratio}");
        let size = eleven.bounds().size();
        assert!((size.y / 0.25 - 1.0).abs() < 0.1 && size.x > 0.12 && size.z < size.x, "{size}");
        assert!(eleven.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-3));
        let even = of(10);
        assert!(even.triangles.len() < eleven.triangles.len());
        // A simple leaf is the blade itself.
        assert_eq!(of(1).points, blade(&spec, 1, BladeDetail::Light).expect("in range").points);
        let none = CompoundSpec { leaflets: 0, leaflet_length: 0.3 };
        assert!(compound_leaf(&spec, &none, 0, BladeDetail::Light).is_err());
    }
}
