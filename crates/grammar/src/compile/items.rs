//! Reads the items of an L-system: header, values, blocks, sections.

use super::lines::{self, KEYWORDS, Keyword, LogicalLine, is_block};
use std::rc::Rc;

use super::{
    Array, Compiler, NameScope, TokenCursor, describe, expression, production, statement, successor, whole_expression,
};
use crate::code::{ArrayShape, Bytecode, Op};
use crate::program::{IgnoredSymbols, Program, SubSystem};
use crate::token::{ParseSession, SourcePlace, Token, TokenKind, with_fix};
use crate::vm;
use osier_base::diagnostic::{Diagnostic, Span, nearest};

/// Limit on the variables of a grammar, array elements included: their slots are 16-bit numbers.
const MAX_ARRAY_ELEMENTS: u32 = 65_535;

/// Limit on the productions in one section of a file. Own: a hundred times those of the largest models, which take 20 MB.
const MAX_PRODUCTIONS: usize = 20_000;
/// Help for faults of arrays in `Define:`.
const ARRAYS_HELP: &str = "write: Define: { array a[2] = {1, 2}; }";
/// Help for item values that are not constant.
const CONSTANT_HELP: &str = "write a number, or a calculation of numbers and of #define";

/// Names of items in other notations, and the corresponding item of this notation.
const FOREIGN_ITEMS: [(&[&str], &str); 5] = [
    (
        &["angle", "delta", "theta"],
        "a grammar has no item for the angle of its turns: write +(25), or give the plant an angle: --set angle_deg=25, or angle_deg \
         below [plants.NAME.turtle]",
    ),
    (&["start", "initiator", "initial", "premise"], "write the string that a derivation starts with as 'Axiom: F'"),
    (&["iterations", "generations", "order"], "write the number of steps as 'derivation length: 5'"),
    (&["variables", "constants", "alphabet"], "symbols are not declared: remove this line"),
    (&["rules", "productions"], "write each production on a line of its own, as 'F --> F[+F]F'"),
];

/// Splits lines into one list for each L-system of the file, which begins with its heading: `Lsystem`, `ring Lsystem`, or
/// both on two lines.
fn split_systems(lines: Vec<LogicalLine>) -> Vec<Vec<LogicalLine>> {
    let mut systems: Vec<Vec<LogicalLine>> = Vec::new();
    // Which parts of the last L-system have been read.
    let (mut has_ended, mut has_heading, mut has_items) = (false, false, false);
    for line in lines {
        let key = line.keyword.map(|k| k.0);
        // A second `Lsystem` begins another L-system even if `endlsystem` is missing.
        let begins = match key {
            Some(Keyword::Lsystem) => has_ended || (has_heading && has_items),
            Some(Keyword::Ring) => has_ended,
            _ => false,
        };
        if begins {
            (has_ended, has_heading, has_items) = (false, false, false);
        }
        has_ended |= key == Some(Keyword::EndLsystem);
        has_heading |= key == Some(Keyword::Lsystem);
        has_items |= !line.is_heading();
        match systems.last_mut() {
            Some(system) if !begins => system.push(line),
            _ => systems.push(vec![line]),
        }
    }
    systems
}

/// Copies of the parts of an [`ItemParser`] that a [`Compiler`] needs, so that the program can change while it compiles.
struct CompilerContext {
    globals: Vec<u32>,
    arrays: Rc<[Array]>,
    has_turtle: bool,
}

impl CompilerContext {
    fn compiler(self, session: &mut ParseSession, scope: NameScope) -> Compiler<'_> {
        let mut c = Compiler::new(session, scope);
        (c.globals, c.arrays, c.has_turtle) = (self.globals, self.arrays, self.has_turtle);
        c
    }
}

/// Program of a file, in which the L-systems after the first one are subsystems; `label` is the text after `Lsystem:`.
#[derive(Debug)]
pub(crate) struct ParsedGrammar {
    pub program: Program,
    pub label: String,
}

/// Section of the file, which decides where productions are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ProductionSection {
    Productions,
    Decomposition,
    Homomorphism,
}

pub(super) struct ItemParser<'r> {
    pub(super) session: &'r mut ParseSession,
    pub(super) program: Program,
    label: String,
    section: ProductionSection,
    globals: Vec<u32>,
    arrays: Vec<Array>,
    shared_arrays: Rc<[Array]>,
    /// Nonzero initial values of array elements, by slot.
    array_values: Vec<(u16, f64)>,
    header: Option<SourcePlace>,
    axiom: Option<SourcePlace>,
    /// Items read so far that may occur only once, and whether they belong to the homomorphism.
    given: Vec<(Keyword, bool)>,
    ended: bool,
    /// True once a production beyond [`MAX_PRODUCTIONS`] was reported.
    has_too_many: bool,
    /// Place of the last line; the suggested `endlsystem` is inserted after it.
    end: Option<SourcePlace>,
}

