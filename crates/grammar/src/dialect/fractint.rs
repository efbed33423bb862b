//! Reads L-systems of Fractint: `Name { Angle 6 Axiom F F=F+F--F+F }`, many in one file.

use super::Reader;
use super::text::{Piece, lines};
use crate::program::SuccessorModule;
use osier_base::diagnostic::{Diagnostic, nearest};
use std::collections::BTreeMap;

/// Derivation length if the scene gives none. Fractint begins with 2, at which most of its systems are hard to recognise.
const DEFAULT_ORDER: u32 = 4;
/// Number of rules, and of columns, beyond which Fractint itself stops reading.
const MAX_RULES: usize = 25;
const MAX_COLUMNS: usize = 160;
/// Commands that no rule can redefine.
const RESERVED: &str = "+-/\\@|!c<>[]";
/// Upper limit on the entries that a message lists.
const LISTED: usize = 12;

struct Entry<'t> {
    name: Piece<'t>,
    /// Lines between the braces, without comments.
    lines: Vec<Piece<'t>>,
    comment: &'t str,
    /// Its number among the entries of the same name, from 1.
    number: usize,
}

impl Entry<'_> {
    /// A name that is unique in the file.
    fn own_name(&self) -> String {
        if self.number == 1 { self.name.text.to_owned() } else { format!("{}({})", self.name.text, self.number) }
    }

    /// True if the entry has an axiom and is not called `comment`, which is Fractint's name for entries of text.
    fn has_axiom(&self) -> bool {
        !self.is_comment() && self.lines.iter().any(|l| value_of(*l, "axiom").is_some())
    }

    /// True for an entry with an axiom, or with an angle, so that a missing axiom is reported; other entries are text. Items
    /// between commas also count, so that the commas are reported.
    fn is_system(&self) -> bool {
        let is_mark = |item: Piece<'_>| is_angle(item) || value_of(item, "axiom").is_some();
        !self.is_comment() && self.lines.iter().flat_map(|l| between_commas(*l)).any(is_mark)
    }

    fn is_comment(&self) -> bool {
        self.name.text.eq_ignore_ascii_case("comment")
    }
}

/// The parts of a line between commas, trimmed. In a rule a comma is a symbol without meaning.
fn between_commas(line: Piece<'_>) -> impl Iterator<Item = Piece<'_>> {
    let mut rest = Some(line);
    std::iter::from_fn(move || {
        let now = rest?;
        let part = now.before(',');
        rest = (part.text.len() < now.text.len()).then(|| now.from(part.text.len() + 1));
        Some(part.trimmed())
    })
}

/// The first word of a line, which ends at a blank or `=`, and the value after it and after an optional `=`.
fn word_and_value(line: Piece<'_>) -> (Piece<'_>, Piece<'_>) {
    let (word, rest) = line.first_word(&['=']);
    (word, if rest.text.starts_with('=') { rest.from(1).trimmed() } else { rest })
}

/// The value of a line that begins with the word `item`, in upper or lower case.
fn value_of<'t>(line: Piece<'t>, item: &str) -> Option<Piece<'t>> {
    let (word, value) = word_and_value(line);
    word.text.eq_ignore_ascii_case(item).then_some(value)
}

/// True if a line gives the number of directions; more may follow it.
fn is_angle(line: Piece<'_>) -> bool {
    value_of(line, "angle").is_some_and(|v| v.first_word(&[]).0.text.parse::<f64>().is_ok())
}

/// True if a line is just the angle or the axiom of an L-system.
fn is_setting(line: Piece<'_>) -> bool {
    let is_lone = |v: Piece<'_>| v.text.split_whitespace().count() == 1 && !v.text.starts_with(':');
    is_angle(line) && value_of(line, "angle").is_some_and(is_lone) || value_of(line, "axiom").is_some_and(is_lone)
}

/// The L-systems of a file. Text between entries is skipped; an entry without its closing brace ends where the next one
/// begins. `outside`: set to the first angle or axiom between entries.
fn entries<'t>(text: &'t str, outside: &mut Option<Piece<'t>>) -> Vec<Entry<'t>> {
    let mut out = blocks(text, false, outside);
    out.retain(Entry::is_system);
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    for e in &mut out {
        let count = counts.entry(e.name.text.to_lowercase()).or_insert(0);
        *count += 1;
        e.number = *count;
    }
    out
}

