//! Writes a grammar of another program in the notation of cpfg, or in osier's own notation with the turtle dialect of that
//! program.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

use crate::binding::{Dialect, DialectSettings};
use crate::code::{BinaryOp, Bytecode, Expr, Op, RandomFunction, UnaryOp};
use crate::grammar::Grammar;
use crate::notation::Notation;
use crate::program::{ContextElement, FormalModule, IgnoredSymbols, Production, SuccessorModule};
use crate::symbols::SymbolId;
use osier_base::Result;
use osier_base::diagnostic::Diagnostic;

/// Target notation of [`convert`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ConvertTo {
    /// The notation and the commands of cpfg.
    Cpfg,
    /// The notation of osier, with the turtle dialect of the other program if there is one.
    Osier,
}

/// Text of a converted grammar, with notes on what the notation cannot express.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Converted {
    /// Text of a grammar file; for a grammar in the notation of cpfg, the unchanged file.
    pub text: String,
    /// Differences in the drawing, such as widths; empty if the text draws the same.
    pub notes: Vec<String>,
}

/// Limit on the colours that one `<` or `>` of Fractint may step over.
const MAX_COLOR_STEPS: u32 = 32;

/// Writes a grammar as text that draws the same. A grammar in the notation of cpfg is copied; a grammar of L-Py is written
/// for cpfg even if `to` is osier.
/// # Errors
/// `Input` with L061 for each command that the target notation cannot express.
pub fn convert(grammar: &Grammar, to: ConvertTo) -> Result<Converted> {
    let dialect = grammar.program.turtle.as_ref().map_or(Dialect::Cpfg, |t| t.dialect);
    if matches!(grammar.notation(), Notation::Cpfg | Notation::Abop | Notation::Catkin) {
        // Copy the file itself; its includes are not copied.
        let text = grammar.sources.text(grammar.start.span.source).to_owned();
        return Ok(Converted { text, notes: Vec::new() });
    }
    let to = if dialect == Dialect::LPy { ConvertTo::Cpfg } else { to };
    let mut writer = Writer::new(grammar, dialect, to);
    writer.check_arguments();
    writer.check_settings();
    // A backslash (roll) at the end of a line would join the next line to it.
    let text = writer.grammar_text().replace("\\\n", "\\ \n");
    if !grammar.palette().is_empty() {
        writer
            .notes
            .insert("the colours that the file sets are left out; a .map file beside the grammar can give them".into());
    }
    if dialect == Dialect::LPy && writer.interprets_cuts() {
        let note = "what stands behind '%' in the last string is drawn; `interpretation past %: off` in a view beside the grammar \
                    leaves it out";
        writer.notes.insert(note.into());
    }
    // In cpfg's notation a branching string is drawn as wood, not as lines; Fractint uses brackets only for branches.
    if to == ConvertTo::Cpfg && dialect == Dialect::Fractint && writer.has_branches() {
        let note = "lines that branch become wood: branches thin outwards, and the first one widens at its foot and goes on into the \
                    ground; skin.flare = 0 and skin.bury = 0 in a scene end it where it begins, as thick as it is";
        writer.notes.insert(note.into());
    }
    // The text does not say that its widths are those of another program.
    if to == ConvertTo::Cpfg && matches!(dialect, Dialect::LParser | Dialect::LPy) {
        let note = "osier widens a stem at its foot and continues it into the ground; skin.flare = 0 and skin.bury = 0 in a scene \
                    end it where it begins, as thick as it is";
        writer.notes.insert(note.into());
    }
    if writer.faults.is_empty() {
        Ok(Converted { text, notes: writer.notes.into_iter().collect() })
    } else {
        Err(grammar.report(writer.faults))
    }
}

/// Spelling of symbols that homomorphisms produce and expand again, below the first level of an interpretation.
#[derive(Debug, Clone)]
struct Level {
    /// The letter that replaces each such symbol.
    letters: BTreeMap<SymbolId, String>,
    /// The last parameter of a module with such a letter, which is its level.
    number: &'static str,
}

struct Writer<'g> {
    grammar: &'g Grammar,
    dialect: Dialect,
    to: ConvertTo,
    settings: DialectSettings,
    /// Spelling of each symbol in the target notation.
    names: BTreeMap<SymbolId, String>,
    taken: BTreeSet<char>,
    /// Homomorphisms that draw symbols of the other program by commands of cpfg.
    images: Vec<String>,
    /// Set while writing the successor of a homomorphism whose modules are expanded again.
    level: Option<Level>,
    faults: Vec<Diagnostic>,
    notes: BTreeSet<String>,
}

/// A module of a string, and the texts of the numbers in parentheses after it.
struct NumberedModule<'m> {
    module: &'m SuccessorModule,
    numbers: Vec<String>,
}

/// A module with its parameters as text, including the numbers of LParser's commands.
#[derive(Debug, Clone)]
struct TextModule {
    symbol: SymbolId,
    args: Vec<String>,
}

impl<'g> Writer<'g> {
    fn new(grammar: &'g Grammar, dialect: Dialect, to: ConvertTo) -> Self {
        let settings = grammar.program.turtle.as_ref().map(|t| t.settings).unwrap_or_default();
        // Letters of the commands that images use.
        let taken = "FfGgDidvMRObcoTspl".chars().collect();
        let (names, images, faults, notes) = (BTreeMap::new(), Vec::new(), Vec::new(), BTreeSet::new());
        Self { grammar, dialect, to, settings, names, taken, images, level: None, faults, notes }
    }

    /// True if the axiom or a successor contains a branch.
    fn has_branches(&self) -> bool {
        let program = &self.grammar.program;
        let successors = program.rules.list.iter().map(|p| &p.successor);
        std::iter::once(&program.axiom).chain(successors).any(|list| list.iter().any(|m| self.c(m.symbol) == '['))
    }

