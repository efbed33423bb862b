//! Mean and spread of maps over the runs of a sweep that differ in their seeds only.

use serde_json::json;

use super::super::exr::floats;
use super::super::textures;
use osier_base::Result;
use osier_base::convert::index;
use osier_base::files::Folder;
use osier_base::math::narrow;
use osier_scene::{Field, Image, ImageKind, Pixels};

/// Mean and standard deviation of one map over runs, texel by texel.
#[derive(Debug, Clone)]
pub struct MapStatistics {
    field: Field,
    count: u32,
    mean: Vec<f64>,
    /// Sum of squared deviations from the mean of each texel.
    squares: Vec<f64>,
}

impl MapStatistics {
    /// Statistics before the first run; all maps that follow have the size of `field`.
    pub fn new(field: Field) -> Self {
        let texels = field.width * field.height;
        Self { field, count: 0, mean: vec![0.0; texels], squares: vec![0.0; texels] }
    }

    /// Adds the values of a run, row by row.
    pub fn add(&mut self, values: &[f32]) {
        self.count += 1;
        let weight = f64::from(self.count).recip();
        for ((mean, squares), v) in self.mean.iter_mut().zip(&mut self.squares).zip(values) {
            // Welford's recurrence: exact for equal values, since it subtracts no large sums.
            let from_old = f64::from(*v) - *mean;
            *mean += from_old * weight;
            *squares += from_old * (f64::from(*v) - *mean);
        }
    }

    /// Standard deviation of each texel over the runs, with n - 1 in the denominator; `None` for a single run.
    pub fn deviation(&self) -> Option<Vec<f32>> {
        let freedom = f64::from(self.count.checked_sub(1).filter(|n| *n > 0)?);
        Some(self.squares.iter().map(|s| narrow((s / freedom).sqrt())).collect())
    }

    /// Mean of each texel over the runs, row by row; 0 before the first run.
    pub fn mean(&self) -> Vec<f32> {
        self.mean.iter().map(|m| narrow(*m)).collect()
    }

    /// Largest mean of a texel; 0 if none is above 0.
    pub fn largest(&self) -> f64 {
        self.mean.iter().copied().fold(0.0, f64::max)
    }

    /// Writes `<folder>/<name>_mean.exr`, of several runs `<name>_deviation.exr`, and, for viewing, `<name>_mean.png`: from white (0) to dark red
    /// (`brightest`, 1/m^2), on a square-root scale.
    /// # Errors
    /// `Io`; X012 for a map beyond the sizes of an image.
    pub fn write(&self, folder: &Folder, path: &str, brightest: f64) -> Result<()> {
        let deviation = self.deviation().map(|values| ("deviation", values));
        for (statistic, values) in std::iter::once(("mean", self.mean())).chain(deviation) {
            let comment = json!({
                "map": self.field.what, "name": self.field.name, "statistic": statistic, "runs": self.count,
                "unit": self.field.unit, "texel_area_m2": self.field.texel_area(),
                "corner_m": self.field.corner.to_array(), "along_m": self.field.along.to_array(),
                "down_m": self.field.down.to_array(),
            });
            let bytes = floats(self.field.width, self.field.height, 1, &values, &comment.to_string())?;
            folder.write(&format!("{path}/{}_{statistic}.exr", self.field.name), "exr.field", &bytes)?;
        }
        let image = self.picture(brightest)?;
        folder.write(&format!("{path}/{}_mean.png", self.field.name), "png.field", &textures::png(&image)?)
    }

    /// The mean as an image of at least `MIN_PICTURE_SIDE` pixels along its longer side.
    fn picture(&self, brightest: f64) -> Result<Image> {
        // Texels are repeated a whole number of times, so that their borders stay sharp.
        let zoom = MIN_PICTURE_SIDE.div_ceil(self.field.width.max(self.field.height).max(1));
        let (width, height) = (self.field.width * zoom, self.field.height * zoom);
        let mut pixels: Vec<u8> = Vec::with_capacity(width * height * 3);
        for y in 0..height {
            for x in 0..width {
                let value = self.mean[y / zoom * self.field.width + x / zoom];
                pixels.extend(map_color((value / brightest.max(f64::MIN_POSITIVE)).clamp(0.0, 1.0).sqrt()));
            }
        }
        Ok(Image {
            name: self.field.name.clone(),
            kind: ImageKind::Color,
            width: index(width, "pixels of a row")?,
            height: index(height, "rows of a picture")?,
            channels: 3,
            pixels: Pixels::U8(pixels),
        })
    }
}

/// Pixels along the longer side of a map's picture at least. Own: readable on a screen.
const MIN_PICTURE_SIDE: usize = 640;

/// Colour of a share of the largest value, 0 to 1: white, yellow, orange, dark red, with falling lightness.
fn map_color(share: f64) -> [u8; 3] {
    const STOPS: [[f64; 3]; 5] =
        [[255.0, 255.0, 255.0], [254.0, 224.0, 144.0], [253.0, 141.0, 60.0], [203.0, 24.0, 29.0], [70.0, 0.0, 20.0]];
    let position = share * (STOPS.len() - 1) as f64;
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 3")]
    let i = (position as usize).min(STOPS.len() - 2);
    let t = position - i as f64;
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 255")]
    [0, 1, 2].map(|c| (STOPS[i][c] * (1.0 - t) + STOPS[i + 1][c] * t).round() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn field() -> Field {
        Field {
            name: "ground".into(),
            what: "deposition",
            width: 2,
            height: 1,
            corner: Vec3::ZERO,
            along: Vec3::X,
            down: Vec3::Z,
            unit: "1/m^2",
            every: None,
        }
    }

    #[test]
    fn mean_and_deviation_are_those_of_the_values() {
        let mut map = MapStatistics::new(field());
        for value in [2.0, 4.0, 9.0] {
            map.add(&[value, 1.0]);
        }
        assert_eq!(map.mean(), [5.0, 1.0]);
        // Squared deviations 9 + 1 + 16 = 26, over n - 1 = 2.
        assert_eq!(map.deviation(), Some(vec![13.0_f32.sqrt(), 0.0]));
        let mut single = MapStatistics::new(field());
        single.add(&[7.0, 1.0]);
        assert_eq!(single.deviation(), None);
    }
}
