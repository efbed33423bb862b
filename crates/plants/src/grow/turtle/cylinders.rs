//! Generalised cylinders: a contour swept along a spline of points that the turtle marks.
//!
//! `@Gs`, `@Gc(n)`, `@Ge(n)` mark a Hermite spline; `{(1)` to `{(4)` an open or closed Hermite spline or B-spline. One cylinder
//! may be open at each bracket level, and while it is, segments at that level are not drawn: the cylinder is the stem. A branch
//! may continue the cylinder of its parent, from its last point on.

use std::collections::BTreeMap;

use glam::{DMat3, DQuat, DVec3, Vec2, Vec3};

use super::frame::{TurtleFrame, TurtlePose, narrow};
use osier_base::math;
use osier_grammar::{Spline, SymbolId};
use osier_scene::{MaterialId, Mesh};

/// Factors on the tangents at a point without `@Gt`. Source: cpfg.
pub(super) const TANGENT: [f64; 2] = [1.2, 1.2];
/// Number of strips of a piece that ends at a step (`F` or `f`). Source: cpfg.
pub(super) const STRIPS: u32 = 4;
/// Most strips of a piece, whatever number the string gives.
const MAX_STRIPS: u32 = 1000;

/// Cross-section of a generalised cylinder of radius 1.
#[derive(Debug, Clone, PartialEq)]
pub struct Contour {
    /// Curve over 0..1; x points opposite to the up vector of the turtle, y opposite to its left vector, z along the axis.
    pub curve: Spline,
    /// Whether the end meets the beginning; an open contour makes a thin surface.
    pub closed: bool,
}

/// The part of the turtle's state that cylinders read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct CylinderState {
    /// Number of the contour; 0 is a circle.
    pub contour: u32,
    /// Number of sides by which the contour is drawn.
    pub sides: u32,
    /// Incoming and outgoing factor of the tangent.
    pub tangent: [f64; 2],
    /// Change of the radius per parameter, incoming and outgoing; `None`: the radius is linear.
    pub slopes: Option<[f64; 2]>,
    /// Whether slopes are multiplied by the length of the chord.
    pub relative: bool,
}

/// A point of the axis of a cylinder, as the string marks it.
#[derive(Debug, Clone, Copy)]
pub(super) struct CylinderPoint {
    /// Position of the turtle, m.
    pub p: DVec3,
    pub frame: TurtleFrame,
    /// Radius at this point, m, half the turtle's line width.
    pub radius: f64,
    pub state: CylinderState,
    /// Strips of the piece that ends at this point.
    pub strips: u32,
    /// Material of the piece that ends at this point.
    pub material: MaterialId,
}

/// Kind of curve that the points of an axis define.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum CurveKind {
    Hermite,
    BSpline,
}

/// The module that began a cylinder, without its parameters.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct CylinderOrigin {
    pub symbol: SymbolId,
    pub lineage: u64,
    /// Step in which the module was made.
    pub birth: u32,
}

/// A cylinder whose end is not marked yet.
#[derive(Debug, Clone)]
pub(super) struct OpenCylinder {
    pub kind: CurveKind,
    pub closed: bool,
    pub origin: CylinderOrigin,
    /// True while this branch has added no point, so that the cylinder holds only the last point of the parent's
    /// cylinder.
    pub inherited: bool,
    /// Whether `F` and `f` add points, as they do between `{(1)` and `}`.
    pub marks_steps: bool,
    /// Number of polygons that were open when it began.
    pub polygons: usize,
    pub points: Vec<CylinderPoint>,
}

/// A ring of vertices across a generalised cylinder: its place, and the contours between which it is interpolated.
struct CrossSection {
    p: DVec3,
    tangent: DVec3,
    radius: f64,
    /// States at the points before and after it, and the share 0..1 of the second in the blended contour.
    contours: (CylinderState, CylinderState, f64),
    /// Up vector of the turtle here, for cylinders that roll with it.
    up: DVec3,
}

