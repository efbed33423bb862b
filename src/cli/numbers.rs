//! Values of flags: lists of whole numbers (`A`, `A-B`, `A-B:STEP`, separated by commas), and keys with several values.

/// The numbers of a list in rising order without duplicates.
/// # Errors
/// A message for a part that cannot be read, and for more than `limit` numbers, which ends with `remedy`.
pub fn number_list(text: &str, limit: u64, remedy: &str) -> Result<Vec<u64>, String> {
    let mut out: Vec<u64> = Vec::new();
    for part in text.split(',') {
        let bad = || format!("\"{part}\" is not A, A-B or A-B:STEP");
        let number = |t: &str| t.trim().parse::<u64>().map_err(|_| bad());
        // An unreadable step becomes 0 and is refused below, with the whole part in the message.
        let (range, step) = part.split_once(':').map_or((part, 1), |(r, s)| (r, number(s).unwrap_or(0)));
        let (a, b) = match range.split_once('-') {
            Some((a, b)) => (number(a)?, number(b)?),
            None => (number(range)?, number(range)?),
        };
        if step == 0 || b < a {
            return Err(bad());
        }
        // The count is checked before the list is built: `0-4294967295` would need 34 GB.
        let steps = (b - a) / step;
        if steps >= limit {
            return Err(format!("\"{part}\" holds more than {limit} numbers; {remedy}"));
        }
        out.extend((0..=steps).map(|k| a + k * step));
        // Thousands of parts within the limit would need as much memory as one beyond it. Numbers of several parts count once.
        if out.len() as u64 > limit {
            out.sort_unstable();
            out.dedup();
        }
        if out.len() as u64 > limit {
            return Err(format!("more than {limit} numbers; {remedy}"));
        }
    }
    out.sort_unstable();
    out.dedup();
    Ok(out)
}

/// The numbers of a list of frames, which have 32 bits.
/// # Errors
/// As [`number_list`], and a message for a number that no frame can have.
pub fn frame_list(text: &str, limit: u64) -> Result<Vec<u32>, String> {
    let frame = |n: u64| u32::try_from(n).map_err(|_| format!("there is no frame {n}"));
    number_list(text, limit, "raise it with --max-frames")?.into_iter().map(frame).collect()
}

/// A key with the values that it takes in the runs of a sweep.
#[derive(Debug, Clone)]
pub struct KeyValues {
    /// Path of the key, as in `--set`.
    pub key: String,
    /// Values as text, as in `--set`.
    pub values: Vec<String>,
}

/// Reads all `--sweep` flags of a command.
/// # Errors
/// A message for a text of another form than `key_values` reads, and for a key or a value that is given twice: runs of equal
/// values would count as seeds of one choice.
pub fn swept_keys(flags: &[String]) -> Result<Vec<KeyValues>, String> {
    let sweeps = flags.iter().map(|text| key_values(text)).collect::<Result<Vec<_>, _>>()?;
    for (i, sweep) in sweeps.iter().enumerate() {
        if sweeps[..i].iter().any(|earlier| earlier.key == sweep.key) {
            return Err(format!("--sweep: \"{}\" is given twice; list all of its values in one flag", sweep.key));
        }
        let is_repeated = |k: &usize| sweep.values[..*k].iter().any(|v| is_same_value(v, &sweep.values[*k]));
        if let Some(k) = (0..sweep.values.len()).find(is_repeated) {
            let (key, value) = (&sweep.key, &sweep.values[k]);
            return Err(format!(
                "--sweep: \"{key}\" has the value {value} twice; --seeds repeats runs with other seeds"
            ));
        }
    }
    Ok(sweeps)
}

/// Whether two texts are one value: `1` and `1.0` are.
fn is_same_value(a: &str, b: &str) -> bool {
    let numbers = a.parse::<f64>().ok().zip(b.parse::<f64>().ok());
    a == b || numbers.is_some_and(|(a, b)| a.total_cmp(&b).is_eq())
}

/// Reads `KEY=A:B:N`, N values evenly from A to B, or `KEY=V1,V2,...`. Values are written without a point if all are whole.
/// # Errors
/// A message for a text of another form; N is 1 to 64.
fn key_values(text: &str) -> Result<KeyValues, String> {
    let bad = || format!("--sweep: \"{text}\" is not KEY=FROM:TO:COUNT nor KEY=VALUE,VALUE,...");
    let (key, range) = text.split_once('=').filter(|(k, r)| !k.is_empty() && !r.is_empty()).ok_or_else(bad)?;
    let values = match range.split(':').collect::<Vec<_>>()[..] {
        [list] => values(list),
        [a, b, n] => {
            let number = |t: &str| t.trim().parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(bad);
            let (a, b) = (number(a)?, number(b)?);
            let few = |n: &u32| (1..=64).contains(n);
            let many = || format!("--sweep: \"{text}\": COUNT is a whole number from 1 to 64");
            let n: u32 = n.trim().parse().ok().filter(few).ok_or_else(many)?;
            // Keys that take whole numbers refuse `3.0`, so whole values are written without a point.
            let is_whole = a.fract() == 0.0 && b.fract() == 0.0 && ((b - a) / f64::from((n - 1).max(1))).fract() == 0.0;
            // N evenly spaced values, both ends included; a single one is A.
            let value = |i: u32| {
                let v = a + (b - a) * f64::from(i) / f64::from((n - 1).max(1));
                // The middle of -0.1 to 0.1 is 0, and not the rounding error of its computation.
                if v.abs() < 1e-12 * a.abs().max(b.abs()) { 0.0 } else { v }
            };
            let text = |v: f64| if is_whole { format!("{v:.0}") } else { trimmed(v) };
            (0..n).map(|i| text(value(i))).collect()
        }
        _ => return Err(bad()),
    };
    Ok(KeyValues { key: key.to_owned(), values })
}

