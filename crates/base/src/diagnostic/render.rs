//! Diagnostics as text for people (source line, carets, help) and as JSON for programs.

use std::ops::Range;

use annotate_snippets::{AnnotationKind, Group, Level, Origin, Patch, Renderer, Snippet};
use serde_json::{Value, json};

use super::{Diagnostic, Report, Severity, Sources, Span};

/// Largest number of diagnostics that are rendered; of the others only the number is printed.
const MAX_RENDERED: usize = 20;

/// Lines quoted before and after a place. No other lines are given to the renderer, so that a huge file costs no more than a
/// small one.
const CONTEXT_LINES: usize = 2;

/// Longest line that is quoted in full, bytes.
const MAX_QUOTED_LINE: usize = 4000;
/// Bytes that are quoted on either side of the place in a longer line.
const QUOTED_AROUND: usize = 60;
const LEFT_OUT: &str = "...";

/// Whether [`render`] writes for a terminal or for a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Style {
    /// Text without escape sequences.
    Plain,
    /// ANSI colour escape sequences for a terminal.
    Coloured,
}

/// All diagnostics of a report (at most 20), ready to print.
pub fn render(report: &Report, style: Style) -> String {
    let renderer = match style {
        Style::Plain => Renderer::plain(),
        Style::Coloured => Renderer::styled(),
    };
    let mut out = String::new();
    for diagnostic in report.diagnostics.iter().take(MAX_RENDERED) {
        out.push_str(&render_one(&renderer, &report.sources, diagnostic));
        out.push_str("\n\n");
    }
    let hidden = report.diagnostics.len().saturating_sub(MAX_RENDERED);
    if hidden > 0 {
        out.push_str(&format!("... and {hidden} more\n\n"));
    }
    out.truncate(out.trim_end().len());
    out
}

/// All diagnostics of a report as a JSON array: `severity`, `code`, `message`, `labels` (each `file`, `line`, `column`,
/// `end_line`, `end_column`, `text`; one-based, columns in characters, the end exclusive), `help` and `fix` (a place with
/// `replacement`), null where absent.
pub fn render_json(report: &Report) -> Value {
    // The end of a span is the start of an empty span behind it, and gets its position the same way.
    let place = |span: Span, key: &str, text: &str| {
        let start = report.sources.position(span);
        let end = report.sources.position(Span { start: span.end.max(span.start), ..span });
        json!({
            "file": report.sources.name(span.source),
            "line": start.line,
            "column": start.column,
            "end_line": end.line,
            "end_column": end.column,
            key: text,
        })
    };
    let one = |d: &Diagnostic| {
        let severity = match d.severity {
            Severity::Error => "error",
            Severity::Warning => "warning",
        };
        json!({
            "severity": severity,
            "code": d.code,
            "message": d.message,
            "labels": d.labels.iter().map(|(span, text)| place(*span, "text", text)).collect::<Vec<_>>(),
            "help": d.help,
            "fix": d.fix.as_ref().map(|f| place(f.span, "replacement", &f.replacement)),
        })
    };
    report.diagnostics.iter().map(one).collect()
}

/// The lines of a source around some spans, or a part of a line that is too long to quote; without control characters.
struct Excerpt {
    text: String,
    /// First byte of the excerpt in the source.
    start: usize,
    /// Number in the source of the excerpt's first line, from 1.
    line: usize,
    /// Length of [`LEFT_OUT`] if `text` begins with it, because the line is cut there; else 0.
    prefix: usize,
}

impl Excerpt {
    /// The lines from the first span to the last and [`CONTEXT_LINES`] on either side; if one of them is too long to quote, a
    /// part of the first span's line.
    fn around(text: &str, spans: &[Span]) -> Self {
        let first = spans.iter().map(|s| s.start as usize).min().unwrap_or(0).min(text.len());
        let last = spans.iter().map(|s| s.end as usize).max().unwrap_or(0).clamp(first, text.len());
        let bytes = text.as_bytes();
        let mut start = line_start(bytes, first);
        let mut end = line_end(bytes, last);
        for _ in 0..CONTEXT_LINES {
            start = if start > 0 { line_start(bytes, start - 1) } else { start };
            end = if end < bytes.len() { line_end(bytes, end + 1) } else { end };
        }
        // File line number of the excerpt's first line, from which the renderer counts.
        let line = 1 + (0..start.min(bytes.len())).filter(|i| is_line_end(bytes, *i)).count();
        let quoted = masked(text.get(start..end).unwrap_or_default());
        if quoted.split('\n').all(|line| line.len() <= MAX_QUOTED_LINE) {
            return Self { text: quoted, start, line, prefix: 0 };
        }
        Self::cut(text, first, last)
    }

