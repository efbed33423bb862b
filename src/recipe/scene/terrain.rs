//! `[terrain]`: land with hills.

use super::ScatterKeys;
use crate::recipe::resolve::Resolver;
use crate::recipe::syntax::keys;
use crate::recipe::syntax::{
    BooleanType, ColorType, NumberArray, OptionalKey, PowerOfTwo, SeedType, TomlNode, TomlTable, TomlValue, degrees,
    integer, number, wrong,
};
use crate::recipe::{PlantRecipe, ScatterRecipe};
use osier_base::diagnostic::{Diagnostic, Span, nearest};
use osier_import::GreyImage;
use osier_scene::MaterialClass;

keys! {
    /// Terrain by midpoint displacement around the origin, instead of the ground. Plants stand on it.
    TerrainKeys at "terrain" {
        /// Selects another terrain.
        seed: u64 = "seed" SeedType(0);
        /// Number of subdivisions n: 2^n + 1 heights along a side.
        subdivisions: u32 = "subdivisions" integer(9, 1, 13);
        /// Side length of the square terrain.
        size: f64 = "size" number(200.0, 1.0, 1e5, "m"), basic;
        /// Height of the largest hills.
        amplitude: f64 = "amplitude" number(25.0, 0.0, 1e4, "m"), basic;
        /// How fast the amplitude decreases with scale: 0 is jagged, 1 is smooth.
        exponent: f64 = "exponent" number(0.8, 0.0, 1.0, "");
        /// Heights of the corners at -x -z, +x -z, -x +z, +x +z.
        corners: Option<[f64; 4]> = "corners" OptionalKey(NumberArray([0.0; 4], number(0.0, -1e5, 1e5, "m")), "random");
        /// Whether opposite edges are equal, so that copies join; only the first of `corners` is used.
        tileable: bool = "tileable" BooleanType(false);
        /// Whether both half steps displace by the same amplitude, as in the paper; slightly rougher.
        paper: bool = "paper" BooleanType(false);
        /// Minimum height, for plains and lake beds.
        floor: Option<f64> = "floor" OptionalKey(number(0.0, -1e5, 1e5, "m"), "none");
        /// Number of smoothing passes.
        smooth: u32 = "smooth" integer(0, 0, 8);
        /// Interval of heights that the mesh uses: 1, 2, 4 ...
        stride: u32 = "stride" integer(1, 1, 8192);
        /// Colour of bare soil.
        color: Option<[f32; 3]> = "color" OptionalKey(ColorType("#5c4d3d"), "brown");
        /// Colour of grass on gentle slopes.
        color2: Option<[f32; 3]> = "color2" OptionalKey(ColorType("#4d5d2c"), "green");
        /// Colour of rock on steep slopes.
        rock: Option<[f32; 3]> = "rock" OptionalKey(ColorType("#77726c"), "grey");
        /// Fraction of grass on gentle slopes.
        cover: f64 = "cover" number(0.9, 0.0, 1.0, "");
        /// Slope above which there is rock.
        steep: f64 = "steep_deg" degrees(37.0, 1.0, 90.0);
        /// Side length of the texture of the whole terrain in pixels.
        side: u32 = "side" PowerOfTwo(2048);
    }
}

