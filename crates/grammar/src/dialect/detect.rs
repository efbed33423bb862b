//! What a file is, by its content and then by the ending of its name.

use super::lparser;
use super::text::{Piece, decode, lines};
use crate::notation::Notation;

/// What a file contains, judged by its text and its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FileKind {
    /// A grammar that can be read, in the notation whose marks it has.
    Grammar(Notation),
    /// Rules as Houdini writes them, one on each line.
    Houdini,
    /// Nothing that a grammar would contain.
    Other,
}

/// Bytes of a file that are looked at: the heading of a grammar lies within them.
const LOOKED_AT: usize = 1 << 20;

/// Determines the kind of a file from its content, and where that is not decisive from the ending of its name (`.l` cpfg, `.ls`
/// LParser, `.lpy` L-Py).
pub fn detect(name: &str, bytes: &[u8]) -> FileKind {
    let decoded = decode(&bytes[..bytes.len().min(LOOKED_AT)]);
    let text = decoded.text.as_str();
    let ending = name.rsplit_once('.').map_or_else(String::new, |(_, e)| e.to_ascii_lowercase());
    // Marks of cpfg and of L+C come first: they stand in no other notation.
    if has_line(text, is_cpfg_heading) || has_line(text, is_l_plus_c) || ends_as_l_plus_c(text) {
        return FileKind::Grammar(Notation::Cpfg);
    }
    if is_fractint(text) {
        return FileKind::Grammar(Notation::Fractint);
    }
    if is_lpy(text, ending == "lpy") {
        return FileKind::Grammar(Notation::LPy);
    }
    // LParser before the arrow, which its commands may spell: `[--->F]`. A comment or title of a scene may contain both.
    if ending != "toml" && is_lparser(text) {
        return FileKind::Grammar(Notation::LParser);
    }
    if ending != "toml" && has_line(text, is_arrow_rule) {
        return FileKind::Grammar(Notation::Cpfg);
    }
    match ending.as_str() {
        "ls" => FileKind::Grammar(Notation::LParser),
        "lpy" => FileKind::Grammar(Notation::LPy),
        "toml" => FileKind::Other,
        "l" if super::fractint::has_faulty_system(text) => FileKind::Grammar(Notation::Fractint),
        _ if is_houdini(text) => FileKind::Houdini,
        "l" => FileKind::Grammar(Notation::Cpfg),
        _ => FileKind::Other,
    }
}

fn has_line(text: &str, test: impl Fn(&str) -> bool) -> bool {
    lines(text).any(|l| test(l.text.trim()))
}

/// `Lsystem: ..` or `ring Lsystem: ..`, in any case.
fn is_cpfg_heading(line: &str) -> bool {
    let line = strip_word(line, "ring").map_or(line, str::trim_start);
    strip_word(line, "lsystem").is_some_and(|rest| rest.trim_start().starts_with(':'))
}

/// The rest of a line that begins with `word`, in any case.
fn strip_word<'t>(line: &'t str, word: &str) -> Option<&'t str> {
    let (begin, rest) = line.split_at_checked(word.len())?;
    begin.eq_ignore_ascii_case(word).then_some(rest)
}

/// A line of L+C, such as `module A(float);`: its file counts as cpfg, whose reader names L+C in its error.
fn is_l_plus_c(line: &str) -> bool {
    (line.starts_with("#include") && line.contains("lpfgall")) || (line.starts_with("module ") && line.ends_with(';'))
}

/// True if the derivation length ends with the semicolon of L+C, and so does the axiom: Python allows one after a number, too.
fn ends_as_l_plus_c(text: &str) -> bool {
    let is_axiom = |line: &str| {
        strip_word(line, "axiom").is_some_and(|rest| rest.trim_start().starts_with(':')) && !line.ends_with([';', ':'])
    };
    has_line(text, |line| strip_word(line, "derivation length:").is_some() && line.ends_with(';'))
        && !has_line(text, is_axiom)
}

