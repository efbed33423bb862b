//! Fractint's `.ifs`.

use super::{TableItem, decimal, loss_diagnostic, millionths, names, share};
use crate::Ifs;
use osier_base::diagnostic::Diagnostic;

/// Comment at the head of a file with plane systems: order of the columns, and the map that they define.
const PLANE: &str = "; columns a b c d e f p :  x' = a x + b y + e   y' = c x + d y + f   (y up)";
const SPACE: &str =
    "; columns a..i j k l p :  x' = a x + b y + c z + j   y' = d x + e y + f z + k   z' = g x + h y + i z + l";

/// Writes all systems as a text and reports what it cannot hold (I011).
pub fn entries(items: &[TableItem]) -> (String, Vec<Diagnostic>) {
    let mut out = format!("; osier {}\n", env!("CARGO_PKG_VERSION"));
    for (dim, columns) in [(2, PLANE), (3, SPACE)] {
        if items.iter().any(|i| i.system.dim == dim) {
            out += &format!("{columns}\n");
        }
    }
    for (item, name) in items.iter().zip(names(items)) {
        let space = if item.system.dim == 3 { " (3D)" } else { "" };
        out += &format!("{name}{space} {{\n{}}}\n", rows(item));
    }
    (out, items.iter().filter_map(|i| lost_features(&i.system)).collect())
}

/// One line per map; columns are as wide as their widest number.
fn rows(item: &TableItem) -> String {
    let ifs = &item.system;
    let shares = millionths(&item.weights);
    let table: Vec<Vec<String>> = ifs
        .maps
        .iter()
        .zip(shares)
        .map(|(m, p)| {
            let mut row: Vec<String> = m.affine.coefficients(ifs.dim).into_iter().map(decimal).collect();
            row.push(share(p));
            row
        })
        .collect();
    let columns = table.first().map_or(0, Vec::len);
    // Right-aligned columns keep the file readable; readers only split at blanks.
    let widths: Vec<usize> = (0..columns).map(|c| table.iter().map(|r| r[c].len()).max().unwrap_or(0)).collect();
    let cells = |row: &Vec<String>| row.iter().zip(&widths).map(|(v, w)| format!("  {v:>w$}")).collect::<String>();
    table.iter().map(|row| cells(row) + "\n").collect()
}

fn lost_features(ifs: &Ifs) -> Option<Diagnostic> {
    let features = [
        ("the chaos matrix", ifs.chaos.is_some()),
        ("the final map", ifs.last.is_some()),
        ("condensation sets", !ifs.condensation.is_empty()),
        ("radii of branches", ifs.maps.iter().any(|m| m.radius.is_some())),
        ("colors", !ifs.palette.is_empty() || ifs.maps.iter().any(|m| m.color.is_some())),
        ("shares of points shown", ifs.maps.iter().any(|m| m.opacity < 1.0)),
        ("the view", ifs.view.is_some()),
    ];
    loss_diagnostic(ifs, "a .ifs file", &features)
}
