//! The flips of the longest timescale, frame by frame: all that has to be remembered of the past.
//!
//! One log serves all timescales; each has a cursor that follows N_k frames behind. Memory is 4 B a
//! flip in blocks that are reused, and 16 B a frame that has flips.

use crate::flip::Flip;
use std::collections::VecDeque;

/// Flips of a block: 16 kB, small against any log, large against its pointer.
const BLOCK_FLIPS: u64 = 4096;
/// Free blocks that are kept for reuse: 1 MB. More came from a mass change (a laser lost, a gap)
/// and go back to the allocator.
const SPARE_BLOCKS_MAX: usize = 64;

/// Flips are addressed by their number since the start of the log.
#[derive(Debug, Clone, Default)]
pub(crate) struct FlipLog {
    frames: VecDeque<LoggedFrame>,
    first_frame: u64,
    blocks: VecDeque<Box<[Flip]>>,
    first_block: u64,
    spare: Vec<Box<[Flip]>>,
    end: u64,
    /// `end` at the last end of a frame.
    frame_start: u64,
}

/// A frame that has flips.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LoggedFrame {
    /// Frame number modulo 2^32.
    pub(crate) tick: u32,
    /// Number of the flip behind its last one.
    pub(crate) end: u64,
}

/// Where one timescale has got to: all before it has left the window.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Cursor {
    frame: u64,
    flip: u64,
}

impl FlipLog {
    #[inline]
    pub(crate) fn push(&mut self, flip: Flip) {
        let offset = (self.end % BLOCK_FLIPS) as usize;
        if offset == 0 {
            let new_block = || vec![Flip::default(); BLOCK_FLIPS as usize].into_boxed_slice();
            self.blocks.push_back(self.spare.pop().unwrap_or_else(new_block));
        }
        if let Some(block) = self.blocks.back_mut() {
            block[offset] = flip;
        }
        self.end += 1;
    }

    /// Ends the frame: the flips pushed since the last call are those of frame `tick`.
    pub(crate) fn end_frame(&mut self, tick: u32) {
        if self.end > self.frame_start {
            self.frames.push_back(LoggedFrame { tick, end: self.end });
            self.frame_start = self.end;
        }
    }

    /// The next frame behind a cursor, if it is in the log.
    pub(crate) fn frame_at(&self, cursor: Cursor) -> Option<LoggedFrame> {
        self.frames.get((cursor.frame - self.first_frame) as usize).copied()
    }

    /// The flips between a cursor and the end of its frame.
    pub(crate) fn flips(
        &self,
        cursor: Cursor,
        frame: LoggedFrame,
    ) -> impl Iterator<Item = &[Flip]> {
        let mut from = cursor.flip;
        std::iter::from_fn(move || {
            if from == frame.end {
                return None;
            }
            let block = self.blocks.get((from / BLOCK_FLIPS - self.first_block) as usize)?;
            let to = frame.end.min((from / BLOCK_FLIPS + 1) * BLOCK_FLIPS);
            let offset = (from % BLOCK_FLIPS) as usize;
            let slice = block.get(offset..offset + (to - from) as usize)?;
            from = to;
            Some(slice)
        })
    }

    /// Forgets what is before the last of the cursors.
    pub(crate) fn release(&mut self, cursors: &[Cursor]) {
        let frame = cursors.iter().map(|cursor| cursor.frame).min().unwrap_or(0);
        let flip = cursors.iter().map(|cursor| cursor.flip).min().unwrap_or(0);
        while self.first_frame < frame && self.frames.pop_front().is_some() {
            self.first_frame += 1;
        }
        while (self.first_block + 1) * BLOCK_FLIPS <= flip {
            let Some(block) = self.blocks.pop_front() else { break };
            self.first_block += 1;
            if self.spare.len() < SPARE_BLOCKS_MAX {
                self.spare.push(block);
            }
        }
    }

    /// Whether no flip is left in any window.
    pub(crate) fn is_empty(&self) -> bool {
        self.frames.is_empty()
    }

    /// Memory, bytes.
    pub(crate) fn bytes(&self) -> usize {
        (self.blocks.len() + self.spare.len()) * BLOCK_FLIPS as usize * size_of::<Flip>()
            + self.frames.len() * size_of::<LoggedFrame>()
    }
}

impl Cursor {
    /// Steps behind a frame of the log.
    pub(crate) fn pass(&mut self, frame: LoggedFrame) {
        self.frame += 1;
        self.flip = frame.end;
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn a_log_gives_back_what_it_was_given_and_forgets_what_all_cursors_passed() {
        let mut log = FlipLog::default();
        let mut cursors = [Cursor::default(); 2];
        for tick in 0..200_u32 {
            for cell in 0..(tick % 3) * 500 {
                log.push(Flip::new(cell + tick, 0, 1));
            }
            log.end_frame(tick);
            for (cursor, behind) in cursors.iter_mut().zip([5, 20]) {
                while let Some(frame) = log.frame_at(*cursor) {
                    if frame.tick + behind > tick {
                        break;
                    }
                    let cells: Vec<usize> =
                        log.flips(*cursor, frame).flatten().map(|flip| flip.cell()).collect();
                    let first = frame.tick as usize;
                    let count = (frame.tick % 3) as usize * 500;
                    assert_eq!(cells, (first..first + count).collect::<Vec<_>>());
                    cursor.pass(frame);
                }
            }
            log.release(&cursors);
            assert!(log.frames.len() <= 20);
        }
        // 20 frames of 500 flips on average, some blocks at the ends, and the spare ones.
        assert!(log.bytes() < 16 * 16 * 1024, "{}", log.bytes());
    }
}
