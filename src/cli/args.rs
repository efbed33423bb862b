//! What can be typed.

use std::ffi::OsString;
use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};

use osier_base::limits::{LIMITS, Limits};

/// Printed below every long help.
pub const EXIT_CODES: &str = "\
Exit codes:
  0    done, also with nothing to do or only warnings
  1    input or run failed: faults in files, missing input, a limit, a foreign file in the way
  2    usage: unknown flag, bad flag value, no arguments
  3    --strict and there were warnings; outputs are complete
  74   reading or writing failed: disk full, no permission, closed pipe of -o -
  75   a retry may help: network or busy file systems
  101  internal error: please report it
  130  interrupted (Ctrl-C); finished files are kept, run again to go on
  143  terminated; likewise";

/// Ten lines for someone who typed nothing.
pub const GUIDE: &str = "\
osier turns small text files into plants and bakes them into files that Blender, POV-Ray, USD and glTF programs open.

  osier bake                         the showcase, complete and moving, into out/showcase
  osier grow oak -o oak.glb          one plant as one file; the ending picks the format
  osier preview oak                  a picture of it, out/oak.png
  osier list presets                 what there is to grow
  osier new mytree --from oak        a folder of your own to change
  osier bake mytree/mytree.toml      the scene you changed
  osier check mytree/mytree.toml     every fault in it, and what it would make
`osier COMMAND --help` tells the rest.
";

/// Grows plants from small text files and bakes them for other programs.
#[derive(Debug, Parser)]
#[command(name = "osier", version, about, after_long_help = EXIT_CODES, max_term_width = 100)]
#[command(disable_help_subcommand = true, propagate_version = true)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
    /// Flags of every command.
    #[command(flatten)]
    pub common: Common,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Simulate a scene and write all of its files.
    #[command(after_long_help = EXIT_CODES)]
    Bake(Bake),
    /// Write one still plant or scene as one file.
    #[command(after_long_help = EXIT_CODES)]
    Grow(Grow),
    /// Draw a picture, a contact sheet, a turntable or a moving picture.
    #[command(after_long_help = EXIT_CODES)]
    Preview(Preview),
    /// Show every fault of scenes and grammars, and what they would make.
    #[command(after_long_help = EXIT_CODES)]
    Check(Check),
    /// Show what exists: presets, scene keys, formats, codes, limits.
    #[command(after_long_help = EXIT_CODES)]
    List(List),
    /// Make a folder with a small working scene.
    #[command(after_long_help = EXIT_CODES)]
    New(New),
    /// Tell what an output holds, and check a bake against its manifest.
    #[command(after_long_help = EXIT_CODES)]
    Info(Info),
    /// Print completions of the command line for a shell.
    Completions(Completions),
    /// Print the manual page, as troff.
    Man,
}

/// `osier completions`.
#[derive(Debug, Args)]
pub struct Completions {
    /// The shell that is to complete.
    #[arg(value_enum)]
    pub shell: clap_complete::Shell,
}

/// `osier bake`.
#[derive(Debug, Args)]
pub struct Bake {
    /// Scene file or preset; without it the showcase.
    #[arg(value_name = "SCENE")]
    pub scene: Option<String>,
    /// Output folder [default: out/NAME].
    #[arg(short = 'o', long = "output", value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Write only these frames: 1-240, 1-240:10, 1,5,9.
    // Limits are named in one space with all other arguments, and one of them is `frames`.
    #[arg(id = "written-frames", long = "frames", value_name = "LIST")]
    pub frames: Option<String>,
    /// Write only these formats.
    #[arg(long, value_name = "LIST", help = format!("Write only these formats: {}", osier_export::registry::words()))]
    pub formats: Option<String>,
    /// Run the scene once for each value of a key, KEY=FROM:TO:COUNT or KEY=V,V, and write one table of what its [flight]
    /// came to, with a plot, into out/NAME-sweep; several for all their choices.
    #[arg(id = "swept-values", long = "sweep", value_name = "KEY=A:B:N")]
    pub sweep: Vec<String>,
    /// The same for seeds: 0-7.
    #[arg(id = "swept-seeds", long = "seeds", value_name = "LIST")]
    pub seeds: Option<String>,
    /// Overwrite files that osier did not write, and write more than 2 GB.
    #[arg(long)]
    pub force: bool,
}

/// `osier grow`.
#[derive(Debug, Args)]
pub struct Grow {
    /// Grammar (.l), scene (.toml) or preset.
    #[arg(value_name = "SOURCE")]
    pub source: String,
    /// File to write: .glb .gltf .usda .usdc .usdz .obj .ply .pov, or - for a glb on standard output.
    #[arg(short = 'o', long = "output", value_name = "FILE")]
    pub output: PathBuf,
    /// Derivation length instead of the grammar's.
    // Limits are named in one space with all other arguments, and one of them is `steps`.
    #[arg(id = "derivation-steps", long = "steps", value_name = "N")]
    pub steps: Option<u32>,
    /// Which readers a glb is made for.
    #[arg(long, value_enum, default_value = "blender")]
    pub profile: ProfileArg,
    /// Overwrite a file that osier did not write, and write more than 2 GB.
    #[arg(long)]
    pub force: bool,
}

