//! The format of a `printf`: text and numbers as C writes them.

use osier_base::convert::to_usize;

/// Limit on the width and precision of a number, characters: larger fields would only waste memory.
const MAX_FIELD: usize = 64;

#[derive(Debug, Clone, PartialEq)]
enum Part {
    Text(String),
    Number(NumberField),
}

/// Flags, width, precision and conversion of one number in a format of `printf`.
#[derive(Debug, Clone, PartialEq)]
struct NumberField {
    left: bool,
    zeros: bool,
    plus: bool,
    width: usize,
    precision: Option<usize>,
    /// `d`, `f`, `e` or `g`.
    conversion: char,
}

/// A format of `printf`, and the number of values that its call passes.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PrintFormat {
    parts: Vec<Part>,
    /// Number of values that the call passes.
    pub arguments: usize,
    /// Index into the `places` of the bytecode that calls it.
    pub place: usize,
}

impl PrintFormat {
    /// Parses the text between the quotes, as written in the file.
    pub fn new(text: &str, arguments: usize, place: usize) -> Self {
        let mut parts = Vec::new();
        let mut plain = String::new();
        let mut chars = text.chars().peekable();
        while let Some(c) = chars.next() {
            match c {
                // Escape sequences of C; an unknown one stands for its second character.
                '\\' => plain.push(match chars.next() {
                    Some('n') => '\n',
                    Some('t') => '\t',
                    Some(other) => other,
                    None => '\\',
                }),
                '%' if chars.peek() == Some(&'%') => {
                    chars.next();
                    plain.push('%');
                }
                '%' => match number_field(&mut chars) {
                    Some(field) => {
                        parts.push(Part::Text(std::mem::take(&mut plain)));
                        parts.push(Part::Number(field));
                    }
                    // A `%` that does not begin a conversion is printed literally.
                    None => plain.push('%'),
                },
                other => plain.push(other),
            }
        }
        parts.push(Part::Text(plain));
        Self { parts, arguments, place }
    }

    /// Number of values that the format consumes.
    pub fn fields(&self) -> usize {
        self.parts.iter().filter(|p| matches!(p, Part::Number(_))).count()
    }

    /// The formatted text; missing values count as 0.
    pub fn text(&self, values: &[f64]) -> String {
        let mut values = values.iter();
        let mut out = String::new();
        for part in &self.parts {
            match part {
                Part::Text(text) => out.push_str(text),
                Part::Number(field) => out.push_str(&field.write(values.next().copied().unwrap_or(0.0))),
            }
        }
        out
    }
}

/// Flags, width and precision after a `%`, up to its letter; `None` if there is no letter.
fn number_field(chars: &mut std::iter::Peekable<std::str::Chars<'_>>) -> Option<NumberField> {
    let mut ahead = chars.clone();
    let mut field = NumberField { left: false, zeros: false, plus: false, width: 0, precision: None, conversion: 'g' };
    // The flags ` ` and `#` of C are accepted, but have no effect here.
    while let Some(flag) = ahead.next_if(|c| matches!(c, '-' | '0' | '+' | ' ' | '#')) {
        field.left |= flag == '-';
        field.zeros |= flag == '0';
        field.plus |= flag == '+';
    }
    let digits = |ahead: &mut std::iter::Peekable<std::str::Chars<'_>>| {
        let mut n = 0_usize;
        while let Some(d) = ahead.peek().and_then(|c| c.to_digit(10)) {
            ahead.next();
            n = n.saturating_mul(10).saturating_add(to_usize(d));
        }
        n.min(MAX_FIELD)
    };
    field.width = digits(&mut ahead);
    if ahead.next_if_eq(&'.').is_some() {
        field.precision = Some(digits(&mut ahead));
    }
    // Skip length modifiers: all values have double precision.
    while ahead.next_if(|c| matches!(c, 'l' | 'h' | 'L')).is_some() {}
    field.conversion = match ahead.next()? {
        'd' | 'i' | 'u' => 'd',
        'f' | 'F' => 'f',
        'e' | 'E' => 'e',
        'g' | 'G' => 'g',
        _ => return None,
    };
    *chars = ahead;
    Some(field)
}

