//! The stack machine that runs expressions and statements.

use super::code::{Bytecode, CalledFunction, ElementAccess, Expr, Op, RandomFunction, TableFunction, is_zero, truth};
use super::cpfg_random::CpfgRandom;
use super::token::SourcePlace;
use osier_base::math;
use osier_base::rng::{self, Key, Rng};

/// Limit on the iterations of all loops in one run of a block, beyond which a loop counts as infinite (L044).
const LOOP_LIMIT: u64 = 1_000_000;
/// Limit on the nesting of function calls (L044): each call takes stack memory of its thread.
const CALL_LIMIT: usize = 200;
/// Limit on the output that a derivation stores, bytes.
const MAX_OUTPUT: usize = 1 << 20;
/// Largest n of `biran(n, p)`, whose trials are drawn one by one; a larger n counts as this many.
const BIRAN_LIMIT: f64 = 1e6;

/// True if the function calls itself, directly or through other functions.
fn calls_itself(functions: &[CalledFunction], k: usize) -> bool {
    let mut seen = vec![false; functions.len()];
    let mut open = vec![k];
    while let Some(function) = open.pop().and_then(|one| functions.get(one)) {
        for op in &function.code.ops {
            let Op::Call(called) = *op else { continue };
            if called == k {
                return true;
            }
            if let Some(is_seen) = seen.get_mut(called)
                && !std::mem::replace(is_seen, true)
            {
                open.push(called);
            }
        }
    }
    false
}

/// Purpose of random draws. It is part of their address, so that draws for one purpose do not affect those for another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum DrawPurpose {
    Choice,
    Statement,
    Weight,
    Decomposition,
    Block,
    Homomorphism,
    Angle,
}

impl DrawPurpose {
    /// All purposes, in the order of their numbers.
    const ALL: [Self; 7] = [
        Self::Choice,
        Self::Statement,
        Self::Weight,
        Self::Decomposition,
        Self::Block,
        Self::Homomorphism,
        Self::Angle,
    ];

    fn label(self) -> &'static str {
        match self {
            Self::Choice => "choice",
            Self::Statement => "statement",
            Self::Weight => "weight",
            Self::Decomposition => "decomposition",
            Self::Block => "block",
            Self::Homomorphism => "homomorphism",
            Self::Angle => "angle",
        }
    }
}

/// Seeds of all random streams of a run.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RandomStreams {
    seed: u64,
    plant_id: u32,
    file_seed: i64,
    /// Key of each purpose, in the order of [`DrawPurpose::ALL`]: the part of an address that all modules share.
    keys: [u64; DrawPurpose::ALL.len()],
}

impl RandomStreams {
    /// The streams of a plant. `seed`: seed of the run; `file_seed`: seed in the grammar.
    pub fn new(seed: u64, plant_id: u32, file_seed: i64) -> Self {
        // Address of a stream: plant, generator, seed of the file, purpose; then the module, and the step where draws
        // differ from step to step.
        let key = |purpose: DrawPurpose| {
            let path: [Key; 4] = [plant_id.into(), "lsys".into(), file_seed.into(), purpose.label().into()];
            Rng::key(seed, &path)
        };
        Self { seed, plant_id, file_seed, keys: DrawPurpose::ALL.map(key) }
    }

    /// The streams of the same run and plant with another grammar seed.
    pub fn with_file_seed(&self, file_seed: i64) -> Self {
        if file_seed == self.file_seed { *self } else { Self::new(self.seed, self.plant_id, file_seed) }
    }

    /// Number of the plant, which makes the draws of plants with equal seed and grammar different.
    pub fn plant_id(&self) -> u32 {
        self.plant_id
    }

    /// Seed in the grammar file; the addresses of streams contain it together with the seed of the run.
    pub fn file_seed(&self) -> i64 {
        self.file_seed
    }

    /// Key of all draws for a purpose, shared by all modules.
    #[inline]
    pub fn purpose_key(&self, purpose: DrawPurpose) -> u64 {
        self.keys[purpose as usize]
    }

