//! Reads files of LParser, both without keywords ("bare lines") and with them.
//!
//! Rewriting acts on characters, including those of numbers: every character is a symbol, and the turtle interprets the
//! numbers.

use super::Reader;
use super::text::{Piece, lines};
use crate::program::SuccessorModule;
use crate::token::SourcePlace;
use std::collections::BTreeSet;

/// Items that affect only LParser itself, and are ignored.
const IGNORED: [&str; 9] =
    ["mutation", "shape", "poly_limit", "switch_yz", "closed_form", "user_form", "rand", "trope", "output"];
/// Commands of the turtle, and the characters of numbers. Any other character without a rule is replaced by `_`.
const COMMANDS: &str = "+-&^<>|%$~tFZfzg.[]{}\"';:?!c()0123456789";
/// Commands that a number may follow.
const NUMBERED: &str = "+-&^<>~tFZfzg\"';:?!c";
/// The number that stands for the initial step length in files without keywords; in files with keywords it is 1. Source:
/// LParser 4 begins with steps of 100, and the same trees have leaves of `f(20)` there and of `f(.2)` in LParser 5.
const OLD_UNIT: f64 = 100.0;
/// Limit on `recursion` (derivation length).
const MAX_RECURSION: f64 = 1e6;

struct Rule<'t> {
    symbol: char,
    place: SourcePlace,
    successor: Vec<Piece<'t>>,
}

struct File<'r, 's, 't> {
    reader: &'r mut Reader<'s>,
    recursion: Option<f64>,
    angle: Option<f64>,
    thickness: Option<f64>,
    min_thickness: f64,
    /// True if recursion, angle or thickness is on a line without a keyword.
    is_old: bool,
    axiom: Option<Vec<Piece<'t>>>,
    rules: Vec<Rule<'t>>,
    /// Symbols that have a rule.
    ruled: BTreeSet<char>,
    length_place: SourcePlace,
    /// True if a number before the axiom is missing, so that the meaning of the following lines is unknown.
    is_stopped: bool,
}

/// Reads a file of LParser into the reader's program.
pub(super) fn read(reader: &mut Reader<'_>, text: &str) {
    reader.description = description(text);
    let length_place = reader.place(0..0);
    let mut file = File {
        reader,
        recursion: None,
        angle: None,
        thickness: None,
        min_thickness: 0.0,
        is_old: false,
        axiom: None,
        rules: Vec::new(),
        ruled: BTreeSet::new(),
        length_place,
        is_stopped: false,
    };
    for line in lines(text) {
        let line = line.before('#').trimmed();
        // '@' ends the file; the rest is ignored.
        if line.text.starts_with('@') && !is_rule(line) {
            break;
        }
        if !line.text.is_empty() {
            file.line(line);
        }
        if file.is_stopped {
            return;
        }
    }
    file.finish(text);
}

/// The first comment of a file that contains text.
fn description(text: &str) -> String {
    let comments = lines(text).map(|l| l.trimmed().text).take_while(|l| l.is_empty() || l.starts_with('#'));
    // Comments are often framed by rows of punctuation, which are not text.
    let plain = |l: &str| l.trim_matches(['#', '-', '=', '*', ' ', '\t']).to_owned();
    comments.map(plain).find(|l| l.chars().filter(|c| c.is_alphabetic()).count() > 3).unwrap_or_default()
}

impl<'t> File<'_, '_, 't> {
    fn error(&mut self, message: String, piece: Piece<'_>, help: &str) {
        let place = self.reader.place(piece.range());
        self.reader.session.error_help("L061", message, place, help);
    }

