//! Warnings about constructs that are legal but probably mistakes.

use std::collections::{BTreeMap, BTreeSet};

use super::code::Bytecode;
use super::compile::check_balance;
use super::notation::Notation;
use super::program::{
    ContextElement, FormalModule, IgnoredSymbols, Production, ProductionSet, Program, SuccessorModule,
};
use super::symbols::{SymbolId, TWO_CHARACTER_COMMANDS};
use super::token::{ParseSession, SourcePlace, with_fix};
use super::vm;
use osier_base::diagnostic::{Diagnostic, Span};

/// Reports L023, L027, L030, L031, L032, L035, L036, L037, L055 and L056: legal constructs that are probably mistakes.
pub(super) fn check(session: &mut ParseSession, program: &Program) {
    check_arities(session, program);
    check_reachability(session, program);
    for rules in [&program.rules, &program.decomposition, &program.homomorphism] {
        let stochastic = program.is_stochastic() || rules.seed.is_some();
        if stochastic {
            check_weight_sums(session, program, rules);
            check_defaults(session, program, rules);
        } else {
            check_shadowed(session, rules);
            check_unused_weights(session, program, rules);
        }
        check_losers(session, rules, stochastic);
    }
    check_command_letters(session, program);
    check_ignored_contexts(session, program);
    note_idle_symbols(session, program);
}

/// Reports probable mistakes in a grammar of another program: L011, L012 and L030, and for L-Py, whose modules have
/// parameters, L023 and L055.
pub(super) fn check_dialect(session: &mut ParseSession, program: &Program, notation: Notation) {
    check_reachability(session, program);
    // In L-Py a function may open a branch that the calling production closes.
    if notation != Notation::LPy {
        check_open_brackets(session, program);
    }
    if notation == Notation::LPy {
        check_arities(session, program);
        check_ignored_contexts(session, program);
    }
}

/// L011, L012: brackets that the axiom or a successor opens but does not close.
fn check_open_brackets(session: &mut ParseSession, program: &Program) {
    let successors = program.productions().map(|p| (&p.successor, "successor", Some(p.place)));
    for (modules, what, place) in std::iter::once((&program.axiom, "axiom", None)).chain(successors) {
        let Some((first, last)) = modules.first().zip(modules.last()) else { continue };
        check_balance(session, modules, &program.symbols, what, place.unwrap_or(first.place), last.place);
    }
}

/// A symbol as the file writes it.
fn shown(program: &Program, symbol: SymbolId) -> String {
    let c = program.symbols.get(symbol);
    program.symbols.long_name(c).map_or_else(|| c.to_string(), str::to_owned)
}

/// L027: a block before the condition runs, and changes global variables, even if the production is then not applied.
fn check_losers(session: &mut ParseSession, rules: &ProductionSet, stochastic: bool) {
    for p in &rules.list {
        let may_lose = p.condition.is_some() || stochastic;
        if may_lose && p.before.as_ref().is_some_and(Bytecode::writes_globals) {
            let message = "this block changes a global variable even where the production is not applied".to_owned();
            let help = "write the statements behind the condition, or use a variable of the production";
            session.warning("L027", message, p.place, help);
        }
    }
}

/// Symbols that are turtle commands of cpfg, alone or as the first character of a command.
const DRAWN_SYMBOLS: &str = "FGfg+-&^\\/|$[]#!;,'{}._@~?%";
/// Letters after `@` that a further letter of the command follows, in lower or upper case.
const LONG_COMMANDS: &str = "bGPm";

/// L037, a note: symbols that are produced, but neither rewritten, nor drawn, nor named in a context.
fn note_idle_symbols(session: &mut ParseSession, program: &Program) {
    let symbol = |id| program.symbols.get(id);
    let predecessors = program.productions().flat_map(|p| p.predecessor.iter().chain(context_modules(p)));
    let used: BTreeSet<SymbolId> = predecessors.map(|f| f.symbol).collect();
    let bound = |id: SymbolId| program.turtle.as_ref().is_some_and(|t| t.symbols.contains_key(&id));
    let mut idle: BTreeMap<SymbolId, SourcePlace> = BTreeMap::new();
    for modules in program.productions().map(|p| &p.successor).chain([&program.axiom]) {
        let mut rest = modules.iter();
        while let Some(t) = rest.next() {
            let c = symbol(t.symbol);
            let is_command = DRAWN_SYMBOLS.contains(c) && !program.overrides_cpfg(c);
            if is_command && matches!(c, '@' | '~' | '?') {
                // The next symbol belongs to the command.
                let second = rest.next().map(|t| symbol(t.symbol));
                let mut ahead = rest.clone();
                let third = ahead.next().map(|t| symbol(t.symbol));
                // `@D` and `@T` may stand alone; the further letter after them is in lower case.
                let is_long = match second {
                    Some('D' | 'T') => third.is_some_and(|t| t.is_ascii_lowercase()),
                    Some(s) => LONG_COMMANDS.contains(s),
                    None => false,
                };
                if c == '@' && is_long {
                    rest = ahead;
                }
            } else if !is_command && !used.contains(&t.symbol) && !bound(t.symbol) && !matches!(c, '[' | ']') {
                idle.entry(t.symbol).or_insert(t.place);
            }
        }
    }
    for (id, place) in idle {
        let message = format!("{} is neither rewritten nor drawn", symbol(id));
        session.note("L037", message, place, "write a production for it, or leave it out");
    }
}

