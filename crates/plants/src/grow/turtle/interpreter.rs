//! Interprets a string of modules as commands of the turtle.

use glam::DVec3;

use super::builder::{DrawnNode, NodeSite, OrganSize, PlantBuilder, ProtoRange, RawOrgan};
use super::commands::Command;
use super::cylinders::{Contour, CylinderState, OpenCylinder, TANGENT};
use super::dialect_commands::{DialectState, DialectTurtle, PendingNumber};
use super::frame::{TurtleFrame, TurtlePose};
use super::guides::GuideCurve;
use super::options::TurtleOptions;
use super::patches::TurtlePatches;
use super::prototypes::{PolygonPrototype, PrototypeCache, TooManyPrototypes};
use super::step_part::{ModuleGrowth, SymbolRole};
use super::trace::DrawingTrace;
use super::tropism;
use osier_base::Result;
use osier_base::diagnostic::Diagnostic;
use osier_base::limits::Limits;
use osier_base::math;
use osier_base::units::radians;
use osier_grammar::{BindingEvaluator, Dialect, Grammar, Module, QueryAnswer, QueryValue, TurtleAction, TurtleAnswers};
use osier_scene::plant::{NONE, PAINTED};

/// Turns after which the frame is made orthonormal again: 64 turns in double precision drift by some 1e-14.
const TURNS_PER_ORTHONORMALIZATION: u32 = 64;
/// Thinnest width, turtle units; `!` may count down below zero.
const MIN_WIDTH: f64 = 1e-7;
/// Longest step, m, and largest width, turtle units: squares of sums of such steps stay within the range of `f32`.
const MAX_STEP: f64 = 1e12;

/// Where the next segment is attached.
#[derive(Debug, Clone, Copy)]
struct Attachment {
    /// The axis that the next segment extends; `None`: the segment opens an axis.
    axis: Option<u32>,
    /// The node that carries a new axis; `None`: it is a root.
    parent: Option<NodeSite>,
    /// Lineage of the module that would open the next axis.
    ordinal: u64,
}

/// The part of the state that brackets save and restore: `[` pushes a copy, `]` returns to it.
#[derive(Debug, Clone, Copy)]
pub(super) struct TurtleState {
    /// Position in plant space, m.
    pub(super) p: DVec3,
    pub(super) frame: TurtleFrame,
    /// Frame of the last drawn segment.
    last: TurtleFrame,
    /// Diameter, turtle units.
    pub(super) width: f64,
    pub(super) scale: f64,
    pub(super) color: u8,
    /// Whether drawn parts take the colour index as their material.
    painted: bool,
    turns: u32,
    attachment: Attachment,
}

/// The part of the state that few branches change; brackets save and restore it too.
#[derive(Debug, Clone, Copy)]
pub(super) struct RareState {
    /// Material of the texture that shapes take; `None`: no texture.
    pub(super) texture: Option<osier_scene::MaterialId>,
    pub(super) cylinder: CylinderState,
    /// State that only the commands of other programs change.
    pub(super) dialect: DialectState,
    elasticity: [f64; tropism::MAX_TROPISMS],
    tropism_elasticity: f64,
}

/// A value that each branch may change for itself. It is copied when a branch changes it, not at each bracket.
#[derive(Debug)]
pub(super) struct Branched<T> {
    value: T,
    /// Number of open brackets.
    depth: usize,
    /// Values to restore at the ends of branches that have changed it, with the depths of the branches.
    saved: Vec<(usize, T)>,
}

impl<T: Copy> Branched<T> {
    fn new(value: T) -> Self {
        Self { value, depth: 0, saved: Vec::new() }
    }

    /// Begins a branch.
    fn push(&mut self) {
        self.depth += 1;
    }

    /// Ends a branch: the value is again what it was when the branch began.
    fn pop(&mut self) {
        if let Some((_, value)) = self.saved.pop_if(|(depth, _)| *depth == self.depth) {
            self.value = value;
        }
        self.depth = self.depth.saturating_sub(1);
    }
}

impl<T> std::ops::Deref for Branched<T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.value
    }
}

impl<T: Copy> std::ops::DerefMut for Branched<T> {
    fn deref_mut(&mut self) -> &mut T {
        if self.saved.last().is_none_or(|(depth, _)| *depth < self.depth) {
            self.saved.push((self.depth, self.value));
        }
        &mut self.value
    }
}

/// Most corners of a polygon. Own: the time to divide one into triangles grows with the square of their number.
const MAX_CORNERS: usize = 20_000;

/// A polygon between `{` and `}`.
#[derive(Debug)]
struct Polygon {
    frame: TurtleFrame,
    corners: Vec<DVec3>,
}

/// The first symbols of a command of several symbols.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Prefix {
    None,
    At,
    /// `@D`, `@T`, `@b`, `@G`, `@P`, `@m`: another letter may follow.
    Letter(char),
    Organ,
    Query,
}

