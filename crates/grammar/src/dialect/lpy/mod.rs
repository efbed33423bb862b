//! Files of L-Py whose productions are rules and expressions: no more of Python than constants, functions of one expression, `if` and
//! `for` over a constant range. A production with `if` becomes one production for each way through it.

mod expression;
mod rule;
mod statement;
mod strings;

use std::ops::Range;

use self::expression::{PyExpr, Refusal, Scope, compile, parse};
use self::rule::Step;
use self::statement::Statement;
use self::strings::{modules, spell, split};
use super::Reader;
use super::text::{Piece, lines};
use crate::code::{Bytecode, Op};
use crate::program::IgnoredSymbols;
use crate::symbols::SymbolId;
use crate::vm;

/// A line of code with its indentation.
#[derive(Debug, Clone, Copy)]
struct Line<'t> {
    indent: usize,
    piece: Piece<'t>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Section {
    Header,
    Rules,
    Decomposition,
    Interpretation,
}

/// A file while its lines are read.
struct Model<'r, 's> {
    reader: &'r mut Reader<'s>,
    scope: Scope,
    declared: Vec<String>,
    section: Section,
    group: f64,
    has_axiom: bool,
    /// Statements of Python that the model could not run without; the first is named.
    refusals: usize,
    start: Vec<Op>,
    temporaries: usize,
}

/// Reads a model of L-Py into the reader's program: sections, rules, and values computed outside of rules.
pub(super) fn read(reader: &mut Reader<'_>, text: &str) {
    reader.description = description(text);
    let plain = without_comments(text);
    let list: Vec<Line<'_>> = lines(&plain).filter_map(line_of).collect();
    reader.program.length = 1;
    let mut model = Model {
        reader,
        scope: Scope::default(),
        declared: Vec::new(),
        section: Section::Header,
        group: 0.0,
        has_axiom: false,
        refusals: 0,
        start: Vec::new(),
        temporaries: 0,
    };
    // Sliders and module names first: L-Py knows them wherever the file has them.
    model.parameters(&list);
    model.declarations(&list);
    model.lines(&list);
    model.finish(text);
}

/// The first comment, or the text in quotes, that opens the file.
fn description(text: &str) -> String {
    let first = text.trim_start();
    let quoted = first.strip_prefix("\"\"\"").and_then(|t| t.split("\"\"\"").next());
    let line = quoted.or_else(|| first.strip_prefix('#')).unwrap_or("");
    line.trim().lines().next().unwrap_or("").trim_matches(['#', '-', '=', ' ']).to_owned()
}

/// The text with blanks in place of comments, of texts in three quotes, of the ends of lines within parentheses and of those behind a
/// backslash: every place stays.
fn without_comments(text: &str) -> String {
    let bytes = text.as_bytes();
    let mut out: Vec<u8> = bytes.to_vec();
    let (mut i, mut depth) = (0, 0_usize);
    let blank = |out: &mut Vec<u8>, range: Range<usize>| {
        if let Some(part) = out.get_mut(range) {
            part.fill(b' ');
        }
    };
    while let Some(&b) = bytes.get(i) {
        let rest = &bytes[i..];
        let triple = [&b"\"\"\""[..], &b"'''"[..]].into_iter().find(|q| rest.starts_with(q));
        if let Some(quotes) = triple {
            // Both quotes and what lies between; a text that is not closed reaches to the end of the file.
            let inner = rest[3..].windows(3).position(|w| w == quotes).map_or(rest.len(), |n| n + 6);
            blank(&mut out, i..i + inner);
            i += inner;
            continue;
        }
        match b {
            b'#' => {
                let end = rest.iter().position(|c| matches!(c, b'\n' | b'\r')).unwrap_or(rest.len());
                blank(&mut out, i..i + end);
                i += end;
                continue;
            }
            b'"' => {
                // A text within one line, whose '#' is no comment.
                let end = rest[1..].iter().position(|c| matches!(c, b'"' | b'\n')).map_or(rest.len(), |n| n + 2);
                i += end;
                continue;
            }
            b'\\' if matches!(bytes.get(i + 1), Some(b'\n' | b'\r')) => {
                let n = if rest.get(1..3) == Some(b"\r\n") { 3 } else { 2 };
                blank(&mut out, i..i + n);
                i += n;
                continue;
            }
            b'(' => depth += 1,
            b')' => depth = depth.saturating_sub(1),
            // A heading that begins a line was not meant to be a parameter: the parenthesis before it lacks its partner.
            b'\n' | b'\r' if depth > 0 => {
                if rest.get(1).is_some_and(|c| matches!(c, b' ' | b'\t' | b')' | b'\n')) {
                    out[i] = b' ';
                } else {
                    depth = 0;
                }
            }
            _ => {}
        }
        i += 1;
    }
    String::from_utf8(out).unwrap_or_else(|_| text.to_owned())
}