/// Values of `--profile`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ProfileArg {
    /// Any Blender.
    Blender,
    /// Browsers and engines.
    Web,
}

/// `osier preview`.
#[derive(Debug, Args)]
pub struct Preview {
    /// Grammar (.l), scene (.toml), preset, mesh (.glb .gltf .obj) or the folder of a bake.
    #[arg(value_name = "SOURCE")]
    pub source: String,
    /// File to write [default: out/NAME.png, .gif for what moves]; .apng and .png also hold what moves.
    #[arg(short = 'o', long = "output", value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Pixels [default: 800x800; 320x320 for each picture of a sheet, 480x480 for what moves].
    #[arg(long, value_name = "WxH")]
    pub size: Option<String>,
    /// How much work goes into it.
    #[arg(long, value_enum, default_value = "normal")]
    pub quality: QualityArg,
    /// From where: portrait, front, back, left, right, top, scene (its own camera), or AZIMUTH,ELEVATION in degrees.
    #[arg(long, value_name = "VIEW", allow_hyphen_values = true)]
    pub view: Option<String>,
    /// Where the sun stands, degrees.
    #[arg(long, value_name = "ELEVATION,AZIMUTH", allow_hyphen_values = true)]
    pub sun: Option<String>,
    /// What lies behind: auto, sky, studio, none (transparent), or a colour such as #f4f1ea.
    #[arg(long, value_name = "WHAT")]
    pub background: Option<String>,
    /// One frame of a moving scene.
    #[arg(long, value_name = "N")]
    pub frame: Option<u32>,
    /// A moving picture of these frames: 1-72, 1-72:2.
    // Limits are named in one space with all other arguments, and one of them is `frames`.
    #[arg(id = "shown-frames", long = "frames", value_name = "LIST")]
    pub frames: Option<String>,
    /// A moving picture that goes once round, in N steps.
    #[arg(long, value_name = "N", num_args = 0..=1, default_missing_value = "48", value_parser = clap::value_parser!(u32).range(1..=3600))]
    pub turntable: Option<u32>,
    /// A contact sheet of these seeds: 0-15.
    #[arg(long, value_name = "LIST")]
    pub seeds: Option<String>,
    /// A contact sheet of a key's values: KEY=FROM:TO:COUNT or KEY=V,V; a second one runs down.
    #[arg(long, value_name = "KEY=A:B:N")]
    pub sweep: Vec<String>,
    /// Pictures in a row of a sheet.
    #[arg(long, value_name = "N")]
    pub columns: Option<u32>,
    /// Another source, shown beside the first with the same camera.
    #[arg(long, value_name = "SOURCE")]
    pub compare: Option<String>,
    /// Derivation length instead of the grammar's.
    #[arg(id = "preview-steps", long = "steps", value_name = "N")]
    pub steps: Option<u32>,
    /// Overwrite a file that osier did not write.
    #[arg(long)]
    pub force: bool,
}

/// Values of `--quality`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum QualityArg {
    /// A glance, sun and shadow only: for shapes.
    Draft,
    /// For every day.
    Normal,
    /// For keeping.
    Fine,
}

/// `osier check`.
#[derive(Debug, Args)]
pub struct Check {
    /// Scenes, grammars or presets.
    #[arg(value_name = "FILE", required = true)]
    pub files: Vec<String>,
}

/// `osier list`.
#[derive(Debug, Args)]
pub struct List {
    /// What to list.
    #[arg(value_enum, default_value = "presets")]
    pub what: What,
    /// With `options`: only keys in whose name, table or help all of these words occur. With `knobs`: the scene or grammar.
    #[arg(value_name = "WORD")]
    pub words: Vec<String>,
}

/// What can be listed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum What {
    /// Grammars and scenes in the program.
    Presets,
    /// Keys of scene files.
    Options,
    /// The #defines of a scene's grammars, with their values and what they say of themselves: osier list knobs oak.
    Knobs,
    /// File formats.
    Formats,
    /// Codes of faults.
    Codes,
    /// Limits and the flags that change them.
    Limits,
}

/// `osier new`.
#[derive(Debug, Args)]
pub struct New {
    /// Folder to make; its last part names the scene.
    #[arg(value_name = "NAME")]
    pub name: PathBuf,
    /// Preset to start from.
    #[arg(long, value_name = "PRESET", default_value = "oak")]
    pub from: String,
}

/// `osier info`.
#[derive(Debug, Args)]
pub struct Info {
    /// A bake's folder, or one file of it.
    #[arg(value_name = "PATH")]
    pub path: PathBuf,
}

