//! The process of the mapper: frames from shared memory, class maps and collapsed maps into it,
//! checkpoints to disk by a thread of their own, so that no frame waits for a disk.

use crate::checkpoint::{self, Checkpoint, CheckpointError};
use crate::core::{MapperCore, Taken};
use crate::results::{Results, Rows};
use process::{Failure, HealthReporter, Publisher, Sample, Subscriber, Worker, monotonic_ns};
use protocol::frame::{FrameHeader, FrameView};
use protocol::grid::{ClassMapHeader, CollapsedMapHeader};
use protocol::health::ServiceState;
use protocol::site::Area;
use protocol::time::SECOND_NS;
use protocol::topic;
use protocol::wire::FLAG_END_OF_STREAM;
use std::path::{Path, PathBuf};
use std::sync::mpsc;
use std::thread::JoinHandle;

/// The last frame of a stream, as its end is told on.
struct Ended {
    number: u64,
}

struct Mapper {
    area: Area,
    core: MapperCore,
    classes: Publisher<ClassMapHeader, u8>,
    collapsed: Publisher<CollapsedMapHeader, u64>,
    frames: Subscriber<FrameHeader, u64>,
    results: Option<Results>,
    counts: Vec<u64>,
    ended: Option<Ended>,
    end_told: bool,
}

/// Where an area's checkpoint lies.
#[must_use]
pub fn checkpoint_path(state_dir: &Path, area: &str) -> PathBuf {
    state_dir.join(format!("{area}.map"))
}

/// Runs the mapper of the worker's area until it is asked to stop.
///
/// # Errors
/// If the site does not fit, shared memory breaks, or the state directory cannot be used.
pub fn run(worker: &mut Worker) -> Result<(), Failure> {
    let mut mapper = Mapper::open(worker)?;
    let path = checkpoint_path(&worker.instance.state_dir, &mapper.area.id);
    mapper.restore(&path, &mut worker.health)?;
    // As a checkpoint that failed: the first that is written clears it.
    let shortage = process::state_lock::shortage(&worker.instance.state_dir);
    worker.health.set_fault("checkpoint_failed", shortage);
    let mut writer = Writer::start(path)?;
    let period_ns = (mapper.area.checkpoint_s * SECOND_NS as f64) as u64;
    let mut due_mono_ns = monotonic_ns() + period_ns;
    mapper.publish_collapsed()?;
    loop {
        mapper.take_frames(&mut worker.health)?;
        mapper.tell_end(&mut worker.health)?;
        if monotonic_ns() >= due_mono_ns {
            due_mono_ns = monotonic_ns() + period_ns;
            writer.write(mapper.core.checkpoint(), &mut worker.health);
            mapper.publish_collapsed()?;
        }
        writer.report(&mut worker.health);
        mapper.collapsed.serve_late_readers();
        mapper.refresh(&mut worker.health);
        if worker.wait(Some(due_mono_ns))?.stop {
            break;
        }
    }
    writer.finish(mapper.core.checkpoint(), &mut worker.health);
    Ok(())
}

impl Mapper {
    fn open(worker: &Worker) -> Result<Self, Failure> {
        let no_area = || Failure::Config("a mapper needs --area".to_owned());
        let (index, area) = worker.area().ok_or_else(no_area)?;
        let grid = area.grid();
        let classes = area.class_names().len();
        let core = MapperCore::new(area, &worker.site.timezone)
            .map_err(|error| Failure::Config(error.to_string()))?;
        let results = worker.instance.out_dir.as_ref().map(|directory| {
            let several = worker.site.areas.len() > 1;
            let directory = if several { directory.join(&area.id) } else { directory.clone() };
            Results::create(&directory, area, Rows::EveryFrame).map_err(|error| {
                let directory = directory.display();
                Failure::Failed(format!("cannot write the results to {directory}: {error}"))
            })
        });
        let bus = &worker.bus;
        Ok(Self {
            area: area.clone(),
            core,
            classes: bus.publisher(&topic::classes(&area.id, grid.cells()), index)?,
            collapsed: bus.publisher(&topic::collapsed(&area.id, grid.cells(), classes), index)?,
            frames: bus.subscriber_with_credit(&topic::frame(&area.id, grid.plane_words()))?,
            results: results.transpose()?,
            counts: vec![0; grid.cells() * classes],
            ended: None,
            end_told: false,
        })
    }

