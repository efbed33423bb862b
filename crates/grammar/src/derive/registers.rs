//! Compiles expressions to operations on registers: constants are folded, and equal operations are computed once for a whole
//! production. Expressions with branches, random draws or side effects remain code of the stack machine.

use crate::code::{BinaryOp, Bytecode, Expr, Op, UnaryOp, is_zero, truth};
use crate::vm::Vm;

/// Number of registers of a production; expressions that need more remain code. A power of two, so that masked indices are
/// in range.
const REGISTERS: usize = 128;

/// The registers that an operation can address: the fixed-size start of a [`RegisterFile`].
type Registers = [f64; REGISTERS];

/// Values that the expressions of one production read and write: local variables first, then constants and results.
/// Operations can address only the first [`REGISTERS`]; a production may have more local variables.
pub(super) type RegisterFile = Vec<f64>;

/// Index into the first `REGISTERS` values of a [`RegisterFile`].
type Register = u8;

/// Computation of an operation; those with one operand read only `a`.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Action {
    Unary(UnaryOp),
    Binary(BinaryOp),
    And,
    Or,
    /// 1 if the operand is not zero, else 0.
    Truth,
}

/// Stores in register `result` the result of an action on registers `a` and `b`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Operation {
    action: Action,
    a: Register,
    b: Register,
    result: Register,
}

/// A condition that compares one parameter with a constant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ParameterTest {
    /// Index of the parameter in the module.
    pub parameter: usize,
    comparison: BinaryOp,
    constant: f64,
}

impl ParameterTest {
    /// True if the condition holds for a module with these parameters; false if the parameter is missing.
    #[inline]
    #[allow(clippy::float_cmp, reason = "the grammar language compares exactly")]
    pub fn holds(&self, params: &[f32]) -> bool {
        let (Some(value), c) = (params.get(self.parameter), self.constant) else { return false };
        let value = f64::from(*value);
        match self.comparison {
            BinaryOp::Lt => value < c,
            BinaryOp::Le => value <= c,
            BinaryOp::Gt => value > c,
            BinaryOp::Ge => value >= c,
            BinaryOp::Eq => value == c,
            _ => value != c,
        }
    }
}

/// A value that is loaded into a register before a production is tested.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum OutsideValue {
    Global(u16),
    /// Number of the present step, `Q` in grammars.
    Step,
    /// Derivation length, `Z` in grammars.
    Length,
    /// Number of derivation steps after this one, `remaining` in grammars.
    Remaining,
}

/// Source of an expression's value: known at compile time, computed in a register, or left to the stack machine.
#[derive(Debug, Clone, Copy)]
pub(super) enum ValueSource<'p> {
    Constant(f64),
    /// Index in the register file that holds the value after the operations of the production.
    Register(u16),
    Code(&'p Bytecode),
}

/// Compiles the expressions of one production to operations on registers; equal constants and results share a register.
#[derive(Debug)]
pub(super) struct RegisterCompiler {
    /// Initial values of the registers: constants, and 0 for all others.
    initial: Box<Registers>,
    used: usize,
    /// First register after the local variables; the later ones hold constants, loaded values and results.
    first_free: usize,
    locals: usize,
    is_constant: [bool; REGISTERS],
    outside: Vec<(Register, OutsideValue)>,
    operations: Vec<Operation>,
}

/// State of the compiler, to undo a failed translation.
struct CompilerMark {
    used: usize,
    outside: usize,
    operations: usize,
}

/// Operations of the condition and of the successor of one production, and the initial values of their registers.
#[derive(Debug)]
pub(super) struct RegisterCode {
    pub initial: RegisterFile,
    /// Registers to load before the condition is tested, with the source of each value.
    pub outside: Vec<(Register, OutsideValue)>,
    /// Operations of the condition, then those of the successor.
    operations: Vec<Operation>,
    condition_end: usize,
    /// True if the operations of the successor cannot divide by zero.
    pub cannot_fail: bool,
}