impl OpenCylinder {
    pub fn new(kind: CurveKind, closed: bool) -> Self {
        let origin = CylinderOrigin::default();
        Self { kind, closed, origin, inherited: false, marks_steps: false, polygons: 0, points: Vec::new() }
    }

    /// The beginning of a branch that may continue this cylinder: its last point. `None` for a cylinder whose points are steps.
    pub fn inheritance(&self) -> Option<Self> {
        let last = *self.points.last().filter(|_| !self.marks_steps)?;
        Some(Self { origin: self.origin, inherited: true, points: vec![last], ..Self::new(self.kind, self.closed) })
    }

    /// The curve that the parameter of `{` selects: 1 and 2 Hermite, 3 and 4 B-spline, the even ones closed; `None` for a
    /// polygon.
    pub fn of_parameter(value: f64) -> Option<Self> {
        match value {
            v if (0.5..1.5).contains(&v) => Some(Self::new(CurveKind::Hermite, false)),
            v if (1.5..2.5).contains(&v) => Some(Self::new(CurveKind::Hermite, true)),
            v if (2.5..3.5).contains(&v) => Some(Self::new(CurveKind::BSpline, false)),
            v if (3.5..4.5).contains(&v) => Some(Self::new(CurveKind::BSpline, true)),
            _ => None,
        }
    }

    /// The surface in the space of `pose`, divided by its size, and that size. `None` for a cylinder without pieces.
    pub fn mesh(&self, contours: &BTreeMap<u32, Contour>, twist: bool, pose: TurtlePose) -> Option<(Mesh, f64)> {
        let (sections, pieces) = self.sections();
        if sections.len() < 2 {
            return None;
        }
        // All sections need the same number of points, the largest that any asks for.
        let sides = self.points.iter().map(|p| p.state.sides).max().unwrap_or(8).max(3);
        // Each section becomes a ring of points in plant space, blended from the contours of both neighbouring points.
        let frames = frames(&sections, twist);
        // The first point is repeated at the end of each ring, where u is 1.
        let around = sides as usize + 1;
        let mut points = Vec::with_capacity(sections.len() * around);
        for (section, (up, left)) in sections.iter().zip(&frames) {
            let (a, b, t) = &section.contours;
            for i in 0..around {
                let share = i as f64 / f64::from(sides);
                let [x, y, z] =
                    blend(contour_point(contours, a.contour, share), contour_point(contours, b.contour, share), *t);
                let r = section.radius;
                points.push(section.p - *up * (r * x) - *left * (r * y) + section.tangent * (r * z));
            }
        }
        // Points in the space of the pose, divided by their largest coordinate.
        let back = pose.q.inverse();
        let local: Vec<DVec3> = points.iter().map(|p| back * (*p - pose.p)).collect();
        let size = local.iter().fold(0.0_f64, |m, p| m.max(p.abs().max_element()));
        if !size.is_finite() || size < 1e-9 {
            return None;
        }
        let mut mesh = Mesh { points: local.iter().map(|p| narrow(*p / size)).collect(), ..Mesh::default() };
        // Texture coordinates: u runs once around, v is the length over the girth of the thickest section.
        let girth = std::f64::consts::TAU * sections.iter().map(|s| s.radius).fold(1e-9, f64::max);
        let mut length = 0.0;
        for (k, section) in sections.iter().enumerate() {
            length += if k > 0 { (section.p - sections[k - 1].p).length() } else { 0.0 };
            let v = math::narrow(length / girth);
            mesh.uvs.extend((0..around).map(|i| Vec2::new(math::narrow(i as f64 / f64::from(sides)), v)));
        }
        let (mut from, row) = (0_u32, sides + 1);
        for (strips, material) in pieces {
            let mut triangles = Vec::new();
            for k in from..from + strips {
                for i in 0..sides {
                    let (a, b) = (k * row + i, (k + 1) * row + i);
                    // The contour runs from -U over -L: counter-clockwise from outside.
                    triangles.push([a, b, b + 1]);
                    triangles.push([a, b + 1, a + 1]);
                }
            }
            from += strips;
            mesh.append_subset(material, triangles);
        }
        let closed = self.points.iter().all(|p| contours.get(&p.state.contour).is_none_or(|c| c.closed));
        mesh.normals = smooth_normals(&mesh, row, closed);
        Some((mesh, size))
    }

