//! The common log: lines of all processes, each with its name, on our stderr.
//!
//! A terminal that somebody stopped (Ctrl-S) must not stop the site: a thread of its own writes, and
//! what does not fit into its queue is dropped and counted.

use process::logging::time_of_day;
use process::wall_ns;
use std::collections::VecDeque;
use std::io::{IsTerminal, Write};
use std::sync::mpsc::{Receiver, SyncSender, channel, sync_channel};
use std::time::Duration;

/// Lines that wait for a slow terminal: some seconds of a chatty site, some 100 kB.
const QUEUE_LINES: usize = 1024;
/// Longest line that is shown; what follows is cut.
pub const LINE_BYTES_MAX: usize = 4096;
/// Lines of a process that are kept as its last words.
pub const LAST_WORDS_MAX: usize = 20;
/// How long the end waits for the terminal.
const FLUSH_PATIENCE: Duration = Duration::from_secs(1);

/// The writer of the common log.
#[derive(Debug)]
pub struct Output {
    queue: Option<SyncSender<String>>,
    finished: Receiver<()>,
    dropped: u64,
    colour: bool,
    width: usize,
}

impl Output {
    /// A log on stderr, with colours if that is a terminal; names are padded to `width`.
    #[must_use]
    pub fn new(width: usize) -> Self {
        let (queue, lines) = sync_channel::<String>(QUEUE_LINES);
        let (done, finished) = channel();
        std::thread::spawn(move || {
            let mut stderr = std::io::stderr();
            for line in lines {
                let _ = stderr.write_all(line.as_bytes()); // nobody is left to be told
            }
            let _ = done.send(());
        });
        let colour = std::io::stderr().is_terminal();
        Self { queue: Some(queue), finished, dropped: 0, colour, width }
    }

    /// Writes a line of the process `name`, the `index`-th of the site (its colour).
    pub fn line(&mut self, index: usize, name: &str, text: &str) {
        let width = self.width;
        let time = time_of_day(wall_ns());
        let mut line = if self.colour {
            let colour = 31 + (index + 5) % 6;
            format!("\x1b[2m{time}\x1b[0m \x1b[{colour}m{name:width$}\x1b[0m {text}\n")
        } else {
            format!("{time} {name:width$} {text}\n")
        };
        if self.dropped > 0 {
            line.insert_str(
                0,
                &format!("{time} ({} lines dropped: stderr is slow)\n", self.dropped),
            );
        }
        let sent = self.queue.as_ref().is_some_and(|queue| queue.try_send(line).is_ok());
        self.dropped = if sent { 0 } else { self.dropped + 1 };
    }

    /// Writes a line of the supervisor itself.
    pub fn say(&mut self, text: &str) {
        self.line(0, "supervisor", text);
    }
}

impl Drop for Output {
    fn drop(&mut self) {
        self.queue = None;
        let _ = self.finished.recv_timeout(FLUSH_PATIENCE);
    }
}

/// Cuts the bytes of a pipe into lines, and keeps the last ones.
#[derive(Debug, Default)]
pub struct Lines {
    unfinished: Vec<u8>,
    last_words: VecDeque<String>,
}

impl Lines {
    /// Takes bytes, and hands every complete line on.
    pub fn take(&mut self, bytes: &[u8], mut line: impl FnMut(&str)) {
        for part in bytes.split_inclusive(|&byte| byte == b'\n') {
            let room = LINE_BYTES_MAX.saturating_sub(self.unfinished.len());
            let text = part.strip_suffix(b"\n").unwrap_or(part);
            self.unfinished.extend_from_slice(&text[..text.len().min(room)]);
            if part.ends_with(b"\n") {
                self.finish(&mut line);
            }
        }
    }

    /// The pipe is closed: what is unfinished is a line as well.
    pub fn end(&mut self, mut line: impl FnMut(&str)) {
        if !self.unfinished.is_empty() {
            self.finish(&mut line);
        }
    }

    fn finish(&mut self, line: &mut impl FnMut(&str)) {
        // A terminal obeys control characters; a log line is only text.
        let text = String::from_utf8_lossy(&self.unfinished).replace(char::is_control, " ");
        let text = text.trim_end().to_owned();
        line(&text);
        if self.last_words.len() == LAST_WORDS_MAX {
            self.last_words.pop_front();
        }
        self.last_words.push_back(text);
        self.unfinished.clear();
    }

    /// The last lines.
    pub fn last_words(&self) -> impl Iterator<Item = &str> {
        self.last_words.iter().map(String::as_str)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_whole_however_the_pipe_cuts_them() {
        let (mut lines, mut seen) = (Lines::default(), Vec::new());
        for part in ["one\ntw", "o", "\nthr", "ee"] {
            lines.take(part.as_bytes(), |line| seen.push(line.to_owned()));
        }
        lines.end(|line| seen.push(line.to_owned()));
        assert_eq!(seen, ["one", "two", "three"]);
    }

    #[test]
    fn a_line_without_end_is_cut_and_only_the_last_words_are_kept() {
        let mut lines = Lines::default();
        for _ in 0..100 {
            lines.take(&[b'x'; 1000], |_| panic!("there is no end of line"));
        }
        let mut length = 0;
        lines.take(b"\n", |line| length = line.len());
        assert_eq!(length, LINE_BYTES_MAX);
        for number in 0..100 {
            lines.take(format!("{number}\n").as_bytes(), |_| {});
        }
        assert_eq!(lines.last_words().count(), LAST_WORDS_MAX);
        assert_eq!(lines.last_words().last(), Some("99"));
    }
}
