//! Turtles of other programs: what the commands of Fractint, LParser and L-Py do.

use glam::DVec3;

use super::dialect_commands::{DialectCommand, DialectState, LPY_RADIUS, WaitingCommand};
use super::frame::TurtleFrame;
use super::interpreter::{Turtle, color_index};
use osier_base::math;
use osier_base::units::radians;
use osier_grammar::{Dialect, Module, QueryAnswer, QueryValue};
use osier_scene::plant::Plant;

/// Diameter of the lines of a drawing in the plane: a share of its median step, so that dense curves stay legible, limited to
/// these shares of its largest side, so that lines are 1 to 6 pixels wide in a picture of 800. Chosen by eye.
const STEP_SHARE: f32 = 0.35;
const LINE_SHARES: [f32; 2] = [0.002, 0.008];
/// Least diameter of LParser's segments, as a share of the largest side. Files that thin their twigs at every step would draw
/// them thinner than a pixel of any picture.
const LEAST_SHARE: f32 = 0.001;
/// Cosine of the turn beyond which a line begins anew, about 155 degrees.
const REVERSAL: f64 = -0.9;
/// Gravity of LParser's `t` without a number.
const GRAVITY: f64 = 0.2;
/// Largest angle of LParser's `~` without a number, degrees: six radians, so that the heading takes any direction. Source: LParser.
const RANDOM_DEG: f64 = 6.0 * 180.0 / std::f64::consts::PI;
/// Increment of the radius of L-Py. Source: the manual of L-Py.
const LPY_RADIUS_STEP: f64 = 1.0;
/// Factor of the scale without a number, and the length up to which numbers count as 0. Source: its turtle (PlantGL).
const LPY_SCALE: f64 = 0.5;
const LPY_EPSILON: f64 = 1e-5;
/// Most steps of a path of L-Py (`nF`) that bends. Own: the bends of more cannot be seen.
const MAX_PATH_STEPS: f64 = 1e5;
/// Colour indices of the arrows of L-Py's `Frame`: heading red, left green, up blue. Source: its help card.
const FRAME_COLORS: [u8; 3] = [3, 2, 5];
/// Head of these arrows: its share of the length, and its width in widths of the line. Chosen by eye.
const FRAME_HEAD: f64 = 0.2;
const FRAME_HEAD_WIDTH: f64 = 2.0;
/// Most characters of a number of LParser.
const MAX_NUMBER: usize = 64;

/// A heading whose horizontal part is at most this counts as vertical: `$` does nothing then; as in
/// [`TurtleFrame::level`].
const VERTICAL: f64 = 1e-9;

/// Cosine and sine of the turn that LParser makes for an angle with cosine `c` and sine `s` about an axis a of the
/// given length: it normalizes the image c v + s a x v of a vector v perpendicular to a.
/// Source: `Set_rot` and `L_draw` of LParser.
fn about(c: f64, s: f64, length: Option<f64>) -> (f64, f64) {
    let Some(length) = length else { return (c, s) };
    let s = s * length;
    let norm = math::sqrt(c * c + s * s);
    (c / norm, s / norm)
}

