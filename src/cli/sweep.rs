//! `osier bake --sweep`: runs of a scene with several values and seeds, and their statistics as one table.

use std::path::Path;
use std::sync::Arc;

use serde_json::{Value, json};

use super::Context;
use super::args::Bake;
use super::numbers::{self, swept_keys};
use super::progress::ProgressDisplay;
use crate::bake::motion::{FrameTime, table_rows};
use crate::bake::scene::reduction::with_small_maps;
use crate::bake::{BakeContext, scene};
use crate::recipe::{Recipe, resolve};
use crate::source::find_scene;
use osier_base::diagnostic::{Report, Severity};
use osier_base::files::{Folder, WriteOptions, check_writable, read_below};
use osier_base::progress::{Progress as _, Silent};
use osier_base::{Error, Result};
use osier_export::stats::{MapStatistics, MissingRun, Run, Spread, Sweep, Whole};
use osier_export::{VERSION, Warning};
use osier_scene::{Scene, largest};

/// Largest number of runs of a sweep, each of which simulates the whole clip.
const MAX_RUNS: u64 = 1000;

struct SweepPlan {
    /// Paths of the keys that vary, in the order of the flags.
    keys: Vec<String>,
    runs: Vec<PlannedRun>,
}

struct PlannedRun {
    /// Values as text, parallel to `SweepPlan::keys`.
    values: Vec<String>,
    /// Seed that replaces the scene's; `None` without `--seeds`.
    seed: Option<u64>,
}

