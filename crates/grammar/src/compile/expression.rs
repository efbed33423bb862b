//! Compiles expressions with an operator-precedence parser whose stack is explicit, directly to bytecode.

use super::{Compiler, NameScope, TokenCursor};
use crate::code::{BinaryOp, Bytecode, Op, RandomFunction, TableFunction, UnaryOp, is_zero};
use crate::token::{SourcePlace, Token, TokenKind, with_fix};
use osier_base::diagnostic::{Diagnostic, Span, nearest};
use osier_base::math::narrow;

/// An operator on the parser's stack whose right operand is not complete.
#[derive(Debug)]
enum PendingOperator {
    Unary(UnaryOp),
    Binary(BinaryOp, u8, SourcePlace),
    /// `&&` or `||`: index of the jump whose target is set later, precedence.
    Short(usize, u8),
    Question(usize),
    Colon(usize),
    Paren(SourcePlace),
    Call {
        name: u32,
        place: SourcePlace,
        args: usize,
    },
    /// `[` of an array: its index in [`Compiler::arrays`], and the number of complete indices.
    Index {
        array: usize,
        place: SourcePlace,
        given: usize,
    },
}

impl PendingOperator {
    /// True for an opening bracket: operators below it on the stack wait until it is closed.
    fn is_bracket(&self) -> bool {
        matches!(self, Self::Paren(_) | Self::Call { .. } | Self::Index { .. })
    }
}

/// Help for faults of `?:`.
const CHOICE_HELP: &str = "write a choice as: condition ? value : other value";
const PREC_TERNARY: u8 = 1;
const PREC_OR: u8 = 2;
const PREC_AND: u8 = 3;
const PREC_UNARY: u8 = 9;

/// All functions of the language, for suggestions.
const FUNCTIONS: [&str; 26] = [
    "sin", "cos", "tan", "asin", "acos", "atan", "exp", "log", "sqrt", "fabs", "floor", "ceil", "trunc", "sign", "ran",
    "nran", "bran", "biran", "srand", "choose", "stop", "func", "curveX", "curveY", "curveZ", "curveGAL",
];
/// Variables that hold the bounds of the last drawing, in the order of [`Op::Bounds`].
const BOUNDS: [&str; 6] = ["vvXmin", "vvYmin", "vvZmin", "vvXmax", "vvYmax", "vvZmax"];
const FILE_FUNCTIONS: [&str; 7] = ["fopen", "fclose", "fscan", "fscanf", "fprintf", "fflush", "play"];
/// Functions of cpfg that act on its window or its process, and the reason why they are refused.
const RUN_FUNCTIONS: [(&str, &str, &str); 3] = [
    ("SetDerivationLength", "the derivation length is fixed", "set 'derivation length', and end early with stop(0)"),
    ("vvScale", "a grammar has no window", "write the scale as a number"),
    ("inblob", "a grammar has no field of blobs", "remove this call"),
];

struct ExpressionCompiler<'c, 'r> {
    compiler: &'c mut Compiler<'r>,
    code: Bytecode,
    pending: Vec<PendingOperator>,
    /// Constant folding must not remove instructions before this index, because a jump leads here.
    barrier: usize,
    /// Place of the last token taken, for errors at the end of the tokens.
    last: SourcePlace,
}

/// Compiles one expression; stops before the first token that cannot continue it. `None` after an error, which is
/// recorded.
pub(super) fn compile_expression(compiler: &mut Compiler<'_>, cursor: &mut TokenCursor<'_>) -> Option<Bytecode> {
    let last = cursor.place();
    let code = Bytecode::default();
    let mut expression = ExpressionCompiler { compiler, code, pending: Vec::new(), barrier: 0, last };
    expression.run(cursor)?;
    Some(expression.code)
}

