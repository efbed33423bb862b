//! Seconds per tree to grow and write 1, 10, 100 and 1,000 trees of one species, as [wang-hao] Fig. 14 asks.
//!
//! The trees share up to 16 individuals, which are written once and placed; `cargo bench --bench forest -- own` lets every
//! tree grow its own (up to 100). `cargo bench --bench forest -- plot FILE` measures both and draws times against amounts as an
//! SVG, as [wang-hao] Fig. 13 and 14 do; it tells the time of the processor, on Linux, so that other programs do not disturb it.
#![allow(clippy::print_stdout, clippy::disallowed_methods, clippy::expect_used, reason = "a bench tells times")]

use std::sync::Arc;
use std::time::Instant;

use osier::bake::BakeContext;
use osier::bake::output::{exporters, frame_loop};
use osier::bake::scene::{SceneOptions, assemble_scene};
use osier::export::textures::Textures;
use osier::files::Folder;
use osier::limits::Limits;
use osier::presets::find;
use osier::progress::{Cancel, Silent};
use osier::recipe::{Request, resolve};

/// Individuals that the trees of a forest share.
const SHARED: u32 = 16;

/// Grows and writes `count` trees; returns seconds and bytes.
fn forest(count: u32, individuals: u32) -> (f64, u64) {
    let text = find("silk-tree.toml").expect("preset").text;
    let set = [
        format!("place.0.count={count}"),
        format!("place.0.individuals={individuals}"),
        format!("place.0.radius={}", 6.0 * f64::from(count).sqrt()),
        "place.0.spacing=6".into(),
        "output.formats=[\"usd\"]".into(),
    ];
    let start = Instant::now();
    let request = Request { name: "forest".into(), text: text.into(), set: set.into(), ..Request::default() };
    let recipe = resolve(&request).expect("scene").0;
    let work = BakeContext { limits: &Limits::default(), cancel: &Cancel::default(), progress: &Silent, cache: None };
    let built = assemble_scene(&recipe, SceneOptions::default(), &work).expect("stage");
    let dir = tempfile::tempdir().expect("dir");
    let folder = Folder::open(dir.path()).expect("folder");
    let textures = Arc::new(Textures::encode(&built.animated.scene).expect("pictures"));
    textures.write(&built.animated.scene, &folder, "textures/").expect("pictures");
    let mut writers = exporters::bake_exporters(&folder, &textures, &recipe, &built.animated, &[]);
    frame_loop::write_frames(&built.animated, &mut writers, &[], &work).expect("files");
    folder.finish().expect("files");
    (start.elapsed().as_secs_f64(), folder.files().iter().map(|f| f.bytes).sum())
}

/// Amounts of trees of the plots.
const AMOUNTS: [u32; 7] = [1, 2, 5, 10, 20, 50, 100];
/// Most trees that grow individually for a plot.
const MOST_OWN: u32 = 50;
/// Width and height of a plot without its margins, and its margins, in pixels.
const PLOT: [f64; 2] = [360.0, 240.0];
const MARGIN: [f64; 2] = [62.0, 46.0];

/// Times of a series: amount of trees, seconds for all of them.
struct Series {
    name: &'static str,
    color: &'static str,
    times: Vec<(u32, f64)>,
}

/// Ticks of the clock of /proc in a second.
const TICKS: f64 = 100.0;

/// Seconds that the processor has spent on this program so far: user and system time of /proc/self/stat.
fn processor_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").expect("Linux");
    let after_name = stat.rsplit(')').next().unwrap_or_default();
    let ticks = after_name.split_whitespace().skip(11).take(2).filter_map(|n| n.parse::<f64>().ok());
    ticks.sum::<f64>() / TICKS
}

/// Measures trees that share individuals and trees that each grow their own, in seconds of the processor.
fn measure() -> [Series; 2] {
    let once = |count: u32, individuals: u32| {
        let before = processor_seconds();
        forest(count, individuals);
        processor_seconds() - before
    };
    let own = AMOUNTS.into_iter().filter(|n| *n <= MOST_OWN).map(|n| (n, once(n, n))).collect();
    let shared = AMOUNTS.into_iter().map(|n| (n, once(n, n.min(SHARED)))).collect();
    [
        Series { name: "each tree grows", color: "#b5472f", times: own },
        Series { name: "16 individuals, placed", color: "#3f78a8", times: shared },
    ]
}

