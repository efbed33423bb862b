//! Productions: heads, the ways through their statements, and what each way becomes.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use super::bounds::{Bounds, mentions};
use super::expression::{PyExpr, PyOp, Refusal, Scope, UNKNOWN};
use super::expression::{arguments, compile, first_call, has_random, model_name, parse, plain_name, range_of, resolve};
use super::expression::{size_with, substitute};
use super::lists::{changes, is_change, names_held};
use super::statement::{GROUP, Statement, assigned, call_in, in_turn, is_written_out, only_computes};
use super::statement::{read_name, renamed, with_lists, without_call};
use super::strings::{PyModule, Spelled, spell};
use super::{Line, Model, Section, block_after, colon, shifted, strings};
use crate::code::{Bytecode, Expr, Op, UnaryOp, is_zero};
use crate::dialect::text::Piece;
use crate::program::{ContextElement, FormalModule, Production, SuccessorModule};
use crate::token::SourcePlace;
use crate::vm;

/// Most ways through one production, and most statements of one way.
const MAX_WAYS: usize = 512;
const MAX_STEPS: usize = 20_000;
/// Upper limit on the turns of a loop whose end is not constant, but bounded.
const MAX_COUNTED: f64 = 100.0;
/// Turns that are read of a loop whose end has no known bound.
const MAX_UNKNOWN: u32 = 64;
/// Turns of a `while` whose tests are known, which are written out.
const MAX_KNOWN_TURNS: u32 = 2_000;
/// Most calls, on one way, of functions that are more than one expression.
const MAX_CALLS: usize = 256;
/// Most modules of the successor of one way; a production that makes more is refused.
const MAX_MODULES: usize = 1 << 20;

/// Appends a test and a place for the jump where it is 0; returns that place.
fn push_test(ops: &mut Vec<Op>, test: &Bytecode) -> usize {
    let offset = ops.len();
    ops.extend(test.ops.iter().map(|op| shifted(*op, offset)));
    ops.push(Op::Pop);
    ops.len() - 1
}

/// The end of `range(end)`.
fn range_end(list: &PyExpr) -> Option<PyExpr> {
    match list {
        PyExpr::Call(name, args, _) if name.ends_with("range") && args.len() == 1 => args.first().cloned(),
        _ => None,
    }
}

/// Beginning, end and positive step of a `range(..)`.
fn range_of_loop(list: &PyExpr) -> Option<(PyExpr, PyExpr, f64)> {
    let PyExpr::Call(name, args, _) = list else { return None };
    if !name.ends_with("range") {
        return None;
    }
    match args.as_slice() {
        [end] => Some((PyExpr::Number(0.0), end.clone(), 1.0)),
        [from, end] => Some((from.clone(), end.clone(), 1.0)),
        [from, end, PyExpr::Number(step)] if *step > 0.0 => Some((from.clone(), end.clone(), *step)),
        _ => None,
    }
}

/// A loop over `range(from, end, step)` as one over a range from 0.
struct CountedRange {
    /// Sets the variable of the beginning, which the turns may read.
    begin: Statement,
    /// `range(turns)`.
    turns: PyExpr,
    /// Variable of the number of the turn.
    name: String,
    /// Value of the variable of the model's loop in a turn.
    value: PyExpr,
}

/// The arguments of a module, `*list` replaced by the items of the list.
fn spread(args: &[PyExpr], scope: &Scope) -> Result<Vec<PyExpr>, Refusal> {
    let mut out = Vec::with_capacity(args.len());
    for arg in args {
        match arg {
            PyExpr::Call(star, list, range) if star == "*" => {
                match list.first().map(|l| resolve(l, scope, 0)).transpose()? {
                    Some(PyExpr::List(items, _)) => out.extend(items),
                    _ => return Err(Refusal::new("'*' before something other than a list", range.clone())),
                }
            }
            _ => out.push(arg.clone()),
        }
    }
    Ok(out)
}

/// One step of a way through a production: an assignment, or a condition with the value it has on this way.
#[derive(Debug, Clone)]
pub(super) enum Step {
    Assign(String, PyExpr),
    Condition(PyExpr, bool),
    /// A `while` loop of statements that only compute.
    Loop(PyExpr, Vec<Statement>, Range<usize>),
}

impl Step {
    fn assigns(&self, name: &str) -> bool {
        match self {
            Self::Assign(n, _) => n == name,
            Self::Condition(..) => false,
            Self::Loop(_, body, _) => names_of(body).0.iter().any(|n| n == name),
        }
    }

    /// True if an expression reads a variable that the step assigns.
    fn changes(&self, e: &PyExpr) -> bool {
        match self {
            Self::Assign(name, _) => mentions(e, name),
            Self::Condition(..) => false,
            Self::Loop(_, body, _) => names_of(body).0.iter().any(|name| mentions(e, name)),
        }
    }
}

/// An expression with the values of the variables of a way, which hide those of the model; [`UNKNOWN`] stands for one whose value
/// is not known, so that what reads it is not constant.
fn in_way(e: &PyExpr, way: &Way) -> PyExpr {
    let names: Vec<String> = way.known.keys().cloned().collect();
    let unknown = || PyExpr::Name(UNKNOWN.to_owned(), 0..0);
    let values: Vec<PyExpr> = way.known.values().map(|v| v.map_or_else(unknown, PyExpr::Number)).collect();
    substitute(e, &names, &values)
}

/// An expression with the values of those variables of a way whose values are known.
fn with_known(e: &PyExpr, way: &Way) -> PyExpr {
    let known = way.known.iter().filter_map(|(name, value)| Some((name.clone(), PyExpr::Number((*value)?))));
    let (names, values): (Vec<String>, Vec<PyExpr>) = known.unzip();
    substitute(e, &names, &values)
}

/// Names that statements assign, and names that they declare `global`.
fn names_of(statements: &[Statement]) -> (Vec<String>, Vec<String>) {
    let (mut names, mut globals) = (Vec::new(), Vec::new());
    assigned(statements, &mut names, &mut globals);
    (names, globals)
}

/// Jumps of a loop whose targets are known at its end.
#[derive(Debug, Default)]
struct LoopJumps {
    breaks: Vec<usize>,
    continues: Vec<usize>,
}

/// A way through a production: what it computes, and what it makes.
#[derive(Debug, Clone, Default)]
pub(super) struct Way {
    pub steps: Vec<Step>,
    pub modules: Vec<PyModule>,
    produced: bool,
    /// Names declared `global` on the way.
    globals: Vec<String>,
    /// Variables that the way has assigned, with their values where these are numbers whatever the parameters are.
    known: BTreeMap<String, Option<f64>>,
    /// Variables that the way has set to lists, which stand where the names are read.
    pub lists: BTreeMap<String, PyExpr>,
    /// Those of them, and lists of the model, that have two names.
    pub shared_lists: BTreeSet<String>,
    /// What its conditions leave of the values of its variables.
    bounds: Bounds,
    /// How many functions it has called.
    calls: usize,
}

impl Way {
    /// Names declared `global` on the way that it also assigns.
    fn written(&self) -> Vec<&String> {
        let assigns = |name: &String| self.steps.iter().any(|s| s.assigns(name));
        self.globals.iter().filter(|g| assigns(g)).collect()
    }

