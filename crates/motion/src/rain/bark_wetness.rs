//! Wetness of bark that drops strike: a patch of bark on which as many drops per area leave spots as on the bark of the plants.

use crate::rain::impact::weber_number;
use crate::rain::leaf::wetness::DryingLaw;
use crate::rain::tuning::MAX_BARK_SPREAD;
use osier_base::math;
use osier_base::rng::Rng;

/// A drop that has struck wood, and the spot that it wets there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WoodStrike {
    /// Index of the plant in the simulation.
    pub plant: usize,
    /// Time since the simulation began, s.
    pub t: f64,
    /// Radius of the wet spot, m.
    pub radius: f64,
}

/// Radius of the spot, m, that a drop of `diameter`, m, wets where it strikes wood at `speed`, m/s: the drop spreads to its largest
/// extent, and what it has covered there is soaked.
/// Source: Clanet, Béguin, Richard and Quéré 2004: the largest extent is D We^(1/4).
pub(in crate::rain) fn spot_radius(speed: f64, diameter: f64) -> f64 {
    // A drop that hardly moves wets what it touches at rest, about its diameter.
    let spread = math::sqrt(math::sqrt(weber_number(speed, diameter))).clamp(1.0, MAX_BARK_SPREAD);
    0.5 * diameter * spread
}

/// Size and address of a [`BarkPatch`], and the bark that it represents.
#[derive(Debug, Clone, PartialEq)]
pub struct BarkPatchParams {
    /// Texels along a side, at least 3.
    pub side: usize,
    /// Length of a side, m.
    pub width: f64,
    /// Area of the bark that the patch represents, m^2.
    pub bark_area: f64,
    /// How spots dry.
    pub law: DryingLaw,
    /// Seed of the random places of spots.
    pub seed: u64,
    /// Name that addresses these places, so that patches differ.
    pub name: String,
}

/// A square patch of bark that represents the bark of plants: its edges join, so that it tiles them as a texture does. Each drop that
/// strikes bark of the area A wets the expected number of spots, patch area over A, at random places of the patch.
#[derive(Debug, Clone)]
pub struct BarkPatch {
    params: BarkPatchParams,
    /// Spots that are due: a fraction below 1 between two strikes.
    due: f64,
    /// Spots wetted so far.
    spots: u64,
    /// Time at which each texel was last covered, s, row by row; negative infinity where it never was.
    covered: Vec<f32>,
}

impl BarkPatch {
    /// A dry patch.
    pub fn new(params: BarkPatchParams) -> Self {
        let covered = vec![f32::NEG_INFINITY; params.side * params.side];
        // The first spot is due after half of its share of drops, which rounds the number of spots to the nearest.
        Self { params, due: 0.5, spots: 0, covered }
    }

    /// Wets the patch by a drop that has struck the bark that it represents.
    pub fn wet(&mut self, strike: &WoodStrike) {
        let width = self.params.width;
        self.due += width * width / self.params.bark_area.max(f64::MIN_POSITIVE);
        // More spots than texels wet nothing more: all of them are covered at this time.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "not negative, and clamped")]
        let due = self.due.floor().min(self.covered.len() as f64) as u64;
        self.due = self.due.fract();
        for _ in 0..due {
            self.spots += 1;
            let path = ["bark".into(), self.params.name.as_str().into(), self.spots.into()];
            let mut draw = Rng::at(self.params.seed, &path);
            let center = [draw.range(0.0, 1.0), draw.range(0.0, 1.0)];
            self.cover(center, strike.radius / width, strike.t);
        }
    }

    /// Marks the texels within `radius` of `center`, both as fractions of a side, as covered at time `t`; over the edges as well.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "texels of the patch")]
    fn cover(&mut self, center: [f64; 2], radius: f64, t: f64) {
        let side = self.params.side as f64;
        let ([x, y], reach) = (center.map(|c| c * side), radius * side);
        // A spot never reaches round the patch to itself.
        let texels = reach.min(0.5 * side - 1.0).ceil() as i64;
        let (middle_x, middle_y) = (x.floor() as i64, y.floor() as i64);
        let wrapped = |k: i64| k.rem_euclid(self.params.side as i64) as usize;
        for row in middle_y - texels..=middle_y + texels {
            for column in middle_x - texels..=middle_x + texels {
                let (dx, dy) = (column as f64 + 0.5 - x, row as f64 + 0.5 - y);
                // The texel of the centre is wet even below a spot that is smaller.
                let is_middle = (column, row) == (middle_x, middle_y);
                if is_middle || dx * dx + dy * dy <= reach * reach {
                    self.covered[wrapped(row) * self.params.side + wrapped(column)] = math::narrow(t);
                }
            }
        }
    }

    /// Wetness of each texel at time `t`, s, row by row: 0 (dry) to 1.
    pub fn wetness(&self, t: f64) -> Vec<f32> {
        let one =
            |covered: &f32| if covered.is_finite() { math::narrow(self.params.law.wetness(*covered, t)) } else { 0.0 };
        self.covered.iter().map(one).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LAW: DryingLaw = DryingLaw { fraction: 0.5, time: 20.0 };

    fn patch(bark_area: f64) -> BarkPatch {
        BarkPatch::new(BarkPatchParams {
            side: 128,
            width: 0.256,
            bark_area,
            law: LAW,
            seed: 3,
            name: "oak_bark".into(),
        })
    }

    fn mean(values: &[f32]) -> f64 {
        values.iter().map(|w| f64::from(*w)).sum::<f64>() / values.len() as f64
    }

    /// n spots of the area a on bark of the area A leave the share exp(-n a / A) dry.
    #[test]
    fn the_wet_share_is_that_of_bark_that_is_struck_at_random() {
        let (radius, area) = (4e-3_f64, 2.0);
        let mut patch = patch(area);
        for n in 1..=30_000_u32 {
            patch.wet(&WoodStrike { plant: 0, t: 0.0, radius });
            if n % 10_000 == 0 {
                let dry = math::exp(-f64::from(n) * std::f64::consts::PI * radius * radius / area);
                let found = mean(&patch.wetness(0.0));
                assert!((found - (1.0 - dry)).abs() < 0.03, "{n}: {found} beside {}", 1.0 - dry);
            }
        }
    }

    #[test]
    fn spots_dry_and_are_wetted_again() {
        let mut patch = patch(0.1);
        let strike = |t| WoodStrike { plant: 0, t, radius: 5e-3 };
        patch.wet(&strike(0.0));
        let wet = mean(&patch.wetness(0.0));
        assert!(wet > 0.0 && (mean(&patch.wetness(20.0)) / wet - 0.5).abs() < 1e-4);
        assert_eq!(mean(&patch.wetness(1e4)).to_bits(), 0.0_f64.to_bits());
        // The patch represents two thirds of the bark: of three drops two wet it.
        for _ in 0..2 {
            patch.wet(&strike(20.0));
        }
        let texels = patch.wetness(20.0);
        assert!(texels.iter().any(|w| (*w - 1.0).abs() < 1e-6) && texels.iter().any(|w| (*w - 0.5).abs() < 1e-4));
    }

    #[test]
    fn a_drop_spreads_with_the_fourth_root_of_its_weber_number() {
        // 2 mm at 6.5 m/s: We 1158.
        let radius = spot_radius(6.5, 2e-3);
        assert!((radius / 1e-3 - 5.83).abs() < 0.01, "{radius}");
        assert!((spot_radius(0.0, 2e-3) - 1e-3).abs() < 1e-12);
    }
}
