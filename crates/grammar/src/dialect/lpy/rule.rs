//! Reads productions: their heads, and one production for each execution path through their statements.

use std::collections::BTreeSet;

use super::execution_path::ExecutionPath;
use super::expression::{PyExpr, PyOp};
use super::lines::{Line, block_after};
use super::objects::object_of;
use super::param_shape::ParamShape;
use super::parser::parse;
use super::pieces::{closing, colon, split};
use super::refusal::Refusal;
use super::resolve::compile;
use super::shapes::{SpreadModule, spread};
use super::statement::{DIRECTION, GROUP, Statement, assigned};
use super::strings::{PyModule, QUERIES, Spelled, frame_query, spell};
use super::vectors::vector;
use super::{Model, Section};
use crate::code::Expr;
use crate::dialect::text::Piece;
use crate::program::{ContextElement, FormalModule, Production, SuccessorModule};
use crate::token::SourcePlace;
use crate::vm;

/// Predecessor and contexts of a production, which precede its statements.
struct Head {
    left: Vec<ContextElement>,
    formals: Vec<FormalModule>,
    right: Vec<ContextElement>,
    new_left: Vec<ContextElement>,
    new_right: Vec<ContextElement>,
    /// Conditions on the parameters of its modules.
    conditions: Vec<PyExpr>,
    place: SourcePlace,
}

/// The parts of `left < new left << predecessor >> new right > right`, of which all but the predecessor are optional. The
/// operator next to a context determines its kind, so that their order is free.
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
        // The operator before the part that begins at `begin`, if it is one of the right side.
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

/// Names of modules with the numbers of parameters that they have in the text; empty if no parameter list contains `*`, which
/// alone needs these numbers.
pub(super) fn arities(text: &str, declared: &[String]) -> BTreeSet<(String, usize)> {
    let mut out = BTreeSet::new();
    if !text.contains("(*") && !text.contains(",*") && !text.contains(", *") {
        return out;
    }
    let single = text.chars().filter(char::is_ascii_alphabetic).map(|c| c.to_string()).collect::<BTreeSet<_>>();
    for name in declared.iter().cloned().chain(single) {
        for (i, _) in text.match_indices(name.as_str()) {
            // A name of several letters must not be part of a longer word; single letters may be modules in a row.
            let after = &text[i + name.len()..];
            let is_word = |c: Option<char>| c.is_some_and(|c| c.is_alphanumeric() || c == '_');
            if name.len() > 1 && (is_word(text[..i].chars().next_back()) || is_word(after.chars().next())) {
                continue;
            }
            let Some(inner) = after.strip_prefix('(') else {
                continue;
            };
            let Some(close) = closing(inner) else { continue };
            let params = split(Piece::new(0, &inner[..close]));
            if !params.iter().any(|p| p.text.starts_with('*')) {
                out.insert((name.clone(), params.len()));
            }
        }
    }
    out
}

impl Model<'_, '_> {
    /// Reads a production: `head --> successor`, or `head:` with statements.
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
        // With `*args` there is a production for each number of parameters with which the model uses the module.
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

