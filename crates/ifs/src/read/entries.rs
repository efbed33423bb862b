//! Fractint's files: entries `name { numbers }`, in the variants found in published tables.

use super::{IfsReader, fractint};
use crate::Ifs;
use osier_base::diagnostic::{Diagnostic, Severity};
use std::ops::Range;

/// Maximum length of a system's name, characters; the rest is cut off.
const MAX_NAME_LENGTH: usize = 40;

/// Bytes of an entry's header, `end` excluded.
struct EntryHeader {
    start: usize,
    end: usize,
    /// True if the name stands on a line above its brace.
    above: bool,
}

/// Reads all entries, or the whole file as one system if there is no brace.
pub(super) fn read(reader: &mut IfsReader<'_>) -> Vec<Ifs> {
    let clean = without_comments(reader.text);
    warn_long_lines(reader);
    let mut systems = Vec::new();
    if !clean.contains(&b'{') {
        if let Some(stray) = clean.iter().position(|b| *b == b'}') {
            let span = reader.span(stray, stray + 1);
            reader.push(Diagnostic::warning("I003", "a '}' without '{'", span, "ignored"));
        }
        let body: Vec<u8> = clean.iter().map(|b| if *b == b'}' { b' ' } else { *b }).collect();
        // Without braces the whole file is one system, named after the file.
        let stem = reader.stem.clone();
        let span = reader.span(0, 0);
        systems.extend(fractint::system(reader, &body, 0, fractint::EntryTitle { name: stem, dim: None, span }));
        return systems;
    }
    let mut at = 0;
    while let Some(open) = find(&clean, at, b"{") {
        let header = header(&clean, at, open);
        warn_stray_text(reader, &clean, at, header.start);
        let close = find(&clean, open + 1, b"{}");
        // An entry without its closing brace ends where the header of the next one begins.
        let (end, next) = match close {
            Some(c) if clean.get(c) == Some(&b'}') => (c, c + 1),
            Some(c) => {
                let next = self::header(&clean, open + 1, c).start;
                (next, next)
            }
            None => (clean.len(), clean.len()),
        };
        let closed = close.is_some_and(|c| clean.get(c) == Some(&b'}'));
        systems.extend(entry(reader, &clean, &header, open + 1..end, closed));
        at = next;
        if reader.has_too_many_diagnostics() {
            return systems;
        }
    }
    warn_stray_text(reader, &clean, at, clean.len());
    systems
}

fn find(clean: &[u8], from: usize, any: &[u8]) -> Option<usize> {
    clean.get(from..)?.iter().position(|b| any.contains(b)).map(|i| i + from)
}

/// The text with every comment blanked, byte for byte; all line ends are LF already.
fn without_comments(text: &str) -> Vec<u8> {
    let mut inside = false;
    text.bytes()
        .map(|b| {
            inside = b != b'\n' && (inside || b == b';');
            match b {
                b'\n' => b'\n',
                b'\t' | 0x0B | 0x0C => b' ',
                _ if inside => b' ',
                b => b,
            }
        })
        .collect()
}

fn warn_long_lines(reader: &mut IfsReader<'_>) {
    let mut start = 0;
    for line in reader.text.split('\n') {
        if line.len() > 200 && !line.trim_start().starts_with(';') {
            let span = reader.span(start, start + line.chars().next().map_or(0, char::len_utf8));
            let text = format!("a line of {} characters", line.len());
            let d = Diagnostic::warning("I009", text, span, "this line");
            reader.push(d.help("Fractint reads 200 characters of a line and loses the rest"));
            return;
        }
        start += line.len() + 1;
    }
}

/// Header of the entry whose brace is at `open`: the text before the brace on its line, or the last line with text
/// above it.
fn header(clean: &[u8], from: usize, open: usize) -> EntryHeader {
    let line = |before: usize| {
        let text = clean.get(from..before).unwrap_or_default();
        from + text.iter().rposition(|b| *b == b'\n').map_or(0, |i| i + 1)
    };
    let blank = |a: usize, b: usize| clean.get(a..b).unwrap_or_default().iter().all(|c| matches!(c, b' ' | b'\n'));
    // Usually the header is the text before the brace on its line.
    let start = line(open);
    if !blank(start, open) {
        return EntryHeader { start, end: open, above: false };
    }
    let mut end = start;
    while end > from {
        let start = line(end - 1);
        if !blank(start, end) {
            return EntryHeader { start, end, above: true };
        }
        end = start;
    }
    EntryHeader { start: open, end: open, above: false }
}

