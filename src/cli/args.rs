//! Commands and flags of the program.

use std::ffi::OsString;
use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};

use osier_base::limits::{LIMITS, Limits, control_group_files};

/// Table of exit codes, printed below every long help.
pub const EXIT_CODES: &str = "\
Exit codes:
  0    success, also with warnings or with nothing to do
  1    input or run failed: faults in files, missing input, a limit, a foreign file in the way
  2    wrong usage: unknown flag, bad value of a flag, no arguments, over 2 GB without --force
  3    warnings under --strict; the output is complete
  74   reading or writing failed: disk full, no permission, closed pipe of -o -
  75   a temporary failure, try again: network or busy file systems
  101  internal error: please report it
  130  interrupted (Ctrl-C); a bake keeps its finished files, run it again to continue
  143  terminated; likewise";

/// Printed when the program is called without arguments.
pub const GUIDE: &str = "\
osier turns small text files into plants and bakes them into files that Blender, POV-Ray, USD and glTF programs open.

  osier bake                         the showcase, complete and moving, into out/showcase
  osier grow oak -o oak.glb          one plant as one file; the ending picks the format
  osier preview oak                  a picture of it into out/oak.png
  osier list presets                 the plants and scenes in the program
  osier new mytree --from oak        a folder of your own to change
  osier bake mytree/mytree.toml      the scene you changed
  osier check mytree/mytree.toml     every fault in it, and an estimate of its bake
`osier COMMAND --help` describes the flags of a command.
";

/// Grows plants from small text files and bakes them for other programs.
#[derive(Debug, Parser)]
#[command(name = "osier", version, about, after_long_help = EXIT_CODES, max_term_width = 100)]
#[command(disable_help_subcommand = true, propagate_version = true)]
pub struct Cli {
    #[command(subcommand)]
    pub command: Command,
    #[command(flatten)]
    pub common: Common,
}

/// The command, with its own flags.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Simulate a scene and write all of its files.
    #[command(after_long_help = EXIT_CODES)]
    Bake(Bake),
    /// Write one still plant or scene as one file.
    #[command(after_long_help = EXIT_CODES)]
    Grow(Grow),
    /// Render a picture, a contact sheet, a turntable or a clip.
    #[command(after_long_help = EXIT_CODES)]
    Preview(Preview),
    /// Report every fault of scenes and grammars, and estimate their bakes.
    #[command(after_long_help = EXIT_CODES)]
    Check(Check),
    /// Write a grammar of Fractint, LParser or L-Py in the notation of cpfg.
    #[command(after_long_help = EXIT_CODES)]
    Convert(Convert),
    /// List presets, species, scene keys, parameters of grammars, formats, codes or limits.
    #[command(after_long_help = EXIT_CODES)]
    List(List),
    /// Create a folder with a small working scene.
    #[command(after_long_help = EXIT_CODES)]
    New(New),
    /// Describe the files of a bake, and verify them against its manifest.
    #[command(after_long_help = EXIT_CODES)]
    Info(Info),
    /// Print shell completions.
    Completions(Completions),
    /// Print the manual page in troff.
    Man,
}

/// Arguments of `osier completions`.
#[derive(Debug, Args)]
pub struct Completions {
    /// Shell to complete for.
    #[arg(value_enum)]
    pub shell: clap_complete::Shell,
}

/// Arguments of `osier bake`.
#[derive(Debug, Args)]
pub struct Bake {
    /// Scene file or preset [default: showcase].
    #[arg(value_name = "SCENE")]
    pub scene: Option<String>,
    /// Output folder [default: out/NAME].
    #[arg(short = 'o', long = "output", value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Write only these frames: 1-240, 1-240:10, 1,5,9.
    // The id differs from the flag, as every limit is an argument too and one of them is named
    // `frames`.
    #[arg(id = "written-frames", long = "frames", value_name = "LIST")]
    pub frames: Option<String>,
    /// Write only these formats.
    #[arg(long, value_name = "LIST", help = format!("Write only these formats: {}", osier_export::registry::words()))]
    pub formats: Option<String>,
    /// Run the scene for each value of a key, KEY=FROM:TO:COUNT or KEY=V,V, and write the statistics of its [flight]
    /// as one table with a plot into out/NAME-sweep. Several flags run all combinations.
    #[arg(id = "swept-values", long = "sweep", value_name = "KEY=A:B:N")]
    pub sweep: Vec<String>,
    /// Run the scene for each of these seeds, as --sweep does: 0-7.
    #[arg(id = "swept-seeds", long = "seeds", value_name = "LIST")]
    pub seeds: Option<String>,
    /// Progress on standard error: a bar or lines of text, or a line of JSON for each step, warning and error.
    #[arg(long, value_enum, value_name = "HOW", default_value = "text")]
    pub progress: ProgressArg,
    /// Overwrite files that osier did not write, and write more than 2 GB.
    #[arg(long)]
    pub force: bool,
}

