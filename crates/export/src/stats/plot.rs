//! Line plots as SVG.

use std::fmt::Write as _;

use super::number;
use osier_base::math::{ln, pow};
use osier_scene::{Clip, Table};

const WIDTH: f64 = 760.0;
const PANEL_HEIGHT: f64 = 220.0;
const LEFT: f64 = 64.0;
const RIGHT: f64 = 170.0;
const TOP: f64 = 34.0;
const BOTTOM: f64 = 34.0;
/// Colours that people with colour blindness can distinguish.
/// Source: M. Okabe, K. Ito, "Color universal design", 2008.
const COLORS: [&str; 7] = ["#0072b2", "#e69f00", "#009e73", "#cc79a7", "#d55e00", "#56b4e9", "#444444"];

/// Step between ticks: 1, 2 or 5 times a power of ten, such that `span` has at most about `count` of them.
fn tick_step(span: f64, count: f64) -> f64 {
    // The smallest of 1, 2, 5 and 10 times the power of ten below the exact step that is not below it.
    let rough = (span / count).max(1e-12);
    let power = pow(10.0, (ln(rough) / std::f64::consts::LN_10).floor());
    let factor = [1.0, 2.0, 5.0, 10.0].into_iter().find(|f| f * power >= rough).unwrap_or(10.0);
    factor * power
}

/// A tick's value as text, rounded to 1e-9 to remove rounding errors.
fn round_label(v: f64) -> String {
    number((v * 1e9).round() / 1e9)
}

/// A line of a panel with its legend.
#[derive(Debug, Clone, Default)]
pub(super) struct PlotLine {
    pub label: String,
    pub points: Vec<[f64; 2]>,
    /// Minimum and maximum at each point if it is a mean of several runs, else empty.
    pub spread: Vec<[f64; 2]>,
}

/// Lines that share a heading and a vertical axis.
#[derive(Debug, Clone, Default)]
pub(super) struct PlotPanel {
    pub name: String,
    pub lines: Vec<PlotLine>,
}

/// The horizontal axis of all panels.
#[derive(Debug, Clone, Default)]
pub(super) struct PlotAxis {
    pub ticks: Vec<(f64, String)>,
    pub label: String,
}

/// Draws a table over time: a panel for each group of columns.
pub(super) fn draw_table(title: &str, table: &Table, clip: Clip, rows: &[(u32, Vec<f64>)]) -> String {
    let times: Vec<f64> = rows.iter().map(|(f, _)| clip.seconds(*f)).collect();
    let line = |c: &usize| {
        let (label, unit) = table.columns.get(*c).map_or(("", ""), |(name, unit)| (name.as_str(), *unit));
        let label =
            if unit.is_empty() { label.replace('_', " ") } else { format!("{} [{unit}]", label.replace('_', " ")) };
        let points = rows.iter().zip(&times).map(|((_, r), t)| [*t, r.get(*c).copied().unwrap_or(0.0)]).collect();
        PlotLine { label, points, spread: Vec::new() }
    };
    let panel = |(name, columns): &(&str, Vec<usize>)| PlotPanel {
        name: (*name).to_owned(),
        lines: columns.iter().map(line).collect(),
    };
    let (first, last) = (times.first().copied().unwrap_or(0.0), times.last().copied().unwrap_or(1.0));
    let tick = tick_step(last - first, 6.0);
    let mut ticks = Vec::new();
    let mut t = (first / tick).ceil() * tick;
    // The sum of steps rounds: the tolerance keeps the tick at the end of the clip.
    while t <= last + 1e-9 {
        ticks.push((t, format!("{} s", round_label((t / tick).round() * tick))));
        t += tick;
    }
    draw_panels(title, &PlotAxis { ticks, label: String::new() }, &table.plots.iter().map(panel).collect::<Vec<_>>())
}

/// Draws panels below each other with the same horizontal axis.
pub(super) fn draw_panels(title: &str, axis: &PlotAxis, panels: &[PlotPanel]) -> String {
    let height = TOP + panels.len() as f64 * (PANEL_HEIGHT + BOTTOM + TOP);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" font-family=\"sans-serif\" \
         font-size=\"12\" fill=\"#222\">\n<rect width=\"{WIDTH}\" height=\"{height}\" fill=\"white\"/>\n\
         <text x=\"{LEFT}\" y=\"22\" font-size=\"15\">{}</text>\n",
        escape_xml(title)
    );
    for (i, shown) in panels.iter().enumerate() {
        let y = TOP + i as f64 * (PANEL_HEIGHT + BOTTOM + TOP) + TOP * 0.6;
        draw_panel(&mut out, y, shown, axis);
    }
    out.push_str("</svg>\n");
    out
}

/// Conversion from values to positions in a panel; the vertical axis begins at 0.
struct PanelScale {
    top: f64,
    first: f64,
    last: f64,
    most: f64,
}

impl PanelScale {
    fn of(top: f64, panel: &PlotPanel) -> Self {
        let points = || panel.lines.iter().flat_map(|l| &l.points);
        let first = points().map(|p| p[0]).fold(f64::INFINITY, f64::min);
        let last = points().map(|p| p[0]).fold(f64::NEG_INFINITY, f64::max);
        let spread = panel.lines.iter().flat_map(|l| &l.spread).map(|s| s[1]);
        let most = points().map(|p| p[1]).chain(spread).fold(0.0, f64::max);
        // A margin of 5 % above the largest value; a panel of zeros gets the range 0 to 1.
        Self { top, first, last, most: if most > 0.0 { most * 1.05 } else { 1.0 } }
    }

