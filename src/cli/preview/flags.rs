//! Parsing of the flags of `osier preview`.

use super::super::args::{Preview, QualityArg};
use super::super::numbers::{self, KeyValues, swept_keys};
use super::super::{Context, unreadable_name};
use super::source::ending;
use crate::scene_preview::{PreviewBackground, PreviewOptions, PreviewView};
use osier_preview::{CameraView, Quality};

/// The flags of `osier preview`, parsed and checked against each other.
#[derive(Debug, Clone)]
pub struct PreviewFlags {
    pub options: PreviewOptions,
    /// Seeds of a contact sheet in rising order; empty without `--seeds`.
    pub seeds: Vec<u64>,
    /// Axes of a contact sheet, in the order of the flags; at most two together with the seeds.
    pub sweeps: Vec<KeyValues>,
    /// Frames of a clip in rising order; empty without `--frames`.
    pub frames: Vec<u32>,
}

impl PreviewFlags {
    /// Parses the flags; sizes are checked against the limits.
    /// # Errors
    /// A message for the first flag that cannot be read or that excludes another.
    pub fn new(context: &Context, args: &Preview) -> Result<Self, String> {
        let seeds = match &args.seeds {
            Some(list) => {
                numbers::number_list(list, MAX_CELLS, "draw several sheets").map_err(|e| format!("--seeds: {e}"))?
            }
            None => Vec::new(),
        };
        let frames = match &args.frames {
            Some(list) => {
                numbers::frame_list(list, context.limits.get("frames")).map_err(|e| format!("--frames: {e}"))?
            }
            None => Vec::new(),
        };
        let sweeps = swept_keys(&args.sweep)?;
        if sweeps.len() > 2 || (sweeps.len() == 2 && !seeds.is_empty()) {
            return Err("a contact sheet has two axes: give two --sweep, or --seeds and one --sweep".into());
        }
        // Other columns would break the rows of a grid, whose title names both axes.
        let has_two_axes = sweeps.len() + usize::from(!seeds.is_empty()) == 2;
        if has_two_axes && args.columns.is_some() {
            return Err("--columns: a sheet of two axes has a column for each value of the first --sweep".into());
        }
        let sheet = !seeds.is_empty() || !sweeps.is_empty();
        // Each of these modes decides the number and arrangement of pictures, so that only one may be set.
        let modes = [sheet, !frames.is_empty(), args.turntable.is_some(), args.compare.is_some()];
        if modes.iter().filter(|m| **m).count() > 1 {
            return Err("--seeds/--sweep, --frames, --turntable and --compare exclude each other".into());
        }
        let moving = !frames.is_empty() || args.turntable.is_some();
        // Clips choose their format by the ending; everything else is a PNG, whatever the name says.
        let ending = args.output.as_deref().filter(|_| !moving).map(ending).unwrap_or_default();
        if !matches!(ending.as_str(), "" | "png" | "apng") {
            return Err(format!("a picture is written as .png, not as .{ending}"));
        }
        if let Some(why) = args.output.as_deref().and_then(unreadable_name) {
            return Err(why);
        }
        let size = match &args.size {
            Some(text) => size(text, context)?,
            // Pictures are smaller by default if one run renders many.
            None if sheet => [320, 320],
            None if moving => [480, 480],
            None => [800, 800],
        };
        let quality = match args.quality {
            QualityArg::Draft => Quality::Draft,
            QualityArg::Normal => Quality::Normal,
            QualityArg::Fine => Quality::Fine,
        };
        let view = args.view.as_deref().map(view).transpose()?;
        let sun = args.sun.as_deref().map(|t| pair(t, "--sun", "ELEVATION,DIRECTION in degrees")).transpose()?;
        let background = background(args.background.as_deref())?;
        Ok(Self { options: PreviewOptions { size, quality, view, sun, background }, seeds, sweeps, frames })
    }

    /// Whether `--seeds` or `--sweep` request a contact sheet.
    pub fn is_sheet(&self) -> bool {
        !self.seeds.is_empty() || !self.sweeps.is_empty()
    }
}