impl Turtle<'_> {
    /// Reads LParser's numbers, which are characters of the string: a command waits until the characters after it have
    /// been read. True if the module was part of a number, or is a command that now waits.
    pub(super) fn read_number(&mut self, command: Option<DialectCommand>, c: char, m: Module<'_>) -> bool {
        if let Some(text) = &mut self.pending.text {
            if c == ')' || text.len() >= MAX_NUMBER {
                self.run_pending();
            } else {
                text.push(c);
            }
            return true;
        }
        // A number after a symbol that is not a command is ignored.
        if c == '(' && m.params.is_empty() {
            self.pending.text = Some(String::new());
            return true;
        }
        self.run_pending();
        self.note_birth(m);
        // Grammars with `turtle: lparser` write numbers as parameters.
        match command {
            Some(command) if m.params.is_empty() => {
                let (symbol, lineage, birth) = (m.symbol, m.lineage(), m.birth);
                self.pending.waiting = Some(WaitingCommand { command, symbol, lineage, birth });
                true
            }
            _ => false,
        }
    }

    /// If the recursion has a fraction, records where a run of modules made by the last step begins and ends: changes
    /// of length, angle and thickness by its commands end with it.
    fn note_birth(&mut self, m: Module<'_>) {
        if self.dialect.settings.fraction.is_none() {
            return;
        }
        let is_last = m.birth == self.dialect.last_step;
        match self.pending.outside {
            None if is_last => {
                let DialectState { length, angle, thickness, .. } = self.rare.dialect;
                self.pending.outside = Some([length, angle, thickness]);
            }
            Some([length, angle, thickness]) if !is_last => {
                self.pending.outside = None;
                self.rare.dialect = DialectState { length, angle, thickness, ..self.rare.dialect };
            }
            _ => {}
        }
    }

    /// The fraction of LParser's recursion, if the module was made by the last step.
    fn fraction(&self, m: Module<'_>) -> Option<f64> {
        self.dialect.settings.fraction.filter(|_| m.birth == self.dialect.last_step)
    }

    /// Factor of a command of LParser; without a number it is `factor`, and a factor above 1 divides.
    fn lparser_factor(&self, given: Option<f64>, factor: f64, m: Module<'_>) -> f64 {
        // The fraction f turns a factor x into 1 + f (x - 1). A number of the file was multiplied by f before that.
        match (self.fraction(m), given) {
            (None, _) => given.unwrap_or(factor),
            (Some(f), Some(x)) => 1.0 + f * (f * x - 1.0),
            (Some(f), None) if factor > 1.0 => 1.0 / (1.0 + f * (1.0 / factor - 1.0)),
            (Some(f), None) => 1.0 + f * (factor - 1.0),
        }
    }

    /// Performs the command that waits for a number, with the number that was read.
    pub(super) fn run_pending(&mut self) {
        let Some(WaitingCommand { command, symbol, lineage, birth }) = self.pending.waiting.take() else {
            self.pending.text = None;
            return;
        };
        let number = self.pending.text.take().and_then(|t| t.trim().parse::<f64>().ok()).filter(|n| n.is_finite());
        let value = number.map(math::narrow);
        let params = value.as_slice();
        self.dialect_command(command, Module::new(symbol, params, lineage, birth));
    }

    /// Performs a command of Fractint, LParser or L-Py; `m`: the module, whose first parameter, if any, is its number.
    pub(super) fn dialect_command(&mut self, command: DialectCommand, m: Module<'_>) {
        use DialectCommand as C;
        let given = (!m.params.is_empty()).then(|| self.param(m, 0, 0.0));
        match command {
            C::Units(draws) => {
                let a = (self.rare.dialect.units as f64) * self.dialect.angle_deg;
                self.plane_step(a, draws, m);
            }
            C::Degrees(draws) => self.plane_step(self.rare.dialect.degrees, draws, m),
            C::TurnUnit(left) => {
                let left = left != self.rare.dialect.reversed;
                self.turn_units(if left { 1 } else { -1 });
            }
            // Half of the directions, rounded down, whatever `!` says.
            C::TurnHalf => self.turn_units(-self.unit_count().div_euclid(2)),
            C::TurnDegrees(left) => {
                // Counter-clockwise unless `!` has exchanged the directions.
                let sign = if left == self.rare.dialect.reversed { -1.0 } else { 1.0 };
                let turned = self.rare.dialect.degrees + sign * given.unwrap_or(0.0);
                self.rare.dialect.degrees = turned.rem_euclid(360.0);
            }
            C::Reverse => self.rare.dialect.reversed = !self.rare.dialect.reversed,
            C::Size => self.rare.dialect.length *= given.unwrap_or(1.0),
            C::Color(None) => self.set_color(color_index(given.unwrap_or(0.0))),
            // Without a number the index stays. Index 0, the background of Fractint, is skipped.
            C::Color(Some(sign)) => {
                let step = f64::from(sign) * given.unwrap_or(0.0);
                self.set_color(match color_index(f64::from(self.s.color) + step) {
                    0 if sign > 0 => 1,
                    0 => u8::MAX,
                    next => next,
                });
            }
            C::Yaw(sign) => {
                let DialectState { is_mirrored, up_length, .. } = self.rare.dialect;
                let sign = if is_mirrored { -sign } else { sign };
                self.dialect_turn(sign, given, up_length, m, TurtleFrame::yaw);
                self.set_unit_axes(true, false);
            }
            C::Pitch(sign) => {
                let left_length = self.rare.dialect.left_length;
                self.dialect_turn(sign, given, left_length, m, TurtleFrame::pitch);
                self.set_unit_axes(false, true);
            }
            C::Roll(sign) => {
                self.dialect_turn(sign, given, None, m, TurtleFrame::roll);
                self.set_unit_axes(true, true);
            }
            // (-1, 0) are cosine and sine of 180 degrees, exactly.
            C::TurnAround => {
                self.s.frame.yaw(-1.0, 0.0);
                self.set_unit_axes(true, false);
            }
            C::RollOver => {
                self.s.frame.roll(-1.0, 0.0);
                self.set_unit_axes(true, true);
            }
            C::Level => self.level(),
            C::Random => {
                let most = given.map_or(RANDOM_DEG, |most| most * self.fraction(m).unwrap_or(1.0));
                self.random_turns(most, m);
            }
            C::Gravity => {
                let h = self.s.frame.h;
                let f = self.fraction(m).unwrap_or(1.0);
                // The horizontal part of the unit heading is the cosine of its elevation.
                let angle = given.map_or(GRAVITY, |x| x * f * f) * math::sqrt(h.x * h.x + h.z * h.z);
                let (c, s) = about(math::cos(angle), math::sin(angle), self.rare.dialect.left_length);
                self.s.frame.pitch(c, s);
                self.set_unit_axes(false, true);
                self.count_turn();
            }
            C::Step { share, draws, adds_vertex } => self.lparser_step(given, share, draws, adds_vertex, m),
            C::Length(factor) => self.rare.dialect.length *= self.lparser_factor(given, factor, m),
            C::Angle(factor) => self.rare.dialect.angle *= self.lparser_factor(given, factor, m),
            C::Thickness(factor) => self.rare.dialect.thickness *= self.lparser_factor(given, factor, m),
            C::ColorIndex(sign) => {
                // Three numbers are an RGB colour, which has no index.
                if m.params.len() < 3 {
                    let next = f64::from(self.s.color) + f64::from(sign);
                    // The fraction of LParser acts on every number.
                    let given = given.map(|index| index * self.fraction(m).unwrap_or(1.0));
                    self.set_color(color_index(given.unwrap_or(next)));
                }
            }
            C::OpenPolygon => {
                self.close_segment();
                self.open_polygon();
                // The first corner of LParser is where the polygon begins.
                if self.dialect.kind == Dialect::LParser {
                    self.vertex();
                }
            }
            C::Vertex => self.vertex(),
            C::ClosePolygon => {
                self.close_segment();
                self.fill_polygon(m);
            }
            C::Digit | C::Ignored => {}
            _ => self.lpy_command(command, given, m),
        }
    }

    /// Character of a module's symbol.
    pub(super) fn symbol_of(&self, m: Module<'_>) -> char {
        self.symbols.get(usize::from(m.symbol)).copied().unwrap_or('?')
    }

    /// Turns by `sign` times the number, degrees; without a number by the present angle of turns. `axis`: length of the axis of the turn
    /// if it is not 1.
    fn dialect_turn(
        &mut self,
        sign: f64,
        given: Option<f64>,
        axis: Option<f64>,
        m: Module<'_>,
        turn: fn(&mut TurtleFrame, f64, f64),
    ) {
        let degrees = given.unwrap_or(self.dialect.angle_deg * self.rare.dialect.angle);
        // LParser multiplies every turn by the fraction, and a number once more when it reads it.
        let degrees = match (self.fraction(m), given) {
            (None, _) => degrees,
            (Some(f), None) => degrees * f,
            (Some(f), Some(_)) => degrees * f * f,
        };
        let a = radians(sign * degrees);
        let (c, s) = about(math::cos(a), math::sin(a), axis);
        turn(&mut self.s.frame, c, s);
        self.count_turn();
    }

    /// Rolls until left is horizontal. LParser recomputes left and up as cross products of heading and vertical: their
    /// length is that of the horizontal part of the heading, and their handedness differs from that of the first frame.
    fn level(&mut self) {
        self.s.frame.level();
        let h = self.s.frame.h;
        let horizontal = math::sqrt(h.x * h.x + h.z * h.z);
        if self.dialect.kind == Dialect::LParser && horizontal > VERTICAL {
            let dialect = &mut self.rare.dialect;
            dialect.is_mirrored = true;
            (dialect.left_length, dialect.up_length) = (Some(horizontal), Some(horizontal));
        }
    }

    /// Records which axes LParser has normalized: those that a turn about another axis has moved.
    fn set_unit_axes(&mut self, left: bool, up: bool) {
        // Branches share the state and writing to it makes a copy, so it is written only if something changes.
        if left && self.rare.dialect.left_length.is_some() {
            self.rare.dialect.left_length = None;
        }
        if up && self.rare.dialect.up_length.is_some() {
            self.rare.dialect.up_length = None;
        }
    }

    /// Number of directions of Fractint's integer pointer: a full turn divided by its unit, rounded, at least 1.
    fn unit_count(&self) -> i64 {
        let n = (360.0 / self.dialect.angle_deg.abs().max(1e-6)).round();
        #[allow(clippy::cast_possible_truncation, reason = "saturates; at most 360 million")]
        let n = n as i64;
        n.max(1)
    }

    /// Turns Fractint's integer pointer. Whole turns are removed, so that closed curves close exactly.
    fn turn_units(&mut self, by: i64) {
        let n = self.unit_count();
        let whole = (n as f64 * self.dialect.angle_deg - 360.0).abs() < 1e-9;
        let units = self.rare.dialect.units + by;
        self.rare.dialect.units = if whole { units.rem_euclid(n) } else { units };
    }

    /// A step of Fractint in the plane, in a direction counter-clockwise from +X, degrees.
    fn plane_step(&mut self, degrees: f64, draws: bool, m: Module<'_>) {
        self.close_segment();
        let (c, s) = (math::cos(radians(degrees)), math::sin(radians(degrees)));
        let before = self.s.frame.h;
        self.s.frame = TurtleFrame { h: DVec3::new(c, s, 0.0), l: DVec3::new(-s, c, 0.0), u: DVec3::Z };
        // A tube cannot turn back upon itself: a segment that does so begins a new axis.
        if draws && self.s.frame.h.dot(before) < REVERSAL {
            self.jump_to(self.s.p, m);
        }
        self.step(self.rare.dialect.length, m, draws, false);
    }

    /// Makes LParser's random turns about up, left and heading; the module's lineage draws each between `-most` and `most`
    /// degrees.
    fn random_turns(&mut self, most: f64, m: Module<'_>) {
        let turns: [fn(&mut TurtleFrame, f64, f64); 3] = [TurtleFrame::yaw, TurtleFrame::pitch, TurtleFrame::roll];
        for (k, turn) in (0_u64..).zip(turns) {
            let a = radians(most * (2.0 * self.bindings.draw(m.lineage(), k) - 1.0));
            // Only the axis of the first turn can have a length other than 1: this turn normalizes the left vector, the
            // second turn the up vector.
            let axis = self.rare.dialect.up_length.filter(|_| k == 0);
            let (c, s) = about(math::cos(a), math::sin(a), axis);
            turn(&mut self.s.frame, c, s);
            self.count_turn();
        }
        self.set_unit_axes(true, true);
    }

    /// A step of LParser. The number is its length, in units of the file; without one it is `share` of the present length. If the
    /// file asks for a fractional number of steps, lengths and thicknesses of segments made by the last step are
    /// multiplied by that fraction, and lengths given by a number are multiplied twice.
    fn lparser_step(&mut self, given: Option<f64>, share: f64, draws: bool, adds_vertex: bool, m: Module<'_>) {
        self.close_segment();
        let DialectState { length, thickness, .. } = self.rare.dialect;
        let settings = self.dialect.settings;
        let fraction = self.fraction(m).unwrap_or(1.0);
        let step = given.map_or(share * length, |x| x / settings.unit.unwrap_or(1.0) * fraction) * fraction;
        if draws {
            // Half steps are half as thick.
            self.set_width((thickness * fraction * step.abs()).max(settings.min_thickness));
        }
        self.step(step, m, draws, adds_vertex);
    }

    /// Answers a query in the axes of L-Py, whose +Z is up: the vector (x, y, z) there is (x, z, -y) in plant space.
    fn lpy_query(&mut self, letter: char) {
        let v = match letter {
            'H' => self.s.frame.h,
            'L' => self.s.frame.l,
            'U' => self.s.frame.u,
            _ => self.s.p / self.options.unit_m,
        };
        let value = QueryValue::Vector([v.x, -v.z, v.y]);
        self.answers.answers.push(QueryAnswer { module: self.index, value });
    }

    /// Performs a command that only L-Py has.
    fn lpy_command(&mut self, command: DialectCommand, given: Option<f64>, m: Module<'_>) {
        use DialectCommand as C;
        let scale = self.s.scale;
        match command {
            C::Forward(draws) => {
                self.close_segment();
                let length = given.unwrap_or(1.0);
                // A second number is the radius at the end of the segment, with which drawing continues.
                self.lpy_step(length, draws, m);
                if draws && m.params.len() > 1 {
                    self.set_end_radius(1, m);
                }
                if draws {
                    self.lpy_cylinder_point(m);
                }
            }
            C::Query(letter) => self.lpy_query(letter),
            C::Path => self.draw_path(m),
            C::Radius(sign) => {
                // The segment before it keeps its radius: L-Py draws it as a cylinder.
                self.close_segment();
                self.set_radius(given.unwrap_or(self.rare.dialect.radius + sign * LPY_RADIUS_STEP), m);
            }
            C::Scale => self.set_scale(given.unwrap_or(1.0)),
            C::ScaleUp => self.set_scale(scale * given.unwrap_or(LPY_SCALE)),
            C::ScaleDown => {
                let by = given.unwrap_or(LPY_SCALE);
                self.set_scale(if by.abs() > 0.0 { scale / by } else { scale });
            }
            C::MoveTo(relative) => {
                self.close_segment();
                // The length of a move by a vector is not scaled, unlike that of a step.
                let by = self.target(m, false);
                self.jump_to(if relative { self.s.p + by } else { by }, m);
            }
            C::LineTo { relative, turns } => {
                self.close_segment();
                let to = self.target(m, relative);
                self.line(to, turns, m);
                // A fourth parameter is the radius at the end of the line, as with `F`.
                if m.params.len() > 3 {
                    self.set_end_radius(3, m);
                }
            }
            // Turns without a step: towards a point, or to a frame that is given.
            C::PointAt(relative) => {
                let to = self.target(m, relative) - self.s.p;
                if let Some(h) = to.try_normalize() {
                    self.s.frame = self.s.frame.with_heading(h);
                }
            }
            C::SetHead => {
                let v = [0, 1, 2, 3, 4, 5].map(|i| self.param(m, i, if i == 2 || i == 3 { 1.0 } else { 0.0 }));
                let last = self.s.frame;
                let up = (m.params.len() != 3).then(|| world(v[3], v[4], v[5]));
                self.s.frame.set(world(v[0], v[1], v[2]), up, &last);
            }
            // Shapes, whose sizes are parameters and default to the width of the line.
            C::Sphere | C::Circle => {
                self.close_segment();
                let radius = given.unwrap_or(0.5 * self.s.width / scale.abs().max(1e-300));
                self.place_disc_or_sphere(if command == C::Sphere { 'O' } else { 'c' }, 2.0 * radius, m);
            }
            C::Surface(letter) => {
                self.close_segment();
                let size = given.unwrap_or(1.0);
                if letter == 'l' && !self.options.organs.contains_key(&letter) {
                    self.leaf(size, m);
                } else {
                    self.organ(letter, size, m);
                }
            }
            C::Frame => self.draw_frame(given.unwrap_or(1.0), m),
            // The tropism, which turns all following steps.
            C::Elasticity => {
                let value = given.unwrap_or(0.0);
                if (0.0..=1.0).contains(&value) {
                    self.rare.dialect.elasticity = value;
                } else {
                    let message = format!("an elasticity of {value} is not within 0 and 1, and is not set");
                    self.warn_of_parameter(m, 0, message, "give a number from 0 (stiff) to 1");
                }
            }
            C::Tropism => {
                let [x, y, z] = [0, 1, 2].map(|i| self.param(m, i, if i == 2 { 1.0 } else { 0.0 }));
                self.rare.dialect.tropism = world(x, y, z).normalize_or(DVec3::Y);
            }
            C::StartCylinder => self.start_lpy_cylinder(m),
            C::EndCylinder => self.end_lpy_cylinder(m),
            C::SetGuide => self.set_guide(m),
            C::EndGuide => self.rare.dialect.guide = None,
            C::PositionOnGuide => self.set_position_on_guide(m),
            C::SetContour => self.set_contour(m),
            C::Sweep => self.sweep(m),
            C::Unsupported => {
                let message = "this command of L-Py is not supported".to_owned();
                self.warn("L008", (None, self.symbol_of(m)), message, "nothing is drawn");
            }
            _ => {}
        }
    }

    /// Draws heading, left and up as arrows of a length, in the colours in which L-Py shows them.
    fn draw_frame(&mut self, length: f64, m: Module<'_>) {
        self.close_segment();
        let TurtleFrame { h, l, u } = self.s.frame;
        for (direction, color) in [h, l, u].into_iter().zip(FRAME_COLORS) {
            self.push_state(m);
            self.s.frame = self.s.frame.with_heading(direction);
            self.set_color(color);
            self.step((1.0 - FRAME_HEAD) * length, m, true, false);
            self.close_segment();
            // The head is a separate cone, so that it does not taper the shaft.
            let width = self.s.width;
            self.jump_to(self.s.p, m);
            self.set_width(FRAME_HEAD_WIDTH * width);
            self.step(FRAME_HEAD * length, m, true, false);
            self.set_width(0.0);
            self.close_segment();
            self.pop_state(m);
        }
    }

    /// The point in plant space that three numbers of L-Py give; with `relative` they count from the turtle's position.
    fn target(&mut self, m: Module<'_>, relative: bool) -> DVec3 {
        let [x, y, z] = [0, 1, 2].map(|i| self.param(m, i, 0.0));
        let scale = self.options.unit_m * if relative { self.s.scale } else { 1.0 };
        let v = world(x, y, z) * scale;
        if relative { self.s.p + v } else { v }
    }

    /// Draws a line to a point of plant space; with `turns` the turtle keeps its direction.
    fn line(&mut self, to: DVec3, turns: bool, m: Module<'_>) {
        let way = to - self.s.p;
        let Some(h) = way.try_normalize() else { return };
        let before = self.s.frame;
        self.s.frame = before.with_heading(h);
        let unit = self.s.scale * self.options.unit_m;
        if unit.abs() > 0.0 {
            self.step(way.length() / unit, m, true, true);
        }
        if !turns {
            self.s.frame = before;
        }
    }

    /// Turns the frame towards the tropism of L-Py before a step, by the elasticity times the angle between heading and tropism; a heading
    /// against the tropism turns about up.
    pub(super) fn bend(&mut self) {
        let DialectState { elasticity, tropism, .. } = self.rare.dialect;
        if elasticity <= 0.0 {
            return;
        }
        let TurtleFrame { h, u, .. } = self.s.frame;
        let (axis, cosine) = (h.cross(tropism), h.dot(tropism));
        let sine = axis.length();
        let (axis, angle) = if sine > 1e-12 {
            (axis / sine, math::atan2(sine, cosine))
        } else if cosine < 0.0 {
            (u, std::f64::consts::PI)
        } else {
            return;
        };
        let a = elasticity * angle;
        self.s.frame = self.s.frame.rotated(axis, math::cos(a), math::sin(a));
        self.s.frame.orthonormalize();
    }

    /// Draws a path of L-Py: length, length of a step, radius at its end. Without a tropism it is straight, and its steps make one segment.
    fn draw_path(&mut self, m: Module<'_>) {
        let length = self.param(m, 0, 1.0);
        let step = self.param(m, 1, length);
        let end = (m.params.len() > 2).then(|| 2.0 * self.param(m, 2, LPY_RADIUS) * self.s.scale.abs());
        let first = self.s.width;
        let is_bent = self.rare.dialect.elasticity > 0.0 || self.rare.dialect.guide.is_some();
        let has_radii = self.path_radius(m, 0.0).is_some();
        let is_surface = self.rare.cylinder.contour != 0;
        let bends = (is_bent || has_radii || is_surface) && step > 0.0 && length > 0.0;
        if let Some(radius) = self.path_radius(m, 0.0) {
            self.set_radius(radius, m);
        }
        let steps = if bends { (length / step).floor() } else { 0.0 };
        if steps > MAX_PATH_STEPS {
            let message = format!("a path of more than {MAX_PATH_STEPS} steps: the rest of it is one step");
            self.warn("L008", (None, self.symbol_of(m)), message, "make the steps longer");
        }
        let whole = steps.min(MAX_PATH_STEPS);
        let mut done = 0.0;
        while done < whole && !self.halted {
            self.close_segment();
            self.lpy_step(step, true, m);
            done += 1.0;
            if let Some(radius) = self.path_radius(m, done * step / length) {
                self.set_radius(radius, m);
            } else if let Some(last) = end.filter(|last| *last >= 0.0) {
                self.set_width(first + (last - first) * (done * step / length).min(1.0));
            }
            self.lpy_cylinder_point(m);
        }
        // The rest of the length; all of it without a tropism.
        let rest = length - whole * step;
        if rest > LPY_EPSILON || whole < 1.0 {
            self.close_segment();
            if bends {
                self.lpy_step(rest, true, m);
            } else {
                self.step(rest, m, true, true);
            }
        }
        if let Some(radius) = self.path_radius(m, 1.0) {
            self.set_radius(radius, m);
        } else if end.is_some() {
            self.set_end_radius(2, m);
        }
        if rest > LPY_EPSILON || whole < 1.0 {
            self.lpy_cylinder_point(m);
        }
    }

    /// Sets the radius of L-Py. A negative radius is reported, and the present one is kept.
    pub(super) fn set_radius(&mut self, radius: f64, m: Module<'_>) {
        if radius < -LPY_EPSILON {
            let message = format!("a radius of {radius:.6} is negative, and is not set");
            let help = "give the radius as a parameter: without one '!' takes 1 away, and the turtle begins with 0.1";
            return self.warn_of_parameter(m, 0, message, help);
        }
        self.rare.dialect.radius = radius.max(0.0);
        self.set_width(2.0 * self.rare.dialect.radius * self.s.scale.abs());
    }

    /// Sets the radius that parameter `i` gives the end of a line; a negative one means none.
    fn set_end_radius(&mut self, i: usize, m: Module<'_>) {
        let radius = self.param(m, i, 0.0);
        if radius > -LPY_EPSILON {
            self.set_radius(radius, m);
        }
    }

    /// Sets the scale of L-Py, which also multiplies the radius that was set before it.
    fn set_scale(&mut self, scale: f64) {
        self.close_segment();
        self.s.scale = scale;
        self.set_width(2.0 * self.rare.dialect.radius * scale.abs());
    }

    /// Draws the leaf `l`, which L-Py defines unless the scene gives an organ for this letter: a blade of length `size` along the
    /// heading.
    fn leaf(&mut self, size: f64, m: Module<'_>) {
        // Half widths along the blade, in lengths: an ovate outline.
        const OUTLINE: [(f64, f64); 5] = [(0.12, 0.1), (0.3, 0.22), (0.5, 0.25), (0.72, 0.16), (0.9, 0.05)];
        let length = size * self.s.scale * self.options.unit_m;
        if length <= 0.0 {
            return;
        }
        let TurtleFrame { h, l, .. } = self.s.frame;
        let p = self.s.p;
        let corner = |(along, half): (f64, f64)| p + (h * along + l * half) * length;
        self.open_polygon();
        let right = OUTLINE.iter().map(|(a, w)| (*a, -*w));
        let left = OUTLINE.iter().rev().copied();
        let outline = std::iter::once((0.0, 0.0)).chain(right).chain(std::iter::once((1.0, 0.0))).chain(left);
        for at in outline {
            self.vertex_at(corner(at));
        }
        self.fill_polygon(m);
    }
}

