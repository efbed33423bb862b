//! `osier check`.

use serde_json::{Value, json};

use super::args::Check;
use super::knobs::Knob;
use super::progress::Show;
use super::{Context, knobs, report, source};
use crate::bake::output::single_file::refuse_invisible;
use crate::bake::{BakeContext, BakeEstimate, scene};
use crate::recipe::{Growth, resolve};
use osier_base::diagnostic::{Report, Severity, render_json};
use osier_base::{Error, Result};

/// What is known about one file.
struct Found {
    report: Report,
    counts: Option<BakeEstimate>,
    /// What its grammars leave to be set.
    knobs: Vec<Knob>,
    /// Why it could not be looked at.
    failed: Option<Error>,
}

/// Runs it. Every file is looked at, whatever the others hold.
pub fn run(context: &Context, args: &Check) -> Result<u8> {
    let mut values: Vec<Value> = Vec::new();
    let (mut errors, mut warnings, mut code) = (0, 0, 0);
    for file in &args.files {
        let found = look(context, file);
        context.cancel.check()?;
        let bad = found.report.diagnostics.iter().filter(|d| d.severity == Severity::Error).count();
        errors += bad;
        warnings += found.report.diagnostics.len() - bad;
        if found.report.has_errors() {
            code = code.max(1);
        }
        if let Some(e) = &found.failed {
            code = code.max(e.exit_code());
            errors += 1;
        }
        if context.console.json {
            values.push(json!({
                "file": file, "diagnostics": render_json(&found.report),
                "error": found.failed.as_ref().map(ToString::to_string),
                "would_make": found.counts.as_ref().map(report::as_json),
                "knobs": knobs::as_json(&found.knobs),
            }));
            continue;
        }
        context.console.report(&found.report);
        match (&found.counts, &found.failed) {
            (_, Some(e)) => context.console.error(e),
            (Some(c), _) => {
                let knobs = knobs::as_text(&found.knobs);
                context.console.result(&format!("{file}\n{}{knobs}", report::as_text(c)))?;
            }
            _ => {}
        }
    }
    if context.console.json {
        context.console.result(&format!("{:#}\n", Value::Array(values)))?;
    } else if errors + warnings > 0 {
        let plural = |n: usize, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
        context.console.note(&format!("{}, {}", plural(errors, "error"), plural(warnings, "warning")));
    }
    Ok(if code == 0 { context.strict(warnings > 0) } else { code })
}

fn look(context: &Context, file: &str) -> Found {
    let mut found = Found { report: Report::default(), counts: None, knobs: Vec::new(), failed: None };
    if let Err(e) = look_into(context, file, &mut found) {
        match e {
            Error::Input(report) => found.report.extend(*report),
            other => found.failed = Some(other),
        }
    }
    found
}

fn look_into(context: &Context, file: &str, found: &mut Found) -> Result<()> {
    let mut request = source::request(context, file)?;
    request.thorough = true;
    let (recipe, warnings) = resolve(&request)?;
    found.report.extend(warnings);
    found.knobs = knobs::of(&recipe);
    if context.common.verbose {
        for plant in &recipe.plants {
            let Growth::Grammar(grammar) = &plant.growth else { continue };
            found.report.extend(Report { sources: grammar.sources().clone(), diagnostics: grammar.notes().to_vec() });
        }
    }
    if !recipe.layers.is_empty() && recipe.plants.is_empty() && recipe.clouds.is_empty() && recipe.terrain.is_none() {
        // A picture of layers makes nothing in space.
        return Ok(());
    }
    let show = Show::Nothing;
    let work = BakeContext { limits: &context.limits, cancel: &context.cancel, progress: &show, cache: None };
    let built = scene::assemble_for_estimate(&recipe, scene::SceneParts::default(), &work)?;
    found.report.extend(built.report.clone());
    let frames: Vec<u32> =
        if recipe.clip.len() > 1 { (recipe.clip.start..=recipe.clip.end).collect() } else { Vec::new() };
    found.counts = Some(built.counts(&recipe, &frames));
    refuse_invisible(&built.animated.scene)
}
