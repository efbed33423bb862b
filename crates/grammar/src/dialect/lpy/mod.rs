//! Models of L-Py: rules, and of Python the statements and expressions that docs/dialects.md lists. A production with `if` becomes one
//! production for each way through it.

mod bounds;
mod color;
mod dictionary;
mod expression;
mod imports;
mod lists;
mod parser;
mod rule;
mod statement;
mod strings;
mod ways;

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use self::expression::{
    OwnFunction, PyExpr, Refusal, Scope, compile, first_call, has_random, is_dictionary, of_model, resolve,
};
use self::lists::change_of;
use self::parser::parse;
use self::statement::{
    FunctionValue, GROUP, Statement, assign_statement, assigned, at_semicolons, heads_block, indented_refusal,
    only_returns, remedy_of, renamed, statements_of_line,
};
use self::strings::{PyModule, modules, spell, split};
use self::ways::Step;
use super::Reader;
use super::text::{Piece, lines};
use crate::code::Op;
use crate::program::IgnoredSymbols;
use crate::symbols::SymbolId;
use crate::token::SourcePlace;
use crate::vm;

/// Functions that L-Py runs at the beginning, around each step and around each drawing.
const CALLED_FUNCTIONS: [&str; 7] =
    ["Start", "StartEach", "EndEach", "End", "StartInterpretation", "EndInterpretation", "PostDraw"];
/// What the refusal of a function says that gives another string than it was given.
const OTHER_STRING: &str = "a function that returns another string";

/// Target of the jump of a `return`, until the end of its function is known.
const RETURN: usize = usize::MAX;

/// A line that is not blank; `indent` in columns.
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

struct Model<'r, 's> {
    reader: &'r mut Reader<'s>,
    scope: Scope,
    declared: Vec<String>,
    section: Section,
    group: f64,
    /// The model calls `useGroup()`.
    uses_groups: bool,
    has_axiom: bool,
    /// The statements that are read are those of the axiom: their loops are written out.
    is_in_axiom: bool,
    /// Number of statements of Python that the model could not run without.
    refusals: usize,
    /// What the values of the model compute before the first step.
    start: Vec<Op>,
    /// Functions that L-Py runs: at the beginning, before and after each step.
    functions: RunFunctions,
    /// Names that rules and functions declare `global`.
    shared: Vec<String>,
    /// Values of shared names before the first step, for items that need a constant.
    initial: BTreeMap<String, f64>,
    /// How many variables and lists this reader has named. Values of the model are among them, so that no production uses a number again.
    temporaries: usize,
    /// Functions that are more than one expression, by name: their parameters and statements.
    bodies: BTreeMap<String, (Vec<String>, Vec<Statement>)>,
    /// Lines of the functions of the model, by their names.
    definitions: BTreeMap<String, usize>,
    /// Lists of the model that have two names.
    shared_lists: BTreeSet<String>,
    /// Functions that the production which is read defines.
    own_functions: BTreeMap<String, OwnFunction>,
    /// Places of the loops that run as code, which each block with loops has a copy of.
    loop_places: Vec<SourcePlace>,
    /// How many parameters `*args` stands for in the present reading of a head.
    star: usize,
    /// Lists that the head of the present rule names, with those of the model that have these names.
    rule_lists: Vec<(String, Option<PyExpr>)>,
    /// Names and numbers of parameters of modules as the text has them.
    arities: BTreeSet<(String, usize)>,
    /// Lines of the functions that L-Py runs, which are read when all values of the model are known: name, first and last line
    /// of the body, place.
    run_later: Vec<(String, Range<usize>, Range<usize>)>,
    /// Lines of the productions, which are read when all values and functions of the model are known, with their section and group.
    productions: Vec<(usize, Section, f64)>,
    /// Parameters of the function that is read, which L-Py runs: the string, and what was drawn.
    run_parameters: Vec<String>,
    /// `backward()` was called, or `forward()`; `None`: neither.
    direction: Option<bool>,
}

/// Code of the functions that L-Py runs between the steps.
#[derive(Default)]
struct RunFunctions {
    start: Vec<Op>,
    start_each: Vec<Op>,
    end_each: Vec<Op>,
}

