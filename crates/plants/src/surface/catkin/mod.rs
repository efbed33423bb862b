//! The tuft of hairs that carries the seed of a willow or poplar: curves of its plant, and meshes for every distance.

mod billboard;
mod stalk;
mod tuning;

use glam::Vec3;

use osier_base::math::{self, narrow};
use osier_base::rng::{Rng, child, word};
use osier_scene::plant::Plant;
use osier_scene::{Curves, Fine, Material, MaterialClass, MaterialId, Mesh, Prototype, tubes, turned_ribbons};

pub use stalk::stalk;
pub use tuning::VARIANTS;

/// Share of the hairs that is kept at the middle distance, widened. Fewer hairs look like straw.
const THINNED_SHARE: f64 = 0.3;

/// How a tuft is modelled: shape of its hairs, thickness of its stalk, and the materials of both.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TuftSpec {
    /// Largest random change of a hair's length, as a share of it, 0..0.9.
    pub jitter: f64,
    /// Radius of a hair where it begins, m.
    pub radius: f64,
    /// Radius at the tip of a hair as a share of `radius`, 0..1; it is linear along the hair.
    pub tip: f64,
    /// Points that a smoothed hair has; 0 leaves its three straight sections.
    pub smooth: u32,
    /// Small semi-axis of the stalk, m; 0 = no stalk.
    pub stalk: f64,
    /// Material of the hairs, then that of the stalk.
    pub materials: [MaterialId; 2],
}

/// Level of detail of a tuft, from near to far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum TuftDetail {
    /// All hairs as three-sided tubes.
    Tubes,
    /// All hairs as two-sided ribbons.
    Ribbons,
    /// Three tenths of the hairs as ribbons, widened to cover the area of all.
    Thinned,
}

/// A tuft: hairs begin at the origin and the tuft opens towards +Y; the stalk hangs below.
#[derive(Debug, Clone)]
pub struct Tuft {
    /// Hairs, in the order of the plant's axes.
    pub hairs: Curves,
    /// Radius of the smallest ball around the origin that holds all hairs and the stalk, m.
    pub radius: f32,
    /// Smallest y of hairs and stalk, m, at most 0.
    pub lowest: f32,
    spec: TuftSpec,
    key: u64,
}

/// The tuft of a plant; `key` seeds the lengths and ribbon angles of its hairs.
/// `plant`: one hair per axis, from its first node at the origin.
/// Source: \[catkin\] 3; the bounding ball, fig. 7a. Differs: the ball holds the stalk as well.
pub fn tuft(plant: &Plant, spec: &TuftSpec, key: u64) -> Tuft {
    let mut hairs = Curves {
        name: "hairs".into(),
        material: spec.materials[0],
        counts: Vec::with_capacity(plant.axes.len()),
        points: Vec::with_capacity(plant.nodes.len()),
        widths: Vec::with_capacity(plant.nodes.len()),
        moving: false,
    };
    for (i, axis) in plant.axes.iter().enumerate() {
        // Scale every hair by a draw from its separate random stream, resample it, and compute its widths.
        let mut stream = Rng::from_key(child(child(key, word("jitter")), i as u64));
        let scale = narrow(1.0 + spec.jitter * stream.range(-1.0, 1.0));
        let line: Vec<Vec3> = plant.nodes.p[plant.nodes_of(axis)].iter().map(|p| *p * scale).collect();
        let line = if spec.smooth == 0 { line } else { resampled(&line, spec.smooth as usize) };
        hairs.counts.push(point_count(&line));
        hairs.widths.extend(widths(&line, spec));
        hairs.points.extend(line);
    }
    // The stalk reaches 4 r below the origin (semi-axis 2 r), and counts for the bounding ball.
    let r = narrow(spec.stalk);
    let far = hairs.points.iter().map(|p| p.length()).fold(4.0 * r, f32::max);
    let lowest = hairs.points.iter().map(|p| p.y).fold(-4.0 * r, f32::min);
    Tuft { hairs, radius: far, lowest: lowest.min(0.0), spec: *spec, key }
}

#[allow(clippy::cast_possible_truncation, reason = "hairs have at most some hundred points")]
fn point_count(line: &[Vec3]) -> u32 {
    line.len() as u32
}

/// Diameters along a hair, linear in its length.
fn widths(line: &[Vec3], spec: &TuftSpec) -> Vec<f32> {
    let mut along = 0.0;
    let mut arcs = vec![0.0_f32];
    for pair in line.windows(2) {
        along += pair[0].distance(pair[1]);
        arcs.push(along);
    }
    let (root, tip) = (narrow(2.0 * spec.radius), narrow(2.0 * spec.radius * spec.tip));
    arcs.iter().map(|s| math::lerp(root, tip, if along > 0.0 { s / along } else { 0.0 })).collect()
}

/// Resamples a line: a curve through its points, sampled at `count` points evenly spaced in the parameter.
/// Source: centripetal Catmull-Rom spline (Barry and Goldman's pyramid); end tangents by mirrored neighbours.
fn resampled(line: &[Vec3], count: usize) -> Vec<Vec3> {
    let n = line.len();
    if n < 2 || count < 2 {
        return line.to_vec();
    }
    // Control point i - 1: mirrored beyond both ends.
    let at = |i: usize| match i.checked_sub(1) {
        None => line[0] * 2.0 - line[1],
        Some(i) if i >= n => line[n - 1] * 2.0 - line[n - 2],
        Some(i) => line[i],
    };
    let place = |k: usize| {
        // Even steps of the parameter over the n - 1 spans.
        let x = (n - 1) as f32 * k as f32 / (count - 1) as f32;
        let i = (0..n - 1).rev().find(|i| *i as f32 <= x).unwrap_or(0);
        spline([at(i), at(i + 1), at(i + 2), at(i + 3)], x - i as f32)
    };
    (0..count).map(place).collect()
}