/// A symbol and a number of parameters; productions apply to modules with both.
type Kind = (SymbolId, usize);

fn kind(f: &FormalModule) -> Kind {
    (f.symbol, usize::from(f.arity))
}

/// Modules of the left context, then of the right one, without the brackets.
fn context_modules(p: &Production) -> impl Iterator<Item = &FormalModule> {
    p.left.iter().chain(&p.right).filter_map(|e| if let ContextElement::Module(f) = e { Some(f) } else { None })
}

/// Every kind of module that the axiom can develop into, with the first place that produces it.
fn made_kinds(program: &Program) -> BTreeMap<Kind, SourcePlace> {
    let productions: Vec<&Production> = program.productions().collect();
    // A production can apply once its predecessor and contexts can be produced: count the kinds that each still waits for.
    let mut waiting: BTreeMap<Kind, Vec<usize>> = BTreeMap::new();
    let mut missing: Vec<usize> = Vec::new();
    for (i, p) in productions.iter().enumerate() {
        let wanted: BTreeSet<Kind> = p.predecessor.iter().chain(context_modules(p)).map(kind).collect();
        missing.push(wanted.len());
        wanted.into_iter().for_each(|k| waiting.entry(k).or_default().push(i));
    }
    let mut made: BTreeMap<Kind, SourcePlace> = BTreeMap::new();
    let mut queue: Vec<&[SuccessorModule]> = vec![&program.axiom];
    while let Some(modules) = queue.pop() {
        for t in modules {
            let kind = (t.symbol, t.args.len());
            if made.contains_key(&kind) {
                continue;
            }
            made.insert(kind, t.place);
            for &i in waiting.get(&kind).into_iter().flatten() {
                missing[i] -= 1;
                if missing[i] == 0 {
                    queue.push(&productions[i].successor);
                }
            }
        }
    }
    made
}

fn plural(n: usize) -> String {
    if n == 1 { "1 parameter".to_owned() } else { format!("{n} parameters") }
}

/// A list of numbers for messages: `1, 2 or 4`.
fn listed(numbers: &[usize]) -> String {
    match numbers {
        [] => String::new(),
        [one] => one.to_string(),
        [most @ .., last] => {
            let most: Vec<String> = most.iter().map(ToString::to_string).collect();
            format!("{} or {last}", most.join(", "))
        }
    }
}

/// Limit on the labels of L023, which show modules with other numbers of parameters.
const MAX_ARITY_LABELS: usize = 4;

/// L023: predecessors and contexts whose number of parameters no production produces.
fn check_arities(session: &mut ParseSession, program: &Program) {
    let made = made_kinds(program);
    // Symbols that nothing produces at all are reported by L030, and so are kinds that depend on them.
    for p in program.productions() {
        for f in p.predecessor.iter().chain(context_modules(p)) {
            let arity = usize::from(f.arity);
            let others: Vec<(usize, SourcePlace)> =
                made.range((f.symbol, 0)..=(f.symbol, usize::MAX)).map(|(k, at)| (k.1, *at)).collect();
            if others.is_empty() || others.iter().any(|o| o.0 == arity) {
                continue;
            }
            let numbers: Vec<usize> = others.iter().map(|o| o.0).collect();
            let c = shown(program, f.symbol);
            let message = format!("{c} with {} never matches: it is made with {}", plural(arity), listed(&numbers));
            // Suggest the module as a successor produces it, with as many formal parameters.
            let near = others.iter().min_by_key(|o| o.0.abs_diff(arity)).map_or(0, |o| o.0);
            let names = ["x", "y", "z", "u", "v", "w"];
            let list: Vec<&str> = names.iter().cycle().take(near).copied().collect();
            let call = if near == 0 { c.clone() } else { format!("{c}({})", list.join(",")) };
            let mut d = Diagnostic::warning("L023", message, f.place.span, "this one");
            for (n, at) in others.iter().take(MAX_ARITY_LABELS) {
                d = d.label(at.span, format!("made with {} here", plural(*n)));
            }
            session.push(d.help(format!("did you mean {call}?")), f.place);
        }
    }
}

/// L030: predecessors that cannot develop from the axiom, directly or indirectly.
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
        let c = shown(program, symbol);
        let idle = if count == 1 { "1 production is".to_owned() } else { format!("{count} productions are") };
        let message = format!("{c} cannot be reached from the axiom: {idle} never applied");
        session.warning("L030", message, place, format!("put {c} into the axiom or a successor that is reached"));
    }
}

/// L031: productions that never apply because, without a seed, an earlier one always applies first.
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

