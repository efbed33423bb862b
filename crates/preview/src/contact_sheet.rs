//! Contact sheets: pictures of one size in a grid, with captions.

use super::font::FontSize;
use super::picture::Picture;
use osier_base::Result;
use osier_base::convert::{index, narrow, saturating_byte};

/// Space between cells and around the sheet, pixels; captions have it above and below.
const GAP: u32 = 10;
/// Background of the sheet, sRGB and alpha.
const PAPER: [u8; 4] = [246, 245, 241, 255];
/// Colour of title and captions, sRGB.
const INK: [u8; 3] = [52, 54, 50];
/// Colour of the note beside the title, sRGB.
const FAINT_INK: [u8; 3] = [120, 122, 116];

/// A picture of a contact sheet and the caption below it.
#[derive(Debug, Clone)]
pub struct ContactSheetCell {
    /// A picture of the size that all cells of the sheet have.
    pub picture: Picture,
    /// One line below the picture, cut at its width.
    pub caption: String,
}

/// Number of columns that make a sheet of `n` cells about square.
pub fn contact_sheet_columns(n: usize) -> usize {
    (1..=n.max(1)).find(|c| c * c >= n).unwrap_or(1)
}

/// Width and height of a sheet of `n` cells of `size` pixels with captions and a title line, pixels.
pub fn contact_sheet_size(n: usize, columns: usize, size: [u32; 2]) -> [u64; 2] {
    let columns = columns.clamp(1, n.max(1));
    let rows = n.div_ceil(columns) as u64;
    let caption = u64::from(FontSize::Small.height() + 2 * GAP);
    let step = |pixels: u32| u64::from(pixels) + u64::from(GAP);
    let title = u64::from(FontSize::Large.height() + GAP);
    [columns as u64 * step(size[0]) + u64::from(GAP), rows * (u64::from(size[1]) + caption) + u64::from(GAP) + title]
}

/// Draws a sheet, row by row. `note`: fainter text beside the title.
/// # Errors
/// `TooMany` for a sheet with a side beyond 32 bits.
/// # Examples
/// ```
/// use osier_preview::{ContactSheetCell, Picture, contact_sheet};
///
/// # fn main() -> osier_base::Result<()> {
/// let cell = |red| ContactSheetCell { picture: Picture::filled(40, 30, [red, 0, 0, 255]), caption: format!("red {red}") };
/// let sheet = contact_sheet("colours", "by red", &[cell(80), cell(160), cell(240)], 2)?;
/// assert_eq!((sheet.width, sheet.height), (110, 176));
/// # Ok(())
/// # }
/// ```
pub fn contact_sheet(title: &str, note: &str, cells: &[ContactSheetCell], columns: usize) -> Result<Picture> {
    let columns = columns.clamp(1, cells.len().max(1));
    let [w, h] = cells.first().map_or([1, 1], |c| [c.picture.width, c.picture.height]);
    let [width, height] = contact_sheet_size(cells.len(), columns, [w, h]);
    let (width, height) = (narrow(width, "columns of a sheet")?, narrow(height, "rows of a sheet")?);
    let mut out = Picture::filled(width, height, PAPER);
    // Title and note share the first line.
    let line_width = width.saturating_sub(2 * GAP);
    let title = FontSize::Large.cut(title, line_width);
    out.draw_text(&title, [GAP, GAP / 2 + 2], FontSize::Large, INK);
    let used = FontSize::Large.text_width(&title) + 2 * GAP;
    let note = FontSize::Small.cut(note, line_width.saturating_sub(used));
    out.draw_text(&note, [GAP + used, GAP / 2 + 8], FontSize::Small, FAINT_INK);
    // Cells follow row by row; each row is as high as a picture and its caption.
    let top = FontSize::Large.height() + 2 * GAP;
    let caption_height = FontSize::Small.height() + 2 * GAP;
    for (i, cell) in cells.iter().enumerate() {
        let (column, row) = (index(i % columns, "columns of a sheet")?, index(i / columns, "rows of a sheet")?);
        let (x, y) = (GAP + column * (w + GAP), top + row * (h + caption_height));
        out.composite_over(&cell.picture, x, y);
        // Captions are centred below their pictures.
        let caption = FontSize::Small.cut(&cell.caption, w);
        let left = x + w.saturating_sub(FontSize::Small.text_width(&caption)) / 2;
        out.draw_text(&caption, [left, y + h + GAP / 2], FontSize::Small, INK);
    }
    Ok(out)
}

impl Picture {
    /// Composites another picture with straight alpha over this one, in sRGB as image viewers do.
    fn composite_over(&mut self, other: &Self, x: u32, y: u32) {
        for v in 0..other.height {
            for u in 0..other.width {
                let (over, under) = (other.at(u, v), self.at(x + u, y + v));
                let a = u32::from(over[3]);
                // Adding 127 before the division rounds to the nearest integer.
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
        assert_eq!(
            (contact_sheet_columns(1), contact_sheet_columns(4), contact_sheet_columns(5), contact_sheet_columns(16)),
            (1, 2, 3, 4)
        );
        let cell = |shade: u8| ContactSheetCell {
            picture: Picture::filled(40, 30, [shade, 0, 0, 255]),
            caption: format!("seed {shade}"),
        };
        let cells: Vec<ContactSheetCell> = (1..=5).map(cell).collect();
        let out = contact_sheet("oak", "", &cells, 3).expect("a sheet");
        assert_eq!([u64::from(out.width), u64::from(out.height)], contact_sheet_size(5, 3, [40, 30]));
        for shade in 1..=5_u8 {
            assert_eq!(out.pixels.iter().filter(|p| **p == [shade, 0, 0, 255]).count(), 1200);
        }
    }
}
