//! Statements of blocks, with an explicit stack of open braces.

use super::expression::compile_expression;
use super::{Compiler, TokenCursor, whole_expression};
use crate::code::{Bytecode, Op};
use crate::token::{SourcePlace, Token, TokenKind};

/// An open brace and what happens when it closes.
enum OpenBrace {
    /// Jump over the block, jumps to the end of the whole chain.
    If(usize, Vec<usize>),
    Else(Vec<usize>),
    /// Start of the condition, jump out.
    While(usize, usize),
    /// Start of the body.
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
        let index = u32::try_from(self.code.places.len() - 1).unwrap_or(0);
        self.code.ops.push(Op::Count(index));
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
                self.count_statement(t.place);
                match self.compiler.session.names.get(name) {
                    "if" => {
                        cursor.bump();
                        self.begin_if(cursor, Vec::new())
                    }
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

    /// Compiles an expression behind what is there already.
    fn append_expression(&mut self, cursor: &mut TokenCursor<'_>) -> Option<()> {
        let code = compile_expression(self.compiler, cursor)?;
        let shift = u32::try_from(self.code.ops.len()).unwrap_or(u32::MAX);
        let places = u32::try_from(self.code.places.len()).unwrap_or(u32::MAX);
        self.code.places.extend(code.places);
        self.code.ops.extend(code.ops.into_iter().map(|op| match op {
            Op::Jump(t) => Op::Jump(t + shift),
            Op::JumpIfZero(t) => Op::JumpIfZero(t + shift),
            Op::And(t) => Op::And(t + shift),
            Op::Or(t) => Op::Or(t + shift),
            Op::Binary(b, p) => Op::Binary(b, p + places),
            other => other,
        }));
        Some(())
    }

    fn patch_jump(&mut self, at: usize) {
        let here = u32::try_from(self.code.ops.len()).unwrap_or(u32::MAX);
        if let Some(Op::Jump(t) | Op::JumpIfZero(t)) = self.code.ops.get_mut(at) {
            *t = here;
        }
    }

    fn next_is_word(&self, cursor: &TokenCursor<'_>, word: &str) -> bool {
        matches!(cursor.peek().map(|t| t.kind), Some(TokenKind::Ident(n)) if self.compiler.session.names.get(n) == word)
    }

    fn close_brace(&mut self, cursor: &mut TokenCursor<'_>, place: SourcePlace) -> Option<()> {
        let target = |i: usize| u32::try_from(i).unwrap_or(u32::MAX);
        match self.open.pop() {
            None => self.error("unexpected '}', no block is open".to_owned(), place),
            Some(OpenBrace::If(jump, mut ends)) if self.next_is_word(cursor, "else") => {
                cursor.bump();
                self.code.ops.push(Op::Jump(0));
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
            Some(OpenBrace::While(start, jump)) => {
                self.code.ops.push(Op::Jump(target(start)));
                self.patch_jump(jump);
                Some(())
            }
            Some(OpenBrace::Do(start)) => {
                if !self.next_is_word(cursor, "while") {
                    return self.error("'do' block without 'while'".to_owned(), place);
                }
                cursor.bump();
                let out = self.condition(cursor)?;
                self.code.ops.push(Op::Jump(target(start)));
                self.patch_jump(out);
                Some(())
            }
        }
    }

    /// An assignment or a bare call.
    fn assignment_or_call(&mut self, cursor: &mut TokenCursor<'_>, name: u32, place: SourcePlace) -> Option<()> {
        let next = cursor.peek_at(1);
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
