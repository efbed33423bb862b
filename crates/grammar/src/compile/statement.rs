//! Statements of blocks, with an explicit stack of open braces.

use super::expression::compile_expression;
use super::{Compiler, TokenCursor, whole_expression};
use crate::code::{Bytecode, Op};
use crate::token::{SourcePlace, Token, TokenKind};

/// An open brace with the jumps to patch when it closes.
enum OpenBrace {
    /// Jump over the block, jumps to the end of the whole chain.
    If(usize, Vec<usize>),
    Else(Vec<usize>),
    /// Start of the condition, jump out.
    While(usize, usize),
    /// Index of the first instruction of the body, where the loop continues.
    Do(usize),
}

struct BlockCompiler<'c, 'r> {
    compiler: &'c mut Compiler<'r>,
    code: Bytecode,
    open: Vec<OpenBrace>,
}

/// Compiles the statements between a block's braces. `None` after an error, which is recorded.
pub(super) fn block(compiler: &mut Compiler<'_>, tokens: &[Token], place: SourcePlace) -> Option<Bytecode> {
    let mut cursor = TokenCursor::new(tokens, place);
    let mut block = BlockCompiler { compiler, code: Bytecode::default(), open: Vec::new() };
    while cursor.peek().is_some() {
        block.statement(&mut cursor)?;
    }
    if block.open.is_empty() {
        return Some(block.code);
    }
    block.compiler.session.error("L004", "block is never closed", cursor.place(), "expected '}' after this");
    None
}

impl BlockCompiler<'_, '_> {
    fn error<T>(&mut self, message: String, place: SourcePlace) -> Option<T> {
        self.compiler.session.error("L001", message, place, "here");
        None
    }

    fn position(&self) -> usize {
        self.code.ops.len()
    }

    fn expect(&mut self, cursor: &mut TokenCursor<'_>, c: char) -> Option<()> {
        if cursor.eat(c) {
            return Some(());
        }
        let found = cursor.peek().map_or_else(|| "end of block".to_owned(), |t| self.compiler.describe(t));
        self.error(format!("unexpected {found}, expected '{c}'"), cursor.place())
    }

    fn count_statement(&mut self, place: SourcePlace) {
        self.code.places.push(place);
        self.code.ops.push(Op::Count(self.code.places.len() - 1));
    }

    fn statement(&mut self, cursor: &mut TokenCursor<'_>) -> Option<()> {
        let Some(&t) = cursor.peek() else { return Some(()) };
        match t.kind {
            TokenKind::Char(';') => {
                cursor.bump();
                Some(())
            }
            TokenKind::Char('}') => {
                cursor.bump();
                self.close_brace(cursor, t.place)
            }
            TokenKind::Ident(name) => {
                // Every statement counts against the budget of statements.
                self.count_statement(t.place);
                match self.compiler.session.names.get(name) {
                    "if" => {
                        cursor.bump();
                        self.begin_if(cursor, Vec::new())
                    }
                    // A loop jumps back to its counter, the instruction before the condition, so that every iteration
                    // is counted.
                    "while" => {
                        cursor.bump();
                        let start = self.position() - 1;
                        let jump = self.condition(cursor)?;
                        self.open_brace(cursor, OpenBrace::While(start, jump))
                    }
                    "do" => {
                        cursor.bump();
                        let start = self.position() - 1;
                        self.open_brace(cursor, OpenBrace::Do(start))
                    }
                    "printf" => self.printf(cursor, t.place),
                    _ => self.assignment_or_call(cursor, name, t.place),
                }
            }
            _ => {
                let word = self.compiler.describe(&t);
                self.error(format!("unexpected {word}, expected a statement"), t.place)
            }
        }
    }

    fn open_brace(&mut self, cursor: &mut TokenCursor<'_>, open: OpenBrace) -> Option<()> {
        let place = cursor.place();
        self.expect(cursor, '{')?;
        self.open.push(open);
        if self.open.len() > self.compiler.max_depth {
            let message = format!("blocks nested deeper than {}", self.compiler.max_depth);
            self.compiler.session.error("L004", message, place, "too deep here");
            return None;
        }
        Some(())
    }

    /// A condition in parentheses; returns the jump taken when it fails.
    fn condition(&mut self, cursor: &mut TokenCursor<'_>) -> Option<usize> {
        self.expect(cursor, '(')?;
        self.append_expression(cursor)?;
        self.expect(cursor, ')')?;
        self.code.ops.push(Op::JumpIfZero(0));
        Some(self.position() - 1)
    }

    fn begin_if(&mut self, cursor: &mut TokenCursor<'_>, ends: Vec<usize>) -> Option<()> {
        let jump = self.condition(cursor)?;
        self.open_brace(cursor, OpenBrace::If(jump, ends))
    }