    /// Cross-sections along the axis, and the number of strips and the material of each piece.
    fn sections(&self) -> (Vec<CrossSection>, Vec<(u32, MaterialId)>) {
        let points = self.control_points();
        let n = points.len();
        let (mut sections, mut pieces) = (Vec::new(), Vec::new());
        let at = |i: usize| &points[i % n];
        let count = match (self.kind, self.closed) {
            (_, _) if n < 2 => 0,
            (_, true) => n,
            (CurveKind::Hermite, false) => n - 1,
            (CurveKind::BSpline, false) => n - 3,
        };
        for i in 0..count {
            // The point at which the piece ends decides its strips and its colour.
            let (first, last) = match self.kind {
                CurveKind::Hermite => (at(i), at(i + 1)),
                CurveKind::BSpline => (at(i + 1), at(i + 2)),
            };
            let strips = last.strips.clamp(1, MAX_STRIPS);
            let chord = (last.p - first.p).length();
            if self.kind == CurveKind::Hermite && chord < 1e-9 {
                continue;
            }
            // Pieces share the section between them.
            let begin = u32::from(!sections.is_empty());
            for k in begin..=strips {
                let t = f64::from(k) / f64::from(strips);
                let (p, tangent) = match self.kind {
                    CurveKind::Hermite => hermite(first, last, chord, t),
                    CurveKind::BSpline => b_spline([at(i).p, at(i + 1).p, at(i + 2).p, at(i + 3).p], t),
                };
                let radius = match self.kind {
                    CurveKind::Hermite => radius(first, last, chord, t),
                    CurveKind::BSpline => {
                        b_spline([at(i), at(i + 1), at(i + 2), at(i + 3)].map(|q| DVec3::X * q.radius), t).0.x
                    }
                };
                let up = first.frame.u.lerp(last.frame.u, t).normalize_or(first.frame.u);
                let tangent = tangent.normalize_or(first.frame.h);
                sections.push(CrossSection { p, tangent, radius, contours: (first.state, last.state, t), up });
            }
            pieces.push((strips, last.material));
        }
        (sections, pieces)
    }

    /// The points of the curve; an open B-spline of fewer than four repeats its ends.
    fn control_points(&self) -> Vec<CylinderPoint> {
        let mut points = self.points.clone();
        if self.kind == CurveKind::BSpline && !self.closed && points.len() >= 2 {
            while points.len() < 4 {
                points.insert(0, points[0]);
                points.extend(points.last().copied().filter(|_| points.len() < 4));
            }
        }
        points
    }
}

/// Point and tangent of a Hermite piece: end tangents are the chord times the factors times the headings.
fn hermite(a: &CylinderPoint, b: &CylinderPoint, chord: f64, t: f64) -> (DVec3, DVec3) {
    let m0 = a.frame.h * (chord * a.state.tangent[1]);
    let m1 = b.frame.h * (chord * b.state.tangent[0]);
    let (t2, t3) = (t * t, t * t * t);
    let p = a.p * (2.0 * t3 - 3.0 * t2 + 1.0) + m0 * (t3 - 2.0 * t2 + t) + b.p * (3.0 * t2 - 2.0 * t3) + m1 * (t3 - t2);
    let d = (b.p - a.p) * (6.0 * (t - t2)) + m0 * (3.0 * t2 - 4.0 * t + 1.0) + m1 * (3.0 * t2 - 2.0 * t);
    (p, d)
}