    /// Key of all draws for a purpose by module `h`; `step` is given if the purpose depends on the step.
    #[inline]
    pub fn key(&self, purpose: DrawPurpose, h: u64, step: Option<u32>) -> u64 {
        let key = rng::child(self.purpose_key(purpose), h);
        step.map_or(key, |s| rng::child(key, u64::from(s)))
    }
}

/// Reason why a run stopped before the end of its code.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Halt {
    /// A loop exceeds [`LOOP_LIMIT`] iterations (L044).
    Loop(SourcePlace),
    /// A function that calls itself, directly or through others, exceeds the nesting limit [`CALL_LIMIT`] (L044).
    Recursion(SourcePlace),
    /// A function that does not call itself exceeds the nesting limit [`CALL_LIMIT`] (L044).
    NestedCalls(SourcePlace),
    /// The derivation exceeds its limit on statements (L051).
    Statements(SourcePlace),
    /// A string exceeds the limit on modules (L051), or the receiver of its modules stops.
    Modules,
    /// The strings exceed the limit `string-bytes` (L051).
    Bytes,
    /// A string exceeds the limit of 2^27 parameters (L051).
    Parameters,
    /// The modules of all steps together exceed the limit on work (L051).
    Work,
    /// The interpretation that a query asked for failed; the derivation holds its error.
    Query,
    /// The production at this place was applied too often while one module was expanded by a decomposition or homomorphism.
    Expansion(SourcePlace),
}

/// A runtime warning and how often it occurred.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct RuntimeWarning {
    pub code: &'static str,
    pub message: String,
    pub place: SourcePlace,
    pub count: u64,
}

/// Runtime warnings, one for each code and place.
#[derive(Debug, Clone, Default)]
pub(crate) struct RuntimeWarnings {
    pub list: Vec<RuntimeWarning>,
}

impl RuntimeWarnings {
    /// Counts an occurrence; the first one of a code and place sets the message.
    pub fn add(&mut self, code: &'static str, place: SourcePlace, message: &str) {
        match self.list.iter_mut().find(|e| e.code == code && e.place == place) {
            Some(e) => e.count += 1,
            None => self.list.push(RuntimeWarning { code, message: message.to_owned(), place, count: 1 }),
        }
    }

    /// Adds the counts of another run; warnings that are new here are appended.
    pub fn merge(&mut self, other: Self) {
        for e in other.list {
            match self.list.iter_mut().find(|o| o.code == e.code && o.place == e.place) {
                Some(o) => o.count += e.count,
                None => self.list.push(e),
            }
        }
    }
}

/// Address of the next random draw, to return to it later.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DrawState {
    purpose: DrawPurpose,
    owner: u64,
    step: Option<u32>,
    number: u64,
    key: Option<u64>,
    reseeded: Option<i64>,
}

/// State of the stack machine: variables, the address of the next random draw, budgets, warnings.
#[derive(Debug, Clone)]
pub(crate) struct Vm {
    pub globals: Vec<f64>,
    stack: Vec<f64>,
    pub streams: RandomStreams,
    pub step: u32,
    pub length: u32,
    /// Lineage of the module that draws.
    owner: u64,
    owner_step: Option<u32>,
    purpose: DrawPurpose,
    number: u64,
    key: Option<u64>,
    reseeded: Option<i64>,
    /// Current nesting of function calls.
    depth: usize,
    pub warnings: RuntimeWarnings,
    pub statements: u64,
    pub statement_limit: u64,
    /// Smallest and largest x, y, z of the drawing in the last interpretation for queries; all 0 before the first.
    pub bounds: [[f64; 3]; 2],
    /// Set by `stop(n)`: the derivation ends after this step.
    pub stopped: bool,
    /// cpfg's random numbers, if draws follow its order instead of being addressed by module; else `None`.
    pub cpfg: Option<CpfgRandom>,
    /// Text that `printf` wrote, at most [`MAX_OUTPUT`] bytes.
    pub output: String,
}

