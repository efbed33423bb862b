//! Writes systems as coefficient files: Fractint's `.ifs` and flames. What is written reads back to the same numbers, and
//! is written again byte for byte.
//!
//! # Examples
//! ```
//! use osier_base::limits::Limits;
//! use osier_ifs::read::read;
//! use osier_ifs::write::{TableItem, entries};
//!
//! let text = b"sierpinski { .5 0 0 .5 0 0 1  .5 0 0 .5 .5 0 1  .5 0 0 .5 0 .5 1 }";
//! let (systems, _) = read("sierpinski.ifs", text, &Limits::default())?;
//! let item = TableItem { system: systems[0].clone(), weights: vec![0.25, 0.25, 0.5], view: None };
//! let (text, lost) = entries(&[item]);
//! assert!(text.contains("sierpinski {") && lost.is_empty());
//! # Ok::<(), osier_base::Error>(())
//! ```

mod flame;
mod fractint;
#[cfg(test)]
mod tests;
mod tree;

pub use flame::flames;
pub use fractint::entries;
pub use tree::squashed;

use super::{Ifs, PictureView};
use osier_base::diagnostic::Diagnostic;

/// Shares are written in millionths.
const MILLION: u64 = 1_000_000;
/// Maximum length of a system's name, characters; the rest is cut off.
const MAX_NAME_LENGTH: usize = 40;

/// A system to write, with its weights and, for flames, the view of its picture.
#[derive(Debug, Clone, PartialEq)]
pub struct TableItem {
    /// System to write; features that the format lacks are reported as I011.
    pub system: Ifs,
    /// Weight of each map, as it is drawn; sum 1.
    pub weights: Vec<f64>,
    /// View of a picture, for systems that have none: flames need one.
    pub view: Option<PictureView>,
}

/// Shares in millionths whose sum is a million: rounded, the last takes the rest; none that was above 0 becomes 0.
fn millionths(weights: &[f64]) -> Vec<u64> {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "shares of a million")]
    let rounded = |w: &f64| if *w > 0.0 { ((w.min(1.0) * 1e6 + 0.5) as u64).max(1) } else { 0 };
    let mut out: Vec<u64> = weights.iter().map(rounded).collect();
    let Some((last, others)) = out.split_last_mut() else { return out };
    let sum: u64 = others.iter().sum();
    let least = u64::from(*last > 0);
    if sum + least <= MILLION {
        *last = MILLION - sum;
    } else {
        // This happens only with many tiny shares: the excess is taken from the largest one.
        *last = least;
        let over = sum + least - MILLION;
        if let Some(most) = others.iter_mut().max_by_key(|w| **w) {
            *most = most.saturating_sub(over).max(1);
        }
    }
    out
}

fn share(millionths: u64) -> String {
    if millionths == MILLION {
        return "1".into();
    }
    let digits = format!("{millionths:06}");
    let digits = digits.trim_end_matches('0');
    if digits.is_empty() { "0".into() } else { format!("0.{digits}") }
}

/// The shortest decimal that reads back to the same number; an exponent only below 1e-6 and from 1e15 on.
fn decimal(v: f64) -> String {
    let size = v.abs();
    if size == 0.0 {
        "0".into()
    } else if (1e-6..1e15).contains(&size) {
        format!("{v}")
    } else {
        format!("{v:e}")
    }
}

/// Unique names that every reader accepts: ASCII without blanks, brackets, braces or semicolons.
fn names(items: &[TableItem]) -> Vec<String> {
    let mut taken: std::collections::BTreeSet<String> = std::collections::BTreeSet::new();
    items
        .iter()
        .map(|item| {
            let mut base = plain(&item.system.name);
            let mut n = 1;
            // Readers compare names without case; equal ones get a number.
            while !taken.insert(base.to_ascii_lowercase()) {
                n += 1;
                let tail = format!("_{n}");
                base.truncate(MAX_NAME_LENGTH - tail.len());
                base += &tail;
            }
            base
        })
        .collect()
}

fn plain(name: &str) -> String {
    let mut name = name;
    while name.get(..4).is_some_and(|p| p.eq_ignore_ascii_case("ifs:")) {
        name = &name[4..];
    }
    let sound = |c: char| if c.is_ascii_graphic() && !"(){};<>&\"'".contains(c) { c } else { '_' };
    let out: String = name.chars().take(MAX_NAME_LENGTH).map(sound).collect();
    match out.as_str() {
        "" => "system".into(),
        o if o.eq_ignore_ascii_case("comment") => format!("{o}_"),
        _ => out,
    }
}

/// I011 for what a file cannot hold; `None` if it holds all of the system.
fn loss_diagnostic(ifs: &Ifs, format: &str, features: &[(&str, bool)]) -> Option<Diagnostic> {
    let gone: Vec<&str> = features.iter().filter(|f| f.1).map(|f| f.0).collect();
    (!gone.is_empty()).then(|| {
        let text = format!("\"{}\": {format} cannot hold {}", ifs.name, gone.join(", "));
        Diagnostic::about("I011", text).help("keep the original; a .ifs.toml file stores everything")
    })
}