/// Point and tangent of a piece of a uniform cubic B-spline.
fn b_spline(p: [DVec3; 4], t: f64) -> (DVec3, DVec3) {
    // The basis of the uniform cubic B-spline, times 6, and its derivative, times 2.
    let (t2, t3, s) = (t * t, t * t * t, 1.0 - t);
    let point = p[0] * (s * s * s)
        + p[1] * (3.0 * t3 - 6.0 * t2 + 4.0)
        + p[2] * (-3.0 * t3 + 3.0 * t2 + 3.0 * t + 1.0)
        + p[3] * t3;
    let along = p[0] * (-s * s) + p[1] * (3.0 * t2 - 4.0 * t) + p[2] * (-3.0 * t2 + 2.0 * t + 1.0) + p[3] * t2;
    (point / 6.0, along * 0.5)
}

/// Radius along a Hermite piece: linear, or cubic with the slopes of `@Gr`.
fn radius(a: &CylinderPoint, b: &CylinderPoint, chord: f64, t: f64) -> f64 {
    let (Some(out), Some(into)) = (a.state.slopes, b.state.slopes) else {
        return a.radius + (b.radius - a.radius) * t;
    };
    let scale = |p: &CylinderPoint| if p.state.relative { chord } else { 1.0 };
    let (m0, m1) = (out[1] * scale(a), into[0] * scale(b));
    let (t2, t3) = (t * t, t * t * t);
    let cubic = a.radius * (2.0 * t3 - 3.0 * t2 + 1.0)
        + m0 * (t3 - 2.0 * t2 + t)
        + b.radius * (3.0 * t2 - 2.0 * t3)
        + m1 * (t3 - t2);
    // Steep slopes may carry the curve below 0.
    cubic.max(0.0)
}

/// Up and left vectors of all sections: least twist from the first, plus, with `twist`, the roll of the turtle.
fn frames(sections: &[CrossSection], twist: bool) -> Vec<(DVec3, DVec3)> {
    let mut out = Vec::with_capacity(sections.len());
    let mut up = DVec3::Z;
    for (i, section) in sections.iter().enumerate() {
        if i == 0 {
            up = section.up;
        } else {
            // Parallel transport: the section does not twist about the axis.
            up = DQuat::from_rotation_arc(sections[i - 1].tangent, section.tangent) * up;
        }
        // Rounding errors of many rotations are removed at each section.
        up = (up - section.tangent * up.dot(section.tangent)).normalize_or(section.tangent.any_orthonormal_vector());
        let own = section.up - section.tangent * section.up.dot(section.tangent);
        let shown = if twist { own.normalize_or(up) } else { up };
        out.push((shown, shown.cross(section.tangent)));
    }
    out
}

/// The point of contour `id` at the parameter `share`, 0..1. Number 0 and unknown numbers are the unit circle.
fn contour_point(contours: &BTreeMap<u32, Contour>, id: u32, share: f64) -> [f64; 3] {
    match contours.get(&id) {
        Some(contour) => contour.curve.at(share),
        None => {
            let a = std::f64::consts::TAU * share;
            [math::cos(a), math::sin(a), 0.0]
        }
    }
}

fn blend(a: [f64; 3], b: [f64; 3], t: f64) -> [f64; 3] {
    [0, 1, 2].map(|i| a[i] + (b[i] - a[i]) * t)
}

/// Normals as the mean of the faces around a point; where the contour is closed, its first and last point share theirs.
fn smooth_normals(mesh: &Mesh, row: u32, closed: bool) -> Vec<Vec3> {
    let mut sums = vec![Vec3::ZERO; mesh.points.len()];
    for t in &mesh.triangles {
        let [a, b, c] = t.map(|i| mesh.points[i as usize]);
        let face = (b - a).cross(c - a);
        // The length of the cross product is twice the area, so that larger faces have more weight.
        t.iter().for_each(|i| sums[*i as usize] += face);
    }
    if closed {
        for ring in sums.chunks_exact_mut(row as usize) {
            let last = ring.len() - 1;
            let both = ring[0] + ring[last];
            (ring[0], ring[last]) = (both, both);
        }
    }
    sums.into_iter().map(|n| math::normalize_or(n, Vec3::Y)).collect()
}