/// Reads a model of L-Py into the reader's program: sections, rules, and values computed outside of rules.
pub(super) fn read(reader: &mut Reader<'_>, text: &str) {
    reader.description = description(text);
    let plain = imports::without_aliases(&without_comments(text));
    let list: Vec<Line<'_>> = lines(&plain).filter_map(line_of).collect();
    reader.program.length = 1;
    let mut model = Model {
        reader,
        scope: Scope::default(),
        declared: Vec::new(),
        section: Section::Header,
        group: 0.0,
        uses_groups: plain.contains("useGroup("),
        has_axiom: false,
        is_in_axiom: false,
        refusals: 0,
        start: Vec::new(),
        functions: RunFunctions::default(),
        shared: Vec::new(),
        initial: BTreeMap::new(),
        temporaries: 0,
        bodies: BTreeMap::new(),
        definitions: BTreeMap::new(),
        shared_lists: BTreeSet::new(),
        own_functions: BTreeMap::new(),
        loop_places: Vec::new(),
        star: 0,
        rule_lists: Vec::new(),
        arities: BTreeSet::new(),
        run_later: Vec::new(),
        productions: Vec::new(),
        run_parameters: Vec::new(),
        direction: None,
    };
    if model.uses_groups {
        model.scope.global(GROUP);
    }
    model.scope.has_none = ["None", "''", "\"\"", ".get("].iter().any(|text| plain.contains(text));
    model.scope.is_backward = plain.contains("backward()");
    model.shared_names(&list);
    // Sliders and module names first: L-Py knows them wherever the file has them.
    model.parameters(&list);
    model.declarations(&list);
    model.arities = arities(&plain, &model.declared);
    let pieces: Vec<Piece<'_>> = list.iter().map(|l| l.piece).collect();
    model.reader.palette = color::palette(&pieces);
    model.lines(&list);
    model.read_productions(&list);
    for (name, body, place) in std::mem::take(&mut model.run_later) {
        // The body may stand on the line of the head: `def Start(): backward()`.
        let head = body.start.checked_sub(1).and_then(|i| list.get(i)).map(|l| l.piece);
        let inline =
            head.and_then(|h| colon(h).map(|c| statements_of_line(h.from(c + 1).trimmed()))).unwrap_or_default();
        let inline: Vec<Line<'_>> = inline.into_iter().map(|piece| Line { indent: 1, piece }).collect();
        let block = if inline.is_empty() { list.get(body).unwrap_or(&[]) } else { &inline };
        let parameters = head.and_then(parameters_of).unwrap_or_default();
        model.run_parameters = parameters.into_iter().map(|(name, _)| name).collect();
        model.called_function(&name, block, &place);
    }
    model.finish(text);
}

/// The first comment, or the text in quotes, that opens the file.
fn description(text: &str) -> String {
    let first = text.trim_start();
    let quoted = first.strip_prefix("\"\"\"").and_then(|t| t.split("\"\"\"").next());
    let line = quoted.or_else(|| first.strip_prefix('#')).unwrap_or("");
    line.trim().lines().next().unwrap_or("").trim_matches(['#', '-', '=', ' ']).to_owned()
}

/// Whether a text ends with the heading of an axiom, with nothing behind it.
fn begins_axiom(text: &[u8]) -> bool {
    let line = text.rsplit(|b| matches!(b, b'\n' | b'\r')).next().unwrap_or_default();
    line.trim_ascii().strip_suffix(b":").is_some_and(|word| word.trim_ascii().eq_ignore_ascii_case(b"axiom"))
}

/// Signs that mean something outside of texts in quotes.
const SIGNS: &[u8; 25] = b"()[]{}:;,=<>#*+-/%.&|!\"'\\";

/// A byte of a text in quotes: signs become control characters, one for each, so that what looks for signs finds none in texts and
/// different texts stay different.
fn masked(byte: u8) -> u8 {
    // 0x01 to 0x08 and 0x0e to 0x1e, which are no whitespace.
    let codes = (0x01..=0x08_u8).chain(0x0e..=0x1e);
    SIGNS.iter().zip(codes).find(|(sign, _)| **sign == byte).map_or(byte, |(_, code)| code)
}

