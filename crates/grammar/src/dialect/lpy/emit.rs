//! Emits bytecode for expressions whose names are resolved.

use std::ops::Range;

use super::arrays::array_of;
use super::expression::{
    APPLY, DICTIONARY, MAX_OPS, NONE, OBJECT, PyExpr, PyOp, is_joined_text, joined_text_refusal, plain_name, range_of,
};
use super::refusal::Refusal;
use super::scope::{RUN, Scope, has_random};
use super::vectors::gives_vector;
use crate::code::{BinaryOp, Bytecode, Op, RandomFunction, TableFunction, UnaryOp, is_zero};

/// A divisor larger than any number of a model: taking the remainder by it truncates a number to an integer.
const CUT: f64 = 1e18;

/// Degrees per radian: Python measures angles in radians, the grammar language in degrees.
const DEGREES: f64 = 180.0 / std::f64::consts::PI;

/// The value of a resolved expression; `None` if it is not constant.
pub(super) fn constant_of(e: &PyExpr, scope: &Scope) -> Option<f64> {
    let mut ops = Vec::new();
    emit(e, scope, &mut ops).ok()?;
    let code = scope.with_tables(Bytecode { ops, ..Bytecode::default() });
    crate::vm::constant_value(&code).filter(|v| v.is_finite())
}

/// The truth value of a resolved test; `None` if it is not constant.
pub(super) fn known_truth(test: &PyExpr, scope: &Scope) -> Option<bool> {
    let value = if scope.has_none { constant_of(&tested(test.clone()), scope) } else { constant_of(test, scope) };
    value.map(|v| !is_zero(v))
}

/// A resolved argument, replaced by a number if it is constant: the tests that end recursive calls need such numbers.
pub(super) fn folded(e: PyExpr, scope: &Scope) -> PyExpr {
    match e {
        PyExpr::Number(_) | PyExpr::Text(..) => e,
        _ => constant_of(&e, scope).map_or(e, PyExpr::Number),
    }
}