    /// Part of the line of `first` around the bytes `first..last`, with [`LEFT_OUT`] at each cut.
    fn cut(text: &str, first: usize, last: usize) -> Self {
        let bytes = text.as_bytes();
        let (line_start, line_end) = (line_start(bytes, first), line_end(bytes, first));
        let boundary = |mut i: usize| {
            while !text.is_char_boundary(i) {
                i -= 1;
            }
            i
        };
        let start = boundary(first.saturating_sub(QUOTED_AROUND).max(line_start));
        let last = last.min(first + QUOTED_AROUND);
        let end = boundary((last + QUOTED_AROUND).min(line_end)).max(start);
        let before = if start > line_start { LEFT_OUT } else { "" };
        let after = if end < line_end { LEFT_OUT } else { "" };
        let line = 1 + (0..start.min(bytes.len())).filter(|i| is_line_end(bytes, *i)).count();
        let quoted = masked(text.get(start..end).unwrap_or_default());
        Self { text: format!("{before}{quoted}{after}"), start, line, prefix: before.len() }
    }

    /// Byte range of a span in the text of the excerpt, clipped to it and rounded down to character boundaries.
    fn range(&self, span: Span) -> Range<usize> {
        let floor = |i: u32| {
            let mut i = ((i as usize).saturating_sub(self.start) + self.prefix).min(self.text.len());
            while !self.text.is_char_boundary(i) {
                i -= 1;
            }
            i
        };
        let start = floor(span.start);
        start..floor(span.end).max(start)
    }
}

/// Whether a line ends with the byte `i`: LF, also that of CRLF, and a lone CR.
fn is_line_end(bytes: &[u8], i: usize) -> bool {
    match bytes.get(i) {
        Some(b'\n') => true,
        Some(b'\r') => bytes.get(i + 1) != Some(&b'\n'),
        _ => false,
    }
}

fn line_start(bytes: &[u8], at: usize) -> usize {
    (0..at.min(bytes.len())).rev().find(|i| is_line_end(bytes, *i)).map_or(0, |i| i + 1)
}

fn line_end(bytes: &[u8], at: usize) -> usize {
    (at..bytes.len()).find(|i| is_line_end(bytes, *i)).unwrap_or(bytes.len())
}

fn render_one(renderer: &Renderer, sources: &Sources, diagnostic: &Diagnostic) -> String {
    let level = match diagnostic.severity {
        Severity::Error => Level::ERROR,
        Severity::Warning => Level::WARNING,
    };
    // Labels of one file share an excerpt, so that their carets stand under one quotation.
    let windows = windows(sources, diagnostic);
    let message = visible(&diagnostic.message);
    let labels: Vec<(Span, String)> = diagnostic.labels.iter().map(|(s, t)| (*s, visible(t))).collect();
    let first = labels.first().map(|(s, _)| *s);
    let mut main: Group<'_> = level
        .primary_title(&message)
        .id(diagnostic.code)
        .elements(Vec::<Snippet<'_, annotate_snippets::Annotation<'_>>>::new());
    // The first label is the cause and gets the primary caret; all others are context.
    for (name, spans, window) in &windows {
        let mut snippet = Snippet::source(window.text.as_str()).line_start(window.line);
        // The renderer would count the columns of a cut line from the cut: give it line and column explicitly.
        match spans.first().filter(|_| window.prefix > 0) {
            Some(span) => {
                let at = sources.position(*span);
                main = main.element(Origin::path(name.as_str()).line(at.line).char_column(at.column));
            }
            None => snippet = snippet.path(name.as_str()),
        }
        for (span, label) in labels.iter().filter(|(s, _)| spans.contains(s)) {
            let kind = if Some(*span) == first { AnnotationKind::Primary } else { AnnotationKind::Context };
            snippet = snippet.annotation(kind.span(window.range(*span)).label(label.as_str()));
        }
        main = main.element(snippet);
    }
    let help = diagnostic.help.as_ref().map(|h| visible(h));
    if let Some(help) = &help {
        main = main.element(Level::HELP.message(help.as_str()));
    }
    let fix = diagnostic.fix.as_ref();
    // A fix is rendered as a patch of a separate excerpt, since it may lie far from the labels.
    let fixed =
        fix.map(|f| (f, Excerpt::around(sources.text(f.span.source), &[f.span]), visible_lines(&f.replacement)));
    let mut groups = vec![main];
    if let Some((fix, window, replacement)) = &fixed {
        let patch = Patch::new(window.range(fix.span), replacement.as_str());
        let snippet = Snippet::source(window.text.as_str()).line_start(window.line).patch(patch);
        groups.push(Level::HELP.secondary_title("write").element(snippet));
    }
    renderer.render(&groups).to_string()
}

