//! Guides, contours and sweeps of L-Py: curves of the model along which its turtle moves, and which it draws as cross-sections.

use glam::DVec2;

use super::cylinders::{Contour, CurveKind, OpenCylinder};
use super::dialect_commands::LPY_RADIUS;
use super::frame::TurtleFrame;
use super::interpreter::Turtle;
use osier_base::convert::saturating_index;
use osier_base::math;
use osier_grammar::{Module, Spline};

/// Minimum number of straight pieces by which a curve is measured. Own: more pieces shift no point by a thousandth of
/// the length.
const MIN_PIECES: usize = 1024;
/// Minimum number of sides of an open or closed contour; the sides of a polyline are its lines, subdivided.
const MIN_SIDES: usize = 16;
/// Most steps of a sweep. Own: rings that lie closer cannot be seen.
const MAX_SWEEP_STEPS: f64 = 1e4;
/// Share of a length below which a length counts as 0, and the remaining part of a guide as none. Source: the turtle of L-Py
/// (PlantGL).
const EPSILON: f64 = 1e-5;

/// A curve in a plane as straight pieces, with the lengths up to their ends.
#[derive(Debug)]
pub(super) struct GuideCurve {
    points: Vec<DVec2>,
    lengths: Vec<f64>,
}

impl GuideCurve {
    /// `None` for a curve without length.
    fn new(curve: &Spline) -> Option<Self> {
        let pieces = curve.pieces().max(1);
        let count = pieces * MIN_PIECES.div_ceil(pieces);
        let point = |i: usize| {
            let [x, y, _] = curve.at(i as f64 / count as f64);
            DVec2::new(x, y)
        };
        let points: Vec<DVec2> = (0..=count).map(point).collect();
        let mut sum = 0.0;
        let mut lengths = vec![0.0];
        for ends in points.windows(2) {
            sum += (ends[1] - ends[0]).length();
            lengths.push(sum);
        }
        (sum.is_finite() && sum > 1e-12).then_some(Self { points, lengths })
    }

    fn length(&self) -> f64 {
        self.lengths.last().copied().unwrap_or(0.0)
    }

    /// Point and unit tangent at a share of the length, 0 to 1.
    fn at(&self, share: f64) -> (DVec2, DVec2) {
        let wanted = share.clamp(0.0, 1.0) * self.length();
        // The first piece that ends at or beyond this length, and has a length.
        let end = self.lengths.partition_point(|l| *l < wanted).clamp(1, self.points.len() - 1);
        let (a, b) = (self.points[end - 1], self.points[end]);
        let (from, to) = (self.lengths[end - 1], self.lengths[end]);
        let t = if to > from { ((wanted - from) / (to - from)).clamp(0.0, 1.0) } else { 0.0 };
        (a.lerp(b, t), (b - a).normalize_or(DVec2::X))
    }
}

/// The guide of a branch: a curve, stretched to a length, and the turtle's position on it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Guide {
    /// Number of the curve.
    id: u32,
    /// Length that the curve is stretched to, turtle units.
    length: f64,
    /// Share of the length that lies behind the turtle.
    done: f64,
    position: DVec2,
    /// Direction on the curve that the heading of the turtle follows.
    heading: DVec2,
    /// The curve begins along y and turns about up; else it begins along x and turns about left.
    turns_about_up: bool,
    is_mirrored: bool,
}

