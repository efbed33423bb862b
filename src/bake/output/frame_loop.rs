//! Frames to exporters.

use crate::bake::BakeContext;
use crate::bake::motion::evaluate_frame;
use crate::bake::scene::animated::AnimatedScene;
use osier_base::{Error, Result};
use osier_export::{Exporter, Warning};
use osier_scene::{Frame, check_frame, check_scene, largest};

/// An exporter with the name shown for it.
pub struct NamedExporter {
    /// Its format.
    pub name: &'static str,
    /// It.
    pub exporter: Box<dyn Exporter>,
}

/// Writes the frames `numbers` (none: a still asset) of a stage by all writers. Each frame goes to the writers in
/// parallel while the next is computed, so at most two frames are in memory.
/// # Errors
/// The first failure in the order of the writers; `Cancelled`.
pub fn write_frames(
    animated: &AnimatedScene,
    writers: &mut [NamedExporter],
    numbers: &[u32],
    context: &BakeContext<'_>,
) -> Result<Vec<Warning>> {
    check_scene(&animated.scene)?;
    context.progress.stage("writing", writers.len() as u64);
    for_each_exporter(writers, |w| w.begin(&animated.scene))?;
    let mut most: Vec<Vec<f64>> = vec![Vec::new(); animated.scene.tables.len()];
    let phased: Vec<u32> =
        numbers.iter().copied().filter(|n| writers.iter().any(|w| w.exporter.wants_phases(*n))).collect();
    let make = |n: u32| {
        let made = evaluate_frame(&animated.scene, &animated.motions, n, phased.contains(&n))?;
        let air = animated.wind.as_ref().map(|air| air.at(&animated.scene, n)).transpose()?;
        Ok::<_, Error>(Frame { air: air.unwrap_or_default(), ..made })
    };
    if let Some((first, rest)) = numbers.split_first() {
        context.progress.stage("writing frames", numbers.len() as u64);
        let mut current: Frame = make(*first)?;
        for next in rest.iter().map(Some).chain([None]) {
            context.cancel.check()?;
            check_frame(&animated.scene, &current)?;
            for (most, row) in most.iter_mut().zip(&current.rows) {
                *most = largest([&**most, row]);
            }
            let (done, following) =
                osier_base::par::join(|| for_each_exporter(writers, |w| w.frame(&current)), || next.map(|n| make(*n)));
            done?;
            context.progress.advance(1);
            if let Some(f) = following {
                current = f?;
            }
        }
    }
    context.cancel.check()?;
    context.progress.stage("finishing", writers.len() as u64);
    let summaries = for_each_exporter(writers, Exporter::finish)?;
    let measured = animated.scene.tables.iter().zip(&most).flat_map(|(table, most)| table.warnings(most));
    let measured = measured.map(|(code, message)| Warning { code, message });
    Ok(measured.chain(summaries.into_iter().flat_map(|s| s.warnings)).collect())
}

/// Calls every exporter, in parallel.
fn for_each_exporter<R: Send>(
    writers: &mut [NamedExporter],
    call: impl Fn(&mut (dyn Exporter + 'static)) -> Result<R> + Sync + Send,
) -> Result<Vec<R>> {
    let mut jobs: Vec<(&mut NamedExporter, Option<Result<R>>)> = writers.iter_mut().map(|w| (w, None)).collect();
    osier_base::par::par_each(&mut jobs, |(writer, result)| *result = Some(call(writer.exporter.as_mut())));
    jobs.into_iter().filter_map(|(_, result)| result).collect()
}
