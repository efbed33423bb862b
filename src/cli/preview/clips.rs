//! Turntables and frame ranges as GIF or APNG.

use super::super::Context;
use super::super::args::Preview;
use super::load::{Change, load};
use super::sheets::subject;
use super::shots::{Background, Wish, ending};
use super::{Done, Target};
use crate::bake::BakeContext;
use osier_base::Result;
use osier_preview::{ClipFormat, ClipTiming, ClipWriter, Looks, RenderRequest, Subject, World, render, tiles};
use osier_scene::Camera;

/// Frames per second of a turntable.
const TURNS: (u32, u32) = (16, 1);

/// Runs it.
pub fn run(context: &Context, args: &Preview, wish: &Wish, work: &BakeContext<'_>) -> Result<Done> {
    let format = match args.output.as_deref().map(ending).as_deref() {
        None | Some("gif") => ClipFormat::Gif,
        Some("png" | "apng") => ClipFormat::Apng,
        Some(other) => return Ok(Done::Refused(format!("a moving picture ends in .gif, .png or .apng, not .{other}"))),
    };
    let moving = args.turntable.is_none() || args.frame.is_some();
    let loaded = load(context, args, &args.source, wish.quality, moving, &Change::default(), work)?;
    context.console.report(&loaded.report);
    let clip = loaded.scene().clip;
    let numbers: Vec<Option<u32>> = match args.turntable {
        Some(_) => vec![args.frame],
        None => wish.frames.iter().map(|f| Some(*f)).collect(),
    };
    if let Some(n) = numbers.iter().flatten().find(|n| !(clip.start..=clip.end).contains(n)) {
        return Ok(Done::Refused(format!("frame {n} is outside the scene's {} to {}", clip.start, clip.end)));
    }
    if args.turntable.is_none() && !loaded.moves() {
        return Ok(Done::Refused(format!("nothing in \"{}\" moves; --turntable goes round it", loaded.name)));
    }
    let first = numbers.first().copied().flatten().map(|n| loaded.frame(n)).transpose()?;
    let own = subject(&loaded, first.as_ref())?;
    let around = if args.turntable.is_some() { own.spun() } else { own.clone() };
    let camera = wish.camera(&loaded, &around);
    let looks = Looks::new(loaded.scene(), wish.quality);
    let count = args.turntable.map_or(numbers.len(), |n| n as usize);
    let fps = if args.turntable.is_some() { TURNS } else { paced(clip.fps, &wish.frames) };
    let target = Target::new(context, args, &loaded.name, "gif")?;
    let Some(output) = target.folder.create(&target.name, "preview", None)? else {
        return Ok(Done::Kept { warned: false });
    };
    let length = u32::try_from(count).unwrap_or(u32::MAX);
    let opaque = wish.background != Background::Clear;
    let mut output = output;
    let mut writer = ClipWriter::new(&mut output, format, wish.size, ClipTiming { frames: length, fps }, opaque)?;
    work.progress.stage("drawing frames", tiles(wish.size) * count as u64);
    if args.turntable.is_some() {
        let shots: Vec<RenderRequest> =
            (0..length).map(|i| wish.shot(&loaded, &own, turned(camera, i, length, &own))).collect();
        let world = World::seen_by(loaded.scene(), first.as_ref(), &looks, &shots);
        for shot in &shots {
            writer.frame(&render(&world, shot, work.cancel, work.progress)?)?;
        }
    } else {
        let shot = wish.shot(&loaded, &own, camera);
        for n in numbers.iter().flatten() {
            let now = loaded.frame(*n)?;
            let world = World::seen_by(loaded.scene(), Some(&now), &looks, &[shot]);
            writer.frame(&render(&world, &shot, work.cancel, work.progress)?)?;
        }
    }
    writer.finish()?;
    output.commit()?;
    target.tell(context, wish.size, count)?;
    Ok(Done::Kept { warned: !loaded.report.diagnostics.is_empty() })
}

/// Frames per second when only every so many frames are shown.
fn paced(fps: (u32, u32), frames: &[u32]) -> (u32, u32) {
    let step = frames.windows(2).map(|w| w[1] - w[0]).min().unwrap_or(1).max(1);
    (fps.0, fps.1.saturating_mul(step))
}

/// The camera `i` of `n` steps round the subject's upright axis.
#[allow(clippy::cast_precision_loss, reason = "thousands of steps at most")]
fn turned(camera: Camera, i: u32, n: u32, subject: &Subject) -> Camera {
    let turn = glam::Quat::from_rotation_y(std::f32::consts::TAU * i as f32 / n.max(1) as f32);
    let axis = subject.bounds.center();
    let round = |p: glam::Vec3| axis + turn * (p - axis);
    Camera { eye: round(camera.eye), target: round(camera.target), ..camera }
}

#[cfg(test)]
mod tests {
    use super::paced;

    #[test]
    fn skipped_frames_are_shown_longer() {
        assert_eq!(paced((24, 1), &[1, 2, 3]), (24, 1));
        assert_eq!(paced((24, 1), &[1, 5, 9]), (24, 4));
        assert_eq!(paced((24, 1), &[7]), (24, 1));
    }
}