/// Values of `--progress`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ProgressArg {
    /// For people.
    Text,
    /// For programs.
    Json,
}

/// Arguments of `osier grow`.
#[derive(Debug, Args)]
pub struct Grow {
    /// Grammar (.l .ls .lpy), scene (.toml), species (.species), particle-shapes (.shapes), coefficient table (.ifs .flame) or preset.
    #[arg(value_name = "SOURCE")]
    pub source: String,
    /// File to write: .glb .gltf .usda .usdc .usdz .obj .ply .pov, .txt for the string of a grammar, .png .exr .ifs .flame for a
    /// coefficient table, or - for a glb on standard output.
    #[arg(short = 'o', long = "output", value_name = "FILE")]
    pub output: PathBuf,
    /// Derivation length in place of that of the grammar; a fraction draws a part of the last step.
    // The id differs from the flag, as every limit is an argument too and one of them is named
    // `steps`.
    #[arg(id = "derivation-steps", long = "steps", value_name = "N", value_parser = read_steps)]
    pub steps: Option<f64>,
    /// Programs that a glb is written for.
    #[arg(long, value_enum, default_value = "blender")]
    pub profile: ProfileArg,
    /// Overwrite a file that osier did not write, and write more than 2 GB.
    #[arg(long)]
    pub force: bool,
}

/// Values of `--profile`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ProfileArg {
    /// Blender.
    Blender,
    /// Browsers and other viewers; for game engines bake profile engine.
    Web,
}

/// Arguments of `osier preview`.
#[derive(Debug, Args)]
pub struct Preview {
    /// Grammar (.l .ls .lpy), scene (.toml), species (.species), particle-shapes (.shapes), coefficient table (.ifs .flame), preset,
    /// mesh (.glb .gltf .obj) or folder of a bake.
    #[arg(value_name = "SOURCE")]
    pub source: String,
    /// File to write, or - for standard output [default: out/NAME.png, out/NAME.gif for a clip]; a clip may also be .apng or
    /// .png; NAME_####.png writes a picture for each frame.
    #[arg(short = 'o', long = "output", value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Width and height in pixels [default: 800x800; 320x320 per picture of a contact sheet, 480x480 for a clip].
    #[arg(long, value_name = "WxH")]
    pub size: Option<String>,
    /// Trade-off between speed and noise.
    #[arg(long, value_enum, default_value = "normal")]
    pub quality: QualityArg,
    /// Camera: portrait, front, back, left, right, top, scene (the camera of the scene), or AZIMUTH,ELEVATION in
    /// degrees.
    #[arg(long, value_name = "VIEW", allow_hyphen_values = true)]
    pub view: Option<String>,
    /// Direction from which the sun shines, degrees: 0 is +X, 90 is -Z.
    #[arg(long, value_name = "ELEVATION,DIRECTION", allow_hyphen_values = true)]
    pub sun: Option<String>,
    /// Background: auto, sky, studio, none (transparent), or a colour such as #f4f1ea.
    #[arg(long, value_name = "WHAT")]
    pub background: Option<String>,
    /// Render this frame of an animated scene, which else has a single frame without wind.
    #[arg(long, value_name = "N")]
    pub frame: Option<u32>,
    /// Render a clip of these frames: 1-72, 1-72:2.
    // The id differs from the flag, as every limit is an argument too and one of them is named
    // `frames`.
    #[arg(id = "shown-frames", long = "frames", value_name = "LIST")]
    pub frames: Option<String>,
    /// Render a clip in which the camera goes once round the subject, in N steps.
    #[arg(long, value_name = "N", num_args = 0..=1, default_missing_value = "48", value_parser = clap::value_parser!(u32).range(1..=3600))]
    pub turntable: Option<u32>,
    /// Render a contact sheet of these seeds: 0-15.
    #[arg(long, value_name = "LIST")]
    pub seeds: Option<String>,
    /// Render a contact sheet of values of a key: KEY=FROM:TO:COUNT or KEY=V,V. A second --sweep runs down the sheet.
    #[arg(long, value_name = "KEY=A:B:N")]
    pub sweep: Vec<String>,
    /// Columns of a contact sheet.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub columns: Option<u32>,
    /// Render another source beside the first, at the same scale.
    #[arg(long, value_name = "SOURCE")]
    pub compare: Option<String>,
    /// Derivation length in place of that of the grammar; a fraction draws a part of the last step.
    #[arg(id = "preview-steps", long = "steps", value_name = "N", value_parser = read_steps)]
    pub steps: Option<f64>,
    /// Overwrite a file that osier did not write.
    #[arg(long)]
    pub force: bool,
}

