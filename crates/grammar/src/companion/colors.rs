//! Colours by index: colour maps and material files.

use crate::notation::Notation;
use osier_base::math::narrow;
use osier_base::units::linear_from_srgb;

/// Number of colour indices, which are bytes.
const COUNT: usize = 256;
/// Bytes of a material record: index, transparency, ambient, diffuse, emissive and specular colour, shininess.
const RECORD: usize = 15;
/// Roughness of the colours of a colour map, whose files hold none. Own: a dull surface, as of leaves and stems.
const ROUGHNESS: f32 = 0.55;

/// Sixteen colours that are easy to distinguish, sRGB. Own: the colours of plants first, in the order in which `;` meets them
/// from the initial index 128 on.
const PALETTE: [[u8; 3]; 16] = [
    [0x7a, 0x5c, 0x3e], // bark
    [0x4f, 0x7a, 0x33], // leaf
    [0x9f, 0xb0, 0x4c], // young leaf
    [0xe6, 0xc8, 0x4f], // yellow
    [0xe0, 0x8a, 0x2e], // orange
    [0xc8, 0x40, 0x2f], // red
    [0xd9, 0x77, 0xa6], // pink
    [0x8e, 0x4a, 0x8c], // purple
    [0x5a, 0x6f, 0xb5], // blue
    [0x6f, 0xb3, 0xc9], // light blue
    [0x2f, 0x5d, 0x3a], // dark green
    [0xb5, 0x9a, 0x6a], // straw
    [0xf2, 0xef, 0xe6], // white
    [0x9a, 0x9a, 0x94], // grey
    [0x4a, 0x40, 0x38], // dark brown
    [0x1f, 0x1f, 0x1f], // black
];

/// Colours 1 to 15 of LParser's viewer, sRGB, toned down to suit paint and bark; every other index is [`LPARSER_OTHER`], dark
/// grey.
const LPARSER_PALETTE: [[u8; 3]; 15] = [
    [0x1f, 0x1f, 0x1f], // black
    [0xc8, 0x30, 0x2a], // red
    [0xe8, 0xc8, 0x40], // yellow
    [0x5c, 0xa8, 0x3c], // green
    [0x50, 0xb4, 0xbe], // cyan
    [0x3c, 0x5a, 0xb4], // blue
    [0xb4, 0x46, 0xa0], // magenta
    [0x2f, 0x6d, 0x33], // dark green
    [0x24, 0x64, 0x68], // dark cyan
    [0x24, 0x30, 0x70], // dark blue
    [0x68, 0x22, 0x5c], // dark magenta
    [0x6e, 0x4a, 0x2c], // brown
    [0x47, 0x5e, 0x26], // olive
    [0x8c, 0x8c, 0x88], // grey
    [0xf2, 0xef, 0xe6], // white
];
const LPARSER_OTHER: [u8; 3] = [0x48, 0x48, 0x46];
/// Materials of L-Py's turtle, sRGB: 0 grey, then brown, green, red, yellow, blue and purple, repeated from index 0 on.
const LPY_PALETTE: [[u8; 3]; 7] = [
    [0x96, 0x96, 0x90], // grey
    [0x70, 0x4e, 0x28], // brown
    [0x54, 0x8c, 0x2c], // green
    [0xb4, 0x26, 0x22], // red
    [0xc8, 0xb8, 0x3c], // yellow
    [0x2e, 0x38, 0x90], // blue
    [0x88, 0x2c, 0x88], // purple
];
/// The sixteen colours of Fractint's default map, repeated; black and white are exchanged because the background is light here.
const FRACTINT_PALETTE: [[u8; 3]; 16] = [
    [0xf2, 0xef, 0xe6], // white
    [0x2a, 0x38, 0xa0], // blue
    [0x2f, 0x8c, 0x3a], // green
    [0x2a, 0x8c, 0x8c], // cyan
    [0xa8, 0x24, 0x20], // red
    [0x98, 0x2a, 0x90], // magenta
    [0x8c, 0x5a, 0x24], // brown
    [0xb0, 0xb0, 0xac], // light grey
    [0x58, 0x58, 0x56], // dark grey
    [0x5a, 0x6c, 0xdc], // light blue
    [0x6c, 0xc8, 0x5a], // light green
    [0x5a, 0xc4, 0xcc], // light cyan
    [0xe0, 0x5a, 0x50], // light red
    [0xd2, 0x64, 0xc8], // light magenta
    [0xe8, 0xcc, 0x48], // yellow
    [0x1f, 0x1f, 0x1f], // black
];

