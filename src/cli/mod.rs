//! The command line: a thin caller of the library, and the only code that uses terminals, clocks, signals and the
//! thread pool.

mod args;
mod bake;
mod check;
mod console;
mod convert;
mod events;
mod grow;
mod info;
mod knobs;
mod list;
mod new;
mod numbers;
mod preset_list;
mod preview;
mod progress;
mod report;
mod shell;
mod sweep;
mod watch;

use std::ffi::OsString;
use std::path::Path;
use std::process::ExitCode;

use clap::Parser as _;

use crate::source::SourceOptions;
use args::{Cli, Command, Common};
use console::Console;
use osier_base::Error;
use osier_base::diagnostic::visible;
use osier_base::files::{Folder, WriteOptions, check_writable, folder_of};
use osier_base::limits::Limits;
use osier_base::progress::Cancel;

/// Largest number of threads: more would mostly wait for each other.
#[cfg(feature = "parallel")]
const THREADS: usize = 256;

/// Common flags, console, limits and cancellation, which every command receives.
pub(crate) struct Context {
    pub common: Common,
    pub console: Console,
    pub limits: Limits,
    pub cancel: Cancel,
    /// Search folders, overrides and seed of the common flags, for the sources that a command names.
    pub sources: SourceOptions,
}

/// Common flags that change scenes and grammars as they are read.
const SCENE_FLAGS: [&str; 4] = ["--set", "--seed", "--dialect", "--rng"];

impl Context {
    /// The first of `flags`, each of [`SCENE_FLAGS`], that was given to a command that it does not change; `None` if none was.
    fn scene_flag(&self, flags: &[&'static str]) -> Option<&'static str> {
        let common = &self.common;
        let is_given = |flag: &&str| match *flag {
            "--set" => !common.set.is_empty(),
            "--seed" => common.seed.is_some(),
            "--dialect" => common.dialect.is_some(),
            "--rng" => common.rng.is_some(),
            _ => false,
        };
        flags.iter().copied().find(is_given)
    }

    /// Exit code of a complete run: 3 for warnings under `--strict`, else 0.
    fn strict(&self, warned: bool) -> u8 {
        if warned && self.common.strict { 3 } else { 0 }
    }
}

/// Runs the program with the arguments of the process.
pub fn main() -> ExitCode {
    ExitCode::from(run(std::env::args_os()))
}

/// Runs the program with arguments, the first of which is its name, and returns the exit code. A process may call it once, since
/// the thread pool is that of the whole process; signal handlers and the memory watch end with the run.
pub fn run(args: impl IntoIterator<Item = OsString>) -> u8 {
    let args: Vec<OsString> = args.into_iter().collect();
    if args.len() <= 1 {
        use std::io::Write as _;
        let _ = std::io::stderr().write_all(args::GUIDE.as_bytes());
        return 2;
    }
    let unreadable = args.iter().filter(|a| a.to_str().is_none()).map(|a| visible(&a.to_string_lossy()));
    let unreadable: Vec<String> = unreadable.map(|a| format!("\"{a}\"")).collect();
    match Cli::try_parse_from(list::with_entries(with_help_flag(args))) {
        Ok(cli) => guarded(cli),
        // Help and version are printed on standard output and are successes; all else is a usage error.
        Err(mut e) if e.use_stderr() => {
            advise_on_flag(&mut e);
            let _ = e.print();
            // The message above does not say which argument it is.
            if e.kind() == clap::error::ErrorKind::InvalidUtf8 {
                use std::io::Write as _;
                let names = unreadable.join(", ");
                let _ = writeln!(std::io::stderr(), "help: {names}: write names of files in UTF-8; rename such a file");
            }
            2
        }
        Err(help) => help_exit_code(help.print()),
    }
}

/// For an unknown flag that is a word of scene keys, as `--wind`, tells how keys are set; one of the limits is no advice for it.
fn advise_on_flag(error: &mut clap::Error) {
    use clap::error::{ContextKind, ContextValue, ErrorKind};
    let Some(ContextValue::String(flag)) = error.get(ContextKind::InvalidArg) else { return };
    let Some(word) = flag.strip_prefix("--").filter(|_| error.kind() == ErrorKind::UnknownArgument) else { return };
    let word = word.split('=').next().unwrap_or_default().to_owned();
    let near = error.get(ContextKind::SuggestedArg);
    if matches!(near, Some(ContextValue::String(near)) if near.starts_with("--max-")) && !word.starts_with("max") {
        error.remove(ContextKind::SuggestedArg);
    }
    if error.get(ContextKind::SuggestedArg).is_none() && list::has_options(&word) {
        let tip =
            format!("keys of a scene are set by --set KEY=VALUE; `osier list options {word}` lists those about it");
        error.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![tip.into()]));
    }
}

/// Rewrites the arguments `osier help` and `osier help COMMAND` to `osier --help` and `osier COMMAND --help`.
fn with_help_flag(mut args: Vec<OsString>) -> Vec<OsString> {
    if args.get(1).is_some_and(|a| a == "help") {
        args.remove(1);
        args.push("--help".into());
    }
    args
}

