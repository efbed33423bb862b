//! Presets: grammars, scenes, coefficient tables and meshes that are part of the library.
//!
//! ```
//! let preset = osier::presets::find("oak.l").expect("a preset");
//! assert!(preset.text.contains("Axiom") && !osier::presets::about(preset).is_empty());
//! ```

/// A file that is part of the library.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Preset {
    /// File name with ending, such as `oak.l`.
    pub name: &'static str,
    /// Content of the file.
    pub text: &'static str,
}

macro_rules! presets {
    ($($folder:literal / $name:literal),* $(,)?) => {
        &[$(Preset { name: $name, text: include_str!(concat!("../", $folder, "/", $name)) }),*]
    };
}

/// All presets, sorted by file name.
pub const PRESETS: &[Preset] = presets! {
    "ifs-tables" / "as_printed.ifs",
    "grammars" / "bamboo.l",
    "scenes" / "bamboo.toml",
    "ifs-tables" / "bamboo_leaf.ifs",
    "ifs-tables" / "bamboo_node.ifs",
    "scenes" / "birch-wood.toml",
    "grammars" / "birch.l",
    "scenes" / "birch.toml",
    "grammars" / "catkin.l",
    "scenes" / "catkin.toml",
    "scenes" / "catkins-air.toml",
    "scenes" / "catkins-ground.toml",
    "scenes" / "catkins-sky.toml",
    "scenes" / "catkins-street.toml",
    "scenes" / "catkins-wall.toml",
    "scenes" / "fern-morph.toml",
    "ifs-tables" / "fern_bud.ifs.toml",
    "ifs-tables" / "fern_frond.ifs.toml",
    "ifs-tables" / "fern_half.ifs.toml",
    "ifs-tables" / "fern_leaf.ifs",
    "scenes" / "fig9.toml",
    "grammars" / "grass.l",
    "scenes" / "grass.toml",
    "ifs-tables" / "gray_tree.ifs",
    "ifs-tables" / "green_tree.ifs",
    "scenes" / "gusty-tree.toml",
    "ifs-tables" / "hill.ifs",
    "grammars" / "koch.l",
    "scenes" / "landscape.toml",
    "scenes" / "meadow.toml",
    "ifs-tables" / "monopodial.ifs",
    "ifs-tables" / "monopodial.ifs.toml",
    "grammars" / "oak.l",
    "scenes" / "oak.toml",
    "ifs-tables" / "palm_tree.ifs",
    "scenes" / "pole.toml",
    "grammars" / "poplar-twig.l",
    "scenes" / "poplar-twig.toml",
    "ifs-tables" / "pseudodichotomous.ifs",
    "ifs-tables" / "pseudodichotomous.ifs.toml",
    "scenes" / "rain-leaves.toml",
    "scenes" / "rain-table-1.toml",
    "scenes" / "rain-table-2.toml",
    "scenes" / "rain-table-3.toml",
    "grammars" / "rain-twig.l",
    "scenes" / "showcase.toml",
    "grammars" / "silk-tree.l",
    "scenes" / "silk-tree.toml",
    "scenes" / "struck-twig.toml",
    "ifs-tables" / "sun.ifs",
    "ifs-tables" / "sympodial.ifs",
    "ifs-tables" / "sympodial.ifs.toml",
    "scenes" / "wet-leaf.toml",
    "scenes" / "wind-twig.toml",
    "meshes" / "young-tree.obj",
    "scenes" / "young-tree.toml",
};

/// The preset with exactly this file name, ending included.
pub fn find(name: &str) -> Option<&'static Preset> {
    PRESETS.iter().find(|p| p.name == name)
}

/// Description of a preset for listings: the first line of its leading comment.
pub fn about(preset: &Preset) -> String {
    let line = preset.text.lines().find(|l| !l.trim().is_empty()).unwrap_or_default();
    line.trim_start_matches(['#', '/', '*', ';', ' ']).trim_end_matches(['*', '/', ' ']).to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_file_of_the_folders_is_in_the_binary() {
        assert!(PRESETS.windows(2).all(|w| w[0].name < w[1].name), "sorted");
        let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
        for folder in ["grammars", "scenes", "ifs-tables", "meshes"] {
            for entry in std::fs::read_dir(root.join(folder)).expect("folder") {
                let name = entry.expect("entry").file_name().to_string_lossy().into_owned();
                assert!(find(&name).is_some(), "{folder}/{name} is not listed in presets.rs");
            }
        }
        for p in PRESETS {
            assert!(!about(p).is_empty(), "{} begins with a comment that says what it is", p.name);
        }
    }
}
