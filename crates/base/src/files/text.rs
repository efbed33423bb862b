//! Bytes into text: UTF-8 with or without byte order mark, any line ends, Latin-1 for formats older than UTF-8.

use crate::diagnostic::{Diagnostic, Report, Span};

/// What to do with bytes that are not UTF-8.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    /// Bytes that are not UTF-8 are an error.
    Utf8,
    /// A text that is not UTF-8 is read as Latin-1; the reader warns.
    OrLatin1,
}

/// A text with LF line ends and no byte order mark.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DecodedText {
    /// The characters. Offsets in it differ from those in the file by a byte order mark and by removed CRs.
    pub text: String,
    /// Set if it was read as Latin-1: one-based line and byte offset of the first byte that is not UTF-8.
    pub latin1: Option<(usize, usize)>,
}

/// Why bytes are not a text.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{what} at byte {offset}, line {line}, column {column}")]
pub struct TextError {
    /// The bytes that are not text, as the subject of the message.
    pub what: &'static str,
    /// Offset in the file, bytes; a byte order mark counts.
    pub offset: usize,
    /// Line of that byte from 1; LF, CRLF and lone CR end a line.
    pub line: usize,
    /// Column of that byte from 1, in characters.
    pub column: usize,
}

impl TextError {
    /// Adds a diagnostic of the given code, at the end of the readable part of `bytes`, which is added as a source called `name`.
    pub fn report(&self, code: &'static str, name: &str, bytes: &[u8], report: &mut Report) {
        let start = bytes.get(..self.offset).unwrap_or(bytes);
        // Up to the offset the bytes are UTF-8, so that offsets in the text equal those in the file.
        let text = String::from_utf8_lossy(start).into_owned() + "\u{fffd}";
        let source = report.sources.add(name, text);
        let span = Span::new(source, self.offset, self.offset + '\u{fffd}'.len_utf8());
        report.push(
            Diagnostic::error(code, self.to_string(), span, "here").help("save the file as UTF-8 text and try again"),
        );
    }
}

/// Decodes a text file. Line ends become LF, a byte order mark is dropped.
/// # Errors
/// A NUL byte, UTF-16, or (with [`Encoding::Utf8`]) bytes that are not UTF-8.
pub fn decode(bytes: &[u8], encoding: Encoding) -> Result<DecodedText, TextError> {
    let skipped = if bytes.starts_with(b"\xef\xbb\xbf") { 3 } else { 0 };
    let body = bytes.get(skipped..).unwrap_or_default();
    if bytes.starts_with(b"\xff\xfe") || bytes.starts_with(b"\xfe\xff") {
        return Err(TextError { what: "the text is UTF-16, not UTF-8,", offset: 0, line: 1, column: 1 });
    }
    let bad = |what, at: usize| {
        let (line, column) = position(body.get(..at).unwrap_or(body));
        TextError { what, offset: at + skipped, line, column }
    };
    if let Some(at) = body.iter().position(|b| *b == 0) {
        let readable = std::str::from_utf8(body.get(..at).unwrap_or(body)).map_or_else(|e| e.valid_up_to(), |_| at);
        // As UTF-8 the earlier of a NUL byte and an invalid byte is reported; as Latin-1 no other byte is invalid.
        if readable == at || encoding == Encoding::OrLatin1 {
            return Err(bad("a NUL byte", at));
        }
    }
    match std::str::from_utf8(body) {
        Ok(text) => Ok(DecodedText { text: with_lf(text), latin1: None }),
        Err(e) if encoding == Encoding::Utf8 => Err(bad("bytes that are not UTF-8", e.valid_up_to())),
        Err(e) => {
            // Latin-1 is the first 256 code points, so every byte is its own character.
            let text: String = body.iter().map(|b| char::from(*b)).collect();
            let (line, _) = position(body.get(..e.valid_up_to()).unwrap_or(body));
            Ok(DecodedText { text: with_lf(&text), latin1: Some((line, e.valid_up_to() + skipped)) })
        }
    }
}

fn with_lf(text: &str) -> String {
    if text.contains('\r') { text.replace("\r\n", "\n").replace('\r', "\n") } else { text.to_owned() }
}

/// One-based line and column just after these bytes.
fn position(before: &[u8]) -> (usize, usize) {
    let text = with_lf(&String::from_utf8_lossy(before));
    let line = text.bytes().filter(|b| *b == b'\n').count() + 1;
    let column = text.rsplit('\n').next().unwrap_or_default().chars().count() + 1;
    (line, column)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_form_of_a_text_is_read_alike() {
        for form in ["a\nb\n", "\u{feff}a\nb\n", "a\r\nb\r\n", "a\rb\r", "\u{feff}a\r\nb\n"] {
            let text = decode(form.as_bytes(), Encoding::Utf8).expect("text");
            assert_eq!((text.text.as_str(), text.latin1), ("a\nb\n", None), "{form:?}");
        }
        assert_eq!(decode(b"a\nb", Encoding::Utf8).expect("text").text, "a\nb");
        assert_eq!(decode(b"", Encoding::Utf8).expect("text").text, "");
    }

    #[test]
    fn bad_bytes_have_a_place() {
        let at = |bytes: &[u8], encoding| decode(bytes, encoding).map_err(|e| (e.offset, e.line, e.column));
        assert_eq!(at("ab\r\n\u{e9}\0".as_bytes(), Encoding::Utf8), Err((6, 2, 2)));
        assert_eq!(at(b"\xef\xbb\xbfab\0", Encoding::OrLatin1), Err((5, 1, 3)));
        assert_eq!(at(b"ab\n\xe9t\xe9", Encoding::Utf8), Err((3, 2, 1)));
        assert_eq!(at(b"\xff\xfea\0", Encoding::OrLatin1), Err((0, 1, 1)));
        let latin = decode(b"ab\n\xe9t\xe9", Encoding::OrLatin1).expect("text");
        assert_eq!((latin.text.as_str(), latin.latin1), ("ab\n\u{e9}t\u{e9}", Some((2, 3))));
    }

    #[test]
    fn a_report_shows_where_the_text_ends() {
        let bytes = b"seed = 1\ntitle = \"\xe9\"\n";
        let mut report = Report::default();
        decode(bytes, Encoding::Utf8).expect_err("not UTF-8").report("S001", "a.toml", bytes, &mut report);
        insta::assert_snapshot!(report.to_string());
    }
}
