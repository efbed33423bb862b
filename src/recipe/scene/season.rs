//! The key `season` of a plant: a number or a date, or two of these for a clip.

use crate::recipe::syntax::{
    Choice, Digest, Fault, KeyListing, TomlNode, TomlValue, ValueForm, ValueKind, ValueType, number, wrong,
};
use crate::recipe::{Growth, PlantRecipe};
use osier_base::diagnostic::Diagnostic;
use osier_plants::season::{FallOrder, season_of_day, season_of_time};
use serde_json::json;

/// Latitude, degrees, for dates in scenes without the key `latitude`.
const LATITUDE: f64 = 50.0;
/// Days before each month of a common year, then the days of the year.
const MONTHS: [u16; 13] = [0, 31, 59, 90, 120, 151, 181, 212, 243, 273, 304, 334, YEAR];
/// Days of a common year.
const YEAR: u16 = 365;

/// A time of the growing year.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SeasonTime {
    /// Share of the growing year: 0 is bud burst, 1 the bare plant.
    Season(f64),
    /// Day of the year, 1..=365, whose season depends on the latitude.
    Day(u16),
}

impl SeasonTime {
    fn season(self, latitude: f64) -> f64 {
        match self {
            Self::Season(season) => season,
            Self::Day(day) => season_of_day(day, latitude),
        }
    }
}

/// Seasons at the first and the last frame; equal for a season that does not change.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeasonSpan {
    /// Season of the first frame.
    pub first: SeasonTime,
    /// Season of the last frame, towards which the clip interpolates.
    pub last: SeasonTime,
}

impl SeasonSpan {
    /// Whether both seasons differ, so that leaves change over the clip.
    pub fn changes(&self) -> bool {
        self.first != self.last
    }

    /// Whether one of both is a date, whose season depends on the latitude.
    pub fn has_date(&self) -> bool {
        [self.first, self.last].iter().any(|time| matches!(time, SeasonTime::Day(_)))
    }
}

/// Season of a plant over the clip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeasonCourse {
    span: SeasonSpan,
    /// Latitude by which dates become seasons, degrees.
    latitude: f64,
}

impl SeasonCourse {
    /// Season, 0..1, at a share of the time from the first frame (0) to the last (1). Between two dates the days pass as in the
    /// calendar, over New Year if the second date is the earlier one.
    pub fn at(&self, share: f64) -> f64 {
        if let Some([first, days]) = self.days() {
            return season_of_time(f64::from(first) + f64::from(days) * share, self.latitude);
        }
        let [first, last] = [self.span.first, self.span.last].map(|time| time.season(self.latitude));
        first + (last - first) * share
    }

    /// Least and greatest season of the clip.
    pub fn range(&self) -> [f64; 2] {
        // Seasons of numbers are between those of the first and the last frame; dates may pass the start of a growing year.
        let steps = self.days().map_or(1, |[_, days]| days.max(1));
        let seasons = (0..=steps).map(|k| self.at(f64::from(k) / f64::from(steps)));
        seasons.fold([1.0, 0.0], |[least, greatest], season| [season.min(least), season.max(greatest)])
    }

    /// The first day and the number of days from it to the last one; `None` unless both seasons are dates.
    fn days(&self) -> Option<[u16; 2]> {
        match (self.span.first, self.span.last) {
            (SeasonTime::Day(first), SeasonTime::Day(last)) => Some([first, (last + YEAR - first) % YEAR]),
            _ => None,
        }
    }
}

impl PlantRecipe {
    /// Its season over the clip; `None` for a plant without the key.
    pub fn season_course(&self) -> Option<SeasonCourse> {
        let site = match &self.growth {
            Growth::Species(species) => species.site.latitude,
            // Only species have a site with a latitude.
            _ => LATITUDE,
        };
        let latitude = self.keys.latitude.unwrap_or(site);
        self.keys.season.map(|span| SeasonCourse { span, latitude })
    }
}

/// Value type of the key `season`: a number from 0 to 1, a date `MM-DD`, or a list of two.
#[derive(Debug, Clone, Copy)]
pub struct SeasonType;

impl SeasonType {
    fn time(name: &str, node: &TomlNode) -> Result<SeasonTime, Fault> {
        match &node.value {
            TomlValue::Text(text) => day_of_date(text).map(SeasonTime::Day).ok_or_else(|| unreadable_date(name, node)),
            // A date of TOML, as 2026-10-15.
            TomlValue::Other => Err(unreadable_date(name, node)),
            TomlValue::Integer(_) | TomlValue::Number(_) => {
                number(0.0, 0.0, 1.0, "").read(name, node).map(SeasonTime::Season)
            }
            _ => Err(wrong(name, node, "a season from 0 to 1, a date \"MM-DD\", or a list of two of them")),
        }
    }
}

/// S003 for a date in another form than `MM-DD`.
fn unreadable_date(name: &str, node: &TomlNode) -> Fault {
    let message = format!("{name} is not a date of month and day");
    let d = Diagnostic::error("S003", message, node.span, "unreadable date");
    Box::new(d.help("write month and day in quotes, as \"10-15\", or a season from 0 (bud burst) to 1 (bare)"))
}

