//! Derivation in chunks, for grammars whose modules are rewritten independently of each other: each chunk of the string is
//! derived through all remaining steps while it is in the processor's cache, several chunks in parallel. The resulting
//! string equals that of the derivation step by step.

use std::sync::atomic::{AtomicU64, Ordering};

use super::matching::ContextView;
use super::rewriter::Rewriter;
use super::step::rewrite_range;
use super::{Derivation, MAX_PARAMS};
use crate::modules::ModuleString;
use crate::vm::Halt;
use osier_base::convert;
use osier_base::par::par_map;

/// Modules of the shortest string that is derived in chunks; shorter ones do not repay the set-up.
const MIN_CHUNKED_STRING: usize = 1024;
/// Modules of a chunk at the start; smaller chunks balance the threads better, larger ones cost less set-up.
const INITIAL_CHUNK: usize = 64;
/// Modules above which a chunk is split again, so that its arrays stay in the cache.
const MAX_CHUNK: usize = 8192;
/// Modules of the chunks that a split makes.
const SPLIT_CHUNK: usize = 1024;

/// Length of a string.
#[derive(Debug, Clone, Copy, Default)]
struct StringLength {
    modules: u64,
    /// Parameters of all modules together.
    params: u64,
}

impl StringLength {
    fn plus(self, other: Self) -> Self {
        Self { modules: self.modules + other.modules, params: self.params + other.params }
    }
}

/// Counters that all chunks add to, so that a limit stops every one of them.
struct SharedCounters {
    /// Modules of finished chunks.
    finished: AtomicU64,
    /// Modules rewritten, over all steps.
    rewritten: AtomicU64,
}

/// A chunk after all steps.
struct DerivedChunk {
    modules: ModuleString,
    /// Length after each step.
    lengths: Vec<StringLength>,
    statements: u64,
    /// Last step that changed anything.
    changed: u32,
}

impl Derivation<'_> {
    /// Derives all steps that follow `step` in chunks, if the grammar rewrites modules independently. False, with the string
    /// unchanged, if it does not, or if a warning or a limit occurs that must name its step: the caller then goes step by
    /// step.
    /// # Errors
    /// `Work` beyond the limit.
    pub(super) fn derive_rest_in_chunks(&mut self, step: u32) -> Result<bool, Halt> {
        if step >= self.length
            || self.string.len() < MIN_CHUNKED_STRING
            || self.must_stay_whole
            || !self.modules_are_independent()
        {
            return Ok(false);
        }
        let counters = SharedCounters { finished: AtomicU64::new(0), rewritten: AtomicU64::new(self.work) };
        // All chunks add to the same counters, so that a limit on the whole string stops every thread.
        let chunks = self.derive_chunks(step, &counters);
        if counters.rewritten.into_inner() > self.limits.get("work") {
            return Err(Halt::Work);
        }
        let Some(chunks) = chunks else {
            self.must_stay_whole = true;
            return Ok(false);
        };
        self.vm.statements += chunks.iter().map(|g| g.statements).sum::<u64>();
        self.string.clear();
        chunks.iter().for_each(|g| self.string.extend(&g.modules, 0..g.modules.len()));
        let changed = chunks.iter().map(|g| g.changed).max().unwrap_or(0);
        // Restore what the serial loop would know now: the first step from which nothing changed, and the last step
        // taken.
        if changed > 0 {
            self.unchanged_since = (changed < self.length).then_some(changed + 1);
        } else {
            self.unchanged_since = self.unchanged_since.or(Some(step + 1));
        }
        self.steps_done = self.unchanged_since.filter(|_| self.nothing_can_change()).unwrap_or(self.length);
        self.vm.step = self.steps_done;
        Ok(true)
    }

    /// The chunks of the string after all steps that follow `step`; `None` if the string must be derived step by step.
    fn derive_chunks(&self, step: u32, counters: &SharedCounters) -> Option<Vec<DerivedChunk>> {
        let limit = self.limits.get("modules");
        let initial = self.string.chunks(INITIAL_CHUNK);
        let chunks = par_map(&initial, |chunk| self.derive_chunk(chunk.clone(), step, counters));
        let chunks = chunks.into_iter().collect::<Option<Vec<DerivedChunk>>>()?;
        let statements = chunks.iter().fold(self.vm.statements, |sum, g| sum + g.statements);
        // A step whose whole string would pass a limit is only visible in the sum over all chunks.
        let length_at = |at: usize| chunks.iter().fold(StringLength::default(), |sum, g| sum.plus(g.lengths[at]));
        let all_fit = (0..(self.length - step) as usize)
            .map(length_at)
            .all(|l| l.modules <= limit && l.params <= MAX_PARAMS as u64);
        (statements <= self.vm.statement_limit && all_fit).then_some(chunks)
    }

    /// True if what becomes of a module depends on nothing but itself and the step.
    fn modules_are_independent(&self) -> bool {
        let program = self.program;
        let blocks = &program.blocks;
        !self.has_queries
            && program.subsystems.is_empty()
            && blocks.start_each.is_none()
            && blocks.end_each.is_none()
            && self.cut_symbol.is_none()
            && program.decomposition.list.is_empty()
            && !program.is_serial()
            && program.rules.list.iter().all(|p| p.is_context_free())
    }

    /// A chunk after all steps that follow `step`; `None` after a warning, or if all chunks together pass a limit.
    fn derive_chunk(&self, chunk: ModuleString, step: u32, counters: &SharedCounters) -> Option<DerivedChunk> {
        let limit = self.limits.get("modules");
        let max_work = self.limits.get("work");
        let mut vm = self.vm.clone();
        (vm.warnings.list, vm.statements) = (Vec::new(), 0);
        // One worker per chunk of the initial string: its buffers serve all chunks that this one is split into.
        let mut worker = ChunkDeriver {
            derivation: self,
            rewriter: Rewriter::new(self.rewrite_settings(&self.program.rules, step), vm),
            is_stationary: self.nothing_can_change(),
            first_step: step,
            next_string: ModuleString::default(),
            lengths: vec![StringLength::default(); (self.length - step) as usize],
            changed: 0,
            work: 0,
        };
        // Depth first, leftmost chunk on top: finished chunks are appended in the order of the string.
        let mut modules = ModuleString::default();
        let mut stack = vec![(chunk, step)];
        while let Some((mut chunk, done)) = stack.pop() {
            let before = worker.work;
            let done = worker.advance(&mut chunk, done, limit)?;
            let spent = worker.work - before;
            if counters.rewritten.fetch_add(spent, Ordering::Relaxed).saturating_add(spent) > max_work {
                return None;
            }
            // The chunk has outgrown the cache before its last step: continue with its parts.
            if done < self.length {
                stack.extend(chunk.chunks(SPLIT_CHUNK).into_iter().rev().map(|p| (p, done)));
                continue;
            }
            modules.extend(&chunk, 0..chunk.len());
            let added = chunk.len() as u64;
            if counters.finished.fetch_add(added, Ordering::Relaxed) + added > limit {
                return None;
            }
        }
        let ChunkDeriver { rewriter, lengths, changed, .. } = worker;
        Some(DerivedChunk { modules, lengths, statements: rewriter.vm.statements, changed })
    }
}