/// Appends the bytecode that leaves the value of an expression on the stack.
pub(super) fn emit(e: &PyExpr, scope: &Scope, ops: &mut Vec<Op>) -> Result<(), Refusal> {
    if ops.len() > MAX_OPS {
        return Err(Refusal::new("an expression that grows too large", range_of(e)));
    }
    if let Some(choice) = operand_choice(e, scope) {
        return emit(&choice, scope, ops);
    }
    // The index of the source place is invalid, because divisions by zero in these models are not reported.
    let binary = |op: BinaryOp| Op::Binary(op, usize::MAX);
    match e {
        PyExpr::Number(n) | PyExpr::Text(n, _) => ops.push(Op::Const(*n)),
        PyExpr::Name(name, range) => {
            // Variables of the rule hide values of the model, except inside functions of the model.
            let of_model = plain_name(name);
            if let Some(slot) = Scope::slot(&scope.locals, name) {
                ops.push(Op::Local(slot));
            } else if let Some(value) = scope.constants.get(of_model) {
                ops.push(Op::Const(*value));
            } else if let Some(slot) = scope.global_slot(of_model) {
                ops.push(Op::Global(slot));
            } else {
                return Err(Refusal::new(format!("the unknown name '{of_model}'"), range.clone()));
            }
        }
        PyExpr::Neg(a) => {
            emit(a, scope, ops)?;
            ops.push(Op::Unary(UnaryOp::Neg));
        }
        PyExpr::Not(a) => {
            emit_test(a, scope, ops)?;
            ops.push(Op::Unary(UnaryOp::Not));
        }
        PyExpr::And(a, b) | PyExpr::Or(a, b) => {
            // Emit a placeholder for the jump; its target is set when the end of the right side is known.
            emit_test(a, scope, ops)?;
            let jump = ops.len();
            ops.push(Op::Pop);
            emit_test(b, scope, ops)?;
            ops.push(Op::Bool);
            let end = ops.len();
            ops[jump] = if matches!(e, PyExpr::And(..)) { Op::And(end) } else { Op::Or(end) };
        }
        PyExpr::Choice(condition, then, other) => {
            // Emit condition, JumpIfZero to `other`, `then`, Jump to the end; each target is set when it is known.
            emit_test(condition, scope, ops)?;
            let to_other = ops.len();
            ops.push(Op::Pop);
            emit(then, scope, ops)?;
            let to_end = ops.len();
            ops.push(Op::Pop);
            ops[to_other] = Op::JumpIfZero(ops.len());
            emit(other, scope, ops)?;
            ops[to_end] = Op::Jump(ops.len());
        }
        PyExpr::Binary(op, a, b) => {
            if let Some(near) = equal_in_single(*op, a, b) {
                return emit(&near, scope, ops);
            }
            let op = match op {
                PyOp::Add => BinaryOp::Add,
                PyOp::Sub => BinaryOp::Sub,
                PyOp::Mul => BinaryOp::Mul,
                PyOp::Div => BinaryOp::Div,
                PyOp::Pow => BinaryOp::Pow,
                PyOp::Eq => BinaryOp::Eq,
                PyOp::Ne => BinaryOp::Ne,
                PyOp::Lt => BinaryOp::Lt,
                PyOp::Le => BinaryOp::Le,
                PyOp::Gt => BinaryOp::Gt,
                PyOp::Ge => BinaryOp::Ge,
                PyOp::FloorDiv | PyOp::Mod => return emit(&floored(e, *op, a, b, scope)?, scope, ops),
            };
            emit(a, scope, ops)?;
            emit(b, scope, ops)?;
            ops.push(binary(op));
        }
        PyExpr::Call(name, args, range) => return emit_call(name, args, range, scope, ops),
        PyExpr::List(_, range)
        | PyExpr::Change(_, _, range)
        | PyExpr::Index(_, _, range)
        | PyExpr::Each(_, _, _, range) => {
            let why = Refusal::new("a list or an index '[..]' where a number is expected", range.clone());
            return Err(why.remedy("hand the items on, each as a number: A(p[0],p[1]), or A(*p)"));
        }
    }
    Ok(())
}

/// Appends the bytecode of a test: its value, except that `None` and empty strings count as false.
fn emit_test(e: &PyExpr, scope: &Scope, ops: &mut Vec<Op>) -> Result<(), Refusal> {
    if scope.has_none { emit(&tested(e.clone()), scope, ops) } else { emit(e, scope, ops) }
}

/// A test in which all parts are truth values: other parts are replaced by their truth values in Python.
pub(super) fn tested(e: PyExpr) -> PyExpr {
    match e {
        PyExpr::And(a, b) => PyExpr::And(Box::new(tested(*a)), Box::new(tested(*b))),
        PyExpr::Or(a, b) => PyExpr::Or(Box::new(tested(*a)), Box::new(tested(*b))),
        _ if is_truth(&e) => e,
        _ => {
            let range = range_of(&e);
            PyExpr::Call("bool".to_owned(), vec![e], range)
        }
    }
}

/// `a and b` or `a or b` as a choice of one of the operands, as in Python. `None` for other expressions; for truth values, for
/// which the code of `&&` and `||` gives the same; and if an operand draws a random number, which a choice would draw twice.
fn operand_choice(e: &PyExpr, scope: &Scope) -> Option<PyExpr> {
    let is_and = match e {
        PyExpr::And(..) => true,
        PyExpr::Or(..) => false,
        _ => return None,
    };
    let mut all = Vec::new();
    append_operands(e, is_and, &mut all);
    let (last, tested) = all.split_last()?;
    let draws = |o: &PyExpr| !is_truth(o) && has_random(o, scope);
    if all.iter().all(|o| is_truth(o)) || tested.iter().any(|o| draws(o)) {
        return None;
    }
    // Each operand is tested, and is the result if it decides; a truth value that decides is 0 for `and` and 1 for `or`.
    let choice = tested.iter().rev().fold(PyExpr::clone(last), |rest, o| {
        let decided = if is_and { 0.0 } else { 1.0 };
        let own = if is_truth(o) { PyExpr::Number(decided) } else { PyExpr::clone(o) };
        let (then, other) = if is_and { (rest, own) } else { (own, rest) };
        PyExpr::Choice(Box::new(PyExpr::clone(o)), Box::new(then), Box::new(other))
    });
    Some(choice)
}

