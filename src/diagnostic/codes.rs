//! Every stable code with its severity and one line; `docs/codes.md` is held equal to it by a test.

use super::Severity::{self, Error, Warning};

/// One row of the table.
#[derive(Debug, Clone, Copy)]
pub struct Code {
    /// `L001`, `S001`, `X001`, ...
    pub code: &'static str,
    /// Fixed per code.
    pub severity: Severity,
    /// Shape of the message.
    pub summary: &'static str,
}

const fn row(code: &'static str, severity: Severity, summary: &'static str) -> Code {
    Code { code, severity, summary }
}

/// All codes, sorted: L grammars, P pictures, S scenes, X files in and out.
pub const CODES: &[Code] = &[
    row("L001", Error, "unexpected token, expected another"),
    row("L002", Error, "unknown item, with the nearest known name"),
    row("L003", Error, "missing axiom, derivation length or endlsystem"),
    row("L004", Error, "unterminated or too deep comment, string, block or nesting"),
    row("L005", Error, "macro: wrong argument count, too deep or too large"),
    row("L006", Error, "include or companion file: absent, cycle, or outside the scene's folder"),
    row("L007", Error, "the file is written for another program"),
    row("L008", Warning, "feature or dialect not supported, read as something near"),
    row("L009", Warning, "not UTF-8, read as Latin-1"),
    row("L010", Error, "ill-formed production"),
    row("L011", Warning, "successor opens a branch that it does not close"),
    row("L012", Warning, "successor opens a polygon that it does not close"),
    row("L013", Warning, "continued by blanks where cpfg needs a tab"),
    row("L014", Warning, "'//' hides the rest of this production"),
    row("L020", Warning, "undefined variable counts as 0"),
    row("L021", Error, "unknown function"),
    row("L022", Error, "function called with the wrong number of arguments"),
    row("L023", Warning, "module never matches: it is made with another number of parameters"),
    row("L024", Error, "formal parameter named twice"),
    row("L025", Warning, "comparison that can never hold for an f32"),
    row("L030", Warning, "symbol cannot be reached from the axiom"),
    row("L031", Warning, "production shadowed by an earlier one"),
    row("L032", Warning, "weight ignored without a seed"),
    row("L033", Warning, "negative or NaN weight counts as 0"),
    row("L034", Warning, "all weights are 0, the first production is taken"),
    row("L035", Warning, "weights look like shares but do not sum to 1"),
    row("L036", Warning, "rule for a symbol also rewrites a command that contains it"),
    row("L037", Warning, "symbol neither rewritten nor drawn"),
    row("L040", Warning, "division by zero gives the numerator"),
    row("L041", Warning, "non-finite or invalid parameter counts as 0"),
    row("L042", Warning, "atan(x,y) differs from cpfg"),
    row("L043", Error, "function or command not available in grammars"),
    row("L044", Error, "loop limit reached"),
    row("L045", Warning, "no angle given, 45 degrees assumed"),
    row("L048", Warning, "organ, contour, function or tropism unknown or damaged"),
    row("L050", Error, "predicted size passes a limit"),
    row("L051", Error, "limit reached while deriving"),
    row("L052", Warning, "depth limit reached"),
    row("L053", Warning, "unmatched ']' in the string"),
    row("L054", Warning, "nothing changes from this step on"),
    row("L055", Warning, "context never matches: it names a hidden symbol"),
    row("P001", Error, "nothing to draw"),
    row("P002", Error, "camera without a finite place or direction"),
    row("P003", Error, "picture cannot be encoded"),
    row("S001", Error, "not valid TOML"),
    row("S002", Error, "unknown key, with the nearest known name"),
    row("S003", Error, "wrong type or malformed value"),
    row("S004", Error, "value outside its range"),
    row("S005", Error, "reference not found or not allowed"),
    row("S006", Error, "missing key"),
    row("S007", Warning, "key has no effect here"),
    row("X001", Error, "value is not finite"),
    row("X002", Warning, "too many joints, the smallest are merged into their parents"),
    row("X003", Warning, "too many animated nodes, a stable subset is kept"),
    row("X004", Error, "usda would be too large"),
    row("X005", Error, "glb over 4 GiB"),
    row("X006", Error, "face subsets are not a partition"),
    row("X007", Warning, "heights clamped to the range of the map"),
    row("X008", Error, "instance slot changes owner"),
    row("X009", Error, "path leaves its root"),
    row("X010", Error, "input over a limit, or damaged"),
    row("X011", Error, "glTF extension is required but unknown"),
    row("X012", Error, "map set incomplete"),
    row("X013", Warning, "more than the program it is meant for handles well: slow to open, or thinned"),
    row("X014", Warning, "file named by an imported file is not found"),
    row("X015", Warning, "imported file is not UTF-8, read as Latin-1"),
    row("X016", Warning, "part of an imported file is not used"),
];

/// The row of a code.
pub fn find(code: &str) -> Option<&'static Code> {
    CODES.iter().find(|c| c.code == code)
}