/// Runs `osier bake --sweep`: resolves all scenes, simulates them in turn and writes the table. The result is the exit code.
pub fn run(context: &Context, args: &Bake) -> Result<u8> {
    let SweepPlan { keys, runs } = match plan(args) {
        Ok(plan) => plan,
        Err(why) => {
            context.console.complain(&why);
            return Ok(2);
        }
    };
    // All recipes are resolved before the first run, so that an error in a late value costs no simulation. Runs have most
    // warnings in common, of which each is printed once.
    let mut recipes = Vec::new();
    let mut of_scenes = Report::default();
    for planned in &runs {
        let mut request = find_scene(args.scene.as_deref().unwrap_or("showcase"), &context.sources)?;
        request.sweep.extend(keys.iter().zip(&planned.values).map(|(k, v)| format!("{k}={v}")));
        request.seed = planned.seed.or(request.seed);
        let (recipe, report) = resolve(&request)?;
        of_scenes.extend(report);
        recipes.push(recipe);
    }
    context.console.report(&of_scenes);
    let mut warned = !of_scenes.diagnostics.is_empty();
    let Some(first) = recipes.first() else { return Ok(0) };
    if first.flight.is_none() {
        let name = &first.name;
        let (flag, single) = if args.sweep.is_empty() { ("--seeds", "--seed") } else { ("--sweep", "--set") };
        context.console.complain(&format!(
            "{flag}: \"{name}\" has no [flight], whose statistics such a bake compares; use a scene with one, such as catkins-wall. \
             For files of each value run `osier bake` or `osier grow` once for each, with {single} and an -o of its own; \
             `osier preview {flag}` draws them"
        ));
        return Ok(2);
    }
    let root = args.output.clone().unwrap_or_else(|| Path::new("out").join(format!("{}-sweep", first.name)));
    let frames = recipes.iter().map(|r| r.clip.len() as u64).sum::<u64>();
    if context.common.dry_run {
        let (count, length) = (counted(recipes.len() as u64, "run"), counted(frames, "frame"));
        let text = format!("{}  {count}, {length} in all\n", root.display());
        let value = json!({ "target": root.display().to_string(), "runs": recipes.len(), "frames": frames });
        context.console.result(&if context.console.json { format!("{value:#}\n") } else { text })?;
        return Ok(context.strict(warned));
    }
    // The runs may take hours, and their table is written after the last one.
    let hashes: Vec<&str> = recipes.iter().map(|r| r.hash.as_str()).collect();
    check_target(args, &root, &hashes, !keys.is_empty())?;
    let display = ProgressDisplay::new(&context.console);
    check_choices(context, &keys, &recipes, &runs, &display)?;
    display.stage("running", frames);
    let mut all = Sweep { title: first.general.title.clone(), keys, ..Sweep::default() };
    let (mut of_runs, mut run_warnings) = (Report::default(), Vec::new());
    let mut ended_by: Option<Error> = None;
    for (recipe, planned) in recipes.iter().zip(&runs) {
        let simulated = match simulate(context, recipe, &display) {
            Ok(simulated) => simulated,
            // A signal or an error ends the sweep; the runs before it are kept.
            Err(e) => {
                ended_by = Some(of_run(e, &all.keys, planned));
                break;
            }
        };
        let SimulatedRun { scene, whole, maps, report, measured } = simulated;
        of_runs.extend(report);
        // The numbers in these messages differ from run to run: the first of each code is printed, with its run.
        for Warning { code, message } in measured {
            if run_warnings.iter().all(|earlier: &Warning| earlier.code != code) {
                let run = run_name(&all.keys, planned);
                let message = format!("{message} (first in the run with {run}; sweep.csv has the numbers of all runs)");
                run_warnings.push(Warning { code, message });
            }
        }
        // Runs with the same values are consecutive; their statistics begin with the first.
        if all.runs.last().is_none_or(|last| last.values != planned.values) {
            all.maps.push(scene.fields.iter().cloned().map(MapStatistics::new).collect());
        }
        for (statistics, values) in all.maps.last_mut().into_iter().flatten().zip(&maps) {
            statistics.add(values);
        }
        // Values may add columns: a wavy ground is a solid of its own.
        let outcome =
            scene.tables.iter().flat_map(|t| t.outcome.iter().filter_map(|c| Some(t.columns.get(*c)?.0.clone())));
        for name in outcome {
            if !all.outcome.contains(&name) {
                all.outcome.push(name);
            }
        }
        let values = planned.values.clone();
        all.runs.push(Run { values, seed: recipe.general.seed, hash: recipe.hash.clone(), whole });
    }
    display.done();
    context.console.report(&of_runs);
    run_warnings.iter().for_each(|w| context.console.warning(w.code, &w.message));
    warned |= !of_runs.diagnostics.is_empty() || !run_warnings.is_empty();
    if let Some(error) = ended_by {
        let missing = recipes.iter().zip(&runs).skip(all.runs.len());
        let of_planned = |(recipe, run): (&Recipe, &PlannedRun)| MissingRun {
            values: run.values.clone(),
            seed: recipe.general.seed,
        };
        all.missing = missing.map(of_planned).collect();
        keep_part(context, args, &root, &all, &runs);
        return Err(error);
    }
    write(args, &root, &all)?;
    print_means(context, &root, &all)?;
    Ok(context.strict(warned))
}

