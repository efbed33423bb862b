//! The lamina (blade) as a mesh: cells between veins are triangulated in the plane, then folded, curled and waved; the petiole
//! continues below as the midrib.

use std::collections::{BTreeMap, BTreeSet};

use glam::{Vec2, Vec3};

use super::BladeSpec;
use super::edge_flips::{edge, flip_edges};
use super::outline::{BladeHalf, BladeOutline};
use crate::surface::pixels::{index_of_last, next_index};
use osier_base::Result;
use osier_base::geometry::triangulate;
use osier_base::math;
use osier_base::rng::Rng;
use osier_scene::Mesh;

/// Level of detail of a blade.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BladeDetail {
    /// For a picture of a few leaves: a smooth margin, some thousand triangles that follow every bend.
    Close,
    /// For plants near the camera: every tooth, 100 to 250 points.
    Hero,
    /// For plants seen whole: 40 to 90 points, without teeth.
    Light,
    /// For crowns of many thousand leaves: 20 to 50 points, with a straight margin between veins and bays.
    Crown,
    /// For trees in the distance: 9 points, without veins and petiole, of the same area.
    Distant,
}

/// Most points of one side's margin of a [`BladeDetail::Crown`] blade: crowns bear 10^5 leaves.
const MAX_CROWN_MARGIN_POINTS: usize = 12;
/// Most points of one side's margin of a [`BladeDetail::Distant`] blade: base, tip and three points between them. Own:
/// by eye, in a wood from 60 m on.
const MAX_DISTANT_MARGIN_POINTS: usize = 5;

/// Levels of subdivision of a [`BladeDetail::Close`] blade: each level cuts every triangle into four.
const SUBDIVISIONS: u32 = 2;

impl BladeDetail {
    /// Points along each piece of the margin, and whether the margin has teeth.
    fn margin(self) -> (u32, bool) {
        match self {
            Self::Close => (8, true),
            Self::Hero => (2, true),
            Self::Light | Self::Crown | Self::Distant => (1, false),
        }
    }

    /// Positions of the points of side veins between their ends, from 0 at the midrib to 1 at the margin.
    fn vein_points(self) -> &'static [f32] {
        match self {
            Self::Close | Self::Hero => &[0.34, 0.68],
            Self::Light => &[0.5],
            Self::Crown | Self::Distant => &[],
        }
    }

    /// Number of sides of the petiole, of rings along it and of rings below the blade; `None` without a petiole.
    fn petiole(self) -> Option<(u32, u32, u32)> {
        match self {
            Self::Close => Some((12, 10, 12)),
            Self::Hero => Some((5, 4, 4)),
            Self::Light => Some((3, 2, 1)),
            Self::Crown => Some((3, 1, 1)),
            Self::Distant => None,
        }
    }

    /// Whether a compound leaf has a stalk.
    pub(super) fn has_stalk(self) -> bool {
        self.petiole().is_some()
    }
}

/// Random deformation of one variant of a leaf.
struct BladeVariation {
    /// Angle by which each half is folded up from the plane, and bend of the midrib from base to tip, rad.
    fold: f32,
    curl: f32,
    /// Amplitude of the margin's waves, share of the width, and their phases on both sides, rad.
    wave: f32,
    phase: [f32; 2],
    /// Sideways bend of the tip, share of the length.
    sideways: f32,
    /// Twist from base to tip, rad.
    twist: f32,
    /// Factors of width and length.
    stretch: [f32; 2],
}

impl BladeVariation {
    fn new(spec: &BladeSpec, variant: u64) -> Self {
        let mut draw = Rng::at(spec.seed, &["leaf".into(), variant.into()]);
        // Values of the species vary relatively; bends of either sign vary by absolute amounts.
        let mut vary = |base: f32, by: f64| base * math::narrow(1.0 + draw.range(-by, by));
        let (fold, curl, wave) = (vary(spec.fold, 0.5), vary(spec.curl, 0.7), vary(spec.waviness, 0.5));
        let stretch = [vary(1.0, 0.08), vary(1.0, 0.06)];
        let mut any = |a: f64| math::narrow(draw.range(-a, a));
        Self { fold, curl, wave, phase: [any(3.0), any(3.0)], sideways: any(0.06), twist: any(0.25), stretch }
    }
}

