//! Collapsing the grid (paper, 3.2): in how many frames each cell had each class.
//!
//! Here: kept per context, and by run length: a cell is counted when its class changes, with the
//! number of frames that it had the class; a reader adds the runs that are still open.

use protocol::grid::CLASS_UNKNOWN;

/// Counts of all contexts, and where the open run of each cell began.
#[derive(Debug, Clone)]
pub(crate) struct CollapsedMap {
    cells: usize,
    /// Per context [class, cell]; empty until the context is used.
    counts: Vec<Vec<u64>>,
    classes: usize,
    context: usize,
    /// First frame of the open run, modulo 2^32. Runs are closed long before they are that long.
    since: Vec<u32>,
}

impl CollapsedMap {
    pub(crate) fn new(cells: usize, classes: usize, contexts: usize) -> Self {
        Self {
            cells,
            counts: vec![Vec::new(); contexts],
            classes,
            context: 0,
            since: vec![0; cells],
        }
    }

    fn counts_of(&mut self, context: usize) -> &mut [u64] {
        let size = self.classes * self.cells;
        let counts = &mut self.counts[context];
        if counts.is_empty() {
            counts.resize(size, 0);
        }
        counts
    }

    /// All runs begin at this frame.
    pub(crate) fn start(&mut self, tick: u32) {
        self.since.fill(tick);
    }

    /// A cell had `class` up to the frame before `tick`.
    #[inline]
    pub(crate) fn end_run(&mut self, cell: usize, class: u8, tick: u32) {
        let frames = tick.wrapping_sub(self.since[cell]);
        self.since[cell] = tick;
        if class != CLASS_UNKNOWN {
            let index = usize::from(class) * self.cells + cell;
            self.counts_of(self.context)[index] += u64::from(frames);
        }
    }

    /// Closes all runs before frame `tick`, and counts `extra` more frames of the same classes;
    /// the next runs begin `extra` frames after `tick`.
    pub(crate) fn settle(&mut self, classes: &[u8], tick: u32, extra: u64) {
        for (cell, &class) in classes.iter().enumerate() {
            self.end_run(cell, class, tick);
            if extra > 0 && class != CLASS_UNKNOWN {
                let index = usize::from(class) * self.cells + cell;
                self.counts_of(self.context)[index] += extra;
            }
        }
        self.start(tick.wrapping_add(extra as u32));
    }

    /// Frames from `tick` on belong to this context.
    pub(crate) fn enter_context(&mut self, context: usize, classes: &[u8], tick: u32) {
        debug_assert!(context < self.counts.len(), "context {context} of {}", self.counts.len());
        let context = context.min(self.counts.len() - 1);
        if context != self.context {
            self.settle(classes, tick, 0);
            self.context = context;
        }
    }

    /// Counts up to the frame before `tick`.
    pub(crate) fn read(&self, context: usize, classes: &[u8], tick: u32, out: &mut [u64]) {
        match self.counts.get(context) {
            Some(counts) if !counts.is_empty() => {
                for (out, &count) in out.iter_mut().zip(counts) {
                    *out = count;
                }
            }
            _ => out.fill(0),
        }
        if context != self.context {
            return;
        }
        for (cell, &class) in classes.iter().enumerate() {
            if class != CLASS_UNKNOWN
                && let Some(out) = out.get_mut(usize::from(class) * self.cells + cell)
            {
                *out += u64::from(tick.wrapping_sub(self.since[cell]));
            }
        }
    }

    pub(crate) fn add(&mut self, context: usize, counts: &[u64]) {
        if context < self.counts.len() {
            for (sum, &count) in self.counts_of(context).iter_mut().zip(counts) {
                *sum = sum.saturating_add(count);
            }
        }
    }
}
