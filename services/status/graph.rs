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
            let name = role.to_string();
            let shown = if stands_by(site, host, &role) {
                format!("{name}, standby")
            } else {
                name.clone()
            };
            text += &(language.process)(&node(host, &name), &shown);
        }
        text += host.map_or("", |_| language.host_end);
    }
    edges.iter().for_each(|edge| text += &(language.edge)(edge));
    text + language.end
}

/// True for a process of an area that runs elsewhere as long as its own host is there.
fn stands_by(site: &Site, host: Option<&str>, role: &Role) -> bool {
    let area = site.areas.iter().find(|area| role.area() == Some(&area.id));
    area.is_some_and(|area| host.is_some() && area.standby.as_deref() == host)
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
            // Whoever runs it.
            for runs in hosts.iter().copied().filter(|runs| area.may_run_on(*runs)) {
                let what = format!("frame, classes, collapsed {}", area.id);
                edge(node(runs, &format!("mapper {}", area.id)), node(runs, "bridge"), "maps");
                edge(node(runs, "bridge"), node(host, "bridge"), &what);
            }
        }
        for area in site.areas.iter().filter(|area| area.host.as_deref() == host) {
            if let Some(standby) = &area.standby {
                let to = node(Some(standby), "bridge");
                edge(node(host, "bridge"), to, &format!("copies {}", area.id));
            }
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

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_standby_is_drawn_as_one_with_what_it_copies() {
        let host = |id: &str, more: &str| {
            format!(
                "[[host]]\nid = \"{id}\"\nendpoint = \"{id}:7447\"\ntransport = \"tls\"\n{more}\n"
            )
        };
        let text = [
            "name = \"t\"\n".to_owned(),
            host("main", "desk = true"),
            host("spare", ""),
            host("guard", "follows = [\"hall\"]"),
            "[[area]]\nid = \"hall\"\nhost = \"main\"\nstandby = \"spare\"\norigin_m = [0.0, 0.0]\n\
             columns = 10\nrows = 10\n[[laser]]\nid = \"hall\"\nhost = \"guard\"\narea = \"hall\"\n\
             x_m = 0.5\ny_m = 0.5\nsource = { kind = \"simulator\", scene = \"room\" }\n"
                .to_owned(),
        ]
        .concat();
        let site = Site::parse(&text, "t").unwrap_or_else(|errors| panic!("{errors}"));
        let graph = super::text(&site, GraphFormat::Mermaid);
        for line in [
            "    spare_fusion_hall[fusion hall, standby]\n",
            "    main_fusion_hall[fusion hall]\n",
            "    guard_laser_hall[laser hall]\n",
            "  main_bridge -->|copies hall| spare_bridge\n",
            "  spare_bridge -->|frame, classes, collapsed hall| guard_bridge\n",
        ] {
            assert!(graph.contains(line), "{line}{graph}");
        }
    }
}