/// The values between the commas of a list; commas in brackets, braces and quotes belong to a value.
fn values(list: &str) -> Vec<String> {
    let (mut depth, mut is_quoted) = (0_i32, false);
    let is_border = |c: char| {
        match c {
            '"' => is_quoted = !is_quoted,
            '[' | '{' if !is_quoted => depth += 1,
            ']' | '}' if !is_quoted => depth -= 1,
            _ => {}
        }
        c == ',' && depth <= 0 && !is_quoted
    };
    list.split(is_border).map(|v| v.trim().to_owned()).collect()
}

/// A number with at least one decimal. Nine digits hide the rounding errors of dividing an interval, whatever its size.
fn trimmed(v: f64) -> String {
    let text = format!("{v:.8e}").parse::<f64>().unwrap_or(v).to_string();
    if text.contains('.') { text } else { format!("{text}.0") }
}

#[cfg(test)]
mod tests {
    use super::{frame_list, key_values, number_list, swept_keys};

    #[test]
    fn values_of_a_key_are_read() {
        let values = |t: &str| key_values(t).map(|s| s.values);
        assert_eq!(values("a.b=0:1:3"), Ok(vec!["0.0".to_owned(), "0.5".into(), "1.0".into()]));
        assert_eq!(values("a=1:5:3"), Ok(vec!["1".to_owned(), "3".into(), "5".into()]));
        assert_eq!(values("a=x, y"), Ok(vec!["x".to_owned(), "y".into()]));
        // Steps below a ten-thousandth stay apart, and none shows the rounding of thirds.
        let small = ["0.00012", "0.00015", "0.00018"].map(str::to_owned).to_vec();
        assert_eq!(values("a=0.00012:0.00018:3"), Ok(small));
        assert_eq!(values("a=0.1:0.4:4"), Ok(["0.1", "0.2", "0.3", "0.4"].map(str::to_owned).to_vec()));
        assert_eq!(values("a=-0.1:0.1:7").map(|v| v[3].clone()), Ok("0.0".to_owned()));
        // Commas of a list or a text are no borders.
        let lists = ["[0, 1, 2]", "[3,4,5]", "\"a,b\""].map(str::to_owned).to_vec();
        assert_eq!(values("a=[0, 1, 2], [3,4,5],\"a,b\""), Ok(lists));
        assert!(["", "a", "a=", "=1", "a=1:2", "a=1:2:0", "a=1:x:3", "a=1:2:99"].iter().all(|t| values(t).is_err()));
    }

    #[test]
    fn keys_and_values_are_given_once() {
        let read = |flags: &[&str]| swept_keys(&flags.iter().map(ToString::to_string).collect::<Vec<_>>());
        assert_eq!(read(&["a=1,2", "b=1:1:1", "c=\"1\",1,-1"]).map(|sweeps| sweeps.len()), Ok(3));
        let refused: [(&[&str], &str); 5] = [
            (&["a=1,2,1"], "\"a\" has the value 1 twice"),
            (&["a=x,y", "b=1,2,1.0"], "\"b\" has the value 1.0 twice"),
            (&["a=0.5:0.5:2"], "0.5 twice"),
            (&["a=1,2", "b=1,2", "a=3"], "\"a\" is given twice"),
            (&["a=1:2"], "KEY=FROM:TO:COUNT"),
        ];
        for (flags, words) in refused {
            let said = read(flags).map(|sweeps| sweeps.len());
            assert!(matches!(&said, Err(why) if why.contains(words)), "{flags:?}: {said:?}");
        }
    }

    #[test]
    fn lists_are_read() {
        assert_eq!(number_list("1-10:4,3,3", 100, "fewer"), Ok(vec![1, 3, 5, 9]));
        assert_eq!(number_list("7", 100, "fewer"), Ok(vec![7]));
        // Seeds have 64 bits, frames 32.
        assert_eq!(
            number_list("18446744073709551614-18446744073709551615", 100, "fewer"),
            Ok(vec![u64::MAX - 1, u64::MAX])
        );
        assert!(
            number_list("18446744073709551616", 100, "fewer").is_err()
                && number_list("0-18446744073709551615", 100, "fewer").is_err()
        );
        assert_eq!(frame_list("4294967295", 100), Ok(vec![u32::MAX]));
        assert_eq!(frame_list("4294967296", 100), Err("there is no frame 4294967296".to_owned()));
        // The limit is that of all parts together, in which a number counts once.
        assert_eq!(number_list("1-3,2-4,1-4", 4, "fewer"), Ok(vec![1, 2, 3, 4]));
        assert_eq!(number_list("1-3,2-4,5", 4, "fewer"), Err("more than 4 numbers; fewer".to_owned()));
        for bad in ["", "x", "3-1", "1-9:0", "1-", "-3", "1-4000000000"] {
            assert!(number_list(bad, 1_000_000, "fewer").is_err(), "{bad}");
        }
    }
}
