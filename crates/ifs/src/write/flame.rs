//! Flames: linear maps with colours, chaos rows, final transform, view and palette.

use glam::DVec3;

use super::{TableItem, decimal, loss_diagnostic, millionths, names, share};
use crate::affine::Affine;
use crate::{Ifs, PictureView};
use osier_base::diagnostic::Diagnostic;
use osier_base::units::{srgb_byte, srgb_from_linear};

/// Height of the picture in a written view, pixels.
const HEIGHT: f64 = 720.0;

/// Writes all systems as one document and reports what it cannot hold (I011).
/// # Errors
/// I030 for a system of space.
pub fn flames(items: &[TableItem]) -> Result<(String, Vec<Diagnostic>), Box<Diagnostic>> {
    let mut out = String::from("<flames>\n");
    for (item, name) in items.iter().zip(names(items)) {
        if item.system.dim != 2 {
            let text = format!("\"{}\" lies in space, flames lie in the plane", item.system.name);
            return Err(Box::new(Diagnostic::about("I030", text).help("write it as .ifs")));
        }
        out += &flame(item, &name);
    }
    Ok((out + "</flames>\n", items.iter().filter_map(|i| lost_features(&i.system)).collect()))
}

fn flame(item: &TableItem, name: &str) -> String {
    let ifs = &item.system;
    let mut out = format!("<flame name=\"{name}\" version=\"osier {}\"", env!("CARGO_PKG_VERSION"));
    out += &ifs.view.or(item.view).map(|v| view(&v)).unwrap_or_default();
    out += ">\n";
    // One xform per map, weights in millionths.
    for (i, (map, weight)) in ifs.maps.iter().zip(millionths(&item.weights)).enumerate() {
        out += &format!(
            "  <xform weight=\"{}\" color=\"{}\" color_speed=\"{}\" opacity=\"{}\" linear=\"1\" coefs=\"{}\"",
            share(weight),
            decimal(map.coord),
            decimal(map.speed),
            decimal(map.opacity),
            coefs(&map.affine)
        );
        if let Some(row) = ifs.chaos.as_ref().and_then(|c| c.get(i)) {
            let row: Vec<String> = row.iter().map(|v| decimal(*v)).collect();
            out += &format!(" chaos=\"{}\"", row.join(" "));
        }
        out += "/>\n";
    }
    if let Some(last) = &ifs.last {
        out += &format!("  <finalxform linear=\"1\" coefs=\"{}\"/>\n", coefs(last));
    }
    if !ifs.palette.is_empty() {
        out += &format!("  <palette count=\"{}\" format=\"RGB\">\n", ifs.palette.len());
        for row in ifs.palette.chunks(8) {
            let hex = |c: &[f32; 3]| c.iter().map(|v| format!("{:02X}", srgb_byte(*v))).collect::<String>();
            out += &format!("    {}\n", row.iter().map(hex).collect::<String>());
        }
        out += "  </palette>\n";
    }
    out + "</flame>\n"
}

/// Coefficients of a map as a flame file has them: column by column, with y down.
fn coefs(map: &Affine) -> String {
    let [a, b, c, d, e, f] = {
        // Back to y down: F w F with the reflection F = diag(1, -1, 1); listed column by column.
        let turned = map.conjugated(DVec3::new(1.0, -1.0, 1.0), DVec3::ZERO).coefficients(2);
        std::array::from_fn(|i| turned.get(i).copied().unwrap_or(0.0))
    };
    [a, c, b, d, e, f].map(decimal).join(" ")
}

/// Numbers of a view are kept to nine digits, so that writing what was read changes nothing.
fn view(v: &PictureView) -> String {
    let short = |v: f64| format!("{v:.9e}").parse::<f64>().map_or_else(|_| "0".into(), decimal);
    let width = (v.aspect * HEIGHT).round().max(1.0);
    let background = v.background.map(|c| format!("{:.4}", srgb_from_linear(c)).parse::<f64>().unwrap_or(0.0));
    let background = background.map(decimal).join(" ");
    let turn = if v.rotate == 0.0 { String::new() } else { format!(" rotate=\"{}\"", short(v.rotate.to_degrees())) };
    format!(
        " size=\"{} {}\" center=\"{} {}\" scale=\"{}\"{turn} background=\"{background}\"",
        decimal(width),
        decimal(HEIGHT),
        short(v.center[0]),
        short(-v.center[1]),
        short(width / v.width.max(1e-12)),
    )
}

fn lost_features(ifs: &Ifs) -> Option<Diagnostic> {
    let features = [
        ("condensation sets", !ifs.condensation.is_empty()),
        ("radii of branches", ifs.maps.iter().any(|m| m.radius.is_some())),
        ("colors of single maps", ifs.maps.iter().any(|m| m.color.is_some())),
    ];
    loss_diagnostic(ifs, "a flame", &features)
}
