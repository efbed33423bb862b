//! Lines and tokens of OBJ and MTL with their byte offsets.

use super::SyntaxError;
use osier_base::files::{NumberError, number};

/// A token and the offset of its first byte.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ObjToken<'a> {
    pub(super) text: &'a str,
    pub(super) start: usize,
}

impl ObjToken<'_> {
    /// A syntax error (X010) at this token.
    pub(super) fn syntax_error(&self, message: impl Into<String>, help: &'static str) -> SyntaxError {
        let end = self.start + self.text.len();
        let (message, label) = (message.into(), format!("{:?}", self.text));
        SyntaxError { code: "X010", start: self.start, end, message, label, help }
    }

    /// The token as a finite number that fits an f32; else X001 or X010 at the token.
    pub(super) fn number(&self) -> Result<f64, SyntaxError> {
        let value = number(self.text).map_err(|why| {
            let token = self.text.trim_start_matches(['+', '-']).to_ascii_lowercase();
            let infinite = matches!(token.as_str(), "nan" | "inf" | "infinity") || why == NumberError::TooLarge;
            let code = if infinite { "X001" } else { "X010" };
            let message = if infinite { "value is not finite".into() } else { why.to_string() };
            let help = match why {
                NumberError::Comma => "replace the comma by a point",
                _ => "write a finite decimal number such as 0.25",
            };
            SyntaxError { code, ..self.syntax_error(message, help) }
        })?;
        if value.abs() <= f64::from(f32::MAX) {
            Ok(value)
        } else {
            Err(SyntaxError {
                code: "X001",
                ..self.syntax_error("value is not finite in 32 bits", "scale the mesh down")
            })
        }
    }
}

/// The text with continued lines joined and tabs replaced by blanks; every byte keeps its offset.
pub(super) fn plain(text: &str) -> String {
    // A backslash and its line end become two blanks, so that the length stays the same.
    text.replace("\\\n", "  ").replace('\t', " ")
}

/// Which indices a corner of a face has besides that of its vertex.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct CornerForm {
    uv: bool,
    normal: bool,
}

impl CornerForm {
    /// The form of a corner such as `3/1/2` or `3//2`.
    pub(super) fn of(corner: &str) -> Self {
        let mut fields = corner.split('/').skip(1);
        let mut is_given = || fields.next().is_some_and(|field| !field.is_empty());
        Self { uv: is_given(), normal: is_given() }
    }
}

/// Rewrites a plain text so that `tobj` reads it correctly. Lines (`l`) are left out, because `tobj` makes faces of
/// them. A new object begins before each face whose corners have another form than those of the face before: `tobj`
/// stores the texture coordinates and normals of an object without gaps, so that in an object with mixed forms they
/// would belong to other vertices. Indentation is removed, since `tobj` counts blanks before `usemtl` and `o` as a part
/// of the name. With `fill_colors`, vertices without a colour become white, since `tobj` takes colours for all vertices
/// or for none.
pub(super) fn for_tobj(plain: &str, fill_colors: bool) -> String {
    let mut text = String::with_capacity(plain.len());
    let (mut object, mut last) = ("o", None);
    for (_, line) in lines(plain) {
        let line = line.trim_start();
        let mut words = line.split_whitespace();
        match words.next() {
            Some("l") => continue,
            Some("o" | "g") => (object, last) = (line, None),
            Some("f") => {
                let form = words.next().map(CornerForm::of);
                if last.is_some() && last != form {
                    text.push_str(object);
                    text.push('\n');
                }
                last = form;
            }
            _ => {}
        }
        text.push_str(line);
        if fill_colors && line.starts_with("v ") && line.split_whitespace().count() == 4 {
            text.push_str(" 1 1 1");
        }
        text.push('\n');
    }
    text
}

/// Lines of a plain text with the first byte of each, comments and blank lines left out.
pub(super) fn lines(plain: &str) -> impl Iterator<Item = (usize, &str)> {
    let mut next = 0;
    let with_start = plain.split('\n').map(move |line| {
        let start = next;
        // Add the length of the line end that `split` removed.
        next += line.len() + 1;
        (start, line)
    });
    with_start.filter(|(_, line)| !line.trim_start().is_empty() && !line.trim_start().starts_with('#'))
}

/// Words of a line that begins at byte `start`.
pub(super) fn tokens(start: usize, line: &str) -> impl Iterator<Item = ObjToken<'_>> {
    let base = line.as_ptr() as usize;
    line.split_whitespace().map(move |text| ObjToken { text, start: start + (text.as_ptr() as usize - base) })
}

/// The text after the first token, trimmed, as one token.
pub(super) fn rest(start: usize, line: &str) -> ObjToken<'_> {
    let first = line.trim_start();
    let after = first.split_once(' ').map_or("", |(_, rest)| rest).trim();
    let offset = if after.is_empty() { line.len() } else { after.as_ptr() as usize - line.as_ptr() as usize };
    ObjToken { text: after, start: start + offset }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_for_tobj_has_one_form_of_corners_in_each_object() {
        let plain = "  o Leaf\nl 1 2 3\nf 1 2 3\nf 3 2 1\nf 1/1 2/2 3/3\nf 1//1 2//2 3//3\no Bark\nf 1 2 3\n";
        let wanted = "o Leaf\nf 1 2 3\nf 3 2 1\no Leaf\nf 1/1 2/2 3/3\no Leaf\nf 1//1 2//2 3//3\no Bark\nf 1 2 3\n";
        assert_eq!(for_tobj(plain, false), wanted);
        assert_eq!(for_tobj("v 0 0 0\nv 1 0 0 0.5 0.5 0\n", true), "v 0 0 0 1 1 1\nv 1 0 0 0.5 0.5 0\n");
    }

    #[test]
    fn places_survive_continued_lines_and_tabs() {
        let plain = plain("# c\nv\t1 \\\n 2  3\n\nmtllib  a b.mtl \n");
        let all: Vec<(usize, Vec<ObjToken<'_>>)> = lines(&plain).map(|(s, l)| (s, tokens(s, l).collect())).collect();
        assert_eq!(all[0].0, 4);
        let starts: Vec<usize> = all[0].1.iter().map(|w| w.start).collect();
        assert_eq!(starts, [4, 6, 11, 14]);
        let (start, line) = lines(&plain).nth(1).expect("mtllib");
        assert_eq!(rest(start, line), ObjToken { text: "a b.mtl", start: 25 });
    }
}
