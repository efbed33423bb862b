//! Parameter sweeps: runs of a scene with different values of some keys, as rows of a table, and plots of the means over the
//! seeds.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use serde_json::{Map, Value, json};

use super::maps::MapStatistics;
use super::plot::{PlotAxis, PlotLine, PlotPanel, draw_panels};
use super::{Whole, named, number};
use osier_base::Result;
use osier_base::files::Folder;

/// The runs of a parameter sweep, from which its tables and plots are made.
#[derive(Debug, Clone, Default)]
pub struct Sweep {
    /// Title of the scene, for the plot.
    pub title: String,
    /// Keys, as `--set` names them.
    pub keys: Vec<String>,
    /// Names of the columns that are summarised over the seeds and plotted.
    pub outcome: Vec<String>,
    /// The simulated runs, in the order of their simulation.
    pub runs: Vec<Run>,
    /// Runs that were not simulated because of an interruption or an error, in their order; empty for a complete sweep.
    pub missing: Vec<MissingRun>,
    /// Maps at the last frame over the seeds, for each choice of values in the order of [`Sweep::means`].
    pub maps: Vec<Vec<MapStatistics>>,
}

/// A run of a sweep that was not simulated.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MissingRun {
    /// A value for each of [`Sweep::keys`], in their order, as it would be written into the scene.
    pub values: Vec<String>,
    /// Seed of the run.
    pub seed: u64,
}

/// One simulation of a sweep: its parameters and the summary of its results.
#[derive(Debug, Clone, Default)]
pub struct Run {
    /// A value for each of [`Sweep::keys`], in their order, as written into the scene.
    pub values: Vec<String>,
    /// Seed of the run; runs of equal values differ in it.
    pub seed: u64,
    /// Hash of the scene with these values, hexadecimal.
    pub hash: String,
    /// Totals, last values, means and maxima of the table that the simulation wrote.
    pub whole: Whole,
}

/// The mean over runs that differ in their seeds only.
#[derive(Debug, Clone, PartialEq)]
pub struct Mean {
    /// A value for each of [`Sweep::keys`], in their order, which all runs of the mean share.
    pub values: Vec<String>,
    /// Number of runs over which the mean is taken, at least 1.
    pub count: usize,
    /// For each of [`Sweep::outcome`], in its order; `None` for a column that the runs do not have.
    pub outcome: Vec<Option<Spread>>,
}

/// A quantity over runs that differ in their seeds only.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spread {
    /// Arithmetic mean over the seeds.
    pub mean: f64,
    /// Smallest value of any seed.
    pub least: f64,
    /// Largest value of any seed.
    pub most: f64,
    /// Standard deviation with n - 1 in the denominator; `None` for a single value.
    pub deviation: Option<f64>,
}

impl Spread {
    /// The spread of `values`; without any the mean is 0, and the extremes are infinite.
    pub fn of(values: &[f64]) -> Self {
        // Sums run in the order of the runs, so that the same sweep has the same digits.
        let count = values.len().max(1) as f64;
        let mean = values.iter().fold(0.0, |sum, v| sum + v) / count;
        let squares = values.iter().fold(0.0, |sum, v| sum + (v - mean) * (v - mean));
        Self {
            mean,
            least: values.iter().copied().fold(f64::INFINITY, f64::min),
            most: values.iter().copied().fold(f64::NEG_INFINITY, f64::max),
            deviation: (values.len() > 1).then(|| (squares / (count - 1.0)).sqrt()),
        }
    }
}

impl Run {
    /// The total of a column that counts events, or the value of another column at the last frame; `None` without the column or value.
    fn outcome(&self, name: &str) -> Option<f64> {
        let mut all = self.whole.totals.iter().chain(&self.whole.last);
        all.find(|c| c.0 == name).map(|c| c.1).filter(|v| !v.is_nan())
    }

    fn numbers(&self) -> impl Iterator<Item = (String, f64)> + '_ {
        let plain = self.whole.totals.iter().chain(&self.whole.last).map(|(name, v)| (name.clone(), *v));
        plain.chain(self.whole.mean.iter().map(|(name, v)| (format!("mean_{name}"), *v)))
    }
}