/// A warning, with the number of its occurrences.
#[derive(Debug)]
struct TurtleWarning {
    code: &'static str,
    /// Prefix and symbol concerned, for its place in the grammar.
    symbol: (Option<char>, char),
    message: String,
    help: String,
    /// Location in the grammar; `None`: the first occurrence of the symbol.
    span: Option<osier_base::diagnostic::Span>,
    count: u64,
}

/// Prototypes of an organ symbol, and their common scale.
#[derive(Debug, Clone, Copy)]
pub(super) struct OrganPrototypes {
    pub range: ProtoRange,
    /// Scale that gives the longest prototype its size at parameter 1.
    pub scale: f64,
}

/// Cosines and sines of the last angles, in degrees: most strings turn by a few angles.
#[derive(Debug, Clone, Copy)]
pub(super) struct AngleCache {
    /// Bits of an angle, its cosine and sine.
    known: [(u64, f64, f64); 4],
    /// Index of the entry that is replaced next.
    oldest: usize,
}

impl Default for AngleCache {
    fn default() -> Self {
        Self { known: [(0.0_f64.to_bits(), math::cos(0.0), math::sin(0.0)); 4], oldest: 0 }
    }
}

impl AngleCache {
    /// Cosine and sine of an angle in degrees.
    #[inline]
    pub fn cos_sin(&mut self, degrees: f64) -> (f64, f64) {
        let bits = degrees.to_bits();
        if let Some((_, cos, sin)) = self.known.iter().find(|known| known.0 == bits) {
            return (*cos, *sin);
        }
        let a = radians(degrees);
        let (cos, sin) = (math::cos(a), math::sin(a));
        self.known[self.oldest] = (bits, cos, sin);
        self.oldest = (self.oldest + 1) % self.known.len();
        (cos, sin)
    }
}

/// Scale and width outside of a sub-L-system, restored at its end.
#[derive(Debug, Clone, Copy)]
struct OuterSize {
    scale: f64,
    /// Diameter, turtle units.
    width: f64,
}

/// The interpreter: its state, the stack of brackets, and what it has drawn.
pub(super) struct Turtle<'a> {
    pub(super) grammar: &'a Grammar,
    pub(super) bindings: BindingEvaluator<'a>,
    pub(super) options: &'a TurtleOptions,
    /// The program whose turtle draws, with the settings of its file.
    pub(super) dialect: DialectTurtle,
    /// A command of LParser that waits for its number.
    pub(super) pending: PendingNumber,
    commands: Vec<Command>,
    /// How far the module that is drawn has grown.
    pub(super) growth: ModuleGrowth,
    /// What each module does, if that is recorded.
    pub(super) trace: Option<Box<DrawingTrace>>,
    pub(super) symbols: Vec<char>,
    pub(super) s: TurtleState,
    stack: Vec<TurtleState>,
    pub(super) rare: Branched<RareState>,
    polygons: Vec<Polygon>,
    /// The open cylinder of each bracket level.
    pub(super) cylinders: Vec<Option<OpenCylinder>>,
    pub(super) patches: TurtlePatches,
    /// Contours of the scene, and those that models of L-Py make, by their numbers.
    pub(super) contours: std::collections::BTreeMap<u32, Contour>,
    /// Curves of L-Py that have been guides.
    pub(super) guide_curves: std::collections::BTreeMap<u32, GuideCurve>,
    prefix: Prefix,
    /// Axis whose last segment still waits for its end width.
    open_segment: Option<u32>,
    /// Cosine and sine of a turn without parameter, and its angle in degrees.
    default_turn: (f64, f64),
    default_degrees: f64,
    pub(super) angles: AngleCache,
    pub builder: PlantBuilder,
    pub(super) shape_prototypes: PrototypeCache,
    /// Prototypes of organs by symbol and, if they take the turtle's colour, colour index; registered on first use.
    pub(super) organs: std::collections::BTreeMap<(char, Option<u8>), OrganPrototypes>,
    warnings: Vec<TurtleWarning>,
    max_stack: u64,
    max_nodes: u64,
    max_organs: u64,
    /// True once a limit was exceeded or a forbidden command was met: nothing more is drawn.
    pub(super) halted: bool,
    pub sets_widths: bool,
    /// Number of open brackets since a `%`, after which nothing is drawn; `None`: everything is drawn.
    cut: Option<usize>,
    /// Index in the string of the module that is drawn.
    pub(super) index: usize,
    /// True if the string is interpreted only to answer its queries.
    pub(super) asked: bool,
    /// Answers to the queries so far, in their order, and the bounds of what was drawn; positions are in turtle units.
    pub(super) answers: TurtleAnswers,
    /// State that each open sub-L-system returns to.
    subsystems: Vec<OuterSize>,
}