/// Binary operator at the cursor with its precedence and number of tokens.
fn operator(cursor: &TokenCursor<'_>) -> Option<(&'static str, u8, usize)> {
    let TokenKind::Char(c) = cursor.peek()?.kind else { return None };
    let second = cursor.glued_char(1);
    Some(match (c, second) {
        ('|', Some('|')) => ("||", PREC_OR, 2),
        ('&', Some('&')) => ("&&", PREC_AND, 2),
        ('=', Some('=')) => ("==", 4, 2),
        ('!', Some('=')) => ("!=", 4, 2),
        ('<', Some('>')) => ("!=", 4, 2),
        ('<', Some('=')) => ("<=", 5, 2),
        ('>', Some('=')) => (">=", 5, 2),
        ('<', _) => ("<", 5, 1),
        ('>', _) => (">", 5, 1),
        // The arrow of a production ends its condition.
        ('-', Some('-')) if cursor.glued_char(2) == Some('>') => return None,
        ('+', _) => ("+", 6, 1),
        ('-', _) => ("-", 6, 1),
        ('*', _) => ("*", 7, 1),
        ('/', _) => ("/", 7, 1),
        ('%', _) => ("%", 7, 1),
        ('^', _) => ("^", 8, 1),
        _ => return None,
    })
}

impl ExpressionCompiler<'_, '_> {
    fn run(&mut self, cursor: &mut TokenCursor<'_>) -> Option<()> {
        loop {
            // Operator-precedence parsing: prefix operators and one operand, then closing parentheses and an infix
            // operator, until neither follows.
            while self.prefix(cursor)? {}
            self.operand(cursor)?;
            loop {
                if self.close_parenthesis(cursor)? {
                    continue;
                }
                if self.infix(cursor)? {
                    break;
                }
                return self.finish(cursor);
            }
        }
    }

    fn error<T>(&mut self, code: &'static str, message: String, place: SourcePlace, label: &str) -> Option<T> {
        self.compiler.session.error(code, message, place, label);
        None
    }

    /// Reports L001 with a label and a help text.
    fn fault<T>(&mut self, message: String, place: SourcePlace, label: &str, help: &str) -> Option<T> {
        self.compiler.session.fault(message, place, label, help);
        None
    }

    /// Reports L001 for a missing value. `found`: the token in its place.
    fn missing_value<T>(&mut self, found: &str, place: SourcePlace, label: &str) -> Option<T> {
        let help = "put a number, a variable or a function there, or remove the operator or comma before it";
        self.fault(format!("unexpected {found}, expected a value"), place, label, help)
    }

    fn push_pending(&mut self, pending: PendingOperator, place: SourcePlace) -> Option<()> {
        self.pending.push(pending);
        let limit = self.compiler.max_depth;
        if self.pending.len() > limit {
            return self.error("L004", format!("expression nested deeper than {limit}"), place, "too deep here");
        }
        Some(())
    }

    /// Consumes one prefix operator or opening parenthesis; false if neither comes next.
    fn prefix(&mut self, cursor: &mut TokenCursor<'_>) -> Option<bool> {
        let Some(&t) = cursor.peek() else { return Some(false) };
        // A unary plus changes nothing and leaves no pending operator.
        let pending = match t.kind {
            TokenKind::Char('-') => Some(PendingOperator::Unary(UnaryOp::Neg)),
            TokenKind::Char('!') => Some(PendingOperator::Unary(UnaryOp::Not)),
            TokenKind::Char('+') => None,
            TokenKind::Char('(') => Some(PendingOperator::Paren(t.place)),
            TokenKind::Ident(name) if cursor.peek_at(1).is_some_and(|n| n.is('(')) => {
                self.refuse_call(name, t.place)?;
                cursor.bump();
                Some(PendingOperator::Call { name, place: t.place, args: 0 })
            }
            TokenKind::Ident(name) if cursor.peek_at(1).is_some_and(|n| n.is('[')) => {
                let Some(array) = self.compiler.array(name) else { return Some(false) };
                cursor.bump();
                Some(PendingOperator::Index { array, place: t.place, given: 0 })
            }
            _ => return Some(false),
        };
        cursor.bump();
        self.last = t.place;
        let is_call = matches!(pending, Some(PendingOperator::Call { .. }));
        if let Some(p) = pending {
            self.push_pending(p, t.place)?;
        }
        // In a call without arguments no operand follows the parenthesis.
        if is_call && cursor.peek().is_some_and(|t| t.is(')')) {
            return Some(false);
        }
        Some(true)
    }

