//! Contours: outlines of generalised cylinders.

use super::words::Reader;
use crate::{Spline, SplineEnds};
use osier_base::diagnostic::{Diagnostic, SourceId};

/// Upper limit on the points of a contour, counted with multiplicity, and on the contours of a set, since measuring lengths
/// takes time for each point.
const MAX_POINTS: usize = 1024;
const MAX_CONTOURS: usize = 256;

/// The control points of a cubic B-spline outline.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ContourFile {
    /// Its name; empty if the file has none.
    pub name: String,
    /// From `type: closed`: the spline joins its last point to its first.
    pub closed: bool,
    /// Control points, each repeated according to its multiplicity.
    pub points: Vec<[f64; 3]>,
}

impl ContourFile {
    /// The cubic B-spline of the points, with uniform knots. An open spline ends before its outermost points unless these
    /// are repeated.
    pub fn spline(&self) -> Spline {
        Spline::new(&self.points, if self.closed { SplineEnds::Closed } else { SplineEnds::Open })
    }
}

/// Reads a contour or a set of contours in any version of the format: `cver`, `version:`, sets, and the older form whose
/// first line has the number of points, their dimension and `open` or `closed`. Returns the readable contours, with L048 for
/// the rest.
pub fn read_contours(text: &str, source: SourceId) -> (Vec<ContourFile>, Vec<Diagnostic>) {
    let mut reader = Reader::new(text, source);
    let mut contours = Vec::new();
    if reader.peek().is_some_and(|w| w.text == "contourgalleryver") {
        reader.take_line();
    }
    while reader.peek().is_some() && contours.len() < MAX_CONTOURS {
        let Some(contour) = read_one(&mut reader) else { break };
        contours.push(contour);
    }
    if contours.is_empty() && reader.report.is_empty() {
        reader.expected("'points:' and the points of a contour");
    }
    (contours, reader.report)
}

fn read_one(reader: &mut Reader<'_>) -> Option<ContourFile> {
    let mut contour = ContourFile::default();
    if reader.peek().is_some_and(|w| w.count().is_some()) {
        return old_form(reader);
    }
    let mut count = None;
    while let Some(word) = reader.peek() {
        match word.text {
            "name:" => {
                let line = reader.take_line();
                contour.name = line.iter().skip(1).map(|w| w.text).collect::<Vec<_>>().join(" ");
            }
            "points:" => {
                reader.take();
                count = Some(reader.count("the number of points")?);
                // A second number repeats the point count, including multiplicities.
                if reader.peek().is_some_and(|w| w.line == word.line) {
                    reader.take_line();
                }
            }
            "type:" => {
                let line = reader.take_line();
                contour.closed = line.get(1).is_some_and(|w| w.text.starts_with('c'));
            }
            // A line that begins with a number begins the rows of points.
            _ if word.number().is_some() => {
                let Some(count) = count else {
                    reader.expected("'points:'");
                    return None;
                };
                contour.points = rows(reader, count, 3)?;
                return Some(contour);
            }
            // Further properties of either version are skipped: items, samples, contact point, heading, up, size, range and
            // others.
            text if text.ends_with(':') || text == "cver" => {
                reader.take_line();
            }
            _ if matches!(reader.peek_at(1), Some(w) if w.line == word.line && w.text.ends_with(':')) => {
                reader.take_line();
            }
            _ => {
                reader.expected("'points:', 'type:' or 'cver'");
                return None;
            }
        }
    }
    reader.expected("the points of the contour");
    None
}

/// Reads the older form: `12 2 closed`, then the points.
fn old_form(reader: &mut Reader<'_>) -> Option<ContourFile> {
    let count = reader.count("the number of points")?;
    let dimension = reader.count("the dimension of the points, 2 or 3")?;
    let closed = match reader.peek().map(|w| w.text) {
        Some("closed") => true,
        Some("open") => false,
        _ => {
            reader.expected("'open' or 'closed'");
            return None;
        }
    };
    reader.take();
    Some(ContourFile { name: String::new(), closed, points: rows(reader, count, dimension.clamp(2, 3))? })
}

/// Reads rows of `dimension` numbers with an optional multiplicity.
fn rows(reader: &mut Reader<'_>, count: usize, dimension: usize) -> Option<Vec<[f64; 3]>> {
    let mut points = Vec::new();
    for _ in 0..count {
        if count > MAX_POINTS || points.len() > MAX_POINTS {
            reader.complain(format!("a contour of {count} points"), "a contour has at most 1024 points");
            return None;
        }
        let line = reader.peek().map(|w| w.line);
        let mut point = [0.0; 3];
        for (i, v) in point.iter_mut().take(dimension).enumerate() {
            // Points of a plane contour may omit z.
            if i < 2 || reader.peek().is_some_and(|w| Some(w.line) == line) {
                *v = reader.number("a coordinate of a point")?;
            }
        }
        points.extend(std::iter::repeat_n(point, reader.multiplicity(line)));
    }
    Some(points)
}

#[cfg(test)]
mod tests {
    use super::*;
    use osier_base::diagnostic::Sources;

    fn read(text: &str) -> (Vec<ContourFile>, Vec<Diagnostic>) {
        let source = Sources::default().add("c.con", text);
        read_contours(text, source)
    }

    #[test]
    fn all_versions_are_read() {
        let square = vec![[1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [-1.0, -1.0, 0.0], [-1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]];
        let rows = "1 1 0 1\n1 -1 0 1\n-1 -1 0 1\n-1 1 0 2\n";
        let new = format!("cver 1 1\nname: stem\npoints: 4 5\ntype: closed\n{rows}");
        let (contours, report) = read(&new);
        assert_eq!(report, []);
        assert_eq!(contours, [ContourFile { name: "stem".into(), closed: true, points: square.clone() }]);
        let (more, report) = read(&format!(
            "version: 1.4\nname: x\npoints: 4\nrange: 0.0 1.0\ndimension: 4 3\ntype: open\nsamples: 4\n{rows}"
        ));
        assert_eq!((more[0].closed, &more[0].points, report.len()), (false, &square, 0));
        let (old, report) = read("3 2 closed\n1 0\n0 1\n-1 0\n");
        assert_eq!((old[0].points.len(), old[0].closed, report.len()), (3, true, 0));
        let (set, report) = read(&format!("contourgalleryver 1 1\nitems: 2\n{new}{new}"));
        assert_eq!((set.len(), report.len()), (2, 0));
    }

    #[test]
    fn damage_is_told() {
        for (text, wanted) in [
            ("", "expected 'points:'"),
            ("cver 1 1\nname: x\n", "expected the points of the contour, found the end of the file"),
            ("cver 1 1\npoints: 2 2\ntype: closed\n0 0 0 1\n0 x 0 1\n", "expected a coordinate of a point, found 'x'"),
            ("4 2 round\n", "expected 'open' or 'closed', found 'round'"),
            ("cver 1 1\n1 2 3 1\n", "expected 'points:'"),
            ("points: 4000000000\ntype: closed\n1 2 3\n", "4000000000 points"),
        ] {
            let (_, report) = read(text);
            assert!(report.len() == 1 && report[0].message.contains(wanted), "{text:?}: {report:?}");
        }
    }
}
