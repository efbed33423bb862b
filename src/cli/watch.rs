//! Termination of a run by signals, or when it exceeds the limit of memory: it is asked to stop, and ended if it does not.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use signal_hook::SigId;

use super::events;
use osier_base::Error;
use osier_base::files::{drop_parts, read_input};
use osier_base::limits::{Limits, memory_error};
use osier_base::progress::Cancel;

/// Time between a signal and forced exit, in which the work can stop and close its files.
const SHUTDOWN_TIME: Duration = Duration::from_millis(1400);
/// Time between two looks for a signal.
const SIGNAL_INTERVAL: Duration = Duration::from_millis(20);
/// Time between two measurements of memory. Shorter: reading `/proc` costs time; longer: a run exceeds its limit by more.
const MEMORY_INTERVAL: Duration = Duration::from_millis(10);
/// Bytes above the limit of memory that a run may take while it stops, beside an eighth of the limit. Own: loops look for requests ten
/// times a second, in which few take more; the default limit leaves a quarter of the memory free.
const MEMORY_MARGIN: u64 = 64 << 20;
/// Time before the first measurement: an excess that the estimate predicts is refused earlier, with its reason.
const FIRST_MEASUREMENT: Duration = Duration::from_millis(500);
/// Most bytes of `/proc/self/status`, which lists processors and groups.
const STATUS_BYTES: u64 = 1 << 16;

/// The handlers of signals of a run. Dropping it removes them, so that in a process that runs osier as a library, such as an
/// interpreter of Python, a signal again calls only the handler that was there before. A signal with the default effect then has
/// none, until the process installs its handlers again.
pub(super) struct SignalWatch {
    ids: Vec<SigId>,
    is_over: Arc<AtomicBool>,
}

impl Drop for SignalWatch {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        for id in self.ids.drain(..) {
            signal_hook::low_level::unregister(id);
        }
    }
}

/// Installs handlers of SIGINT and SIGTERM: the first signal requests cancellation and forces the exit if the work
/// has not stopped within SHUTDOWN_TIME; a second signal exits at once. SIGXFSZ, where there is one, has no effect. `as_json`: whether
/// the error of a forced exit is a line of JSON, as all others.
pub(super) fn listen(cancel: &Cancel, as_json: bool) -> std::io::Result<SignalWatch> {
    use signal_hook::consts::{SIGINT, SIGTERM};
    use signal_hook::flag;
    // What is registered before an error is removed again.
    let mut watch = SignalWatch { ids: Vec::new(), is_over: Arc::default() };
    let armed = Arc::new(AtomicBool::new(false));
    // Order matters: the conditional exit is registered before the handler that arms it, so that the first signal only
    // arms it and the second one exits. Codes are 128 plus the signal's number, as shells have them.
    for (signal, code, number) in [(SIGINT, 130, 2), (SIGTERM, 143, 15)] {
        watch.ids.push(flag::register_conditional_shutdown(signal, code, Arc::clone(&armed))?);
        watch.ids.push(flag::register(signal, Arc::clone(&armed))?);
        watch.ids.push(flag::register_usize(signal, cancel.flag(), number)?);
    }
    // By default the signal of `ulimit -f` ends the process without a word; with a handler the write fails with its reason.
    #[cfg(unix)]
    watch.ids.push(flag::register(signal_hook::consts::SIGXFSZ, Arc::default())?);
    let (is_over, cancel) = (Arc::clone(&watch.is_over), cancel.clone());
    // The request is polled, since Windows has no iterator over signals.
    std::thread::Builder::new().name("signals".into()).spawn(move || {
        while !is_over.load(Ordering::Relaxed) {
            if let Err(why) = cancel.check() {
                std::thread::sleep(SHUTDOWN_TIME);
                if !is_over.load(Ordering::Relaxed) {
                    end(why, as_json);
                }
                return;
            }
            std::thread::sleep(SIGNAL_INTERVAL);
        }
    })?;
    Ok(watch)
}

/// The thread that watches the memory of a run; it ends when this is dropped.
pub(super) struct MemoryWatch(Arc<AtomicBool>);

impl Drop for MemoryWatch {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Starts a thread that requests cancellation when the run takes more memory than its limit, which covers excesses that no estimate
/// predicts. It forces the exit when the run takes [`MEMORY_MARGIN`] and an eighth of the limit more; [`listen`] does if the work has
/// not stopped within [`SHUTDOWN_TIME`]. `as_json`: whether the error of a forced exit is a line of JSON.
/// # Errors
/// `Limit` for a limit of 0, `Io` if the thread cannot be started.
pub(super) fn watch(limits: &Limits, cancel: &Cancel, as_json: bool) -> std::result::Result<MemoryWatch, Error> {
    let most = limits.get("memory");
    if most == 0 {
        return Err(memory_error(resident_bytes().unwrap_or(1), most));
    }
    let watch = MemoryWatch(Arc::default());
    let (is_over, cancel) = (Arc::clone(&watch.0), cancel.clone());
    let spawned = std::thread::Builder::new().name("memory".into()).spawn(move || {
        std::thread::sleep(FIRST_MEASUREMENT);
        while let Some(bytes) = resident_bytes() {
            if is_over.load(Ordering::Relaxed) {
                return;
            }
            if bytes > most {
                cancel.request_for_memory(bytes, most);
            }
            if bytes > most.saturating_add(most / 8).saturating_add(MEMORY_MARGIN) {
                end(memory_error(bytes, most), as_json);
            }
            std::thread::sleep(MEMORY_INTERVAL);
        }
    });
    spawned.map(|_| watch).map_err(|e| Error::io("start", "a thread", e))
}

/// Resident memory of the process in bytes; `None` where the system does not report it.
fn resident_bytes() -> Option<u64> {
    let text = read_input(Path::new("/proc/self/status"), STATUS_BYTES, "").ok()?;
    // `/proc/self/statm` counts in pages, which are larger than 4 kB on some machines.
    let line = text.split(|b| *b == b'\n').find_map(|line| line.strip_prefix(b"VmRSS:"))?;
    std::str::from_utf8(line).ok()?.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

/// Exits the process with the code of an error, even while other threads work or block, as in a write to a full pipe. `as_json`: whether
/// the error is printed as a line of JSON.
fn end(why: Error, as_json: bool) -> ! {
    // `process::exit` runs no destructors, so unfinished files are removed here.
    drop_parts();
    let code = i32::from(why.exit_code());
    // Writing to standard error may block too, so that it happens on a thread for which the exit does not wait.
    let _ = std::thread::Builder::new().spawn(move || {
        use std::io::Write as _;
        if as_json {
            events::error(&why);
        } else {
            let _ = writeln!(std::io::stderr(), "error: {why}");
        }
    });
    std::thread::sleep(Duration::from_millis(100));
    std::process::exit(code)
}
