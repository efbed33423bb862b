//! Productions prepared for rewriting: an index by symbol and number of parameters, and successors as arrays of symbols and
//! parameters that are copied as a whole, so that only changing parameters are computed.

use super::registers::{ParameterTest, RegisterCode, RegisterCompiler, ValueSource};
use crate::code::{Bytecode, Expr, Op};
use crate::modules::LineageIds;
use crate::program::{Production, ProductionSet, Program, Section, SuccessorModule};
use crate::symbols::SymbolId;
use osier_base::convert::{saturating_index, to_usize};
use osier_base::math::narrow;
use osier_base::rng::Shares;

/// Index of a group in [`RewritePlan::groups`].
pub(super) type GroupId = u32;

/// A successor, or the axiom, as arrays over its modules.
#[derive(Debug)]
pub(super) struct Template<'p> {
    pub symbols: Vec<SymbolId>,
    /// Per module: end index of its parameters.
    pub ends: Vec<u32>,
    /// Parameters of all modules; 0 for those that are computed.
    pub constants: Vec<f32>,
    pub computed: Vec<ComputedParameter<'p>>,
    /// Per module: the ids that turn the lineage of the replaced module into that of the new one.
    pub ids: Vec<LineageIds>,
    /// Modules that a production may rewrite.
    pub active: Vec<ActiveModule>,
    /// The modules as text, if none of them has parameters.
    pub text: Option<TemplateText>,
}

/// Text of the symbols of a template whose modules have no parameters; ranges of it are copied.
#[derive(Debug, Default)]
pub(super) struct TemplateText {
    text: String,
    /// Per module: end index of its text.
    ends: Vec<u32>,
}

impl TemplateText {
    fn new(program: &Program, symbols: &[SymbolId]) -> Self {
        let mut out = Self::default();
        for symbol in symbols {
            program.symbols.append_spelling(*symbol, &mut out.text);
            out.ends.push(saturating_index(out.text.len()));
        }
        out
    }

    #[inline]
    pub fn part(&self, modules: std::ops::Range<usize>) -> &str {
        let end = |n: usize| n.checked_sub(1).map_or(0, |k| to_usize(self.ends[k]));
        &self.text[end(modules.start)..end(modules.end)]
    }
}

/// A parameter that depends on the module being rewritten.
#[derive(Debug, Clone, Copy)]
pub(super) struct ComputedParameter<'p> {
    pub source: ValueSource<'p>,
    /// Its expression; run to report a division by zero.
    pub code: Option<&'p Bytecode>,
    /// Index of the parameter among all parameters of the template.
    pub target: u32,
}

/// A module of a template that a production may rewrite.
#[derive(Debug, Clone, Copy)]
pub(super) struct ActiveModule {
    pub index: u32,
    pub group: GroupId,
    /// Range of its parameters among all parameters of the template.
    pub first_param: u32,
    pub end_param: u32,
}

/// Weight of a production when it competes with others that apply.
#[derive(Debug)]
pub(super) enum Weight<'p> {
    Constant(f64),
    Code(&'p Bytecode),
}

/// A production prepared for rewriting: registers for its condition and parameters, and its successor as a template.
#[derive(Debug)]
pub(super) struct PlannedProduction<'p> {
    pub source: &'p Production,
    /// Number of local variables, formal parameters included.
    pub locals: usize,
    pub condition: Condition<'p>,
    /// The condition, if it compares one parameter with a constant.
    pub test: Option<ParameterTest>,
    pub weight: Weight<'p>,
    pub registers: RegisterCode,
    pub template: Template<'p>,
    /// Per symbol: true if contexts of this production skip it; `None` if they skip the symbols of its L-system.
    pub ignored: Option<Vec<bool>>,
    /// True if it has one predecessor, no contexts and no blocks, so that only its condition decides whether it applies.
    pub is_simple: bool,
    /// True if computing the successor's parameters has no side effects.
    pub is_pure: bool,
}

/// The condition of a production.
#[derive(Debug, Clone, Copy)]
pub(super) enum Condition<'p> {
    Always,
    /// Source of the condition's value, and the equivalent bytecode.
    Value(ValueSource<'p>, &'p Bytecode),
}

