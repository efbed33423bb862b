//! Compiles the statements of blocks, with an explicit stack of open braces.

use super::expression::compile_expression;
use super::{Compiler, TokenCursor, whole_expression};
use crate::code::{Bytecode, Op};
use crate::print_format::PrintFormat;
use crate::token::{SourcePlace, Token, TokenKind};
use osier_base::diagnostic::Diagnostic;

/// An open brace, with the jumps whose targets are set when it closes.
enum OpenBrace {
    /// The jump over the block, and the jumps to the end of the whole if-chain.
    If(usize, Vec<usize>),
    Else(Vec<usize>),
    /// Start of the condition, and the jump out of the loop.
    While(usize, usize),
    /// Index of the first instruction of the body, to which the loop jumps back.
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
    fn error<T>(&mut self, message: String, place: SourcePlace, help: &str) -> Option<T> {
        self.compiler.session.error_help("L001", message, place, help);
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
        let message = format!("unexpected {found}, expected '{c}'");
        let help = if c == ';' { "end each statement with ';'".to_owned() } else { format!("put '{c}' there") };
        self.compiler.session.error_help("L001", message, cursor.place(), help);
        None
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
                // Every statement counts against the limit on statements.
                self.count_statement(t.place);
                match self.compiler.session.names.get(name) {
                    "if" => {
                        cursor.bump();
                        self.begin_if(cursor, Vec::new())
                    }
                    // A loop jumps back to its `Count` instruction before the condition, so that every iteration is counted.
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
                    "for" if cursor.peek_at(1).is_some_and(|t| t.is('(')) => {
                        let message = "grammars have no 'for'".to_owned();
                        let help = "count in a loop with 'while': i = 0; while (i < 3) { ..; i = i+1; }";
                        self.compiler.session.error_help("L001", message, t.place, help);
                        None
                    }
                    "int" | "float" | "double"
                        if matches!(cursor.peek_at(1).map(|t| t.kind), Some(TokenKind::Ident(_))) =>
                    {
                        let message = "variables of grammars have no types".to_owned();
                        self.compiler.session.error_help("L001", message, t.place, "remove the type: x = 3;");
                        None
                    }
                    _ => self.assignment_or_call(cursor, name, t.place),
                }
            }
            TokenKind::Number(_) | TokenKind::Char('(' | '-' | '!' | '+') => {
                self.count_statement(t.place);
                self.bare_expression(cursor, t.place)
            }
            _ => {
                let word = self.compiler.describe(&t);
                let help = "write an assignment such as 'x = 1;', a call, 'if', 'while' or 'do', or remove it";
                self.error(format!("unexpected {word}, expected a statement"), t.place, help)
            }
        }
    }

    fn open_brace(&mut self, cursor: &mut TokenCursor<'_>, open: OpenBrace) -> Option<()> {
        let place = cursor.place();
        if !cursor.peek().is_some_and(|t| t.is('{')) {
            return self.refuse_without_braces(cursor, &open);
        }
        cursor.bump();
        self.open.push(open);
        if self.open.len() > self.compiler.max_depth {
            let message = format!("blocks nested deeper than {}", self.compiler.max_depth);
            self.compiler.session.error("L004", message, place, "too deep here");
            return None;
        }
        Some(())
    }

    /// Reports L001 for a statement without braces after `if`, `else`, `while` or `do`.
    fn refuse_without_braces(&mut self, cursor: &TokenCursor<'_>, open: &OpenBrace) -> Option<()> {
        let after = match open {
            OpenBrace::If(..) => "if (..)",
            OpenBrace::Else(_) => "else",
            OpenBrace::While(..) => "while (..)",
            OpenBrace::Do(_) => "do",
        };
        let found = cursor.peek().map_or_else(|| "end of block".to_owned(), |t| self.compiler.describe(t));
        let message = format!("unexpected {found}, expected '{{' after '{after}'");
        let help = format!("put the statement in braces: {after} {{ .. }}");
        // The text up to the semicolon, without blanks.
        let mut text = String::new();
        let mut ahead = 0;
        while let Some(t) = cursor.peek_at(ahead) {
            match t.kind {
                TokenKind::Ident(n) | TokenKind::Number(n) => text.push_str(self.compiler.session.names.get(n)),
                TokenKind::Char(c) if !matches!(c, '{' | '}') => text.push(c),
                _ => break,
            }
            if t.is(';') {
                let place = cursor.place().to(t.place);
                self.compiler.session.error_fix("L001", message, place, help, format!("{{ {text} }}"));
                return None;
            }
            ahead += 1;
        }
        self.compiler.session.error_help("L001", message, cursor.place(), help);
        None
    }

    /// Compiles a condition in parentheses; returns the jump that is taken if it is false.
    fn condition(&mut self, cursor: &mut TokenCursor<'_>) -> Option<usize> {
        self.expect(cursor, '(')?;
        self.append_expression(cursor)?;
        if let Some(t) = cursor.peek().filter(|t| t.is('=')) {
            let message = "unexpected '=', expected ')'".to_owned();
            self.compiler.session.error_fix("L001", message, t.place, "did you mean '=='?", "==");
            return None;
        }
        self.expect(cursor, ')')?;
        self.code.ops.push(Op::JumpIfZero(0));
        Some(self.position() - 1)
    }

    fn begin_if(&mut self, cursor: &mut TokenCursor<'_>, ends: Vec<usize>) -> Option<()> {
        let jump = self.condition(cursor)?;
        self.open_brace(cursor, OpenBrace::If(jump, ends))
    }

    fn append_expression(&mut self, cursor: &mut TokenCursor<'_>) -> Option<()> {
        let code = compile_expression(self.compiler, cursor)?;
        self.code.append(code);
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
            None => self.error("unexpected '}', no block is open".to_owned(), place, "remove it"),
            Some(OpenBrace::If(jump, mut ends)) if self.next_is_word(cursor, "else") => {
                cursor.bump();
                self.code.ops.push(Op::Jump(0));
                // At an `else`, the block before it jumps to the end of the whole if-chain; its false condition leads here.
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
            // At the end of a `while` body, jump back to the condition; a false condition leads after that jump.
            Some(OpenBrace::While(start, jump)) => {
                self.code.ops.push(Op::Jump(start));
                self.patch_jump(jump);
                Some(())
            }
            Some(OpenBrace::Do(start)) => {
                if !self.next_is_word(cursor, "while") {
                    let help = "put the condition behind the block: do {..} while (x < 3);";
                    return self.error("'do' block without 'while'".to_owned(), place, help);
                }
                cursor.bump();
                // In `do { } while (c)` a false condition skips the jump back.
                let out = self.condition(cursor)?;
                self.code.ops.push(Op::Jump(start));
                self.patch_jump(out);
                Some(())
            }
        }
    }

    fn assignment_or_call(&mut self, cursor: &mut TokenCursor<'_>, name: u32, place: SourcePlace) -> Option<()> {
        let next = cursor.peek_at(1);
        // A call as a statement: its value is discarded.
        if next.is_some_and(|t| t.is('(')) {
            self.append_expression(cursor)?;
            self.code.ops.push(Op::Pop);
            return self.expect(cursor, ';');
        }
        if next.is_some_and(|t| t.is('[')) {
            return self.element_statement(cursor, name, place);
        }
        // A statement that is not an assignment is an expression, whose value is discarded.
        let follows = |c: char| cursor.peek_at(2).is_some_and(|t| t.glued && t.is(c));
        let is_equality = next.is_some_and(|t| t.is('=')) && follows('=');
        let doubled = ['+', '-'].iter().any(|c| next.is_some_and(|t| t.is(*c)) && follows(*c));
        let compound = matches!(next.map(|t| t.kind), Some(TokenKind::Char('+' | '-' | '*' | '/' | '%' | '^')));
        let changes = compound && follows('=') || doubled && cursor.peek_at(3).is_none_or(|t| t.is(';'));
        if changes {
            return self.refuse_compound(cursor, name, doubled);
        }
        if is_equality || !next.is_some_and(|t| t.is('=')) {
            return self.bare_expression(cursor, place);
        }
        cursor.bump();
        self.expect(cursor, '=')?;
        self.append_expression(cursor)?;
        let op = self.compiler.store_variable(name, place)?;
        self.code.ops.push(op);
        self.expect(cursor, ';')
    }

    /// Compiles `a[i,j] = expression;`, or an expression that begins with an array element.
    fn element_statement(&mut self, cursor: &mut TokenCursor<'_>, name: u32, place: SourcePlace) -> Option<()> {
        let Some(array) = self.compiler.array(name) else {
            let word = self.compiler.session.names.get(name).to_owned();
            let help = format!("declare it before the productions: Define: {{ array {word}[10]; }}");
            let message = format!("'{word}' is no array");
            self.compiler.session.error_help("L001", message, place, help);
            return None;
        };
        if !self.assigns_element(cursor) {
            return self.bare_expression(cursor, place);
        }
        cursor.bump();
        let mut given = 0_usize;
        let mut close = place;
        // Indices may stand in one pair of brackets or in a pair each.
        while cursor.eat('[') {
            loop {
                self.append_expression(cursor)?;
                given += 1;
                if !cursor.eat(',') {
                    break;
                }
            }
            close = cursor.place();
            self.expect(cursor, ']')?;
        }
        let access = self.compiler.element(array, given, place.to(close))?;
        self.expect(cursor, '=')?;
        self.append_expression(cursor)?;
        self.code.elements.push(access);
        self.code.ops.push(Op::StoreElement(self.code.elements.len() - 1));
        self.expect(cursor, ';')
    }

    /// True for `name[..] =` at the cursor, but not for `name[..] ==`.
    fn assigns_element(&self, cursor: &TokenCursor<'_>) -> bool {
        let mut depth = 0_usize;
        let mut ahead = 1;
        while let Some(t) = cursor.peek_at(ahead) {
            match t.kind {
                TokenKind::Char('[') => depth += 1,
                TokenKind::Char(']') => depth = depth.saturating_sub(1),
                TokenKind::Char('=') if depth == 0 => {
                    return !cursor.peek_at(ahead + 1).is_some_and(|t| t.is('=') && t.glued);
                }
                _ if depth == 0 => return false,
                _ => {}
            }
            ahead += 1;
        }
        false
    }

    /// Compiles an expression as a statement, whose value is discarded, as cpfg does.
    fn bare_expression(&mut self, cursor: &mut TokenCursor<'_>, place: SourcePlace) -> Option<()> {
        let errors = self.compiler.session.diagnostics.len();
        self.append_expression(cursor)?;
        self.code.ops.push(Op::Pop);
        self.expect(cursor, ';')?;
        if self.compiler.session.diagnostics.len() == errors {
            let help = "its value is dropped, as in cpfg; write 'v = ..;' to keep it";
            self.compiler.session.warning("L008", "this expression has no effect".into(), place, help);
        }
        Some(())
    }

    /// Reports L001 for `v += ..`, `v++` and the like, which the language does not have.
    fn refuse_compound(&mut self, cursor: &TokenCursor<'_>, name: u32, doubled: bool) -> Option<()> {
        let word = self.compiler.session.names.get(name).to_owned();
        let (first, op, last) = (cursor.peek()?, cursor.peek_at(1)?, cursor.peek_at(2)?);
        let TokenKind::Char(sign) = op.kind else { return None };
        let place = op.place.to(last.place);
        let message = format!("unexpected '{sign}', expected '='");
        let mut d = Diagnostic::error("L001", message, place.span, "here");
        // Replace `v++` as a whole. In `v += e` replace only the operator by `= v +`, which is right for any e.
        if doubled {
            d = d
                .help(format!("write {word} = {word} {sign} 1"))
                .fix(first.place.to(last.place).span, format!("{word} = {word} {sign} 1"));
        } else if sign == '+' {
            d = d
                .help(format!("write the variable on both sides: {word} = {word} {sign} .."))
                .fix(place.span, format!("= {word} {sign}"));
        } else {
            d = d.help(format!("write the variable on both sides: {word} = {word} {sign} (..)"));
        }
        self.compiler.session.push(d, place);
        None
    }

    /// Compiles `printf("format", values);`, which writes to the output of the derivation.
    fn printf(&mut self, cursor: &mut TokenCursor<'_>, place: SourcePlace) -> Option<()> {
        cursor.bump();
        self.expect(cursor, '(')?;
        let Some(&Token { kind: TokenKind::Text(format), .. }) = cursor.peek() else {
            let message = "printf needs a format in quotes".to_owned();
            let help = "write printf(\"step %g\\n\", n);";
            self.compiler.session.error_help("L022", message, cursor.place(), help);
            return None;
        };
        let format = self.compiler.session.names.get(format).to_owned();
        cursor.bump();
        let mut arguments = 0_usize;
        while cursor.eat(',') {
            self.append_expression(cursor)?;
            arguments += 1;
        }
        self.expect(cursor, ')')?;
        // Place of the warning about omitted output.
        self.code.places.push(place);
        let format = PrintFormat::new(&format, arguments, self.code.places.len() - 1);
        if format.fields() != arguments {
            let message = format!("the format of printf takes {} values, got {arguments}", format.fields());
            let help = "give one value for each % of the format; a missing one is 0";
            self.compiler.session.warning("L008", message, place, help);
        }
        self.code.formats.push(format);
        self.code.ops.push(Op::Print(self.code.formats.len() - 1));
        // Discard the 0 that `Print` pushes.
        self.code.ops.push(Op::Pop);
        self.expect(cursor, ';')
    }
}

/// Compiles a condition that must use all tokens; a single `*` is true.
pub(super) fn condition(compiler: &mut Compiler<'_>, tokens: &[Token], place: SourcePlace) -> Option<Option<Bytecode>> {
    match tokens {
        [] => Some(None),
        [t] if t.is('*') => Some(None),
        _ => whole_expression(compiler, tokens, place).map(Some),
    }
}
