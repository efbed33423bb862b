//! Reads coefficient files into systems: Fractint's `.ifs`, flames, and tables in TOML.
//!
//! # Examples
//! ```
//! use osier_base::limits::Limits;
//! use osier_ifs::read::{pick, read};
//!
//! let text = b"sierpinski { .5 0 0 .5 0 0 1  .5 0 0 .5 .5 0 1  .5 0 0 .5 0 .5 1 }";
//! let (systems, _) = read("sierpinski.ifs", text, &Limits::default())?;
//! let system = pick(&systems, Some("Sierpinski"), "sierpinski.ifs")?;
//! assert_eq!((system.dim, system.maps.len()), (2, 3));
//! # Ok::<(), osier_base::Error>(())
//! ```

mod entries;
mod flame;
mod fractint;
mod table;
#[cfg(test)]
mod tests;

use super::Ifs;
use osier_base::convert;
use osier_base::diagnostic::{Diagnostic, Report, Severity, SourceId, Span, nearest};
use osier_base::files::{Encoding, decode};
use osier_base::limits::{Limits, grouped};
use osier_base::{Error, Result};

/// Longest file, bytes.
const MAX_BYTES: usize = 16 << 20;
const MAX_SYSTEMS: usize = 10_000;
/// Diagnostics printed about one file; a damaged file could otherwise produce one per number.
const MAX_DIAGNOSTICS: usize = 100;

/// Format of a coefficient file, recognised by its content.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TableFormat {
    /// Fractint's columns.
    Fractint,
    /// XML of flam3 and Apophysis.
    Flame,
    /// TOML with a table `[ifs]`.
    Table,
}

impl TableFormat {
    /// Recognises the format by the first character that is not blank, or by a line that starts `[ifs` or `[[ifs`.
    fn of(text: &str) -> Self {
        if text.trim_start().starts_with('<') {
            Self::Flame
        } else if text.lines().any(|l| l.starts_with("[ifs") || l.starts_with("[[ifs")) {
            Self::Table
        } else {
            Self::Fractint
        }
    }

    fn suffix(self) -> &'static str {
        match self {
            Self::Fractint => ".ifs",
            Self::Flame => ".flame",
            Self::Table => ".ifs.toml",
        }
    }
}

/// Reads all systems of a file. `name`: name in messages; I002 if its ending contradicts the content.
/// Returns them in the file's order, with warnings in the report.
/// # Errors
/// `Input` with I codes and places.
pub fn read(name: &str, bytes: &[u8], limits: &Limits) -> Result<(Vec<Ifs>, Report)> {
    let mut report = Report::default();
    let limit = convert::limit(limits.get("text-bytes")).min(MAX_BYTES);
    if bytes.len() > limit {
        let text =
            format!("\"{name}\" has {} bytes, the limit is {}", grouped(bytes.len() as u64), grouped(limit as u64));
        return Err(Diagnostic::about("I008", text).help("split the file, or name a system in a smaller one").into());
    }
    // DOS editors end a file with 0x1A.
    let end = bytes.iter().position(|b| *b == 0x1A).unwrap_or(bytes.len());
    let body = bytes.get(..end).unwrap_or(bytes);
    // Old tables are often in Latin-1; other encodings are refused.
    let text = match decode(body, Encoding::OrLatin1) {
        Ok(text) => text,
        Err(bad) => {
            bad.report("I005", name, body, &mut report);
            return Err(Error::Input(Box::new(report)));
        }
    };
    let source = report.sources.add(name, text.text.as_str());
    let mut reader =
        IfsReader { text: &text.text, source, stem: stem(name), report: &mut report, diagnostic_count: 0, limits };
    if let Some((line, _)) = text.latin1 {
        let d = Diagnostic::about("I003", format!("\"{name}\" is not UTF-8 from line {line} on, read as Latin-1"));
        reader.push(d.help("save the file as UTF-8 to keep names as they are"));
    }
    let kind = TableFormat::of(&text.text);
    reader.check_suffix(name, kind);
    let systems = match kind {
        TableFormat::Fractint => entries::read(&mut reader),
        TableFormat::Flame => flame::read(&mut reader),
        TableFormat::Table => table::read(&mut reader),
    };
    if kind == TableFormat::Fractint && !systems.is_empty() {
        reader.skip_faulty_entries();
    }
    reader.check_names(&systems);
    reader.check_weights(&systems);
    report.into_result(systems)
}

