//! Layers of a composed picture.

use super::LayerRecipe;
use super::cloud_keys::{CloudKeys, ColorBy};
use super::key::{Section as _, wrong};
use super::layer_keys::LayerKeys;
use super::resolve::Resolver;
use super::tree::{Node, Table, Value};
use osier_base::diagnostic::Diagnostic;

impl Resolver<'_> {
    /// All layers of a scene, from the lowest.
    pub(super) fn layers(&mut self, root: &Table) -> Vec<LayerRecipe> {
        let Some(entry) = root.get("layer") else { return Vec::new() };
        let Value::List(list) = &entry.node.value else {
            self.report.push(*wrong("layer", &entry.node, "a list: write [[layer]]"));
            return Vec::new();
        };
        list.iter().enumerate().filter_map(|(i, node)| self.layer(i, node)).collect()
    }

    fn layer(&mut self, i: usize, node: &Node) -> Option<LayerRecipe> {
        let path = format!("layer.{i}");
        let Value::Table(table) = &node.value else {
            self.report.push(*wrong(&path, node, "a table"));
            return None;
        };
        let keys = LayerKeys::read(Some(table), &path, &mut self.report);
        if keys.ifs.is_none() {
            if keys.color.is_none() && !self.report.has_errors() {
                let d =
                    Diagnostic::error("S006", format!("[[{path}]] draws nothing"), node.span, "neither ifs nor color");
                self.report.push(d.help("add ifs = \"NAME.ifs\" for a table, or color = \"#rrggbb\" for a plain box"));
                return None;
            }
            return Some(LayerRecipe { cloud: None, keys });
        }
        let cloud = CloudKeys {
            ifs: keys.ifs.clone(),
            system: keys.system.clone(),
            weights: keys.weights,
            color_by: if keys.color.is_some() { ColorBy::Density } else { keys.color_by },
            prefix: keys.prefix,
            colors: keys.color.map_or_else(|| keys.colors.clone(), |c| vec![c]),
            ..CloudKeys::defaults()
        };
        let cloud = self.attractor((&path, &path, format!("layer_{i}")), node.span, cloud)?;
        if cloud.system.dim != 2 {
            let text = format!("\"{}\" lies in space; a layer is drawn by a table of the plane", cloud.system.name);
            let d = Diagnostic::error("S005", text, node.span, "this layer");
            self.report.push(d.help("take a table with 7 columns"));
            return None;
        }
        Some(LayerRecipe { cloud: Some(cloud), keys })
    }
}