/// The text with comments, texts in triple quotes, line ends within parentheses and line ends behind a backslash replaced by
/// blanks, so that all offsets stay; signs within other texts are [`masked`].
fn without_comments(text: &str) -> String {
    let bytes = text.as_bytes();
    let mut out: Vec<u8> = bytes.to_vec();
    let (mut i, mut depth, mut list) = (0, 0_usize, 0_usize);
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
            // Early versions set the width with `#`, and their axioms begin with it; a comment there would leave no axiom.
            b'#' if rest.starts_with(b"#(") && begins_axiom(&bytes[..i]) => out[i] = b'_',
            b'#' => {
                let end = rest.iter().position(|c| matches!(c, b'\n' | b'\r')).unwrap_or(rest.len());
                blank(&mut out, i..i + end);
                i += end;
                continue;
            }
            b'"' | b'\'' => {
                let length = quoted_length(rest);
                out.iter_mut().skip(i + 1).take(length.saturating_sub(2)).for_each(|b| *b = masked(*b));
                i += length;
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
            // A list or dictionary that is assigned to a name may span several lines. Its bracket stands behind a `=`, that of a branch
            // or polygon does not.
            b'[' | b'{' if list > 0 || bytes[..i].trim_ascii_end().ends_with(b"=") => list += 1,
            b']' | b'}' => list = list.saturating_sub(1),
            b'\n' | b'\r' if list > 0 && depth == 0 => out[i] = b' ',
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

/// Length of a text in quotes at the beginning of some bytes, whose '#' is no comment; it ends at its quote or at the end of the line.
fn quoted_length(bytes: &[u8]) -> usize {
    let quote = bytes.first().copied();
    let mut is_escaped = false;
    let end = bytes.iter().skip(1).position(|c| {
        let is_end = !is_escaped && (Some(*c) == quote || *c == b'\n');
        is_escaped = !is_escaped && *c == b'\\';
        is_end
    });
    end.map_or(bytes.len(), |n| n + 2)
}

/// Names of modules with the numbers of parameters that the text gives them; of texts without `*` among parameters none, as
/// nothing asks for them.
fn arities(text: &str, declared: &[String]) -> BTreeSet<(String, usize)> {
    let mut out = BTreeSet::new();
    if !text.contains("(*") && !text.contains(",*") && !text.contains(", *") {
        return out;
    }
    let single = text.chars().filter(char::is_ascii_alphabetic).map(|c| c.to_string()).collect::<BTreeSet<_>>();
    for name in declared.iter().cloned().chain(single) {
        for (i, _) in text.match_indices(name.as_str()) {
            // A longer word is another name, unless it is a row of modules: those of single letters cannot be told from it.
            let after = &text[i + name.len()..];
            let is_word = |c: Option<char>| c.is_some_and(|c| c.is_alphanumeric() || c == '_');
            if name.len() > 1 && (is_word(text[..i].chars().next_back()) || is_word(after.chars().next())) {
                continue;
            }
            let Some(inner) = after.strip_prefix('(') else {
                continue;
            };
            let Some(close) = strings::closing(inner) else { continue };
            let params = split(Piece::new(0, &inner[..close]));
            if !params.iter().any(|p| p.text.starts_with('*')) {
                out.insert((name.clone(), params.len()));
            }
        }
    }
    out
}

/// The name that a line of a function sets to a value that cannot be read, with the reason: only what uses the name is refused.
fn unreadable_assignment<'t>(line: &Line<'t>) -> Option<(&'t str, Refusal)> {
    let (names, value) = assignment(line.piece)?;
    let why = parse(value).err()?;
    (split(names).len() == 1).then_some((names.text, why))
}

/// A line with its indentation; `None` for a blank one.
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

/// The text behind the colon of a heading such as `Axiom:`; any number of blanks may separate the words of the heading.
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
        let help = why.remedy.unwrap_or(
            "osier reads rules, expressions, lists, dictionaries, functions with a value, 'if', 'for' and 'while'; pass what a \
             production needs as parameters of its modules",
        );
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

    /// Values of the sliders that L-Py saves behind the model: `('name', 'Integer', 5, 1, 10)`, in older files without the type.
    fn parameters(&mut self, list: &[Line<'_>]) {
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

    /// Names that some rule or function declares `global`: they may change from step to step.
    fn shared_names(&mut self, list: &[Line<'_>]) {
        for part in list.iter().flat_map(|line| at_semicolons(line.piece)) {
            // It may stand behind the head of its block: `def Start(): global n`.
            let at = part.text.rfind("global ").filter(|i| *i == 0 || part.up_to(*i).text.trim_end().ends_with(':'));
            if let Some(at) = at {
                self.shared.extend(split(part.from(at + "global ".len())).iter().map(|n| n.text.to_owned()));
            }
        }
    }

    /// Collects the names that `module` lines declare, wherever they stand in the file.
    fn declarations(&mut self, list: &[Line<'_>]) {
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
            // Python allows a semicolon behind a statement.
            self.set_length(Piece::new(rest.at, rest.text.trim_end_matches([';', ' '])));
            return i + 1;
        }
        if let Some(rest) = after_heading(piece, &["maximum", "depth"]) {
            self.set_depth(rest);
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
            // Module names were read before; views do not change the string.
            "module" | "initial_view" => return i + 1,
            _ => {}
        }
        if self.section != Section::Header && is_rule(piece) {
            self.productions.push((i, self.section, self.group));
            return block_after(list, i, line.indent).1;
        }
        self.python(list, i, line)
    }

    /// Reads the productions. As in L-Py they see the values that names of the model have at its end, and functions behind them.
    fn read_productions(&mut self, list: &[Line<'_>]) {
        let blocks: Vec<Range<usize>> = self.run_later.iter().map(|(_, body, _)| body.clone()).collect();
        for body in blocks {
            self.hide_unreadable(list.get(body).unwrap_or(&[]));
        }
        self.read_callers_again(list);
        for (i, section, group) in std::mem::take(&mut self.productions) {
            (self.section, self.group) = (section, group);
            self.rule(list, i);
        }
        // The functions that L-Py runs do not know the variables of the last one.
        self.scope.locals.clear();
    }

    /// Reads those functions again, as statements, that call a function of statements which stands behind them.
    fn read_callers_again(&mut self, list: &[Line<'_>]) {
        let calls_body = |model: &Self, name: &str| {
            let value = model.scope.functions.get(name).map(|(_, value)| value);
            value.is_some_and(|value| first_call(value, &|called| model.has_body(called)).is_some())
        };
        loop {
            let caller = self.definitions.iter().find(|(name, _)| calls_body(self, name));
            let Some((name, i)) = caller.map(|(name, i)| (name.clone(), *i)) else { return };
            let Some(line) = list.get(i) else { return };
            let (block, _) = block_after(list, i, line.indent);
            let (_, rest) = line.piece.first_word(&['(', ':', '=']);
            // Values of parameters are those where the function is defined.
            let defaults = self.scope.defaults.get(&name).cloned().unwrap_or_default();
            self.scope.functions.remove(&name);
            self.function(rest, block, &line.piece.range());
            self.scope.defaults.insert(name, defaults);
        }
    }

    /// Names that a function which L-Py runs sets to values that cannot be read: a production that uses one is refused.
    fn hide_unreadable(&mut self, block: &[Line<'_>]) {
        for (name, why) in block.iter().filter_map(unreadable_assignment) {
            self.scope.constants.remove(name);
            self.scope.unreadable.insert(name.to_owned(), why);
        }
    }

    fn constant(&mut self, value: Piece<'_>) -> Option<f64> {
        // Shared names have the values that they begin with.
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

    /// The value of an expression of constants; `None` for any other.
    fn known_number(&self, value: Piece<'_>) -> Option<f64> {
        let mut scope = self.scope.clone();
        scope.constants.extend(self.initial.clone());
        let code = parse(value).and_then(|e| compile(&e, &scope)).ok()?;
        vm::constant_value(&code).filter(|v| v.is_finite())
    }

    /// As [`Self::constant`], cut to an integer with L008 if it is a fraction.
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
            self.statements(block)
        } else {
            self.modules_of(value, block).map(|m| vec![Statement::Produce(m, true)])
        };
        let Some(statements) = self.settle(statements) else { return };
        // Variables of the block are none of the model.
        let (mut names, mut globals) = (Vec::new(), Vec::new());
        assigned(&statements, &mut names, &mut globals);
        names.retain(|name| !globals.contains(name));
        let own: Vec<String> = names.iter().map(|name| format!("{name} (axiom)")).collect();
        let statements: Vec<Statement> = statements.iter().map(|s| renamed(s, &names, &own)).collect();
        self.is_in_axiom = true;
        let ways = self.ways(&statements);
        self.is_in_axiom = false;
        let Some(ways) = self.settle(ways) else { return };
        let [way] = ways.as_slice() else {
            return self.refuse(&Refusal::new("an axiom with 'if'", value.range()));
        };
        // What the axiom computes is computed before the first step.
        for step in &way.steps {
            match step {
                Step::Assign(name, e) => self.global(name, e, value.range()),
                Step::Loop(_, _, place) => {
                    return self.refuse(&Refusal::new("a loop of the axiom whose turns are drawn", place.clone()));
                }
                Step::Condition(..) => {}
            }
        }
        let successor = self.successor(&way.modules);
        if let Some(successor) = successor {
            self.reader.axiom(successor);
        }
    }

    /// Modules of an axiom or a successor, which may go on in indented lines.
    fn modules_of(&self, first: Piece<'_>, block: &[Line<'_>]) -> Result<Vec<PyModule>, Refusal> {
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
        Ok(out)
    }

    /// Runs statements of the model as in the block of an axiom; false where only a run knows the way through them.
    fn run(&mut self, statements: &[Statement], range: &Range<usize>) -> Result<bool, Refusal> {
        self.is_in_axiom = true;
        let ways = self.ways(statements);
        self.is_in_axiom = false;
        let ways = ways?;
        let [way] = ways.as_slice() else { return Ok(false) };
        if !way.modules.is_empty() || !way.steps.iter().all(|step| matches!(step, Step::Assign(..))) {
            return Ok(false);
        }
        for step in &way.steps {
            if let Step::Assign(name, e) = step {
                self.global(name, e, range.clone());
            }
        }
        for (name, list) in &way.lists {
            self.global(name, list, range.clone());
        }
        self.shared_lists.extend(way.shared_lists.iter().cloned());
        Ok(true)
    }

    /// A value of the model: a constant, or a number that is drawn once.
    fn global(&mut self, name: &str, e: &PyExpr, range: Range<usize>) {
        // A function of statements runs as in the block of an axiom. One that cannot is named where the value is used.
        if first_call(e, &|name| self.has_body(name)).is_some()
            && let Ok(true) = self.run(&[Statement::Assign(name.to_owned(), e.clone())], &range)
        {
            return;
        }
        let is_shared = self.shared.iter().any(|s| s == name);
        let resolved = resolve(e, &self.scope, 0);
        if let Ok(list) = &resolved
            && (matches!(list, PyExpr::List(..)) || is_dictionary(list))
            && !is_shared
            && !has_random(list, &self.scope)
        {
            self.share_lists_of_model(name, e);
            self.scope.constants.remove(name);
            self.scope.unreadable.remove(name);
            self.scope.lists.insert(name.to_owned(), list.clone());
            return;
        }
        self.scope.lists.remove(name);
        // A text is compared and handed on under its name, too, and no number.
        if matches!(resolved, Ok(PyExpr::Text(..))) {
            self.scope.texts.insert(name.to_owned());
        } else {
            self.scope.texts.remove(name);
        }
        let code = match resolved.and_then(|e| compile(&e, &self.scope)) {
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
            if !is_shared {
                self.scope.constants.insert(name.to_owned(), value);
                return;
            }
            self.initial.insert(name.to_owned(), value);
        }
        self.scope.constants.remove(name);
        // A slot beyond 65,535 would be that of another value, but `Scope::slot` does not find such names: each use is refused.
        let slot = self.scope.global(name);
        let offset = self.start.len();
        self.start.extend(code.ops.iter().map(|op| shifted(*op, offset)));
        self.start.push(Op::StoreGlobal(slot));
    }

    /// Python outside of rules; returns the index of the next line.
    fn python(&mut self, list: &[Line<'_>], i: usize, line: Line<'_>) -> usize {
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
                if CALLED_FUNCTIONS.contains(&name) {
                    self.hide_unreadable(block);
                    self.run_later.push((name.to_owned(), i + 1..next, range));
                } else {
                    self.definitions.insert(name.to_owned(), i);
                    self.function(rest, block, &range);
                }
                return next;
            }
            "if" | "for" | "while" => {
                // The lines of its `elif` and `else` belong to an `if`, that of its `else` to a loop.
                let mut end = next;
                while let Some(more) = list.get(end).filter(|more| more.indent == line.indent) {
                    if !matches!(more.piece.first_word(&['(', ':']).0.text, "elif" | "else") {
                        break;
                    }
                    end = block_after(list, end, more.indent).1;
                }
                let statements = self.statements(list.get(i..end).unwrap_or(&[]));
                let is_known = statements.and_then(|statements| self.run(&statements, &range));
                if self.settle(is_known) == Some(false) {
                    let why = Refusal::new(format!("'{}' outside of a production", word.text), range);
                    self.refuse(
                        &why.remedy("only a run knows what it does: write it into Start(), or into a production"),
                    );
                }
                return end;
            }
            // Imports that may fail; what follows an `except` runs where they do.
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
            "class" | "try" | "with" | "raise" | "del" => {
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
        // Angles of the turtle, seeds, and other settings that change no rule.
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
        // `x += 2`; a plain assignment may have lists and several names.
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
            // `x = y = 3` sets each name.
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
            if let ([name], Some((params, body))) = (names.as_slice(), lambda(value)) {
                self.scope.defaults.remove(name.text);
                let body = of_model(&body, &params, &self.shared);
                self.scope.functions.insert(name.text.to_owned(), (params, body));
                return next;
            }
            // One list for several names.
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
            // Python takes all values before it sets the first name.
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
        // Texts in quotes and bare numbers do nothing.
        if piece.text.starts_with(['"', '\'']) || piece.text.parse::<f64>().is_ok() {
            return next;
        }
        let shown: String = piece.text.chars().take(40).collect();
        self.refuse(&Refusal::new(format!("'{shown}'"), range));
        next
    }

    /// `extern(n = 3, angle = 60)`: values that a program around L-Py may have set before; sliders of the file have.
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

    /// Reads a `def`. A function with a value is kept as an expression; another one is refused where it is called. The functions
    /// that L-Py calls become blocks.
    fn function(&mut self, rest: Piece<'_>, block: &[Line<'_>], range: &Range<usize>) {
        let name = rest.text.split('(').next().unwrap_or("").trim().to_owned();
        // A function that rules call: its body stands behind the colon or in the block.
        let Some(FunctionHead { params, body }) = function_head(rest) else { return };
        // Python evaluates them once, where the function is defined.
        let default = |value: Piece<'_>| {
            let value = parse(value).and_then(|e| resolve(&e, &self.scope, 0)).ok();
            value.filter(|e| !has_random(e, &self.scope))
        };
        let defaults: Vec<Option<PyExpr>> = params.iter().map(|(_, value)| value.and_then(default)).collect();
        let params: Vec<String> = params.into_iter().map(|(name, _)| name).collect();
        let inline = [Line { indent: 0, piece: body }];
        let lines = if body.text.is_empty() { block } else { &inline };
        let statements = self.statements(lines);
        let value = statements.clone().and_then(|mut list| {
            list.reverse();
            let values = params.iter().map(|p| PyExpr::Name(p.clone(), range.clone())).collect();
            let mut function = FunctionValue { scope: &self.scope, place: range.clone(), count: 0 };
            function.of(list, params.clone(), values, 0)
        });
        // An expression with a call of a function of statements is no more than its statements.
        let value = value.ok().filter(|value| first_call(value, &|name| self.has_body(name)).is_none());
        match value {
            Some(value) => {
                self.bodies.remove(&name);
                self.scope.defaults.insert(name.clone(), defaults);
                let value = of_model(&value, &params, &self.shared);
                self.scope.functions.insert(name, (params, value));
            }
            // Productions that call a function of more than one expression run its statements. A call of one that could not be read
            // is refused there.
            None => {
                self.scope.functions.remove(&name);
                self.bodies.remove(&name);
                let why = match statements {
                    Ok(list) if only_returns(&list) => {
                        self.scope.defaults.insert(name.clone(), defaults);
                        self.bodies.insert(name, (params, list));
                        return;
                    }
                    Ok(_) => "it changes values of the model, or ends without a value".to_owned(),
                    Err(why) => format!("line {}: {}", self.reader.line_number(why.range.start), why.construct),
                };
                self.scope.refused_functions.insert(name, why);
            }
        }
    }

    /// True for the name of a function that is more than one expression.
    fn has_body(&self, name: &str) -> bool {
        self.bodies.contains_key(name) && !self.scope.functions.contains_key(name)
    }

    /// Reads a function that L-Py runs, which becomes a block.
    fn called_function(&mut self, name: &str, block: &[Line<'_>], range: &Range<usize>) {
        self.scope.is_before_step = name == "StartEach";
        let code = self.run_function(block);
        self.scope.is_before_step = false;
        let is_run = matches!(name, "Start" | "StartEach" | "EndEach");
        match code {
            Ok(code) if is_run => {
                let to = match name {
                    "Start" => &mut self.functions.start,
                    "StartEach" => &mut self.functions.start_each,
                    _ => &mut self.functions.end_each,
                };
                *to = code;
            }
            Ok(code) if code.is_empty() => {}
            Err(why) if is_run || why.construct == OTHER_STRING => {
                let construct = format!("the function '{name}', which L-Py runs: {}", why.construct);
                let range = if why.range.is_empty() { range.clone() } else { why.range };
                self.refuse(&Refusal { construct, range, remedy: why.remedy });
            }
            // The other functions run behind the last step, and around drawings.
            _ => {
                let place = self.reader.place(range.clone());
                let message = format!("the function '{name}' is not run");
                let help = "osier runs Start, StartEach and EndEach; set in EndEach() what an interpretation reads";
                self.reader.session.warning("L008", message, place, help);
            }
        }
    }

    /// Code of a function that L-Py runs: assignments of numbers, `if`. A value that cannot be read is refused where it is used.
    fn run_function<'t>(&mut self, block: &[Line<'t>]) -> Result<Vec<Op>, Refusal> {
        let mut lines = Vec::new();
        let parts_of = |line: &Line<'t>| {
            let indent = line.indent;
            statements_of_line(line.piece).into_iter().map(move |piece| Line { indent, piece })
        };
        for line in &block.iter().flat_map(parts_of).collect::<Vec<_>>() {
            let text = line.piece.text;
            // These do not change what rules read; `forward()` is how L-Py rewrites without it.
            if self.turtle_setting(line.piece) || text.starts_with("context(") || is_seed(line.piece) {
                continue;
            }
            // `return lstring, scene` hands on both.
            let (word, rest) = line.piece.first_word(&[]);
            let values = if word.text == "return" { split(rest) } else { Vec::new() };
            if let [string, _, ..] = values.as_slice()
                && values.iter().all(|v| self.run_parameters.iter().any(|p| p == v.text))
            {
                let end = string.at + string.text.len() - line.piece.at;
                lines.push(Line { piece: line.piece.up_to(end), ..*line });
                continue;
            }
            let is_backward = text.starts_with("backward()");
            if is_backward || text.starts_with("forward()") {
                self.direction(is_backward, line.piece.range(), block.iter().any(|l| l.indent < line.indent))?;
                continue;
            }
            if unreadable_assignment(line).is_none() {
                lines.push(*line);
            }
        }
        let statements = self.statements(&lines)?;
        let mut ops = Vec::new();
        let mut declared = Vec::new();
        self.block_code(&statements, &mut declared, &mut ops)?;
        // A function that does nothing but return is none.
        if ops.iter().all(|op| *op == Op::Jump(RETURN)) {
            ops.clear();
        }
        let end = ops.len();
        for op in ops.iter_mut().filter(|op| **op == Op::Jump(RETURN)) {
            *op = Op::Jump(end);
        }
        Ok(ops)
    }

    /// Reads a line that sets the turtle, such as `context().turtle.setAngleIncrement(90)`; false for any other. L008 for a setting
    /// that has no effect.
    fn turtle_setting(&mut self, piece: Piece<'_>) -> bool {
        // The value of a method stands in parentheses, that of a member behind '='.
        let value = |method: &str, member: &str| {
            if let Some(i) = piece.text.find(method) {
                let call = piece.from(i + method.len()).trimmed();
                let inner = call.text.strip_prefix('(').map(|_| call.from(1))?;
                return Some(inner.up_to(strings::closing(inner.text)?).trimmed());
            }
            let rest = piece.from(piece.text.find(member)? + member.len()).trimmed();
            let is_value = rest.text.starts_with('=') && !rest.text.starts_with("==");
            let value = rest.from(1).trimmed();
            is_value.then_some(Piece::new(value.at, value.text.trim_end_matches([';', ' '])))
        };
        if let Some(value) = value("setAngleIncrement", ".angle_increment") {
            if let Some(angle) = self.known_number(value) {
                if let Some(turtle) = &mut self.reader.program.turtle {
                    turtle.settings.angle_deg = Some(angle.abs());
                }
            } else {
                let place = self.reader.place(value.range());
                let message = "this angle is not constant and has no effect".to_owned();
                self.reader.session.warning("L008", message, place, "write the angle as a number");
            }
            return true;
        }
        let others = [
            ("setDefaultStep", ".default_step"),
            ("setWidthIncrement", ".width_increment"),
            ("setColorIncrement", ".color_increment"),
            ("setScaleMultiplier", ".scale_multiplier"),
        ];
        let is_other = others.iter().any(|(method, member)| value(method, member).is_some());
        if is_other {
            let place = self.reader.place(piece.range());
            let message = "this setting of the turtle has no effect".to_owned();
            self.reader.session.warning("L008", message, place, "give the modules their parameters");
        }
        is_other
    }

    /// `backward()` or `forward()`, the direction in which all steps rewrite. `is_nested`: a condition decides on it.
    fn direction(&mut self, is_backward: bool, range: Range<usize>, is_nested: bool) -> Result<(), Refusal> {
        if is_nested || self.direction.is_some_and(|d| d != is_backward) {
            let why = Refusal::new("a direction of rewriting that changes between the steps", range);
            return Err(
                why.remedy("call 'backward()' without a condition, in Start(): all steps then rewrite from the right")
            );
        }
        self.direction = Some(is_backward);
        Ok(())
    }

    /// Leaves out the productions that look at the new string on the side where the direction of rewriting has not made it yet:
    /// L-Py does not apply them.
    fn keep_productions_of_direction(&mut self) {
        let is_backward = self.direction == Some(true);
        self.reader.program.is_backward = is_backward;
        let list = std::mem::take(&mut self.reader.program.rules.list);
        for p in list {
            let (unseen, sign) = if is_backward { (&p.new_left, "<<") } else { (&p.new_right, ">>") };
            if is_backward && p.predecessor.len() > 1 {
                let range = p.place.span.start as usize..p.place.span.end as usize;
                let why = Refusal::new("several modules as a predecessor beside 'backward()'", range);
                self.refuse(
                    &why.remedy("write the others as a right context and rewrite each by a production of its own"),
                );
            } else if unseen.is_empty() {
                self.reader.program.rules.list.push(p);
            } else {
                let message = format!("a production with '{sign}' never applies in this direction of rewriting");
                let help = if is_backward {
                    "'backward()' makes the string from its end: use '>>', or leave 'backward()' out"
                } else {
                    "the string is made from its beginning: use '<<', or call 'backward()' in Start()"
                };
                self.reader.session.warning("L008", message, p.place, help);
            }
        }
    }

    /// Appends the code of statements of a function. Its local variables are kept apart from those of the model.
    fn block_code(
        &mut self,
        statements: &[Statement],
        declared: &mut Vec<String>,
        ops: &mut Vec<Op>,
    ) -> Result<(), Refusal> {
        for statement in statements {
            match statement {
                Statement::Pass => {}
                // A function that returns the string that it was given changes nothing.
                Statement::Return(value, place) => {
                    let is_own = match value {
                        Some(PyExpr::Name(name, _)) => self.run_parameters.contains(name),
                        Some(_) => false,
                        None => true,
                    };
                    if !is_own {
                        let why = Refusal::new(OTHER_STRING, place.clone());
                        return Err(why.remedy("write the string as the axiom, and its changes as productions"));
                    }
                    ops.push(Op::Jump(RETURN));
                }
                Statement::Global(names) => declared.extend(names.iter().cloned()),
                Statement::Assign(name, e) => {
                    let code = compile(e, &self.scope)?;
                    let offset = ops.len();
                    ops.extend(code.ops.iter().map(|op| shifted(*op, offset)));
                    // Without `global` the name is a local variable in Python, which blocks do not have.
                    let is_of_model = self.scope.constants.contains_key(name) || self.shared.contains(name);
                    if !declared.contains(name) && is_of_model {
                        return Err(Refusal::new(format!("'{name}' as a variable of its own"), 0..0));
                    }
                    ops.push(Op::StoreGlobal(self.scope.global(name)));
                }
                // test, JumpIfZero to the next test, body, Jump to the end; both targets are known only after the code that they pass.
                Statement::If(tests, other) => {
                    let mut ends = Vec::new();
                    for (test, then) in tests {
                        let code = compile(test, &self.scope)?;
                        let offset = ops.len();
                        ops.extend(code.ops.iter().map(|op| shifted(*op, offset)));
                        let skip = ops.len();
                        ops.push(Op::Pop);
                        self.block_code(then, declared, ops)?;
                        ends.push(ops.len());
                        ops.push(Op::Pop);
                        ops[skip] = Op::JumpIfZero(ops.len());
                    }
                    self.block_code(other, declared, ops)?;
                    for end in ends {
                        ops[end] = Op::Jump(ops.len());
                    }
                }
                Statement::While(test, body, place, _) => {
                    // test, JumpIfZero behind the loop, body, Jump to the test.
                    let start = ops.len();
                    ops.push(Op::Count(self.loop_places.len()));
                    self.loop_places.push(self.reader.place(place.clone()));
                    let code = compile(test, &self.scope)?;
                    let offset = ops.len();
                    ops.extend(code.ops.iter().map(|op| shifted(*op, offset)));
                    let skip = ops.len();
                    ops.push(Op::Pop);
                    self.block_code(body, declared, ops)?;
                    ops.push(Op::Jump(start));
                    ops[skip] = Op::JumpIfZero(ops.len());
                }
                Statement::Break(place) | Statement::Continue(place) => {
                    let why = Refusal::new("'break' or 'continue' in a function that L-Py runs", place.clone());
                    return Err(why.remedy("put the condition into the test of the loop"));
                }
                Statement::TurnEnd | Statement::LoopEnd | Statement::FunctionEnd(..) => {}
                Statement::For(_, _, _, place) => {
                    let why = Refusal::new("'for' in a function that L-Py runs", place.clone());
                    return Err(why.remedy("count with 'while'"));
                }
                Statement::Produce(modules, _) => {
                    let range = modules.first().map_or(0..0, |m| m.range.clone());
                    return Err(Refusal::new("'produce' outside of a production", range));
                }
            }
        }
        Ok(())
    }

    fn finish(mut self, text: &str) {
        if !self.has_axiom && self.refusals == 0 {
            let piece = Piece::new(0, &text[..text.find('\n').unwrap_or(text.len())]);
            let place = self.reader.place(piece.range());
            let help = "write: Axiom: F";
            self.reader.session.error_help("L003", "the model has no axiom".into(), place, help);
        }
        self.keep_productions_of_direction();
        // Values of the model first, wherever they are written, then the function that begins a run.
        let offset = self.start.len();
        self.start.extend(self.functions.start.iter().map(|op| shifted(*op, offset)));
        let [start, start_each, end_each] =
            [self.start.clone(), self.functions.start_each.clone(), self.functions.end_each.clone()]
                .map(|ops| (!ops.is_empty()).then(|| self.bytecode(ops)));
        let blocks = &mut self.reader.program.blocks;
        blocks.globals = self.scope.globals.len();
        (blocks.start, blocks.start_each, blocks.end_each) = (start, start_each, end_each);
    }
}

/// The head of a function: its parameters, with the values that they have otherwise, and what stands behind its colon.
struct FunctionHead<'t> {
    params: Vec<(String, Option<Piece<'t>>)>,
    body: Piece<'t>,
}

/// Reads the head of a function from its name on, `f(x, k=3) -> float: return x`.
fn function_head(rest: Piece<'_>) -> Option<FunctionHead<'_>> {
    let params = parameters_of(rest)?;
    let inner = rest.from(rest.text.find('(')? + 1);
    // `def f(x) -> float:` names what it gives.
    let after = inner.from(strings::closing(inner.text)? + 1).trimmed();
    let given = after.text.strip_prefix("->").and_then(|t| t.find(':')).map_or(0, |c| c + "->".len());
    let after = after.from(given);
    let body = after.text.strip_prefix(':').map(|_| after.from(1).trimmed())?;
    Some(FunctionHead { params, body })
}

/// Names of the parameters of a function from its head, `Start(lstring):`, with the values that they have otherwise, `f(x, k=3):`.
fn parameters_of(head: Piece<'_>) -> Option<Vec<(String, Option<Piece<'_>>)>> {
    let inner = head.from(head.text.find('(')? + 1);
    let list = split(inner.up_to(strings::closing(inner.text)?));
    let parameters = list.into_iter().map(|p| {
        let value = p.text.find('=').map(|i| p.from(i + 1).trimmed());
        // `x: float` names what it takes.
        let name = p.text.split(['=', ':']).next().unwrap_or_default().trim();
        (name.to_owned(), value)
    });
    Some(parameters.collect())
}

/// `lambda x, y: e`: parameters and expression.
fn lambda(piece: Piece<'_>) -> Option<(Vec<String>, PyExpr)> {
    let rest = piece.text.strip_prefix("lambda").map(|_| piece.from("lambda".len()))?;
    let c = colon(rest)?;
    let params: Vec<String> = split(rest.up_to(c).trimmed()).iter().map(|p| p.text.to_owned()).collect();
    Some((params, parse(rest.from(c + 1).trimmed()).ok()?))
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

/// Index of the colon that ends the heading of a block, such as `for v in q[1:]:`: the first one outside of all brackets.
fn block_colon(piece: Piece<'_>) -> Option<usize> {
    let mut depth = 0_usize;
    piece.text.char_indices().find_map(|(i, c)| {
        match c {
            '(' | '[' | '{' => depth += 1,
            ')' | ']' | '}' => depth = depth.saturating_sub(1),
            _ => {}
        }
        (c == ':' && depth == 0).then_some(i)
    })
}

/// A production has an arrow, or ends its head with a colon; statements of Python do neither.
fn is_rule(piece: Piece<'_>) -> bool {
    let (word, _) = piece.first_word(&['(', ':', '=']);
    let is_python =
        ["def", "class", "if", "for", "while", "try", "with", "else", "elif", "from", "import"].contains(&word.text);
    piece.text.contains("-->")
        || piece.text.contains("-static->")
        || (!is_python && colon(piece).is_some() && assignment(piece).is_none())
}

/// True for lines of imports alone.
fn only_imports(block: &[Line<'_>]) -> bool {
    let is_import = |p: Piece<'_>| matches!(p.first_word(&[]).0.text, "import" | "from" | "pass");
    !block.is_empty() && block.iter().flat_map(|l| statements_of_line(l.piece)).all(is_import)
}

/// True for `seed(3)`, `random.seed(3)` and the like.
fn is_seed(piece: Piece<'_>) -> bool {
    let Some((name, _)) = piece.text.split_once('(') else { return false };
    let name = name.trim_end();
    let is_path = name.chars().all(|c| c.is_alphanumeric() || matches!(c, '_' | '.'));
    is_path && name.rsplit('.').next() == Some("seed")
}

/// True for a name of Python.
fn is_name(text: &str) -> bool {
    let mut chars = text.chars();
    chars.next().is_some_and(|c| c.is_alphabetic() || c == '_') && chars.all(|c| c.is_alphanumeric() || c == '_')
}

/// `name = expression`; `None` for anything else.
fn assignment(piece: Piece<'_>) -> Option<(Piece<'_>, Piece<'_>)> {
    let i = piece.text.find('=')?;
    let names = piece.up_to(i).trimmed();
    // `(x, y) = e` is `x, y = e`.
    let inner = names.text.strip_prefix('(').and_then(|t| t.strip_suffix(')'));
    let names = inner.map_or(names, |t| Piece::new(names.at + 1, t).trimmed());
    let value = piece.from(i + 1).trimmed();
    (split(names).iter().all(|p| is_name(p.text)) && !names.text.is_empty() && !value.text.starts_with('='))
        .then_some((names, value))
}
