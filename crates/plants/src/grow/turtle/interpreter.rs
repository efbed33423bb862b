//! Walks the string and obeys its commands.

use glam::{DQuat, DVec3};

use super::builder::{Builder, RawOrgan};
use super::commands::Command;
use super::frame::Frame;
use super::options::TurtleOptions;
use super::pull;
use super::shapes::Shapes;
use osier_base::Result;
use osier_base::diagnostic::Diagnostic;
use osier_base::limits::Limits;
use osier_base::math;
use osier_base::units::radians;
use osier_grammar::{Action, Dialect, Drawing, Grammar, Module};

/// Turns after which rounding is removed from the frame.
const TURNS: u32 = 64;
/// Thinnest width, turtle units.
const MIN_WIDTH: f64 = 1e-7;

/// Where the next segment goes.
#[derive(Debug, Clone, Copy)]
struct Attachment {
    /// The axis that goes on here.
    axis: Option<u32>,
    /// The axis and node that carry a new axis.
    parent: Option<(u32, u32)>,
    /// Lineage of the module that would open the next axis.
    ordinal: u64,
}

/// What brackets save.
#[derive(Debug, Clone, Copy)]
pub(super) struct State {
    pub(super) p: DVec3,
    pub(super) frame: Frame,
    /// Frame of the last drawn segment.
    last: Frame,
    pub(super) width: f64,
    pub(super) scale: f64,
    pub(super) color: u8,
    elasticity: [f64; pull::MAX],
    old_elasticity: f64,
    keep_roll: bool,
    turns: u32,
    attachment: Attachment,
}

/// An open polygon.
#[derive(Debug)]
struct Polygon {
    frame: Frame,
    corners: Vec<DVec3>,
}

/// A command of several symbols under way.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Prefix {
    None,
    At,
    /// `@D`, `@T`, `@b`, `@G`, `@P`: another letter may follow.
    Letter(char),
    Organ,
    Query,
}

/// Something odd, with how often it came.
#[derive(Debug)]
struct Remark {
    code: &'static str,
    /// Prefix and symbol concerned, for its place in the grammar.
    symbol: (Option<char>, char),
    message: String,
    help: String,
    count: u64,
}

/// The turtle.
pub(super) struct Turtle<'a> {
    grammar: &'a Grammar,
    pub(super) drawing: Drawing<'a>,
    pub(super) options: &'a TurtleOptions,
    commands: Vec<Command>,
    pub(super) symbols: Vec<char>,
    pub(super) s: State,
    stack: Vec<State>,
    polygons: Vec<Polygon>,
    prefix: Prefix,
    /// End node of the segment that still waits for its end width.
    open: Option<u32>,
    /// Turn without parameter: sine and cosine.
    default_turn: (f64, f64),
    pub builder: Builder,
    pub(super) shapes: Shapes,
    /// Prototypes of organs once they are used.
    pub(super) organs: std::collections::BTreeMap<char, (u16, u16, f64)>,
    remarks: Vec<Remark>,
    max_stack: u64,
    max_nodes: u64,
    max_organs: u64,
    /// A limit was passed or a command refused: nothing more is drawn.
    halted: bool,
    pub sets_widths: bool,
}

impl<'a> Turtle<'a> {
    pub fn new(grammar: &'a Grammar, drawing: Drawing<'a>, options: &'a TurtleOptions, limits: &Limits) -> Self {
        let id = |i: usize| u16::try_from(i).unwrap_or(u16::MAX);
        let symbols: Vec<char> = (0..grammar.symbols().len()).map(|i| grammar.symbols().get(id(i))).collect();
        let angle = options.angle.unwrap_or(radians(45.0));
        let mut elasticity = [0.0; pull::MAX];
        for (e, t) in elasticity.iter_mut().zip(&options.tropisms) {
            *e = t.elasticity;
        }
        let s = State {
            p: DVec3::ZERO,
            frame: Frame::START,
            last: Frame::START,
            width: options.width.max(MIN_WIDTH),
            scale: options.scale,
            color: options.color,
            elasticity,
            old_elasticity: 0.0,
            keep_roll: options.tropism_keep_roll,
            turns: 0,
            attachment: Attachment { axis: None, parent: None, ordinal: 0 },
        };
        let command = |i: usize, c: char| match drawing.action(id(i)) {
            Some(Action::As(other)) => Command::of(*other),
            Some(_) => Command::Bound,
            None if drawing.dialect() == Dialect::Cpfg || matches!(c, '[' | ']') => Command::of(c),
            None => Command::Nothing,
        };
        Self {
            grammar,
            options,
            commands: symbols.iter().enumerate().map(|(i, c)| command(i, *c)).collect(),
            drawing,
            symbols,
            s,
            stack: Vec::new(),
            polygons: Vec::new(),
            prefix: Prefix::None,
            open: None,
            default_turn: (math::cos(angle), math::sin(angle)),
            builder: Builder::default(),
            shapes: Shapes::default(),
            organs: std::collections::BTreeMap::new(),
            remarks: Vec::new(),
            max_stack: limits.get("turtle-stack"),
            max_nodes: limits.get("nodes"),
            max_organs: limits.get("organs"),
            halted: false,
            sets_widths: false,
        }
    }