impl<'a> Turtle<'a> {
    pub fn new(
        grammar: &'a Grammar,
        bindings: BindingEvaluator<'a>,
        options: &'a TurtleOptions,
        limits: &Limits,
    ) -> Self {
        // Symbols are numbered by the grammar; their commands are looked up once, not per module.
        let symbols: Vec<char> = (0_u16..).take(grammar.symbols().len()).map(|i| grammar.symbols().get(i)).collect();
        // Turns without a parameter share one angle, whose sine and cosine are computed once.
        let settings = bindings.settings();
        let own_angle = settings.angle_deg.map(radians);
        let angle = options.angle.or(own_angle).unwrap_or(radians(45.0));
        let dialect = DialectTurtle::new(bindings.dialect(), settings, options.angle, bindings.last_step());
        let mut elasticity = [0.0; tropism::MAX_TROPISMS];
        for (e, t) in elasticity.iter_mut().zip(&options.tropisms) {
            *e = t.elasticity;
        }
        let s = TurtleState {
            p: DVec3::ZERO,
            frame: dialect.first_frame(),
            last: TurtleFrame::START,
            width: dialect.first_width(options.width.max(MIN_WIDTH)),
            scale: options.scale,
            color: dialect.first_color(options.color),
            painted: options.painted,
            turns: 0,
            attachment: Attachment { axis: None, parent: None, ordinal: 0 },
        };
        let rare = RareState {
            texture: None,
            cylinder: CylinderState {
                contour: 0,
                sides: options.sides,
                tangent: TANGENT,
                slopes: None,
                relative: false,
            },
            dialect: dialect.state(),
            elasticity,
            tropism_elasticity: options.old_elasticity,
        };
        // In the dialects of papers only bound symbols and brackets are commands.
        let command = |i: u16, c: char| match bindings.action(i) {
            Some(TurtleAction::SameAs(other)) => Command::from_symbol(*other),
            Some(_) => Command::Bound,
            None if dialect.kind.has_cpfg_commands() || matches!(c, '[' | ']') => Command::from_symbol(c),
            None => dialect.command(c, grammar.symbols().long_name(c)).map_or(Command::Nothing, Command::Dialect),
        };
        Self {
            grammar,
            options,
            dialect,
            pending: PendingNumber::default(),
            commands: (0_u16..).zip(&symbols).map(|(i, c)| command(i, *c)).collect(),
            growth: ModuleGrowth::WHOLE,
            trace: None,
            bindings,
            symbols,
            s,
            stack: Vec::new(),
            rare: Branched::new(rare),
            polygons: Vec::new(),
            cylinders: vec![None],
            patches: TurtlePatches::new(),
            contours: options.contours.clone(),
            guide_curves: std::collections::BTreeMap::new(),
            prefix: Prefix::None,
            open_segment: None,
            default_turn: (math::cos(angle), math::sin(angle)),
            default_degrees: angle.to_degrees(),
            angles: AngleCache::default(),
            builder: PlantBuilder::default(),
            shape_prototypes: PrototypeCache::default(),
            organs: std::collections::BTreeMap::new(),
            warnings: Vec::new(),
            max_stack: limits.get("turtle-stack"),
            max_nodes: limits.get("nodes"),
            max_organs: limits.get("organs"),
            halted: false,
            sets_widths: dialect.sets_widths(),
            cut: None,
            index: 0,
            asked: false,
            answers: TurtleAnswers::default(),
            subsystems: Vec::new(),
        }
    }

    /// Warns (L041) that parameter `i` of a module is not a usable number, at the place in the grammar that computes
    /// it.
    pub(super) fn warn_of_parameter(&mut self, m: Module<'_>, i: usize, message: String, help: &str) {
        let c = self.grammar.symbols().get(m.symbol);
        let known = self.warnings.len();
        self.warn("L041", (None, c), message, help);
        if let Some(new) = self.warnings.get_mut(known) {
            new.span = self.grammar.place_of_parameter(m.symbol, m.params.len(), i);
        }
    }

    pub(super) fn warn(&mut self, code: &'static str, symbol: (Option<char>, char), message: String, help: &str) {
        // One warning per code and symbol, with the number of its occurrences: a string may repeat a fault a million
        // times.
        match self.warnings.iter_mut().find(|r| r.code == code && r.symbol == symbol) {
            Some(r) => r.count += 1,
            None => {
                self.warnings.push(TurtleWarning { code, symbol, message, help: help.to_owned(), span: None, count: 1 })
            }
        }
    }

    fn halt(&mut self, code: &'static str, c: char, message: String, help: &str) {
        self.halted = true;
        self.warn(code, (None, c), message, help);
    }