/// Derives chunks one after the other with one set of buffers.
struct ChunkDeriver<'d, 'g> {
    derivation: &'d Derivation<'g>,
    rewriter: Rewriter<'d>,
    /// True if what did not change in one step does not in the next.
    is_stationary: bool,
    /// Step of the string that the chunks were cut from.
    first_step: u32,
    next_string: ModuleString,
    /// Length after each step, over the chunks so far.
    lengths: Vec<StringLength>,
    changed: u32,
    /// Modules rewritten by this worker, over all steps: its share of the limit `work`.
    work: u64,
}

impl ChunkDeriver<'_, '_> {
    /// Derives a chunk until it must be split or all steps are done; returns the last step done. `None` after a
    /// warning, `stop(n)` or a passed limit: the string must be derived step by step.
    fn advance(&mut self, chunk: &mut ModuleString, done: u32, limit: u64) -> Option<u32> {
        let length = self.derivation.length;
        for step in done + 1..=length {
            (self.rewriter.vm.step, self.rewriter.settings.step, self.rewriter.settings.birth) =
                (step, Some(step), step);
            self.next_string.clear();
            self.work = self.work.saturating_add(chunk.len() as u64);
            // Independent modules have no contexts, so that the view needs no bracket table.
            let view = ContextView {
                modules: chunk,
                partner: &[],
                ignored: &self.derivation.ignored,
                is_ring: false,
                borders: None,
            };
            let max_modules = convert::limit(limit);
            let changed =
                rewrite_range(&mut self.rewriter, view, 0..chunk.len(), &mut self.next_string, max_modules).ok()?;
            // A warning must name the step at which it occurs first in the whole string; only the serial derivation
            // knows it.
            if !self.rewriter.vm.warnings.list.is_empty() || self.rewriter.vm.stopped {
                return None;
            }
            std::mem::swap(chunk, &mut self.next_string);
            let at_rest = !changed && self.is_stationary;
            let counted = if at_rest { length } else { step };
            // A chunk at rest keeps its length through all later steps.
            let now = StringLength { modules: chunk.len() as u64, params: chunk.param_count() as u64 };
            for length in &mut self.lengths[(step - self.first_step - 1) as usize..(counted - self.first_step) as usize]
            {
                *length = length.plus(now);
            }
            if changed {
                self.changed = self.changed.max(step);
            }
            if at_rest {
                return Some(length);
            }
            if chunk.len() > MAX_CHUNK {
                return Some(step);
            }
        }
        Some(length)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::read;
    use crate::{DeriveOptions, derive};
    use osier_base::limits::Limits;

    /// Derives step by step; the string and the first step from which nothing changed.
    fn stepwise(text: &str) -> (ModuleString, u32) {
        let (grammar, _) = read(text);
        let (options, limits) = (DeriveOptions { seed: 3, ..Default::default() }, Limits::default());
        let mut d = Derivation::new(&grammar, &options, grammar.program.length, &limits);
        d.append_axiom().expect("axiom");
        let mut idle = 0;
        for step in 1..=d.length {
            d.vm.step = step;
            let changed = d.rewrite_string(step).expect("rewrites");
            idle = if changed { step + 1 } else { idle };
        }
        (d.string, idle)
    }

    fn both(length: u32, rules: &str) -> (ModuleString, u32) {
        let text = format!("Lsystem: 1\nSeed: 5\nderivation length: {length}\nAxiom: A(0) B\n{rules}\nendlsystem\n");
        let (grammar, _) = read(&text);
        let (options, limits) = (DeriveOptions { seed: 3, ..Default::default() }, Limits::default());
        let derived = derive(&grammar, &options, &limits).expect("derives");
        let (string, idle) = stepwise(&text);
        assert!(string.len() > MIN_CHUNKED_STRING, "{} modules prove nothing", string.len());
        assert_eq!(derived.modules, string, "{rules}");
        let said = derived.warnings.iter().find(|d| d.code == "L054").map(|d| d.message.clone());
        let wanted = (idle < length).then(|| format!("nothing changes from step {idle} on"));
        assert_eq!(said, wanted, "{rules}");
        (string, derived.steps)
    }

    #[test]
    fn pieces_give_the_string_that_steps_give() {
        // Grows past the size at which chunks are cut up again; draws, erases, and asks for the step.
        let (string, steps) = both(
            14,
            "A(x) --> F(x+ran(1)) [ A(x+1) ] A(nran(0,2))\nB : Q%3==0 --> B C\nC --> \nB --> B D(1)\nD(n) : n<5 --> D(n+1)",
        );
        assert!(string.len() > MAX_CHUNK && steps == 14);
        // Alternatives by weight.
        both(13, "A(x) --> A(x) F A(x+1) :3\nA(x) --> F(x) A(x) [ A(0) ] :2");
        // Comes to rest, some chunks before others.
        let (_, steps) = both(40, "A(x) : x<12 --> A(x+1) A(x+1) F\nA(x) : x>=12 && x<20 --> A(x+1)");
        assert_eq!(steps, 21);
    }

    #[test]
    fn what_has_to_be_said_is_said_as_step_by_step() {
        let text = "Lsystem: 1\nderivation length: 14\nAxiom: A(0)\nA(x) --> A(x+1/0) A(x+1)\nendlsystem\n";
        let (grammar, _) = read(text);
        let derived = derive(&grammar, &DeriveOptions::default(), &Limits::default()).expect("derives");
        assert_eq!(derived.modules, stepwise(text).0);
        let said = derived.warnings.iter().find(|d| d.code == "L040").map(|d| d.message.clone());
        assert_eq!(said.as_deref(), Some("division by zero, 16383 times"));
    }

    #[test]
    fn a_limit_that_is_passed_on_the_way_is_told_with_its_step() {
        let (grammar, _) = read(
            "Lsystem: 1\nderivation length: 30\nAxiom: A(0)\nA(x) : x<12 --> A(x+1) A(x+1)\nA(x) : x>=12 && x < 14 --> A(x+1) C C\nC --> \nendlsystem\n",
        );
        let fails = |modules: u64| {
            let mut limits = Limits::default();
            limits.set("modules", &modules.to_string()).expect("a limit");
            derive(&grammar, &DeriveOptions::default(), &limits).err().map(|e| e.to_string())
        };
        assert!(fails(12_288).is_none(), "{:?}", fails(12_288));
        let why = fails(12_287).expect("step 13 has 12,288 modules");
        assert!(why.contains("step 13 passes the limit"), "{why}");
    }
}