/// The productions of one symbol with one number of parameters, in file order.
#[derive(Debug)]
pub(super) struct ProductionGroup {
    pub productions: Vec<u32>,
    /// True if all productions depend only on the module and their conditions.
    pub is_simple: bool,
    /// True if a module to which no production applies in one step stays unchanged in all later steps.
    pub is_stationary: bool,
    /// The production that rewrites every module of the group; `None` if that is not always the same one.
    pub always: Option<u32>,
    /// The test of each production (`None` if it always applies); only if no condition reads more than one parameter and the
    /// first production that applies is taken.
    pub tests: Option<Vec<Option<ParameterTest>>>,
    /// Constant weights of the productions, if they compete and all of them apply to every module of the group.
    pub shares: Option<Shares>,
}

/// The productions of one section, prepared for rewriting.
#[derive(Debug)]
pub(super) struct RewritePlan<'p> {
    pub set: &'p ProductionSet,
    pub productions: Vec<PlannedProduction<'p>>,
    pub groups: Vec<ProductionGroup>,
    /// Per symbol: pairs of number of parameters and group.
    by_symbol: Vec<Vec<(usize, GroupId)>>,
    /// True if competing productions are drawn by weight.
    pub stochastic: bool,
    /// True if a production draws random numbers or is itself drawn, so that rewriting needs lineages.
    pub draws: bool,
    /// True if a production has contexts in the new string.
    pub reads_made: bool,
}

/// The plans of one section of all L-systems of a file.
#[derive(Debug)]
pub(super) struct SectionPlans<'p> {
    /// The main L-system first, then those of [`Program::subsystems`].
    systems: Vec<RewritePlan<'p>>,
}

impl<'p> SectionPlans<'p> {
    /// Prepares a section. `stochastic`: its productions compete by weight.
    pub fn new(program: &'p Program, section: Section, stochastic: bool) -> Self {
        let plan = |set| RewritePlan::new(program, set, stochastic);
        Self { systems: program.sections(section).map(plan).collect() }
    }

    pub fn main(&self) -> &RewritePlan<'p> {
        &self.systems[0]
    }

    /// The plan of an L-system, numbered as in [`Program::section`]; that of the main one for an unknown number.
    pub fn of(&self, system: u16) -> &RewritePlan<'p> {
        self.systems.get(usize::from(system)).unwrap_or(&self.systems[0])
    }

    /// True if neither the main L-system nor any other has a production in this section.
    pub fn is_empty(&self) -> bool {
        self.systems.iter().all(|p| p.productions.is_empty())
    }

    /// True if a production has a left or right context, which needs matched brackets.
    pub fn needs_partners(&self) -> bool {
        self.systems.iter().flat_map(|p| &p.set.list).any(|p| !p.is_context_free())
    }

    /// Largest number of modules in a predecessor; 1 without productions.
    pub fn longest_predecessor(&self) -> usize {
        self.systems.iter().flat_map(|p| &p.set.list).map(|p| p.predecessor.len()).max().unwrap_or(1)
    }
}

/// The plans of the sections that rewrite the string.
#[derive(Debug)]
pub(super) struct Plans<'p> {
    pub rules: SectionPlans<'p>,
    pub decomposition: SectionPlans<'p>,
}

impl<'p> Plans<'p> {
    /// Prepares the productions of a program. `stochastic`: they compete by weight; `as_cpfg`: of those of a decomposition
    /// the first that applies is taken instead.
    pub fn new(program: &'p Program, stochastic: bool, as_cpfg: bool) -> Self {
        Self {
            rules: SectionPlans::new(program, Section::Rules, stochastic),
            decomposition: SectionPlans::new(program, Section::Decomposition, stochastic && !as_cpfg),
        }
    }

    /// True if a production of either section draws random numbers or is drawn, so that lineages are needed.
    pub fn draws(&self) -> bool {
        self.rules.systems.iter().chain(&self.decomposition.systems).any(|p| p.draws)
    }
}

