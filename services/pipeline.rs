//! The cores of one area, chained in one thread: fusion -> mapper -> anomaly. What the services do in
//! processes of their own, `tog replay` and the fast-forward of `tog demo` do here.

use anomaly::{ClassFrame, Watch};
use fusion::core::FusionCore;
use mapper::context::ContextError;
use mapper::core::MapperCore;
use protocol::event::EventChange;
use protocol::site::{Area, Laser, Site};

/// The cores of one area.
pub struct Pipeline {
    /// The area.
    pub area: Area,
    /// Its lasers, in the area's order.
    pub lasers: Vec<Laser>,
    /// Scans to frames.
    pub fusion: FusionCore,
    /// Frames to classes and counts.
    pub mapper: MapperCore,
    /// Classes to events.
    pub watch: Watch,
}

impl Pipeline {
    /// The cores of an area of the site, without a clock.
    ///
    /// # Errors
    /// If a context of the area is not valid.
    pub fn new(site: &Site, area_index: usize) -> Result<Self, ContextError> {
        let area = site.areas[area_index].clone();
        let lasers: Vec<Laser> = site.lasers_of(&area.id).map(|(_, laser)| laser.clone()).collect();
        Ok(Self {
            fusion: FusionCore::new(&area, &lasers.iter().collect::<Vec<_>>(), None),
            mapper: MapperCore::new(&area, &site.timezone)?,
            watch: Watch::new(&area, &lasers),
            area,
            lasers,
        })
    }

    /// Passes on every frame that is complete. `step` is called with the number and the classes of
    /// each frame; changes of events are appended to `changes`.
    pub fn run_frames(&mut self, changes: &mut Vec<EventChange>, mut step: impl FnMut(u64, &[u8])) {
        while let Some(frame) = self.fusion.next_frame(None) {
            let context = self.mapper.context_of(frame.number);
            let changed = Some(frame.changed_cells);
            let mut steps = 0;
            self.mapper.frame(frame.view(), changed, |number, grid| {
                steps += 1;
                step(number, grid.classes());
            });
            let class_frame = ClassFrame {
                number: frame.number,
                lasers_present: frame.lasers_present,
                context,
                classes: self.mapper.grid().classes(),
            };
            // The list is of one step of the grid, and frames that never came are steps as well.
            if steps == 1 {
                let changed = self.mapper.grid().changed_cells();
                self.watch.handle_changed(&class_frame, changed, changes);
            } else {
                self.watch.handle(&class_frame, changes);
            }
        }
        self.fusion.drain_finished().for_each(drop);
    }
}
