//! What the flags of `osier preview` ask for.

use std::path::Path;

use super::super::Context;
use super::super::args::{Preview, QualityArg};
use super::super::numbers::{self, Sweep, sweep};
use super::load::Loaded;
use osier_base::units::{linear_from_srgb, radians_f32};
use osier_preview::{Backdrop, CameraView, Light, Quality, RenderRequest, Subject};
use osier_scene::{Camera, Frame};

/// Flags, read.
#[derive(Debug, Clone)]
pub struct Wish {
    pub size: [u32; 2],
    pub quality: Quality,
    /// `None`: the scene's own camera if it has one, else [`CameraView::Portrait`].
    pub view: Option<ViewWish>,
    /// Elevation and azimuth, degrees.
    pub sun: Option<[f32; 2]>,
    pub background: Background,
    pub seeds: Vec<u32>,
    pub sweeps: Vec<Sweep>,
    pub frames: Vec<u32>,
}

/// Where the camera stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ViewWish {
    /// The scene's own camera.
    Scene,
    /// Fitted.
    Fitted(CameraView),
}

/// What lies behind.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Background {
    /// The sky of scenes with ground or with something below the horizon, paper for the rest.
    Auto,
    Sky,
    Studio,
    Clear,
    /// sRGB shares.
    Color([f32; 3]),
}