    /// True if the strings of an L-Py model with an interpretation may contain a `%`, after which the interpretation draws
    /// nothing.
    fn interprets_cuts(&self) -> bool {
        let program = &self.grammar.program;
        let made = program.rules.list.iter().chain(&program.decomposition.list).map(|p| &p.successor);
        !program.homomorphism.list.is_empty()
            && std::iter::once(&program.axiom).chain(made).any(|list| list.iter().any(|m| self.c(m.symbol) == '%'))
    }

    fn c(&self, symbol: SymbolId) -> char {
        self.grammar.program.symbols.get(symbol)
    }

    fn shown(&self, symbol: SymbolId) -> String {
        let c = self.c(symbol);
        self.grammar.program.symbols.long_name(c).map_or_else(|| c.to_string(), str::to_owned)
    }

    fn fault(&mut self, symbol: SymbolId, why: &str) {
        let shown = self.shown(symbol);
        let message = format!("'{shown}' cannot be written in the notation of cpfg: {why}");
        let at = self.grammar.place_of(None, self.c(symbol));
        let help = match self.dialect {
            Dialect::LPy => "osier draws the model as it is",
            _ => "`--to osier` keeps the commands of the other program",
        };
        let d = Diagnostic::error("L061", message, at, "here").help(help);
        if !self.faults.iter().any(|f| f.message == d.message) {
            self.faults.push(d);
        }
    }

    /// L061, at the place of the module, for each parameter that cannot be written in the notation of cpfg.
    fn check_arguments(&mut self) {
        let program = &self.grammar.program;
        for modules in [&program.axiom].into_iter().chain(program.productions().map(|p| &p.successor)) {
            for m in modules {
                for (i, why) in m.args.iter().enumerate().filter_map(|(i, e)| Some((i, unwritable(e)?))) {
                    self.argument_fault(m, i, why);
                }
            }
            let (numbered, loose) = self.with_numbers(modules);
            if let Some(parenthesis) = loose {
                self.parenthesis_fault(parenthesis);
            }
            for NumberedModule { module, numbers } in numbered {
                for number in numbers {
                    // A number after a rewritten symbol belongs to its successor, but a parameter is a part of its module.
                    let is_replaced = program.rules.matching(module.symbol, 0).next().is_some();
                    if number.parse::<f64>().is_err() {
                        self.argument_fault(module, 0, &format!("'{number}' is no number"));
                    } else if is_replaced {
                        self.argument_fault(module, 0, "it belongs to what a rule makes of the symbol");
                    }
                }
            }
        }
    }

    /// L061 for a fractional recursion, since cpfg draws whole steps; a note about the smallest thickness.
    fn check_settings(&mut self) {
        if self.to != ConvertTo::Cpfg {
            return;
        }
        if self.settings.min_thickness > 0.0 {
            self.notes.insert("the least thickness is left out".into());
        }
        if self.settings.fraction.is_some() {
            let message =
                "the fraction of the recursion cannot be written in the notation of cpfg: its steps are whole";
            let help = "write a whole recursion; `--to osier` keeps the fraction";
            self.faults.push(Diagnostic::error("L061", message, self.grammar.length_place(), "here").help(help));
        }
    }

    /// L061 at a module whose parameter `index` cannot be written in the notation of cpfg.
    fn argument_fault(&mut self, module: &SuccessorModule, index: usize, why: &str) {
        let shown = self.shown(module.symbol);
        let number = index + 1;
        let message = format!("parameter {number} of '{shown}' cannot be written in the notation of cpfg: {why}");
        let help = "write another expression in its place; osier draws the model as it is";
        let d = Diagnostic::error("L061", message, module.place.span, "here").help(help);
        if !self.faults.contains(&d) {
            self.faults.push(d);
        }
    }

    /// L061 at a production whose contexts skip other symbols than those of the other productions.
    fn list_fault(&mut self, p: &Production) {
        let message = "this production cannot be written in the notation of cpfg: it has another list of 'ignore:' or \
                       'consider:' than others with contexts";
        let help = "write one list, before all productions; osier draws the model as it is";
        let d = Diagnostic::error("L061", message, p.place.span, "here").help(help);
        if !self.faults.contains(&d) {
            self.faults.push(d);
        }
    }

    /// L061 at a parenthesis of LParser without a number, or without a command in the same rule that takes it.
    fn parenthesis_fault(&mut self, parenthesis: &SuccessorModule) {
        let shown = self.shown(parenthesis.symbol);
        let message = format!(
            "'{shown}' cannot be written in another notation: its number and its command stand in different rules"
        );
        let help = "write a number directly behind its command, in the same rule: F(20)";
        self.faults.push(Diagnostic::error("L061", message, parenthesis.place.span, "here").help(help));
    }

    /// Modules of the axiom and of all successors.
    fn all_modules(&self) -> Vec<TextModule> {
        let program = &self.grammar.program;
        let mut out: Vec<TextModule> = self.attached(&program.axiom);
        for p in program.productions() {
            out.extend(self.attached(&p.successor));
        }
        out
    }

