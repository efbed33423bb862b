//! View files: how a grammar is drawn.

use std::collections::BTreeMap;

use super::condition;
use super::words::{Word, shown, words};
use osier_base::diagnostic::{Diagnostic, SourceId, Sources, Span};
use osier_base::files::{Encoding, decode};

/// Upper limit on the files that a view names; lines beyond it are L048.
const MAX_FILES: usize = 256;
/// Levels of `#include` in a view; deeper ones are L048.
const MAX_DEPTH: usize = 32;
/// Upper limits: bytes of a view with its includes; and for one line, the number of macro replacements and the bytes they
/// produce.
const MAX_BYTES: usize = 1 << 24;
const MAX_REPLACEMENTS: usize = 1000;
const MAX_EXPANDED: usize = 1 << 16;

/// Values of `line style:`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LineStyle {
    /// Lines with widths in pixels.
    Pixel,
    /// Flat polygons of the line's width.
    Polygon,
    /// Cylinders whose diameter is the line's width.
    Cylinder,
}

/// Reference to another file in a line of a view.
#[derive(Debug, Clone, PartialEq)]
pub struct FileLine {
    /// Name of the file as the line has it, relative to the view file.
    pub file: String,
    /// The whole line, for messages.
    pub span: Span,
    /// Number before or after the name: samples of a function, or number of a contour.
    pub number: Option<u32>,
}

/// A line of the view that assigns a surface to a letter.
#[derive(Debug, Clone, PartialEq)]
pub struct SurfaceLine {
    /// Letter that draws the surface when it follows `~`.
    pub letter: char,
    /// File of the surface, relative to the view; its `number` is `None`.
    pub file: FileLine,
    /// Turtle units per unit of the surface file, above 0; 1 if the line gives no number.
    pub scale: f64,
    /// Number of quads along and across each patch, 0 to 256; `None` if the line gives none.
    pub quads: Option<[u32; 2]>,
    /// Number of the texture, counted from 1 in the order of the view; `None` for none.
    pub texture: Option<u32>,
}

/// A tropism or torque of the view: the direction that the turtle bends to, and its strength.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ViewTropism {
    /// Direction that the heading turns towards.
    pub dir: [f64; 3],
    /// Angle between heading and `dir` at rest, degrees.
    pub angle: f64,
    /// Strength of the turn, -1 to 1; negative values turn away from `dir`.
    pub intensity: f64,
    /// Initial elasticity.
    pub elasticity: f64,
    /// Increment of the elasticity by `@Ti` without a parameter.
    pub step: f64,
    /// True for `torque:`, which turns the turtle about its heading; false for `tropism:`, which turns the heading.
    pub torque: bool,
}

/// What a view file sets; what it does not set is `None` or empty.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct View {
    /// Angle of rotation commands without a parameter, degrees.
    pub angle: Option<f64>,
    /// Initial line width, in pixels if `line` is `Pixel` or `None`, else in turtle units.
    pub width: Option<f64>,
    /// Increment of the line width by `#` and decrement by `!`, without a parameter.
    pub width_increment: Option<f64>,
    /// Shape of segments, set by `line style:` or by the unit of `initial line width:`; the last such line counts.
    pub line: Option<LineStyle>,
    /// Whether segments taper to the width of the next one.
    pub tapered: Option<bool>,
    /// Initial colour index.
    pub color: Option<u8>,
    /// Increment of the colour index by `;` and decrement by `,`, without a parameter.
    pub color_increment: Option<u8>,
    /// Initial scale factor of lengths and widths.
    pub scale: Option<f64>,
    /// Scale factor of `@D` without a parameter.
    pub scale_multiplier: Option<f64>,
    /// Number of sides of circular cross sections.
    pub sides: Option<u32>,
    /// Whether the cross section of generalised cylinders turns with the turtle.
    pub twist: Option<bool>,
    /// Whether the parts of the final string after a `%` are drawn.
    pub past_cut: Option<bool>,
    /// Tropisms and torques in the order of the file.
    pub tropisms: Vec<ViewTropism>,
    /// Direction of the older tropism of cpfg (`tropism direction:`), which has no angle and no intensity.
    pub old_direction: Option<[f64; 3]>,
    /// Initial elasticity of the older tropism.
    pub old_elasticity: Option<f64>,
    /// Increment of the elasticity of the older tropism by `_` without a parameter.
    pub old_increment: Option<f64>,
    /// Lines `surface:` in file order; most of their files hold patches, a few hold triangles.
    pub surfaces: Vec<SurfaceLine>,
    /// Lines `tsurface:` in order; their files hold triangles.
    pub triangles: Vec<SurfaceLine>,
    /// Texture files in the order of the view; the first one has number 1.
    pub textures: Vec<FileLine>,
    /// Lines `contour:` in order; `number` is the number of the contour.
    pub contours: Vec<FileLine>,
    /// Lines `contour set:` in order; each file holds several contours, and `number` is `None`.
    pub contour_sets: Vec<FileLine>,
    /// Functions and sets of functions in file order; a set has no number of samples.
    pub functions: Vec<FileLine>,
}

