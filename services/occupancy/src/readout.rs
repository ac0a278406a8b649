//! What can be asked of a grid between two steps.

use crate::engine::Engine;

impl<const K: usize> Engine<K> {
    pub(crate) fn classes(&self) -> &[u8] {
        &self.classes
    }

    pub(crate) fn last_number(&self) -> Option<u64> {
        self.last_number
    }

    pub(crate) fn changed_cells(&self) -> &[u32] {
        &self.changed
    }

    pub(crate) fn sum(&self, timescale: usize, cell: usize) -> i32 {
        let tick = self.last_number.unwrap_or(0) as u32;
        self.cells[cell].sum(timescale, self.windows[timescale], tick)
    }

    pub(crate) fn known(&self, cell: usize) -> u32 {
        let tick = self.last_number.unwrap_or(0) as u32;
        self.cells[cell].known(self.longest, self.windows[self.longest], tick)
    }

    pub(crate) fn occupancy(&self, timescale: usize, cell: usize) -> f64 {
        self.classifier.occupancy(timescale, self.sum(timescale, cell))
    }

    pub(crate) fn collapsed(&self, context: usize, out: &mut [u64]) {
        let next = self.last_number.map_or(0, |last| (last as u32).wrapping_add(1));
        self.map.read(context, &self.classes, next, out);
    }

    pub(crate) fn add_collapsed(&mut self, context: usize, counts: &[u64]) {
        self.map.add(context, counts);
    }

    pub(crate) fn history_bytes(&self) -> usize {
        self.log.bytes()
    }
}
