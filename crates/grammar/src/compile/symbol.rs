//! Splits tokens into symbols, with the source place of each character.

use super::Compiler;
use crate::symbols::{SymbolId, Symbols};
use crate::token::{SourcePlace, Token, TokenKind};

/// Limit on the parameters of one module: their number is stored in 8 bits.
pub(super) const MAX_ARITY: usize = 255;

/// One symbol and its place. Blanks are not needed between symbols: a word is one symbol for each letter.
#[derive(Debug, Clone, Copy)]
pub(super) struct LocatedSymbol {
    pub c: char,
    pub place: SourcePlace,
}

/// Symbols of a token, each with its place: one per character, quotes included; none for a line end.
pub(super) fn symbols_of(compiler: &Compiler<'_>, t: &Token) -> Vec<LocatedSymbol> {
    symbols_in(&text_of(compiler, t), t).collect()
}

/// The text of a token, quotes included; empty for a line end.
pub(super) fn text_of(compiler: &Compiler<'_>, t: &Token) -> String {
    match t.kind {
        TokenKind::Ident(n) | TokenKind::Number(n) => compiler.session.names.get(n).to_owned(),
        // Quotes are symbols of the string like any other character.
        TokenKind::Text(n) => format!("\"{}\"", compiler.session.names.get(n)),
        TokenKind::Char(c) => c.to_string(),
        TokenKind::Newline { .. } => String::new(),
    }
}

/// The symbols of `text`, one per character, with their places.
pub(super) fn symbols_in<'t>(text: &'t str, t: &'t Token) -> impl Iterator<Item = LocatedSymbol> + 't {
    let is_word = matches!(t.kind, TokenKind::Ident(_) | TokenKind::Number(_));
    text.char_indices().map(move |(i, c)| {
        let mut place = t.place;
        // If a macro has changed the text, a character not found in its token gets the place of the whole token.
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