    /// True if it reads a variable that it does not set.
    fn misses(&self, name: &str) -> bool {
        let is_set = self.known.contains_key(name) || self.lists.contains_key(name);
        let reads = |step: &Step| match step {
            Step::Assign(_, e) | Step::Condition(e, _) => mentions(e, name),
            Step::Loop(test, body, _) => mentions(test, name) || read_name(body, name),
        };
        let is_read =
            || self.steps.iter().any(reads) || self.modules.iter().flat_map(|m| &m.args).any(|arg| mentions(arg, name));
        !is_set && is_read()
    }

    /// Where its modules are written, for messages.
    fn range(&self) -> Range<usize> {
        self.modules.first().map_or(0..0, |m| m.range.clone())
    }
}

/// Predecessor and contexts of a production, before its statements.
struct Head {
    left: Vec<ContextElement>,
    formals: Vec<FormalModule>,
    right: Vec<ContextElement>,
    new_left: Vec<ContextElement>,
    new_right: Vec<ContextElement>,
    /// What the parameters of its modules must be.
    conditions: Vec<PyExpr>,
    place: SourcePlace,
}

/// The parts of `left < new left << predecessor >> new right > right`, of which all but the predecessor may be missing. The sign
/// next to a context says which one it is, so that their order is free.
struct HeadParts<'t> {
    left: Option<Piece<'t>>,
    new_left: Option<Piece<'t>>,
    predecessor: Piece<'t>,
    new_right: Option<Piece<'t>>,
    right: Option<Piece<'t>>,
}

impl<'t> HeadParts<'t> {
    fn new(head: Piece<'t>) -> Self {
        let mut parts = Self { left: None, new_left: None, predecessor: head, new_right: None, right: None };
        let bytes = head.text.as_bytes();
        let (mut depth, mut begin, mut i) = (0_usize, 0, 0);
        // The sign before the part that begins at `begin`, if it is one of the right side.
        let mut sign: Option<&str> = None;
        while i <= bytes.len() {
            let c = bytes.get(i).copied();
            depth = (depth + usize::from(c == Some(b'('))).saturating_sub(usize::from(c == Some(b')')));
            let ends = c.is_none() || (depth == 0 && matches!(c, Some(b'<' | b'>')));
            if !ends {
                i += 1;
                continue;
            }
            let length = if c.is_some() && bytes.get(i + 1).copied() == c { 2 } else { 1 };
            let piece = head.up_to(i).from(begin);
            match (sign, c) {
                (None, Some(b'<')) if length == 2 => parts.new_left = Some(piece),
                (None, Some(b'<')) => parts.left = Some(piece),
                (None, _) => parts.predecessor = piece,
                (Some(">>"), _) => parts.new_right = Some(piece),
                (Some(_), _) => parts.right = Some(piece),
            }
            if c == Some(b'>') {
                sign = Some(if length == 2 { ">>" } else { ">" });
            }
            begin = i + length;
            i = begin;
            if c.is_none() {
                break;
            }
        }
        parts
    }
}

impl Model<'_, '_> {
    /// A production: `head --> successor`, or `head:` with statements.
    pub(super) fn rule(&mut self, list: &[Line<'_>], i: usize) {
        let Some(Line { indent, piece }) = list.get(i).copied() else { return };
        let (block, _) = block_after(list, i, indent);
        // Variables of one production are unknown in the next.
        self.scope.locals.clear();
        let arrow = ["-static->", "-->"].iter().find_map(|a| piece.text.find(a).map(|i| (i, i + a.len())));
        let (head, condition, statements) = if let Some((from, to)) = arrow {
            let head = piece.up_to(from);
            let (head, condition) = match colon(head) {
                Some(c) => (head.up_to(c), Some(head.from(c + 1).trimmed()).filter(|c| c.text != "*")),
                None => (head, None),
            };
            let successor = self.modules_of(piece.from(to).trimmed(), block);
            (head, condition, successor.map(|modules| vec![Statement::Produce(modules, true)]))
        } else {
            let c = colon(piece).unwrap_or(piece.text.len());
            let inline = piece.from(c + 1).trimmed();
            let statements = if inline.text.is_empty() {
                self.statements(block)
            } else {
                self.statements(&[Line { indent: 0, piece: inline }])
            };
            (piece.up_to(c), None, statements)
        };
        if self.group.abs() > 0.0 && !self.uses_groups {
            let place = self.reader.place(piece.range());
            let message = format!("production of group {}, which nothing activates", self.group);
            self.reader.session.warning(
                "L008",
                message,
                place,
                "call useGroup() in StartEach(), or move it after 'endgroup'",
            );
            return;
        }
        let Some(statements) = self.settle(statements) else { return };
        // With `*args` there is a production for each number of parameters that the model gives the module.
        for star in self.star_lengths(head) {
            self.star = star;
            self.scope.locals.clear();
            if self.rule_of(head, condition, statements.clone()).is_none() {
                break;
            }
        }
        for name in std::mem::take(&mut self.rule_lists) {
            self.scope.lists.remove(&name);
        }
    }

    /// Numbers of parameters that the `*args` of a head may stand for; a single 0 without one.
    fn star_lengths(&self, head: Piece<'_>) -> Vec<usize> {
        // Signs of contexts are no names of modules.
        let plain = head.text.replace(['<', '>'], " ");
        let Ok(spelled) = spell(Piece::new(head.at, &plain), &self.declared) else { return vec![0] };
        for s in spelled {
            let Some(params) = s.params.filter(|p| p.last().is_some_and(|p| p.text.starts_with('*'))) else { continue };
            let fixed = params.len() - 1;
            let known = self.arities.iter().filter(|(name, _)| *name == s.name);
            let lengths: Vec<usize> = known.filter_map(|(_, n)| n.checked_sub(fixed)).collect();
            return if lengths.is_empty() { vec![0] } else { lengths };
        }
        vec![0]
    }

    /// The productions of one reading of a head; `None` after an error.
    fn rule_of(&mut self, head: Piece<'_>, condition: Option<Piece<'_>>, mut statements: Vec<Statement>) -> Option<()> {
        let heads = self.heads(head);
        let head = self.settle(heads)?;
        if let Some(condition) = condition {
            let test = self.test(condition);
            let test = self.settle(test)?;
            // `head : condition --> successor` is `head: if condition: produce successor`.
            statements = vec![Statement::If(vec![(test, statements)], Vec::new())];
        }
        if let Some(test) = head.conditions.iter().cloned().reduce(|a, b| PyExpr::And(Box::new(a), Box::new(b))) {
            statements = vec![Statement::If(vec![(test, statements)], Vec::new())];
        }
        let (mut names, mut globals) = (Vec::new(), Vec::new());
        assigned(&statements, &mut names, &mut globals);
        if names.iter().any(|n| n == GROUP) {
            let why = Refusal::new(
                "'useGroup()' in a production",
                head.place.span.start as usize..head.place.span.end as usize,
            );
            self.refuse(&why.remedy("call it in StartEach(), which runs before each step"));
            return None;
        }
        // Productions of a group wait for its number.
        if self.group.abs() > 0.0 {
            let active = PyExpr::Name(GROUP.to_owned(), 0..0);
            let is = PyExpr::Binary(PyOp::Eq, Box::new(active), Box::new(PyExpr::Number(self.group)));
            statements = vec![Statement::If(vec![(is, statements)], Vec::new())];
        }
        let ways = self.ways(&statements);
        let ways = self.settle(ways)?;
        // A way without modules still assigns variables of the model; the next production is tried after it.
        let applied: Vec<&Way> = ways.iter().filter(|w| w.produced || !w.written().is_empty()).collect();
        // A variable that only other ways set has no value: L-Py ends with an error on such a way.
        names.retain(|name| !globals.contains(name) && !self.scope.locals.contains(name));
        let unset: Vec<Option<&String>> =
            applied.iter().map(|way| names.iter().find(|name| way.misses(name))).collect();
        let is_any_whole = unset.iter().any(Option::is_none);
        for name in unset.iter().flatten().filter(|_| is_any_whole).collect::<BTreeSet<_>>() {
            let message = format!("'{name}' has no value on a way through this production, which is left out");
            let help = "set it before the 'if' or the loop: L-Py ends with an error there";
            self.reader.session.warning("L008", message, head.place, help);
        }
        for (way, unset) in applied.iter().zip(&unset) {
            if unset.is_some() && is_any_whole {
                continue;
            }
            if let Some(production) = self.production(&head, way) {
                let program = &mut self.reader.program;
                match self.section {
                    Section::Decomposition => program.decomposition.list.push(production),
                    Section::Interpretation => program.homomorphism.list.push(production),
                    Section::Rules | Section::Header => program.rules.list.push(production),
                }
            }
        }
        Some(())
    }

    /// Left context, predecessor and right context, whose parameters become local variables.
    fn heads(&mut self, head: Piece<'_>) -> Result<Head, Refusal> {
        let parts = HeadParts::new(head);
        if (parts.new_left.is_some() || parts.new_right.is_some()) && self.section != Section::Rules {
            let why = "a context of the new string ('<<', '>>') outside of productions";
            return Err(Refusal::new(why, head.range()));
        }
        let predecessor = parts.predecessor;
        let place = self.reader.place(predecessor.trimmed().range());
        let mut formals = Vec::new();
        let mut conditions = Vec::new();
        for e in self.elements(predecessor.trimmed(), &mut conditions)? {
            match e {
                ContextElement::Module(f) => formals.push(f),
                _ => return Err(Refusal::new("brackets as the predecessor of a production", predecessor.range())),
            }
        }
        if formals.is_empty() {
            return Err(Refusal::new("a production without predecessor", head.range()));
        }
        // A single `*` is no context.
        let mut context = |model: &mut Self, piece: Option<Piece<'_>>| match piece.map(|p| p.trimmed()) {
            Some(p) if p.text != "*" => model.elements(p, &mut conditions),
            _ => Ok(Vec::new()),
        };
        let left = context(self, parts.left)?;
        let right = context(self, parts.right)?;
        let new_left = context(self, parts.new_left)?;
        let new_right = context(self, parts.new_right)?;
        Ok(Head { left, formals, right, new_left, new_right, conditions, place })
    }