    /// Goes on from the checkpoint, or says why not and keeps it aside.
    fn restore(&mut self, path: &Path, health: &mut HealthReporter) -> Result<(), Failure> {
        let read = checkpoint::read(
            path,
            &self.core.describe(),
            checkpoint::body_bytes_max(self.core.grid().config()),
        );
        let problem = match read {
            Ok(None) => return Ok(()),
            Ok(Some(checkpoint)) => match self.core.restore(&checkpoint) {
                Ok(()) => {
                    tracing::info!("goes on from {}", path.display());
                    return Ok(());
                }
                Err(error) => format!("checkpoint {}: {error}", path.display()),
            },
            Err(error @ CheckpointError::Io { .. }) => {
                return Err(Failure::Failed(error.to_string()));
            }
            Err(error) => error.to_string(),
        };
        let aside = checkpoint::keep_aside(path, process::wall_ns())
            .map_err(|error| Failure::Failed(error.to_string()))?;
        let text = format!(
            "{problem}; it is kept as {}, and this area counts from zero: put a good copy back and \
             restart, or delete it",
            aside.display()
        );
        health.fault("checkpoint_unusable", text);
        Ok(())
    }

    fn take_frames(&mut self, health: &mut HealthReporter) -> Result<(), Failure> {
        while self.classes.may_send() {
            let Some(frame) = self.frames.receive()? else { break };
            self.frame(&frame, health)?;
            self.frames.finish(&frame.receipt());
        }
        Ok(())
    }

    fn frame(
        &mut self,
        frame: &Sample<FrameHeader, u64>,
        health: &mut HealthReporter,
    ) -> Result<(), Failure> {
        let header = *frame.header();
        if frame.is_end_of_stream() {
            self.ended = Some(Ended { number: header.number });
            return Ok(());
        }
        let words = self.area.grid().plane_words();
        let view = FrameView::from_wire(header.number, frame.payload(), words);
        let fits = header.columns == self.area.columns && header.rows == self.area.rows;
        let (Some(view), true) = (view, fits) else {
            health.count("frames_refused", 1);
            let (found_c, found_r) = (header.columns, header.rows);
            let (columns, rows) = (self.area.columns, self.area.rows);
            let text = format!(
                "a frame of {found_c} x {found_r} cells came, expected {columns} x {rows}: dropped"
            );
            health.fault("frame_refused", text);
            return Ok(());
        };
        let results = &mut self.results;
        let mut written = Ok(());
        let taken = self.core.frame(view, None, |number, grid| {
            if let (Some(results), true) = (results.as_mut(), written.is_ok()) {
                written = results.step(number, grid.classes());
            }
        });
        written.map_err(|error| Failure::Failed(format!("cannot write the results: {error}")))?;
        if taken == Taken::Yes {
            self.publish_classes(&header)?;
            health.set_state(ServiceState::Running);
        }
        Ok(())
    }

    fn publish_classes(&mut self, frame: &FrameHeader) -> Result<(), Failure> {
        let context = self.core.context_of(frame.number) as u32;
        let classes = self.core.grid().classes();
        let mut loan = self.classes.loan(classes.len())?;
        *loan.header_mut() = ClassMapHeader {
            number: frame.number,
            period_ns: frame.period_ns,
            lasers_present: frame.lasers_present,
            completed_by_mono_ns: frame.completed_by_mono_ns,
            context,
            classes: self.core.grid().config().classes() as u32,
            columns: frame.columns,
            rows: frame.rows,
            ..ClassMapHeader::default()
        };
        loan.payload_mut().copy_from_slice(classes);
        loan.send();
        Ok(())
    }

