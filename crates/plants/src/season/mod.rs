//! Leaves through the growing year: buds, unfolding, summer, autumn colours, fall, bare twigs.
//!
//! A season is a number: 0 at bud burst, 1 on the bare winter tree; [`season_of_day`] computes it for a day of the year. Every
//! leaf has a separate [`LeafCalendar`], which depends on its place in the crown: leaves in the sun and single branches turn
//! first, and the leaves of a branch turn alike. [`apply_season`] puts a grown [`osier_scene::plant::Plant`] into a season.
//!
//! ```
//! use osier_plants::season::season_of_day;
//!
//! // Middle of October at 50 degrees north: full colour. January: bare.
//! assert!((season_of_day(288, 50.0) - 0.81).abs() < 0.02);
//! assert!(season_of_day(15, 50.0) >= 1.0 && season_of_day(130, 50.0) < 0.15);
//! // On the southern hemisphere the seasons are shifted by half a year.
//! assert!((season_of_day(288 - 183, -50.0) - season_of_day(288, 50.0)).abs() < 0.01);
//! ```
//!
//! Own, but for the dates. Source of the dates: Hopkins, Periodical events and natural law as guides to agricultural research and
//! practice, Monthly Weather Review, supplement 9, 1918: spring comes four days later with each degree of latitude.

mod apply;
mod buds;
mod calendar;
mod recolor;
mod shape;

pub use apply::{BudOrgan, PlantSeason, SeasonSlots, SeasonalOrgan, SlotNow, apply_season, season_slots};
pub use buds::bud_mesh;
pub use calendar::{LeafCalendar, LeafNow, colors_between, leaf_calendars};
pub use recolor::{mean_color, recolored};
pub use shape::shaped_leaf;

/// Day of bud burst and of the last leaf at [`MIDDLE`] degrees of latitude: 20 April, 26 November.
const BURST_DAY: f64 = 110.0;
const BARE_DAY: f64 = 330.0;
/// Latitude of those days, degrees.
const MIDDLE: f64 = 50.0;
/// Days by which spring is later and winter earlier with each degree towards the pole.
const SPRING_DELAY: f64 = 4.0;
const WINTER_ADVANCE: f64 = 2.5;
/// Least and greatest latitude of these rules: nearer to the equator cold does not end the year, nearer to the poles no trees
/// grow.
const LATITUDES: [f64; 2] = [25.0, 70.0];
/// Days of a year; leap years are not distinguished.
const YEAR: f64 = 365.0;

/// The season of a day of the year, 1..=366, at a latitude in degrees, negative in the south: 0..1, 1 in winter.
pub fn season_of_day(day: u16, latitude: f64) -> f64 {
    season_of_time(day.into(), latitude)
}

/// As [`season_of_day`], at a time in days, with fractions; 365 days later is the same time of the next year.
pub fn season_of_time(day: f64, latitude: f64) -> f64 {
    let from_equator = latitude.abs().clamp(LATITUDES[0], LATITUDES[1]);
    let turned = if latitude < 0.0 { 0.5 * YEAR } else { 0.0 };
    let day = (day + turned).rem_euclid(YEAR);
    let burst = BURST_DAY + SPRING_DELAY * (from_equator - MIDDLE);
    let bare = (BARE_DAY - WINTER_ADVANCE * (from_equator - MIDDLE)).min(YEAR - 1.0);
    if day < burst || day > bare { 1.0 } else { (day - burst) / (bare - burst) }
}

/// Which leaves of a shoot fall first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FallOrder {
    /// The leaves at its tip, as of oaks, beeches and ashes.
    Tips,
    /// The leaves at its base, as of birches, poplars and lindens.
    Bases,
    /// A random order, drawn for each leaf.
    Random,
}

/// A colour that leaves turn to in autumn, and how many of them do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AutumnColor {
    /// Linear RGB of the leaf, 0 to 1.
    pub color: [f32; 3],
    /// Frequency relative to the other colours, above 0.
    pub weight: f64,
}