/// All combinations of values and seeds; seeds vary fastest and the first key slowest.
/// # Errors
/// A message for a flag that cannot be read or that does not go with a sweep.
fn plan(args: &Bake) -> std::result::Result<SweepPlan, String> {
    if args.formats.is_some() || args.frames.is_some() {
        return Err("--sweep and --seeds write one table and its plot: leave out --formats and --frames".into());
    }
    let sweeps = swept_keys(&args.sweep)?;
    let seeds = match &args.seeds {
        Some(list) => {
            let seeds =
                numbers::number_list(list, MAX_RUNS, "start several sweeps").map_err(|e| format!("--seeds: {e}"))?;
            seeds.into_iter().map(Some).collect()
        }
        None => vec![None],
    };
    // Saturating, since the product of many long axes can exceed 64 bits.
    let count = sweeps.iter().fold(seeds.len() as u64, |n, s| n.saturating_mul(s.values.len() as u64));
    if count > MAX_RUNS {
        return Err(format!("--sweep: {count} runs, more than {MAX_RUNS}; take fewer values or seeds"));
    }
    let mut combinations: Vec<Vec<String>> = vec![Vec::new()];
    for s in &sweeps {
        // Every combination so far is extended by each value of this key; the first one is empty.
        let with =
            |c: &Vec<String>| s.values.iter().map(|v| [&c[..], std::slice::from_ref(v)].concat()).collect::<Vec<_>>();
        combinations = combinations.iter().flat_map(with).collect();
    }
    // Seeds vary fastest: runs with the same values are consecutive, on which `run` relies.
    let with_seeds = |c: &Vec<String>| -> Vec<PlannedRun> {
        seeds.iter().map(|seed| PlannedRun { values: c.clone(), seed: *seed }).collect()
    };
    let runs = combinations.iter().flat_map(with_seeds).collect();
    Ok(SweepPlan { keys: sweeps.into_iter().map(|s| s.key).collect(), runs })
}

/// Assembles the scene of each choice of values as for an estimate, so that a fault which depends on a late value, such as a solid
/// across a side of the lattice wind in one of its directions, costs no simulation.
/// # Errors
/// Those of the assembly, with the values of the run.
fn check_choices(
    context: &Context,
    keys: &[String],
    recipes: &[Recipe],
    runs: &[PlannedRun],
    display: &ProgressDisplay,
) -> Result<()> {
    let work = BakeContext { limits: &context.limits, cancel: &context.cancel, progress: &Silent, cache: None };
    display.stage("checking", recipes.len() as u64);
    let mut checked: Option<&[String]> = None;
    for (recipe, planned) in recipes.iter().zip(runs) {
        // Runs with the same values are consecutive; they differ in their seeds.
        if checked != Some(planned.values.as_slice()) {
            checked = Some(planned.values.as_slice());
            scene::assemble_for_estimate(recipe, scene::SceneOptions::BAKE, &work)
                .map_err(|e| of_run(e, keys, planned))?;
        }
        display.advance(1);
    }
    Ok(())
}

/// Values and seed of a run for messages: `wind.speed=4, seed 2`.
fn run_name(keys: &[String], run: &PlannedRun) -> String {
    let values = keys.iter().zip(&run.values).map(|(key, value)| format!("{key}={value}"));
    values.chain(run.seed.map(|seed| format!("seed {seed}"))).collect::<Vec<_>>().join(", ")
}

/// Adds the values of a run to the message of a fault that its scene shows.
fn of_run(error: Error, keys: &[String], run: &PlannedRun) -> Error {
    match error {
        Error::Input(mut report) => {
            let values = run_name(keys, run);
            for d in report.diagnostics.iter_mut().filter(|d| d.severity == Severity::Error) {
                d.message = format!("{}; in the run with {values}", d.message);
            }
            Error::Input(report)
        }
        other => other,
    }
}

/// Results that a sweep keeps of one run.
struct SimulatedRun {
    scene: Arc<Scene>,
    /// Summary of the first table over the clip.
    whole: Whole,
    /// Texels of the scene's deposition maps at the last frame.
    maps: Vec<Vec<f32>>,
    /// Warnings of growth and wind.
    report: Report,
    /// Warnings of the simulation, by the largest values of the first table.
    measured: Vec<Warning>,
}