/// Reads a file that a view includes; returns its name for messages and its bytes.
pub type ViewInclude<'a> = dyn FnMut(&str) -> Result<(String, Vec<u8>), String> + 'a;

/// Reads a view, whose text is added to `sources`. `name`: for messages. Returns the view with its warnings: L048 for
/// damaged lines and for unreadable includes, L047 for lines that have no effect here.
pub fn read_view(
    name: &str,
    bytes: &[u8],
    sources: &mut Sources,
    include: &mut ViewInclude<'_>,
) -> (View, Vec<Diagnostic>) {
    let macros = BTreeMap::from([("OSIER".to_owned(), "1".to_owned())]);
    let mut reader = ViewReader { sources, include, macros, view: View::default(), report: Vec::new(), bytes: 0 };
    reader.file(name, bytes, 0);
    (reader.view, reader.report)
}

struct ViewReader<'a, 'b> {
    sources: &'a mut Sources,
    include: &'a mut ViewInclude<'b>,
    macros: BTreeMap<String, String>,
    view: View,
    report: Vec<Diagnostic>,
    bytes: usize,
}

/// A line of a view after macro replacement, and its place.
struct Line<'a> {
    words: Vec<Word<'a>>,
    span: Span,
}

/// An `#if`, `#ifdef` or `#ifndef` that is not closed by `#endif` yet.
#[derive(Debug, Clone, Copy)]
struct Conditional {
    /// True if the lines of the current branch are read.
    counts: bool,
    /// True if a branch so far was read, so that `#else` is not.
    has_counted: bool,
}

impl ViewReader<'_, '_> {
    fn file(&mut self, name: &str, bytes: &[u8], depth: usize) {
        self.bytes += bytes.len();
        let shown = match decode(bytes, Encoding::OrLatin1) {
            Ok(decoded) if self.bytes <= MAX_BYTES => decoded.text,
            Ok(_) => {
                let message = format!("\"{name}\" and what it includes are longer than 16 MiB");
                self.report.push(Diagnostic::about("L048", message).help("it is not read"));
                return;
            }
            Err(bad) => {
                let message = format!("\"{name}\" is no view file: {bad}");
                self.report.push(Diagnostic::about("L048", message).help("it is not read"));
                return;
            }
        };
        let source = self.sources.add(name, shown.as_str());
        let text = without_comments(&shown);
        let mut open: Vec<Conditional> = Vec::new();
        let mut start = 0;
        for line in text.split('\n') {
            let span = Span::new(source, start, start + line.trim_end().len());
            start += line.len() + 1;
            // A line is read only if it is in the branch that holds of every `#if` around it.
            let counts = open.iter().all(|o| o.counts);
            if let Some(directive) = line.trim_start().strip_prefix('#') {
                self.directive(directive, span, counts, &mut open, depth);
            } else if counts && !line.trim().is_empty() {
                let first = span.start as usize;
                self.line(line, source, first);
            }
        }
    }

    fn directive(&mut self, text: &str, span: Span, counts: bool, open: &mut Vec<Conditional>, depth: usize) {
        let text = text.trim();
        let (word, rest) = text.split_at(text.find(|c: char| !c.is_ascii_alphabetic()).unwrap_or(text.len()));
        let rest = rest.trim();
        // Skip definitions and includes in branches that do not hold.
        match word {
            "define" if counts => {
                let (name, body) = rest.split_once(char::is_whitespace).unwrap_or((rest, ""));
                if name.contains('(') {
                    self.warn("L048", span, format!("macro '{}' of a view has arguments", shown(name)));
                } else {
                    self.macros.insert(name.to_owned(), body.trim().to_owned());
                }
            }
            "undef" if counts => {
                self.macros.remove(rest);
            }
            "ifdef" | "ifndef" | "if" => {
                let holds = match word {
                    "ifdef" => self.macros.contains_key(rest),
                    "ifndef" => !self.macros.contains_key(rest),
                    _ => counts && self.condition(rest, span),
                };
                open.push(Conditional { counts: holds, has_counted: holds });
            }
            "elif" => {
                if let Some((last, outer)) = open.split_last_mut() {
                    let holds = !last.has_counted && outer.iter().all(|o| o.counts) && self.condition(rest, span);
                    *last = Conditional { counts: holds, has_counted: last.has_counted || holds };
                }
            }
            "else" => {
                if let Some(last) = open.last_mut() {
                    *last = Conditional { counts: !last.has_counted, has_counted: true };
                }
            }
            "endif" => {
                open.pop();
            }
            "include" if counts => {
                let file = rest.trim_matches(['"', '<', '>', ' ']);
                if depth >= MAX_DEPTH {
                    let message = format!("\"{}\" is included {MAX_DEPTH} files deep", shown(file));
                    return self.warn("L048", span, message);
                }
                match (self.include)(file) {
                    Ok((name, bytes)) => self.file(&name, &bytes, depth + 1),
                    Err(why) => self.warn("L048", span, format!("the view includes \"{}\": {why}", shown(file))),
                }
            }
            _ => {}
        }
    }