/// A line that holds something.
fn line_of(piece: Piece<'_>) -> Option<Line<'_>> {
    let trimmed = piece.trimmed();
    if trimmed.text.is_empty() {
        return None;
    }
    let lead = &piece.text[..trimmed.at - piece.at];
    // A tab reaches to the next multiple of 8, as in Python.
    let indent = lead.chars().fold(0, |n, c| if c == '\t' { n / 8 * 8 + 8 } else { n + 1 });
    Some(Line { indent, piece: trimmed })
}

/// What follows a heading such as `Axiom:`, whose words any number of blanks may part.
fn after_heading<'t>(piece: Piece<'t>, words: &[&str]) -> Option<Piece<'t>> {
    let mut rest = piece;
    for word in words {
        let t = rest.trimmed();
        if !t.text.get(..word.len())?.eq_ignore_ascii_case(word) {
            return None;
        }
        rest = t.from(word.len());
    }
    let t = rest.trimmed();
    t.text.starts_with(':').then(|| t.from(1).trimmed())
}

/// Lines of a block after line `i`, which are indented more than it, and the index of the line after them.
fn block_after<'l, 't>(list: &'l [Line<'t>], i: usize, indent: usize) -> (&'l [Line<'t>], usize) {
    let n = list.get(i + 1..).unwrap_or(&[]).iter().take_while(|l| l.indent > indent).count();
    (&list[i + 1..i + 1 + n], i + 1 + n)
}

