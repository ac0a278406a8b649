//! What was found in a site file, where, and how it is drawn.

use super::TEXT_BYTES_MAX;
use super::tree::Node;
use super::words;
use annotate_snippets::{
    Annotation, AnnotationKind, Level, Origin, Renderer, Snippet, normalize_untrusted_str,
};
use serde::Serialize;
use std::fmt;
use std::ops::Range;

/// Most diagnostics that are kept; the rest is counted. Nobody mends more than a screen or two at
/// a time, and a file that is not a site file at all has an error on every line.
pub const DIAGNOSTICS_MAX: usize = 50;
/// Most bytes of the file that are drawn for one diagnostic: lines of a file that a person wrote,
/// between two places that have to do with each other, are fewer.
const EXCERPT_BYTES_MAX: usize = 64 * 1024;

/// How bad it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// The file is refused.
    Error,
    /// The file is read, but this looks like a mistake.
    Warning,
}

/// One thing that is wrong.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Diagnostic {
    /// How bad it is.
    pub severity: Severity,
    /// Line of the value, from 1.
    pub line: usize,
    /// Column of the value, in characters, from 1.
    pub column: usize,
    /// The value: `laser[1].source.rate_hz`; items count from 0; empty for the whole file.
    pub path: String,
    /// One sentence with all of it.
    pub message: String,
    /// What is there.
    pub found: String,
    /// What should be there.
    pub expected: String,
    /// What to do; may have several lines.
    pub help: String,
    #[serde(skip)]
    span: Range<usize>,
    #[serde(skip)]
    related: Vec<(Range<usize>, String)>,
}

/// A diagnostic before its line is known.
#[derive(Debug, Clone)]
pub(super) struct Finding(Diagnostic);

impl Finding {
    fn at(severity: Severity, span: Range<usize>, path: String) -> Self {
        let empty = String::new;
        Self(Diagnostic {
            severity,
            line: 0,
            column: 0,
            path,
            message: empty(),
            found: empty(),
            expected: empty(),
            help: empty(),
            span,
            related: Vec::new(),
        })
    }

    /// `path` is `found`, expected `expected`.
    pub fn error(node: &Node<'_>, found: impl Into<String>, expected: impl Into<String>) -> Self {
        Self::at(Severity::Error, node.span.clone(), node.path.clone()).said(found, expected)
    }

    /// As [`Finding::error`], but the file is read all the same.
    pub fn warning(node: &Node<'_>, found: impl Into<String>, expected: impl Into<String>) -> Self {
        Self::at(Severity::Warning, node.span.clone(), node.path.clone()).said(found, expected)
    }

    fn said(mut self, found: impl Into<String>, expected: impl Into<String>) -> Self {
        (self.0.found, self.0.expected) = (found.into(), expected.into());
        let place = &self.0.path;
        self.0.message = format!("`{place}` is {}, expected {}", self.0.found, self.0.expected);
        self
    }

    /// Another sentence than "`path` is .., expected ..".
    pub fn message(mut self, message: impl Into<String>) -> Self {
        self.0.message = message.into();
        self
    }

    /// What to do.
    pub fn help(mut self, help: impl Into<String>) -> Self {
        self.0.help = help.into();
        self
    }

    /// Another place than that of the node.
    pub fn span(mut self, span: Range<usize>) -> Self {
        self.0.span = span;
        self
    }

    /// A second place that has to do with it.
    pub fn related(mut self, span: Range<usize>, label: impl Into<String>) -> Self {
        self.0.related.push((span, label.into()));
        self
    }

    /// What the TOML parser or serde says.
    pub fn syntax(error: &toml::de::Error) -> Self {
        let message = error.message().trim();
        // The parser says "reason, expected this": the part behind goes under the caret.
        let (found, expected) = match message.rsplit_once(", expected ") {
            Some((found, expected)) if !expected.is_empty() => (found, expected),
            _ => (message, ""),
        };
        let span = error.span().unwrap_or(0..0);
        Self::at(Severity::Error, span, String::new())
            .said(words::shortened(found), words::shortened(expected))
            .message(format!("this is not TOML: {}", words::shortened(message)))
            .help("TOML is described at https://toml.io")
    }

    /// A file larger than any site.
    pub fn too_long(bytes: usize) -> Self {
        Self::at(Severity::Error, 0..0, String::new())
            .said(format!("{bytes} bytes"), format!("at most {TEXT_BYTES_MAX} bytes"))
            .message(format!("the file has {bytes} bytes, a site file at most {TEXT_BYTES_MAX}"))
            .help("is this a site file?")
    }
}

/// All that was found in one file, in the order of the text; draws itself.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Diagnostics {
    file_name: String,
    #[serde(skip)]
    text: String,
    items: Vec<Diagnostic>,
    omitted: usize,
}

impl std::error::Error for Diagnostics {}

impl fmt::Display for Diagnostics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.render(false))
    }
}

