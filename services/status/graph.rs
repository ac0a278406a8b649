//! Processes and topics of a site as a picture: `tog graph`.

use super::cli::GraphFormat;
use process::Role;
use protocol::site::Site;
use std::collections::BTreeSet;

/// From which process to which, and by what.
struct Edge {
    from: String,
    to: String,
    what: String,
}

/// A process of a host, as a name that both languages take.
fn node(host: Option<&str>, process: &str) -> String {
    let of = host.map_or_else(String::new, |host| format!("{host}_"));
    format!("{of}{process}").replace(|c: char| !c.is_ascii_alphanumeric(), "_")
}

/// The picture in one of the languages.
pub fn text(site: &Site, format: GraphFormat) -> String {
    let hosts: Vec<Option<&str>> = if site.hosts.is_empty() {
        vec![None]
    } else {
        site.hosts.iter().map(|host| Some(host.id.as_str())).collect()
    };
    let edges = edges(site, &hosts);
    let language = match format {
        GraphFormat::Dot => &DOT,
        GraphFormat::Mermaid => &MERMAID,
    };
    let mut text = (language.head)(&site.name);
    for host in hosts.iter().copied() {
        text += &host.map_or_else(String::new, |id| (language.host)(&node(None, id), id));
        for role in Role::all(site, host) {
            let role = role.to_string();
            text += &(language.process)(&node(host, &role), &role);
        }
        text += host.map_or("", |_| language.host_end);
    }
    edges.iter().for_each(|edge| text += &(language.edge)(edge));
    text + language.end
}

/// How a language draws.
struct Language {
    head: fn(&str) -> String,
    /// The beginning of a host: its name in the language, and its id.
    host: fn(&str, &str) -> String,
    host_end: &'static str,
    process: fn(&str, &str) -> String,
    edge: fn(&Edge) -> String,
    end: &'static str,
}

const DOT: Language = Language {
    head: |site| {
        format!(
            "digraph \"{site}\" {{\n  rankdir=LR;\n  node [shape=box, fontname=\"sans-serif\"];\n"
        )
    },
    host: |name, id| format!("  subgraph cluster_{name} {{\n    label=\"host {id}\";\n"),
    host_end: "  }\n",
    process: |name, role| format!("    {name} [label=\"{role}\"];\n"),
    edge: |Edge { from, to, what }| format!("  {from} -> {to} [label=\"{what}\"];\n"),
    end: "}\n",
};

const MERMAID: Language = Language {
    head: |_| "flowchart LR\n".to_owned(),
    host: |name, id| format!("  subgraph {name}[host {id}]\n"),
    host_end: "  end\n",
    process: |name, role| format!("    {name}[{role}]\n"),
    edge: |Edge { from, to, what }| format!("  {from} -->|{what}| {to}\n"),
    end: "",
};

fn edges(site: &Site, hosts: &[Option<&str>]) -> Vec<Edge> {
    let mut edges = Vec::new();
    let mut edge = |from: String, to: String, what: &str| {
        edges.push(Edge { from, to, what: what.to_owned() });
    };
    for laser in &site.lasers {
        let host = site.host_of_laser(laser);
        let from = node(host, &format!("laser {}", laser.id));
        for to in hosts.iter().copied() {
            let runs = site.areas.iter().any(|area| area.id == laser.area && area.may_run_on(to));
            let fusion = node(to, &format!("fusion {}", laser.area));
            if runs && to == host {
                edge(from.clone(), fusion, "scan");
            } else if runs {
                edge(from.clone(), node(host, "bridge"), "scan");
                edge(node(host, "bridge"), node(to, "bridge"), &format!("scan {}", laser.id));
                edge(node(to, "bridge"), fusion, "scan");
            }
        }
    }
    for host in hosts.iter().copied() {
        for area in site.areas_on(host) {
            let of = |service: &str| node(host, &format!("{service} {}", area.id));
            edge(of("fusion"), of("mapper"), "frame");
            edge(of("mapper"), of("anomaly"), "classes, collapsed");
            edge(of("anomaly"), node(host, "alerts"), "event");
        }
        for area in site.areas_followed_by(host) {
            let from = node(area.host.as_deref(), "bridge");
            let what = format!("frame, classes, collapsed {}", area.id);
            edge(node(area.host.as_deref(), &format!("mapper {}", area.id)), from.clone(), "maps");
            edge(from, node(host, "bridge"), &what);
        }
        for desk in site.hosts.iter().filter(|desk| desk.desk && Some(desk.id.as_str()) != host) {
            edge(node(host, "alerts"), node(host, "bridge"), "event");
            edge(node(host, "bridge"), node(Some(&desk.id), "bridge"), "event");
            edge(node(Some(&desk.id), "bridge"), node(Some(&desk.id), "alerts"), "event");
        }
    }
    let mut seen = BTreeSet::new();
    edges.retain(|edge| seen.insert((edge.from.clone(), edge.to.clone(), edge.what.clone())));
    edges
}