    fn elements(&mut self, piece: Piece<'_>, conditions: &mut Vec<PyExpr>) -> Result<Vec<ContextElement>, Refusal> {
        let spelled = spell(piece, &self.declared)?;
        let mut out = Vec::new();
        let mut list = spelled.into_iter().peekable();
        while let Some(s) = list.next() {
            match s.name.as_str() {
                "[" => out.push(ContextElement::Open),
                // The other way round than in cpfg: a bracket skips the rest of its branch, `=]` does not.
                "]" => out.push(ContextElement::CloseRest),
                "=" if list.peek().is_some_and(|n| n.name == "]") => {
                    list.next();
                    out.push(ContextElement::Close);
                }
                "*" => {
                    let why = Refusal::new("'*', which stands for any module", s.range);
                    return Err(why.remedy("write one production for each module that it stands for"));
                }
                "?R" | "?F" => return Err(strings::frame_query(&s.name, s.range)),
                _ => out.push(ContextElement::Module(self.formal(&s, conditions)?)),
            }
        }
        Ok(out)
    }

    /// A module of a head: its parameters are names, names with a condition `x if x > 2`, or constants that they must equal.
    fn formal(&mut self, s: &Spelled<'_>, conditions: &mut Vec<PyExpr>) -> Result<FormalModule, Refusal> {
        let place = self.reader.place(s.range.clone());
        let slot = u16::try_from(self.scope.locals.len());
        let slot = slot.map_err(|_| Refusal::new("more than 65,535 parameters", s.range.clone()))?;
        let params = s.params.as_deref().unwrap_or(&[]);
        let list = |names: &[String]| {
            PyExpr::List(names.iter().map(|n| PyExpr::Name(n.clone(), s.range.clone())).collect(), s.range.clone())
        };
        // A query has three numbers, which one name holds as a vector: `?P(v)` has `v.x` and `v[0]`.
        let is_vector = strings::QUERIES.contains(&s.name.as_str()) && params.len() < 3;
        // `A(x, *args)` takes whatever number of parameters there is beyond the first: `star` in this reading of the head.
        let star = params.last().filter(|p| p.text.starts_with('*') && !p.text.starts_with("**"));
        let plain = if is_vector { &[][..] } else { &params[..params.len() - usize::from(star.is_some())] };
        for p in plain {
            let (name, condition) = match p.text.find(" if ") {
                Some(i) => (p.up_to(i).trimmed(), Some(p.from(i + " if ".len()).trimmed())),
                None => (*p, None),
            };
            let mut chars = name.text.chars();
            let is_name = chars.next().is_some_and(|c| c.is_alphabetic() || c == '_')
                && chars.all(|c| c.is_alphanumeric() || c == '_');
            // A name that an earlier parameter has is no new one, and is refused below.
            if is_name && !self.scope.locals.iter().any(|l| l == name.text) {
                self.scope.locals.push(name.text.to_owned());
                conditions.extend(condition.map(|c| self.test(c)).transpose()?);
                continue;
            }
            // Without a new name only a constant is left, which the parameter must equal.
            let constant = parse(name).ok().and_then(|e| compile(&e, &self.scope).ok());
            let constant =
                constant.and_then(|code| vm::constant_value(&code)).filter(|_| !is_name && condition.is_none());
            let Some(value) = constant else {
                return Err(Refusal::new(format!("'{}' as the name of a parameter", p.text), p.range()));
            };
            // The constant gets a variable that no model can name, so that slots go on in the order of the parameters.
            let hidden = format!("(parameter {})", self.scope.locals.len());
            self.scope.locals.push(hidden.clone());
            let own = Box::new(PyExpr::Name(hidden, p.range()));
            conditions.push(PyExpr::Binary(PyOp::Eq, own, Box::new(PyExpr::Number(value))));
        }
        let mut arity = plain.len();
        let mut group = None;
        if is_vector {
            let name = params.first().map_or("(query)", |p| p.text);
            group = Some((name.to_owned(), ["x", "y", "z"].map(|axis| format!("{name}.{axis}")).to_vec()));
        } else if let Some(star) = star {
            let name = star.text.trim_start_matches('*').trim();
            group = Some((name.to_owned(), (0..self.star).map(|k| format!("{name} ({k})")).collect()));
        }
        if let Some((name, names)) = group {
            self.scope.lists.insert(name.clone(), list(&names));
            self.rule_lists.push(name);
            arity += names.len();
            self.scope.locals.extend(names);
        }
        let arity = u8::try_from(arity).map_err(|_| Refusal::new("more than 255 parameters", s.range.clone()))?;
        let symbol = self.symbol(&s.name).ok_or_else(|| Refusal::new("more than 65,535 symbols", s.range.clone()))?;
        Ok(FormalModule { symbol, arity, slot, place })
    }

