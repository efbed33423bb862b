//! Conditions of `#if` in views.

/// Limit on the nesting of parentheses and signs in one condition.
const MAX_DEPTH: u32 = 64;
/// Binary operators, from the lowest to the highest precedence; within a level longer operators come before their prefixes.
static LEVELS: [&[&str]; 6] = [&["||"], &["&&"], &["==", "!="], &["<=", ">=", "<", ">"], &["+", "-"], &["*", "/", "%"]];

/// Evaluates a condition whose macros are already replaced: whole numbers with the operators of C, names count as 0. `None`
/// if the text is anything else.
pub(super) fn holds(text: &str) -> Option<bool> {
    let mut condition = Condition { rest: text.trim_start(), depth: 0 };
    let value = condition.binary(0)?;
    condition.rest.is_empty().then_some(value != 0)
}

struct Condition<'t> {
    rest: &'t str,
    depth: u32,
}

impl Condition<'_> {
    /// Consumes `text` and the blanks after it if it comes next; returns whether it did.
    fn take(&mut self, text: &str) -> bool {
        let rest = self.rest.strip_prefix(text).map(str::trim_start);
        self.rest = rest.unwrap_or(self.rest);
        rest.is_some()
    }

    fn binary(&mut self, level: usize) -> Option<i64> {
        let Some(operators) = LEVELS.get(level) else { return self.unary() };
        let mut left = self.binary(level + 1)?;
        while let Some(operator) = operators.iter().find(|o| self.rest.starts_with(**o)) {
            self.take(operator);
            let right = self.binary(level + 1)?;
            left = match *operator {
                "||" => i64::from(left != 0 || right != 0),
                "&&" => i64::from(left != 0 && right != 0),
                "==" => i64::from(left == right),
                "!=" => i64::from(left != right),
                "<=" => i64::from(left <= right),
                ">=" => i64::from(left >= right),
                "<" => i64::from(left < right),
                ">" => i64::from(left > right),
                "+" => left.wrapping_add(right),
                "-" => left.wrapping_sub(right),
                "*" => left.wrapping_mul(right),
                "/" => left.checked_div(right)?,
                _ => left.checked_rem(right)?,
            };
        }
        Some(left)
    }

    fn unary(&mut self) -> Option<i64> {
        self.depth += 1;
        if self.depth > MAX_DEPTH {
            return None;
        }
        let value = if self.take("!") {
            i64::from(self.unary()? == 0)
        } else if self.take("-") {
            self.unary()?.wrapping_neg()
        } else if self.take("(") {
            let inside = self.binary(0)?;
            if !self.take(")") {
                return None;
            }
            inside
        } else {
            self.word()?
        };
        self.depth -= 1;
        Some(value)
    }

    fn word(&mut self) -> Option<i64> {
        let end = self.rest.find(|c: char| !c.is_ascii_alphanumeric() && c != '_').unwrap_or(self.rest.len());
        let (word, rest) = self.rest.split_at(end);
        self.rest = rest.trim_start();
        if word.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_') {
            return Some(0);
        }
        word.parse().ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn conditions_have_the_values_of_c() {
        for (text, value) in [
            ("1", Some(true)),
            ("0", Some(false)),
            ("2 == 2", Some(true)),
            ("2 != 2 || 1", Some(true)),
            ("1 || 0 && 0", Some(true)),
            ("(1 || 0) && 0", Some(false)),
            ("3 - 2 - 1", Some(false)),
            ("1 + 2 * 3 == 7", Some(true)),
            ("-1 < 0", Some(true)),
            ("!0 && !(3 <= 2)", Some(true)),
            ("7 % 4 == 3 && 7 / 2 >= 3", Some(true)),
            ("unknown", Some(false)),
            ("", None),
            ("1 2", None),
            ("1 / 0", None),
            ("(1", None),
            ("1.5", None),
        ] {
            assert_eq!(holds(text), value, "{text}");
        }
        assert_eq!(holds(&"(".repeat(100_000)), None);
    }
}