impl<'s> Model<'_, 's> {
    fn refuse(&mut self, why: &Refusal) {
        self.refusals += 1;
        let place = self.reader.place(why.range.clone());
        let line = self.reader.line_number(why.range.start);
        let message = format!("this is L-Py with Python code, line {line}: {}", why.construct);
        let help = "osier reads rules, expressions, constants, functions of one expression, 'if', and 'for' over a constant \
                    range; pass what a production needs as parameters of its modules";
        self.reader.session.error_help("L007", message, place, help);
    }

    fn settle<T>(&mut self, result: Result<T, Refusal>) -> Option<T> {
        match result {
            Ok(value) => Some(value),
            Err(why) => {
                self.refuse(&why);
                None
            }
        }
    }

    /// Values of the sliders that L-Py saves behind the model: `('name', 'Integer', 5, 1, 10)`.
    fn parameters(&mut self, list: &[Line<'_>]) {
        for line in list.iter().filter(|l| l.piece.text.starts_with("scalars")) {
            for part in line.piece.text.split('(').skip(1) {
                let fields: Vec<&str> =
                    part.split([',', ')']).map(|f| f.trim().trim_matches(['\'', '"', ' '])).collect();
                let number = fields.get(2).and_then(|v| match *v {
                    "True" => Some(1.0),
                    "False" => Some(0.0),
                    v => v.parse::<f64>().ok(),
                });
                if let (Some(name), Some(value)) = (fields.first(), number) {
                    self.scope.constants.insert((*name).to_owned(), value);
                }
            }
        }
    }

    /// Names of modules, wherever they are declared.
    fn declarations(&mut self, list: &[Line<'_>]) {
        for line in list {
            let (word, rest) = line.piece.first_word(&[]);
            if word.text != "module" || rest.text.is_empty() {
                continue;
            }
            let names = rest.before(':');
            for part in split(names) {
                let name = part.text.split('(').next().unwrap_or("").trim();
                if !name.is_empty() && !self.declared.iter().any(|d| d == name) {
                    self.declared.push(name.to_owned());
                }
            }
        }
    }

    fn lines(&mut self, list: &[Line<'_>]) {
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
        // Headings of sections, then items with a value, then groups, rules and statements.
        for (words, section) in sections {
            if after_heading(piece, words).is_some_and(|rest| rest.text.is_empty()) {
                self.section = section;
                return i + 1;
            }
        }
        if let Some(rest) = after_heading(piece, &["axiom"]) {
            let (block, next) = block_after(list, i, line.indent);
            self.axiom(rest, block);
            return next;
        }
        if let Some(rest) = after_heading(piece, &["derivation", "length"]) {
            self.length(rest);
            return i + 1;
        }
        if let Some(rest) = after_heading(piece, &["maximum", "depth"]) {
            self.depth(rest);
            return i + 1;
        }
        for (word, hides) in [("ignore", true), ("consider", false)] {
            if let Some(rest) = after_heading(piece, &[word]) {
                self.ignored(rest, hides);
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
            "module" | "initial_view" => return i + 1,
            "import" | "from" => return i + 1,
            _ => {}
        }
        if self.section != Section::Header && is_rule(piece) {
            return self.rule(list, i, line);
        }
        self.python(list, i, line)
    }

    fn constant(&mut self, value: Piece<'_>) -> Option<f64> {
        let code = parse(value).and_then(|e| compile(&e, &self.scope));
        let code = self.settle(code)?;
        let number = vm::constant_value(&code).filter(|v| v.is_finite());
        if number.is_none() {
            self.refuse(&Refusal::new("a number that is not constant", value.range()));
        }
        number
    }

    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped before the cast")]
    fn length(&mut self, value: Piece<'_>) {
        let place = self.reader.place(value.range());
        if let Some(n) = self.constant(value) {
            self.reader.program.length = n.clamp(0.0, 1e6) as u32;
            self.reader.program.length_place = Some(place);
        }
    }

    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped before the cast")]
    fn depth(&mut self, value: Piece<'_>) {
        let Some(n) = self.constant(value) else { return };
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
        self.reader.program.ignored =
            if hides { IgnoredSymbols::Listed(list) } else { IgnoredSymbols::AllExcept(list) };
    }

    /// The symbol of a name: its character, or a private one for a longer name.
    fn symbol(&mut self, name: &str) -> Option<SymbolId> {
        let mut chars = name.chars();
        let symbols = &mut self.reader.program.symbols;
        match (chars.next(), chars.next()) {
            (Some(c), None) => symbols.intern(c),
            _ => symbols.private_character(name).and_then(|c| symbols.intern(c)),
        }
    }

    /// `Axiom: modules`, or a block of `nproduce`.
    fn axiom(&mut self, value: Piece<'_>, block: &[Line<'_>]) {
        self.has_axiom = true;
        let statements = if value.text.is_empty() {
            self.statements(block, 0)
        } else {
            modules(value, &self.declared).map(|m| vec![Statement::Produce(m, true)])
        };
        let Some(statements) = self.settle(statements) else { return };
        let ways = self.ways(&statements);
        let Some(ways) = self.settle(ways) else { return };
        let [way] = ways.as_slice() else {
            return self.refuse(&Refusal::new("an axiom with 'if'", value.range()));
        };
        // What the axiom computes is computed before the first step.
        for step in &way.steps {
            if let Step::Assign(name, e) = step {
                self.global(name, e, value.range());
            }
        }
        let successor = self.successor(&way.modules);
        if let Some(successor) = successor {
            self.reader.axiom(successor);
        }
    }

    /// A value of the model: a constant, or a number that is drawn once.
    fn global(&mut self, name: &str, e: &PyExpr, range: Range<usize>) {
        let code = match compile(e, &self.scope) {
            Ok(code) => code,
            Err(why) => {
                // Named only where it is used: many models hold values that their rules do not need.
                self.scope.constants.remove(name);
                self.scope.unreadable.insert(name.to_owned(), Refusal { range, ..why });
                return;
            }
        };
        self.scope.unreadable.remove(name);
        if let Some(value) = vm::constant_value(&code) {
            self.scope.constants.insert(name.to_owned(), value);
            return;
        }
        self.scope.constants.remove(name);
        if !self.scope.globals.iter().any(|g| g == name) {
            self.scope.globals.push(name.to_owned());
        }
        // Slots beyond 65,535 cannot be stored; `Scope::slot` does not find their names either, so that each use is refused.
        let slot = self.scope.globals.iter().position(|g| g == name).unwrap_or(0);
        let offset = self.start.len();
        self.start.extend(code.ops.iter().map(|op| shifted(*op, offset)));
        self.start.push(Op::StoreGlobal(u16::try_from(slot).unwrap_or(u16::MAX)));
    }

    /// Python outside of rules; returns the index of the next line.
    fn python(&mut self, list: &[Line<'_>], i: usize, line: Line<'_>) -> usize {
        let piece = line.piece;
        let (block, next) = block_after(list, i, line.indent);
        let (word, rest) = piece.first_word(&['(', ':', '=']);
        let range = piece.range();
        match word.text {
            "pass" | "print" | "global" => return next,
            "def" => {
                self.function(rest, block, &range);
                return next;
            }
            "class" | "if" | "for" | "while" | "try" | "with" | "assert" | "raise" | "del" => {
                self.refuse(&Refusal::new(format!("'{}' outside of a production", word.text), range));
                return next;
            }
            _ if word.text.starts_with('@') => {
                self.refuse(&Refusal::new("a decorator", range));
                return next;
            }
            _ => {}
        }
        // Angles of the turtle, seeds, and other settings that change no rule.
        let compact: String = piece.text.chars().filter(|c| !c.is_whitespace()).collect();
        if let Some(at) =
            ["setAngleIncrement(", "angle_increment="].iter().find_map(|k| compact.find(k).map(|i| i + k.len()))
        {
            if let Ok(angle) = compact[at..].trim_end_matches(')').parse::<f64>()
                && let Some(turtle) = &mut self.reader.program.turtle
            {
                turtle.settings.angle_deg = Some(angle);
            }
            return next;
        }
        let is_setting = [
            "seed(",
            "random.seed(",
            "context(",
            "lsystem.",
            "numpy.random.seed(",
            "np.random.seed(",
            "setCodeVersion",
        ];
        if is_setting.iter().any(|s| compact.starts_with(s)) {
            return next;
        }
        if let Some((names, value)) = assignment(piece) {
            let (names, values) = (split(names), split(value));
            for (k, name) in names.iter().enumerate() {
                let one = if names.len() == values.len() { values.get(k).copied() } else { Some(value) };
                match one.map_or_else(|| Err(Refusal::new("this assignment", range.clone())), parse) {
                    Ok(e) => self.global(name.text, &e, value.range()),
                    Err(why) => {
                        self.scope.constants.remove(name.text);
                        self.scope.unreadable.insert(name.text.to_owned(), Refusal { range: value.range(), ..why });
                    }
                }
            }
            return next;
        }
        // Texts in quotes and bare numbers do nothing.
        if piece.text.starts_with(['"', '\'']) || piece.text.parse::<f64>().is_ok() {
            return next;
        }
        let shown: String = piece.text.chars().take(40).collect();
        self.refuse(&Refusal::new(format!("'{shown}'"), range));
        next
    }

    /// `def f(x): return e`; any other function is named where it is called, one that L-Py calls itself at once.
    fn function(&mut self, rest: Piece<'_>, block: &[Line<'_>], range: &Range<usize>) {
        let name = rest.text.split('(').next().unwrap_or("").trim().to_owned();
        let parsed = || {
            let open = rest.text.find('(')?;
            let inner = rest.from(open + 1);
            let close = strings::closing(inner.text)?;
            let params: Vec<String> = split(inner.up_to(close)).iter().map(|p| p.text.to_owned()).collect();
            let after = inner.from(close + 1).trimmed();
            let body = after.text.strip_prefix(':').map(|_| after.from(1).trimmed())?;
            let only = match block {
                [] => body,
                [one] if body.text.is_empty() => one.piece,
                _ => return None,
            };
            let value = only.text.strip_prefix("return").map(|_| only.from("return".len()))?;
            Some((params, parse(value).ok()?))
        };
        if let Some(function) = parsed() {
            self.scope.functions.insert(name, function);
            return;
        }
        let called = ["Start", "StartEach", "EndEach", "End", "StartInterpretation", "EndInterpretation", "PostDraw"];
        // A body that only sets seeds or prints changes nothing.
        let harmless = |l: &Line<'_>| {
            let text = l.piece.text;
            ["pass", "print", "global", "seed", "random.seed", "return None"].iter().any(|w| text.starts_with(w))
                || text == "return"
        };
        if called.contains(&name.as_str()) && !block.iter().all(harmless) {
            self.refuse(&Refusal::new(format!("the function '{name}', which L-Py runs"), range.clone()));
        }
    }

    fn finish(mut self, text: &str) {
        if !self.has_axiom && self.refusals == 0 {
            let piece = Piece::new(0, &text[..text.find('\n').unwrap_or(text.len())]);
            let place = self.reader.place(piece.range());
            let help = "write: Axiom: F";
            self.reader.session.error_help("L003", "the model has no axiom".into(), place, help);
        }
        let blocks = &mut self.reader.program.blocks;
        blocks.globals = self.scope.globals.len();
        if !self.start.is_empty() {
            blocks.start = Some(Bytecode { ops: std::mem::take(&mut self.start), ..Bytecode::default() });
        }
    }
}

/// An instruction moved behind others.
fn shifted(op: Op, by: usize) -> Op {
    match op {
        Op::Jump(t) => Op::Jump(t + by),
        Op::JumpIfZero(t) => Op::JumpIfZero(t + by),
        Op::And(t) => Op::And(t + by),
        Op::Or(t) => Op::Or(t + by),
        other => other,
    }
}

/// Index of the first colon outside of parentheses.
fn colon(piece: Piece<'_>) -> Option<usize> {
    let mut depth = 0_usize;
    piece.text.char_indices().find_map(|(i, c)| {
        depth = (depth + usize::from(c == '(')).saturating_sub(usize::from(c == ')'));
        (c == ':' && depth == 0).then_some(i)
    })
}

/// A production has an arrow, or ends its head with a colon; statements of Python do neither.
fn is_rule(piece: Piece<'_>) -> bool {
    let (word, _) = piece.first_word(&['(', ':', '=']);
    let is_python =
        ["def", "class", "if", "for", "while", "try", "with", "else", "elif", "from", "import"].contains(&word.text);
    piece.text.contains("-->") || piece.text.contains("-static->") || (!is_python && colon(piece).is_some())
}

/// `name = expression`; `None` for anything else.
fn assignment(piece: Piece<'_>) -> Option<(Piece<'_>, Piece<'_>)> {
    let i = piece.text.find('=')?;
    let names = piece.up_to(i).trimmed();
    let value = piece.from(i + 1).trimmed();
    let is_name = |p: &Piece<'_>| {
        let mut chars = p.text.chars();
        chars.next().is_some_and(|c| c.is_alphabetic() || c == '_') && chars.all(|c| c.is_alphanumeric() || c == '_')
    };
    (split(names).iter().all(is_name) && !names.text.is_empty() && !value.text.starts_with('='))
        .then_some((names, value))
}
