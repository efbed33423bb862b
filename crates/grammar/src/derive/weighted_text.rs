//! The final string as text, for L-systems without parameters whose productions compete only by constant weights: only
//! lineages and the productions drawn for them are computed, and the text of each successor is copied.

use super::depth_first::DepthFirst;
use super::plan::{ActiveModule, RewritePlan, Template};
use super::rewriter::StepChoices;
use crate::vm::Halt;
use osier_base::convert::to_usize;

/// True if no module has parameters and each is rewritten in the step after its birth, by its only production or by one
/// drawn by constant weights; [`weighted_text`] can then write the string.
pub(super) fn is_drawn_by_weight(plan: &RewritePlan<'_>, axiom: &Template<'_>) -> bool {
    axiom.text.is_some()
        && plan.productions.iter().all(|p| p.template.text.is_some())
        && plan.groups.iter().all(|g| g.always.is_some() || g.shares.is_some())
}

/// Number of bytes copied for each short piece of text, whatever its length: a copy of constant size needs no function call.
const SHORT: usize = 16;

/// A piece of text, prepared to be appended many times.
struct TextPiece<'p> {
    text: &'p str,
    /// Its bytes, padded with zeros, if it is not longer than [`SHORT`].
    padded: [u8; SHORT],
}

impl<'p> TextPiece<'p> {
    fn new(text: &'p str) -> Self {
        let mut padded = [0; SHORT];
        padded.iter_mut().zip(text.bytes()).for_each(|(to, byte)| *to = byte);
        Self { text, padded }
    }

    #[inline]
    fn append_to(&self, out: &mut Vec<u8>) {
        let end = out.len() + self.text.len();
        if self.text.len() <= SHORT {
            out.extend_from_slice(&self.padded);
            out.truncate(end);
        } else {
            out.extend_from_slice(self.text.as_bytes());
        }
    }
}

/// The text of a template, divided at its active modules.
struct DividedText<'p> {
    /// Text of all modules.
    whole: TextPiece<'p>,
    /// Per active module: the text between the previous active module and this one.
    before: Vec<TextPiece<'p>>,
    /// Text after the last active module.
    rest: TextPiece<'p>,
}

impl<'p> DividedText<'p> {
    fn new<'a: 'p>(template: &'a Template<'_>) -> Option<Self> {
        let text = template.text.as_ref()?;
        let mut from = 0;
        let before = template.active.iter().map(|active| {
            let index = to_usize(active.index);
            let piece = text.part(from..index);
            from = index + 1;
            TextPiece::new(piece)
        });
        let before = before.collect();
        let count = template.symbols.len();
        Some(Self { whole: TextPiece::new(text.part(0..count)), before, rest: TextPiece::new(text.part(from..count)) })
    }
}

/// Lineage of an active module and the production that rewrites it.
#[derive(Clone, Copy)]
struct DrawnProduction {
    lineage: u64,
    production: u32,
}

/// A block of modules, made by one production, whose text is being written.
struct OpenBlock {
    /// Index of its text: that of its production, or the last index for the axiom.
    text: usize,
    /// Step in which the block was made; 0 for the axiom.
    birth: u32,
    /// Number of its active modules processed so far.
    next: usize,
    /// Start of its choices, which extend to the end of the list.
    choices: usize,
}

/// Draws the productions for the modules of a block. All are drawn before the first is followed, so that the processor
/// overlaps the hash chains.
fn draw<'a>(
    plan: &'a RewritePlan<'_>,
    step: &'a StepChoices,
    active: &'a [ActiveModule],
    lineage: impl Fn(usize) -> u64 + 'a,
) -> impl Iterator<Item = DrawnProduction> + 'a {
    active.iter().map(move |active| {
        let lineage = lineage(to_usize(active.index));
        let group = &plan.groups[to_usize(active.group)];
        let production = match (group.always, &group.shares) {
            (None, Some(shares)) => group.productions[shares.pick(&mut step.stream(lineage))],
            (always, _) => always.unwrap_or_default(),
        };
        DrawnProduction { lineage, production }
    })
}

/// The text of the final string of a derivation that [is drawn by weight](is_drawn_by_weight). Reserves memory for
/// `expected` modules; afterwards the counts of `run` are those of the derivation.
/// # Errors
/// `Modules` and `Work` beyond the limits of the job.
pub(super) fn weighted_text(run: &mut DepthFirst<'_>, expected: usize) -> Result<String, Halt> {
    let (plan, job, length) = (run.plan(), run.job, run.job.length);
    let templates = || plan.productions.iter().map(|p| &p.template).chain([&run.axiom]);
    let Some(texts) = templates().map(DividedText::new).collect::<Option<Vec<_>>>() else { return Ok(String::new()) };
    let templates: Vec<&Template<'_>> = templates().collect();
    // The random streams for the choices of each step.
    let steps: Vec<StepChoices> = (1..=length).map(|step| run.rewriter.step_choices(step)).collect();
    let mut out: Vec<u8> = Vec::with_capacity(expected + SHORT);
    // The axiom is the first open block; its lineages are known.
    let axiom = plan.productions.len();
    let mut choices: Vec<DrawnProduction> = Vec::new();
    if let Some(step) = steps.first() {
        choices.extend(draw(plan, step, &run.axiom.active, |i| run.axiom_lineages[i]));
    }
    run.counts.modules = (run.axiom.symbols.len() - if length > 0 { run.axiom.active.len() } else { 0 }) as u64;
    // Depth first: write the text of a block up to a module that is rewritten, then the block that replaces the module.
    let mut stack = vec![OpenBlock { text: axiom, birth: 0, next: 0, choices: 0 }];
    while let Some(block) = stack.last_mut() {
        let text = &texts[block.text];
        if block.birth == length {
            text.whole.append_to(&mut out);
            stack.pop();
            continue;
        }
        let step = block.birth + 1;
        let mut opened = None;
        while let Some(before) = text.before.get(block.next) {
            let choice = choices[block.choices + block.next];
            block.next += 1;
            before.append_to(&mut out);
            // The production makes either constant text, or a block whose modules are rewritten in the next step.
            let production = to_usize(choice.production);
            let template = templates[production];
            run.counts.count_production(choice.production, step, template.symbols.len());
            run.counts.work += 1;
            let is_final = step == length || template.active.is_empty();
            run.counts.modules += (template.symbols.len() - if is_final { 0 } else { template.active.len() }) as u64;
            if !is_final {
                opened = Some(choice);
                break;
            }
            texts[production].whole.append_to(&mut out);
        }
        if run.counts.modules > job.max_modules || run.counts.work > job.max_work {
            run.rewriter.begin_step(step, &[]);
            return Err(if run.counts.modules > job.max_modules { Halt::Modules } else { Halt::Work });
        }
        // Open the block that the production made, with the choices for its modules; or close this block after its last
        // module.
        match opened {
            Some(DrawnProduction { lineage: parent, production }) => {
                let production = to_usize(production);
                let template = templates[production];
                let first = choices.len();
                choices
                    .extend(draw(plan, &steps[to_usize(step)], &template.active, |i| template.ids[i].lineage(parent)));
                stack.push(OpenBlock { text: production, birth: step, next: 0, choices: first });
            }
            None => {
                text.rest.append_to(&mut out);
                choices.truncate(block.choices);
                stack.pop();
            }
        }
    }
    Ok(crate::grammar::utf8_text(out))
}