    /// All warnings; an error if the interpretation was halted.
    pub fn diagnostics(&self) -> Result<Vec<Diagnostic>> {
        let list: Vec<Diagnostic> = self
            .warnings
            .iter()
            .map(|r| {
                // Warnings point at the first place of the symbol in the grammar.
                let times = if r.count > 1 { format!(", {} times", r.count) } else { String::new() };
                let span = r.span.unwrap_or_else(|| self.grammar.place_of(r.symbol.0, r.symbol.1));
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

    /// By symbol, what it does for the growth within a step.
    pub fn symbol_roles(&self) -> Vec<SymbolRole> {
        let bound = |i: u16| match self.bindings.action(i) {
            Some(TurtleAction::Forward | TurtleAction::Move) => SymbolRole::Step,
            Some(TurtleAction::RotateWorld(_) | TurtleAction::RotateTurtle(_)) => SymbolRole::Turn,
            _ => SymbolRole::Other,
        };
        let role = |(i, command): (u16, &Command)| match command {
            Command::Bound => bound(i),
            command => command.role(),
        };
        (0_u16..).zip(&self.commands).map(role).collect()
    }

    /// Interprets one module of a string whose modules have grown in part, and records what it does. `index`: index in the string of
    /// the module that `m` draws.
    pub fn growing_module(&mut self, m: Module<'_>, index: usize, growth: &[ModuleGrowth]) {
        self.growth = growth.get(index).copied().unwrap_or(ModuleGrowth::WHOLE);
        if let Some(trace) = &mut self.trace {
            trace.begin_module(index, self.s.p);
        }
        self.module(m);
    }

    /// Interprets one module; modules must come in the order of the string.
    #[inline]
    pub fn module(&mut self, m: Module<'_>) {
        if self.halted {
            return;
        }
        let i = usize::from(m.symbol);
        let (Some(&command), Some(&c)) = (self.commands.get(i), self.symbols.get(i)) else { return };
        if !self.options.past_cut && self.is_cut(c) {
            return;
        }
        if self.dialect.kind == Dialect::LParser {
            let own = if let Command::Dialect(d) = command { Some(d) } else { None };
            if self.read_number(own, c, m) {
                return;
            }
        }
        // Commands of several symbols are read by a small state machine: the prefix says what the symbols before this
        // one began.
        let is_read = match std::mem::replace(&mut self.prefix, Prefix::None) {
            Prefix::None => false,
            prefix => self.follow_prefix(prefix, c, m),
        };
        if !is_read {
            self.command(command, c, m);
        }
    }

    /// Interprets a symbol after the beginning of a command; false if the symbol does not belong to it.
    fn follow_prefix(&mut self, prefix: Prefix, c: char, m: Module<'_>) -> bool {
        match prefix {
            Prefix::None => return false,
            Prefix::At => self.at_command(c, m),
            Prefix::Letter(first) => return self.at_command_letter(first, c, m),
            Prefix::Organ => {
                let size = self.param(m, 0, 1.0) * self.growth.size;
                self.organ(c, size, m);
            }
            Prefix::Query => self.query(c),
        }
        true
    }

    /// Whether a symbol is cut: a `%`, or a symbol after one on the same branch. The bracket that closes the branch is not cut.
    fn is_cut(&mut self, c: char) -> bool {
        match (self.cut, c) {
            (None, '%') if self.dialect.kind.has_cpfg_commands() && self.prefix == Prefix::None => self.cut = Some(0),
            (None, _) => return false,
            (Some(open), '[') => self.cut = Some(open + 1),
            (Some(0), ']') => {
                self.cut = None;
                return false;
            }
            (Some(open), ']') => self.cut = Some(open - 1),
            (Some(_), _) => {}
        }
        true
    }

    /// Parameter `i`, or the default. A value that is not finite counts as 0 and is warned of (L041).
    #[inline]
    pub(super) fn param(&mut self, m: Module<'_>, i: usize, default: f64) -> f64 {
        match m.params.get(i) {
            None => default,
            Some(v) if v.is_finite() => f64::from(*v),
            Some(_) => {
                self.warn_of_infinite(m, i);
                0.0
            }
        }
    }

    /// Warns that parameter `i` of a module is not finite.
    #[cold]
    fn warn_of_infinite(&mut self, m: Module<'_>, i: usize) {
        let c = self.grammar.symbols().get(m.symbol);
        let message = format!("parameter {} of {c} is not finite and counts as 0", i + 1);
        let help = "look for a logarithm of 0, a root of a negative number, or a value that grows without end";
        self.warn_of_parameter(m, i, message, help);
    }

    /// Performs a command that is a single symbol, or records the prefix of a command of several symbols. Inlined into its only
    /// caller, since each module would be copied for the call.
    #[inline(always)]
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
                let length = self.param(m, 0, 1.0) * self.growth.length;
                self.step(length, m, draws, matches!(command, Command::Draw | Command::Move));
            }
            Command::Yaw(p) => self.turn(m, p, c, TurtleFrame::yaw),
            Command::Pitch(p) => self.turn(m, p, c, TurtleFrame::pitch),
            Command::Roll(p) => self.turn(m, p, c, TurtleFrame::roll),
            Command::TurnAround if self.growth.turn < 1.0 => {
                let (cos, sin) = self.angles.cos_sin(180.0 * self.growth.turn);
                self.s.frame.yaw(cos, sin);
            }
            Command::TurnAround => self.s.frame.yaw(-1.0, 0.0),
            // Ends a sub-L-system if one is open; otherwise acts as the textbook's `@v`.
            Command::Level => match self.subsystems.pop() {
                Some(OuterSize { scale, width }) => (self.s.scale, self.s.width) = (scale, width),
                None => self.s.frame.level(),
            },
            Command::Push => self.push_state(m),
            Command::Pop => self.pop_state(m),
            // Increments of `#` and `!` scale with the turtle, as a parameter does.
            Command::Width(up) => {
                let step = if up { self.options.width_increment } else { -self.options.width_increment };
                let scale = self.s.scale;
                let width = match m.params.first() {
                    Some(_) => self.param(m, 0, 0.0) * scale * self.growth.size,
                    None => self.s.width + step * scale,
                };
                self.set_width(width);
            }
            // Colour indices wrap at 256.
            Command::Color(up) => {
                let step = self.options.color_increment;
                let next = if up { self.s.color.wrapping_add(step) } else { self.s.color.wrapping_sub(step) };
                let value = self.param(m, 0, f64::from(next));
                self.set_color(color_index(value));
            }
            Command::OpenPolygon => {
                self.open_shape(m);
            }
            Command::Vertex if self.is_in_spline() => {
                let strips = self.strips(m, 1);
                self.cylinder_point(strips);
            }
            Command::Vertex => self.vertex(),
            Command::ClosePolygon if self.is_in_spline() => self.finish_cylinder(m),
            Command::ClosePolygon => self.fill_polygon(m),
            Command::TropismElasticity => {
                let raised = self.rare.tropism_elasticity + self.options.old_increment;
                self.rare.tropism_elasticity = self.param(m, 0, raised);
            }
            Command::At => self.prefix = Prefix::At,
            Command::Organ => self.prefix = Prefix::Organ,
            Command::Bound => self.apply_bound_action(m),
            Command::Dialect(d) => self.dialect_command(d, m),
            // `?(label,s)` begins a sub-L-system, which is drawn s times as large.
            Command::Query if !m.params.is_empty() => {
                let factor = self.param(m, 1, 1.0);
                self.subsystems.push(OuterSize { scale: self.s.scale, width: self.s.width });
                self.s.scale *= factor;
                self.s.width = (self.s.width * factor).max(MIN_WIDTH);
            }
            Command::Query => self.prefix = Prefix::Query,
            Command::Nothing => {}
        }
    }

