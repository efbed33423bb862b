//! A compiled grammar, and how errors met while deriving it are reported.

use std::sync::Arc;

use osier_base::Error;
use osier_base::convert::to_usize;
use osier_base::diagnostic::{Diagnostic, Report, Sources, Span};
use osier_base::math::narrow;

use super::binding::{Dialect, TurtleAction, TurtleBindings};
use super::code::Expr;
use super::functions::Spline;
use super::modules::{Module, ModuleString};
use super::notation::Notation;
use super::preprocess::Define;
use super::program::{Program, SuccessorModule};
use super::symbols::{SymbolId, Symbols};
use super::token::SourcePlace;

/// Magnitude from which a constant parameter is considered a mistake rather than a length or an angle.
const HUGE: f32 = 1e12;

/// A grammar that was parsed without errors.
#[derive(Debug, Clone)]
pub struct Grammar {
    /// Shared between all copies of the grammar in a scene: the successors of a long file take a hundred megabytes.
    pub(crate) program: Arc<Program>,
    pub(crate) label: String,
    pub(crate) description: String,
    pub(crate) defines: Vec<Define>,
    pub(crate) notes: Vec<Diagnostic>,
    /// Source texts that diagnostics of the derivation point into.
    pub(crate) sources: Sources,
    pub(crate) expansions: Vec<(String, SourcePlace)>,
    pub(crate) start: SourcePlace,
    pub(crate) notation: Notation,
    /// sRGB colours by colour index that the grammar file itself defines.
    pub(crate) palette: Vec<(u8, [u8; 3])>,
}

impl Grammar {
    /// Text after `Lsystem:`.
    pub fn label(&self) -> &str {
        &self.label
    }

    /// The notation given to `parse_as`, or otherwise the one detected from the file's content and name.
    pub fn notation(&self) -> Notation {
        self.notation
    }

    /// sRGB colours by colour index that the grammar file itself defines.
    pub fn palette(&self) -> &[(u8, [u8; 3])] {
        &self.palette
    }

    /// The curve of the file whose number is `id`, a parameter value; `None` if there is no such curve.
    pub fn curve(&self, id: f64) -> Option<&Spline> {
        self.program.curves.spline(id)
    }

    /// Value at `x` of the function whose graph is the plane curve with number `id`; `None` if there is no such curve.
    pub fn curve_value(&self, id: f64, x: f64) -> Option<f64> {
        self.program.curves.value(id, x)
    }

    /// The comment at the beginning of the file.
    pub fn description(&self) -> &str {
        &self.description
    }

    /// The `#define`s without arguments, in file order; `--set` can change their values.
    pub fn defines(&self) -> &[Define] {
        &self.defines
    }

    /// Notes, which only a verbose run prints.
    pub fn notes(&self) -> &[Diagnostic] {
        &self.notes
    }

    /// Derivation length in the file, which `DeriveOptions::steps` may replace.
    pub fn steps(&self) -> u32 {
        self.program.length
    }

    /// True if productions compete by weight, because the grammar has a `Seed:` or `turtle:` item.
    pub fn is_stochastic(&self) -> bool {
        self.program.is_stochastic()
    }

    /// True for a tuft of hairs: the turtle dialect is that of catkins, or a symbol is bound to the stalk.
    pub fn is_tuft(&self) -> bool {
        let turtle = self.program.turtle.as_ref();
        let stalk = |t: &TurtleBindings| t.symbols.values().any(|b| b.action == TurtleAction::Organ("stalk".into()));
        turtle.is_some_and(|t| t.dialect == Dialect::Catkin || stalk(t))
    }

    /// True for a grammar of another program, which defines the thickness of its stems itself: its notation says so, or the
    /// `turtle:` item that a conversion to osier's notation wrote.
    pub fn is_foreign(&self) -> bool {
        let turtle = self.program.turtle.as_ref();
        matches!(self.notation, Notation::Fractint | Notation::LParser | Notation::LPy)
            || turtle.is_some_and(|t| matches!(t.dialect, Dialect::Fractint | Dialect::LParser | Dialect::LPy))
    }

    /// Symbols of the grammar; the symbol numbers of modules are indices into them.
    pub fn symbols(&self) -> &Symbols {
        &self.program.symbols
    }

