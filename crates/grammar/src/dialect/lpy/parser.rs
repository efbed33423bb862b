//! Parses expressions of Python.

use std::ops::Range;

use osier_base::convert::saturating_index;

use super::expression::{
    ATTRIBUTE, DICTIONARY, FLAT, IN, JOINED_TEXT, METHOD, NOTHING, OF_NUMBERS, PyExpr, PyOp, SLICE, is_joined_text,
    is_none, range_of, substitute, text_number, text_refusal,
};
use super::lines::{JOINED, masked};
use super::pieces::{assignment, colon, split};
use super::refusal::Refusal;
use super::vectors::AXES;
use crate::dialect::text::Piece;

/// Limit on the nesting of an expression.
const MAX_DEPTH: usize = 200;

/// Limit on the height of a syntax tree, which chains of operators also increase: functions on trees are recursive.
const MAX_HEIGHT: usize = 500;

/// Limit on the nesting of the names of a `for`.
const MAX_TARGETS: usize = 16;

/// Methods that read a list or a dictionary. The call of one is represented by the call of a function whose name has a point
/// before it.
const METHODS: [&str; 7] = ["index", "get", "keys", "values", "items", "copy", "format"];

/// Operators and punctuation, longer ones first.
const SIGNS: [&str; 26] = [
    "**", "//", "<=", ">=", "==", "!=", "<>", "->", "+", "-", "*", "/", "%", "<", ">", "(", ")", ",", "=", ".", "[",
    "]", ";", ":", "{", "}",
];

#[derive(Debug, Clone, PartialEq)]
struct PyToken {
    kind: PyTokenKind,
    range: Range<usize>,
}