    /// Every way through statements, in the order in which Python would try them.
    pub(super) fn ways(&mut self, statements: &[Statement]) -> Result<Vec<Way>, Refusal> {
        let mut out = Vec::new();
        // Each unfinished way: what it has done, and the statements that it has left, the next one last.
        let mut open: Vec<(Way, Vec<Statement>)> = vec![(Way::default(), statements.iter().rev().cloned().collect())];
        while let Some((mut way, mut left)) = open.pop() {
            let too_many = out.len() + open.len() > MAX_WAYS || way.steps.len() + left.len() > MAX_STEPS;
            if too_many || way.modules.len() > MAX_MODULES {
                return Err(Refusal::new("a production with too many ways through it", way.range()));
            }
            let Some(statement) = left.pop() else {
                way.produced |= !way.modules.is_empty();
                out.push(way);
                continue;
            };
            if self.call(&statement, &mut way, &mut left)? {
                open.push((way, left));
                continue;
            }
            // The names whose lists an assignment hands on, before the lists take their place.
            let held = match &statement {
                Statement::Assign(name, e) => {
                    self.check_change(name, e, &way)?;
                    names_held(e)
                }
                _ => BTreeSet::new(),
            };
            let is_same =
                matches!(&statement, Statement::Assign(_, e) if !matches!(e, PyExpr::List(..)) && !is_change(e));
            let statement = with_lists(statement, &way.lists);
            match statement {
                Statement::Pass => open.push((way, left)),
                Statement::Global(names) => {
                    way.globals.extend(names);
                    open.push((way, left));
                }
                Statement::Return(None, _) => {
                    way.produced |= !way.modules.is_empty();
                    out.push(way);
                }
                // The value of a function that the production calls; else the production has no value.
                Statement::Return(Some(e), place) => {
                    let at = left.iter().rposition(|s| matches!(s, Statement::FunctionEnd(..)));
                    let at = at.ok_or_else(|| Refusal::new("'return' in a production", place))?;
                    let end = left.drain(at..).next();
                    if let Some(Statement::FunctionEnd(name, ..)) = end {
                        left.push(Statement::Assign(name, e));
                    }
                    open.push((way, left));
                }
                Statement::FunctionEnd(_, function, place) => {
                    return Err(Refusal::new(
                        format!("the function '{function}', which may end without a value"),
                        place,
                    ));
                }
                Statement::Assign(name, e) => {
                    let list = self.list_of(&e, &way).filter(|_| !way.globals.contains(&name));
                    if let Some(list) = list {
                        let mut taken = Vec::new();
                        let mut list = self.kept(&list, &way, &mut taken);
                        // A list that changes has no name for each of its changes.
                        if !is_change(&e) {
                            list = self.named_list(list, &mut format!("(list of {})", self.temporaries));
                            self.temporaries += 1;
                            way.shared_lists.remove(&name);
                        }
                        self.share_lists(&name, is_same, &held, &mut way);
                        way.lists.insert(name, list);
                        left.extend(taken.into_iter().rev());
                        open.push((way, left));
                        continue;
                    }
                    way.lists.remove(&name);
                    let value = self.known_value(&e, &way);
                    let e = value.filter(|_| self.calls_function(&e)).map_or(e, PyExpr::Number);
                    way.known.insert(name.clone(), value);
                    way.bounds.assign(&name, &e, &self.scope);
                    way.steps.push(Step::Assign(name, e));
                    open.push((way, left));
                }
                Statement::Produce(modules, ends) => {
                    self.produce(&mut way, &modules, ends);
                    if ends {
                        way.produced = true;
                        out.push(way);
                    } else {
                        open.push((way, left));
                    }
                }
                Statement::If(tests, other) => {
                    // Pushed in reverse, so that the first alternative is continued first.
                    let mut alternatives = Vec::new();
                    let (mut decided, mut impossible) = (false, false);
                    for (test, then) in tests {
                        // Tests of numbers alone, such as those of the variable of a loop, leave one way.
                        match self.known_value(&test, &way) {
                            Some(value) if is_zero(value) => continue,
                            Some(_) => {
                                left.extend(then.into_iter().rev());
                                decided = true;
                                break;
                            }
                            None => {}
                        }
                        // Conditions before may have decided this one; what draws is tested all the same.
                        let draws = has_random(&test, &self.scope);
                        match way.bounds.decide(&test, &self.scope).filter(|_| !draws) {
                            Some(false) => continue,
                            Some(true) => {
                                left.extend(then.into_iter().rev());
                                decided = true;
                                break;
                            }
                            None => {}
                        }
                        let mut taken = way.clone();
                        taken.steps.push(Step::Condition(test.clone(), true));
                        let mut rest = left.clone();
                        rest.extend(then.into_iter().rev());
                        if draws || taken.bounds.refine(&test, true, &self.scope) {
                            alternatives.push((taken, rest));
                        }
                        impossible = !draws && !way.bounds.refine(&test, false, &self.scope);
                        if impossible {
                            break;
                        }
                        way.steps.push(Step::Condition(test, false));
                    }
                    // Nothing but the alternatives is left where one of the tests must hold.
                    if impossible {
                        open.extend(alternatives.into_iter().rev());
                        continue;
                    }
                    if !decided {
                        left.extend(other.into_iter().rev());
                    }
                    alternatives.push((way, left));
                    open.extend(alternatives.into_iter().rev());
                }
                Statement::For(name, list, body, place) => {
                    let turns = self.turns(&in_way(&list, &way), &place);
                    // The items of a list that are not constant are taken before the first turn.
                    if turns.is_err()
                        && let Some(list) = self.list_of(&list, &way)
                    {
                        let mut taken = Vec::new();
                        let PyExpr::List(items, _) = self.kept(&list, &way, &mut taken) else {
                            return Err(Refusal::new("'for' over something other than a list", place));
                        };
                        if items.len().saturating_mul(body.len() + 1) > MAX_STEPS {
                            return Err(Refusal::new("'for' with too many turns", place));
                        }
                        if changes(&body, &name) {
                            let why = Refusal::new(format!("a change of '{name}', an item of a list"), place);
                            return Err(why.remedy("make a copy under another name and change that one: p = list(q)"));
                        }
                        left.push(Statement::LoopEnd);
                        for item in items.into_iter().rev() {
                            left.push(Statement::TurnEnd);
                            left.extend(body.iter().rev().cloned());
                            left.push(Statement::Assign(name.clone(), item));
                        }
                        left.extend(taken.into_iter().rev());
                        open.push((way, left));
                        continue;
                    }
                    // `range(from, end, step)` whose turns are not known counts them from 0.
                    if turns.is_err()
                        && let Some(counted) = self.counted(&list, &way)
                    {
                        let mut turn = vec![Statement::Assign(name, counted.value)];
                        turn.extend(body);
                        left.push(Statement::For(counted.name, counted.turns, turn, place));
                        left.push(counted.begin);
                        open.push((way, left));
                        continue;
                    }
                    match turns {
                        Ok(turns) => {
                            left.push(Statement::LoopEnd);
                            if turns.len().saturating_mul(body.len() + 1) > MAX_STEPS {
                                return Err(Refusal::new("'for' with too many turns", place));
                            }
                            for value in turns.iter().rev() {
                                left.push(Statement::TurnEnd);
                                left.extend(body.iter().rev().map(|s| in_turn(s, &name, *value)));
                                left.push(Statement::Assign(name.clone(), PyExpr::Number(*value)));
                            }
                        }
                        // A loop that only computes runs as often as it must.
                        Err(_) if only_computes(&body) && range_end(&list).is_some() => {
                            let [count, last] = ["turn", "end"].map(|word| format!("({word} {})", self.temporaries));
                            self.temporaries += 1;
                            let at = |n: &str| PyExpr::Name(n.to_owned(), place.clone());
                            let end = range_end(&list).unwrap_or(PyExpr::Number(0.0));
                            let test = PyExpr::Binary(PyOp::Lt, Box::new(at(&count)), Box::new(at(&last)));
                            let one = Box::new(PyExpr::Number(1.0));
                            let next = PyExpr::Binary(PyOp::Add, Box::new(at(&count)), one);
                            // Counted first, so that `continue` does not pass over it.
                            let mut turn = vec![
                                Statement::Assign(name.clone(), at(&count)),
                                Statement::Assign(count.clone(), next),
                            ];
                            turn.extend(body.iter().cloned());
                            left.push(Statement::While(test, turn, place, 0));
                            left.push(Statement::Assign(count, PyExpr::Number(0.0)));
                            // Evaluated once: the body may change what it reads, and it may draw a random number.
                            left.push(Statement::Assign(last, end));
                        }
                        // As many turns as there may be, each inside a condition that the loop gets that far.
                        Err(why) => {
                            let (end, most) = self.last_turn(&list, &way, &place).ok_or(why)?;
                            let count = format!("(turns {})", self.temporaries);
                            self.temporaries += 1;
                            way.bounds.assign(&count, &end, &self.scope);
                            way.steps.push(Step::Assign(count.clone(), end));
                            let mut inner = Vec::new();
                            for k in (0..most).rev() {
                                let value = f64::from(k);
                                let number = PyExpr::Number(value);
                                let end = PyExpr::Name(count.clone(), place.clone());
                                let test = PyExpr::Binary(PyOp::Lt, Box::new(number.clone()), Box::new(end));
                                let mut turn = vec![Statement::Assign(name.clone(), number)];
                                turn.extend(body.iter().map(|s| in_turn(s, &name, value)));
                                turn.push(Statement::TurnEnd);
                                turn.append(&mut inner);
                                inner = vec![Statement::If(vec![(test, turn)], Vec::new())];
                            }
                            left.push(Statement::LoopEnd);
                            left.append(&mut inner);
                        }
                    }
                    open.push((way, left));
                }
                Statement::While(test, body, place, turn) => {
                    if turn == 0 {
                        left.push(Statement::LoopEnd);
                    }
                    match self.known_value(&test, &way) {
                        Some(value) if is_zero(value) => open.push((way, left)),
                        // The condition is known to be true: a loop that makes modules is unrolled, so that what it makes is known, and
                        // so is one of the axiom, which has no code of its own.
                        Some(_) if self.is_in_axiom || !only_computes(&body) || turn > 0 => {
                            if turn > MAX_KNOWN_TURNS {
                                return Err(Refusal::new("'while' with too many turns", place));
                            }
                            // A `break` on a condition that is not known ends it: each turn makes a way, as a test would.
                            let conditions = way.steps.iter().filter(|s| matches!(s, Step::Condition(..))).count();
                            if turn >= MAX_UNKNOWN && u32::try_from(conditions).is_ok_and(|n| n >= MAX_UNKNOWN) {
                                self.turns_left_out(place);
                                open.push((way, left));
                                continue;
                            }
                            left.push(Statement::While(test, body.clone(), place, turn + 1));
                            left.push(Statement::TurnEnd);
                            left.extend(body.into_iter().rev());
                            open.push((way, left));
                        }
                        _ if only_computes(&body) => {
                            let (names, globals) = names_of(&body);
                            names.iter().for_each(|n| {
                                way.bounds.forget(n);
                                way.lists.remove(n);
                            });
                            way.known.extend(names.into_iter().map(|n| (n, None)));
                            way.globals.extend(globals);
                            way.steps.push(Step::Loop(test, body, place));
                            open.push((way, left));
                        }
                        _ => {
                            if turn == MAX_UNKNOWN {
                                self.turns_left_out(place);
                                open.push((way, left));
                                continue;
                            }
                            let mut taken = way.clone();
                            taken.steps.push(Step::Condition(test.clone(), true));
                            let draws = has_random(&test, &self.scope);
                            let goes_on = draws || taken.bounds.refine(&test, true, &self.scope);
                            let ends = draws || way.bounds.refine(&test, false, &self.scope);
                            let mut rest = left.clone();
                            rest.push(Statement::While(test.clone(), body.clone(), place, turn + 1));
                            rest.push(Statement::TurnEnd);
                            rest.extend(body.into_iter().rev());
                            way.steps.push(Step::Condition(test, false));
                            open.extend(Some((way, left)).filter(|_| ends));
                            open.extend(Some((taken, rest)).filter(|_| goes_on));
                        }
                    }
                }
                Statement::TurnEnd | Statement::LoopEnd => open.push((way, left)),
                Statement::Break(place) => {
                    let at = left.iter().rposition(|s| matches!(s, Statement::LoopEnd));
                    left.truncate(at.ok_or_else(|| Refusal::new("'break' outside of a loop", place))?);
                    open.push((way, left));
                }
                Statement::Continue(place) => {
                    let at = left.iter().rposition(|s| matches!(s, Statement::TurnEnd));
                    left.truncate(at.ok_or_else(|| Refusal::new("'continue' outside of a loop", place))?);
                    open.push((way, left));
                }
            }
        }
        Ok(out)
    }

