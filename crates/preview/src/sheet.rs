//! Contact sheets: many pictures of one size in a grid, with captions.

use super::lettering::Letters;
use super::picture::Picture;
use osier_base::convert::saturating_byte;

const GAP: u32 = 10;
const PAPER: [u8; 4] = [246, 245, 241, 255];
const INK: [u8; 3] = [52, 54, 50];
const FAINT: [u8; 3] = [120, 122, 116];

/// A picture with its caption.
#[derive(Debug, Clone)]
pub struct ContactSheetCell {
    /// The picture.
    pub picture: Picture,
    /// One line below it.
    pub caption: String,
}

/// Columns that make a sheet of `n` cells about as wide as high.
pub fn columns(n: usize) -> usize {
    (1..=n.max(1)).find(|c| c * c >= n).unwrap_or(1)
}

/// Size of a sheet of `n` cells of `size` pixels, with a title line.
pub fn size(n: usize, columns: usize, size: [u32; 2]) -> [u64; 2] {
    let columns = columns.clamp(1, n.max(1));
    let rows = n.div_ceil(columns) as u64;
    let line = u64::from(Letters::Small.height() + 2 * GAP);
    let step = |pixels: u32| u64::from(pixels) + u64::from(GAP);
    let title = u64::from(Letters::Large.height() + GAP);
    [columns as u64 * step(size[0]) + u64::from(GAP), rows * (u64::from(size[1]) + line) + u64::from(GAP) + title]
}

/// Lays cells out row by row. `note`: fainter text beside the title.
pub fn sheet(title: &str, note: &str, cells: &[ContactSheetCell], columns: usize) -> Picture {
    let columns = columns.clamp(1, cells.len().max(1));
    let [w, h] = cells.first().map_or([1, 1], |c| [c.picture.width, c.picture.height]);
    let [width, height] = size(cells.len(), columns, [w, h]).map(|v| u32::try_from(v).unwrap_or(u32::MAX));
    let mut out = Picture::filled(width, height, PAPER);
    let room = width.saturating_sub(2 * GAP);
    let title = Letters::Large.fit(title, room);
    out.write(&title, [GAP, GAP / 2 + 2], Letters::Large, INK);
    let used = u32::try_from(title.chars().count()).unwrap_or(0) * Letters::Large.width() + 2 * GAP;
    let note = Letters::Small.fit(note, room.saturating_sub(used));
    out.write(&note, [GAP + used, GAP / 2 + 8], Letters::Small, FAINT);
    let top = Letters::Large.height() + 2 * GAP;
    let line = Letters::Small.height() + 2 * GAP;
    for (i, cell) in cells.iter().enumerate() {
        let index = |n: usize| u32::try_from(n).unwrap_or(0);
        let (x, y) = (GAP + index(i % columns) * (w + GAP), top + index(i / columns) * (h + line));
        out.paste_over(&cell.picture, x, y);
        let caption = Letters::Small.fit(&cell.caption, w);
        let length = u32::try_from(caption.chars().count()).unwrap_or(0) * Letters::Small.width();
        out.write(&caption, [x + (w.saturating_sub(length)) / 2, y + h + GAP / 2], Letters::Small, INK);
    }
    out
}

impl Picture {
    /// Lays a picture with alpha over this one.
    pub fn paste_over(&mut self, other: &Self, x: u32, y: u32) {
        for v in 0..other.height {
            for u in 0..other.width {
                let (over, under) = (other.at(u, v), self.at(x + u, y + v));
                let a = u32::from(over[3]);
                let mix = |o: u8, b: u8| saturating_byte((u32::from(o) * a + u32::from(b) * (255 - a) + 127) / 255);
                let alpha = over[3].max(under[3]);
                self.set(x + u, y + v, [mix(over[0], under[0]), mix(over[1], under[1]), mix(over[2], under[2]), alpha]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_stand_in_rows_and_nothing_is_cut() {
        assert_eq!((columns(1), columns(4), columns(5), columns(16)), (1, 2, 3, 4));
        let cell = |shade: u8| ContactSheetCell {
            picture: Picture::filled(40, 30, [shade, 0, 0, 255]),
            caption: format!("seed {shade}"),
        };
        let cells: Vec<ContactSheetCell> = (1..=5).map(cell).collect();
        let out = sheet("oak", "", &cells, 3);
        assert_eq!([u64::from(out.width), u64::from(out.height)], size(5, 3, [40, 30]));
        for shade in 1..=5_u8 {
            assert_eq!(out.pixels.iter().filter(|p| **p == [shade, 0, 0, 255]).count(), 1200);
        }
    }
}
