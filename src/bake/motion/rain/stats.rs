//! What rain is measured by: the columns of its table and their numbers at a frame.

use super::drop_records::RUNS;
use osier_base::units;
use osier_motion::rain::{DropParams, RainFrame};
use osier_scene::Table;

/// Name of the table of rain.
pub const TABLE: &str = "rain";

/// Cubic millimetres in a cubic metre.
const MM3: f64 = 1e9;

/// Columns that count drops at a frame, or tell where the water is.
const NOW: [(&str, &str); 10] = [
    ("in_air", ""),
    ("at_rest", ""),
    ("running", ""),
    ("hanging", ""),
    ("water_air", "mm3"),
    ("water_leaves", "mm3"),
    ("water_hanging", "mm3"),
    ("water_ground", "mm3"),
    ("water_wood", "mm3"),
    ("rained", "mm3"),
];

/// Columns that count what happened until a frame.
const TOTAL: [&str; 5] = ["struck", "merged", "beads", "hung", "fell"];

/// The table of rain; `falls`: its rate, m/s, and the area that it starts from, m^2.
pub fn table(manner: &DropParams, falls: Option<(f64, f64)>) -> Table {
    let mut columns: Vec<(String, &'static str)> = NOW.iter().map(|(name, unit)| ((*name).to_owned(), *unit)).collect();
    columns.extend(TOTAL.iter().map(|name| ((*name).to_owned(), "")));
    columns.push(("hardest_blow".to_owned(), "mg m/s"));
    let find = |names: &[&str]| names.iter().filter_map(|n| columns.iter().position(|c| c.0 == *n)).collect::<Vec<_>>();
    let plots = vec![
        ("Drops by what they do", find(&["in_air", "at_rest", "running", "hanging"])),
        ("Water", find(&["water_air", "water_leaves", "water_hanging"])),
        ("What has happened", find(&TOTAL)),
    ];
    // Rounded so that a number written in a scene comes out as it was written.
    let rounded = |x: f64, digits: f64| (x * digits).round() / digits;
    let degrees = |x: f64| rounded(x.to_degrees(), 1e6);
    let wetting = &manner.wetting;
    let (rate, area) =
        falls.map(|(rate, area)| (rounded(rate * units::MILLIMETRES_PER_HOUR, 1e9), rounded(area, 1e4))).unzip();
    let parameters = serde_json::json!({
        "rate_mm_per_h": rate, "rained_on_m2": area, "theta_deg": degrees(wetting.contact_angle), "receding_deg": degrees(wetting.receding),
        "advancing_deg": degrees(wetting.advancing), "tau_v_s": manner.velocity_decay_time, "tangent_keep": manner.tangent_keep,
        "tip_radius_m": manner.tip_radius, "half_life_s": manner.decay_time,
    });
    let (totals, outcome) = (find(&TOTAL), find(&["water_leaves", "water_hanging", "fell"]));
    Table { name: TABLE.into(), columns, plots, totals, outcome, parameters, said: Vec::new(), watches: Vec::new() }
}

/// A row of [`table`].
pub fn row(m: &RainFrame) -> Vec<f64> {
    let running = m.sessile.iter().filter(|d| d.v.length() > RUNS).count();
    let (l, t) = (&m.water_budget, &m.counters);
    let mut row: Vec<f64> =
        [m.airborne.len(), m.sessile.len() - running, running, m.pendant.len()].iter().map(|n| *n as f64).collect();
    row.extend([l.air, l.leaves, l.pendants, l.ground, l.wood, l.emitted].map(|v| v * MM3));
    row.extend([t.impacts, t.mergers, t.beads, t.pendants, t.detachments].map(|n| n as f64));
    row.push(t.max_impulse * 1e6);
    row
}
