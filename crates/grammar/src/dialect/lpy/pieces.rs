//! Splits a line into parts: in parentheses, between commas, before a colon.

use crate::dialect::text::Piece;

/// Index of the parenthesis that closes one opened directly before the text; `None` if it is not closed.
pub(super) fn closing(text: &str) -> Option<usize> {
    let mut depth = 0_usize;
    for (i, c) in text.char_indices() {
        match c {
            '(' => depth += 1,
            ')' if depth == 0 => return Some(i),
            ')' => depth -= 1,
            _ => {}
        }
    }
    None
}

/// Parts between the commas outside of brackets; none for an empty text.
pub(super) fn split(piece: Piece<'_>) -> Vec<Piece<'_>> {
    if piece.text.trim().is_empty() { Vec::new() } else { parts(piece, ',') }
}

/// The parameters of each module called `name` in a text, in order. The name must not be part of a longer word, except in a
/// row of single-letter modules.
pub(super) fn parameters_of_modules<'t>(text: Piece<'t>, name: &'t str) -> impl Iterator<Item = Vec<Piece<'t>>> {
    text.text.match_indices(name).filter_map(move |(i, _)| {
        let before = text.text.get(..i)?.chars().next_back();
        let ends_word = |c: char| c == '_' || c == '.' || c.is_ascii_digit() || c.is_lowercase();
        let is_word = before.is_some_and(|c| ends_word(c) || (name.len() > 1 && c.is_alphabetic()));
        let inner = text.text.get(i + name.len()..)?.strip_prefix('(').filter(|_| !is_word)?;
        let end = closing(inner)?;
        Some(split(Piece::new(text.at + i + name.len() + 1, inner.get(..end).unwrap_or(""))))
    })
}

/// Parts between the separators outside of brackets; at least one.
fn parts(piece: Piece<'_>, separator: char) -> Vec<Piece<'_>> {
    let mut out = Vec::new();
    let (mut depth, mut from) = (0_usize, 0);
    for (i, c) in piece.text.char_indices() {
        match c {
            '(' | '[' | '{' => depth += 1,
            ')' | ']' | '}' => depth = depth.saturating_sub(1),
            c if c == separator && depth == 0 => {
                out.push(piece.up_to(i).from(from).trimmed());
                from = i + c.len_utf8();
            }
            _ => {}
        }
    }
    out.push(piece.from(from).trimmed());
    out
}

/// The contents of the bracket at the beginning of a text, and the rest after it.
pub(super) fn bracketed(piece: Piece<'_>) -> Option<(Piece<'_>, Piece<'_>)> {
    let mut depth = 0_usize;
    let close = piece.text.char_indices().find_map(|(i, c)| {
        match c {
            '[' | '(' => depth += 1,
            ']' | ')' => depth = depth.saturating_sub(1),
            _ => {}
        }
        (c == ']' && depth == 0).then_some(i)
    })?;
    Some((piece.up_to(close).from(1).trimmed(), piece.from(close + 1).trimmed()))
}

/// Index of the first colon outside of parentheses.
pub(super) fn colon(piece: Piece<'_>) -> Option<usize> {
    let mut depth = 0_usize;
    piece.text.char_indices().find_map(|(i, c)| {
        depth = (depth + usize::from(c == '(')).saturating_sub(usize::from(c == ')'));
        (c == ':' && depth == 0).then_some(i)
    })
}

/// Index of the colon that ends the heading of a block, such as `for v in q[1:]:`: the first one outside of all brackets.
pub(super) fn block_colon(piece: Piece<'_>) -> Option<usize> {
    let mut depth = 0_usize;
    piece.text.char_indices().find_map(|(i, c)| {
        match c {
            '(' | '[' | '{' => depth += 1,
            ')' | ']' | '}' => depth = depth.saturating_sub(1),
            _ => {}
        }
        (c == ':' && depth == 0).then_some(i)
    })
}

/// True if the text is a valid name in Python.
pub(super) fn is_name(text: &str) -> bool {
    let mut chars = text.chars();
    chars.next().is_some_and(|c| c.is_alphabetic() || c == '_') && chars.all(|c| c.is_alphanumeric() || c == '_')
}

/// The contents of the parentheses that enclose a whole text; `None` if the text is not entirely in one pair of parentheses.
pub(super) fn inside(piece: Piece<'_>) -> Option<Piece<'_>> {
    let inner = piece.text.strip_prefix('(')?;
    let end = closing(inner).filter(|end| end + 1 == inner.len())?;
    Some(Piece::new(piece.at + 1, inner.get(..end)?).trimmed())
}

/// True for what an assignment may set: a name, or several of them in parentheses, `(a, (b, c))`.
fn is_nested_target(piece: Piece<'_>) -> bool {
    match inside(piece) {
        Some(inner) => split(inner).into_iter().all(is_nested_target) && !inner.text.is_empty(),
        None => is_name(piece.text),
    }
}

/// Splits an assignment `name = expression`, also of several names, into target and value; `None` for anything else.
pub(super) fn assignment(piece: Piece<'_>) -> Option<(Piece<'_>, Piece<'_>)> {
    let i = piece.text.find('=')?;
    let names = piece.up_to(i).trimmed();
    // `(x, y) = e` is the same as `x, y = e`.
    let names = inside(names).unwrap_or(names);
    let value = piece.from(i + 1).trimmed();
    // One name may take the items that the other names leave: `first, *rest = q`.
    let parts = split(names);
    let stars = parts.iter().filter(|p| p.text.starts_with('*')).count();
    let is_target =
        |p: &Piece<'_>| is_nested_target(*p) || (parts.len() > 1 && is_name(p.text.trim_start_matches('*').trim()));
    (stars <= 1 && parts.iter().all(is_target) && !names.text.is_empty() && !value.text.starts_with('='))
        .then_some((names, value))
}

/// Non-empty parts of a line between the semicolons outside of brackets; semicolons in strings are masked.
pub(super) fn at_semicolons(piece: Piece<'_>) -> Vec<Piece<'_>> {
    let mut out = parts(piece, ';');
    out.retain(|p| !p.text.is_empty());
    out
}

/// True for a word that begins the heading of a block of Python.
pub(super) fn heads_block(word: &str) -> bool {
    matches!(word, "if" | "elif" | "else" | "for" | "while" | "def" | "class" | "try" | "except" | "finally" | "with")
}

/// The statements of a line, separated by semicolons; a line that begins a block is a single one. The modules of `produce`
/// extend to the end of the line, because `;` is also a module.
pub(super) fn statements_of_line(piece: Piece<'_>) -> Vec<Piece<'_>> {
    fn word(p: Piece<'_>) -> &str {
        p.first_word(&['(', ':', '=', '[']).0.text
    }
    if heads_block(word(piece)) {
        return vec![piece];
    }
    let mut parts = at_semicolons(piece);
    let produce = parts.iter().position(|p| matches!(word(*p), "produce" | "nproduce"));
    if let Some((k, at)) = produce.and_then(|k| Some((k, parts.get(k)?.at))) {
        parts.truncate(k);
        parts.push(piece.from(at - piece.at));
    }
    parts
}

/// A call of a method, `name.method(arguments)`.
pub(super) struct MethodCall<'t> {
    pub name: Piece<'t>,
    pub method: &'t str,
    pub args: Vec<Piece<'t>>,
}

pub(super) fn method_call(piece: Piece<'_>) -> Option<MethodCall<'_>> {
    let dot = piece.text.find('.')?;
    let name = piece.up_to(dot).trimmed();
    let call = piece.from(dot + 1);
    let open = call.text.find('(')?;
    let inner = call.from(open + 1);
    let close = closing(inner.text)?;
    let is_whole = inner.from(close + 1).text.trim().is_empty();
    let method = call.up_to(open).text.trim();
    (is_name(name.text) && is_whole).then(|| MethodCall { name, method, args: split(inner.up_to(close)) })
}

/// The heading of a function: its parameters with their default values, and the text after its colon.
pub(super) struct FunctionHead<'t> {
    pub params: Vec<(String, Option<Piece<'t>>)>,
    pub body: Piece<'t>,
}

/// Reads the heading of a function after `def`: `f(x, k=3) -> float: return x`.
pub(super) fn function_head(rest: Piece<'_>) -> Option<FunctionHead<'_>> {
    let params = parameters_of(rest)?;
    let inner = rest.from(rest.text.find('(')? + 1);
    // In `def f(x) -> float:` skip the type of the result.
    let after = inner.from(closing(inner.text)? + 1).trimmed();
    let given = after.text.strip_prefix("->").and_then(|t| t.find(':')).map_or(0, |c| c + "->".len());
    let after = after.from(given);
    let body = after.text.strip_prefix(':').map(|_| after.from(1).trimmed())?;
    Some(FunctionHead { params, body })
}

/// Parameter names in the heading of a function, `Start(lstring):`, with their default values, as in `f(x, k=3):`.
pub(super) fn parameters_of(head: Piece<'_>) -> Option<Vec<(String, Option<Piece<'_>>)>> {
    let inner = head.from(head.text.find('(')? + 1);
    let list = split(inner.up_to(closing(inner.text)?));
    let parameters = list.into_iter().map(|p| {
        let value = p.text.find('=').map(|i| p.from(i + 1).trimmed());
        // In `x: float` drop the type of the parameter.
        let name = p.text.split(['=', ':']).next().unwrap_or_default().trim();
        (name.to_owned(), value)
    });
    Some(parameters.collect())
}

/// True for a production, which has an arrow or whose head ends with a colon; other statements of Python have neither.
pub(super) fn is_rule(piece: Piece<'_>) -> bool {
    let (word, _) = piece.first_word(&['(', ':', '=']);
    let is_python =
        ["def", "class", "if", "for", "while", "try", "with", "else", "elif", "from", "import"].contains(&word.text);
    piece.text.contains("-->")
        || piece.text.contains("-static->")
        || (!is_python && colon(piece).is_some() && assignment(piece).is_none())
}

/// True for `seed(3)`, `random.seed(3)` and the like.
pub(super) fn is_seed(piece: Piece<'_>) -> bool {
    let Some((name, _)) = piece.text.split_once('(') else { return false };
    let name = name.trim_end();
    let is_path = name.chars().all(|c| c.is_alphanumeric() || matches!(c, '_' | '.'));
    is_path && name.rsplit('.').next() == Some("seed")
}

/// The target of `p.field = value` or `p.field += value`: object name, attribute, and the rest of the line.
pub(super) struct AttributeTarget<'t> {
    pub object: Piece<'t>,
    pub field: &'t str,
    /// The rest of the line, beginning with the operator.
    pub rest: Piece<'t>,
}

/// The attribute that a line sets; `None` for other lines.
pub(super) fn attribute_target(piece: Piece<'_>) -> Option<AttributeTarget<'_>> {
    let dot = piece.text.find('.')?;
    let object = piece.up_to(dot).trimmed();
    let after = piece.from(dot + 1);
    let n = after.text.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(after.text.len());
    let (field, rest) = (after.up_to(n).text, after.from(n).trimmed());
    let sets = rest.text.find('=').is_some_and(|i| {
        let sign = rest.text[..i].trim();
        !rest.text[i..].starts_with("==") && (sign.is_empty() || sign.chars().all(|c| "+-*/%".contains(c)))
    });
    (is_name(object.text) && is_name(field) && sets).then_some(AttributeTarget { object, field, rest })
}