    /// Modules with the texts of the numbers after them, which are characters of the string in LParser; and the first
    /// parenthesis that follows no module or has no partner.
    fn with_numbers<'m>(
        &self,
        modules: &'m [SuccessorModule],
    ) -> (Vec<NumberedModule<'m>>, Option<&'m SuccessorModule>) {
        let mut out: Vec<NumberedModule<'m>> = Vec::new();
        let mut open: Option<(&'m SuccessorModule, String)> = None;
        let mut loose = None;
        for module in modules {
            match (&mut open, self.c(module.symbol)) {
                _ if self.dialect != Dialect::LParser => out.push(NumberedModule { module, numbers: Vec::new() }),
                (Some((_, text)), ')') => {
                    if let Some(last) = out.last_mut() {
                        last.numbers.push(text.trim().to_owned());
                    }
                    open = None;
                }
                (Some((_, text)), c) => text.push(c),
                (None, '(') => {
                    if out.is_empty() {
                        loose = loose.or(Some(module));
                    }
                    open = Some((module, String::new()));
                }
                (None, c) => {
                    if c == ')' {
                        loose = loose.or(Some(module));
                    }
                    out.push(NumberedModule { module, numbers: Vec::new() });
                }
            }
        }
        (out, loose.or(open.map(|(parenthesis, _)| parenthesis)))
    }

    /// Modules with their parameters as text, including the numbers of LParser's commands.
    fn attached(&self, modules: &[SuccessorModule]) -> Vec<TextModule> {
        let (numbered, _) = self.with_numbers(modules);
        let text = |m: NumberedModule<'_>| {
            let own = m.module.args.iter().map(argument);
            let numbers = m.numbers.iter().map(|n| self.number_text(m.module.symbol, n));
            TextModule { symbol: m.module.symbol, args: own.chain(numbers).collect() }
        };
        numbered.into_iter().map(text).collect()
    }

    /// The number of a command of LParser. For cpfg, lengths are divided by the file's unit, so that a step has length 1.
    fn number_text(&self, symbol: SymbolId, text: &str) -> String {
        let is_length = self.to == ConvertTo::Cpfg && matches!(self.c(symbol), 'F' | 'f' | 'g' | 'Z' | 'z');
        match (self.settings.unit.filter(|_| is_length), text.parse::<f64>()) {
            (Some(unit), Ok(length)) => format!("{}", length / unit),
            _ => text.to_owned(),
        }
    }

    /// Chooses the spelling of all symbols, and writes the homomorphisms that draw them.
    fn spell_symbols(&mut self) {
        let mut used: BTreeMap<SymbolId, BTreeSet<usize>> = BTreeMap::new();
        for m in self.all_modules() {
            used.entry(m.symbol).or_default().insert(m.args.len());
        }
        let program = &self.grammar.program;
        for p in program.productions() {
            for f in &p.predecessor {
                used.entry(f.symbol).or_default();
            }
            for e in p.left.iter().chain(&p.right) {
                if let ContextElement::Module(f) = e {
                    used.entry(f.symbol).or_default();
                }
            }
        }
        if let IgnoredSymbols::Listed(list) | IgnoredSymbols::AllExcept(list) = &program.ignored {
            for symbol in list {
                used.entry(*symbol).or_default();
            }
        }
        // Spell commands first, so that other symbols avoid their letters. A command used with and without a number may need
        // two homomorphisms.
        let mut rest = Vec::new();
        for (symbol, arities) in used {
            let spelled = match self.to {
                ConvertTo::Osier => self.osier_name(symbol),
                ConvertTo::Cpfg => self.cpfg_name(symbol, &arities),
            };
            match spelled {
                Some(name) => {
                    self.taken.extend(name.chars());
                    self.names.insert(symbol, name);
                }
                None => rest.push(symbol),
            }
        }
        for symbol in rest {
            let name = self.free_letter(symbol);
            self.names.insert(symbol, name.to_string());
        }
    }

    /// An unused letter: the symbol itself, else the first free letter of its name, else any.
    fn free_letter(&mut self, symbol: SymbolId) -> char {
        let shown = self.shown(symbol);
        let usable = |c: &char| c.is_ascii_alphanumeric();
        // Fractint does not distinguish upper and lower case.
        let in_order = |c: char| {
            if self.dialect == Dialect::Fractint { [c.to_ascii_uppercase(), c] } else { [c, c.to_ascii_uppercase()] }
        };
        let own: Vec<char> = shown.chars().filter(usable).flat_map(in_order).collect();
        let any = ('A'..='Z').chain('a'..='z').chain('\u{3b1}'..='\u{3c9}').chain('\u{4e00}'..='\u{9fff}');
        let found = own.into_iter().chain(any).find(|c| !self.taken.contains(c)).unwrap_or('\u{2603}');
        self.taken.insert(found);
        found
    }

    /// The spelling of a command for the turtle dialect of the other program: its own character, unless the notation
    /// reserves it.
    fn osier_name(&mut self, symbol: SymbolId) -> Option<String> {
        let c = self.c(symbol);
        // Replace reserved characters by those that the turtle dialect accepts instead.
        let name = match (self.dialect, c) {
            (Dialect::Fractint, '<') => ';',
            (Dialect::Fractint, '>') => ',',
            (Dialect::LParser, '<') => '\\',
            (Dialect::LParser, '>') => '/',
            (Dialect::LParser, '"') => '`',
            (Dialect::LParser, ':') => '=',
            (
                _,
                '[' | ']' | '{' | '}' | '+' | '-' | '&' | '^' | '|' | '%' | '$' | '~' | '.' | '\'' | ';' | '!' | '?',
            ) => c,
            (Dialect::Fractint, '@' | '\\' | '/') => c,
            _ if c.is_ascii_alphanumeric() || c == '_' => c,
            _ => return None,
        };
        Some(name.to_string())
    }

    /// The command of cpfg for a symbol; a symbol without one gets a letter and a homomorphism that draws it.
    fn cpfg_name(&mut self, symbol: SymbolId, arities: &BTreeSet<usize>) -> Option<String> {
        let c = self.c(symbol);
        if matches!(c, '[' | ']') {
            return Some(c.to_string());
        }
        match self.dialect {
            Dialect::Fractint => self.fractint_name(symbol, c, arities),
            Dialect::LParser => self.lparser_name(symbol, c, arities),
            _ => self.lpy_name(symbol, c, arities),
        }
    }

    /// Chooses a letter for the symbol, drawn by `image` for each number of parameters `a`, `b`, ..
    fn image(
        &mut self,
        symbol: SymbolId,
        arities: &BTreeSet<usize>,
        image: impl Fn(usize) -> Option<String>,
    ) -> Option<String> {
        let letter = self.free_letter(symbol).to_string();
        self.images_of(symbol, &letter, arities, image);
        Some(letter)
    }

    fn images_of(
        &mut self,
        symbol: SymbolId,
        name: &str,
        arities: &BTreeSet<usize>,
        image: impl Fn(usize) -> Option<String>,
    ) {
        for &n in arities {
            match image(n) {
                Some(drawn) if drawn == name => {}
                Some(drawn) => {
                    let drawn = if drawn.is_empty() { "*".to_owned() } else { drawn };
                    self.images.push(format!("{} --> {drawn}", with_letters(name, n)));
                }
                None => self.fault(symbol, "cpfg has no such command"),
            }
        }
    }

    /// A rotation command that keeps its character; without a number it rotates by the angle of the file.
    fn turn(&mut self, sign: &str, angle: f64, arities: &BTreeSet<usize>) -> Option<String> {
        if arities.contains(&0) {
            self.images.push(format!("{sign} --> {sign}({angle})"));
        }
        Some(sign.to_owned())
    }

    fn fractint_name(&mut self, symbol: SymbolId, c: char, arities: &BTreeSet<usize>) -> Option<String> {
        let angle = self.settings.angle_deg.unwrap_or(45.0);
        // Fractint rotates by whole units of the angle: '|' rotates by half of the units of a circle, rounded down.
        let half = (360.0 / angle).round().div_euclid(2.0).floor() * angle;
        let uses = |list: &str| list.chars().any(|c| self.grammar.program.symbols.find(c).is_some());
        // cpfg has one heading: use that of Fractint's two pointers by which the file moves. Rotations of the other pointer
        // have no effect.
        let (by_units, by_degrees) = (uses("fg"), uses("dm"));
        let both = by_units && by_degrees && uses("+-|/\\");
        if both && matches!(c, 'd' | 'm' | '/' | '\\') {
            self.fault(symbol, "the file uses both the pointer in units and that in degrees");
        }
        match c {
            'f' | 'd' => Some("F".into()),
            'g' | 'm' => Some("f".into()),
            '+' | '-' | '|' if by_degrees && !by_units => {
                self.images.push(format!("{c} --> *"));
                Some(c.to_string())
            }
            '\\' | '/' if by_units && !by_degrees => self.image(symbol, arities, |_| Some(String::new())),
            '+' | '-' => self.turn(&c.to_string(), angle, arities),
            '|' => {
                self.images.push(format!("| --> -({half})"));
                Some("|".into())
            }
            '\\' | '/' => {
                let sign = if c == '\\' { '+' } else { '-' };
                self.image(symbol, arities, |n| Some(if n > 0 { format!("{sign}(a)") } else { String::new() }))
            }
            '@' => self.image(symbol, arities, |_| Some("@Di(a)".into())),
            'c' => self.image(symbol, arities, |n| Some(if n > 0 { ";(a)".into() } else { ";(0)".into() })),
            '<' | '>' => {
                let sign = if c == '<' { ";" } else { "," };
                let letter = self.free_letter(symbol).to_string();
                if arities.contains(&0) {
                    self.images.push(format!("{letter} --> *"));
                }
                // Write one rule for each step size in the file.
                let steps: BTreeSet<u32> = self
                    .all_modules()
                    .iter()
                    .filter(|m| m.symbol == symbol)
                    .filter_map(|m| m.args.first()?.parse::<u32>().ok())
                    .collect();
                for n in steps {
                    if n > MAX_COLOR_STEPS {
                        self.notes.insert(format!("colour steps of more than {MAX_COLOR_STEPS} are left out"));
                    }
                    let signs = vec![sign; n.min(MAX_COLOR_STEPS) as usize].join(" ");
                    let drawn = if signs.is_empty() { "*".to_owned() } else { signs };
                    self.images.push(format!("{letter}(a) : a == {n} --> {drawn}"));
                }
                Some(letter)
            }
            '!' => {
                self.fault(symbol, "cpfg cannot exchange the directions of turns");
                None
            }
            _ if c.is_ascii_digit() => Some(c.to_string()),
            _ => None,
        }
    }

    fn lparser_name(&mut self, symbol: SymbolId, c: char, arities: &BTreeSet<usize>) -> Option<String> {
        let angle = self.settings.angle_deg.unwrap_or(45.0);
        let find = |c: char| self.grammar.program.symbols.find(c);
        let factors = find('\'').is_some() || find('"').is_some();
        let with_length = matches!(c, 'F' | 'f' | 'g' | 'Z' | 'z') && arities.contains(&1);
        if factors && with_length {
            self.fault(symbol, "the file gives it a length of its own beside factors of the length");
        }
        // The first corner of an LParser polygon is its starting point, and segments add no corners, like cpfg's `G`.
        let draws = if find('{').is_some() { 'G' } else { 'F' };
        match c {
            'F' => Some(draws.to_string()),
            '{' => Some("{.".into()),
            'f' | 'g' | '|' | '.' | '}' => Some(c.to_string()),
            'Z' | 'z' => {
                // Without a number these segments have half the length.
                let sign = if c == 'Z' { draws } else { 'f' };
                self.image(symbol, arities, |n| Some(if n > 0 { format!("{sign}(a)") } else { format!("{sign}(0.5)") }))
            }
            '+' | '-' | '&' | '^' => self.turn(&c.to_string(), angle, arities),
            // Roll commands of the two programs have opposite directions.
            '<' => self.turn("/", angle, arities),
            '>' => self.turn("\\", angle, arities),
            '%' => self.image(symbol, arities, |_| Some("\\(180)".into())),
            '$' => {
                self.fault(symbol, "it mirrors the turns behind it, which no command of cpfg does");
                None
            }
            '\'' | '"' => {
                self.notes.insert("widths do not follow the factors of the length".into());
                let own = if c == '"' { "@Dd(0.9)" } else { "@Di(0.9)" };
                self.image(symbol, arities, |n| Some(if n > 0 { "@Di(a)".into() } else { own.into() }))
            }
            '!' | '?' => {
                self.notes.insert("factors of the thickness are left out".into());
                self.image(symbol, arities, |_| Some(String::new()))
            }
            'c' => self.image(symbol, arities, |n| Some(if n > 0 { ";(a)".into() } else { ";".into() })),
            '~' | 't' | ':' | ';' => {
                self.fault(symbol, "cpfg has no such command");
                None
            }
            _ if c.is_ascii_digit() => Some(c.to_string()),
            _ => None,
        }
    }

    fn lpy_name(&mut self, symbol: SymbolId, c: char, arities: &BTreeSet<usize>) -> Option<String> {
        let angle = self.settings.angle_deg.unwrap_or(60.0);
        // Symbols with long names are private-use characters, which no file can contain.
        if let Some(long) = self.grammar.program.symbols.long_name(c) {
            let long = long.to_owned();
            return self.lpy_long_name(symbol, &long, arities);
        }
        match c {
            '+' | '-' | '&' | '^' => self.turn(&c.to_string(), angle, arities),
            // Roll commands of the two programs have opposite directions.
            '/' => self.turn("\\", angle, arities),
            '\\' => self.turn("/", angle, arities),
            '|' | '{' | '}' | '.' | ';' | ',' | '%' => Some(c.to_string()),
            'f' => Some("g".into()),
            'F' => {
                // L-Py specifies radii, cpfg widths.
                if arities.contains(&2) {
                    self.images.push("F(a,b) --> F(a) !(2*(b))".into());
                }
                Some("F".into())
            }
            '_' | '!' => self.image(symbol, arities, |n| (n > 0).then(|| "!(2*(a))".into())),
            _ => None,
        }
    }

    fn lpy_long_name(&mut self, symbol: SymbolId, name: &str, arities: &BTreeSet<usize>) -> Option<String> {
        let surface = name.strip_prefix('~').map(str::to_owned);
        let is_command = name.starts_with(['@', '~', '?'])
            || ["SetWidth", "SetColor", "nF", "iRollL", "iRollR", "Frame", "InterpolateColors", "SectionResolution"]
                .contains(&name)
            || [
                "Line",
                "OLine",
                "Move",
                "Pinpoint",
                "Position",
                "Texture",
                "Euler",
                "SetContour",
                "SetGuide",
                "EndGuide",
                "Sweep",
            ]
            .iter()
            .any(|p| name.starts_with(p))
            || name.ends_with("Reflection");
        if !is_command {
            return None;
        }
        if name == "Frame" {
            self.notes.insert("the arrows of Frame are left out".into());
        }
        if name.starts_with("@D") {
            self.notes.insert("widths do not follow scales that are set behind them".into());
        }
        // The command in the notation of cpfg, with its parameters named a, b, .. L-Py specifies radii where cpfg specifies
        // diameters; the axes (x, y, z) become (x, z, -y). Commands that draw nothing become empty.
        let image = move |n: usize| -> Option<String> {
            Some(match (name, n) {
                ("@O", 0) => "@O".into(),
                ("@O", _) => "@O(2*(a))".into(),
                ("@o", 0) => "@c".into(),
                ("@o", _) => "@c(2*(a))".into(),
                ("@v", _) => "@v".into(),
                ("@M", 3) => "@M(a,c,0-(b))".into(),
                ("@R", 6) => "@R(a,c,0-(b),0-(d),0-(f),e)".into(),
                ("@D" | "@Di" | "@Dd", 1..) => format!("{name}(a)"),
                ("@D", 0) => "@D(1)".into(),
                ("@Di" | "@Dd", 0) => format!("{name}(0.5)"),
                ("SetWidth", 1..) => "!(2*(a))".into(),
                ("SetColor", 1) => ";(a)".into(),
                ("SetColor", _) => String::new(),
                ("nF" | "@B" | "@b", 1..) => "F(a)".into(),
                ("@B" | "@b", 0) => "F".into(),
                ("iRollL", 1..) => "\\(a)".into(),
                ("iRollR", 1..) => "/(a)".into(),
                ("@Gc" | "@Ge" | "Frame" | "InterpolateColors" | "SectionResolution" | "@2D" | "@3D" | "@L", _) => {
                    String::new()
                }
                _ if name.starts_with("Texture") => String::new(),
                _ => match (&surface, n) {
                    (Some(letter), 0) => format!("~{letter}"),
                    (Some(letter), _) => format!("~{letter}(a)"),
                    (None, _) => return None,
                },
            })
        };
        self.image(symbol, arities, image)
    }

    fn name(&self, symbol: SymbolId) -> &str {
        self.names.get(&symbol).map_or("?", String::as_str)
    }

    fn string(&mut self, modules: &[SuccessorModule]) -> String {
        let attached = self.attached(modules);
        // Braces must be balanced in each line.
        let braces = |c: char| attached.iter().filter(|m| self.c(m.symbol) == c).count();
        if braces('{') != braces('}')
            && let Some(m) = attached.iter().find(|m| matches!(self.c(m.symbol), '{' | '}'))
        {
            self.fault(m.symbol, "a polygon begins and ends in different rules");
        }
        let spelled = attached.iter().map(|m| {
            let letter = self.level.as_ref().and_then(|l| Some((l.letters.get(&m.symbol)?, l.number)));
            let name = letter.map_or(self.name(m.symbol), |l| l.0);
            let args = m.args.iter().map(String::as_str).chain(letter.map(|l| l.1));
            let args = args.collect::<Vec<_>>().join(",");
            if args.is_empty() { name.to_owned() } else { format!("{name}({args})") }
        });
        spelled.collect::<Vec<_>>().join(" ")
    }

    /// The successor as text; an empty one is `*` in cpfg, and nothing with a `turtle:` item.
    fn successor(&mut self, modules: &[SuccessorModule]) -> String {
        let text = self.string(modules);
        if text.is_empty() && self.to == ConvertTo::Cpfg { "*".into() } else { text }
    }

    fn formal(&self, f: &FormalModule) -> String {
        let params: Vec<String> = (0..u16::from(f.arity)).map(|i| local(f.slot + i)).collect();
        let name = self.name(f.symbol);
        if params.is_empty() { name.to_owned() } else { format!("{name}({})", params.join(",")) }
    }

    fn context(&self, elements: &[ContextElement]) -> String {
        let spelled = elements.iter().map(|e| match e {
            ContextElement::Module(f) => self.formal(f),
            ContextElement::Open => "[".into(),
            ContextElement::Close => "]".into(),
            ContextElement::CloseRest => "=]".into(),
        });
        spelled.collect::<Vec<_>>().join(" ")
    }

    fn production(&mut self, p: &Production) -> String {
        let head = self.production_head(p, None);
        let successor = self.successor(&p.successor);
        format!("{head} --> {successor}").trim_end().to_owned()
    }

    /// A production up to its arrow. `at`: replacement letter of the predecessor, and the level below which the production
    /// applies.
    fn production_head(&mut self, p: &Production, at: Option<(&str, u32)>) -> String {
        let mut out = String::new();
        if let Some(ContextElement::Module(f)) = p.new_left.first().or(p.new_right.first()) {
            self.fault(f.symbol, "it is a context of the new string");
        }
        if p.ignored.is_some() {
            self.list_fault(p);
        }
        if !p.left.is_empty() {
            let _ = write!(out, "{} < ", self.context(&p.left));
        }
        let predecessor: Vec<String> = match (at, p.predecessor.first()) {
            (Some((letter, _)), Some(f)) => {
                let params = (0..u16::from(f.arity)).map(|i| local(f.slot + i)).chain([LEVEL.to_owned()]);
                vec![format!("{letter}({})", params.collect::<Vec<_>>().join(","))]
            }
            _ => p.predecessor.iter().map(|f| self.formal(f)).collect(),
        };
        out += &predecessor.join(" ");
        if !p.right.is_empty() {
            let _ = write!(out, " > {}", self.context(&p.right));
        }
        let symbol = p.predecessor.first().map_or(0, |f| f.symbol);
        let before = p.before.as_ref().map(block);
        let condition = p.condition.as_ref().map(|code| expression(&code.ops));
        let condition = match (at, condition) {
            (Some((_, levels)), None) => Some(Some(format!("{LEVEL}<{levels}"))),
            (Some((_, levels)), Some(Some(condition))) => Some(Some(format!("{LEVEL}<{levels} && {condition}"))),
            (_, condition) => condition,
        };
        // `Some(None)` is a block or condition that cannot be written.
        match (before, condition) {
            (None, None) => {}
            (None, Some(Some(condition))) => {
                let _ = write!(out, " : {condition}");
            }
            (Some(Some(block)), Some(Some(condition))) => {
                let _ = write!(out, " : {{ {block} }} {condition}");
            }
            _ => self.fault(symbol, "its production draws random numbers before it is chosen"),
        }
        out
    }

    /// The program as the text of a grammar, in the order of its items: comments, settings, `Start`, axiom, productions,
    /// decompositions, homomorphisms.
    fn grammar_text(&mut self) -> String {
        self.spell_symbols();
        let program = &self.grammar.program;
        let word = self.grammar.notation().word();
        let label: String = self.grammar.label().chars().filter(|c| c.is_alphanumeric() || *c == ' ').collect();
        let mut out = format!("/* {} */\n", format!("{} (from {word})", label.trim()).trim());
        // Add a comment for each symbol with another name; symbols of one character need none.
        for (symbol, name) in &self.names {
            let shown = self.shown(*symbol);
            if shown != *name && shown.chars().count() > 1 {
                let _ = writeln!(out, "/* {name} = {} */", shown.replace("*/", ""));
            }
        }
        let _ = writeln!(out, "Lsystem: 1\nderivation length: {}", program.length);
        // The notation of osier keeps the turtle dialect of the other program, with its settings.
        if self.to == ConvertTo::Osier {
            let settings = self.settings;
            let turtle = if self.dialect == Dialect::LParser { "lparser" } else { "fractint" };
            let _ = write!(out, "turtle: {turtle}");
            for (key, value) in [
                ("angle", settings.angle_deg),
                ("thickness", settings.thickness.map(|t| 100.0 * t)),
                ("min_thickness", Some(100.0 * settings.min_thickness).filter(|t| *t > 0.0)),
                ("unit", settings.unit),
                ("fraction", settings.fraction),
            ] {
                if let Some(value) = value {
                    let _ = write!(out, " {key} = {value}");
                }
            }
            out.push('\n');
        }
        if let IgnoredSymbols::Listed(list) | IgnoredSymbols::AllExcept(list) = &program.ignored {
            let item = if matches!(program.ignored, IgnoredSymbols::Listed(_)) { "Ignore" } else { "Consider" };
            let names: Vec<&str> = list.iter().map(|s| self.name(*s)).collect();
            let _ = writeln!(out, "{item}: {}", names.join(" "));
        }
        // Values that the model computes before the first step.
        if let Some(start) = &program.blocks.start {
            match block(start) {
                Some(text) => {
                    let _ = writeln!(out, "Start: {{ {text} }}");
                }
                None => self.fault(0, "a value of the model"),
            }
        }
        // Axiom, productions, and the decompositions of each step.
        let axiom = self.string(&program.axiom);
        let _ = writeln!(out, "Axiom: {}{axiom}", self.beginning());
        for p in &program.rules.list {
            let line = self.production(p);
            let _ = writeln!(out, "{line}");
        }
        if !program.decomposition.list.is_empty() {
            let _ = writeln!(out, "Decomposition\nmaximum depth: {}", program.decomposition.depth);
            for p in &program.decomposition.list {
                let line = self.production(p);
                let _ = writeln!(out, "{line}");
            }
        }
        if !program.homomorphism.list.is_empty() || !self.images.is_empty() {
            let own = if program.homomorphism.list.is_empty() { 0 } else { program.homomorphism.depth };
            // Images are applied after the homomorphisms of the model, one level deeper.
            let depth = own + u32::from(!self.images.is_empty());
            let _ = writeln!(out, "Homomorphism\nmaximum depth: {depth}");
            for line in self.homomorphisms(own) {
                let _ = writeln!(out, "{line}");
            }
            for line in &self.images {
                let _ = writeln!(out, "{line}");
            }
        }
        out + "endlsystem\n"
    }

    /// The homomorphisms of the model, which expand a symbol at most `levels` times. The images need a further level, on
    /// which symbols that their own homomorphisms produce would be expanded again. Such symbols are replaced by a letter
    /// with the level as its last parameter: if it is not expanded on its level, or is on the last level, it is drawn as the
    /// symbol itself.
    fn homomorphisms(&mut self, levels: u32) -> Vec<String> {
        let list = &self.grammar.program.homomorphism.list;
        let heads: BTreeSet<SymbolId> = list.iter().filter_map(|p| p.predecessor.first()).map(|f| f.symbol).collect();
        let made: Vec<TextModule> = list.iter().flat_map(|p| self.attached(&p.successor)).collect();
        let again: BTreeSet<SymbolId> = made.iter().map(|m| m.symbol).filter(|s| heads.contains(s)).collect();
        if self.images.is_empty() || again.is_empty() {
            return list.iter().map(|p| self.production(p)).collect();
        }
        let letters: BTreeMap<SymbolId, String> =
            again.iter().map(|s| (*s, self.free_letter(*s).to_string())).collect();
        let mut out = Vec::new();
        // Homomorphisms of the string's symbols produce letters of the first level.
        for p in list {
            let head = self.production_head(p, None);
            self.level = Some(Level { letters: letters.clone(), number: "1" });
            out.push(format!("{head} --> {}", self.successor(&p.successor)).trim_end().to_owned());
            self.level = None;
        }
        // Homomorphisms of the letters produce letters of the next level.
        for p in list.iter().filter(|_| levels > 1) {
            let symbol = p.predecessor.first().map_or(0, |f| f.symbol);
            let Some(letter) = letters.get(&symbol) else { continue };
            let head = self.production_head(p, Some((letter, levels)));
            self.level = Some(Level { letters: letters.clone(), number: NEXT_LEVEL });
            out.push(format!("{head} --> {}", self.successor(&p.successor)).trim_end().to_owned());
            self.level = None;
        }
        // A letter that no production expands becomes the symbol's image, or else its command.
        for (symbol, letter) in &letters {
            let own = self.name(*symbol).to_owned();
            let arities: BTreeSet<usize> = made.iter().filter(|m| m.symbol == *symbol).map(|m| m.args.len()).collect();
            for n in arities {
                let head = with_letters(&own, n);
                let image = self.images.iter().find_map(|i| i.strip_prefix(&format!("{head} --> ")));
                let mut params: Vec<String> = ('a'..='z').take(n).map(String::from).collect();
                params.push(LEVEL.to_owned());
                out.push(format!("{letter}({}) --> {}", params.join(","), image.unwrap_or(&head)));
            }
        }
        out
    }

    /// Commands that set the initial direction, colour and width of the other program's turtle in cpfg.
    fn beginning(&self) -> String {
        match (self.to, self.dialect) {
            (ConvertTo::Cpfg, Dialect::Fractint) => "-(90) ;(15) ".into(),
            (ConvertTo::Cpfg, Dialect::LParser) => {
                format!("/(90) ;(2) !({}) ", self.settings.thickness.unwrap_or(1.0))
            }
            (ConvertTo::Cpfg, Dialect::LPy) => "\\(90) ;(1) !(0.2) ".into(),
            _ => String::new(),
        }
    }
}

