//! Statistics of a flight: columns of its table, their values at a frame, and the thresholds of warnings.

use crate::recipe::scene::{DepositEvent, FlightKeys};
use crate::recipe::word_of;
use osier_base::units;
use osier_motion::flight::FlightStats;
use osier_scene::{Table, Watch};
use osier_wind::LatticeStats;

/// Name of the table that holds the statistics of a flight, one row per frame.
pub const TABLE: &str = "flight";

/// Name and unit of each column that describes the state at a frame; counts have no unit.
const STATE_COLUMNS: [(&str, &str); 18] = [
    ("pending", ""),
    ("airborne", ""),
    ("grounded", ""),
    ("on_wall", ""),
    ("corner", ""),
    ("exited", ""),
    ("clusters", ""),
    ("singles", ""),
    ("largest", ""),
    ("penetrations", ""),
    ("mean_speed", "m/s"),
    ("max_speed", "m/s"),
    ("ground_wind", "m/s"),
    ("flight_time", "s"),
    ("flight_distance", "m"),
    ("flight_distance_10", "m"),
    ("flight_distance_50", "m"),
    ("flight_distance_90", "m"),
];

/// Columns that count events from the start of the spin-up to a frame.
const TOTAL_COLUMNS: [&str; 7] = ["merges", "deposits", "lift_offs", "falls", "recycled", "left", "long_steps"];

/// Columns of a lattice wind: number of times that the speed of a cell was limited, the checkerboard amplitude of the density,
/// and the mean density less 1.
const LATTICE_COLUMNS: [&str; 3] = ["wind_clamps", "wind_checkered", "wind_mass_error"];

/// Checkerboard amplitude of the density (lattice units) above which a warning says that the lattice is unstable. Guessed, not
/// measured; a smaller value warns earlier.
const MAX_CHECKERBOARD: f64 = 1e-3;

/// Number of solids whose deposits a sweep lists among its outcomes.
const COMPARED_SOLIDS: usize = 4;

/// Names of the places at which the table of a flight counts depositions.
#[derive(Debug, Clone, Copy)]
pub struct CountedPlaceNames<'a> {
    /// Names of the solids, each of which gets the columns `at_NAME` and `landed_NAME`.
    pub solids: &'a [&'a str],
    /// Names of rectangles on the ground, each of which gets the column `ground_NAME`.
    pub zones: &'a [&'a str],
}