    /// Organs of the grammar, in order of their characters: symbols that follow a `~`, and letters that `bind` names as
    /// organs.
    pub fn organ_symbols(&self) -> Vec<char> {
        let successors = self.program.productions().map(|p| &p.successor).chain([&self.program.axiom]);
        let symbol = |id| self.program.symbols.get(id);
        let behind = |s: &Vec<SuccessorModule>| {
            let pairs = s.windows(2).filter(|w| symbol(w[0].symbol) == '~').map(|w| symbol(w[1].symbol));
            pairs.collect::<Vec<_>>()
        };
        // Organs are the symbols after `~`, unless the turtle dialect gives `~` another meaning, and single letters
        // bound as organs.
        let mut all = std::collections::BTreeSet::new();
        if !self.program.overrides_cpfg('~') {
            all.extend(successors.flat_map(behind));
        }
        let bound = self.program.turtle.iter().flat_map(|t| t.symbols.values());
        all.extend(bound.filter_map(|b| match &b.action {
            TurtleAction::Organ(name) => name.chars().next().filter(|_| name.chars().count() == 1),
            _ => None,
        }));
        all.into_iter().collect()
    }

    /// A string of modules as text, parameters with six digits.
    pub fn print(&self, modules: &ModuleString) -> String {
        if modules.param_count() == 0 {
            return self.print_symbols(modules.symbols());
        }
        let mut out = String::with_capacity(modules.len());
        let mut numbers = NumberTexts::default();
        modules.iter().for_each(|m| write_module(&mut out, self, m, &mut numbers));
        out
    }

    /// A string of modules without parameters as text.
    fn print_symbols(&self, symbols: &[SymbolId]) -> String {
        let table = &self.program.symbols;
        // In most strings all symbols are single bytes: then each module is a table look-up.
        let byte = |i: SymbolId| {
            let c = table.get(i);
            u8::try_from(c).ok().filter(|_| c.is_ascii() && table.long_name(c).is_none())
        };
        let bytes: Option<Vec<u8>> = (0..).take(table.len()).map(byte).collect();
        if let Some(bytes) = bytes {
            return utf8_text(symbols.iter().map(|s| bytes[usize::from(*s)]).collect());
        }
        let mut out = String::with_capacity(symbols.len());
        symbols.iter().for_each(|s| table.append_spelling(*s, &mut out));
        out
    }

    /// Location of the derivation length, or the start of the file.
    pub(crate) fn length_place(&self) -> Span {
        self.program.length_place.unwrap_or(self.start).span
    }

    /// Adds a label for each macro use that led to `place`, at most four.
    pub(crate) fn with_macro_chain(&self, mut d: Diagnostic, place: SourcePlace) -> Diagnostic {
        // Origins are one-based indices of macro uses. Each use has an origin itself; the chain ends at a use written
        // outside macros.
        let mut at = place;
        for _ in 0..4 {
            let Some((name, used_at)) = (at.origin as usize).checked_sub(1).and_then(|i| self.expansions.get(i)) else {
                break;
            };
            d = d.label(used_at.span, format!("through macro {name}"));
            at = *used_at;
        }
        d
    }

    /// Location of the first occurrence of a symbol in the axiom or a successor, after `prefix` if given; the start of the file
    /// if there is none.
    pub fn place_of(&self, prefix: Option<char>, c: char) -> Span {
        let symbol = |t: &SuccessorModule| self.program.symbols.get(t.symbol);
        let successors = || [&self.program.axiom].into_iter().chain(self.program.productions().map(|p| &p.successor));
        let place = match prefix {
            None => successors().flatten().find(|t| symbol(t) == c).map(|t| t.place),
            Some(p) => {
                let mut pairs = successors().flat_map(|s| s.windows(2));
                let pair = pairs.find(|w| symbol(&w[0]) == p && symbol(&w[1]) == c);
                pair.map(|w| w[0].place.to(w[1].place))
            }
        };
        place.unwrap_or(self.start).span
    }