/// The mesh of a leaf in organ space: petiole base at the origin, midrib along +Y, upper side +Z, m. One material (0).
/// `variant` varies fold, curl, waves and proportions; all variants share texture coordinates and so one set of maps:
/// u across, v from 0 at the base of the blade to 1 at its tip, petiole on the midrib.
/// # Errors
/// `Range` for a value outside its range.
/// Own: cells between veins, so that creases follow the veins.
pub fn blade(spec: &BladeSpec, variant: u64, detail: BladeDetail) -> Result<Mesh> {
    spec.check()?;
    // Outline and veins in the plane; for crowns with a margin of few points.
    let (smooth, teeth) = detail.margin();
    let mut outline = BladeOutline::new(spec, smooth, teeth);
    let mut variation = BladeVariation::new(spec, variant);
    match detail {
        BladeDetail::Crown => outline.halves.iter_mut().for_each(|half| half.simplify(MAX_CROWN_MARGIN_POINTS)),
        // The blade is widened by the area that the simplified margin loses, so that crowns keep their density.
        BladeDetail::Distant => variation.stretch[0] *= outline.simplify_without_veins(MAX_DISTANT_MARGIN_POINTS),
        BladeDetail::Close | BladeDetail::Hero | BladeDetail::Light => {}
    }
    // Triangulate the plane once; deform the points, so that all variants share topology and texture coordinates.
    let flat = triangulate_blade(&outline, detail);
    let mut mesh = Mesh {
        points: flat.points.iter().map(|p| bend_blade(spec, &variation, *p)).collect(),
        uvs: flat.points.iter().map(|p| outline.uv(*p)).collect(),
        triangles: flat.triangles,
        ..Mesh::default()
    };
    mesh.normals = smooth_normals(&mesh);
    petiole(spec, &variation, &outline, detail, &mut mesh);
    tilt_normals_to_faces(&mut mesh);
    Ok(mesh.with_material(0))
}

/// The triangulated blade before it is bent, in the plane of the outline, m.
struct BladeTriangulation {
    points: Vec<Vec2>,
    triangles: Vec<[u32; 3]>,
    /// Edges along veins, which must stay edges of the mesh.
    creases: BTreeSet<(u32, u32)>,
}

impl BladeTriangulation {
    fn push(&mut self, p: Vec2) -> u32 {
        self.points.push(p);
        index_of_last(&self.points)
    }

    /// Cuts each triangle into four at the midpoints of its edges; shared edges share the new point.
    fn subdivide(&mut self) {
        let mut middles: BTreeMap<(u32, u32), u32> = BTreeMap::new();
        for [a, b, c] in std::mem::take(&mut self.triangles) {
            let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(p, q)| {
                let middle = (self.points[p as usize] + self.points[q as usize]) * 0.5;
                *middles.entry(edge(p, q)).or_insert_with(|| self.push(middle))
            });
            self.triangles.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
    }

    /// Adds a cell between veins, triangulated; `reversed` if its corners run clockwise seen from above.
    fn add_cell(&mut self, corners: &[u32], reversed: bool) {
        let mut corners = corners.to_vec();
        if reversed {
            corners.reverse();
        }
        let outline: Vec<Vec2> = corners.iter().map(|i| self.points[*i as usize]).collect();
        self.triangles.extend(triangulate(&outline).iter().map(|t| t.map(|i| corners[i as usize])));
    }
}

/// Triangulates an outline so that midrib and veins are edges; improved by edge flips, and subdivided for close views.
fn triangulate_blade(outline: &BladeOutline, detail: BladeDetail) -> BladeTriangulation {
    let mut flat = BladeTriangulation { points: Vec::new(), triangles: Vec::new(), creases: BTreeSet::new() };
    let midrib: Vec<u32> = outline.midrib.iter().map(|y| flat.push(Vec2::new(0.0, *y))).collect();
    for (half, reversed) in outline.halves.iter().zip([true, false]) {
        add_half(&mut flat, outline, half, &midrib, detail, reversed);
    }
    flat.creases.extend(midrib.windows(2).map(|w| edge(w[0], w[1])));
    // Improve the triangles by edge flips; edges on veins stay, so that creases follow the veins.
    let BladeTriangulation { points, triangles, creases } = &mut flat;
    flip_edges(points, triangles, creases);
    for _ in 0..if detail == BladeDetail::Close { SUBDIVISIONS } else { 0 } {
        flat.subdivide();
    }
    flat
}

