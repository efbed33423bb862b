//! Steps of modules that do not look at each other: pieces of the string are derived to the end one after the other, each
//! while it is in the processor's cache, and several at once. The string is the one that step by step would give.

use std::sync::atomic::{AtomicU64, Ordering};

use super::matching::View;
use super::rewriter::Rewriter;
use super::step::rewrite_range;
use super::{Derivation, MAX_PARAMS, Modules};
use crate::vm::Halt;
use osier_base::par::par_map;

/// Modules from which a string is worth being taken apart.
const WORTH: usize = 1024;
/// Modules of a piece at first.
const PIECE: usize = 64;
/// Modules at which a piece is cut up again: as many as a cache holds.
const LARGE: usize = 8192;
/// Modules of what it is cut into.
const CUT: usize = 1024;

/// Modules and parameters of the string after a step.
type Size = [u64; 2];

/// What a piece became.
struct Grown {
    modules: Modules,
    /// By step.
    sizes: Vec<Size>,
    statements: u64,
    /// Last step that changed anything.
    changed: u32,
}

impl Derivation<'_> {
    /// Takes all steps that are left after `step`, if no module asks what stands beside it or what others did. False if
    /// they must be taken one by one, as well where something has to be said of them: the words then name their step.
    /// # Errors
    /// `Work` beyond the limit.
    pub(super) fn rest_apart(&mut self, step: u32) -> Result<bool, Halt> {
        if step >= self.length || self.string.len() < WORTH || self.held_together || !self.modules_keep_apart() {
            return Ok(false);
        }
        let work = AtomicU64::new(self.work);
        let grown = self.all_grown(step, &work);
        if work.into_inner() > self.limits.get("work") {
            return Err(Halt::Work);
        }
        let Some(grown) = grown else {
            self.held_together = true;
            return Ok(false);
        };
        self.vm.statements += grown.iter().map(|g| g.statements).sum::<u64>();
        self.string.clear();
        grown.iter().for_each(|g| self.string.extend(&g.modules, 0..g.modules.len()));
        let changed = grown.iter().map(|g| g.changed).max().unwrap_or(0);
        if changed > 0 {
            self.idle_from = (changed < self.length).then_some(changed + 1);
        } else {
            self.idle_from = self.idle_from.or(Some(step + 1));
        }
        self.taken = self.idle_from.filter(|_| self.nothing_can_change()).unwrap_or(self.length);
        self.vm.step = self.taken;
        Ok(true)
    }

    /// What pieces of the string become after all steps that follow `step`; `None` if they must be taken together.
    /// `work`: modules rewritten, added to.
    fn all_grown(&self, step: u32, work: &AtomicU64) -> Option<Vec<Grown>> {
        let limit = self.limits.get("modules");
        let kept = AtomicU64::new(0);
        let pieces = self.string.pieces(PIECE);
        let grown = par_map(&pieces, |piece| self.grown(piece.clone(), step, (&kept, work), limit));
        let grown = grown.into_iter().collect::<Option<Vec<Grown>>>()?;
        let statements = grown.iter().fold(self.vm.statements, |sum, g| sum + g.statements);
        let fits = |[modules, params]: Size| modules <= limit && params <= MAX_PARAMS as u64;
        let sized = |at: usize| grown.iter().fold([0, 0], |[m, p], g| [m + g.sizes[at][0], p + g.sizes[at][1]]);
        let all_fit = (0..(self.length - step) as usize).all(|at| fits(sized(at)));
        (statements <= self.vm.statement_limit && all_fit).then_some(grown)
    }

    /// True if what becomes of a module depends on nothing but itself and the step.
    fn modules_keep_apart(&self) -> bool {
        let program = self.program;
        let blocks = &program.blocks;
        blocks.start_each.is_none()
            && blocks.end_each.is_none()
            && self.cut.is_none()
            && program.decomposition.list.is_empty()
            && !program.is_serial()
            && program.rules.list.iter().all(|p| p.is_context_free())
    }

    /// A piece after all steps that follow `step`; `None` if anything has to be said of it, or if all pieces together pass the
    /// limit. `kept`: modules of finished pieces.
    fn grown(&self, piece: Modules, step: u32, (kept, work): (&AtomicU64, &AtomicU64), limit: u64) -> Option<Grown> {
        let most = self.limits.get("work");
        let mut vm = self.vm.clone();
        (vm.events.0, vm.statements) = (Vec::new(), 0);
        let mut worker = Worker {
            derivation: self,
            rewriter: Rewriter::new(self.setup(&self.program.rules, step), vm),
            settles: self.nothing_can_change(),
            from: step,
            spare: Modules::default(),
            sizes: vec![[0; 2]; (self.length - step) as usize],
            changed: 0,
            work: 0,
        };
        let mut modules = Modules::default();
        let mut waiting = vec![(piece, step)];
        while let Some((mut piece, seen)) = waiting.pop() {
            let before = worker.work;
            let seen = worker.step(&mut piece, seen, limit)?;
            let spent = worker.work - before;
            if work.fetch_add(spent, Ordering::Relaxed).saturating_add(spent) > most {
                return None;
            }
            if seen < self.length {
                waiting.extend(piece.pieces(CUT).into_iter().rev().map(|p| (p, seen)));
                continue;
            }
            modules.extend(&piece, 0..piece.len());
            let added = piece.len() as u64;
            if kept.fetch_add(added, Ordering::Relaxed) + added > limit {
                return None;
            }
        }
        let Worker { rewriter, sizes, changed, .. } = worker;
        Some(Grown { modules, sizes, statements: rewriter.vm.statements, changed })
    }
}