#[derive(Debug, Clone, PartialEq)]
enum PyTokenKind {
    Number(f64),
    /// A string constant, by the number that represents it.
    Text(f64),
    /// A string that contains expressions, `f"{x}"`.
    JoinedText,
    Name(String),
    Sign(&'static str),
}

/// Splits a text into tokens.
fn tokens(piece: Piece<'_>) -> Result<Vec<PyToken>, Refusal> {
    let mut out = Vec::new();
    let text = piece.text;
    let mut i = 0;
    // True if the prefix of the next string makes it one composed at run time.
    let mut is_joined = false;
    while let Some(c) = text[i..].chars().next() {
        let at = piece.at + i;
        let rest = &text[i..];
        if c.is_whitespace() {
            i += c.len_utf8();
            continue;
        }
        // A number may begin with its decimal point: `.5`.
        if c.is_ascii_digit() || (c == '.' && rest[1..].starts_with(|d: char| d.is_ascii_digit())) {
            let (n, value) = match number_of_base(rest) {
                Some(whole) => whole,
                None => {
                    let n = number_length(rest);
                    let value = rest[..n].replace('_', "").parse::<f64>();
                    (n, value.map_err(|_| Refusal::new(format!("the number '{}'", &rest[..n]), at..at + n))?)
                }
            };
            out.push(PyToken { kind: PyTokenKind::Number(value), range: at..at + n });
            i += n;
        } else if c.is_alphabetic() || c == '_' {
            let n = rest.find(|d: char| !d.is_alphanumeric() && d != '_').unwrap_or(rest.len());
            // Prefix of a string: an `f`, as in `f"{x}"`, makes it one composed at run time; other prefixes have no effect here.
            let is_prefix =
                n <= 2 && rest[..n].chars().all(|c| "fFrRbBuU".contains(c)) && rest[n..].starts_with(['"', '\'']);
            if is_prefix {
                let inner = rest.get(n + 1..).unwrap_or("");
                let text = inner.split(rest[n..].chars().next().unwrap_or('"')).next().unwrap_or("");
                let has_value = text.contains(char::from(masked(b'{')));
                is_joined = rest[..n].contains(['f', 'F']) && has_value;
                i += n;
                continue;
            }
            out.push(PyToken { kind: PyTokenKind::Name(rest[..n].to_owned()), range: at..at + n });
            i += n;
        } else if c == '"' || c == '\'' {
            let inner = &rest[1..];
            let Some(n) = inner.find(c) else {
                return Err(Refusal::new("a text in quotes that does not end", at..at + rest.len()));
            };
            // Strings are only compared and passed on, so that a unique number represents each. The backslash before an
            // escaped quote is not part of the string; both characters are masked here.
            let [backslash, double, single] = [b'\\', b'"', b'\''].map(|b| char::from(masked(b)).to_string());
            let text = inner[..n].replace(&(backslash.clone() + &double), &double);
            let text = text.replace(&(backslash + &single), &single).replace(char::from(JOINED), "");
            let kind = if is_joined { PyTokenKind::JoinedText } else { PyTokenKind::Text(text_number(&text)) };
            is_joined = false;
            out.push(PyToken { kind, range: at..at + n + 2 });
            i += n + 2;
        } else if let Some(sign) = SIGNS.iter().find(|s| rest.starts_with(**s)) {
            out.push(PyToken { kind: PyTokenKind::Sign(sign), range: at..at + sign.len() });
            i += sign.len();
        } else {
            return Err(Refusal::new(format!("the character '{c}'"), at..at + c.len_utf8()));
        }
    }
    Ok(out)
}

/// Length and value of an integer of another base at the beginning of a text: `0xff`, `0o17`, `0b101`.
fn number_of_base(text: &str) -> Option<(usize, f64)> {
    let base = match text.get(..2)? {
        "0x" | "0X" => 16,
        "0o" | "0O" => 8,
        "0b" | "0B" => 2,
        _ => return None,
    };
    let digits = text.get(2..)?;
    let n = digits.find(|d: char| !d.is_digit(base) && d != '_').unwrap_or(digits.len());
    let value = u32::from_str_radix(&digits[..n].replace('_', ""), base).ok()?;
    Some((n + 2, f64::from(value)))
}

/// Length of the number at the beginning of a text.
fn number_length(text: &str) -> usize {
    let bytes = text.as_bytes();
    // Python allows underscores between digits.
    let digits = |from: usize| {
        let more = bytes.get(from..).unwrap_or(&[]).iter().take_while(|b| b.is_ascii_digit() || **b == b'_').count();
        from + more
    };
    let mut n = digits(0);
    if bytes.get(n) == Some(&b'.') {
        n = digits(n + 1);
    }
    // An `e` belongs to the number only if digits follow.
    if matches!(bytes.get(n), Some(b'e' | b'E')) {
        let sign = usize::from(matches!(bytes.get(n + 1), Some(b'+' | b'-')));
        let end = digits(n + 1 + sign);
        if end > n + 1 + sign {
            n = end;
        }
    }
    n
}

/// The refusal of an attribute that is not a coordinate.
fn attribute_refusal(name: &str, range: Range<usize>) -> Refusal {
    let why = Refusal::new(format!("an attribute of '{name}'"), range);
    why.remedy("use a plain value or a list; of attributes .x, .y and .z of a vector are known")
}

struct PyParser {
    tokens: Vec<PyToken>,
    i: usize,
    depth: usize,
    /// Height of the last tree that was read.
    height: usize,
    end: usize,
}

/// Parses an expression that must use the whole text.
pub(super) fn parse(piece: Piece<'_>) -> Result<PyExpr, Refusal> {
    let mut p = PyParser { tokens: tokens(piece)?, i: 0, depth: 0, height: 0, end: piece.at + piece.text.len() };
    if p.tokens.is_empty() {
        return Err(Refusal::new("a missing expression", piece.range()));
    }
    let e = p.choice()?;
    match p.tokens.get(p.i) {
        None => Ok(e),
        Some(t) => Err(Refusal::new(p.describe(t), t.range.clone())),
    }
}

/// The parts of `lambda x, k=2: e`: parameters, texts of their default values, and expression.
pub(super) struct Lambda<'t> {
    pub params: Vec<String>,
    pub defaults: Vec<Option<Piece<'t>>>,
    pub value: PyExpr,
}