impl NumberField {
    fn write(&self, x: f64) -> String {
        let precision = self.precision.unwrap_or(6);
        let magnitude = x.abs();
        let digits = match self.conversion {
            // Infinite values and NaN print as `inf` and `NaN` in every conversion.
            _ if !x.is_finite() => format!("{magnitude}"),
            'd' => format!("{:.0}", magnitude.trunc()),
            'f' => format!("{magnitude:.precision$}"),
            'e' => with_exponent(magnitude, precision),
            _ => general(magnitude, precision.max(1)),
        };
        let sign = if x.is_sign_negative() && !x.is_nan() {
            "-"
        } else if self.plus {
            "+"
        } else {
            ""
        };
        let missing = self.width.saturating_sub(sign.len() + digits.len());
        // Padding zeros stand between sign and digits, padding blanks outside.
        match (self.left, self.zeros && x.is_finite()) {
            (true, _) => format!("{sign}{digits}{}", " ".repeat(missing)),
            (false, true) => format!("{sign}{}{digits}", "0".repeat(missing)),
            (false, false) => format!("{}{sign}{digits}", " ".repeat(missing)),
        }
    }
}

/// A finite number as C's `%e` prints it.
fn with_exponent(x: f64, precision: usize) -> String {
    let text = format!("{x:.precision$e}");
    let Some((digits, power)) = text.split_once('e') else { return text };
    let power: i32 = power.parse().unwrap_or(0);
    format!("{digits}e{}{:02}", if power < 0 { '-' } else { '+' }, power.abs())
}

/// A finite number of at least 0 as C's `%g` prints it: `precision` significant digits, no trailing zeros.
fn general(x: f64, precision: usize) -> String {
    if x <= 0.0 {
        return "0".to_owned();
    }
    let scientific = with_exponent(x, precision - 1);
    let Some((digits, power)) = scientific.split_once('e') else { return scientific };
    let power: i32 = power.parse().unwrap_or(0);
    let trim =
        |s: &str| if s.contains('.') { s.trim_end_matches('0').trim_end_matches('.').to_owned() } else { s.to_owned() };
    // A negative exponent needs more decimals for its leading zeros, a positive one fewer.
    let decimals = match usize::try_from(power) {
        Ok(power) => precision.checked_sub(power + 1),
        Err(_) => Some(precision - 1 + to_usize(power.unsigned_abs())).filter(|_| power >= -4),
    };
    let Some(decimals) = decimals else {
        return format!("{}e{}{:02}", trim(digits), if power < 0 { '-' } else { '+' }, power.abs());
    };
    trim(&format!("{x:.decimals$}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn print(format: &str, values: &[f64]) -> String {
        PrintFormat::new(format, values.len(), 0).text(values)
    }

    #[test]
    fn numbers_are_written_as_c_writes_them() {
        // Expectations: printf of C with the same arguments.
        assert_eq!(print("Step %3f|%.0f|%.lf\\n", &[1.5, 2.5, 3.5]), "Step 1.500000|2|4\n");
        assert_eq!(print("%g %g %g %g", &[0.0001, 0.00001, 1e6, 0.5]), "0.0001 1e-05 1e+06 0.5");
        assert_eq!(print("[%5.1f][%-5.1f][%05.1f][%+d]", &[2.25, -2.25, 2.25, 7.9]), "[  2.2][-2.2 ][002.2][+7]");
        assert_eq!(print("%.3e %d%%", &[12345.678, -3.9]), "1.235e+04 -3%");
        assert_eq!(print("%.2g %g", &[123.0, f64::INFINITY]), "1.2e+02 inf");
    }

    #[test]
    fn odd_formats_are_text_and_missing_values_are_zero() {
        assert_eq!(print("a%q 100% %d %d", &[4.0]), "a%q 100% 4 0");
        assert_eq!(PrintFormat::new("%d %% %f", 0, 0).fields(), 2);
        assert_eq!(print("%999f", &[0.0]).len(), 64, "the width of a field is bounded");
    }
}
