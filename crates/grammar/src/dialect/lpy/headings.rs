//! Reads the headings of a model, and the items with a value: axiom, derivation length, ignored modules.

use std::ops::Range;

use super::execution_path::Step;
use super::expression::{PyExpr, range_of};
use super::lines::{Line, after_heading, block_after};
use super::parser::parse;
use super::pieces::{at_semicolons, colon, is_rule, parameters_of, split};
use super::refusal::Refusal;
use super::resolve::compile;
use super::scope::arguments;
use super::statement::{Statement, assigned, renamed};
use super::strings::{PyModule, modules, spell};
use super::{Model, ProductionLine, Section};
use crate::dialect::text::Piece;
use crate::program::{IgnoredSymbols, Production};
use crate::symbols::SymbolId;
use crate::vm;

/// Help for repeated items.
pub(super) const KEEP_ONE: &str = "keep one of them";
/// Name in messages of the items that list ignored modules.
const LIST: &str = "the list of 'ignore:' or 'consider:'";

impl Model<'_, '_> {
    /// Reads the values of the sliders that L-Py saves after the model: `('name', 'Integer', 5, 1, 10)`, or without the type in
    /// older files.
    pub(super) fn parameters(&mut self, list: &[Line<'_>]) {
        for line in list.iter().filter(|l| l.piece.text.starts_with("scalars")) {
            for part in line.piece.text.split('(').skip(1) {
                let fields: Vec<&str> =
                    part.split([',', ')']).map(|f| f.trim().trim_matches(['\'', '"', ' '])).collect();
                let number = |i: usize| {
                    fields.get(i).and_then(|v| match *v {
                        "True" => Some(1.0),
                        "False" => Some(0.0),
                        v => v.parse::<f64>().ok(),
                    })
                };
                if let (Some(name), Some(value)) = (fields.first(), number(1).or_else(|| number(2))) {
                    self.scope.constants.insert((*name).to_owned(), value);
                }
            }
        }
    }

    /// Collects the names that a rule or function declares `global`: their values may change from step to step.
    pub(super) fn shared_names(&mut self, list: &[Line<'_>]) {
        for part in list.iter().flat_map(|line| at_semicolons(line.piece)) {
            // The declaration may follow the heading of its block: `def Start(): global n`.
            let at = part.text.rfind("global ").filter(|i| *i == 0 || part.up_to(*i).text.trim_end().ends_with(':'));
            if let Some(at) = at {
                self.shared.extend(split(part.from(at + "global ".len())).iter().map(|n| n.text.to_owned()));
            }
        }
    }

    /// Collects the names that `module` lines declare, anywhere in the file.
    pub(super) fn declarations(&mut self, list: &[Line<'_>]) {
        for line in list {
            let (word, rest) = line.piece.first_word(&[]);
            if word.text != "module" || rest.text.is_empty() {
                continue;
            }
            let names = rest.before(':');
            if rest.from(names.text.len()).text.contains("scale") {
                let place = self.reader.place(line.piece.range());
                let message = "the scale of a module has no effect".to_owned();
                let help = "contexts see modules of every scale; name those that they skip by 'ignore:'";
                self.reader.session.warning("L008", message, place, help);
            }
            for part in split(names) {
                let name = part.text.split('(').next().unwrap_or("").trim();
                if let Some(params) = parameters_of(part) {
                    let params = params.into_iter().map(|(param, _)| param).collect();
                    self.module_parameters.insert(name.to_owned(), params);
                }
                if !name.is_empty() && !self.declared.iter().any(|d| d == name) {
                    self.declared.push(name.to_owned());
                }
            }
        }
    }

    pub(super) fn lines(&mut self, list: &[Line<'_>]) {
        let mut i = 0;
        while let Some(line) = list.get(i) {
            let text = line.piece.text;
            if text == "endlsystem" {
                return;
            }
            i = self.line(list, i, *line);
        }
    }

    /// Reads the line `i` and its block; returns the index of the next line.
    fn line(&mut self, list: &[Line<'_>], i: usize, line: Line<'_>) -> usize {
        let piece = line.piece;
        let sections = [
            (&["production"][..], Section::Rules),
            (&["productions"], Section::Rules),
            (&["decomposition"], Section::Decomposition),
            (&["interpretation"], Section::Interpretation),
            (&["homomorphism"], Section::Interpretation),
        ];
        // Read section headings first, then items with a value, then groups, rules and statements.
        for (words, section) in sections {
            if after_heading(piece, words).is_some_and(|rest| rest.text.is_empty()) {
                self.section = section;
                return i + 1;
            }
        }
        if let Some(rest) = after_heading(piece, &["axiom"]) {
            let (block, next) = block_after(list, i, line.indent);
            self.second("the axiom", piece, KEEP_ONE);
            self.axiom(rest, block);
            return next;
        }
        if let Some(rest) = after_heading(piece, &["derivation", "length"]) {
            self.second("the derivation length", piece, KEEP_ONE);
            // Python allows a semicolon after a statement.
            self.set_length(Piece::new(rest.at, rest.text.trim_end_matches([';', ' '])));
            return i + 1;
        }
        if let Some(rest) = after_heading(piece, &["maximum", "depth"]) {
            let is_decomposition = self.section == Section::Decomposition;
            let whose =
                if is_decomposition { "the depth of the decomposition" } else { "the depth of the interpretation" };
            self.second(whose, piece, KEEP_ONE);
            self.set_depth(rest);
            return i + 1;
        }
        for (word, hides) in [("ignore", true), ("consider", false)] {
            if let Some(rest) = after_heading(piece, &[word]) {
                // A later list replaces the earlier one for the productions after it, even if one is `ignore` and the other `consider`.
                if let Some((_, true)) = self.ignored_line {
                    self.given.remove(LIST);
                }
                self.second(LIST, piece, "write all symbols in one line: a list is for the productions behind it");
                self.ignored(rest, hides);
                self.ignored_line = Some((piece.range(), false));
                return i + 1;
            }
        }
        let (word, rest) = piece.first_word(&[':']);
        match word.text {
            "group" => {
                let number = Piece::new(rest.at, rest.text.trim_matches([':', ' ']));
                self.group = number.text.parse().unwrap_or(0.0);
                return i + 1;
            }
            "endgroup" => {
                self.group = 0.0;
                return i + 1;
            }
            // Module names were collected before; views do not affect the string.
            "module" | "initial_view" => return i + 1,
            _ => {}
        }
        if self.section != Section::Header && is_rule(piece) {
            if let Some((_, is_used)) = &mut self.ignored_line {
                *is_used = true;
            }
            let (section, group) = (self.section, self.group);
            self.productions.push(ProductionLine { index: i, section, group, ignored: self.ignored.clone() });
            return block_after(list, i, line.indent).1;
        }
        self.python(list, i, line)
    }

    /// Reads the productions. As in L-Py, they use the final values of the model's names, and functions defined after them.
    pub(super) fn read_productions(&mut self, list: &[Line<'_>]) {
        let blocks: Vec<Range<usize>> = self.run_later.iter().map(|(_, body, _)| body.clone()).collect();
        for body in blocks {
            self.hide_unreadable(list.get(body).unwrap_or(&[]));
        }
        self.begin_changed_lists();
        self.read_callers_again(list);
        if let Some((line, false)) = self.ignored_line.clone() {
            let place = self.reader.place(line);
            let message = "this list has no effect, since no production follows it".to_owned();
            self.reader.session.warning(
                "L008",
                message,
                place,
                "move it before the productions whose contexts it is for",
            );
        }
        for ProductionLine { index, section, group, ignored } in std::mem::take(&mut self.productions) {
            (self.section, self.group, self.ignored) = (section, group, ignored);
            self.rule(list, index);
        }
        // Remove the variables of the last production, which the functions that L-Py runs must not see.
        self.scope.locals.clear();
    }

    fn constant(&mut self, value: Piece<'_>) -> Option<f64> {
        // Shared names have their initial values.
        let mut scope = self.scope.clone();
        scope.constants.extend(self.initial.clone());
        let code = parse(value).and_then(|e| compile(&e, &scope));
        let code = self.settle(code)?;
        let number = vm::constant_value(&code).filter(|v| v.is_finite());
        if number.is_none() {
            self.refuse(&Refusal::new("a number that is not constant", value.range()));
        }
        number
    }

    /// The value of a constant expression; `None` for other expressions.
    pub(super) fn known_number(&self, value: Piece<'_>) -> Option<f64> {
        let mut scope = self.scope.clone();
        scope.constants.extend(self.initial.clone());
        let code = parse(value).and_then(|e| compile(&e, &scope)).ok()?;
        vm::constant_value(&code).filter(|v| v.is_finite())
    }

    /// Like [`Self::constant`], but truncated to an integer, with L008 if it is a fraction.
    fn whole_number(&mut self, value: Piece<'_>) -> Option<f64> {
        let n = self.constant(value)?;
        if n.fract().abs() > 0.0 {
            let message = format!("{n} is no whole number, {} is taken", n.trunc());
            let place = self.reader.place(value.range());
            self.reader.session.warning("L008", message, place, "write a whole number");
        }
        Some(n.trunc())
    }

    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped before the cast")]
    fn set_length(&mut self, value: Piece<'_>) {
        let place = self.reader.place(value.range());
        if let Some(n) = self.whole_number(value) {
            self.reader.program.length = n.clamp(0.0, 1e6) as u32;
            self.reader.program.length_place = Some(place);
        }
    }

    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped before the cast")]
    fn set_depth(&mut self, value: Piece<'_>) {
        let Some(n) = self.whole_number(value) else { return };
        let depth = n.clamp(0.0, 1e6) as u32;
        match self.section {
            Section::Decomposition => self.reader.program.decomposition.depth = depth,
            _ => self.reader.program.homomorphism.depth = depth,
        }
    }

    fn ignored(&mut self, value: Piece<'_>, hides: bool) {
        let spelled = spell(value, &self.declared);
        let Some(list) = self.settle(spelled) else { return };
        let list: Vec<SymbolId> = list.iter().filter(|s| s.name != ",").filter_map(|s| self.symbol(&s.name)).collect();
        self.ignored = if hides { IgnoredSymbols::Listed(list) } else { IgnoredSymbols::AllExcept(list) };
    }

    /// If all productions with contexts ignore the same symbols, as they do if a single list precedes them, stores that list
    /// once, in the program.
    pub(super) fn share_ignored_symbols(&mut self) {
        let program = &mut self.reader.program;
        let sets = [&mut program.rules, &mut program.decomposition, &mut program.homomorphism];
        let mut all: Vec<&mut Production> = sets.into_iter().flat_map(|set| &mut set.list).collect();
        let mut lists = all.iter().filter(|p| !p.is_context_free()).map(|p| p.ignored.as_ref());
        let first = lists.next().unwrap_or(Some(&self.ignored)).cloned();
        let is_one = lists.all(|list| list == first.as_ref());
        for p in &mut all {
            if is_one || p.is_context_free() {
                p.ignored = None;
            }
        }
        if is_one {
            program.ignored = first.unwrap_or_default();
        }
    }

    /// Reads `Axiom: modules`, or a block with `nproduce`.
    fn axiom(&mut self, value: Piece<'_>, block: &[Line<'_>]) {
        self.has_axiom = true;
        self.is_outside_of_blocks = true;
        let statements = if value.text.is_empty() {
            self.statements(block)
        } else {
            self.modules_of(value, block).map(|m| vec![Statement::Produce(m, true)])
        };
        self.is_outside_of_blocks = false;
        let Some(statements) = self.settle(statements) else { return };
        // Variables of the block do not belong to the model.
        let (mut names, mut globals) = (Vec::new(), Vec::new());
        assigned(&statements, &mut names, &mut globals);
        names.retain(|name| !globals.contains(name));
        let own: Vec<String> = names.iter().map(|name| format!("{name} (axiom)")).collect();
        let statements: Vec<Statement> = statements.iter().map(|s| renamed(s, &names, &own)).collect();
        self.is_in_axiom = true;
        let paths = self.execution_paths(&statements);
        self.is_in_axiom = false;
        let Some(paths) = self.settle(paths) else { return };
        let [path] = paths.as_slice() else {
            return self.refuse(&Refusal::new("an axiom with 'if'", value.range()));
        };
        // The computations of the axiom run before the first step.
        for step in &path.steps {
            match step {
                Step::Store(store) => {
                    let why = format!("a change of the list '{}' in the axiom", store.list);
                    let why = Refusal::new(why, value.range());
                    return self.refuse(&why.remedy("change it in Start(), which runs before the first step"));
                }
                Step::Assign(name, e) => self.global(name, e, value.range()),
                Step::Loop(_, _, place) => {
                    return self.refuse(&Refusal::new("a loop of the axiom whose turns are drawn", place.clone()));
                }
                Step::Condition(..) => {}
            }
        }
        let successor = self.successor(&path.modules);
        if let Some(successor) = successor {
            self.reader.axiom(successor);
        }
    }

    /// Reads the modules of an axiom or a successor, which may continue on indented lines.
    pub(super) fn modules_of(&self, first: Piece<'_>, block: &[Line<'_>]) -> Result<Vec<PyModule>, Refusal> {
        let mut out = modules(first, &self.declared)?;
        for line in block {
            if colon(line.piece).is_some() {
                let why = Refusal::new("an indented line behind a string of modules", line.piece.range());
                return Err(why.remedy(
                    "write a heading or a statement without blanks before it; an indented line goes on with modules",
                ));
            }
            out.extend(modules(line.piece, &self.declared)?);
        }
        out.into_iter().map(|m| self.in_declared_order(m)).collect()
    }

    /// A module with its parameters in declared order, if they are given by name: `Leaf(size=2)`.
    pub(super) fn in_declared_order(&self, module: PyModule) -> Result<PyModule, Refusal> {
        let is_named = |arg: &PyExpr| matches!(arg, PyExpr::Call(name, ..) if name.ends_with('='));
        let Some(first) = module.args.iter().find(|arg| is_named(arg)) else { return Ok(module) };
        let refused = |what: &str| {
            let name = &module.name;
            let why =
                Refusal::new(format!("the module '{name}' with parameters by their names, {what}"), range_of(first));
            why.remedy("declare their names, module Leaf(size, age), and give each parameter once")
        };
        let params =
            self.module_parameters.get(&module.name).ok_or_else(|| refused("which no 'module' line declares"))?;
        let args =
            arguments(params, None, module.args.clone()).ok_or_else(|| refused("which are others than it declares"))?;
        Ok(PyModule { args, ..module })
    }
}
