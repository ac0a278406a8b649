//! `tog top`: a running site in a terminal, as it changes.

use super::{hosts, hosts_of};
use alerts::Journal;
use protocol::event::EventState;
use protocol::site::Site;
use ratatui::Frame;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEventKind, KeyModifiers};
use ratatui::layout::{Constraint, Layout};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::Line;
use ratatui::widgets::{Block, Paragraph, Row, Table};
use std::collections::BTreeMap;
use std::io;
use std::path::Path;
use std::time::{Duration, Instant};
use supervisor::{ProcessState, ServiceStatus, StatusReport};

/// How often it looks.
const PERIOD: Duration = Duration::from_secs(1);
/// Most alerts that are shown.
const ALERTS: usize = 8;
/// Most lines about hosts: more do not fit a terminal, `tog status --site` has them.
const HOSTS_LINES: usize = 10;

/// What was seen.
struct Seen {
    report: Result<StatusReport, String>,
    /// Percent of a core, by the service.
    cpu: BTreeMap<String, f64>,
    /// The other hosts, as this one knows them, a line each; none for a site of one host.
    hosts: Vec<String>,
    alerts: Vec<String>,
}

/// Shows the site until somebody presses q.
///
/// # Errors
/// If there is no terminal.
pub fn run(site: &Site, journal: &Path) -> io::Result<()> {
    let mut terminal = ratatui::try_init()?;
    let shown = show(&mut terminal, site, journal);
    ratatui::restore();
    shown
}

fn show(terminal: &mut ratatui::DefaultTerminal, site: &Site, journal: &Path) -> io::Result<()> {
    let mut before: Option<(Instant, BTreeMap<String, f64>)> = None;
    loop {
        let seen = look(site, journal, &mut before);
        terminal.draw(|frame| draw(frame, site, &seen))?;
        let next = Instant::now() + PERIOD;
        while let Some(left) = next.checked_duration_since(Instant::now()) {
            if !event::poll(left)? {
                break;
            }
            match event::read()? {
                Event::Key(key) if key.kind == KeyEventKind::Press => {
                    let ctrl_c = key.code == KeyCode::Char('c')
                        && key.modifiers.contains(KeyModifiers::CONTROL);
                    if ctrl_c || matches!(key.code, KeyCode::Char('q') | KeyCode::Esc) {
                        return Ok(());
                    }
                }
                Event::Resize(..) => {
                    terminal.draw(|frame| draw(frame, site, &seen))?;
                }
                _ => {}
            }
        }
    }
}

fn look(
    site: &Site,
    journal: &Path,
    before: &mut Option<(Instant, BTreeMap<String, f64>)>,
) -> Seen {
    let report = supervisor::status(&site.name).map_err(|error| error.to_string());
    let services = report.as_ref().map_or(&[][..], |report| &report.services);
    let cpu_s = |service: &ServiceStatus| {
        Some((service.name.clone(), service.gauges.get("cpu_s").copied()?))
    };
    let now: BTreeMap<String, f64> = services.iter().filter_map(cpu_s).collect();
    let cpu = match before {
        Some((then, earlier)) => {
            let seconds = then.elapsed().as_secs_f64();
            let share = |(name, cpu_s): (&String, &f64)| {
                let used_s = (cpu_s - earlier.get(name)?).max(0.0); // it may have started anew
                Some((name.clone(), 100.0 * used_s / seconds))
            };
            now.iter().filter_map(share).collect()
        }
        None => BTreeMap::new(),
    };
    *before = Some((Instant::now(), now));
    let hosts = report.as_ref().map(|report| hosts_of(site, report)).unwrap_or_default();
    let hosts = match hosts.as_slice() {
        [] => Vec::new(),
        hosts => hosts::text(hosts).lines().map(str::to_owned).collect(),
    };
    Seen { report, cpu, hosts, alerts: newest_alerts(journal).unwrap_or_default() }
}

