//! Numbers on axes and the scale of shares.

/// The largest of 1, 2 or 5 times a power of ten that is not above `limit`; `limit` > 0.
pub(crate) fn round_below(limit: f64) -> f64 {
    let power = 10f64.powf(limit.max(1e-12).log10().floor());
    // 1 + 1e-9: log10 and powf may leave the limit itself a hair below its own round value.
    [5.0, 2.0, 1.0]
        .map(|m| m * power)
        .into_iter()
        .find(|s| *s <= limit * (1.0 + 1e-9))
        .unwrap_or(power)
}

/// The next round number after a round number: 1, 2, 5, 10.
fn round_after(step: f64) -> f64 {
    let lead = step / 10f64.powf(step.log10().floor());
    if (1.9..2.9).contains(&lead) { step * 2.5 } else { step * 2.0 }
}

/// Decimals that a multiple of `step` needs.
fn decimals(step: f64) -> usize {
    (-(step.log10() + 1e-9).floor()).clamp(0.0, 9.0) as usize
}

/// A number without superfluous decimals: 0.5 m, 20 m.
pub(crate) fn number(value: f64, step: f64) -> String {
    let text = format!("{value:.*}", decimals(step));
    // -0.0 and what rounds to it
    let zero = text.trim_start_matches('-').chars().all(|c| c == '0' || c == '.');
    let text = if zero { text.trim_start_matches('-').to_owned() } else { text };
    text.replace('-', "−")
}

/// Marks of an axis from `low` to `high` at round numbers, with their texts.
///
/// `px_per_m` is the scale; two marks keep `spacing_px(longest text)` apart.
pub(crate) fn ticks(
    low: f64,
    high: f64,
    px_per_m: f64,
    spacing_px: impl Fn(&str) -> i32,
) -> Vec<(f64, String)> {
    let mut step = round_below((high - low).max(1e-6) / 40.0);
    // From 40 marks to none takes at most 3 steps a decade; 30 covers any text width.
    for _ in 0..30 {
        let (first, last) = ((low / step).ceil(), (high / step).floor());
        let count = (last - first + 1.0).clamp(0.0, 1000.0) as usize;
        let marks: Vec<(f64, String)> = (0..count)
            .map(|i| (first + i as f64) * step)
            .map(|value| (value, number(value, step)))
            .collect();
        let widest = marks.iter().map(|(_, text)| spacing_px(text)).max().unwrap_or(0);
        if f64::from(widest) <= step * px_per_m {
            return marks;
        }
        step = round_after(step);
    }
    Vec::new()
}

/// Shares that are written on the colour bar, most important first, between both ends.
const SHARE_MARKS: [f64; 8] = [0.01, 0.1, 0.5, 0.25, 0.001, 0.05, 0.75, 0.02];

/// Place of a share on a bar that ends at the share `top`, 0..=1.
pub(crate) fn place(share: f64, top: f64, gamma: f64) -> f64 {
    (share / top).clamp(0.0, 1.0).powf(gamma)
}

/// Marks of the colour bar from 0 to the share `top`, 0 < top <= 1: (place 0..=1, text), those that
/// keep `spacing` apart of a bar of length 1.
pub(crate) fn share_marks(gamma: f64, top: f64, spacing: f64) -> Vec<(f64, String)> {
    let mut kept: Vec<(f64, String)> = vec![(0.0, percent(0.0)), (1.0, percent_of_top(top))];
    for share in SHARE_MARKS.into_iter().filter(|share| *share < top) {
        let at = place(share, top, gamma);
        if kept.iter().all(|(other, _)| (other - at).abs() >= spacing) {
            kept.push((at, percent(share)));
        }
    }
    kept.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    kept
}

/// The share at the end of a colour bar: it is seldom round.
pub(crate) fn percent_of_top(share: f64) -> String {
    match share {
        s if s >= 0.995 => "100 %".to_owned(),
        s if s >= 0.0995 => format!("{:.0} %", s * 100.0),
        s if s >= 0.00995 => format!("{:.1} %", s * 100.0),
        s => format!("{:.3} %", s * 100.0),
    }
}

/// A share as text: 0.1 %, 25 %.
pub(crate) fn percent(share: f64) -> String {
    if share > 0.0 && share < 0.0099 {
        format!("{:.1} %", share * 100.0)
    } else {
        format!("{:.0} %", share * 100.0)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn steps_are_one_two_or_five_times_a_power_of_ten() {
        for (limit, expected) in [(1.0, 1.0), (0.3, 0.2), (4.99, 2.0), (5.0, 5.0), (77.0, 50.0)] {
            assert!((round_below(limit) - expected).abs() < 1e-9 * expected, "{limit}");
        }
        let mut step = 0.1;
        for expected in [0.2, 0.5, 1.0, 2.0, 5.0, 10.0] {
            step = round_after(step);
            assert!((step - expected).abs() < 1e-9, "{step} {expected}");
        }
    }

    #[test]
    fn marks_of_an_axis_are_round_and_keep_apart() {
        let texts = |low, high, scale: f64| {
            let marks = ticks(low, high, scale, |t| 8 * t.chars().count() as i32 + 10);
            marks.into_iter().map(|(_, text)| text).collect::<Vec<_>>()
        };
        assert_eq!(texts(-0.9, 1.1, 40.0), ["0", "1"]);
        assert_eq!(texts(-0.5, 0.5, 220.0), ["−0.4", "−0.2", "0.0", "0.2", "0.4"]);
    }

    #[test]
    fn a_bar_that_ends_at_the_largest_share_names_it() {
        let marks = share_marks(1.0, 0.0234, 0.1);
        assert_eq!(marks.last().unwrap(), &(1.0, "2.3 %".to_owned()));
        let one = marks.iter().find(|(_, text)| text == "1 %").unwrap();
        assert!((one.0 - 0.01 / 0.0234).abs() < 1e-12);
        assert!(marks.iter().all(|(at, _)| (0.0..=1.0).contains(at)), "{marks:?}");
    }

    #[test]
    fn both_ends_are_on_the_colour_bar_whatever_its_length() {
        for spacing in [0.02, 0.1, 0.5, 0.9] {
            let marks = share_marks(0.4, 1.0, spacing);
            assert_eq!(marks.first().map(|m| m.1.as_str()), Some("0 %"));
            assert_eq!(marks.last().map(|m| m.1.as_str()), Some("100 %"));
        }
        assert!(share_marks(0.4, 1.0, 0.03).iter().any(|m| m.1 == "0.1 %"));
    }
}