impl<'p> RewritePlan<'p> {
    /// Groups the productions of a section by symbol and number of parameters, and prepares their conditions, weights and
    /// successors. `stochastic`: they compete by weight.
    pub fn new(program: &'p Program, set: &'p ProductionSet, stochastic: bool) -> Self {
        let mut by_symbol: Vec<Vec<(usize, GroupId)>> = vec![Vec::new(); program.symbols.len()];
        let mut groups: Vec<ProductionGroup> = Vec::new();
        // Group the productions first: templates refer to the groups of their modules.
        for (i, p) in (0_u32..).zip(&set.list) {
            let Some(first) = p.predecessor.first() else { continue };
            let Some(row) = by_symbol.get_mut(usize::from(first.symbol)) else { continue };
            let arity = usize::from(first.arity);
            let group = row.iter().find(|(a, _)| *a == arity).map(|(_, g)| *g);
            let group = group.unwrap_or_else(|| {
                let next = saturating_index(groups.len());
                row.push((arity, next));
                groups.push(ProductionGroup {
                    productions: Vec::new(),
                    is_simple: true,
                    is_stationary: true,
                    always: None,
                    tests: None,
                    shares: None,
                });
                next
            });
            if let Some(g) = groups.get_mut(to_usize(group)) {
                g.productions.push(i);
            }
        }
        let varies_by_step = program.blocks.start_each.is_some() || program.blocks.end_each.is_some();
        for g in &mut groups {
            let tests = g.productions.iter().filter_map(|i| set.list.get(to_usize(*i))).flat_map(tests);
            // Conditions that depend only on parameters have the same value in every step.
            g.is_stationary = !tests.into_iter().any(|c| may_change(c, varies_by_step));
        }
        let mut plan =
            Self { set, productions: Vec::new(), groups, by_symbol, stochastic, draws: false, reads_made: false };
        plan.reads_made = set.list.iter().any(|p| !p.new_left.is_empty());
        plan.productions = set.list.iter().map(|p| plan.production(program, p)).collect();
        for i in 0..plan.groups.len() {
            plan.groups[i].is_simple =
                plan.groups[i].productions.iter().all(|p| plan.productions[to_usize(*p)].is_simple);
            plan.groups[i].always = match plan.groups[i].productions.as_slice() {
                // A deterministic L-system takes the first production that applies, so that the others have no effect.
                [first, others @ ..] if others.is_empty() || !stochastic => {
                    let p = &plan.productions[to_usize(*first)];
                    (p.is_simple && matches!(p.condition, Condition::Always)).then_some(*first)
                }
                _ => None,
            };
        }
        for i in 0..plan.groups.len() {
            plan.groups[i].shares = plan.constant_shares(&plan.groups[i]);
            plan.groups[i].tests = plan.parameter_tests(&plan.groups[i]);
        }
        let competes = stochastic && plan.groups.iter().any(|g| g.productions.len() > 1);
        plan.draws = competes || set.list.iter().flat_map(Production::codes).any(draws);
        plan
    }

    /// The tests of a group's productions, if each reads at most one parameter and none competes by weight.
    fn parameter_tests(&self, group: &ProductionGroup) -> Option<Vec<Option<ParameterTest>>> {
        if (self.stochastic && group.always.is_none()) || !group.is_simple {
            return None;
        }
        let test = |i: &u32| {
            let p = &self.productions[to_usize(*i)];
            match p.condition {
                Condition::Always => Some(None),
                Condition::Value(..) => p.test.map(Some),
            }
        };
        group.productions.iter().map(test).collect()
    }

    /// The weights of productions that compete without conditions, if all are constant and positive.
    fn constant_shares(&self, group: &ProductionGroup) -> Option<Shares> {
        let share = |i: &u32| {
            let p = &self.productions[to_usize(*i)];
            match p.weight {
                Weight::Constant(w) if w > 0.0 && p.is_simple && matches!(p.condition, Condition::Always) => Some(w),
                _ => None,
            }
        };
        // Precomputed sums of the weights, so that a draw needs no pass over the productions.
        let competes = self.stochastic && group.productions.len() > 1;
        let weights: Option<Vec<f64>> = if competes { group.productions.iter().map(share).collect() } else { None };
        weights.map(|w| Shares::new(&w))
    }

    /// Group of the modules of a symbol with `arity` parameters; `None` if it has no productions.
    #[inline]
    pub fn group(&self, symbol: SymbolId, arity: usize) -> Option<GroupId> {
        let row = self.by_symbol.get(usize::from(symbol))?;
        row.iter().find(|(a, _)| *a == arity).map(|(_, g)| *g)
    }

