//! Lists of whole numbers as they are typed everywhere: `A`, `A-B`, `A-B:STEP`, comma separated.

/// The numbers of a list, sorted, each once. At most `limit` of them.
/// # Errors
/// What cannot be read.
pub fn parse(text: &str, limit: u64) -> Result<Vec<u32>, String> {
    let mut out = Vec::new();
    for part in text.split(',') {
        let bad = || format!("\"{part}\" is not A, A-B or A-B:STEP");
        let number = |t: &str| t.trim().parse::<u32>().map_err(|_| bad());
        let (range, step) = part.split_once(':').map_or((part, 1), |(r, s)| (r, number(s).unwrap_or(0)));
        let (a, b) = match range.split_once('-') {
            Some((a, b)) => (number(a)?, number(b)?),
            None => (number(range)?, number(range)?),
        };
        if step == 0 || b < a {
            return Err(bad());
        }
        if u64::from((b - a) / step) >= limit {
            return Err(format!("\"{part}\" holds more than {limit} numbers"));
        }
        out.extend((a..=b).step_by(step as usize));
    }
    out.sort_unstable();
    out.dedup();
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::parse;

    #[test]
    fn lists_are_read() {
        assert_eq!(parse("1-10:4,3,3", 100), Ok(vec![1, 3, 5, 9]));
        assert_eq!(parse("7", 100), Ok(vec![7]));
        for bad in ["", "x", "3-1", "1-9:0", "1-", "-3", "1-4000000000"] {
            assert!(parse(bad, 1_000_000).is_err(), "{bad}");
        }
    }
}
