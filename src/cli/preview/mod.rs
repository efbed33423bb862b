//! `osier preview`: pictures with no other program.

mod clips;
mod layered;
mod load;
mod sheets;
mod shots;

use std::path::{Path, PathBuf};

use serde_json::json;

use super::Context;
use super::args::Preview;
use super::progress::Show;
use crate::bake::BakeContext;
use osier_base::Result;
use osier_base::files::{Folder, WriteOptions};
use osier_export::GENERATOR;
use osier_preview::{Picture, Quality};
use osier_scene::Scene;

/// Runs it.
pub fn run(context: &Context, args: &Preview) -> Result<u8> {
    let wish = match shots::Wish::new(context, args) {
        Ok(wish) => wish,
        Err(why) => {
            context.console.complain(&why);
            return Ok(2);
        }
    };
    if let Some((recipe, report)) = layered::of(context, args)? {
        context.console.report(&report);
        return layered::run(context, args, recipe, &wish, !report.diagnostics.is_empty());
    }
    let show = Show::new(&context.console);
    let work = BakeContext { limits: &context.limits, cancel: &context.cancel, progress: &show, cache: None };
    let done = if wish.is_sheet() {
        sheets::run(context, args, &wish, &work)
    } else if !wish.frames.is_empty() || args.turntable.is_some() {
        clips::run(context, args, &wish, &work)
    } else {
        sheets::single(context, args, &wish, &work)
    };
    show.done();
    match done? {
        Done::Kept { warned } => Ok(context.strict(warned)),
        Done::Refused(why) => {
            context.console.complain(&why);
            Ok(2)
        }
    }
}

/// How a run ends.
enum Done {
    /// The file is there.
    Kept { warned: bool },
    /// A flag does not fit the source.
    Refused(String),
}

/// Where a result goes and what is said about it.
struct Target {
    folder: Folder,
    name: String,
    path: PathBuf,
}

impl Target {
    /// `out/NAME.ENDING` unless `-o` says otherwise.
    fn new(context: &Context, args: &Preview, name: &str, ending: &str) -> Result<Self> {
        let path = args.output.clone().unwrap_or_else(|| Path::new("out").join(format!("{name}.{ending}")));
        let parent = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let options = WriteOptions { force: args.force, cancel: context.cancel.clone(), ..WriteOptions::default() };
        let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        Ok(Self { folder: Folder::plain(parent, options)?, name, path })
    }

    /// Writes a picture and prints its path.
    fn write_picture(
        &self,
        context: &Context,
        picture: &Picture,
        quality: Quality,
        scene: &Scene,
        about: &str,
    ) -> Result<()> {
        let made = format!("scene {}, seed {}", scene.hash, scene.seed);
        let notes = [("Software", GENERATOR.to_owned()), ("Title", about.to_owned()), ("Source", made)];
        self.folder.write(&self.name, "preview", &picture.png(&notes, quality.hurries())?)?;
        self.tell(context, [picture.width, picture.height], 1)
    }

    /// Names the finished file.
    fn tell(&self, context: &Context, [width, height]: [u32; 2], frames: usize) -> Result<()> {
        self.folder.finish()?;
        if context.console.json {
            let row = |f: &osier_base::files::FileRecord| json!({ "path": self.path.display().to_string(), "kind": f.kind, "bytes": f.bytes, "blake3": f.blake3 });
            let files: Vec<_> = self.folder.files().iter().map(row).collect();
            let value = json!({ "files": files, "width": width, "height": height, "frames": frames });
            return context.console.result(&format!("{value:#}\n"));
        }
        if context.console.quiet {
            return Ok(());
        }
        let frames = if frames > 1 { format!(", {frames} frames") } else { String::new() };
        context.console.result(&format!("{}  {width} x {height}{frames}\n", self.path.display()))
    }
}
