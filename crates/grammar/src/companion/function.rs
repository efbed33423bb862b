//! Functions of one variable: `.func` and sets of them, `.fset`.

use super::words::Reader;
use osier_base::convert::to_usize;
use osier_base::diagnostic::{Diagnostic, SourceId};

/// Upper limit on the points of a function, counted with multiplicity, and on the functions of a set: larger files are
/// damaged.
const MAX_POINTS: usize = 4096;
const MAX_FUNCTIONS: usize = 256;
/// Upper limit on samples times points of a function, since each sample searches all points.
const MAX_WORK: usize = 500_000;

/// Control points and number of samples of a function y(x), as given in its file.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FunctionFile {
    /// Its name; empty if the file has none.
    pub name: String,
    /// Number of samples to tabulate the function with; 0 if it is not tabulated.
    pub samples: usize,
    /// Control points (x, y), each repeated according to its multiplicity.
    pub points: Vec<[f64; 2]>,
}

impl FunctionFile {
    /// Sets the number of samples, as `function: FILE n` does; functions with very many points are limited to fewer samples.
    pub fn tabulate(&mut self, samples: u32) {
        self.samples = to_usize(samples).min(MAX_WORK / self.points.len().max(1));
    }
}

/// Reads a function or a set of functions in any version of the format: `fver`, sets, and the older form that begins with
/// `range:`. Returns the readable functions, with L048 for the rest.
pub fn read_functions(text: &str, source: SourceId) -> (Vec<FunctionFile>, Vec<Diagnostic>) {
    let mut reader = Reader::new(text, source);
    let mut functions = Vec::new();
    if reader.peek().is_some_and(|w| w.text == "funcgalleryver") {
        reader.take_line();
    }
    while reader.peek().is_some() && functions.len() < MAX_FUNCTIONS {
        let Some(function) = read_one(&mut reader) else { break };
        functions.push(function);
    }
    if functions.is_empty() && reader.report.is_empty() {
        reader.expected("'points:' and the points of a function");
    }
    (functions, reader.report)
}

/// Reads the next function; `None` if no more can be read.
fn read_one(reader: &mut Reader<'_>) -> Option<FunctionFile> {
    let mut function = FunctionFile::default();
    while let Some(word) = reader.peek() {
        match word.text {
            "name:" => {
                let line = reader.take_line();
                function.name = line.iter().skip(1).map(|w| w.text).collect::<Vec<_>>().join(" ");
            }
            "samples:" => {
                reader.take();
                function.samples = reader.count("the number of samples")?;
            }
            "points:" => {
                reader.take();
                function.points = read_points(reader)?;
                // Each sample searches all points, so that the product of both bounds the time.
                function.samples = function.samples.min(MAX_WORK / function.points.len().max(1));
                return Some(function);
            }
            // Marks that the function editor stores, one a line: `m0 0.2 0.5`.
            "markers:" => {
                reader.take();
                let count = reader.count("the number of markers")?;
                for _ in 0..count {
                    if reader.take_line().is_empty() {
                        break;
                    }
                }
            }
            "items:" | "fver" | "flip:" | "range:" | "background:" | "backgroundXY:" => {
                reader.take_line();
            }
            _ => {
                reader.expected("'points:', 'name:', 'samples:' or 'fver'");
                return None;
            }
        }
    }
    // The file ends within a function, unless nothing of that function was read yet.
    if !function.name.is_empty() || function.samples > 0 {
        reader.expected("'points:' and the points of the function");
    }
    None
}

/// Reads the points after `points:`, one a line, with an optional multiplicity.
fn read_points(reader: &mut Reader<'_>) -> Option<Vec<[f64; 2]>> {
    let count = reader.count("the number of points")?;
    let mut points = Vec::new();
    for _ in 0..count {
        if count > MAX_POINTS || points.len() > MAX_POINTS {
            reader.complain(format!("a function of {count} points"), "a function has at most 4096 points");
            return None;
        }
        let line = reader.peek().map(|w| w.line);
        let point = [reader.number("the x of a point")?, reader.number("the y of a point")?];
        points.extend(std::iter::repeat_n(point, reader.multiplicity(line)));
    }
    Some(points)
}

#[cfg(test)]
mod tests {
    use super::*;
    use osier_base::diagnostic::Sources;

    fn read(text: &str) -> (Vec<FunctionFile>, Vec<Diagnostic>) {
        let source = Sources::default().add("f.func", text);
        read_functions(text, source)
    }

    #[test]
    fn all_versions_are_read() {
        let new = "fver 1 1\nname: leaf size\nsamples: 20\nflip: off\npoints: 2\n0.0 0.5\n1.0 2.5 3\n";
        let (functions, report) = read(new);
        assert_eq!(report, []);
        let points = vec![[0.0, 0.5], [1.0, 2.5], [1.0, 2.5], [1.0, 2.5]];
        assert_eq!(functions, [FunctionFile { name: "leaf size".into(), samples: 20, points }]);
        let marked =
            new.replace("flip:", "background: plan.png\nbackgroundXY: 0 0\nmarkers: 2\nm0 0.1 0.2\nm1 0.5 0.5\nflip:");
        let (with_marks, report) = read(&marked);
        assert_eq!((&with_marks, report.len()), (&functions, 0), "{report:?}");
        assert_eq!(read("markers: 18446744073709551615\n").0, []);
        let (old, _) = read("range: 0.0 1.0\npoints: 2\n0 0\n1 1\n");
        assert_eq!(old[0].points, [[0.0, 0.0], [1.0, 1.0]]);
        let (set, report) = read(&format!("funcgalleryver 1 1\nitems: 2\n{new}{new}"));
        assert_eq!((set.len(), report.len()), (2, 0));
    }

    #[test]
    fn damage_is_told() {
        for (text, wanted) in [
            ("", "expected 'points:'"),
            ("points: x\n", "expected the number of points, found 'x'"),
            ("points: 2\n0 0\n", "expected the x of a point, found the end of the file"),
            ("points: 2\n0 0\n1 y\n", "expected the y of a point, found 'y'"),
            ("points: 99999999999\n", "a function of 99999999999 points"),
            ("hello\n", "found 'hello'"),
            ("name: a\n", "expected 'points:'"),
            ("points: 1\n0 nan\n", "found 'nan'"),
        ] {
            let (_, report) = read(text);
            assert!(report.len() == 1 && report[0].message.contains(wanted), "{text:?}: {report:?}");
        }
    }
}
