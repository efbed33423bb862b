//! Chooses and applies productions, one module at a time.

use super::matching::{self, Brackets, ContextView};
use crate::modules::{Module, ModuleString};
use crate::program::{Production, ProductionSet, Program};
use crate::vm::{DrawPurpose, Halt, RandomStreams, Vm};
use osier_base::math::narrow;
use osier_base::rng::{self, Rng};

/// Purposes of random draws, by the part of a production that makes them.
#[derive(Debug, Clone, Copy)]
pub(super) struct DrawPurposes {
    /// Statements, conditions and parameters of the successor.
    pub statement: DrawPurpose,
    pub weight: DrawPurpose,
    /// The choice among the productions that apply.
    pub choice: DrawPurpose,
}

impl DrawPurposes {
    /// One purpose for all parts.
    pub fn all(purpose: DrawPurpose) -> Self {
        Self { statement: purpose, weight: purpose, choice: purpose }
    }
}

/// The productions to apply, and how their draws and the modules they produce are labelled.
#[derive(Debug, Clone, Copy)]
pub(super) struct RewriteSettings<'p> {
    pub program: &'p Program,
    pub rules: &'p ProductionSet,
    pub stochastic: bool,
    /// What the random draws are for, by the part of the production that makes them.
    pub purposes: DrawPurposes,
    /// Step of the draws; `None` for a homomorphism, whose draws do not change from step to step.
    pub step: Option<u32>,
    /// Written into the modules made.
    pub birth: u32,
    /// Mixed into lineages; 0 = nothing.
    pub tag: u64,
    pub brackets: Brackets,
}

/// A production that applies to the current module.
#[derive(Debug, Clone, Copy)]
struct Candidate<'p> {
    production: &'p Production,
    /// Start of its local variables in `saved_locals`.
    offset: usize,
}

/// Modules after the current one that a predecessor of several modules may take, where they do not stand in the string.
#[derive(Debug)]
pub(super) struct Followers {
    pub modules: ModuleString,
    /// Where right contexts begin in the string.
    pub context_from: usize,
}

/// Selects and applies the productions of one section.
#[derive(Debug)]
pub(super) struct Rewriter<'p> {
    pub settings: RewriteSettings<'p>,
    pub vm: Vm,
    /// `None`: the neighbours in the string follow.
    pub followers: Option<Followers>,
    locals: Vec<f64>,
    /// Productions that apply to the current module.
    candidates: Vec<Candidate<'p>>,
    saved_locals: Vec<f64>,
    weights: Vec<f64>,
    /// Unicode scalar value of each symbol: its part in the lineage of a module.
    symbol_codes: Vec<u64>,
}

impl<'p> Rewriter<'p> {
    pub fn new(settings: RewriteSettings<'p>, vm: Vm) -> Self {
        let symbols = &settings.program.symbols;
        let symbol_codes = symbols.iter().map(|(_, c)| u64::from(u32::from(c))).collect();
        Self {
            settings,
            vm,
            followers: None,
            locals: Vec::new(),
            candidates: Vec::new(),
            saved_locals: Vec::new(),
            weights: Vec::new(),
            symbol_codes,
        }
    }

    /// Draws from here on are for `purpose` and belong to the module of lineage `h`.
    fn begin_draws(&mut self, purpose: DrawPurpose, h: u64) {
        self.vm.begin_draws(purpose, h, self.settings.step);
    }

    /// Tests a production at `module`, the module of index `at`: predecessor, contexts, condition. Local variables hold its
    /// parameters afterwards if it applies.
    fn applies(&mut self, p: &Production, module: Module<'_>, view: ContextView<'_>, at: usize) -> Result<bool, Halt> {
        self.locals.clear();
        self.locals.resize(p.locals, 0.0);
        // Strict predecessor: the module itself, then its right neighbours one by one.
        let Some((first, others)) = p.predecessor.split_first() else { return Ok(false) };
        if !matching::match_module(first, module, &mut self.locals) {
            return Ok(false);
        }
        for (k, formal) in others.iter().enumerate() {
            let (modules, i) = match &self.followers {
                Some(f) => (&f.modules, k),
                None => (view.modules, at + 1 + k),
            };
            if i >= modules.len() || !matching::match_module(formal, modules.get(i), &mut self.locals) {
                return Ok(false);
            }
        }
        let right = self.followers.as_ref().map_or(at + p.predecessor.len(), |f| f.context_from);
        // Contexts: to the left of the first module, to the right of the last one.
        let brackets = self.settings.brackets;
        if !view.matches_left(brackets, &p.left, at, &mut self.locals)
            || !view.matches_right(brackets, &p.right, right, &mut self.locals)
        {
            return Ok(false);
        }
        // The block before the condition may assign variables that the condition reads.
        if let Some(code) = &p.before {
            self.vm.run(code, &mut self.locals)?;
        }
        if let Some(code) = &p.condition
            && crate::code::is_zero(self.vm.run(code, &mut self.locals)?)
        {
            return Ok(false);
        }
        if let Some(code) = &p.after {
            self.vm.run(code, &mut self.locals)?;
        }
        Ok(true)
    }

