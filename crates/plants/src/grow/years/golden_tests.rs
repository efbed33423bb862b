//! Counts and drawings of the mature trees of every table against those that were looked at.
//!
//! `golden/counts.txt` holds the counts, `golden/NAME.png` a drawing of seeds 1 and 2 side by side. `OSIER_BLESS=1` renews them and
//! still fails, so that blessing is never silent.
#![allow(
    clippy::expect_used,
    clippy::disallowed_methods,
    reason = "a test may fail, and reads and writes its own files"
)]

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use super::GrownTree;
use super::forestry_tests::{MATURE, MatureTree, only_in_release};

/// Width and height of the drawing of a tree, pixels.
const SIDE: usize = 256;
/// Width and height of the blocks whose counts of pixels are compared: small shifts of twigs hardly change these.
const BLOCK: usize = 8;
/// Share of the drawn pixels that may be elsewhere. Two individuals of a species differ by more than [`INDIVIDUALS`].
const TOLERANCE: f64 = 0.02;
const INDIVIDUALS: f64 = 0.05;
/// Indices of the palette: sky, leaves, wood thicker than a pixel.
const SKY: u8 = 0;
const LEAVES: u8 = 1;
const WOOD: u8 = 2;
const PALETTE: [[u8; 3]; 3] = [[238, 241, 245], [96, 140, 70], [60, 48, 40]];

/// A drawing of a tree from +Z: an index of the palette for each pixel, rows from the top.
pub(super) struct Drawing(Vec<u8>);

impl Drawing {
    /// Draws the leaves of a tree, then its wood over them. The drawing is as wide and as high as the larger of both measures of the tree,
    /// rounded up to whole metres.
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "pixels; negative ones become 0 and are outside"
    )]
    pub fn new(grown: &GrownTree) -> Self {
        let (tree, nodes) = (&grown.tree, &grown.tree.nodes);
        let measures = grown.measures();
        let size = 1.05 * measures.height.max(measures.crown_width).ceil().max(1.0);
        let scale = SIDE as f32 / size;
        let mut drawing = Self(vec![SKY; SIDE * SIDE]);
        let at = |p: glam::Vec3| [(p.x + 0.5 * size) * scale, (size - p.y) * scale];
        let mut disc = |[x, y]: [f32; 2], radius: f32, color: u8| {
            let reach = radius.ceil() as i32;
            for row in y as i32 - reach..=y as i32 + reach {
                for column in x as i32 - reach..=x as i32 + reach {
                    let (dx, dy) = (column as f32 + 0.5 - x, row as f32 + 0.5 - y);
                    let inside = usize::try_from(row).ok().zip(usize::try_from(column).ok());
                    let inside = inside.filter(|(r, c)| *r < SIDE && *c < SIDE && dx * dx + dy * dy <= radius * radius);
                    if let Some((row, column)) = inside {
                        drawing.0[row * SIDE + column] = color;
                    }
                }
            }
        };
        for i in (0..nodes.len()).filter(|i| nodes.lives(*i)) {
            let area = tree.leaf_area(i);
            if area > 0.0 {
                disc(at(nodes.p[i]), (0.5 * area.sqrt() * scale).max(0.5), LEAVES);
            }
        }
        for i in (0..nodes.len()).filter(|i| nodes.lives(*i) && 2.0 * nodes.r[*i] * scale > 1.0) {
            let to = nodes.p[i];
            let from = to - nodes.direction(i) * nodes.length[i];
            let steps = (nodes.length[i] * scale).ceil().max(1.0);
            for k in 0..=steps as u16 {
                disc(at(from.lerp(to, f32::from(k) / steps)), nodes.r[i] * scale, WOOD);
            }
        }
        drawing
    }

    /// Numbers of pixels of a colour in each block.
    fn blocks(&self, color: u8) -> Vec<u32> {
        let mut counts = vec![0; (SIDE / BLOCK) * (SIDE / BLOCK)];
        for (i, _) in self.0.iter().enumerate().filter(|(_, c)| **c == color) {
            counts[i / SIDE / BLOCK * (SIDE / BLOCK) + i % SIDE / BLOCK] += 1;
        }
        counts
    }

    /// Share of the drawn pixels that another drawing has in other blocks.
    fn difference(&self, other: &Self) -> f64 {
        let (mut apart, mut all) = (0, 0);
        for color in [LEAVES, WOOD] {
            for (a, b) in self.blocks(color).iter().zip(other.blocks(color)) {
                apart += a.abs_diff(b);
                all += a + b;
            }
        }
        f64::from(apart) / f64::from(all.max(1))
    }
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src/grow/years/golden")
}