/// The rotation of a frame, with X to the right, Y ahead and Z up.
pub(super) fn frame_rotation(frame: &TurtleFrame) -> DQuat {
    DQuat::from_mat3(&DMat3::from_cols(-frame.l, frame.h, frame.u)).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;
    use osier_grammar::SplineEnds;

    const ROUND: CylinderState =
        CylinderState { contour: 0, sides: 8, tangent: TANGENT, slopes: None, relative: false };

    fn point(y: f64, radius: f64) -> CylinderPoint {
        let p = DVec3::new(0.0, y, 0.0);
        CylinderPoint { p, frame: TurtleFrame::START, radius, state: ROUND, strips: 4, material: 0 }
    }

    fn open(kind: CurveKind, points: Vec<CylinderPoint>) -> OpenCylinder {
        OpenCylinder { points, ..OpenCylinder::new(kind, false) }
    }

    const HERE: TurtlePose = TurtlePose { p: DVec3::ZERO, q: DQuat::IDENTITY };

    #[test]
    fn a_straight_cylinder_is_a_cone_with_exact_rings() {
        let (mesh, size) = open(CurveKind::Hermite, vec![point(0.0, 1.0), point(4.0, 0.5)])
            .mesh(&BTreeMap::new(), false, HERE)
            .expect("a piece");
        // Five rings of 8 sides and a seam, four strips of 16 triangles.
        assert_eq!((mesh.points.len(), mesh.triangles.len()), (45, 64));
        for (ring, points) in mesh.points.chunks(9).enumerate() {
            let wanted = 1.0 - 0.5 * ring as f64 / 4.0;
            for p in points {
                let r = f64::from(p.x.hypot(p.z)) * size;
                assert!((r - wanted).abs() < 1e-6, "ring {ring}: {r}");
            }
        }
        // The first point of a circle is -U, the quarter -L; faces look outwards.
        assert!((mesh.points[0] - Vec3::new(0.0, 0.0, -0.25)).length() < 1e-6, "{}", mesh.points[0]);
        assert!((mesh.points[2] - Vec3::new(0.25, 0.0, 0.0)).length() < 1e-6, "{}", mesh.points[2]);
        for t in &mesh.triangles {
            let [a, b, c] = t.map(|i| mesh.points[i as usize]);
            let out = (a + b + c) * Vec3::new(1.0, 0.0, 1.0);
            assert!((b - a).cross(c - a).dot(out) > 0.0);
        }
        assert!(mesh.normals.iter().zip(&mesh.points).all(|(n, p)| n.dot(*p * Vec3::new(1.0, 0.0, 1.0)) > 0.0));
    }

    #[test]
    fn tangents_are_chord_times_factor_times_heading() {
        let (mut a, mut b) = (point(0.0, 1.0), point(0.0, 1.0));
        b.p = DVec3::new(2.0, 0.0, 0.0);
        b.frame = TurtleFrame { h: DVec3::NEG_Y, l: DVec3::X, u: DVec3::Z };
        a.state.tangent = [9.0, 1.5];
        b.state.tangent = [0.5, 9.0];
        // D = 2: tangents (0, 3, 0) and (0, -1, 0); the middle is (a+b)/2 + (m0 - m1)/8.
        let (p, _) = hermite(&a, &b, 2.0, 0.5);
        assert!((p - DVec3::new(1.0, 0.5, 0.0)).length() < 1e-12, "{p}");
        assert!((hermite(&a, &b, 2.0, 0.0).1 - DVec3::new(0.0, 3.0, 0.0)).length() < 1e-12);
        assert!((hermite(&a, &b, 2.0, 1.0).1 - DVec3::new(0.0, -1.0, 0.0)).length() < 1e-12);
    }

    #[test]
    fn slopes_bend_the_radius() {
        let (mut a, mut b) = (point(0.0, 1.0), point(2.0, 1.0));
        a.state.slopes = Some([0.0, 0.8]);
        b.state.slopes = Some([-0.8, 0.0]);
        // Middle of a cubic: the mean plus (m0 - m1)/8.
        assert!((radius(&a, &b, 2.0, 0.5) - 1.2).abs() < 1e-12);
        (a.state.relative, b.state.relative) = (true, true);
        assert!((radius(&a, &b, 2.0, 0.5) - 1.4).abs() < 1e-12);
    }

    #[test]
    fn a_b_spline_begins_at_a_sixth_four_sixths_a_sixth() {
        let curve =
            open(CurveKind::BSpline, vec![point(0.0, 1.0), point(6.0, 1.0), point(18.0, 1.0), point(24.0, 1.0)]);
        let (sections, pieces) = curve.sections();
        assert_eq!((sections.len(), pieces.len()), (5, 1));
        assert!((sections[0].p.y - 7.0).abs() < 1e-12 && (sections[4].p.y - 17.0).abs() < 1e-12);
        // A repeated end three times is met.
        let ends = vec![point(0.0, 1.0), point(0.0, 1.0), point(0.0, 1.0), point(3.0, 1.0)];
        assert!(open(CurveKind::BSpline, ends).sections().0[0].p.length() < 1e-12);
    }

    #[test]
    fn closed_curves_return_and_contours_blend() {
        let turned = |x: f64, y: f64, h: DVec3| CylinderPoint {
            p: DVec3::new(x, y, 0.0),
            frame: TurtleFrame { h, l: DVec3::Z.cross(h), u: DVec3::Z },
            ..point(0.0, 0.1)
        };
        let points = vec![
            turned(1.0, 0.0, DVec3::Y),
            turned(0.0, 1.0, DVec3::NEG_X),
            turned(-1.0, 0.0, DVec3::NEG_Y),
            turned(0.0, -1.0, DVec3::X),
        ];
        let ring = OpenCylinder { points, ..OpenCylinder::new(CurveKind::Hermite, true) };
        let (sections, pieces) = ring.sections();
        assert_eq!((pieces.len(), sections.len()), (4, 17));
        assert!((sections[0].p - sections[16].p).length() < 1e-12);
        // A circle that becomes a line along x: half way y is half as large.
        let line = Spline::new(&[[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]], SplineEnds::Clamped);
        let contours = BTreeMap::from([(3, Contour { curve: line, closed: false })]);
        let a = blend(contour_point(&contours, 0, 0.25), contour_point(&contours, 3, 0.25), 0.5);
        assert!((a[0] + 0.25).abs() < 1e-12 && (a[1] - 0.5).abs() < 1e-12, "{a:?}");
    }

    #[test]
    fn rolls_spread_only_with_twist() {
        let mut end = point(4.0, 1.0);
        end.frame.roll(0.0, 1.0);
        let curve = open(CurveKind::Hermite, vec![point(0.0, 1.0), end]);
        let (sections, _) = curve.sections();
        let (still, turned) = (frames(&sections, false), frames(&sections, true));
        assert!((still[4].0 - DVec3::Z).length() < 1e-12);
        assert!((turned[4].0 - end.frame.u).length() < 1e-12);
        assert!((turned[2].0.dot(DVec3::Z) - std::f64::consts::FRAC_1_SQRT_2).abs() < 1e-9);
    }

    #[test]
    fn few_points_make_nothing_or_a_short_spline() {
        assert!(open(CurveKind::Hermite, vec![point(0.0, 1.0)]).mesh(&BTreeMap::new(), false, HERE).is_none());
        assert!(open(CurveKind::BSpline, Vec::new()).mesh(&BTreeMap::new(), false, HERE).is_none());
        assert!(
            open(CurveKind::BSpline, vec![point(0.0, 1.0), point(2.0, 1.0)])
                .mesh(&BTreeMap::new(), false, HERE)
                .is_some()
        );
    }
}
