//! The tables in docs/ say what the program says. `OSIER_BLESS=1` rewrites them, and still fails.
#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "tests read the repository")]

use osier::diagnostic::{Severity, codes::CODES};
use osier::limits::{LIMITS, grouped};

fn held(name: &str, expected: &str) {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("docs").join(name);
    let found = std::fs::read_to_string(&path).unwrap_or_default();
    if found != expected && std::env::var("OSIER_BLESS").is_ok() {
        std::fs::write(&path, expected).expect("write");
    }
    assert!(
        found == expected,
        "docs/{name} differs from the table in the source; OSIER_BLESS=1 cargo test --test docs"
    );
}

#[test]
fn codes() {
    let mut text = String::from(
        "# Codes\n\nEvery complaint has a code that never changes its meaning. L: grammars, I: coefficient tables, S: scenes, \
         X: files in and out.\nAn error ends the command with code 1 once the file is checked; warnings end it with code 3 \
         under `--strict`.\n\n| code | kind | meaning |\n|---|---|---|\n",
    );
    for c in CODES {
        let kind = if c.severity == Severity::Error { "error" } else { "warning" };
        text.push_str(&format!("| {} | {kind} | {} |\n", c.code, c.summary));
    }
    held("codes.md", &text);
}

#[test]
fn codes_are_sorted_and_unique() {
    assert!(CODES.windows(2).all(|w| w[0].code < w[1].code));
}

#[test]
fn limits() {
    let mut text = String::from(
        "# Limits\n\nWhat a file may cost. `--max-NAME VALUE` sets one (suffix k, M, G = 1e3, 1e6, 1e9; `none` lifts it). \
         Scenes cannot.\nPassing one is an error that names the flag, before memory is spent.\n\n\
         | name | default | counts |\n|---|---|---|\n",
    );
    for l in LIMITS {
        text.push_str(&format!("| {} | {} | {} |\n", l.name, grouped(l.default), l.counts));
    }
    held("limits.md", &text);
}
