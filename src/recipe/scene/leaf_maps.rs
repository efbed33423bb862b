//! `[maps]`: maps of wet leaves.

use crate::recipe::Recipe;
use crate::recipe::resolve::Resolver;
use crate::recipe::syntax::KeyTable;
use crate::recipe::syntax::keys;
use crate::recipe::syntax::{BooleanType, TomlTable, integer, number};
use osier_base::diagnostic::Diagnostic;
use osier_export::exr::{ATLAS, BORDER};

keys! {
    /// Texture maps of leaves in rain: height, wetness and normals, one file per leaf and frame.
    LeafMapKeys at "maps" {
        /// Largest number of texels along a side of a map.
        resolution: u32 = "resolution" integer(512, 32, 8192);
        /// Texels of a map per pixel of the camera's picture: leaves far from the camera get smaller maps.
        texels_per_pixel: f64 = "texels_per_pixel" number(2.0, 0.1, 1000.0, "");
        /// Height of the value 1 of a height map; greater heights are clamped.
        height_range: f64 = "height_range_m" number(0.004, 1e-4, 0.1, "m");
        /// Largest number of leaves with maps, nearest to the camera first; other leaves have drops only.
        max_mapped_leaves: u32 = "max_mapped_leaves" integer(32, 0, 512);
        /// Whether the maps of all leaves are also written as atlases of 4096 texels a side.
        atlas: bool = "atlas" BooleanType(false);
        /// Whether the height of the water is also written as a map of its own.
        water: bool = "water" BooleanType(false);
    }
}

impl Resolver<'_> {
    /// Reads `[maps]`; S004 if a leaf's maps do not fit into an atlas.
    pub(in crate::recipe) fn maps(&mut self, root: &TomlTable) -> LeafMapKeys {
        let keys: LeafMapKeys = self.section(root, "maps");
        // Each leaf in an atlas has a border that separates it from its neighbours.
        let most = ATLAS - 2 * BORDER;
        if keys.atlas && keys.resolution as usize > most {
            let span = self.place_of(root, &["maps", "resolution"]);
            let text = format!("maps.resolution is {}, but with atlas must be at most {most}", keys.resolution);
            let d = Diagnostic::error("S004", text, span, "larger than an atlas");
            self.report.push(d.help("lower the resolution, or leave out `atlas = true`"));
        }
        keys
    }
}

impl Recipe {
    /// Whether some key of `[maps]` differs from its default. Scenes without such keys keep the hash from before the table
    /// existed.
    pub(in crate::recipe) fn asks_for_maps(&self) -> bool {
        self.maps != LeafMapKeys::defaults()
    }
}

#[cfg(test)]
mod tests {
    use crate::recipe::{Recipe, Request, resolve};
    use osier_base::{Error, Result};

    fn read(text: &str) -> Result<Recipe> {
        let text = format!("[[rod]]\npoints = [[0, 0, 0], [0, 1, 0]]\n{text}");
        resolve(&Request { name: "maps".into(), shown: "maps.toml".into(), text, ..Request::default() }).map(|r| r.0)
    }

    #[test]
    fn maps_have_defaults_and_count_in_the_hash_where_asked_for() {
        let (plain, said) = (read("").expect("plain"), read("[maps]\nwater = true\n").expect("said"));
        assert_eq!((plain.maps.resolution, plain.maps.max_mapped_leaves, plain.maps.water), (512, 32, false));
        assert!(said.maps.water && said.hash != plain.hash);
        assert_eq!(plain.hash, read("[maps]\nresolution = 512\n").expect("default").hash);
    }

    #[test]
    fn a_map_that_no_atlas_holds_is_refused() {
        let Err(Error::Input(report)) = read("[maps]\natlas = true\nresolution = 4093\n") else { panic!("accepted") };
        assert!(report.to_string().contains("with atlas must be at most 4092"), "{report}");
        assert!(read("[maps]\natlas = true\nresolution = 4092\n").is_ok());
    }
}
