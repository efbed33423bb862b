//! Surfaces of Bezier patches (`.s`) and of triangles (`.ray`).

use super::words::{Reader, Word};
use osier_base::diagnostic::{Diagnostic, SourceId};

/// Upper limit on the patches or triangles of a file; further ones are ignored.
const MAX_ITEMS: usize = 1_000_000;

/// Sixteen control points of a bicubic Bezier patch.
#[derive(Debug, Clone, PartialEq)]
pub struct SurfacePatch {
    /// Colour index of the upper side, 1 to 255; `None` for the turtle's colour, which index 0 of the file also selects.
    pub color: Option<u8>,
    /// Control points `points[row][column]` in the coordinates of the file.
    pub points: [[[f64; 3]; 4]; 4],
}

/// Patches of a surface and its placement relative to the turtle, in units of the file.
#[derive(Debug, Clone, PartialEq)]
pub struct SurfaceFile {
    /// Point of the surface that is placed at the turtle.
    pub contact: [f64; 3],
    /// Point of the surface to which the turtle moves after drawing it.
    pub end: [f64; 3],
    /// Direction in the file that is aligned with the turtle's heading.
    pub heading: [f64; 3],
    /// Direction in the file that is aligned with the turtle's up vector, whose sign is that of cpfg.
    pub up: [f64; 3],
    /// Length in the file that equals one turtle unit.
    pub size: f64,
    /// Patches in file order; not empty if read from a file.
    pub patches: Vec<SurfacePatch>,
}

impl SurfaceFile {
    /// Converts a point of the file to organ space: X to the right of the turtle, Y ahead, Z up; in units of `size`.
    /// Source: r = q - contact; l = h x u, v = r.x l + r.y h + r.z (l x h), organ point (-v.x, v.y, -v.z), which is r for the
    /// usual h = +Y and u = -Z.
    pub fn organ_point(&self, q: [f64; 3]) -> [f64; 3] {
        let r = [0, 1, 2].map(|i| (q[i] - self.contact[i]) / self.size);
        let h = unit(self.heading, [0.0, 1.0, 0.0]);
        let l = unit(cross(h, unit(self.up, [0.0, 0.0, -1.0])), [-1.0, 0.0, 0.0]);
        let n = cross(l, h);
        let v = [0, 1, 2].map(|i| r[0] * l[i] + r[1] * h[i] + r[2] * n[i]);
        [-v[0], v[1], -v[2]]
    }
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn unit(v: [f64; 3], fallback: [f64; 3]) -> [f64; 3] {
    let length = osier_base::math::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    if length > 1e-12 { v.map(|c| c / length) } else { fallback }
}

/// Reads a surface of Bezier patches: three rows of minimum and maximum coordinates, contact point, end point, heading, up,
/// size; then for each patch a name, colours, three lines of neighbours and four rows of four points. `None` if there is no
/// patch; L048 for unreadable parts.
pub fn read_surface(text: &str, source: SourceId) -> (Option<SurfaceFile>, Vec<Diagnostic>) {
    let mut reader = Reader::new(text, source);
    let surface = surface(&mut reader);
    (surface, reader.report)
}

fn surface(reader: &mut Reader<'_>) -> Option<SurfaceFile> {
    // Skip the bounding box, in one row or in three: the points define it.
    while reader.peek().is_some_and(|w| w.number().is_some()) {
        reader.take();
    }
    let mut out = SurfaceFile {
        contact: [0.0; 3],
        end: [0.0; 3],
        heading: [0.0, 1.0, 0.0],
        up: [0.0, 0.0, -1.0],
        size: 1.0,
        patches: Vec::new(),
    };
    loop {
        match reader.peek().map(|w| w.text) {
            Some("CONTACT") => out.contact = vector(reader, "the contact point")?,
            Some("END") => out.end = vector(reader, "the end point")?,
            Some("HEADING") => out.heading = vector(reader, "the heading")?,
            Some("UP") => out.up = vector(reader, "the up vector")?,
            // Skip cpfg's sampling of the patches, which has no effect here.
            Some("PRECISION") => {
                reader.take_line();
            }
            Some("SIZE:") => {
                reader.take();
                out.size = reader.number("the size")?;
                if out.size.abs() < 1e-12 {
                    reader.complain("the size of the surface is 0".into(), "it is read as 1");
                    out.size = 1.0;
                }
                break;
            }
            _ => {
                reader.expected("'CONTACT POINT', 'END POINT', 'HEADING', 'UP' or 'SIZE:'");
                return None;
            }
        }
    }
    while reader.peek().is_some() && out.patches.len() < MAX_ITEMS {
        match patch(reader) {
            Some(patch) => out.patches.push(patch),
            None => break,
        }
    }
    if out.patches.is_empty() {
        // If no error was reported, the file ends where a patch should begin.
        if reader.report.is_empty() {
            reader.expected("a patch");
        }
        return None;
    }
    Some(out)
}

/// Reads three numbers among words: `HEADING X: 0 Y: 1 Z: 0`.
fn vector(reader: &mut Reader<'_>, what: &str) -> Option<[f64; 3]> {
    let line = reader.peek().map(|w| w.line);
    let mut found = [0.0; 3];
    let mut n = 0;
    while n < 3 {
        let Some(word) = reader.peek().filter(|w| Some(w.line) == line) else {
            reader.expected(&format!("three coordinates of {what}"));
            return None;
        };
        if let Some(value) = number_behind_colon(word) {
            found[n] = value;
            n += 1;
        }
        reader.take();
    }
    while reader.peek().is_some_and(|w| Some(w.line) == line) {
        reader.take();
    }
    Some(found)
}

/// The number in `1.5` or `X:1.5`.
fn number_behind_colon(word: Word<'_>) -> Option<f64> {
    let text = word.text.rsplit(':').next().unwrap_or(word.text);
    text.parse::<f64>().ok().filter(|v| v.is_finite())
}

/// Reads a patch: lines of name, colours and neighbours, then 16 points.
fn patch(reader: &mut Reader<'_>) -> Option<SurfacePatch> {
    // Skip the first line as a whole, because the name may be a number.
    reader.take_line();
    let mut color = None;
    while let Some(word) = reader.peek().filter(|w| w.number().is_none()) {
        let line = reader.take_line();
        if word.text == "TOP" {
            let value = line.iter().skip(1).find_map(|w| number_behind_colon(*w));
            color = value.and_then(index).filter(|c| *c > 0);
        }
    }
    let mut points = [[[0.0; 3]; 4]; 4];
    for p in points.iter_mut().flatten().flatten() {
        *p = reader.number("a coordinate of one of the 16 points of a patch")?;
    }
    Some(SurfacePatch { color, points })
}

/// A colour index; `None` outside 0 to 255.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the range is checked")]
fn index(value: f64) -> Option<u8> {
    (0.0..256.0).contains(&value).then_some(value as u8)
}

/// A triangle of a `.ray` file, with a normal at each corner.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceTriangle {
    /// Corners in units of the file; their winding need not agree with the normals.
    pub points: [[f64; 3]; 3],
    /// Normals at the corners as given in the file, of any length.
    pub normals: [[f64; 3]; 3],
    /// Texture coordinates at the corners, if the file has them.
    pub uvs: Option<[[f64; 2]; 3]>,
}