    /// Records the answer to the query `?c`, positions in turtle units; warns (L008) of an unknown letter.
    fn query(&mut self, c: char) {
        let value = match c {
            'P' => self.s.p / self.options.unit_m,
            'H' => self.s.frame.h,
            'L' => self.s.frame.l,
            // cpfg's up vector is the opposite of U = H x L.
            'U' => -self.s.frame.u,
            // The rotation that turns the world's axes into right, heading and up.
            'Q' => {
                let q = self.s.frame.quat();
                let value = QueryValue::Rotation([q.x, q.y, q.z, q.w]);
                return self.answers.answers.push(QueryAnswer { module: self.index, value });
            }
            _ => {
                let message = format!("query '?{c}' is not supported");
                return self.warn(
                    "L008",
                    (Some('?'), c),
                    message,
                    "queries are ?P ?H ?L ?U ?Q; its parameters stay as they are",
                );
            }
        };
        self.answers.answers.push(QueryAnswer { module: self.index, value: QueryValue::Vector(value.to_array()) });
    }

    /// Gives the end of the current segment the current width.
    pub(super) fn close_segment(&mut self) {
        let Some(axis) = self.open_segment.take() else { return };
        // With tapered segments the end takes the width that the string has set since the segment was drawn.
        if self.options.tapered {
            self.builder.set_end_width(axis, self.s.width * self.options.unit_m);
        }
    }

    /// Completes what the string left unfinished: a waiting number, a command of two letters, the last segment, cylinders.
    pub fn end(&mut self) {
        self.run_pending();
        if let Prefix::Letter(first) = std::mem::replace(&mut self.prefix, Prefix::None) {
            self.at_command_without_letter(first, &[]);
        }
        self.close_segment();
        self.finish_cylinders();
    }

    #[inline]
    fn turn(&mut self, m: Module<'_>, positive: bool, c: char, f: impl FnOnce(&mut TurtleFrame, f64, f64)) {
        // The angle of the module in degrees, or the default angle of the scene.
        let (cos, sin) = if m.params.is_empty() {
            if self.options.angle.is_none() {
                let help = "give the turn a parameter, or the plant an angle: --set angle_deg=90, angle_deg below [plants.NAME.turtle], or a view beside the grammar";
                self.warn("L045", (None, c), "no angle given, 45 degrees assumed".into(), help);
            }
            match self.growth.turn {
                part if part < 1.0 => self.angles.cos_sin(self.default_degrees * part),
                _ => self.default_turn,
            }
        } else {
            let degrees = self.param(m, 0, 0.0) * self.growth.turn;
            self.angles.cos_sin(degrees)
        };
        f(&mut self.s.frame, cos, if positive { sin } else { -sin });
        self.count_turn();
    }

    /// Counts a turn; makes the frame orthonormal after many of them.
    pub(super) fn count_turn(&mut self) {
        self.s.turns += 1;
        if self.s.turns >= TURNS_PER_ORTHONORMALIZATION {
            self.s.turns = 0;
            self.s.frame.orthonormalize();
        }
    }