/// One excerpt for each source that has labels, with its name and spans.
fn windows(sources: &Sources, diagnostic: &Diagnostic) -> Vec<(String, Vec<Span>, Excerpt)> {
    let mut ids = Vec::new();
    for (span, _) in &diagnostic.labels {
        if !ids.contains(&span.source) {
            ids.push(span.source);
        }
    }
    let window = |id| {
        let spans: Vec<Span> = diagnostic.labels.iter().map(|l| l.0).filter(|s| s.source == id).collect();
        let window = Excerpt::around(sources.text(id), &spans);
        (visible(sources.name(id)), spans, window)
    };
    ids.into_iter().map(window).collect()
}

/// Replaces control, bidirectional and invisible characters by `\u{..}`, so that text from a hostile file can neither control
/// the terminal nor begin a line.
pub fn visible(text: &str) -> String {
    text.chars().map(|c| if is_hidden(c) { c.escape_unicode().to_string() } else { c.to_string() }).collect()
}

/// [`visible`] for each line; line ends stay, because the renderer puts a margin before every line of a quotation.
fn visible_lines(text: &str) -> String {
    text.split('\n').map(visible).collect::<Vec<_>>().join("\n")
}

/// Like [`visible`], but keeps every byte offset: a hidden character becomes as many question marks as it has bytes, and a lone
/// CR between two lines becomes LF, since the renderer ends lines only at LF.
fn masked(text: &str) -> String {
    let bytes = text.as_bytes();
    let is_masked = |c: char| is_hidden(c) && !matches!(c, '\n' | '\t' | '\r');
    // A CR at the end of the text may belong to the CRLF that ends the excerpt.
    let is_lone = |i: usize, c: char| c == '\r' && i + 1 < bytes.len() && is_line_end(bytes, i);
    if !text.char_indices().any(|(i, c)| is_masked(c) || is_lone(i, c)) {
        return text.to_owned();
    }
    let shown = |(i, c): (usize, char)| match c {
        c if is_masked(c) => "?".repeat(c.len_utf8()),
        c if is_lone(i, c) => "\n".to_owned(),
        c => c.to_string(),
    };
    text.char_indices().map(shown).collect()
}