    /// Reports L043 for a function that acts on files or on the window of cpfg. Its arguments are not read, because strings
    /// among them are not values.
    fn refuse_call(&mut self, name: u32, place: SourcePlace) -> Option<()> {
        let word = self.compiler.session.names.get(name).to_owned();
        if let Some((_, why, help)) = RUN_FUNCTIONS.iter().find(|f| f.0 == word) {
            self.compiler.session.error_help("L043", format!("{word} is not available: {why}"), place, *help);
            return None;
        }
        let help = match word.as_str() {
            w if !FILE_FUNCTIONS.contains(&w) => return Some(()),
            "fscan" | "fscanf" | "fopen" => {
                "write the values into the grammar: Define: { array a[3] = {1, 2, 3}; }; a file that is only written needs no call"
            }
            "fprintf" => "printf writes to the output of the derivation",
            _ => "remove this call",
        };
        let message = format!("{word} is not available: grammars neither read nor write files");
        self.compiler.session.error_help("L043", message, place, help);
        None
    }

    fn operand(&mut self, cursor: &mut TokenCursor<'_>) -> Option<()> {
        let Some(&t) = cursor.peek() else {
            return self.missing_value("end", self.last, "after this");
        };
        match t.kind {
            TokenKind::Number(n) => {
                let text = self.compiler.session.names.get(n).to_owned();
                // The lexer accepts valid number literals only, so that parsing cannot fail; too large numbers become
                // infinity.
                let value: f64 = text.parse().unwrap_or(f64::INFINITY);
                if !value.is_finite() {
                    let message = format!("number {text} is out of range");
                    return self.fault(message, t.place, "too large", "write a number of at most 1.7e308");
                }
                self.code.ops.push(Op::Const(value));
            }
            TokenKind::Ident(name) => {
                let op = self.compiler.load_variable(name, t.place);
                self.code.ops.push(op);
            }
            // The empty argument list of a call.
            TokenKind::Char(')')
                if matches!(self.pending.last(), Some(PendingOperator::Call { args: 0, .. })) && self.at_call() =>
            {
                return Some(());
            }
            _ => {
                let word = self.compiler.describe(&t);
                return self.missing_value(&word, t.place, "here");
            }
        }
        cursor.bump();
        self.last = t.place;
        Some(())
    }

    /// True if the last token opened the innermost call, which then has no argument yet.
    fn at_call(&self) -> bool {
        matches!(self.pending.last(), Some(PendingOperator::Call { place, .. }) if *place == self.last)
    }

    /// Consumes a `)` or `]` that belongs to this expression; false if none comes next.
    fn close_parenthesis(&mut self, cursor: &mut TokenCursor<'_>) -> Option<bool> {
        let Some(&t) = cursor.peek() else { return Some(false) };
        if t.is(']') {
            return self.close_index(cursor, t.place);
        }
        let inside = self.pending.iter().any(|p| matches!(p, PendingOperator::Paren(_) | PendingOperator::Call { .. }));
        if !inside || !t.is(')') {
            return Some(false);
        }
        // All operators inside the parenthesis are complete: emit them, then the call itself.
        let empty = matches!(self.pending.last(), Some(PendingOperator::Call { args: 0, .. })) && self.at_call();
        self.reduce(0);
        match self.pending.pop() {
            Some(PendingOperator::Paren(_)) => {}
            Some(PendingOperator::Call { name, place, args }) => {
                self.call(name, place.to(t.place), args + usize::from(!empty))?;
            }
            _ => return self.fault("unexpected ')', expected ':' of '?:'".into(), t.place, "here", CHOICE_HELP),
        }
        cursor.bump();
        self.last = t.place;
        Some(true)
    }