impl Vm {
    pub fn new(streams: RandomStreams, globals: usize, length: u32) -> Self {
        Self {
            globals: vec![0.0; globals],
            stack: Vec::new(),
            streams,
            step: 0,
            length,
            owner: 0,
            owner_step: None,
            purpose: DrawPurpose::Block,
            number: 0,
            key: None,
            reseeded: None,
            depth: 0,
            warnings: RuntimeWarnings::default(),
            statements: 0,
            statement_limit: u64::MAX,
            bounds: [[0.0; 3]; 2],
            stopped: false,
            cpfg: None,
            output: String::new(),
        }
    }

    /// Takes the machine, leaving an empty one in its place: copying long output and large arrays in each step would cost
    /// more than the step itself.
    pub fn take(&mut self) -> Self {
        let empty = Self::new(self.streams, 0, self.length);
        std::mem::replace(self, empty)
    }

    /// Makes all draws from here on those of `owner`.
    pub fn begin_draws(&mut self, purpose: DrawPurpose, owner: u64, step: Option<u32>) {
        (self.purpose, self.owner, self.owner_step) = (purpose, owner, step);
        // The first draw computes the key, as most modules draw nothing.
        (self.number, self.key, self.reseeded) = (0, None, None);
    }

    /// Sets the number of the next draw, so that two uses of one purpose draw different numbers.
    pub fn set_draw_number(&mut self, number: u64) {
        self.number = number;
    }

    /// Saves the address of the next draw.
    pub fn save_draws(&self) -> DrawState {
        DrawState {
            purpose: self.purpose,
            owner: self.owner,
            step: self.owner_step,
            number: self.number,
            key: self.key,
            reseeded: self.reseeded,
        }
    }

    /// Restores an address that [`Vm::save_draws`] saved.
    pub fn restore_draws(&mut self, d: DrawState) {
        (self.purpose, self.owner, self.owner_step) = (d.purpose, d.owner, d.step);
        (self.number, self.key, self.reseeded) = (d.number, d.key, d.reseeded);
    }

    /// The seed that `srand` has set since [`Vm::begin_draws`], if any.
    pub fn reseeded(&self) -> Option<i64> {
        self.reseeded
    }

    /// The next random stream of the current owner.
    fn next_stream(&mut self) -> Rng {
        // The key is computed once per owner; each draw is a numbered child stream of it.
        let key = *self.key.get_or_insert_with(|| {
            let streams = self.reseeded.map_or(self.streams, |seed| self.streams.with_file_seed(seed));
            streams.key(self.purpose, self.owner, self.owner_step)
        });
        let stream = Rng::from_key(rng::child(key, self.number));
        self.number += 1;
        stream
    }

    /// Value of an expression; variables beyond `locals` read as 0.
    #[inline]
    pub fn eval(&mut self, e: &Expr, locals: &mut [f64]) -> Result<f64, Halt> {
        match e {
            Expr::Const(c) => Ok(*c),
            Expr::Local(i) => Ok(locals.get(usize::from(*i)).copied().unwrap_or(0.0)),
            Expr::Code(code) => self.run(code, locals),
        }
    }

    fn pop(&mut self) -> f64 {
        self.stack.pop().unwrap_or(0.0)
    }

    /// Runs code; returns the value that it leaves on the stack, or 0.
    pub fn run(&mut self, code: &Bytecode, locals: &mut [f64]) -> Result<f64, Halt> {
        self.stack.clear();
        self.depth = 0;
        let functions = code.functions.as_ref().and_then(|list| list.get()).map_or(&[][..], Vec::as_slice);
        self.run_code(code, locals, functions)
    }

