//! Splits a model into lines, without comments.

use std::ops::Range;

use crate::dialect::text::Piece;

/// A line that is not blank; `indent` is in columns.
#[derive(Debug, Clone, Copy)]
pub(super) struct Line<'t> {
    pub indent: usize,
    pub piece: Piece<'t>,
}

/// A line with its indentation; `None` if it is blank.
pub(super) fn line_of(piece: Piece<'_>) -> Option<Line<'_>> {
    let trimmed = piece.trimmed();
    if trimmed.text.is_empty() {
        return None;
    }
    let lead = &piece.text[..trimmed.at - piece.at];
    // A tab extends to the next multiple of 8 columns, as in Python.
    let indent = lead.chars().fold(0, |n, c| if c == '\t' { n / 8 * 8 + 8 } else { n + 1 });
    Some(Line { indent, piece: trimmed })
}

/// Lines of the block after line `i`, which are indented more than it, and the index of the line after the block.
pub(super) fn block_after<'l, 't>(list: &'l [Line<'t>], i: usize, indent: usize) -> (&'l [Line<'t>], usize) {
    let n = list.get(i + 1..).unwrap_or(&[]).iter().take_while(|l| l.indent > indent).count();
    (&list[i + 1..i + 1 + n], i + 1 + n)
}

/// The text after the colon of a heading such as `Axiom:`; any number of blanks may separate the words of the heading.
pub(super) fn after_heading<'t>(piece: Piece<'t>, words: &[&str]) -> Option<Piece<'t>> {
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

/// The first comment, or the string at the beginning of the file.
pub(super) fn description(text: &str) -> String {
    let first = text.trim_start();
    let quoted = first.strip_prefix("\"\"\"").and_then(|t| t.split("\"\"\"").next());
    let line = quoted.or_else(|| first.strip_prefix('#')).unwrap_or("");
    line.trim().split(['\n', '\r']).next().unwrap_or("").trim_matches(['#', '-', '=', ' ']).to_owned()
}

/// True if a text ends with the heading of an axiom.
fn begins_axiom(text: &[u8]) -> bool {
    let line = text.rsplit(|b| matches!(b, b'\n' | b'\r')).next().unwrap_or_default();
    line.trim_ascii().strip_suffix(b":").is_some_and(|word| word.trim_ascii().eq_ignore_ascii_case(b"axiom"))
}

/// Characters that have a meaning outside of strings.
const SIGNS: &[u8; 25] = b"()[]{}:;,=<>#*+-/%.&|!\"'\\";

/// The replacement of a byte in a string: each character of [`SIGNS`] becomes a control character of its own, so that
/// searches for these characters skip strings, and different strings stay different.
pub(super) fn masked(byte: u8) -> u8 {
    // 0x01 to 0x08 and 0x0e to 0x1e, which are not whitespace.
    let codes = (0x01..=0x08_u8).chain(0x0e..=0x1e);
    SIGNS.iter().zip(codes).find(|(sign, _)| **sign == byte).map_or(byte, |(_, code)| code)
}

/// Replacement of a backslash and line end within a string, which continue it on the next line without being part of it.
pub(super) const JOINED: u8 = 0x1f;

/// Number of bytes of the character at the beginning of `text`, which is the rest of a string, with the backslash before it.
fn quoted_character(text: &[u8]) -> usize {
    match text {
        [b'\\', b'\r', b'\n', ..] => 3,
        [b'\\', _, ..] => 2,
        _ => 1,
    }
}

/// Masks the characters of a string, and joins its lines.
fn mask_text(text: &mut [u8]) {
    let mut i = 0;
    while let Some(rest) = text.get_mut(i..).filter(|rest| !rest.is_empty()) {
        let is_joined = matches!(&*rest, [b'\\', b'\n' | b'\r', ..]);
        let n = quoted_character(rest);
        rest.iter_mut().take(n).for_each(|b| *b = if is_joined { JOINED } else { masked(*b) });
        i += n;
    }
}

/// The text in which comments, strings in triple quotes, line ends within parentheses and line ends after a backslash are
/// replaced by blanks, so that all offsets stay the same. Characters within other strings are [`masked`], and their line
/// ends become [`JOINED`].
pub(super) fn without_comments(text: &str) -> String {
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
            // Length including both triple quotes; an unclosed string extends to the end of the file.
            let inner = rest[3..].windows(3).position(|w| w == quotes).map_or(rest.len(), |n| n + 6);
            blank(&mut out, i..i + inner);
            i += inner;
            continue;
        }
        match b {
            // Early versions set the width with `#`, so that an axiom may begin with it; read as a comment, it would leave no axiom.
            b'#' if rest.starts_with(b"#(") && begins_axiom(&bytes[..i]) => out[i] = b'_',
            b'#' => {
                let end = rest.iter().position(|c| matches!(c, b'\n' | b'\r')).unwrap_or(rest.len());
                blank(&mut out, i..i + end);
                i += end;
                continue;
            }
            b'"' | b'\'' => {
                let length = quoted_length(rest);
                mask_text(out.get_mut(i + 1..i + length - 1).unwrap_or_default());
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
            // A list or dictionary assigned to a name may span several lines. Its bracket follows a `=`, unlike that of a
            // branch or polygon.
            b'[' | b'{' if list > 0 || bytes[..i].trim_ascii_end().ends_with(b"=") => list += 1,
            b']' | b'}' => list = list.saturating_sub(1),
            b'\n' | b'\r' if list > 0 && depth == 0 => out[i] = b' ',
            // If a heading begins a line within parentheses, the parenthesis before it is not closed, since a heading cannot be a
            // parameter.
            b'\n' | b'\r' if depth > 0 => {
                if rest.get(1).is_some_and(|c| matches!(c, b' ' | b'\t' | b')' | b'\n' | b'\r')) {
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

/// Length of the string at the beginning of `bytes`, in which '#' does not begin a comment. It ends at its quote, or at the
/// end of the line unless a backslash precedes that.
fn quoted_length(bytes: &[u8]) -> usize {
    let quote = bytes.first().copied();
    let mut i = 1;
    while let Some(rest) = bytes.get(i..).filter(|rest| !rest.is_empty()) {
        if rest.first().copied() == quote || matches!(rest, [b'\n' | b'\r', ..]) {
            return i + 1;
        }
        i += quoted_character(rest);
    }
    bytes.len()
}
