//! Progress, messages and errors as lines of JSON on standard error, for programs that start osier (`--progress json`).
//!
//! Each line is one object whose `event` is `progress`, `error`, `warning` or `note`.

use std::io::Write as _;
use std::sync::Mutex;
use std::sync::PoisonError;

use serde_json::{Value, json};

use osier_base::Error;
use osier_base::diagnostic::{Diagnostic, Report, Severity};

/// Largest number of progress lines of one stage after its first one.
const LINES_PER_STAGE: u64 = 100;

/// Prints one object as a line of standard error; errors of writing are ignored.
pub fn print(event: &Value) {
    // One write per line, so that lines of several threads do not mix.
    let _ = std::io::stderr().lock().write_all(format!("{event}\n").as_bytes());
}

/// Prints a message that is neither a warning nor an error.
pub fn note(text: &str) {
    print(&note_event(text));
}

/// A note, whose kind the field `event` tells: without the word that begins some of them on a terminal.
fn note_event(text: &str) -> Value {
    json!({ "event": "note", "message": text.strip_prefix("note: ").unwrap_or(text) })
}

/// Prints a warning without a position in a file.
pub fn warning(code: &str, message: &str) {
    print(&placeless("warning", Some(code), message, None));
}

/// Prints an error without a position in a file.
pub fn complaint(text: &str) {
    print(&placeless("error", None, text, None));
}

/// Prints errors and warnings of files, one line each.
pub fn report(report: &Report) {
    report.diagnostics.iter().for_each(|d| print(&diagnostic_event(report, d)));
}

/// Prints the error that ends a run, with the path or diagnostics that it holds.
pub fn error(error: &Error) {
    match error {
        Error::Input(found) => report(found),
        Error::Export { code, reason } => print(&placeless("error", Some(code), reason, None)),
        Error::Io { path, .. } | Error::Foreign { path } => {
            print(&placeless("error", None, &error.to_string(), Some(&path.display().to_string())));
        }
        other => complaint(&other.to_string()),
    }
}

/// A warning or an error without a position in a text. `file`: path of the file that it concerns.
fn placeless(event: &str, code: Option<&str>, message: &str, file: Option<&str>) -> Value {
    json!({
        "event": event, "code": code, "message": message, "help": null, "file": file, "line": null, "column": null,
        "span": null,
    })
}

/// A diagnostic with the position of its first label: file, line and column from 1, byte range.
fn diagnostic_event(report: &Report, d: &Diagnostic) -> Value {
    let event = if d.severity == Severity::Error { "error" } else { "warning" };
    let span = d.labels.first().map(|(span, _)| *span);
    let position = span.map(|span| report.sources.position(span));
    json!({
        "event": event, "code": d.code, "message": d.message, "help": d.help,
        "file": span.map(|s| report.sources.name(s.source)),
        "line": position.map(|p| p.line), "column": position.map(|p| p.column), "span": span.map(|s| [s.start, s.end]),
    })
}

/// Reports the current stage and its progress; stages and steps may come from several threads.
#[derive(Debug, Default)]
pub struct StageEvents {
    state: Mutex<StageState>,
}

#[derive(Debug, Default)]
struct StageState {
    name: String,
    done: u64,
    total: u64,
}

impl StageState {
    fn event(&self) -> Value {
        json!({ "event": "progress", "stage": self.name, "done": self.done, "total": self.total })
    }

    /// Counts steps; returns whether a line is due.
    fn advance(&mut self, steps: u64) -> bool {
        let share = |done: u64| done.saturating_mul(LINES_PER_STAGE) / self.total.max(1);
        let before = share(self.done);
        self.done += steps;
        // Progress is only reported as a share of a known total.
        self.total > 0 && self.done <= self.total && share(self.done) > before
    }
}

impl StageEvents {
    /// Begins a new stage and reports it; `total` is the expected number of steps, 0 if unknown.
    pub fn stage(&self, name: &str, total: u64) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        *state = StageState { name: name.to_owned(), done: 0, total };
        print(&state.event());
    }

    /// Counts `steps` more steps of the stage and reports every hundredth of the total.
    pub fn advance(&self, steps: u64) {
        // The lock is held while the line is written, so that `done` rises from line to line.
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        if state.advance(steps) {
            print(&state.event());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn notes_are_told_by_their_event_alone() {
        assert_eq!(note_event("note: format csv has no file")["message"], "format csv has no file");
        assert_eq!(note_event("writing about 2 MB")["message"], "writing about 2 MB");
    }

    #[test]
    fn a_long_stage_has_a_hundred_lines() {
        let mut state = StageState { name: "writing".into(), done: 0, total: 2400 };
        let lines = (0..2400).filter(|_| state.advance(1)).count();
        assert_eq!((lines, state.done), (100, 2400));
        let mut short = StageState { name: "writing".into(), done: 0, total: 3 };
        assert_eq!((0..3).filter(|_| short.advance(1)).count(), 3);
    }
}