    /// Like [`Self::run`], but preserves the values already on the stack. `functions`: the functions that the code may call.
    fn run_code(&mut self, code: &Bytecode, locals: &mut [f64], functions: &[CalledFunction]) -> Result<f64, Halt> {
        let mut pc = 0_usize;
        let mut iterations = 0_u64;
        // Decided results of `&&` and `||` whose right side is still computed (with cpfg's random numbers), and where that
        // side ends.
        let mut decided: Vec<(usize, f64)> = Vec::new();
        loop {
            while let Some((_, value)) = decided.pop_if(|d| d.0 == pc) {
                self.pop();
                self.stack.push(value);
            }
            let Some(op) = code.ops.get(pc) else { break };
            pc += 1;
            match *op {
                // Operands. Slots that no compiled code refers to read as 0.
                Op::Const(c) => self.stack.push(c),
                Op::Local(i) => self.stack.push(locals.get(usize::from(i)).copied().unwrap_or(0.0)),
                Op::Global(i) => {
                    let v = self.globals.get(usize::from(i)).copied().unwrap_or(0.0);
                    self.stack.push(v);
                }
                Op::StoreLocal(i) => {
                    let v = self.pop();
                    if let Some(slot) = locals.get_mut(usize::from(i)) {
                        *slot = v;
                    }
                }
                Op::StoreGlobal(i) => {
                    let v = self.pop();
                    if let Some(slot) = self.globals.get_mut(usize::from(i)) {
                        *slot = v;
                    }
                }
                Op::LoadElement(k) => self.load_element(code, k),
                Op::StoreElement(k) => self.store_element(code, k),
                Op::Step => self.stack.push(f64::from(self.step)),
                Op::Length => self.stack.push(f64::from(self.length)),
                Op::Remaining => self.stack.push(f64::from(self.length) - f64::from(self.step)),
                // Arithmetic. Operands lie on the stack in source order, so that the right one is popped first.
                Op::Unary(f) => {
                    let v = self.pop();
                    self.stack.push(f.apply(v));
                }
                Op::Binary(f, place) => {
                    let b = self.pop();
                    let a = self.pop();
                    let (v, by_zero) = f.apply(a, b);
                    if by_zero && let Some(place) = code.places.get(place) {
                        self.warnings.add("L040", *place, "division by zero");
                    }
                    self.stack.push(v);
                }
                // Control flow. `&&` and `||` leave their result on the stack, and skip the right side if the left one
                // decides.
                Op::Jump(t) => {
                    // A jump back begins the next iteration of a loop.
                    iterations += u64::from(t < pc);
                    pc = t;
                }
                Op::JumpIfZero(t) => {
                    if is_zero(self.pop()) {
                        pc = t;
                    }
                }
                Op::And(t) => {
                    if is_zero(self.pop()) {
                        self.decide(0.0, t, &mut pc, &mut decided);
                    }
                }
                Op::Or(t) => {
                    if !is_zero(self.pop()) {
                        self.decide(1.0, t, &mut pc, &mut decided);
                    }
                }
                Op::Bool => {
                    let v = self.pop();
                    self.stack.push(truth(!is_zero(v)));
                }
                // Budgets: end infinite loops and runaway blocks.
                Op::Count(place) => self.count_statement(code, place, iterations)?,
                Op::Pop => {
                    self.pop();
                }
                Op::Random(f) => {
                    // Trials are drawn one by one: a large number of them costs as much time as statements do.
                    if f == RandomFunction::Biran {
                        let trials = self.stack.iter().rev().nth(1).copied().unwrap_or(0.0);
                        self.statements = self.statements.saturating_add(trial_cost(trials));
                    }
                    self.push_random(f);
                }
                Op::Choose(n) => self.choose(n),
                Op::Bounds(i) => self.stack.push(self.bounds[usize::from(i / 3 % 2)][usize::from(i % 3)]),
                Op::Table(f, place) => self.read_table(code, f, place),
                Op::Srand => self.srand(),
                Op::RestartDraws => self.number = 0,
                Op::Stop => self.stopped = true,
                Op::Print(k) => self.print(code, k),
                Op::Call(k) => self.call(functions, k)?,
            }
        }
        Ok(self.pop())
    }

