//! What a reader must be told where a recording does not say it.

use crate::columns::ColumnMap;

/// How a recording is read; the default suits everything but a foreign CSV.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ReadOptions {
    /// What the columns of a CSV are; without it the first line of the CSV must say so.
    pub columns: Option<ColumnMap>,
    /// Which echo of a beam that has several is taken.
    pub echo: Echo,
}

/// Which echo of a beam that has several.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Echo {
    /// The nearest that the device reports: whatever is there first, glass included.
    #[default]
    First,
    /// The one with the highest intensity; the first where intensities are absent.
    Strongest,
    /// The farthest that the device reports: what is behind glass, rain and dust.
    Last,
}

impl Echo {
    /// The range of this echo; NaN if there is none.
    pub(crate) fn choose(self, ranges_m: &[f32], intensities: &[f32]) -> f32 {
        let chosen = match self {
            Self::First => ranges_m.first(),
            Self::Last => ranges_m.last(),
            Self::Strongest => {
                let pairs = ranges_m.iter().zip(intensities);
                // `max_by` takes the last of equals; the nearest is wanted.
                let strongest = pairs.rev().max_by(|a, b| a.1.total_cmp(b.1));
                strongest.map(|(range_m, _)| range_m).or(ranges_m.first())
            }
        };
        chosen.copied().unwrap_or(f32::NAN)
    }
}