/// Draws the times of all trees (left) and per tree (right) against the amount, both axes logarithmic.
fn plot(series: &[Series]) -> String {
    let width = 2.0 * (PLOT[0] + MARGIN[0]) + 20.0;
    let height = PLOT[1] + 2.0 * MARGIN[1];
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" \
         font-size=\"12\">\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n"
    );
    for (panel, title) in ["seconds for all trees", "seconds per tree"].into_iter().enumerate() {
        let per_tree = panel == 1;
        let left = MARGIN[0] + panel as f64 * (PLOT[0] + MARGIN[0]);
        let value = |(n, s): &(u32, f64)| if per_tree { s / f64::from(*n) } else { *s };
        let all = || series.iter().flat_map(|s| &s.times).map(value);
        let low = all().fold(f64::MAX, f64::min).log10().floor();
        let high = all().fold(0.0, f64::max).log10().ceil();
        let x = |n: f64| left + PLOT[0] * n.log10() / f64::from(AMOUNTS[AMOUNTS.len() - 1]).log10();
        let y = |v: f64| MARGIN[1] + PLOT[1] * (high - v.log10()) / (high - low);
        let mut text = |at: [f64; 2], anchor: &str, words: &str| {
            svg += &format!("<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"{anchor}\">{words}</text>\n", at[0], at[1]);
        };
        text([left + PLOT[0] * 0.5, 24.0], "middle", title);
        text([left + PLOT[0] * 0.5, height - 8.0], "middle", "number of trees");
        for n in AMOUNTS {
            text([x(f64::from(n)), MARGIN[1] + PLOT[1] + 18.0], "middle", &n.to_string());
        }
        // One line of the grid for each power of ten.
        let mut power = low;
        let mut grid = String::new();
        while power <= high + 0.5 {
            let at = y(10_f64.powf(power));
            text([left - 6.0, at + 4.0], "end", &format!("{}", 10_f64.powf(power)));
            grid += &format!("<path d=\"M{left} {at:.1}h{}\" stroke=\"#ccc\"/>\n", PLOT[0]);
            power += 1.0;
        }
        for (row, s) in series.iter().enumerate() {
            let at = [left + 12.0, MARGIN[1] + PLOT[1] - 12.0 - 16.0 * row as f64];
            svg += &format!("<g fill=\"{}\">", s.color);
            svg += &format!("<text x=\"{:.1}\" y=\"{:.1}\">{}</text></g>\n", at[0], at[1], s.name);
            let points: Vec<[f64; 2]> = s.times.iter().map(|t| [x(f64::from(t.0)), y(value(t))]).collect();
            let line: Vec<String> = points.iter().map(|p| format!("{:.1},{:.1}", p[0], p[1])).collect();
            svg += &format!("<polyline points=\"{}\" fill=\"none\" stroke=\"{}\"/>\n", line.join(" "), s.color);
            for p in points {
                svg += &format!("<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"3\" fill=\"{}\"/>\n", p[0], p[1], s.color);
            }
        }
        svg += &grid;
    }
    svg + "</svg>\n"
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    if let Some(file) = arguments.iter().position(|a| a == "plot").and_then(|i| arguments.get(i + 1)) {
        let series = measure();
        for s in &series {
            println!("{}: {:?}", s.name, s.times);
        }
        std::fs::write(file, plot(&series)).expect("the plot is written");
        return;
    }
    let own = std::env::args().any(|a| a == "own");
    println!("{:>6} {:>12} {:>10} {:>12} {:>10}", "trees", "individuals", "s", "s per tree", "MB");
    for count in [1_u32, 10, 100, 1000] {
        let individuals = if own { count } else { count.min(SHARED) };
        if individuals > 100 {
            continue;
        }
        let (seconds, bytes) = forest(count, individuals);
        let each = seconds / f64::from(count);
        println!("{count:>6} {individuals:>12} {seconds:>10.2} {each:>12.4} {:>10.1}", bytes as f64 / 1e6);
    }
}