    pub(super) fn push_state(&mut self, m: Module<'_>) {
        if self.stack.len() as u64 >= self.max_stack {
            let help = "raise it with --max-turtle-stack, or close branches";
            return self.halt("L051", '[', format!("more than {} open branches", self.max_stack), help);
        }
        self.stack.push(self.s);
        self.rare.push();
        self.push_cylinder();
        self.s.attachment = Attachment { axis: None, parent: self.current_site(), ordinal: m.lineage() };
    }

    pub(super) fn pop_state(&mut self, m: Module<'_>) {
        if self.stack.is_empty() {
            let help = "every ']' needs a '[' before it";
            return self.warn("L053", (None, ']'), "unmatched ']' in the string".into(), help);
        }
        // A cylinder whose end is not marked ends with its branch.
        self.finish_cylinder(m);
        self.cylinders.pop();
        self.leave_axis();
        self.rare.pop();
        if let Some(s) = self.stack.pop() {
            self.s = s;
        }
    }

    /// The node at the turtle's position, which carries new branches and organs; `None` where a new root would begin.
    fn current_site(&self) -> Option<NodeSite> {
        // The last node of the current axis; before its first segment, the node that will carry the axis.
        let a = &self.s.attachment;
        a.axis.map(|axis| self.builder.site(axis)).or(a.parent)
    }

    /// Leaves the current axis. No saved state returns to it, because an axis belongs to one bracket level.
    fn leave_axis(&mut self) {
        if let Some(axis) = self.s.attachment.axis.take()
            // An axis whose last segment waits for its end width is closed at the end.
            && self.open_segment != Some(axis)
        {
            self.builder.close_axis(axis);
        }
    }

    /// Leaves the current axis, since the turtle moves without drawing: what is drawn next begins a new axis.
    fn leave_axis_by(&mut self, m: Module<'_>) {
        self.leave_axis();
        self.s.attachment.ordinal = m.lineage();
    }

    pub(super) fn set_width(&mut self, width: f64) {
        self.s.width = width.clamp(MIN_WIDTH, MAX_STEP);
        self.sets_widths = true;
    }

    /// Sets the colour index, which all parts drawn from here on take.
    pub(super) fn set_color(&mut self, index: u8) {
        (self.s.color, self.s.painted) = (index, true);
    }

    /// The colour index that drawn parts take; `None`: they take the materials of the plant.
    pub(super) fn worn_color(&self) -> Option<u8> {
        self.s.painted.then_some(self.s.color)
    }

    pub(super) fn polygon_count(&self) -> usize {
        self.polygons.len()
    }

    pub(super) fn open_polygon(&mut self) {
        self.polygons.push(Polygon { frame: self.s.frame, corners: Vec::new() });
    }

    pub(super) fn vertex(&mut self) {
        self.vertex_at(self.s.p);
    }

    /// Adds a corner to the innermost unfinished polygon; ignored outside of polygons.
    pub(super) fn vertex_at(&mut self, p: DVec3) {
        let Some(polygon) = self.polygons.last_mut() else { return };
        if polygon.corners.len() >= MAX_CORNERS {
            let message = format!("a polygon of more than {MAX_CORNERS} corners");
            return self.halt("L051", '{', message, "close it earlier with '}', or draw the outline without a polygon");
        }
        polygon.corners.push(p);
    }

    /// Moves ahead by `length` (turtle units), bent by the tropisms before the step and by the old tropism after it.
    pub(super) fn step(&mut self, length: f64, m: Module<'_>, draws: bool, adds_vertex: bool) {
        let mut length = length * self.s.scale * self.options.unit_m;
        if length.abs() > MAX_STEP || length.is_nan() {
            let c = self.grammar.symbols().get(m.symbol);
            let message = format!("a step of {c} is longer than {MAX_STEP:e} m and counts as 0");
            let help = "look for a length, or a scale of @D, that grows without end";
            self.warn_of_parameter(m, 0, message, help);
            length = 0.0;
        }
        // Directional growth responses turn the heading before the step.
        let tropisms = &self.options.tropisms;
        if !tropisms.is_empty() {
            let (s, rare, keep_roll) = (&mut self.s, &*self.rare, self.options.tropism_keep_roll);
            tropism::apply_tropisms(&mut s.frame, &s.last, tropisms, &rare.elasticity, keep_roll);
        }
        let from = self.s.p;
        self.s.p += self.s.frame.h * length;
        if draws && self.asked {
            for p in [from, self.s.p] {
                let p = (p / self.options.unit_m).to_array();
                let [least, greatest] = &mut self.answers.bounds;
                for (k, x) in p.into_iter().enumerate() {
                    (least[k], greatest[k]) = (least[k].min(x), greatest[k].max(x));
                }
            }
        }
        if let Some(trace) = &mut self.trace {
            trace.step(from, self.s.p, &self.s.frame);
        }
        // If a cylinder is open here, it is the stem, and no segment is drawn.
        let is_stem = self.cylinder().is_some();
        // A drawn step extends the current axis. A jump ends it: what is drawn next begins a new axis.
        if draws && !is_stem {
            self.segment(from, m);
            self.s.last = self.s.frame;
        } else {
            if draws {
                self.s.last = self.s.frame;
            }
            self.leave_axis_by(m);
        }
        if self.rare.tropism_elasticity.abs() > 0.0 {
            tropism::apply_tropism_after_step(
                &mut self.s.frame,
                self.options.old_tropism,
                self.rare.tropism_elasticity,
            );
        }
        if adds_vertex {
            self.step_point();
            self.vertex();
        }
    }

