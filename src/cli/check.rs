//! `osier check`: errors of scenes and grammars, and estimates of their bakes.

use serde_json::{Value, json};

use super::args::Check;
use super::progress::ProgressDisplay;
use super::{Context, knobs, report};
use crate::bake::BakeContext;
use crate::check::{CheckResult, check};
use crate::recipe::{GivenKey, Request, resolve};
use crate::single_file::DerivedText;
use crate::source::{entry_sources, find_scene};
use osier_base::diagnostic::{Severity, render_json, visible};
use osier_base::{Error, Result};

/// A key that a scene sets as JSON: path, value, file and byte range of the value.
fn key_json(key: &GivenKey) -> Value {
    json!({ "key": key.path, "value": key.value, "file": key.file, "span": key.span })
}

/// The strings that the grammars of a scene derive; `None` for a scene without grammars, and if an error prevents the
/// derivation, which is then added to `found`.
fn derived_string(request: &Request, found: &mut CheckResult, context: &BakeContext<'_>) -> Option<String> {
    if found.report.has_errors() {
        return None;
    }
    let derived = resolve(request).and_then(|(recipe, _)| DerivedText::derive(&recipe, context));
    match derived {
        Ok(derived) => Some(derived.text),
        Err(Error::Input(report)) => {
            found.report.extend(*report);
            None
        }
        Err(other) => {
            found.failure.get_or_insert(other);
            None
        }
    }
}

/// Runs `osier check`; the result is the exit code. An error in one file does not end the check of the others.
pub fn run(context: &Context, args: &Check) -> Result<u8> {
    let work = BakeContext {
        limits: &context.limits,
        cancel: &context.cancel,
        progress: &ProgressDisplay::Silent,
        cache: None,
    };
    let mut values: Vec<Value> = Vec::new();
    let (mut errors, mut warnings, mut code) = (0, 0, 0);
    // A file of several L-systems is checked entry by entry.
    let mut files = Vec::new();
    for file in &args.files {
        let entries = entry_sources(file, &context.limits).unwrap_or_else(|_| vec![file.clone()]);
        // Each entry is read from the whole file: the time grows as the square of their number.
        let about = format!("number of L-systems in \"{}\"", visible(file));
        match context.limits.check("entries", entries.len() as u64, &about) {
            Ok(()) => files.extend(entries.into_iter().map(|e| (e, None))),
            Err(Error::Limit { name, wanted, limit, flag, .. }) => {
                let help = format!("check one of them: \"{}\"", entries.first().map_or("", |e| e.as_str()));
                files.push((file.clone(), Some(Error::Limit { name, wanted, limit, flag, help })));
            }
            Err(other) => return Err(other),
        }
    }
    for (file, refused) in files {
        let file = &file;
        let mut string = None;
        let request = refused.map_or_else(|| find_scene(file, &context.sources), Err);
        let found = match request {
            Ok(request) => {
                let mut found = check(&request, context.common.verbose, &work);
                if args.string {
                    string = derived_string(&request, &mut found, &work);
                }
                found
            }
            Err(Error::Input(report)) => CheckResult { report: *report, ..CheckResult::default() },
            Err(other) => CheckResult { failure: Some(other), ..CheckResult::default() },
        };
        // A cancelled check ends the run; any other failure is reported and the next file checked.
        context.cancel.check()?;
        let file_errors = found.report.diagnostics.iter().filter(|d| d.severity == Severity::Error).count();
        errors += file_errors;
        warnings += found.report.diagnostics.len() - file_errors;
        if found.report.has_errors() {
            // The code of the whole run is the largest of its files: 1 for errors in files, a higher one for failures of the
            // system.
            code = code.max(1);
        }
        if let Some(e) = &found.failure {
            code = code.max(e.exit_code());
            errors += 1;
        }
        if context.console.json {
            values.push(json!({
                "file": file, "diagnostics": render_json(&found.report),
                "error": found.failure.as_ref().map(ToString::to_string),
                "would_make": found.estimate.as_ref().map(report::estimate_json),
                "keys": found.keys.iter().map(key_json).collect::<Value>(),
                "knobs": knobs::as_json(&found.parameters),
                "string": string.as_deref().map(str::trim_end),
            }));
            continue;
        }
        context.console.report(&found.report);
        if let Some(text) = &string {
            context.console.result(text)?;
        }
        match (&found.estimate, &found.failure) {
            (_, Some(e)) => context.console.error(e),
            (Some(estimate), _) if !context.console.quiet => {
                let knobs = knobs::as_text(&found.parameters);
                context.console.result(&format!("{file}\n{}{knobs}", report::estimate_text(estimate)))?;
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
