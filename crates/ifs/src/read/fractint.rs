//! Converts the numbers of one Fractint entry into maps.

use super::IfsReader;
use crate::affine::Affine;
use crate::{Ifs, MAX_COEFFICIENT, Map};
use osier_base::diagnostic::{Diagnostic, Span};
use osier_base::files::{NumberError, number};

/// Most characters of a number that a diagnostic points at.
const MAX_NUMBER_LENGTH: usize = 64;

/// Name and dimension from an entry's header, or the name of a file without one.
pub(super) struct EntryTitle {
    pub name: String,
    /// `None` without a header: the dimension is guessed from the numbers.
    pub dim: Option<usize>,
    pub span: Span,
}

struct NumberToken {
    value: f64,
    span: Span,
    line: usize,
}

/// Reads the numbers of an entry whose body begins at byte `start` of the file. `None` after an error.
pub(super) fn system(reader: &mut IfsReader<'_>, body: &[u8], start: usize, title: EntryTitle) -> Option<Ifs> {
    let tokens = tokens(reader, body, start)?;
    if tokens.is_empty() {
        let text = format!("\"{}\" holds no numbers", title.name);
        let d = Diagnostic::error("I007", text, title.span, "an empty entry");
        reader.push(d.help("a map is 7 numbers: a b c d e f p, for x' = a x + b y + e, y' = c x + d y + f"));
        return None;
    }
    let dim = title.dim.unwrap_or_else(|| guess_dimension(&tokens));
    // A row is the matrix, the shift and the weight.
    let columns = if dim == 3 { 13 } else { 7 };
    if tokens.len() % columns != 0 {
        report_number_count(reader, &tokens, &title, columns);
        return None;
    }
    let maps = tokens.len() / columns;
    if maps > reader.max_maps() {
        let text = format!("\"{}\" has {maps} maps, the limit is {}", title.name, reader.max_maps());
        let d = Diagnostic::error("I008", text, title.span, "too many maps");
        reader.push(d.help("use fewer maps, or raise the limit with --max-maps"));
        return None;
    }
    // Other programs have these limits; this reader does not.
    if maps > 32 {
        let text = format!("\"{}\" has {maps} maps", title.name);
        let help = if maps > 64 { "Fractint reads 32 maps, Iterated Dynamics 64" } else { "Fractint reads 32 maps" };
        reader.push(Diagnostic::warning("I009", text, title.span, "more than others read").help(help));
    }
    let row = |row: &[NumberToken]| -> Option<Map> {
        let value = |i: usize| row.get(i).map_or(0.0, |t| t.value);
        let affine = if dim == 3 {
            Affine::space(std::array::from_fn(value))
        } else {
            Affine::plane(std::array::from_fn(value))
        };
        let span = row.first()?.span.to(row.last()?.span);
        Some(Map::new(affine, Some(value(columns - 1)), span))
    };
    Some(Ifs {
        name: title.name,
        dim,
        maps: tokens.chunks_exact(columns).filter_map(row).collect(),
        chaos: None,
        last: None,
        condensation: Vec::new(),
        view: None,
        palette: Vec::new(),
        weights: None,
        span: title.span,
    })
}

/// All numbers of a body; `None` if any of its words is not a number.
fn tokens(reader: &mut IfsReader<'_>, body: &[u8], start: usize) -> Option<Vec<NumberToken>> {
    let mut out = Vec::new();
    // Read on after a bad number, to report all of them; commas are reported once.
    let (mut at, mut line, mut comma, mut bad_ones) = (0, 0, None, 0);
    while let Some(b) = body.get(at) {
        match b {
            b'\n' => line += 1,
            b' ' => {}
            b',' => comma = comma.or(Some(at)),
            _ => {
                let length =
                    body[at..].iter().position(|b| matches!(b, b' ' | b'\n' | b',')).unwrap_or(body.len() - at);
                let (a, b) = (start + at, start + at + length);
                match value(reader.text.get(a..b).unwrap_or_default()) {
                    Ok(value) => out.push(NumberToken { value, span: reader.span(a, b), line }),
                    Err(why) => {
                        report_number(reader, a..b, out.len() + bad_ones, &why);
                        bad_ones += 1;
                    }
                }
                at += length - 1;
            }
        }
        at += 1;
        if reader.has_too_many_diagnostics() {
            return None;
        }
    }
    if let Some(comma) = comma {
        let span = reader.span(start + comma, start + comma + 1);
        let d = Diagnostic::warning("I009", "commas between numbers", span, "the first one");
        reader.push(d.help("Fractint separates numbers by blanks; a decimal comma must be a point"));
    }
    (bad_ones == 0).then_some(out)
}