impl Wish {
    /// # Errors
    /// What is wrong with a flag.
    pub fn new(context: &Context, args: &Preview) -> Result<Self, String> {
        let seeds = match &args.seeds {
            Some(list) => numbers::parse(list, CELLS).map_err(|e| format!("--seeds: {e}"))?,
            None => Vec::new(),
        };
        let frames = match &args.frames {
            Some(list) => numbers::parse(list, context.limits.get("frames")).map_err(|e| format!("--frames: {e}"))?,
            None => Vec::new(),
        };
        let sweeps = args.sweep.iter().map(|s| sweep(s)).collect::<Result<Vec<_>, _>>()?;
        if sweeps.len() > 2 || (sweeps.len() == 2 && !seeds.is_empty()) {
            return Err("a sheet has two directions: give two --sweep, or --seeds and one --sweep".into());
        }
        let sheet = !seeds.is_empty() || !sweeps.is_empty();
        let modes = [sheet, !frames.is_empty(), args.turntable.is_some(), args.compare.is_some()];
        if modes.iter().filter(|m| **m).count() > 1 {
            return Err("choose one of --seeds/--sweep, --frames, --turntable and --compare".into());
        }
        let moving = !frames.is_empty() || args.turntable.is_some();
        let size = match &args.size {
            Some(text) => size(text, context)?,
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
        let sun = args.sun.as_deref().map(|t| pair(t, "--sun", "ELEVATION,AZIMUTH in degrees")).transpose()?;
        let background = background(args.background.as_deref())?;
        Ok(Self { size, quality, view, sun, background, seeds, sweeps, frames })
    }

    pub fn is_sheet(&self) -> bool {
        !self.seeds.is_empty() || !self.sweeps.is_empty()
    }

    /// Width over height.
    #[allow(clippy::cast_precision_loss, reason = "sides are below 2^17")]
    pub fn aspect(&self) -> f32 {
        self.size[0] as f32 / self.size[1] as f32
    }

    /// The camera for something loaded.
    pub fn camera(&self, loaded: &Loaded, subject: &Subject) -> Camera {
        let vfov = loaded.scene().camera.vfov.min(radians_f32(60.0));
        match self.view {
            Some(ViewWish::Scene) => loaded.scene().camera,
            Some(ViewWish::Fitted(view)) => subject.camera(view, self.aspect(), vfov),
            None if loaded.has_camera => loaded.scene().camera,
            None => subject.camera(CameraView::Portrait, self.aspect(), vfov),
        }
    }

    /// The picture to take.
    pub fn shot(&self, loaded: &Loaded, subject: &Subject, camera: Camera) -> RenderRequest {
        let scene = loaded.scene();
        let mut sun = scene.sun;
        if let Some([elevation, azimuth]) = self.sun {
            (sun.elevation, sun.azimuth) = (radians_f32(elevation), radians_f32(azimuth));
        }
        // Trunks go on a little below the ground they stand on; what stands elsewhere stands on its lowest point.
        let (low, height) = (subject.bounds.min.y, subject.bounds.size().y);
        let level = if low > -0.25 * height && low < 0.1 * height { 0.0 } else { low };
        let floor = if subject.ground { None } else { Some(level) };
        let backdrop = match self.background {
            Background::Auto if subject.ground || scene.sky.below.is_some() => Backdrop::Sky,
            Background::Sky => Backdrop::Sky,
            Background::Auto | Background::Studio => Backdrop::Studio { floor },
            Background::Clear => Backdrop::Clear { floor },
            Background::Color(c) => Backdrop::Plain { color: c.map(linear_from_srgb), floor },
        };
        RenderRequest { camera, size: self.size, light: Light::new(&sun, &scene.sky), backdrop, seed: 0 }
    }
}

/// Cells of a sheet at most.
pub const CELLS: u64 = 1024;

/// The frame of a stage that is shown, or `None` for rest; with catkins in flight the first.
pub fn frame_of(loaded: &Loaded, number: Option<u32>) -> Result<Option<Frame>, String> {
    let clip = loaded.scene().clip;
    match number {
        // Catkins at rest are those that never flew.
        None if loaded.flies() => loaded.frame(clip.start).map(Some).map_err(|e| e.to_string()),
        None => Ok(None),
        Some(n) if (clip.start..=clip.end).contains(&n) => loaded.frame(n).map(Some).map_err(|e| e.to_string()),
        Some(n) => Err(format!("--frame: frame {n} is outside the scene's {} to {}", clip.start, clip.end)),
    }
}

fn size(text: &str, context: &Context) -> Result<[u32; 2], String> {
    let bad = || format!("--size: \"{text}\" is not WIDTHxHEIGHT, such as 800x600");
    let (w, h) = text.split_once(['x', 'X']).unwrap_or((text, text));
    let side = |t: &str| t.trim().parse::<u32>().ok().filter(|n| *n > 0).ok_or_else(bad);
    let size = [side(w)?, side(h)?];
    within(size.map(u64::from), context).map(|()| size)
}

/// Refuses pictures beyond the limits, before memory is spent on them.
pub fn within([width, height]: [u64; 2], context: &Context) -> Result<(), String> {
    let limits = &context.limits;
    limits.check("image-side", width.max(height), "a side of the picture, in pixels,").map_err(|e| e.to_string())?;
    let bytes = width.saturating_mul(height).saturating_mul(4);
    limits.check("image-bytes", bytes, "the picture, in bytes,").map_err(|e| e.to_string())
}

fn pair(text: &str, flag: &str, shape: &str) -> Result<[f32; 2], String> {
    let bad = || format!("{flag}: \"{text}\" is not {shape}, such as 40,120");
    let (a, b) = text.split_once(',').ok_or_else(bad)?;
    let number = |t: &str| t.trim().parse::<f32>().ok().filter(|v| v.is_finite() && v.abs() <= 3600.0).ok_or_else(bad);
    Ok([number(a)?, number(b)?])
}

fn view(text: &str) -> Result<ViewWish, String> {
    let angles = |azimuth, elevation| ViewWish::Fitted(CameraView::Angles { azimuth, elevation });
    match text {
        "scene" => Ok(ViewWish::Scene),
        "portrait" => Ok(ViewWish::Fitted(CameraView::Portrait)),
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

fn background(text: Option<&str>) -> Result<Background, String> {
    let bad = |t: &str| format!("--background: \"{t}\" is not auto, sky, studio, none or a colour such as #f4f1ea");
    match text.unwrap_or("auto") {
        "auto" => Ok(Background::Auto),
        "sky" => Ok(Background::Sky),
        "studio" => Ok(Background::Studio),
        "none" | "transparent" => Ok(Background::Clear),
        t => {
            let hex = t.strip_prefix('#').filter(|h| h.len() == 6 && h.is_ascii()).ok_or_else(|| bad(t))?;
            let channel =
                |i: usize| hex.get(i..i + 2).and_then(|h| u8::from_str_radix(h, 16).ok()).map(|b| f32::from(b) / 255.0);
            match [channel(0), channel(2), channel(4)] {
                [Some(r), Some(g), Some(b)] => Ok(Background::Color([r, g, b])),
                _ => Err(bad(t)),
            }
        }
    }
}

/// Ending of a file name, in lower case.
pub fn ending(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default()
}