    /// Evaluates the condition of an `#if`; L048 and false if it cannot be parsed.
    fn condition(&mut self, text: &str, span: Span) -> bool {
        let holds = condition::holds(&self.expand(&self.without_defined(text)));
        if holds.is_none() {
            self.warn("L048", span, format!("expected a condition of whole numbers, found '{}'", shown(text)));
        }
        holds.unwrap_or(false)
    }

    /// Replaces `defined(X)` and `defined X` by 1 or 0, before macros are expanded.
    fn without_defined(&self, text: &str) -> String {
        let mut parts = text.split("defined");
        let mut out = parts.next().unwrap_or("").to_owned();
        for part in parts.map(str::trim_start) {
            let inside = part.strip_prefix('(').map(str::trim_start);
            let name = inside.unwrap_or(part);
            let end = name.find(|c: char| !c.is_ascii_alphanumeric() && c != '_').unwrap_or(name.len());
            let (name, rest) = name.split_at(end);
            out.push(if self.macros.contains_key(name) { '1' } else { '0' });
            out.push_str(inside.and_then(|_| rest.trim_start().strip_prefix(')')).unwrap_or(rest));
        }
        out
    }

    /// Replaces macros, recursively, at most [`MAX_REPLACEMENTS`] times and up to [`MAX_EXPANDED`] bytes.
    fn expand(&self, text: &str) -> String {
        let is_word = |c: char| c.is_ascii_alphanumeric() || c == '_';
        let mut out = String::new();
        // Stack of the texts being read, the innermost last, each with the index of its next byte.
        let mut open: Vec<(&str, usize)> = vec![(text, 0)];
        let mut replaced = 0;
        while let Some((piece, at)) = open.pop() {
            let rest = &piece[at..];
            let begin = rest.find(|c: char| c.is_ascii_alphabetic() || c == '_').unwrap_or(rest.len());
            let (before, word) = rest.split_at(begin);
            let end = word.find(|c| !is_word(c)).unwrap_or(word.len());
            let word = &word[..end];
            out.push_str(before);
            // A name directly after a letter, a digit or an underscore is part of a longer word.
            let inside = before.is_empty() && out.ends_with(is_word) || before.ends_with(|c: char| c.is_ascii_digit());
            if begin + end < rest.len() {
                open.push((piece, at + begin + end));
            }
            let body = self
                .macros
                .get(word)
                .filter(|body| !inside && replaced < MAX_REPLACEMENTS && out.len() + body.len() <= MAX_EXPANDED);
            match body {
                Some(body) => {
                    replaced += 1;
                    open.push((body.as_str(), 0));
                }
                None => out.push_str(word),
            }
        }
        out
    }

    fn warn(&mut self, code: &'static str, span: Span, message: String) {
        self.report.push(Diagnostic::warning(code, message, span, "here").help("the line is ignored"));
    }

    /// Reads one line, `keyword: values`. `first`: its offset in the source.
    fn line(&mut self, text: &str, source: SourceId, first: usize) {
        let end = first + text.trim_end().len();
        let whole = Span::new(source, first, end);
        let Some((key, values)) = text.split_once(':') else {
            return self.ignored(whole, text.trim());
        };
        let keyword: String = key.to_lowercase().split_whitespace().collect::<Vec<_>>().join(" ");
        let values = self.expand(values);
        let line = Line { words: words(&values), span: whole };
        let before = self.report.len();
        if self.turtle_line(&keyword, &line) || self.file_line(&keyword, &line) {
            // If the values could not be read, the whole line is reported already.
            if self.report.len() == before {
                self.check_length(&keyword, &line);
            }
            return;
        }
        self.ignored(whole, key.trim());
    }

    fn ignored(&mut self, span: Span, key: &str) {
        let message = format!("'{}' of a view has no effect", shown(key));
        let d = Diagnostic::warning("L047", message, span, "ignored");
        self.report.push(d.help("lights, cameras and windows are set in the scene"));
    }

    /// Reports L048 for extra words after the values of a line.
    fn check_length(&mut self, keyword: &str, line: &Line<'_>) {
        let second = line.words.get(1);
        let count = match keyword {
            // Filters and environments, such as `H:`, are left to the renderer.
            "texture" => {
                let file = texture_file(&line.words);
                let others = line.words.iter().enumerate().filter(|(i, _)| !file.contains(i));
                let surplus: Vec<&str> = others.map(|(_, word)| word.text).collect();
                return self.unused(line, &surplus);
            }
            // The parts of a tropism are checked where they are read.
            "tropism" | "torque" => return,
            "tropism direction" => 3,
            "contour" => 2,
            // Letter, file, scale, two numbers of quads, texture.
            "surface" | "tsurface" => 2 + line.words.iter().skip(2).map_while(value_of).take(4).count(),
            "function" => 1 + usize::from(second.and_then(count32).is_some()),
            // A unit may follow the number.
            "initial line width" | "line width increment" => {
                1 + usize::from(second.is_some_and(|w| w.text.starts_with(|c: char| c.is_ascii_alphabetic())))
            }
            _ => 1,
        };
        let surplus: Vec<&str> = line.words.iter().skip(count).map(|w| w.text).collect();
        self.unused(line, &surplus);
    }