impl RegisterCompiler {
    /// Creates a compiler for a production whose first `locals` registers, at most [`REGISTERS`], hold its local variables.
    pub fn new(locals: usize) -> Self {
        let first_free = locals.min(REGISTERS);
        Self {
            initial: Box::new([0.0; REGISTERS]),
            used: first_free,
            first_free,
            locals,
            is_constant: [false; REGISTERS],
            outside: Vec::new(),
            operations: Vec::new(),
        }
    }

    pub fn operation_count(&self) -> usize {
        self.operations.len()
    }

    /// Compiles a parameter of a successor; a local variable beyond those of the production reads as 0.
    pub fn expression<'p>(&mut self, e: &'p Expr) -> ValueSource<'p> {
        match e {
            Expr::Const(c) => ValueSource::Constant(*c),
            Expr::Local(i) if usize::from(*i) < self.locals => ValueSource::Register(*i),
            // A slot without a variable reads as 0.
            Expr::Local(_) => ValueSource::Constant(0.0),
            Expr::Code(code) => self.code(code),
        }
    }

    /// Compiles a condition, a weight or a computed parameter; code that does not fit into registers is left to the stack
    /// machine.
    pub fn code<'p>(&mut self, code: &'p Bytecode) -> ValueSource<'p> {
        let mark = CompilerMark { used: self.used, outside: self.outside.len(), operations: self.operations.len() };
        match self.translate(code) {
            Some(r) if self.is_constant[usize::from(r)] => ValueSource::Constant(self.initial[usize::from(r)]),
            Some(r) => ValueSource::Register(r.into()),
            None => {
                // Undo the partial translation.
                self.is_constant[mark.used..].fill(false);
                self.used = mark.used;
                self.outside.truncate(mark.outside);
                self.operations.truncate(mark.operations);
                ValueSource::Code(code)
            }
        }
    }

    /// The test that the operations before `condition_end` compute, if they compare one local variable with a constant.
    pub fn parameter_test(&self, condition_end: usize) -> Option<ParameterTest> {
        let [Operation { action: Action::Binary(op), a, b, .. }] = self.operations.get(..condition_end)? else {
            return None;
        };
        let (a, b) = (usize::from(*a), usize::from(*b));
        // Mirror the comparison: `0 < x` is `x > 0`.
        let turned = match op {
            BinaryOp::Lt => BinaryOp::Gt,
            BinaryOp::Le => BinaryOp::Ge,
            BinaryOp::Gt => BinaryOp::Lt,
            BinaryOp::Ge => BinaryOp::Le,
            BinaryOp::Eq | BinaryOp::Ne => *op,
            _ => return None,
        };
        if a < self.locals && self.is_constant[b] {
            Some(ParameterTest { parameter: a, comparison: *op, constant: self.initial[b] })
        } else if b < self.locals && self.is_constant[a] {
            Some(ParameterTest { parameter: b, comparison: turned, constant: self.initial[a] })
        } else {
            None
        }
    }

    /// The finished code; operations before `condition_end` belong to the condition.
    pub fn finish(self, condition_end: usize) -> RegisterCode {
        let (values, constant) = (&self.initial, &self.is_constant);
        let divides = |o: &Operation| matches!(o.action, Action::Binary(BinaryOp::Div | BinaryOp::Rem));
        let is_safe = |o: &Operation| {
            let b = usize::from(o.b);
            !divides(o) || (constant[b] && values[b].trunc().abs() >= 1.0)
        };
        let cannot_fail = self.operations[condition_end..].iter().all(is_safe);
        let mut initial = self.initial.to_vec();
        initial.resize(self.locals.max(REGISTERS), 0.0);
        RegisterCode { initial, outside: self.outside, operations: self.operations, condition_end, cannot_fail }
    }

    /// Compiles `code` and returns the register that holds its value; `None` if the code needs the stack machine.
    fn translate(&mut self, code: &Bytecode) -> Option<Register> {
        // The stack of the machine, which holds registers instead of values.
        let mut stack: Vec<Register> = Vec::new();
        // `&&` and `||` whose right side is being compiled: its end, the left side, the action. Both sides are evaluated,
        // because the only side effect of the right one is the warning of a division by zero, for which the stack machine
        // runs the code.
        let mut pending: Vec<(usize, Register, Action)> = Vec::new();
        for pc in 0..=code.ops.len() {
            while let Some(&(_, a, action)) = pending.last().filter(|p| p.0 == pc) {
                pending.pop();
                let b = stack.pop()?;
                stack.push(self.operation(action, a, b)?);
            }
            let Some(op) = code.ops.get(pc) else { break };
            let register = match *op {
                Op::Const(c) => self.constant(c)?,
                Op::Local(i) if usize::from(i) < self.first_free => u8::try_from(i).ok()?,
                Op::Global(i) => self.outside_value(OutsideValue::Global(i))?,
                Op::Step => self.outside_value(OutsideValue::Step)?,
                Op::Length => self.outside_value(OutsideValue::Length)?,
                Op::Remaining => self.outside_value(OutsideValue::Remaining)?,
                Op::Unary(f) => {
                    let a = stack.pop()?;
                    self.operation(Action::Unary(f), a, a)?
                }
                Op::Binary(f, _) => {
                    let b = stack.pop()?;
                    let a = stack.pop()?;
                    self.operation(Action::Binary(f), a, b)?
                }
                Op::Bool => {
                    let a = stack.pop()?;
                    self.operation(Action::Truth, a, a)?
                }
                Op::And(end) | Op::Or(end) => {
                    let action = if matches!(op, Op::And(_)) { Action::And } else { Action::Or };
                    pending.push((end, stack.pop()?, action));
                    continue;
                }
                _ => return None,
            };
            stack.push(register);
        }
        let result = stack.pop()?;
        (stack.is_empty() && pending.is_empty()).then_some(result)
    }

    fn free_register(&mut self) -> Option<Register> {
        let r = u8::try_from(self.used).ok().filter(|_| self.used < REGISTERS)?;
        self.used += 1;
        Some(r)
    }

    fn constant(&mut self, value: f64) -> Option<Register> {
        let known = (self.first_free..self.used)
            .find(|i| self.is_constant[*i] && self.initial[*i].to_bits() == value.to_bits());
        if let Some(i) = known {
            return u8::try_from(i).ok();
        }
        let r = self.free_register()?;
        self.initial[usize::from(r)] = value;
        self.is_constant[usize::from(r)] = true;
        Some(r)
    }

    fn outside_value(&mut self, value: OutsideValue) -> Option<Register> {
        if let Some((r, _)) = self.outside.iter().find(|(_, v)| *v == value) {
            return Some(*r);
        }
        let r = self.free_register()?;
        self.outside.push((r, value));
        Some(r)
    }

    /// The register of an operation's result: a constant if its operands are constant, or the register of an equal
    /// operation.
    fn operation(&mut self, action: Action, a: Register, b: Register) -> Option<Register> {
        let (ia, ib) = (usize::from(a), usize::from(b));
        if self.is_constant[ia]
            && self.is_constant[ib]
            && let Some(value) = compute(action, self.initial[ia], self.initial[ib])
        {
            return self.constant(value);
        }
        // Operations that may divide by zero are not shared, because each place of such a division is reported.
        let may_fail = matches!(action, Action::Binary(BinaryOp::Div | BinaryOp::Rem)) && !self.is_constant[ib];
        let equal = |o: &&Operation| o.action == action && o.a == a && o.b == b && !may_fail;
        if let Some(o) = self.operations.iter().find(equal) {
            return Some(o.result);
        }
        let result = self.free_register()?;
        self.operations.push(Operation { action, a, b, result });
        Some(result)
    }
}