/// Reads all L-systems of a file: the first is the main one, the others become its subsystems.
pub(crate) fn parse(session: &mut ParseSession, tokens: Vec<Token>, start: SourcePlace) -> ParsedGrammar {
    let lines = lines::split_lines(session, &tokens);
    // The lines hold copies of the tokens; keeping both would cost a fourth of all memory for a long text.
    drop(tokens);
    let mut p = ItemParser {
        session,
        program: Program::default(),
        label: String::new(),
        section: ProductionSection::Productions,
        globals: Vec::new(),
        arrays: Vec::new(),
        shared_arrays: Rc::from([]),
        array_values: Vec::new(),
        header: None,
        axiom: None,
        given: Vec::new(),
        ended: false,
        has_too_many: false,
        end: lines.last().and_then(LogicalLine::place),
    };
    p.program.decomposition.depth = 1;
    p.program.homomorphism.depth = 1;
    // Brackets and the cut symbol have fixed meanings and get the first numbers.
    for c in ['[', ']', '%'] {
        p.program.symbols.intern(c);
    }
    let (main, others) = p.main_lines(lines);
    // Collect global variables and turtle bindings before compiling any production, wherever their items are in the file.
    // All L-systems of a file share variables and arrays.
    let all = || main.iter().chain(others.iter().flatten());
    p.collect_globals(all());
    for line in all().filter(|l| l.keyword.is_some_and(|(k, _)| k == Keyword::Define)) {
        p.define_item(line);
    }
    p.shared_arrays = std::mem::take(&mut p.arrays).into();
    for line in main.iter().filter(|l| l.keyword.is_some_and(|(k, _)| is_block(k) && k != Keyword::Define)) {
        p.block_item(line);
    }
    p.set_array_values();
    p.turtle_items(&main);
    for line in &main {
        if p.session.is_full() {
            break;
        }
        p.item(line);
    }
    p.check_complete(start);
    for system in &others {
        p.subsystem(system);
    }
    let symbols = p.program.symbols.len();
    p.program.rules.index(symbols);
    p.program.decomposition.index(symbols);
    p.program.homomorphism.index(symbols);
    for s in &mut p.program.subsystems {
        [&mut s.rules, &mut s.decomposition, &mut s.homomorphism].into_iter().for_each(|set| set.index(symbols));
    }
    p.program.blocks.globals = p.variable_count();
    ParsedGrammar { program: p.program, label: p.label }
}