/// The point of the spline at the share `t` between the second and the third of four points.
fn spline(p: [Vec3; 4], t: f32) -> Vec3 {
    // Centripetal knots, then three levels of linear interpolation.
    let mut knots = [0.0_f32; 4];
    for i in 0..3 {
        knots[i + 1] = knots[i] + math::sqrt_f32(p[i].distance(p[i + 1])).max(1e-6);
    }
    let t = math::lerp(knots[1], knots[2], t);
    let between = |a: (Vec3, f32), b: (Vec3, f32)| a.0 + (b.0 - a.0) * ((t - a.1) / (b.1 - a.1));
    let a: [Vec3; 3] = std::array::from_fn(|i| between((p[i], knots[i]), (p[i + 1], knots[i + 1])));
    let b: [Vec3; 2] = std::array::from_fn(|i| between((a[i], knots[i]), (a[i + 1], knots[i + 2])));
    between((b[0], knots[1]), (b[1], knots[2]))
}

impl Tuft {
    /// The tuft as a mesh: hairs, then the stalk, which has fewer faces at lower detail.
    pub fn mesh(&self, detail: TuftDetail) -> Mesh {
        // Ribbons are turned about their hairs at random, so that the tuft looks the same from all sides.
        let turn = |i: usize| {
            let key = child(child(self.key, word("turn")), i as u64);
            Rng::from_key(key).unit_f32() * std::f32::consts::PI
        };
        let (mut mesh, cut) = match detail {
            TuftDetail::Tubes => (tubes(&self.hairs), (12, 8)),
            TuftDetail::Ribbons => (turned_ribbons(&self.hairs, turn), (6, 5)),
            TuftDetail::Thinned => (turned_ribbons(&self.thinned(), turn), (3, 3)),
        };
        mesh.append(&self.stalk(cut));
        mesh
    }

    /// The stalk with its material; `cut`: segments around, rows from pole to pole.
    fn stalk(&self, cut: (u32, u32)) -> Mesh {
        stalk(narrow(self.spec.stalk), cut).with_material(self.spec.materials[1])
    }

    /// The first hairs of a fixed shuffle, widened so that they cover the area of all hairs.
    /// Own: widened by the ratio of projected areas; that of numbers would be exact only for hairs of equal length.
    fn thinned(&self) -> Curves {
        let n = self.hairs.counts.len();
        let mut order: Vec<usize> = (0..n).collect();
        Rng::from_key(child(self.key, word("thin"))).shuffle(&mut order);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of a length")]
        let kept = ((n as f64 * THINNED_SHARE).round() as usize).clamp(1.min(n), n);
        order.truncate(kept);
        order.sort_unstable();
        let mut out = Curves { counts: Vec::new(), points: Vec::new(), widths: Vec::new(), ..self.hairs.clone() };
        // First point of every hair by a running sum; copy the points of those that stay.
        let starts: Vec<usize> =
            self.hairs.counts.iter().scan(0, |s, c| Some(std::mem::replace(s, *s + *c as usize))).collect();
        for i in order {
            let range = starts[i]..starts[i] + self.hairs.counts[i] as usize;
            out.counts.push(self.hairs.counts[i]);
            out.points.extend_from_slice(&self.hairs.points[range.clone()]);
            out.widths.extend_from_slice(&self.hairs.widths[range]);
        }
        // A tuft without hairs, or with hairs of no width, has no area to preserve.
        let own = projected_area(&out);
        let factor = if own > 0.0 { narrow(projected_area(&self.hairs) / own) } else { 1.0 };
        out.widths.iter_mut().for_each(|w| *w *= factor);
        out
    }

    /// The tuft as curves and stalk, with ribbons for programs that have no curves.
    pub fn curves_prototype(&self, name: &str) -> Prototype {
        let fine = Fine { mesh: self.stalk((12, 8)), curves: self.hairs.clone() };
        Prototype { fine: Some(fine), ..Prototype::new(name, self.mesh(TuftDetail::Ribbons)) }
    }
}

/// Projected area of curves at rest seen from their sides, m^2: the sum over segments of length times mean width.
pub fn projected_area(curves: &Curves) -> f64 {
    let mut first = 0_usize;
    let mut sum = 0.0;
    for count in &curves.counts {
        let end = first + *count as usize;
        for k in first + 1..end {
            let length = curves.points[k - 1].distance(curves.points[k]);
            sum += f64::from(length) * f64::from(curves.widths[k - 1] + curves.widths[k]) * 0.5;
        }
        first = end;
    }
    sum
}

/// Material of white, translucent, two-sided hairs, without images.
pub fn hair_material(name: &str) -> Material {
    let plain = Material::plain(name.to_owned(), MaterialClass::Catkin, tuning::HAIR, 0.75);
    Material { translucency: tuning::HAIR_LIGHT, double_sided: true, ..plain }
}

/// Opaque, one-sided material of the brown stalk, without images.
pub fn stalk_material(name: &str) -> Material {
    Material {
        base_color: tuning::STALK,
        roughness: 0.7,
        translucency: 0.0,
        double_sided: false,
        class: MaterialClass::Bark,
        ..hair_material(name)
    }
}

#[cfg(test)]
mod tests;