impl Sweep {
    /// Groups of runs with equal values, in the order of their first runs.
    fn groups(&self) -> Vec<Vec<&Run>> {
        let mut groups: Vec<Vec<&Run>> = Vec::new();
        for run in &self.runs {
            match groups.iter_mut().find(|g| g[0].values == run.values) {
                Some(group) => group.push(run),
                None => groups.push(vec![run]),
            }
        }
        groups
    }

    /// Means over the seeds, in the order of the first runs of each choice of values.
    pub fn means(&self) -> Vec<Mean> {
        let mean = |group: &Vec<&Run>| {
            let of = |name: &String| {
                let values: Vec<f64> = group.iter().filter_map(|r| r.outcome(name)).collect();
                (!values.is_empty()).then(|| Spread::of(&values))
            };
            Mean { values: group[0].values.clone(), count: group.len(), outcome: self.outcome.iter().map(of).collect() }
        };
        self.groups().iter().map(mean).collect()
    }

    /// Writes `sweep.csv` (a row for each run), `means.csv` (a row for each choice of values), `sweep.json`, `sweep.svg` if there
    /// are keys and runs, and `maps/<choice>/` with the mean of each map over the seeds and, of several seeds, the standard deviation;
    /// `<choice>` consists of the number of a choice and its values.
    /// # Errors
    /// `Io`; X012 for a map beyond the sizes of an image.
    pub fn write(&self, folder: &Folder) -> Result<()> {
        folder.write("sweep.csv", "sweep.csv", self.csv().as_bytes())?;
        folder.write("means.csv", "sweep.csv", self.means_csv().as_bytes())?;
        folder.write("sweep.json", "sweep.json", format!("{:#}\n", self.json()).as_bytes())?;
        if !self.keys.is_empty() && !self.runs.is_empty() {
            folder.write("sweep.svg", "sweep.svg", self.svg().as_bytes())?;
        }
        // All pictures of a map share the scale of the choice with the largest density, so that they can be compared.
        let count = self.maps.iter().map(Vec::len).max().unwrap_or(0);
        let brightest: Vec<f64> = (0..count)
            .map(|k| self.maps.iter().filter_map(|maps| maps.get(k)).map(MapStatistics::largest).fold(0.0, f64::max))
            .collect();
        for (i, (maps, choice)) in self.maps.iter().zip(self.means()).enumerate() {
            let path = format!("maps/{}", choice_folder(i, &choice.values));
            for (map, brightest) in maps.iter().zip(&brightest) {
                map.write(folder, &path, *brightest)?;
            }
        }
        Ok(())
    }

    /// Names of the numbers of all runs, in the order in which they first appear. The values of a key may add columns: a wavy
    /// ground is a solid of its own, and a lattice wind has statistics.
    fn columns(&self) -> Vec<String> {
        let mut names: Vec<String> = Vec::new();
        for (name, _) in self.runs.iter().flat_map(Run::numbers) {
            if !names.contains(&name) {
                names.push(name);
            }
        }
        names
    }

    /// A row for each run; the cell of a column that a run does not have is empty.
    fn csv(&self) -> String {
        let names = self.columns();
        let heads: Vec<String> =
            self.keys.iter().map(|k| csv_cell(k)).chain(["seed".to_owned()]).chain(names.clone()).collect();
        let mut out = heads.join(",") + "\n";
        for run in &self.runs {
            let values: Vec<String> = run.values.iter().map(|v| csv_cell(v)).collect();
            let own: BTreeMap<String, f64> = run.numbers().collect();
            let numbers = names.iter().map(|name| own.get(name).map_or_else(String::new, |v| number(*v)));
            let all: Vec<String> = values.into_iter().chain([run.seed.to_string()]).chain(numbers).collect();
            let _ = writeln!(out, "{}", all.join(","));
        }
        out
    }

