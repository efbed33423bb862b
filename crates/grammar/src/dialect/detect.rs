//! Detects the kind of a file from its content and then from its filename extension.

use super::lparser;
use super::text::{Piece, decode, lines};
use crate::notation::Notation;

/// Kind of a file, determined from its text and its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FileKind {
    /// A readable grammar in the detected notation.
    Grammar(Notation),
    /// Rules in the notation of Houdini, one on each line.
    Houdini,
    /// A file without any sign of a grammar.
    Other,
}

/// Number of bytes inspected at the beginning of a file, which contain the heading of a grammar.
const LOOKED_AT: usize = 1 << 20;

/// Determines the kind of a file from its content, or if that is not decisive from its extension (`.l` cpfg, `.ls` LParser,
/// `.lpy` L-Py).
pub fn detect(name: &str, bytes: &[u8]) -> FileKind {
    let decoded = decode(&bytes[..bytes.len().min(LOOKED_AT)]);
    let text = decoded.text.as_str();
    let ending = name.rsplit_once('.').map_or_else(String::new, |(_, e)| e.to_ascii_lowercase());
    // Check for cpfg and L+C first: their headings occur in no other notation.
    if has_line(text, is_cpfg_heading) || has_line(text, is_l_plus_c) || ends_as_l_plus_c(text) {
        return FileKind::Grammar(Notation::Cpfg);
    }
    if is_fractint(text) {
        return FileKind::Grammar(Notation::Fractint);
    }
    if is_lpy(text, ending == "lpy") {
        return FileKind::Grammar(Notation::LPy);
    }
    // Check for LParser before the arrow `-->`, which its commands may contain: `[--->F]`. A comment or title of a scene may
    // contain both.
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

/// True for `Lsystem: ..` or `ring Lsystem: ..`, in upper or lower case.
fn is_cpfg_heading(line: &str) -> bool {
    let line = strip_word(line, "ring").map_or(line, str::trim_start);
    strip_word(line, "lsystem").is_some_and(|rest| rest.trim_start().starts_with(':'))
}

/// The rest of a line that begins with `word`, in upper or lower case.
fn strip_word<'t>(line: &'t str, word: &str) -> Option<&'t str> {
    let (begin, rest) = line.split_at_checked(word.len())?;
    begin.eq_ignore_ascii_case(word).then_some(rest)
}

/// True for a line of L+C, such as `module A(float);`. Such a file counts as cpfg, whose reader names L+C in its error.
fn is_l_plus_c(line: &str) -> bool {
    (line.starts_with("#include") && line.contains("lpfgall")) || (line.starts_with("module ") && line.ends_with(';'))
}

/// True if both the derivation length and the axiom end with the semicolon of L+C; Python also allows one after a number.
fn ends_as_l_plus_c(text: &str) -> bool {
    let is_axiom = |line: &str| {
        strip_word(line, "axiom").is_some_and(|rest| rest.trim_start().starts_with(':')) && !line.ends_with([';', ':'])
    };
    has_line(text, |line| strip_word(line, "derivation length:").is_some() && line.ends_with(';'))
        && !has_line(text, is_axiom)
}

/// True for a line with cpfg's arrow `-->` that is neither an XML comment nor begins with `#`.
fn is_arrow_rule(line: &str) -> bool {
    line.contains("-->") && !line.starts_with("<!--") && !line.starts_with('#')
}

/// True if the text has an entry `Name { .. }` with an axiom.
fn is_fractint(text: &str) -> bool {
    text.contains('{') && super::fractint::has_system(text)
}

/// True for headings of L-Py, or Python statements together with an axiom.
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

/// True for keywords of LParser; or for three lines that begin with a number, then an axiom, and a rule or a line that
/// begins with `@`.
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

/// True if the text has rules such as `F=F[+F]F` or `A(i):i>3=F(i)A:0.5`, without an arrow, and no table heading of TOML.
fn is_houdini(text: &str) -> bool {
    let rule = |line: &str| {
        let Some((left, right)) = line.split_once('=') else { return false };
        let (left, right) = (left.trim(), right.trim());
        let symbol = left.split(['(', ':', '<', '>']).next().unwrap_or("");
        // The successor of a rule contains commands, or consists of letters; the value of a setting does neither.
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
