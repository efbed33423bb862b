//! The frame loop: evaluates frames and hands each to all exporters.

use std::collections::BTreeSet;

use crate::bake::BakeContext;
use crate::bake::motion::evaluate_frame;
use crate::bake::scene::animated::AnimatedScene;
use crate::bake::wind::output::SampledWind;
use osier_base::{Error, Result};
use osier_export::{Exporter, Warning};
use osier_scene::{Frame, check_frame, check_scene, largest};

/// An exporter with the name of its format.
pub struct NamedExporter {
    /// The word of its format, or `wind`; it appears in errors and progress.
    pub name: &'static str,
    /// The exporter; the frame loop calls `begin`, `frame` and `finish` on it.
    pub exporter: Box<dyn Exporter>,
}

/// Writes the frames `numbers` of a scene (none: a still scene) with all exporters; returns their warnings. The exporters write
/// a frame in parallel while the next one is evaluated, so that at most two frames are in memory.
/// # Errors
/// The first failure in the order of the exporters; `Cancelled`.
pub fn write_frames(
    animated: &AnimatedScene,
    exporters: &mut [NamedExporter],
    numbers: &[u32],
    context: &BakeContext<'_>,
) -> Result<Vec<Warning>> {
    check_scene(&animated.scene)?;
    context.progress.stage("writing", exporters.len() as u64);
    // Static data: geometry, materials, rest poses.
    for_each_exporter(exporters, |e| e.begin(&animated.scene))?;
    // Warnings at the end are derived from the largest value of every table column.
    let mut largest_rows: Vec<Vec<f64>> = vec![Vec::new(); animated.scene.tables.len()];
    let phased: Vec<u32> =
        numbers.iter().copied().filter(|n| exporters.iter().any(|e| e.exporter.wants_phases(*n))).collect();
    let evaluate = |n: u32| {
        let frame = evaluate_frame(&animated.scene, &animated.motions, n, phased.contains(&n))?;
        let wind = animated.wind.as_ref().map(|wind| wind.sample_frame(&animated.scene, n)).transpose()?;
        let SampledWind { air, volume } = wind.unwrap_or_default();
        // The wind's volume comes first, as in the scene.
        let volumes = volume.into_iter().chain(frame.volumes).collect();
        Ok::<_, Error>(Frame { air, volumes, ..frame })
    };
    if let Some((first, rest)) = numbers.split_first() {
        context.progress.stage("writing frames", numbers.len() as u64);
        let mut current: Frame = evaluate(*first)?;
        for next in rest.iter().map(Some).chain([None]) {
            context.cancel.check()?;
            check_frame(&animated.scene, &current)?;
            for (largest_row, row) in largest_rows.iter_mut().zip(&current.rows) {
                *largest_row = largest([&**largest_row, row]);
            }
            // Overlap writing this frame with evaluating the next. A failed export is reported before a failed frame.
            let (written, following) = osier_base::par::join(
                || for_each_exporter(exporters, |e| e.frame(&current)),
                || next.map(|n| evaluate(*n)),
            );
            written?;
            context.progress.advance(1);
            if let Some(f) = following {
                current = f?;
            }
        }
    }
    context.cancel.check()?;
    context.progress.stage("finishing", exporters.len() as u64);
    let summaries = for_each_exporter(exporters, Exporter::finish)?;
    let measured = animated.scene.tables.iter().zip(&largest_rows).flat_map(|(table, row)| table.warnings(row));
    let measured = measured.map(|(code, message)| Warning { code, message });
    // The exporters of several profiles of a format find the same of a scene: each message is kept once, at its first place.
    let mut known = BTreeSet::new();
    let all = measured.chain(summaries.into_iter().flat_map(|s| s.warnings));
    Ok(all.filter(|w| known.insert((w.code, w.message.clone()))).collect())
}

/// Calls all exporters in parallel; returns their results in order, or the error of the first exporter that failed.
fn for_each_exporter<R: Send>(
    exporters: &mut [NamedExporter],
    call: impl Fn(&mut (dyn Exporter + 'static)) -> Result<R> + Sync + Send,
) -> Result<Vec<R>> {
    let mut jobs: Vec<(&mut NamedExporter, Option<Result<R>>)> = exporters.iter_mut().map(|e| (e, None)).collect();
    osier_base::par::par_each(&mut jobs, |(named, result)| *result = Some(call(named.exporter.as_mut())));
    jobs.into_iter().filter_map(|(_, result)| result).collect()
}