/// Values of `--quality`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum QualityArg {
    /// One sample per pixel, not ray traced, sky light estimated: to judge shapes.
    Draft,
    /// 3 to 24 samples per pixel: for everyday use.
    Normal,
    /// 32 to 192 samples per pixel: for final pictures.
    Fine,
}

/// Arguments of `osier check`.
#[derive(Debug, Args)]
pub struct Check {
    /// Scenes, grammars, species, particle-shapes, coefficient tables or presets.
    #[arg(value_name = "FILE", required = true)]
    pub files: Vec<String>,
    /// Also print the string that each grammar derives, as cpfg prints it.
    #[arg(long)]
    pub string: bool,
}

/// Arguments of `osier convert`.
#[derive(Debug, Args)]
pub struct Convert {
    /// Grammar, or FILE#ENTRY for one L-system of a file of Fractint.
    #[arg(value_name = "FILE")]
    pub file: String,
    /// Commands of cpfg, or those of the other program (`turtle: fractint`, `turtle: lparser`).
    #[arg(long, value_enum, value_name = "WHAT", default_value = "osier")]
    pub to: ConvertArg,
    /// File to write [default: standard output].
    #[arg(short = 'o', long = "output", value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Overwrite a file that osier did not write.
    #[arg(long)]
    pub force: bool,
}

/// Values of `--to`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ConvertArg {
    /// The commands of cpfg alone.
    Cpfg,
    /// The commands of the other program.
    Osier,
}

/// Arguments of `osier list`.
#[derive(Debug, Args)]
pub struct List {
    /// What to list.
    #[arg(value_enum, default_value = "presets")]
    pub what: What,
    /// With `options`, `presets` and `species`: only those in whose name or description each of these begins a word. With `knobs`: the
    /// scene or grammar. With `entries`: the files. With `codes`: codes, or the letters with which they begin.
    #[arg(value_name = "WORD")]
    pub words: Vec<String>,
    /// With `presets`: also draw a small picture of each into this folder.
    #[arg(long, value_name = "DIR")]
    pub thumbnails: Option<PathBuf>,
}

/// Values of the first argument of `osier list`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum What {
    /// Grammars, scenes, coefficient tables and meshes in the program.
    Presets,
    /// Trees that grow year by year, with the scenes that show them.
    Species,
    /// Keys of scene files.
    Options,
    /// Parameters (#defines) of the grammars of a scene, with their values and comments: osier list knobs oak.
    Knobs,
    /// L-systems of a file that holds several: osier list FILE.l.
    Entries,
    /// File formats.
    Formats,
    /// Codes of errors and warnings.
    Codes,
    /// Limits and the flags that change them.
    Limits,
}

/// Arguments of `osier new`.
#[derive(Debug, Args)]
pub struct New {
    /// Folder to create; the last part of its path names the scene.
    #[arg(value_name = "NAME")]
    pub name: PathBuf,
    /// Preset to copy.
    #[arg(long, value_name = "PRESET", default_value = "oak")]
    pub from: String,
    /// Copy the grammar of the library that fits these words best, with its scene: daisy, "white umbels", curve.
    #[arg(long, value_name = "WORDS", conflicts_with = "from")]
    pub grammar: Option<String>,
}

