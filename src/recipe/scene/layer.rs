//! `[[layer]]`: layers of a composed picture.

use super::{AttractorKeys, ColorBy, WeightsFrom};
use crate::recipe::LayerRecipe;
use crate::recipe::resolve::{NamedTable, Resolver};
use crate::recipe::syntax::KeyTable;
use crate::recipe::syntax::keys;
use crate::recipe::syntax::{
    ColorList, ColorType, FileReference, NumberArray, OneOf, OptionalKey, Reference, StringType, TomlNode, TomlTable,
    TomlValue, integer, number, wrong,
};
use osier_base::diagnostic::Diagnostic;

keys! {
    /// A layer of a composite picture, above the layers before it: the points of a table, or without `ifs` a rectangle
    /// (`osier grow NAME -o NAME.png`).
    LayerKeys at "layer" as list {
        /// Coefficient table whose attractor the layer shows.
        ifs: Option<Reference> = "ifs" FileReference(".ifs, .flame, .ifs.toml");
        /// Which system of the table; the first without a name.
        system: String = "system" StringType("");
        /// Where the probabilities of maps come from.
        weights: Option<WeightsFrom> = "weights" OptionalKey(OneOf(WeightsFrom::File), "the file's");
        /// Number of points that the chaos game draws.
        points: Option<u32> = "points" OptionalKey(integer(1_000_000, 1, 1_000_000_000), "20 per pixel of its box");
        /// Bottom centre, as fractions of the width and height of the picture from its lower left corner.
        at: [f64; 2] = "at" NumberArray([0.5, 0.0], number(0.0, -10.0, 10.0, ""));
        /// Height as a fraction of the picture.
        height: Option<f64> = "height" OptionalKey(number(1.0, 1e-3, 10.0, ""), "from width");
        /// Width as a fraction of the picture; with `height` the layer is stretched.
        width: Option<f64> = "width" OptionalKey(number(1.0, 1e-3, 10.0, ""), "from height");
        /// Single colour of the layer.
        color: Option<[f32; 3]> = "color" OptionalKey(ColorType("#000000"), "by color_by");
        /// Colour at the top of a rectangle, as a gradient from `color`.
        color2: Option<[f32; 3]> = "color2" OptionalKey(ColorType("#000000"), "color");
        /// What the colour of a point stands for.
        color_by: ColorBy = "color_by" OneOf(ColorBy::Map);
        /// Maps that count for the colour by word.
        prefix: u32 = "prefix" integer(2, 1, 4);
        /// Colours by map, or along the palette.
        colors: Vec<[f32; 3]> = "colors" ColorList;
        /// Factor on the opacity of the layer.
        opacity: f64 = "opacity" number(1.0, 0.0, 1.0, "");
        /// Brightness of low densities.
        exposure: Option<f64> = "exposure" OptionalKey(number(16.0, 1e-6, 1e9, ""), "that of the picture");
        /// Exponent of opacity.
        gamma: Option<f64> = "gamma" OptionalKey(number(0.6, 0.05, 10.0, ""), "that of the picture");
    }
}

impl Resolver<'_> {
    /// Reads every `[[layer]]`, from the lowest; leaves out those that cannot be read.
    pub(in crate::recipe) fn layers(&mut self, root: &TomlTable) -> Vec<LayerRecipe> {
        let Some(entry) = root.get("layer") else { return Vec::new() };
        let TomlValue::List(list) = &entry.node.value else {
            self.report.push(*wrong("layer", &entry.node, "a list: write [[layer]]"));
            return Vec::new();
        };
        list.iter().enumerate().filter_map(|(i, node)| self.layer(i, node)).collect()
    }

    fn layer(&mut self, i: usize, node: &TomlNode) -> Option<LayerRecipe> {
        let path = format!("layer.{i}");
        let TomlValue::Table(table) = &node.value else {
            self.report.push(*wrong(&path, node, "a table"));
            return None;
        };
        let keys = self.read_keys::<LayerKeys>(table, &path);
        if keys.ifs.is_none() {
            // After an error in `ifs`, which has been reported, the layer would seem to have neither key.
            if keys.color.is_none() && !self.report.has_errors() {
                let d =
                    Diagnostic::error("S006", format!("[[{path}]] draws nothing"), node.span, "neither ifs nor color");
                self.report.push(d.help("add ifs = \"NAME.ifs\" for a table, or color = \"#rrggbb\" for a plain box"));
                return None;
            }
            return Some(LayerRecipe { cloud: None, keys });
        }
        // The attractor takes its colours from the layer; a single colour means shading by density.
        let cloud = AttractorKeys {
            ifs: keys.ifs.clone(),
            system: keys.system.clone(),
            weights: keys.weights,
            color_by: if keys.color.is_some() { ColorBy::Density } else { keys.color_by },
            prefix: keys.prefix,
            colors: keys.color.map_or_else(|| keys.colors.clone(), |c| vec![c]),
            ..AttractorKeys::defaults()
        };
        let cloud =
            self.attractor(NamedTable { name: &path, path: &path, id: format!("layer_{i}") }, node.span, cloud)?;
        // Layers have no camera to project points in space.
        if cloud.system.dim != 2 {
            let text = format!("\"{}\" is a 3D table; a layer needs a 2D one", cloud.system.name);
            let d = Diagnostic::error("S005", text, node.span, "this layer");
            self.report.push(d.help("take a table with 7 columns"));
            return None;
        }
        Some(LayerRecipe { cloud: Some(cloud), keys })
    }
}