/// A module with as many letters as parameters, such as `A(a,b)`.
fn with_letters(name: &str, n: usize) -> String {
    let letters: Vec<String> = ('a'..='z').take(n).map(String::from).collect();
    if letters.is_empty() { name.to_owned() } else { format!("{name}({})", letters.join(",")) }
}

/// Name of the parameter that counts the levels of an interpretation, and its value for what a production makes.
const LEVEL: &str = "level";
const NEXT_LEVEL: &str = "level+1";

fn local(slot: u16) -> String {
    format!("p{slot}")
}

/// A parameter as text; empty if it cannot be written, which [`Writer::check_arguments`] reports.
fn argument(e: &Expr) -> String {
    match e {
        Expr::Const(c) => format!("{c}"),
        Expr::Local(i) => local(*i),
        Expr::Code(code) => expression(&code.ops).unwrap_or_default(),
    }
}

/// The reason why a parameter cannot be written; `None` if it can.
fn unwritable(e: &Expr) -> Option<&'static str> {
    match e {
        Expr::Const(c) if !c.is_finite() => Some("it is infinite or not a number"),
        Expr::Const(_) | Expr::Local(_) => None,
        Expr::Code(code) if expression(&code.ops).is_some() => None,
        Expr::Code(code) if code.ops.iter().any(|op| matches!(op, Op::LoadElement(_) | Op::StoreElement(_))) => {
            Some("it reads an array")
        }
        Expr::Code(code) if code.ops.iter().any(|op| matches!(op, Op::Random(_) | Op::Choose(_))) => {
            Some("cpfg has no such random number")
        }
        Expr::Code(_) => Some("cpfg has no such expression"),
    }
}