/// True if the file has an L-system; reads its text only up to the first one.
pub(super) fn has_system(text: &str) -> bool {
    blocks(text, true, &mut None).iter().any(Entry::has_axiom)
}

/// True if the file has an L-system without an axiom, or lines of one without braces around them, so that its errors should
/// be those of a Fractint file.
pub(super) fn has_faulty_system(text: &str) -> bool {
    let has = |item: &str| lines(text).map(|l| l.before(';')).any(|l| is_setting(l) && value_of(l, item).is_some());
    has("angle") && has("axiom") || blocks(text, false, &mut None).iter().any(Entry::is_system)
}

/// The contents of braces, including entries of text. `to_first_system`: stop after the first L-system. `outside`: set to
/// the first angle or axiom between entries.
fn blocks<'t>(text: &'t str, to_first_system: bool, outside: &mut Option<Piece<'t>>) -> Vec<Entry<'t>> {
    let mut out: Vec<Entry<'_>> = Vec::new();
    let mut is_open = false;
    let mut title = Piece::new(0, "");
    for line in lines(text) {
        let code = line.before(';');
        // A brace after an item, such as `Angle 6 {`, belongs to that line.
        if let Some(brace) = code.text.find('{').filter(|brace| !(is_open && is_item(code.up_to(*brace)))) {
            // The name precedes the brace, or is the only text on the line before.
            let before = code.up_to(brace).trimmed();
            if to_first_system && out.last().is_some_and(Entry::has_axiom) {
                return out;
            }
            // Without a name, use an empty one at the place of the brace.
            let is_titled = before.text.is_empty() && !title.text.is_empty();
            let name = if is_titled { title } else { before };
            title = Piece::new(0, "");
            let comment = line.text.split_once(';').map_or("", |(_, c)| c.trim());
            out.push(Entry { name, lines: Vec::new(), comment, number: 1 });
            is_open = true;
            is_open = add_line(&mut out, code.from(brace + 1)) && is_open;
        } else if is_open {
            is_open = add_line(&mut out, code);
        } else if !code.trimmed().text.is_empty() {
            title = code.trimmed();
            if outside.is_none() && is_setting(title) {
                *outside = Some(title);
            }
        }
    }
    out
}

/// True if a line begins with the angle, the axiom or a rule of an L-system.
fn is_item(line: Piece<'_>) -> bool {
    let (word, value) = line.first_word(&['=']);
    let is_named = ["angle", "axiom"].iter().any(|w| word.text.eq_ignore_ascii_case(w));
    // Such as `F=F+F {`; without the `=`, `F` may be the name of an entry.
    let is_rule = word.text.chars().count() == 1 && value.text.starts_with('=');
    (is_named || is_rule) && !value.text.is_empty()
}

/// Adds a line to the last entry; returns false if the line closes the entry.
fn add_line<'t>(entries: &mut [Entry<'t>], line: Piece<'t>) -> bool {
    let close = line.text.find('}');
    let piece = line.up_to(close.unwrap_or(line.text.len())).trimmed();
    if let Some(e) = entries.last_mut().filter(|_| !piece.text.is_empty()) {
        e.lines.push(piece);
    }
    close.is_none()
}

/// Names of the L-systems in file order. The second of the same name is `NAME(2)`.
pub(super) fn names(text: &str) -> Vec<String> {
    entries(text, &mut None).iter().map(Entry::own_name).collect()
}

/// Reads the entry `wanted`, or without it the only entry of the file; L061 if there is none or several.
pub(super) fn read(reader: &mut Reader<'_>, text: &str, file: &str, wanted: Option<&str>) {
    let mut outside = None;
    let list = entries(text, &mut outside);
    let help = "write '{' behind the name of the L-system, and '}' on a line of its own behind its last rule";
    if let Some(line) = outside.filter(|_| list.is_empty()) {
        let message = "the lines of an L-system of Fractint stand in braces, which this one lacks".to_owned();
        let place = reader.place(line.range());
        return reader.session.error_help("L061", message, place, help);
    }
    let entry = select(reader, &list, file, wanted);
    if let Some(line) = outside {
        // A preview sheet reads all entries and reports this once, with the entry that follows.
        let next = list.iter().find(|e| e.name.at > line.at).or(list.last());
        if entry.is_none_or(|e| next.is_some_and(|n| n.name.at == e.name.at)) {
            let message = format!("'{}' stands outside of all braces and is left out", line.text);
            let place = reader.place(line.range());
            reader.session.warning("L008", message, place, help);
        }
    }
    let Some(entry) = entry else { return };
    warn_of_namesakes(reader, &list, entry, file);
    entry.name.text.clone_into(&mut reader.label);
    entry.comment.clone_into(&mut reader.description);
    let mut system = System { reader, angle: None, axiom: None, rules: Vec::new() };
    for line in &entry.lines {
        system.line(*line);
    }
    system.finish(entry);
}

