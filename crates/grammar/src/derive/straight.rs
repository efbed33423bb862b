//! Expressions in the form in which a derivation evaluates them: arithmetic as a list of operations on registers, everything
//! else as code of the stack machine.

use crate::code::{BinaryOp, Bytecode, Expr, Op, UnaryOp, is_zero, truth};
use crate::vm::{Halt, Vm};

/// Operations of one expression; longer ones stay code. Each result needs a register.
const MAX_OPERATIONS: usize = 24;

/// Where an operation finds a number.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Operand {
    Constant(f64),
    Local(u16),
    Global(u16),
    /// Result of an earlier operation.
    Register(u8),
    /// `Q`.
    Step,
    /// `Z`.
    Length,
    /// `remaining`.
    Remaining,
}

/// One operation; its result goes to the register of its own number.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Operation {
    Unary(UnaryOp, Operand),
    Binary(BinaryOp, Operand, Operand),
    And(Operand, Operand),
    Or(Operand, Operand),
    /// 1 for a number that is not zero.
    Truth(Operand),
}

/// Arithmetic without branches, random draws and side effects.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct StraightLine {
    operations: Vec<Operation>,
    result: Operand,
}

/// How an expression is evaluated.
#[derive(Debug, Clone)]
pub(super) enum Evaluation<'p> {
    Constant(f64),
    Local(u16),
    /// Arithmetic, and the code that it equals: that one runs where a division by zero must be reported.
    Straight(StraightLine, &'p Bytecode),
    Code(&'p Bytecode),
}

impl<'p> Evaluation<'p> {
    /// The evaluation of a successor's parameter.
    pub fn of_expr(e: &'p Expr) -> Self {
        match e {
            Expr::Const(c) => Self::Constant(*c),
            Expr::Local(i) => Self::Local(*i),
            Expr::Code(code) => Self::of_code(code),
        }
    }

    /// The evaluation of a condition or a weight.
    pub fn of_code(code: &'p Bytecode) -> Self {
        match StraightLine::from_code(code) {
            None => Self::Code(code),
            Some(StraightLine { operations, result }) => match result {
                Operand::Constant(c) if operations.is_empty() => Self::Constant(c),
                Operand::Local(i) if operations.is_empty() => Self::Local(i),
                _ => Self::Straight(StraightLine { operations, result }, code),
            },
        }
    }

    /// Value for the local variables `locals`.
    /// # Errors
    /// Those of [`Vm::run`].
    #[inline]
    pub fn value(&self, vm: &mut Vm, locals: &mut [f64]) -> Result<f64, Halt> {
        match self {
            Self::Constant(c) => Ok(*c),
            Self::Local(i) => Ok(locals.get(usize::from(*i)).copied().unwrap_or(0.0)),
            Self::Straight(line, code) => match line.value(vm, locals) {
                Some(v) => Ok(v),
                None => vm.run(code, locals),
            },
            Self::Code(code) => vm.run(code, locals),
        }
    }
}

impl StraightLine {
    /// Translates code; `None` for code with branches, draws or side effects.
    fn from_code(code: &Bytecode) -> Option<Self> {
        let mut operations: Vec<Operation> = Vec::new();
        // The stack of the machine, with the places of the numbers instead of the numbers.
        let mut stack: Vec<Operand> = Vec::new();
        // `&&` and `||` whose right side is being read: where it ends, the left side, and which of the two it is. Both sides are
        // evaluated: the right one has no side effect but the warning of a division by zero, for which the code itself is run.
        let mut pending: Vec<(usize, Operand, bool)> = Vec::new();
        for (pc, op) in code.ops.iter().enumerate() {
            close_pending(&mut pending, pc, &mut operations, &mut stack)?;
            match *op {
                Op::Const(c) => stack.push(Operand::Constant(c)),
                Op::Local(i) => stack.push(Operand::Local(i)),
                Op::Global(i) => stack.push(Operand::Global(i)),
                Op::Step => stack.push(Operand::Step),
                Op::Length => stack.push(Operand::Length),
                Op::Remaining => stack.push(Operand::Remaining),
                Op::Unary(f) => {
                    let a = stack.pop()?;
                    push_operation(Operation::Unary(f, a), &mut operations, &mut stack)?;
                }
                Op::Binary(f, _) => {
                    let b = stack.pop()?;
                    let a = stack.pop()?;
                    push_operation(Operation::Binary(f, a, b), &mut operations, &mut stack)?;
                }
                Op::And(end) => pending.push((end, stack.pop()?, true)),
                Op::Or(end) => pending.push((end, stack.pop()?, false)),
                Op::Bool => {
                    let a = stack.pop()?;
                    push_operation(Operation::Truth(a), &mut operations, &mut stack)?;
                }
                _ => return None,
            }
        }
        close_pending(&mut pending, code.ops.len(), &mut operations, &mut stack)?;
        let result = stack.pop()?;
        (stack.is_empty() && pending.is_empty()).then_some(Self { operations, result })
    }

    /// Value; `None` where a division by zero occurs on the way.
    #[inline]
    fn value(&self, vm: &Vm, locals: &[f64]) -> Option<f64> {
        let mut registers = [0.0; MAX_OPERATIONS];
        let read = |o: Operand, registers: &[f64; MAX_OPERATIONS]| match o {
            Operand::Constant(c) => c,
            Operand::Local(i) => locals.get(usize::from(i)).copied().unwrap_or(0.0),
            Operand::Global(i) => vm.globals.get(usize::from(i)).copied().unwrap_or(0.0),
            Operand::Register(i) => registers.get(usize::from(i)).copied().unwrap_or(0.0),
            Operand::Step => f64::from(vm.step),
            Operand::Length => f64::from(vm.length),
            Operand::Remaining => f64::from(vm.length) - f64::from(vm.step),
        };
        for (i, operation) in self.operations.iter().enumerate() {
            let value = match *operation {
                Operation::Unary(f, a) => f.apply(read(a, &registers)),
                Operation::Binary(f, a, b) => {
                    let (value, by_zero) = f.apply(read(a, &registers), read(b, &registers));
                    if by_zero {
                        return None;
                    }
                    value
                }
                Operation::And(a, b) => truth(!is_zero(read(a, &registers)) && !is_zero(read(b, &registers))),
                Operation::Or(a, b) => truth(!is_zero(read(a, &registers)) || !is_zero(read(b, &registers))),
                Operation::Truth(a) => truth(!is_zero(read(a, &registers))),
            };
            if let Some(register) = registers.get_mut(i) {
                *register = value;
            }
        }
        Some(read(self.result, &registers))
    }
}

/// Completes every `&&` and `||` whose right side ends before the instruction `pc`.
fn close_pending(
    pending: &mut Vec<(usize, Operand, bool)>,
    pc: usize,
    operations: &mut Vec<Operation>,
    stack: &mut Vec<Operand>,
) -> Option<()> {
    while let Some(&(end, a, is_and)) = pending.last()
        && end == pc
    {
        pending.pop();
        let b = stack.pop()?;
        push_operation(if is_and { Operation::And(a, b) } else { Operation::Or(a, b) }, operations, stack)?;
    }
    Some(())
}

/// Adds an operation, or its value where its operands are constants, and pushes where the result lies; `None` if there are too
/// many.
fn push_operation(operation: Operation, operations: &mut Vec<Operation>, stack: &mut Vec<Operand>) -> Option<()> {
    let folded = match operation {
        Operation::Unary(f, Operand::Constant(a)) => Some(f.apply(a)),
        Operation::Binary(f, Operand::Constant(a), Operand::Constant(b)) => {
            let (value, by_zero) = f.apply(a, b);
            (!by_zero).then_some(value)
        }
        Operation::Truth(Operand::Constant(a)) => Some(truth(!is_zero(a))),
        _ => None,
    };
    if let Some(value) = folded {
        stack.push(Operand::Constant(value));
        return Some(());
    }
    // The same operation on the same operands gives the same number: its register is read again.
    let known = operations.iter().position(|o| *o == operation);
    let register = known.unwrap_or(operations.len());
    if known.is_none() {
        if operations.len() >= MAX_OPERATIONS {
            return None;
        }
        operations.push(operation);
    }
    stack.push(Operand::Register(u8::try_from(register).ok()?));
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::read;
    use crate::vm::RandomStreams;

    /// Value of a condition by registers and by the stack machine, with x = 3 and y = 0.
    fn both(condition: &str) -> (Option<f64>, f64) {
        let text =
            format!("Lsystem: 1\nderivation length: 1\nAxiom: A(1,2)\nA(x,y) : {condition} --> B\nendlsystem\n");
        let (grammar, _) = read(&text);
        let code = grammar.program.rules.list[0].condition.as_ref().expect("a condition");
        let mut vm = Vm::new(RandomStreams::new(1, 0, 0), 0, 9);
        vm.step = 4;
        let straight = StraightLine::from_code(code).and_then(|line| line.value(&vm, &[3.0, 0.0]));
        (straight, vm.run(code, &mut [3.0, 0.0]).expect("runs"))
    }

    #[test]
    fn registers_compute_what_the_stack_machine_computes() {
        for condition in [
            "x+2*x-(x-1)/2",
            "x > 2 && y < 1",
            "x > 5 && y < 1 || x == 3",
            "(x > 5 || y) && (x || y) || !y",
            "-x^2 + sin(30)*x % 2",
            "Q + Z*10 + remaining*100",
            "1 && (2 && (x && 3))",
            "2*3+4 > 9",
        ] {
            let (straight, machine) = both(condition);
            assert_eq!(straight, Some(machine), "{condition}");
        }
    }

    #[test]
    fn code_that_needs_the_machine_is_left_to_it() {
        for condition in ["x/y", "x ? 1 : 2", "ran(1) > 2", "x && 5/0"] {
            assert_eq!(both(condition).0, None, "{condition}");
        }
    }
}