/// True for control characters, and for Unicode characters without width or that change the direction of text.
pub fn is_hidden(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{61c}' | '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{2069}' | '\u{feff}')
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnostic::SourceId;

    fn report(text: &str, spans: &[(&str, &str)]) -> Report {
        let mut report = Report::default();
        let source = report.sources.add("scenes/a.toml", text);
        for (word, label) in spans {
            let at = text.find(word).expect("word");
            let span = Span::new(source, at, at + word.len());
            let fix = if *word == "lenght" { Some("length") } else { None };
            let mut d = Diagnostic::error("S002", format!("unknown key {word:?}"), span, *label).help("see the list");
            if let Some(fix) = fix {
                d = d.fix(span, fix);
            }
            report.push(d);
        }
        report
    }

    #[test]
    fn a_place_in_the_middle_has_its_line_and_column() {
        let text: String = (1..=30).map(|i| format!("key{i} = {i} # \u{e9}\u{1F33F}\n")).collect();
        let text = text.replace("key17 = 17", "  lenght = 17");
        insta::assert_snapshot!(render(&report(&text, &[("lenght", "not a key")]), Style::Plain));
    }

    #[test]
    fn lines_that_end_with_a_carriage_return_are_quoted_one_by_one() {
        let shown = render(&report("a = 1\rb = 2\rc = 3\r", &[("b", "here")]), Style::Plain);
        assert!(
            shown.contains("scenes/a.toml:2:1") && shown.contains("2 | b = 2") && !shown.contains("c = 3"),
            "{shown}"
        );
        // Those of CRLF are one line end.
        let shown = render(&report("a = 1\r\nb = 2\r\nc = 3\r\n", &[("b", "here")]), Style::Plain);
        assert!(
            shown.contains("scenes/a.toml:2:1") && shown.contains("2 | b = 2") && !shown.contains("c = 3"),
            "{shown}"
        );
    }

    #[test]
    fn two_places_in_two_files() {
        let mut r = report("a = 1\nb = 2\n", &[("b", "here")]);
        let other = r.sources.add("b.toml", "c = 3\nd = 4\n");
        r.diagnostics[0].labels.push((Span::new(other, 6, 7), "first set here".into()));
        insta::assert_snapshot!(render(&r, Style::Plain));
    }

    #[test]
    fn hostile_characters_are_shown_not_sent() {
        let mut r = report("x = \"\u{1b}[2J\u{202e}evil\u{7}\"\n", &[("evil", "\u{1b}]0;title\u{7}")]);
        let name = r.sources.add("a\nopenjd_env: x\u{1b}", "q");
        r.push(Diagnostic::error("S001", "bad\nopenjd_env: y", Span::new(name, 0, 1), "\nopenjd_"));
        let text = render(&r, Style::Plain);
        assert!(!text.chars().any(|c| is_hidden(c) && c != '\n'), "{text:?}");
        assert!(text.lines().all(|l| !l.to_lowercase().starts_with("openjd_")), "{text}");
        insta::assert_snapshot!(text);
    }

    #[test]
    fn a_huge_line_and_a_huge_file_are_quick_and_keep_their_place() {
        let text = format!("{{\n{}oops{}", "x".repeat(8 << 20), "y\n".repeat(1 << 20));
        let r = report(&text, &[("oops", "here")]);
        let shown = render(&r, Style::Plain);
        assert!(shown.contains("scenes/a.toml:2:8388609") && shown.len() < 1000, "{shown}");
        // The line is quoted around the place, with the caret below the word.
        let lines: Vec<&str> = shown.lines().collect();
        let quoted = lines.iter().position(|l| l.contains("...xxx") && l.contains("oopsy")).expect("quoted");
        assert_eq!(lines[quoted].find("oops"), lines[quoted + 1].find("^^^^ here"), "{shown}");
        let text = "line\n".repeat(2 << 20) + "oops\n";
        assert!(render(&report(&text, &[("oops", "here")]), Style::Plain).contains("a.toml:2097153:1"));
    }

    #[test]
    fn odd_spans_never_panic() {
        let mut r = report("a\u{e9}\n", &[]);
        for (start, end) in [(2, 2), (2, 3), (4, 9), (9, 4), (usize::MAX, 0)] {
            let span = Span::new(SourceId(0), start, end);
            r.push(Diagnostic::warning("L001", "odd", span, "here").fix(span, "x"));
        }
        r.push(Diagnostic::error("L002", "no such source", Span::new(SourceId(7), 0, 1), "here"));
        assert!(render(&r, Style::Plain).contains("no such source"));
        assert!(render_json(&r).as_array().is_some_and(|a| a.len() == 6));
    }

    #[test]
    fn json_names_place_help_and_fix() {
        insta::assert_json_snapshot!(render_json(&report("\u{e9} = 1\n  lenght = 2\n", &[("lenght", "not a key")])));
    }
}
