//! What the bridge says of the areas that run here, and what systemd is told.

use super::{Phase, Supervisor, report};
use crate::notify::{self, Look};
use crate::service::Service;
use process::{Role, monotonic_ns};
use protocol::codec::decode;
use protocol::health::ServiceState;
use protocol::ownership::{AreaOwnership, Ownership};

impl Supervisor {
    /// Tells systemd what is due.
    pub(super) fn notify(&mut self, heard: bool) {
        let now_ns = monotonic_ns();
        let words = match self.phase {
            Phase::Running => self.notifier.words(&self.look, heard, now_ns),
            Phase::Stopping { .. } => self.notifier.stopping(),
        };
        notify::tell(&words);
    }

    /// How the site is, for systemd; looked at once a second.
    pub(super) fn look(&self) -> Look {
        let mut running = self.services.iter().filter(|service| !service.is_held());
        let all_told = running.clone().all(|service| service.state().is_some());
        let flows = |service: &&Service| {
            let data = matches!(service.state(), Some(state) if state != ServiceState::Starting);
            data && matches!(service.role, Role::Mapper { .. })
        };
        let none = !running.clone().any(|service| matches!(service.role, Role::Mapper { .. }));
        let frames = none || running.any(|service| flows(&service));
        let headline = report(&self.services, &self.owner, &self.phase).headline();
        Look { all_told, frames, headline }
    }

    /// Which areas run here, as the bridge says; its last word stands when it is gone.
    pub(super) fn take_ownership(&mut self) {
        let Some(ownership) = &mut self.ownership else { return };
        let mut newest = None;
        while let Ok(Some(message)) = ownership.receive() {
            newest = decode::<Ownership>(message.payload()).ok().or(newest);
        }
        if !matches!(self.phase, Phase::Running) {
            return;
        }
        let now_ns = monotonic_ns();
        for AreaOwnership { area, runs } in newest.into_iter().flat_map(|newest| newest.areas) {
            let of_area = |service: &&mut Service| service.role.area() == Some(area.as_str());
            let mut changed = false;
            for service in self.services.iter_mut().filter(of_area) {
                changed |= service.is_held() == runs;
                match (service.is_held(), runs) {
                    (true, true) => service.let_run(now_ns),
                    (false, false) => service.hold(),
                    _ => {}
                }
            }
            if changed {
                let what = if runs { "runs here now" } else { "runs on another host now" };
                self.output.say(&format!("WARN area {area} {what}"));
            }
        }
    }
}