    /// Calls a function: pops its arguments and pushes its value. A call counts as a statement.
    fn call(&mut self, functions: &[CalledFunction], k: usize) -> Result<(), Halt> {
        let Some(function) = functions.get(k) else { return Ok(()) };
        self.statements += 1;
        if self.statements > self.statement_limit {
            return Err(Halt::Statements(function.place));
        }
        if self.depth >= CALL_LIMIT {
            let halt = if calls_itself(functions, k) { Halt::Recursion } else { Halt::NestedCalls };
            return Err(halt(function.place));
        }
        let first = self.stack.len().saturating_sub(function.parameters);
        let mut locals = self.stack.split_off(first);
        self.depth += 1;
        let value = self.run_code(&function.code, &mut locals, functions)?;
        self.depth -= 1;
        self.stack.push(value);
        Ok(())
    }

    /// Skips the right side of `&&` or `||`, which ends at `end`, once the left side has decided. cpfg evaluates it
    /// nevertheless, which advances its random numbers.
    fn decide(&mut self, value: f64, end: usize, pc: &mut usize, decided: &mut Vec<(usize, f64)>) {
        if self.cpfg.is_some() {
            decided.push((end, value));
        } else {
            self.stack.push(value);
            *pc = end;
        }
    }

    /// Appends the output of a `printf`; the output holds at most [`MAX_OUTPUT`] bytes.
    fn print(&mut self, code: &Bytecode, k: usize) {
        let Some(format) = code.formats.get(k) else { return };
        let first = self.stack.len().saturating_sub(format.arguments);
        let text = format.text(self.stack.get(first..).unwrap_or(&[]));
        self.stack.truncate(first);
        self.stack.push(0.0);
        if self.output.len() + text.len() <= MAX_OUTPUT {
            self.output.push_str(&text);
        } else if let Some(place) = code.places.get(format.place) {
            self.warnings.add("L008", *place, "more than 1 MiB of output is left out");
        }
    }

    /// Pops indices and returns the slot of their element; L026 outside the array.
    fn element(&mut self, access: &ElementAccess) -> Option<usize> {
        let first = self.stack.len().saturating_sub(access.shape.sizes.len());
        let slot = access.shape.slot(self.stack.get(first..).unwrap_or(&[]));
        self.stack.truncate(first);
        if slot.is_none() {
            self.warnings.add("L026", access.place, &format!("index outside array '{}'", access.name));
        }
        slot
    }

    fn load_element(&mut self, code: &Bytecode, k: usize) {
        let Some(access) = code.elements.get(k) else { return };
        let value = self.element(access).and_then(|slot| self.globals.get(slot)).copied();
        self.stack.push(value.unwrap_or(0.0));
    }

    fn store_element(&mut self, code: &Bytecode, k: usize) {
        let Some(access) = code.elements.get(k) else { return };
        let value = self.pop();
        if let Some(slot) = self.element(access).and_then(|slot| self.globals.get_mut(slot)) {
            *slot = value;
        }
    }

    /// Pushes the value of a function or curve of a companion file; 0 with L048 if it is missing.
    fn read_table(&mut self, code: &Bytecode, f: TableFunction, place: usize) {
        let x = if f == TableFunction::CurveLength { 0.0 } else { self.pop() };
        let id = self.pop();
        let value = code.tables.as_ref().and_then(|t| f.value(t, id, x));
        if value.is_none()
            && let Some(place) = code.places.get(place)
        {
            let what = if f == TableFunction::Func { "function" } else { "curve" };
            self.warnings.add("L048", *place, &format!("{what} {id} is unknown, its value is 0"));
        }
        self.stack.push(value.unwrap_or(0.0));
    }

    fn count_statement(&mut self, code: &Bytecode, place: usize, iterations: u64) -> Result<(), Halt> {
        self.statements += 1;
        let place = || code.places.get(place).copied();
        if iterations > LOOP_LIMIT
            && let Some(p) = place()
        {
            return Err(Halt::Loop(p));
        }
        if self.statements > self.statement_limit
            && let Some(p) = place()
        {
            return Err(Halt::Statements(p));
        }
        Ok(())
    }

