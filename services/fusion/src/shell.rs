//! The process of fusion: scans from shared memory, frames into it, deadlines from the site's clock.

use crate::core::{FusionCore, Origin};
use process::{Failure, HealthReporter, Publisher, Receipt, Subscriber, Worker, monotonic_ns};
use protocol::frame::FrameHeader;
use protocol::health::ServiceState;
use protocol::scan::{ScanHeader, ScanView};
use protocol::site::{Area, Laser};
use protocol::time::SECOND_NS;
use protocol::topic;
use protocol::wire::FLAG_END_OF_STREAM;

struct Fusion {
    area: Area,
    /// Index in the site file and laser, in the area's order.
    lasers: Vec<(usize, Laser)>,
    /// Index in the area by index in the site file.
    local: Vec<Option<usize>>,
    core: FusionCore,
    scans: Subscriber<ScanHeader, f32>,
    frames: Publisher<FrameHeader, u64>,
    clock: process::Clock,
    last_number: u64,
    end_told: bool,
    /// Bits of the lasers whose scans are refused, as last told.
    refused: u64,
    lost: u64,
    rate: Rate,
}

/// Frames a second, over the time between two looks.
#[derive(Default)]
struct Rate {
    mono_ns: u64,
    frames: u64,
}

/// Runs fusion of the worker's area until it is asked to stop.
///
/// # Errors
/// If the site does not fit, or shared memory breaks.
pub fn run(worker: &mut Worker) -> Result<(), Failure> {
    let mut fusion = Fusion::open(worker)?;
    loop {
        // Until nothing moves: what is finished with makes room for what comes.
        while fusion.take_scans(&mut worker.health)? | fusion.emit_frames(&mut worker.health)? {}
        fusion.tell_end(&mut worker.health)?;
        fusion.refresh(&mut worker.health);
        let deadline = fusion.core.deadline_ns();
        let deadline = deadline.and_then(|site_ns| fusion.clock.deadline_mono_ns(site_ns));
        if worker.wait(deadline)?.stop {
            return Ok(());
        }
    }
}

impl Fusion {
    fn open(worker: &Worker) -> Result<Self, Failure> {
        let no_area = || Failure::Config("fusion needs --area".to_owned());
        let (index, area) = worker.area().ok_or_else(no_area)?;
        let lasers: Vec<(usize, Laser)> =
            worker.site.lasers_of(&area.id).map(|(index, laser)| (index, laser.clone())).collect();
        let mut local = vec![None; worker.site.lasers.len()];
        for (in_area, (in_site, _)) in lasers.iter().enumerate() {
            local[*in_site] = Some(in_area);
        }
        let clock = worker.instance.clock;
        let models: Vec<&Laser> = lasers.iter().map(|(_, laser)| laser).collect();
        let core = FusionCore::new(area, &models, clock.now_ns());
        let words = area.grid().plane_words();
        Ok(Self {
            core,
            scans: worker.bus.subscriber_with_credit(&topic::scan(&area.id))?,
            frames: worker.bus.publisher(&topic::frame(&area.id, words), index)?,
            area: area.clone(),
            lasers,
            local,
            clock,
            last_number: 0,
            end_told: false,
            refused: 0,
            lost: 0,
            rate: Rate::default(),
        })
    }

    /// Takes every scan that is there; true if there was one.
    fn take_scans(&mut self, health: &mut HealthReporter) -> Result<bool, Failure> {
        let mut any = false;
        while let Some(scan) = self.scans.receive()? {
            any = true;
            let (header, receipt) = (*scan.header(), scan.receipt());
            let local = self.local.get(receipt.source as usize).copied().flatten();
            let Some(laser) = local else {
                health.count("scans_of_no_laser", 1);
                self.scans.finish(&receipt);
                continue;
            };
            if scan.is_end_of_stream() {
                self.core.end(laser);
                self.scans.finish(&receipt);
                continue;
            }
            let origin = Origin {
                laser,
                session: receipt.session,
                seq: receipt.seq,
                published_mono_ns: header.envelope.published_mono_ns,
            };
            let view = ScanView::from_wire(&header, scan.payload());
            let refused = self.core.scan(origin, view, self.clock.now_ns()).err();
            self.note_refusal(laser, refused.map(|error| error.to_string()), health);
        }
        Ok(any)
    }

