//! Diagnostics about the user's files: source position, message, help and fix.
//!
//! Readers collect [`Diagnostic`]s beside the [`Sources`] they point into; a [`Report`] carries both to the cli, which
//! renders it once.

pub mod codes;
mod render;
mod source;

pub use render::{Style, is_hidden, render, render_json, visible};
pub use source::{Position, SourceId, Sources, Span};

/// Severity of a diagnostic; fixed per code.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// The file can be used.
    Warning,
    /// The file cannot be used.
    Error,
}

/// A text edit that resolves a diagnostic.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fix {
    /// Range of bytes that the fix replaces; empty to insert there.
    pub span: Span,
    /// Text that replaces them; empty to delete.
    pub replacement: String,
}

/// One problem at one place of one file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Diagnostic {
    /// Severity of `code` in [`codes::CODES`].
    pub severity: Severity,
    /// Stable code from [`codes`], such as `L001`.
    pub code: &'static str,
    /// Subject and fact, lower case, no full stop.
    pub message: String,
    /// Places with what to say under each; the first one is the cause.
    pub labels: Vec<(Span, String)>,
    /// What the user can do about it, as a sentence.
    pub help: Option<String>,
    /// A text edit that repairs the file, where one is certain.
    pub fix: Option<Fix>,
}

impl Diagnostic {
    /// An error at `span`; `label` is printed under the caret there, and help or a fix may be chained.
    pub fn error(code: &'static str, message: impl Into<String>, span: Span, label: impl Into<String>) -> Self {
        Self::new(Severity::Error, code, message.into(), span, label.into())
    }

    /// A warning at `span`; `label` is printed under the caret there, and help or a fix may be chained.
    pub fn warning(code: &'static str, message: impl Into<String>, span: Span, label: impl Into<String>) -> Self {
        Self::new(Severity::Warning, code, message.into(), span, label.into())
    }

    /// A diagnostic without a place: about a whole file or something without lines, which the message must name. The severity is
    /// that of the code.
    pub fn about(code: &'static str, message: impl Into<String>) -> Self {
        let severity = codes::find(code).map_or(Severity::Error, |c| c.severity);
        Self { severity, code, message: message.into(), labels: Vec::new(), help: None, fix: None }
    }

    fn new(severity: Severity, code: &'static str, message: String, span: Span, label: String) -> Self {
        Self { severity, code, message, labels: vec![(span, label)], help: None, fix: None }
    }

    /// Sets the sentence on what the user can do, in place of an earlier one.
    pub fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }

    /// Adds a further place, with what to say under it; the first one stays the cause.
    pub fn label(mut self, span: Span, label: impl Into<String>) -> Self {
        self.labels.push((span, label.into()));
        self
    }

    /// Sets the edit that repairs the file: `replacement` in place of the bytes of `span`.
    pub fn fix(mut self, span: Span, replacement: impl Into<String>) -> Self {
        self.fix = Some(Fix { span, replacement: replacement.into() });
        self
    }
}

/// Largest number of diagnostics in a report, so that a damaged file of any size gives a short report.
const MAX_DIAGNOSTICS: usize = 250;

/// Diagnostics, the sources they point into, and what the sources printed.
#[derive(Debug, Clone, Default)]
pub struct Report {
    /// The texts that spans point into, by id.
    pub sources: Sources,
    /// In order of discovery; [`Report::push`] keeps repetitions out and bounds their number.
    pub diagnostics: Vec<Diagnostic>,
    /// What the sources themselves print, such as `printf` of a grammar; lines end with a line feed.
    pub output: String,
}

impl Report {
    /// True if any diagnostic is an error; [`Report::into_result`] is then an `Err`.
    pub fn has_errors(&self) -> bool {
        self.diagnostics.iter().any(|d| d.severity == Severity::Error)
    }

    /// True if [`Report::push`] would drop every further diagnostic, so that readers of long files may stop.
    pub fn is_full(&self) -> bool {
        self.diagnostics.len() >= MAX_DIAGNOSTICS && self.has_errors()
    }

    /// Adds a diagnostic unless one with the same code and place (without a place: the same message) is there already. A report
    /// of 250 accepts only its first error.
    pub fn push(&mut self, diagnostic: Diagnostic) {
        let warning = diagnostic.severity == Severity::Warning;
        if self.diagnostics.len() >= MAX_DIAGNOSTICS && (warning || self.has_errors()) {
            return;
        }
        let place = |d: &Diagnostic| (d.code, d.labels.first().map(|l| l.0));
        let same = |d: &Diagnostic| {
            place(d) == place(&diagnostic) && (place(d).1.is_some() || d.message == diagnostic.message)
        };
        if !self.diagnostics.iter().any(same) {
            self.diagnostics.push(diagnostic);
        }
    }