    /// For each choice of values the number of its runs, then mean and standard deviation of each column of `sweep.csv` over
    /// them. The deviation of a single value is empty.
    fn means_csv(&self) -> String {
        let names = self.columns();
        let columns = names.iter().flat_map(|name| [name.clone(), format!("{name}_deviation")]);
        let heads: Vec<String> =
            self.keys.iter().map(|k| csv_cell(k)).chain(["runs".to_owned()]).chain(columns).collect();
        let mut out = heads.join(",") + "\n";
        for group in self.groups() {
            let rows: Vec<BTreeMap<String, f64>> = group.iter().map(|run| run.numbers().collect()).collect();
            let numbers = names.iter().flat_map(|name| {
                let values: Vec<f64> =
                    rows.iter().filter_map(|row| row.get(name).copied()).filter(|v| !v.is_nan()).collect();
                if values.is_empty() {
                    return [String::new(), String::new()];
                }
                let spread = Spread::of(&values);
                [number(spread.mean), spread.deviation.map_or_else(String::new, number)]
            });
            let values = group[0].values.iter().map(|v| csv_cell(v));
            let all: Vec<String> = values.chain([group.len().to_string()]).chain(numbers).collect();
            let _ = writeln!(out, "{}", all.join(","));
        }
        out
    }

    fn json(&self) -> Value {
        let values = |list: &[String]| -> Map<String, Value> {
            self.keys.iter().zip(list).map(|(k, v)| (k.clone(), v.clone().into())).collect()
        };
        let run = |r: &Run| {
            json!({
                "values": values(&r.values), "seed": r.seed.to_string(), "scene": r.hash, "totals": named(&r.whole.totals),
                "last": named(&r.whole.last), "mean": named(&r.whole.mean), "most": named(&r.whole.most),
            })
        };
        let mean = |m: &Mean| {
            let spread =
                |s: &Spread| json!({ "mean": s.mean, "least": s.least, "most": s.most, "deviation": s.deviation });
            // A column that the runs do not have is null.
            let names = self.outcome.iter().cloned();
            let outcome: Map<String, Value> =
                names.zip(m.outcome.iter().map(|s| s.as_ref().map_or(Value::Null, spread))).collect();
            json!({ "values": values(&m.values), "runs": m.count, "outcome": outcome })
        };
        let mut told = json!({
            "title": self.title, "keys": self.keys, "runs": self.runs.iter().map(run).collect::<Vec<_>>(),
            "means": self.means().iter().map(mean).collect::<Vec<_>>(),
        });
        // Only a part of a sweep has this field.
        if !self.missing.is_empty() {
            let row = |m: &MissingRun| json!({ "values": values(&m.values), "seed": m.seed.to_string() });
            told["missing"] = self.missing.iter().map(row).collect();
        }
        told
    }

    /// A panel for each column of the outcome, over the first key, with a line for each choice of the other keys.
    fn svg(&self) -> String {
        let means = self.means();
        let mut ticks: Vec<(f64, String)> = Vec::new();
        for text in means.iter().filter_map(|m| m.values.first()) {
            if !ticks.iter().any(|t| t.1 == *text) {
                // Values that are not numbers are placed side by side.
                ticks.push((text.parse().unwrap_or(ticks.len() as f64), text.clone()));
            }
        }
        let position = |m: &Mean| ticks.iter().find(|t| m.values.first() == Some(&t.1)).map_or(0.0, |t| t.0);
        // A line for each choice of the keys after the first, in the order of the runs.
        let mut others: Vec<&[String]> = Vec::new();
        for rest in means.iter().map(|m| m.values.get(1..).unwrap_or_default()) {
            if !others.contains(&rest) {
                others.push(rest);
            }
        }
        let panel = |(i, name): (usize, &String)| {
            let line = |rest: &&[String]| {
                let mut those: Vec<&Mean> = means.iter().filter(|m| m.values.get(1..) == Some(*rest)).collect();
                // Runs may be in any order; the line is drawn from left to right.
                those.sort_by(|a, b| position(a).total_cmp(&position(b)));
                let keys = self.keys.iter().skip(1).map(|k| k.rsplit('.').next().unwrap_or(k));
                let label: Vec<String> = keys.zip(*rest).map(|(k, v)| format!("{k} {v}")).collect();
                // Choices without the column have no point.
                let known: Vec<(&Mean, Spread)> = those.iter().filter_map(|m| Some((*m, m.outcome[i]?))).collect();
                PlotLine {
                    label: label.join(", "),
                    points: known.iter().map(|(m, s)| [position(m), s.mean]).collect(),
                    spread: known.iter().filter(|(m, _)| m.count > 1).map(|(_, s)| [s.least, s.most]).collect(),
                }
            };
            PlotPanel { name: name.replace('_', " "), lines: others.iter().map(line).collect() }
        };
        let axis = PlotAxis { ticks: ticks.clone(), label: self.keys.first().cloned().unwrap_or_default() };
        draw_panels(&self.title, &axis, &self.outcome.iter().enumerate().map(panel).collect::<Vec<_>>())
    }
}