/// The day of the year of `MM-DD`, 1..=365; 29 February counts as 28 February.
fn day_of_date(text: &str) -> Option<u16> {
    let (month, day) = text.split_once('-')?;
    // `parse` would also accept "+1" and "1".
    let digits = |t: &str| (t.len() == 2 && t.bytes().all(|b| b.is_ascii_digit())).then(|| t.parse::<u16>().ok());
    let (month, day) = (usize::from(digits(month)??), digits(day)??);
    // Days before the month; the entry after it ends the month, so that the last one belongs to no month.
    let before = *MONTHS.get(month.checked_sub(1)?)?;
    let length = *MONTHS.get(month)? - before;
    let day = if (month, day) == (2, 29) { 28 } else { day };
    (1..=length).contains(&day).then_some(before + day)
}

impl ValueType for SeasonType {
    type Value = SeasonSpan;
    fn fallback(&self) -> SeasonSpan {
        SeasonSpan { first: SeasonTime::Season(0.5), last: SeasonTime::Season(0.5) }
    }
    fn read(&self, name: &str, node: &TomlNode) -> Result<SeasonSpan, Fault> {
        let TomlValue::List(list) = &node.value else {
            let time = Self::time(name, node)?;
            return Ok(SeasonSpan { first: time, last: time });
        };
        match list.as_slice() {
            [first, last] => Ok(SeasonSpan { first: Self::time(name, first)?, last: Self::time(name, last)? }),
            _ => {
                let values = if list.len() == 1 { "value" } else { "values" };
                let text = format!("{name} has {} {values}, but must have 2", list.len());
                let d = Diagnostic::error("S003", text, node.span, "two seasons");
                Err(Box::new(d.help("write the seasons of the first and the last frame, or one season without a list")))
            }
        }
    }
    fn listing(&self) -> KeyListing {
        KeyListing {
            accepts: "number, 0 to 1, date \"MM-DD\", or a list of two for the first and the last frame".into(),
            default: "0.5".into(),
            unit: "",
            form: ValueForm::new(ValueKind::Number, json!(0.5)).within(0.0, 1.0),
        }
    }
    fn digest(&self, value: &SeasonSpan, hasher: &mut blake3::Hasher) {
        for time in [value.first, value.last] {
            match time {
                // The tag distinguishes season 1 from day 1.
                SeasonTime::Season(season) => (0_u32, season).digest(hasher),
                SeasonTime::Day(day) => (1_u32, u32::from(day)).digest(hasher),
            }
        }
    }
}

impl Choice for FallOrder {
    const ALL: &'static [(&'static str, Self)] =
        &[("tips", Self::Tips), ("bases", Self::Bases), ("random", Self::Random)];
}

impl Digest for FallOrder {
    fn digest(&self, hasher: &mut blake3::Hasher) {
        crate::recipe::syntax::word_of(*self).digest(hasher);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn course(first: SeasonTime, last: SeasonTime) -> SeasonCourse {
        SeasonCourse { span: SeasonSpan { first, last }, latitude: 50.0 }
    }

    /// At 50 degrees buds burst on day 110, and trees are bare from day 330 on.
    #[test]
    fn a_clip_between_two_dates_passes_the_days_between_them() {
        let near = |a: f64, b: f64| (a - b).abs() < 1e-9;
        let year = course(SeasonTime::Day(1), SeasonTime::Day(365));
        assert!(near(year.at(0.0), 1.0) && near(year.at(1.0), 1.0));
        // The middle of the clip is day 183.
        assert!(near(year.at(0.5), 73.0 / 220.0), "{}", year.at(0.5));
        let [least, greatest] = year.range();
        assert!(least < 0.01 && near(greatest, 1.0), "{least} {greatest}");
        // From 15 November to 15 May: over New Year, not back through the summer.
        let winter = course(SeasonTime::Day(319), SeasonTime::Day(135));
        assert!(near(winter.at(0.0), 209.0 / 220.0) && near(winter.at(0.5), 1.0) && near(winter.at(1.0), 25.0 / 220.0));
        let autumn = course(SeasonTime::Day(263), SeasonTime::Day(324));
        let range = autumn.range();
        assert!(near(range[0], 153.0 / 220.0) && near(range[1], 214.0 / 220.0), "{range:?}");
    }

    #[test]
    fn a_clip_between_two_numbers_passes_the_seasons_between_them() {
        let back = course(SeasonTime::Season(0.8), SeasonTime::Season(0.2));
        assert!((back.at(0.25) - 0.65).abs() < 1e-9);
        let [least, greatest] = back.range();
        assert!((least - 0.2).abs() < 1e-9 && (greatest - 0.8).abs() < 1e-9);
    }

    #[test]
    fn dates_are_days_of_the_year() {
        assert_eq!(["01-01", "03-01", "12-31", "02-29"].map(day_of_date), [Some(1), Some(60), Some(365), Some(59)]);
        for bad in ["13-01", "00-10", "04-31", "4-3", "10/15", "", "10-15-20", "+1-02"] {
            assert_eq!(day_of_date(bad), None, "{bad}");
        }
    }
}