    pub(super) fn remark(&mut self, code: &'static str, symbol: (Option<char>, char), message: String, help: &str) {
        match self.remarks.iter_mut().find(|r| r.code == code && r.symbol == symbol) {
            Some(r) => r.count += 1,
            None => self.remarks.push(Remark { code, symbol, message, help: help.to_owned(), count: 1 }),
        }
    }

    fn halt(&mut self, code: &'static str, c: char, message: String, help: &str) {
        self.halted = true;
        self.remark(code, (None, c), message, help);
    }

    /// What was odd; an error if the drawing had to stop.
    pub fn diagnostics(&self) -> Result<Vec<Diagnostic>> {
        let list: Vec<Diagnostic> = self
            .remarks
            .iter()
            .map(|r| {
                let times = if r.count > 1 { format!(", {} times", r.count) } else { String::new() };
                let span = self.grammar.place_of(r.symbol.0, r.symbol.1);
                let message = format!("{}{times}", r.message);
                let d = match osier_base::diagnostic::codes::find(r.code).map(|c| c.severity) {
                    Some(osier_base::diagnostic::Severity::Error) => Diagnostic::error(r.code, message, span, "here"),
                    _ => Diagnostic::warning(r.code, message, span, "here"),
                };
                d.help(r.help.clone())
            })
            .collect();
        if self.halted { Err(self.grammar.report(list)) } else { Ok(list) }
    }

    /// Obeys one module.
    pub fn module(&mut self, m: Module<'_>) {
        if self.halted {
            return;
        }
        let i = usize::from(m.symbol);
        let (Some(&command), Some(&c)) = (self.commands.get(i), self.symbols.get(i)) else { return };
        match std::mem::replace(&mut self.prefix, Prefix::None) {
            Prefix::None => self.command(command, c, m),
            Prefix::At => self.at(c, m),
            Prefix::Letter(first) => {
                if !self.at_second(first, c, m) {
                    self.command(command, c, m);
                }
            }
            Prefix::Organ => {
                let size = self.param(m, 0, 1.0);
                self.organ(c, size, m);
            }
            Prefix::Query => {}
        }
    }

    /// Parameter `i`, or the default; non-finite values count as 0.
    pub(super) fn param(&mut self, m: Module<'_>, i: usize, default: f64) -> f64 {
        match m.params.get(i) {
            None => default,
            Some(v) if v.is_finite() => f64::from(*v),
            Some(_) => {
                let c = self.grammar.symbols().get(m.symbol);
                let message = format!("parameter {} of {c} is not finite and counts as 0", i + 1);
                self.remark("L041", (None, c), message, "look for a division or logarithm of 0");
                0.0
            }
        }
    }