/// The last changes of the journal, newest first.
fn newest_alerts(journal: &Path) -> Option<Vec<String>> {
    let journal = Journal::open_read_only(journal).ok()?;
    let filter = alerts::Filter { limit: ALERTS, ..alerts::Filter::default() };
    let rows = journal.list(&filter).ok()?;
    let line = |change: &protocol::event::EventChange| {
        let state = match change.state {
            EventState::Cleared => "over",
            _ => "    ",
        };
        format!("{state} {}", change.text)
    };
    let changes = rows.iter().rev().filter_map(|row| row.change().ok());
    Some(changes.map(|change| line(&change)).collect())
}

fn draw(frame: &mut Frame<'_>, site: &Site, seen: &Seen) {
    // The first line is the title; a frame takes two.
    let hosts_lines = match seen.hosts.len().saturating_sub(1) {
        0 => 0,
        lines => lines.min(HOSTS_LINES) as u16 + 2,
    };
    let [head, body, hosts, foot] = Layout::vertical([
        Constraint::Length(1),
        Constraint::Min(5),
        Constraint::Length(hosts_lines),
        Constraint::Length(ALERTS as u16 + 2),
    ])
    .areas(frame.area());
    match &seen.report {
        Ok(report) => {
            let color = if report.is_healthy() { Color::Green } else { Color::Red };
            let style = Style::new().fg(color).add_modifier(Modifier::BOLD);
            let line = format!("site {}: {}    (q ends)", site.name, report.headline());
            frame.render_widget(Line::styled(line, style), head);
            frame.render_widget(table(report, &seen.cpu), body);
        }
        Err(error) => {
            let style = Style::new().fg(Color::Red);
            frame.render_widget(
                Line::styled(format!("site {}    (q ends)", site.name), style),
                head,
            );
            frame.render_widget(Paragraph::new(error.as_str()), body);
        }
    }
    if let Some((title, lines)) = seen.hosts.split_first() {
        let lines: Vec<Line<'_>> = lines.iter().map(|line| Line::raw(line.as_str())).collect();
        let block = Block::bordered().title(title.as_str());
        frame.render_widget(Paragraph::new(lines).block(block), hosts);
    }
    let alerts: Vec<Line<'_>> = seen.alerts.iter().map(|alert| Line::raw(alert.as_str())).collect();
    frame.render_widget(Paragraph::new(alerts).block(Block::bordered().title("alerts")), foot);
}

fn table<'t>(report: &'t StatusReport, cpu: &BTreeMap<String, f64>) -> Table<'t> {
    let or_dash = |value: Option<String>| value.unwrap_or_else(|| "-".to_owned());
    let mut rows = Vec::new();
    for service in &report.services {
        let color = match service.state {
            ProcessState::Running | ProcessState::Ended => Color::Reset,
            ProcessState::Standby | ProcessState::Starting => Color::DarkGray,
            ProcessState::Degraded | ProcessState::Waiting => Color::Red,
        };
        let cells = [
            service.name.clone(),
            service.state.name().to_owned(),
            or_dash(service.rate_hz().map(|hz| format!("{hz:.1} Hz"))),
            or_dash(cpu.get(&service.name).map(|percent| format!("{percent:.1} %"))),
            or_dash(service.age_s().map(|age_s| format!("{age_s:.1} s"))),
            service.restarts.to_string(),
        ];
        rows.push(Row::new(cells).style(Style::new().fg(color)));
        for fault in &service.faults {
            let line = format!("  ! {}: {}", fault.code, fault.text);
            rows.push(Row::new([line]).style(Style::new().fg(Color::Red)));
        }
    }
    let head = Row::new(["service", "state", "rate", "cpu", "age", "restarts"]);
    let widths = [
        Constraint::Fill(1),
        Constraint::Length(9),
        Constraint::Length(9),
        Constraint::Length(8),
        Constraint::Length(8),
        Constraint::Length(8),
    ];
    Table::new(rows, widths).header(head.style(Style::new().add_modifier(Modifier::UNDERLINED)))
}