/// Reads triangles: the word `triangle`, then three rows of a point, a normal and optional texture coordinates. Returns the
/// readable triangles, with L048 for the rest.
pub fn read_ray(text: &str, source: SourceId) -> (Vec<SurfaceTriangle>, Vec<Diagnostic>) {
    let mut reader = Reader::new(text, source);
    let mut out = Vec::new();
    while reader.peek().is_some() && out.len() < MAX_ITEMS {
        let Some(triangle) = triangle(&mut reader) else { break };
        out.push(triangle);
    }
    if out.is_empty() && reader.report.is_empty() {
        reader.expected("'triangle'");
    }
    (out, reader.report)
}

fn triangle(reader: &mut Reader<'_>) -> Option<SurfaceTriangle> {
    if reader.peek().is_none_or(|w| w.text != "triangle") {
        reader.expected("'triangle'");
        return None;
    }
    reader.take();
    // A number after the word is a material, which is skipped.
    let (mut points, mut normals, mut uvs) = ([[0.0; 3]; 3], [[0.0; 3]; 3], [[0.0; 2]; 3]);
    let mut textured = true;
    if reader.peek().zip(reader.peek_at(1)).is_some_and(|(a, b)| a.line != b.line) {
        reader.take();
    }
    for i in 0..3 {
        let line = reader.peek().map(|w| w.line);
        for v in points[i].iter_mut().chain(&mut normals[i]) {
            *v = reader.number("a coordinate of a corner or its normal")?;
        }
        for v in &mut uvs[i] {
            if reader.peek().is_some_and(|w| Some(w.line) == line) {
                *v = reader.number("a texture coordinate")?;
            } else {
                textured = false;
            }
        }
    }
    Some(SurfaceTriangle { points, normals, uvs: textured.then_some(uvs) })
}