/// The entry with the name `wanted`, in upper or lower case; without `wanted`, the only entry.
fn select<'e, 't>(
    reader: &mut Reader<'_>,
    list: &'e [Entry<'t>],
    file: &str,
    wanted: Option<&str>,
) -> Option<&'e Entry<'t>> {
    let names = || list.iter().map(|e| e.name.text);
    let listing = || {
        let mut shown: Vec<&str> = names().take(LISTED).collect();
        if list.len() > LISTED {
            shown.push("..");
        }
        shown.join(", ")
    };
    let place = reader.place(0..0);
    // Without a name the file must have a single entry; the error lists the entries.
    let Some(wanted) = wanted.map(str::trim) else {
        if let [only] = list {
            return Some(only);
        }
        let first = names().next().unwrap_or("NAME");
        let (message, help) = if list.is_empty() {
            let help = "write: Name { Angle 6 Axiom F F=F+F--F+F }, with each item on a line of its own";
            ("the file has no L-system with an axiom".to_owned(), help.to_owned())
        } else {
            let message = format!("the file has {} L-systems: {}", list.len(), listing());
            (message, format!("name one: \"{file}#{first}\"; `osier preview {file}` draws them all"))
        };
        reader.session.error_help("L061", message, place, help);
        return None;
    };
    // Compare names exactly, then without case, then by first word.
    let first_word = |name: &'t str| name.split_whitespace().next().unwrap_or("");
    let found = list
        .iter()
        .find(|e| e.name.text == wanted)
        .or_else(|| list.iter().find(|e| e.own_name().eq_ignore_ascii_case(wanted)))
        .or_else(|| list.iter().find(|e| e.name.text.eq_ignore_ascii_case(wanted)))
        .or_else(|| list.iter().find(|e| first_word(e.name.text).eq_ignore_ascii_case(wanted)));
    if found.is_none() {
        let help = match nearest(wanted, names()) {
            Some(near) => format!("did you mean \"{near}\"?"),
            None => format!("the file has {}", listing()),
        };
        reader.session.error_help("L061", format!("the file has no L-system \"{wanted}\""), place, help);
    }
    found
}

/// L062 if other entries have the same name: Fractint draws only the first one.
fn warn_of_namesakes(reader: &mut Reader<'_>, list: &[Entry<'_>], entry: &Entry<'_>, file: &str) {
    let others = list.iter().filter(|e| e.name.text.eq_ignore_ascii_case(entry.name.text) && e.number != entry.number);
    let lines: Vec<String> = others.clone().map(|e| reader.line_number(e.name.at).to_string()).collect();
    let Some(other) = others.clone().next() else { return };
    let lines = lines.join(", ");
    let (message, mend) = if entry.name.text.is_empty() {
        (format!("this L-system has no name, nor has that in line {lines}"), "write a name before each '{'")
    } else {
        (format!("the name \"{}\" is used again in line {lines}", entry.name.text), "rename one of them")
    };
    let (own, others) = (entry.own_name(), other.own_name());
    let help = format!("{mend}; \"{file}#{own}\" is this one, \"{file}#{others}\" the other");
    let d = Diagnostic::warning("L062", message, reader.place(entry.name.range()).span, "this one is drawn")
        .label(reader.place(other.name.range()).span, "the other one")
        .help(help);
    reader.session.push(d, reader.place(entry.name.range()));
}

struct Rule {
    symbol: char,
    place: crate::token::SourcePlace,
    successor: Vec<SuccessorModule>,
}

struct System<'r, 's> {
    reader: &'r mut Reader<'s>,
    angle: Option<f64>,
    axiom: Option<Vec<SuccessorModule>>,
    rules: Vec<Rule>,
}

