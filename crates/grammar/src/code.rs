//! Expressions and statements as code for a small stack machine.

use std::sync::{Arc, OnceLock};

use super::functions::FunctionTables;
use super::print_format::PrintFormat;
use super::token::SourcePlace;

/// Functions of one argument without side effects; angles in degrees, truth values 1 or 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum UnaryOp {
    Neg,
    Not,
    Sin,
    Cos,
    Tan,
    Asin,
    Acos,
    Atan,
    Exp,
    Log,
    Sqrt,
    Fabs,
    Floor,
    Ceil,
    Trunc,
    Sign,
}

/// Arithmetic, comparisons (1 or 0) and `atan2`; `&&` and `||` are not among them, as they compile to jumps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum BinaryOp {
    Add,
    Sub,
    Mul,
    Div,
    Rem,
    Pow,
    Eq,
    Ne,
    Lt,
    Le,
    Gt,
    Ge,
    Atan2,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum RandomFunction {
    Ran,
    Nran,
    Bran,
    Biran,
    /// Random number between two bounds, evenly distributed; only in angle definitions.
    Uniform,
}

/// Functions that read the tables of companion files; the first argument is the number of a function or of a curve.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum TableFunction {
    Func,
    /// A coordinate of a point of a curve: 0 is x, 1 is y, 2 is z.
    Curve(u8),
    CurveLength,
}

impl TableFunction {
    /// The function with this name, and its number of arguments; `None` for other names.
    pub fn named(name: &str) -> Option<(Self, usize)> {
        Some(match name {
            "func" => (Self::Func, 2),
            "curveX" => (Self::Curve(0), 2),
            "curveY" => (Self::Curve(1), 2),
            "curveZ" => (Self::Curve(2), 2),
            "curveGAL" => (Self::CurveLength, 1),
            _ => return None,
        })
    }

    /// Value at `x` of table `id`; `None` if there is no such table.
    pub fn value(self, tables: &FunctionTables, id: f64, x: f64) -> Option<f64> {
        match self {
            Self::Func => tables.value(id, x),
            Self::Curve(axis) => tables.curve(id, x)?.get(usize::from(axis)).copied(),
            Self::CurveLength => tables.curve_length(id),
        }
    }
}

/// Instruction of the stack machine; most pop their operands and push their result.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Op {
    Const(f64),
    Local(u16),
    Global(u16),
    StoreLocal(u16),
    StoreGlobal(u16),
    /// Pops the indices, pushes an element; index into [`Bytecode::elements`].
    LoadElement(usize),
    /// Pops a value and the indices; index into [`Bytecode::elements`].
    StoreElement(usize),
    /// Pushes `Q`, the number of the current step.
    Step,
    /// Pushes `Z`, the derivation length.
    Length,
    /// Pushes `remaining` = `Z` - `Q`.
    Remaining,
    Unary(UnaryOp),
    /// Operator and index into [`Bytecode::places`], for division by zero.
    Binary(BinaryOp, usize),
    Random(RandomFunction),
    /// Pops this number of pairs (value, share); pushes one of the values, drawn in proportion to the shares.
    Choose(usize),
    Srand,
    /// Pushes a bound of the last interpretation: least x, y, z, then greatest x, y, z.
    Bounds(u8),
    /// Looks up a table; the index into [`Bytecode::places`] is for the warning about a missing table.
    Table(TableFunction, usize),
    /// Sets the number of the next random draw back to 0, as at the start of the run.
    RestartDraws,
    Stop,
    /// Pops the arguments of a `printf`, pushes 0; index into [`Bytecode::formats`].
    Print(usize),
    Pop,
    Jump(usize),
    /// Pops; jumps if zero.
    JumpIfZero(usize),
    /// Pops; if zero pushes 0 and jumps.
    And(usize),
    /// Pops; if not zero pushes 1 and jumps.
    Or(usize),
    /// Pops; pushes 1 or 0.
    Bool,
    /// Calls a function: pops its arguments and pushes its value; index into [`Bytecode::functions`].
    Call(usize),
    /// Counts a statement or a loop test against the budget of statements, and ends a loop of too many iterations; index
    /// into [`Bytecode::places`].
    Count(usize),
}

/// Code of an expression or a block of statements, with the tables that its instructions index.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Bytecode {
    pub ops: Vec<Op>,
    pub places: Vec<SourcePlace>,
    /// The tables that [`Op::Table`] reads.
    pub tables: Option<Arc<FunctionTables>>,
    /// Operands of [`Op::LoadElement`] and [`Op::StoreElement`].
    pub elements: Vec<ElementAccess>,
    /// Operands of [`Op::Print`]; their `place` is an index into `places`.
    pub formats: Vec<PrintFormat>,
    /// The functions that [`Op::Call`] calls; set once the whole grammar is read.
    pub functions: Option<Arc<OnceLock<Vec<CalledFunction>>>>,
}