/// Simulates the clip of one run and summarises its statistics.
fn simulate(context: &Context, recipe: &Recipe, display: &ProgressDisplay) -> Result<SimulatedRun> {
    // The context is silent, since one bar counts the frames of all runs.
    let work = BakeContext { limits: &context.limits, cancel: &context.cancel, progress: &Silent, cache: None };
    // Maps are not written and change no number; drawing them would take longer than many a flight. Those of wet leaves have sizes of
    // their own, so that scenes with rain stay as they are.
    let small = if recipe.rain.is_none() { Some(with_small_maps(recipe)) } else { None };
    let built = scene::assemble_scene(small.as_ref().unwrap_or(recipe), scene::SceneOptions::default(), &work)?;
    let (stage, report) = (built.animated, built.report);
    let mut all = Vec::new();
    // Each frame adds one row; nothing else is kept of the frames.
    for number in recipe.clip.start..=recipe.clip.end {
        context.cancel.check()?;
        let row = table_rows(&stage.scene, &stage.motions, number)?.into_iter().next().unwrap_or_default();
        all.push((number, row));
        display.advance(1);
    }
    let whole = stage.scene.tables.first().map(|table| Whole::of(table, &all)).unwrap_or_default();
    let largest_row = largest(all.iter().map(|(_, row)| row.as_slice()));
    let measured = stage.scene.tables.first().map(|table| table.warnings(&largest_row)).unwrap_or_default();
    let measured = measured.into_iter().map(|(code, message)| Warning { code, message }).collect();
    // Maps are those of the last frame, like the last row of the table.
    let last = FrameTime::of_frame(&stage.scene, recipe.clip.end).index();
    let maps = stage.motions.iter().flatten().map(|m| m.fields(last)).collect::<Result<Vec<_>>>()?.concat();
    Ok(SimulatedRun { scene: stage.scene, whole, maps, report, measured })
}

/// Refuses a folder that cannot be written, or in which a file of the sweep would overwrite one that osier did not write.
/// # Errors
/// `Io`, `Foreign`.
fn check_target(args: &Bake, root: &Path, hashes: &[&str], has_plot: bool) -> Result<()> {
    check_writable(root)?;
    if !root.is_dir() {
        return Ok(());
    }
    let folder = open(args, root, hashes)?;
    let mut files = ["sweep.csv", "means.csv", "sweep.json"].into_iter().chain(has_plot.then_some("sweep.svg"));
    files.try_for_each(|name| folder.check_name(name))
}

/// Opens the folder of a sweep; `hashes`: of the scenes of all runs. A signal ends the simulation and not the writing of its results:
/// these few files are written within the time that it leaves.
fn open(args: &Bake, root: &Path, hashes: &[&str]) -> Result<Folder> {
    let options = WriteOptions {
        // The key of the folder covers all runs: one changed value makes another sweep.
        key: format!("{VERSION} {}", hashes.join(" ")),
        force: args.force,
        ..WriteOptions::default()
    };
    Folder::open_with(root, options)
}

fn write(args: &Bake, root: &Path, all: &Sweep) -> Result<()> {
    let hashes: Vec<&str> = all.runs.iter().map(|r| r.hash.as_str()).collect();
    let folder = open(args, root, &hashes)?;
    all.write(&folder)?;
    folder.finish()
}

/// Writes the tables of the finished runs of a sweep that a signal or an error has ended, and tells which they are and which are
/// missing. `runs`: all that were planned. A failure is told, too; the error that ended the sweep counts more.
fn keep_part(context: &Context, args: &Bake, root: &Path, part: &Sweep, runs: &[PlannedRun]) {
    let (done, folder) = (part.runs.len(), root.display());
    let Some((last, next)) = done.checked_sub(1).and_then(|i| runs.get(i)).zip(runs.get(done)) else {
        return context.console.note("no run of the sweep was finished, so that nothing is kept");
    };
    if holds_runs(context, root, part) {
        return context.console.note(&format!("the finished runs are already in the tables of \"{folder}\""));
    }
    let text = match write(args, root, part) {
        Ok(()) => format!(
            "kept in \"{folder}\": {done} of {} runs, to the one with {}; missing are those from {} on, which sweep.json lists: \
             run them with an -o of their own",
            runs.len(),
            run_name(&part.keys, last),
            run_name(&part.keys, next),
        ),
        Err(e) => format!("the finished runs of the sweep are not kept: {e}"),
    };
    context.console.note(&text);
}

