//! The one error type of the library and its way to an exit code.

use std::path::PathBuf;

use crate::diagnostic::{Diagnostic, Report};

/// Everything that can end a run, one variant per remedy.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Diagnostics about the user's files; the cli renders them with source lines.
    #[error("{0}")]
    Input(Box<Report>),
    /// A system call on a file or folder failed.
    #[error("cannot {action} \"{}\": {source}{}", path.display(), io_remedy(action, source))]
    Io {
        /// What was attempted, as a verb: "open", "write", "rename".
        action: &'static str,
        /// The file or folder that the call named; for a rename the new name.
        path: PathBuf,
        /// Error of the system call; its kind selects the exit code.
        source: std::io::Error,
    },
    /// A value outside its documented range.
    #[error("{name} is {value}, but must lie in {min} to {max} {unit}")]
    Range {
        /// Key of a scene, or parameter of a function, that has the value.
        name: String,
        /// The rejected value, which may be NaN.
        value: f64,
        /// Lower end of the allowed range.
        min: f64,
        /// Upper end of the allowed range, which may be infinite.
        max: f64,
        /// Unit of all three, empty if none.
        unit: &'static str,
    },
    /// Work that would exceed a limit; refused before it starts.
    #[error("{name} would be {wanted}, the limit is {limit}{}", remedies(flag, help))]
    Limit {
        /// Description of the counted quantity.
        name: String,
        /// Predicted amount, with separators of thousands.
        wanted: String,
        /// Amount in force, with separators of thousands.
        limit: String,
        /// Flag that raises the limit; empty for a limit that no flag raises.
        flag: String,
        /// Another remedy, as a request without a full stop: "use a larger dx"; empty if there is none.
        help: String,
    },
    /// More things than the integer that numbers them can count.
    #[error("{count} {what} are too many; at most {limit} can be indexed")]
    TooMany {
        /// The things, in the plural: "points of a mesh".
        what: &'static str,
        /// Their number in decimal digits, without separators.
        count: String,
        /// Largest number that the index type holds.
        limit: u64,
    },
    /// A simulation left its bounds.
    #[error("frame {frame}: {quantity} is out of bounds; shorten the step or soften the input")]
    Simulation {
        /// Number of the frame whose step failed.
        frame: u32,
        /// The quantity that became infinite or left its range.
        quantity: String,
    },
    /// A file cannot be written as asked (codes X001 to X030).
    #[error("{code}: {reason}")]
    Export {
        /// Stable code, X001 to X030.
        code: &'static str,
        /// Subject, fact, next step.
        reason: String,
    },
    /// The output would overwrite a file that neither names osier as its maker nor is listed in the journal of its folder.
    #[error(
        "\"{}\" does not name osier as its maker; choose another name or folder with -o, or pass --force to overwrite it",
        path.display()
    )]
    Foreign {
        /// The file, or the journal of a folder, that would be overwritten.
        path: PathBuf,
    },
    /// A signal asked the run to end.
    #[error("interrupted by signal {signal}")]
    Cancelled {
        /// SIGINT is 2, SIGTERM 15.
        signal: i32,
    },
}

/// `Result` of the fallible functions of all osier crates.
pub type Result<T> = std::result::Result<T, Error>;

impl Report {
    /// `Err` with this report if it holds an error; otherwise `Ok` with `value` and this report, which may hold warnings.
    /// # Errors
    /// [`Error::Input`].
    pub fn into_result<T>(self, value: T) -> Result<(T, Self)> {
        if self.has_errors() { Err(Error::Input(Box::new(self))) } else { Ok((value, self)) }
    }
}

impl Error {
    /// Exit code of the process that ends with this error; the table is printed by `osier --help`.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Io { action, source, .. } => io_code(action, source),
            Self::Cancelled { signal: 15 } => 143,
            Self::Cancelled { .. } => 130,
            _ => 1,
        }
    }

    /// [`Error::Io`] for a failed system call. `action`: the verb of the message; "open" gives an absent file exit code 1, "make"
    /// names no flag `-o` as a remedy.
    pub fn io(action: &'static str, path: impl Into<PathBuf>, source: std::io::Error) -> Self {
        Self::Io { action, path: path.into(), source }
    }

    /// A fault of the input that is found only while it is used and so has no span. `message`: subject, fact, next step.
    pub fn input(code: &'static str, message: impl Into<String>) -> Self {
        Diagnostic::about(code, message).into()
    }

    /// [`Error::Export`] with a stable code, X001 to X030. `reason`: subject, fact, next step.
    pub fn export(code: &'static str, reason: impl Into<String>) -> Self {
        Self::Export { code, reason: reason.into() }
    }
}

/// [`Error::Input`] with this diagnostic and no source texts; meant for diagnostics without labels.
impl From<Diagnostic> for Error {
    fn from(diagnostic: Diagnostic) -> Self {
        Self::Input(Box::new(Report { diagnostics: vec![diagnostic], ..Report::default() }))
    }
}

