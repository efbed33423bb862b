//! Reads functions that L-Py runs before the derivation and around each step, and settings of the turtle.

use std::ops::Range;

use super::Model;
use super::assignment::unreadable_assignment;
use super::emit::append_code;
use super::expression::{PyExpr, range_of};
use super::lines::Line;
use super::path_code::{LoopJumps, push_test};
use super::pieces::{closing, is_seed, split, statements_of_line};
use super::refusal::Refusal;
use super::resolve::compile;
use super::statement::{DIRECTION, Statement};
use crate::code::Op;
use crate::dialect::text::Piece;

/// Functions that L-Py runs at the beginning, around each step and around each drawing.
pub(super) const CALLED_FUNCTIONS: [&str; 7] =
    ["Start", "StartEach", "EndEach", "End", "StartInterpretation", "EndInterpretation", "PostDraw"];

/// Message for a function that returns a string other than its argument.
const OTHER_STRING: &str = "a function that returns another string";

/// Placeholder target for the jump of a `return`, until the end of its function is known.
const RETURN: usize = usize::MAX;

/// Code of the functions that L-Py runs around the steps.
#[derive(Default)]
pub(super) struct RunFunctions {
    pub start: Vec<Op>,
    pub start_each: Vec<Op>,
    pub end_each: Vec<Op>,
}

