//! `main.pov`, which includes the file of the rendered frame, and `render.ini`, which renders the clip.

use std::collections::BTreeSet;

use super::material::string_literal;
use super::objects::write_union;
use super::space::PovSpace;
use super::{PovOptions, camera_light};
use crate::text::{Decimal, TextBuffer};
use crate::{GENERATOR, file_target::FileTarget};
use osier_scene::{AssetKind, Placement, Scene, scene_bounds};

/// The text of the scene file. `includes`: folder of the include files, with its `/`; `written`:
/// frames that have a file, ascending.
pub(super) fn main_file(scene: &Scene, space: PovSpace, includes: &str, written: &[u32]) -> TextBuffer {
    let mut text = TextBuffer::default();
    text.put(&format!("// {GENERATOR}, scene {}, seed {}, {}\n", scene.name, scene.seed, scene.hash));
    text.put("#version 3.7;\n");
    for name in ["common.inc", "prototypes.inc", "static.inc"] {
        text.put("#include ").put(&string_literal(&format!("{includes}{name}"))).put("\n");
    }
    declare_frame(&mut text, written);
    let phases: BTreeSet<u32> = scene.placements.iter().map(|p| p.phase).filter(|p| *p > 0).collect();
    for phase in phases.iter().filter(|_| !written.is_empty()) {
        // A frame's file declares identifiers of fixed names. Placements at a phase are therefore declared right after their
        // frame's file, before the file of the rendered frame declares the same names again.
        include_phase(&mut text, scene, includes, *phase, written);
        text.put(&format!("#declare OsWorld{phase} = "));
        let mut shown = TextBuffer::default();
        let count = write_placements(&mut shown, scene, space, |p| p.phase == *phase);
        write_union(&mut text, count, &shown, "");
    }
    if !written.is_empty() {
        text.put(&format!("#declare OsTag = str(OsFrame, -{}, 0);\n", scene.clip.digits()));
        write_include(&mut text, includes, "OsTag");
    }
    text.put("\n#macro OsWorld() ");
    let mut shown = TextBuffer::default();
    let mut count = write_placements(&mut shown, scene, space, |p| p.phase == 0 || written.is_empty());
    for phase in phases.iter().filter(|_| !written.is_empty()) {
        shown.put(&format!("  object {{ OsWorld{phase} }}\n"));
        count += 1;
    }
    write_union(&mut text, count, &shown, "");
    text.put("#end\nOsWorld()\n\n");
    let bounds = scene_bounds(scene, None);
    camera_light::write_camera(&mut text, space, &scene.camera);
    camera_light::write_sun(&mut text, space, &scene.sun, bounds);
    camera_light::write_sky(&mut text, space, &scene.sky, &scene.sun, bounds);
    let has_ground = scene.assets.iter().any(|a| a.kind == AssetKind::Terrain);
    camera_light::write_light_from_below(&mut text, space, &scene.sky, &scene.sun, bounds, has_ground);
    text
}

/// Writes an object for each placement that `fits` selects. Returns their number.
fn write_placements(text: &mut TextBuffer, scene: &Scene, space: PovSpace, fits: impl Fn(&Placement) -> bool) -> usize {
    let fitting: Vec<&Placement> = scene.placements.iter().filter(|p| fits(p)).collect();
    for placement in &fitting {
        text.put(&format!("  object {{ A_{}() ", placement.asset));
        space.write_matrix(text, &placement.transform);
        text.put(" } // ").put(&placement.name).put("\n");
    }
    fitting.len()
}

/// Writes the `#include` of a frame's file. `tag`: identifier that holds the number as a string.
fn write_include(text: &mut TextBuffer, includes: &str, tag: &str) {
    text.put("#include concat(").put(&string_literal(&format!("{includes}frames/frame.")));
    text.put(&format!(", {tag}, \".inc\")\n"));
}