/// Clause of a message about a limit: the flag that raises it, and another remedy; either may be empty.
fn remedies(flag: &str, help: &str) -> String {
    match (flag.is_empty(), help.is_empty()) {
        (false, false) => format!("; raise it with {flag}, or {help}"),
        (false, true) => format!("; raise it with {flag}"),
        (true, false) => format!("; {help}"),
        (true, true) => String::new(),
    }
}

/// Clause of a message about a failed system call: what the user can do about it; empty where nothing is known.
fn io_remedy(action: &str, source: &std::io::Error) -> &'static str {
    use std::io::ErrorKind as K;
    let reads = matches!(action, "open" | "read");
    // "make" is the action of commands without `-o`, whose argument is the place itself.
    let makes = action == "make";
    match source.kind() {
        K::PermissionDenied if reads => "; change its permissions, or name a copy that you may read",
        K::PermissionDenied if makes => "; change the permissions there, or choose another place",
        K::ReadOnlyFilesystem if makes => "; choose a place on another disk",
        K::StorageFull | K::QuotaExceeded if makes => "; free some space, or choose a place on another disk",
        K::NotADirectory if makes => "; choose another place",
        K::PermissionDenied => "; change the permissions there, or choose another folder with -o",
        K::ReadOnlyFilesystem => "; choose a folder on another disk with -o",
        K::StorageFull | K::QuotaExceeded => "; free some space, or choose a folder on another disk with -o",
        K::NotADirectory if !reads => "; choose another folder with -o",
        _ => "",
    }
}

/// 1 for an absent input, 75 (EX_TEMPFAIL) for errors that may pass, 74 (EX_IOERR) for the others; see sysexits.h.
fn io_code(action: &str, source: &std::io::Error) -> u8 {
    match source.kind() {
        std::io::ErrorKind::NotFound if action == "open" => 1,
        _ if is_transient(source) => 75,
        _ => 74,
    }
}

/// True for errors that may pass by themselves: busy or stale files, a slow network, too many open files.
pub(crate) fn is_transient(source: &std::io::Error) -> bool {
    use std::io::ErrorKind as K;
    let kind = matches!(
        source.kind(),
        K::TimedOut
            | K::WouldBlock
            | K::Interrupted
            | K::StaleNetworkFileHandle
            | K::ResourceBusy
            | K::HostUnreachable
            | K::NetworkUnreachable
            | K::NetworkDown
            | K::ConnectionReset
            | K::ConnectionAborted
    );
    // ENFILE (23) and EMFILE (24), too many open files, have no `ErrorKind`.
    kind || (cfg!(unix) && matches!(source.raw_os_error(), Some(23 | 24)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_tell_flag_and_help() {
        let told = |flag: &str, help: &str| {
            let (name, wanted, limit) = ("points".into(), "9".into(), "8".into());
            Error::Limit { name, wanted, limit, flag: flag.into(), help: help.into() }.to_string()
        };
        let both = "points would be 9, the limit is 8; raise it with --max-points, or use fewer";
        assert_eq!(told("--max-points", "use fewer"), both);
        assert_eq!(told("--max-points", ""), "points would be 9, the limit is 8; raise it with --max-points");
        assert_eq!(told("", "use fewer"), "points would be 9, the limit is 8; use fewer");
    }

    #[test]
    fn failed_calls_tell_a_remedy() {
        use std::io::ErrorKind as K;
        let told = |action, kind: K| Error::io(action, "out/oak.glb", kind.into()).to_string();
        let denied = told("create", K::PermissionDenied);
        assert!(
            denied.starts_with("cannot create \"out/oak.glb\": permission denied; change the permissions there, or"),
            "{denied}"
        );
        assert!(told("open", K::PermissionDenied).ends_with("that you may read"), "{denied}");
        for kind in [K::PermissionDenied, K::ReadOnlyFilesystem, K::StorageFull, K::QuotaExceeded, K::NotADirectory] {
            assert!(told("write", kind).ends_with("with -o"), "{kind:?}");
        }
        assert_eq!(told("open", K::NotFound), "cannot open \"out/oak.glb\": entity not found");
        for kind in [K::PermissionDenied, K::ReadOnlyFilesystem, K::StorageFull, K::QuotaExceeded, K::NotADirectory] {
            let made = told("make", kind);
            assert!(made.contains("; ") && !made.contains(" -o"), "{made}");
        }
    }

    #[test]
    fn exit_codes_follow_the_table() {
        let missing = std::io::Error::from(std::io::ErrorKind::NotFound);
        let full = std::io::Error::from(std::io::ErrorKind::StorageFull);
        assert_eq!(Error::io("open", "a.l", missing).exit_code(), 1);
        assert_eq!(Error::io("write", "a.glb", full).exit_code(), 74);
        assert_eq!(Error::Cancelled { signal: 2 }.exit_code(), 130);
        assert_eq!(Error::Cancelled { signal: 15 }.exit_code(), 143);
        assert_eq!(Error::export("X001", "x").exit_code(), 1);
    }
}
