//! Turntables and frame ranges as GIF, APNG or single pictures.

use std::io::Write;

use super::{PreviewOptions, PreviewScene};
use crate::bake::BakeContext;
use osier_base::Result;
use osier_base::convert::index;
use osier_preview::{
    ClipFormat, ClipTiming, ClipWriter, Picture, PreviewMaterials, RenderRequest, RenderScene, Subject, render,
    tile_count,
};
use osier_scene::{Camera, Frame};

use super::options::PreviewBackground;

/// Frame rate of a turntable, frames per second.
const TURNTABLE_FPS: (u32, u32) = (16, 1);

/// Contents of the pictures of a clip.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ClipContent<'f> {
    /// Views from a camera that moves once around the subject.
    Turntable {
        /// Number of pictures, 1 or more.
        steps: u32,
        /// Frame of the scene in all pictures; `None` for rest.
        frame: Option<u32>,
    },
    /// Frames of the scene's clip, in the order in which they are shown, from one camera.
    Frames(&'f [u32]),
}

/// A clip with its subject and fitted camera, ready to be rendered.
#[derive(Debug)]
pub struct PreviewClip<'a> {
    scene: &'a PreviewScene,
    options: &'a PreviewOptions,
    content: ClipContent<'a>,
    /// State of the scene to which the camera is fitted: the first frame of the clip, `None` for rest.
    first: Option<Frame>,
    subject: Subject,
    camera: Camera,
}

impl<'a> PreviewClip<'a> {
    /// Evaluates the first frame of a clip and fits the camera to it and to the scene at rest; for a turntable to the volume that
    /// the subject sweeps.
    /// # Errors
    /// `Range` for a frame outside of the scene's clip, P001 if nothing is visible, those of the simulation.
    /// # Examples
    /// ```
    /// use osier::bake::BakeContext;
    /// use osier::limits::Limits;
    /// use osier::preview::{ClipFormat, Quality};
    /// use osier::progress::Cancel;
    /// use osier::scene_preview::{ClipContent, PreviewClip, PreviewOptions, PreviewScene};
    /// use osier::source::{SourceOptions, find_scene};
    ///
    /// # fn main() -> osier::Result<()> {
    /// let (limits, cancel) = (Limits::default(), Cancel::default());
    /// let context = BakeContext::quiet(&limits, &cancel);
    /// let (recipe, _warnings) = osier::recipe::resolve(&find_scene("koch.l", &SourceOptions::default())?)?;
    /// let options = PreviewOptions { size: [32, 32], quality: Quality::Draft, ..PreviewOptions::default() };
    /// let scene = PreviewScene::of_recipe(recipe, options.quality, false, &context)?;
    /// let clip = PreviewClip::new(&scene, &options, ClipContent::Turntable { steps: 4, frame: None })?;
    /// let mut gif = Vec::new();
    /// clip.write(&mut gif, ClipFormat::Gif, &context)?;
    /// assert!(gif.starts_with(b"GIF89a"));
    /// # Ok(())
    /// # }
    /// ```
    pub fn new(scene: &'a PreviewScene, options: &'a PreviewOptions, content: ClipContent<'a>) -> Result<Self> {
        let first = match content {
            ClipContent::Turntable { frame, .. } => frame,
            ClipContent::Frames(numbers) => numbers.first().copied(),
        };
        let first = first.map(|n| scene.frame(n)).transpose()?;
        let subject = scene.subject(first.as_ref())?;
        let camera = match content {
            ClipContent::Turntable { .. } => options.camera(scene, &subject.spun()),
            // A plant that grows over the clip is small at first and complete at rest: both are framed.
            ClipContent::Frames(_) => match scene.subject(None) {
                Ok(rest) => options.camera(scene, &subject.clone().with(&rest)),
                Err(_) => options.camera(scene, &subject),
            },
        };
        Ok(Self { scene, options, content, first, subject, camera })
    }

    /// Number of pictures: steps of the turntable, or frames of the clip.
    pub fn len(&self) -> usize {
        match self.content {
            ClipContent::Turntable { steps, .. } => steps as usize,
            ClipContent::Frames(numbers) => numbers.len(),
        }
    }