/// Result of an action; `None` for a division by zero.
#[inline(always)]
fn compute(action: Action, a: f64, b: f64) -> Option<f64> {
    Some(match action {
        // The common operations come first, without a test for a division by zero.
        Action::Binary(BinaryOp::Add) => a + b,
        Action::Binary(BinaryOp::Sub) => a - b,
        Action::Binary(BinaryOp::Mul) => a * b,
        Action::Binary(f) => {
            let (value, by_zero) = f.apply(a, b);
            if by_zero {
                return None;
            }
            value
        }
        Action::Unary(f) => f.apply(a),
        Action::And => truth(!is_zero(a) && !is_zero(b)),
        Action::Or => truth(!is_zero(a) || !is_zero(b)),
        Action::Truth => truth(!is_zero(a)),
    })
}

impl RegisterCode {
    /// Loads the registers of global variables, step, derivation length and remaining steps.
    #[inline]
    pub fn load_outside(&self, vm: &Vm, file: &mut [f64]) {
        for (r, value) in &self.outside {
            file[usize::from(*r)] = match value {
                OutsideValue::Global(i) => vm.globals.get(usize::from(*i)).copied().unwrap_or(0.0),
                OutsideValue::Step => f64::from(vm.step),
                OutsideValue::Length => f64::from(vm.length),
                OutsideValue::Remaining => f64::from(vm.length) - f64::from(vm.step),
            };
        }
    }

