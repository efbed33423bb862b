//! Predicts the length of the string from the growth matrix over symbols and numbers of parameters, before deriving it.

use std::collections::BTreeMap;

use super::DeriveOptions;
use crate::code::{Bytecode, Op};
use crate::grammar::{Grammar, runtime_error, runtime_report};
use crate::program::Production;
use crate::symbols::SymbolId;
use osier_base::Result;
use osier_base::diagnostic::Diagnostic;
use osier_base::limits::{Limits, grouped};

/// Bounds and expected value of the number of modules after some steps, computed without deriving.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prediction {
    /// Lower bound (saturating).
    pub lower: u128,
    /// Upper bound (saturating).
    pub upper: u128,
    /// Expected number by the weights; conditions count as equally likely alternatives.
    pub expected: f64,
}

/// A module's symbol and number of parameters.
type ModuleSignature = (SymbolId, usize);
/// Sparse row of the growth matrix: (index of a signature, number of such modules in the successor).
type SparseRow<T> = Vec<(usize, T)>;

#[derive(Debug, Default)]
struct GrowthMatrix {
    kinds: BTreeMap<ModuleSignature, usize>,
    lower: Vec<SparseRow<u128>>,
    upper: Vec<SparseRow<u128>>,
    expected: Vec<SparseRow<f64>>,
    start: Vec<u128>,
    /// False if the string can shrink in ways that the growth matrix does not include.
    has_lower: bool,
}

fn successor_counts(kinds: &BTreeMap<ModuleSignature, usize>, p: &Production) -> BTreeMap<usize, u128> {
    let mut out = BTreeMap::new();
    for t in &p.successor {
        if let Some(&k) = kinds.get(&(t.symbol, t.args.len())) {
            *out.entry(k).or_insert(0) += 1;
        }
    }
    out
}

impl GrowthMatrix {
    fn new(grammar: &Grammar, stochastic: bool) -> Self {
        let program = &grammar.program;
        let templates = program.rules.list.iter().flat_map(|p| &p.successor).chain(&program.axiom);
        let mut m = Self::default();
        for t in templates {
            let kind = (t.symbol, t.args.len());
            let next = m.kinds.len();
            m.kinds.entry(kind).or_insert(next);
        }
        let n = m.kinds.len();
        (m.lower, m.upper, m.expected) = (vec![Vec::new(); n], vec![Vec::new(); n], vec![Vec::new(); n]);
        m.start = vec![0; n];
        for t in &program.axiom {
            let kind = (t.symbol, t.args.len());
            if let Some(&k) = m.kinds.get(&kind) {
                m.start[k] += 1;
            }
        }
        // Lower bounds hold only if every module is rewritten separately: `%`, predecessors of several modules and
        // decompositions can remove modules outside the matrix.
        let cut_symbol = program.symbols.find('%');
        let has_cut = m.kinds.keys().any(|k| Some(k.0) == cut_symbol);
        let several = program.rules.list.iter().any(|p| p.predecessor.len() > 1);
        let alone = program.decomposition.list.is_empty() && program.subsystems.is_empty();
        m.has_lower = !has_cut && !several && alone;
        for (&(symbol, arity), &k) in &m.kinds.clone() {
            let rules: Vec<&Production> = program.rules.matching(symbol, arity).collect();
            m.set_row(k, &rules, stochastic);
        }
        m
    }

    /// Per kind: true if every step certainly rewrites its modules. False for all kinds if `stop` or the blocks of steps may
    /// end the derivation.
    fn always_rewritten(&self, grammar: &Grammar) -> Vec<bool> {
        let program = &grammar.program;
        let stops = |c: &Bytecode| c.ops.iter().any(|o| matches!(o, Op::Stop));
        let blocks = program.blocks.start_each.is_some() || program.blocks.end_each.is_some();
        let runs = !blocks && !program.rules.list.iter().any(|p| p.codes().any(stops));
        let mut rewritten = vec![false; self.kinds.len()];
        for (&(symbol, arity), &k) in &self.kinds {
            rewritten[k] = runs && program.rules.matching(symbol, arity).any(Production::is_unconditional);
        }
        rewritten
    }

