//! `osier grow TABLE -o NAME.ifs` and `.flame`: coefficients written again.

use super::Context;
use super::args::Grow;
use super::grow::{beside, file_name, result};
use crate::bake::output::ifs_tables::systems;
use crate::recipe::Recipe;
use osier_base::diagnostic::Report;
use osier_base::{Error, Result};
use osier_ifs::write::{entries, flames};

/// Writes every attractor and table-grown tree of a recipe; what the file cannot hold is told (I011).
pub fn run(context: &Context, args: &Grow, recipe: &Recipe, warnings: &Report) -> Result<u8> {
    let items = systems(recipe);
    if items.is_empty() {
        let why = format!("\"{}\" holds no coefficients; .ifs and .flame are for tables and their trees", args.source);
        context.console.complain(&why);
        return Ok(2);
    }
    let name = file_name(&args.output);
    let written = if name.to_ascii_lowercase().ends_with(".flame") { flames(&items) } else { Ok(entries(&items)) };
    let (text, lost) = written.map_err(|d| {
        let mut report = Report::default();
        report.push(*d);
        Error::Input(Box::new(report))
    })?;
    let mut report = Report::default();
    let warned = !warnings.diagnostics.is_empty() || !lost.is_empty();
    lost.into_iter().for_each(|d| report.push(d));
    context.console.report(&report);
    if context.common.dry_run {
        context.console.result(&format!("{}\n  {} systems\n", args.output.display(), items.len()))?;
        return Ok(context.strict(warned));
    }
    let (folder, parent) = beside(context, args)?;
    folder.write(&name, "ifs", text.as_bytes())?;
    folder.finish()?;
    result(context, parent, &folder)?;
    Ok(context.strict(warned))
}