    fn note_refusal(&mut self, laser: usize, text: Option<String>, health: &mut HealthReporter) {
        let bit = 1u64 << laser;
        if text.is_some() == (self.refused & bit != 0) {
            return;
        }
        self.refused ^= bit;
        let id = &self.lasers[laser].1.id;
        let text = text.map(|text| format!("laser {id}: {text}"));
        health.set_fault(&format!("scan_refused {id}"), text);
    }

    /// Publishes every frame that is complete; true if there was one.
    fn emit_frames(&mut self, health: &mut HealthReporter) -> Result<bool, Failure> {
        let mut any = false;
        while self.frames.may_send() {
            let Some(frame) = self.core.next_frame(self.clock.now_ns()) else { break };
            any = true;
            let words = frame.hit.len();
            let mut loan = self.frames.loan(2 * words)?;
            *loan.header_mut() = FrameHeader {
                number: frame.number,
                period_ns: self.area.lattice().period_ns(),
                lasers_present: frame.lasers_present,
                completed_by_mono_ns: frame.completed_by_mono_ns,
                columns: self.area.columns,
                rows: self.area.rows,
                ..FrameHeader::default()
            };
            let (hit, known) = loan.payload_mut().split_at_mut(words);
            hit.copy_from_slice(frame.hit);
            known.copy_from_slice(frame.known);
            self.last_number = frame.number;
            loan.send();
            health.set_state(ServiceState::Running);
        }
        for origin in self.core.drain_finished() {
            self.scans.finish(&Receipt {
                source: self.lasers[origin.laser].0 as u32,
                session: origin.session,
                seq: origin.seq,
                end_of_stream: false,
            });
        }
        Ok(any)
    }

    /// When all recordings are over and all frames are out, the end is told on.
    fn tell_end(&mut self, health: &mut HealthReporter) -> Result<(), Failure> {
        if self.end_told || !self.core.is_over() || !self.frames.may_send() {
            return Ok(());
        }
        let mut header = FrameHeader { number: self.last_number, ..FrameHeader::default() };
        header.envelope.flags = FLAG_END_OF_STREAM;
        self.frames.send(header, &[])?;
        self.end_told = true;
        health.set_state(ServiceState::Ended);
        Ok(())
    }

    fn refresh(&mut self, health: &mut HealthReporter) {
        let (counts, losses) = (self.core.counts(), self.scans.losses());
        for (name, total) in [
            ("scans_in", counts.scans_in),
            ("scans_lost", losses.lost),
            ("scans_late", counts.scans_late),
            ("scans_out_of_order", counts.scans_out_of_order),
            ("scans_from_the_future", counts.scans_from_the_future),
            ("scans_queue_full", counts.scans_queue_full),
            ("scans_refused", counts.scans_refused),
            ("scans_superseded", counts.scans_superseded),
            ("frames_out", counts.frames_out),
            ("frames_by_deadline", counts.frames_by_deadline),
            ("frames_skipped", counts.frames_skipped),
        ] {
            health.set_count(name, total);
        }
        let now_mono_ns = monotonic_ns();
        let passed_ns = now_mono_ns - self.rate.mono_ns;
        if passed_ns >= SECOND_NS {
            let frames = counts.frames_out - self.rate.frames;
            health.gauge("frame_rate_hz", frames as f64 * 1e9 / passed_ns as f64);
            self.rate = Rate { mono_ns: now_mono_ns, frames: counts.frames_out };
        }
        self.note_lost(health);
    }

    fn note_lost(&mut self, health: &mut HealthReporter) {
        let lost = if self.end_told { 0 } else { self.core.lost(self.clock.now_ns()) };
        let changed = lost ^ self.lost;
        self.lost = lost;
        for (laser, (_, model)) in self.lasers.iter().enumerate() {
            if changed >> laser & 1 == 0 {
                continue;
            }
            let (id, after_ms) = (&model.id, self.area.laser_lost_ms);
            let text = format!(
                "laser {id} has delivered nothing for more than {after_ms} ms; frames go on without \
                 it: check its power and its cable"
            );
            let silent = lost >> laser & 1 == 1;
            health.set_fault(&format!("laser_silent {id}"), silent.then_some(text));
        }
    }
}
