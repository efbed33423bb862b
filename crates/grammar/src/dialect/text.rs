//! Decodes bytes to text, and splits text into lines with their places.

/// The text of a file, and the encoding of its bytes.
pub(super) struct Decoded {
    pub text: String,
    /// True if the bytes were not valid UTF-8 and were read as Latin-1.
    pub is_latin1: bool,
}

/// Decodes a file: UTF-8, UTF-16 if it begins with a byte order mark, else Latin-1. Text after the DOS end-of-file character
/// `^Z` is ignored.
pub(super) fn decode(bytes: &[u8]) -> Decoded {
    let (mut text, is_latin1) = match bytes {
        [0xff, 0xfe, rest @ ..] => (utf16(rest, u16::from_le_bytes), false),
        [0xfe, 0xff, rest @ ..] => (utf16(rest, u16::from_be_bytes), false),
        _ => {
            let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
            match std::str::from_utf8(bytes) {
                Ok(text) => (text.to_owned(), false),
                Err(_) => (bytes.iter().map(|&b| char::from(b)).collect(), true),
            }
        }
    };
    if let Some(end) = text.find('\u{1a}') {
        text.truncate(end);
    }
    Decoded { text, is_latin1 }
}

fn utf16(bytes: &[u8], unit: fn([u8; 2]) -> u16) -> String {
    let units = bytes.chunks_exact(2).map(|p| unit([p[0], p[1]]));
    char::decode_utf16(units).map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER)).collect()
}

/// A part of a text, with the byte offset of its beginning.
#[derive(Debug, Clone, Copy)]
pub(super) struct Piece<'t> {
    pub at: usize,
    pub text: &'t str,
}

impl<'t> Piece<'t> {
    pub fn new(at: usize, text: &'t str) -> Self {
        Self { at, text }
    }

    /// The part without whitespace at either end; `at` is adjusted.
    pub fn trimmed(self) -> Self {
        let start = self.text.trim_start();
        Self { at: self.at + self.text.len() - start.len(), text: start.trim_end() }
    }

    /// The part before the first `c`, or the whole part if it has none.
    pub fn before(self, c: char) -> Self {
        Self { at: self.at, text: self.text.split(c).next().unwrap_or("") }
    }

    /// The part from byte `i` to the end; `i` is relative to this part.
    pub fn from(self, i: usize) -> Self {
        Self { at: self.at + i.min(self.text.len()), text: self.text.get(i..).unwrap_or("") }
    }

    /// The part before byte `i`, which is relative to this part.
    pub fn up_to(self, i: usize) -> Self {
        Self { at: self.at, text: self.text.get(..i).unwrap_or(self.text) }
    }

    pub fn range(self) -> std::ops::Range<usize> {
        self.at..self.at + self.text.len()
    }

    /// Splits after the first word, which ends at whitespace or one of `ends`; the rest is trimmed, but keeps a character of
    /// `ends`.
    pub fn first_word(self, ends: &[char]) -> (Self, Self) {
        let t = self.trimmed();
        let end = t.text.find(|c: char| c.is_whitespace() || ends.contains(&c)).unwrap_or(t.text.len());
        (t.up_to(end), t.from(end).trimmed())
    }

    /// Its characters with their byte offsets in the whole text.
    pub fn chars(self) -> impl Iterator<Item = (usize, char)> + 't {
        let at = self.at;
        self.text.char_indices().map(move |(i, c)| (at + i, c))
    }
}

/// Lines of a text, which end in LF, CRLF or CR, without their line ends.
pub(super) fn lines(text: &str) -> impl Iterator<Item = Piece<'_>> {
    let mut at = 0;
    let mut rest = Some(text);
    std::iter::from_fn(move || {
        let now = rest?;
        let end = now.find(['\n', '\r']);
        let line = Piece::new(at, &now[..end.unwrap_or(now.len())]);
        rest = end.map(|e| {
            let skip = if now[e..].starts_with("\r\n") { 2 } else { 1 };
            at += e + skip;
            &now[e + skip..]
        });
        Some(line)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_end_in_any_way_and_know_their_places() {
        let found: Vec<(usize, &str)> = lines("a\r\nbc\rd\n\ne").map(|l| (l.at, l.text)).collect();
        assert_eq!(found, [(0, "a"), (3, "bc"), (6, "d"), (8, ""), (9, "e")]);
        let (word, rest) = Piece::new(10, "  angle = 6 ").first_word(&['=']);
        assert_eq!((word.at, word.text, rest.at, rest.text), (12, "angle", 18, "= 6"));
    }

    #[test]
    fn encodings_are_found_by_their_marks() {
        assert_eq!(decode(b"\xff\xfeA\0b\0").text, "Ab");
        assert_eq!(decode(b"\xfe\xff\0A\0b").text, "Ab");
        assert!(decode(b"caf\xe9").is_latin1);
        assert_eq!(decode(b"F=FF\x1aGARBAGE").text, "F=FF");
    }
}