/// Declares the table of a flight that counts at `places`. `lattice`: statistics of its lattice wind before the first frame,
/// if it has one. `said`: warnings so far, by code.
pub fn flight_table(
    keys: &FlightKeys,
    count: usize,
    places: CountedPlaceNames<'_>,
    lattice: Option<LatticeStats>,
    said: Vec<(&'static str, String)>,
) -> Table {
    let mut columns: Vec<(String, &'static str)> =
        STATE_COLUMNS.iter().map(|(name, unit)| ((*name).to_owned(), *unit)).collect();
    let CountedPlaceNames { solids, zones } = places;
    columns.extend(solids.iter().map(|name| (format!("at_{name}"), "")));
    // `at_` counts what rests there now, `landed_` and `ground_` count all depositions so far.
    let of_solids = solids.iter().map(|name| format!("landed_{name}"));
    let landed: Vec<String> = of_solids.chain(zones.iter().map(|name| format!("ground_{name}"))).collect();
    columns.extend(landed.iter().map(|name| (name.clone(), "")));
    let counted = TOTAL_COLUMNS.iter().copied().chain(lattice.iter().flat_map(|_| LATTICE_COLUMNS));
    columns.extend(counted.map(|name| (name.to_owned(), "")));
    // Plots, totals and outcomes refer to columns by index.
    let find = |name: &str| columns.iter().position(|c| c.0 == name);
    let plot = |names: &[&str]| names.iter().filter_map(|n| find(n)).collect();
    let events = TOTAL_COLUMNS.iter().chain(&["wind_clamps"]).copied().chain(landed.iter().map(String::as_str));
    let totals = events.filter_map(find).collect();
    let mut outcome: Vec<usize> = plot(&["exited", "grounded", "corner", "lift_offs"]);
    outcome.extend(solids.iter().take(COMPARED_SOLIDS).filter_map(|name| find(&format!("at_{name}"))));
    // If the scene maps depositions, those at its solids are outcomes, too; zones always are.
    if keys.map_counts == DepositEvent::Landings {
        outcome.extend(solids.iter().take(COMPARED_SOLIDS).filter_map(|name| find(&format!("landed_{name}"))));
    }
    outcome.extend(zones.iter().filter_map(|name| find(&format!("ground_{name}"))));
    let plots = vec![
        ("Catkins by what they do", plot(&["airborne", "grounded", "on_wall", "corner", "exited", "pending"])),
        ("Sticking and coming to rest", plot(&["clusters", "largest", "merges", "deposits", "lift_offs"])),
        ("Speed", plot(&["mean_speed", "max_speed", "ground_wind"])),
    ];
    // A warning is given once, with the largest value of its column; clamped cells of the spin-up were reported before.
    let watched = [
        (
            "long_steps",
            0.0,
            "S027",
            "{once} a catkin moved further in a step than the wind's cells are wide; raise flight.substeps",
        ),
        (
            "wind_clamps",
            lattice.map_or(0.0, |h| h.clamped_cells as f64),
            "S022",
            "{once} in all the lattice wind was held at its fastest in a cell; lower wind.speed, or raise wind.lattice.steps",
        ),
        (
            "wind_checkered",
            MAX_CHECKERBOARD,
            "S023",
            "the lattice wind has come apart into a checkerboard of density {}; raise wind.lattice.tau_floor",
        ),
    ];
    let watch = |(name, above, code, text): &(&str, f64, &'static str, &'static str)| {
        Some(Watch { column: find(name)?, above: *above, code, text })
    };
    let watches = watched.iter().filter_map(watch).collect();
    Table {
        name: TABLE.into(),
        totals,
        outcome,
        plots,
        parameters: parameters_json(keys, count),
        said,
        watches,
        columns,
    }
}

/// The parameters of a flight, keys with their defaults, as written into the header of its table.
fn parameters_json(keys: &FlightKeys, count: usize) -> serde_json::Value {
    serde_json::json!({
        "count": count, "release": word_of(keys.release), "substeps": keys.substeps, "spin_up_s": keys.spin_up,
        "scale": keys.scale, "mass_mg": keys.mass / units::MILLIGRAM, "fall_speed_m_s": keys.fall, "fall_spread": keys.fall_spread,
        "glide": keys.glide, "inertia": keys.inertia, "flutter": keys.flutter, "stick_radius_m": keys.stick_radius,
        "stick_probability": keys.stick_probability, "stick_close": keys.stick_close, "lift_rate_1_s": keys.lift_rate,
        "cluster_rotation": keys.cluster_rotation, "cluster_fall_power": keys.beta, "gamma_1_m2": keys.gamma,
        "humidity": keys.humidity, "humidity_map": keys.humidity_map.as_ref().map(|r| r.text.clone()),
        "lift_speed_m_s": keys.lift_speed, "lift_wet": keys.lift_wet,
    })
}

/// Catkins at each solid and in each zone, in the order of [`CountedPlaceNames`].
#[derive(Debug, Clone, Copy)]
pub struct PlaceCounts<'a> {
    /// Catkins that rest on each solid at the frame.
    pub resting: &'a [u64],
    /// Depositions on each solid from the start to the frame.
    pub landed: &'a [u64],
    /// Depositions in each zone on the ground from the start to the frame.
    pub in_zones: &'a [u64],
}

/// Values of one row in the order of the columns of [`flight_table`]; NaN for the mean of an empty set.
pub fn flight_row(t: &FlightStats, at: PlaceCounts<'_>, lattice: Option<LatticeStats>) -> Vec<f64> {
    let counts = [
        t.pending,
        t.airborne,
        t.grounded,
        t.on_wall,
        t.corner,
        t.exited,
        t.clusters,
        t.singles,
        t.largest,
        t.penetrations,
    ];
    let totals = [t.merges, t.deposits, t.lift_offs, t.falls, t.recycled, t.left, t.long_steps];
    let mut row: Vec<f64> = counts.iter().map(|v| *v as f64).collect();
    let means = [t.mean_speed, t.max_speed, t.ground_wind, t.flight_time, t.flight_distance];
    let quantiles = t.distance_quantiles.map_or([None; 3], |all| all.map(Some));
    row.extend(means.into_iter().chain(quantiles).map(|v| v.unwrap_or(f64::NAN)));
    row.extend(at.resting.iter().chain(at.landed).chain(at.in_zones).map(|v| *v as f64));
    row.extend(totals.iter().map(|v| *v as f64));
    row.extend(lattice.iter().flat_map(|h| [h.clamped_cells as f64, h.checkerboard, h.density_error]));
    row
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recipe::KeyTable as _;

    const NOWHERE: PlaceCounts<'_> = PlaceCounts { resting: &[], landed: &[], in_zones: &[] };
    const NO_PLACES: CountedPlaceNames<'_> = CountedPlaceNames { solids: &[], zones: &[] };
    const HEALTH: LatticeStats =
        LatticeStats { steps: 9, clamped_cells: 4, peak_checkerboard: 0.5, checkerboard: 0.25, density_error: -0.125 };

    #[test]
    fn every_column_has_its_number() {
        let keys = FlightKeys::defaults();
        let tally = FlightStats {
            pending: 1,
            penetrations: 10,
            flight_distance: Some(15.0),
            distance_quantiles: Some([5.0, 12.0, 31.0]),
            merges: 16,
            falls: 19,
            long_steps: 22,
            ..FlightStats::default()
        };
        for lattice in [None, Some(HEALTH)] {
            let (table, row) = (
                flight_table(&keys, 5, CountedPlaceNames { solids: &["wall"], zones: &["yard"] }, lattice, Vec::new()),
                flight_row(&tally, PlaceCounts { resting: &[7], landed: &[9], in_zones: &[4] }, lattice),
            );
            assert_eq!(table.columns.len(), row.len());
            let of = |name: &str| table.columns.iter().position(|c| c.0 == name).map(|i| row[i]);
            assert_eq!((of("pending"), of("penetrations"), of("flight_distance")), (Some(1.0), Some(10.0), Some(15.0)));
            assert_eq!((of("merges"), of("long_steps"), of("at_wall")), (Some(16.0), Some(22.0), Some(7.0)));
            assert_eq!((of("falls"), of("landed_wall"), of("ground_yard")), (Some(19.0), Some(9.0), Some(4.0)));
            assert_eq!((of("flight_distance_10"), of("flight_distance_90")), (Some(5.0), Some(31.0)));
            assert!(of("flight_time").is_some_and(f64::is_nan) && of("mean_speed").is_some_and(f64::is_nan));
            assert_eq!(of("wind_mass_error"), lattice.map(|h| h.density_error));
        }
    }

    /// A sweep prints and plots the counts that the scene asks for.
    #[test]
    fn zones_and_mapped_depositions_are_outcomes() {
        let outcome = |map_counts: DepositEvent, zones: &[&str]| -> Vec<String> {
            let keys = FlightKeys { map_counts, ..FlightKeys::defaults() };
            let table = flight_table(&keys, 5, CountedPlaceNames { solids: &["wall"], zones }, None, Vec::new());
            table.outcome.iter().map(|i| table.columns[*i].0.clone()).collect()
        };
        let common = ["exited", "grounded", "corner", "lift_offs", "at_wall"];
        assert_eq!(outcome(DepositEvent::Resting, &[]), common);
        let asked = outcome(DepositEvent::Landings, &["yard", "street"]);
        assert_eq!(asked, [&common[..], &["landed_wall", "ground_yard", "ground_street"]].concat());
    }

    #[test]
    fn the_spin_up_has_the_name_of_its_key() {
        let keys = FlightKeys { spin_up: 12.0, ..FlightKeys::defaults() };
        let table = flight_table(&keys, 5, NO_PLACES, None, Vec::new());
        assert_eq!(table.parameters["spin_up_s"].as_f64(), Some(12.0));
    }

    /// Clamped cells of the spin-up were reported before; later ones are reported with their number.
    #[test]
    fn what_went_wrong_is_told_once() {
        let table = flight_table(&FlightKeys::defaults(), 5, NO_PLACES, Some(HEALTH), Vec::new());
        let told = |t: &FlightStats, h: LatticeStats| -> Vec<&str> {
            table.warnings(&flight_row(t, NOWHERE, Some(h))).iter().map(|w| w.0).collect()
        };
        let calm = LatticeStats { checkerboard: 0.0, ..HEALTH };
        assert!(told(&FlightStats::default(), calm).is_empty());
        assert_eq!(told(&FlightStats { long_steps: 3, ..FlightStats::default() }, HEALTH), ["S027", "S023"]);
        assert_eq!(told(&FlightStats::default(), LatticeStats { clamped_cells: 6, ..calm }), ["S022"]);
        let text = |long_steps: u64| {
            let stats = FlightStats { long_steps, ..FlightStats::default() };
            table.warnings(&flight_row(&stats, NOWHERE, Some(calm))).remove(0).1
        };
        assert!(text(3).starts_with("3 times a catkin"), "{}", text(3));
        assert!(text(1).starts_with("once a catkin"), "{}", text(1));
    }
}
