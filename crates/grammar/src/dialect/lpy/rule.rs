//! Productions: heads, and the code that each way through their statements becomes.

use std::collections::BTreeSet;
use std::ops::Range;

use super::expression::{PyExpr, PyOp, Refusal, compile, has_random};
use super::parser::parse;
use super::statement::{GROUP, Statement, assigned};
use super::strings::{PyModule, Spelled, spell};
use super::ways::{Step, Way, names_of, spread};
use super::{Line, Model, Section, block_after, colon, shifted, strings};
use crate::code::{Bytecode, Expr, Op, UnaryOp};
use crate::dialect::text::Piece;
use crate::program::{ContextElement, FormalModule, Production, SuccessorModule};
use crate::token::SourcePlace;
use crate::vm;

/// Appends a test and a place for the jump where it is 0; returns that place.
fn push_test(ops: &mut Vec<Op>, test: &Bytecode) -> usize {
    let offset = ops.len();
    ops.extend(test.ops.iter().map(|op| shifted(*op, offset)));
    ops.push(Op::Pop);
    ops.len() - 1
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

/// Jumps of a loop whose targets are known at its end.
#[derive(Debug, Default)]
struct LoopJumps {
    breaks: Vec<usize>,
    continues: Vec<usize>,
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
        for (name, of_model) in std::mem::take(&mut self.rule_lists).into_iter().rev() {
            match of_model {
                Some(list) => self.scope.lists.insert(name, list),
                None => self.scope.lists.remove(&name),
            };
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
            let of_model = self.scope.lists.insert(name.clone(), list(&names));
            self.rule_lists.push((name, of_model));
            arity += names.len();
            self.scope.locals.extend(names);
        }
        let arity = u8::try_from(arity).map_err(|_| Refusal::new("more than 255 parameters", s.range.clone()))?;
        let symbol = self.symbol(&s.name).ok_or_else(|| Refusal::new("more than 65,535 symbols", s.range.clone()))?;
        Ok(FormalModule { symbol, arity, slot, place })
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
