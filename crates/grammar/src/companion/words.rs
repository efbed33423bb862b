//! Words of a text with their places.

use osier_base::diagnostic::{Diagnostic, SourceId, Span};

/// Limit on the multiplicity of a control point: at four a cubic spline passes through it, and more change nothing.
const MAX_MULTIPLICITY: usize = 8;

/// A word delimited by blanks, and its place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Word<'a> {
    pub text: &'a str,
    /// Byte range in the text: first byte, and the byte after the last.
    pub at: (usize, usize),
    /// Line number, from 0.
    pub line: usize,
}

impl Word<'_> {
    /// The word as a finite number; `None` if it is not one.
    pub fn number(&self) -> Option<f64> {
        self.text.parse::<f64>().ok().filter(|v| v.is_finite())
    }

    /// The word as a whole number of 0 or more; `None` if it is not one.
    pub fn count(&self) -> Option<usize> {
        self.text.parse().ok()
    }

    pub fn span(&self, source: SourceId) -> Span {
        Span::new(source, self.at.0, self.at.1)
    }
}

/// All words of a text. Commas count as blanks.
pub(super) fn words(text: &str) -> Vec<Word<'_>> {
    let mut out = Vec::new();
    let (mut start, mut line) = (None, 0);
    // An added line break ends the last word of the text.
    for (i, c) in text.char_indices().chain([(text.len(), '\n')]) {
        if c.is_whitespace() || c == ',' {
            if let Some(first) = start.take() {
                out.push(Word { text: &text[first..i], at: (first, i), line });
            }
            line += usize::from(c == '\n');
        } else if start.is_none() {
            start = Some(i);
        }
    }
    out
}

/// Reads words one after the other and collects the errors about them.
pub(super) struct Reader<'a> {
    words: Vec<Word<'a>>,
    next: usize,
    source: SourceId,
    /// Length of the text in bytes: the place of errors about its end.
    end: usize,
    pub report: Vec<Diagnostic>,
}

impl<'a> Reader<'a> {
    pub fn new(text: &'a str, source: SourceId) -> Self {
        Self { words: words(text), next: 0, source, end: text.len(), report: Vec::new() }
    }

    pub fn peek(&self) -> Option<Word<'a>> {
        self.words.get(self.next).copied()
    }

    /// Looks ahead without consuming a word: 0 is the next word, 1 the one after it.
    pub fn peek_at(&self, n: usize) -> Option<Word<'a>> {
        self.words.get(self.next + n).copied()
    }

    pub fn take(&mut self) -> Option<Word<'a>> {
        let word = self.peek();
        self.next += usize::from(word.is_some());
        word
    }

    /// Consumes and returns the remaining words of the line that the next word is on.
    pub fn take_line(&mut self) -> Vec<Word<'a>> {
        let Some(first) = self.peek() else { return Vec::new() };
        let rest = &self.words[self.next..];
        let line: Vec<_> = rest.iter().take_while(|w| w.line == first.line).copied().collect();
        self.next += line.len();
        line
    }

    /// The multiplicity of a point, optional at the end of its line: the next word if it is on `line` and a whole number,
    /// else 1.
    pub fn multiplicity(&mut self, line: Option<usize>) -> usize {
        let same_line = self.peek().filter(|w| Some(w.line) == line);
        let times = same_line.and_then(|w| w.count());
        if times.is_some() {
            self.take();
        }
        times.unwrap_or(1).clamp(1, MAX_MULTIPLICITY)
    }

    /// The next word as a number; L048 if it is not one.
    pub fn number(&mut self, what: &str) -> Option<f64> {
        match self.peek().and_then(|w| w.number()) {
            Some(value) => {
                self.next += 1;
                Some(value)
            }
            None => {
                self.expected(what);
                None
            }
        }
    }

    /// The next word as a whole number; L048 if it is not one.
    pub fn count(&mut self, what: &str) -> Option<usize> {
        match self.peek().and_then(|w| w.count()) {
            Some(value) => {
                self.next += 1;
                Some(value)
            }
            None => {
                self.expected(what);
                None
            }
        }
    }

    /// Reports L048: `what` was expected in place of the next word.
    pub fn expected(&mut self, what: &str) {
        let (found, span) = match self.peek() {
            Some(w) => (format!("'{}'", shown(w.text)), w.span(self.source)),
            None => ("the end of the file".to_owned(), Span::new(self.source, self.end, self.end)),
        };
        let message = format!("expected {what}, found {found}");
        let d = Diagnostic::warning("L048", message, span, "here");
        self.report.push(d.help("the file is damaged, or of another kind; nothing from here on is read"));
    }

    /// Reports L048 at the next word.
    pub fn complain(&mut self, message: String, help: &str) {
        let span = self.peek().map_or(Span::new(self.source, self.end, self.end), |w| w.span(self.source));
        self.report.push(Diagnostic::warning("L048", message, span, "here").help(help));
    }
}

/// A word for messages: at most 24 characters, then `..` if it is longer.
pub(super) fn shown(word: &str) -> String {
    let mut out: String = word.chars().take(24).collect();
    if out.len() < word.len() {
        out.push_str("..");
    }
    out
}
