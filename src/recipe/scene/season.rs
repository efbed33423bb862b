//! The key `season` of a plant: a number or a date, or two of these for a clip.

use crate::recipe::syntax::{
    Choice, Digest, Fault, KeyListing, TomlNode, TomlValue, ValueForm, ValueKind, ValueType, number, wrong,
};
use crate::recipe::{Growth, PlantRecipe};
use osier_base::diagnostic::Diagnostic;
use osier_plants::season::{FallOrder, season_of_day};
use serde_json::json;

/// Latitude, degrees, for dates in scenes without the key `latitude`.
const LATITUDE: f64 = 50.0;
/// Days before each month of a common year, then the days of the year.
const MONTHS: [u16; 13] = [0, 31, 59, 90, 120, 151, 181, 212, 243, 273, 304, 334, 365];

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
}

impl PlantRecipe {
    /// Seasons of the first and the last frame, 0..1; `None` for a plant without the key.
    pub fn seasons(&self) -> Option<[f64; 2]> {
        let site = match &self.growth {
            Growth::Species(species) => species.site.latitude,
            // Only species have a site with a latitude.
            _ => LATITUDE,
        };
        let latitude = self.keys.latitude.unwrap_or(site);
        self.keys.season.map(|span| [span.first, span.last].map(|time| time.season(latitude)))
    }
}

/// Value type of the key `season`: a number from 0 to 1, a date `MM-DD`, or a list of two.
#[derive(Debug, Clone, Copy)]
pub struct SeasonType;

impl SeasonType {
    fn time(name: &str, node: &TomlNode) -> Result<SeasonTime, Fault> {
        match &node.value {
            TomlValue::Text(text) => day_of_date(text).map(SeasonTime::Day).ok_or_else(|| {
                let d = Diagnostic::error("S003", format!("{name} is not a date"), node.span, "unreadable date");
                Box::new(d.help("write month and day, as \"10-15\", or a season from 0 (bud burst) to 1 (bare)"))
            }),
            TomlValue::Integer(_) | TomlValue::Number(_) => {
                number(0.0, 0.0, 1.0, "").read(name, node).map(SeasonTime::Season)
            }
            _ => Err(wrong(name, node, "a season from 0 to 1, a date \"MM-DD\", or a list of two of them")),
        }
    }
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
                let text = format!("{name} has {} values, but must have 2", list.len());
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

    #[test]
    fn dates_are_days_of_the_year() {
        assert_eq!(["01-01", "03-01", "12-31", "02-29"].map(day_of_date), [Some(1), Some(60), Some(365), Some(59)]);
        for bad in ["13-01", "00-10", "04-31", "4-3", "10/15", "", "10-15-20", "+1-02"] {
            assert_eq!(day_of_date(bad), None, "{bad}");
        }
    }
}