    /// Sets the matrix row of one kind: the modules that its productions may produce.
    fn set_row(&mut self, k: usize, rules: &[&Production], stochastic: bool) {
        let copy = BTreeMap::from([(k, 1)]);
        let mut alternatives: Vec<(BTreeMap<usize, u128>, f64)> = Vec::new();
        // One alternative for each production that may apply, in file order; in a deterministic grammar an unconditional
        // production hides the later ones.
        let mut always = false;
        for p in rules {
            let weight = p.weight.as_ref().map_or(Some(1.0), crate::vm::constant_value).unwrap_or(1.0);
            alternatives.push((successor_counts(&self.kinds, p), weight.max(0.0)));
            always |= p.is_unconditional();
            if always && !stochastic {
                break;
            }
        }
        if !always {
            alternatives.push((copy.clone(), 1.0));
        }
        let total = alternatives.iter().fold(0.0, |s, o| s + o.1);
        // Per kind of module in the successors: smallest, largest and weighted mean number over the alternatives.
        let columns: std::collections::BTreeSet<usize> =
            alternatives.iter().flat_map(|o| o.0.keys().copied()).collect();
        for c in columns {
            let of = |o: &(BTreeMap<usize, u128>, f64)| o.0.get(&c).copied().unwrap_or(0);
            let low = alternatives.iter().map(of).min().unwrap_or(0);
            let high = alternatives.iter().map(of).max().unwrap_or(0);
            let share = |o: &(BTreeMap<usize, u128>, f64)| of(o) as f64 * o.1;
            let mean =
                if total > 0.0 { alternatives.iter().fold(0.0, |s, o| s + share(o)) / total } else { low as f64 };
            if low > 0 {
                self.lower[k].push((c, low));
            }
            self.upper[k].push((c, high));
            self.expected[k].push((c, mean));
        }
    }

    fn next_counts(rows: &[SparseRow<u128>], v: &[u128]) -> Vec<u128> {
        let mut out = vec![0_u128; v.len()];
        for (row, x) in rows.iter().zip(v) {
            for (c, n) in row {
                out[*c] = out[*c].saturating_add(x.saturating_mul(*n));
            }
        }
        out
    }

    /// Lower bound of the number of modules of each kind after `steps` steps.
    fn counts_after(&self, steps: u32) -> Vec<u128> {
        let mut v = self.start.clone();
        for _ in 0..steps {
            let next = Self::next_counts(&self.lower, &v);
            // At a fixed point the counts stay the same.
            if next == v {
                break;
            }
            v = next;
        }
        v
    }
}

fn saturating_sum(v: &[u128]) -> u128 {
    v.iter().fold(0, |s, x| s.saturating_add(*x))
}

/// Number of modules after `steps` steps; exact (lower = upper) if every kind has one production without conditions.
/// Source: the growth matrix of the textbook, length = v0 M^n 1; bounds take element-wise extremes over alternatives.
pub fn predict(grammar: &Grammar, steps: u32, stochastic: bool) -> Prediction {
    let m = GrowthMatrix::new(grammar, stochastic);
    // Row vectors of counts, multiplied by the matrix in each step. The loop ends early at a fixed point, or above 2^64
    // modules.
    let (mut low, mut high) = (m.start.clone(), m.start.clone());
    let mut expected: Vec<f64> = m.start.iter().map(|x| *x as f64).collect();
    for _ in 0..steps {
        let mut next = vec![0.0; expected.len()];
        for (row, x) in m.expected.iter().zip(&expected) {
            for (c, n) in row {
                next[*c] += x * n;
            }
        }
        let (l, h) = (GrowthMatrix::next_counts(&m.lower, &low), GrowthMatrix::next_counts(&m.upper, &high));
        if l == low && h == high && next == expected {
            break;
        }
        (low, high, expected) = (l, h, next);
        if saturating_sum(&low) > u128::from(u64::MAX) {
            break;
        }
    }
    let lower = if m.has_lower { saturating_sum(&low) } else { 0 };
    let alone = grammar.program.decomposition.list.is_empty() && grammar.program.subsystems.is_empty();
    let upper = if alone { saturating_sum(&high) } else { u128::MAX };
    Prediction { lower, upper, expected: expected.iter().fold(0.0, |s, x| s + x) }
}

