//! Checks every line of an OBJ text and notes which libraries it names.

use super::lines::{Word, lines, plain, rest, words};
use super::{Checked, Complaint};
use crate::{Job, Outcome};

/// Most corners of one face.
const CORNERS: usize = 10_000;

/// Complaints after which a file is given up.
const ENOUGH: usize = 20;

/// What the text refers to.
pub(super) struct Scan {
    /// Library names in order, with their first byte.
    pub(super) libraries: Vec<(String, usize)>,
}

#[derive(Default)]
struct Counts {
    vertices: u64,
    colored: u64,
    uvs: u64,
    normals: u64,
    triangles: u64,
    faceless: u64,
}

/// Checks a text; `None` if it has errors, which are then in the report.
/// # Errors
/// X010 if it holds more than the limits allow.
pub(super) fn scan(job: &mut Job<'_>, checked: &mut Checked<'_>) -> Outcome<Option<Scan>> {
    let plain = plain(checked.text);
    let mut counts = Counts::default();
    let mut libraries = Vec::new();
    let mut complaints = 0;
    for (start, line) in lines(&plain) {
        let mut words = words(start, line);
        let Some(key) = words.next() else { continue };
        let result = match key.text {
            "v" => vertex(key, words, &mut counts),
            "vt" => numbers(key, words, 1..=3).map(|n| counts.uvs += u64::from(n > 0)),
            "vn" => numbers(key, words, 3..=3).map(|_| counts.normals += 1),
            "f" | "l" => face(key, words, &mut counts),
            "mtllib" | "usemtl" => {
                let rest = rest(start, line);
                if key.text == "mtllib" && !libraries.iter().any(|(l, _)| l == rest.text) {
                    libraries.push((rest.text.to_owned(), rest.start));
                }
                if rest.text.is_empty() {
                    Err(key.complaint("a name is missing", "add it, or remove the line"))
                } else {
                    Ok(())
                }
            }
            _ => Ok(()),
        };
        if let Err(complaint) = result {
            checked.complain(job, complaint);
            complaints += 1;
            if complaints == ENOUGH {
                break;
            }
        }
    }
    job.limit("vertices", counts.vertices.max(counts.uvs).max(counts.normals))?;
    job.limit("triangles", counts.triangles)?;
    if counts.colored != 0 && counts.colored != counts.vertices {
        let (some, all) = (counts.colored, counts.vertices);
        return Err(Box::new(
            job.fault("X010", format_args!("gives {some} of {all} vertices a colour"))
                .help("colour all of them or none"),
        ));
    }
    if counts.faceless > 0 {
        let n = counts.faceless;
        job.warn("X016", format_args!("holds {n} faces with fewer than three corners; they are left out"));
    }
    Ok((complaints == 0).then_some(Scan { libraries }))
}

/// Checks that as many numbers follow as allowed; returns how many.
fn numbers<'a>(
    key: Word<'_>,
    words: impl Iterator<Item = Word<'a>>,
    allowed: std::ops::RangeInclusive<usize>,
) -> Result<usize, Complaint> {
    let mut n = 0;
    for word in words {
        word.number()?;
        n += 1;
        if n > *allowed.end() {
            return Err(word.complaint(format!("at most {} numbers follow {:?}", allowed.end(), key.text), "remove it"));
        }
    }
    // A texture coordinate without v is read as v = 0 by nobody we hand it to.
    let least = (*allowed.start()).max(if key.text == "vt" { 2 } else { 0 });
    if n < least {
        let message = format!("{:?} needs {least} numbers, {n} follow", key.text);
        return Err(key.complaint(message, "add the missing numbers"));
    }
    Ok(n)
}

fn vertex<'a>(key: Word<'_>, words: impl Iterator<Item = Word<'a>>, counts: &mut Counts) -> Result<(), Complaint> {
    let all: Vec<Word<'a>> = words.take(7).collect();
    match numbers(key, all.iter().copied(), 3..=6)? {
        4 => {
            if let Some(w) = all.get(3)
                && w.number()?.abs() < f64::from(f32::MIN_POSITIVE)
            {
                return Err(w.complaint("a vertex cannot be divided by 0", "remove the fourth number"));
            }
        }
        5 => return Err(key.complaint("5 numbers are no vertex", "write x y z, x y z w, or x y z r g b")),
        6 => counts.colored += 1,
        _ => {}
    }
    counts.vertices += 1;
    Ok(())
}

fn face<'a>(key: Word<'_>, words: impl Iterator<Item = Word<'a>>, counts: &mut Counts) -> Result<(), Complaint> {
    let mut n = 0_usize;
    for word in words {
        n += 1;
        if n > CORNERS {
            let message = format!("a face has more than {CORNERS} corners");
            return Err(key.complaint(message, "triangulate the mesh before exporting it"));
        }
        let mut fields = word.text.split('/');
        index(word, fields.next(), counts.vertices, "vertices", false)?;
        index(word, fields.next(), counts.uvs, "texture coordinates", true)?;
        index(word, fields.next(), counts.normals, "normals", true)?;
        if fields.next().is_some() {
            return Err(word.complaint("a corner has at most three indices", "write v, v/vt, v//vn or v/vt/vn"));
        }
    }
    if n == 0 {
        return Err(key.complaint("a face without corners", "add them, or remove the line"));
    }
    if key.text == "f" {
        counts.faceless += u64::from(n < 3);
        counts.triangles += n.saturating_sub(2) as u64;
    }
    Ok(())
}

/// Checks one index of a corner against what was defined above it.
fn index(word: Word<'_>, field: Option<&str>, count: u64, what: &str, optional: bool) -> Result<(), Complaint> {
    let field = match field {
        None | Some("") if optional => return Ok(()),
        Some(field) => field,
        None => "",
    };
    let help = "count from 1, or backwards from -1, over what stands above this line";
    let digits = field.strip_prefix('-').unwrap_or(field);
    let plain = !digits.is_empty() && digits.bytes().all(|b| b.is_ascii_digit());
    if !plain {
        return Err(word.complaint("expected an index such as 3 or -1", help));
    }
    match digits.parse::<u64>() {
        Ok(0) => Err(word.complaint("indices count from 1", help)),
        Ok(n) if n <= count => Ok(()),
        _ => Err(word.complaint(format!("index {field} is out of range: {count} {what} stand above"), help)),
    }
}
