//! A compiled grammar, and how errors met while deriving it are reported.

use osier_base::Error;
use osier_base::diagnostic::{Diagnostic, Report, Sources, Span};

use super::binding::{Dialect, TurtleAction, TurtleBindings};
use super::modules::ModuleString;
use super::preprocess::Define;
use super::program::{Program, SuccessorModule};
use super::symbols::Symbols;
use super::token::SourcePlace;

/// A grammar that was read without errors.
#[derive(Debug, Clone)]
pub struct Grammar {
    pub(crate) program: Program,
    pub(crate) label: String,
    pub(crate) description: String,
    pub(crate) defines: Vec<Define>,
    pub(crate) notes: Vec<Diagnostic>,
    /// The texts, for complaints while deriving.
    pub(crate) sources: Sources,
    pub(crate) expansions: Vec<(String, SourcePlace)>,
    pub(crate) start: SourcePlace,
}

impl Grammar {
    /// What stands behind `Lsystem:`.
    pub fn label(&self) -> &str {
        &self.label
    }

    /// The comment that opens the file.
    pub fn description(&self) -> &str {
        &self.description
    }

    /// Its `#define`s without arguments, in file order: what `--set` can change.
    pub fn defines(&self) -> &[Define] {
        &self.defines
    }

    /// Remarks that only a verbose run shows.
    pub fn notes(&self) -> &[Diagnostic] {
        &self.notes
    }

    /// The derivation length.
    pub fn steps(&self) -> u32 {
        self.program.length
    }

    /// True with a `Seed:` or a `turtle:`: productions compete by weight.
    pub fn is_stochastic(&self) -> bool {
        self.program.is_stochastic()
    }

    /// True for a tuft of hairs: its turtle is a catkin's, or a symbol is bound to its stalk.
    pub fn is_tuft(&self) -> bool {
        let turtle = self.program.turtle.as_ref();
        let stalk = |t: &TurtleBindings| t.symbols.values().any(|b| b.action == TurtleAction::Organ("stalk".into()));
        turtle.is_some_and(|t| t.dialect == Dialect::Catkin || stalk(t))
    }

    /// Its symbols.
    pub fn symbols(&self) -> &Symbols {
        &self.program.symbols
    }

    /// Symbols that stand behind a `~` anywhere, and letters that `bind` names as organs: the organs that it draws, in order
    /// of their characters.
    pub fn organ_symbols(&self) -> Vec<char> {
        let successors = self.program.productions().map(|p| &p.successor).chain([&self.program.axiom]);
        let symbol = |id| self.program.symbols.get(id);
        let behind = |s: &Vec<SuccessorModule>| {
            let pairs = s.windows(2).filter(|w| symbol(w[0].symbol) == '~').map(|w| symbol(w[1].symbol));
            pairs.collect::<Vec<_>>()
        };
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
        let mut out = String::new();
        for m in modules.iter() {
            out.push(self.program.symbols.get(m.symbol));
            if !m.params.is_empty() {
                let params: Vec<String> = m.params.iter().map(|p| format_g(f64::from(*p))).collect();
                out.push_str(&format!("({})", params.join(",")));
            }
        }
        out
    }

    /// Where the derivation length stands.
    pub(crate) fn length_place(&self) -> Span {
        self.program.length_place.unwrap_or(self.start).span
    }

    /// A complaint with the macros that led to its place.
    pub(crate) fn with_macro_chain(&self, mut d: Diagnostic, place: SourcePlace) -> Diagnostic {
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

    /// Where a symbol (behind `prefix`, if given) is first made; the start of the file if nowhere.
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

    /// Complaints about this grammar as an error.
    pub fn report(&self, diagnostics: Vec<Diagnostic>) -> Error {
        Error::Input(Box::new(Report { sources: self.sources.clone(), diagnostics }))
    }

    /// The texts that complaints of this grammar point into.
    pub fn sources(&self) -> &Sources {
        &self.sources
    }
}

/// A number as C's `%g` prints it: six significant digits, no trailing zeros.
fn format_g(x: f64) -> String {
    if !x.is_finite() || super::code::is_zero(x) {
        return format!("{x}");
    }
    let exponent = format!("{x:.5e}");
    let Some((digits, power)) = exponent.split_once('e') else { return exponent };
    let power: i32 = power.parse().unwrap_or(0);
    let trim =
        |s: &str| if s.contains('.') { s.trim_end_matches('0').trim_end_matches('.').to_owned() } else { s.to_owned() };
    if !(-4..6).contains(&power) {
        let sign = if power < 0 { '-' } else { '+' };
        return format!("{}e{sign}{:02}", trim(digits), power.abs());
    }
    let decimals = usize::try_from(5 - power).unwrap_or(0);
    trim(&format!("{x:.decimals$}"))
}

/// An error met while deriving, as a report.
pub(crate) fn runtime_report(grammar: &Grammar, diagnostic: Diagnostic) -> Error {
    grammar.report(vec![diagnostic])
}

/// An error met while deriving, at one place, with a way out.
pub(crate) fn runtime_error(
    grammar: &Grammar,
    code: &'static str,
    message: String,
    at: Span,
    help: impl Into<String>,
) -> Error {
    runtime_report(grammar, Diagnostic::error(code, message, at, "here").help(help))
}
