//! Tests that look behind the parser: the walker, the schema and serde agree.
#![allow(clippy::unwrap_used)]

use super::*;
use serde_json::Value;
use std::collections::BTreeSet;

/// Every keyword of a schema, with the names of properties left out.
fn keywords(schema: &Value, found: &mut BTreeSet<String>) {
    for (key, value) in schema.as_object().into_iter().flatten() {
        found.insert(key.clone());
        match (key.as_str(), value) {
            ("properties" | "$defs", Value::Object(children)) => {
                children.values().for_each(|child| keywords(child, found));
            }
            ("items", child) => keywords(child, found),
            ("oneOf" | "anyOf", Value::Array(branches)) => {
                branches.iter().for_each(|branch| keywords(branch, found));
            }
            _ => {}
        }
    }
}

#[test]
fn the_checker_knows_every_word_of_the_schema() {
    let mut found = BTreeSet::new();
    keywords(&SCHEMA, &mut found);
    let told = "$defs $ref $schema additionalProperties anyOf const default description enum \
                format items maxItems maxLength maximum minItems minLength minimum oneOf pattern \
                properties required title type";
    assert_eq!(found.into_iter().collect::<Vec<_>>().join(" "), told);
}

fn patterns(schema: &Value, found: &mut BTreeSet<String>) {
    if let Some(pattern) = schema["pattern"].as_str() {
        found.insert(pattern.to_owned());
    }
    match schema {
        Value::Object(children) => children.values().for_each(|child| patterns(child, found)),
        Value::Array(items) => items.iter().for_each(|child| patterns(child, found)),
        _ => {}
    }
}

#[test]
fn the_checker_tests_every_pattern_of_the_schema() {
    let mut found = BTreeSet::new();
    patterns(&SCHEMA, &mut found);
    let known: BTreeSet<String> =
        words::PATTERNS.iter().map(|(pattern, ..)| (*pattern).to_owned()).collect();
    assert_eq!(found, known);
}

/// Every table of the schema refuses unknown keys, so that no typo passes.
#[test]
fn no_table_of_the_schema_is_open() {
    fn closed(schema: &Value) {
        if schema["properties"].is_object() && schema["title"] != "Detector" {
            assert_eq!(schema["additionalProperties"], false, "{schema}");
        }
        match schema {
            Value::Object(children) => children.values().for_each(closed),
            Value::Array(items) => items.iter().for_each(closed),
            _ => {}
        }
    }
    closed(&SCHEMA["$defs"]);
    assert_eq!(SCHEMA["additionalProperties"], false);
}

/// If nothing was found, serde reads it: the last resort of `parse_with_warnings` is never taken.
#[test]
fn what_the_checker_lets_pass_serde_reads() {
    let good = include_str!("../../../deploy/foyer.toml");
    let values = [
        "0",
        "1",
        "-1",
        "1.5",
        "120",
        "18446744073709551615",
        "9223372036854775808",
        "1e3",
        "\"a\"",
        "\"free\"",
        "\"lossless\"",
        "true",
        "[]",
        "[0, 0]",
        "[1, 2, 3]",
        "[\"mon\"]",
        "{}",
        "{ kind = \"replay\", recording = \"a\" }",
        "{ kind = \"simulator\", scene = \"a\" }",
        "2020-01-01",
        "0x10",
        "1_000",
        "[[0, 0], [9, 0], [9, 7]]",
        "[{ name = \"a\" }]",
    ];
    let mut read = 0;
    for line in 0..good.lines().count() {
        for value in values {
            let swap = |(index, text): (usize, &str)| match text.split_once(" = ") {
                Some((key, _)) if index == line => format!("{key} = {value}\n"),
                _ => format!("{text}\n"),
            };
            let text: String = good.lines().enumerate().map(swap).collect();
            let (table, syntax_errors) = toml::de::DeTable::parse_recoverable(&text);
            assert!(syntax_errors.is_empty());
            let root = toml::de::DeValue::Table(table.into_inner());
            if check::check(&SCHEMA, &Node::root(&root)).is_empty() {
                let site = toml::from_str::<Site>(&text);
                assert!(site.is_ok(), "{site:?} of\n{text}");
                read += 1;
            }
        }
    }
    assert!(read > 100, "{read}");
}

#[test]
fn a_time_of_the_day_has_two_digits_a_colon_and_two_digits() {
    assert_eq!(minute_of_day("00:00"), Some(0));
    assert_eq!(minute_of_day("23:59"), Some(24 * 60 - 1));
    for wrong in ["", "24:00", "12:60", "1:00", "01:0", "+1:00", "12-30", "１2:30", "12:30 "] {
        assert_eq!(minute_of_day(wrong), None, "{wrong}");
    }
}