    fn x(&self, v: f64) -> f64 {
        // The minimum keeps a plot of a single point from dividing by zero.
        LEFT + (v - self.first) / (self.last - self.first).max(1e-9) * (WIDTH - RIGHT - LEFT)
    }

    fn y(&self, v: f64) -> f64 {
        self.top + PANEL_HEIGHT - v / self.most * PANEL_HEIGHT
    }
}

fn draw_panel(out: &mut String, top: f64, panel: &PlotPanel, axis: &PlotAxis) {
    let scale = PanelScale::of(top, panel);
    let right = WIDTH - RIGHT;
    let name = escape_xml(&panel.name);
    let _ = writeln!(out, "<text x=\"{LEFT}\" y=\"{:.1}\" font-weight=\"bold\">{name}</text>", top - 6.0);
    // Horizontal lines at round values, labelled on the left.
    let grid = tick_step(scale.most, 5.0);
    let mut v = 0.0;
    while v <= scale.most {
        let at = scale.y(v);
        let _ = writeln!(
            out,
            "<path d=\"M{LEFT} {at:.1}H{right}\" stroke=\"#ddd\"/><text x=\"{:.1}\" y=\"{:.1}\" \
             text-anchor=\"end\">{}</text>",
            LEFT - 6.0,
            at + 4.0,
            round_label((v / grid).round() * grid)
        );
        v += grid;
    }
    // Labels of the common axis below the panel.
    let in_panel = |at: f64| (LEFT - 1.0..=right + 1.0).contains(&scale.x(at));
    for (at, text) in axis.ticks.iter().filter(|tick| in_panel(tick.0)) {
        let (x, y, text) = (scale.x(*at), top + PANEL_HEIGHT + 16.0, escape_xml(text));
        let _ = writeln!(out, "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"middle\">{text}</text>");
    }
    if !axis.label.is_empty() {
        let (x, y, text) = (right + 10.0, top + PANEL_HEIGHT + 16.0, escape_xml(&axis.label));
        let _ = writeln!(out, "<text x=\"{x:.1}\" y=\"{y:.1}\">{text}</text>");
    }
    // Lines come last, so that they cover the grid; the legend has their order.
    for (k, shown) in panel.lines.iter().enumerate() {
        draw_line(out, &scale, k, shown);
    }
}

fn draw_line(out: &mut String, scale: &PanelScale, k: usize, line: &PlotLine) {
    // A line without points still uses up its colour, so that a line has the same colour in all panels.
    if line.points.is_empty() {
        return;
    }
    let color = COLORS[k % COLORS.len()];
    for ([x, _], [least, most]) in line.points.iter().zip(&line.spread) {
        let (x, low, high) = (scale.x(*x), scale.y(*least), scale.y(*most));
        let _ = writeln!(out, "<path d=\"M{x:.1} {low:.1}V{high:.1}\" stroke=\"{color}\" stroke-width=\"1\"/>");
    }
    // An absent value interrupts the line.
    for points in line.points.split(|[_, y]| y.is_nan()).filter(|points| !points.is_empty()) {
        // A polyline of one point has no extent: a dot is drawn instead.
        if let [[x, y]] = *points {
            let (x, y) = (scale.x(x), scale.y(y));
            let _ = writeln!(out, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3\" fill=\"{color}\"/>");
        }
        let points: Vec<String> =
            points.iter().map(|[x, y]| format!("{:.1},{:.1}", scale.x(*x), scale.y(*y))).collect();
        let _ = writeln!(
            out,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"1.6\"/>",
            points.join(" ")
        );
    }
    let _ = writeln!(
        out,
        "<text x=\"{:.1}\" y=\"{:.1}\" fill=\"{color}\">{}</text>",
        WIDTH - RIGHT + 10.0,
        scale.top + 12.0 + 16.0 * k as f64,
        escape_xml(&line.label)
    );
}

fn escape_xml(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_that_are_not_there_interrupt_a_line() {
        let points = [1.0, f64::NAN, f64::NAN, 2.0, 3.0, f64::NAN].iter().zip(0..).map(|(y, x)| [f64::from(x), *y]);
        let line = PlotLine { label: "time".into(), points: points.collect(), spread: Vec::new() };
        let panel = PlotPanel { name: "Times".into(), lines: vec![line] };
        let text = draw_panels("a", &PlotAxis::default(), &[panel]);
        assert_eq!((text.matches("<polyline").count(), text.matches("<circle").count()), (2, 1), "{text}");
        assert!(!text.contains("NaN"), "{text}");
    }

    #[test]
    fn ticks_are_round_numbers() {
        let near = |a: f64, b: f64| (a - b).abs() < 1e-9 * b;
        assert_eq!((round_label(3.0 * 0.2), round_label(400.0)), ("0.6".to_owned(), "400".to_owned()));
        assert!(
            near(tick_step(10.0, 5.0), 2.0) && near(tick_step(2100.0, 5.0), 500.0) && near(tick_step(0.7, 5.0), 0.2)
        );
    }
}