/// Parses a `lambda`; `None` for other texts, and if its expression cannot be read.
pub(super) fn lambda(piece: Piece<'_>) -> Option<Lambda<'_>> {
    let rest = piece.text.strip_prefix("lambda").map(|_| piece.from("lambda".len()))?;
    let c = colon(rest)?;
    let value = parse(rest.from(c + 1).trimmed()).ok()?;
    let (mut params, mut defaults) = (Vec::new(), Vec::new());
    for part in split(rest.up_to(c).trimmed()) {
        let (name, default) = assignment(part).map_or((part, None), |(name, default)| (name, Some(default)));
        params.push(name.text.to_owned());
        defaults.push(default);
    }
    Some(Lambda { params, defaults, value })
}

/// A name that a comprehension or loop sets to an item of a list, or to the part of the item at these nested indices: in `i, (a,
/// b)` the path of b is 1, 1.
struct ItemTarget {
    name: String,
    path: Vec<usize>,
}

impl ItemTarget {
    /// Names that each take a part of the item; a single one takes all of it.
    fn row(names: Vec<String>) -> Vec<Self> {
        let is_one = names.len() == 1;
        let target = |(k, name)| Self { name, path: if is_one { Vec::new() } else { vec![k] } };
        names.into_iter().enumerate().map(target).collect()
    }
}

/// Makes `[value for name in list]`; several names unpack each item.
fn each_item(
    value: PyExpr,
    targets: Vec<ItemTarget>,
    list: PyExpr,
    place: &Range<usize>,
    range: Range<usize>,
) -> PyExpr {
    let (value, name) = match targets.as_slice() {
        [ItemTarget { name, path }] if path.is_empty() => (value, name.clone()),
        _ => {
            let item = format!("(item at {})", place.start);
            let part = |target: &ItemTarget| {
                let whole = PyExpr::Name(item.clone(), place.clone());
                target.path.iter().fold(whole, |part, k| {
                    let index = PyExpr::Number(f64::from(saturating_index(*k)));
                    PyExpr::Index(Box::new(part), Box::new(index), place.clone())
                })
            };
            let parts: Vec<PyExpr> = targets.iter().map(part).collect();
            let names: Vec<String> = targets.into_iter().map(|target| target.name).collect();
            (substitute(&value, &names, &parts), item)
        }
    };
    PyExpr::Each(Box::new(value), name, Box::new(list), range)
}

impl PyParser {
    fn describe(&self, t: &PyToken) -> String {
        match &t.kind {
            PyTokenKind::Number(n) => format!("'{n}' where an operator is expected"),
            PyTokenKind::Text(_) | PyTokenKind::JoinedText => "a text where an operator is expected".into(),
            PyTokenKind::Name(n) if matches!(n.as_str(), "for" | "lambda" | "in" | "is" | "yield" | "await") => {
                format!("'{n}'")
            }
            PyTokenKind::Name(n) => format!("'{n}' where an operator is expected"),
            PyTokenKind::Sign("[") => "a list or an index '[..]'".into(),
            PyTokenKind::Sign("{" | "}") => "a dictionary '{..}'".into(),
            PyTokenKind::Sign(".") => "an attribute '.'".into(),
            PyTokenKind::Sign(",") => "a tuple".into(),
            PyTokenKind::Sign("=") => "an argument with a name".into(),
            PyTokenKind::Sign(s) => format!("'{s}' at this place"),
        }
    }

    fn sign(&self) -> Option<&'static str> {
        match self.tokens.get(self.i).map(|t| &t.kind) {
            Some(PyTokenKind::Sign(s)) => Some(s),
            _ => None,
        }
    }

    fn word(&self) -> Option<&str> {
        match self.tokens.get(self.i).map(|t| &t.kind) {
            Some(PyTokenKind::Name(n)) => Some(n),
            _ => None,
        }
    }

    /// Refuses a string where an operand must be a number: the tokens from `from` on are just a string.
    fn check_number(&self, from: usize) -> Result<(), Refusal> {
        match self.tokens.get(from) {
            Some(PyToken { kind: PyTokenKind::Text(value), range }) if self.i == from + 1 => {
                Err(text_refusal(*value, range.clone()))
            }
            _ => Ok(()),
        }
    }

    /// The function that represents a method of a list or dictionary, if its call follows: `.index` for `.index(`.
    fn method(&self) -> Option<String> {
        match self.tokens.get(self.i..)? {
            [_, PyToken { kind: PyTokenKind::Name(name), .. }, PyToken { kind: PyTokenKind::Sign("("), .. }, ..]
                if METHODS.contains(&name.as_str()) =>
            {
                Some(format!(".{name}"))
            }
            _ => None,
        }
    }

    fn eat(&mut self, sign: &str) -> bool {
        let found = self.sign() == Some(sign);
        self.i += usize::from(found);
        found
    }

    fn eat_word(&mut self, word: &str) -> bool {
        let found = self.word() == Some(word);
        self.i += usize::from(found);
        found
    }

    fn here(&self) -> Range<usize> {
        self.tokens.get(self.i).map_or(self.end..self.end, |t| t.range.clone())
    }

    /// Updates the height of a tree: `others` is the largest height of its other parts, and the last part was just read.
    fn grow(&mut self, others: usize) -> Result<(), Refusal> {
        self.height = self.height.max(others) + 1;
        if self.height > MAX_HEIGHT {
            let why = Refusal::new("an expression of too many parts", self.here());
            return Err(why.remedy("give its parts names, on lines of their own"));
        }
        Ok(())
    }

    fn choice(&mut self) -> Result<PyExpr, Refusal> {
        self.depth += 1;
        if self.depth > MAX_DEPTH {
            return Err(Refusal::new("an expression nested too deep", self.here()));
        }
        // In `a if b else c` the value precedes its condition.
        let then = self.or()?;
        let mut height = self.height;
        let out = if self.eat_word("if") {
            let condition = self.or()?;
            height = height.max(self.height);
            if !self.eat_word("else") {
                return Err(Refusal::new("'if' without 'else' in an expression", self.here()));
            }
            let other = self.choice()?;
            self.grow(height)?;
            PyExpr::Choice(Box::new(condition), Box::new(then), Box::new(other))
        } else {
            then
        };
        self.depth -= 1;
        Ok(out)
    }

    fn or(&mut self) -> Result<PyExpr, Refusal> {
        let mut left = self.and()?;
        while self.eat_word("or") {
            let height = self.height;
            left = PyExpr::Or(Box::new(left), Box::new(self.and()?));
            self.grow(height)?;
        }
        Ok(left)
    }

    fn and(&mut self) -> Result<PyExpr, Refusal> {
        let mut left = self.not()?;
        while self.eat_word("and") {
            let height = self.height;
            left = PyExpr::And(Box::new(left), Box::new(self.not()?));
            self.grow(height)?;
        }
        Ok(left)
    }

    fn not(&mut self) -> Result<PyExpr, Refusal> {
        // Count repeated prefixes instead of nesting them.
        let mut negations = 0_usize;
        while self.eat_word("not") {
            negations += 1;
        }
        let e = self.comparison()?;
        Ok(if negations == 0 {
            e
        } else if negations % 2 == 1 {
            PyExpr::Not(Box::new(e))
        } else {
            PyExpr::Not(Box::new(PyExpr::Not(Box::new(e))))
        })
    }

    /// Consumes `in`, or the two words `not in`; true for the latter, `None` if neither comes next.
    fn membership(&mut self) -> Option<bool> {
        if self.eat_word("in") {
            return Some(false);
        }
        let next = self.tokens.get(self.i + 1).map(|t| &t.kind);
        let is_negated = self.word() == Some("not") && matches!(next, Some(PyTokenKind::Name(n)) if n == "in");
        self.i += 2 * usize::from(is_negated);
        is_negated.then_some(true)
    }

    /// Parses comparisons; `a < b < c` holds if both comparisons do.
    fn comparison(&mut self) -> Result<PyExpr, Refusal> {
        let mut from = self.i;
        let mut left = self.sum()?;
        let mut all: Option<PyExpr> = None;
        loop {
            let (place, height) = (self.here(), self.height);
            if let Some(is_negated) = self.membership() {
                from = self.i;
                let right = self.sum()?;
                self.grow(height)?;
                let found = PyExpr::Call(IN.to_owned(), vec![left, right.clone()], place);
                let one = if is_negated { PyExpr::Not(Box::new(found)) } else { found };
                all = Some(match all {
                    None => one,
                    Some(before) => PyExpr::And(Box::new(before), Box::new(one)),
                });
                left = right;
                continue;
            }
            // `is` and `is not` compare with `None`.
            let by_word = self.eat_word("is").then(|| if self.eat_word("not") { PyOp::Ne } else { PyOp::Eq });
            let by_sign = match self.sign() {
                Some("==") => Some(PyOp::Eq),
                Some("!=" | "<>") => Some(PyOp::Ne),
                Some("<") => Some(PyOp::Lt),
                Some("<=") => Some(PyOp::Le),
                Some(">") => Some(PyOp::Gt),
                Some(">=") => Some(PyOp::Ge),
                _ => None,
            };
            let Some(op) = by_word.or(by_sign) else { return Ok(all.unwrap_or(left)) };
            // Strings can only be compared for equality: their order is not known.
            let is_order = !matches!(op, PyOp::Eq | PyOp::Ne);
            if is_order {
                self.check_number(from)?;
            }
            self.i += usize::from(by_word.is_none());
            from = self.i;
            let right = self.sum()?;
            self.grow(height)?;
            if is_order {
                self.check_number(from)?;
            }
            let one = PyExpr::Binary(op, Box::new(left), Box::new(right.clone()));
            all = Some(match all {
                None => one,
                Some(before) => PyExpr::And(Box::new(before), Box::new(one)),
            });
            left = right;
        }
    }

    fn sum(&mut self) -> Result<PyExpr, Refusal> {
        self.joined_from_left(Self::product, |sign| match sign {
            "+" => Some(PyOp::Add),
            "-" => Some(PyOp::Sub),
            _ => None,
        })
    }

    fn product(&mut self) -> Result<PyExpr, Refusal> {
        self.joined_from_left(Self::factor, |sign| match sign {
            "*" => Some(PyOp::Mul),
            "/" => Some(PyOp::Div),
            "//" => Some(PyOp::FloorDiv),
            "%" => Some(PyOp::Mod),
            _ => None,
        })
    }

    /// Parses operands joined by operators of equal precedence, from left to right.
    fn joined_from_left(
        &mut self,
        operand: fn(&mut Self) -> Result<PyExpr, Refusal>,
        operator: fn(&str) -> Option<PyOp>,
    ) -> Result<PyExpr, Refusal> {
        let from = self.i;
        let mut left = operand(self)?;
        while let Some(op) = self.sign().and_then(operator) {
            // `'a' + str(x)` and `'%d' % x` compose strings.
            let is_text = |e: &PyExpr| is_joined_text(e) || matches!(e, PyExpr::Text(value, _) if !is_none(*value));
            let joins = is_text(&left) && matches!(op, PyOp::Add | PyOp::Mod);
            if !joins {
                self.check_number(from)?;
            }
            self.i += 1;
            let (right_from, height) = (self.i, self.height);
            let right = operand(self)?;
            self.grow(height)?;
            if joins && (op == PyOp::Mod || is_text(&right)) {
                let range = range_of(&left);
                left = PyExpr::Call(JOINED_TEXT.to_owned(), Vec::new(), range);
                continue;
            }
            if joins {
                self.check_number(from)?;
            }
            self.check_number(right_from)?;
            left = PyExpr::Binary(op, Box::new(left), Box::new(right));
        }
        Ok(left)
    }

    fn factor(&mut self) -> Result<PyExpr, Refusal> {
        let mut negative = false;
        let first = self.i;
        loop {
            if self.eat("-") {
                negative = !negative;
            } else if !self.eat("+") {
                break;
            }
        }
        let from = self.i;
        let e = self.power()?;
        if from > first {
            self.check_number(from)?;
        }
        Ok(if negative { PyExpr::Neg(Box::new(e)) } else { e })
    }

    /// Parses `**`, which is right-associative and binds more tightly than a sign before it.
    fn power(&mut self) -> Result<PyExpr, Refusal> {
        let base = self.atom()?;
        if !self.eat("**") {
            return Ok(base);
        }
        self.depth += 1;
        if self.depth > MAX_DEPTH {
            return Err(Refusal::new("an expression nested too deep", self.here()));
        }
        let height = self.height;
        let exponent = self.factor()?;
        self.grow(height)?;
        self.depth -= 1;
        Ok(PyExpr::Binary(PyOp::Pow, Box::new(base), Box::new(exponent)))
    }

    /// Parses a number, string, name, call, list, dictionary or expression in parentheses, with the indices and coordinates after it.
    fn atom(&mut self) -> Result<PyExpr, Refusal> {
        let Some(t) = self.tokens.get(self.i).cloned() else {
            return Err(Refusal::new("an unfinished expression", self.here()));
        };
        self.i += 1;
        self.height = 1;
        match t.kind {
            PyTokenKind::Number(n) => Ok(PyExpr::Number(n)),
            PyTokenKind::Text(n) => {
                // `'%d'.format(x)` composes a string.
                if self.method().as_deref() == Some(".format") {
                    self.i += 3;
                    self.call(JOINED_TEXT.to_owned(), t.range.clone())?;
                    return Ok(PyExpr::Call(JOINED_TEXT.to_owned(), Vec::new(), t.range));
                }
                Ok(PyExpr::Text(n, t.range))
            }
            PyTokenKind::JoinedText => Ok(PyExpr::Call(JOINED_TEXT.to_owned(), Vec::new(), t.range)),
            PyTokenKind::Sign("(") => {
                let e = self.choice()?;
                // A single value in parentheses is that value; with a comma they hold a list.
                if self.eat(")") {
                    return self.indexed(e);
                }
                if self.sign() == Some(",") {
                    let list = self.list(e, ")", t.range)?;
                    return self.indexed(list);
                }
                let what = self.tokens.get(self.i).map_or("an unclosed '('".to_owned(), |t| self.describe(t));
                Err(Refusal::new(what, self.here()))
            }
            PyTokenKind::Sign("[") if self.eat("]") => Ok(PyExpr::List(Vec::new(), t.range)),
            // Parse a list constant, or `[value for name in list]`.
            PyTokenKind::Sign("[") => {
                let e = self.choice()?;
                let list = if self.word() == Some("for") {
                    let list = self.each(e, t.range)?;
                    if !self.eat("]") {
                        return Err(Refusal::new("a list that does not end", self.here()));
                    }
                    list
                } else {
                    self.list(e, "]", t.range)?
                };
                self.indexed(list)
            }
            // A dictionary is represented as a call with keys and values as alternating arguments.
            PyTokenKind::Sign("{") => {
                let (mut pairs, mut height) = (Vec::new(), 0_usize);
                while !self.eat("}") {
                    pairs.push(self.choice()?);
                    height = height.max(self.height);
                    if !self.eat(":") {
                        return Err(Refusal::new("a dictionary '{..}' without values", t.range.clone()));
                    }
                    pairs.push(self.choice()?);
                    height = height.max(self.height);
                    if !self.eat(",") && self.sign() != Some("}") {
                        return Err(Refusal::new("a dictionary '{..}' that does not end", self.here()));
                    }
                }
                self.grow(height)?;
                self.indexed(PyExpr::Call(DICTIONARY.to_owned(), pairs, t.range))
            }
            PyTokenKind::Name(first) => {
                // Keywords of Python that cannot begin a value here.
                if matches!(first.as_str(), "lambda" | "for" | "if" | "else" | "in" | "is") {
                    return Err(Refusal::new(format!("'{first}'"), t.range));
                }
                // Drop the names of modules: math.sin becomes sin.
                let mut name = first;
                while self.sign() == Some(".") {
                    if let Some(method) = self.method() {
                        self.i += 3;
                        let mut call = self.call(method, t.range.clone())?;
                        if let PyExpr::Call(_, args, _) = &mut call {
                            args.insert(0, PyExpr::Name(name, t.range));
                        }
                        return self.indexed(call);
                    }
                    // The attribute is a coordinate of a vector, which `indexed` reads.
                    if self.axis().is_some() {
                        return self.indexed(PyExpr::Name(name, t.range));
                    }
                    let is_module = matches!(
                        name.as_str(),
                        "math" | "random" | "np" | "numpy" | "rd" | "rnd" | "m" | "pgl" | "copy"
                    );
                    if !is_module && let Some(method) = self.called_method() {
                        let object = PyExpr::Name(name, t.range.clone());
                        let call = self.method_call(method, object, t.range)?;
                        return self.indexed(call);
                    }
                    if !is_module && let Some(field) = self.attribute() {
                        let object = PyExpr::Name(name, t.range.clone());
                        return self.indexed(PyExpr::Call(field, vec![object], t.range));
                    }
                    if !matches!(
                        name.as_str(),
                        "math" | "random" | "np" | "numpy" | "rd" | "rnd" | "m" | "pgl" | "copy"
                    ) {
                        return Err(attribute_refusal(&name, self.here()));
                    }
                    self.i += 1;
                    let Some(next) = self.word() else {
                        return Err(Refusal::new("'.' without a name", self.here()));
                    };
                    name = next.to_owned();
                    self.i += 1;
                }
                if self.eat("(") {
                    let call = self.call(name, t.range)?;
                    return self.indexed(call);
                }
                match name.as_str() {
                    "True" => Ok(PyExpr::Number(1.0)),
                    "False" => Ok(PyExpr::Number(0.0)),
                    "None" => Ok(PyExpr::none(t.range)),
                    _ => self.indexed(PyExpr::Name(name, t.range)),
                }
            }
            PyTokenKind::Sign(_) => Err(Refusal::new(self.describe(&t), t.range)),
        }
    }

    /// Parses the rest of a list after its first value.
    fn list(&mut self, first: PyExpr, end: &str, range: Range<usize>) -> Result<PyExpr, Refusal> {
        let (mut items, mut height) = (vec![first], self.height);
        while !self.eat(end) {
            if !self.eat(",") {
                return Err(Refusal::new("a list that does not end", self.here()));
            }
            if self.sign() != Some(end) {
                items.push(self.choice()?);
                height = height.max(self.height);
            }
        }
        self.grow(height)?;
        Ok(PyExpr::List(items, range))
    }

    /// Parses `for name in list` after the value of a comprehension.
    fn each(&mut self, value: PyExpr, range: Range<usize>) -> Result<PyExpr, Refusal> {
        let place = self.here();
        if !self.eat_word("for") {
            return Err(Refusal::new("a list that does not end", place));
        }
        let mut names = Vec::new();
        self.targets(&[], &mut names)?;
        if !self.eat_word("in") {
            return Err(Refusal::new("'for'", place));
        }
        // `value`, which precedes `for`, has been parsed already; the tests are parsed next and wrap it.
        let mut height = self.height;
        let list = self.or()?;
        height = height.max(self.height);
        // An `if` omits items.
        let mut tests = Vec::new();
        while self.eat_word("if") {
            tests.push(self.or()?);
            height = height.max(self.height) + 1;
        }
        self.grow(height)?;
        let is_nested = self.word() == Some("for");
        self.depth += 1;
        if self.depth > MAX_DEPTH {
            return Err(Refusal::new("an expression nested too deep", self.here()));
        }
        let value = if is_nested { self.each(value, range.clone())? } else { value };
        self.depth -= 1;
        let value = tests.into_iter().rev().fold(value, |value, test| {
            let nothing = PyExpr::Call(NOTHING.to_owned(), Vec::new(), range.clone());
            PyExpr::Choice(Box::new(test), Box::new(value), Box::new(nothing))
        });
        let all = each_item(value, names, list, &place, range.clone());
        Ok(if is_nested { PyExpr::Call(FLAT.to_owned(), vec![all], range) } else { all })
    }

    /// Reads the names of `for i, (a, b) in`. `path`: position within the item of the part that these names unpack.
    fn targets(&mut self, path: &[usize], out: &mut Vec<ItemTarget>) -> Result<(), Refusal> {
        let first = out.len();
        let mut count = 0;
        while count == 0 || self.eat(",") {
            let own = [path, &[count]].concat();
            if self.eat("(") {
                if own.len() > MAX_TARGETS {
                    return Err(Refusal::new("names nested too deep", self.here()));
                }
                self.targets(&own, out)?;
                if !self.eat(")") {
                    return Err(Refusal::new("an unclosed '('", self.here()));
                }
            } else {
                let name = self.word().map(str::to_owned).ok_or_else(|| Refusal::new("'for'", self.here()))?;
                out.push(ItemTarget { name, path: own });
                self.i += 1;
            }
            count += 1;
        }
        // A single target takes the whole item.
        if count == 1 {
            for target in out.iter_mut().skip(first) {
                target.path.remove(path.len());
            }
        }
        Ok(())
    }

    /// Parses the rest of `map(function, list)` or `filter(function, list)` as `[value for name in list]`; several lists of `map`
    /// are traversed in parallel.
    fn mapped(&mut self, is_filter: bool, range: Range<usize>) -> Result<PyExpr, Refusal> {
        let place = self.here();
        // A lambda gives parameter names and a value; otherwise only the name of a function is given.
        let (mut names, mut value) = (Vec::new(), None);
        let mut function = None;
        if self.eat_word("lambda") {
            while names.is_empty() || self.eat(",") {
                let Some(name) = self.word().map(str::to_owned) else {
                    return Err(Refusal::new("'lambda'", self.here()));
                };
                names.push(name);
                self.i += 1;
            }
            if !self.eat(":") {
                return Err(Refusal::new("'lambda' without ':'", self.here()));
            }
            value = Some(self.choice()?);
        } else {
            function = Some(self.choice()?);
        }
        // Read the lists after the function, up to the parenthesis.
        let mut height = self.height;
        let mut lists = Vec::new();
        while self.eat(",") {
            lists.push(self.choice()?);
            height = height.max(self.height);
        }
        if lists.is_empty() || !self.eat(")") {
            let what = self.tokens.get(self.i).map_or("an unclosed '('".to_owned(), |t| self.describe(t));
            return Err(Refusal::new(what, self.here()));
        }
        self.grow(height)?;
        // For a function, make names for the items, and its call as the value.
        if names.is_empty() {
            names = (0..lists.len()).map(|k| format!("(item {k} of {})", place.start)).collect();
        }
        let items: Vec<PyExpr> = names.iter().map(|name| PyExpr::Name(name.clone(), place.clone())).collect();
        // With `None` as its function, `filter` omits items that count as false.
        let value = match (value, function) {
            (Some(value), _) => value,
            (None, Some(PyExpr::Name(name, at))) => PyExpr::Call(name, items.clone(), at),
            (None, none) => match items.as_slice() {
                [item] if is_filter && none == Some(PyExpr::none(place.clone())) => item.clone(),
                _ => return Err(Refusal::new("this function of 'map' or 'filter'", place)),
            },
        };
        if lists.len() != names.len() || (is_filter && lists.len() != 1) {
            let what = format!("'{}' of other lists than its function has", if is_filter { "filter" } else { "map" });
            return Err(Refusal::new(what, range));
        }
        // `filter` keeps an item if the value holds, and otherwise omits it.
        let value = match items.as_slice() {
            [item] if is_filter => {
                let nothing = PyExpr::Call(NOTHING.to_owned(), Vec::new(), range.clone());
                PyExpr::Choice(Box::new(value), Box::new(item.clone()), Box::new(nothing))
            }
            _ => value,
        };
        // Several lists are zipped.
        let list = match lists.pop() {
            Some(list) if lists.is_empty() => list,
            last => PyExpr::Call("zip".to_owned(), lists.into_iter().chain(last).collect(), range.clone()),
        };
        Ok(each_item(value, ItemTarget::row(names), list, &place, range))
    }

    /// The index of a coordinate such as `.x`, if it comes next.
    fn axis(&self) -> Option<u32> {
        let Some(PyTokenKind::Name(name)) = self.tokens.get(self.i + 1).map(|t| &t.kind) else { return None };
        AXES.iter().position(|axis| axis == name).map(saturating_index)
    }

    /// Consumes an attribute that is not called; returns the name of the call that represents it.
    fn attribute(&mut self) -> Option<String> {
        let rest = self.tokens.get(self.i..)?;
        let (Some(PyTokenKind::Sign(".")), Some(PyTokenKind::Name(field))) =
            (rest.first().map(|t| &t.kind), rest.get(1).map(|t| &t.kind))
        else {
            return None;
        };
        if matches!(rest.get(2).map(|t| &t.kind), Some(PyTokenKind::Sign("(" | "."))) {
            return None;
        }
        let name = format!("{ATTRIBUTE}{field}");
        self.i += 2;
        Some(name)
    }

    /// The method of a class of the model whose call follows.
    fn called_method(&self) -> Option<String> {
        match self.tokens.get(self.i..)? {
            [
                PyToken { kind: PyTokenKind::Sign("."), .. },
                PyToken { kind: PyTokenKind::Name(name), .. },
                PyToken { kind: PyTokenKind::Sign("("), .. },
                ..,
            ] => Some(format!("{METHOD}{name}")),
            _ => None,
        }
    }

    /// Parses the rest of such a call, of which the object becomes the first argument.
    fn method_call(&mut self, method: String, object: PyExpr, range: Range<usize>) -> Result<PyExpr, Refusal> {
        self.depth += 1;
        if self.depth > MAX_DEPTH {
            return Err(Refusal::new("an expression nested too deep", self.here()));
        }
        self.i += 3;
        let mut call = self.call(method, range)?;
        self.depth -= 1;
        if let PyExpr::Call(_, args, _) = &mut call {
            args.insert(0, object);
        }
        Ok(call)
    }

    /// Parses the indices and coordinates after a value.
    fn indexed(&mut self, value: PyExpr) -> Result<PyExpr, Refusal> {
        let mut out = value;
        let mut count = 0;
        while matches!(self.sign(), Some("[" | ".")) {
            let place = self.here();
            let height = self.height;
            // `v.x` is read as `v[0]`; other attributes are refused at the end of the expression.
            if self.sign() == Some(".") {
                let Some(axis) = self.axis() else {
                    if let Some(method) = self.called_method() {
                        out = self.method_call(method, out, place)?;
                        self.grow(height)?;
                        continue;
                    }
                    let Some(field) = self.attribute() else { break };
                    self.grow(height)?;
                    out = PyExpr::Call(field, vec![out], place);
                    continue;
                };
                self.i += 2;
                self.grow(height)?;
                out = PyExpr::Index(Box::new(out), Box::new(PyExpr::Number(f64::from(axis))), place);
                continue;
            }
            self.i += 1;
            let index = self.part(&place)?;
            self.grow(height)?;
            count += 1;
            if !self.eat("]") || count > 8 {
                return Err(Refusal::new("a list or an index '[..]'", place));
            }
            out = PyExpr::Index(Box::new(out), Box::new(index), place);
        }
        Ok(out)
    }

    /// Parses the contents of an index's brackets: an index, or `from:to:step`, of which each part may be omitted.
    fn part(&mut self, place: &Range<usize>) -> Result<PyExpr, Refusal> {
        let missing = || PyExpr::Call(NOTHING.to_owned(), Vec::new(), place.clone());
        let first = if self.sign() == Some(":") { missing() } else { self.choice()? };
        if self.sign() != Some(":") {
            return Ok(first);
        }
        let mut parts = vec![first];
        while parts.len() < 3 && self.eat(":") {
            let is_missing = matches!(self.sign(), Some(":" | "]"));
            parts.push(if is_missing { missing() } else { self.choice()? });
        }
        Ok(PyExpr::Call(SLICE.to_owned(), parts, place.clone()))
    }

    fn call(&mut self, name: String, range: Range<usize>) -> Result<PyExpr, Refusal> {
        if matches!(name.as_str(), "map" | "filter") {
            return self.mapped(name == "filter", range);
        }
        let (mut args, mut height) = (Vec::new(), 0_usize);
        while !self.eat(")") {
            // Keyword argument `f(x, k=3)`: the name is kept with its `=`, so that it cannot be a function.
            if let [PyToken { kind: PyTokenKind::Name(own), range }, PyToken { kind: PyTokenKind::Sign("="), .. }, ..] =
                self.tokens.get(self.i..).unwrap_or(&[])
            {
                let (own, range) = (format!("{own}="), range.clone());
                self.i += 2;
                args.push(PyExpr::Call(own, vec![self.choice()?], range));
            } else {
                let from = self.i;
                args.push(self.choice()?);
                if OF_NUMBERS.contains(&name.as_str()) {
                    self.check_number(from)?;
                }
                if self.word() == Some("for")
                    && args.len() == 1
                    && let Some(value) = args.pop()
                {
                    args.push(self.each(value, range.clone())?);
                }
            }
            height = height.max(self.height);
            if self.eat(",") || self.sign() == Some(")") {
                continue;
            }
            let what = self.tokens.get(self.i).map_or("an unclosed '('".to_owned(), |t| self.describe(t));
            return Err(Refusal::new(what, self.here()));
        }
        self.grow(height)?;
        Ok(PyExpr::Call(name, args, range))
    }
}