    /// Reports L048 for words of a line that have no effect, except punctuation alone, such as `;`.
    fn unused(&mut self, line: &Line<'_>, words: &[&str]) {
        if words.iter().any(|w| w.contains(|c: char| c.is_alphanumeric())) {
            let message = format!("'{}' in this line of a view has no effect", shown(&words.join(" ")));
            let d = Diagnostic::warning("L048", message, line.span, "here");
            self.report.push(d.help("leave it out: the other values are all that such a line takes"));
        }
    }

    /// Reports L048 for a line that lacks the numbers it needs.
    fn damaged(&mut self, line: &Line<'_>, expected: &str) {
        self.warn("L048", line.span, format!("expected {expected}"));
    }

    /// The first word of a line as a number; L048 if it is not one.
    fn number(&mut self, line: &Line<'_>, what: &str) -> Option<f64> {
        let value = line.words.first().and_then(value_of);
        if value.is_none() {
            self.damaged(line, what);
        }
        value
    }

    /// The first three numbers of a line; L048 if it has fewer.
    fn vector(&mut self, line: &Line<'_>, what: &str) -> Option<[f64; 3]> {
        let numbers: Vec<f64> = line.words.iter().filter_map(value_of).collect();
        match numbers[..] {
            [x, y, z, ..] => Some([x, y, z]),
            _ => {
                self.damaged(line, what);
                None
            }
        }
    }

    /// True for `on`, false for `off`; L048 for other words.
    fn switch(&mut self, line: &Line<'_>) -> Option<bool> {
        match line.words.first().map(|w| w.text) {
            Some("on") => Some(true),
            Some("off") => Some(false),
            _ => {
                self.damaged(line, "'on' or 'off'");
                None
            }
        }
    }

    /// Reads a line with a numeric setting; false if the keyword is not one of these.
    fn turtle_line(&mut self, keyword: &str, line: &Line<'_>) -> bool {
        // A value that cannot be read is reported, and the value of an earlier line is kept.
        match keyword {
            "angle increment" => self.view.angle = self.number(line, "an angle in degrees").or(self.view.angle),
            "angle factor" => match self.number(line, "the number of turns of a full circle") {
                // The file gives the number of turns of the angle in a full circle.
                Some(n) if n.abs() > 0.0 => self.view.angle = Some(360.0 / n),
                Some(_) => self.damaged(line, "a number of turns other than 0"),
                None => {}
            },
            "initial line width" => {
                if let Some(width) = self.number(line, "a width") {
                    self.view.width = Some(width);
                    // The unit sets the style, as `line style:` does: `p` for pixels, `s` for cylinders, none for polygons,
                    // whose width is in turtle units. `2p` is one word.
                    let touching =
                        line.words.first().map(|w| w.text.trim_start_matches(|c: char| !c.is_ascii_alphabetic()));
                    let units = touching.into_iter().chain(line.words.get(1).map(|unit| unit.text));
                    let mut letters = units.filter_map(|u| u.chars().next()).map(|c| c.to_ascii_lowercase());
                    self.view.line = Some(match letters.find(|c| matches!(c, 'p' | 's')) {
                        Some('p') => LineStyle::Pixel,
                        Some(_) => LineStyle::Cylinder,
                        None => LineStyle::Polygon,
                    });
                }
            }
            "line width increment" => {
                self.view.width_increment = self.number(line, "a width").or(self.view.width_increment);
            }
            "line style" => match line.words.first().map(|w| w.text.to_lowercase()).as_deref() {
                // cpfg also accepts the numbers of the styles.
                Some("pixel" | "1") => self.view.line = Some(LineStyle::Pixel),
                Some("polygon" | "2") => self.view.line = Some(LineStyle::Polygon),
                Some("cylinder" | "3") => self.view.line = Some(LineStyle::Cylinder),
                _ => self.damaged(line, "'pixel', 'polygon' or 'cylinder'"),
            },
            "tapered lines" => self.view.tapered = self.switch(line).or(self.view.tapered),
            "initial color" => {
                self.view.color = self.number(line, "a colour index").map(byte).or(self.view.color);
            }
            "color increment" => {
                self.view.color_increment = self.number(line, "a number").map(byte).or(self.view.color_increment);
            }
            "initial scale" => self.view.scale = self.positive(line).or(self.view.scale),
            "scale multiplier" => self.view.scale_multiplier = self.positive(line).or(self.view.scale_multiplier),
            "contour sides" => match self.number(line, "a number of sides") {
                Some(n) if n >= 3.0 => self.view.sides = Some(sides(n)),
                Some(_) => self.damaged(line, "at least 3 sides"),
                None => {}
            },
            // An older keyword: level n has 2^(n+1) sides.
            "polygonization level" => match self.number(line, "a level from 0 to 7") {
                Some(n) if (0.0..8.0).contains(&n) => self.view.sides = Some((2_u32 << sides(n)).max(3)),
                Some(_) => self.damaged(line, "a level from 0 to 7"),
                None => {}
            },
            "interpretation past %" => self.view.past_cut = self.switch(line).or(self.view.past_cut),
            "twist of cylinders" => self.view.twist = self.switch(line).or(self.view.twist),
            "tropism" | "torque" => {
                if let Some(tropism) = self.tropism(line, keyword == "torque") {
                    self.view.tropisms.push(tropism);
                }
            }
            "tropism direction" => {
                self.view.old_direction = self.vector(line, "three coordinates").or(self.view.old_direction);
            }
            "initial elasticity" => {
                self.view.old_elasticity = self.number(line, "an elasticity").or(self.view.old_elasticity);
            }
            "elasticity increment" => {
                self.view.old_increment = self.number(line, "an elasticity").or(self.view.old_increment);
            }
            _ => return false,
        }
        true
    }

