//! Which processes a site has on a host, and what each is called.

use protocol::site::Site;
use serde::{Deserialize, Serialize};
use std::fmt;

/// One process of a site.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(tag = "service", rename_all = "snake_case")]
pub enum Role {
    /// The journal and the feed; one a site.
    Alerts,
    /// The way to the other hosts; one a host, if the site has several.
    Bridge,
    /// The recorder; one a site, if the site file asks for it.
    Recorder,
    /// The detector of an area.
    Anomaly {
        /// The area's id.
        area: String,
    },
    /// The grid of an area.
    Mapper {
        /// The area's id.
        area: String,
    },
    /// The lattice of frames of an area.
    Fusion {
        /// The area's id.
        area: String,
    },
    /// One laser.
    Laser {
        /// The laser's id.
        laser: String,
    },
}

impl Role {
    /// The verb of `tog <service>`.
    #[must_use]
    pub fn service(&self) -> &'static str {
        match self {
            Self::Alerts => "alerts",
            Self::Bridge => "bridge",
            Self::Recorder => "recorder",
            Self::Anomaly { .. } => "anomaly",
            Self::Mapper { .. } => "mapper",
            Self::Fusion { .. } => "fusion",
            Self::Laser { .. } => "laser",
        }
    }

    /// The arguments that follow `tog <service> --instance DIR`.
    #[must_use]
    pub fn arguments(&self) -> Vec<String> {
        match self {
            Self::Alerts | Self::Bridge | Self::Recorder => Vec::new(),
            Self::Anomaly { area } | Self::Mapper { area } | Self::Fusion { area } => {
                vec!["--area".to_owned(), area.clone()]
            }
            Self::Laser { laser } => vec!["--laser".to_owned(), laser.clone()],
        }
    }

    /// The role of `tog <service> [--laser ID | --area ID]`.
    ///
    /// # Errors
    /// A sentence if the service is unknown, or lacks its id.
    pub fn from_arguments(
        service: &str,
        laser: Option<&str>,
        area: Option<&str>,
    ) -> Result<Self, String> {
        let the_area = || {
            area.map(str::to_owned).ok_or_else(|| format!("{service} needs --area ID of an area"))
        };
        Ok(match service {
            "alerts" => Self::Alerts,
            "bridge" => Self::Bridge,
            "recorder" => Self::Recorder,
            "anomaly" => Self::Anomaly { area: the_area()? },
            "mapper" => Self::Mapper { area: the_area()? },
            "fusion" => Self::Fusion { area: the_area()? },
            "laser" => {
                Self::Laser { laser: laser.ok_or("laser needs --laser ID of a laser")?.to_owned() }
            }
            other => return Err(format!("{other} is not a service of tog")),
        })
    }

    /// The area that it serves, if it is one of the services of an area.
    #[must_use]
    pub fn area(&self) -> Option<&str> {
        match self {
            Self::Anomaly { area } | Self::Mapper { area } | Self::Fusion { area } => Some(area),
            Self::Alerts | Self::Bridge | Self::Recorder | Self::Laser { .. } => None,
        }
    }

    /// All processes of a site on `host` (none for a site without hosts), those that it runs only as a
    /// standby included, in the order in which they are started: readers before those whose messages
    /// they read, so that the first scan already finds everybody. Its position here is a process's
    /// index as the source of health messages.
    #[must_use]
    pub fn all(site: &Site, host: Option<&str>) -> Vec<Self> {
        let mut roles = vec![Self::Alerts];
        roles.extend(site.has_bridges().then_some(Self::Bridge));
        roles.extend(site.records_on(host).then_some(Self::Recorder));
        for area in site.areas_on(host) {
            roles.push(Self::Anomaly { area: area.id.clone() });
            roles.push(Self::Mapper { area: area.id.clone() });
            roles.push(Self::Fusion { area: area.id.clone() });
        }
        let lasers = site.lasers_on(host);
        roles.extend(lasers.map(|laser| Self::Laser { laser: laser.id.clone() }));
        roles
    }
}

impl fmt::Display for Role {
    /// The name in logs, in health and in `ps`: `fusion foyer`, `laser front`, `alerts`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Alerts => f.write_str("alerts"),
            Self::Bridge => f.write_str("bridge"),
            Self::Recorder => f.write_str("recorder"),
            Self::Anomaly { area } => write!(f, "anomaly {area}"),
            Self::Mapper { area } => write!(f, "mapper {area}"),
            Self::Fusion { area } => write!(f, "fusion {area}"),
            Self::Laser { laser } => write!(f, "laser {laser}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_role_is_the_arguments_that_it_gives() {
        for role in
            [Role::Alerts, Role::Mapper { area: "a".into() }, Role::Laser { laser: "l".into() }]
        {
            let arguments = role.arguments();
            let value = |flag: &str| {
                arguments.iter().position(|a| a == flag).map(|i| arguments[i + 1].as_str())
            };
            let read = Role::from_arguments(role.service(), value("--laser"), value("--area"));
            assert_eq!(read, Ok(role));
        }
        assert!(Role::from_arguments("fusion", None, None).is_err());
        assert!(Role::from_arguments("nonsense", None, None).is_err());
    }
}
