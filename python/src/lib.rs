//! The module `osier` of Python: the program `osier`, called with a list of arguments.

use pyo3::prelude::*;

/// Numbers of SIGINT and SIGTERM.
const SIGNALS: [i32; 2] = [2, 15];

/// Lets Python install its handlers of signals again. The one that a run has put in their place stays: it only calls those before
/// it, so that a signal with the default effect, such as SIGTERM, would have none.
fn reinstall_handlers(py: Python<'_>) {
    let Ok(module) = py.import("signal") else { return };
    for number in SIGNALS {
        // Python refuses outside of its main thread, and for a handler that it did not install.
        if let Ok(handler) = module.call_method1("getsignal", (number,)) {
            let _ = module.call_method1("signal", (number, handler));
        }
    }
}

/// Runs the program osier as Python calls it.
#[pymodule]
mod osier {
    use std::ffi::OsString;
    use std::sync::atomic::{AtomicBool, Ordering};

    use pyo3::exceptions::{PyKeyboardInterrupt, PyRuntimeError};
    use pyo3::prelude::*;

    /// Whether the program has run in this process.
    static CALLED: AtomicBool = AtomicBool::new(false);

    /// Runs the program osier with the arguments `argv` (those of the process if None) and returns its exit code.
    ///
    /// Output goes to the standard output and error of the process. SIGINT and SIGTERM stop a bake without unfinished files: the
    /// code is then 130 or 143. A process may call it once.
    ///
    /// A run stops, with code 1, when the memory of the process, that of Python included, exceeds the limit --max-memory. The whole
    /// process ends, with the code of the run, if a run has not stopped 1.4 s after a signal or after it exceeded the limit, if a second
    /// signal comes, and if the memory grows on by an eighth of the limit and 64 MB.
    #[pyfunction]
    #[pyo3(signature = (argv = None))]
    fn main(py: Python<'_>, argv: Option<Vec<OsString>>) -> PyResult<u8> {
        if CALLED.swap(true, Ordering::Relaxed) {
            return Err(PyRuntimeError::new_err("osier.main may be called once in a process; start another process"));
        }
        let arguments = match argv {
            Some(arguments) => arguments,
            None => py.import("sys")?.getattr("argv")?.extract::<Vec<OsString>>()?.into_iter().skip(1).collect(),
        };
        let code = py.detach(|| ::osier::cli::run(std::iter::once(OsString::from("osier")).chain(arguments)));
        // Python has noted SIGINT, too, and would raise KeyboardInterrupt after a run that has already stopped because of it.
        let noted = py.check_signals();
        super::reinstall_handlers(py);
        match noted {
            Err(e) if !e.is_instance_of::<PyKeyboardInterrupt>(py) => Err(e),
            _ => Ok(code),
        }
    }
}
