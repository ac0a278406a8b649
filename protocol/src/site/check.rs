//! Holds the tree against the JSON schema of the types and tells everything that does not fit.
//!
//! Knows the part of JSON schema that `schemars` makes of these types: `$ref`, `type`,
//! `properties`, `required`, `additionalProperties`, `items`, `enum`, `const`, `oneOf`/`anyOf`,
//! `minimum`, `maximum`, `minLength`, `maxLength`, `minItems`, `maxItems`, `pattern`. A test holds
//! this list against the schema.

use super::diagnostics::Finding;
use super::tree::{Node, number, whole};
use super::words;
use serde_json::Value;
use std::collections::BTreeMap;
use toml::de::DeValue;

/// All findings of a tree against a schema with its `$defs`.
pub(super) fn check(schema: &Value, root: &Node<'_>) -> Vec<Finding> {
    let mut checker = Checker { root: schema, homes: Homes::new(), findings: Vec::new() };
    homes(schema, schema, "", &mut checker.homes);
    checker.value(root, schema);
    checker.findings
}

struct Checker<'s> {
    root: &'s Value,
    homes: Homes,
    findings: Vec<Finding>,
}

impl<'s> Checker<'s> {
    /// Goes as deep as the schema, not as deep as the text.
    fn value(&mut self, node: &Node<'_>, schema: &'s Value) {
        let target = words::resolved(self.root, schema);
        if !words::tags(target).is_empty() {
            return self.tagged(node, schema, target);
        }
        let choices = words::choices(target);
        if !choices.is_empty() {
            return self.choice(node, schema, target, &choices);
        }
        match (words::kind(target), node.value) {
            ("object", DeValue::Table(_)) => self.table(node, target),
            ("array", DeValue::Array(_)) => self.list(node, schema, target),
            ("string", DeValue::String(text)) => self.text(node, schema, target, text),
            ("number" | "integer", value) => {
                self.require(number_fits(value, target), node, schema);
            }
            ("boolean", DeValue::Boolean(_)) => {}
            _ => self.require(false, node, schema),
        }
    }

    fn require(&mut self, holds: bool, node: &Node<'_>, schema: &Value) {
        if holds {
            return;
        }
        let target = words::resolved(self.root, schema);
        let items = words::resolved(self.root, &target["items"]);
        let help = match node.value {
            DeValue::Table(_) if words::kind(target) == "array" && items["type"] == "object" => {
                format!("write `[[{}]]` in double brackets, once for each", last_key(&node.path))
            }
            DeValue::String(_) if matches!(words::kind(target), "number" | "integer") => {
                format!("write the number without quotes. {}", description(schema))
            }
            _ => description(schema).to_owned(),
        };
        let expected = words::expected(self.root, schema);
        self.findings.push(Finding::error(node, words::found(node.value), expected).help(help));
    }

    fn text(&mut self, node: &Node<'_>, schema: &Value, target: &Value, text: &str) {
        let pattern = target["pattern"].as_str();
        let test = words::PATTERNS.iter().find(|(known, ..)| Some(*known) == pattern);
        let length = text.chars().count() as u64;
        let holds = test.is_none_or(|(_, test, _)| test(text))
            && target["minLength"].as_u64().is_none_or(|min| length >= min)
            && target["maxLength"].as_u64().is_none_or(|max| length <= max);
        self.require(holds, node, schema);
        if holds && text.chars().any(char::is_control) {
            let expected = "text without control characters";
            self.findings.push(
                Finding::error(node, words::quoted(text), expected)
                    .help("it is shown on terminals and in alerts: remove them"),
            );
        }
    }

    fn list(&mut self, node: &Node<'_>, schema: &Value, target: &'s Value) {
        let items = node.items();
        let length = items.len() as u64;
        let holds = target["minItems"].as_u64().is_none_or(|min| length >= min)
            && target["maxItems"].as_u64().is_none_or(|max| length <= max);
        self.require(holds, node, schema);
        for item in items {
            self.value(&item, &target["items"]);
        }
    }

    fn choice(&mut self, node: &Node<'_>, schema: &Value, target: &'s Value, choices: &[&str]) {
        let text = node.value.as_str();
        if text.is_some_and(|text| choices.contains(&text)) {
            return;
        }
        let others = || words::branches(target).iter().filter(|branch| branch["const"].is_null());
        if text.is_none() && others().any(|branch| number_fits(node.value, branch)) {
            return;
        }
        let meant = text.and_then(|text| words::did_you_mean(text, choices.iter().copied()));
        let help = match meant {
            Some(word) => format!("did you mean {word:?}?"),
            None => description(schema).to_owned(),
        };
        let expected = words::expected(self.root, schema);
        self.findings.push(Finding::error(node, words::found(node.value), expected).help(help));
    }

    /// A table that its key `kind` tells what else it has.
    fn tagged(&mut self, node: &Node<'_>, schema: &Value, target: &'s Value) {
        if node.value.as_table().is_none() {
            return self.require(false, node, schema);
        }
        let tags = words::tags(target);
        let expected: Vec<String> = tags.iter().map(|tag| format!("{tag:?}")).collect();
        let Some(kind) = node.get("kind") else {
            let message = format!("`{}` lacks `kind`", node.path);
            let help = format!("write `kind = ` and {}", words::either(&expected));
            let finding = Finding::error(node, "a table without `kind`", words::either(&expected));
            return self.findings.push(finding.message(message).help(help));
        };
        let branch = words::branches(target)
            .iter()
            .find(|branch| kind.value.as_str() == branch["properties"]["kind"]["const"].as_str());
        if let Some(branch) = branch.filter(|_| kind.value.is_str()) {
            return self.table(node, branch);
        }
        let meant = kind.value.as_str().and_then(|text| words::did_you_mean(text, tags));
        let help = match meant {
            Some(word) => format!("did you mean {word:?}?"),
            None => description(schema).to_owned(),
        };
        let found = words::found(kind.value);
        self.findings.push(Finding::error(&kind, found, words::either(&expected)).help(help));
    }

