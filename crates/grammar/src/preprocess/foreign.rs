//! Recognises files of other programs whose names have the same ending.

use crate::token::{NameTable, SourcePlace, Token, TokenKind};

/// The program that a file is written for, and the line that identifies it, if it is one whose language is not supported.
pub(super) fn detect(names: &NameTable, tokens: &[Token]) -> Option<(&'static str, SourcePlace)> {
    tokens.split(Token::is_newline).find_map(|line| {
        let (first, last) = (line.first()?, line.last()?);
        Some((program(names, line)?, first.place.to(last.place)))
    })
}

/// The program of such a line; `None` for a line that may belong to cpfg.
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