/// True if calls of `backward()` and `forward()` may give steps different directions: both are called, or a call is inside a
/// block other than the body of a function.
pub(super) fn changes_direction(list: &[Line<'_>]) -> bool {
    let (mut directions, mut is_tested) = (Vec::new(), false);
    for (i, line) in list.iter().enumerate() {
        let text = line.piece.text;
        let Some(at) = ["backward()", "forward()"].iter().find_map(|call| text.find(call)) else { continue };
        directions.push(text.get(at..).is_some_and(|t| t.starts_with("backward()")));
        // Find the heading of the block that contains the call, which may be on the same line.
        let head = list.iter().take(i).rev().find(|other| other.indent < line.indent);
        let head = if at == 0 { head.map_or("", |l| l.piece.text) } else { text };
        is_tested |= !head.starts_with("def ") && !head.is_empty();
    }
    is_tested || directions.iter().any(|d| Some(d) != directions.first())
}

impl Model<'_, '_> {
    /// Reads a function that L-Py runs, and stores it as a block.
    pub(super) fn called_function(&mut self, name: &str, block: &[Line<'_>], range: &Range<usize>) {
        self.scope.is_before_step = name == "StartEach";
        let code = self.run_function(block);
        self.scope.is_before_step = false;
        let is_run = matches!(name, "Start" | "StartEach" | "EndEach");
        match code {
            Ok(code) if is_run => {
                let to = match name {
                    "Start" => &mut self.functions.start,
                    "StartEach" => &mut self.functions.start_each,
                    _ => &mut self.functions.end_each,
                };
                *to = code;
            }
            Ok(code) if code.is_empty() => {}
            Err(why) if is_run || why.construct == OTHER_STRING => {
                let construct = format!("the function '{name}', which L-Py runs: {}", why.construct);
                let range = if why.range.is_empty() { range.clone() } else { why.range };
                self.refuse(&Refusal { construct, range, remedy: why.remedy });
            }
            // The other functions run after the last step, and around drawings.
            _ => {
                let place = self.reader.place(range.clone());
                let message = format!("the function '{name}' is not run");
                let help = "osier runs Start, StartEach and EndEach; set in EndEach() what an interpretation reads";
                self.reader.session.warning("L008", message, place, help);
            }
        }
    }

    /// Compiles a function that L-Py runs: assignments of numbers, and `if`. An unreadable value is refused where it is used.
    fn run_function<'t>(&mut self, block: &[Line<'t>]) -> Result<Vec<Op>, Refusal> {
        let mut lines = Vec::new();
        let parts_of = |line: &Line<'t>| {
            let indent = line.indent;
            statements_of_line(line.piece).into_iter().map(move |piece| Line { indent, piece })
        };
        for line in &block.iter().flat_map(parts_of).collect::<Vec<_>>() {
            let text = line.piece.text;
            // These lines do not affect rules; `forward()` is the default direction of L-Py.
            if self.turtle_setting(line.piece) || text.starts_with("context(") || is_seed(line.piece) {
                continue;
            }
            // `return lstring, scene` returns both arguments.
            let (word, rest) = line.piece.first_word(&[]);
            let values = if word.text == "return" { split(rest) } else { Vec::new() };
            if let [string, _, ..] = values.as_slice()
                && values.iter().all(|v| self.run_parameters.iter().any(|p| p == v.text))
            {
                let end = string.at + string.text.len() - line.piece.at;
                lines.push(Line { piece: line.piece.up_to(end), ..*line });
                continue;
            }
            // If all steps have one direction, record it as a setting; it generates no code.
            let is_backward = text.starts_with("backward()");
            if (is_backward || text.starts_with("forward()")) && !self.scope.direction_changes {
                self.direction = Some(is_backward);
                continue;
            }
            if unreadable_assignment(line, &self.scope, &self.defined).is_none() {
                lines.push(*line);
            }
        }
        let statements = self.statements(&lines)?;
        let mut ops = Vec::new();
        let mut declared = Vec::new();
        self.block_code(&statements, &mut declared, &mut ops, &mut LoopJumps::default())?;
        // A function that only returns needs no code.
        if ops.iter().all(|op| *op == Op::Jump(RETURN)) {
            ops.clear();
        }
        let end = ops.len();
        for op in ops.iter_mut().filter(|op| **op == Op::Jump(RETURN)) {
            *op = Op::Jump(end);
        }
        Ok(ops)
    }

    /// Appends the code of a function's statements. Its local variables are separate from those of the model. `jumps`: jumps
    /// of the enclosing loop.
    fn block_code(
        &mut self,
        statements: &[Statement],
        declared: &mut Vec<String>,
        ops: &mut Vec<Op>,
        jumps: &mut LoopJumps,
    ) -> Result<(), Refusal> {
        for statement in statements {
            match statement {
                Statement::Pass => {}
                // A function that returns its own argument changes nothing.
                Statement::Return(value, place) => {
                    let is_own = match value {
                        Some(PyExpr::Name(name, _)) => self.run_parameters.contains(name),
                        Some(_) => false,
                        None => true,
                    };
                    if !is_own {
                        let why = Refusal::new(OTHER_STRING, place.clone());
                        return Err(why.remedy("write the string as the axiom, and its changes as productions"));
                    }
                    ops.push(Op::Jump(RETURN));
                }
                Statement::Global(names) => declared.extend(names.iter().cloned()),
                Statement::Stop(_) => ops.push(Op::Stop),
                Statement::Assign(name, e) => {
                    let code = compile(e, &self.scope)?;
                    append_code(ops, &code.ops);
                    // In Python a name assigned without `global` is local to the function. Blocks have no local variables, so
                    // such a name is refused.
                    let is_of_model = self.scope.constants.contains_key(name) || self.shared.contains(name);
                    if !declared.contains(name) && is_of_model {
                        return Err(Refusal::new(format!("'{name}' as a variable of its own"), 0..0));
                    }
                    ops.push(Op::StoreGlobal(self.scope.global(name)));
                }
                Statement::Store(store) => self.plain_store(store, ops)?,
                // The code of an `if`: test, JumpIfZero to the next test, body, Jump to the end; both targets are known only
                // after the code that they skip.
                Statement::If(tests, other) => {
                    let mut ends = Vec::new();
                    for (test, then) in tests {
                        let code = compile(test, &self.scope)?;
                        append_code(ops, &code.ops);
                        let skip = ops.len();
                        ops.push(Op::Pop);
                        self.block_code(then, declared, ops, jumps)?;
                        ends.push(ops.len());
                        ops.push(Op::Pop);
                        ops[skip] = Op::JumpIfZero(ops.len());
                    }
                    self.block_code(other, declared, ops, jumps)?;
                    for end in ends {
                        ops[end] = Op::Jump(ops.len());
                    }
                }
                // `break` and `continue` are jumps whose targets the enclosing loop sets.
                Statement::While(test, body, place, _) => self.block_loop(test, body, place, declared, ops)?,
                Statement::Break(_) => {
                    jumps.breaks.push(ops.len());
                    ops.push(Op::Pop);
                }
                Statement::Continue(_) => {
                    jumps.continues.push(ops.len());
                    ops.push(Op::Pop);
                }
                // These occur only in productions: ends of unrolled iterations and loops, and of inlined functions.
                Statement::TurnEnd | Statement::LoopEnd | Statement::FunctionEnd(..) => {}
                // A loop over a range with a positive step becomes a `while` loop.
                Statement::For(name, list, body, place) => {
                    let counted = self.counted_loop(name, list, body, place).ok_or_else(|| {
                        let why = Refusal::new("'for' over a list in a function that L-Py runs", place.clone());
                        why.remedy("count: for i in range(len(q))")
                    })?;
                    self.block_code(&counted.begin, declared, ops, &mut LoopJumps::default())?;
                    self.block_loop(&counted.test, &counted.turn, place, declared, ops)?;
                }
                // Only productions make modules.
                Statement::Run(e) => {
                    let why = Refusal::new("a call of a function for its modules outside of a production", range_of(e));
                    return Err(why.remedy("write what it computes here, and its modules into a production"));
                }
                Statement::Produce(modules, _) => {
                    let range = modules.first().map_or(0..0, |m| m.range.clone());
                    return Err(Refusal::new("'produce' outside of a production", range));
                }
            }
        }
        Ok(())
    }

    /// Appends a loop: test, JumpIfZero to after the loop, body, Jump to the test.
    fn block_loop(
        &mut self,
        test: &PyExpr,
        body: &[Statement],
        place: &Range<usize>,
        declared: &mut Vec<String>,
        ops: &mut Vec<Op>,
    ) -> Result<(), Refusal> {
        let start = ops.len();
        ops.push(Op::Count(self.loop_places.len()));
        self.loop_places.push(self.reader.place(place.clone()));
        let skip = push_test(ops, &compile(test, &self.scope)?);
        let mut jumps = LoopJumps::default();
        self.block_code(body, declared, ops, &mut jumps)?;
        jumps.close(ops, start, skip);
        Ok(())
    }

    /// Reads a line that sets the turtle, such as `context().turtle.setAngleIncrement(90)`; false for other lines. L008 for
    /// a setting without effect.
    pub(super) fn turtle_setting(&mut self, piece: Piece<'_>) -> bool {
        // A value in parentheses sets the argument of a method, a value after '=' a member.
        let value = |method: &str, member: &str| {
            if let Some(i) = piece.text.find(method) {
                let call = piece.from(i + method.len()).trimmed();
                let inner = call.text.strip_prefix('(').map(|_| call.from(1))?;
                return Some(inner.up_to(closing(inner.text)?).trimmed());
            }
            let rest = piece.from(piece.text.find(member)? + member.len()).trimmed();
            let is_value = rest.text.starts_with('=') && !rest.text.starts_with("==");
            let value = rest.from(1).trimmed();
            is_value.then_some(Piece::new(value.at, value.text.trim_end_matches([';', ' '])))
        };
        if let Some(value) = value("setAngleIncrement", ".angle_increment") {
            if let Some(angle) = self.known_number(value) {
                if let Some(turtle) = &mut self.reader.program.turtle {
                    turtle.settings.angle_deg = Some(angle.abs());
                }
            } else {
                let place = self.reader.place(value.range());
                let message = "this angle is not constant and has no effect".to_owned();
                self.reader.session.warning("L008", message, place, "write the angle as a number");
            }
            return true;
        }
        let others = [
            ("setDefaultStep", ".default_step"),
            ("setWidthIncrement", ".width_increment"),
            ("setColorIncrement", ".color_increment"),
            ("setScaleMultiplier", ".scale_multiplier"),
        ];
        let is_other = others.iter().any(|(method, member)| value(method, member).is_some());
        if is_other {
            let place = self.reader.place(piece.range());
            let message = "this setting of the turtle has no effect".to_owned();
            self.reader.session.warning("L008", message, place, "give the modules their parameters");
        }
        is_other
    }

    /// Removes the productions with a context in the new string on the side that is rewritten later, which L-Py never applies. If
    /// the steps have different directions, none is removed.
    pub(super) fn keep_productions_of_direction(&mut self) {
        let is_backward = self.direction == Some(true);
        self.reader.program.is_backward = is_backward;
        let changes = self.scope.direction_changes;
        if changes {
            self.reader.program.direction = Some(self.scope.global(DIRECTION));
        }
        let list = std::mem::take(&mut self.reader.program.rules.list);
        for p in list {
            let (unseen, sign) = if is_backward { (&p.new_left, "<<") } else { (&p.new_right, ">>") };
            if (is_backward || changes) && p.predecessor.len() > 1 {
                let range = p.place.span.start as usize..p.place.span.end as usize;
                let why = Refusal::new("several modules as a predecessor beside 'backward()'", range);
                self.refuse(
                    &why.remedy("write the others as a right context and rewrite each by a production of its own"),
                );
            } else if unseen.is_empty() || changes {
                self.reader.program.rules.list.push(p);
            } else {
                let message = format!("a production with '{sign}' never applies in this direction of rewriting");
                let help = if is_backward {
                    "'backward()' makes the string from its end: use '>>', or leave 'backward()' out"
                } else {
                    "the string is made from its beginning: use '<<', or call 'backward()' in Start()"
                };
                self.reader.session.warning("L008", message, p.place, help);
            }
        }
    }
}