/// Exit code after printing help on standard output: 0, also if the reader has closed the pipe; else that of the error, which is printed.
fn help_exit_code(result: std::io::Result<()>) -> u8 {
    use std::io::Write as _;
    match result.and_then(|()| std::io::stdout().flush()) {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => {
            let error = Error::io("write", "standard output", e);
            let _ = writeln!(std::io::stderr(), "error: {error}");
            error.exit_code()
        }
        _ => 0,
    }
}

/// Runs the command; a panic is reported as a bug in two lines with exit code 101.
fn guarded(cli: Cli) -> u8 {
    let verbose = cli.common.verbose;
    // The default hook, which prints location and backtrace, runs with `--verbose` only.
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |info| {
        use std::io::Write as _;
        let mut err = std::io::stderr();
        let _ = writeln!(err, "internal error: {info}");
        let _ = writeln!(err, "this is a bug in osier; please report it with the input that caused it");
        if verbose {
            hook(info);
        }
    }));
    std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| start(cli))).unwrap_or(101)
}

fn start(cli: Cli) -> u8 {
    let as_json = matches!(&cli.command, Command::Bake(bake) if bake.progress == args::ProgressArg::Json);
    let console = Console::new(&cli.common, as_json);
    #[allow(clippy::disallowed_methods, reason = "the command line may read the environment")]
    let environment = std::env::var_os("OSIER_MAX");
    let limits = match cli.common.limits(environment) {
        Ok(limits) => limits,
        Err(e) => {
            console.complain(&e);
            return 2;
        }
    };
    if let Some(bad) = cli.common.set.iter().find(|set| !set.contains('=')) {
        console.complain(&format!("--set: \"{bad}\" is not PATH=VALUE, such as wind.speed=6"));
        return 2;
    }
    // Signal handlers, threads and memory watch precede all work; the handlers and the watch end with the run.
    let cancel = Cancel::default();
    let _signals = watch::listen(&cancel, as_json)
        .inspect_err(|e| console.complain(&format!("cannot listen to signals: {e}")))
        .ok();
    if let Err(e) = pool(cli.common.jobs) {
        console.complain(&e);
        return 2;
    }
    let _memory = match watch::watch(&limits, &cancel, as_json) {
        Ok(memory) => memory,
        Err(e) => {
            console.error(&e);
            return e.exit_code();
        }
    };
    let sources = SourceOptions {
        search: cli.common.search.clone(),
        set: cli.common.set.clone(),
        dialect: cli.common.dialect.clone(),
        rng: cli.common.rng.clone(),
        seed: cli.common.seed,
        limits: limits.clone(),
    };
    let context = Context { common: cli.common, console, limits, cancel, sources };
    let done = match &cli.command {
        Command::Convert(a) => convert::run(&context, a),
        Command::List(a) => list::run(&context, a),
        Command::New(a) => new::run(&context, a),
        Command::Bake(a) => bake::run(&context, a),
        Command::Grow(a) => grow::run(&context, a),
        Command::Preview(a) => preview::run(&context, a),
        Command::Check(a) => check::run(&context, a),
        Command::Info(a) => info::run(&context, a),
        Command::Completions(a) => shell::completions(&context, a),
        Command::Man => shell::man(&context),
    };
    done.unwrap_or_else(|e| {
        context.console.error(&e);
        e.exit_code()
    })
}

/// Checks the output of a command before work that takes long: its folder can be written, and no file of the user is in the way unless
/// `force` is set.
/// # Errors
/// `Io`, `Foreign`.
fn check_output(context: &Context, output: &Path, force: bool) -> osier_base::Result<()> {
    let parent = folder_of(output);
    check_writable(parent)?;
    let name = output.file_name().and_then(|name| name.to_str()).filter(|_| output.is_file() && !force);
    let Some(name) = name else { return Ok(()) };
    let options = WriteOptions { cancel: context.cancel.clone(), ..WriteOptions::default() };
    Folder::plain(parent, options)?.check_name(name).map_err(|e| match e {
        // As it was typed, without "./".
        Error::Foreign { .. } => Error::Foreign { path: output.to_owned() },
        other => other,
    })
}

/// Message about an output whose file name is not UTF-8, which written files could not refer to; `None` for any other.
fn unreadable_name(output: &Path) -> Option<String> {
    let is_text = output.file_name().is_none_or(|name| name.to_str().is_some());
    (!is_text).then(|| format!("the name of the file \"{}\" is not UTF-8", output.display()))
}

/// Starts the global thread pool with `jobs` threads, by default as many as the machine has, at most [`THREADS`].
#[cfg(feature = "parallel")]
fn pool(jobs: Option<usize>) -> Result<(), String> {
    if jobs == Some(0) {
        return Err("-j takes at least one thread".into());
    }
    let threads = jobs.or_else(|| std::thread::available_parallelism().map(std::num::NonZero::get).ok()).unwrap_or(1);
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads.min(THREADS))
        .build_global()
        .map_err(|e| format!("cannot start {threads} threads: {e}"))
}

/// Checks `jobs`; without the feature `parallel` everything runs on one thread.
#[cfg(not(feature = "parallel"))]
fn pool(jobs: Option<usize>) -> Result<(), String> {
    if jobs == Some(0) { Err("-j takes at least one thread".into()) } else { Ok(()) }
}