    /// Consumes a `]` that ends the indices of an array.
    fn close_index(&mut self, cursor: &mut TokenCursor<'_>, close: SourcePlace) -> Option<bool> {
        let innermost = self.pending.iter().rev().find(|p| p.is_bracket());
        let Some(&PendingOperator::Index { array, place, given }) = innermost else { return Some(false) };
        let wanted = self.compiler.arrays.get(array).map_or(0, |a| a.shape.sizes.len());
        // In `a[i][j]` the next bracket holds the next index.
        if given + 1 < wanted && cursor.peek_at(1).is_some_and(|t| t.is('[')) {
            return Some(false);
        }
        self.reduce(0);
        if !matches!(self.pending.pop(), Some(PendingOperator::Index { .. })) {
            return self.fault("unexpected ']', expected ':' of '?:'".into(), close, "here", CHOICE_HELP);
        }
        let access = self.compiler.element(array, given + 1, place.to(close))?;
        self.code.elements.push(access);
        self.code.ops.push(Op::LoadElement(self.code.elements.len() - 1));
        self.barrier = self.code.ops.len();
        cursor.bump();
        self.last = close;
        Some(true)
    }

    /// Consumes a binary operator, `?`, `:` or the comma of a call; false if the expression ends here.
    fn infix(&mut self, cursor: &mut TokenCursor<'_>) -> Option<bool> {
        let Some(&t) = cursor.peek() else { return Some(false) };
        // Binary operators are left-associative: emit operators of at least the same precedence before pushing this one.
        if let Some((op, prec, length)) = operator(cursor) {
            for _ in 0..length {
                cursor.bump();
            }
            self.last = t.place;
            self.reduce(prec);
            self.push_operator(op, prec, t.place)?;
            return Some(true);
        }
        match t.kind {
            TokenKind::Char('?') => {
                self.reduce(PREC_TERNARY + 1);
                // In `c ? a : b` the condition is complete. The target of its jump, b, is set at the ":"; the target of the
                // jump over b is set at the end.
                self.code.ops.push(Op::JumpIfZero(0));
                let jump = self.code.ops.len() - 1;
                self.push_pending(PendingOperator::Question(jump), t.place)?;
            }
            TokenKind::Char(':') if self.has_open_question() => {
                self.reduce(0);
                let Some(PendingOperator::Question(jump)) = self.pending.pop() else { return Some(false) };
                self.code.ops.push(Op::Jump(0));
                let end = self.code.ops.len() - 1;
                self.patch_jump(jump);
                self.push_pending(PendingOperator::Colon(end), t.place)?;
            }
            // `a[i][j]` means `a[i,j]`; `close_index` has left this bracket.
            TokenKind::Char(']') if self.pending.iter().any(|p| matches!(p, PendingOperator::Index { .. })) => {
                self.reduce(0);
                match self.pending.last_mut() {
                    Some(PendingOperator::Index { given, .. }) => *given += 1,
                    _ => {
                        let message = "unexpected ']', expected ')'".into();
                        return self.fault(message, t.place, "here", "put ')' before it");
                    }
                }
                cursor.bump();
            }
            TokenKind::Char(',') => {
                if !self.pending.iter().any(PendingOperator::is_bracket) {
                    return Some(false);
                }
                self.reduce(0);
                // A comma ends an argument of the innermost call; outside calls and arrays it is an error.
                match self.pending.last_mut() {
                    Some(PendingOperator::Call { args, .. }) => *args += 1,
                    Some(PendingOperator::Index { given, .. }) => *given += 1,
                    _ => {
                        let help = "put ')' before it: only functions and arrays have several values in parentheses";
                        return self.fault("unexpected ',', expected ')'".into(), t.place, "here", help);
                    }
                }
            }
            _ => return Some(false),
        }
        cursor.bump();
        self.last = t.place;
        self.barrier = self.code.ops.len();
        Some(true)
    }

    /// True if a `?` in the innermost parenthesis still lacks its `:`.
    fn has_open_question(&self) -> bool {
        let stop = |p: &&PendingOperator| matches!(p, PendingOperator::Question(_)) || p.is_bracket();
        matches!(self.pending.iter().rev().find(stop), Some(PendingOperator::Question(_)))
    }

