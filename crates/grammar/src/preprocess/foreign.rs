//! Recognises files of other programs that have the same filename extension.

use crate::token::{NameTable, SourcePlace, Token, TokenKind};

/// The program that a file is written for, and the place of the line that identifies it; `None` unless that program's
/// language is unsupported or has a reader of its own.
pub(super) fn detect(names: &NameTable, tokens: &[Token]) -> Option<(&'static str, SourcePlace)> {
    tokens.split(Token::is_newline).find_map(|line| {
        let (first, last) = (line.first()?, line.last()?);
        Some((program(names, line)?, first.place.to(last.place)))
    })
}

/// The program that this line identifies; `None` for a line that may belong to cpfg.
fn program(names: &NameTable, line: &[Token]) -> Option<&'static str> {
    let (first, last) = (line.first()?, line.last()?);
    let word = |t: &Token| if let TokenKind::Ident(n) = t.kind { names.get(n) } else { "" };
    match word(first) {
        "module" | "produce" if last.is(';') && line.len() > 2 => Some("L+C"),
        "def" if last.is(':') && line.len() > 3 => Some("L-Py"),
        "production" if last.is(':') && line.len() == 2 => Some("L-Py"),
        _ if first.is('#') && line.iter().any(|t| word(t) == "lpfgall") => Some("L+C"),
        _ => None,
    }
}