    fn table(&mut self, node: &Node<'_>, schema: &'s Value) {
        let Some(properties) = schema["properties"].as_object() else { return };
        let absent = |key: &&str| node.get(key).is_none();
        let required = schema["required"].as_array().map(Vec::as_slice).unwrap_or(&[]);
        let mut missing: Vec<&str> =
            required.iter().filter_map(Value::as_str).filter(absent).collect();
        for (key, span) in node.keys() {
            if let Some(property) = properties.get(key) {
                if let Some(child) = node.get(key) {
                    self.value(&child, property);
                }
                continue;
            }
            let free = properties.keys().map(String::as_str).filter(absent);
            let meant = words::did_you_mean(key, free);
            missing.retain(|name| Some(*name) != meant); // one mistake, one message
            let finding = self.unknown_key(node, key, meant, properties.keys());
            self.findings.push(finding.span(span));
        }
        if !missing.is_empty() {
            self.missing_keys(node, &missing, properties);
        }
    }

    fn unknown_key<'k>(
        &self,
        node: &Node<'_>,
        key: &str,
        meant: Option<&str>,
        keys: impl Iterator<Item = &'k String>,
    ) -> Finding {
        let place = place(&node.path);
        let shown = words::shortened(key);
        let homes = self.homes.get(key).map_or(&[][..], Vec::as_slice);
        let help = match (meant, homes) {
            (Some(word), _) => format!("did you mean `{word}`?"),
            (None, [_, ..]) => format!("`{shown}` belongs {}", words::either(homes)),
            (None, []) => format!("remove it. Keys here: {}", words::names(keys.map(|k| &**k))),
        };
        let child = Node { path: node.path_of(&shown), ..node.clone() };
        Finding::error(&child, format!("the key `{shown}`"), "a known key")
            .message(format!("there is no key `{shown}` in {place}"))
            .help(help)
    }

    fn missing_keys(
        &mut self,
        node: &Node<'_>,
        missing: &[&str],
        properties: &serde_json::Map<String, Value>,
    ) {
        let line = |key: &&str| {
            let schema = &properties[*key];
            let target = words::resolved(self.root, schema);
            let items = words::resolved(self.root, &target["items"]);
            let how = match (words::kind(target), items["type"].as_str()) {
                (_, Some("object")) => format!("`[[{key}]]` and its keys"),
                ("string", _) => format!("`{key}`"),
                _ => format!("`{key}` ({})", words::expected(self.root, schema)),
            };
            format!("{how}: {}", description(schema))
        };
        let help: Vec<String> = missing.iter().map(line).collect();
        let names = words::names(missing.iter().copied());
        let finding = Finding::error(node, format!("no {names}"), names.clone())
            .message(format!("{} lacks {names}", place(&node.path)))
            .help(format!("add {}", help.join("\nadd ")));
        self.findings.push(finding);
    }
}

/// Whether a value is a number of the type and range of a schema.
fn number_fits(value: &DeValue<'_>, schema: &Value) -> bool {
    let fits = |value: &i128| fits_format(*value, schema);
    let value = match (words::kind(schema), value) {
        ("integer", DeValue::Integer(integer)) => {
            whole(integer).filter(fits).map(|value| value as f64)
        }
        ("number", value) => number(value),
        _ => None,
    };
    value.is_some_and(|value| in_range(value, schema))
}

fn in_range(value: f64, schema: &Value) -> bool {
    schema["minimum"].as_f64().is_none_or(|min| value >= min)
        && schema["maximum"].as_f64().is_none_or(|max| value <= max)
}

fn fits_format(value: i128, schema: &Value) -> bool {
    match schema["format"].as_str() {
        Some("uint8") => u8::try_from(value).is_ok(),
        Some("uint16") => u16::try_from(value).is_ok(),
        Some("uint32") => u32::try_from(value).is_ok(),
        Some("uint64") => u64::try_from(value).is_ok(),
        _ => i64::try_from(value).is_ok(),
    }
}

fn description(schema: &Value) -> &str {
    schema["description"].as_str().unwrap_or("")
}

fn place(path: &str) -> String {
    if path.is_empty() { "the site file".to_owned() } else { format!("`{path}`") }
}

fn last_key(path: &str) -> &str {
    path.rsplit('.').next().unwrap_or(path)
}

/// The tables that have a key, by key: "in `area.detector`", "at the top of the file ..".
type Homes = BTreeMap<String, Vec<String>>;

fn homes(root: &Value, schema: &Value, path: &str, found: &mut Homes) {
    let schema = words::resolved(root, schema);
    if schema["type"] == "array" {
        return homes(root, &schema["items"], path, found);
    }
    let tables = words::branches(schema).iter().chain([schema]);
    for properties in tables.filter_map(|table| table["properties"].as_object()) {
        for (key, child) in properties {
            let home = match path {
                "" => "at the top of the file, before the first `[[..]]`".to_owned(),
                path => format!("in `{path}`{}", of_kind(properties)),
            };
            let known = found.entry(key.clone()).or_default();
            if !known.contains(&home) {
                known.push(home);
            }
            let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
            homes(root, child, &path, found);
        }
    }
}

fn of_kind(properties: &serde_json::Map<String, Value>) -> String {
    let tag = properties.get("kind").and_then(|kind| kind["const"].as_str());
    tag.map_or_else(String::new, |tag| format!(" of kind {tag:?}"))
}