/// Largest number of cells of a contact sheet: with more than 32 by 32, captions and pictures are too small to compare.
pub const MAX_CELLS: u64 = 1024;

/// Parses `WIDTHxHEIGHT` in pixels, or one number for a square.
fn size(text: &str, context: &Context) -> Result<[u32; 2], String> {
    let bad = || format!("--size: \"{text}\" is not WIDTHxHEIGHT, such as 800x600");
    let (w, h) = text.split_once(['x', 'X']).unwrap_or((text, text));
    let side = |t: &str| t.trim().parse::<u32>().ok().filter(|n| *n > 0).ok_or_else(bad);
    let size = [side(w)?, side(h)?];
    check_picture_limits(size.map(u64::from), context).map(|()| size)
}

/// Compares the size of a picture with the limits `image-side` and `image-bytes`, before memory is allocated.
pub fn check_picture_limits([width, height]: [u64; 2], context: &Context) -> Result<(), String> {
    let limits = &context.limits;
    limits.check("image-side", width.max(height), "a side of the picture, in pixels,").map_err(|e| e.to_string())?;
    // Four channels of one byte.
    let bytes = width.saturating_mul(height).saturating_mul(4);
    limits.check("image-bytes", bytes, "the picture, in bytes,").map_err(|e| e.to_string())
}

/// Parses two finite numbers of magnitude at most 3600, separated by a comma. `shape`: phrase for the message.
fn pair(text: &str, flag: &str, shape: &str) -> Result<[f32; 2], String> {
    let bad = || format!("{flag}: \"{text}\" is not {shape}, such as 40,120");
    let (a, b) = text.split_once(',').ok_or_else(bad)?;
    let number = |t: &str| t.trim().parse::<f32>().ok().filter(|v| v.is_finite() && v.abs() <= 3600.0).ok_or_else(bad);
    Ok([number(a)?, number(b)?])
}

/// The view from the front (+Z), for drawings in the plane x-y.
pub fn front() -> PreviewView {
    PreviewView::Fitted(CameraView::Angles { azimuth: 0.0, elevation: 0.0 })
}

/// Parses the name of a view, or azimuth and elevation in degrees.
fn view(text: &str) -> Result<PreviewView, String> {
    let angles = |azimuth, elevation| PreviewView::Fitted(CameraView::Angles { azimuth, elevation });
    match text {
        "scene" => Ok(PreviewView::Scene),
        "portrait" => Ok(PreviewView::Fitted(CameraView::Portrait)),
        "front" => Ok(angles(0.0, 0.0)),
        "right" => Ok(angles(90.0, 0.0)),
        "back" => Ok(angles(180.0, 0.0)),
        "left" => Ok(angles(270.0, 0.0)),
        "top" => Ok(angles(0.0, 90.0)),
        _ => {
            let shape = "one of portrait, front, back, left, right, top, scene, nor AZIMUTH,ELEVATION in degrees";
            pair(text, "--view", shape).map(|[a, e]| angles(a, e))
        }
    }
}

/// Parses the name of a background, or an sRGB colour `#rrggbb`; `auto` without the flag.
fn background(text: Option<&str>) -> Result<PreviewBackground, String> {
    let bad = |t: &str| format!("--background: \"{t}\" is not auto, sky, studio, none or a colour such as #f4f1ea");
    match text.unwrap_or("auto") {
        "auto" => Ok(PreviewBackground::Auto),
        "sky" => Ok(PreviewBackground::Sky),
        "studio" => Ok(PreviewBackground::Studio),
        "none" | "transparent" => Ok(PreviewBackground::Clear),
        t => {
            let hex = t.strip_prefix('#').filter(|h| h.len() == 6 && h.is_ascii()).ok_or_else(|| bad(t))?;
            let channel =
                |i: usize| hex.get(i..i + 2).and_then(|h| u8::from_str_radix(h, 16).ok()).map(|b| f32::from(b) / 255.0);
            match [channel(0), channel(2), channel(4)] {
                [Some(r), Some(g), Some(b)] => Ok(PreviewBackground::Color([r, g, b])),
                _ => Err(bad(t)),
            }
        }
    }
}