/// The system with the given name, compared without case; without a name, the first one.
/// # Errors
/// `Input` with I001 and the nearest name.
pub fn pick<'a>(systems: &'a [Ifs], name: Option<&str>, file: &str) -> Result<&'a Ifs> {
    let found = match name {
        Some(name) => systems.iter().find(|s| s.name.eq_ignore_ascii_case(name)),
        None => systems.first(),
    };
    found.ok_or_else(|| {
        let d = match name {
            Some(name) => {
                let d = Diagnostic::about("I001", format!("\"{file}\" has no system \"{name}\""));
                match nearest(name, systems.iter().map(|s| s.name.as_str())) {
                    Some(near) => d.help(format!("did you mean \"{near}\"?")),
                    None => {
                        let names: Vec<&str> = systems.iter().take(12).map(|s| s.name.as_str()).collect();
                        d.help(format!("it holds: {}", names.join(", ")))
                    }
                }
            }
            None => Diagnostic::about("I001", format!("\"{file}\" holds no system"))
                .help("a system is written NAME { a b c d e f p ... }, one map per line"),
        };
        Error::from(d)
    })
}

fn stem(name: &str) -> String {
    let file = name.rsplit(['/', '\\', ':']).next().unwrap_or(name);
    file.split('.').next().unwrap_or(file).to_owned()
}

pub(super) struct IfsReader<'a> {
    pub text: &'a str,
    pub source: SourceId,
    /// File name without folder and extension; systems without a name are called this.
    pub stem: String,
    pub report: &'a mut Report,
    /// Number of diagnostics so far, including those beyond the limit.
    diagnostic_count: usize,
    pub limits: &'a Limits,
}

impl IfsReader<'_> {
    fn max_maps(&self) -> usize {
        convert::limit(self.limits.get("maps"))
    }

    fn span(&self, start: usize, end: usize) -> Span {
        Span::new(self.source, start, end)
    }

    /// Adds a diagnostic, at most [`MAX_DIAGNOSTICS`] of them.
    fn push(&mut self, d: Diagnostic) {
        self.diagnostic_count += 1;
        if self.diagnostic_count <= MAX_DIAGNOSTICS {
            self.report.push(d);
        }
    }

    /// True if there are more diagnostics than the limit: reading on is of no use.
    fn has_too_many_diagnostics(&self) -> bool {
        self.diagnostic_count > MAX_DIAGNOSTICS
    }

    /// Turns errors of entries into warnings: a faulty entry is skipped, the other entries of the file are kept.
    fn skip_faulty_entries(&mut self) {
        for d in self.report.diagnostics.iter_mut().filter(|d| d.severity == Severity::Error) {
            d.severity = Severity::Warning;
            d.message += "; the entry is skipped";
        }
    }

    fn check_suffix(&mut self, name: &str, kind: TableFormat) {
        let lower = name.to_ascii_lowercase();
        // The format that the ending of the name claims, if any.
        let claims = [TableFormat::Table, TableFormat::Flame, TableFormat::Fractint]
            .into_iter()
            .find(|k| lower.ends_with(k.suffix()));
        if let Some(claimed) = claims.filter(|c| *c != kind) {
            let text =
                format!("the name ends in {}, but the content is that of {} files", claimed.suffix(), kind.suffix());
            let span = self.span(0, self.text.chars().next().map_or(0, char::len_utf8));
            self.push(Diagnostic::warning("I002", text, span, "read by its content"));
        }
    }

    /// Reports names that are used twice (I010), names that Fractint does not distinguish (I009), and too many systems (I008).
    fn check_names(&mut self, systems: &[Ifs]) {
        if systems.len() > MAX_SYSTEMS {
            let text =
                format!("the file holds {} systems, the limit is {}", systems.len(), grouped(MAX_SYSTEMS as u64));
            self.push(Diagnostic::about("I008", text).help("split the file"));
            return;
        }
        let mut seen: std::collections::BTreeMap<String, (Span, String)> = std::collections::BTreeMap::new();
        for s in systems {
            let lower = s.name.to_lowercase();
            // Fractint compares 18 characters without case.
            let short: String = lower.chars().take(18).collect();
            match seen.get(&short).cloned() {
                Some((first, full)) if full == lower => {
                    let text = format!("the name \"{}\" is used twice", s.name);
                    let d = Diagnostic::error("I010", text, s.span, "second").label(first, "first");
                    self.push(d.help("give each system of a file a name of its own"));
                }
                Some((first, _)) => {
                    let text = format!("\"{}\" and another name are equal in their first 18 characters", s.name);
                    let d = Diagnostic::warning("I009", text, s.span, "second").label(first, "first");
                    self.push(d.help("Fractint compares 18 characters and would use the first"));
                }
                None => {
                    seen.insert(short, (s.span, lower));
                }
            }
        }
    }

    fn check_weights(&mut self, systems: &[Ifs]) {
        for s in systems {
            for d in super::weights::column_warnings(s) {
                self.push(d);
            }
        }
    }
}
