//! What a class says of a cell, whatever its name: read off the prototype.
//!
//! The site file may name any classes; the detector must still know that "something stands here"
//! differs from "something left". A prototype gives one occupancy a timescale, shortest first:
//! what counts is whether the cell is occupied on the shortest, in the middle, and on the longest.

use protocol::site::Area;

/// What a class says of a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Role {
    /// Occupied on no timescale.
    Empty,
    /// Occupied now, not before.
    Passing,
    /// Occupied for some time, not for long.
    Lingering,
    /// Was occupied for long, is not now.
    Vacated,
    /// Occupied on every timescale.
    Fixed,
    /// A hit within the shortest timescale, too quick for `Passing`.
    Transit,
    /// Not observed.
    Unknown,
}

impl Role {
    /// Something was hit here within the shortest timescale.
    pub(crate) fn is_present(self) -> bool {
        matches!(self, Self::Passing | Self::Lingering | Self::Fixed | Self::Transit)
    }

    /// Nothing is here now: the roles that a shadow or a dead laser imitates.
    pub(crate) fn is_absent(self) -> bool {
        matches!(self, Self::Empty | Self::Vacated)
    }

    fn of_prototype(prototype: &[f64]) -> Self {
        let occupied = |index: usize| prototype.get(index).is_some_and(|value| *value >= 0.5);
        let last = prototype.len().saturating_sub(1);
        let short = occupied(0);
        let long = occupied(last);
        let middle = (1..last).any(occupied);
        match (short, middle, long) {
            (true, _, true) => Self::Fixed,
            (true, true, false) | (false, true, false) => Self::Lingering,
            (true, false, false) => Self::Passing,
            (false, _, true) => Self::Vacated,
            (false, false, false) => Self::Empty,
        }
    }
}

/// The roles and names of an area's classes; one slot more than classes, the last is `unknown`.
#[derive(Debug, Clone)]
pub(crate) struct Roles {
    roles: Vec<Role>,
    names: Vec<String>,
}

impl Roles {
    pub(crate) fn of(area: &Area) -> Self {
        let mut roles: Vec<Role> =
            area.prototypes().iter().map(|class| Role::of_prototype(&class.prototype)).collect();
        if area.has_transit() {
            roles.push(Role::Transit);
        }
        roles.push(Role::Unknown);
        let mut names: Vec<String> =
            area.class_names().into_iter().map(|class| class.name).collect();
        names.push("unknown".to_owned());
        Self { roles, names }
    }

    /// Number of classes, `unknown` not counted; also the slot of `unknown`.
    pub(crate) fn classes(&self) -> usize {
        self.roles.len() - 1
    }

    /// Slot of a class id of a class map: an id that the area does not have says nothing.
    pub(crate) fn slot(&self, id: u8) -> u8 {
        usize::from(id).min(self.classes()) as u8
    }

    pub(crate) fn role(&self, slot: u8) -> Role {
        self.roles[usize::from(slot).min(self.classes())]
    }

    pub(crate) fn name(&self, slot: u8) -> &str {
        &self.names[usize::from(slot).min(self.classes())]
    }

    pub(crate) fn names(&self) -> &[String] {
        &self.names[..self.classes()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn roles_follow_from_the_prototypes_of_every_preset() {
        use Role::*;
        assert_eq!(Role::of_prototype(&[0.0, 0.0, 0.0]), Empty);
        assert_eq!(Role::of_prototype(&[1.0, 0.0, 0.0]), Passing);
        assert_eq!(Role::of_prototype(&[1.0, 1.0, 0.0]), Lingering);
        assert_eq!(Role::of_prototype(&[0.0, 1.0, 0.0]), Lingering, "onehot");
        assert_eq!(Role::of_prototype(&[0.0, 0.0, 1.0]), Vacated);
        assert_eq!(Role::of_prototype(&[1.0, 1.0, 1.0]), Fixed);
        assert_eq!(Role::of_prototype(&[1.0]), Fixed, "a single timescale");
        assert_eq!(Role::of_prototype(&[0.0]), Empty);
    }
}