    /// L008 for a `while` of more turns than are read.
    fn turns_left_out(&mut self, place: Range<usize>) {
        let at = self.reader.place(place);
        let message = format!("this 'while' makes modules: read with up to {MAX_UNKNOWN} turns");
        let help = "further turns are left out; make one module in a turn, by a production that repeats";
        self.reader.session.warning("L008", message, at, help);
    }

    /// Puts the statements of the first function of more than one expression that a statement calls before it, under names of
    /// their own, with the name of the value in place of the call; false for a statement without such a call.
    fn call(&mut self, s: &Statement, way: &mut Way, left: &mut Vec<Statement>) -> Result<bool, Refusal> {
        if self.bodies.is_empty() {
            return Ok(false);
        }
        let Some(call) = call_in(s, &|name| self.has_body(name)) else { return Ok(false) };
        let PyExpr::Call(function, args, place) = &call else { return Ok(false) };
        let Some((params, body)) = self.bodies.get(function).cloned() else { return Ok(false) };
        way.calls += 1;
        if way.calls > MAX_CALLS {
            return Err(Refusal::new(
                format!("more than {MAX_CALLS} calls of functions in a production"),
                place.clone(),
            ));
        }
        let args = arguments(&params, self.scope.defaults.get(function), args.clone());
        let args = args.ok_or_else(|| Refusal::new(format!("this call of '{function}'"), place.clone()))?;
        let mut names = names_of(&body).0;
        names.extend(params.iter().cloned());
        let number = self.temporaries;
        self.temporaries += 1;
        let mut own: Vec<String> = names.iter().map(|name| format!("{name} ({number})")).collect();
        // The function reads values of the model where the production has variables of their names.
        let others = self.scope.locals.iter().chain(way.known.keys()).chain(way.lists.keys());
        let others: BTreeSet<&String> =
            others.filter(|name| !name.contains('(') && !names.contains(name) && read_name(&body, name)).collect();
        let others: Vec<String> = others.into_iter().filter(|name| !way.globals.contains(name)).cloned().collect();
        if let Some(name) = others.iter().find(|name| self.shared.contains(name)) {
            let why = format!("a call of '{function}', which reads a '{name}' that this production has, too");
            let why = Refusal::new(why, place.clone());
            return Err(why.remedy("give the variable of the production another name"));
        }
        own.extend(others.iter().map(|name| model_name(name)));
        names.extend(others);
        let result = format!("(result {number})");
        let value = PyExpr::Name(result.clone(), place.clone());
        // `a, b = f(x)` takes both items of one value.
        for next in left.iter_mut().rev().take_while(|s| matches!(s, Statement::Assign(..))) {
            *next = without_call(next, &call, &value);
        }
        left.push(without_call(s, &call, &value));
        left.push(Statement::FunctionEnd(result, function.clone(), place.clone()));
        left.extend(body.iter().rev().map(|s| renamed(s, &names, &own)));
        let set = params.iter().zip(args).map(|(p, value)| {
            let name = names.iter().position(|n| n == p).and_then(|i| own.get(i)).unwrap_or(p);
            Statement::Assign(name.clone(), value)
        });
        left.extend(set);
        Ok(true)
    }

