//! Statements of productions: what they are, and how they are read.

use std::ops::Range;

use super::expression::{PyExpr, PyOp, Refusal, parse, substitute};
use super::strings::{PyModule, modules, split};
use super::{Line, Model, assignment, block_after, colon};
use crate::dialect::text::Piece;

/// Deepest nesting of blocks in a production; deeper ones are refused, as the reader recurses.
const MAX_NESTING: usize = 64;

/// A statement of a production.
#[derive(Debug, Clone)]
pub(super) enum Statement {
    Assign(String, PyExpr),
    /// Conditions with their blocks, then the block of `else`.
    If(Vec<(PyExpr, Vec<Statement>)>, Vec<Statement>),
    /// Variable, first, end, step.
    For(String, [PyExpr; 3], Vec<Statement>, Range<usize>),
    /// Adds modules; true ends the production.
    Produce(Vec<PyModule>, bool),
    Return,
    Pass,
}

impl Model<'_, '_> {
    /// Statements of a block.
    pub(super) fn statements(&mut self, block: &[Line<'_>], nesting: usize) -> Result<Vec<Statement>, Refusal> {
        let mut out = Vec::new();
        let mut i = 0;
        if let Some(first) = block.first().filter(|_| nesting > MAX_NESTING) {
            return Err(Refusal::new("blocks nested too deep", first.piece.range()));
        }
        while let Some(line) = block.get(i) {
            let piece = line.piece;
            // The lines indented deeper, and where the block goes on after them.
            let (inner, next) = block_after(block, i, line.indent);
            let (word, rest) = piece.first_word(&['(', ':', '=', '[']);
            // A block may stand on the line of its heading.
            let body = |model: &mut Self, after: Piece<'_>| {
                let after = after.trimmed();
                if after.text.is_empty() {
                    model.statements(inner, nesting + 1)
                } else {
                    model.statements(&[Line { indent: 0, piece: after }], nesting + 1)
                }
            };
            i = next;
            match word.text {
                "produce" | "nproduce" => {
                    out.push(Statement::Produce(modules(rest, &self.declared)?, word.text == "produce"));
                }
                // What these do does not reach the string of modules.
                "pass" | "print" | "global" => out.push(Statement::Pass),
                "return" if rest.text.is_empty() || rest.text == "None" => out.push(Statement::Return),
                "if" | "elif" => {
                    let c = colon(rest).ok_or_else(|| Refusal::new("'if' without ':'", piece.range()))?;
                    let test = parse(rest.up_to(c))?;
                    let then = body(self, rest.from(c + 1))?;
                    if word.text == "if" {
                        out.push(Statement::If(vec![(test, then)], Vec::new()));
                    // The statement before must be an `if`: Python allows nothing between the two.
                    } else if let Some(Statement::If(tests, _)) = out.last_mut() {
                        tests.push((test, then));
                    } else {
                        return Err(Refusal::new("'elif' without 'if'", piece.range()));
                    }
                }
                "else" => {
                    let c = colon(rest).ok_or_else(|| Refusal::new("'else' without ':'", piece.range()))?;
                    let other = body(self, rest.from(c + 1))?;
                    // As for `elif`.
                    let Some(Statement::If(_, last)) = out.last_mut() else {
                        return Err(Refusal::new("'else' without 'if'", piece.range()));
                    };
                    *last = other;
                }
                "for" => {
                    let c = colon(rest).ok_or_else(|| Refusal::new("'for' without ':'", piece.range()))?;
                    let (name, range) = for_range(rest.up_to(c))?;
                    let inner = body(self, rest.from(c + 1))?;
                    out.push(Statement::For(name, range, inner, piece.range()));
                }
                "while" | "try" | "with" | "import" | "from" | "def" | "class" | "assert" | "raise" | "del"
                | "return" | "sproduce" | "nsproduce" | "lambda" => {
                    return Err(Refusal::new(format!("'{}' in a production", word.text), piece.range()));
                }
                _ => out.extend(assign_statement(piece)?),
            }
        }
        Ok(out)
    }
}

/// Assignments of a production: `x = e`, `x, y = e, f`, `x += e`.
fn assign_statement(piece: Piece<'_>) -> Result<Vec<Statement>, Refusal> {
    let refused = || {
        let shown: String = piece.text.chars().take(40).collect();
        Refusal::new(format!("'{shown}' in a production"), piece.range())
    };
    for sign in ["+=", "-=", "*=", "/="] {
        if let Some(i) = piece.text.find(sign) {
            let name = piece.up_to(i).trimmed();
            let value = parse(piece.from(i + 2).trimmed())?;
            let op = match sign {
                "+=" => PyOp::Add,
                "-=" => PyOp::Sub,
                "*=" => PyOp::Mul,
                _ => PyOp::Div,
            };
            // `x += e` becomes `x = x + e`.
            let old = PyExpr::Name(name.text.to_owned(), name.range());
            let sum = PyExpr::Binary(op, Box::new(old), Box::new(value));
            return Ok(vec![Statement::Assign(name.text.to_owned(), sum)]);
        }
    }
    let (names, value) = assignment(piece).ok_or_else(refused)?;
    let (names, values) = (split(names), split(value));
    // `x, y = f()` would need a value with parts, which expressions here do not have.
    if names.len() != values.len() {
        return Err(refused());
    }
    let one = |(name, value): (&Piece<'_>, &Piece<'_>)| Ok(Statement::Assign(name.text.to_owned(), parse(*value)?));
    names.iter().zip(&values).map(one).collect()
}

/// A statement in one turn of a loop: ranges of loops within it may name the variable.
pub(super) fn in_turn(s: &Statement, name: &String, value: f64) -> Statement {
    let all = |list: &[Statement]| list.iter().map(|s| in_turn(s, name, value)).collect::<Vec<_>>();
    match s {
        Statement::If(tests, other) => {
            let tests = tests.iter().map(|(test, then)| (test.clone(), all(then))).collect();
            Statement::If(tests, all(other))
        }
        Statement::For(own, range, body, place) => {
            // Ranges must be constant, so that they need the number now; elsewhere the variable is read as it was assigned for this turn.
            let known = std::slice::from_ref(name);
            let range = range.each_ref().map(|e| substitute(e, known, &[PyExpr::Number(value)]));
            Statement::For(own.clone(), range, all(body), place.clone())
        }
        other => other.clone(),
    }
}

/// `i in range(a, b, step)`.
fn for_range(piece: Piece<'_>) -> Result<(String, [PyExpr; 3]), Refusal> {
    let refused = || Refusal::new("'for' over something other than range(..)", piece.range());
    let (name, rest) = piece.first_word(&[]);
    let (word, rest) = rest.first_word(&[]);
    let list = ["range", "xrange"].iter().find_map(|r| rest.text.strip_prefix(r).map(|_| rest.from(r.len()).trimmed()));
    let list = list.filter(|l| word.text == "in" && l.text.starts_with('(') && l.text.ends_with(')'));
    let list = list.ok_or_else(refused)?;
    let inner = list.up_to(list.text.len() - 1).from(1);
    let mut values = split(inner).iter().map(|p| parse(*p)).collect::<Result<Vec<_>, _>>()?;
    let (zero, one) = (PyExpr::Number(0.0), PyExpr::Number(1.0));
    let range = match values.len() {
        1 => [zero, values.remove(0), one],
        2 => [values.remove(0), values.remove(0), one],
        3 => [values.remove(0), values.remove(0), values.remove(0)],
        _ => return Err(refused()),
    };
    Ok((name.text.to_owned(), range))
}
