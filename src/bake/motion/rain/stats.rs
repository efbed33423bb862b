//! Statistics of rain: the columns of its table and their values at a frame.

use super::drop_records::RUNNING_SPEED;
use osier_base::{math, units};
use osier_motion::rain::{DropParams, RainFrame};
use osier_scene::Table;

/// Name of the table that holds the statistics of rain, one row per frame.
pub const TABLE: &str = "rain";

/// Cubic millimetres in a cubic metre; volumes of the table are in mm^3.
const CUBIC_MM_PER_M3: f64 = 1e9;

/// Columns of the state at a frame: numbers of drops, and volumes of water by place.
const STATE_COLUMNS: [(&str, &str); 11] = [
    ("in_air", ""),
    ("at_rest", ""),
    ("running", ""),
    ("hanging", ""),
    ("water_air", "mm3"),
    ("water_leaves", "mm3"),
    ("water_hanging", "mm3"),
    ("water_ground", "mm3"),
    ("water_wood", "mm3"),
    ("water_solids", "mm3"),
    ("rained", "mm3"),
];

/// Columns that count events from the start of the spin-up to a frame.
const TOTAL_COLUMNS: [&str; 5] = ["struck", "merged", "beads", "hung", "fell"];

/// Declares the table of rain. `rate`: intensity of the rain, m/s; `area`: area of its emitter, m^2; both are `None` if no rain
/// falls.
pub fn rain_table(params: &DropParams, rate: Option<f64>, area: Option<f64>) -> Table {
    let mut columns: Vec<(String, &'static str)> =
        STATE_COLUMNS.iter().map(|(name, unit)| ((*name).to_owned(), *unit)).collect();
    columns.extend(TOTAL_COLUMNS.iter().map(|name| ((*name).to_owned(), "")));
    columns.push(("hardest_blow".to_owned(), "mg m/s"));
    columns.push(("impact_momentum".to_owned(), "mg m/s"));
    columns.push(("momentum_error".to_owned(), ""));
    let find = |names: &[&str]| names.iter().filter_map(|n| columns.iter().position(|c| c.0 == *n)).collect::<Vec<_>>();
    let plots = vec![
        ("Drops by what they do", find(&["in_air", "at_rest", "running", "hanging"])),
        ("Water", find(&["water_air", "water_leaves", "water_hanging"])),
        ("What has happened", find(&TOTAL_COLUMNS)),
    ];
    // Rounding restores the numbers as written in the scene, before their conversion to SI units.
    let rounded = |x: f64, digits: f64| (x * digits).round() / digits;
    let degrees = |x: f64| rounded(x.to_degrees(), 1e6);
    let wetting = &params.wetting;
    let rate = rate.map(|rate| rounded(rate * units::M_PER_S_TO_MM_PER_H, 1e9));
    let area = area.map(|area| rounded(area, 1e4));
    // Wetness decays as fraction^(t / time): it halves after time ln(1/2) / ln(fraction).
    let half_life = rounded(params.decay_time * (math::ln(0.5) / math::ln(params.decay_fraction)), 1e9);
    let parameters = serde_json::json!({
        "rate_mm_per_h": rate, "rained_on_m2": area, "contact_angle_deg": degrees(wetting.contact_angle), "receding_deg": degrees(wetting.receding),
        "advancing_deg": degrees(wetting.advancing), "velocity_decay_s": params.velocity_decay_time, "tangent_keep": params.tangent_keep,
        "tip_radius_m": params.tip_radius, "half_life_s": half_life,
    });
    let (totals, outcome) = (find(&TOTAL_COLUMNS), find(&["water_leaves", "water_hanging", "fell"]));
    Table { name: TABLE.into(), columns, plots, totals, outcome, parameters, said: Vec::new(), watches: Vec::new() }
}

/// Values of one row in the order of the columns of [`rain_table`].
pub fn rain_row(frame: &RainFrame) -> Vec<f64> {
    let running = frame.sessile.iter().filter(|d| d.v.length() > RUNNING_SPEED).count();
    let (water, counters) = (&frame.water_budget, &frame.counters);
    let mut row: Vec<f64> = [frame.airborne.len(), frame.sessile.len() - running, running, frame.pendant.len()]
        .iter()
        .map(|n| *n as f64)
        .collect();
    let volumes = [water.air, water.leaves, water.pendants, water.ground, water.wood, water.solids, water.emitted];
    row.extend(volumes.map(|v| v * CUBIC_MM_PER_M3));
    row.extend(
        [counters.impacts, counters.mergers, counters.beads, counters.pendants, counters.detachments].map(|n| n as f64),
    );
    row.push(counters.max_impulse * 1e6);
    row.push(frame.impact_momentum.brought * 1e6);
    row.push(frame.impact_momentum.error());
    row
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_are_told_in_the_units_of_their_names() {
        let told = |decay_fraction: f64, decay_time: f64| {
            let params = DropParams { decay_fraction, decay_time, ..DropParams::default() };
            rain_table(&params, Some(2.5e-6), Some(3.0)).parameters
        };
        for (fraction, time, half_life) in [(0.5, 20.0, 20.0), (0.25, 20.0, 10.0), (0.125, 0.9, 0.3)] {
            assert_eq!(told(fraction, time)["half_life_s"].as_f64(), Some(half_life), "{fraction} after {time} s");
        }
        assert_eq!(told(0.5, 20.0)["rate_mm_per_h"].as_f64(), Some(9.0));
        assert_eq!(told(0.5, 20.0)["rained_on_m2"].as_f64(), Some(3.0));
    }

    #[test]
    fn parameters_of_drops_have_the_names_of_their_keys() {
        let params = DropParams { velocity_decay_time: 0.25, ..DropParams::default() };
        let told = rain_table(&params, None, None).parameters;
        assert_eq!(told["velocity_decay_s"].as_f64(), Some(0.25));
        for key in ["contact_angle_deg", "receding_deg", "advancing_deg"] {
            assert!(told[key].as_f64().is_some_and(|degrees| degrees > 1.0), "{key}: {told}");
        }
    }
}