    /// A number above 0; other values are reported and give `None`.
    fn positive(&mut self, line: &Line<'_>) -> Option<f64> {
        let value = self.number(line, "a number")?;
        if value > 0.0 {
            return Some(value);
        }
        self.damaged(line, "a number above 0");
        None
    }

    /// Reads a tropism or torque: `T: x y z A: deg I: f E: f S: f`.
    fn tropism(&mut self, line: &Line<'_>, torque: bool) -> Option<ViewTropism> {
        let mut out =
            ViewTropism { dir: [0.0, 1.0, 0.0], angle: 0.0, intensity: 1.0, elasticity: 0.0, step: 0.0, torque };
        let mut part = 'T';
        let mut place = 0;
        let mut unused = Vec::new();
        for word in &line.words {
            // A part is one word, as in `A:30`, or two, as in `A:` and `30`.
            let (name, value) = match word.text.split_once(':') {
                Some((name, value)) => (name.chars().next(), value),
                None => (None, word.text),
            };
            // A letter begins a part; its numbers follow.
            if let Some(name) = name {
                (part, place) = (name.to_ascii_uppercase(), 0);
            }
            if value.is_empty() {
                if !"TAIES".contains(part) {
                    unused.push(word.text);
                }
                continue;
            }
            let Some(number) = value.parse::<f64>().ok().filter(|v| v.is_finite()) else {
                self.damaged(line, "numbers after T:, A:, I:, E: and S:");
                return None;
            };
            match (part, place) {
                ('T', 0..3) => out.dir[place] = number,
                ('A', 0) => out.angle = number,
                ('I', 0) => out.intensity = number.clamp(-1.0, 1.0),
                ('E', 0) => out.elasticity = number,
                ('S', 0) => out.step = number,
                _ => unused.push(word.text),
            }
            place += 1;
        }
        if out.dir.iter().all(|c| c.abs() < 1e-12) {
            self.damaged(line, "a direction T: other than 0 0 0");
            return None;
        }
        self.unused(line, &unused);
        Some(out)
    }

    /// Reads a line that names a file; false if the keyword is not one of these.
    fn file_line(&mut self, keyword: &str, line: &Line<'_>) -> bool {
        let named = [self.view.surfaces.len(), self.view.triangles.len(), self.view.textures.len()];
        let more = [self.view.contours.len(), self.view.contour_sets.len(), self.view.functions.len()];
        if named.into_iter().chain(more).sum::<usize>() >= MAX_FILES {
            let message = format!("a view names more than {MAX_FILES} files");
            // Lines that name no file are left to the other readers.
            let known = ["surface", "tsurface", "texture", "contour", "contour set", "function", "function set"];
            if known.contains(&keyword) {
                self.warn("L048", line.span, message);
                return true;
            }
        }
        match keyword {
            "surface" => {
                let surface = self.surface(line);
                self.view.surfaces.extend(surface);
            }
            "tsurface" => {
                let surface = self.surface(line);
                self.view.triangles.extend(surface);
            }
            "texture" => {
                let words = line.words.get(texture_file(&line.words)).unwrap_or_default();
                match words.last().map(|w| w.text.strip_prefix("F:").unwrap_or(w.text)).filter(|f| !f.is_empty()) {
                    Some(file) => self.view.textures.push(file_of(file, line, None)),
                    None => self.damaged(line, "the file of a texture"),
                }
            }
            "contour" => match &line.words[..] {
                // Number and file may come in either order.
                [id, file, ..] if id.count().is_some() => {
                    self.view.contours.push(file_of(file.text, line, count32(id)));
                }
                [file, id, ..] if id.count().is_some() => {
                    self.view.contours.push(file_of(file.text, line, count32(id)));
                }
                _ => self.damaged(line, "the number of a contour and its file"),
            },
            "function" => match line.words.first() {
                Some(file) => {
                    let samples = line.words.get(1).and_then(count32);
                    self.view.functions.push(file_of(file.text, line, samples));
                }
                None => self.damaged(line, "the file of a function"),
            },
            "function set" | "contour set" => match line.words.first() {
                Some(file) if keyword == "function set" => {
                    self.view.functions.push(file_of(file.text, line, None));
                }
                Some(file) => self.view.contour_sets.push(file_of(file.text, line, None)),
                None => self.damaged(line, "the file of a set"),
            },
            _ => return false,
        }
        true
    }