/// The cells of one half: up the midrib, out along the upper vein, back along the margin, in along the lower vein.
fn add_half(
    triangulation: &mut BladeTriangulation,
    outline: &BladeOutline,
    half: &BladeHalf,
    midrib: &[u32],
    detail: BladeDetail,
    reversed: bool,
) {
    // Points of the margin; base and tip are shared with the midrib.
    let last = half.margin.len() - 1;
    let (base, tip) = (midrib[0], midrib[midrib.len() - 1]);
    let vein_points = detail.vein_points();
    let margin: Vec<u32> = half
        .margin
        .iter()
        .enumerate()
        .map(|(i, p)| match i {
            0 => base,
            i if i == last => tip,
            _ => triangulation.push(*p),
        })
        .collect();
    // Lower bounds of the current cell: index on the midrib, index on the margin, and the vein between them from the
    // midrib outwards.
    let (mut from, mut along, mut below): (usize, usize, Vec<u32>) = (0, 0, Vec::new());
    for vein in &half.veins {
        let root = outline.midrib.partition_point(|y| *y < vein.root.y);
        let above: Vec<u32> = vein_points.iter().map(|t| triangulation.push(vein.point(*t))).collect();
        let line: Vec<u32> = [midrib[root]].iter().chain(&above).chain(&[margin[vein.at]]).copied().collect();
        triangulation.creases.extend(line.windows(2).map(|w| edge(w[0], w[1])));
        let corners: Vec<u32> = midrib[from..=root]
            .iter()
            .chain(&above)
            .chain(margin[along..=vein.at].iter().rev().filter(|i| **i != base))
            .chain(below.iter().rev())
            .copied()
            .collect();
        triangulation.add_cell(&corners, reversed);
        (from, along, below) = (root, vein.at, above);
    }
    // Without side veins this is the only cell: the midrib begins with the base, which is left out of the margin.
    let back = margin[along..last].iter().rev().filter(|i| **i != base);
    let corners: Vec<u32> = midrib[from..].iter().chain(back).chain(below.iter().rev()).copied().collect();
    triangulation.add_cell(&corners, reversed);
}

/// Bends a point of the flat blade into space. The midrib is an arc of `curl`; both halves are folded up along it, their margins
/// wave and droop.
fn bend_blade(spec: &BladeSpec, variation: &BladeVariation, p: Vec2) -> Vec3 {
    // Coordinates of the blade: u along the midrib, 0 to 1; share across it, 0 at the midrib and 1 at the margin.
    let half = spec.width * 0.5;
    let u = p.y / spec.length;
    let side = usize::from(p.x < 0.0);
    let x = p.x * variation.stretch[0];
    let share = (x / half).abs();
    // Fold both halves up along the midrib, less towards the tip; add waves that grow with share^1.5 towards the margin, and a
    // parabolic droop. Nine radians of phase are one and a half waves along the margin.
    let fold = variation.fold * (1.0 - 0.35 * u);
    let wave = variation.wave * spec.width * math::sin_f32(9.0 * u + variation.phase[side]) * share * share.sqrt();
    let rise = x.abs() * math::sin_f32(fold) - 0.1 * half * share * share + wave;
    let across = x * math::cos_f32(fold);
    // Twist the cross-section about the midrib, then place it on the midrib's arc.
    let twist = variation.twist * u;
    let (ct, st) = (math::cos_f32(twist), math::sin_f32(twist));
    let (across, rise) = (across * ct - rise * st, across * st + rise * ct);
    let (mid, normal) = midrib_frame(spec, variation, u);
    Vec3::new(across + variation.sideways * spec.length * u * u, mid.x + normal.x * rise, mid.y + normal.y * rise)
}

/// Point and normal of the midrib at `u` (0..1 along it), in the plane of y and z: a circular arc of angle `curl`.
fn midrib_frame(spec: &BladeSpec, variation: &BladeVariation, u: f32) -> (Vec2, Vec2) {
    let length = spec.length * variation.stretch[1];
    // Arc of curvature k / length from the end of the petiole: y = sin(k u) length / k, z = (cos(k u) - 1) length /
    // k.
    let k = if variation.curl.abs() < 1e-3 { 1e-3 } else { variation.curl };
    let a = k * u;
    let (sin, cos) = (math::sin_f32(a), math::cos_f32(a));
    let start = Vec2::new(spec.petiole_length, 0.0);
    (start + Vec2::new(sin, cos - 1.0) * (length / k), Vec2::new(sin, cos))
}

