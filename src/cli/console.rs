//! Standard output for results, standard error for everything else.

use std::io::{self, IsTerminal as _, Write as _};
use std::sync::atomic::{AtomicBool, Ordering};

use anstream::ColorChoice;

use super::args::{Color, Common};
use osier_base::diagnostic::{Report, Style, is_hidden, render, visible};
use osier_base::{Error, Result};

/// Where a command talks to.
#[derive(Debug)]
pub struct Console {
    /// No progress, no summaries.
    pub quiet: bool,
    /// Results as JSON.
    pub json: bool,
    closed: AtomicBool,
}

impl Console {
    /// As the flags say.
    pub fn new(common: &Common) -> Self {
        let choice = match common.color {
            Color::Auto => ColorChoice::Auto,
            Color::Always => ColorChoice::Always,
            Color::Never => ColorChoice::Never,
        };
        choice.write_global();
        Self { quiet: common.quiet, json: common.json, closed: AtomicBool::new(false) }
    }

    /// True if bars can be drawn.
    pub fn has_bars(&self) -> bool {
        !self.quiet && io::stderr().is_terminal()
    }

    /// Prints a result. A reader that went away is no error; the work goes on quietly.
    /// # Errors
    /// `Io` if standard output cannot be written for another reason.
    pub fn result(&self, text: &str) -> Result<()> {
        if self.closed.load(Ordering::Relaxed) {
            return Ok(());
        }
        let text = if self.json { escaped(text) } else { shown(text) };
        let mut out = anstream::stdout().lock();
        match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
            Err(e) if e.kind() == io::ErrorKind::BrokenPipe => {
                self.closed.store(true, Ordering::Relaxed);
                Ok(())
            }
            other => other.map_err(|e| Error::io("write", "standard output", e)),
        }
    }

    /// Prints bytes as the artefact of `-o -`: a reader that went away ends the work.
    /// # Errors
    /// `Io`.
    pub fn artefact(&self, bytes: &[u8]) -> Result<()> {
        let mut out = io::stdout().lock();
        out.write_all(bytes).and_then(|()| out.flush()).map_err(|e| Error::io("write", "standard output", e))
    }

    /// A line for people on standard error, unless quiet. Errors of standard error are ignored.
    pub fn note(&self, text: &str) {
        if !self.quiet {
            let _ = writeln!(anstream::stderr(), "{}", visible(text));
        }
    }

    /// Faults and warnings of files. Warnings are kept back by `-q`.
    pub fn report(&self, report: &Report) {
        if report.diagnostics.is_empty() || (self.quiet && !report.has_errors()) {
            return;
        }
        let stderr = anstream::AutoStream::choice(&io::stderr());
        let style = if stderr == ColorChoice::Never { Style::Plain } else { Style::Coloured };
        let _ = writeln!(anstream::stderr(), "{}\n", render(report, style));
    }

    /// Why the run ends.
    pub fn error(&self, error: &Error) {
        match error {
            Error::Input(report) => self.report(report),
            other => self.complain(&other.to_string()),
        }
    }

    /// One line that begins with `error:`.
    pub fn complain(&self, text: &str) {
        let _ = writeln!(anstream::stderr(), "\u{1b}[1;31merror\u{1b}[0m: {}", visible(text));
    }
}

/// A result of several lines: what is hidden in them is shown, beside the ends of lines.
fn shown(text: &str) -> String {
    let lines: Vec<String> = text.split('\n').map(visible).collect();
    lines.join("\n")
}

/// JSON with what is hidden in its texts escaped; beside texts JSON has only blanks and ends of lines.
fn escaped(json: &str) -> String {
    let plain = |c: char| if is_hidden(c) && c != '\n' { format!("\\u{:04x}", u32::from(c)) } else { c.to_string() };
    if json.chars().any(|c| is_hidden(c) && c != '\n') { json.chars().map(plain).collect() } else { json.to_owned() }
}