/// Converts a vector of LParser or L-Py, whose +Z is up, to plant space, whose +Y is up.
fn world(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, z, -y)
}

/// Gives all lines of a drawing in the plane one diameter that suits a picture of the whole, and marks them as lines of a drawing.
pub(super) fn set_line_radius(plant: &mut Plant) {
    plant.lines = true;
    let extent = largest_side(plant);
    let mut steps: Vec<f32> = plant.nodes.s.windows(2).map(|w| w[1] - w[0]).filter(|d| *d > 0.0).collect();
    steps.sort_unstable_by(f32::total_cmp);
    let step = steps.get(steps.len() / 2).copied().unwrap_or(extent);
    if extent.is_finite() && extent > 0.0 {
        let diameter = (STEP_SHARE * step).clamp(LINE_SHARES[0] * extent, LINE_SHARES[1] * extent);
        plant.nodes.r.fill(0.5 * diameter);
    }
}

/// Thickens segments of LParser that would be thinner than a pixel in a picture of the whole.
pub(super) fn set_least_radius(plant: &mut Plant) {
    let least = 0.5 * LEAST_SHARE * largest_side(plant);
    if least.is_finite() {
        for r in &mut plant.nodes.r {
            *r = r.max(least);
        }
    }
}

/// The largest side of the box around all nodes, m; not finite for a plant without nodes.
fn largest_side(plant: &Plant) -> f32 {
    let low = plant.nodes.p.iter().fold(glam::Vec3::INFINITY, |m, p| m.min(*p));
    let high = plant.nodes.p.iter().fold(glam::Vec3::NEG_INFINITY, |m, p| m.max(*p));
    (high - low).max_element()
}
