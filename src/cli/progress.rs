//! Progress: a bar on a terminal, elsewhere one line per stage.

use std::io::Write as _;
use std::sync::Mutex;
use std::sync::PoisonError;
use std::time::Instant;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::console::Console;
use super::events::{self, StageEvents};
use osier_base::diagnostic::visible;
use osier_base::progress::Progress;

/// Display of progress in the format that the console allows.
#[derive(Debug)]
pub enum ProgressDisplay {
    /// One bar per stage, replaced when the next begins; for terminals.
    Bar(Mutex<Option<ProgressBar>>),
    /// One line of text per stage, when it begins.
    Lines,
    /// Lines of JSON, for other programs.
    Events(StageEvents),
    /// No output, with `--quiet` and where a command checks many files.
    Silent,
}

impl ProgressDisplay {
    /// Chooses the display by the flags of the console and by whether standard error is a terminal.
    pub fn new(console: &Console) -> Self {
        if console.events {
            Self::Events(StageEvents::default())
        } else if console.quiet {
            Self::Silent
        } else if console.has_bars() {
            Self::Bar(Mutex::new(None))
        } else {
            Self::Lines
        }
    }

    /// Removes the bar, so that the summary starts on an empty line.
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

impl Progress for ProgressDisplay {
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
                // Errors of the display do not end the work.
                let _ = writeln!(std::io::stderr(), "{}{count}", visible(name));
            }
            Self::Events(events) => events.stage(name, total),
            Self::Silent => {}
        }
    }

    fn advance(&self, steps: u64) {
        match self {
            Self::Bar(slot) => {
                if let Some(bar) = slot.lock().unwrap_or_else(PoisonError::into_inner).as_ref() {
                    bar.inc(steps);
                }
            }
            Self::Events(events) => events.advance(steps),
            Self::Lines | Self::Silent => {}
        }
    }

    fn message(&self, text: &str) {
        match self {
            Self::Bar(slot) => {
                if let Some(bar) = slot.lock().unwrap_or_else(PoisonError::into_inner).as_ref() {
                    // The bar is removed while a line is printed, which would otherwise be appended to it.
                    bar.suspend(|| {
                        let _ = writeln!(std::io::stderr(), "{}", visible(text));
                    });
                }
            }
            Self::Lines => {
                let _ = writeln!(std::io::stderr(), "{}", visible(text));
            }
            Self::Events(_) => events::note(text),
            Self::Silent => {}
        }
    }
}

/// Passes progress on to a display and measures the time of each stage.
#[derive(Debug)]
pub struct StageTimer<'a> {
    display: &'a ProgressDisplay,
    begun: Mutex<Vec<(String, Instant)>>,
}

impl<'a> StageTimer<'a> {
    /// A timer that has seen no stage.
    pub fn new(display: &'a ProgressDisplay) -> Self {
        Self { display, begun: Mutex::new(Vec::new()) }
    }

    /// Seconds of each stage so far, in order of first occurrence; stages of one name are added up. Times are only printed:
    /// files are the same for every run.
    pub fn seconds(&self) -> Vec<(String, f64)> {
        let begun = self.begun.lock().unwrap_or_else(PoisonError::into_inner);
        let mut out: Vec<(String, f64)> = Vec::new();
        for (i, (name, from)) in begun.iter().enumerate() {
            // A stage lasts until the next begins; the last one is still running.
            let took = begun.get(i + 1).map_or_else(|| from.elapsed(), |next| next.1 - *from).as_secs_f64();
            match out.iter_mut().find(|s| s.0 == *name) {
                Some(stage) => stage.1 += took,
                None => out.push((name.clone(), took)),
            }
        }
        out
    }
}

impl Progress for StageTimer<'_> {
    fn stage(&self, name: &str, total: u64) {
        #[allow(clippy::disallowed_methods, reason = "the command line may measure time")]
        let now = Instant::now();
        self.begun.lock().unwrap_or_else(PoisonError::into_inner).push((name.to_owned(), now));
        self.display.stage(name, total);
    }

    fn advance(&self, steps: u64) {
        self.display.advance(steps);
    }

    fn message(&self, text: &str) {
        self.display.message(text);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stages_of_one_name_are_added_up() {
        let display = ProgressDisplay::Silent;
        let timer = StageTimer::new(&display);
        ["growing", "writing", "growing"].iter().for_each(|name| timer.stage(name, 0));
        let seconds = timer.seconds();
        assert_eq!(seconds.iter().map(|s| s.0.as_str()).collect::<Vec<_>>(), ["growing", "writing"]);
        assert!(seconds.iter().all(|s| (0.0..60.0).contains(&s.1)));
    }
}