impl Turtle<'_> {
    /// `SetGuide(curve, length, yorientation, ccw)`: steps follow the curve from here on. The curve lies in the plane of heading
    /// (its x) and up (its y), or with `yorientation` of heading (y) and left (-x).
    pub(super) fn set_guide(&mut self, m: Module<'_>) {
        let id = self.param(m, 0, 0.0);
        let length = self.param(m, 1, 1.0);
        let [turns_about_up, is_mirrored] = [2, 3].map(|i| self.param(m, i, 0.0).abs() >= 1.0);
        self.begin_guide(id, length, turns_about_up, is_mirrored, m);
    }

    /// Sets the guide of the branch. Returns false, with a warning, for a curve that cannot be a guide.
    fn begin_guide(&mut self, id: f64, length: f64, turns_about_up: bool, is_mirrored: bool, m: Module<'_>) -> bool {
        let Some(key) = self.guide_curve(id, m) else { return false };
        let Some(curve) = self.guide_curves.get(&key) else { return false };
        if length <= EPSILON {
            let message = format!("a guide of the length {length}, which no step follows");
            self.warn_of_parameter(m, 1, message, "give SetGuide a length above 0");
            return false;
        }
        let sign = if is_mirrored { -1.0 } else { 1.0 };
        let heading = if turns_about_up { DVec2::Y } else { DVec2::X } * sign;
        let position = curve.at(0.0).0;
        let guide = Guide { id: key, length, done: 0.0, position, heading, turns_about_up, is_mirrored };
        self.rare.dialect.guide = Some(guide);
        true
    }

    /// The key of a curve of the model, which is measured on first use. `None`, with a warning, for a curve in space, a
    /// curve without length and a number without a curve.
    fn guide_curve(&mut self, id: f64, m: Module<'_>) -> Option<u32> {
        let curve = self.grammar.curve(id);
        let key = key_of(id);
        let is_flat = self.grammar.curve_value(id, 0.0).is_some();
        if let Some(curve) = curve.filter(|_| is_flat) {
            if !self.guide_curves.contains_key(&key)
                && let Some(measured) = GuideCurve::new(curve)
            {
                self.guide_curves.insert(key, measured);
            }
            if self.guide_curves.contains_key(&key) {
                return Some(key);
            }
        }
        let message = match curve {
            None => "this is no curve of the model",
            Some(_) if is_flat => "a curve without length",
            Some(_) => "a curve in space as a guide",
        };
        let help = "the turtle moves straight; give a Polyline2D, NurbsCurve2D or BezierCurve2D";
        self.warn("L048", (None, self.symbol_of(m)), message.to_owned(), help);
        None
    }

    /// `PositionOnGuide(s)`: continues at the length s of the guide.
    pub(super) fn set_position_on_guide(&mut self, m: Module<'_>) {
        let at = self.param(m, 0, 0.0);
        let Some(guide) = self.rare.dialect.guide else { return };
        let Some(curve) = self.guide_curves.get(&guide.id) else { return };
        let done = (at / guide.length).clamp(0.0, 1.0);
        let (position, heading) = curve.at(done);
        self.rare.dialect.guide = Some(Guide { done, position, heading, ..guide });
    }

    /// Turns the heading along the guide for a step; returns the length of the step, which is that of the chord. A step beyond the
    /// end of the curve goes on in its last direction, and ends the guide.
    pub(super) fn follow_guide(&mut self, length: f64) -> f64 {
        let Some(guide) = self.rare.dialect.guide.filter(|_| length > EPSILON) else { return length };
        if guide.done >= 1.0 {
            self.rare.dialect.guide = None;
            return length;
        }
        let Some(curve) = self.guide_curves.get(&guide.id) else { return length };
        let next = guide.done + length / guide.length;
        let (position, tangent) = curve.at(next);
        let beyond = (next - 1.0).max(0.0) * curve.length();
        let chord = position + tangent * beyond - guide.position;
        let scale = guide.length / curve.length();
        // Points that coincide leave the direction as it is.
        let Some(heading) = chord.try_normalize() else { return length };
        self.turn_along(&guide, heading);
        self.rare.dialect.guide = Some(Guide { done: next.min(1.0), position, heading, ..guide });
        chord.length() * scale
    }

    /// Turns the heading to the tangent of the guide after a step, so that organs stand along the curve.
    pub(super) fn align_with_guide(&mut self) {
        let Some(guide) = self.rare.dialect.guide else { return };
        let Some(curve) = self.guide_curves.get(&guide.id) else { return };
        let heading = curve.at(guide.done).1;
        self.turn_along(&guide, heading);
        self.rare.dialect.guide = Some(Guide { heading, ..guide });
    }

    /// Turns the turtle by the angle from the guide's last direction to another one.
    fn turn_along(&mut self, guide: &Guide, heading: DVec2) {
        let (c, s) = (guide.heading.dot(heading), guide.heading.perp_dot(heading));
        let s = if guide.is_mirrored { -s } else { s };
        let n = math::sqrt(c * c + s * s);
        if n <= 0.0 {
            return;
        }
        // Turn to the left about up, or upwards about left.
        if guide.turns_about_up {
            TurtleFrame::yaw(&mut self.s.frame, c / n, s / n);
        } else {
            TurtleFrame::pitch(&mut self.s.frame, c / n, -s / n);
        }
        self.count_turn();
    }

    /// `SetContour(curve)`: the cross-section of generalised cylinders from here on, its x along left and its y along up.
    pub(super) fn set_contour(&mut self, m: Module<'_>) {
        let id = self.param(m, 0, 0.0);
        if self.begin_contour(id, m) && self.rare.dialect.is_in_cylinder && self.cylinder().is_none() {
            self.begin_contour_cylinder(m);
        }
    }

    fn begin_contour(&mut self, id: f64, m: Module<'_>) -> bool {
        let key = key_of(id);
        let Some(curve) = self.grammar.curve(id) else {
            let help = "a circle is drawn; give a Polyline2D, NurbsCurve2D or BezierCurve2D";
            self.warn("L048", (None, self.symbol_of(m)), "this is no curve of the model".to_owned(), help);
            return false;
        };
        let ends = [0.0, 1.0].map(|t| curve.at(t));
        let closed = (0..3).all(|k| (ends[0][k] - ends[1][k]).abs() < 1e-9);
        // Contours have x opposite to up and y opposite to left.
        let contour = Contour { curve: curve.with_points(|[x, y, _]| [-y, -x, 0.0]), closed };
        let pieces = curve.pieces().max(1);
        let sides = pieces * MIN_SIDES.div_ceil(pieces);
        self.contours.insert(key, contour);
        self.rare.cylinder.contour = key;
        self.rare.cylinder.sides = saturating_index(sides).max(self.options.sides);
        true
    }

    /// `StartGC`: with a contour, the steps up to `EndGC` become one surface. Round tubes form one axis even without
    /// this command.
    pub(super) fn start_lpy_cylinder(&mut self, m: Module<'_>) {
        self.rare.dialect.is_in_cylinder = true;
        if self.rare.cylinder.contour != 0 {
            self.begin_contour_cylinder(m);
        }
    }

    /// `EndGC` ends the cylinder.
    pub(super) fn end_lpy_cylinder(&mut self, m: Module<'_>) {
        self.rare.dialect.is_in_cylinder = false;
        self.finish_cylinder(m);
    }

    fn begin_contour_cylinder(&mut self, m: Module<'_>) {
        self.finish_cylinder(m);
        // The model's steps are short where the surface bends, so its tangents are the turtle's headings and its pieces
        // are nearly straight.
        self.rare.cylinder.tangent = [1.0, 1.0];
        self.open_cylinder(OpenCylinder::new(CurveKind::Hermite, false), m);
        self.cylinder_point(1);
    }

    /// Adds the end of a drawn step to the surface that is open here.
    pub(super) fn lpy_cylinder_point(&mut self, m: Module<'_>) {
        if self.rare.cylinder.contour == 0 {
            return;
        }
        if self.rare.dialect.is_in_cylinder {
            self.cylinder_point(1);
        } else {
            let message = "a contour outside of StartGC and EndGC".to_owned();
            let help = "the segment is round; write StartGC before it, and EndGC behind the last one";
            self.warn("L008", (None, self.symbol_of(m)), message, help);
        }
    }

    /// Factor on the radius at a share of the length: the value of the model's function that parameter `i` names;
    /// `None` without such a function.
    pub(super) fn radius_factor(&mut self, m: Module<'_>, i: usize, share: f64) -> Option<f64> {
        let id = m.params.get(i).map(|_| self.param(m, i, 0.0))?;
        self.grammar.curve_value(id, share)
    }

    /// `Sweep(path, section, length, dlength, radius, radiusvariation)`: sweeps a section along a path into a surface.
    /// The turtle does not move.
    pub(super) fn sweep(&mut self, m: Module<'_>) {
        let [path, section, length] = [(0, 0.0), (1, 0.0), (2, 1.0)].map(|(i, default)| self.param(m, i, default));
        let step = self.param(m, 3, 0.1 * length);
        let radius = self.param(m, 4, 1.0);
        self.close_segment();
        self.push_state(m);
        if !self.halted && self.begin_guide(path, length, false, false, m) && self.begin_contour(section, m) {
            let mut steps =
                if step > EPSILON * length { (length / step - EPSILON).ceil().max(1.0) } else { f64::INFINITY };
            if steps > MAX_SWEEP_STEPS {
                let message = format!("a sweep of more than {MAX_SWEEP_STEPS} steps: its steps are longer");
                self.warn("L008", (None, self.symbol_of(m)), message, "make the steps longer");
                steps = MAX_SWEEP_STEPS;
            }
            let first = self.radius_factor(m, 5, 0.0).unwrap_or(1.0);
            self.set_radius((radius * first).max(0.0), m);
            self.start_lpy_cylinder(m);
            let mut k = 0.0;
            while k < steps && !self.halted {
                k += 1.0;
                self.lpy_step(length / steps, true, m);
                let factor = self.radius_factor(m, 5, k / steps).unwrap_or(1.0);
                self.set_radius((radius * factor).max(0.0), m);
                self.lpy_cylinder_point(m);
            }
            self.end_lpy_cylinder(m);
        }
        self.pop_state(m);
    }

    /// A step of L-Py along the guide, bent by the tropism.
    pub(super) fn lpy_step(&mut self, length: f64, draws: bool, m: Module<'_>) {
        let length = self.follow_guide(length);
        if length > 0.0 || !draws {
            self.bend();
        }
        self.step(length, m, draws, draws);
        self.align_with_guide();
    }

    /// Radius of a path at a share of its length: the third parameter times the function that the fourth one names;
    /// `None` without such a function.
    pub(super) fn path_radius(&mut self, m: Module<'_>, share: f64) -> Option<f64> {
        let factor = self.radius_factor(m, 3, share)?;
        Some((self.param(m, 2, LPY_RADIUS) * factor).max(0.0))
    }
}

/// The key of a curve: its number, which is whole.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
fn key_of(id: f64) -> u32 {
    id as u32
}