/// Appends the operands of a chain of `and` (or of `or`) from left to right.
fn append_operands<'e>(e: &'e PyExpr, is_and: bool, out: &mut Vec<&'e PyExpr>) {
    match (e, is_and) {
        (PyExpr::And(a, b), true) | (PyExpr::Or(a, b), false) => {
            append_operands(a, is_and, out);
            append_operands(b, is_and, out);
        }
        _ => out.push(e),
    }
}

/// True if the value is certainly 0 or 1.
fn is_truth(e: &PyExpr) -> bool {
    match e {
        PyExpr::Number(n) => is_zero(*n) || is_zero(*n - 1.0),
        PyExpr::Not(_) => true,
        PyExpr::Binary(op, ..) => op.compares(),
        PyExpr::And(a, b) | PyExpr::Or(a, b) => is_truth(a) && is_truth(b),
        PyExpr::Choice(_, a, b) => is_truth(a) && is_truth(b),
        PyExpr::Call(name, ..) => name == "bool",
        _ => false,
    }
}

/// `a == b` or `a != b` with a number that is not exact in single precision, such as 0.1: parameters have single precision,
/// so that one equals the number if it is the nearest single-precision value. `None` for other comparisons.
fn equal_in_single(op: PyOp, a: &PyExpr, b: &PyExpr) -> Option<PyExpr> {
    let (value, number) = match (a, b) {
        (PyExpr::Number(_), PyExpr::Number(_)) => return None,
        (value, PyExpr::Number(n)) | (PyExpr::Number(n), value) => (value, *n),
        _ => return None,
    };
    #[allow(clippy::cast_possible_truncation, reason = "rounded to single precision")]
    let nearest = f64::from(number as f32);
    if !matches!(op, PyOp::Eq | PyOp::Ne) || is_zero(nearest - number) {
        return None;
    }
    let difference = PyExpr::Binary(PyOp::Sub, Box::new(value.clone()), Box::new(PyExpr::Number(number)));
    let distance = PyExpr::Call("fabs".to_owned(), vec![difference], range_of(value));
    // Rounding to single precision changes a number by at most 2^-24 of its value.
    let most = PyExpr::Number(number.abs() / 16_777_216.0);
    let is_near = PyExpr::Binary(PyOp::Le, Box::new(distance), Box::new(most));
    Some(if op == PyOp::Eq { is_near } else { PyExpr::Not(Box::new(is_near)) })
}

/// `a // b` as floor(a / b), and `a % b` as a - b floor(a / b), which has the sign of b.
fn floored(e: &PyExpr, op: PyOp, a: &PyExpr, b: &PyExpr, scope: &Scope) -> Result<PyExpr, Refusal> {
    let quotient = PyExpr::Binary(PyOp::Div, Box::new(a.clone()), Box::new(b.clone()));
    let floor = PyExpr::Call("floor".into(), vec![quotient], range_of(e));
    if op == PyOp::FloorDiv {
        return Ok(floor);
    }
    if has_random(e, scope) {
        return Err(Refusal::new("a random number in '%'", range_of(e)));
    }
    let whole = PyExpr::Binary(PyOp::Mul, Box::new(b.clone()), Box::new(floor));
    Ok(PyExpr::Binary(PyOp::Sub, Box::new(a.clone()), Box::new(whole)))
}

