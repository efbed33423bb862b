//! Warnings about constructs that are legal but probably mistakes.

use std::collections::{BTreeMap, BTreeSet};

use super::code::Bytecode;
use super::program::{ContextElement, FormalModule, IgnoredSymbols, Production, ProductionSet, Program};
use super::symbols::{SymbolId, TWO_CHARACTER_COMMANDS};
use super::token::{ParseSession, SourcePlace};
use super::vm;
use osier_base::diagnostic::Diagnostic;

/// Reports L023, L030, L031, L032, L035, L036 and L055: legal constructs that are probably mistakes.
pub(super) fn check(session: &mut ParseSession, program: &Program) {
    check_arities(session, program);
    check_reachability(session, program);
    for rules in [&program.rules, &program.decomposition, &program.homomorphism] {
        let stochastic = program.is_stochastic() || rules.seed.is_some();
        if stochastic {
            check_weight_sums(session, program, rules);
        } else {
            check_shadowed(session, rules);
            check_unused_weights(session, rules);
        }
    }
    check_command_letters(session, program);
    check_ignored_contexts(session, program);
}

/// Numbers of parameters that each symbol is produced with, and where first.
fn produced_arities(program: &Program) -> BTreeMap<SymbolId, BTreeMap<usize, SourcePlace>> {
    let mut out: BTreeMap<SymbolId, BTreeMap<usize, SourcePlace>> = BTreeMap::new();
    for t in program.productions().flat_map(|p| &p.successor).chain(&program.axiom) {
        out.entry(t.symbol).or_default().entry(t.args.len()).or_insert(t.place);
    }
    out
}

fn plural(n: usize) -> String {
    if n == 1 { "1 parameter".to_owned() } else { format!("{n} parameters") }
}

/// L023: predecessors and contexts whose number of parameters is never made.
fn check_arities(session: &mut ParseSession, program: &Program) {
    let produced = produced_arities(program);
    for p in program.productions() {
        // Predecessors and contexts alike must match a number of parameters that occurs.
        let elements = p.left.iter().chain(&p.right);
        let contexts = elements.filter_map(|e| if let ContextElement::Module(f) = e { Some(f) } else { None });
        let formals: Vec<&FormalModule> = p.predecessor.iter().chain(contexts).collect();
        for f in formals {
            let arity = usize::from(f.arity);
            let Some(known) = produced.get(&f.symbol) else { continue };
            if known.contains_key(&arity) {
                continue;
            }
            let Some((&other, &at)) = known.iter().next() else { continue };
            let c = program.symbols.get(f.symbol);
            let message = format!("{c} with {} never matches: it is made with {other}", plural(arity));
            // Suggest the module as the successor produces it, with as many formal parameters.
            let names = ["x", "y", "z", "u", "v", "w"];
            let list: Vec<&str> = names.iter().cycle().take(other).copied().collect();
            let call = if other == 0 { c.to_string() } else { format!("{c}({})", list.join(",")) };
            let d = Diagnostic::warning("L023", message, f.place.span, "this one")
                .label(at.span, format!("made with {} here", plural(other)))
                .help(format!("did you mean {call}?"));
            session.push(d, f.place);
        }
    }
}

/// L030: predecessors that nothing makes, directly or indirectly, from the axiom.
fn check_reachability(session: &mut ParseSession, program: &Program) {
    let mut seen: BTreeSet<SymbolId> = program.axiom.iter().map(|t| t.symbol).collect();
    let mut makes: BTreeMap<SymbolId, BTreeSet<SymbolId>> = BTreeMap::new();
    for p in program.productions() {
        for f in &p.predecessor {
            makes.entry(f.symbol).or_default().extend(p.successor.iter().map(|t| t.symbol));
        }
    }
    // Graph search over "a production for s produces t", from the symbols of the axiom.
    let mut queue: Vec<SymbolId> = seen.iter().copied().collect();
    while let Some(s) = queue.pop() {
        for next in makes.get(&s).into_iter().flatten() {
            if seen.insert(*next) {
                queue.push(*next);
            }
        }
    }
    let mut idle: BTreeMap<SymbolId, (usize, SourcePlace)> = BTreeMap::new();
    for p in program.productions() {
        for f in p.predecessor.iter().filter(|f| !seen.contains(&f.symbol)) {
            idle.entry(f.symbol).or_insert((0, f.place)).0 += 1;
        }
    }
    for (symbol, (count, place)) in idle {
        let c = program.symbols.get(symbol);
        let idle = if count == 1 { "1 production is".to_owned() } else { format!("{count} productions are") };
        let message = format!("{c} cannot be reached from the axiom: {idle} never applied");
        session.warning("L030", message, place, format!("put {c} into the axiom or a successor that is reached"));
    }
}

