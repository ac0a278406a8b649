//! Which areas run on this host now: told by its bridge, obeyed by its supervisor.

use serde::{Deserialize, Serialize};

/// Whether an area runs here.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct AreaOwnership {
    /// The area's id.
    pub area: String,
    /// True if its services are to run on this host.
    pub runs: bool,
}

/// The areas that have a standby, all of them in each message; the others always run where the site
/// file says.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Ownership {
    /// One an area.
    pub areas: Vec<AreaOwnership>,
}