/// Takes steps of pieces.
struct Worker<'d, 'g> {
    derivation: &'d Derivation<'g>,
    rewriter: Rewriter<'d>,
    /// True if what did not change in one step does not in the next.
    settles: bool,
    /// The step that all pieces have seen.
    from: u32,
    spare: Modules,
    sizes: Vec<Size>,
    changed: u32,
    /// Modules rewritten.
    work: u64,
}

impl Worker<'_, '_> {
    /// Steps a piece on until it is large or has seen all steps; the last step that it has seen. `None` as of
    /// [`Derivation::grown`].
    fn step(&mut self, piece: &mut Modules, seen: u32, limit: u64) -> Option<u32> {
        let length = self.derivation.length;
        for step in seen + 1..=length {
            (self.rewriter.vm.step, self.rewriter.setup.step, self.rewriter.setup.birth) = (step, Some(step), step);
            self.spare.clear();
            self.work = self.work.saturating_add(piece.len() as u64);
            let view = View { modules: piece, partner: &[], hidden: &self.derivation.hidden };
            let most = usize::try_from(limit).unwrap_or(usize::MAX);
            let changed = rewrite_range(&mut self.rewriter, view, 0..piece.len(), &mut self.spare, most).ok()?;
            if !self.rewriter.vm.events.0.is_empty() || self.rewriter.vm.stopped {
                return None;
            }
            std::mem::swap(piece, &mut self.spare);
            let done = !changed && self.settles;
            let counted = if done { length } else { step };
            for size in &mut self.sizes[(step - self.from - 1) as usize..(counted - self.from) as usize] {
                *size = [size[0] + piece.len() as u64, size[1] + piece.param_count() as u64];
            }
            if changed {
                self.changed = self.changed.max(step);
            }
            if done {
                return Some(length);
            }
            if piece.len() > LARGE {
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
    fn stepwise(text: &str) -> (Modules, u32) {
        let (grammar, _) = read(text);
        let (options, limits) = (DeriveOptions { seed: 3, ..Default::default() }, Limits::default());
        let mut d = Derivation::new(&grammar, &options, grammar.program.length, &limits);
        d.axiom().expect("axiom");
        let mut idle = 0;
        for step in 1..=d.length {
            d.vm.step = step;
            let changed = d.rewrite(step).expect("rewrites");
            idle = if changed { step + 1 } else { idle };
        }
        (d.string, idle)
    }

    fn both(length: u32, rules: &str) -> (Modules, u32) {
        let text = format!("Lsystem: 1\nSeed: 5\nderivation length: {length}\nAxiom: A(0) B\n{rules}\nendlsystem\n");
        let (grammar, _) = read(&text);
        let (options, limits) = (DeriveOptions { seed: 3, ..Default::default() }, Limits::default());
        let derived = derive(&grammar, &options, &limits).expect("derives");
        let (string, idle) = stepwise(&text);
        assert!(string.len() > WORTH, "{} modules prove nothing", string.len());
        assert_eq!(derived.modules, string, "{rules}");
        let said = derived.warnings.iter().find(|d| d.code == "L054").map(|d| d.message.clone());
        let wanted = (idle < length).then(|| format!("nothing changes from step {idle} on"));
        assert_eq!(said, wanted, "{rules}");
        (string, derived.steps)
    }

    #[test]
    fn pieces_give_the_string_that_steps_give() {
        // Grows past the size at which pieces are cut up again; draws, erases, and asks for the step.
        let (string, steps) = both(
            14,
            "A(x) --> F(x+ran(1)) [ A(x+1) ] A(nran(0,2))\nB : Q%3==0 --> B C\nC --> \nB --> B D(1)\nD(n) : n<5 --> D(n+1)",
        );
        assert!(string.len() > LARGE && steps == 14);
        // Alternatives by weight.
        both(13, "A(x) --> A(x) F A(x+1) :3\nA(x) --> F(x) A(x) [ A(0) ] :2");
        // Comes to rest, some pieces before others.
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