impl ItemParser<'_> {
    /// Separates the lines of the first L-system from those of the others, and stores the place of its heading.
    fn main_lines(&mut self, lines: Vec<LogicalLine>) -> (Vec<LogicalLine>, Vec<Vec<LogicalLine>>) {
        let mut systems = split_systems(lines);
        // Lines before the first heading belong to the first L-system.
        let main = if systems.is_empty() { Vec::new() } else { systems.remove(0) };
        self.header = main.iter().find(|l| l.is_heading()).and_then(LogicalLine::place);
        (main, systems)
    }

    /// Reads another L-system of the file: its productions, and its blocks, which run after those of the main L-system. Its
    /// axiom and derivation length are read, but have no effect.
    fn subsystem(&mut self, lines: &[LogicalLine]) {
        let program = &mut self.program;
        // The parser fills the sections of the main L-system, so that these are saved here and restored below.
        let main = SubSystem {
            label: None,
            ignored: std::mem::take(&mut program.ignored),
            rules: std::mem::take(&mut program.rules),
            decomposition: std::mem::take(&mut program.decomposition),
            homomorphism: std::mem::take(&mut program.homomorphism),
        };
        let (axiom, length, place) = (std::mem::take(&mut program.axiom), program.length, program.length_place);
        let (seed, ring) = (program.seed, program.is_ring);
        let blocks = std::mem::take(&mut program.blocks);
        // Optional settings return to their defaults for each L-system.
        (program.decomposition.depth, program.homomorphism.depth) = (1, 1);
        let (label, first) = (std::mem::take(&mut self.label), self.axiom.take());
        (self.section, self.ended) = (ProductionSection::Productions, false);
        self.given.clear();
        for line in lines.iter().filter(|l| l.keyword.is_some_and(|(k, _)| is_block(k) && k != Keyword::Define)) {
            self.block_item(line);
        }
        for line in lines {
            self.item(line);
        }
        let program = &mut self.program;
        // Blocks of all L-systems run one after the other: append each to the block of the main L-system.
        let own = std::mem::replace(&mut program.blocks, blocks);
        for (slot, code) in [
            (&mut program.blocks.start, own.start),
            (&mut program.blocks.start_each, own.start_each),
            (&mut program.blocks.end_each, own.end_each),
            (&mut program.blocks.end, own.end),
        ] {
            match (slot.as_mut(), code) {
                (Some(main), Some(code)) => main.append(code),
                (None, code) => *slot = code,
                (Some(_), None) => {}
            }
        }
        program.subsystems.push(SubSystem {
            label: self.label.parse().ok(),
            ignored: std::mem::replace(&mut program.ignored, main.ignored),
            rules: std::mem::replace(&mut program.rules, main.rules),
            decomposition: std::mem::replace(&mut program.decomposition, main.decomposition),
            homomorphism: std::mem::replace(&mut program.homomorphism, main.homomorphism),
        });
        // Axiom, length, seed and ring of the main L-system remain in force.
        (program.axiom, program.length, program.length_place) = (axiom, length, place);
        (program.seed, program.is_ring) = (seed, ring);
        (self.label, self.axiom) = (label, first);
    }

    /// Collects the names that blocks assign: all of them are global, wherever the block is in the file.
    fn collect_globals<'l>(&mut self, lines: impl Iterator<Item = &'l LogicalLine>) {
        let blocks = lines.filter(|l| l.keyword.is_some_and(|(k, _)| is_block(k) && k != Keyword::Define));
        for line in blocks {
            for (i, t) in line.tokens.iter().enumerate() {
                let TokenKind::Ident(name) = t.kind else { continue };
                // Matches `name =`, but not `name ==`.
                let assigned = line.tokens.get(i + 1).is_some_and(|t| t.is('='))
                    && !line.tokens.get(i + 2).is_some_and(|t| t.is('=') && t.glued);
                if assigned && !self.globals.contains(&name) {
                    self.globals.push(name);
                }
            }
        }
    }

    pub(super) fn compiler(&mut self, scope: NameScope) -> Compiler<'_> {
        let context = self.compiler_context();
        context.compiler(self.session, scope)
    }

    fn compiler_context(&self) -> CompilerContext {
        CompilerContext {
            globals: self.globals.clone(),
            arrays: Rc::clone(&self.shared_arrays),
            has_turtle: self.program.turtle.is_some(),
        }
    }

    /// Number of global variables, array elements included.
    fn variable_count(&self) -> usize {
        let elements = |a: &Array| a.shape.sizes.iter().fold(1, |n, s| n * *s as usize);
        self.globals.len() + self.arrays.iter().chain(self.shared_arrays.iter()).map(elements).sum::<usize>()
    }

    /// Reads a `Define` block: `Define: { array a[2,3] = {1,2,3,4,5,6}; array b[4]; }`
    fn define_item(&mut self, line: &LogicalLine) {
        let (Some((_, n)), Some(place)) = (line.keyword, line.place()) else { return };
        let Some(inner) = self.block_tokens(line, n, place) else { return };
        let mut cursor = TokenCursor::new(inner, place);
        while cursor.peek().is_some() {
            if cursor.eat(';') {
                continue;
            }
            let is_array = matches!(cursor.peek().map(|t| t.kind), Some(TokenKind::Ident(w)) if self.session.names.get(w) == "array");
            if !is_array && self.is_word(cursor.peek(), "external") {
                let message = "arrays that another program fills ('external') are not supported".to_owned();
                let help =
                    "osier runs no programs beside a grammar: write the array with its values, array a[2] = {1, 2};";
                self.session.error_help("L001", message, cursor.peek().map_or(place, |t| t.place), help);
                return;
            }
            if !is_array {
                let message = "unexpected token, expected 'array NAME[SIZE];'".to_owned();
                let help = "only arrays are defined here; assign variables in Start: { .. }";
                return self.session.error_help("L001", message, cursor.place(), help);
            }
            cursor.bump();
            // One `array` may declare several arrays, separated by commas.
            loop {
                if self.array_definition(&mut cursor).is_none() {
                    return;
                }
                if !cursor.eat(',') {
                    break;
                }
            }
            if !cursor.eat(';') {
                let message = "unexpected token, expected ';' after the array".to_owned();
                return self.session.error_help("L001", message, cursor.place(), "end the definition with ';'");
            }
        }
    }

    /// Reads the declaration of an array, `name[2,3] = {..}`; `None` after an error.
    fn array_definition(&mut self, cursor: &mut TokenCursor<'_>) -> Option<()> {
        let place = cursor.place();
        let Some(TokenKind::Ident(name)) = cursor.peek().map(|t| t.kind) else {
            self.session.error_help("L001", "expected the name of an array".into(), place, ARRAYS_HELP);
            return None;
        };
        cursor.bump();
        let word = self.session.names.get(name).to_owned();
        if self.arrays.iter().any(|a| a.name == name) || self.globals.contains(&name) {
            self.session.error("L024", format!("'{word}' is defined twice"), place, "the second one");
            return None;
        }
        // Sizes may stand in one pair of brackets or in a pair each.
        let mut sizes = Vec::new();
        while cursor.eat('[') {
            loop {
                let at = cursor.place();
                let size = self.constant(cursor)?;
                if !(1.0..=f64::from(MAX_ARRAY_ELEMENTS)).contains(&size) {
                    let message = format!("a size of an array lies in 1 to {MAX_ARRAY_ELEMENTS}");
                    self.session.error_help("L001", message, at, "write a whole number of elements");
                    return None;
                }
                if size.fract().abs() > 0.0 {
                    let message = format!("{size} is no whole number, {} is taken", size.trunc());
                    self.session.warning("L008", message, at, "write a whole number of elements");
                }
                #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the range is checked")]
                sizes.push(size as u32);
                if !cursor.eat(',') {
                    break;
                }
            }
            self.expect(cursor, ']')?;
        }
        if sizes.is_empty() {
            let message = format!("expected '[' and the sizes of array '{word}'");
            self.session.error_help("L001", message, cursor.place(), ARRAYS_HELP);
            return None;
        }
        // All elements are global variables after those of the blocks.
        let elements = sizes.iter().fold(1_usize, |n, s| n.saturating_mul(*s as usize));
        let used = self.variable_count();
        let first = u16::try_from(used).ok().filter(|_| used.saturating_add(elements) <= MAX_ARRAY_ELEMENTS as usize);
        let Some(first) = first else {
            let message = format!("arrays and variables have more than {MAX_ARRAY_ELEMENTS} elements together");
            self.session.error_help("L004", message, place, "make the arrays smaller");
            return None;
        };
        if cursor.eat('=') {
            self.array_initializer(cursor, &word, first, elements)?;
        }
        self.arrays.push(Array { name, shape: ArrayShape { first, sizes } });
        Some(())
    }

    /// Reads initial values `{1, 2, {3, 4}}` in the order of the elements.
    fn array_initializer(&mut self, cursor: &mut TokenCursor<'_>, word: &str, first: u16, count: usize) -> Option<()> {
        let place = cursor.place();
        self.expect(cursor, '{')?;
        // Inner braces are only grouping: values fill the elements in the order of the text.
        let (mut depth, mut given) = (1_usize, 0_usize);
        while depth > 0 {
            if cursor.eat('{') {
                depth += 1;
            } else if cursor.eat('}') {
                depth -= 1;
            } else if !cursor.eat(',') {
                let value = self.constant(cursor)?;
                if given >= count {
                    let message = format!("array '{word}' has {count} elements, more values are given");
                    self.session.error_help("L022", message, place, "remove values, or make the array larger");
                    return None;
                }
                let slot = u16::try_from(usize::from(first) + given).ok()?;
                self.array_values.push((slot, value));
                given += 1;
            }
        }
        Some(())
    }

    /// Value of a constant expression; L001 and `None` for other expressions.
    fn constant(&mut self, cursor: &mut TokenCursor<'_>) -> Option<f64> {
        let place = cursor.place();
        let mut compiler = self.compiler(NameScope::Global);
        let code = expression::compile_expression(&mut compiler, cursor)?;
        let value = vm::constant_value(&code);
        if value.is_none() {
            self.session.error_help("L001", "value is not a constant number".into(), place, CONSTANT_HELP);
        }
        value
    }

    fn expect(&mut self, cursor: &mut TokenCursor<'_>, c: char) -> Option<()> {
        if cursor.eat(c) {
            return Some(());
        }
        let found = cursor.peek().map_or_else(|| "end of block".to_owned(), |t| describe(&self.session.names, t));
        let message = format!("unexpected {found}, expected '{c}'");
        self.session.error_help("L001", message, cursor.place(), format!("put '{c}' there"));
        None
    }

    /// Sets the initial values of arrays at the start of the derivation, before the statements of `Start`.
    fn set_array_values(&mut self) {
        let values = std::mem::take(&mut self.array_values);
        if values.is_empty() {
            return;
        }
        let set = values.iter().flat_map(|(slot, value)| [Op::Const(*value), Op::StoreGlobal(*slot)]);
        let mut code = Bytecode { ops: set.collect(), ..Bytecode::default() };
        if let Some(start) = self.program.blocks.start.take() {
            code.append(start);
        }
        self.program.blocks.start = Some(code);
    }

    /// The tokens of a block between its outer braces; `None` after an error.
    fn block_tokens<'l>(&mut self, line: &'l LogicalLine, keyword: usize, place: SourcePlace) -> Option<&'l [Token]> {
        let colon = usize::from(line.tokens.get(keyword).is_some_and(|t| t.is(':')));
        match &line.tokens[(keyword + colon).min(line.tokens.len())..] {
            [open, inner @ .., close] if open.is('{') && close.is('}') => Some(inner),
            [open, ..] if open.is('{') => {
                self.session.error("L004", "block is never closed", open.place, "opened here");
                None
            }
            body => {
                let at = body.first().map_or(place, |t| t.place);
                // Publications on L-systems call the axiom `start`.
                let help = "put the statements of the block in braces: Start: { n = 1; }; the string that a derivation starts with is \
                            the axiom: Axiom: F";
                self.session.error_help("L001", "unexpected token, expected '{'".into(), at, help);
                None
            }
        }
    }

    fn block_item(&mut self, line: &LogicalLine) {
        let (Some((key, n)), Some(place)) = (line.keyword, line.place()) else { return };
        let Some(inner) = self.block_tokens(line, n, place) else { return };
        let mut compiler = self.compiler(NameScope::Global);
        let Some(code) = statement::block(&mut compiler, inner, place) else { return };
        let head = line.tokens.first().map_or(place, |t| t.place);
        self.check_second(key, head);
        let slot = match key {
            Keyword::Start => &mut self.program.blocks.start,
            Keyword::StartEach => &mut self.program.blocks.start_each,
            Keyword::EndEach => &mut self.program.blocks.end_each,
            _ => &mut self.program.blocks.end,
        };
        *slot = Some(code);
    }

    /// L008 for a repeated item, which replaces the first one.
    fn check_second(&mut self, key: Keyword, place: SourcePlace) {
        // The homomorphism has its own seed and depth; the length belongs to the L-system in any section.
        let has_own = matches!(key, Keyword::Seed | Keyword::Depth);
        let item = (key, has_own && self.section == ProductionSection::Homomorphism);
        if !self.given.contains(&item) {
            return self.given.push(item);
        }
        let name = KEYWORDS.iter().find(|k| k.1 == key).map_or("item", |k| k.2);
        let message = format!("a second '{name}' replaces the first one");
        self.session.warning("L008", message, place, "keep one of them");
    }

    fn item(&mut self, line: &LogicalLine) {
        if self.ended {
            return;
        }
        let Some(place) = line.place() else { return };
        if let Some(arrow) = line.arrow {
            return self.production(line, arrow);
        }
        let Some((key, n)) = line.keyword else { return self.unknown_line(line, place) };
        let colon = usize::from(line.tokens.get(n).is_some_and(|t| t.is(':')));
        let head = line.tokens.first().map_or(place, |t| t.place);
        // The value of an item follows its keyword and the optional colon.
        let value = &line.tokens[(n + colon).min(line.tokens.len())..];
        if matches!(key, Keyword::Seed | Keyword::Length | Keyword::Depth) {
            self.check_second(key, head);
        }
        match key {
            Keyword::Lsystem => self.label = self.spelling(value),
            // A label may follow, as after `Lsystem`.
            Keyword::Ring => {
                self.program.is_ring = true;
                if !value.is_empty() {
                    self.label = self.spelling(value);
                }
            }
            // `Seed:` belongs to the section it is in; all sections other than the homomorphism share one seed.
            Keyword::Seed => {
                let seed = self.integer(value, head);
                match self.section {
                    ProductionSection::Homomorphism => self.program.homomorphism.seed = seed,
                    _ => self.program.seed = seed,
                }
            }
            Keyword::Length => {
                self.program.length_place = Some(place);
                match self.integer(value, head).map(u32::try_from) {
                    Some(Ok(length)) => self.program.length = length,
                    Some(Err(_)) => {
                        let message = "derivation length must lie in 0 to 1,000,000".into();
                        self.session.error_help("L001", message, place, "write a number of steps in that range");
                    }
                    None => {}
                }
            }
            Keyword::Axiom => self.axiom_item(value, place),
            Keyword::Ignore | Keyword::Consider => self.set_ignored(key, value, head),
            Keyword::Decomposition | Keyword::Homomorphism => self.begin_section(key, value, head),
            Keyword::Depth => {
                let depth = match self.integer(value, head).map(u32::try_from) {
                    Some(Ok(depth)) => depth,
                    Some(Err(_)) => {
                        let message = "maximum depth must be 0 or more".into();
                        return self.session.error_help("L001", message, place, "write for example: maximum depth: 5");
                    }
                    None => return,
                };
                match self.section {
                    ProductionSection::Homomorphism => self.program.homomorphism.depth = depth,
                    _ => self.program.decomposition.depth = depth,
                }
            }
            Keyword::Warnings | Keyword::NoWarnings => self.set_depth_warnings(key == Keyword::Warnings),
            Keyword::EndLsystem => self.ended = true,
            _ => {}
        }
    }

    fn set_depth_warnings(&mut self, warn: bool) {
        match self.section {
            ProductionSection::Homomorphism => self.program.homomorphism.warn_depth = warn,
            _ => self.program.decomposition.warn_depth = warn,
        }
    }

    fn begin_section(&mut self, key: Keyword, value: &[Token], place: SourcePlace) {
        let is_homomorphism = key == Keyword::Homomorphism;
        self.section = if is_homomorphism { ProductionSection::Homomorphism } else { ProductionSection::Decomposition };
        let rules = if is_homomorphism { &mut self.program.homomorphism } else { &mut self.program.decomposition };
        rules.place = Some(place);
        // Items of the section may follow on the same line as its heading.
        let mut rest = value;
        while let Some(first) = rest.first() {
            let keyword_at = |i: usize| lines::keyword(&self.session.names, &rest[i..]);
            let own = [Keyword::Warnings, Keyword::NoWarnings, Keyword::Seed, Keyword::Depth];
            let Some((key, n)) = keyword_at(0).filter(|(k, _)| own.contains(k)) else {
                let message = format!("'{}' after this heading has no effect", self.spelling(rest));
                let help = "'warnings', 'no warnings', 'seed: n' and 'maximum depth: n' may stand here";
                return self.session.warning("L008", message, first.place, help);
            };
            let end = (n..rest.len()).find(|i| keyword_at(*i).is_some()).unwrap_or(rest.len());
            let line = LogicalLine { tokens: rest[..end].to_vec(), arrow: None, keyword: Some((key, n)) };
            self.item(&line);
            rest = &rest[end..];
        }
    }

    /// Texts of tokens, joined by blanks.
    pub(super) fn spelling(&self, tokens: &[Token]) -> String {
        let word = |t: &Token| describe(&self.session.names, t).trim_matches(['\'', '"']).to_owned();
        tokens.iter().map(word).collect::<Vec<_>>().join(" ")
    }

    /// The constant value of an item as an integer: L008 if a fraction was truncated, L001 if the value is missing or not constant.
    fn integer(&mut self, tokens: &[Token], place: SourcePlace) -> Option<i64> {
        if tokens.is_empty() {
            let help = "write the number behind the colon";
            self.session.fault("unexpected end of line, expected a number", place, "after this", help);
            return None;
        }
        let mut compiler = self.compiler(NameScope::Global);
        let code: Bytecode = whole_expression(&mut compiler, tokens, place)?;
        match vm::constant_value(&code) {
            #[allow(clippy::cast_possible_truncation, reason = "saturates; ranges are checked by the caller")]
            Some(v) if v.is_finite() => {
                if v.fract().abs() > 0.0 {
                    let message = format!("{v} is no whole number, {} is taken", v.trunc());
                    self.session.warning("L008", message, place, "write a whole number");
                }
                Some(v.trunc() as i64)
            }
            _ => {
                self.session.error_help("L001", "value is not a constant number".into(), place, CONSTANT_HELP);
                None
            }
        }
    }

    fn axiom_item(&mut self, value: &[Token], place: SourcePlace) {
        if let Some(first) = self.axiom {
            let d = Diagnostic::error("L001", "second axiom", place.span, "here").label(first.span, "the first one");
            return self.session.push(d.help("keep one axiom with the modules of both"), place);
        }
        self.axiom = Some(place);
        let mut compiler = self.compiler_context().compiler(self.session, NameScope::Global);
        if let Some((modules, _)) = successor::successor(&mut compiler, &mut self.program.symbols, value, place) {
            if modules.is_empty() {
                let d = Diagnostic::error("L003", "the axiom is empty", place.span, "expected modules after this");
                self.session.push(d.help("write the modules that the derivation begins with: Axiom: F(1)"), place);
            }
            let end = value.last().map_or(place, |t| t.place);
            production::check_balance(self.session, &modules, &self.program.symbols, "axiom", place, end);
            self.program.axiom = modules;
        }
    }

    fn set_ignored(&mut self, key: Keyword, value: &[Token], place: SourcePlace) {
        match (key, &self.program.ignored) {
            (_, IgnoredSymbols::Nothing) => {}
            (Keyword::Ignore, IgnoredSymbols::Listed(_)) | (Keyword::Consider, IgnoredSymbols::AllExcept(_)) => {
                let message = "the symbols of this line replace those of the one before".to_owned();
                self.session.warning("L008", message, place, "write all symbols in one line");
            }
            _ => {
                let message = "Ignore and Consider exclude each other".to_owned();
                return self.session.error_help("L010", message, place, "remove this line or the one before");
            }
        }
        // A quote is a symbol like any other character.
        let mut list = Vec::new();
        for t in value {
            let symbols = &mut self.program.symbols;
            match t.kind {
                TokenKind::Ident(n) | TokenKind::Number(n) => {
                    list.extend(self.session.names.get(n).chars().filter_map(|c| symbols.intern(c)));
                }
                TokenKind::Text(n) => {
                    let text = format!("\"{}\"", self.session.names.get(n));
                    list.extend(text.chars().filter(|c| !c.is_whitespace()).filter_map(|c| symbols.intern(c)));
                }
                TokenKind::Char(c) => list.extend(symbols.intern(c)),
                TokenKind::Newline { .. } => {}
            }
        }
        self.program.ignored =
            if key == Keyword::Ignore { IgnoredSymbols::Listed(list) } else { IgnoredSymbols::AllExcept(list) };
    }

    fn production(&mut self, line: &LogicalLine, arrow: usize) {
        let known = match self.section {
            ProductionSection::Productions => &self.program.rules,
            ProductionSection::Decomposition => &self.program.decomposition,
            ProductionSection::Homomorphism => &self.program.homomorphism,
        };
        if known.list.len() >= MAX_PRODUCTIONS {
            // Report only the first excess production: the others have the same cause.
            if let Some(place) = line.place().filter(|_| !self.has_too_many) {
                let message = format!("more than {MAX_PRODUCTIONS} productions");
                let help = "give symbols parameters, so that one production serves for many cases";
                self.session.error_help("L004", message, place, help);
            }
            self.has_too_many = true;
            return;
        }
        let mut compiler = self.compiler_context().compiler(self.session, NameScope::Production);
        let parsed = production::production(&mut compiler, &mut self.program.symbols, line, arrow);
        let Some(parsed) = parsed else { return };
        let rules = match self.section {
            ProductionSection::Productions => &mut self.program.rules,
            ProductionSection::Decomposition => &mut self.program.decomposition,
            ProductionSection::Homomorphism => &mut self.program.homomorphism,
        };
        rules.list.push(parsed);
    }

    /// The place of an arrow in the notation of another program; `None` if there is none.
    fn foreign_arrow(&self, line: &LogicalLine) -> Option<SourcePlace> {
        let tokens = &line.tokens;
        let mut depth = 0_usize;
        for (i, t) in tokens.iter().enumerate().skip(1) {
            let follows = |k: usize, c: char| tokens.get(i + k).is_some_and(|t| t.glued && t.is(c));
            let to = |k: usize| tokens.get(i + k).map(|e| t.place.to(e.place));
            match t.kind {
                TokenKind::Char('(') => depth += 1,
                TokenKind::Char(')') => depth = depth.saturating_sub(1),
                // A condition or a block follows, in which such characters are not arrows.
                TokenKind::Char(':' | '{') if depth == 0 => return None,
                _ if depth > 0 => {}
                TokenKind::Char('\u{2192}' | '\u{27f6}' | '\u{21d2}') => return Some(t.place),
                TokenKind::Char('-' | '=') if follows(1, '>') => return to(1),
                TokenKind::Char('=') if follows(1, '=') && follows(2, '>') => return to(2),
                TokenKind::Char('=') => return Some(t.place),
                _ => {}
            }
        }
        None
    }

    /// Place of the arrow `-o>`, cpfg's mark of productions that involve the environment, if the line has one.
    fn environment_arrow(&self, line: &LogicalLine) -> Option<SourcePlace> {
        line.tokens.windows(3).find_map(|w| match w {
            [a, o, b] if a.is('-') && self.is_word(Some(o), "o") && b.is('>') && o.glued && b.glued => {
                Some(a.place.to(b.place))
            }
            _ => None,
        })
    }

    fn is_word(&self, token: Option<&Token>, word: &str) -> bool {
        matches!(token.map(|t| t.kind), Some(TokenKind::Ident(n)) if self.session.names.get(n) == word)
    }

    /// The item that corresponds to an item of another notation at the start of a line: `angle: 25`, `angle = 25`, `angle 25`.
    fn foreign_item(&self, line: &LogicalLine) -> Option<&'static str> {
        let [first, sign, ..] = &line.tokens[..] else { return None };
        let TokenKind::Ident(n) = first.kind else { return None };
        if !(sign.is(':') || sign.is('=') || matches!(sign.kind, TokenKind::Number(_))) {
            return None;
        }
        let word = self.session.names.get(n).to_ascii_lowercase();
        FOREIGN_ITEMS.iter().find(|(words, _)| words.contains(&word.as_str())).map(|(_, help)| *help)
    }

    /// Reports a line that is neither an item nor a production.
    fn unknown_line(&mut self, line: &LogicalLine, place: SourcePlace) {
        // The name of an item and its value, without a colon or with `=` instead.
        if let Some(count) = lines::name_without_colon(&self.session.names, &line.tokens) {
            let spelled = self.spelling(&line.tokens[..count]);
            let message = format!("'{spelled}' without a colon behind it");
            let name = line.tokens[..count].last().map_or(place, |t| t.place);
            let behind = SourcePlace { span: Span { start: name.span.end, ..name.span }, ..name };
            let sign = line.tokens.get(count).filter(|t| t.is('=')).map_or(behind, |t| t.place);
            let d = Diagnostic::error("L001", message, place.span, "here").help("write ':' between name and value");
            return self.session.push(with_fix(d, sign, ":"), place);
        }
        if let Some(help) = self.foreign_item(line) {
            let word = self.spelling(&line.tokens[..1]);
            let at = line.tokens.first().map_or(place, |t| t.place);
            return self.session.error_help("L002", format!("unknown item '{word}'"), at, help);
        }
        if let Some(arrow) = self.environment_arrow(line) {
            let message = "'-o>', the arrow of productions that an environment takes part in, is not supported";
            let help =
                "osier runs no programs beside a grammar: write '-->' for what becomes of the module without one";
            return self.session.error_help("L001", message.to_owned(), arrow, help);
        }
        // Arrows of other programs: `->`, `=` and the like.
        if let Some(arrow) = self.foreign_arrow(line) {
            let message = "unexpected sign, expected '-->' between predecessor and successor".to_owned();
            return self.session.error_fix("L001", message, arrow, "did you mean '-->'?", "-->");
        }
        // A few plain words before a ":" are probably a misspelled item; any other line lacks its arrow.
        let colon = line.tokens.iter().position(|t| t.is(':') || t.is('{'));
        let words = &line.tokens[..colon.unwrap_or(line.tokens.len())];
        let all_words = !words.is_empty() && words.iter().all(|t| matches!(t.kind, TokenKind::Ident(_)));
        let first = line.tokens.first().map_or(place, |t| t.place);
        if all_words && (colon.is_some() || words.len() < 3) {
            let spelled = self.spelling(words);
            let lower = spelled.to_ascii_lowercase();
            let known = KEYWORDS.iter().map(|k| k.2);
            let near = nearest(
                &lower,
                known.clone().map(str::to_ascii_lowercase).collect::<Vec<_>>().iter().map(|s| s.as_str()),
            )
            .map(str::to_owned);
            // Suggest the nearest keyword in its usual spelling.
            let near = near.and_then(|n| known.clone().find(|k| k.eq_ignore_ascii_case(&n)));
            let help = match near {
                Some(n) => format!("did you mean '{n}'?"),
                None => "a production needs '-->' between predecessor and successor".to_owned(),
            };
            let at = words.last().map_or(first, |t| first.to(t.place));
            let d = Diagnostic::error("L002", format!("unknown item '{spelled}'"), at.span, "here").help(help);
            let d = if let Some(near) = near { with_fix(d, at, near) } else { d };
            return self.session.push(d, at);
        }
        let found = line.tokens.first().map_or_else(String::new, |t| describe(&self.session.names, t));
        let message = format!("unexpected {found}, expected an item or a production with '-->'");
        let help = "write an item such as 'Axiom: F', a production such as 'A --> F A', or a comment: /* .. */";
        self.session.fault(message, first, "this line", help);
    }

    fn check_complete(&mut self, start: SourcePlace) {
        let at = self.header.unwrap_or(start);
        if self.axiom.is_none() {
            let help = "add a line such as 'Axiom: F(1)'";
            self.session.error_help("L003", "the L-system has no axiom".into(), at, help);
        }
        if self.program.length_place.is_none() {
            let help = "add a line such as 'derivation length: 5'";
            self.session.error_help("L003", "the L-system has no derivation length".into(), at, help);
        }
        if !self.ended {
            let help = "add a last line 'endlsystem'";
            let mut d = Diagnostic::error("L003", "the L-system has no 'endlsystem'", at.span, "here").help(help);
            // Suggest to insert the missing line after the last one.
            if let Some(end) = self.end {
                let behind = Span { start: end.span.end, ..end.span };
                d = with_fix(d, SourcePlace { span: behind, ..end }, "\nendlsystem");
            }
            self.session.push(d, at);
        }
    }
}