/// `round(a)`: halves are rounded to the even neighbour.
fn rounded(a: &PyExpr, range: &Range<usize>) -> PyExpr {
    let half = || Box::new(PyExpr::Number(0.5));
    let floor = |e: PyExpr| Box::new(PyExpr::Call("floor".into(), vec![e], range.clone()));
    let part = PyExpr::Binary(PyOp::Mod, Box::new(a.clone()), Box::new(PyExpr::Number(2.0)));
    let is_above_even = PyExpr::Binary(PyOp::Eq, Box::new(part), half());
    let up = PyExpr::Binary(PyOp::Add, Box::new(a.clone()), half());
    PyExpr::Choice(Box::new(is_above_even), floor(a.clone()), floor(up))
}

/// Appends the bytecode of a call of a function of Python or L-Py, which is an operation of the stack machine or an
/// expression of such operations. The arguments are resolved.
fn emit_call(
    name: &str,
    args: &[PyExpr],
    range: &Range<usize>,
    scope: &Scope,
    ops: &mut Vec<Op>,
) -> Result<(), Refusal> {
    let scaled =
        |ops: &mut Vec<Op>, factor: f64| ops.extend([Op::Const(factor), Op::Binary(BinaryOp::Mul, usize::MAX)]);
    let one = |name: &str| UnaryOp::named(name);
    match (name, args) {
        // Angles are in radians in Python, in degrees in the stack machine.
        ("sin" | "cos" | "tan", [a]) => {
            emit(a, scope, ops)?;
            scaled(ops, DEGREES);
            ops.extend(one(name).map(Op::Unary));
        }
        ("asin" | "acos" | "atan", [a]) => {
            emit(a, scope, ops)?;
            ops.extend(one(name).map(Op::Unary));
            scaled(ops, 1.0 / DEGREES);
        }
        ("atan2", [a, b]) => {
            emit(a, scope, ops)?;
            emit(b, scope, ops)?;
            ops.push(Op::Binary(BinaryOp::Atan2, usize::MAX));
            scaled(ops, 1.0 / DEGREES);
        }
        ("radians", [a]) => {
            emit(a, scope, ops)?;
            scaled(ops, 1.0 / DEGREES);
        }
        ("degrees", [a]) => {
            emit(a, scope, ops)?;
            scaled(ops, DEGREES);
        }
        // Functions with an operation of their own, and conversions.
        ("sqrt" | "exp" | "log" | "floor" | "ceil" | "fabs", [a]) => {
            emit(a, scope, ops)?;
            ops.extend(one(name).map(Op::Unary));
        }
        ("abs", [a]) => {
            emit(a, scope, ops)?;
            ops.push(Op::Unary(UnaryOp::Fabs));
        }
        ("float", [a]) => emit(a, scope, ops)?,
        ("bool", [a]) if scope.has_none && !is_truth(a) => {
            emit(a, scope, ops)?;
            ops.extend([Op::Unary(UnaryOp::Fabs), Op::Const(NONE), Op::Binary(BinaryOp::Le, usize::MAX)]);
            ops.push(Op::Unary(UnaryOp::Not));
        }
        ("bool", [a]) => {
            emit(a, scope, ops)?;
            ops.extend([Op::Unary(UnaryOp::Not), Op::Unary(UnaryOp::Not)]);
        }
        // The remainder operation truncates both operands to integers.
        ("int" | "trunc", [a]) => {
            emit(a, scope, ops)?;
            ops.extend([Op::Const(CUT), Op::Binary(BinaryOp::Rem, usize::MAX)]);
        }
        // `Trunc` rounds halves up, whereas Python 3 rounds them to the even neighbour. A random number, which must be drawn
        // only once, is practically never a half.
        ("round", [a]) if has_random(a, scope) => {
            emit(a, scope, ops)?;
            ops.push(Op::Unary(UnaryOp::Trunc));
        }
        ("round", [a]) => emit(&rounded(a, range), scope, ops)?,
        ("pow", [a, b]) => {
            emit(a, scope, ops)?;
            emit(b, scope, ops)?;
            ops.push(Op::Binary(BinaryOp::Pow, usize::MAX));
        }
        // Nested choices between two operands. Both occur twice in the code, so that they must not draw random numbers.
        ("min" | "max", [first, rest @ ..]) if !rest.is_empty() => {
            if args.iter().any(|a| has_random(a, scope)) {
                return Err(Refusal::new(format!("a random number in '{name}'"), range.clone()));
            }
            let op = if name == "min" { PyOp::Le } else { PyOp::Ge };
            let least = rest.iter().fold(first.clone(), |a, b| {
                let test = PyExpr::Binary(op, Box::new(a.clone()), Box::new(b.clone()));
                PyExpr::Choice(Box::new(test), Box::new(a), Box::new(b.clone()))
            });
            emit(&least, scope, ops)?;
        }
        ("log", [a, base]) => {
            let log = |e: &PyExpr| Box::new(PyExpr::Call("log".to_owned(), vec![e.clone()], range.clone()));
            emit(&PyExpr::Binary(PyOp::Div, log(a), log(base)), scope, ops)?;
        }
        ("log10", [a]) => {
            emit(a, scope, ops)?;
            ops.push(Op::Unary(UnaryOp::Log));
            scaled(ops, std::f64::consts::LOG10_E);
        }
        // Round to this number of decimals.
        ("round", [a, digits]) => {
            let digits = constant_of(digits, scope).filter(|d| d.fract().abs() <= 0.0 && d.abs() <= 15.0);
            let digits =
                digits.ok_or_else(|| Refusal::new("digits of 'round' that are not constant", range.clone()))?;
            let unit = format!("1e{digits}").parse().unwrap_or(1.0);
            let unit = || Box::new(PyExpr::Number(unit));
            let larger = PyExpr::Binary(PyOp::Mul, Box::new(a.clone()), unit());
            let whole = PyExpr::Call("round".to_owned(), vec![larger], range.clone());
            emit(&PyExpr::Binary(PyOp::Div, Box::new(whole), unit()), scope, ops)?;
        }
        // Functions without an operation, by their definitions.
        ("hypot" | "fmod" | "sinh" | "cosh" | "tanh", _) if !args.iter().any(|a| has_random(a, scope)) => {
            let call = |name: &str, a: PyExpr| Box::new(PyExpr::Call(name.to_owned(), vec![a], range.clone()));
            let two = |op: PyOp, a: &PyExpr, b: &PyExpr| PyExpr::Binary(op, Box::new(a.clone()), Box::new(b.clone()));
            let e = match (name, args) {
                ("hypot", [a, b]) => {
                    let sum = two(PyOp::Add, &two(PyOp::Mul, a, a), &two(PyOp::Mul, b, b));
                    *call("sqrt", sum)
                }
                // The remainder has the sign of the first number.
                ("fmod", [a, b]) => two(PyOp::Sub, a, &two(PyOp::Mul, b, &call("trunc", two(PyOp::Div, a, b)))),
                (_, [a]) if name != "hypot" && name != "fmod" => {
                    let (up, down) = (call("exp", a.clone()), call("exp", PyExpr::Neg(Box::new(a.clone()))));
                    let (sum, difference) = (two(PyOp::Add, &up, &down), two(PyOp::Sub, &up, &down));
                    match name {
                        "sinh" => two(PyOp::Div, &difference, &PyExpr::Number(2.0)),
                        "cosh" => two(PyOp::Div, &sum, &PyExpr::Number(2.0)),
                        _ => two(PyOp::Div, &difference, &sum),
                    }
                }
                _ => return Err(Refusal::new(format!("this call of '{name}'"), range.clone())),
            };
            emit(&e, scope, ops)?;
        }
        // L-Py counts steps from 0; `Q` counts from 1 in productions, and from 0 in the function before a step.
        ("getIterationNb", []) if scope.is_before_step => ops.push(Op::Step),
        ("getIterationNb", []) => {
            ops.extend([Op::Step, Op::Const(1.0), Op::Binary(BinaryOp::Sub, usize::MAX)]);
        }
        // Random numbers.
        ("random", []) => ops.extend([Op::Const(1.0), Op::Random(RandomFunction::Ran)]),
        ("ran", [a]) => {
            emit(a, scope, ops)?;
            ops.push(Op::Random(RandomFunction::Ran));
        }
        ("uniform", [a, b]) => {
            emit(a, scope, ops)?;
            emit(b, scope, ops)?;
            ops.push(Op::Random(RandomFunction::Uniform));
        }
        // A random integer from a to b, both included.
        ("randint", [a, b]) => {
            emit(a, scope, ops)?;
            emit(b, scope, ops)?;
            ops.extend([Op::Const(1.0), Op::Binary(BinaryOp::Add, usize::MAX), Op::Random(RandomFunction::Uniform)]);
            ops.push(Op::Unary(UnaryOp::Floor));
        }
        // A random integer below b.
        ("randrange", [bounds @ .., b]) if bounds.len() <= 1 => {
            emit(bounds.first().unwrap_or(&PyExpr::Number(0.0)), scope, ops)?;
            emit(b, scope, ops)?;
            ops.extend([Op::Random(RandomFunction::Uniform), Op::Unary(UnaryOp::Floor)]);
        }
        ("gauss" | "normalvariate" | "normal", [a, b]) => {
            emit(a, scope, ops)?;
            emit(b, scope, ops)?;
            ops.push(Op::Random(RandomFunction::Nran));
        }
        // The call of a function held by a variable; a missing function is reported at this place.
        (APPLY, [function, x]) => {
            emit(function, scope, ops)?;
            emit(x, scope, ops)?;
            ops.push(Op::Table(TableFunction::Func, scope.call_place(range)));
        }
        // Values that are not numbers, functions compiled to code, and unknown functions.
        _ if is_joined_text(&PyExpr::Call(name.to_owned(), args.to_vec(), range.clone())) => {
            return Err(joined_text_refusal(range.clone()));
        }
        _ if array_of(name, &scope.arrays).is_some() => {
            for arg in args {
                emit(arg, scope, ops)?;
            }
            ops.extend(array_of(name, &scope.arrays).map(Op::LoadElement));
        }
        _ if name == OBJECT => {
            let why = Refusal::new("an object where a number is expected", range.clone());
            return Err(why.remedy("read one of its attributes: p.age"));
        }
        _ if name == DICTIONARY => {
            let why = Refusal::new("a dictionary '{..}' where a number is expected", range.clone());
            return Err(why.remedy("write the dictionary outside of the productions, and look up its values: d[key]"));
        }
        _ if gives_vector(name) => {
            let why = Refusal::new("a vector where a number is expected", range.clone());
            return Err(why.remedy("write one of its coordinates, v.x"));
        }
        _ if name.starts_with(RUN) => {
            let called = name.strip_prefix(RUN).and_then(|own| scope.run_index(own));
            let called = called.ok_or_else(|| scope.refused_call(name, range.clone()))?;
            for arg in args {
                emit(arg, scope, ops)?;
            }
            ops.push(Op::Call(called));
        }
        _ if name.ends_with('=') => return Err(Refusal::new("an argument with a name", range.clone())),
        _ => return Err(scope.refused_call(name, range.clone())),
    }
    Ok(())
}

/// Appends code after other code, shifting its jump targets.
pub(super) fn append_code(ops: &mut Vec<Op>, code: &[Op]) {
    let offset = ops.len();
    ops.extend(code.iter().map(|op| shifted(*op, offset)));
}

/// An instruction with its jump target shifted.
fn shifted(op: Op, by: usize) -> Op {
    match op {
        Op::Jump(t) => Op::Jump(t + by),
        Op::JumpIfZero(t) => Op::JumpIfZero(t + by),
        Op::And(t) => Op::And(t + by),
        Op::Or(t) => Op::Or(t + by),
        other => other,
    }
}
