//! Names of prims.

use std::collections::BTreeSet;

/// A name as files and prims may have it: `[a-z0-9_]+`, not starting with a digit.
pub(super) fn clean(name: &str) -> String {
    let keep = |b: u8| match b {
        b'a'..=b'z' | b'0'..=b'9' | b'_' => char::from(b),
        _ => '_',
    };
    let mut out: String = name.bytes().map(keep).collect();
    if out.is_empty() || out.starts_with(|c: char| c.is_ascii_digit()) {
        out.insert(0, '_');
    }
    out
}

/// Names of siblings; a collision gets `_2`, `_3`.
#[derive(Debug, Default)]
pub(super) struct Names(BTreeSet<String>);

impl Names {
    /// The name of the next sibling.
    pub(super) fn take(&mut self, name: &str) -> String {
        let base = clean(name);
        let mut out = base.clone();
        let mut n = 2_u32;
        while !self.0.insert(out.clone()) {
            out = format!("{base}_{n}");
            n += 1;
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_clean_and_unique() {
        let mut names = Names::default();
        assert_eq!(names.take("Oak-7"), "_ak_7");
        assert_eq!(names.take("_ak_7"), "_ak_7_2");
        assert_eq!(names.take("3d"), "_3d");
        assert_eq!(names.take(""), "_");
        assert_eq!(names.take("é"), "__");
    }
}