/// An expression as text; `None` for statements.
fn expression(ops: &[Op]) -> Option<String> {
    let mut stack = Vec::new();
    run(ops, 0, ops.len(), &mut stack)?;
    stack.pop().filter(|_| stack.is_empty())
}

/// Interprets instructions `from` to `to` on a stack of texts.
fn run(ops: &[Op], from: usize, to: usize, stack: &mut Vec<String>) -> Option<()> {
    let mut i = from;
    while i < to {
        let op = ops.get(i)?;
        i += 1;
        match *op {
            Op::Const(c) if c < 0.0 => stack.push(format!("(0-{})", -c)),
            Op::Const(c) => stack.push(format!("{c}")),
            Op::Local(slot) => stack.push(local(slot)),
            Op::Global(slot) => stack.push(format!("g{slot}")),
            Op::Step => stack.push("Q".into()),
            Op::Length => stack.push("Z".into()),
            Op::Unary(f) => {
                let a = stack.pop()?;
                stack.push(unary(f, &a));
            }
            Op::Binary(f, _) => {
                let (b, a) = (stack.pop()?, stack.pop()?);
                stack.push(binary(f, &a, &b));
            }
            Op::Random(RandomFunction::Ran) => {
                let a = stack.pop()?;
                stack.push(format!("ran({a})"));
            }
            Op::Random(RandomFunction::Uniform) => {
                let (b, a) = (stack.pop()?, stack.pop()?);
                stack.push(format!("({a}+ran({b}-{a}))"));
            }
            Op::Random(RandomFunction::Nran) => {
                let (b, a) = (stack.pop()?, stack.pop()?);
                stack.push(format!("nran({a},{b})"));
            }
            Op::And(end) | Op::Or(end) => {
                let left = stack.pop()?;
                run(ops, i, end, stack)?;
                let right = stack.pop()?;
                let sign = if matches!(op, Op::And(_)) { "&&" } else { "||" };
                stack.push(format!("({left} {sign} {right})"));
                i = end;
            }
            // The operands of `&&` and `||` are truth values already.
            Op::Bool => {}
            Op::JumpIfZero(other) => {
                let condition = stack.pop()?;
                // `a ? b : c` compiles to: a, jump if zero to c, b, jump after c, c.
                let Some(Op::Jump(end)) = ops.get(other.checked_sub(1)?) else { return None };
                run(ops, i, other - 1, stack)?;
                let then = stack.pop()?;
                run(ops, other, *end, stack)?;
                let otherwise = stack.pop()?;
                stack.push(format!("({condition} ? {then} : {otherwise})"));
                i = *end;
            }
            _ => return None,
        }
    }
    Some(())
}