    /// True if some production has this symbol as its (first) predecessor.
    #[inline]
    pub fn has_productions(&self, symbol: SymbolId) -> bool {
        self.by_symbol.get(usize::from(symbol)).is_some_and(|row| !row.is_empty())
    }

    fn production(&self, program: &Program, p: &'p Production) -> PlannedProduction<'p> {
        let weight = match &p.weight {
            None => Weight::Constant(1.0),
            Some(code) => crate::vm::constant_value(code).map_or(Weight::Code(code), Weight::Constant),
        };
        // The parameters of a lone predecessor are the first local variables.
        let is_first = p.predecessor.first().is_some_and(|f| f.slot == 0);
        let is_simple =
            p.is_context_free() && p.predecessor.len() == 1 && is_first && p.before.is_none() && p.after.is_none();
        let mut compiler = RegisterCompiler::new(p.locals);
        let condition = match &p.condition {
            None => Condition::Always,
            Some(code) => Condition::Value(compiler.code(code), code),
        };
        // Registers of the condition are computed first; those of the successor only if the condition holds.
        let condition_end = compiler.operation_count();
        let arity = p.predecessor.first().map_or(0, |f| usize::from(f.arity));
        let is_register = matches!(condition, Condition::Value(ValueSource::Register(_), _));
        let test = compiler.parameter_test(condition_end).filter(|t| is_register && t.parameter < arity);
        let template = self.template(program, &p.successor, &mut compiler);
        let registers = compiler.finish(condition_end);
        let runs_code = template.computed.iter().any(|c| matches!(c.source, ValueSource::Code(_)));
        let is_pure = registers.cannot_fail && !runs_code;
        PlannedProduction {
            source: p,
            locals: p.locals,
            condition,
            test,
            weight,
            registers,
            template,
            ignored: p.ignored.as_ref().map(|ignored| ignored.flags(&program.symbols)),
            is_simple,
            is_pure,
        }
    }

    /// Makes the template of a successor or of the axiom; adds its expressions to `compiler`.
    pub fn template(
        &self,
        program: &Program,
        modules: &'p [SuccessorModule],
        compiler: &mut RegisterCompiler,
    ) -> Template<'p> {
        let mut out = Template {
            symbols: Vec::new(),
            ends: Vec::new(),
            constants: Vec::new(),
            computed: Vec::new(),
            ids: Vec::new(),
            active: Vec::new(),
            text: None,
        };
        for (index, m) in (0_u32..).zip(modules) {
            out.symbols.push(m.symbol);
            let code = u64::from(u32::from(program.symbols.get(m.symbol)));
            out.ids.push(LineageIds::new(code, m.occurrence));
            let first_param = saturating_index(out.constants.len());
            // Constants are stored; other parameters are computed when a module is rewritten.
            for arg in &m.args {
                let target = saturating_index(out.constants.len());
                let source = compiler.expression(arg);
                let ValueSource::Constant(c) = source else {
                    let code = if let Expr::Code(code) = arg { Some(&**code) } else { None };
                    out.computed.push(ComputedParameter { source, code, target });
                    // Placeholder for the computed value.
                    out.constants.push(0.0);
                    continue;
                };
                out.constants.push(narrow(c));
            }
            let end_param = saturating_index(out.constants.len());
            out.ends.push(end_param);
            if let Some(group) = self.group(m.symbol, m.args.len()) {
                out.active.push(ActiveModule { index, group, first_param, end_param });
            }
        }
        // Modules without parameters always have the same text.
        out.text = out.constants.is_empty().then(|| TemplateText::new(program, &out.symbols));
        out
    }
}

/// Code that decides whether a production applies: the block before its condition, and the condition.
fn tests(p: &Production) -> impl Iterator<Item = &Bytecode> {
    [&p.before, &p.condition].into_iter().flatten()
}

/// True if the value may change from step to step; `globals`: blocks of the L-system may change global variables.
fn may_change(code: &Bytecode, globals: bool) -> bool {
    code.ops.iter().any(|o| match o {
        Op::Step | Op::Remaining | Op::Random(_) | Op::Choose(_) => true,
        Op::Global(_) | Op::LoadElement(_) => globals,
        _ => false,
    })
}

fn draws(code: &Bytecode) -> bool {
    code.ops.iter().any(|o| matches!(o, Op::Random(_) | Op::Choose(_)))
}