    /// The list that an expression is; `None` for any other.
    fn list_of(&self, e: &PyExpr, way: &Way) -> Option<PyExpr> {
        if matches!(e, PyExpr::List(..)) {
            return Some(e.clone());
        }
        let is_list = self.may_be_list(e) && matches!(resolve(&in_way(e, way), &self.scope, 0), Ok(PyExpr::List(..)));
        // The items keep the names of variables whose values are not known.
        let list = is_list.then(|| resolve(&with_known(e, way), &self.scope_of(way), 0).ok()).flatten();
        list.filter(|e| matches!(e, PyExpr::List(..)))
    }

    /// False for an expression that is no list whatever its names are; it need not be resolved.
    fn may_be_list(&self, e: &PyExpr) -> bool {
        match e {
            PyExpr::List(..) | PyExpr::Index(..) | PyExpr::Each(..) => true,
            PyExpr::Name(name, _) => self.scope.lists.contains_key(plain_name(name)),
            PyExpr::Binary(PyOp::Add | PyOp::Mul, a, b) => self.may_be_list(a) || self.may_be_list(b),
            PyExpr::Call(name, ..) => {
                // `[[]]` is a list over several lists.
                matches!(name.as_str(), "range" | "xrange" | "list" | "tuple" | "reversed" | "sorted" | "divmod")
                    || matches!(name.as_str(), "enumerate" | "zip" | ".keys" | ".values" | ".items" | ".copy" | "[[]]")
                    || self.scope.functions.contains_key(name)
                    || is_change(e)
            }
            _ => false,
        }
    }

    /// The scope of the production with the variables that a way has assigned.
    fn scope_of(&self, way: &Way) -> Scope {
        let own = way.known.keys().filter(|name| !self.scope.locals.contains(name));
        let mut scope = self.scope.clone();
        scope.locals.extend(own.cloned());
        scope
    }

    /// A list of numbers, and of variables that the statements `taken` set, so that it may be read at any time.
    fn kept(&mut self, e: &PyExpr, way: &Way, taken: &mut Vec<Statement>) -> PyExpr {
        let is_kept = matches!(e, PyExpr::Name(name, _) if name.starts_with("(item "));
        if is_written_out(e) || is_kept {
            return e.clone();
        }
        if let Some(PyExpr::List(items, place)) = self.list_of(e, way) {
            let items = items.iter().map(|e| self.kept(e, way, taken)).collect();
            return PyExpr::List(items, place);
        }
        let name = format!("(item {})", self.temporaries);
        self.temporaries += 1;
        taken.push(Statement::Assign(name.clone(), e.clone()));
        PyExpr::Name(name, range_of(e))
    }

    /// Value of an expression after the steps of a way, if it is a number whatever the parameters are.
    fn known_value(&self, e: &PyExpr, way: &Way) -> Option<f64> {
        let code = compile(&in_way(e, way), &self.scope).ok()?;
        vm::constant_value(&code).filter(|v| !v.is_nan())
    }

    /// True for an expression with a call of a function of the model: where its value is known, the number stands in its place, as the
    /// function may call itself until a test of such numbers ends it.
    fn calls_function(&self, e: &PyExpr) -> bool {
        first_call(e, &|name| self.scope.functions.contains_key(name)).is_some()
    }

    /// Values that the variable of a `for` loop takes, one per turn; a list that is not constant is refused.
    fn turns(&self, list: &PyExpr, place: &Range<usize>) -> Result<Vec<f64>, Refusal> {
        let is_constant = |e: &PyExpr| compile(e, &self.scope).is_ok_and(|code| vm::constant_value(&code).is_some());
        let refused = || match list {
            PyExpr::Call(name, args, _) if name.ends_with("range") && args.iter().all(is_constant) => {
                Refusal::new("'for' with too many turns", place.clone())
            }
            PyExpr::Call(name, ..) if name == "range" || name == "xrange" => {
                Refusal::new("'for' over a range that is not constant", place.clone())
            }
            _ => Refusal::new("'for' over something other than range(..)", place.clone()),
        };
        let Ok(PyExpr::List(items, _)) = resolve(list, &self.scope, 0) else { return Err(refused()) };
        let number = |e: &PyExpr| {
            let code = compile(e, &self.scope).map_err(|_| refused())?;
            vm::constant_value(&code).filter(|v| v.is_finite()).ok_or_else(refused)
        };
        items.iter().map(number).collect()
    }

    /// The parts of a loop over `range(from, end)` or `range(from, end, step)`, the step constant; `None` for any other list.
    fn counted(&mut self, list: &PyExpr, way: &Way) -> Option<CountedRange> {
        let PyExpr::Call(function, args, place) = list else { return None };
        let (from, end, step) = match args.as_slice() {
            [from, end] => (from, end, 1.0),
            [from, end, step] => (from, end, self.known_value(step, way).filter(|step| step.abs() > 0.0)?),
            _ => return None,
        };
        if !function.ends_with("range") {
            return None;
        }
        let [begin, count] = ["begin", "count"].map(|word| format!("({word} {})", self.temporaries));
        self.temporaries += 1;
        let at = |name: &str| PyExpr::Name(name.to_owned(), place.clone());
        let two = |op, a: PyExpr, b: PyExpr| PyExpr::Binary(op, Box::new(a), Box::new(b));
        // A beginning that is constant stays a number, so that a largest number of turns is found.
        let first = self.known_value(from, way).map_or_else(|| at(&begin), PyExpr::Number);
        let (low, high) = if step > 0.0 { (first.clone(), end.clone()) } else { (end.clone(), first.clone()) };
        let span = two(PyOp::Sub, high, low);
        let turns = if is_zero(step.abs() - 1.0) {
            span
        } else {
            PyExpr::Call("ceil".to_owned(), vec![two(PyOp::Div, span, PyExpr::Number(step.abs()))], place.clone())
        };
        let value = two(PyOp::Add, first, two(PyOp::Mul, at(&count), PyExpr::Number(step)));
        Some(CountedRange {
            begin: Statement::Assign(begin, from.clone()),
            turns: PyExpr::Call("range".to_owned(), vec![turns], place.clone()),
            name: count,
            value,
        })
    }