/// A recursive function, compiled to code of its own. Its parameters are the local variables of its code.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct CalledFunction {
    pub parameters: usize,
    /// An expression that leaves its value on the stack; the indices of its [`Op::Call`]s refer to the functions of the
    /// calling code.
    pub code: Bytecode,
    pub place: SourcePlace,
}

/// An array of a `Define:` block; its elements are consecutive global variables, the last index changes fastest.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct ArrayShape {
    /// Slot of its first element.
    pub first: u16,
    pub sizes: Vec<u32>,
}

/// An access to an array element: the array, and the place in the source for messages. The indices lie on the stack at run
/// time.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct ElementAccess {
    pub shape: ArrayShape,
    pub name: String,
    pub place: SourcePlace,
}

impl ArrayShape {
    /// Slot of the element with these indices, truncated to integers; `None` outside the array.
    pub fn slot(&self, indices: &[f64]) -> Option<usize> {
        let mut offset = 0_usize;
        for (index, size) in indices.iter().zip(&self.sizes) {
            let i = index.trunc();
            if !(i >= 0.0 && i < f64::from(*size)) {
                return None;
            }
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "inside the array")]
            let i = i as usize;
            // Horner's scheme: the last index changes fastest.
            offset = offset * (*size as usize) + i;
        }
        Some(usize::from(self.first) + offset)
    }
}

/// A parameter of a successor. Constants and plain variables, the common cases, need neither the stack machine nor memory of
/// their own, since a long axiom has millions of them.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Expr {
    Const(f64),
    Local(u16),
    Code(Box<Bytecode>),
}

impl Bytecode {
    /// Unwraps code that is only a constant or a local variable.
    pub fn into_expr(self) -> Expr {
        match self.ops.as_slice() {
            [Op::Const(c)] => Expr::Const(*c),
            [Op::Local(i)] => Expr::Local(*i),
            _ => Expr::Code(Box::new(self)),
        }
    }

    /// Appends code that was compiled separately: its jump targets and indices are shifted by the length of the code before it.
    pub fn append(&mut self, code: Self) {
        let (shift, places, elements) = (self.ops.len(), self.places.len(), self.elements.len());
        let formats = self.formats.len();
        self.places.extend(code.places);
        self.elements.extend(code.elements);
        self.formats.extend(code.formats.into_iter().map(|mut f| {
            f.place += places;
            f
        }));
        // All code of a grammar reads the same tables.
        self.tables = self.tables.take().or(code.tables);
        self.functions = self.functions.take().or(code.functions);
        self.ops.extend(code.ops.into_iter().map(|op| match op {
            Op::Jump(t) => Op::Jump(t + shift),
            Op::JumpIfZero(t) => Op::JumpIfZero(t + shift),
            Op::And(t) => Op::And(t + shift),
            Op::Or(t) => Op::Or(t + shift),
            Op::Binary(b, p) => Op::Binary(b, p + places),
            Op::Table(f, p) => Op::Table(f, p + places),
            Op::Count(p) => Op::Count(p + places),
            Op::LoadElement(k) => Op::LoadElement(k + elements),
            Op::StoreElement(k) => Op::StoreElement(k + elements),
            Op::Print(k) => Op::Print(k + formats),
            other => other,
        }));
    }

    /// True if finite operands may yield infinity or NaN, as with `exp`, `log`, `*`, `/` and `^`.
    pub fn may_overflow(&self) -> bool {
        let risky = |o: &Op| match o {
            Op::Unary(f) => {
                // Functions whose value may be infinite or NaN for a finite argument.
                matches!(f, UnaryOp::Exp | UnaryOp::Log | UnaryOp::Sqrt | UnaryOp::Tan | UnaryOp::Asin | UnaryOp::Acos)
            }
            Op::Binary(f, _) => matches!(f, BinaryOp::Mul | BinaryOp::Div | BinaryOp::Pow),
            Op::Call(_) => true,
            _ => false,
        };
        self.ops.iter().any(risky)
    }

    pub fn prints(&self) -> bool {
        self.ops.iter().any(|o| matches!(o, Op::Print(_)))
    }

    /// True if the code assigns a global variable or an array element, or calls `stop`.
    pub fn writes_globals(&self) -> bool {
        self.ops.iter().any(|o| matches!(o, Op::StoreGlobal(_) | Op::StoreElement(_) | Op::Stop))
    }
}