impl Diagnostics {
    pub(super) fn new(text: &str, file_name: &str, findings: Vec<Finding>) -> Self {
        let mut items: Vec<Diagnostic> = findings.into_iter().map(|finding| finding.0).collect();
        items.sort_by_key(|item| item.span.start); // stable: the order of the checks stays
        let found = items.len();
        if found > DIAGNOSTICS_MAX {
            items.sort_by_key(|item| item.severity); // a warning never crowds out an error
            items.truncate(DIAGNOSTICS_MAX);
            items.sort_by_key(|item| item.span.start);
        }
        for item in &mut items {
            item.span = on_one_line(text, &item.span);
            for (span, _) in &mut item.related {
                *span = on_one_line(text, span);
            }
            let before = &text[..item.span.start];
            let line_start = before.rfind('\n').map_or(0, |newline| newline + 1);
            item.line = before.matches('\n').count() + 1;
            item.column = before[line_start..].chars().count() + 1;
        }
        let omitted = found - items.len();
        Self { file_name: file_name.to_owned(), text: text.to_owned(), items, omitted }
    }

    /// The diagnostics in the order of the text, at most [`DIAGNOSTICS_MAX`].
    pub fn iter(&self) -> impl Iterator<Item = &Diagnostic> {
        self.items.iter()
    }

    /// How many more there are than [`Diagnostics::iter`] gives.
    #[must_use]
    pub fn omitted(&self) -> usize {
        self.omitted
    }

    /// True if there is nothing to say.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.items.is_empty()
    }

    /// True if the file was refused.
    #[must_use]
    pub fn has_errors(&self) -> bool {
        self.count(Severity::Error) > 0
    }

    fn count(&self, severity: Severity) -> usize {
        self.items.iter().filter(|item| item.severity == severity).count()
    }

    /// Draws all of it for a terminal: the line, a caret, what to do; a summary at the end.
    /// Ends with a newline; empty if there is nothing to say.
    #[must_use]
    pub fn render(&self, colour: bool) -> String {
        if self.is_empty() {
            return String::new();
        }
        let renderer = if colour { Renderer::styled() } else { Renderer::plain() };
        let mut drawn = String::new();
        for item in &self.items {
            drawn.push_str(&self.draw(item, &renderer));
            drawn.push_str("\n\n");
        }
        let file_name = normalize_untrusted_str(&self.file_name);
        drawn.push_str(&format!("{file_name}: {}\n", self.summary()));
        drawn
    }

    fn summary(&self) -> String {
        let of = |count: usize, what: &str| match count {
            1 => format!("1 {what}"),
            _ => format!("{count} {what}s"),
        };
        let errors = (self.count(Severity::Error), "error");
        let warnings = (self.count(Severity::Warning), "warning");
        let counts: Vec<String> = [errors, warnings]
            .into_iter()
            .filter(|(count, _)| *count > 0)
            .map(|(count, what)| of(count, what))
            .collect();
        let more = match self.omitted {
            0 => String::new(),
            omitted => format!("; {omitted} more are not shown"),
        };
        format!("{}{more}", counts.join(", "))
    }

    fn draw(&self, item: &Diagnostic, renderer: &Renderer) -> String {
        let near: Vec<_> = item
            .related
            .iter()
            .filter(|(span, _)| span.start.abs_diff(item.span.start) < EXCERPT_BYTES_MAX)
            .collect();
        let spans = || near.iter().map(|(span, _)| span).chain([&item.span]);
        let from = spans().map(|span| span.start).min().unwrap_or(0);
        let to = spans().map(|span| span.end).max().unwrap_or(0);
        let from = self.text[..from].rfind('\n').map_or(0, |newline| newline + 1);
        let to = self.text[to..].find('\n').map_or(self.text.len(), |newline| to + newline);
        let level = match item.severity {
            Severity::Error => Level::ERROR,
            Severity::Warning => Level::WARNING,
        };
        let title = level.primary_title(&item.message);
        let mut group = if to - from > EXCERPT_BYTES_MAX {
            // A line that nobody can read: only its place is told.
            let place = Origin::path(&self.file_name).line(item.line);
            title.element(place.char_column(item.column))
        } else {
            title.element(self.excerpt(item, &near, from..to))
        };
        if !item.help.is_empty() {
            let lines: Vec<String> = item.help.lines().map(normalize_untrusted_str).collect();
            group = group.element(Level::HELP.message(lines.join("\n")));
        }
        renderer.render(&[group])
    }

    /// The lines `range` of the text with what is marked in them.
    fn excerpt<'a>(
        &'a self,
        item: &Diagnostic,
        near: &[&(Range<usize>, String)],
        range: Range<usize>,
    ) -> Snippet<'a, Annotation<'a>> {
        let from = range.start;
        let shift = |span: &Range<usize>| span.start - from..span.end - from;
        let label = match item.expected.as_str() {
            "" => String::new(),
            expected => format!("expected {}", normalize_untrusted_str(expected)),
        };
        Snippet::source(&self.text[range])
            .path(&self.file_name)
            .line_start(self.text[..from].matches('\n').count() + 1)
            .annotation(AnnotationKind::Primary.span(shift(&item.span)).label(label))
            .annotations(near.iter().map(|(span, label)| {
                let label = normalize_untrusted_str(label);
                AnnotationKind::Context.span(shift(span)).label(label)
            }))
    }
}

/// The part of a span that lies in the text and on its first line, at character boundaries.
fn on_one_line(text: &str, span: &Range<usize>) -> Range<usize> {
    let boundary = |mut index: usize| {
        index = index.min(text.len());
        while !text.is_char_boundary(index) {
            index -= 1; // ends at 0, which is a boundary
        }
        index
    };
    let start = boundary(span.start);
    let end = boundary(span.end).max(start);
    let line = text[start..end].find('\n').map_or(end, |newline| start + newline);
    start..line
}
