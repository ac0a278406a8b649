//! Faults: whatever is killed, stopped, full or left over, the site goes on, or says why not.
//!
//! | where | what is broken |
//! |---|---|
//! | `life` | start, stop, the second instance, a supervisor that is killed and what it leaves |
//! | `kills` | SIGKILL: each service in turn, and anybody at any moment |
//! | `hang` | processes that do not answer |
//! | `events`, `feed` | who tells is killed while there is something to tell |
//! | `removed` | files of a site that runs are removed; a second site on its state |
//! | `recorder` | a recorder that is killed, or has no room |
//! | `bridge` | two hosts: bridges that are killed, a desk that was away; three say what one says |
//! | `clients` | programs in Python that share no code with us |
//! | `cost` | nothing: what crosses is held against what `tog check` says |
//! | `lan` | three hosts, links that are cut, four lasers at 75 Hz |
//! | `upgrade` | hosts of two versions |
//! | `router` | a desk that is a client of two hosts |
//! | `lost_state` | a host whose state is lost, or restored from a backup: its desk goes on |
//! | `look` | the ways to look at a running site: the building, Prometheus, a terminal |
//! | `doctor` | what `tog doctor` says, before and while a site runs |
//! | `systemd` | what systemd is told, and what the unit says |
//! | `overhead` | nothing: what the bridges add to zenoh is measured |
//! | `standby` | a host that is lost: its area goes on elsewhere |
//! | `views` | frames and maps of an area at a host that follows it |
//! | `intruder` | hosts with certificates, and who has none, or the wrong one |
//! | `disk`, `damage` | a full disk, damaged files, a state directory that cannot be |
//!
//! `TOG_NIGHTLY=1` runs the long variants (400 kills: five minutes), `TOG_SEED=n` other moments. The full
//! disk needs the right to mount, else that test says that it is skipped.

mod bridge;
mod clients;
mod cost;
mod damage;
mod disk;
mod doctor;
mod events;
mod feed;
mod hang;
mod intruder;
mod kills;
mod lan;
mod life;
mod look;
mod lost_state;
mod overhead;
mod recorder;
mod removed;
mod router;
mod standby;
mod systemd;
mod upgrade;
mod views;

/// Two lasers of a small room, one area, everything else as it is by default.
pub const ROOM: &str = r#"
name = "t"
timezone = "UTC"
state_dir = "state"

[[area]]
id = "room"
origin_m = [-0.5, -0.5]
cell_m = 0.1
columns = 110
rows = 100
checkpoint_s = 1
timescales_s = [1, 2, 4]   # known, and counted, within seconds

[[laser]]
id = "south"
area = "room"
x_m = 4.6
y_m = 0.2
yaw_deg = 90
source = { kind = "simulator", scene = "room", seed = 1 }

[[laser]]
id = "north"
area = "room"
x_m = 5.2
y_m = 8.8
yaw_deg = -90
source = { kind = "simulator", scene = "room", seed = 1 }
"#;

/// The processes of [`ROOM`].
pub const SERVICES: [&str; 6] =
    ["alerts", "anomaly room", "mapper room", "fusion room", "laser south", "laser north"];

/// An ignored test of this suite, such as `intruder::the_one_who_asks`, in a process of its own that shows what
/// it prints.
fn process_of(test: &str) -> std::process::Command {
    let mut command = std::process::Command::new(std::env::current_exe().unwrap());
    let name = format!("system::{test}");
    command.args(["--exact", name.as_str(), "--ignored", "--nocapture"]);
    command
}