/// L032: weights have no effect without a seed.
fn check_unused_weights(session: &mut ParseSession, program: &Program, rules: &ProductionSet) {
    let mut first: Option<SourcePlace> = None;
    for p in rules.list.iter().filter(|p| p.weight.is_some()) {
        first.get_or_insert(p.place);
    }
    if let Some(place) = first {
        let help = "add 'Seed: 1' to let productions compete by weight";
        let mut d = Diagnostic::warning("L032", "weights are ignored without a seed", place.span, "here").help(help);
        if let Some(length) = program.length_place {
            let before = Span { end: length.span.start, ..length.span };
            d = with_fix(d, SourcePlace { span: before, ..length }, "Seed: 1\n");
        }
        session.push(d, place);
    }
}

/// L056: in a deterministic grammar a final production without a condition applies where no other does. With a seed it
/// competes with the others and is chosen as often as they are.
fn check_defaults(session: &mut ParseSession, program: &Program, rules: &ProductionSet) {
    let mut groups: BTreeMap<(SymbolId, u8), Vec<&Production>> = BTreeMap::new();
    for p in &rules.list {
        if let Some(f) = p.predecessor.first() {
            groups.entry((f.symbol, f.arity)).or_default().push(p);
        }
    }
    for ((symbol, _), list) in groups {
        // Explicit weights show that the competition is intended.
        let always: Vec<&&Production> = list.iter().filter(|p| p.is_unconditional()).collect();
        let conditional = list.iter().find(|p| !p.is_unconditional());
        let (&[default], Some(conditional)) = (always.as_slice(), conditional) else { continue };
        if list.iter().any(|p| p.weight.is_some()) {
            continue;
        }
        let c = program.symbols.get(symbol);
        let message =
            format!("with a seed this production for {c} competes with those that have conditions or contexts");
        let help = "give it the opposite condition, or weights to all of them; without 'Seed:' the first that applies is taken";
        let d = Diagnostic::warning("L056", message, default.place.span, "this one always applies")
            .label(conditional.place.span, "this one is drawn only half of the time where it applies")
            .help(help);
        session.push(d, default.place);
    }
}

/// L035: constant weights of one kind of module whose sum is close to 1 or 100, but not equal.
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
        // A sum of exactly 1 or 100 is intended; a sum within 15 % of it suggests an error in one weight.
        let near = |whole: f64| (sum - whole).abs() > whole * 1e-3 && (sum - whole).abs() < whole * 0.15;
        if near(1.0) || near(100.0) {
            let c = program.symbols.get(symbol);
            let message = format!("weights of the productions for {c} sum to {sum}");
            let help = "they are divided by their sum";
            session.warning("L035", message, list[0].place, help);
        }
    }
}

/// L055: contexts that name a symbol which context matching ignores.
fn check_ignored_contexts(session: &mut ParseSession, program: &Program) {
    let of_system = program.ignored.flags(&program.symbols);
    for p in program.productions().filter(|p| !p.is_context_free()) {
        let own = p.ignored.as_ref().map(|ignored| ignored.flags(&program.symbols));
        let flags = own.as_ref().unwrap_or(&of_system);
        let is_list = matches!(p.ignored.as_ref().unwrap_or(&program.ignored), IgnoredSymbols::Listed(_));
        let item = if is_list { "Ignore" } else { "Consider" };
        for element in p.left.iter().chain(&p.right) {
            let ContextElement::Module(f) = element else { continue };
            if flags.get(usize::from(f.symbol)) != Some(&true) {
                continue;
            }
            let c = shown(program, f.symbol);
            let message = format!("this context never matches: {c} is hidden by '{item}:'");
            // `Ignore:` lists the hidden symbols, `Consider:` those that are seen.
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
    let symbol = |id| program.symbols.get(id);
    // A predecessor such as `?P(x,y,z)` names the command itself, and rewrites no other P.
    let own_letters = |p: &Production| -> Vec<SymbolId> {
        let is_second = |i: usize| {
            let pair = i.checked_sub(1).and_then(|k| p.predecessor.get(k)).zip(p.predecessor.get(i));
            pair.is_some_and(|(a, b)| TWO_CHARACTER_COMMANDS.contains(&(symbol(a.symbol), symbol(b.symbol))))
        };
        p.predecessor.iter().enumerate().filter(|(i, _)| !is_second(*i)).map(|(_, f)| f.symbol).collect()
    };
    let rewritten: BTreeSet<SymbolId> = program.rules.list.iter().flat_map(own_letters).collect();
    let successors = program.productions().map(|p| &p.successor).chain([&program.axiom]);
    let mut found: Vec<(SourcePlace, char, char)> = Vec::new();
    for s in successors {
        for w in s.windows(2) {
            let prefix = symbol(w[0].symbol);
            if program.overrides_cpfg(prefix) {
                continue;
            }
            // The second character of a command is a separate symbol and is rewritten like any other.
            let known = TWO_CHARACTER_COMMANDS.contains(&(prefix, symbol(w[1].symbol)));
            if (known || prefix == '~') && rewritten.contains(&w[1].symbol) {
                found.push((w[0].place.to(w[1].place), prefix, symbol(w[1].symbol)));
            }
        }
    }
    for (place, prefix, c) in found {
        // An organ that is itself a growing module is a common idiom.
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
