//! Source texts, and spans and positions in them.

use std::sync::Arc;

use crate::convert;

/// Index of a text in [`Sources`], in order of addition.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SourceId(pub u32);

/// Bytes `start..end` of one source.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Span {
    /// The source that holds the bytes; [`Span::to`] never joins spans of two sources.
    pub source: SourceId,
    /// Offset of the first byte in the UTF-8 text.
    pub start: u32,
    /// One past the last byte; equal to `start` for a place between bytes.
    pub end: u32,
}

impl Span {
    /// Span of bytes `start..end`; offsets beyond 4 GiB saturate (texts are limited far below).
    pub fn new(source: SourceId, start: usize, end: usize) -> Self {
        // Offsets beyond the text need no error: positions and excerpts clamp them to its end.
        let clip = convert::saturating_index;
        Self { source, start: clip(start), end: clip(end) }
    }

    /// The smallest span that holds both; `self` if they lie in different sources.
    pub fn to(self, other: Self) -> Self {
        if self.source == other.source {
            Self { start: self.start.min(other.start), end: self.end.max(other.end), ..self }
        } else {
            self
        }
    }
}

/// One-based line and column (in characters).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Position {
    /// Line number from 1; LF, CRLF and lone CR end a line.
    pub line: usize,
    /// Column from 1 in Unicode scalar values; a tab counts as one.
    pub column: usize,
}

#[derive(Debug, Clone)]
struct SourceText {
    name: String,
    text: Arc<str>,
}

/// The texts that diagnostics point into, each with the name that messages give it.
#[derive(Debug, Clone, Default)]
pub struct Sources {
    list: Vec<SourceText>,
}

impl Sources {
    /// Adds a text under the name that messages give it (the path as typed, or `preset:oak.l`).
    pub fn add(&mut self, name: impl Into<String>, text: impl Into<Arc<str>>) -> SourceId {
        let id = self.next_id();
        self.list.push(SourceText { name: name.into(), text: text.into() });
        id
    }

    /// Id of the text added next. The cast is exact: texts are files that were opened, fewer than 2^32.
    #[allow(clippy::cast_possible_truncation, reason = "the number of opened files")]
    fn next_id(&self) -> SourceId {
        SourceId(self.list.len() as u32)
    }

    /// Name of a source; empty for an unknown id.
    pub fn name(&self, id: SourceId) -> &str {
        self.list.get(id.0 as usize).map_or("", |s| &s.name)
    }

    /// Text of a source; empty for an unknown id.
    pub fn text(&self, id: SourceId) -> &str {
        self.list.get(id.0 as usize).map_or("", |s| &s.text)
    }

    /// Ids in order of addition.
    pub fn ids(&self) -> impl Iterator<Item = SourceId> + '_ {
        (0..).zip(&self.list).map(|(i, _)| SourceId(i))
    }

    /// Appends the texts of `other`; returns the number to add to its ids, which otherwise refer to texts of `self`.
    pub fn append(&mut self, other: Self) -> u32 {
        let offset = self.next_id().0;
        self.list.extend(other.list);
        offset
    }

    /// Line and column where a span starts; LF, CRLF and lone CR all end a line.
    pub fn position(&self, span: Span) -> Position {
        let text = self.text(span.source);
        let before = &text.as_bytes()[..text.len().min(span.start as usize)];
        let is_end =
            |i: usize| before[i] == b'\n' || (before[i] == b'\r' && text.as_bytes().get(i + 1) != Some(&b'\n'));
        // Counts line ends before the offset and keeps the start of the last line.
        let ends = (0..before.len()).filter(|&i| is_end(i));
        let (line, last) = ends.fold((1, 0), |(n, _), i| (n + 1, i + 1));
        let column = String::from_utf8_lossy(&before[last..]).chars().count() + 1;
        Position { line, column }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_count_every_kind_of_line_end() {
        let mut sources = Sources::default();
        let id = sources.add("a", "ab\ncd\r\ne\rf");
        let at = |i| sources.position(Span::new(id, i, i));
        assert_eq!(at(4), Position { line: 2, column: 2 });
        assert_eq!(at(7), Position { line: 3, column: 1 });
        assert_eq!(at(9), Position { line: 4, column: 1 });
    }
}
