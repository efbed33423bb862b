//! The final string as text. Strings without parameters are copied block by block; if in addition every module has a single
//! production, each repeated part is written once and copied from then on.

use std::ops::{ControlFlow, Range};

use super::depth_first::{Block, ModuleSink};
use super::plan::{RewritePlan, Template};
use crate::grammar::{Grammar, NumberTexts, write_module};
use osier_base::convert::to_usize;

/// Limit on the parts (production and steps left) whose text is remembered; further ones are written again.
const MAX_PARTS: usize = 1 << 20;

/// Sink that appends modules to a text in the notation of grammars, parameters with six digits.
pub(super) struct TextSink<'g> {
    grammar: &'g Grammar,
    pub text: String,
    numbers: NumberTexts,
}

impl<'g> TextSink<'g> {
    /// Creates a sink for a string of about `modules` modules.
    pub fn new(grammar: &'g Grammar, modules: u64) -> Self {
        let text = String::with_capacity(osier_base::convert::limit(modules));
        Self { grammar, text, numbers: NumberTexts::default() }
    }
}

impl ModuleSink for TextSink<'_> {
    const NEEDS_LINEAGE: bool = false;

    #[inline]
    fn modules(&mut self, block: &Block<'_>, range: Range<usize>) -> ControlFlow<()> {
        match block.text {
            Some(text) => self.text.push_str(text.part(range)),
            None => range.for_each(|i| write_module(&mut self.text, self.grammar, block.module(i), &mut self.numbers)),
        }
        ControlFlow::Continue(())
    }
}

/// A part of the string whose text is being written.
struct OpenPart<'p> {
    /// The production that made it; `None` for the axiom.
    production: Option<usize>,
    template: &'p Template<'p>,
    /// Number of derivation steps that still rewrite its active modules.
    left: u32,
    /// Number of its active modules processed so far, in order.
    next: usize,
    /// Number of its modules processed so far: written, or active and replaced by the part above it on the stack.
    written: usize,
    /// Byte of the output at which its text begins; the finished text is copied from there when it occurs again.
    start: usize,
}

/// True if no module has parameters and each has at most one production, which applies always, so that
/// [`repeated_text`] writes the string after `steps` steps.
pub(super) fn repeats(plan: &RewritePlan<'_>, axiom: &Template<'_>, steps: u32) -> bool {
    plan.productions.iter().all(|p| p.template.text.is_some())
        && plan.groups.iter().all(|g| g.always.is_some())
        && axiom.text.is_some()
        && plan.productions.len().saturating_mul(to_usize(steps) + 1) <= MAX_PARTS
}

/// The text of a string of `modules` modules; `None` for a grammar that does not [repeat](repeats).
pub(super) fn repeated_text(plan: &RewritePlan<'_>, axiom: &Template<'_>, steps: u32, modules: u64) -> Option<String> {
    let columns = to_usize(steps) + 1;
    let parts = plan.productions.len() * columns;
    let mut out = String::with_capacity(osier_base::convert::limit(modules));
    // By production and number of steps left: range of the output where its text was first written.
    let mut known: Vec<Option<Range<usize>>> = vec![None; parts];
    let open = |production, template, left, start| OpenPart { production, template, left, next: 0, written: 0, start };
    let mut stack: Vec<OpenPart<'_>> = vec![open(None, axiom, steps, 0)];
    while let Some(part) = stack.last_mut() {
        let text = part.template.text.as_ref()?;
        let next = part.template.active.get(part.next).filter(|_| part.left > 0);
        let Some(active) = next else {
            out.push_str(text.part(part.written..part.template.symbols.len()));
            if let Some(production) = part.production {
                known[production * columns + to_usize(part.left)] = Some(part.start..out.len());
            }
            stack.pop();
            continue;
        };
        let index = to_usize(active.index);
        out.push_str(text.part(part.written..index));
        (part.written, part.next) = (index + 1, part.next + 1);
        let production = to_usize(plan.groups[to_usize(active.group)].always?);
        let left = part.left - 1;
        match &known[production * columns + to_usize(left)] {
            Some(range) => out.extend_from_within(range.clone()),
            None => {
                let start = out.len();
                stack.push(open(Some(production), &plan.productions[production].template, left, start));
            }
        }
    }
    Some(out)
}