    /// Adds all of another report. Sources with equal name and text become one, so that equal diagnostics of several plants of
    /// one grammar are reported once.
    pub fn extend(&mut self, other: Self) {
        // Plants grown from one grammar often print the same lines, which are kept once.
        if !has_lines(&self.output, &other.output) {
            self.output.push_str(&other.output);
        }
        let ids: Vec<SourceId> = other.sources.ids().map(|id| self.add_source_of(&other.sources, id)).collect();
        let renumber = |s: &mut Span| s.source = ids.get(s.source.0 as usize).copied().unwrap_or(s.source);
        for mut diagnostic in other.diagnostics {
            diagnostic.labels.iter_mut().for_each(|l| renumber(&mut l.0));
            if let Some(fix) = &mut diagnostic.fix {
                renumber(&mut fix.span);
            }
            self.push(diagnostic);
        }
    }

    /// Id of a text of another report, which is added unless it is already here.
    fn add_source_of(&mut self, from: &Sources, id: SourceId) -> SourceId {
        let same = |i: &SourceId| self.sources.name(*i) == from.name(id) && self.sources.text(*i) == from.text(id);
        let known = self.sources.ids().find(same);
        known.unwrap_or_else(|| self.sources.add(from.name(id), from.text(id)))
    }
}

impl std::fmt::Display for Report {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&render(self, Style::Plain))
    }
}

/// True if the whole lines of `lines` stand together in `text`: "2" is no line of "12".
fn has_lines(text: &str, lines: &str) -> bool {
    let begins = |at: usize| at == 0 || text[..at].ends_with('\n');
    let ends = |at: usize| lines.ends_with('\n') || at == text.len() || text[at..].starts_with('\n');
    lines.is_empty() || text.match_indices(lines).any(|(at, _)| begins(at) && ends(at + lines.len()))
}

/// The name in `known` nearest to `word` within edit distance 2 (1 for words of two or three letters, 0 for one letter), for
/// "did you mean"; of several at the same distance the first. A name that differs only in case is at distance 0.
pub fn nearest<'a>(word: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    // Any letter becomes any other by one edit, so that short words allow fewer edits.
    let limit = match word.chars().count() {
        0 | 1 => 0,
        2 | 3 => 1,
        _ => 2,
    };
    let distance = |k: &str| if k.eq_ignore_ascii_case(word) { 0 } else { edit_distance(word, k) };
    known.into_iter().map(|k| (distance(k), k)).filter(|(d, _)| *d <= limit).min_by_key(|(d, _)| *d).map(|(_, k)| k)
}

/// Number of letters to insert, remove, change, or swap with the next one. Source: the optimal string alignment distance, with
/// three rows of its table at a time.
fn edit_distance(a: &str, b: &str) -> usize {
    let (a, b): (Vec<char>, Vec<char>) = (a.chars().collect(), b.chars().collect());
    let mut before: Vec<usize> = Vec::new();
    let mut last: Vec<usize> = (0..=b.len()).collect();
    for i in 0..a.len() {
        let mut row = vec![i + 1];
        for j in 0..b.len() {
            let substitute = last[j] + usize::from(a[i] != b[j]);
            let mut cost = substitute.min(last[j + 1] + 1).min(row[j] + 1);
            if i > 0 && j > 0 && a[i] == b[j - 1] && a[i - 1] == b[j] {
                cost = cost.min(before[j - 1] + 1);
            }
            row.push(cost);
        }
        before = std::mem::replace(&mut last, row);
    }
    last[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_takes_over_another_with_its_texts() {
        let one = |name: &str| {
            let mut r = Report::default();
            let id = r.sources.add(name, "text");
            r.push(Diagnostic::warning("L020", "undefined", Span::new(id, 0, 2), "here"));
            r
        };
        let mut all = one("a.l");
        all.extend(one("a.l"));
        all.extend(one("b.l"));
        assert_eq!((all.diagnostics.len(), all.sources.ids().count()), (2, 2));
        assert_eq!(all.sources.name(all.diagnostics[1].labels[0].0.source), "b.l");
    }

    #[test]
    fn printed_lines_are_kept_unless_they_are_repeated() {
        let printed = |output: &str| Report { output: output.into(), ..Report::default() };
        let mut all = printed("12\n");
        for output in ["2\n", "12\n", "1", "", "12\n2\n"] {
            all.extend(printed(output));
        }
        assert_eq!(all.output, "12\n2\n1");
    }

    #[test]
    fn nearest_name_is_found_within_two_edits() {
        assert_eq!(nearest("derivaton", ["axiom", "derivation"]), Some("derivation"));
        assert_eq!(nearest("zzz", ["axiom", "seed"]), None);
        assert_eq!((nearest("Z", ["y", "z"]), nearest("x", ["y", "z"])), (Some("z"), None));
        assert_eq!(nearest("OBJ", ["usd", "obj"]), Some("obj"));
        assert_eq!(edit_distance("kitten", "sitting"), 3);
    }
}
