//! Positions of the vertices of a PLY file (Stanford triangle format, 1.0): of a point cloud, or of a mesh whose faces are skipped.

/// Longest header that is searched for its end, bytes.
const MAX_HEADER: usize = 1 << 16;

/// How the values after the header are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

/// A property of a single value.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Property {
    name: String,
    kind: ValueKind,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ValueKind {
    Signed(usize),
    Unsigned(usize),
    Float,
    Double,
}

impl ValueKind {
    fn of_word(word: &str) -> Option<Self> {
        Some(match word {
            "char" | "int8" => Self::Signed(1),
            "short" | "int16" => Self::Signed(2),
            "int" | "int32" => Self::Signed(4),
            "uchar" | "uint8" => Self::Unsigned(1),
            "ushort" | "uint16" => Self::Unsigned(2),
            "uint" | "uint32" => Self::Unsigned(4),
            "float" | "float32" => Self::Float,
            "double" | "float64" => Self::Double,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Self::Signed(n) | Self::Unsigned(n) => n,
            Self::Float => 4,
            Self::Double => 8,
        }
    }

    /// The value of its bytes in little-endian order.
    fn value(self, bytes: &[u8]) -> f64 {
        let mut all = [0_u8; 8];
        all[..bytes.len()].copy_from_slice(bytes);
        let whole = u64::from_le_bytes(all);
        match self {
            Self::Float => f64::from(f32::from_le_bytes([all[0], all[1], all[2], all[3]])),
            Self::Double => f64::from_le_bytes(all),
            Self::Unsigned(_) => whole as f64,
            Self::Signed(n) => {
                // The sign bit of a shorter number moves to that of 64 bits and back.
                let unused = 64 - 8 * n;
                ((whole << unused).cast_signed() >> unused) as f64
            }
        }
    }
}

/// Reads `x`, `y` and `z` of the vertices of a PLY file, ASCII or binary, in the units of the file and in its order. The vertices must be
/// its first element.
/// # Errors
/// What is wrong with the file, in words.
pub fn ply_points(bytes: &[u8]) -> Result<Vec<[f64; 3]>, String> {
    let head = &bytes[..bytes.len().min(MAX_HEADER)];
    let end = head.windows(10).position(|w| w == b"end_header").ok_or("it has no header of a PLY file")?;
    let header = std::str::from_utf8(&head[..end]).map_err(|_| "its header is no text")?;
    let mut lines = header.lines().map(str::trim);
    if lines.next() != Some("ply") {
        return Err("it does not begin with the word ply".into());
    }

    // The encoding, and the properties of the first element.
    let (mut encoding, mut count, mut properties, mut elements) = (None, 0_usize, Vec::new(), 0);
    for line in lines {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            ["format", word, _] => {
                encoding = Some(match word {
                    "ascii" => Encoding::Ascii,
                    "binary_little_endian" => Encoding::LittleEndian,
                    "binary_big_endian" => Encoding::BigEndian,
                    _ => return Err(format!("its format \"{word}\" is unknown")),
                });
            }
            ["element", name, number] => {
                elements += 1;
                if elements == 1 {
                    if name != "vertex" {
                        return Err(format!("its first element is \"{name}\" and not \"vertex\""));
                    }
                    count = number.parse().map_err(|_| format!("\"{number}\" is not a number of vertices"))?;
                }
            }
            ["property", "list", ..] if elements == 1 => return Err("its vertices have a list".into()),
            ["property", kind, name] if elements == 1 => {
                let kind = ValueKind::of_word(kind).ok_or(format!("the type \"{kind}\" of {name} is unknown"))?;
                properties.push(Property { name: name.to_owned(), kind });
            }
            // Comments, and the elements after the vertices.
            _ => {}
        }
    }
    let encoding = encoding.ok_or("its header names no format")?;
    let mut columns = [0; 3];
    for (column, name) in columns.iter_mut().zip(["x", "y", "z"]) {
        *column = properties.iter().position(|p| p.name == name).ok_or(format!("its vertices have no {name}"))?;
    }