/// Warns (I003) about text that belongs to no entry.
fn warn_stray_text(reader: &mut IfsReader<'_>, clean: &[u8], from: usize, to: usize) {
    let text = clean.get(from..to).unwrap_or_default();
    let Some(first) = text.iter().position(|b| !matches!(b, b' ' | b'\n')) else { return };
    let length = text[first..].iter().position(|b| *b == b'\n').unwrap_or(text.len() - first);
    let span = reader.span(from + first, from + first + length);
    let d = Diagnostic::warning("I003", "text outside entries", span, "ignored");
    reader.push(d.help("an entry is NAME { numbers }; comments begin with ';'"));
}

/// Reads one entry; `body`: the bytes between its braces. `None` for a comment or an entry with errors.
fn entry(
    reader: &mut IfsReader<'_>,
    clean: &[u8],
    header: &EntryHeader,
    body: Range<usize>,
    closed: bool,
) -> Option<Ifs> {
    // Entries named "comment" hold text, not numbers.
    let title = title(reader, clean, header);
    if title.name.eq_ignore_ascii_case("comment") {
        return None;
    }
    let errors_before = error_count(reader);
    if title.name.is_empty() {
        let span = reader.span(body.start - 1, body.start);
        let d = Diagnostic::warning("I003", "an entry without a name", span, "no name before this brace");
        reader.push(d.help("write NAME { ... }"));
    }
    if !closed {
        let d =
            Diagnostic::error("I006", format!("\"{}\" has no closing brace", title.name), title.span, "begins here");
        reader.push(d.help("end the entry with a line that holds only }"));
    }
    warn_portability(reader, clean, header, body.clone(), closed);
    let text = clean.get(body.clone()).unwrap_or_default();
    let system = fractint::system(reader, text, body.start, title);
    system.filter(|_| error_count(reader) == errors_before)
}

fn error_count(reader: &IfsReader<'_>) -> usize {
    reader.report.diagnostics.iter().filter(|d| d.severity == Severity::Error).count()
}

fn title(reader: &mut IfsReader<'_>, clean: &[u8], header: &EntryHeader) -> fractint::EntryTitle {
    let blank = |i: &usize| clean.get(*i).is_none_or(|b| matches!(b, b' ' | b'\n'));
    let start = (header.start..header.end).find(|i| !blank(i)).unwrap_or(header.end);
    let end = (header.start..header.end).rev().find(|i| !blank(i)).map_or(start, |i| i + 1);
    let span = reader.span(start, end);
    let text = reader.text.get(start..end).unwrap_or_default();
    // The name ends at a blank or parenthesis; a prefix "ifs:" is dropped.
    let mut name: String = text.chars().take_while(|c| !c.is_whitespace() && *c != '(').take(MAX_NAME_LENGTH).collect();
    if name.get(..4).is_some_and(|p| p.eq_ignore_ascii_case("ifs:")) {
        name = name.split_off(4);
    }
    let mut dim = None;
    let mut rest = text;
    while let Some((_, after)) = rest.split_once('(') {
        let (words, tail) = after.split_once(')').unwrap_or((after, ""));
        for word in words.split([' ', ',', '\n']).filter(|w| !w.is_empty()) {
            if word.eq_ignore_ascii_case("3d") {
                dim = Some(3);
            } else {
                let text = format!("unknown word \"{word}\" in the header");
                let d = Diagnostic::warning("I004", text, span, "in this header");
                reader.push(d.help("only (3D) is known here"));
            }
        }
        rest = tail;
    }
    fractint::EntryTitle { name, dim: Some(dim.unwrap_or(2)), span }
}

/// Reports I009 for parts of an entry that Fractint and its successors would drop.
fn warn_portability(reader: &mut IfsReader<'_>, clean: &[u8], header: &EntryHeader, body: Range<usize>, closed: bool) {
    let (open, end) = (body.start - 1, body.end);
    let note = |reader: &mut IfsReader<'_>, text: &str, help: &str, (a, b): (usize, usize)| {
        let span = reader.span(a, b);
        reader.push(Diagnostic::warning("I009", text, span, "here").help(help));
    };
    // All but the last help text say what Fractint does with such an entry, so that authors can judge whether it matters.
    if header.above {
        let help = "Fractint wants the brace on the line of the name";
        note(reader, "the brace stands on the line after the name", help, (open, open + 1));
    }
    let body = clean.get(open + 1..end).unwrap_or_default();
    let line = body.iter().position(|b| *b == b'\n').unwrap_or(body.len());
    let same_line = body.get(..line).unwrap_or_default();
    if let Some(first) = same_line.iter().position(|b| *b != b' ') {
        let help = "Fractint drops the rest of the header line";
        note(reader, "numbers on the header line", help, (open + 1 + first, open + 1 + line));
    }
    if closed && line == body.len() && !body.is_empty() {
        note(reader, "the entry ends on its header line", "Fractint never sees this brace", (end, end + 1));
    } else if closed && body.last().is_some_and(|b| !matches!(b, b' ' | b'\n')) {
        note(reader, "a brace behind a number without a blank", "set the brace on a line of its own", (end, end + 1));
    }
}