/// Material that a turtle's colour index stands for: diffuse colour, roughness and transparency.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceColor {
    /// Linear RGB of the diffuse colour, 0 to 1.
    pub base: [f32; 3],
    /// 0 mirror to 1 matt.
    pub roughness: f32,
    /// Fraction of light that passes through, 0 to 1.
    pub transparency: f32,
}

/// Material of each colour index, 0 to 255, that a turtle can select.
#[derive(Debug, Clone, PartialEq)]
pub struct ColorTable {
    colors: Vec<SurfaceColor>,
}

impl Default for ColorTable {
    /// Sixteen colours, repeated: index i has the colour of i modulo 16, from brown (0) over greens, yellow and red to black
    /// (15).
    fn default() -> Self {
        Self { colors: PALETTE.iter().cycle().take(COUNT).map(|c| plain(*c)).collect() }
    }
}

fn plain(srgb: [u8; 3]) -> SurfaceColor {
    SurfaceColor { base: srgb.map(linear), roughness: ROUGHNESS, transparency: 0.0 }
}

fn linear(byte: u8) -> f32 {
    linear_from_srgb(f32::from(byte) / 255.0)
}

impl ColorTable {
    /// Default palette of the program that a notation belongs to.
    pub fn of(notation: Notation) -> Self {
        let repeated =
            |palette: &[[u8; 3]]| Self { colors: palette.iter().cycle().take(COUNT).map(|c| plain(*c)).collect() };
        match notation {
            Notation::Cpfg | Notation::Abop | Notation::Catkin => Self::default(),
            Notation::Fractint => repeated(&FRACTINT_PALETTE),
            Notation::LPy => repeated(&LPY_PALETTE),
            Notation::LParser => {
                let own: Vec<(u8, [u8; 3])> = (1_u8..).zip(LPARSER_PALETTE).collect();
                repeated(&[LPARSER_OTHER]).with(&own)
            }
        }
    }

    /// Reads a colour map: 256 times red, green and blue as sRGB bytes. A shorter map keeps the default colours of the other
    /// indices.
    /// # Errors
    /// A message if the bytes are not a colour map.
    pub fn from_map(bytes: &[u8]) -> Result<Self, String> {
        let expected = "a colour map is 256 times 3 bytes (768)";
        if bytes.is_empty() || bytes.len() > COUNT * 3 || !bytes.len().is_multiple_of(3) {
            return Err(format!("{expected}, the file has {} bytes", bytes.len()));
        }
        let mut table = Self::default();
        for (color, rgb) in table.colors.iter_mut().zip(bytes.chunks_exact(3)) {
            *color = plain([rgb[0], rgb[1], rgb[2]]);
        }
        Ok(table)
    }

    /// Reads a material file: records of 15 bytes, each of which begins with its index. The diffuse colour becomes the base
    /// colour.
    /// # Errors
    /// A message if the bytes are not a material file.
    pub fn from_mat(bytes: &[u8]) -> Result<Self, String> {
        if bytes.is_empty() || !bytes.len().is_multiple_of(RECORD) {
            return Err(format!(
                "a material file is a number of records of 15 bytes, the file has {} bytes",
                bytes.len()
            ));
        }
        let mut table = Self::default();
        for record in bytes.chunks_exact(RECORD) {
            let shininess = f64::from(record[14]);
            table.colors[usize::from(record[0])] = SurfaceColor {
                base: [record[5], record[6], record[7]].map(linear),
                // Phong exponent n to the width of a microfacet lobe, alpha = sqrt(2 / (n + 2)) (Walter et al. 2007);
                // alpha is the square of the roughness of materials, as in glTF and USD.
                roughness: narrow(osier_base::math::sqrt(osier_base::math::sqrt(2.0 / (shininess + 2.0)))),
                transparency: f32::from(record[1]) / 255.0,
            };
        }
        Ok(table)
    }