    #[allow(clippy::cast_possible_truncation, reason = "seeds saturate")]
    fn srand(&mut self) {
        let seed = self.stack.last().copied().unwrap_or(0.0) as i64;
        if let Some(cpfg) = &mut self.cpfg {
            cpfg.seed(seed);
        }
        (self.reseeded, self.key, self.number) = (Some(seed), None, 0);
    }

    fn push_random(&mut self, f: RandomFunction) {
        if let Some(mut cpfg) = self.cpfg {
            // The last argument lies on top of the stack; `ran` has only one.
            let b = self.pop();
            let value = match f {
                RandomFunction::Ran => b * cpfg.uniform(),
                _ => {
                    let a = self.pop();
                    match f {
                        RandomFunction::Nran => cpfg.normal(a, b),
                        RandomFunction::Uniform => a + (b - a) * cpfg.uniform(),
                        RandomFunction::Bran => cpfg.beta(a, b),
                        _ => cpfg.binomial(a, b),
                    }
                }
            };
            self.cpfg = Some(cpfg);
            return self.stack.push(value);
        }
        let mut stream = self.next_stream();
        let value = match f {
            RandomFunction::Ran => self.pop() * stream.unit_f64(),
            _ => {
                let b = self.pop();
                let a = self.pop();
                match f {
                    RandomFunction::Nran => a + b * stream.normal(),
                    RandomFunction::Uniform => a + (b - a) * stream.unit_f64(),
                    RandomFunction::Bran => beta(&mut stream, a, b),
                    _ => binomial(&mut stream, a, b),
                }
            }
        };
        self.stack.push(value);
    }

    /// Pops `n` pairs (value, share) and pushes one value, drawn in proportion to the shares.
    fn choose(&mut self, n: usize) {
        // The stack holds value, share, value, share and so on.
        let first = self.stack.len().saturating_sub(2 * n);
        let pairs: Vec<f64> = self.stack.split_off(first);
        let shares: Vec<f64> = pairs.iter().skip(1).step_by(2).copied().collect();
        // A single draw, whatever the number of values; cpfg takes it from the generator of its functions.
        let i = match &mut self.cpfg {
            Some(cpfg) => rng::weighted_index(cpfg.uniform(), &shares),
            None => self.next_stream().pick(&shares),
        };
        self.stack.push(pairs.get(2 * i).copied().unwrap_or(0.0));
    }
}

/// A beta variate drawn from `stream`; 0 if a parameter is not positive.
/// Source: X / (X + Y) of gamma variates X and Y of shapes a and b has the beta distribution.
fn beta(stream: &mut Rng, a: f64, b: f64) -> f64 {
    if !(a > 0.0 && b > 0.0) {
        return 0.0;
    }
    let (x, y) = (log_gamma_variate(stream, a), log_gamma_variate(stream, b));
    // X / (X + Y) = 1 / (1 + exp(log Y - log X)): logarithms keep gamma variates of small shapes distinct that underflow to
    // 0.
    1.0 / (1.0 + math::exp(y - x))
}

/// Logarithm of a gamma variate with the positive shape `shape` and scale 1.
/// Source: G. Marsaglia and W. W. Tsang, ACM Trans. Math. Software 26 (2000), 363: d (1 + c N)^3 with d = shape - 1/3 and
/// c = 1 / sqrt(9 d) is accepted in more than 95 of 100 cases. A shape below 1 takes that of shape + 1 times U^(1 / shape).
fn log_gamma_variate(stream: &mut Rng, shape: f64) -> f64 {
    let boost = if shape < 1.0 { math::ln(1.0 - stream.unit_f64()) / shape } else { 0.0 };
    let d = if shape < 1.0 { shape + 1.0 } else { shape } - 1.0 / 3.0;
    let c = 1.0 / math::sqrt(9.0 * d);
    loop {
        let normal = stream.normal();
        let root = 1.0 + c * normal;
        if root <= 0.0 {
            continue;
        }
        let v = root * root * root;
        let u = 1.0 - stream.unit_f64();
        if math::ln(u) < 0.5 * normal * normal + d - d * v + d * math::ln(v) {
            return boost + math::ln(d * v);
        }
    }
}

