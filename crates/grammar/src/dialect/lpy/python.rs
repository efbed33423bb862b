//! Reads Python outside of productions: the values of the model.

use std::ops::Range;

use super::Model;
use super::assignment::{assign_statement, change_of, unreadable_assignment};
use super::emit::append_code;
use super::execution_path::Step;
use super::expression::{PyExpr, first_call, is_dictionary, of_model};
use super::headings::KEEP_ONE;
use super::lines::{Line, block_after};
use super::parser::{Lambda, lambda, parse};
use super::pieces::{assignment, heads_block, is_seed, split, statements_of_line};
use super::refusal::{Refusal, indented_refusal, remedy_of};
use super::resolve::{compile, is_list_or_vector, resolve};
use super::run_functions::CALLED_FUNCTIONS;
use super::scope::has_random;
use super::statement::Statement;
use crate::code::Op;
use crate::dialect::text::Piece;
use crate::vm;

/// True if all lines are imports.
fn only_imports(block: &[Line<'_>]) -> bool {
    let is_import = |p: Piece<'_>| matches!(p.first_word(&[]).0.text, "import" | "from" | "pass");
    !block.is_empty() && block.iter().flat_map(|l| statements_of_line(l.piece)).all(is_import)
}

impl Model<'_, '_> {
    /// Reads a Python statement outside of rules; returns the index of the next line.
    pub(super) fn python(&mut self, list: &[Line<'_>], i: usize, line: Line<'_>) -> usize {
        let piece = line.piece;
        let (block, next) = block_after(list, i, line.indent);
        let parts = statements_of_line(piece);
        if parts.len() > 1 || parts.first().is_some_and(|p| p.text.len() < piece.text.len()) {
            for part in parts {
                let own = Line { indent: line.indent, piece: part };
                self.python(&[own], 0, own);
            }
            return next;
        }
        let (word, rest) = piece.first_word(&['(', ':', '=']);
        let range = piece.range();
        if let Some(inner) = block.first().filter(|_| !heads_block(word.text)) {
            self.refuse(&indented_refusal(inner.piece));
            return next;
        }
        match word.text {
            "pass" | "print" | "global" | "assert" => return next,
            "import" | "from" => {
                self.import(piece);
                return next;
            }
            "extern" if rest.text.starts_with('(') => {
                self.external(rest);
                return next;
            }
            "def" => {
                let name = rest.text.split('(').next().unwrap_or("").trim();
                if let Some(called) = CALLED_FUNCTIONS.into_iter().find(|called| *called == name) {
                    self.second(called, piece, KEEP_ONE);
                    self.run_later.retain(|(other, ..)| other != name);
                    self.hide_unreadable(block);
                    self.run_later.push((name.to_owned(), i + 1..next, range));
                } else {
                    self.definitions.insert(name.to_owned(), i);
                    self.function(rest, block, &range);
                }
                return next;
            }
            // A `try` block of imports only: read the imports and skip the `except` blocks, since imports never fail here.
            "try" if rest.text == ":" && only_imports(block) => {
                block.iter().for_each(|l| self.import(l.piece));
                let mut end = next;
                let is_except =
                    |l: &&Line<'_>| l.indent == line.indent && l.piece.first_word(&[':', '(']).0.text == "except";
                while let Some(more) = list.get(end).filter(is_except) {
                    end = block_after(list, end, more.indent).1;
                }
                return end;
            }
            "if" | "for" | "while" | "try" => {
                // Include the `elif` and `else` blocks of an `if`, the `else` block of a loop, and the other blocks of a `try`.
                let mut end = next;
                let more_words: &[&str] =
                    if word.text == "try" { &["except", "else", "finally"] } else { &["elif", "else"] };
                while let Some(more) = list.get(end).filter(|more| more.indent == line.indent) {
                    if !more_words.contains(&more.piece.first_word(&['(', ':']).0.text) {
                        break;
                    }
                    end = block_after(list, end, more.indent).1;
                }
                self.is_outside_of_blocks = true;
                let statements = self.statements(list.get(i..end).unwrap_or(&[]));
                self.is_outside_of_blocks = false;
                let is_known = statements.and_then(|statements| self.run(&statements, &range));
                if self.settle(is_known) == Some(false) {
                    let why = Refusal::new(format!("'{}' outside of a production", word.text), range);
                    self.refuse(
                        &why.remedy("only a run knows what it does: write it into Start(), or into a production"),
                    );
                }
                return end;
            }
            // The attributes of classes were read earlier; a class that cannot be read is refused where an object of it is made.
            "class" => {
                self.methods(list, i, line.indent);
                return next;
            }
            "del" if rest.text.contains('[') => {}
            "with" | "raise" | "del" => {
                let why = Refusal::new(format!("'{}' outside of a production", word.text), range);
                self.refuse(&Refusal { remedy: remedy_of(word.text), ..why });
                return next;
            }
            _ if word.text.starts_with('@') => {
                self.refuse(&Refusal::new("a decorator", range));
                return next;
            }
            _ => {}
        }
        // Turtle angles, seeds, and other settings that do not affect rules.
        if self.turtle_setting(piece) {
            return next;
        }
        let compact: String = piece.text.chars().filter(|c| !c.is_whitespace()).collect();
        let is_setting = ["context(", "lsystem.", "sys.path", "setCodeVersion"];
        if is_setting.iter().any(|s| compact.starts_with(s)) || is_seed(piece) {
            return next;
        }
        match change_of(piece) {
            Ok(None) => {}
            Ok(Some(changes)) => {
                for (name, e) in changes {
                    let is_lost = self.check_change_of_model(&name, &e);
                    if self.settle(is_lost) == Some(false) {
                        self.global(&name, &e, range.clone());
                    }
                }
                return next;
            }
            Err(why) => {
                self.refuse(&why);
                return next;
            }
        }
        // Handle `x += 2`; a plain assignment may contain lists and several names.
        if assignment(piece).is_none()
            && let Ok([Statement::Assign(name, e)]) = assign_statement(piece).as_deref()
            && name.chars().all(|c| c.is_alphanumeric() || c == '_')
        {
            let is_lost = self.check_change_of_model(name, e);
            if self.settle(is_lost) == Some(false) {
                self.global(name, e, range);
            }
            return next;
        }
        if let Some((names, mut value)) = assignment(piece) {
            // `x = y = 3` sets both names.
            let mut others = Vec::new();
            while let Some((more, last)) = assignment(value) {
                others.extend(split(more));
                value = last;
            }
            for name in others {
                match parse(value) {
                    Ok(e) => self.global(name.text, &e, value.range()),
                    Err(why) => {
                        self.scope.constants.remove(name.text);
                        self.scope.unreadable.insert(name.text.to_owned(), why);
                    }
                }
            }
            let (names, values) = (split(names), split(value));
            if names.iter().any(|name| name.text.starts_with(['*', '('])) {
                match assign_statement(piece) {
                    Ok(statements) => {
                        for statement in statements {
                            if let Statement::Assign(name, e) = statement {
                                self.global(&name, &e, value.range());
                            }
                        }
                    }
                    Err(why) => self.refuse(&why),
                }
                return next;
            }
            if let ([name], Some(Lambda { params, defaults, value })) = (names.as_slice(), lambda(value)) {
                let defaults = defaults.into_iter().map(|d| d.and_then(|d| self.default_value(d))).collect();
                self.scope.defaults.insert(name.text.to_owned(), defaults);
                let body = of_model(&value, &params, &self.shared);
                self.scope.functions.insert(name.text.to_owned(), (params, body));
                return next;
            }
            // A list is unpacked to several names.
            if names.len() > 1
                && values.len() == 1
                && let Ok(PyExpr::List(items, _)) = parse(value).and_then(|e| resolve(&e, &self.scope, 0))
                && items.len() == names.len()
            {
                for (name, item) in names.iter().zip(&items) {
                    self.global(name.text, item, value.range());
                }
                return next;
            }
            // Python evaluates all values before it sets the first name.
            let read = |k: usize| {
                let one = if names.len() == values.len() { values.get(k).copied() } else { Some(value) };
                let e = one.map_or_else(|| Err(Refusal::new("this assignment", range.clone())), parse)?;
                if names.len() > 1 { resolve(&e, &self.scope, 0) } else { Ok(e) }
            };
            let taken: Vec<_> = (0..names.len()).map(read).collect();
            for (name, e) in names.iter().zip(taken) {
                match e {
                    Ok(e) => self.global(name.text, &e, value.range()),
                    Err(why) => {
                        self.scope.constants.remove(name.text);
                        self.scope.lists.remove(name.text);
                        self.scope.unreadable.insert(name.text.to_owned(), Refusal { range: value.range(), ..why });
                    }
                }
            }
            return next;
        }
        // Strings and bare numbers have no effect.
        if piece.text.starts_with(['"', '\'']) || piece.text.parse::<f64>().is_ok() {
            return next;
        }
        let shown: String = piece.text.chars().take(40).collect();
        self.refuse(&Refusal::new(format!("'{shown}'"), range));
        next
    }

    /// Reads `extern(n = 3, angle = 60)`: values that a program which calls L-Py, or a slider of the file, may have set before.
    fn external(&mut self, rest: Piece<'_>) {
        let inside = rest.up_to(rest.text.rfind(')').unwrap_or(rest.text.len())).from(1);
        for part in split(inside) {
            match assignment(part) {
                Some((name, _)) if self.scope.constants.contains_key(name.text) => {}
                Some((name, value)) => match parse(value) {
                    Ok(e) => self.global(name.text, &e, value.range()),
                    Err(why) => {
                        let refusal = Refusal { range: value.range(), ..why };
                        self.scope.unreadable.insert(name.text.to_owned(), refusal);
                    }
                },
                None => self.refuse(&Refusal::new(format!("'{}' in 'extern'", part.text), part.range())),
            }
        }
    }

    /// Sets a value of the model: a constant, or a number that is drawn once.
    pub(super) fn global(&mut self, name: &str, e: &PyExpr, range: Range<usize>) {
        // A value that calls a function of statements is computed like a block of the axiom. If the function cannot run, the use
        // of the value is refused.
        let mut refused = None;
        if first_call(e, &|name| self.has_body(name)).is_some() {
            match self.run(&[Statement::Assign(name.to_owned(), e.clone())], &range) {
                Ok(true) => return,
                Ok(false) => {}
                Err(why) => refused = Some(why),
            }
        }
        match e {
            PyExpr::Text(_, place) if !place.is_empty() => self.texts.insert(name.to_owned(), place.clone()),
            _ => self.texts.remove(name),
        };
        let is_shared = self.shared.iter().any(|s| s == name);
        let resolved = resolve(e, &self.scope, 0);
        if let Ok(list) = &resolved
            && (is_list_or_vector(list) || is_dictionary(list))
            && (!is_shared || self.scope.changing.contains(name))
            && (!has_random(list, &self.scope) || self.scope.changing.contains(name))
        {
            self.share_lists_of_model(name, e);
            self.scope.constants.remove(name);
            self.scope.unreadable.remove(name);
            self.scope.lists.insert(name.to_owned(), list.clone());
            return;
        }
        self.scope.lists.remove(name);
        // A string can be compared and passed on by its name, but is not a number.
        if matches!(resolved, Ok(PyExpr::Text(..))) {
            self.scope.texts.insert(name.to_owned());
        } else {
            self.scope.texts.remove(name);
        }
        let code = match resolved.and_then(|e| compile(&e, &self.scope)) {
            Ok(code) => code,
            Err(why) => {
                // The name is refused only where it is used, because many models contain values that their rules do not need.
                let why = refused.unwrap_or(why);
                self.scope.constants.remove(name);
                self.scope.unreadable.insert(name.to_owned(), Refusal { range, ..why });
                return;
            }
        };
        self.scope.unreadable.remove(name);
        if let Some(value) = vm::constant_value(&code) {
            if !is_shared {
                self.scope.constants.insert(name.to_owned(), value);
                return;
            }
            self.initial.insert(name.to_owned(), value);
        }
        self.scope.constants.remove(name);
        // A slot above 65,535 would be that of another value. `Scope::slot` does not find names with such slots, so that each use
        // is refused.
        let slot = self.scope.global(name);
        append_code(&mut self.start, &code.ops);
        self.start.push(Op::StoreGlobal(slot));
    }

    /// Runs statements of the model like the block of an axiom; false if their execution path is known only at run time.
    fn run(&mut self, statements: &[Statement], range: &Range<usize>) -> Result<bool, Refusal> {
        self.is_in_axiom = true;
        let paths = self.execution_paths(statements);
        self.is_in_axiom = false;
        let paths = paths?;
        let [path] = paths.as_slice() else { return Ok(false) };
        if !path.modules.is_empty() || !path.steps.iter().all(|step| matches!(step, Step::Assign(..))) {
            return Ok(false);
        }
        for step in &path.steps {
            if let Step::Assign(name, e) = step {
                self.global(name, e, range.clone());
            }
        }
        for (name, list) in &path.lists {
            self.global(name, list, range.clone());
        }
        self.shared_lists.extend(path.shared_lists.iter().cloned());
        Ok(true)
    }

    /// Records the names that a function run by L-Py sets to unreadable values; a production that uses one is refused.
    pub(super) fn hide_unreadable(&mut self, block: &[Line<'_>]) {
        let unreadable = |line| unreadable_assignment(line, &self.scope, &self.defined);
        let found: Vec<_> = block.iter().filter_map(unreadable).collect();
        for (name, why) in found {
            self.scope.constants.remove(name);
            self.scope.unreadable.insert(name.to_owned(), why);
        }
    }
}