    /// Sets colours by pairs of index and sRGB colour; these entries become opaque, with the roughness of colour maps.
    #[must_use]
    pub fn with(mut self, colors: &[(u8, [u8; 3])]) -> Self {
        for (index, srgb) in colors {
            self.colors[usize::from(*index)] = plain(*srgb);
        }
        self
    }

    /// Material of an index; the table has an entry for all 256 indices.
    pub fn get(&self, index: u8) -> SurfaceColor {
        self.colors.get(usize::from(index)).copied().unwrap_or(plain(PALETTE[0]))
    }
}

#[cfg(test)]
#[allow(clippy::float_cmp, reason = "what is read is equal to the bit")]
mod tests {
    use super::*;

    #[test]
    fn a_map_holds_srgb_colors() {
        let mut bytes = vec![0; 768];
        bytes[129 * 3..129 * 3 + 3].copy_from_slice(&[255, 188, 0]);
        let table = ColorTable::from_map(&bytes).expect("a map");
        let color = table.get(129);
        assert!((color.base[0] - 1.0).abs() < 1e-6 && (color.base[1] - 0.503).abs() < 2e-3, "{color:?}");
        assert_eq!(table.get(128).base, [0.0; 3]);
        // A short map keeps the default for the rest.
        let short = ColorTable::from_map(&bytes[..3]).expect("one colour");
        assert_eq!(short.get(1), ColorTable::default().get(1));
    }

    #[test]
    fn a_material_has_its_diffuse_color_and_a_roughness_by_its_shininess() {
        let mut record = [0_u8; 15];
        record[0] = 7;
        record[1] = 51;
        record[5..8].copy_from_slice(&[255, 0, 255]);
        record[14] = 126;
        let color = ColorTable::from_mat(&record).expect("a material").get(7);
        assert_eq!(color.base, [1.0, 0.0, 1.0]);
        // alpha = sqrt(2 / 128) = 1/8, and the roughness its root.
        assert!((color.roughness - 0.353_553_4).abs() < 1e-6 && (color.transparency - 0.2).abs() < 1e-6, "{color:?}");
    }

    #[test]
    fn other_sizes_are_refused_with_the_size() {
        for n in [0, 1, 767, 769, 771] {
            let error = ColorTable::from_map(&vec![0; n]).expect_err("damaged");
            assert!(error.contains(&format!("{n} bytes")), "{error}");
        }
        for n in [0, 14, 16] {
            assert!(ColorTable::from_mat(&vec![0; n]).is_err());
        }
    }

    #[test]
    fn programs_have_their_own_colors() {
        let is_red = |c: SurfaceColor| c.base[0] > 3.0 * c.base[1] && c.base[0] > 3.0 * c.base[2];
        let is_green = |c: SurfaceColor| c.base[1] > 1.5 * c.base[0] && c.base[1] > 1.5 * c.base[2];
        let lparser = ColorTable::of(Notation::LParser);
        assert!(is_red(lparser.get(2)) && is_green(lparser.get(4)) && is_green(lparser.get(8)));
        assert_eq!((lparser.get(0), lparser.get(16)), (lparser.get(200), lparser.get(16)));
        let lpy = ColorTable::of(Notation::LPy);
        assert!(is_green(lpy.get(2)) && is_red(lpy.get(3)) && lpy.get(7) == lpy.get(0));
        let fractint = ColorTable::of(Notation::Fractint);
        assert!(is_green(fractint.get(2)) && is_red(fractint.get(4)) && fractint.get(18) == fractint.get(2));
        assert_eq!(ColorTable::of(Notation::Cpfg), ColorTable::default());
    }

    #[test]
    fn the_default_repeats_sixteen_different_colors() {
        let table = ColorTable::default();
        assert_eq!(table.get(128), table.get(0));
        let distinct: std::collections::BTreeSet<[u32; 3]> =
            (0..16).map(|i| table.get(i).base.map(f32::to_bits)).collect();
        assert_eq!(distinct.len(), 16);
    }
}
