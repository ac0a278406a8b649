//! Colours: viridis for shares, Okabe and Ito's for classes (told apart by colour-blind readers).

use crate::canvas::Rgb;
use protocol::grid::CLASS_UNKNOWN;

/// Marks of events: Okabe-Ito vermillion, which no class of the presets has.
pub(crate) const EVENT: Rgb = [213, 94, 0];
/// Marks of lasers.
pub(crate) const LASER: Rgb = [200, 0, 60];
/// Class 0, `empty`, and the paper of the overview.
pub(crate) const EMPTY: Rgb = [250, 250, 247];

/// Colour of a class. Ids 1 to 5 are those of the presets: passing sky blue, lingering orange,
/// vacated bluish green, background black, transit reddish purple; others take what is left.
pub(crate) fn class_colour(id: u8) -> Rgb {
    match id {
        0 => EMPTY,
        1 => [86, 180, 233],
        2 => [230, 159, 0],
        3 => [0, 158, 115],
        4 => [30, 30, 30],
        5 => [204, 121, 167],
        CLASS_UNKNOWN => [232, 232, 232],
        // Okabe-Ito's blue and yellow, then brown and grey, in turn.
        other => [[0, 114, 178], [240, 228, 66], [120, 84, 56], [136, 136, 136]]
            [usize::from(other - 6) % 4],
    }
}

/// Viridis at v in 0..=1.
pub(crate) fn viridis(v: f64) -> Rgb {
    let colour = colorous::VIRIDIS.eval_continuous(v.clamp(0.0, 1.0));
    [colour.r, colour.g, colour.b]
}

/// `share` of the way from a to b, 0..=1.
pub(crate) fn mix(a: Rgb, b: Rgb, share: f64) -> Rgb {
    let channel = |i: usize| f64::from(a[i]) + (f64::from(b[i]) - f64::from(a[i])) * share;
    [0, 1, 2].map(|i| channel(i).round() as u8)
}

/// The hatched grey of cells that were never observed; the hatch does not depend on the cells.
pub(crate) fn hatch(x: i32, y: i32) -> Rgb {
    if (x + y).rem_euclid(8) == 0 { [206, 206, 206] } else { [234, 234, 234] }
}

/// Colour of a change of share, -1..=1: blue where it fell, white where it stayed, red where it rose.
/// ColorBrewer's RdBu: told apart by colour-blind readers.
pub(crate) fn diverging(change: f64) -> Rgb {
    let colour = colorous::RED_BLUE.eval_continuous(0.5 - change.clamp(-1.0, 1.0) / 2.0);
    [colour.r, colour.g, colour.b]
}

/// Outlines and names of zones.
pub(crate) const ZONE: Rgb = [72, 52, 148];

/// A cell of two maps that stayed as it was, from a share of 0 to one of 1: grey, as neither red nor
/// blue, and pale beside them.
pub(crate) fn unchanged(share: f64) -> Rgb {
    mix([248, 248, 248], [158, 158, 158], share)
}

/// Cells that only the later, or only the earlier of two maps has observed.
pub(crate) const NEWLY_OBSERVED: Rgb = [244, 232, 170];
pub(crate) const NO_MORE_OBSERVED: Rgb = [176, 190, 166];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn classes_of_the_presets_lasers_and_events_have_different_colours() {
        let mut colours: Vec<Rgb> = (0..10).map(class_colour).collect();
        colours.extend([EVENT, LASER, class_colour(CLASS_UNKNOWN)]);
        let count = colours.len();
        colours.sort_unstable();
        colours.dedup();
        assert_eq!(colours.len(), count);
    }

    #[test]
    fn a_change_to_more_is_red_to_less_is_blue_and_none_is_nearly_white() {
        let [more, less, none] = [1.0, -1.0, 0.0].map(diverging);
        assert!(more[0] > more[2] + 50 && less[2] > less[0] + 50, "{more:?} {less:?}");
        assert!(none.iter().all(|channel| *channel > 235), "{none:?}");
    }

    #[test]
    fn never_observed_is_no_colour_of_a_share() {
        let grey = |c: Rgb| c[0] == c[1] && c[1] == c[2];
        assert!((0..64).all(|i| grey(hatch(i, 0))));
        assert!((0..=1000).all(|i| !grey(viridis(f64::from(i) / 1000.0))));
    }
}
