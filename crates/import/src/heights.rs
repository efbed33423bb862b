//! Height maps: PNG of 8 or 16 bits, EXR of floats.

use std::io::Cursor;
use std::path::Path;

use exr::prelude::{FlatSamples, ReadChannels as _, ReadLayers as _, read};
use image::DynamicImage;

use crate::{ImportContext, ImportOptions, ImportResult, images};
use osier_base::{Error, Result};

/// First bytes of an OpenEXR file: the number 20000630, little-endian.
const EXR_MAGIC: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];
/// Names of the channel that holds heights, in the order in which they are looked for; case is ignored.
const CHANNELS: [&str; 6] = ["Y", "height", "Z", "displacement", "R", "G"];

/// No-data values of GIS programs, which mark pixels without a height; -10,000 is -9999 in 16 bits.
const NO_DATA: [f32; 5] = [-9_999.0, -10_000.0, -32_767.0, -32_768.0, -99_999.0];
/// Least magnitude of values that cannot be heights in any unit: no-data marks such as -3.4e38 and 1e20. Own.
const NO_HEIGHT: f32 = 1e9;

/// Unit of the values of a height map: fractions of a range that is still to be given, or lengths.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HeightUnit {
    /// Fractions of the range from black (0) to white (1). A picture of whole numbers has this number of steps.
    Fraction {
        /// Number of steps from black to white: 255 or 65,535.
        steps: u32,
    },
    /// Numbers as they are, metres by convention.
    Values,
}

/// A height map, rows from the top.
#[derive(Debug, Clone, PartialEq)]
pub struct HeightMap {
    /// Width, pixels, at least 2.
    pub width: usize,
    /// Height, pixels, at least 2.
    pub height: usize,
    /// Heights in `unit`, row by row from the top left; all finite.
    pub values: Vec<f32>,
    /// Whether `values` are fractions of a range or numbers as the file has them.
    pub unit: HeightUnit,
}

pub(crate) fn is_exr(bytes: &[u8]) -> bool {
    bytes.starts_with(&EXR_MAGIC)
}

/// Reads a height map from a PNG (the mean of its colours as they are stored) or an EXR (its channel Y, height, Z, displacement, R
/// or G, or the only one that it has).
/// # Errors
/// `Input` with X001 for a value that is not finite, X010 for a file that is damaged, of another format, over a limit, smaller than
/// 2 x 2 pixels, or with numbers that mark pixels without a height.
pub fn read_heights(path: &Path, bytes: &[u8], options: &ImportOptions<'_>) -> Result<HeightMap> {
    let context = ImportContext::new(path, bytes, options);
    let map = if is_exr(bytes) { from_exr(&context, bytes) } else { from_picture(&context, bytes) };
    map.and_then(|map| check(&context, map)).map_err(|d| Error::from(*d))
}

/// Fails for maps without a cell, and for values that are no heights.
fn check(context: &ImportContext<'_>, map: HeightMap) -> ImportResult<HeightMap> {
    if map.width < 2 || map.height < 2 {
        let message = format_args!("the height map has {} x {} pixels", map.width, map.height);
        return Err(Box::new(context.error_in_file("X010", message).help("it needs at least 2 x 2: one cell of land")));
    }
    if let Some(i) = map.values.iter().position(|v| !v.is_finite()) {
        let bad = map.values.iter().filter(|v| !v.is_finite()).count();
        let (x, y) = (i % map.width, i / map.width);
        let message = format_args!(
            "{bad} heights are not finite numbers, the first ({}) at pixel {x}, {y} from the top left",
            map.values[i]
        );
        return Err(Box::new(context.error_in_file("X001", message).help(FILL_GAPS)));
    }
    if let Some(mark) = no_data_mark(&map) {
        let is_mark = |v: &f32| v.to_bits() == mark.to_bits();
        let count = map.values.iter().filter(|v| is_mark(v)).count();
        let first = map.values.iter().position(is_mark).unwrap_or(0);
        let (x, y) = (first % map.width, first / map.width);
        let shown = if mark.abs() < NO_HEIGHT { mark.to_string() } else { format!("{mark:e}") };
        let message = format_args!(
            "{count} heights are {shown}, which marks pixels without a height, the first at pixel {x}, {y} from the top left"
        );
        return Err(Box::new(context.error_in_file("X010", message).help(FILL_GAPS)));
    }
    Ok(map)
}