/// L050 for a derivation that certainly exceeds the limit on steps, modules or work.
pub(super) fn check_limits(grammar: &Grammar, steps: u32, options: &DeriveOptions, limits: &Limits) -> Result<()> {
    // Check the number of steps first, because the loops below run once for each step.
    let max_steps = limits.get("steps");
    if u64::from(steps) > max_steps {
        let (wanted, limit) = (grouped(u64::from(steps)), grouped(max_steps));
        let message = format!("derivation length {wanted} is above the limit of {limit} steps");
        return Err(length_error(grammar, options, message, "raise it with --max-steps"));
    }
    let stochastic = options.stochastic.unwrap_or(grammar.program.is_stochastic());
    let m = GrowthMatrix::new(grammar, stochastic);
    if !m.has_lower {
        return Ok(());
    }
    let limit = u128::from(limits.get("modules"));
    let mut v = m.start.clone();
    let mut work = 0_u128;
    // Follow the lower bound step by step. A step costs the length of its string, but only if it certainly rewrites some
    // module, because a string without changes ends the derivation early.
    let rewritten = m.always_rewritten(grammar);
    for step in 0..=steps {
        if saturating_sum(&v) > limit {
            return Err(limit_error(grammar, &m, step, options, limits));
        }
        let busy = rewritten.iter().zip(&v).any(|(rewritten, n)| *rewritten && *n > 0);
        let each = if busy { saturating_sum(&v) } else { 0 };
        let next = GrowthMatrix::next_counts(&m.lower, &v);
        // At a fixed point the counts stay the same, so that all remaining steps have the same cost.
        if next == v {
            work = work.saturating_add(each.saturating_mul(u128::from(steps - step)));
            break;
        }
        work = work.saturating_add(if step < steps { each } else { 0 });
        v = next;
    }
    if work > u128::from(limits.get("work")) {
        let (wanted, limit) = (grouped_wide(work), grouped(limits.get("work")));
        let message =
            format!("{} steps would rewrite {wanted} modules, the limit is {limit}", grouped(u64::from(steps)));
        let help = "raise it with --max-work, or shorten the derivation";
        return Err(length_error(grammar, options, message, help));
    }
    Ok(())
}

/// L050 at the grammar's derivation length, or without a place if the options replace that length.
fn length_error(
    grammar: &Grammar,
    options: &DeriveOptions,
    message: String,
    help: impl Into<String>,
) -> osier_base::Error {
    match options.steps {
        Some(_) => runtime_report(grammar, Diagnostic::about("L050", message).help(help)),
        None => runtime_error(grammar, "L050", message, grammar.length_place(), help),
    }
}

/// A count with grouped digits, as messages print it.
fn grouped_wide(n: u128) -> String {
    u64::try_from(n).map_or_else(|_| "more than 10^19".to_owned(), grouped)
}

/// L050 for a derivation that would exceed the limit on modules; `first_over`: the first step that does.
fn limit_error(
    grammar: &Grammar,
    m: &GrowthMatrix,
    first_over: u32,
    options: &DeriveOptions,
    limits: &Limits,
) -> osier_base::Error {
    let steps = options.steps.unwrap_or(grammar.program.length);
    let limit = limits.get("modules");
    let count = |step: u32| saturating_sum(&m.counts_after(step));
    // If the string shrinks again before the end, report the first step that exceeds the limit.
    let (step, wanted) = match count(steps) {
        wanted if wanted > u128::from(limit) => (steps, wanted),
        _ => (first_over, count(first_over)),
    };
    let wanted = grouped_wide(wanted);
    let (message, help) = match first_over.checked_sub(1) {
        Some(allowed) => {
            let message = format!("step {step} would make {wanted} modules; --max-modules {limit} allows {allowed}");
            // Name the source of the length: option or scene key, or else the grammar.
            let length = if options.steps.is_some() { "--steps (or the key 'steps')" } else { "the derivation length" };
            (message, format!("set {length} to {allowed} or less, or raise --max-modules"))
        }
        None => {
            let message = format!("the axiom has {} modules, more than --max-modules {limit}", grouped_wide(count(0)));
            (message, "shorten the axiom, or raise --max-modules".to_owned())
        }
    };
    let error = length_error(grammar, options, message, help);
    match (main_production(grammar, m, first_over).filter(|_| first_over > 0), error) {
        (Some(p), osier_base::Error::Input(mut report)) => {
            if let Some(d) = report.diagnostics.pop() {
                report.push(d.label(p.place.span, "this production makes most of them"));
            }
            osier_base::Error::Input(report)
        }
        (_, error) => error,
    }
}

/// The production that adds most modules in step `step`, the first of equal ones; `None` if none adds any.
fn main_production<'g>(grammar: &'g Grammar, m: &GrowthMatrix, step: u32) -> Option<&'g Production> {
    let v = m.counts_after(step.saturating_sub(1));
    let gain = |p: &&Production| {
        let first = p.predecessor.first();
        let kind = first.and_then(|f| m.kinds.get(&(f.symbol, usize::from(f.arity))));
        let count = kind.and_then(|k| v.get(*k)).copied().unwrap_or(0);
        count.saturating_mul(p.successor.len().saturating_sub(1) as u128)
    };
    grammar.program.rules.list.iter().filter(|p| gain(p) > 0).min_by_key(|p| std::cmp::Reverse(gain(p)))
}
