//! Symbols of tokens, with the source location of each character.

use super::Compiler;
use crate::symbols::{SymbolId, Symbols};
use crate::token::{SourcePlace, Token, TokenKind};

/// Upper limit on the parameters of one module, whose number is stored in 8 bits.
pub(super) const MAX_ARITY: usize = 255;

/// One symbol: blanks mean nothing, so that a word is as many symbols as it has letters.
#[derive(Debug, Clone, Copy)]
pub(super) struct LocatedSymbol {
    pub c: char,
    pub place: SourcePlace,
}

/// Symbols that a token stands for, each with its place: one per character, quotes included; none for an end of line.
pub(super) fn symbols_of(compiler: &Compiler<'_>, t: &Token) -> Vec<LocatedSymbol> {
    symbols_in(&text_of(compiler, t), t).collect()
}

/// The characters of a token, quotes included; empty for an end of line.
pub(super) fn text_of(compiler: &Compiler<'_>, t: &Token) -> String {
    match t.kind {
        TokenKind::Ident(n) | TokenKind::Number(n) => compiler.session.names.get(n).to_owned(),
        // Quotes are symbols of the string like any other character.
        TokenKind::Text(n) => format!("\"{}\"", compiler.session.names.get(n)),
        TokenKind::Char(c) => c.to_string(),
        TokenKind::Newline { .. } => String::new(),
    }
}

/// One symbol for each character of a token's text, with its place.
pub(super) fn symbols_in<'t>(text: &'t str, t: &'t Token) -> impl Iterator<Item = LocatedSymbol> + 't {
    let is_word = matches!(t.kind, TokenKind::Ident(_) | TokenKind::Number(_));
    text.char_indices().map(move |(i, c)| {
        let mut place = t.place;
        // A macro may have changed the text: a character that its token does not contain gets the whole token.
        if let (Ok(offset), Ok(length)) = (u32::try_from(i), u32::try_from(c.len_utf8()))
            && is_word
            && place.span.start + offset + length <= place.span.end
        {
            let start = place.span.start + offset;
            (place.span.start, place.span.end) = (start, start + length);
        }
        LocatedSymbol { c, place }
    })
}

pub(super) fn intern(
    compiler: &mut Compiler<'_>,
    symbols: &mut Symbols,
    c: char,
    place: SourcePlace,
) -> Option<SymbolId> {
    let id = symbols.intern(c);
    if id.is_none() {
        compiler.session.error("L004", "more than 65,535 different symbols", place, "this one is too many");
    }
    id
}