fn value(word: &str) -> Result<f64, String> {
    if word.len() > MAX_NUMBER_LENGTH {
        return Err(format!("a number of {} characters", word.len()));
    }
    let value = number(word).map_err(|why| match why {
        NumberError::Malformed => format!("\"{word}\" is not a finite number"),
        NumberError::Comma | NumberError::TooLarge => format!("\"{word}\": {why}"),
    })?;
    if value.abs() > MAX_COEFFICIENT {
        return Err(format!("{word} is beyond 1e12"));
    }
    Ok(value)
}

/// Reports I005 for the number `index` of an entry, the bytes `word` of the text.
fn report_number(reader: &mut IfsReader<'_>, word: std::ops::Range<usize>, index: usize, why: &str) {
    // Diagnostics mark only the start of a long word.
    let end = word.start
        + reader
            .text
            .get(word.clone())
            .unwrap_or_default()
            .chars()
            .take(MAX_NUMBER_LENGTH)
            .map(char::len_utf8)
            .sum::<usize>();
    let span = reader.span(word.start, end);
    let d = Diagnostic::error("I005", why, span, format!("number {} of the entry", index + 1));
    reader.push(d.help("write finite decimals such as 0.85, -.04 or 1e-3, separated by blanks"));
}

/// Number of columns of a file without header: 7, or 13 if only that fits.
fn guess_dimension(tokens: &[NumberToken]) -> usize {
    let n = tokens.len();
    let mut per_line: Vec<usize> = Vec::new();
    for pair in tokens.chunk_by(|a, b| a.line == b.line) {
        per_line.push(pair.len());
    }
    // 13 numbers on every line, or a count that only 13 divides.
    let lines_of_13 = per_line.iter().all(|c| *c == 13);
    if lines_of_13 || (n.is_multiple_of(13) && !n.is_multiple_of(7)) { 3 } else { 2 }
}

/// Reports I007 at the first line that has a wrong count of numbers.
fn report_number_count(reader: &mut IfsReader<'_>, tokens: &[NumberToken], title: &EntryTitle, columns: usize) {
    let line = tokens.chunk_by(|a, b| a.line == b.line).find(|l| l.len() % columns != 0);
    let text = format!("\"{}\" has {} numbers, which is no multiple of {columns}", title.name, tokens.len());
    let (span, label) = match line {
        Some(line) => {
            let span = line.first().zip(line.last()).map_or(title.span, |(a, b)| a.span.to(b.span));
            (span, format!("{} numbers here", line.len()))
        }
        None => (title.span, String::from("in this entry")),
    };
    let d = Diagnostic::error("I007", text, span, label);
    // The most frequent cause is a missing or wrong (3D) in the header. A line with exactly the numbers of one map
    // shows that the header is right.
    let is_right = tokens.chunk_by(|a, b| a.line == b.line).any(|l| l.len() == columns);
    let fits = |columns: usize| tokens.len().is_multiple_of(columns) && !is_right;
    let (two, three) = (fits(7), fits(13));
    reader.push(match columns {
        7 if three => d.help("13 columns would fit: is it 3D? Then write (3D) behind the name"),
        13 if two => d.help("7 columns would fit: is it plane? Then take (3D) out of the header"),
        7 => d.help("a map of the plane has 7 numbers: a b c d e f p"),
        _ => d.help("a map of space has 13 numbers: a..i, j k l, p"),
    });
}