/// Vertex normals: the normalized sum of the face normals around, weighted by area.
fn smooth_normals(mesh: &Mesh) -> Vec<Vec3> {
    let mut normals = vec![Vec3::ZERO; mesh.points.len()];
    for t in &mesh.triangles {
        let [a, b, c] = t.map(|i| mesh.points[i as usize]);
        let n = (b - a).cross(c - a);
        for i in t {
            normals[*i as usize] += n;
        }
    }
    normals.iter().map(|n| if n.length() > 1e-20 { n.normalize() } else { Vec3::Z }).collect()
}

/// Where a sharp wave has turned triangles away from their vertex normals, tilts these normals until they agree with
/// the triangles. At most 8 sweeps.
fn tilt_normals_to_faces(mesh: &mut Mesh) {
    for _ in 0..8 {
        let mut turned = false;
        for t in &mesh.triangles {
            let [a, b, c] = t.map(|i| mesh.points[i as usize]);
            // A face agrees if the cosine to its summed vertex normals is positive, with a margin; else push its
            // normals towards it. The factor 1e6 lifts areas of mm^2 above the length that counts as zero.
            let n = math::normalize_or((b - a).cross(c - a) * 1e6, Vec3::ZERO);
            let mean: Vec3 = t.iter().fold(Vec3::ZERO, |s, i| s + mesh.normals[*i as usize]);
            if n.dot(mean) < 0.05 && n != Vec3::ZERO {
                turned = true;
                for i in t {
                    let normal = &mut mesh.normals[*i as usize];
                    *normal = math::normalize_or(*normal + n * 0.5, n);
                }
            }
        }
        if !turned {
            break;
        }
    }
}