    /// Runs the operations of the condition; false after a division by zero, which the stack machine must then report.
    #[inline]
    pub fn run_condition(&self, file: &mut [f64]) -> bool {
        run(&self.operations[..self.condition_end], file)
    }

    /// Runs the operations of the successor; false after a division by zero.
    #[inline]
    pub fn run_successor(&self, file: &mut [f64]) -> bool {
        run(&self.operations[self.condition_end..], file)
    }
}

#[inline]
fn run(operations: &[Operation], file: &mut [f64]) -> bool {
    // Check the length once for all operations: masked register numbers are then in range.
    let Some(file) = file.first_chunk_mut::<REGISTERS>() else { return false };
    for o in operations {
        let (a, b) = (file[usize::from(o.a) % REGISTERS], file[usize::from(o.b) % REGISTERS]);
        let Some(value) = compute(o.action, a, b) else { return false };
        file[usize::from(o.result) % REGISTERS] = value;
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::read;
    use crate::vm::RandomStreams;

    /// Value of a condition by registers and by the stack machine, with x = 3, y = 0, in step 4 of 9.
    fn both(condition: &str) -> (Option<f64>, f64) {
        let text = format!("Lsystem: 1\nderivation length: 1\nAxiom: A(1,2)\nA(x,y) : {condition} --> B\nendlsystem\n");
        let (grammar, _) = read(&text);
        let code = grammar.program.rules.list[0].condition.as_ref().expect("a condition");
        let mut vm = Vm::new(RandomStreams::new(1, 0, 0), 0, 9);
        vm.step = 4;
        let mut compiler = RegisterCompiler::new(2);
        let by_registers = match compiler.code(code) {
            ValueSource::Constant(c) => Some(c),
            ValueSource::Code(_) => None,
            ValueSource::Register(r) => {
                let code = compiler.finish(0);
                let mut file = code.initial.clone();
                (file[0], file[1]) = (3.0, 0.0);
                code.load_outside(&vm, &mut file);
                code.run_successor(&mut file).then(|| file[usize::from(r)])
            }
        };
        (by_registers, vm.run(code, &mut [3.0, 0.0]).expect("runs"))
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
            "x*x+x*x+x*x",
        ] {
            let (registers, machine) = both(condition);
            assert_eq!(registers, Some(machine), "{condition}");
        }
    }

    #[test]
    fn code_that_needs_the_machine_is_left_to_it() {
        for condition in ["x/y", "x ? 1 : 2", "ran(1) > 2", "x && 5/0"] {
            assert_eq!(both(condition).0, None, "{condition}");
        }
        let sum = (0..200).map(|i| format!("x*{i}.5")).collect::<Vec<_>>().join("+");
        assert_eq!(both(&sum).0, None, "more operations than registers");
    }
}