/// Assignments and conditions of a block as statements; `None` if several productions must draw the same random numbers.
fn block(code: &Bytecode) -> Option<String> {
    let ops = &code.ops;
    let restarts = ops.contains(&Op::RestartDraws);
    if restarts && ops.iter().any(|op| matches!(op, Op::Random(_))) {
        return None;
    }
    // Index of the 0 near the end of a block with conditions, which ends in: 1, store, jump, 0, store. A false condition
    // jumps to this 0.
    let failure = restarts.then(|| ops.len().saturating_sub(2));
    let (mut out, mut open) = (String::new(), 0_usize);
    let mut from = usize::from(restarts);
    if let (Some(_), Some(Op::StoreLocal(slot))) = (failure, ops.last()) {
        let _ = write!(out, "{} = 0; ", local(*slot));
    }
    let end = failure.map_or(ops.len(), |f| f.saturating_sub(1));
    let mut i = from;
    while i < end {
        match ops[i] {
            Op::StoreLocal(slot) => {
                let value = expression_part(ops, from, i)?;
                let _ = write!(out, "{} = {value}; ", local(slot));
                from = i + 1;
            }
            Op::StoreGlobal(slot) => {
                let value = expression_part(ops, from, i)?;
                let _ = write!(out, "g{slot} = {value}; ");
                from = i + 1;
            }
            Op::JumpIfZero(to) if Some(to) == failure => {
                let test = expression_part(ops, from, i)?;
                let _ = write!(out, "if ({test}) {{ ");
                open += 1;
                from = i + 1;
            }
            _ => {}
        }
        i += 1;
    }
    out += &"} ".repeat(open);
    Some(out.trim_end().to_owned())
}