    /// Compiles an expression and appends its code.
    fn append_expression(&mut self, cursor: &mut TokenCursor<'_>) -> Option<()> {
        let code = compile_expression(self.compiler, cursor)?;
        // The expression was compiled from index 0: move its jump targets and locations behind the code so far.
        let shift = self.code.ops.len();
        let places = self.code.places.len();
        self.code.places.extend(code.places);
        self.code.tables = self.code.tables.take().or(code.tables);
        self.code.ops.extend(code.ops.into_iter().map(|op| match op {
            Op::Jump(t) => Op::Jump(t + shift),
            Op::JumpIfZero(t) => Op::JumpIfZero(t + shift),
            Op::And(t) => Op::And(t + shift),
            Op::Or(t) => Op::Or(t + shift),
            Op::Binary(b, p) => Op::Binary(b, p + places),
            Op::Table(f, p) => Op::Table(f, p + places),
            other => other,
        }));
        Some(())
    }

    fn patch_jump(&mut self, at: usize) {
        let here = self.position();
        if let Some(Op::Jump(t) | Op::JumpIfZero(t)) = self.code.ops.get_mut(at) {
            *t = here;
        }
    }

    fn next_is_word(&self, cursor: &TokenCursor<'_>, word: &str) -> bool {
        matches!(cursor.peek().map(|t| t.kind), Some(TokenKind::Ident(n)) if self.compiler.session.names.get(n) == word)
    }

    fn close_brace(&mut self, cursor: &mut TokenCursor<'_>, place: SourcePlace) -> Option<()> {
        match self.open.pop() {
            None => self.error("unexpected '}', no block is open".to_owned(), place),
            Some(OpenBrace::If(jump, mut ends)) if self.next_is_word(cursor, "else") => {
                cursor.bump();
                self.code.ops.push(Op::Jump(0));
                // `else`: the block before it jumps to the end of the whole if-chain; its failed condition lands here.
                ends.push(self.position() - 1);
                self.patch_jump(jump);
                if self.next_is_word(cursor, "if") {
                    cursor.bump();
                    return self.begin_if(cursor, ends);
                }
                self.open_brace(cursor, OpenBrace::Else(ends))
            }
            Some(OpenBrace::If(jump, ends)) => {
                self.patch_jump(jump);
                ends.into_iter().for_each(|e| self.patch_jump(e));
                Some(())
            }
            Some(OpenBrace::Else(ends)) => {
                ends.into_iter().for_each(|e| self.patch_jump(e));
                Some(())
            }
            // End of a `while` body: back to the condition; a failed condition lands behind that jump.
            Some(OpenBrace::While(start, jump)) => {
                self.code.ops.push(Op::Jump(start));
                self.patch_jump(jump);
                Some(())
            }
            Some(OpenBrace::Do(start)) => {
                if !self.next_is_word(cursor, "while") {
                    return self.error("'do' block without 'while'".to_owned(), place);
                }
                cursor.bump();
                // `do { } while (c)`: the jump back is skipped when the condition fails.
                let out = self.condition(cursor)?;
                self.code.ops.push(Op::Jump(start));
                self.patch_jump(out);
                Some(())
            }
        }
    }

    /// An assignment or a bare call.
    fn assignment_or_call(&mut self, cursor: &mut TokenCursor<'_>, name: u32, place: SourcePlace) -> Option<()> {
        let next = cursor.peek_at(1);
        // A call as a statement: its value is dropped.
        if next.is_some_and(|t| t.is('(')) {
            self.append_expression(cursor)?;
            self.code.ops.push(Op::Pop);
            return self.expect(cursor, ';');
        }
        if next.is_some_and(|t| t.is('[')) {
            let word = self.compiler.session.names.get(name).to_owned();
            let help = "use single variables";
            let message = format!("'{word}[..]': arrays are not supported");
            self.compiler.session.error_help("L001", message, place, help);
            return None;
        }
        cursor.bump();
        // Compound assignments such as += do not exist in the language; suggest the long form.
        if let (Some(op), Some('=')) = (cursor.peek(), cursor.glued_char(1)) {
            let help = "write the variable on both sides: v = v + 1";
            let message = format!("unexpected {}, expected '='", self.compiler.describe(op));
            self.compiler.session.error_help("L001", message, op.place, help);
            return None;
        }
        self.expect(cursor, '=')?;
        self.append_expression(cursor)?;
        let op = self.compiler.store_variable(name, place)?;
        self.code.ops.push(op);
        self.expect(cursor, ';')
    }

    /// Skips a call of `printf` to its semicolon.
    fn printf(&mut self, cursor: &mut TokenCursor<'_>, place: SourcePlace) -> Option<()> {
        let help = "it prints nothing here; use `osier check` to see what a grammar makes";
        self.compiler.session.warning("L008", "printf is not supported".into(), place, help);
        while cursor.peek().is_some_and(|t| !t.is(';')) {
            cursor.bump();
        }
        self.expect(cursor, ';')
    }
}

/// Compiles a condition that fills its tokens; `*` alone is true.
pub(super) fn condition(compiler: &mut Compiler<'_>, tokens: &[Token], place: SourcePlace) -> Option<Option<Bytecode>> {
    match tokens {
        [] => Some(None),
        [t] if t.is('*') => Some(None),
        _ => whole_expression(compiler, tokens, place).map(Some),
    }
}