    /// Whether the clip has no pictures, which happens only for an empty list of frames or 0 steps.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Renders all pictures and encodes them one after another.
    /// # Errors
    /// P003 if the format cannot hold the clip or the sink fails, those of the simulation, `Cancelled`.
    pub fn write(&self, sink: impl Write, format: ClipFormat, context: &BakeContext<'_>) -> Result<()> {
        let options = self.options;
        let fps = match self.content {
            ClipContent::Turntable { .. } => TURNTABLE_FPS,
            ClipContent::Frames(numbers) => frame_rate_of(self.scene.scene().clip.fps, numbers),
        };
        let timing = ClipTiming { frames: index(self.len(), "pictures of a clip")?, fps };
        let is_opaque = options.background != PreviewBackground::Clear;
        let mut writer = ClipWriter::new(sink, format, options.size, timing, is_opaque)?;
        self.draw(context, |_, picture| writer.frame(picture))?;
        writer.finish()
    }

    /// Renders all pictures and hands each to `take` with its number: that of its frame, or the step of a turntable from 1 on.
    /// # Errors
    /// Those of `take` and of the simulation, `Cancelled`.
    pub fn draw(&self, context: &BakeContext<'_>, mut take: impl FnMut(u32, &Picture) -> Result<()>) -> Result<()> {
        let (scene, options) = (self.scene.scene(), self.options);
        let materials = PreviewMaterials::new(scene, options.quality);
        let length = index(self.len(), "pictures of a clip")?;
        context.progress.stage("drawing frames", tile_count(options.size) * u64::from(length));
        match self.content {
            ClipContent::Turntable { steps, .. } => {
                // All views share one state of the scene, which is prepared once.
                let requests: Vec<RenderRequest> = (0..steps).map(|i| self.request(self.turned(i, steps))).collect();
                let world = RenderScene::for_requests(scene, self.first.as_ref(), &materials, &requests);
                for (number, request) in (1_u32..).zip(&requests) {
                    take(number, &render(&world, request, context.cancel, context.progress)?)?;
                }
            }
            ClipContent::Frames(numbers) => {
                // All frames have one camera, so that only the scene moves in the picture.
                let request = self.request(self.camera);
                for number in numbers {
                    let frame = self.scene.frame(*number)?;
                    let world = RenderScene::for_requests(scene, Some(&frame), &materials, &[request]);
                    take(*number, &render(&world, &request, context.cancel, context.progress)?)?;
                }
            }
        }
        Ok(())
    }

    fn request(&self, camera: Camera) -> RenderRequest {
        self.options.request(self.scene, &self.subject, camera)
    }

    /// The camera turned by `i` of `steps` parts of a full turn about the vertical axis of the subject.
    #[allow(clippy::cast_precision_loss, reason = "thousands of steps at most")]
    fn turned(&self, i: u32, steps: u32) -> Camera {
        let rotation = glam::Quat::from_rotation_y(std::f32::consts::TAU * i as f32 / steps.max(1) as f32);
        let axis = self.subject.bounds.center();
        let about_axis = |p: glam::Vec3| axis + rotation * (p - axis);
        Camera { eye: about_axis(self.camera.eye), target: about_axis(self.camera.target), ..self.camera }
    }
}

/// Frame rate of a selection of frames, as a fraction, so that the smallest step between two of them lasts as long as in the
/// scene. `fps`: frame rate of the scene.
fn frame_rate_of(fps: (u32, u32), numbers: &[u32]) -> (u32, u32) {
    let step = numbers.windows(2).map(|w| w[1].abs_diff(w[0])).min().unwrap_or(1).max(1);
    // Showing every n-th frame divides the rate by n.
    (fps.0, fps.1.saturating_mul(step))
}

#[cfg(test)]
mod tests {
    use super::frame_rate_of;

    #[test]
    fn skipped_frames_are_shown_longer() {
        assert_eq!(frame_rate_of((24, 1), &[1, 2, 3]), (24, 1));
        assert_eq!(frame_rate_of((24, 1), &[1, 5, 9]), (24, 4));
        assert_eq!(frame_rate_of((24, 1), &[7]), (24, 1));
        assert_eq!(frame_rate_of((24, 1), &[5, 3, 1]), (24, 2), "backwards");
    }
}