/// Advice for an elevation model that has pixels without a height.
const FILL_GAPS: &str = "fill gaps of the elevation model before export; programs for maps call it \"fill no data\"";

/// The value that marks pixels without a height in a map, if it has one. A mark of [`NO_DATA`] counts as a height if
/// other values lie below half of it.
fn no_data_mark(map: &HeightMap) -> Option<f32> {
    if map.unit != HeightUnit::Values {
        return None;
    }
    let huge = map.values.iter().copied().find(|v| v.abs() >= NO_HEIGHT);
    huge.or_else(|| {
        NO_DATA.into_iter().find(|mark| {
            let is_mark = |v: &f32| v.to_bits() == mark.to_bits();
            map.values.iter().any(is_mark) && !map.values.iter().any(|v| *v < mark / 2.0 && !is_mark(v))
        })
    })
}

/// Heights of a PNG (a JPEG where one is allowed), 0 black to 1 white: the mean of its colours as they are stored, without alpha.
fn from_picture(context: &ImportContext<'_>, bytes: &[u8]) -> ImportResult<HeightMap> {
    let picture = images::decode_deep(context, "height map", bytes, &mut 0)?;
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    let deep = matches!(
        picture,
        DynamicImage::ImageLuma16(_)
            | DynamicImage::ImageLumaA16(_)
            | DynamicImage::ImageRgb16(_)
            | DynamicImage::ImageRgba16(_)
    );
    // Grey with or without alpha has one colour, all others three; alpha is left out.
    let color = picture.color();
    let (channels, colors) = (usize::from(color.channel_count()), if color.has_color() { 3_u8 } else { 1 });
    let mean = |sum: u32, steps: f32| sum as f32 / (f32::from(colors) * steps);
    let (steps, values): (u32, Vec<f32>) = if deep {
        let sum = |p: &[u16]| p.iter().take(usize::from(colors)).map(|v| u32::from(*v)).sum::<u32>();
        let samples = match &picture {
            DynamicImage::ImageLuma16(p) => p.as_raw(),
            DynamicImage::ImageLumaA16(p) => p.as_raw(),
            DynamicImage::ImageRgb16(p) => p.as_raw(),
            other => &other.to_rgba16().into_raw(),
        };
        (65_535, samples.chunks_exact(channels).map(|p| mean(sum(p), 65_535.0)).collect())
    } else {
        let sum = |p: &[u8]| p.iter().take(usize::from(colors)).map(|v| u32::from(*v)).sum::<u32>();
        (255, picture.as_bytes().chunks_exact(channels).map(|p| mean(sum(p), 255.0)).collect())
    };
    Ok(HeightMap { width, height, values, unit: HeightUnit::Fraction { steps } })
}