/// A production with the arrow `-->` of cpfg, but no comment of XML and no line that begins with `#`.
fn is_arrow_rule(line: &str) -> bool {
    line.contains("-->") && !line.starts_with("<!--") && !line.starts_with('#')
}

/// An entry `Name { .. }` with an axiom.
fn is_fractint(text: &str) -> bool {
    text.contains('{') && super::fractint::has_system(text)
}

/// Headings of L-Py, or Python around an axiom.
fn is_lpy(text: &str, has_ending: bool) -> bool {
    let mut axiom = false;
    let (mut heading, mut python) = (false, false);
    for line in lines(text) {
        let code = line.before('#');
        let unindented = !code.text.starts_with([' ', '\t']);
        let lower = code.text.trim().to_ascii_lowercase();
        let lower = lower.as_str();
        axiom |= lower.starts_with("axiom:") || lower.starts_with("axiom :");
        heading |= unindented && matches!(lower, "production:" | "interpretation:");
        python |= unindented && (lower.starts_with("from ") && lower.contains(" import "))
            || unindented && lower.starts_with("def ") && lower.ends_with(':')
            || lower.starts_with("produce ") && !lower.ends_with(';')
            || lower.starts_with("nproduce ");
    }
    heading && (axiom || has_ending || python) || axiom && python || has_ending && axiom
}

/// Keywords of LParser, or three lines that begin with a number, then an axiom, and a rule or a line that begins with `@`.
fn is_lparser(text: &str) -> bool {
    let code = || lines(text).map(|l| l.before('#').trimmed()).filter(|l| !l.text.is_empty());
    let keyword = |l: &Piece<'_>, words: &[&str]| {
        let (word, rest) = l.first_word(&[]);
        words.contains(&word.text.to_ascii_lowercase().as_str()) && !rest.text.is_empty() && !rest.text.starts_with('=')
    };
    let has = |word: &str| code().any(|l| keyword(&l, &[word]));
    if has("axiom") && (has("rule") || has("recursion")) {
        return true;
    }
    let mut numbers = code();
    let is_number = |l: Option<Piece<'_>>| l.is_some_and(|l| l.first_word(&[]).0.text.parse::<f64>().is_ok());
    let has_numbers = (0..3).all(|_| is_number(numbers.next()));
    let Some(axiom) = numbers.next().filter(|_| has_numbers) else { return false };
    let mut rules = numbers.take_while(|l| !l.text.starts_with('@'));
    axiom.text.parse::<f64>().is_err() && (rules.any(lparser::is_rule) || code().any(|l| l.text.starts_with('@')))
}

/// Rules `F=F[+F]F` or `A(i):i>3=F(i)A:0.5` without an arrow, at least one, and nothing that TOML could be.
fn is_houdini(text: &str) -> bool {
    let rule = |line: &str| {
        let Some((left, right)) = line.split_once('=') else { return false };
        let (left, right) = (left.trim(), right.trim());
        let symbol = left.split(['(', ':', '<', '>']).next().unwrap_or("");
        // The successor of a rule has commands, or letters only; the value of a setting has neither.
        let looks_drawn =
            right.contains(['[', ']', '+', '-', '&', '/']) || right.chars().all(|c| c.is_ascii_alphabetic());
        symbol.chars().count() == 1
            && !right.is_empty()
            && !right.starts_with(['"', '\'', '[', '{', '='])
            && right.parse::<f64>().is_err()
            && looks_drawn
    };
    let mut rules = 0_usize;
    for line in lines(text).map(|l| l.text.trim()).filter(|l| !l.is_empty() && !l.starts_with(['#', '/'])) {
        // A heading of TOML, such as `[table]`.
        if line.starts_with('[') && line.ends_with(']') && !line.contains(['+', '-', '&', '/']) {
            return false;
        }
        rules += usize::from(rule(line));
    }
    rules > 0
}
