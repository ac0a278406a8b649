//! A calendar of cells: which of them are due for a look at their class, frame by frame.
//!
//! A ring of [`SLOTS`] days, each a chain of chunks from one pool. Entries are not taken back: who
//! drains a day compares with the due frame that the cell itself holds.

/// Days of the ring: an entry lies less than this ahead. Cells that are due later are looked at
/// once in 4095 frames, which is cheap and always right.
pub(crate) const SLOTS: u32 = 4096;
/// Cells of a chunk: with its header a cache line.
const CHUNK_CELLS: usize = 14;
const NONE: u32 = u32::MAX;

#[derive(Debug, Clone)]
pub(crate) struct Calendar {
    heads: Vec<u32>,
    chunks: Vec<Chunk>,
    free: u32,
    entries: usize,
}

#[derive(Debug, Clone)]
struct Chunk {
    next: u32,
    len: u32,
    cells: [u32; CHUNK_CELLS],
}

impl Calendar {
    pub(crate) fn new() -> Self {
        Self { heads: vec![NONE; SLOTS as usize], chunks: Vec::new(), free: NONE, entries: 0 }
    }

    /// Enters a cell for frame `tick`, which is less than [`SLOTS`] frames ahead.
    #[inline]
    pub(crate) fn enter(&mut self, tick: u32, cell: u32) {
        let slot = (tick % SLOTS) as usize;
        let mut head = self.heads[slot];
        if head == NONE || self.chunks[head as usize].len as usize == CHUNK_CELLS {
            head = self.new_chunk(head);
            self.heads[slot] = head;
        }
        let chunk = &mut self.chunks[head as usize];
        chunk.cells[chunk.len as usize % CHUNK_CELLS] = cell;
        chunk.len += 1;
        self.entries += 1;
    }

    fn new_chunk(&mut self, next: u32) -> u32 {
        let chunk = Chunk { next, len: 0, cells: [0; CHUNK_CELLS] };
        if self.free == NONE {
            self.chunks.push(chunk);
            return (self.chunks.len() - 1) as u32;
        }
        let index = self.free;
        self.free = self.chunks[index as usize].next;
        self.chunks[index as usize] = chunk;
        index
    }

    /// Moves the entries of frame `tick` to `due`.
    pub(crate) fn drain(&mut self, tick: u32, due: &mut Vec<u32>) {
        let mut index = std::mem::replace(&mut self.heads[(tick % SLOTS) as usize], NONE);
        while index != NONE {
            let chunk = &mut self.chunks[index as usize];
            due.extend_from_slice(&chunk.cells[..chunk.len as usize]);
            self.entries -= chunk.len as usize;
            let next = chunk.next;
            chunk.next = self.free;
            self.free = index;
            index = next;
        }
    }

    /// Whether nothing is entered.
    pub(crate) fn is_empty(&self) -> bool {
        self.entries == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_cell_comes_back_on_its_day_and_chunks_are_reused() {
        let mut calendar = Calendar::new();
        let mut due = Vec::new();
        for round in 0..10 {
            let start = (u32::MAX - 5).wrapping_add(round * SLOTS); // across the end of u32
            for cell in 0..1000 {
                calendar.enter(start.wrapping_add(cell % 7), cell);
            }
            for day in 0..7 {
                due.clear();
                calendar.drain(start.wrapping_add(day), &mut due);
                due.sort_unstable();
                let expected: Vec<u32> = (0..1000).filter(|cell| cell % 7 == day).collect();
                assert_eq!(due, expected);
            }
            assert!(calendar.is_empty());
        }
        assert!(calendar.chunks.len() <= 7 * 11);
    }
}