fn blesses() -> bool {
    std::env::var("OSIER_BLESS").is_ok_and(|v| v == "1")
}

/// Writes drawings side by side with two bits for each pixel.
fn write_png(path: &Path, drawings: &[&Drawing]) {
    let width = SIDE * drawings.len();
    let file = std::fs::File::create(path).expect("a file");
    let size = |n: usize| u32::try_from(n).expect("small");
    let mut encoder = png::Encoder::new(std::io::BufWriter::new(file), size(width), size(SIDE));
    encoder.set_color(png::ColorType::Indexed);
    encoder.set_depth(png::BitDepth::Two);
    encoder.set_palette(PALETTE.as_flattened().to_vec());
    let row = |y: usize| drawings.iter().flat_map(move |d| d.0[y * SIDE..(y + 1) * SIDE].iter().copied());
    let pixels: Vec<u8> = (0..SIDE).flat_map(row).collect();
    let bytes: Vec<u8> = pixels.chunks(4).map(|p| p.iter().fold(0, |byte, color| byte << 2 | color)).collect();
    encoder.write_header().expect("a header").write_image_data(&bytes).expect("pixels");
}

/// Reads `count` drawings that stand side by side; `None` if the file does not hold them.
fn read_png(path: &Path, count: usize) -> Option<Vec<Drawing>> {
    let file = std::io::BufReader::new(std::fs::File::open(path).ok()?);
    let mut reader = png::Decoder::new(file).read_info().ok()?;
    let mut bytes = vec![0; SIDE * SIDE * count / 4];
    if reader.output_buffer_size()? != bytes.len() {
        return None;
    }
    reader.next_frame(&mut bytes).ok()?;
    let pixels: Vec<u8> = bytes.iter().flat_map(|b| [6, 4, 2, 0].map(|shift| b >> shift & 3)).collect();
    let of = |k: usize| Drawing(pixels.chunks(SIDE).skip(k).step_by(count).flatten().copied().collect());
    Some((0..count).map(of).collect())
}

/// A line of counts for each tree; lengths in m, the area of leaves in m2.
fn counts(name: &str, trees: &[MatureTree]) -> String {
    let mut text = String::new();
    for (seed, tree) in (1..).zip(trees) {
        let m = &tree.measures;
        writeln!(
            text,
            "{name} {seed}: nodes {}, tips {}, leaves {:.2}, height {:.3}, spread {:.3}, stem {:.4}",
            m.nodes, m.tips, m.leaf_area, m.height, m.crown_width, m.dbh
        )
        .expect("a string takes any text");
    }
    text
}

#[test]
fn every_table_has_its_counts() {
    only_in_release!();
    let found: String = MATURE.iter().map(|(name, trees)| counts(name, trees)).collect();
    let path = folder().join("counts.txt");
    if blesses() {
        std::fs::write(&path, &found).expect("written");
        panic!("blessed; look at {}", path.display());
    }
    let kept = std::fs::read_to_string(&path).unwrap_or_default();
    let changed: Vec<&str> = found.lines().filter(|line| !kept.lines().any(|k| k == *line)).collect();
    assert!(kept == found, "other than in {}:\n{}", path.display(), changed.join("\n"));
}

#[test]
fn every_table_looks_as_it_did() {
    only_in_release!();
    let mut faults = Vec::new();
    for (name, trees) in MATURE.iter() {
        let path = folder().join(format!("{name}.png"));
        let drawings: Vec<&Drawing> = trees.iter().map(|tree| &tree.drawing).collect();
        // Two individuals differ by more than the tolerance, so that the measure tells trees apart.
        let individuals = drawings[0].difference(drawings[1]);
        assert!(individuals > INDIVIDUALS, "{name}: seeds 1 and 2 differ by {individuals:.3}");
        if blesses() {
            write_png(&path, &drawings);
            faults.push(format!("{name}: blessed; look at {}", path.display()));
            continue;
        }
        let Some(kept) = read_png(&path, drawings.len()) else {
            faults.push(format!("{}: no drawings; OSIER_BLESS=1 makes them", path.display()));
            continue;
        };
        for (seed, (kept, drawing)) in (1..).zip(kept.iter().zip(&drawings)) {
            let difference = kept.difference(drawing);
            if difference > TOLERANCE {
                faults.push(format!("{name} {seed}: {difference:.3} of the drawing is elsewhere"));
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}