    fn push_operator(&mut self, op: &str, prec: u8, place: SourcePlace) -> Option<()> {
        let binary = match op {
            "&&" | "||" => {
                // Short circuit: the left side leaves its truth value, and jumps over the right side if it decides the
                // result.
                let is_or = op == "||";
                self.code.ops.push(if is_or { Op::Or(0) } else { Op::And(0) });
                let jump = self.code.ops.len() - 1;
                self.barrier = self.code.ops.len();
                return self.push_pending(PendingOperator::Short(jump, prec), place);
            }
            "==" => BinaryOp::Eq,
            "!=" => BinaryOp::Ne,
            "<=" => BinaryOp::Le,
            ">=" => BinaryOp::Ge,
            "<" => BinaryOp::Lt,
            ">" => BinaryOp::Gt,
            "+" => BinaryOp::Add,
            "-" => BinaryOp::Sub,
            "*" => BinaryOp::Mul,
            "/" => BinaryOp::Div,
            "%" => BinaryOp::Rem,
            _ => BinaryOp::Pow,
        };
        self.push_pending(PendingOperator::Binary(binary, prec, place), place)
    }

    /// Emits all pending operators of at least precedence `prec`; stops at brackets and at a `?` without its `:`.
    fn reduce(&mut self, prec: u8) {
        loop {
            // Precedence of the topmost operator; brackets and a "?" without its ":" keep everything below them.
            let binds = match self.pending.last() {
                Some(PendingOperator::Unary(_)) => PREC_UNARY,
                Some(PendingOperator::Binary(_, p, _) | PendingOperator::Short(_, p)) => *p,
                Some(PendingOperator::Colon(_)) => PREC_TERNARY,
                _ => return,
            };
            if binds < prec {
                return;
            }
            match self.pending.pop() {
                Some(PendingOperator::Unary(op)) => self.emit_unary(op),
                Some(PendingOperator::Binary(op, _, place)) => self.emit_binary(op, place),
                Some(PendingOperator::Short(jump, _)) => {
                    // The right side of `&&` or `||` is complete: convert its value to 0 or 1, and let the jump lead after
                    // it.
                    self.code.ops.push(Op::Bool);
                    self.patch_jump(jump);
                }
                Some(PendingOperator::Colon(end)) => self.patch_jump(end),
                _ => return,
            }
        }
    }

    /// Sets the target of the jump at `index` to the next instruction.
    fn patch_jump(&mut self, index: usize) {
        let here = self.code.ops.len();
        self.barrier = self.code.ops.len();
        if let Some(op) = self.code.ops.get_mut(index) {
            *op = match *op {
                Op::Jump(_) => Op::Jump(here),
                Op::JumpIfZero(_) => Op::JumpIfZero(here),
                Op::And(_) => Op::And(here),
                Op::Or(_) => Op::Or(here),
                other => other,
            };
        }
    }

    fn emit_unary(&mut self, op: UnaryOp) {
        let n = self.code.ops.len();
        match self.code.ops.last_mut() {
            // Constant folding, unless a jump lands between the operand and the operator.
            Some(Op::Const(c)) if n > self.barrier => *c = op.apply(*c),
            _ => self.code.ops.push(Op::Unary(op)),
        }
    }

    fn emit_binary(&mut self, op: BinaryOp, place: SourcePlace) {
        let n = self.code.ops.len();
        // Constant folding of two operands. A division by zero is not folded, so that it is reported at run time.
        if n >= self.barrier + 2
            && let [.., Op::Const(a), Op::Const(b)] = self.code.ops[..]
            && let (value, false) = op.apply(a, b)
        {
            self.code.ops.truncate(n - 2);
            self.code.ops.push(Op::Const(value));
            return;
        }
        if matches!(op, BinaryOp::Eq | BinaryOp::Ne) {
            self.check_equality(op, place);
        }
        // Only division and remainder can fail at run time, so that only they need a place.
        let index = if matches!(op, BinaryOp::Div | BinaryOp::Rem) {
            self.code.places.push(place);
            self.code.places.len() - 1
        } else {
            0
        };
        self.code.ops.push(Op::Binary(op, index));
    }