    /// The end of `range(end)` and how many turns are read: the most that there may be, else [`MAX_UNKNOWN`] with a warning L008.
    fn last_turn(&mut self, list: &PyExpr, way: &Way, place: &Range<usize>) -> Option<(PyExpr, u32)> {
        let PyExpr::Call(name, args, _) = list else { return None };
        let [end] = args.as_slice() else { return None };
        let constant = compile(&in_way(end, way), &self.scope).ok().and_then(|code| vm::constant_value(&code));
        if !name.ends_with("range") || constant.is_some() || !self.is_readable(end, way) {
            return None;
        }
        let most = self.at_most(end, &way.steps, 0).map(f64::ceil).filter(|m| *m <= MAX_COUNTED);
        if most.is_none() {
            let at = self.reader.place(place.clone());
            let message = format!("the end of this 'for' is not constant: read with up to {MAX_UNKNOWN} turns");
            let help = "further turns are left out; write an end that has a largest value: min(n, 8)";
            self.reader.session.warning("L008", message, at, help);
        }
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between 0 and MAX_COUNTED")]
        let turns = most.map_or(MAX_UNKNOWN, |m| m.max(0.0) as u32);
        Some((end.clone(), turns))
    }

    /// True if all names of an expression are known after the steps of a way.
    fn is_readable(&self, e: &PyExpr, way: &Way) -> bool {
        let mut scope = self.scope.clone();
        for step in &way.steps {
            match step {
                Step::Assign(name, _) => {
                    scope.local(name);
                }
                Step::Loop(_, body, _) => names_of(body).0.iter().for_each(|name| {
                    scope.local(name);
                }),
                Step::Condition(..) => {}
            }
        }
        compile(e, &scope).is_ok()
    }

    /// Upper bound on the value of an expression after these steps of a way; `None` if none is found.
    fn at_most(&self, e: &PyExpr, steps: &[Step], depth: usize) -> Option<f64> {
        if depth > 32 {
            return None;
        }
        let of = |e: &PyExpr| self.at_most(e, steps, depth + 1);
        // Variables of the way hide values of the model.
        let fixed = |e: &PyExpr| {
            let code = compile(e, &self.scope).ok()?;
            vm::constant_value(&code).filter(|_| !steps.iter().any(|s| s.changes(e)))
        };
        match e {
            PyExpr::Name(name, _) => {
                // The last assignment before this place counts; what it reads was assigned before it.
                let last = steps.iter().enumerate().rev().find_map(|(i, s)| match s {
                    Step::Assign(n, e) if n == name => Some((i, Some(e))),
                    // A loop may assign anything.
                    Step::Loop(..) if s.assigns(name) => Some((i, None)),
                    _ => None,
                });
                match last {
                    Some((i, e)) => self.at_most(e?, &steps[..i], depth + 1),
                    None => fixed(e),
                }
            }
            PyExpr::Binary(PyOp::Add, a, b) => Some(of(a)? + of(b)?),
            PyExpr::Binary(PyOp::Sub, a, b) => Some(of(a)? - fixed(b)?),
            // Bounds hold for divisors and factors that are constant and not negative; a dividend below 0 is at most 0.
            PyExpr::Binary(PyOp::Div, a, b) => Some(of(a)?.max(0.0) / fixed(b).filter(|b| *b > 0.0)?),
            PyExpr::Binary(PyOp::Mul, a, b) => {
                let (factor, other) = fixed(a).map_or_else(|| (fixed(b), a), |a| (Some(a), b));
                Some(of(other)?.max(0.0) * factor.filter(|f| *f >= 0.0)?)
            }
            PyExpr::Choice(_, a, b) => Some(of(a)?.max(of(b)?)),
            PyExpr::Call(name, args, _) => match (name.as_str(), args.as_slice()) {
                ("randint", [_, b]) => of(b),
                ("uniform", [a, b]) => Some(of(a)?.max(of(b)?)),
                ("random", []) => Some(1.0),
                ("int" | "trunc" | "floor" | "float", [a]) => Some(of(a)?.max(0.0)),
                ("round" | "ceil", [a]) => Some(of(a)?.max(0.0) + 1.0),
                ("min", args) => args.iter().filter_map(of).reduce(f64::min),
                ("max", args) => args.iter().map(of).reduce(|a, b| Some(a?.max(b?))).flatten(),
                // A function of the model: its body with the arguments in place of its parameters.
                _ => {
                    let (params, body) = self.scope.functions.get(name).filter(|f| f.0.len() == args.len())?;
                    (size_with(body, params, args) <= MAX_STEPS).then(|| of(&substitute(body, params, args))).flatten()
                }
            },
            _ => fixed(e),
        }
    }

    /// Adds modules to a way. Their parameters are computed now, for variables may change afterwards.
    fn produce(&mut self, way: &mut Way, modules: &[PyModule], ends: bool) {
        for m in modules {
            let mut module = m.clone();
            // A list that cannot be read is refused where the successor is made.
            if m.args.iter().any(|arg| matches!(arg, PyExpr::Call(star, ..) if star == "*"))
                && let Ok(args) = spread(&m.args, &self.scope_of(way))
            {
                module.args = args;
            }
            for arg in &mut module.args {
                let value = if self.calls_function(arg) { self.known_value(arg, way) } else { None };
                if let Some(value) = value {
                    *arg = PyExpr::Number(value);
                }
            }
            for arg in module.args.iter_mut().filter(|a| !ends && !matches!(a, PyExpr::Number(_) | PyExpr::Text(..))) {
                let name = format!("(value {})", self.temporaries);
                self.temporaries += 1;
                let value = std::mem::replace(arg, PyExpr::Name(name.clone(), m.range.clone()));
                way.steps.push(Step::Assign(name, value));
            }
            way.modules.push(module);
        }
    }

    /// The production of one way; `None` after an error.
    fn production(&mut self, head: &Head, way: &Way) -> Option<Production> {
        // Each way has separate variables; the parameters of the head are common to all.
        let own = self.scope.locals.clone();
        let made = self.way_code(way);
        let built = match self.settle(made) {
            Some((before, condition)) => self.successor(&way.modules).map(|successor| {
                let successor = self.reader.numbered(successor);
                Production {
                    left: head.left.clone(),
                    predecessor: head.formals.clone(),
                    right: head.right.clone(),
                    new_left: head.new_left.clone(),
                    new_right: head.new_right.clone(),
                    before,
                    condition,
                    after: None,
                    successor,
                    weight: None,
                    locals: self.scope.locals.len(),
                    place: head.place,
                }
            }),
            None => None,
        };
        self.scope.locals = own;
        built
    }