/// Number of successes in `n` trials of probability `p`, drawn one by one.
fn binomial(stream: &mut Rng, n: f64, p: f64) -> f64 {
    // `n` is limited to a number of trials that takes reasonable time; NaN and infinity give no trials.
    let mut left = if n.is_finite() { n.clamp(0.0, BIRAN_LIMIT).floor() } else { 0.0 };
    let mut hits = 0.0;
    while left > 0.0 {
        hits += truth(stream.chance(p));
        left -= 1.0;
    }
    hits
}

/// Statements whose time `biran` with so many trials takes. Own: a trial takes about a fourth of a statement.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped before the cast")]
fn trial_cost(trials: f64) -> u64 {
    if trials.is_finite() { trials.clamp(0.0, BIRAN_LIMIT) as u64 / 4 } else { 0 }
}

/// Value of code that depends on nothing at run time; `None` for other code.
pub(crate) fn constant_value(code: &Bytecode) -> Option<f64> {
    // Code depends on its run if it reads variables or steps, draws random numbers or has side effects.
    let needs = |op: &Op| {
        matches!(
            op,
            Op::Local(_)
                | Op::Global(_)
                | Op::StoreLocal(_)
                | Op::StoreGlobal(_)
                | Op::LoadElement(_)
                | Op::StoreElement(_)
                | Op::Step
                | Op::Length
                | Op::Remaining
                | Op::Random(_)
                | Op::Choose(_)
                | Op::Srand
                | Op::Bounds(_)
                | Op::Stop
                | Op::Print(_)
                | Op::Call(_)
        )
    };
    if code.ops.iter().any(needs) {
        return None;
    }
    let streams = RandomStreams::new(0, 0, 0);
    Vm::new(streams, 0, 0).run(code, &mut []).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Distribution function of the beta distribution at `x`, by the midpoint rule on its density.
    fn beta_cdf(a: f64, b: f64, x: f64) -> f64 {
        let density = |t: f64| math::pow(t, a - 1.0) * math::pow(1.0 - t, b - 1.0);
        let sum = |to: f64| {
            let n = 20_000;
            (0..n).fold(0.0, |s, i| s + density(to * (f64::from(i) + 0.5) / f64::from(n)) * to / f64::from(n))
        };
        sum(x) / sum(1.0)
    }

    #[test]
    fn beta_variates_have_their_distribution() {
        const N: u32 = 40_000;
        for (a, b) in [(5.0, 16.0), (1.0, 1.0), (2.5, 1.5), (40.0, 3.0)] {
            let draws: Vec<f64> = (0..u64::from(N)).map(|i| beta(&mut Rng::from_key(rng::child(7, i)), a, b)).collect();
            // Ten classes of equal width around the mean; chi-square with 9 degrees of freedom, p = 0.001.
            let edges: Vec<f64> = (0..=10).map(|i| f64::from(i) / 10.0).collect();
            let mut chi = 0.0;
            let mut classes = 0;
            for w in edges.windows(2) {
                let expected =
                    f64::from(N) * (beta_cdf(a, b, w[1]) - if w[0] > 0.0 { beta_cdf(a, b, w[0]) } else { 0.0 });
                let found = draws.iter().filter(|x| **x >= w[0] && **x < w[1]).count() as f64;
                if expected > 5.0 {
                    chi += (found - expected) * (found - expected) / expected;
                    classes += 1;
                }
            }
            assert!(chi < 27.9 && classes >= 3, "bran({a},{b}): chi-square {chi} of {classes} classes");
            assert!(draws.iter().all(|x| *x > 0.0 && *x < 1.0));
        }
        // Shapes near 0 give values at the ends of the interval: P(x > 1/2) = a / (a + b).
        let high = (0..4000_u64).filter(|i| beta(&mut Rng::from_key(rng::child(9, *i)), 1e-6, 3e-6) > 0.5).count();
        assert!((high as f64 - 1000.0).abs() < 110.0, "four standard deviations: {high}");
    }
}