/// Flags of every command.
#[derive(Debug, Args)]
#[command(next_help_heading = "Common flags")]
pub struct Common {
    /// Seed of every random draw: another whole number, another individual.
    #[arg(long, value_name = "N", global = true)]
    pub seed: Option<u64>,
    /// Change a key of the scene, or a #define of a bare grammar: wind.speed=6, angle=30.
    #[arg(long, value_name = "PATH=VALUE", global = true)]
    pub set: Vec<String>,
    /// Look for referenced files in this folder as well.
    #[arg(long, value_name = "DIR", global = true)]
    pub search: Vec<PathBuf>,
    /// Threads [default: all that the system allows].
    #[arg(short = 'j', long = "jobs", value_name = "N", global = true)]
    pub jobs: Option<usize>,
    /// Only say what would be made.
    #[arg(short = 'n', long, global = true)]
    pub dry_run: bool,
    /// Print the result as JSON.
    #[arg(long, global = true)]
    pub json: bool,
    /// Say nothing but errors.
    #[arg(short = 'q', long, global = true)]
    pub quiet: bool,
    /// Say more.
    #[arg(short = 'v', long, global = true)]
    pub verbose: bool,
    /// Colours on the terminal.
    #[arg(long, value_enum, value_name = "WHEN", default_value = "auto", global = true)]
    pub color: Color,
    /// Exit with 3 if there were warnings.
    #[arg(long, global = true)]
    pub strict: bool,
    /// Limits that were changed.
    #[command(flatten)]
    pub max: MaxFlags,
}

/// Values of `--color`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Color {
    /// On terminals.
    Auto,
    /// Also into files and pipes.
    Always,
    /// Nowhere.
    Never,
}

/// One `--max-NAME VALUE` per limit; `osier list limits` shows them.
#[derive(Debug, Clone, Default)]
pub struct MaxFlags(pub Vec<(&'static str, String)>);

impl Args for MaxFlags {
    fn augment_args(cmd: clap::Command) -> clap::Command {
        LIMITS.iter().fold(cmd, |cmd, limit| {
            let name = format!("max-{}", limit.name);
            cmd.arg(clap::Arg::new(limit.name).long(name).value_name("N").hide(true).global(true))
        })
    }

    fn augment_args_for_update(cmd: clap::Command) -> clap::Command {
        Self::augment_args(cmd)
    }
}

impl clap::FromArgMatches for MaxFlags {
    fn from_arg_matches(matches: &clap::ArgMatches) -> Result<Self, clap::Error> {
        let given = |name: &'static str| matches.get_one::<String>(name).map(|v| (name, v.clone()));
        Ok(Self(LIMITS.iter().filter_map(|l| given(l.name)).collect()))
    }

    fn update_from_arg_matches(&mut self, matches: &clap::ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

/// A short file of the system; empty if there is none.
fn system_text(file: &str) -> String {
    let bytes = osier_base::files::read_input(std::path::Path::new(file), 1 << 16).unwrap_or_default();
    String::from_utf8_lossy(&bytes).into_owned()
}

impl Common {
    /// Limits in force: flags over `OSIER_MAX=name=value,...` over defaults.
    /// # Errors
    /// What is wrong with a flag or with the variable.
    pub fn limits(&self, environment: Option<OsString>) -> Result<Limits, String> {
        let [machine, container] = ["/proc/meminfo", "/sys/fs/cgroup/memory.max"].map(system_text);
        let mut limits = Limits::of_machine(&machine, &container).within_process(&system_text("/proc/self/limits"));
        let text = environment.map(|v| v.to_string_lossy().into_owned()).unwrap_or_default();
        for part in text.split(',').filter(|p| !p.is_empty()) {
            let (name, value) = part.split_once('=').ok_or(format!("OSIER_MAX: \"{part}\" is not name=value"))?;
            limits.set(name, value).map_err(|e| format!("OSIER_MAX: {e}"))?;
        }
        for (name, value) in &self.max.0 {
            limits.set(name, value).map_err(|e| format!("--max-{name}: {e}"))?;
        }
        Ok(limits)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory as _;

    #[test]
    fn the_definition_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn flags_and_limits_of_one_name_stay_apart() {
        let frames = ["osier", "bake", "--frames", "1-2", "--max-frames", "7"];
        let cli = Cli::try_parse_from(frames).expect("flags");
        assert_eq!(cli.common.limits(None).expect("limits").get("frames"), 7);
        let steps = ["osier", "grow", "oak", "-o", "oak.glb", "--steps", "5", "--max-steps", "9"];
        let cli = Cli::try_parse_from(steps).expect("flags");
        assert_eq!(cli.common.limits(None).expect("limits").get("steps"), 9);
    }

    #[test]
    fn limits_come_from_flags_before_the_environment() {
        let cli = Cli::try_parse_from(["osier", "bake", "--max-modules", "3k"]).expect("flags");
        let limits = cli.common.limits(Some("modules=1M,frames=10".into())).expect("limits");
        assert_eq!((limits.get("modules"), limits.get("frames")), (3000, 10));
        assert!(cli.common.limits(Some("wishes=3".into())).is_err());
    }
}