    fn line(&mut self, line: Piece<'t>) {
        let (word, rest) = line.first_word(&[]);
        let keyword = word.text.to_ascii_lowercase();
        let is_second = match keyword.as_str() {
            "recursion" => self.recursion.is_some(),
            "angle" => self.angle.is_some(),
            "thickness" => self.thickness.is_some(),
            "min_thickness" => self.min_thickness > 0.0,
            // A second line of an axiom without keyword continues it; one with the keyword replaces it.
            "axiom" => self.axiom.take().is_some(),
            _ => false,
        };
        if is_second {
            let place = self.reader.place(line.range());
            let message = format!("a second {keyword} replaces the first one");
            self.reader.session.warning("L008", message, place, "keep one of them");
        }
        match keyword.as_str() {
            "recursion" => self.recursion(rest),
            "angle" => self.angle = self.number(rest),
            "thickness" => self.thickness = self.thickness(rest),
            "min_thickness" => self.min_thickness = self.thickness(rest).unwrap_or(0.0),
            "color" | "colour" => self.color(rest),
            "axiom" => self.set_axiom(rest),
            "rule" => self.rule(rest),
            ignored if IGNORED.contains(&ignored) || is_setting(word, rest) => {
                let place = self.reader.place(line.range());
                let message = format!("'{ignored}' has no meaning for osier and is ignored");
                self.reader.session.warning("L008", message, place, "remove the line");
            }
            _ => self.bare_line(line),
        }
    }

    /// A line without a keyword: recursion, angle, thickness and axiom in this order, then rules.
    fn bare_line(&mut self, line: Piece<'t>) {
        if is_rule(line) {
            // With a blank beside the '=', take the whole line as the rule, although LParser cannot read it.
            let (word, _) = line.first_word(&[]);
            let is_whole = is_rule(word) && word.text.chars().count() > 2;
            let rule = if is_whole { self.bare_word(line) } else { line };
            return self.rule(rule);
        }
        if self.axiom.is_some() {
            // Accept a continuation of a long rule on the next line, although LParser does not read it.
            let place = self.reader.place(line.range());
            let before = if self.rules.is_empty() { "axiom" } else { "rule" };
            let message = format!("this line is no rule, and goes on with the {before} before it");
            let help = "write a rule as one character, '=' and its successor: A=F[+A]; or a long one on one line";
            self.reader.session.warning("L008", message, place, help);
            return match self.rules.last_mut() {
                Some(rule) => rule.successor.push(line),
                None => self.set_axiom(line),
            };
        }
        // Words may follow the number.
        let (word, _) = line.first_word(&[]);
        if word.text.parse::<f64>().is_err() {
            // In a file without keywords three numbers precede the axiom.
            let numbers = [("angle", self.angle), ("thickness", self.thickness)];
            if let Some((missing, _)) = numbers.into_iter().find(|n| self.is_old && n.1.is_none()) {
                let message = format!("expected the {missing}, found '{}'", word.text);
                let help = "begin with recursion, angle, thickness and axiom, each on a line of its own";
                self.is_stopped = true;
                return self.error(message, line, help);
            }
            let axiom = self.bare_word(line);
            return self.set_axiom(axiom);
        }
        self.is_old |= self.thickness.is_none();
        if self.recursion.is_none() {
            self.recursion(line);
        } else if self.angle.is_none() {
            self.angle = self.number(line);
        } else if self.thickness.is_none() {
            self.thickness = self.thickness(line);
        } else {
            let axiom = self.bare_word(line);
            self.set_axiom(axiom);
        }
    }