fn expression_part(ops: &[Op], from: usize, to: usize) -> Option<String> {
    let mut stack = Vec::new();
    run(ops, from, to, &mut stack)?;
    stack.pop().filter(|_| stack.is_empty())
}

fn unary(f: UnaryOp, a: &str) -> String {
    let name = match f {
        UnaryOp::Neg => return format!("(0-{a})"),
        UnaryOp::Not => return format!("(!{a})"),
        UnaryOp::Sin => "sin",
        UnaryOp::Cos => "cos",
        UnaryOp::Tan => "tan",
        UnaryOp::Asin => "asin",
        UnaryOp::Acos => "acos",
        UnaryOp::Atan => "atan",
        UnaryOp::Exp => "exp",
        UnaryOp::Log => "log",
        UnaryOp::Sqrt => "sqrt",
        UnaryOp::Fabs => "fabs",
        UnaryOp::Floor => "floor",
        UnaryOp::Ceil => "ceil",
        UnaryOp::Trunc => "trunc",
        UnaryOp::Sign => "sign",
    };
    format!("{name}({a})")
}

fn binary(f: BinaryOp, a: &str, b: &str) -> String {
    let sign = match f {
        BinaryOp::Add => "+",
        BinaryOp::Sub => "-",
        BinaryOp::Mul => "*",
        BinaryOp::Div => "/",
        BinaryOp::Rem => "%",
        BinaryOp::Pow => "^",
        BinaryOp::Eq => "==",
        BinaryOp::Ne => "!=",
        BinaryOp::Lt => "<",
        BinaryOp::Le => "<=",
        BinaryOp::Gt => ">",
        BinaryOp::Ge => ">=",
        BinaryOp::Atan2 => return format!("atan({a},{b})"),
    };
    format!("({a}{sign}{b})")
}