    /// Reads a surface: `letter file scale [[i j] texture]`.
    fn surface(&mut self, line: &Line<'_>) -> Option<SurfaceLine> {
        let letter = line.words.first().map(|w| w.text).filter(|t| t.chars().count() == 1);
        let (Some(letter), Some(file)) = (letter.and_then(|t| t.chars().next()), line.words.get(1)) else {
            self.damaged(line, "one letter and the file of a surface");
            return None;
        };
        let numbers: Vec<f64> = line.words.iter().skip(2).map_while(value_of).collect();
        let scale = numbers.first().copied().unwrap_or(1.0);
        if scale <= 0.0 {
            self.damaged(line, "a scale above 0");
            return None;
        }
        // If only one number follows the scale, it is the texture.
        let (quads, texture) = match numbers.get(1..).unwrap_or_default() {
            [texture] => (None, Some(texture)),
            [i, j, more @ ..] => (Some([sides(*i), sides(*j)]), more.first()),
            [] => (None, None),
        };
        let texture = texture.map(|t| sides(*t)).filter(|t| *t > 0);
        Some(SurfaceLine { letter, file: file_of(file.text, line, None), scale, quads, texture })
    }
}

fn file_of(file: &str, line: &Line<'_>, number: Option<u32>) -> FileLine {
    FileLine { file: file.to_owned(), span: line.span, number }
}

fn count32(word: &Word<'_>) -> Option<u32> {
    word.text.parse().ok()
}

/// A number, or a quotient or product of two, such as `360/7`.
fn value_of(word: &Word<'_>) -> Option<f64> {
    if let Some(value) = word.number() {
        return Some(value);
    }
    let text = word.text.trim_matches(['(', ')']);
    let part = |t: &str| t.trim().parse::<f64>().ok();
    let value = match (text.split_once('/'), text.split_once('*')) {
        (Some((a, b)), _) => part(a)? / part(b)?,
        (_, Some((a, b))) => part(a)? * part(b)?,
        // Ignores text after a number, such as `;` or a unit.
        _ => {
            let end = text.find(|c: char| !c.is_ascii_digit() && !".+-eE".contains(c)).unwrap_or(text.len());
            part(text[..end].trim_end_matches(['.', '+', '-', 'e', 'E']))?
        }
    };
    Some(value).filter(|v| v.is_finite())
}

