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
    match t.kind {
        TokenKind::Ident(n) | TokenKind::Number(n) => {
            let text = compiler.session.names.get(n);
            let at = |i: usize, c: char| {
                let mut place = t.place;
                // A macro may have changed the text: a character that its token does not contain gets the whole token.
                if let (Ok(offset), Ok(length)) = (u32::try_from(i), u32::try_from(c.len_utf8()))
                    && place.span.start + offset + length <= place.span.end
                {
                    let start = place.span.start + offset;
                    (place.span.start, place.span.end) = (start, start + length);
                }
                LocatedSymbol { c, place }
            };
            text.char_indices().map(|(i, c)| at(i, c)).collect()
        }
        TokenKind::Text(n) => {
            let text = compiler.session.names.get(n);
            // Quotes are symbols of the string like any other character.
            ['"'].into_iter().chain(text.chars()).chain(['"']).map(|c| LocatedSymbol { c, place: t.place }).collect()
        }
        TokenKind::Char(c) => vec![LocatedSymbol { c, place: t.place }],
        TokenKind::Newline { .. } => Vec::new(),
    }
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