#[cfg(test)]
#[allow(clippy::float_cmp, reason = "what is read is equal to the bit")]
mod tests {
    use super::*;
    use osier_base::diagnostic::Sources;

    const HEAD: &str = "0 1 0 2 0 0\nCONTACT POINT X: 0.5 Y: 0 Z: 0\nEND POINT X: 0.5 Y: 2 Z: 0\nHEADING X: 0 Y: 1 Z: 0\nUP X: 0 Y: 0 Z: -1\nSIZE: 2\n";
    const PATCH: &str = "petal\nTOP COLOR: 130 DIFFUSE: 0.5 BACK COLOR: 131 DIFFUSE: 0.5\nAL: ~ A: ~ AR: ~\nL: ~ R: ~\nBL: ~ B: ~ BR: ~\n\
        0 0 0  0.33 0 0  0.67 0 0  1 0 0\n0 0.67 0  0.33 0.67 0  0.67 0.67 0  1 0.67 0\n\
        0 1.33 0  0.33 1.33 0  0.67 1.33 0  1 1.33 0\n0 2 0  0.33 2 0  0.67 2 0  1 2 0\n";

    fn read(text: &str) -> (Option<SurfaceFile>, Vec<Diagnostic>) {
        let source = Sources::default().add("a.s", text);
        read_surface(text, source)
    }

    #[test]
    fn patches_are_read_with_their_place() {
        let (surface, report) = read(&format!("{HEAD}{PATCH}7{}", PATCH.strip_prefix("petal").unwrap_or("")));
        assert_eq!(report, []);
        let surface = surface.expect("a surface");
        assert_eq!((surface.patches.len(), surface.patches[0].color), (2, Some(130)));
        assert_eq!(surface.patches[1].points[3][3], [1.0, 2.0, 0.0]);
        // The usual axes: the point itself, from the contact point, over the size.
        assert_eq!(surface.organ_point([1.0, 2.0, 0.5]), [0.25, 1.0, 0.25]);
    }

    #[test]
    fn other_axes_turn_the_surface() {
        // Heading +Z, up +Y: l = Z x Y = -X, l x h = -X x Z = Y; r = (1, 2, 3) gives v = -X + 2 Z + 3 Y.
        let surface = SurfaceFile {
            contact: [0.0; 3],
            end: [0.0; 3],
            heading: [0.0, 0.0, 1.0],
            up: [0.0, 1.0, 0.0],
            size: 1.0,
            patches: Vec::new(),
        };
        assert_eq!(surface.organ_point([1.0, 2.0, 3.0]), [1.0, 3.0, -2.0]);
    }

    #[test]
    fn damage_is_told() {
        for (text, wanted) in [
            (String::new(), "expected 'CONTACT POINT'"),
            ("CONTACT POINT X: 1 Y: 2\n".into(), "three coordinates of the contact point"),
            (HEAD.into(), "expected a patch"),
            (format!("{HEAD}{}", &PATCH[..PATCH.len() - 8]), "found the end of the file"),
            (format!("{HEAD}{}", PATCH.replace("0.67 2 0", "0.67 x 0")), "found 'x'"),
            (HEAD.replace("SIZE: 2", "SIZE: 0"), "size of the surface is 0"),
        ] {
            let (_, report) = read(&text);
            assert!(!report.is_empty() && report[0].message.contains(wanted), "{text:?}: {report:?}");
        }
    }

    #[test]
    fn triangles_are_read() {
        let source = Sources::default().add("a.ray", "");
        let rows = "0 0 0 0 0 1\n1 0 0 0 0 1\n0 1 0 0 0 1\n";
        let (plain, report) = read_ray(&format!("triangle\n{rows}triangle {rows}"), source);
        assert_eq!((plain.len(), report.len(), plain[0].uvs), (2, 0, None));
        assert_eq!(plain[0], plain[1]);
        let (textured, _) = read_ray("triangle\n0 0 0 0 0 1 0 0\n1 0 0 0 0 1 1 0\n0 1 0 0 0 1 0 1\n", source);
        assert_eq!(textured[0].uvs, Some([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]));
        let (_, report) = read_ray("polygon\n", source);
        assert!(report[0].message.contains("expected 'triangle', found 'polygon'"));
    }
}