/// L031: without a seed the first production that applies wins.
fn check_shadowed(session: &mut ParseSession, rules: &ProductionSet) {
    let mut always: BTreeMap<(SymbolId, u8), SourcePlace> = BTreeMap::new();
    for p in &rules.list {
        let Some(first) = p.predecessor.first() else { continue };
        let kind = (first.symbol, first.arity);
        if let Some(by) = always.get(&kind) {
            let d = Diagnostic::warning("L031", "this production is never used", p.place.span, "this one")
                .label(by.span, "this earlier one always applies")
                .help("give the earlier one a condition, or add 'Seed: 1' to let them compete by weight");
            session.push(d, p.place);
        } else if p.is_unconditional() && p.before.is_none() {
            always.insert(kind, p.place);
        }
    }
}

/// L032: weights mean nothing without a seed.
fn check_unused_weights(session: &mut ParseSession, rules: &ProductionSet) {
    let mut first: Option<SourcePlace> = None;
    for p in rules.list.iter().filter(|p| p.weight.is_some()) {
        first.get_or_insert(p.place);
    }
    if let Some(place) = first {
        let help = "add 'Seed: 1' to let productions compete by weight";
        session.warning("L032", "weights are ignored without a seed".into(), place, help);
    }
}

/// L035: constant weights of one kind that look like shares of 1 or 100.
fn check_weight_sums(session: &mut ParseSession, program: &Program, rules: &ProductionSet) {
    let mut groups: BTreeMap<(SymbolId, u8), Vec<&Production>> = BTreeMap::new();
    for p in &rules.list {
        if let Some(f) = p.predecessor.first() {
            groups.entry((f.symbol, f.arity)).or_default().push(p);
        }
    }
    for ((symbol, _), list) in groups.into_iter().filter(|(_, l)| l.len() > 1) {
        if !list.iter().all(|p| p.is_unconditional()) {
            continue;
        }
        // Only unconditional productions with constant weights can be judged before derivation.
        let constant = |p: &&Production| p.weight.as_ref().and_then(|c: &Bytecode| vm::constant_value(c));
        let Some(weights) = list.iter().map(constant).collect::<Option<Vec<f64>>>() else { continue };
        let sum = weights.iter().fold(0.0, |s, w| s + w);
        // Sums exactly at 1 or 100 are meant; sums within 15 % of them look like a slip in one weight.
        let near = |whole: f64| (sum - whole).abs() > whole * 1e-3 && (sum - whole).abs() < whole * 0.15;
        if near(1.0) || near(100.0) {
            let c = program.symbols.get(symbol);
            let message = format!("weights of the productions for {c} sum to {sum}");
            let help = "they are divided by their sum";
            session.warning("L035", message, list[0].place, help);
        }
    }
}

/// L055: contexts that name a symbol which contexts look past.
fn check_ignored_contexts(session: &mut ParseSession, program: &Program) {
    let ignored = program.ignored.flags(&program.symbols);
    let item = if matches!(program.ignored, IgnoredSymbols::Listed(_)) { "Ignore" } else { "Consider" };
    for element in program.productions().flat_map(|p| p.left.iter().chain(&p.right)) {
        let ContextElement::Module(f) = element else { continue };
        if ignored.get(usize::from(f.symbol)) == Some(&true) {
            let c = program.symbols.get(f.symbol);
            let message = format!("this context never matches: {c} is hidden by '{item}:'");
            let verb = if item == "Ignore" { "take it out of" } else { "add it to" };
            session.warning(
                "L055",
                message,
                f.place,
                format!("{verb} the symbols of '{item}:', or leave the context out"),
            );
        }
    }
}

/// L036: a rule for the letter of a two-character command rewrites the command as well.
fn check_command_letters(session: &mut ParseSession, program: &Program) {
    let rewritten: BTreeSet<SymbolId> =
        program.rules.list.iter().flat_map(|p| &p.predecessor).map(|f| f.symbol).collect();
    let symbol = |id| program.symbols.get(id);
    let successors = program.productions().map(|p| &p.successor).chain([&program.axiom]);
    let mut found: Vec<(SourcePlace, char, char)> = Vec::new();
    for s in successors {
        for w in s.windows(2) {
            let prefix = symbol(w[0].symbol);
            if program.overrides_cpfg(prefix) {
                continue;
            }
            // The second character of a command is a symbol of its own and is rewritten like any other.
            let known = TWO_CHARACTER_COMMANDS.contains(&(prefix, symbol(w[1].symbol)));
            if (known || prefix == '~') && rewritten.contains(&w[1].symbol) {
                found.push((w[0].place.to(w[1].place), prefix, symbol(w[1].symbol)));
            }
        }
    }
    for (place, prefix, c) in found {
        // An organ that is a growing module of its own is a common idiom.
        if prefix == '~' && program.rules.list.iter().all(|p| keeps_symbol(p, c, program)) {
            continue;
        }
        let message = format!("a production for {c} also rewrites the {c} of '{prefix}{c}'");
        session.warning("L036", message, place, "use another letter for the module");
    }
}

/// Does the production leave the symbol in place, only with other parameters?
fn keeps_symbol(p: &Production, c: char, program: &Program) -> bool {
    let symbol = |id| program.symbols.get(id);
    let concerns = p.predecessor.iter().any(|f| symbol(f.symbol) == c);
    !concerns || p.successor.first().is_some_and(|t| symbol(t.symbol) == c)
}