    // The line of `end_header` ends with a line feed, also in binary files.
    let line_end = bytes[end..].iter().position(|b| *b == b'\n').ok_or("it ends with its header")?;
    let body = &bytes[end + line_end + 1..];
    let points = match encoding {
        Encoding::Ascii => ascii_points(body, count, columns),
        _ => binary_points(body, count, &properties, encoding == Encoding::BigEndian, columns),
    };
    let points = points.ok_or_else(|| format!("it does not hold the {count} vertices of its header"))?;
    if points.iter().flatten().any(|v| !v.is_finite()) {
        return Err("a coordinate is not finite".into());
    }
    Ok(points)
}

fn ascii_points(body: &[u8], count: usize, columns: [usize; 3]) -> Option<Vec<[f64; 3]>> {
    let text = std::str::from_utf8(body).ok()?;
    let point = |line: &str| {
        let values: Vec<&str> = line.split_whitespace().collect();
        let at = |k: usize| values.get(columns[k])?.parse::<f64>().ok();
        Some([at(0)?, at(1)?, at(2)?])
    };
    let points: Option<Vec<[f64; 3]>> =
        text.lines().filter(|line| !line.trim().is_empty()).take(count).map(point).collect();
    points.filter(|points| points.len() == count)
}

fn binary_points(
    body: &[u8],
    count: usize,
    properties: &[Property],
    big_endian: bool,
    columns: [usize; 3],
) -> Option<Vec<[f64; 3]>> {
    let row: usize = properties.iter().map(|p| p.kind.size()).sum();
    if row.checked_mul(count)? > body.len() {
        return None;
    }
    let offset = |column: usize| properties[..column].iter().map(|p| p.kind.size()).sum::<usize>();
    let value = |row: &[u8], column: usize| {
        let (kind, from) = (properties[column].kind, offset(column));
        let mut bytes = row[from..from + kind.size()].to_vec();
        if big_endian {
            bytes.reverse();
        }
        kind.value(&bytes)
    };
    Some(body.chunks_exact(row).take(count).map(|row| columns.map(|column| value(row, column))).collect())
}

#[cfg(test)]
#[allow(clippy::cast_possible_truncation, reason = "numbers of a test file")]
mod tests {
    use super::*;

    #[test]
    fn the_same_points_are_read_from_text_and_from_bytes_of_either_order() {
        let header = |format: &str| {
            format!(
                "ply\nformat {format} 1.0\ncomment a cloud\nelement vertex 2\nproperty uchar red\nproperty float x\n\
                 property double y\nproperty short z\nelement face 0\nproperty list uchar int vertex_indices\nend_header\n"
            )
        };
        let points = [[1.5, -2.25, -3.0], [0.5, 1e3, 7.0]];
        let ascii = header("ascii") + "7 1.5 -2.25 -3\n7 0.5 1e3 7\n";
        assert_eq!(ply_points(ascii.as_bytes()), Ok(points.to_vec()));
        let body = |little: bool| -> Vec<u8> {
            let order = |mut bytes: Vec<u8>| {
                if !little {
                    bytes.reverse();
                }
                bytes
            };
            let row = |[x, y, z]: [f64; 3]| {
                let parts = [
                    vec![7],
                    (x as f32).to_le_bytes().to_vec(),
                    y.to_le_bytes().to_vec(),
                    (z as i16).to_le_bytes().to_vec(),
                ];
                parts.map(order).concat()
            };
            points.map(row).concat()
        };
        for (format, little) in [("binary_little_endian", true), ("binary_big_endian", false)] {
            let file = [header(format).into_bytes(), body(little)].concat();
            assert_eq!(ply_points(&file), Ok(points.to_vec()), "{format}");
            assert!(ply_points(&file[..file.len() - 1]).is_err_and(|e| e.contains("the 2 vertices")), "{format}");
        }
    }

    #[test]
    fn what_is_no_cloud_is_told() {
        let wrong = |text: &str| ply_points(text.as_bytes()).err().unwrap_or_default();
        assert!(wrong("x,y,z\n1,2,3\n").contains("no header"));
        assert!(wrong("ply\nformat ascii 1.0\nelement face 1\nend_header\n").contains("first element is \"face\""));
        let flat = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nend_header\n1 2\n";
        assert!(wrong(flat).contains("have no z"));
        let infinite = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n1 2 inf\n";
        assert!(wrong(infinite).contains("not finite"));
    }
}
