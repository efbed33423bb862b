//! The wind that a scene describes.

use super::resolve::{Resolver, span_of};
use super::tree::Table;
use super::wind_keys::{SwayKeys, WindKeys, WindModel};
use crate::diagnostic::Diagnostic;
use crate::scene::Clip;
use crate::wind::{CALM, beaufort};

/// Shortest clip that can repeat, s.
pub const SHORTEST_LOOP: f64 = 2.0;

impl Resolver<'_> {
    /// Wind; a given speed wins over a number of Beaufort's scale.
    pub(super) fn wind(&mut self, root: &Table) -> WindKeys {
        let mut keys: WindKeys = self.section(root, "wind");
        let speed = span_of(root, &["wind", "speed"]);
        if let Some((number, span)) = keys.beaufort.zip(span_of(root, &["wind", "beaufort"])) {
            if speed.is_some() {
                let text = format!("wind.beaufort is {number}, but wind.speed is given, too");
                let d = Diagnostic::warning("S007", text, span, "has no effect");
                self.report.push(d.help("leave one of them out"));
            } else {
                keys.speed = beaufort(number);
            }
        }
        if keys.literal && keys.model != WindModel::Perlin {
            let span = span_of(root, &["wind", "literal"]).unwrap_or(self.whole);
            let d = Diagnostic::warning("S007", "wind.literal belongs to another wind", span, "has no effect");
            self.report.push(d.help("write model = \"perlin\""));
        }
        keys
    }

    /// Answer to the wind.
    pub(super) fn sway(&mut self, root: &Table, clip: Clip) -> SwayKeys {
        let keys: SwayKeys = self.section(root, "sway");
        if keys.repeat == Some(true) && seconds(&clip) < SHORTEST_LOOP {
            let span = span_of(root, &["sway", "repeat"]).unwrap_or(self.whole);
            let text = format!("a clip of {:.2} s is too short to repeat", seconds(&clip));
            let d = Diagnostic::error("S004", text, span, "not possible");
            self.report.push(d.help(format!("at least {SHORTEST_LOOP} s: raise frames.end")));
        }
        keys
    }
}

impl WindKeys {
    /// False in a calm.
    pub fn blows(&self) -> bool {
        self.model != WindModel::Calm && self.speed >= CALM
    }
}

/// Length of a loop: the frame after the last one looks like the first.
pub fn seconds(clip: &Clip) -> f64 {
    #[allow(clippy::cast_precision_loss, reason = "at most a million frames")]
    let frames = clip.len() as f64;
    frames / clip.fps()
}
