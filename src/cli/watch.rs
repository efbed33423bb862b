//! What ends a run from outside of its work: signals, and memory beyond the limit.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use osier_base::Error;
use osier_base::files::{drop_parts, read_input};
use osier_base::limits::{Limits, grouped};
use osier_base::progress::Cancel;

/// Time that work has to stop by itself after a signal.
const PATIENCE: Duration = Duration::from_millis(1400);
/// Time between two looks at the memory in use.
const LOOK: Duration = Duration::from_millis(10);
/// Time before the first look: what can be foretold is refused by name before.
const GRACE: Duration = Duration::from_millis(500);
/// Bytes of a page, by which the system counts.
const PAGE: u64 = 4096;

/// The first signal asks the work to stop, and ends what has not stopped soon after; the second ends it at once.
pub(super) fn listen(cancel: &Cancel) -> std::io::Result<()> {
    use signal_hook::consts::{SIGINT, SIGTERM};
    use signal_hook::flag;
    let armed = Arc::new(AtomicBool::new(false));
    for (signal, code, number) in [(SIGINT, 130, 2), (SIGTERM, 143, 15)] {
        flag::register_conditional_shutdown(signal, code, Arc::clone(&armed))?;
        flag::register(signal, Arc::clone(&armed))?;
        flag::register_usize(signal, cancel.flag(), number)?;
    }
    let mut signals = signal_hook::iterator::Signals::new([SIGINT, SIGTERM])?;
    std::thread::Builder::new().name("signals".into()).spawn(move || {
        if let Some(signal) = signals.forever().next() {
            std::thread::sleep(PATIENCE);
            end(Error::Cancelled { signal });
        }
    })?;
    Ok(())
}

/// Ends the run once it takes more memory than it may: what nobody could foretell.
/// # Errors
/// `Limit` if it takes more already.
pub(super) fn watch(limits: &Limits) -> std::result::Result<(), Error> {
    let most = limits.get("memory");
    if most == 0 {
        return Err(over(in_use().unwrap_or(PAGE), most));
    }
    let spawned = std::thread::Builder::new().name("memory".into()).spawn(move || {
        std::thread::sleep(GRACE);
        while let Some(bytes) = in_use() {
            if bytes > most {
                end(over(bytes, most));
            }
            std::thread::sleep(LOOK);
        }
    });
    spawned.map(drop).map_err(|e| Error::io("start", "a thread", e))
}

fn over(bytes: u64, most: u64) -> Error {
    let name = "memory in use, in bytes,".into();
    Error::Limit { name, wanted: grouped(bytes), limit: grouped(most), flag: "--max-memory".into() }
}

/// Bytes of memory in use; none where the system does not tell.
fn in_use() -> Option<u64> {
    let text = read_input(Path::new("/proc/self/statm"), 4096).ok()?;
    let text = String::from_utf8(text).ok()?;
    text.split_whitespace().nth(1)?.parse::<u64>().ok()?.checked_mul(PAGE)
}

/// Ends a run that cannot be called from where it is, such as a wait for the other end of a pipe.
fn end(why: Error) -> ! {
    drop_parts();
    let code = i32::from(why.exit_code());
    // Standard error may be what is waited for.
    let _ = std::thread::Builder::new().spawn(move || {
        use std::io::Write as _;
        let _ = writeln!(std::io::stderr(), "error: {why}");
    });
    std::thread::sleep(Duration::from_millis(100));
    std::process::exit(code)
}