    /// Code of the steps of a way: a block before the condition, and the condition.
    fn way_code(&mut self, way: &Way) -> Result<(Option<Bytecode>, Option<Bytecode>), Refusal> {
        // Only conditions, which draw nothing: one expression.
        let is_plain = |s: &Step| matches!(s, Step::Condition(e, _) if !has_random(e, &self.scope));
        if way.steps.iter().all(is_plain) {
            let test = |s: &Step| match s {
                Step::Condition(e, true) => Some(e.clone()),
                Step::Condition(e, false) => Some(PyExpr::Not(Box::new(e.clone()))),
                Step::Assign(..) | Step::Loop(..) => None,
            };
            let all = way.steps.iter().filter_map(test).reduce(|a, b| PyExpr::And(Box::new(a), Box::new(b)));
            return Ok((None, all.map(|e| compile(&e, &self.scope)).transpose()?));
        }
        // A block computes everything in order; a variable says whether all conditions held. Every way draws the same random
        // numbers, as it is the same run of Python.
        let result = self.scope.local("(applies)");
        let mut ops = vec![Op::RestartDraws];
        let mut failures = Vec::new();
        for step in &way.steps {
            let (e, store) = match step {
                Step::Assign(name, e) => (e, Some(name)),
                Step::Condition(e, _) => (e, None),
                Step::Loop(test, body, place) => {
                    self.loop_code(test, body, place, &mut ops)?;
                    continue;
                }
            };
            let code = compile(e, &self.scope)?;
            let offset = ops.len();
            ops.extend(code.ops.iter().map(|op| shifted(*op, offset)));
            match (store, step) {
                (Some(name), _) => ops.push(Op::StoreLocal(self.scope.local(name))),
                (None, Step::Condition(_, wanted)) => {
                    if !wanted {
                        ops.push(Op::Unary(UnaryOp::Not));
                    }
                    failures.push(ops.len());
                    ops.push(Op::Pop);
                }
                (None, Step::Assign(..) | Step::Loop(..)) => {}
            }
        }
        // Until here they were local variables: only the way that is taken changes those of the model.
        for name in way.written() {
            let (local, global) = (self.scope.local(name), self.scope.global(name));
            ops.extend([Op::Local(local), Op::StoreGlobal(global)]);
        }
        ops.extend([Op::Const(if way.produced { 1.0 } else { 0.0 }), Op::StoreLocal(result)]);
        let jump = ops.len();
        ops.push(Op::Pop);
        for at in failures {
            ops[at] = Op::JumpIfZero(ops.len());
        }
        ops.extend([Op::Const(0.0), Op::StoreLocal(result)]);
        ops[jump] = Op::Jump(ops.len());
        let condition = Bytecode { ops: vec![Op::Local(result)], ..Bytecode::default() };
        Ok((Some(self.bytecode(ops)), Some(condition)))
    }

    /// Code with the places of its loops.
    pub(super) fn bytecode(&self, ops: Vec<Op>) -> Bytecode {
        let has_loops = ops.iter().any(|op| matches!(op, Op::Count(_)));
        let places = if has_loops { self.loop_places.clone() } else { Vec::new() };
        Bytecode { ops, places, ..Bytecode::default() }
    }

    /// Appends a loop: test, JumpIfZero to its end, body, Jump to the test.
    fn loop_code(
        &mut self,
        test: &PyExpr,
        body: &[Statement],
        place: &Range<usize>,
        ops: &mut Vec<Op>,
    ) -> Result<(), Refusal> {
        // Names that the body assigns exist before it, so that the test may read them.
        for name in names_of(body).0 {
            self.scope.local(&name);
        }
        let start = ops.len();
        ops.push(Op::Count(self.loop_places.len()));
        self.loop_places.push(self.reader.place(place.clone()));
        let skip = push_test(ops, &compile(test, &self.scope)?);
        let mut jumps = LoopJumps::default();
        self.computing_code(body, ops, &mut jumps)?;
        for at in jumps.continues {
            ops[at] = Op::Jump(start);
        }
        ops.push(Op::Jump(start));
        ops[skip] = Op::JumpIfZero(ops.len());
        for at in jumps.breaks {
            ops[at] = Op::Jump(ops.len());
        }
        Ok(())
    }

    /// Appends statements that only compute. `jumps`: those of the loop around them.
    fn computing_code(&mut self, body: &[Statement], ops: &mut Vec<Op>, jumps: &mut LoopJumps) -> Result<(), Refusal> {
        for statement in body {
            match statement {
                Statement::Assign(name, e) => {
                    let code = compile(e, &self.scope)?;
                    let offset = ops.len();
                    ops.extend(code.ops.iter().map(|op| shifted(*op, offset)));
                    ops.push(Op::StoreLocal(self.scope.local(name)));
                }
                Statement::If(tests, other) => {
                    let mut ends = Vec::new();
                    for (test, then) in tests {
                        let skip = push_test(ops, &compile(test, &self.scope)?);
                        self.computing_code(then, ops, jumps)?;
                        ends.push(ops.len());
                        ops.push(Op::Pop);
                        ops[skip] = Op::JumpIfZero(ops.len());
                    }
                    self.computing_code(other, ops, jumps)?;
                    for end in ends {
                        ops[end] = Op::Jump(ops.len());
                    }
                }
                Statement::While(test, inner, place, _) => self.loop_code(test, inner, place, ops)?,
                Statement::For(name, list, inner, place) => {
                    let [count, last] = ["turn", "end"].map(|word| format!("({word} {})", self.temporaries));
                    self.temporaries += 1;
                    let (from, end, step) = range_of_loop(list)
                        .ok_or_else(|| Refusal::new("'for' over a list in a loop", place.clone()))?;
                    let at = |n: &str| PyExpr::Name(n.to_owned(), place.clone());
                    let test = PyExpr::Binary(PyOp::Lt, Box::new(at(&count)), Box::new(at(&last)));
                    let next = PyExpr::Binary(PyOp::Add, Box::new(at(&count)), Box::new(PyExpr::Number(step)));
                    let mut turn =
                        vec![Statement::Assign(name.clone(), at(&count)), Statement::Assign(count.clone(), next)];
                    turn.extend(inner.iter().cloned());
                    // Python evaluates a range once, before the first turn.
                    for (variable, value) in [(&count, &from), (&last, &end)] {
                        let code = compile(value, &self.scope)?;
                        let offset = ops.len();
                        ops.extend(code.ops.iter().map(|op| shifted(*op, offset)));
                        ops.push(Op::StoreLocal(self.scope.local(variable)));
                    }
                    self.loop_code(&test, &turn, place, ops)?;
                }
                Statement::Break(_) => {
                    jumps.breaks.push(ops.len());
                    ops.push(Op::Pop);
                }
                Statement::Continue(_) => {
                    jumps.continues.push(ops.len());
                    ops.push(Op::Pop);
                }
                // The names of `global` are known from the way; nothing else is left in a loop that only computes.
                _ => {}
            }
        }
        Ok(())
    }

    pub(super) fn successor(&mut self, list: &[PyModule]) -> Option<Vec<SuccessorModule>> {
        let mut out = Vec::with_capacity(list.len());
        for m in list {
            let place = self.reader.place(m.range.clone());
            let mut args = Vec::new();
            let spread = spread(&m.args, &self.scope);
            for arg in &self.settle(spread)? {
                let code = compile(arg, &self.scope);
                args.push(self.settle(code)?.into_expr());
            }
            if m.name == "SetColor" && args.len() >= 3 {
                args = self.color_index(&args, place).map_or(args, |index| vec![Expr::Const(f64::from(index))]);
            }
            let Some(symbol) = self.symbol(&m.name) else {
                self.refuse(&Refusal::new("more than 65,535 symbols", m.range.clone()));
                return None;
            };
            out.push(SuccessorModule { symbol, args: args.into(), occurrence: 0, place });
        }
        Some(out)
    }
}