    fn command(&mut self, command: Command, c: char, m: Module<'_>) {
        if command == Command::Nothing {
            return;
        }
        if command.closes_segment() {
            self.close_segment();
        }
        match command {
            Command::Draw | Command::DrawOnly | Command::Move | Command::MoveOnly => {
                let draws = matches!(command, Command::Draw | Command::DrawOnly);
                let length = self.param(m, 0, 1.0);
                self.step(length, m, draws, matches!(command, Command::Draw | Command::Move));
            }
            Command::Yaw(p) => self.turn(m, p, c, Frame::yaw),
            Command::Pitch(p) => self.turn(m, p, c, Frame::pitch),
            Command::Roll(p) => self.turn(m, p, c, Frame::roll),
            Command::TurnAround => self.s.frame.yaw(-1.0, 0.0),
            Command::Level => self.s.frame.level(),
            Command::Push => self.push(m),
            Command::Pop => self.pop(),
            Command::Width(up) => {
                let step = if up { self.options.width_increment } else { -self.options.width_increment };
                let scale = self.s.scale;
                let width = match m.params.first() {
                    Some(_) => self.param(m, 0, 0.0) * scale,
                    None => self.s.width + step * scale,
                };
                self.widen(width);
            }
            Command::Color(up) => {
                let step = self.options.color_increment;
                let next = if up { self.s.color.wrapping_add(step) } else { self.s.color.wrapping_sub(step) };
                let value = self.param(m, 0, f64::from(next));
                self.s.color = wrapped(value);
            }
            Command::OpenPolygon => {
                if !m.params.is_empty() {
                    self.remark("L008", (None, c), "splines are not supported, read as a polygon".into(), "");
                }
                self.open_polygon();
            }
            Command::Vertex => self.vertex(),
            Command::ClosePolygon => self.fill(m),
            Command::OldElasticity => self.s.old_elasticity = self.param(m, 0, 0.0),
            Command::At => self.prefix = Prefix::At,
            Command::Organ => self.prefix = Prefix::Organ,
            Command::Bound => self.bound(m),
            Command::Query => {
                self.prefix = Prefix::Query;
                self.remark("L008", (None, c), "queries are not supported".into(), "the module keeps its parameters");
            }
            Command::Nothing => {}
        }
    }

    /// The present segment ends with the width now in force.
    pub(super) fn close_segment(&mut self) {
        let Some(node) = self.open.take() else { return };
        let width = self.s.width * self.options.unit_m;
        if self.options.tapered
            && let Some(n) = self.builder.at(node)
        {
            n.width_in = Some(width);
        }
    }

    /// The string is over.
    pub fn end(&mut self) {
        if let Prefix::Letter(first) = std::mem::replace(&mut self.prefix, Prefix::None) {
            self.letter_default(first, 0, &[]);
        }
        self.close_segment();
    }

    fn turn(&mut self, m: Module<'_>, positive: bool, c: char, f: fn(&mut Frame, f64, f64)) {
        let (cos, sin) = if m.params.is_empty() {
            if self.options.angle.is_none() {
                let help = "give the turn a parameter, or set angle_deg";
                self.remark("L045", (None, c), "no angle given, 45 degrees assumed".into(), help);
            }
            self.default_turn
        } else {
            let a = radians(self.param(m, 0, 0.0));
            (math::cos(a), math::sin(a))
        };
        f(&mut self.s.frame, cos, if positive { sin } else { -sin });
        self.turned();
    }

    /// Counts a turn, and removes what rounding many of them have left.
    pub(super) fn turned(&mut self) {
        self.s.turns += 1;
        if self.s.turns >= TURNS {
            self.s.turns = 0;
            self.s.frame.orthonormalize();
        }
    }

    fn push(&mut self, m: Module<'_>) {
        if self.stack.len() as u64 >= self.max_stack {
            let help = "raise it with --max-turtle-stack, or close branches";
            return self.halt("L051", '[', format!("more than {} open branches", self.max_stack), help);
        }
        self.stack.push(self.s);
        self.s.attachment = Attachment { axis: None, parent: self.site(), ordinal: m.lineage };
    }

    fn pop(&mut self) {
        match self.stack.pop() {
            Some(s) => self.s = s,
            None => {
                let help = "every ']' needs a '[' before it";
                self.remark("L053", (None, ']'), "unmatched ']' in the string".into(), help);
            }
        }
    }

    /// The axis and node where the turtle stands.
    fn site(&self) -> Option<(u32, u32)> {
        let a = &self.s.attachment;
        a.axis.map(|axis| (axis, self.builder.last(axis))).or(a.parent)
    }

    pub(super) fn widen(&mut self, width: f64) {
        self.s.width = width.max(MIN_WIDTH);
        self.sets_widths = true;
    }

    pub(super) fn open_polygon(&mut self) {
        self.polygons.push(Polygon { frame: self.s.frame, corners: Vec::new() });
    }