/// Indices of the words that name the texture file: `F: name` or `F:name` among other parts, or just the name.
fn texture_file(words: &[Word<'_>]) -> std::ops::Range<usize> {
    match words.iter().enumerate().find(|(_, w)| w.text.starts_with("F:")) {
        Some((i, w)) if w.text == "F:" => i..words.len().min(i + 2),
        Some((i, _)) => i..i + 1,
        None => 0..words.len().min(1),
    }
}

/// A colour index, modulo 256.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "reduced to 0..256 before the cast")]
fn byte(value: f64) -> u8 {
    value.trunc().rem_euclid(256.0) as u8
}

/// A whole number, clamped to 0 to 256.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped before the cast")]
fn sides(value: f64) -> u32 {
    value.trunc().clamp(0.0, 256.0) as u32
}

/// The text with comments replaced by blanks; line breaks are kept.
fn without_comments(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(at) = rest.find('/') {
        let (before, from) = rest.split_at(at);
        out.push_str(before);
        let length = if let Some(inside) = from.strip_prefix("/*") {
            inside.find("*/").map_or(from.len(), |end| end + 4)
        } else if from.starts_with("//") {
            from.find('\n').unwrap_or(from.len())
        } else {
            out.push('/');
            rest = &from[1..];
            continue;
        };
        let (comment, after) = from.split_at(length);
        // Byte positions stay the same, so that messages refer to the right place in the file.
        out.extend(comment.bytes().map(|b| if b == b'\n' { '\n' } else { ' ' }));
        rest = after;
    }
    out.push_str(rest);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> (View, Vec<Diagnostic>) {
        let mut sources = Sources::default();
        let mut include = |name: &str| match name {
            "more.v" => Ok(("more.v".to_owned(), b"initial color: 3\n".to_vec())),
            "self.v" => Ok(("self.v".to_owned(), b"#include \"self.v\"\n".to_vec())),
            _ => Err("not found".to_owned()),
        };
        read_view("t.v", text.as_bytes(), &mut sources, &mut include)
    }

    #[test]
    fn every_line_of_the_table_is_read() {
        let (view, report) = read(
            "/* a view */\n#define DEG 22.5\n#define TWICE DEG\nangle increment: TWICE\ninitial line width: 3 p // pixels\n\
             line width increment: 0.5\nline style: cylinder\ntapered lines: off\ninitial color: 257\ncolor increment: -1\n\
             initial scale: 2\nscale multiplier: 0.5\ncontour sides: 12\ntwist of cylinders: on\n\
             tropism: T: 0.0,-1.0,0.0 A: 90 I: 0.5 E: 0.2 S: 0.01\ntorque: T: 1 0 0 E:0.3\n\
             tropism direction: 1 0 -1\ninitial elasticity: 0.22\nelasticity increment: 0.1\n\
             surface: l leaf.s 0.5 4 6 1\ntsurface: p petal.ray 2\ntexture: F: bark.png\ncontour: 2 stem.con\n\
             function: grow.func 50\nfunction set: all.fset\n",
        );
        assert_eq!(report, []);
        assert_eq!(view.angle, Some(22.5));
        assert_eq!((view.width, view.width_increment), (Some(3.0), Some(0.5)));
        assert_eq!((view.line, view.tapered), (Some(LineStyle::Cylinder), Some(false)));
        assert_eq!((view.color, view.color_increment), (Some(1), Some(255)));
        assert_eq!((view.scale, view.scale_multiplier, view.sides), (Some(2.0), Some(0.5), Some(12)));
        assert_eq!(view.twist, Some(true));
        let down = ViewTropism {
            dir: [0.0, -1.0, 0.0],
            angle: 90.0,
            intensity: 0.5,
            elasticity: 0.2,
            step: 0.01,
            torque: false,
        };
        let roll =
            ViewTropism { dir: [1.0, 0.0, 0.0], angle: 0.0, intensity: 1.0, elasticity: 0.3, step: 0.0, torque: true };
        assert_eq!(view.tropisms, [down, roll]);
        assert_eq!(view.old_direction, Some([1.0, 0.0, -1.0]));
        assert_eq!((view.old_elasticity, view.old_increment), (Some(0.22), Some(0.1)));
        let surface = &view.surfaces[0];
        assert_eq!((surface.letter, surface.file.file.as_str(), surface.scale), ('l', "leaf.s", 0.5));
        assert_eq!((surface.quads, surface.texture), (Some([4, 6]), Some(1)));
        assert_eq!((view.triangles[0].letter, view.triangles[0].scale), ('p', 2.0));
        assert_eq!(view.textures[0].file, "bark.png");
        assert_eq!((view.contours[0].number, view.contours[0].file.as_str()), (Some(2), "stem.con"));
        let functions: Vec<_> = view.functions.iter().map(|f| (f.file.as_str(), f.number)).collect();
        assert_eq!(functions, [("grow.func", Some(50)), ("all.fset", None)]);
    }

    #[test]
    fn other_lines_are_told_and_damaged_ones_too() {
        let (view, report) = read("light: V: 1 1 1\nviewpoint: 0,0,1\nangle factor: 8\nrender mode\n");
        assert_eq!(view.angle, Some(45.0));
        assert_eq!(report.iter().map(|d| d.code).collect::<Vec<_>>(), ["L047"; 3]);
        for (line, wanted) in [
            ("angle increment: x", "an angle in degrees"),
            ("angle factor: 0", "other than 0"),
            ("line style: wide", "'pixel'"),
            ("tapered lines: maybe", "'on' or 'off'"),
            ("contour sides: 2", "at least 3"),
            ("initial scale: 0", "above 0"),
            ("tropism: T: 0 0 0 E: 1", "a direction"),
            ("tropism: T: a b c", "numbers after T:"),
            ("surface: leaf leaf.s 1", "one letter"),
            ("surface: l leaf.s -1", "a scale above 0"),
            ("contour: stem.con", "the number of a contour"),
            ("function:", "the file of a function"),
            ("texture:", "the file of a texture"),
            ("tropism direction: 1 2", "three coordinates"),
            ("#include \"none.v\"", "not found"),
            ("#include \"self.v\"", "32 files deep"),
        ] {
            let (_, report) = read(line);
            assert!(report.len() == 1 && report[0].code == "L048", "{line}: {report:?}");
            assert!(report[0].message.contains(wanted), "{line}: {}", report[0].message);
        }
    }

    #[test]
    fn values_that_a_line_does_not_take_are_told() {
        for (line, unused) in [
            ("angle increment: 20 30", "'30'"),
            ("angle factor: 8 turns", "'turns'"),
            ("initial line width: 2 pixels 3", "'3'"),
            ("line width increment: 0.5 0.7", "'0.7'"),
            ("line style: cylinder 8", "'8'"),
            ("initial color: 257 4", "'4'"),
            ("tropism direction: 0 1 0 1", "'1'"),
            ("tropism: T: 0 1 0 2 A: 30 40 X: 5", "'2 40 X: 5'"),
            ("surface: l leaf.s 1 2 3 4 5 6", "'5 6'"),
            ("tsurface: l leaf.ray wide", "'wide'"),
            ("contour: 1 stem.con 2", "'2'"),
            ("function: grow.func many", "'many'"),
            ("function set: all.fset 5", "'5'"),
            ("texture: F: bark.png H: l E: d", "'H: l E: d'"),
            ("texture: H: l F:bark.png", "'H: l'"),
            ("texture: bark.png 2", "'2'"),
        ] {
            let (view, report) = read(line);
            assert!(report.len() == 1 && report[0].code == "L048", "{line}: {report:?}");
            assert_eq!(report[0].message, format!("{unused} in this line of a view has no effect"), "{line}");
            // The values before them count.
            assert_ne!(view, View::default(), "{line}");
        }
        let (_, report) = read("angle increment: 20 ;\ninitial line width: 2 p\nline width increment: 1 p\n");
        assert_eq!(report, []);
    }

    #[test]
    fn conditions_includes_and_quotients() {
        let (view, _) = read(
            "#define BIG\n#ifdef BIG\nangle increment: 360/7\n#else\nangle increment: 1\n#endif\n#ifndef BIG\ninitial scale: 9\n#endif\n#include \"more.v\"\n",
        );
        assert!(view.angle.is_some_and(|a| (a - 360.0 / 7.0).abs() < 1e-12));
        assert_eq!((view.scale, view.color), (None, Some(3)));
        let (view, _) = read("#define A B\n#define B A\nangle increment: A\n");
        assert_eq!(view.angle, None);
        let two = "#define X 2\n#if X == 1\nangle increment: 10\n#elif X == 2 && defined(X)\nangle increment: 20\n\
                   #elif(1)\nangle increment: 30\n\
                   #else\nangle increment: 40\n#endif\n#if OSIER && !defined Y\ninitial scale: 3\n#endif\n";
        let (view, report) = read(two);
        assert_eq!((view.angle, view.scale, report.len()), (Some(20.0), Some(3.0), 0), "{report:?}");
        let (view, _) = read(&two.replace("X 2", "X 1"));
        assert_eq!(view.angle, Some(10.0));
        let (view, _) = read(&two.replace("X 2", "X 3"));
        assert_eq!(view.angle, Some(30.0));
        // Conditions within a branch that is not taken are not evaluated.
        let (view, report) =
            read("#if 0\n#if 1 2\n#elif 1\nangle increment: 1\n#endif\n#else\nangle increment: 2\n#endif\n");
        assert_eq!((view.angle, report.len()), (Some(2.0), 0));
        let (_, report) = read("#if 1 2\n#endif\n");
        assert!(report.len() == 1 && report[0].code == "L048", "{report:?}");
    }

    #[test]
    fn what_follows_a_number_does_not_count() {
        let (view, report) = read("angle increment: 22.5;\ninitial line width: 2pixels\nline width increment: .5e\n");
        assert_eq!(report, []);
        assert_eq!((view.angle, view.width, view.line), (Some(22.5), Some(2.0), Some(LineStyle::Pixel)));
        assert_eq!(view.width_increment, Some(0.5));
    }

    #[test]
    fn the_unit_of_a_width_sets_the_style_of_lines() {
        use super::LineStyle::{Cylinder, Pixel, Polygon};
        for (text, line) in [
            ("initial line width: 0.2\n", Polygon),
            ("initial line width: 0.2 /* units */\r\n", Polygon),
            ("initial line width: 1e-1\n", Polygon),
            ("initial line width: 2 p\n", Pixel),
            ("initial line width: 2.0 pixels\n", Pixel),
            ("initial line width: 0.1 s\n", Cylinder),
            // The last line that sets it counts.
            ("initial line width: 3\nline style: pixel\n", Pixel),
            ("line style: pixel\ninitial line width: 3\n", Polygon),
            ("initial line width: 2 pixels\nline style: cylinder\n", Cylinder),
            ("line style: 1\n", Pixel),
            ("line style: 2\n", Polygon),
            ("line style: 3\n", Cylinder),
        ] {
            let (view, report) = read(text);
            assert_eq!((view.line, report.len()), (Some(line), 0), "{text}: {report:?}");
        }
        assert_eq!(read("angle factor: 8\n").0.line, None);
    }

    #[test]
    fn older_lines_of_views_are_read() {
        for (level, sides) in [(0, Some(3)), (1, Some(4)), (3, Some(16)), (7, Some(256)), (8, None), (-1, None)] {
            let (view, report) = read(&format!("polygonization level: {level}\n"));
            assert_eq!((view.sides, report.len()), (sides, usize::from(sides.is_none())), "{level}: {report:?}");
        }
        // One number after the scale of a surface is its texture.
        let (view, _) = read("surface: l leaf.s 0.5 2\nsurface: m leaf.s 0.5 3 4\nsurface: n leaf.s 0.5 3 4 1\n");
        let found: Vec<_> = view.surfaces.iter().map(|s| (s.quads, s.texture)).collect();
        assert_eq!(found, [(None, Some(2)), (Some([3, 4]), None), (Some([3, 4]), Some(1))]);
    }

    #[test]
    fn no_bytes_make_it_panic() {
        let mut state = 7_u64;
        let alphabet: Vec<char> = "surface: l T:,#define if/*\n\u{e9}0-.9e(\"".chars().collect();
        for _ in 0..2000 {
            let mut text = String::new();
            for _ in 0..40 {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                text.push(alphabet[(state >> 33) as usize % alphabet.len()]);
            }
            let _ = read(&text);
            let source = Sources::default().add("t", text.as_str());
            let _ = super::super::read_functions(&text, source);
            let _ = super::super::read_contours(&text, source);
            let _ = super::super::read_surface(&text, source);
            let _ = super::super::read_ray(&text, source);
        }
    }
}
