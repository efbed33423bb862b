//! Makes names that are safe as files, prims and identifiers from any names in the input.

use std::collections::{BTreeMap, BTreeSet};

/// Longest safe name, bytes.
const LONGEST: usize = 120;

/// Windows device names without a number; `com0` to `com9` and `lpt0` to `lpt9` are tested apart.
const DEVICES: [&str; 4] = ["con", "prn", "aux", "nul"];

/// A name in `[a-z0-9_]+`: other characters become `_`, a leading digit gets one before it, a Windows device name one
/// after it; at most 120 bytes; `unnamed` for the empty name.
pub fn safe_name(name: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '_' };
    let mut safe: String = name.chars().map(plain).take(LONGEST).collect();
    if safe.is_empty() {
        return "unnamed".into();
    }
    if safe.starts_with(|c: char| c.is_ascii_digit()) {
        safe.insert(0, '_');
        safe.truncate(LONGEST);
    }
    if is_device(&safe) {
        safe.push('_');
    }
    safe
}

fn is_device(name: &str) -> bool {
    let numbered =
        |stem| name.strip_prefix(stem).is_some_and(|n| n.len() == 1 && n.bytes().all(|b| b.is_ascii_digit()));
    DEVICES.contains(&name) || numbered("com") || numbered("lpt")
}

/// Safe names given out so far; a name already taken gets `_2`, `_3`, ... in order of asking.
#[derive(Debug, Clone, Default)]
pub struct Names {
    taken: BTreeSet<String>,
    /// Number to try next for each safe name, so that n equal names take about n attempts, not n^2 / 2.
    next: BTreeMap<String, u64>,
}

impl Names {
    /// [`safe_name`] of `name`, with a number if an earlier call returned it; at most 120 bytes.
    pub fn unique(&mut self, name: &str) -> String {
        let base = safe_name(name);
        if self.taken.insert(base.clone()) {
            return base;
        }
        let n = self.next.entry(base.clone()).or_insert(2);
        loop {
            let tail = format!("_{n}");
            // The number must survive the cut at the longest length, or long names would never become unique.
            let kept = base.len().min(LONGEST - tail.len());
            let unique = format!("{}{tail}", &base[..kept]);
            *n += 1;
            if self.taken.insert(unique.clone()) {
                return unique;
            }
        }
    }
}

/// True for a relative path with `/` that stays below its root on every system and fits on one line.
pub(super) fn is_plain_path(path: &str) -> bool {
    !path.contains('\\')
        && !path.chars().any(char::is_control)
        && path.split('/').all(|c| !matches!(c, "" | "." | ".."))
        && path.as_bytes().get(1) != Some(&b':')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hostile_names_become_plain_ones() {
        let long = "x".repeat(300);
        let cases = [
            ("Oak Leaf", "oak_leaf"),
            ("", "unnamed"),
            ("3d", "_3d"),
            ("CON", "con_"),
            ("com1", "com1_"),
            ("com10", "com10"),
            ("a\nb\u{1b}[31m*/", "a_b__31m__"),
            ("\u{202e}é", "__"),
            ("../../etc", "______etc"),
            (&long, &long[..120]),
        ];
        for (name, safe) in cases {
            assert_eq!(safe_name(name), safe, "{name:?}");
        }
    }

    #[test]
    fn collisions_are_numbered_within_the_length() {
        let mut names = Names::default();
        let got: Vec<String> = ["Leaf", "leaf", "leaf_2", "LEAF"].iter().map(|n| names.unique(n)).collect();
        assert_eq!(got, ["leaf", "leaf_2", "leaf_2_2", "leaf_3"]);
        let long = "y".repeat(200);
        let (a, b) = (names.unique(&long), names.unique(&long));
        assert!(a != b && a.len() == 120 && b.len() == 120);
    }
}
