//! Parameters of particle-shapes: how particles move, where they spawn others, where they end.

use std::f64::consts::PI;

use super::region::Region;

/// Values by level of branching; the last one holds for all higher levels. Never empty.
#[derive(Debug, Clone, PartialEq)]
pub struct ByLevel(Vec<f64>);

impl ByLevel {
    /// `values`: from level 0 on; an empty list counts as a single 0.
    pub fn new(values: impl Into<Vec<f64>>) -> Self {
        let values = values.into();
        Self(if values.is_empty() { vec![0.0] } else { values })
    }

    /// The value of a level, counted from 0; levels beyond the list have its last value.
    #[inline]
    pub fn at(&self, level: u8) -> f64 {
        self.0[usize::from(level).min(self.0.len() - 1)]
    }

    /// Whether the value of any level differs from 0.
    pub fn any(&self) -> bool {
        self.0.iter().any(|v| *v != 0.0)
    }
}

impl<const N: usize> From<[f64; N]> for ByLevel {
    fn from(values: [f64; N]) -> Self {
        Self::new(values)
    }
}

/// Equations by which a particle moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Variant {
    /// With units and independent of the step length, including the terms that the paper names without a formula.
    Corrected,
    /// The three printed lines of \[hoetzlein\] section 3.
    Paper,
}

/// Length of children along their parent, as a factor of `length`. w: distance of the site from the parent's tip, as a share
/// of the part that bears children (0 at the tip, 1 at the lowest site).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CrownShape {
    /// .2 + .8 w: a spire.
    Conical,
    /// .2 + .8 sin(pi w): longest in the middle.
    Spherical,
    /// .2 + .8 sin(pi w / 2).
    Hemispherical,
    /// 1 everywhere: a column.
    Cylindrical,
    /// .5 + .5 w: half as long at the tip as below.
    Tapered,
    /// 1 - .8 w: longest at the top.
    Inverse,
    /// Grows to 1 at w = .7, then falls to 0 at the lowest site.
    Flame,
}

impl CrownShape {
    /// The factor at `w`, which is clamped to 0..1; it lies in 0..1 too.
    #[inline]
    pub fn factor(self, w: f64) -> f64 {
        let w = w.clamp(0.0, 1.0);
        match self {
            Self::Conical => 0.2 + 0.8 * w,
            Self::Spherical => 0.2 + 0.8 * osier_base::math::sin(PI * w),
            Self::Hemispherical => 0.2 + 0.8 * osier_base::math::sin(0.5 * PI * w),
            Self::Cylindrical => 1.0,
            Self::Tapered => 0.5 + 0.5 * w,
            Self::Inverse => 1.0 - 0.8 * w,
            Self::Flame if w <= 0.7 => w / 0.7,
            Self::Flame => (1.0 - w) / 0.3,
        }
    }
}

/// The first particles: one axis of level 0 each.
#[derive(Debug, Clone, PartialEq)]
pub struct Roots {
    /// Number of root axes, at least 1.
    pub count: u32,
    /// Radius of the disc that they start in, m.
    pub radius: f64,
    /// Least and greatest angle to the vertical at which they start, rad.
    pub tilt: [f64; 2],
    /// Share 0..1 by which they tilt away from the middle of the disc; 0: in any direction.
    pub outward: f64,
}

/// Motion of a particle. Lengths in m, growth time in t, an arbitrary unit.
#[derive(Debug, Clone, PartialEq)]
pub struct Motion {
    /// Speed to which a particle tends, m/t.
    pub speed: ByLevel,
    /// Rate at which its velocity follows its target direction, 1/t.
    pub spread: ByLevel,
    /// Random walk of the target direction, t^-1/2: after T the mean cosine of the turn is exp(-wander^2 T).
    pub wander: ByLevel,
    /// Rotation of the velocity about the target direction, and of the frame about the velocity, rad/t.
    pub twist: ByLevel,
    /// Rotation of the target direction about the home direction, rad/t: keeps a vine winding.
    pub coil: ByLevel,
    /// Angle between target and home direction where `coil` is not 0, rad.
    pub coil_angle: f64,
    /// Downward acceleration, which grows with the square of the length grown, m/t^2; with negative values axes rise.
    pub gravity: ByLevel,
    /// Rate at which the target direction turns upwards, 1/t.
    pub up: ByLevel,
    /// Rate at which the target direction turns away from shade, 1/t.
    pub light: ByLevel,
    /// Rate at which the target direction turns towards the points of the crown guide, 1/t.
    pub attract: ByLevel,
    /// Rate at which the target direction turns away from solids, 1/t; decays over 0.5 m.
    pub avoid: ByLevel,
    /// Rate at which the target direction turns towards solids, 1/t: makes a vine climb.
    pub climb: ByLevel,
    /// With [`Variant::Paper`]: the printed factor `spread` of each step, 0..1.
    pub paper_spread: f64,
}