/// A tube from the pivot to the blade and on below the midrib, thinning out; closed at both ends.
fn petiole(spec: &BladeSpec, variation: &BladeVariation, outline: &BladeOutline, detail: BladeDetail, mesh: &mut Mesh) {
    let Some((sides, steps, under)) = detail.petiole() else { return };
    let r = spec.petiole_radius;
    // Centreline with radii: the sagging petiole, thicker at its base, then along the underside of the midrib.
    let mut path: Vec<(Vec3, f32)> = Vec::new();
    for k in 0..steps {
        let t = k as f32 / steps as f32;
        let sag = 0.06 * spec.petiole_length * math::sin_f32(std::f32::consts::PI * t);
        path.push((Vec3::new(0.0, spec.petiole_length * t, -sag), r * (1.0 + 0.6 * (1.0 - t) * (1.0 - t))));
    }
    for k in 0..=under {
        let u = 0.62 * k as f32 / under as f32;
        let (mid, normal) = midrib_frame(spec, variation, u);
        let thin = r * (1.0 - 0.85 * u / 0.62);
        let p = mid - normal * (thin * 0.75);
        path.push((Vec3::new(variation.sideways * spec.length * u * u, p.x, p.y), thin));
    }
    if spec.petiole_length < 1e-6 {
        path.drain(..steps as usize);
    }
    let first = next_index(mesh);
    // An elliptic ring at every point. All texture coordinates lie on the midrib near the base of the blade.
    let base_v = outline.uv(Vec2::ZERO).y;
    for (i, (c, r)) in path.iter().enumerate() {
        let (a, b) = (path[i.saturating_sub(1)].0, path[(i + 1).min(path.len() - 1)].0);
        let t = math::normalize_or(b - a, Vec3::Y);
        let up = math::normalize_or(Vec3::X.cross(t), Vec3::Z);
        for j in 0..sides {
            let angle = j as f32 / sides as f32 * std::f32::consts::TAU;
            let (sin, cos) = (math::sin_f32(angle), math::cos_f32(angle));
            // Elliptic section of equal area: semi-axes r / sqrt(f) across and r sqrt(f) along the normal.
            let flat = spec.petiole_flatness.sqrt();
            mesh.points.push(*c + (Vec3::X * (cos / flat) + up * (sin * flat)) * *r);
            let end = if i == 0 {
                -t
            } else if i + 1 == path.len() {
                t
            } else {
                Vec3::ZERO
            };
            mesh.normals.push(math::normalize_or(Vec3::X * (cos * flat) + up * (sin / flat) + end * 0.3, up));
            let v = base_v + 0.02 + 0.03 * i as f32 / path.len() as f32;
            mesh.uvs.push(Vec2::new(outline.uv(Vec2::ZERO).x + 0.004 * cos, v));
        }
    }
    let rings = if spec.petiole_length < 1e-6 { under + 1 } else { steps + under + 1 };
    // Two triangles per side between consecutive rings.
    for i in 0..rings.saturating_sub(1) {
        for j in 0..sides {
            let (a, b) = (first + i * sides + j, first + i * sides + (j + 1) % sides);
            mesh.triangles.push([a, b + sides, b]);
            mesh.triangles.push([a, a + sides, b + sides]);
        }
    }
    let last = first + rings.saturating_sub(1) * sides;
    // Fans close both ends.
    for j in 1..sides - 1 {
        mesh.triangles.push([first, first + j, first + j + 1]);
        mesh.triangles.push([last, last + j + 1, last + j]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::leaf::LeafForm;

    fn area(spec: &BladeSpec, detail: BladeDetail) -> (f32, f32) {
        let (smooth, teeth) = detail.margin();
        let outline = BladeOutline::new(spec, smooth, teeth);
        let f = triangulate_blade(&outline, detail);
        let signed = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|i| f.points[i as usize]);
            (b - a).perp_dot(c - a) * 0.5
        };
        assert!(f.triangles.iter().all(|t| signed(t) > 0.0), "{:?}: every cell faces up", spec.form);
        let polygon = |h: &BladeHalf| h.margin.windows(2).fold(0.0, |s, w| s + w[0].perp_dot(w[1]) * 0.5);
        (f.triangles.iter().fold(0.0, |s, t| s + signed(t)), polygon(&outline.halves[0]) - polygon(&outline.halves[1]))
    }

    #[test]
    fn cells_cover_the_outline_once() {
        for spec in [BladeSpec::oak(), BladeSpec::birch(), BladeSpec::poplar(), BladeSpec::maple()] {
            for detail in [BladeDetail::Close, BladeDetail::Hero, BladeDetail::Light] {
                let (add_half, outline) = area(&spec, detail);
                assert!((add_half / outline - 1.0).abs() < 1e-3, "{:?}: {add_half} of {outline}", spec.form);
            }
        }
    }

    #[test]
    fn a_crown_blade_covers_what_a_light_one_does() {
        for spec in [BladeSpec::oak(), BladeSpec::birch(), BladeSpec::poplar()] {
            let mut outline = BladeOutline::new(&spec, 1, false);
            let all: Vec<Vec2> = outline.halves[0].margin.clone();
            let (light, _) = area(&spec, BladeDetail::Light);
            outline.halves.iter_mut().for_each(|half| half.simplify(MAX_CROWN_MARGIN_POINTS));
            let half = &outline.halves[0];
            assert!(half.margin.len() <= MAX_CROWN_MARGIN_POINTS.max(half.veins.len() + 2));
            assert!(half.veins.iter().all(|v| half.margin[v.at].distance(v.tip) < 1e-6), "veins end on the margin");
            assert!(half.margin.iter().all(|p| all.contains(p)));
            let flat = triangulate_blade(&outline, BladeDetail::Crown);
            let twice = |t: &[u32; 3]| {
                let [a, b, c] = t.map(|i| flat.points[i as usize]);
                (b - a).perp_dot(c - a)
            };
            let crown: f32 = 0.5 * flat.triangles.iter().map(twice).sum::<f32>();
            assert!((crown / light - 1.0).abs() < 0.12, "{:?}: {crown} of {light}", spec.form);
        }
    }

    /// Where the margin crossed a vein, parts of the blade lay over each other.
    #[test]
    fn cells_of_crown_blades_cover_their_outline_once() {
        for (lobes, depth) in [(3, 0.3), (4, 0.4), (5, 0.35), (5, 0.5), (7, 0.6)] {
            for seed in 0..8 {
                let spec = BladeSpec { seed, ..BladeSpec::oak() };
                let spec = BladeSpec { form: LeafForm::Lobed { lobes, depth }, ..spec };
                let mut outline = BladeOutline::new(&spec, 1, false);
                outline.halves.iter_mut().for_each(|half| half.simplify(MAX_CROWN_MARGIN_POINTS));
                let flat = triangulate_blade(&outline, BladeDetail::Crown);
                let twice = |t: &[u32; 3]| {
                    let [a, b, c] = t.map(|i| flat.points[i as usize]);
                    (b - a).perp_dot(c - a)
                };
                let covered: f32 = flat.triangles.iter().map(|t| twice(t).abs()).sum();
                let polygon = |h: &BladeHalf| h.margin.windows(2).fold(0.0, |s, w| s + w[0].perp_dot(w[1]));
                let whole = polygon(&outline.halves[0]) - polygon(&outline.halves[1]);
                assert!((covered / whole - 1.0).abs() < 1e-3, "{lobes} {depth} {seed}: {covered} of {whole}");
            }
        }
    }

    #[test]
    fn a_distant_blade_has_the_area_of_a_light_one() {
        for spec in
            [BladeSpec::oak(), BladeSpec::birch(), BladeSpec::poplar(), BladeSpec::maple(), BladeSpec::elliptic()]
        {
            let mut outline = BladeOutline::new(&spec, 1, false);
            let (light, _) = area(&spec, BladeDetail::Light);
            let widening = outline.simplify_without_veins(MAX_DISTANT_MARGIN_POINTS);
            let flat = triangulate_blade(&outline, BladeDetail::Distant);
            assert_eq!((flat.points.len(), flat.triangles.len()), (9, 8), "{:?}", spec.form);
            let twice = |t: &[u32; 3]| {
                let [a, b, c] = t.map(|i| flat.points[i as usize]);
                (b - a).perp_dot(c - a)
            };
            assert!(flat.triangles.iter().all(|t| twice(t) > 0.0), "{:?}: every cell faces up", spec.form);
            let distant: f32 = 0.5 * widening * flat.triangles.iter().map(twice).sum::<f32>();
            assert!((distant / light - 1.0).abs() < 1e-3, "{:?}: {distant} of {light}", spec.form);
            // Palmate blades lose most: their bays are as deep as their lobes are long.
            assert!((0.6..1.6).contains(&widening), "{:?}: {widening}", spec.form);
            let mesh =
                blade(&BladeSpec { petiole_length: 0.05, ..spec.clone() }, 0, BladeDetail::Distant).expect("a blade");
            assert_eq!(mesh.points.len(), 9, "no petiole");
        }
    }

    /// What the keys of a leaf allow: `size` of 1 mm to 2 m and `width` of 0.02 to 3 times as much.
    #[test]
    fn blades_of_any_size_are_sound() {
        let all = [BladeSpec::oak(), BladeSpec::birch(), BladeSpec::maple(), BladeSpec::elliptic(), BladeSpec::petal()];
        for spec in all {
            for (length, width) in [(0.001, 0.02), (0.001, 1.0), (0.004, 0.2), (2.0, 3.0)] {
                let spec = BladeSpec { length, width: length * width, ..spec.clone() };
                for detail in [BladeDetail::Close, BladeDetail::Light, BladeDetail::Crown, BladeDetail::Distant] {
                    let mesh = blade(&spec, 0, detail).expect("a size that scenes may have");
                    assert!(mesh.points.iter().all(|p| p.is_finite()), "{:?} {length} {detail:?}", spec.form);
                    assert!(mesh.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-3), "{:?} {length}", spec.form);
                }
            }
        }
    }

    #[test]
    fn blades_are_sound_and_variants_differ() {
        for spec in [BladeSpec::oak(), BladeSpec::birch(), BladeSpec::poplar(), BladeSpec::maple()] {
            let all = [
                (BladeDetail::Close, 1000..=6000),
                (BladeDetail::Hero, 60..=280),
                (BladeDetail::Light, 20..=100),
                (BladeDetail::Crown, 20..=50),
                (BladeDetail::Distant, 9..=9),
            ];
            for (detail, counts) in all {
                let (a, b) = (blade(&spec, 0, detail).expect("a"), blade(&spec, 1, detail).expect("b"));
                assert!(counts.contains(&a.points.len()), "{:?} {detail:?}: {}", spec.form, a.points.len());
                assert_eq!(a.uvs, b.uvs, "variants share their maps");
                assert_ne!(a.points, b.points);
                assert!(a.uvs.iter().all(|t| (0.0..=1.0).contains(&t.x) && (0.0..=1.0).contains(&t.y)));
                assert!(a.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-4));
                let bad = a.triangles.iter().filter(|t| {
                    let [p, q, r] = t.map(|i| a.points[i as usize]);
                    let mean = t.iter().fold(Vec3::ZERO, |s, i| s + a.normals[*i as usize]);
                    (q - p).cross(r - p).dot(mean) <= 0.0
                });
                assert_eq!(bad.count(), 0, "{:?} {detail:?}", spec.form);
            }
        }
        assert!(blade(&BladeSpec { length: -1.0, ..BladeSpec::oak() }, 0, BladeDetail::Hero).is_err());
    }
}