/// Arguments of `osier info`.
#[derive(Debug, Args)]
pub struct Info {
    /// Folder of a bake, one file of it, a mesh, a grammar, any other file, or a preset.
    #[arg(value_name = "PATH")]
    pub path: PathBuf,
}

/// Flags that every command accepts.
#[derive(Debug, Args)]
#[command(next_help_heading = "Common flags")]
pub struct Common {
    /// Seed of all random draws; each whole number gives another individual.
    #[arg(long, value_name = "N", global = true, allow_negative_numbers = true, value_parser = read_seed)]
    pub seed: Option<u64>,
    /// Override a key of the scene, or a #define of a bare grammar: wind.speed=6, angle=30.
    #[arg(long, value_name = "PATH=VALUE", global = true)]
    pub set: Vec<String>,
    /// Notation of a grammar, where its content does not tell: cpfg, abop, catkin, fractint, lparser, lpy.
    #[arg(long, value_name = "NAME", global = true)]
    pub dialect: Option<String>,
    /// How a grammar draws random numbers: osier, or cpfg to get the strings of that program.
    #[arg(long, value_name = "NAME", global = true)]
    pub rng: Option<String>,
    /// Also look up referenced files in this folder.
    #[arg(long, value_name = "DIR", global = true)]
    pub search: Vec<PathBuf>,
    /// Threads [default: all available].
    #[arg(short = 'j', long = "jobs", value_name = "N", global = true)]
    pub jobs: Option<usize>,
    /// Print an estimate and write nothing.
    #[arg(short = 'n', long, global = true)]
    pub dry_run: bool,
    /// Print the result as JSON.
    #[arg(long, global = true)]
    pub json: bool,
    /// Print errors only.
    #[arg(short = 'q', long, global = true)]
    pub quiet: bool,
    /// Print more detail.
    #[arg(short = 'v', long, global = true)]
    pub verbose: bool,
    /// Use of colours.
    #[arg(long, value_enum, value_name = "WHEN", default_value = "auto", global = true)]
    pub color: Color,
    /// Exit with code 3 if there were warnings.
    #[arg(long, global = true)]
    pub strict: bool,
    #[command(flatten)]
    pub max: MaxFlags,
}

/// The seed that a text means; the error completes clap's "invalid value 'x' for '--seed <N>': ".
fn read_steps(text: &str) -> Result<f64, String> {
    let steps = text.parse().ok().filter(|steps| (0.0..=1e6).contains(steps));
    steps.ok_or_else(|| "a number of steps is 0 to 1,000,000".to_owned())
}

fn read_seed(text: &str) -> Result<u64, String> {
    text.parse().map_err(|_| format!("a seed is a whole number from 0 to {}", u64::MAX))
}

/// Values of `--color`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Color {
    /// On terminals.
    Auto,
    /// Also in files and pipes.
    Always,
    /// Never.
    Never,
}

/// The flags `--max-NAME VALUE`, one per limit, as they were given; help hides them and `osier list limits` shows them.
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

/// Content of a short file of the system; empty if it cannot be read.
fn system_text(file: &str) -> String {
    let bytes = osier_base::files::read_input(std::path::Path::new(file), 1 << 16, "").unwrap_or_default();
    String::from_utf8_lossy(&bytes).into_owned()
}

impl Common {
    /// Limits in force: flags override `OSIER_MAX=name=value,...`, which overrides the defaults of this machine.
    /// # Errors
    /// A message for a flag or a variable that cannot be read.
    pub fn limits(&self, environment: Option<OsString>) -> Result<Limits, String> {
        // The smallest of three bounds: memory of the machine, of its control groups, and address space of the process.
        let groups = control_group_files(&system_text("/proc/self/cgroup"));
        let container: Vec<String> = groups.iter().map(|file| system_text(file)).collect();
        let machine = Limits::of_machine(&system_text("/proc/meminfo"), &container.join("\n"));
        let mut limits = machine.within_process(&system_text("/proc/self/limits"));
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
