//! Lines over time as SVG.

use std::fmt::Write as _;

use super::number;
use crate::math::{ln, pow};
use crate::scene::{Clip, Table};

const WIDTH: f64 = 760.0;
const PANEL: f64 = 220.0;
const LEFT: f64 = 64.0;
const RIGHT: f64 = 170.0;
const TOP: f64 = 34.0;
const BOTTOM: f64 = 34.0;
/// Told apart by people who see fewer colours as well.
/// Source: M. Okabe, K. Ito, "Color universal design", 2008.
const COLORS: [&str; 7] = ["#0072b2", "#e69f00", "#009e73", "#cc79a7", "#d55e00", "#56b4e9", "#444444"];

/// A step of 1, 2 or 5 times a power of ten that cuts `span` into about `count` parts.
fn step(span: f64, count: f64) -> f64 {
    let rough = (span / count).max(1e-12);
    let power = pow(10.0, (ln(rough) / std::f64::consts::LN_10).floor());
    let factor = [1.0, 2.0, 5.0, 10.0].into_iter().find(|f| f * power >= rough).unwrap_or(10.0);
    factor * power
}

/// A panel per group of columns, one below the other.
pub(super) fn panels(title: &str, table: &Table, clip: Clip, rows: &[(u32, Vec<f64>)]) -> String {
    let height = TOP + table.plots.len() as f64 * (PANEL + BOTTOM + TOP);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" font-family=\"sans-serif\" \
         font-size=\"12\" fill=\"#222\">\n<rect width=\"{WIDTH}\" height=\"{height}\" fill=\"white\"/>\n\
         <text x=\"{LEFT}\" y=\"22\" font-size=\"15\">{}</text>\n",
        escaped(title)
    );
    for (i, (name, columns)) in table.plots.iter().enumerate() {
        let y = TOP + i as f64 * (PANEL + BOTTOM + TOP) + TOP * 0.6;
        panel(&mut out, y, (name, table, columns), (clip, rows));
    }
    out.push_str("</svg>\n");
    out
}

fn panel(
    out: &mut String,
    top: f64,
    (name, table, columns): (&str, &Table, &[usize]),
    (clip, rows): (Clip, &[(u32, Vec<f64>)]),
) {
    let times: Vec<f64> = rows.iter().map(|(f, _)| clip.seconds(*f)).collect();
    let (first, last) = (times.first().copied().unwrap_or(0.0), times.last().copied().unwrap_or(1.0));
    let value = |row: &[f64], c: usize| row.get(c).copied().unwrap_or(0.0);
    let most = rows.iter().flat_map(|(_, r)| columns.iter().map(|c| value(r, *c))).fold(0.0, f64::max);
    let most = if most > 0.0 { most * 1.05 } else { 1.0 };
    let right = WIDTH - RIGHT;
    let x = |t: f64| LEFT + (t - first) / (last - first).max(1e-9) * (right - LEFT);
    let y = |v: f64| top + PANEL - v / most * PANEL;
    let _ = writeln!(out, "<text x=\"{LEFT}\" y=\"{:.1}\" font-weight=\"bold\">{}</text>", top - 6.0, escaped(name));
    let grid = step(most, 5.0);
    let mut v = 0.0;
    while v <= most {
        let at = y(v);
        let _ = writeln!(
            out,
            "<path d=\"M{LEFT} {at:.1}H{right}\" stroke=\"#ddd\"/><text x=\"{:.1}\" y=\"{:.1}\" \
             text-anchor=\"end\">{}</text>",
            LEFT - 6.0,
            at + 4.0,
            number((v / grid).round() * grid)
        );
        v += grid;
    }
    let tick = step(last - first, 6.0);
    let mut t = (first / tick).ceil() * tick;
    while t <= last + 1e-9 {
        let _ = writeln!(
            out,
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{} s</text>",
            x(t),
            top + PANEL + 16.0,
            number((t / tick).round() * tick)
        );
        t += tick;
    }
    for (k, c) in columns.iter().enumerate() {
        let color = COLORS[k % COLORS.len()];
        let points: Vec<String> =
            rows.iter().zip(&times).map(|((_, r), t)| format!("{:.1},{:.1}", x(*t), y(value(r, *c)))).collect();
        let (label, unit) = table.columns.get(*c).copied().unwrap_or(("", ""));
        let label =
            if unit.is_empty() { label.replace('_', " ") } else { format!("{} [{unit}]", label.replace('_', " ")) };
        let _ = writeln!(
            out,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"1.6\"/>\n\
             <text x=\"{:.1}\" y=\"{:.1}\" fill=\"{color}\">{}</text>",
            points.join(" "),
            right + 10.0,
            top + 12.0 + 16.0 * k as f64,
            escaped(&label)
        );
    }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_numbers() {
        let near = |a: f64, b: f64| (a - b).abs() < 1e-9 * b;
        assert!(near(step(10.0, 5.0), 2.0) && near(step(2100.0, 5.0), 500.0) && near(step(0.7, 5.0), 0.2));
    }
}
