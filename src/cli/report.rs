//! Estimates as text and as JSON.

use serde_json::{Value, json};

use super::Context;
use crate::bake::BakeEstimate;
use osier_base::Result;
use osier_base::limits::grouped;

/// Predicted bytes of output beyond which `--force` is needed: a directory of 2 GB is seldom meant, and takes minutes
/// to write.
pub const CONFIRM_BYTES: u64 = 2_000_000_000;

/// Prints the estimate of a run under the name of its target, as text or JSON.
/// # Errors
/// `Io` if standard output cannot be written.
pub fn counts(context: &Context, what: &str, counts: &BakeEstimate) -> Result<()> {
    if context.console.json {
        let value = json!({ "target": what, "would_make": as_json(counts) });
        return context.console.result(&format!("{value:#}\n"));
    }
    context.console.result(&format!("{what}\n{}", as_text(counts)))
}

/// An estimate as indented lines.
pub fn as_text(c: &BakeEstimate) -> String {
    let row = |name: &str, n: u64| format!("  {name:12} {}\n", grouped(n));
    [
        row("assets", c.assets),
        row("placements", c.placements),
        row("modules", c.modules),
        row("vertices", c.vertices),
        row("triangles", c.triangles),
        row("instances", c.instances),
        row("points", c.points),
        row("joints", c.joints),
        row("frames", c.frames),
        format!("  {:12} about {}\n", "size", size(c.bytes)),
    ]
    .concat()
        + &rows(&c.sizes)
        + &format!("  {:12} about {}\n", "memory", size(c.peak()))
        + &rows(&c.memory)
}

/// Parts of a number of bytes, one per line.
fn rows(parts: &[(&'static str, u64)]) -> String {
    parts.iter().map(|(what, bytes)| format!("    {what:13} {}\n", size(*bytes))).collect()
}

/// Memory of a lattice wind and its parts on one line.
pub fn lattice(parts: &[(&'static str, u64)]) -> String {
    let all = size(parts.iter().map(|p| p.1).sum());
    let each: Vec<String> = parts.iter().map(|(what, bytes)| format!("{what} {}", size(*bytes))).collect();
    format!("memory of the lattice wind: {all} ({})", each.join(", "))
}

fn by_name(parts: &[(&'static str, u64)]) -> Value {
    Value::Object(parts.iter().map(|(what, bytes)| ((*what).to_owned(), Value::from(*bytes))).collect())
}

/// An estimate as a JSON object.
pub fn as_json(c: &BakeEstimate) -> Value {
    json!({
        "assets": c.assets, "placements": c.placements, "modules": c.modules, "vertices": c.vertices,
        "triangles": c.triangles, "instances": c.instances, "points": c.points, "joints": c.joints, "frames": c.frames,
        "bytes": c.bytes,
        "memory": by_name(&c.memory),
        "sizes": by_name(&c.sizes),
    })
}

/// Bytes with one decimal and a decimal prefix: `12.3 MB`.
pub fn size(bytes: u64) -> String {
    let steps = [(1_000_000_000, "GB"), (1_000_000, "MB"), (1_000, "kB")];
    match steps.iter().find(|(s, _)| bytes >= *s) {
        #[allow(clippy::cast_precision_loss, reason = "one decimal is shown")]
        Some((s, unit)) => format!("{:.1} {unit}", bytes as f64 / *s as f64),
        None => format!("{bytes} bytes"),
    }
}