    pub(super) fn vertex(&mut self) {
        let p = self.s.p;
        if let Some(polygon) = self.polygons.last_mut() {
            polygon.corners.push(p);
        }
    }

    pub(super) fn step(&mut self, length: f64, m: Module<'_>, draws: bool, adds_vertex: bool) {
        let length = length * self.s.scale * self.options.unit_m;
        let tropisms = &self.options.tropisms;
        if !tropisms.is_empty() {
            let s = &mut self.s;
            pull::bend(&mut s.frame, &s.last, tropisms, &s.elasticity, s.keep_roll);
        }
        let from = self.s.p;
        self.s.p += self.s.frame.h * length;
        if draws {
            self.segment(from, m);
            self.s.last = self.s.frame;
        } else {
            self.s.attachment = Attachment { axis: None, ordinal: m.lineage, ..self.s.attachment };
        }
        if self.s.old_elasticity.abs() > 0.0 {
            pull::bend_old(&mut self.s.frame, self.options.old_tropism, self.s.old_elasticity);
        }
        if adds_vertex {
            self.vertex();
        }
    }

    /// Draws from `from` to the present position.
    fn segment(&mut self, from: DVec3, m: Module<'_>) {
        let (nodes, _) = self.builder.counts();
        if nodes + 2 > self.max_nodes {
            let message = format!("more than {} nodes", self.max_nodes);
            return self.halt("L051", 'F', message, "raise it with --max-nodes, or shorten the derivation");
        }
        let left = self.s.frame.l;
        let width = self.s.width * self.options.unit_m;
        let color = u16::from(self.s.color);
        let axis = match self.s.attachment.axis {
            Some(axis) => axis,
            None => {
                let a = self.s.attachment;
                let axis = self.builder.begin(a.parent, a.ordinal, Builder::node(from, left, m.birth, color));
                self.s.attachment.axis = Some(axis);
                axis
            }
        };
        let start = self.builder.last(axis);
        if let Some(n) = self.builder.at(start) {
            n.width_out = Some(width);
        }
        let mut node = Builder::node(self.s.p, left, m.birth, color);
        node.width_in = Some(width);
        self.builder.extend(axis, node);
        self.open = Some(self.builder.last(axis)).filter(|n| *n != start);
    }

    /// Puts an organ at `pose`; `protos`: first and number, `size`: scale and petiole (m).
    pub(super) fn place(&mut self, pose: (DVec3, DQuat), protos: (u16, u16), size: (f64, f64), m: Module<'_>) {
        let (_, organs) = self.builder.counts();
        if organs >= self.max_organs {
            let message = format!("more than {} organs", self.max_organs);
            return self.halt("L051", '~', message, "raise it with --max-organs, or shorten the derivation");
        }
        let ((p, q), (scale, petiole), site) = (pose, size, self.site());
        self.builder.organ(RawOrgan { site, p, q, scale, petiole, protos, lineage: m.lineage, birth: m.birth });
    }

    pub(super) fn no_room(&mut self, c: char) {
        self.halt("L051", c, "more than 65,535 different shapes".into(), "draw shapes that differ less");
    }

    pub(super) fn fill(&mut self, m: Module<'_>) {
        let Some(polygon) = self.polygons.pop() else { return };
        let Some(&p) = polygon.corners.first() else { return };
        let q = polygon.frame.quat();
        let material = self.options.shape_material;
        match self.shapes.polygon(&mut self.builder.protos, material, &polygon.corners, (p, q)) {
            Ok(Some((proto, size))) => self.place((p, q), (proto, 1), (size, 0.0), m),
            Ok(None) => {}
            Err(()) => self.no_room('}'),
        }
    }