/// Heights of the first layer of an EXR that has them.
fn from_exr(context: &ImportContext<'_>, bytes: &[u8]) -> ImportResult<HeightMap> {
    let damaged = |e: &dyn std::fmt::Display| context.error_in_file("X010", format_args!("EXR is damaged: {e}"));
    // Sizes come from the header: nothing is decoded before they are within the limits.
    let header = exr::meta::MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(|e| damaged(&e))?;
    let limit = context.options.limits.get("image-side");
    for layer in &header.headers {
        let (width, height) = (layer.layer_size.width(), layer.layer_size.height());
        if width.max(height) as u64 > limit {
            let message = format_args!("height map of {width} x {height} pixels, the limit is {limit} a side");
            return Err(Box::new(
                context.error_in_file("X010", message).help("make it smaller, or use --max-image-side"),
            ));
        }
        let size = (layer.channels.bytes_per_pixel as u64).saturating_mul((width as u64).saturating_mul(height as u64));
        images::spend(context, "height map", size, &mut 0)?;
    }
    let picture = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(bytes))
        .map_err(|e| damaged(&e))?;
    let layer = picture.layer_data;
    // The channel of heights: by name, else the only one.
    let channels = layer.channel_data.list;
    let named = |name: &&str| channels.iter().position(|c| c.name.to_string().eq_ignore_ascii_case(name));
    let only = (channels.len() == 1).then_some(0);
    let Some(index) = CHANNELS.iter().find_map(named).or(only) else {
        let names: Vec<String> = channels.iter().map(|c| c.name.to_string()).collect();
        let names = names.join(", ");
        let message = format_args!("no channel holds heights; it has {names}");
        let help = format!("name the channel of heights one of {}", CHANNELS.join(", "));
        return Err(Box::new(context.error_in_file("X010", message).help(help)));
    };
    let values: Vec<f32> = match channels.into_iter().nth(index).map(|c| c.sample_data) {
        Some(FlatSamples::F16(v)) => v.into_iter().map(|h| h.to_f32()).collect(),
        Some(FlatSamples::F32(v)) => v,
        Some(FlatSamples::U32(v)) => v.into_iter().map(|h| h as f32).collect(),
        None => Vec::new(),
    };
    let (width, height) = (layer.size.width(), layer.size.height());
    // A subsampled channel has fewer values than the layer has pixels.
    if values.len() != width * height {
        return Err(damaged(&"its channel of heights is subsampled"));
    }
    Ok(HeightMap { width, height, values, unit: HeightUnit::Values })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::UpAxis;
    use exr::prelude::{AnyChannel, AnyChannels, Encoding, Image, Layer, LayerAttributes, WritableImage as _};
    use image::{ImageBuffer, ImageFormat, Luma, Rgb};
    use osier_base::files::SearchPaths;
    use osier_base::limits::Limits;
    use osier_scene::MaterialClass;

    fn heights_within(bytes: &[u8], limits: &Limits) -> std::result::Result<HeightMap, String> {
        let options = ImportOptions {
            roots: &SearchPaths::none(),
            limits,
            up: UpAxis::Y,
            scale: 1.0,
            class: MaterialClass::Ground,
        };
        read_heights(Path::new("hills.png"), bytes, &options).map_err(|e| match e {
            Error::Input(report) => report.diagnostics.iter().map(|d| format!("{} {}", d.code, d.message)).collect(),
            other => other.to_string(),
        })
    }

    fn heights(bytes: &[u8]) -> std::result::Result<HeightMap, String> {
        heights_within(bytes, &Limits::default())
    }

    fn png(picture: impl Into<DynamicImage>) -> Vec<u8> {
        let mut out = Cursor::new(Vec::new());
        picture.into().write_to(&mut out, ImageFormat::Png).expect("png");
        out.into_inner()
    }

    fn exr_of(width: usize, height: usize, channels: &[(&str, FlatSamples)]) -> Vec<u8> {
        let list = channels.iter().map(|(name, samples)| AnyChannel::new(*name, samples.clone())).collect();
        let layer =
            Layer::new((width, height), LayerAttributes::named("a"), Encoding::FAST_LOSSLESS, AnyChannels::sort(list));
        let mut out = Cursor::new(Vec::new());
        Image::from_layer(layer).write().to_buffered(&mut out).expect("exr");
        out.into_inner()
    }

    #[test]
    fn depth_and_order_of_pictures_are_kept() {
        let deep = ImageBuffer::<Luma<u16>, _>::from_vec(3, 2, vec![0_u16, 1, 65_535, 256, 257, 32_768]).expect("fits");
        let map = heights(&png(deep)).expect("heights");
        assert_eq!((map.width, map.height, map.unit), (3, 2, HeightUnit::Fraction { steps: 65_535 }));
        assert!((map.values[1] - 1.0 / 65_535.0).abs() < 1e-9 && (map.values[4] - 257.0 / 65_535.0).abs() < 1e-7);
        assert!((map.values[2] - 1.0).abs() < 1e-7);
        let coarse = ImageBuffer::<Rgb<u8>, _>::from_vec(2, 2, vec![0_u8, 3, 6, 255, 255, 255, 0, 0, 0, 9, 9, 9]);
        let map = heights(&png(coarse.expect("fits"))).expect("heights");
        assert_eq!(map.unit, HeightUnit::Fraction { steps: 255 });
        assert!((map.values[0] - 3.0 / 255.0).abs() < 1e-7 && (map.values[3] - 9.0 / 255.0).abs() < 1e-7);
    }

    #[test]
    fn the_channel_of_heights_is_found() {
        let of = |name: &'static str, v: [f32; 4]| (name, FlatSamples::F32(v.to_vec()));
        let map = heights(&exr_of(2, 2, &[of("A", [0.0; 4]), of("Y", [-3.5, 0.0, 7.25, 812.0])])).expect("heights");
        assert_eq!((map.values, map.unit), (vec![-3.5, 0.0, 7.25, 812.0], HeightUnit::Values));
        assert_eq!(heights(&exr_of(2, 2, &[of("elevation", [1.0; 4])])).expect("only one").values, [1.0; 4]);
        let none = heights(&exr_of(2, 2, &[of("mask", [1.0; 4]), of("snow", [1.0; 4])]));
        assert!(none.expect_err("no heights").contains("it has mask, snow"));
    }

    /// Elevation models mark their gaps by numbers, which would be holes of kilometres.
    #[test]
    fn marks_of_missing_heights_are_told() {
        let of = |v: [f32; 4]| heights(&exr_of(2, 2, &[("Y", FlatSamples::F32(v.to_vec()))]));
        for mark in [-9_999.0, -10_000.0, -32_768.0, f32::MIN, 1e20] {
            let said = of([210.5, 285.0, mark, mark]).expect_err("a gap");
            assert!(
                said.starts_with("X010 ") && said.contains("2 heights are ") && said.contains("pixel 0, 1"),
                "{said}"
            );
        }
        // The floor of a deep sea is no gap.
        assert!(of([-9_999.0, -9_998.0, -9_000.0, 5.0]).is_ok() && of([-9_000.0, 0.0, 8_848.0, 9_999.0]).is_ok());
    }

    #[test]
    fn bad_maps_are_refused() {
        let gap = exr_of(2, 2, &[("Y", FlatSamples::F32(vec![1.0, 2.0, f32::NAN, f32::INFINITY]))]);
        let said = heights(&gap).expect_err("not finite");
        assert!(said.starts_with("X001") && said.contains("2 heights") && said.contains("pixel 0, 1"), "{said}");
        let line = exr_of(4, 1, &[("Y", FlatSamples::F32(vec![1.0; 4]))]);
        assert!(heights(&line).expect_err("no cell").contains("4 x 1 pixels"));
        assert!(heights(&line[..line.len() - 6]).expect_err("cut").starts_with("X010"));
        assert!(heights(b"").expect_err("empty").starts_with("X010"));
        for other in [&b"II*\0\x08\0\0\0"[..], b"BM\x1e\0\0\0"] {
            let said = heights(other).expect_err("another format");
            assert!(said.contains("neither PNG nor JPEG") && !said.contains("damaged"), "{said}");
        }
        let mut small = Limits::default();
        small.set("image-side", "3").expect("limit");
        assert!(heights_within(&line, &small).expect_err("too large").contains("the limit is 3 a side"));
    }
}
