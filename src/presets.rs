//! Presets: grammars, scenes, coefficient tables and meshes that are part of the library.
//!
//! ```
//! let preset = osier::presets::find("oak.l").expect("a preset");
//! assert!(preset.text.contains("Axiom") && !osier::presets::about(preset).is_empty());
//! ```

/// A file that is compiled into the program, so that scenes can refer to it by its bare name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Preset {
    /// File name with ending, such as `oak.l`.
    pub name: &'static str,
    /// Whole text of the file, comments included.
    pub text: &'static str,
}

/// All presets, sorted by file name. `build.rs` lists them: the files of `grammars`, `ifs-tables`, `meshes`, `scenes`, `shapes`
/// and `species`.
pub const PRESETS: &[Preset] = include!(concat!(env!("OUT_DIR"), "/presets.rs"));

/// The preset with exactly this file name, ending included.
pub fn find(name: &str) -> Option<&'static Preset> {
    PRESETS.iter().find(|p| p.name == name)
}

/// Other English names of species, with the name that osier has for them.
const OTHER_NAMES: [(&str, &str); 3] = [("lime", "linden"), ("basswood", "linden"), ("filbert", "hazel")];

/// The species that an English name means which osier does not use: `linden` for `lime`. `name`: without an ending, in any case.
pub fn other_name(name: &str) -> Option<&'static str> {
    OTHER_NAMES.iter().find(|(other, _)| other.eq_ignore_ascii_case(name)).map(|(_, species)| *species)
}

/// Description of a preset for listings: the first line of its leading comment, and of a block comment (`/* .. */`) that breaks
/// its first sentence also the rest of that.
pub fn about(preset: &Preset) -> String {
    let bare =
        |line: &'static str| line.trim_start_matches(['#', '/', '*', ';', ' ']).trim_end_matches(['*', '/', ' ']);
    let mut lines = preset.text.lines().skip_while(|l| l.trim().is_empty());
    let first = lines.next().unwrap_or_default();
    let mut text = bare(first).to_owned();
    let mut goes_on = first.starts_with("/*") && !first.contains("*/");
    while goes_on && !text.ends_with('.') {
        let line = lines.next().unwrap_or("*/");
        // A point within a number ends no sentence.
        let sentence = bare(line).split_inclusive(". ").next().unwrap_or_default();
        text = format!("{text} {sentence}").trim_end().to_owned();
        goes_on = !line.contains("*/");
    }
    text
}

/// Kind of a preset by its file and by other presets of its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PresetKind {
    /// A scene of one plant with the name of the grammar, particle-shapes or species that grows it.
    Species,
    /// A scene of several plants, or of none.
    Scene,
    /// A grammar that scenes can grow.
    Grammar,
    /// Coefficients of iterated function systems.
    IfsTable,
    /// A mesh (`.obj`, `.glb` or `.gltf`) that plants, organs and solids can name.
    Mesh,
    /// Parameters of particle-shapes that scenes can grow.
    Shapes,
    /// Habit of a species that scenes grow year by year.
    Habit,
}

impl PresetKind {
    /// Name of this kind in the JSON of `osier list presets`.
    pub fn word(self) -> &'static str {
        match self {
            Self::Species => "species",
            Self::Scene => "scene",
            Self::Grammar => "grammar",
            Self::IfsTable => "ifs_table",
            Self::Mesh => "mesh",
            Self::Shapes => "shapes",
            Self::Habit => "habit",
        }
    }
}

/// Kind of a preset, by its ending and by whether other presets have its name.
pub fn kind(preset: &Preset) -> PresetKind {
    let (stem, ending) = preset.name.split_once('.').unwrap_or((preset.name, ""));
    match ending {
        "l" => PresetKind::Grammar,
        "shapes" => PresetKind::Shapes,
        "species" => PresetKind::Habit,
        "toml" if ["l", "shapes", "species"].iter().any(|e| find(&format!("{stem}.{e}")).is_some()) => {
            PresetKind::Species
        }
        "toml" => PresetKind::Scene,
        "obj" | "glb" | "gltf" => PresetKind::Mesh,
        _ => PresetKind::IfsTable,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_file_of_the_folders_is_in_the_binary() {
        assert!(PRESETS.windows(2).all(|w| w[0].name < w[1].name), "sorted");
        let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
        for folder in ["grammars", "scenes", "ifs-tables", "meshes", "shapes", "species"] {
            for entry in std::fs::read_dir(root.join(folder)).expect("folder") {
                let name = entry.expect("entry").file_name().to_string_lossy().into_owned();
                assert!(find(&name).is_some(), "{folder}/{name} is not among the presets");
            }
        }
        for p in PRESETS {
            let about = about(p);
            assert!(!about.is_empty(), "{} begins with a comment that says what it is", p.name);
            assert!(about.ends_with(['.', ')']), "{} is described by half a sentence: {about}", p.name);
        }
    }
}