/// Name of the folder of a choice: its number and its values, in letters that every file system takes.
fn choice_folder(number: usize, values: &[String]) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() || c == '.' || c == '-' { c } else { '_' };
    values.iter().fold(format!("{number:02}"), |name, value| name + "_" + &value.chars().map(plain).collect::<String>())
}

/// A cell of a CSV row (RFC 4180): in quotes if it has a comma, a quote or a line break.
fn csv_cell(text: &str) -> String {
    if text.contains([',', '"', '\n']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sweep() -> Sweep {
        let run = |values: [&str; 2], seed: u64, exited: f64| Run {
            values: values.map(str::to_owned).to_vec(),
            seed,
            hash: "ab".into(),
            whole: Whole {
                totals: vec![("merges".into(), 2.0)],
                last: vec![("exited".into(), exited)],
                mean: vec![("exited".into(), exited / 2.0)],
                most: vec![("exited".into(), exited)],
            },
        };
        Sweep {
            title: "A <street>".into(),
            keys: vec!["solid.0.size.1".into(), "flight.humidity".into()],
            outcome: vec!["exited".into(), "merges".into()],
            runs: vec![
                run(["2", "0.5"], 1, 10.0),
                run(["2", "0.5"], 2, 14.0),
                run(["0.5", "0.5"], 1, 20.0),
                run(["0.5", "[1, 2]"], 1, 4.0),
            ],
            missing: Vec::new(),
            maps: Vec::new(),
        }
    }

    #[test]
    fn a_part_of_a_sweep_lists_the_runs_that_it_lacks() {
        let mut part = sweep();
        assert_eq!(part.json().get("missing"), None);
        part.missing.push(MissingRun { values: vec!["3".into(), "0.5".into()], seed: 7 });
        let wanted = json!([{ "values": { "solid.0.size.1": "3", "flight.humidity": "0.5" }, "seed": "7" }]);
        assert_eq!(part.json()["missing"], wanted);
    }

    #[test]
    fn seeds_are_averaged_and_choices_are_not() {
        let means = sweep().means();
        assert_eq!(means.iter().map(|m| m.count).collect::<Vec<_>>(), [2, 1, 1]);
        let spread = |mean, least, most, deviation| Spread { mean, least, most, deviation: Some(deviation) };
        // Two values 4 apart: each 2 from the mean, and the sum of squares 8 over n - 1 = 1.
        let wanted = [spread(12.0, 10.0, 14.0, 8.0_f64.sqrt()), spread(2.0, 2.0, 2.0, 0.0)];
        assert_eq!(means[0].outcome, wanted.map(Some));
        // One seed does not tell how far others lie apart.
        assert_eq!(means[1].outcome[0].map(|s| (s.mean, s.deviation)), Some((20.0, None)));
        assert_eq!(sweep().json()["means"][1]["outcome"]["exited"]["deviation"], Value::Null);
    }

    #[test]
    fn folders_of_choices_are_plain_names() {
        assert_eq!(choice_folder(3, &["[1, 2]".into(), "0.5".into()]), "03__1__2__0.5");
        assert_eq!(choice_folder(0, &[]), "00");
    }

    #[test]
    fn a_row_for_each_run() {
        let text = sweep().csv();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[0], "solid.0.size.1,flight.humidity,seed,merges,exited,mean_exited");
        assert_eq!((lines[1], lines[4]), ("2,0.5,1,2,10,5", "0.5,\"[1, 2]\",1,2,4,2"));
    }

    #[test]
    fn a_row_of_means_for_each_choice() {
        let text = sweep().means_csv();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(
            lines[0],
            "solid.0.size.1,flight.humidity,runs,merges,merges_deviation,exited,exited_deviation,mean_exited,mean_exited_deviation"
        );
        // Values 10 and 14: mean 12, deviation sqrt(8); of their halves half of both.
        let numbers: Vec<f64> = lines[1].split(',').map(|v| v.parse().expect("a number")).collect();
        assert_eq!(numbers, [2.0, 0.5, 2.0, 2.0, 0.0, 12.0, 8.0_f64.sqrt(), 6.0, 2.0_f64.sqrt()]);
        assert_eq!((lines.len(), lines[3]), (4, "0.5,\"[1, 2]\",1,2,,4,,2,"));
    }

    /// A run in which nothing came to rest has no mean time; the others have.
    #[test]
    fn means_leave_out_runs_without_a_value() {
        let mut sweep = sweep();
        sweep.runs.truncate(2);
        for (run, time) in sweep.runs.iter_mut().zip([f64::NAN, 3.0]) {
            run.whole.last.push(("flight_time".into(), time));
        }
        let rows =
            |text: String| text.lines().map(|l| l.rsplit(',').nth(1).unwrap_or("").to_owned()).collect::<Vec<_>>();
        assert_eq!(rows(sweep.csv()), ["flight_time", "", "3"]);
        assert!(sweep.means_csv().lines().nth(1).is_some_and(|row| row.contains(",3,,")), "{}", sweep.means_csv());
        assert_eq!(sweep.json()["runs"][0]["last"]["flight_time"], Value::Null);
    }

    /// The third run has one solid more, whose column stands before another of its own.
    #[test]
    fn numbers_stand_below_their_names_where_runs_differ() {
        let mut sweep = sweep();
        sweep.runs[2].whole.last.insert(0, ("at_land".into(), 7.0));
        let text = sweep.csv();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[0], "solid.0.size.1,flight.humidity,seed,merges,exited,mean_exited,at_land");
        assert_eq!((lines[1], lines[3]), ("2,0.5,1,2,10,5,", "0.5,0.5,1,2,20,10,7"));
        let text = sweep.means_csv();
        let lines: Vec<&str> = text.lines().collect();
        assert!(lines[0].ends_with(",at_land,at_land_deviation") && lines[1].ends_with(",,"), "{text}");
        assert_eq!(lines[2], "0.5,0.5,1,2,,20,,10,,7,");
    }

    /// A value that a run lacks is null and has no point in the plot; it is not 0.
    #[test]
    fn columns_that_runs_lack_are_null() {
        let mut sweep = sweep();
        sweep.outcome.push("at_land".into());
        sweep.runs[2].whole.last.insert(0, ("at_land".into(), 7.0));
        let means = sweep.json()["means"].clone();
        let of = |choice: usize| means[choice]["outcome"]["at_land"].clone();
        assert_eq!((of(0), of(1)["mean"].as_f64(), of(2)), (Value::Null, Some(7.0), Value::Null));
        assert_eq!(means[0]["outcome"]["exited"]["mean"], 12.0);
        // The panel of the new column has one point, and no line for the humidity that lacks it.
        let lines = |text: &str| text.matches("<polyline").count();
        assert_eq!(lines(&sweep.svg()), 5);
    }

    /// Two panels; a line for each humidity, from the lowest wall to the highest, with the spread of the seeds.
    #[test]
    fn lines_run_over_the_first_key() {
        let text = sweep().svg();
        assert_eq!((text.matches("<polyline").count(), text.matches("stroke-width=\"1\"").count()), (4, 2));
        let first = text.lines().find(|l| l.starts_with("<polyline")).expect("a line");
        let xs: Vec<f64> = first
            .split('"')
            .nth(1)
            .expect("points")
            .split(' ')
            .map(|p| p.split(',').next().expect("x").parse().expect("x"))
            .collect();
        assert!(xs.len() == 2 && xs[0] < xs[1], "{first}");
        assert!(text.contains("humidity 0.5") && text.contains("A &lt;street&gt;") && text.contains("solid.0.size.1"));
    }
}