impl System<'_, '_> {
    fn error(&mut self, message: String, piece: Piece<'_>, help: &str) {
        let place = self.reader.place(piece.range());
        self.reader.session.error_help("L061", message, place, help);
    }

    fn limit(&mut self, message: String, piece: Piece<'_>, help: &str) {
        let place = self.reader.place(piece.range());
        self.reader.session.warning("L060", message, place, help);
    }

    fn line(&mut self, line: Piece<'_>) {
        if line.text.chars().count() > MAX_COLUMNS {
            let message = format!("line of more than {MAX_COLUMNS} columns, of which Fractint reads no more");
            self.limit(message, line, "osier reads all of it; give parts of it a symbol of their own");
        }
        if let Some(second) = between_commas(line).skip(1).find(|item| is_item(*item)) {
            let message = format!("'{}' stands behind a comma, on the line of another item", second.text);
            self.error(message, second, "write each item on a line of its own, without commas between them");
            // Read each part, so that none is reported as missing.
            return between_commas(line).for_each(|item| self.line(item));
        }
        let (word, rest) = word_and_value(line);
        if word.text.is_empty() {
            return self.error("a rule without the symbol that it replaces".into(), line, "write: F=F+F");
        }
        let (value, more) = rest.first_word(&[]);
        let mut symbols = word.text.chars();
        match (word.text.to_ascii_lowercase().as_str(), symbols.next(), symbols.next()) {
            ("angle", ..) => self.angle(value),
            ("axiom", ..) => {
                let modules = self.modules(value);
                if modules.is_empty() {
                    return self.error("the axiom is empty".into(), line, "write: Axiom F");
                }
                if self.axiom.replace(modules).is_some() {
                    self.second("axiom", line);
                }
            }
            // A single symbol without a value is a rule that removes it.
            (_, Some(c), None) => self.rule(c.to_ascii_lowercase(), word, value),
            _ => {
                let help = "an L-system of Fractint holds Angle n, Axiom s, and rules such as F=F+F";
                return self.error(format!("unknown item '{}'", word.text), word, help);
            }
        }
        if !more.text.is_empty() {
            let message = format!("unexpected '{}' after the value", more.text);
            self.error(
                message,
                more,
                "write values without blanks, items on lines of their own, and comments after ';'",
            );
        }
    }

    /// L008 for a repeated item.
    fn second(&mut self, item: &str, line: Piece<'_>) {
        let place = self.reader.place(line.range());
        let message = format!("a second {item} replaces the first one");
        self.reader.session.warning("L008", message, place, "keep one of them");
    }

    fn angle(&mut self, value: Piece<'_>) {
        match value.text.parse::<f64>() {
            Ok(n) if n >= 1.0 && n.is_finite() => {
                // Only a note, because the number divides the circle in any case.
                if !(3.0..=50.0).contains(&n) {
                    let message = format!("angle {n}: Fractint takes 3 to 50 directions");
                    self.limit(message, value, "osier draws it anyway");
                }
                if n.fract().abs() > 0.0 {
                    let place = self.reader.place(value.range());
                    let message = format!("{n} is no whole number, {} is taken", n.trunc());
                    let help = "write a whole number of directions; '\\' and '/' turn by any number of degrees";
                    self.reader.session.warning("L008", message, place, help);
                }
                if self.angle.replace(n.trunc()).is_some() {
                    self.second("angle", value);
                }
            }
            _ => {
                let message = format!("the angle '{}' is not a number of directions", value.text);
                self.error(message, value, "Angle 6 divides the circle into 6 directions");
                // The angle is not missing: report only its fault.
                self.angle.get_or_insert(1.0);
            }
        }
    }

    fn rule(&mut self, c: char, word: Piece<'_>, value: Piece<'_>) {
        if RESERVED.contains(c) {
            return self.error(format!("'{c}' is a command and cannot be replaced"), word, "use another letter");
        }
        let c = self.symbol(c);
        let successor = self.modules(value);
        // Rules of the same symbol are concatenated.
        if let Some(known) = self.rules.iter_mut().find(|r| r.symbol == c) {
            known.successor.extend(successor);
            return;
        }
        let place = self.reader.place(word.range());
        self.rules.push(Rule { symbol: c, place, successor });
        if self.rules.len() == MAX_RULES + 1 {
            let message = format!("more than {MAX_RULES} rules, of which Fractint reads no more");
            self.limit(message, word, "osier reads all of them");
        }
    }