impl Resolver<'_> {
    /// The land, if the scene has a `[terrain]`.
    pub(in crate::recipe) fn terrain(&mut self, root: &TomlTable) -> Option<TerrainKeys> {
        let table = self.table(root, "", "terrain")?;
        let keys = self.read_keys::<TerrainKeys>(table, "terrain");
        let most = 1_u32 << keys.subdivisions;
        if let Some(entry) = table.get("stride").filter(|_| !keys.stride.is_power_of_two() || keys.stride > most) {
            let text = format!("terrain.stride is {}, but must be a power of two up to {most}", keys.stride);
            let d = Diagnostic::error("S004", text, entry.node.span, "no such stride");
            self.report.push(d.help("1 shows every height, 2 every second one, 4 every fourth"));
        }
        // Heights along a side are 2^n + 1; a mesh with stride s has (2^n / s)^2 cells of two triangles.
        let side = u64::from(most / keys.stride.max(1));
        let span = table.get("subdivisions").map(|e| e.node.span);
        self.limit("triangles", 2 * side * side, span);
        Some(keys)
    }

    /// What is strewn over the land.
    pub(in crate::recipe) fn scatters(&mut self, root: &TomlTable, plants: &[PlantRecipe]) -> Vec<ScatterRecipe> {
        let Some(entry) = root.get("scatter") else { return Vec::new() };
        let TomlValue::List(list) = &entry.node.value else {
            self.report.push(*wrong("scatter", &entry.node, "a list: write [[scatter]]"));
            return Vec::new();
        };
        if root.get("terrain").is_none() {
            let d = Diagnostic::error("S006", "[[scatter]] needs land", entry.key_span, "no [terrain] in this scene");
            self.report.push(d.help("add [terrain], or put plants up by [[place]]"));
        }
        list.iter().enumerate().filter_map(|(i, node)| self.scatter(i, node, root, plants)).collect()
    }

    fn scatter(
        &mut self,
        i: usize,
        node: &TomlNode,
        root: &TomlTable,
        plants: &[PlantRecipe],
    ) -> Option<ScatterRecipe> {
        let path = format!("scatter.{i}");
        let TomlValue::Table(table) = &node.value else {
            self.report.push(*wrong(&path, node, "a table"));
            return None;
        };
        let keys = self.read_keys::<ScatterKeys>(table, &path);
        for (name, pair) in [("altitude", keys.altitude), ("scale", keys.scale)] {
            self.in_order(table, &path, name, pair);
        }
        let span = table.get("plants").map_or(node.span, |e| e.node.span);
        if keys.plants.is_empty() {
            let d = Diagnostic::error("S006", format!("[[{path}]] names no plant"), span, "no plants here");
            self.report.push(d.help("add plants = { NAME = 1 }"));
            return None;
        }
        // Names become indices into the plants of the recipe.
        let weights = self.weights(&format!("{path}.plants"), span, &keys.plants, root, plants)?;
        let mask = match &keys.mask {
            Some(reference) => {
                let file = self.read(&reference.text, reference.span, "mesh-bytes", &[".png", ".jpg", ".jpeg"])?;
                Some(self.grey(&file)?)
            }
            None => None,
        };
        Some(ScatterRecipe { plants: weights, mask, keys })
    }

    /// S004 if the second of a pair is smaller than the first.
    pub(in crate::recipe) fn in_order(&mut self, table: &TomlTable, path: &str, name: &str, [low, high]: [f64; 2]) {
        if let Some(entry) = table.get(name).filter(|_| low > high) {
            let text = format!("{path}.{name} has its minimum above its maximum");
            let d = Diagnostic::error("S004", text, entry.node.span, "the smaller number comes first");
            self.report.push(d.help(format!("write [{high}, {low}]")));
        }
    }

    /// S004 for a weight that is none.
    pub(in crate::recipe) fn weight(&mut self, path: &str, name: &str, weight: f64, span: Span) {
        if !(0.0..=1e9).contains(&weight) {
            let text = format!("{path}.{name} is {weight}, but must be 0 to 1e9");
            self.report.push(Diagnostic::error("S004", text, span, "0 to 1e9").help("weights are shares"));
        }
    }

    /// Plants (indices into the recipe's) with their weights. `path`, `span`: where they are named.
    pub(in crate::recipe) fn weights(
        &mut self,
        path: &str,
        span: Span,
        named: &[(String, f64)],
        root: &TomlTable,
        plants: &[PlantRecipe],
    ) -> Option<Vec<(usize, f64)>> {
        let declared: Vec<&str> = match root.get("plants").map(|e| &e.node.value) {
            Some(TomlValue::Table(t)) => t.entries.iter().map(|e| e.key.as_str()).collect(),
            _ => Vec::new(),
        };
        let mut out = Vec::new();
        for (name, weight) in named {
            self.weight(path, name, *weight, span);
            match plants.iter().position(|p| p.name == *name) {
                Some(plant) => out.push((plant, *weight)),
                // A plant with faults of its own has been named already.
                None if declared.contains(&name.as_str()) => return None,
                None => {
                    let d = Diagnostic::error("S005", format!("there is no plant \"{name}\""), span, "unknown plant");
                    self.report.push(match nearest(name, declared.iter().copied()) {
                        Some(near) => d.help(format!("did you mean \"{near}\"?")),
                        None => d.help(format!("plants of this scene: {}", declared.join(", "))),
                    });
                    return None;
                }
            }
        }
        Some(out)
    }

    pub(in crate::recipe) fn grey(&mut self, file: &crate::recipe::ReferencedFile) -> Option<GreyImage> {
        let request = self.request;
        let options = osier_import::ImportOptions {
            roots: request.library.roots(),
            limits: &request.limits,
            up: osier_import::UpAxis::Y,
            scale: 1.0,
            class: MaterialClass::Ground,
        };
        let grey = osier_import::read_grey(&file.path, &file.bytes, &options);
        self.load_or_report(grey, file)
    }
}
