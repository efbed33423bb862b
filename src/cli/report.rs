//! Formats estimates and sizes as text and as JSON.

use serde_json::{Value, json};

use super::Context;
use crate::bake::{BakeEstimate, SolidSizeInCells};
use osier_base::Result;
use osier_base::limits::grouped;

/// Predicted bytes of output beyond which `--force` is needed. Own: a folder of 2 GB is seldom intended, and takes minutes
/// to write.
pub const CONFIRM_BYTES: u64 = 2_000_000_000;

/// A frame rate with at most three decimals, as Blender's own rates of 23.976 and 59.94, which are fractions.
pub fn rate(fps: f64) -> f64 {
    (fps * 1000.0).round() / 1000.0
}

/// Prints the estimate of a run under the name of its target, as text or JSON.
/// # Errors
/// `Io` if standard output cannot be written.
pub fn print_estimate(context: &Context, target: &str, estimate: &BakeEstimate) -> Result<()> {
    if context.console.json {
        let value = json!({ "target": target, "would_make": estimate_json(estimate) });
        return context.console.result(&format!("{value:#}\n"));
    }
    context.console.result(&format!("{target}\n{}", estimate_text(estimate)))
}

/// An estimate as indented lines, one per count, then sizes and memory with their parts.
pub fn estimate_text(c: &BakeEstimate) -> String {
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
        row("frames", written_frames(c)),
        format!("  {:12} about {}\n", "size", byte_size(c.bytes)),
    ]
    .concat()
        + &byte_rows(&c.sizes)
        + &format!("  {:12} about {}\n", "memory", byte_size(c.peak()))
        + &byte_rows(&c.memory)
}

/// Number of frames that are written; a still scene is one.
fn written_frames(c: &BakeEstimate) -> u64 {
    c.frames.max(1)
}

/// Parts of a number of bytes, one per line.
fn byte_rows(parts: &[(&'static str, u64)]) -> String {
    parts.iter().map(|(what, bytes)| format!("    {what:13} {}\n", byte_size(*bytes))).collect()
}

/// Memory of a lattice wind and its parts on one line.
pub fn lattice_memory_text(parts: &[(&'static str, u64)]) -> String {
    let all = byte_size(parts.iter().map(|p| p.1).sum());
    let each: Vec<String> = parts.iter().map(|(what, bytes)| format!("{what} {}", byte_size(*bytes))).collect();
    format!("memory of the lattice wind: {all} ({})", each.join(", "))
}

/// Sizes of solids in cells of the lattice wind on one line.
pub fn solids_in_cells_text(solids: &[SolidSizeInCells]) -> String {
    let each = solids.iter().map(|s| {
        let thickness = s.thickness.map_or_else(String::new, |t| format!(", {t:.1} thick"));
        format!("{} {:.1} high{thickness}", s.name, s.height)
    });
    format!("solids in cells of the lattice wind: {}", each.collect::<Vec<_>>().join("; "))
}

fn by_name(parts: &[(&'static str, u64)]) -> Value {
    Value::Object(parts.iter().map(|(what, bytes)| ((*what).to_owned(), Value::from(*bytes))).collect())
}

/// An estimate as a JSON object; its `memory` and `sizes` are objects of bytes by name.
pub fn estimate_json(c: &BakeEstimate) -> Value {
    json!({
        "assets": c.assets, "placements": c.placements, "modules": c.modules, "vertices": c.vertices,
        "triangles": c.triangles, "instances": c.instances, "points": c.points, "joints": c.joints,
        "frames": written_frames(c),
        "bytes": c.bytes,
        "memory": by_name(&c.memory),
        "sizes": by_name(&c.sizes),
    })
}

/// Bytes with one decimal and a decimal prefix: `12.3 MB`.
pub fn byte_size(bytes: u64) -> String {
    let steps = [(1_000_000_000, "GB"), (1_000_000, "MB"), (1_000, "kB")];
    match steps.iter().find(|(s, _)| bytes >= *s) {
        #[allow(clippy::cast_precision_loss, reason = "one decimal is shown")]
        Some((s, unit)) => format!("{:.1} {unit}", bytes as f64 / *s as f64),
        None => format!("{bytes} bytes"),
    }
}

/// A path as one word of a command for a shell: in quotes if it has other characters than letters, digits and those of plain names.
pub fn shell_word(path: &str) -> String {
    let is_plain = |c: char| {
        c.is_alphanumeric()
            || matches!(c, '/' | '.' | '_' | '-' | '+' | ',' | ':' | '@')
            || (cfg!(windows) && c == '\\')
    };
    if path.chars().all(is_plain) {
        path.to_owned()
    } else if cfg!(windows) {
        format!("\"{path}\"")
    } else {
        // Within single quotes only their own end needs another spelling.
        format!("'{}'", path.replace('\'', "'\\''"))
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::shell_word;

    #[test]
    fn paths_are_one_word_of_a_shell() {
        for path in ["out/oak/oak.usda", "out/my bake/pov", "it's/pov", "a$(b)/c;d", "a\\b", "*"] {
            let echo = format!("printf %s {}", shell_word(path));
            let shell = std::process::Command::new("sh").args(["-c", &echo]).output().expect("sh");
            assert_eq!(String::from_utf8_lossy(&shell.stdout), path);
        }
        assert_eq!(shell_word("out/oak_2.0/oak.usda"), "out/oak_2.0/oak.usda");
    }
}
