//! Diagnostics as text for people: source line, carets, help.

use annotate_snippets::{AnnotationKind, Group, Level, Renderer, Snippet};

use super::{Diagnostic, Report, Severity, Sources, Span};

/// Longest list shown; the rest is counted.
const SHOWN: usize = 20;

/// With or without terminal colours.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Style {
    /// No escapes.
    Plain,
    /// ANSI colours.
    Coloured,
}

/// All diagnostics of a report (at most 20), ready to print.
pub fn render(report: &Report, style: Style) -> String {
    let renderer = match style {
        Style::Plain => Renderer::plain(),
        Style::Coloured => Renderer::styled(),
    };
    let mut out = String::new();
    for diagnostic in report.diagnostics.iter().take(SHOWN) {
        out.push_str(&render_one(&renderer, &report.sources, diagnostic));
        out.push_str("\n\n");
    }
    let hidden = report.diagnostics.len().saturating_sub(SHOWN);
    if hidden > 0 {
        out.push_str(&format!("... and {hidden} more\n\n"));
    }
    out.truncate(out.trim_end().len());
    out
}

fn render_one(renderer: &Renderer, sources: &Sources, diagnostic: &Diagnostic) -> String {
    let level = match diagnostic.severity {
        Severity::Error => Level::ERROR,
        Severity::Warning => Level::WARNING,
    };
    let message = visible(&diagnostic.message);
    let labels: Vec<(Span, String)> = diagnostic.labels.iter().map(|(s, t)| (*s, visible(t))).collect();
    let texts: Vec<String> = labels.iter().map(|(s, _)| masked(sources.text(s.source))).collect();
    let mut group: Group<'_> = level
        .primary_title(&message)
        .id(diagnostic.code)
        .elements(Vec::<Snippet<'_, annotate_snippets::Annotation<'_>>>::new());
    let mut done: Vec<u32> = Vec::new();
    for (i, (span, _)) in labels.iter().enumerate() {
        if done.contains(&span.source.0) {
            continue;
        }
        done.push(span.source.0);
        let text = &texts[i];
        let mut snippet = Snippet::source(text.as_str()).line_start(1).path(sources.name(span.source));
        for (k, (s, label)) in labels.iter().enumerate().filter(|(_, l)| l.0.source == span.source) {
            let kind = if k == 0 { AnnotationKind::Primary } else { AnnotationKind::Context };
            snippet = snippet.annotation(kind.span(clamp(text, *s)).label(label.as_str()));
        }
        group = group.element(snippet);
    }
    let help = diagnostic.help.as_ref().map(|h| visible(h));
    if let Some(help) = &help {
        group = group.element(Level::HELP.message(help.as_str()));
    }
    renderer.render(&[group]).to_string()
}

/// A span cut to the text and moved to character borders.
fn clamp(text: &str, span: Span) -> std::ops::Range<usize> {
    let floor = |mut i: usize| {
        i = i.min(text.len());
        while !text.is_char_boundary(i) {
            i -= 1;
        }
        i
    };
    let start = floor(span.start as usize);
    start..floor(span.end as usize).max(start)
}

/// Control and bidirectional characters shown as `\u{..}`, so that a hostile file cannot drive the terminal.
pub(crate) fn visible(text: &str) -> String {
    text.chars().map(|c| if hidden(c) && c != '\n' { c.escape_unicode().to_string() } else { c.to_string() }).collect()
}

/// Like [`visible`], but keeps every byte offset: hidden characters become the same number of question marks.
fn masked(text: &str) -> String {
    if !text.chars().any(|c| hidden(c) && c != '\n' && c != '\t' && c != '\r') {
        return text.to_owned();
    }
    let mask =
        |c: char| if hidden(c) && !matches!(c, '\n' | '\t' | '\r') { "?".repeat(c.len_utf8()) } else { c.to_string() };
    text.chars().map(mask).collect()
}

fn hidden(c: char) -> bool {
    c.is_control() || matches!(c, '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}