    /// L025 for a comparison of a parameter with a constant that no 32-bit number equals.
    fn check_equality(&mut self, op: BinaryOp, place: SourcePlace) {
        let sides = self.code.ops.get(self.barrier..).unwrap_or(&[]);
        let (slot, value) = match *sides {
            [.., Op::Local(slot), Op::Const(v)] | [.., Op::Const(v), Op::Local(slot)] => (slot, v),
            _ => return,
        };
        // Parameters are stored as f32: one can equal the constant only if the constant is exact in f32.
        let exact = is_zero(f64::from(narrow(value)) - value);
        if exact || !self.compiler.parameter_slots.contains(&slot) {
            return;
        }
        let name = self.compiler.locals.get(usize::from(slot)).map_or("", |n| self.compiler.session.names.get(*n));
        let (sign, verdict) = if op == BinaryOp::Eq { ("==", "can never hold") } else { ("!=", "always holds") };
        let message =
            format!("'{name} {sign} {value}' {verdict}: parameters are stored in 32 bits, which {value} is not");
        let help = format!("allow for rounding: fabs({name} - {value}) < 0.001");
        self.compiler.session.warning("L025", message, place, help);
    }

    fn call(&mut self, name: u32, place: SourcePlace, args: usize) -> Option<()> {
        let word = self.compiler.session.names.get(name).to_owned();
        let wrong = |wanted: &str| format!("{word} takes {wanted}, got {args}");
        // Random functions and their number of arguments; `uniform` and `normal` exist in angle definitions only.
        let random = match word.as_str() {
            "ran" => Some((RandomFunction::Ran, 1)),
            "nran" => Some((RandomFunction::Nran, 2)),
            "bran" => Some((RandomFunction::Bran, 2)),
            "biran" => Some((RandomFunction::Biran, 2)),
            "uniform" if self.compiler.scope == NameScope::Angle => Some((RandomFunction::Uniform, 2)),
            "normal" if self.compiler.scope == NameScope::Angle => Some((RandomFunction::Nran, 2)),
            _ => None,
        };
        if let Some((op, wanted)) = random {
            if args != wanted {
                return self.error("L022", wrong(&format!("{wanted} arguments")), place, "this call");
            }
            self.code.ops.push(Op::Random(op));
        // cpfg 6.6 accepts a second argument and ignores it.
        } else if word == "atan" && args == 2 {
            let help = "osier computes the angle of the point (y, x), cpfg ignores x";
            self.compiler.session.note("L042", "atan(x,y) differs from cpfg 6.6".into(), place, help);
            self.emit_binary(BinaryOp::Atan2, place);
        } else if let Some(op) = UnaryOp::named(&word) {
            if args != 1 {
                return self.error("L022", wrong("1 argument"), place, "this call");
            }
            self.emit_unary(op);
        } else {
            return self.special_call(&word, place, args);
        }
        Some(())
    }