/// Whether the tables of an earlier sweep in a folder have all runs of this one, whose part is then not written over them.
fn holds_runs(context: &Context, root: &Path, part: &Sweep) -> bool {
    let Ok(Some(bytes)) = read_below(root, "sweep.json", context.limits.get("json-bytes"), "") else { return false };
    let Ok(earlier) = serde_json::from_slice::<Value>(&bytes) else { return false };
    let runs = earlier["runs"].as_array().map(Vec::as_slice).unwrap_or_default();
    part.runs.iter().all(|run| runs.iter().any(|r| r["scene"] == run.hash.as_str()))
}

/// Prints the means over the seeds as a table; as JSON only the folder and the numbers of runs and of choices.
fn print_means(context: &Context, root: &Path, all: &Sweep) -> Result<()> {
    let means = all.means();
    if context.console.json {
        let value = json!({ "folder": root.display().to_string(), "runs": all.runs.len(), "choices": means.len() });
        return context.console.result(&format!("{value:#}\n"));
    }
    if context.console.quiet {
        return Ok(());
    }
    let heads = all.keys.iter().cloned().chain(["runs".into()]).chain(all.outcome.iter().cloned());
    let mut lines: Vec<Vec<String>> = vec![heads.collect()];
    lines.extend(means.iter().map(|m| {
        let with_spread = |s: &Spread| {
            // One value has no deviation.
            s.deviation.map_or_else(|| rounded(s.mean), |d| format!("{} ± {}", rounded(s.mean), rounded(d)))
        };
        let numbers = m.outcome.iter().map(|s| s.as_ref().map_or_else(|| "-".to_owned(), with_spread));
        m.values.iter().cloned().chain([m.count.to_string()]).chain(numbers).collect()
    }));
    // Columns are right-aligned to their widest cell, headings included.
    let columns = lines.first().map_or(0, Vec::len);
    let widths: Vec<usize> =
        (0..columns).map(|i| lines.iter().map(|l| l[i].chars().count()).max().unwrap_or(0)).collect();
    let files = ["sweep.csv", "means.csv", "sweep.json"].into_iter();
    // Without a key there is no plot over it.
    let more = [("sweep.svg", !all.keys.is_empty()), ("maps/", all.maps.iter().any(|maps| !maps.is_empty()))];
    let files: Vec<&str> = files.chain(more.iter().filter(|(_, is_there)| *is_there).map(|(name, _)| *name)).collect();
    let runs = counted(all.runs.len() as u64, "run");
    let mut text = format!("{}  {runs}: {}\n", root.display(), files.join(", "));
    for line in &lines {
        let cells: Vec<String> = line.iter().zip(&widths).map(|(cell, w)| format!("{cell:>w$}")).collect();
        text += &format!("  {}\n", cells.join("  "));
    }
    context.console.result(&text)
}

/// A number with what it counts: "1 run", "4 runs".
fn counted(n: u64, what: &str) -> String {
    format!("{n} {what}{}", if n == 1 { "" } else { "s" })
}

/// A number of the printed table: with one decimal if it is less than a hundred and not whole, as means over few seeds are.
fn rounded(value: f64) -> String {
    let is_whole = value.abs() >= 100.0 || (value - value.round()).abs() < 0.05;
    if is_whole { format!("{value:.0}") } else { format!("{value:.1}") }
}

#[cfg(test)]
mod tests {
    use super::{counted, rounded};

    #[test]
    fn one_run_is_told_in_the_singular() {
        assert_eq!([counted(1, "run"), counted(4, "run")], ["1 run", "4 runs"]);
    }

    #[test]
    fn small_means_keep_a_decimal() {
        let shown = [0.0, 0.5, 0.707, 2.0, 99.97, 123.4, 0.96].map(rounded);
        assert_eq!(shown, ["0", "0.5", "0.7", "2", "100", "123", "1"]);
    }
}
