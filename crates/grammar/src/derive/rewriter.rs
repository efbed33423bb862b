//! Chooses and applies productions, one module at a time.

use super::matching::{self, Brackets, ContextView};
use super::modules::{Module, Modules};
use crate::program::{Production, Program, Rules};
use crate::vm::{Halt, Purpose, Streams, Vm};
use osier_base::math::narrow;
use osier_base::rng::{self, Rng};

/// What a rewriter works with.
#[derive(Debug, Clone, Copy)]
pub(super) struct RewriteContext<'p> {
    pub program: &'p Program,
    pub rules: &'p Rules,
    pub stochastic: bool,
    /// Draws of statements, of weights, of choices.
    pub purposes: [Purpose; 3],
    /// Step of the draws; `None` for a homomorphism, whose draws do not change from step to step.
    pub step: Option<u32>,
    /// Written into the modules made.
    pub birth: u32,
    /// Mixed into lineages; 0 = nothing.
    pub tag: u64,
    pub brackets: Brackets,
}

/// Applies productions of one section.
#[derive(Debug)]
pub(super) struct Rewriter<'p> {
    pub setup: RewriteContext<'p>,
    pub vm: Vm,
    locals: Vec<f64>,
    /// Applicable productions of the module at hand: production, weight, offset of its variables in `saved`.
    candidates: Vec<(&'p Production, f64, usize)>,
    saved: Vec<f64>,
    weights: Vec<f64>,
    /// The value of each symbol in lineages.
    codes: Vec<u64>,
}

impl<'p> Rewriter<'p> {
    pub fn new(setup: RewriteContext<'p>, vm: Vm) -> Self {
        let symbols = &setup.program.symbols;
        let code = |i: usize| u64::from(u32::from(symbols.get(u16::try_from(i).unwrap_or(u16::MAX))));
        let codes = (0..symbols.len()).map(code).collect();
        Self { setup, vm, locals: Vec::new(), candidates: Vec::new(), saved: Vec::new(), weights: Vec::new(), codes }
    }

    /// Draws of purpose number `which` belong to module `h` from here on.
    fn begin(&mut self, which: usize, h: u64) {
        self.vm.begin(self.setup.purposes[which], h, self.setup.step);
    }

    /// Does the production apply to `module`, which stands at `at`? Its variables are set if so.
    fn applies(&mut self, p: &Production, module: Module<'_>, view: ContextView<'_>, at: usize) -> Result<bool, Halt> {
        self.locals.clear();
        self.locals.resize(usize::from(p.locals), 0.0);
        let Some((first, others)) = p.predecessor.split_first() else { return Ok(false) };
        if !matching::accept(first, module, &mut self.locals) {
            return Ok(false);
        }
        for (k, formal) in others.iter().enumerate() {
            let i = at + 1 + k;
            if i >= view.modules.len() || !matching::accept(formal, view.modules.get(i), &mut self.locals) {
                return Ok(false);
            }
        }
        let brackets = self.setup.brackets;
        if !view.left(brackets, &p.left, at, &mut self.locals)
            || !view.right(brackets, &p.right, at + p.predecessor.len(), &mut self.locals)
        {
            return Ok(false);
        }
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

    /// The production for a module, with its variables set; `None` = copy.
    pub fn find(
        &mut self,
        module: Module<'_>,
        view: ContextView<'_>,
        at: usize,
    ) -> Result<Option<&'p Production>, Halt> {
        let arity = u8::try_from(module.params.len()).unwrap_or(u8::MAX);
        let rules = self.setup.rules;
        self.begin(0, module.lineage);
        // Deterministic L-system: the first production in file order that applies.
        if !self.setup.stochastic {
            for p in rules.of(module.symbol, arity) {
                if self.applies(p, module, view, at)? {
                    return Ok(Some(p));
                }
            }
            return Ok(None);
        }
        // Stochastic L-system: collect every production that applies, with its variables, and draw one by weight.
        self.candidates.clear();
        self.saved.clear();
        for p in rules.of(module.symbol, arity) {
            if self.applies(p, module, view, at)? {
                self.candidates.push((p, 1.0, self.saved.len()));
                self.saved.extend_from_slice(&self.locals);
            }
        }
        let chosen = match self.candidates.len() {
            0 => return Ok(None),
            1 => 0,
            _ => self.choose(module.lineage)?,
        };
        let Some(&(p, _, offset)) = self.candidates.get(chosen) else { return Ok(None) };
        self.locals.clear();
        self.locals.extend_from_slice(&self.saved[offset..offset + usize::from(p.locals)]);
        Ok(Some(p))
    }

    /// Index of the candidate drawn by weight.
    fn choose(&mut self, h: u64) -> Result<usize, Halt> {
        // Weights have a stream of their own, so that their draws do not shift those of the successor.
        let resume = self.vm.clone_draws();
        self.begin(1, h);
        self.vm.number_from(1 << 32);
        self.weights.clear();
        for k in 0..self.candidates.len() {
            let (p, _, offset) = self.candidates[k];
            let weight = match &p.weight {
                None => 1.0,
                Some(code) => {
                    let locals = &mut self.saved[offset..offset + usize::from(p.locals)];
                    self.vm.run(code, locals)?
                }
            };
            if weight.is_nan() || weight < 0.0 {
                self.vm.events.add("L033", p.place, "negative or NaN weight counts as 0");
            }
            self.weights.push(if weight > 0.0 { weight } else { 0.0 });
        }
        self.vm.resume_draws(resume);
        if !self.weights.iter().any(|w| *w > 0.0) {
            self.vm.events.add("L034", self.candidates[0].0.place, "all weights are 0, the first production is taken");
            return Ok(0);
        }
        let streams: Streams = self.vm.streams;
        let key = streams.key(self.setup.purposes[2], h, self.setup.step);
        Ok(Rng::from_key(rng::child(key, u64::MAX)).pick(&self.weights))
    }

    /// Appends the successor of a production that [`Rewriter::find`] chose for the module of lineage `h`.
    pub fn build(&mut self, p: &Production, h: u64, out: &mut Modules) -> Result<(), Halt> {
        let h = if self.setup.tag == 0 { h } else { rng::child(h, self.setup.tag) };
        for t in &p.successor {
            for arg in &t.args {
                let value = self.vm.eval(arg, &mut self.locals)?;
                out.param(narrow(value));
            }
            let code = self.codes.get(usize::from(t.symbol)).copied().unwrap_or(0);
            let lineage = rng::child(rng::child(h, code), u64::from(t.occurrence));
            out.close(t.symbol, lineage, self.setup.birth);
        }
        Ok(())
    }
}