    /// The first word of a line without a keyword: LParser ignores the rest, which is L008.
    fn bare_word(&mut self, line: Piece<'t>) -> Piece<'t> {
        let (word, rest) = line.first_word(&[]);
        if !rest.text.is_empty() {
            let place = self.reader.place(rest.range());
            let message =
                "LParser reads a line without a keyword up to its first blank: the rest is left out".to_owned();
            let help = "remove the blank, begin a line with what belongs to the grammar, or a comment with '#'";
            self.reader.session.warning("L008", message, place, help);
        }
        word
    }

    fn number(&mut self, value: Piece<'_>) -> Option<f64> {
        let (word, _) = value.first_word(&[]);
        let number = word.text.parse::<f64>().ok().filter(|n| n.is_finite());
        if number.is_none() {
            self.error(format!("'{}' is not a number", word.text), value, "write a number such as 20 or 4.5");
        }
        number
    }

    fn thickness(&mut self, value: Piece<'_>) -> Option<f64> {
        let number = self.number(value);
        if number.is_some_and(|n| n < 0.0) {
            self.error("a thickness below 0".into(), value, "write the percentage of the length, such as 20");
        }
        number
    }

    fn recursion(&mut self, value: Piece<'_>) {
        self.length_place = self.reader.place(value.range());
        self.recursion = self.number(value);
        if let Some(n) = self.recursion.filter(|n| !(0.0..=MAX_RECURSION).contains(n)) {
            let message = format!("a recursion of {n} does not lie in 0 to 1,000,000");
            self.error(message, value, "write the number of steps, such as 7");
        }
    }

    /// Reads `color i r g b`: index, then red, green and blue from 0 to 255.
    fn color(&mut self, value: Piece<'_>) {
        // Words may follow the numbers.
        let numbers: Option<Vec<u8>> = value.text.split_whitespace().take(4).map(|w| w.parse().ok()).collect();
        match numbers.as_deref() {
            Some([i, r, g, b]) => self.reader.palette.push((*i, [*r, *g, *b])),
            _ => self.error("a color is an index and three numbers 0 to 255".into(), value, "write: color 2 255 0 0"),
        }
    }

    fn set_axiom(&mut self, value: Piece<'t>) {
        match &mut self.axiom {
            Some(parts) => parts.push(value),
            None => self.axiom = Some(vec![value]),
        }
    }

    /// Reads a rule `x = s`, with blanks anywhere.
    fn rule(&mut self, line: Piece<'t>) {
        if !is_rule(line) {
            let help = "write: rule A = F[+A]";
            return self.error("a rule is one character, '=' and its successor".into(), line, help);
        }
        let Some(symbol) = line.text.chars().next() else { return };
        // The predecessor may itself be '=': search after it.
        let equals = line.text[symbol.len_utf8()..].find('=').map_or(0, |i| i + symbol.len_utf8());
        let place = self.reader.place(line.up_to(symbol.len_utf8()).range());
        if !self.ruled.insert(symbol) {
            let message = format!("a second rule for '{symbol}' is never used");
            self.reader.session.warning("L031", message, place, "the first rule of a symbol applies");
        }
        self.rules.push(Rule { symbol, place, successor: vec![line.from(equals + 1)] });
    }

    /// L008 for parentheses without a number, unless rules can produce one from their content, and for numbers after
    /// commands that take none.
    fn check_numbers(&mut self, parts: &[Piece<'_>]) {
        let is_made = |text: &str| text.contains(|c: char| self.ruled.contains(&c));
        // Start of the open parenthesis, whether the symbol before it takes a number, and its content so far.
        let mut open: Option<(usize, bool, String)> = None;
        let mut takes_number = true;
        for (at, c) in parts.iter().flat_map(|p| p.chars()).filter(|(_, c)| !c.is_whitespace()) {
            match (&mut open, c) {
                (None, '(') => open = Some((at, takes_number, String::new())),
                (None, _) => takes_number = NUMBERED.contains(c) || self.ruled.contains(&c),
                (Some((from, is_taken, text)), ')') => {
                    let fault = if !is_number(text) && !is_made(text.as_str()) {
                        Some("is no number")
                    } else if !*is_taken {
                        Some("stands behind no command that takes a number")
                    } else {
                        None
                    };
                    if let Some(fault) = fault {
                        let place = self.reader.place(*from..at + 1);
                        let message = format!("'({text})' {fault}, and is left out");
                        self.reader.session.warning("L008", message, place, NUMBER_HELP);
                    }
                    (open, takes_number) = (None, false);
                }
                (Some((_, _, text)), c) => text.push(c),
            }
        }
        if let Some((from, ..)) = open.filter(|(_, _, text)| !is_made(text.as_str())) {
            let place = self.reader.place(from..from + 1);
            let message = "'(' without ')': what follows it is read as a number, and left out".to_owned();
            self.reader.session.warning("L008", message, place, NUMBER_HELP);
        }
    }

    /// Modules of a text, ignoring blanks.
    fn modules(&mut self, parts: &[Piece<'_>]) -> Vec<SuccessorModule> {
        let chars = parts.iter().flat_map(|p| p.chars()).filter(|(_, c)| !c.is_whitespace());
        let mut out = Vec::new();
        let mut in_number = false;
        for (at, c) in chars {
            in_number = c == '(' || (in_number && c != ')');
            let place = self.reader.place(at..at + c.len_utf8());
            // A character that is neither a command nor has a rule draws nothing: replace it by `_`. A number may contain an
            // exponent.
            let is_exponent = in_number && matches!(c, 'e' | 'E');
            let is_known = is_exponent || COMMANDS.contains(c) || self.ruled.contains(&c);
            out.extend(self.reader.module(if is_known { c } else { '_' }, place));
        }
        out
    }

    /// The fraction of the recursion; 0 if all rules are for segments and moves, whose successors LParser draws in full.
    /// L008 if there are rules of both kinds.
    fn fraction(&mut self, fraction: f64) -> f64 {
        let is_full = |rule: &&Rule<'_>| "FfZz".contains(rule.symbol);
        let full = self.rules.iter().find(is_full).map(|rule| (rule.symbol, rule.place));
        let has_others = self.rules.iter().any(|rule| !is_full(&rule));
        match full {
            Some(_) if !has_others => 0.0,
            Some((symbol, place)) if fraction > 0.0 => {
                let message = format!(
                    "the fraction of the recursion acts on what the rule of '{symbol}' makes, too, which LParser draws in full"
                );
                self.reader.session.warning(
                    "L008",
                    message,
                    place,
                    "write a whole recursion, or use another symbol for the rule",
                );
                fraction
            }
            _ => fraction,
        }
    }

    fn finish(mut self, text: &str) {
        let Some(axiom) = self.axiom.take() else {
            let piece = Piece::new(0, &text[..text.find(['\n', '\r']).unwrap_or(text.len())]);
            let help =
                "write recursion, angle, thickness and axiom, each on a line of its own, then rules such as A=F[+A]";
            return self.error("the file has no axiom".into(), piece, help);
        };
        // Recursion 3.4 derives 4 steps; the fraction .4 applies to the drawing of the last one.
        let recursion = self.recursion.unwrap_or(1.0).clamp(0.0, MAX_RECURSION);
        let fraction = self.fraction(recursion - recursion.floor());
        self.check_numbers(&axiom);
        let axiom = self.modules(&axiom);
        let mut made = BTreeSet::new();
        for Rule { symbol, place, successor } in std::mem::take(&mut self.rules) {
            // If a symbol has several rules, the first one counts.
            if made.insert(symbol) {
                self.check_numbers(&successor);
                let successor = self.modules(&successor);
                self.reader.rule(symbol, successor, place);
            }
        }
        let program = &mut self.reader.program;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 0..1e6")]
        let steps = recursion.ceil() as u32;
        (program.length, program.length_place) = (steps, Some(self.length_place));
        if let Some(turtle) = &mut program.turtle {
            turtle.settings.angle_deg = Some(self.angle.unwrap_or(45.0));
            turtle.settings.thickness = Some(0.01 * self.thickness.unwrap_or(100.0));
            turtle.settings.min_thickness = 0.01 * self.min_thickness;
            turtle.settings.unit = self.is_old.then_some(OLD_UNIT);
            turtle.settings.fraction = Some(fraction).filter(|f| *f > 0.0);
        }
        self.reader.axiom(axiom);
    }
}

/// Help for numbers that have no effect.
const NUMBER_HELP: &str = "write a number directly behind a command that takes one: F(20)";

/// True if a text is a number as LParser reads it: `20`, `-.5`, `1e2`.
fn is_number(text: &str) -> bool {
    // Rust also parses the words `inf` and `nan`.
    text.chars().all(|c| c.is_ascii_digit() || "+-.eE".contains(c)) && text.parse::<f64>().is_ok_and(f64::is_finite)
}

/// True for a word such as `no_wait` before a single number, which cannot be an axiom.
fn is_setting(word: Piece<'_>, value: Piece<'_>) -> bool {
    let mut parts = word.text.split('_');
    let are_words =
        parts.clone().count() > 1 && parts.all(|p| p.len() > 1 && p.bytes().all(|b| b.is_ascii_lowercase()));
    are_words && value.text.parse::<f64>().is_ok()
}

/// True for one character, optional blanks and '='.
pub(super) fn is_rule(line: Piece<'_>) -> bool {
    let mut chars = line.trimmed().text.chars();
    let symbol = chars.next();
    symbol.is_some_and(|c| c != '=') && chars.as_str().trim_start().starts_with('=')
}