    /// Draws a segment from `from` to the current position: extends the current axis or opens one.
    fn segment(&mut self, from: DVec3, m: Module<'_>) {
        // A segment adds at most two nodes: an axis opens with its base as well.
        if self.builder.node_count() + 2 > self.max_nodes {
            let message = format!("more than {} nodes", self.max_nodes);
            return self.halt("L051", 'F', message, "raise it with --max-nodes, or shorten the derivation");
        }
        let left = self.s.frame.l;
        let width = self.s.width * self.options.unit_m;
        let color = u16::from(self.s.color) | if self.s.painted { PAINTED } else { 0 };
        // The first segment of a bracket level opens an axis at the node where the bracket began.
        let step = self.trace.as_ref().map_or(NONE, |trace| trace.last_step());
        let node = DrawnNode { p: self.s.p, left, birth: m.birth, color, step };
        let axis = match self.s.attachment.axis {
            Some(axis) => axis,
            None => {
                let a = self.s.attachment;
                let axis = self.builder.begin_axis(a.parent, a.ordinal, DrawnNode { p: from, ..node });
                self.s.attachment.axis = Some(axis);
                axis
            }
        };
        self.open_segment = Some(axis).filter(|_| self.builder.extend(axis, node, width));
    }

    /// Moves without drawing, by a vector in m.
    pub(super) fn jump(&mut self, by: DVec3, m: Module<'_>) {
        self.jump_to(self.s.p + by, m);
    }

    /// Moves to a point of plant space without drawing; what is drawn next begins a new axis.
    pub(super) fn jump_to(&mut self, to: DVec3, m: Module<'_>) {
        self.s.p = to;
        self.leave_axis_by(m);
    }

    pub(super) fn pose(&self) -> TurtlePose {
        TurtlePose { p: self.s.p, q: self.s.frame.quat() }
    }

    /// Adds an organ at `pose`, carried by the current node.
    pub(super) fn place_organ(&mut self, pose: TurtlePose, protos: ProtoRange, size: OrganSize, m: Module<'_>) {
        if self.builder.organ_count() >= self.max_organs {
            let message = format!("more than {} organs", self.max_organs);
            return self.halt("L051", '~', message, "raise it with --max-organs, or shorten the derivation");
        }
        let site = self.current_site();
        if let Some(trace) = &mut self.trace {
            trace.organ(pose, size);
        }
        self.builder.add_organ(RawOrgan { site, pose, size, protos, lineage: m.lineage(), birth: m.birth });
    }

    pub(super) fn too_many_prototypes(&mut self, c: char) {
        self.halt("L051", c, "more than 65,535 different shapes".into(), "draw shapes that differ less");
    }

    pub(super) fn fill_polygon(&mut self, m: Module<'_>) {
        let Some(polygon) = self.polygons.pop() else { return };
        let Some(&p) = polygon.corners.first() else { return };
        // A polygon becomes an organ whose pivot is its first corner, in the frame of the turtle at `{`.
        let pose = TurtlePose { p, q: polygon.frame.quat() };
        let material = self.shape_material(true);
        match self.shape_prototypes.polygon(&mut self.builder.protos, material, &polygon.corners, pose) {
            Ok(Some(PolygonPrototype { proto, size })) => {
                self.place_organ(pose, ProtoRange::single(proto), OrganSize { scale: size, petiole: 0.0 }, m);
            }
            Ok(None) => {}
            Err(TooManyPrototypes) => self.too_many_prototypes('}'),
        }
    }

    /// Interprets the symbol after `@`.
    fn at_command(&mut self, c: char, m: Module<'_>) {
        match c {
            'v' => self.s.frame.level(),
            // Absolute position: what is drawn next begins a new axis, since the jump is no part of the plant.
            'M' => {
                let [x, y, z] = [0, 1, 2].map(|i| self.param(m, i, 0.0));
                self.s.p = DVec3::new(x, y, z) * self.options.unit_m;
                self.leave_axis_by(m);
            }
            'R' => {
                let v = [0, 1, 2, 3, 4, 5].map(|i| self.param(m, i, 0.0));
                // Up in cpfg's convention, which is the opposite of U = H x L.
                let up = (m.params.len() >= 5).then(|| -DVec3::new(v[3], v[4], v[5]));
                let last = self.s.last;
                self.s.frame.set(DVec3::new(v[0], v[1], v[2]), up, &last);
            }
            'o' | 'c' | 'O' => self.disc_or_sphere(c, m),
            // No export format has a colour for the reverse side.
            ';' | ',' => {}
            '#' => self.rare.cylinder.contour = self.strips_or(m, 0),
            '!' => self.rare.cylinder.sides = self.strips_or(m, self.options.sides).clamp(3, 256),
            'D' | 'T' if !m.params.is_empty() => self.at_command_without_letter(c, m.params),
            'D' | 'T' | 'b' | 'G' | 'P' | 'm' => self.prefix = Prefix::Letter(c),
            // A label is an annotation of cpfg's window; plants have none.
            'L' => {}
            'S' => {
                let message = "command '@S' is not available in grammars".to_owned();
                self.halted = true;
                self.warn("L043", (Some('@'), c), message, "remove it: grammars start no programs");
            }
            // cpfg itself draws nothing for them in its window.
            'I' | 'J' => {
                let message = format!("command '@{c}' inserts objects of rayshade and has no effect");
                self.warn("L008", (Some('@'), c), message, "remove it; `[[place]]` puts meshes into a scene");
            }
            _ => self.warn("L008", (Some('@'), c), format!("command '@{c}' is not supported"), "nothing is drawn"),
        }
    }

