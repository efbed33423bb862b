//! Progress on a terminal as a bar, elsewhere as a line per stage.

use std::io::Write as _;
use std::sync::Mutex;
use std::sync::PoisonError;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::console::Console;
use crate::diagnostic::visible;
use crate::progress::Progress;

/// How work is shown.
#[derive(Debug)]
pub enum Show {
    /// One bar, replaced by the next stage's.
    Bar(Mutex<Option<ProgressBar>>),
    /// A line when a stage begins.
    Lines,
    /// Nothing.
    Nothing,
}

impl Show {
    /// What suits the console.
    pub fn new(console: &Console) -> Self {
        if console.quiet {
            Self::Nothing
        } else if console.has_bars() {
            Self::Bar(Mutex::new(None))
        } else {
            Self::Lines
        }
    }

    /// Clears the bar away before the summary.
    pub fn done(&self) {
        self.replace(None);
    }

    fn replace(&self, bar: Option<ProgressBar>) {
        if let Self::Bar(slot) = self {
            let mut slot = slot.lock().unwrap_or_else(PoisonError::into_inner);
            if let Some(old) = slot.take() {
                old.finish_and_clear();
            }
            *slot = bar;
        }
    }
}

impl Progress for Show {
    fn stage(&self, name: &str, total: u64) {
        match self {
            Self::Bar(_) => {
                let bar = ProgressBar::with_draw_target(Some(total.max(1)), ProgressDrawTarget::stderr_with_hz(10));
                let shape = "{msg:24} {wide_bar} {pos}/{len} {eta}";
                if let Ok(style) = ProgressStyle::with_template(shape) {
                    bar.set_style(style);
                }
                bar.set_message(visible(name));
                self.replace(Some(bar));
            }
            Self::Lines => {
                let count = if total > 1 { format!(" ({total})") } else { String::new() };
                let _ = writeln!(std::io::stderr(), "{}{count}", visible(name));
            }
            Self::Nothing => {}
        }
    }

    fn advance(&self, steps: u64) {
        if let Self::Bar(slot) = self
            && let Some(bar) = slot.lock().unwrap_or_else(PoisonError::into_inner).as_ref()
        {
            bar.inc(steps);
        }
    }

    fn message(&self, text: &str) {
        match self {
            Self::Bar(slot) => {
                if let Some(bar) = slot.lock().unwrap_or_else(PoisonError::into_inner).as_ref() {
                    bar.suspend(|| {
                        let _ = writeln!(std::io::stderr(), "{}", visible(text));
                    });
                }
            }
            Self::Lines => {
                let _ = writeln!(std::io::stderr(), "{}", visible(text));
            }
            Self::Nothing => {}
        }
    }
}