    /// The symbol after `@`.
    fn at(&mut self, c: char, m: Module<'_>) {
        match c {
            'v' => self.s.frame.level(),
            'M' => {
                let [x, y, z] = [0, 1, 2].map(|i| self.param(m, i, 0.0));
                self.s.p = DVec3::new(x, y, z) * self.options.unit_m;
                self.s.attachment = Attachment { axis: None, ordinal: m.lineage, ..self.s.attachment };
            }
            'R' => {
                let v = [0, 1, 2, 3, 4, 5].map(|i| self.param(m, i, 0.0));
                // Grammars state cpfg's up, which points the other way.
                let up = (m.params.len() >= 5).then(|| -DVec3::new(v[3], v[4], v[5]));
                let last = self.s.last;
                self.s.frame.set(DVec3::new(v[0], v[1], v[2]), up, &last);
            }
            'o' | 'c' | 'O' => self.round(c, m),
            ';' | ',' | '#' | '!' => {}
            'D' | 'T' if !m.params.is_empty() => self.letter_default(c, m.params.len(), m.params),
            'D' | 'T' | 'b' | 'G' | 'P' => self.prefix = Prefix::Letter(c),
            'L' => self.remark("L008", (Some('@'), c), "labels are not supported".into(), "nothing is drawn"),
            'S' | 'I' | 'J' | 'm' => {
                let message = format!("command '@{c}' is not available in grammars");
                self.halted = true;
                self.remark("L043", (Some('@'), c), message, "remove it: grammars start no programs");
            }
            _ => self.remark("L008", (Some('@'), c), format!("command '@{c}' is not supported"), "nothing is drawn"),
        }
    }

    /// `@D`, `@T` and others without a further letter.
    fn letter_default(&mut self, first: char, given: usize, params: &[f32]) {
        let value = |i: usize| params.get(i).map(|v| f64::from(*v)).filter(|v| v.is_finite()).unwrap_or(0.0);
        match first {
            'D' if given > 0 => self.s.scale = value(0),
            'D' => self.s.scale = self.options.scale,
            'T' => self.elasticity(if given > 0 { value(0) } else { 1.0 }, (given > 1).then(|| value(1)), 1.0),
            _ => {}
        }
    }

    /// Raises the elasticity of tropism `i` by `e`, or by its own step.
    fn elasticity(&mut self, i: f64, e: Option<f64>, sign: f64) {
        let Some(k) = self.tropism(i) else { return };
        let step = e.unwrap_or_else(|| self.options.tropisms.get(k).map_or(0.0, |t| t.step));
        self.s.elasticity[k] += sign * step;
    }

    /// Index of tropism number `i`, counted from 1.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates; the range is checked next")]
    fn tropism(&mut self, i: f64) -> Option<usize> {
        let k = (i as usize).wrapping_sub(1);
        if k < self.options.tropisms.len().min(pull::MAX) {
            return Some(k);
        }
        let message = format!("tropism {i} is unknown, {} defined", self.options.tropisms.len());
        self.remark("L048", (Some('@'), 'T'), message, "add it to `tropisms` of the scene's turtle");
        None
    }

    /// The second letter after `@`; false if the symbol does not belong to the command.
    fn at_second(&mut self, first: char, c: char, m: Module<'_>) -> bool {
        let factor = self.param(m, 0, self.options.scale_multiplier);
        match (first, c) {
            ('D', 'i') => self.s.scale *= factor,
            ('D', 'd') => self.s.scale /= if factor.abs() > 0.0 { factor } else { 1.0 },
            ('T', 's') => {
                let (i, e) = (self.param(m, 0, 1.0), self.param(m, 1, 0.0));
                if let Some(k) = self.tropism(i) {
                    let own = self.options.tropisms.get(k).map_or(0.0, |t| t.elasticity);
                    self.s.elasticity[k] = if m.params.len() > 1 { e } else { own };
                }
            }
            ('T', 'i' | 'd') => {
                let (i, e) = (self.param(m, 0, 1.0), self.param(m, 1, 0.0));
                let sign = if c == 'i' { 1.0 } else { -1.0 };
                self.elasticity(i, (m.params.len() > 1).then_some(e), sign);
            }
            ('T', 'p') => self.s.frame = self.s.last.swung_to(self.s.frame.h),
            ('T', 'f') => self.s.keep_roll = true,
            ('D' | 'T', _) => {
                self.letter_default(first, 0, &[]);
                return false;
            }
            _ => {
                let what = if first == 'G' { "generalised cylinders are" } else { "this command is" };
                let message = format!("'@{first}{c}': {what} not supported");
                self.remark("L008", (Some('@'), first), message, "nothing is drawn");
            }
        }
        true
    }
}

/// A colour index, modulo 256.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "reduced to 0..256 before the cast")]
pub(super) fn wrapped(value: f64) -> u8 {
    value.trunc().rem_euclid(256.0) as u8
}