/// Writes the `#include` of the frame that is `phase` frames later in the repeated clip. If only every n-th frame is written, it
/// is phase / n frames later among those.
fn include_phase(text: &mut TextBuffer, scene: &Scene, includes: &str, phase: u32, written: &[u32]) {
    // Written frames are first, first + step, ..: position in the list = (frame - first) / step, taken modulo their number.
    let (first, count) = (written.first().copied().unwrap_or(0), written.len() as u64);
    let last = written.last().copied().unwrap_or(first);
    let step = if count > 1 { (u64::from(last - first) / (count - 1)).max(1) } else { 1 };
    // Frames ahead as positions in the list of written frames; phases between two of them are rounded down.
    let ahead = (u64::from(phase) / step) % count.max(1);
    text.put(&format!("#declare OsLater = {first} + mod((OsFrame - {first}) / {step} + {ahead}, {count}) * {step};\n"));
    text.put(&format!("#declare OsLaterTag = str(OsLater, -{}, 0);\n", scene.clip.digits()));
    write_include(text, includes, "OsLaterTag");
}

/// Whether every frame from the first to the last has a file.
fn is_contiguous(written: &[u32]) -> bool {
    written.windows(2).all(|pair| pair[1] == pair[0] + 1)
}

/// Declares `OsFrame`, the frame that is rendered. A render without animation has frame number 0 and shows the first
/// frame; a clip that starts at 0 is therefore rendered as frames 1, 2, .. If only every n-th frame is written,
/// these frames are numbered 1, 2, ..
fn declare_frame(text: &mut TextBuffer, written: &[u32]) {
    let (Some(first), Some(last)) = (written.first(), written.last()) else { return };
    let shift = u32::from(*first == 0);
    text.put(&format!("#if (frame_number = 0) #declare OsFrame = {first}; "));
    match shift {
        0 => text.put("#else #declare OsFrame = frame_number; #end\n"),
        _ => text.put("#else #declare OsFrame = frame_number - 1; #end\n"),
    };
    if !is_contiguous(written) {
        let list: Vec<String> = written.iter().map(u32::to_string).collect();
        text.put(&format!("#declare OsWritten = array[{}] {{ {} }}\n", list.len(), list.join(", ")));
        let last = written.len() - 1;
        text.put(&format!("#declare OsFrame = OsWritten[max(0, min({last}, frame_number - 1))];\n"));
    } else {
        text.put(&format!("#declare OsFrame = max({first}, min({last}, OsFrame));\n"));
    }
}

/// The text of `render.ini`: image size, antialiasing and range of frames. `main`: name of the scene file;
/// `written`: frames that have a file.
pub(super) fn render_ini(scene: &Scene, options: &PovOptions, main: &str, written: &[u32]) -> TextBuffer {
    let mut text = TextBuffer::default();
    let library = match options.target {
        FileTarget::Bake => "..",
        FileTarget::Single(_) => ".",
    };
    let (width, height) = options.size;
    text.put(&format!("; {GENERATOR}\nInput_File_Name=\"{main}\"\nLibrary_Path=\"{library}\"\nOutput_File_Type=N\n"));
    text.put(&format!("Bits_Per_Color=16\nWidth={width}\nHeight={height}\n"));
    text.put("Antialias=On\nAntialias_Threshold=0.1\nSampling_Method=2\nAntialias_Depth=3\n");
    if let (Some(first), Some(last)) = (written.first(), written.last()) {
        // As in `declare_frame`: only frames that exist; with gaps between them, images are counted from 1.
        let (from, to) = if is_contiguous(written) {
            let shift = u64::from(*first == 0);
            (u64::from(*first) + shift, u64::from(*last) + shift)
        } else {
            (1, written.len() as u64)
        };
        let clock = |f: u32| Decimal(osier_base::math::narrow(scene.clip.seconds(f)));
        text.put(&format!("Initial_Frame={from}\nFinal_Frame={to}\n"));
        text.put(&format!("Initial_Clock={}\nFinal_Clock={}\n", clock(*first), clock(*last)));
    }
    text.put("Display=Off\nPause_When_Done=Off\n");
    text
}
