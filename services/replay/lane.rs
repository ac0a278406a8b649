//! The scans of one laser, read and decoded on a thread of their own, a little ahead of the cores.

use laser::replay::ReplaySource;
use laser::source::{Oddity, SourceCounts, SourceError};
use protocol::scan::LaserScan;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

/// Scans handed over at once: waking the other thread costs as much as decoding several.
const BATCH_SCANS: usize = 64;
/// Batches that wait at most: 64 lasers of 4096 beams ahead by this much are 256 MB.
const BATCHES_MAX: usize = 2;

/// A laser of the area, as the cores see it.
pub struct Lane {
    batches: Receiver<Batch>,
    batch: Batch,
    /// Scans of `batch` that were taken.
    taken: usize,
    reader: Option<JoinHandle<()>>,
}

/// Scans one after the other, and how the source stands behind them.
#[derive(Default)]
struct Batch {
    scans: Vec<LaserScan>,
    oddities: Vec<Oddity>,
    counts: SourceCounts,
    end: Option<Result<(), SourceError>>,
}

impl Lane {
    /// Starts to read.
    ///
    /// # Errors
    /// If the system gives no thread.
    pub fn open(source: ReplaySource) -> std::io::Result<Self> {
        let (sender, batches) = sync_channel(BATCHES_MAX);
        let name = "tog-decode".to_owned();
        let reader = std::thread::Builder::new().name(name).spawn(|| read_all(source, sender))?;
        Ok(Self { batches, batch: Batch::default(), taken: 0, reader: Some(reader) })
    }

    /// The next scan; `None` at the end.
    ///
    /// # Errors
    /// What [`ReplaySource::next`] says. Nothing follows an error, nor the end.
    pub fn next(&mut self) -> Result<Option<&LaserScan>, SourceError> {
        while self.taken == self.batch.scans.len() {
            match self.batch.end.take() {
                Some(Err(error)) => return Err(error),
                Some(Ok(())) => return Ok(None),
                None => {}
            }
            self.taken = 0;
            self.batch.scans.clear();
            match self.batches.recv() {
                Ok(batch) => self.batch = batch,
                Err(_) => {
                    self.join();
                    return Ok(None); // behind the end
                }
            }
        }
        self.taken += 1;
        Ok(self.batch.scans.get(self.taken - 1))
    }

    /// The reader is gone: at its end, or by a panic, which goes on here.
    fn join(&mut self) {
        if let Some(Err(panic)) = self.reader.take().map(JoinHandle::join) {
            std::panic::resume_unwind(panic);
        }
    }

    /// Totals of the source, as far as it was read.
    pub fn counts(&self) -> SourceCounts {
        self.batch.counts
    }

    /// What was odd since the last call.
    pub fn take_oddities(&mut self) -> Vec<Oddity> {
        std::mem::take(&mut self.batch.oddities)
    }
}

/// Reads until the end, an error, or until nobody wants more.
fn read_all(mut source: ReplaySource, sender: SyncSender<Batch>) {
    loop {
        let mut batch = Batch { scans: Vec::with_capacity(BATCH_SCANS), ..Batch::default() };
        while batch.scans.len() < BATCH_SCANS && batch.end.is_none() {
            let mut scan = LaserScan::default();
            match source.next(&mut scan) {
                Ok(true) => batch.scans.push(scan),
                Ok(false) => batch.end = Some(Ok(())),
                Err(error) => batch.end = Some(Err(error)),
            }
        }
        (batch.oddities, batch.counts) = (source.take_oddities(), source.counts());
        let ends = batch.end.is_some();
        if sender.send(batch).is_err() || ends {
            return;
        }
    }
}