    /// Interprets `@D` or `@T` without a further letter; other commands of two letters are ignored without their second
    /// letter.
    fn at_command_without_letter(&mut self, first: char, params: &[f32]) {
        let given = params.len();
        let value = |i: usize| params.get(i).map(|v| f64::from(*v)).filter(|v| v.is_finite()).unwrap_or(0.0);
        match first {
            'D' if given > 0 => self.s.scale = value(0),
            'D' => self.s.scale = self.options.scale,
            'T' => self.add_elasticity(if given > 0 { value(0) } else { 1.0 }, (given > 1).then(|| value(1)), 1.0),
            _ => {}
        }
    }

    /// Adds to the elasticity of tropism number `i`: `sign` times `e`, or `sign` times the tropism's step without `e`.
    fn add_elasticity(&mut self, i: f64, e: Option<f64>, sign: f64) {
        let Some(k) = self.tropism_index(i) else { return };
        let step = e.unwrap_or_else(|| self.options.tropisms.get(k).map_or(0.0, |t| t.step));
        self.rare.elasticity[k] += sign * step;
    }

    /// Index of tropism number `i`, counted from 1; warns (L048) of an unknown number.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates; the range is checked next")]
    fn tropism_index(&mut self, i: f64) -> Option<usize> {
        // Scenes and grammars count tropisms from 1; a number below 1 wraps and fails the range test.
        let k = (i as usize).wrapping_sub(1);
        if k < self.options.tropisms.len().min(tropism::MAX_TROPISMS) {
            return Some(k);
        }
        let message = format!("tropism {i} is unknown, {} defined", self.options.tropisms.len());
        self.warn("L048", (Some('@'), 'T'), message, "add it to `tropisms` of the scene's turtle");
        None
    }

    /// Interprets the second letter after `@`; false if the symbol does not belong to the command.
    fn at_command_letter(&mut self, first: char, c: char, m: Module<'_>) -> bool {
        match (first, c) {
            ('D', 'i' | 'd') => {
                let factor = self.param(m, 0, self.options.scale_multiplier);
                match c {
                    'i' => self.s.scale *= factor,
                    _ if factor.abs() > 0.0 => self.s.scale /= factor,
                    _ => {}
                }
            }
            ('T', 's') => {
                let (i, e) = (self.param(m, 0, 1.0), self.param(m, 1, 0.0));
                if let Some(k) = self.tropism_index(i) {
                    self.rare.elasticity[k] = e;
                }
            }
            ('T', 'i' | 'd') => {
                let (i, e) = (self.param(m, 0, 1.0), self.param(m, 1, 0.0));
                let sign = if c == 'i' { 1.0 } else { -1.0 };
                self.add_elasticity(i, (m.params.len() > 1).then_some(e), sign);
            }
            ('T', 'p') => self.s.frame = self.s.last.with_heading(self.s.frame.h),
            // The roll since the last segment counts as part of that segment: the tropism of the next segment starts
            // from here.
            ('T', 'f') => self.s.last = self.s.frame,
            ('T', 'x') => self.set_texture(m),
            ('D' | 'T', _) => {
                self.at_command_without_letter(first, &[]);
                return false;
            }
            _ if self.extended_command(first, c, m) => {}
            _ => {
                // The two letters tell one such command from another.
                let message = format!("'@{first}{c}': this command is not supported");
                self.warn("L008", (Some(first), c), message, "nothing is drawn");
            }
        }
        true
    }
}

/// Index of a colour number: truncated, modulo 256.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "reduced to 0..256 before the cast")]
pub(super) fn color_index(value: f64) -> u8 {
    value.trunc().rem_euclid(256.0) as u8
}

#[cfg(test)]
mod tests {
    use super::Branched;

    #[test]
    fn branches_return_to_what_they_began_with() {
        let mut value = Branched::new(1);
        value.push();
        *value = 2;
        value.push();
        value.push();
        *value = 3;
        *value = 4;
        value.pop();
        assert_eq!(*value, 2);
        value.pop();
        assert_eq!(*value, 2, "this branch changed nothing");
        *value = 5;
        value.pop();
        assert_eq!(*value, 1);
        *value = 6;
        value.push();
        value.pop();
        assert_eq!(*value, 6);
    }
}