    /// Location of a module with this symbol and `arity` parameters whose parameter `i` may be infinite or NaN: the first
    /// with such a constant, else the first that computes it by an operation that may overflow, else the first at all;
    /// `None` if no module matches.
    pub fn place_of_parameter(&self, symbol: SymbolId, arity: usize, i: usize) -> Option<Span> {
        let successors = [&self.program.axiom].into_iter().chain(self.program.productions().map(|p| &p.successor));
        let modules: Vec<&SuccessorModule> =
            successors.flatten().filter(|t| t.symbol == symbol && t.args.len() == arity).collect();
        let risky = |t: &&&SuccessorModule| matches!(t.args.get(i), Some(Expr::Code(c)) if c.may_overflow());
        let infinite = |t: &&&SuccessorModule| matches!(t.args.get(i), Some(Expr::Const(v)) if v.is_nan() || narrow(*v).abs() >= HUGE);
        let found = modules.iter().find(infinite).or_else(|| modules.iter().find(risky)).or(modules.first());
        found.map(|t| t.place.span)
    }

    /// Diagnostics about this grammar as an error that quotes its text.
    pub fn report(&self, diagnostics: Vec<Diagnostic>) -> Error {
        Error::Input(Box::new(Report { sources: self.sources.clone(), diagnostics, ..Report::default() }))
    }

    /// Source texts that the diagnostics of this grammar point into.
    pub fn sources(&self) -> &Sources {
        &self.sources
    }
}

/// Cache of the texts of recently printed numbers: strings repeat the same few parameters, and formatting a number takes a
/// hundred times as long as copying its text.
#[derive(Debug)]
pub(crate) struct NumberTexts {
    /// Bit patterns of numbers with their texts, each in the slot given by its hash.
    slots: Vec<Option<(u32, String)>>,
}

impl NumberTexts {
    /// Binary logarithm of the number of slots: 4096 entries fit into the processor's cache.
    const BITS: u32 = 12;

    fn text(&mut self, value: f32) -> &str {
        let bits = value.to_bits();
        // Fibonacci hashing: the high bits of the product depend on all bits of the number.
        let slot = &mut self.slots[to_usize(bits.wrapping_mul(0x9E37_79B9) >> (32 - Self::BITS))];
        if slot.as_ref().is_none_or(|(known, _)| *known != bits) {
            *slot = Some((bits, format_g(f64::from(value))));
        }
        slot.as_ref().map_or("", |(_, text)| text)
    }
}

impl Default for NumberTexts {
    fn default() -> Self {
        Self { slots: vec![None; 1 << Self::BITS] }
    }
}

/// The text of bytes that are known to be UTF-8.
pub(crate) fn utf8_text(bytes: Vec<u8>) -> String {
    String::from_utf8(bytes).unwrap_or_else(|e| String::from_utf8_lossy(e.as_bytes()).into_owned())
}

/// Appends a module as text, parameters with six digits.
pub(crate) fn write_module(out: &mut String, grammar: &Grammar, m: Module<'_>, numbers: &mut NumberTexts) {
    grammar.program.symbols.append_spelling(m.symbol, out);
    for (i, value) in m.params.iter().enumerate() {
        out.push(if i == 0 { '(' } else { ',' });
        out.push_str(numbers.text(*value));
    }
    if !m.params.is_empty() {
        out.push(')');
    }
}

/// A number as C's `%g` prints it: six significant digits, no trailing zeros.
fn format_g(x: f64) -> String {
    if !x.is_finite() || super::code::is_zero(x) {
        return format!("{x}");
    }
    // Rust has no %g: take the six digits and the exponent from %e, then choose the form as C does, by the exponent.
    let exponent = format!("{x:.5e}");
    let Some((digits, power)) = exponent.split_once('e') else { return exponent };
    let power: i32 = power.parse().unwrap_or(0);
    let trim =
        |s: &str| if s.contains('.') { s.trim_end_matches('0').trim_end_matches('.').to_owned() } else { s.to_owned() };
    if !(-4..6).contains(&power) {
        let sign = if power < 0 { '-' } else { '+' };
        return format!("{}e{sign}{:02}", trim(digits), power.abs());
    }
    let decimals = to_usize((5 - power).unsigned_abs());
    trim(&format!("{x:.decimals$}"))
}

/// A runtime error as a report that quotes the grammar.
pub(crate) fn runtime_report(grammar: &Grammar, diagnostic: Diagnostic) -> Error {
    grammar.report(vec![diagnostic])
}

/// A runtime error at one location with a help text.
pub(crate) fn runtime_error(
    grammar: &Grammar,
    code: &'static str,
    message: String,
    at: Span,
    help: impl Into<String>,
) -> Error {
    runtime_report(grammar, Diagnostic::error(code, message, at, "here").help(help))
}