    /// The symbol of a character. A comma has no meaning in Fractint, but decrements the colour in grammars with `turtle:
    /// fractint`.
    fn symbol(&mut self, c: char) -> char {
        if c == ',' { self.reader.program.symbols.private_character(",").unwrap_or('_') } else { c }
    }

    /// Modules of a string: a command takes the number after it as its parameter.
    fn modules(&mut self, value: Piece<'_>) -> Vec<SuccessorModule> {
        let chars: Vec<(usize, char)> = value.chars().map(|(i, c)| (i, c.to_ascii_lowercase())).collect();
        let mut out = Vec::with_capacity(chars.len());
        let mut i = 0;
        while let Some(&(at, c)) = chars.get(i) {
            i += 1;
            // The place of a module includes its number.
            let mut end = at + c.len_utf8();
            let mut parameter = None;
            if matches!(c, '@' | '\\' | '/' | '<' | '>' | 'c') {
                let number = Number::read(&chars, &mut i, c);
                if let Some(&(last, l)) = chars.get(i.wrapping_sub(1)) {
                    end = end.max(last + l.len_utf8());
                }
                parameter = number.value;
                // A missing or zero scale factor would shrink the rest of the drawing to a point.
                if c == '@' && parameter.is_none_or(|p| p <= 0.0) {
                    let piece = Piece::new(at, &value.text[at - value.at..end - value.at]);
                    let help = "write the factor after it: @.5, @I2 (1/2), @Q2 (root of 2), @IQ2";
                    self.error("'@' without a factor above 0".into(), piece, help);
                    parameter = Some(1.0);
                }
            }
            let place = self.reader.place(at..end);
            let c = self.symbol(c);
            let module = match parameter {
                Some(value) => self.reader.module_with(c, value, place),
                None => self.reader.module(c, place),
            };
            out.extend(module);
        }
        out
    }

    fn finish(mut self, entry: &Entry<'_>) {
        let help = "every L-system has lines such as 'Angle 6' and 'Axiom F'";
        if self.angle.is_none() {
            self.error("the L-system has no angle".into(), entry.name, help);
        }
        let Some(axiom) = self.axiom.take() else {
            return self.error("the L-system has no axiom".into(), entry.name, help);
        };
        let reader = self.reader;
        if let Some(turtle) = &mut reader.program.turtle {
            // The file gives the number of turns of the angle in a full circle.
            turtle.settings.angle_deg = self.angle.map(|n| 360.0 / n);
        }
        reader.program.length = DEFAULT_ORDER;
        reader.program.length_place = Some(reader.place(entry.name.range()));
        reader.axiom(axiom);
        for rule in self.rules {
            reader.rule(rule.symbol, rule.successor, rule.place);
        }
    }
}

/// The number after a command, if there is one.
struct Number {
    value: Option<f64>,
}

impl Number {
    /// Reads `[I][Q]digits[.digits]`: `I` is 1/x, `Q` the square root. Colour commands take digits without these prefixes.
    fn read(chars: &[(usize, char)], i: &mut usize, command: char) -> Self {
        let is_color = matches!(command, 'c' | '<' | '>');
        let peek = |k: usize| chars.get(k).map(|p| p.1);
        // A number may begin with its decimal point: `@.5`.
        let begins = |k: usize| peek(k).is_some_and(|c| c.is_ascii_digit() || c == '.');
        let (mut inverse, mut root, mut k) = (false, false, *i);
        while let Some(c @ ('i' | 'q')) = peek(k).filter(|_| !is_color) {
            inverse |= c == 'i';
            root |= c == 'q';
            k += 1;
        }
        // Prefix letters without a number after them are symbols.
        if !begins(k) {
            return Self { value: None };
        }
        let mut text = String::new();
        while let Some(c) = peek(k).filter(|c| c.is_ascii_digit() || (*c == '.' && !is_color)) {
            text.push(c);
            k += 1;
        }
        *i = k;
        let mut value = text.parse::<f64>().unwrap_or(0.0);
        if root {
            value = osier_base::math::sqrt(value);
        }
        if inverse && value > 0.0 {
            value = 1.0 / value;
        }
        Self { value: Some(value) }
    }
}