    /// Publishes the collapsed map of every context.
    fn publish_collapsed(&mut self) -> Result<(), Failure> {
        let Some(number) = self.core.grid().last_number() else { return Ok(()) };
        let classes = self.core.grid().config().classes() as u32;
        for context in 0..self.core.context_names().len() {
            self.core.grid().collapsed(context, &mut self.counts);
            let header = CollapsedMapHeader {
                number,
                period_ns: self.area.lattice().period_ns(),
                context: context as u32,
                classes,
                columns: self.area.columns,
                rows: self.area.rows,
                ..CollapsedMapHeader::default()
            };
            self.collapsed.send(header, &self.counts)?;
        }
        Ok(())
    }

    /// When the stream is over: the results are finished, and the end is told on.
    fn tell_end(&mut self, health: &mut HealthReporter) -> Result<(), Failure> {
        let Some(ended) = &self.ended else { return Ok(()) };
        if self.end_told || !self.classes.may_send() {
            return Ok(());
        }
        if let Some(results) = self.results.take() {
            results
                .finish(self.core.grid(), &self.core.context_names())
                .map_err(|error| Failure::Failed(format!("cannot write the results: {error}")))?;
        }
        let number = ended.number;
        self.publish_collapsed()?; // so that a recorder has the maps of the end
        let mut header = ClassMapHeader { number, ..ClassMapHeader::default() };
        header.envelope.flags = FLAG_END_OF_STREAM;
        self.classes.send(header, &[])?;
        self.end_told = true;
        health.set_state(ServiceState::Ended);
        Ok(())
    }

    fn refresh(&mut self, health: &mut HealthReporter) {
        let (counts, losses) = (self.core.counts(), self.frames.losses());
        health.set_count("frames_in", counts.frames_in);
        health.set_count("frames_missing", counts.frames_missing);
        health.set_count("frames_repeated", counts.frames_repeated);
        health.set_count("frames_lost", losses.lost);
        health.set_count("classes_out", self.classes.sent().messages);
        health.gauge("history_mb", self.core.grid().history_bytes() as f64 / 1e6);
    }
}

/// Writes checkpoints on a thread of its own, one at a time.
struct Writer {
    orders: Option<mpsc::SyncSender<Checkpoint>>,
    outcomes: mpsc::Receiver<Result<(), String>>,
    thread: Option<JoinHandle<()>>,
}

impl Writer {
    fn start(path: PathBuf) -> Result<Self, Failure> {
        // One order waits at most: two whole maps in memory, never more.
        let (orders, waiting) = mpsc::sync_channel::<Checkpoint>(1);
        let (tell, outcomes) = mpsc::channel();
        let thread =
            std::thread::Builder::new().name("checkpoint".to_owned()).spawn(move || {
                for checkpoint in waiting {
                    let written = checkpoint::encode(&checkpoint)
                        .map_err(|error| format!("cannot encode the checkpoint: {error}"))
                        .and_then(|bytes| {
                            checkpoint::write(&path, &bytes).map_err(|error| error.to_string())
                        });
                    if tell.send(written).is_err() {
                        return;
                    }
                }
            })?;
        Ok(Self { orders: Some(orders), outcomes, thread: Some(thread) })
    }

    fn write(&self, checkpoint: Checkpoint, health: &mut HealthReporter) {
        let Some(orders) = &self.orders else { return };
        if orders.try_send(checkpoint).is_err() {
            health.count("checkpoints_skipped", 1); // the disk is slower than the period
        }
    }

    fn report(&mut self, health: &mut HealthReporter) {
        for outcome in self.outcomes.try_iter() {
            match outcome {
                Ok(()) => {
                    health.count("checkpoints_written", 1);
                    health.clear("checkpoint_failed");
                }
                Err(text) => {
                    health.count("checkpoints_failed", 1);
                    health.fault("checkpoint_failed", format!("{text}; the next is tried in time"));
                }
            }
        }
    }

    /// Writes a last checkpoint and waits until it is on disk.
    fn finish(mut self, last: Checkpoint, health: &mut HealthReporter) {
        if let Some(orders) = self.orders.take() {
            let _ = orders.send(last); // fails only if the thread died, which is said below
        }
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            health.fault("checkpoint_failed", "the thread that writes checkpoints died");
        }
        self.report(health);
    }
}
