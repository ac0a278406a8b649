//! Numbers of text logs.

use protocol::time::SECOND_NS;

/// Decimal seconds to nanoseconds without a rounding on the way ("1048880434.230000"): an f64 holds
/// UNIX seconds to 0.2 us only. More than nine decimals are rounded.
///
/// # Errors
/// Not a number, negative, or beyond the year 2554.
pub(crate) fn seconds_ns(text: &str) -> Result<u64, String> {
    scaled_ns(text, SECOND_NS)
}

/// Decimal multiples of `unit_ns` (1, 1000, .. SECOND_NS) to nanoseconds.
///
/// # Errors
/// As [`seconds_ns`].
pub(crate) fn scaled_ns(text: &str, unit_ns: u64) -> Result<u64, String> {
    let refuse = || format!("a time of \"{}\", expected a decimal number >= 0", shown(text));
    let plain = text.strip_prefix('+').unwrap_or(text);
    let (whole, decimals) = plain.split_once('.').unwrap_or((plain, ""));
    let is_digits = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
    if whole.len() + decimals.len() == 0 {
        return Err(refuse());
    }
    if !is_digits(whole) || !is_digits(decimals) {
        // 3.4e+02, or no number at all.
        let value: f64 = text.parse().map_err(|_| refuse())?;
        let ns = value * unit_ns as f64;
        return if (0.0..1.8e19).contains(&ns) { Ok(ns.round() as u64) } else { Err(refuse()) };
    }
    let whole: u64 = if whole.is_empty() { 0 } else { whole.parse().map_err(|_| refuse())? };
    let mut ns = whole.checked_mul(unit_ns).ok_or_else(refuse)?;
    let mut place_ns = unit_ns;
    for digit in decimals.bytes().map(|byte| u64::from(byte - b'0')) {
        if place_ns == 1 {
            return ns.checked_add(u64::from(digit >= 5)).ok_or_else(refuse);
        }
        place_ns /= 10;
        ns = ns.checked_add(digit * place_ns).ok_or_else(refuse)?;
    }
    Ok(ns)
}

/// A real number; C's "-nan" is taken too.
///
/// # Errors
/// Not a number.
pub(crate) fn real(text: &str, what: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(value) => Ok(value),
        Err(_) if text.eq_ignore_ascii_case("-nan") => Ok(f64::NAN),
        Err(_) => Err(format!("{what} is \"{}\", expected a number", shown(text))),
    }
}

/// A real number rounded once to 32 bits, as recordings hold it.
///
/// # Errors
/// Not a number.
pub(crate) fn real32(text: &str, what: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(value) => Ok(value),
        Err(_) => real(text, what).map(|value| value as f32),
    }
}

/// A count that is not above `most`.
///
/// # Errors
/// Not a whole number, or too many.
pub(crate) fn count(text: &str, most: usize, what: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(count) if count <= most => Ok(count),
        Ok(count) => Err(format!("{count} {what}, expected at most {most}")),
        Err(_) => Err(format!("the number of {what} is \"{}\", expected a count", shown(text))),
    }
}

/// The begin of a text for an error.
fn shown(text: &str) -> String {
    text.chars().take(24).collect::<String>().escape_debug().to_string()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn seconds_become_nanoseconds_exactly() {
        for (text, ns) in [
            ("1048880434.230001", 1_048_880_434_230_001_000),
            ("0.000246", 246_000),
            ("1700000000.1234567895", 1_700_000_000_123_456_790),
            ("1700000000.12345678949", 1_700_000_000_123_456_789),
            (".5", 500_000_000),
            ("7", 7_000_000_000),
            ("3.5e+02", 350_000_000_000),
            ("0000000000.000", 0),
        ] {
            assert_eq!(seconds_ns(text), Ok(ns), "{text}");
        }
        assert_eq!(scaled_ns("1700000000123.25", 1_000_000), Ok(1_700_000_000_123_250_000));
        assert_eq!(scaled_ns("12", 1), Ok(12));
        for text in ["", ".", "-1", "nan", "1e30", "pippo", "99999999999999999999", "1.2.3"] {
            assert!(seconds_ns(text).unwrap_err().contains("expected a decimal number"), "{text}");
        }
    }
}
