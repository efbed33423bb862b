//! Console: results on standard output, everything else on standard error.

use std::io::{self, IsTerminal as _, Write as _};
use std::sync::atomic::{AtomicBool, Ordering};

use anstream::ColorChoice;

use super::args::{Color, Common};
use super::events;
use osier_base::diagnostic::{Report, Style, is_hidden, render, visible};
use osier_base::{Error, Result};

/// Standard output and standard error of a command, in the format that its flags choose.
#[derive(Debug)]
pub struct Console {
    /// Whether progress, warnings and summaries are suppressed (`-q`).
    pub quiet: bool,
    /// Whether results are printed as JSON (`--json`).
    pub json: bool,
    /// Whether standard error consists of lines of JSON (`--progress json`).
    pub events: bool,
    /// Whether the reader of standard output has closed it, after which nothing is printed.
    closed: AtomicBool,
}

impl Console {
    /// A console with the settings of `-q`, `--json` and `--color`; `events`: whether `--progress json` is set.
    pub fn new(common: &Common, events: bool) -> Self {
        let choice = match common.color {
            Color::Auto => ColorChoice::Auto,
            Color::Always => ColorChoice::Always,
            Color::Never => ColorChoice::Never,
        };
        choice.write_global();
        Self { quiet: common.quiet, json: common.json, events, closed: AtomicBool::new(false) }
    }

    /// Whether standard error is a terminal on which a progress bar can be displayed.
    pub fn has_bars(&self) -> bool {
        !self.quiet && !self.events && io::stderr().is_terminal()
    }

    /// Prints a result. A closed pipe is no error: the command completes its work without further output.
    /// # Errors
    /// `Io` if standard output cannot be written for another reason.
    pub fn result(&self, text: &str) -> Result<()> {
        let text = if self.json { escaped(text) } else { made_visible(text) };
        self.print(&mut anstream::stdout().lock(), &text)
    }

    /// Prints a text that other programs read, such as a grammar: unchanged, except on a terminal. A closed pipe is no error.
    /// # Errors
    /// `Io` if standard output cannot be written for another reason.
    pub fn document(&self, text: &str) -> Result<()> {
        let mut out = io::stdout().lock();
        if out.is_terminal() { self.print(&mut out, &made_visible(text)) } else { self.print(&mut out, text) }
    }

    fn print(&self, out: &mut impl io::Write, text: &str) -> Result<()> {
        // After `osier list | head` the reader is gone: further writes would all fail.
        if self.closed.load(Ordering::Relaxed) {
            return Ok(());
        }
        match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
            Err(e) if e.kind() == io::ErrorKind::BrokenPipe => {
                self.closed.store(true, Ordering::Relaxed);
                Ok(())
            }
            other => other.map_err(|e| Error::io("write", "standard output", e)),
        }
    }

    /// Writes the file of `-o -` to standard output; a closed pipe is an error.
    /// # Errors
    /// `Io`.
    pub fn artefact(&self, bytes: &[u8]) -> Result<()> {
        let mut out = io::stdout().lock();
        out.write_all(bytes).and_then(|()| out.flush()).map_err(|e| Error::io("write", "standard output", e))
    }

    /// Prints a line on standard error, unless quiet. Errors of standard error are ignored.
    pub fn note(&self, text: &str) {
        if self.events {
            events::note(text);
        } else if !self.quiet {
            let _ = writeln!(anstream::stderr(), "{}", visible(text));
        }
    }

    /// Tells that the result is not printed as JSON, where standard output takes the file itself.
    pub fn note_unprinted_json(&self) {
        if self.json {
            self.note("note: --json has no effect with -o -, where standard output is the file");
        }
    }

    /// Prints a warning without a position in a file, unless quiet.
    pub fn warning(&self, code: &str, message: &str) {
        if self.events {
            return events::warning(code, message);
        }
        self.note(&format!("warning[{code}]: {message}"));
    }

    /// Prints errors and warnings of files with their source lines; `-q` suppresses reports without errors.
    pub fn report(&self, report: &Report) {
        if !report.output.is_empty() {
            report.output.lines().for_each(|line| self.note(line));
        }
        if report.diagnostics.is_empty() || (self.quiet && !report.has_errors()) {
            return;
        }
        if self.events {
            return events::report(report);
        }
        let stderr = anstream::AutoStream::choice(&io::stderr());
        let style = if stderr == ColorChoice::Never { Style::Plain } else { Style::Coloured };
        let _ = writeln!(anstream::stderr(), "{}\n", render(report, style));
    }

    /// Prints the error that ends a run: with source lines if it has any, else as one line.
    pub fn error(&self, error: &Error) {
        if self.events {
            return events::error(error);
        }
        match error {
            // Errors in files are printed with their source lines.
            Error::Input(report) => self.report(report),
            // The code stands where that of a diagnostic stands.
            Error::Export { code, reason } => print_complaint(&format!("error[{code}]"), reason),
            other => self.complain(&other.to_string()),
        }
    }

    /// Prints one line that begins with `error:`, even if quiet.
    pub fn complain(&self, text: &str) {
        if self.events {
            return events::complaint(text);
        }
        print_complaint("error", text);
    }
}

/// Prints one line on standard error, with `title` in red before it.
fn print_complaint(title: &str, text: &str) {
    let _ = writeln!(anstream::stderr(), "\u{1b}[1;31m{title}\u{1b}[0m: {}", visible(text));
}

/// Replaces invisible characters except line breaks and tabs by visible ones, so that a hostile file name cannot control the
/// terminal.
fn made_visible(text: &str) -> String {
    let lines: Vec<String> =
        text.split('\n').map(|line| line.split('\t').map(visible).collect::<Vec<_>>().join("\t")).collect();
    lines.join("\n")
}

/// Escapes invisible characters in JSON, where they occur only within strings, except for line breaks.
fn escaped(json: &str) -> String {
    let plain = |c: char| if is_hidden(c) && c != '\n' { format!("\\u{:04x}", u32::from(c)) } else { c.to_string() };
    if json.chars().any(|c| is_hidden(c) && c != '\n') { json.chars().map(plain).collect() } else { json.to_owned() }
}
