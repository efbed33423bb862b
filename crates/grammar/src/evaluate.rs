//! Evaluates the values that a grammar's `bind` gives to symbols.

use std::collections::BTreeMap;

use osier_base::diagnostic::Diagnostic;
use osier_base::limits::Limits;

use super::binding::{AngleDefinition, Dialect, DialectSettings, TurtleAction, TurtleBindings};
use super::code::{Bytecode, Op, RandomFunction};
use super::derive::{self, DerivedString};
use super::grammar::Grammar;
use super::modules::Module;
use super::symbols::SymbolId;
use super::vm::{DrawPurpose, RandomStreams, Vm};

/// Slots of the local variables (here the angles) that the code reads.
fn angles_read(code: &Bytecode) -> impl Iterator<Item = usize> {
    code.ops.iter().filter_map(|o| if let Op::Local(i) = o { Some(usize::from(*i)) } else { None })
}

/// Indices of the angles that an expression depends on, directly or through other angles, in the order of definition.
fn required_angles(code: &Bytecode, angles: &[AngleDefinition]) -> Vec<usize> {
    let mut wanted = vec![false; angles.len()];
    angles_read(code).filter(|i| *i < angles.len()).for_each(|i| wanted[i] = true);
    // The expression of an angle uses earlier angles only, so that one pass from the last to the first finds all of them.
    for i in (0..angles.len()).rev() {
        if wanted[i] {
            angles_read(&angles[i].code).filter(|k| *k < i).for_each(|k| wanted[k] = true);
        }
    }
    (0..angles.len()).filter(|i| wanted[*i]).collect()
}

/// Looks up the action that a symbol is bound to and evaluates its number for each module.
#[derive(Debug)]
pub struct BindingEvaluator<'g> {
    bindings: Option<&'g TurtleBindings>,
    /// Indices of the angles that the number of each bound symbol depends on.
    required: BTreeMap<SymbolId, Vec<usize>>,
    vm: Vm,
    angles: Vec<f64>,
}

impl<'g> BindingEvaluator<'g> {
    /// Creates an evaluator for the modules of `derived`, with the seed, plant, step and global variables at the end of that
    /// derivation.
    pub fn new(grammar: &'g Grammar, derived: &DerivedString, limits: &Limits) -> Self {
        let bindings = grammar.program.turtle.as_ref();
        let streams = RandomStreams::new(derived.seed, derived.plant_id, derived.file_seed);
        let mut vm = Vm::new(streams, 0, derived.length);
        vm.globals.clone_from(&derived.globals);
        vm.step = derived.steps;
        vm.statement_limit = limits.get("statements");
        // Only the angles that a value depends on are drawn. The dependencies are resolved here once, not for each module.
        let required = |r: &TurtleBindings| {
            let list = r.symbols.iter().filter_map(|(s, b)| Some((*s, required_angles(b.value.as_ref()?, &r.angles))));
            list.collect()
        };
        let angles = vec![0.0; bindings.map_or(0, |r| r.angles.len())];
        Self { required: bindings.map(required).unwrap_or_default(), bindings, vm, angles }
    }

    /// The dialect, which gives the turtle commands of symbols without a binding.
    pub fn dialect(&self) -> Dialect {
        self.bindings.map_or(Dialect::Cpfg, |r| r.dialect)
    }

    /// Numeric settings of the `turtle:` item; defaults in a grammar without one.
    pub fn settings(&self) -> DialectSettings {
        self.bindings.map_or_else(DialectSettings::default, |r| r.settings)
    }

    /// Number of the last derivation step, which is the birth of the modules made in it.
    pub fn last_step(&self) -> u32 {
        self.vm.step
    }

    /// Random number of a module, 0 to 1: draw `k` of its lineage, independent of the rest of the string.
    pub fn draw(&mut self, lineage: u64, k: u64) -> f64 {
        let unit = Bytecode { ops: vec![Op::Const(1.0), Op::Random(RandomFunction::Ran)], ..Bytecode::default() };
        self.vm.begin_draws(DrawPurpose::Angle, lineage, None);
        self.vm.set_draw_number(k);
        self.vm.run(&unit, &mut []).unwrap_or(0.5)
    }

    /// The action that the grammar binds to a symbol; `None` for a symbol without a binding and in a grammar without
    /// bindings.
    pub fn action(&self, symbol: SymbolId) -> Option<&'g TurtleAction> {
        self.bindings?.symbols.get(&symbol).map(|b| &b.action)
    }

    /// The number that a bound module without a parameter acts with. Its draws are addressed by the module's lineage, so
    /// that they do not depend on the rest of the string.
    pub fn value(&mut self, m: Module<'_>) -> Option<f64> {
        let bindings = self.bindings?;
        let code = bindings.symbols.get(&m.symbol)?.value.as_ref()?;
        for &i in self.required.get(&m.symbol).into_iter().flatten() {
            let angle = &bindings.angles[i];
            self.vm.begin_draws(DrawPurpose::Angle, m.lineage(), None);
            // The draw is numbered by the angle's name, so that adding another angle before it does not change it.
            self.vm.set_draw_number(angle.draw_key >> 1);
            let value = self.vm.run(&angle.code, &mut self.angles).unwrap_or(0.0);
            self.angles[i] = value;
        }
        self.vm.begin_draws(DrawPurpose::Angle, m.lineage(), None);
        self.vm.run(code, &mut self.angles).ok()
    }

    /// Warnings of the evaluations so far, such as division by zero.
    pub fn warnings(&self, grammar: &Grammar) -> Vec<Diagnostic> {
        derive::runtime_diagnostics(grammar, &self.vm.warnings)
    }
}