impl UnaryOp {
    /// The function of one argument with this name; `None` for other names.
    pub fn named(name: &str) -> Option<Self> {
        Some(match name {
            "sin" => Self::Sin,
            "cos" => Self::Cos,
            "tan" => Self::Tan,
            "asin" => Self::Asin,
            "acos" => Self::Acos,
            "atan" => Self::Atan,
            "exp" => Self::Exp,
            "log" => Self::Log,
            "sqrt" => Self::Sqrt,
            "fabs" => Self::Fabs,
            "floor" => Self::Floor,
            "ceil" => Self::Ceil,
            "trunc" => Self::Trunc,
            "sign" => Self::Sign,
            _ => return None,
        })
    }

    /// Value; angles in degrees.
    pub fn apply(self, x: f64) -> f64 {
        use osier_base::math;
        use osier_base::units::radians;
        let degrees = |r: f64| r * (180.0 / std::f64::consts::PI);
        match self {
            Self::Neg => -x,
            Self::Not => truth(is_zero(x)),
            Self::Sin => math::sin(radians(x)),
            Self::Cos => math::cos(radians(x)),
            Self::Tan => math::tan(radians(x)),
            Self::Asin => degrees(math::asin(x)),
            Self::Acos => degrees(math::acos(x)),
            Self::Atan => degrees(math::atan(x)),
            Self::Exp => math::exp(x),
            Self::Log => math::ln(x),
            Self::Sqrt => math::sqrt(x),
            Self::Fabs => x.abs(),
            Self::Floor => x.floor(),
            Self::Ceil => x.ceil(),
            // cpfg's trunc rounds half up.
            Self::Trunc => (x + 0.5).floor(),
            Self::Sign if x > 0.0 => 1.0,
            Self::Sign if x < 0.0 => -1.0,
            Self::Sign => 0.0,
        }
    }
}

/// A truth value as a number of the language: 1 or 0.
pub(crate) fn truth(b: bool) -> f64 {
    if b { 1.0 } else { 0.0 }
}

/// The language's notion of false; NaN is true, as in C.
#[allow(clippy::float_cmp, reason = "the grammar language compares exactly")]
pub(crate) fn is_zero(x: f64) -> bool {
    x == 0.0
}

impl BinaryOp {
    /// The result, and whether a division by zero occurred: then the result is the numerator for `/` and 0 for `%`.
    #[allow(clippy::float_cmp, reason = "the grammar language compares exactly")]
    pub fn apply(self, a: f64, b: f64) -> (f64, bool) {
        let value = match self {
            Self::Add => a + b,
            Self::Sub => a - b,
            Self::Mul => a * b,
            // A division by zero has a value, so that the derivation continues with a warning.
            Self::Div if is_zero(b) => return (a, true),
            Self::Div => a / b,
            Self::Rem => return remainder(a, b),
            Self::Pow => osier_base::math::pow(a, b),
            Self::Eq => truth(a == b),
            Self::Ne => truth(a != b),
            Self::Lt => truth(a < b),
            Self::Le => truth(a <= b),
            Self::Gt => truth(a > b),
            Self::Ge => truth(a >= b),
            Self::Atan2 => osier_base::math::atan2(a, b) * (180.0 / std::f64::consts::PI),
        };
        (value, false)
    }
}

/// Remainder of the operands truncated to integers; it has the sign of the left operand.
fn remainder(a: f64, b: f64) -> (f64, bool) {
    let (a, b) = (a.trunc(), b.trunc());
    if is_zero(b) || !a.is_finite() || b.is_nan() {
        return (0.0, true);
    }
    (a % b, false)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[allow(clippy::float_cmp, reason = "exact values of the language")]
    fn arithmetic_of_the_language() {
        assert_eq!(BinaryOp::Div.apply(5.0, 0.0), (5.0, true));
        assert_eq!(BinaryOp::Rem.apply(-7.0, 4.0), (-3.0, false));
        assert_eq!(BinaryOp::Rem.apply(7.9, 2.9), (1.0, false));
        assert_eq!(BinaryOp::Rem.apply(7.0, 0.5), (0.0, true));
        assert_eq!(BinaryOp::Pow.apply(0.0, 0.0).0, 1.0);
        assert_eq!(UnaryOp::Trunc.apply(2.5), 3.0);
        assert_eq!(UnaryOp::Trunc.apply(-2.5), -2.0);
        assert!(UnaryOp::Sqrt.apply(-1.0).is_nan());
        assert_eq!(UnaryOp::Log.apply(0.0), f64::NEG_INFINITY);
        assert!((UnaryOp::Sin.apply(30.0) - 0.5).abs() < 1e-15);
        assert!((BinaryOp::Atan2.apply(1.0, -1.0).0 - 135.0).abs() < 1e-12);
    }
}