    /// The production to apply to a module, with its local variables set; `None`: the module is copied unchanged.
    pub fn select(
        &mut self,
        module: Module<'_>,
        view: ContextView<'_>,
        at: usize,
    ) -> Result<Option<&'p Production>, Halt> {
        let arity = module.params.len();
        let rules = self.settings.rules;
        self.begin_draws(self.settings.purposes.statement, module.lineage);
        // Deterministic L-system: the first production in file order that applies.
        if !self.settings.stochastic {
            for p in rules.matching(module.symbol, arity) {
                if self.applies(p, module, view, at)? {
                    return Ok(Some(p));
                }
            }
            return Ok(None);
        }
        // Stochastic L-system: collect every production that applies, with its variables, and draw one by weight.
        self.candidates.clear();
        self.saved_locals.clear();
        for p in rules.matching(module.symbol, arity) {
            if self.applies(p, module, view, at)? {
                self.candidates.push(Candidate { production: p, offset: self.saved_locals.len() });
                self.saved_locals.extend_from_slice(&self.locals);
            }
        }
        // A single candidate is taken without a draw, whatever its weight.
        let chosen = match self.candidates.len() {
            0 => return Ok(None),
            1 => 0,
            _ => self.choose(module.lineage)?,
        };
        let Some(&Candidate { production: p, offset }) = self.candidates.get(chosen) else { return Ok(None) };
        self.locals.clear();
        // Testing later candidates overwrote the local variables; restore those of the chosen one.
        self.locals.extend_from_slice(&self.saved_locals[offset..offset + p.locals]);
        Ok(Some(p))
    }

    /// Index of the candidate drawn by weight.
    fn choose(&mut self, h: u64) -> Result<usize, Halt> {
        // Weights have a stream of their own, so that their draws do not shift those of the successor.
        let resume = self.vm.save_draws();
        self.begin_draws(self.settings.purposes.weight, h);
        self.vm.set_draw_number(1 << 32);
        self.weights.clear();
        for k in 0..self.candidates.len() {
            let Candidate { production: p, offset } = self.candidates[k];
            let weight = match &p.weight {
                None => 1.0,
                Some(code) => {
                    let locals = &mut self.saved_locals[offset..offset + p.locals];
                    self.vm.run(code, locals)?
                }
            };
            // Invalid weights are reported and count as 0, so that the rest still forms a distribution.
            if weight.is_nan() || weight < 0.0 {
                self.vm.warnings.add("L033", p.place, "negative or NaN weight counts as 0");
            }
            self.weights.push(if weight > 0.0 { weight } else { 0.0 });
        }
        self.vm.restore_draws(resume);
        if !self.weights.iter().any(|w| *w > 0.0) {
            self.vm.warnings.add(
                "L034",
                self.candidates[0].production.place,
                "all weights are 0, the first production is taken",
            );
            return Ok(0);
        }
        let streams: RandomStreams = self.vm.streams;
        // The choice is drawn at the address u64::MAX of the module, which statements and weights, numbered from 0 and
        // 2^32, cannot reach.
        let key = streams.key(self.settings.purposes.choice, h, self.settings.step);
        Ok(Rng::from_key(rng::child(key, u64::MAX)).pick(&self.weights))
    }

    /// Appends the successor of a production that [`Rewriter::select`] chose for the module of lineage `h`.
    pub fn append_successor(&mut self, p: &Production, h: u64, out: &mut ModuleString) -> Result<(), Halt> {
        // The tag separates the lineages of a homomorphism from those of the string that it draws.
        let h = if self.settings.tag == 0 { h } else { rng::child(h, self.settings.tag) };
        for t in &p.successor {
            for arg in &t.args {
                let value = self.vm.eval(arg, &mut self.locals)?;
                out.push_param(narrow(value));
            }
            let code = self.symbol_codes.get(usize::from(t.symbol)).copied().unwrap_or(0);
            // Lineage: a hash of the parent's lineage, the symbol and its occurrence among equal symbols of the
            // successor. It does not depend on the position in the string.
            let lineage = rng::child(rng::child(h, code), u64::from(t.occurrence));
            out.finish_module(t.symbol, lineage, self.settings.birth);
        }
        Ok(())
    }
}