/// Where axes spawn others, and how these begin.
#[derive(Debug, Clone, PartialEq)]
pub struct Spawning {
    /// Median distance between sites, m.
    pub spacing: ByLevel,
    /// Standard deviation of the logarithm of the distance between sites.
    pub spacing_sigma: f64,
    /// Share of its length that an axis keeps free of sites at its base.
    pub base: ByLevel,
    /// Share of the buds that never grow.
    pub dormancy: f64,
    /// Buds at a site: 1 alternate, 2 opposite, 3 to 5 whorled.
    pub buds: u32,
    /// Angle between an axis and its children, rad; by the level of the parent.
    pub angle: ByLevel,
    /// Standard deviation of `angle`, rad.
    pub angle_deviation: f64,
    /// Standard deviation of the azimuth of a bud, rad.
    pub azimuth_deviation: f64,
    /// Upward part added to the direction of a child, of length 1.
    pub up_bias: f64,
    /// Share 0..1 of the parent's direction in a child's first velocity, from which it bends out.
    pub flow: f64,
    /// Profile of the lengths of children along their parent, which shapes the crown.
    pub crown: CrownShape,
    /// Probability that an axis forks at its tip into two axes of its level.
    pub split: ByLevel,
    /// Angle between the two axes of a fork, rad.
    pub split_angle: f64,
    /// Probability that an axis ends at its last site, where its child continues in its place.
    pub apex_death: ByLevel,
}

/// What ends an axis: its length, its age, shade, and the regions that bound it.
#[derive(Debug, Clone)]
pub struct Limits {
    /// Number of levels, 1..8; root axes have level 0.
    pub levels: u8,
    /// Length to which axes grow, m; for children it is the length where the crown's factor is 1.
    pub length: ByLevel,
    /// Standard deviation of the logarithm of the length of children.
    pub length_deviation: f64,
    /// Greatest age of an axis, t; `None`: no limit.
    pub max_age: Option<f64>,
    /// Shade above which an axis ends; a node casts a shade of 0.2 on its own cell. `None`: no limit.
    pub max_shade: Option<f64>,
    /// Most nodes of the plant: a level that would exceed them is not grown.
    pub max_nodes: u64,
    /// Region outside of which axes are cut off; `None`: unbounded.
    pub envelope: Option<Region>,
    /// Regions that axes cannot enter; they slide along their surfaces.
    pub obstacles: Vec<Region>,
    /// Whether axes cannot enter the ground below y = 0 either.
    pub ground: bool,
}

/// Thickness of axes, set once all of them have grown.
#[derive(Debug, Clone, PartialEq)]
pub struct Thickness {
    /// Whether radii follow from the branches and leaves of an axis, from its length or from drawn ratios.
    pub rule: ThicknessRule,
    /// Radius of root axes at their base, m; `None`: the radius to which the tips add up (pipe model), or 0.02 m.
    pub base: Option<f64>,
    /// Radius at the tips of all axes, m, above 0.
    pub tip: f64,
    /// Exponent of the law: n of the pipe model, or of the taper.
    pub exponent: f64,
}

/// Rule by which radii follow from the branching, once all axes have grown.
#[derive(Debug, Clone, PartialEq)]
pub enum ThicknessRule {
    /// At a fork the n-th powers of the radii add up.
    Pipe,
    /// Each axis tapers from its base to its tip, whatever it bears.
    Taper,
    /// Every internode is a truncated cone; the ratio of its radii is drawn from these weighted values.
    /// [wang-hao] 3.2.1, r_3.
    Cone(Vec<WeightedRatio>),
}

/// A ratio of top to bottom radius that an internode may draw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WeightedRatio {
    /// Top radius divided by bottom radius, above 0, at most 1.
    pub ratio: f64,
    /// Weight of this ratio in the draw; the sum of weights is arbitrary.
    pub weight: f64,
}

/// Where leaves stand along axes, and how they are turned.
#[derive(Debug, Clone, PartialEq)]
pub struct Leaves {
    /// Distance between leaves along an axis, m; 0: no leaves.
    pub spacing: f64,
    /// Radius, m, below which axes of levels other than the last bear leaves too.
    pub max_radius: f64,
    /// Mean angle between axis and leaf, rad.
    pub angle: f64,
    /// Standard deviation of `angle`, rad.
    pub angle_deviation: f64,
    /// Standard deviation of the logarithm of the size of leaves; 0: all are alike.
    pub size_deviation: f64,
    /// Share 0..1 by which the upper side is turned upwards.
    pub face_up: f64,
}

/// Parameters of a plant of particle-shapes. Lengths in m, growth time in t, an arbitrary unit.
#[derive(Debug, Clone)]
pub struct ShapeParams {
    /// Equations of motion: with units, or as the paper prints them.
    pub variant: Variant,
    /// Factor of the length of all steps: 1 is 1/16 of an axis, 2 to 50 mm.
    pub step: f64,
    /// Number, place and tilt of the axes of level 0.
    pub roots: Roots,
    /// Rates at which particles turn and speed up.
    pub motion: Motion,
    /// Sites along an axis, and angle and length of the children there.
    pub spawning: Spawning,
    /// Where particles end: length, age, shade, regions.
    pub limits: Limits,
    /// Radii of the axes that particles leave behind.
    pub thickness: Thickness,
    /// Distance, angle and size of leaves along axes.
    pub leaves: Leaves,
    /// Width of the blade that each axis is drawn as, m, in place of a round tube.
    pub blade_width: Option<f64>,
}

impl ShapeParams {
    /// Length of a step of an axis of a level, m: 1/16 of the length of the axis, limited to 2..50 mm, times `step`.
    #[inline]
    pub fn step_length(&self, level: u8) -> f64 {
        (self.limits.length.at(level) / 16.0).clamp(0.002, 0.05) * self.step
    }

    /// Radius of axes of a level, m, that is assumed for contact with solids before radii are known: the radius of
    /// roots, halved at each level, at least that of a tip.
    pub fn assumed_radius(&self, level: u8) -> f64 {
        let base = self.thickness.base.unwrap_or(super::super::radii::Taper::default().base);
        (0..level).fold(base, |r, _| 0.5 * r).max(self.thickness.tip)
    }
}