/// Colours of the leaves of an organ over the year, and how they fall.
#[derive(Debug, Clone, PartialEq)]
pub struct LeafHabit {
    /// Whether the leaves stay on the plant and green; then only the leaves of the youngest shoots change, in spring.
    pub evergreen: bool,
    /// Share of the plant's growth time that was its last year: organs born within this share before the youngest organ
    /// belong to the shoots of the year.
    pub last_year: f32,
    /// Linear colour in summer.
    pub green: [f32; 3],
    /// Linear colour of the first leaves of spring.
    pub spring: [f32; 3],
    /// Linear colour of a dry leaf, to which autumn colours age.
    pub dry: [f32; 3],
    /// Colours of autumn, from those of leaves in the sun to those of leaves in the shade; at most 100.
    pub autumn: Vec<AutumnColor>,
    /// Which leaves of a shoot fall first.
    pub falls: FallOrder,
    /// Share of the leaves that stay on the plant, dry, through the winter, 0..1.
    pub keeps: f32,
    /// Whether young leaves are folded and dry ones curl; needles do not.
    pub bends: bool,
}

/// Colour of a leaf; the numbers are indices into [`LeafHabit::autumn`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum LeafColor {
    /// The green of an adult leaf.
    Green,
    /// The pale green of a leaf that has just unfolded.
    Fresh,
    /// Halfway between fresh and green.
    Young,
    /// Green along the veins, the autumn colour between them.
    Turning(u8),
    /// The autumn colour over the whole blade.
    Turned(u8),
    /// The autumn colour on its way to dry.
    Aged(u8),
}

/// Shape of a leaf at a stage of its year; each shape has a separate prototype.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum LeafShape {
    /// Both halves lie against each other.
    Furled,
    /// Halfway between furled and open.
    Unfolding,
    /// The flat blade of summer.
    Open,
    /// Curled along the midrib, as dry leaves that stay on the twig.
    Withered,
}

/// Colour and shape of a leaf in steps; each pair that occurs has a separate prototype.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct LeafLook {
    /// Step of the colours from spring to dry.
    pub color: LeafColor,
    /// Step of its unfolding or withering.
    pub shape: LeafShape,
}

impl LeafLook {
    /// The look of all leaves before a season is applied: green and open.
    pub const SUMMER: Self = Self { color: LeafColor::Green, shape: LeafShape::Open };
}

/// Share of the autumn colour in a turning leaf, and of the dry one in an aged leaf.
const TURNING_SHARE: f32 = 0.5;
const AGED_SHARE: f32 = 0.45;
/// Share of the spring colour in a leaf between fresh and green.
const YOUNG_SHARE: f32 = 0.5;

impl LeafHabit {
    /// The autumn colour of an index; green without colours.
    pub fn autumn_color(&self, index: u8) -> [f32; 3] {
        self.autumn.get(usize::from(index)).map_or(self.green, |c| c.color)
    }

    /// Mean linear colour of a blade in a step of colour, which for a turning leaf is the mean of the veins and the
    /// blade between them.
    pub fn color(&self, color: LeafColor) -> [f32; 3] {
        match color {
            LeafColor::Green => self.green,
            LeafColor::Fresh => self.spring,
            LeafColor::Young => mixed(self.green, self.spring, YOUNG_SHARE),
            LeafColor::Turning(i) => mixed(self.green, self.autumn_color(i), TURNING_SHARE),
            LeafColor::Turned(i) => self.autumn_color(i),
            LeafColor::Aged(i) => mixed(self.autumn_color(i), self.dry, AGED_SHARE),
        }
    }
}

/// Linear mix of two colours: `a` at 0, `b` at 1.
pub fn mixed(a: [f32; 3], b: [f32; 3], t: f32) -> [f32; 3] {
    std::array::from_fn(|k| osier_base::math::lerp(a[k], b[k], t))
}
