//! Parameter sweeps: runs of a scene with different values of some keys, as rows of a table, and plots of the means over the seeds.

use std::fmt::Write as _;

use serde_json::{Map, Value, json};

use super::plot::{PlotAxis, PlotLine, PlotPanel, draw_panels};
use super::{Whole, named, number};
use osier_base::Result;
use osier_base::files::Folder;

/// The results of a parameter sweep.
#[derive(Debug, Clone, Default)]
pub struct Sweep {
    /// Title of the scene, for the plot.
    pub title: String,
    /// Keys, as `--set` names them.
    pub keys: Vec<String>,
    /// Columns of the table that are plotted.
    pub outcome: Vec<String>,
    /// In the order in which they were simulated.
    pub runs: Vec<Run>,
}

/// One simulation of a sweep: its parameters and the summary of its results.
#[derive(Debug, Clone, Default)]
pub struct Run {
    /// A value for each key, as written into the scene.
    pub values: Vec<String>,
    /// Seed of the run; runs of equal values differ in it.
    pub seed: u64,
    /// Hash of the scene with these values, hexadecimal.
    pub hash: String,
    /// Summary of its table.
    pub whole: Whole,
}

/// The mean over runs that differ in their seeds only.
#[derive(Debug, Clone, PartialEq)]
pub struct Mean {
    /// A value for each key.
    pub values: Vec<String>,
    /// Number of runs over which the mean is taken, at least 1.
    pub count: usize,
    /// Mean, minimum and maximum of each column of the outcome.
    pub outcome: Vec<[f64; 3]>,
}

impl Run {
    /// The total of a column that counts events, or the value of another column at the last frame.
    fn outcome(&self, name: &str) -> f64 {
        let all = self.whole.totals.iter().chain(&self.whole.last);
        all.filter(|c| c.0 == name).map(|c| c.1).next().unwrap_or(0.0)
    }

    fn numbers(&self) -> impl Iterator<Item = (String, f64)> + '_ {
        let plain = self.whole.totals.iter().chain(&self.whole.last).map(|(name, v)| (name.clone(), *v));
        plain.chain(self.whole.mean.iter().map(|(name, v)| (format!("mean_{name}"), *v)))
    }
}

impl Sweep {
    /// Means over the seeds, in the order of the first runs of each choice of values.
    pub fn means(&self) -> Vec<Mean> {
        let mut groups: Vec<Vec<&Run>> = Vec::new();
        for run in &self.runs {
            match groups.iter_mut().find(|g| g[0].values == run.values) {
                Some(group) => group.push(run),
                None => groups.push(vec![run]),
            }
        }
        let mean = |group: &Vec<&Run>| {
            let of = |name: &String| {
                let each = || group.iter().map(|r| r.outcome(name));
                let sum = each().fold(0.0, |sum, v| sum + v);
                // Outcomes are counts and sizes, not negative, so the maximum may start at 0.
                [sum / group.len() as f64, each().fold(f64::INFINITY, f64::min), each().fold(0.0, f64::max)]
            };
            Mean { values: group[0].values.clone(), count: group.len(), outcome: self.outcome.iter().map(of).collect() }
        };
        groups.iter().map(mean).collect()
    }

    /// Writes `sweep.csv`, `sweep.json`, and `sweep.svg` if there are keys and runs.
    /// # Errors
    /// `Io`.
    pub fn write(&self, folder: &Folder) -> Result<()> {
        folder.write("sweep.csv", "sweep.csv", self.csv().as_bytes())?;
        folder.write("sweep.json", "sweep.json", format!("{:#}\n", self.json()).as_bytes())?;
        if !self.keys.is_empty() && !self.runs.is_empty() {
            folder.write("sweep.svg", "sweep.svg", self.svg().as_bytes())?;
        }
        Ok(())
    }

    fn csv(&self) -> String {
        let names = self.runs.first().map(|r| r.numbers().map(|n| n.0).collect::<Vec<_>>()).unwrap_or_default();
        let heads: Vec<String> =
            self.keys.iter().map(|k| csv_cell(k)).chain(["seed".to_owned()]).chain(names).collect();
        let mut out = heads.join(",") + "\n";
        for run in &self.runs {
            let values: Vec<String> = run.values.iter().map(|v| csv_cell(v)).collect();
            let numbers: Vec<String> = run.numbers().map(|n| number(n.1)).collect();
            let all: Vec<String> = values.into_iter().chain([run.seed.to_string()]).chain(numbers).collect();
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
            let each = |(name, [mean, least, most]): (&String, &[f64; 3])| {
                (name.clone(), json!({ "mean": mean, "least": least, "most": most }))
            };
            let outcome: Map<String, Value> = self.outcome.iter().zip(&m.outcome).map(each).collect();
            json!({ "values": values(&m.values), "runs": m.count, "outcome": outcome })
        };
        json!({
            "title": self.title, "keys": self.keys, "runs": self.runs.iter().map(run).collect::<Vec<_>>(),
            "means": self.means().iter().map(mean).collect::<Vec<_>>(),
        })
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
                PlotLine {
                    label: label.join(", "),
                    points: those.iter().map(|m| [position(m), m.outcome[i][0]]).collect(),
                    spread: those.iter().filter(|m| m.count > 1).map(|m| [m.outcome[i][1], m.outcome[i][2]]).collect(),
                }
            };
            PlotPanel { name: name.replace('_', " "), lines: others.iter().map(line).collect() }
        };
        let axis = PlotAxis { ticks: ticks.clone(), label: self.keys.first().cloned().unwrap_or_default() };
        draw_panels(&self.title, &axis, &self.outcome.iter().enumerate().map(panel).collect::<Vec<_>>())
    }
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
        }
    }

    #[test]
    fn seeds_are_averaged_and_choices_are_not() {
        let means = sweep().means();
        assert_eq!(means.iter().map(|m| m.count).collect::<Vec<_>>(), [2, 1, 1]);
        assert_eq!(means[0].outcome, [[12.0, 10.0, 14.0], [2.0, 2.0, 2.0]]);
    }

    #[test]
    fn a_row_for_each_run() {
        let text = sweep().csv();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[0], "solid.0.size.1,flight.humidity,seed,merges,exited,mean_exited");
        assert_eq!((lines[1], lines[4]), ("2,0.5,1,2,10,5", "0.5,\"[1, 2]\",1,2,4,2"));
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