    fn special_call(&mut self, word: &str, place: SourcePlace, args: usize) -> Option<()> {
        // Functions that read tables of companion files; the code stores the tables for the machine.
        if let Some((function, wanted)) = TableFunction::named(word) {
            if args != wanted {
                let s = if wanted == 1 { "" } else { "s" };
                let message = format!("{word} takes {wanted} argument{s}, got {args}");
                return self.error("L022", message, place, "this call");
            }
            self.code.places.push(place);
            self.code.ops.push(Op::Table(function, self.code.places.len() - 1));
            self.code.tables = Some(std::sync::Arc::clone(&self.compiler.session.functions));
            self.barrier = self.code.ops.len();
            return Some(());
        }
        if let Some((bound, _)) = (0_u8..).zip(BOUNDS).find(|(_, b)| *b == word) {
            // cpfg expects the number of the view; there is only one here.
            match args {
                0 => {}
                1 => self.code.ops.push(Op::Pop),
                _ => {
                    let message = format!("{word} takes at most 1 argument, got {args}");
                    return self.error("L022", message, place, "this call");
                }
            }
            self.code.ops.push(Op::Bounds(bound));
            self.barrier = self.code.ops.len();
            return Some(());
        }
        match word {
            // Value and share alternate on the stack; the machine receives the number of pairs.
            "choose" => {
                if args == 0 || !args.is_multiple_of(2) {
                    let message = format!("choose takes pairs of value and share, got {args} arguments");
                    return self.error("L022", message, place, "this call");
                }
                self.check_shares(place, args);
                self.code.ops.push(Op::Choose(args / 2));
                Some(())
            }
            "srand" | "stop" | "GetDerivationLength" | "Display" if args != 1 => {
                self.error("L022", format!("{word} takes 1 argument, got {args}"), place, "this call")
            }
            // The argument is ignored; the value is that of `Z`.
            "GetDerivationLength" => {
                self.code.ops.extend([Op::Pop, Op::Length]);
                self.barrier = self.code.ops.len();
                Some(())
            }
            "Display" => {
                let message = "Display has no effect: only the last string is drawn".to_owned();
                self.compiler.session.warning("L008", message, place, "remove this call");
                Some(())
            }
            "srand" | "stop" => {
                self.code.ops.push(if word == "srand" { Op::Srand } else { Op::Stop });
                self.barrier = self.code.ops.len();
                Some(())
            }
            w => {
                let help = match nearest(w, FUNCTIONS) {
                    Some(n) => format!("did you mean '{n}'?"),
                    None => format!("known functions: {}", FUNCTIONS.join(", ")),
                };
                let message = format!("unknown function '{w}'");
                let mut d = Diagnostic::error("L021", message, place.span, "here").help(help);
                // The suggested edit replaces only the name at the beginning of the call.
                if let (Some(near), Ok(length)) = (nearest(w, FUNCTIONS), u32::try_from(w.len())) {
                    let end = place.span.start + length;
                    d = with_fix(d, SourcePlace { span: Span { end, ..place.span }, ..place }, near);
                }
                self.compiler.session.push(d, place);
                None
            }
        }
    }

    /// L035 if the constant shares of a `choose` do not sum to 1 within 0.001.
    fn check_shares(&mut self, place: SourcePlace, args: usize) {
        let n = self.code.ops.len();
        let Some(tail) = n.checked_sub(args).and_then(|first| self.code.ops.get(first..)) else { return };
        let constant = |o: &Op| if let Op::Const(c) = o { Some(*c) } else { None };
        let Some(values) = tail.iter().map(constant).collect::<Option<Vec<f64>>>() else { return };
        let sum = values.iter().skip(1).step_by(2).fold(0.0, |s, p| s + p);
        if (sum - 1.0).abs() > 1e-3 {
            let help = "they are divided by their sum";
            self.compiler.session.warning("L035", format!("shares of choose sum to {sum}"), place, help);
        }
    }

    fn finish(&mut self, cursor: &TokenCursor<'_>) -> Option<()> {
        self.reduce(0);
        let place = cursor.peek().map_or(self.last, |t| t.place);
        match self.pending.pop() {
            None => Some(()),
            Some(p @ (PendingOperator::Paren(_) | PendingOperator::Call { .. } | PendingOperator::Index { .. })) => {
                let (open, close) = match p {
                    PendingOperator::Paren(open) | PendingOperator::Call { place: open, .. } => (open, ')'),
                    PendingOperator::Index { place: open, .. } => (open, ']'),
                    _ => (place, ')'),
                };
                // The expression ended inside a parenthesis: label both places.
                let found = cursor.peek().map_or_else(|| "end".to_owned(), |t: &Token| self.compiler.describe(t));
                self.compiler.session.push(
                    Diagnostic::error(
                        "L001",
                        format!("unexpected {found}, expected '{close}' or an operator"),
                        place.span,
                        "here",
                    )
                    .label(open.span, "opened here")
                    .help(format!("close it with '{close}', or put an operator between two values")),
                    place,
                );
                None
            }
            Some(_) => self.fault("'?' without ':'".into(), place, "expected ':' before this", CHOICE_HELP),
        }
    }
}