    /// Numbers of parameters that `*args` in a head may represent; a single 0 if the head has none.
    fn star_lengths(&self, head: Piece<'_>) -> Vec<usize> {
        // Operators of contexts are not names of modules.
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

    /// Makes the productions of one reading of a head; `None` after an error.
    fn rule_of(&mut self, head: Piece<'_>, condition: Option<Piece<'_>>, mut statements: Vec<Statement>) -> Option<()> {
        let heads = self.heads(head);
        let head = self.settle(heads)?;
        if let Some(condition) = condition {
            let test = self.test(condition);
            let test = self.settle(test)?;
            // Treat `head : condition --> successor` as `head: if condition: produce successor`.
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
        if names.iter().any(|n| n == DIRECTION) {
            let range = head.place.span.start as usize..head.place.span.end as usize;
            let why = Refusal::new("'backward()' or 'forward()' in a production", range);
            self.refuse(&why.remedy("call it in StartEach(), which runs before each step"));
            return None;
        }
        // Productions of a group apply only while the number of the active group is theirs.
        if self.group.abs() > 0.0 {
            let active = PyExpr::Name(GROUP.to_owned(), 0..0);
            let is = PyExpr::Binary(PyOp::Eq, Box::new(active), Box::new(PyExpr::Number(self.group)));
            statements = vec![Statement::If(vec![(is, statements)], Vec::new())];
        }
        let paths = self.execution_paths(&statements);
        let paths = self.settle(paths)?;
        // If an execution path changes an object of the head but makes no modules, the old module would remain with the old object.
        let is_kept = |path: &&ExecutionPath| {
            !path.produced && self.rule_lists.iter().any(|(name, _)| path.changed_objects.contains(name))
        };
        if let Some(path) = paths.iter().find(is_kept) {
            let name = self.rule_lists.iter().map(|(name, _)| name).find(|name| path.changed_objects.contains(*name));
            let name = name.cloned().unwrap_or_default();
            let range = head.place.span.start as usize..head.place.span.end as usize;
            let why = Refusal::new(format!("a change of '{name}' on a way that makes no modules"), range);
            self.refuse(&why.remedy("end each way by 'produce' with the module that holds the object: produce A(p)"));
            return None;
        }
        // An execution path that makes no modules still assigns variables of the model; then the next production is tried.
        let applied: Vec<&ExecutionPath> =
            paths.iter().filter(|w| w.produced || !w.written().is_empty() || w.stores()).collect();
        // On a path that does not set a variable, the variable has no value, and L-Py would end with an error.
        let is_of_head = |name: &String| self.rule_lists.iter().any(|(own, _)| own == name);
        names.retain(|name| !globals.contains(name) && !self.scope.locals.contains(name) && !is_of_head(name));
        let unset: Vec<Option<&String>> =
            applied.iter().map(|path| names.iter().find(|name| path.misses(name))).collect();
        let is_any_whole = unset.iter().any(Option::is_none);
        for name in unset.iter().flatten().filter(|_| is_any_whole).collect::<BTreeSet<_>>() {
            let message = format!("'{name}' has no value on a way through this production, which is left out");
            let help = "set it before the 'if' or the loop: L-Py ends with an error there";
            self.reader.session.warning("L008", message, head.place, help);
        }
        for (path, unset) in applied.iter().zip(&unset) {
            if unset.is_some() && is_any_whole {
                continue;
            }
            if let Some(production) = self.production(&head, path) {
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

    /// Reads left context, predecessor and right context, whose parameters become local variables.
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
        // A single `*` means no context.
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
                // The reverse of cpfg: `]` skips the rest of its branch, `=]` does not.
                "]" => out.push(ContextElement::CloseRest),
                "=" if list.peek().is_some_and(|n| n.name == "]") => {
                    list.next();
                    out.push(ContextElement::Close);
                }
                "*" => {
                    let why = Refusal::new("'*', which stands for any module", s.range);
                    return Err(why.remedy("write one production for each module that it stands for"));
                }
                "?R" | "?F" => return Err(frame_query(&s.name, s.range)),
                _ => out.push(ContextElement::Module(self.formal(&s, conditions)?)),
            }
        }
        Ok(out)
    }

    /// Reads a module of a head. Its parameters are names, names with a condition such as `x if x > 2`, or constants that
    /// they must equal.
    fn formal(&mut self, s: &Spelled<'_>, conditions: &mut Vec<PyExpr>) -> Result<FormalModule, Refusal> {
        let place = self.reader.place(s.range.clone());
        let slot = u16::try_from(self.scope.locals.len());
        let slot = slot.map_err(|_| Refusal::new("more than 65,535 parameters", s.range.clone()))?;
        let params = s.params.as_deref().unwrap_or(&[]);
        let list = |names: &[String]| {
            PyExpr::List(names.iter().map(|n| PyExpr::Name(n.clone(), s.range.clone())).collect(), s.range.clone())
        };
        // A query has three numbers. A single name for them is a vector: `?P(v)` allows `v.x` and `v[0]`.
        let is_vector = QUERIES.contains(&s.name.as_str()) && params.len() < 3;
        // `A(x, *args)` accepts any number of parameters beyond the first: `star` of them in this reading of the head.
        let star = params.last().filter(|p| p.text.starts_with('*') && !p.text.starts_with("**"));
        let plain = if is_vector { &[][..] } else { &params[..params.len() - usize::from(star.is_some())] };
        let shape = self.shape_of(&s.name, plain.len());
        let mut arity = 0;
        for (p, shape) in plain.iter().zip(&shape) {
            arity += shape.count();
            let (name, condition) = match p.text.find(" if ") {
                Some(i) => (p.up_to(i).trimmed(), Some(p.from(i + " if ".len()).trimmed())),
                None => (*p, None),
            };
            let mut chars = name.text.chars();
            let is_name = chars.next().is_some_and(|c| c.is_alphabetic() || c == '_')
                && chars.all(|c| c.is_alphanumeric() || c == '_');
            // A list or a vector has one name, but a parameter for each of its items.
            if let (true, ParamShape::List(n) | ParamShape::Vector(n) | ParamShape::Object { count: n, .. }) =
                (is_name, *shape)
            {
                let names: Vec<String> = (0..n).map(|k| format!("{} ({k})", name.text)).collect();
                let items = list(&names);
                let value = match (*shape, items) {
                    (ParamShape::Vector(_), PyExpr::List(items, range)) => vector(items, range),
                    (ParamShape::Object { kind, .. }, PyExpr::List(items, range)) => {
                        object_of(&self.scope.fields(kind), items, &range)
                    }
                    (_, items) => items,
                };
                let of_model = self.scope.lists.insert(name.text.to_owned(), value);
                self.rule_lists.push((name.text.to_owned(), of_model));
                self.scope.locals.extend(names);
                conditions.extend(condition.map(|c| self.test(c)).transpose()?);
                continue;
            }
            if *shape != ParamShape::Number {
                let why = Refusal::new(format!("'{}' in place of a list or a vector", p.text), p.range());
                return Err(
                    why.remedy("give the parameter a name, and compare its items in a condition: v if v[0] > 2")
                );
            }
            // The name of an earlier parameter is not a new name, and is refused below.
            if is_name && !self.scope.locals.iter().any(|l| l == name.text) {
                self.scope.locals.push(name.text.to_owned());
                conditions.extend(condition.map(|c| self.test(c)).transpose()?);
                continue;
            }
            // `x == 2` and `x != 2` are read as a name with a condition.
            let test = if is_name || condition.is_some() { None } else { parse(name).ok() };
            if let Some(PyExpr::Binary(op, left, _)) = &test
                && let PyExpr::Name(own, _) = &**left
                && op.compares()
                && !self.scope.locals.contains(own)
            {
                self.scope.locals.push(own.clone());
                conditions.extend(test);
                continue;
            }
            // An expression that is not a new name must be a constant, which the parameter must equal.
            let constant = parse(name).ok().and_then(|e| compile(&e, &self.scope).ok());
            let constant =
                constant.and_then(|code| vm::constant_value(&code)).filter(|_| !is_name && condition.is_none());
            let Some(value) = constant else {
                return Err(Refusal::new(format!("'{}' as the name of a parameter", p.text), p.range()));
            };
            // The constant gets a variable with a name that no model can contain, so that slots stay in the order of the parameters.
            let hidden = format!("(parameter {})", self.scope.locals.len());
            self.scope.locals.push(hidden.clone());
            let own = Box::new(PyExpr::Name(hidden, p.range()));
            conditions.push(PyExpr::Binary(PyOp::Eq, own, Box::new(PyExpr::Number(value))));
        }
        let mut group = None;
        if is_vector {
            let name = params.first().map_or("(query)", |p| p.text);
            group = Some((name.to_owned(), ["x", "y", "z"].map(|axis| format!("{name}.{axis}")).to_vec()));
        } else if let Some(star) = star {
            let name = star.text.trim_start_matches('*').trim();
            group = Some((name.to_owned(), (0..self.star).map(|k| format!("{name} ({k})")).collect()));
        }
        if let Some((name, names)) = group {
            let value = match list(&names) {
                PyExpr::List(items, range) if is_vector => vector(items, range),
                list => list,
            };
            let of_model = self.scope.lists.insert(name.clone(), value);
            self.rule_lists.push((name, of_model));
            arity += names.len();
            self.scope.locals.extend(names);
        }
        if star.is_none() && !is_vector {
            self.check_shape(&s.name, &shape, &s.range)?;
        }
        let arity = u8::try_from(arity).map_err(|_| Refusal::new("more than 255 parameters", s.range.clone()))?;
        let symbol = self.symbol(&s.name).ok_or_else(|| Refusal::new("more than 65,535 symbols", s.range.clone()))?;
        Ok(FormalModule { symbol, arity, slot, place })
    }

    /// Makes the production of one execution path; `None` after an error.
    fn production(&mut self, head: &Head, path: &ExecutionPath) -> Option<Production> {
        // Each path has its own variables; all paths share the parameters of the head.
        let own = self.scope.locals.clone();
        let made = self.path_code(path);
        let built = match self.settle(made) {
            Some((before, condition)) => self.successor(&path.modules).map(|successor| {
                let successor = self.reader.numbered(successor);
                Production {
                    left: head.left.clone(),
                    predecessor: head.formals.clone(),
                    right: head.right.clone(),
                    new_left: head.new_left.clone(),
                    new_right: head.new_right.clone(),
                    ignored: Some(self.ignored.clone()),
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

    pub(super) fn successor(&mut self, list: &[PyModule]) -> Option<Vec<SuccessorModule>> {
        let mut out = Vec::with_capacity(list.len());
        for m in list {
            let place = self.reader.place(m.range.clone());
            let mut args = Vec::new();
            let spread = match &m.shape {
                Some(shape) => Ok(SpreadModule { args: m.args.clone(), shape: shape.clone() }),
                None => spread(m, &self.scope),
            };
            let SpreadModule { args: numbers, shape } = self.settle(spread)?;
            let is_known = self.check_shape(&m.name, &shape, &m.range);
            self.settle(is_known)?;
            for arg in &numbers {
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
