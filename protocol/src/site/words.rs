//! How values and expectations are said, and what a mistyped word may have meant.

use super::host::{ENDPOINT_PATTERN, is_endpoint};
use super::minute_of_day;
use super::{ID_PATTERN, TIME_PATTERN};
use serde_json::Value;
use toml::de::DeValue;

/// Most characters of a value or key that a message repeats.
const CHARS_MAX: usize = 60;

/// The text, or its beginning if it is long.
pub(super) fn shortened(text: &str) -> String {
    match text.char_indices().nth(CHARS_MAX) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text.to_owned(),
    }
}

/// Text in quotes as TOML would write it, shortened.
pub(super) fn quoted(text: &str) -> String {
    format!("{:?}", shortened(text))
}

/// A value as a message repeats it.
pub(super) fn found(value: &DeValue<'_>) -> String {
    match value {
        DeValue::String(text) => quoted(text),
        DeValue::Integer(integer) => shortened(&integer.to_string()),
        DeValue::Float(float) => shortened(float.as_str()),
        DeValue::Boolean(value) => value.to_string(),
        DeValue::Datetime(_) => "a date or time".to_owned(),
        DeValue::Array(array) if array.len() == 1 => "a list of 1 value".to_owned(),
        DeValue::Array(array) => format!("a list of {} values", array.len()),
        DeValue::Table(_) => "a table".to_owned(),
    }
}

/// A pattern of the schema: how it is tested and said. `(pattern, test, words)`.
type Pattern = (&'static str, fn(&str) -> bool, &'static str);

/// The patterns that the schema uses; a regular expression engine for three of them would be idle.
pub(super) const PATTERNS: [Pattern; 3] = [
    (ID_PATTERN, is_id, "1 to 32 letters, digits, `-` or `_`"),
    (TIME_PATTERN, |text| minute_of_day(text).is_some(), "a time from \"00:00\" to \"23:59\""),
    (
        ENDPOINT_PATTERN,
        is_endpoint,
        "the address by which other hosts reach it and a port, as \"10.0.0.7:7447\"",
    ),
];

/// Whether a text is an id of a site file: 1 to 32 letters, digits, `-` or `_`.
#[must_use]
pub fn is_id(text: &str) -> bool {
    let allowed = |byte: u8| byte.is_ascii_alphanumeric() || byte == b'-' || byte == b'_';
    (1..=32).contains(&text.len()) && text.bytes().all(allowed)
}

/// `$ref` followed, also that of a section that may be left out: `anyOf` it and null.
pub(super) fn resolved<'s>(root: &'s Value, schema: &'s Value) -> &'s Value {
    let schema = match schema["anyOf"].as_array().map(Vec::as_slice) {
        Some([section, nothing]) if nothing["type"] == "null" => section,
        _ => schema,
    };
    let name = schema["$ref"].as_str().and_then(|path| path.strip_prefix("#/$defs/"));
    name.map_or(schema, |name| &root["$defs"][name])
}

/// The JSON type of a schema, without the `null` of an option.
pub(super) fn kind(schema: &Value) -> &str {
    let named = |value: &'_ Value| value.as_str().is_some_and(|name| name != "null");
    match &schema["type"] {
        Value::Array(names) => names.iter().find(|name| named(name)).and_then(Value::as_str),
        name => name.as_str(),
    }
    .unwrap_or("")
}

/// Alternatives of a schema.
pub(super) fn branches(schema: &Value) -> &[Value] {
    let list = |key: &str| schema[key].as_array().map(Vec::as_slice);
    list("oneOf").or_else(|| list("anyOf")).unwrap_or(&[])
}

/// The words that a schema allows: of an `enum`, or of branches with a `const`.
pub(super) fn choices(schema: &Value) -> Vec<&str> {
    let listed = schema["enum"].as_array().map(Vec::as_slice).unwrap_or(&[]).iter();
    let constant = branches(schema).iter().map(|branch| &branch["const"]);
    listed.chain(constant).filter_map(Value::as_str).collect()
}

/// The values of the tag `kind` by which the branches of a tagged table are told apart.
pub(super) fn tags(schema: &Value) -> Vec<&str> {
    let tag = |branch: &'_ Value| branch["properties"]["kind"]["const"].is_string();
    let tagged = branches(schema).iter().filter(|branch| tag(branch));
    tagged.filter_map(|branch| branch["properties"]["kind"]["const"].as_str()).collect()
}

/// What a schema wants, in words: "a number from 0.01 to 1".
pub(super) fn expected(root: &Value, schema: &Value) -> String {
    let schema = resolved(root, schema);
    let tags = tags(schema);
    if !tags.is_empty() {
        let kinds: Vec<String> = tags.iter().map(|tag| format!("kind = {tag:?}")).collect();
        return format!("a table with {}", either(&kinds));
    }
    let mut words: Vec<String> = choices(schema).iter().map(|word| format!("{word:?}")).collect();
    words.extend(
        branches(schema)
            .iter()
            .filter(|branch| branch["const"].is_null())
            .map(|branch| expected(root, branch)),
    );
    if !words.is_empty() {
        return either(&words);
    }
    match kind(schema) {
        "number" => format!("a number{}", range(schema)),
        "integer" => format!("a whole number{}", range(schema)),
        "boolean" => "true or false".to_owned(),
        "string" => text(schema),
        "array" => list(root, schema),
        _ => "a table".to_owned(),
    }
}

fn range(schema: &Value) -> String {
    match (schema["minimum"].as_f64(), schema["maximum"].as_f64()) {
        (Some(min), Some(max)) => format!(" from {min} to {max}"),
        (Some(min), None) => format!(", at least {min}"),
        (None, Some(max)) => format!(", at most {max}"),
        (None, None) => String::new(),
    }
}

fn text(schema: &Value) -> String {
    if let Some(pattern) = schema["pattern"].as_str() {
        let known = PATTERNS.iter().find(|(known, ..)| *known == pattern);
        return known.map_or_else(|| format!("text like {pattern}"), |(.., words)| (*words).into());
    }
    match (schema["minLength"].as_u64(), schema["maxLength"].as_u64()) {
        (min, Some(max)) => format!("text of {} to {max} characters", min.unwrap_or(0)),
        _ => "text".to_owned(),
    }
}

fn list(root: &Value, schema: &Value) -> String {
    let items = resolved(root, &schema["items"]);
    let what = match kind(items) {
        "number" => "numbers",
        "object" => "tables",
        "array" => "[x, y] pairs",
        _ => "values",
    };
    match (schema["minItems"].as_u64(), schema["maxItems"].as_u64()) {
        (Some(min), Some(max)) if min == max => format!("a list of {min} {what}"),
        (min, Some(max)) => format!("a list of {} to {max} {what}", min.unwrap_or(0)),
        _ => format!("a list of {what}"),
    }
}

/// `a`, `b` or `c`.
pub(super) fn either(words: &[String]) -> String {
    match words {
        [] => String::new(),
        [one] => one.clone(),
        [first @ .., last] => format!("{} or {last}", first.join(", ")),
    }
}

/// Names in back quotes, with commas.
pub(super) fn names<'n>(names: impl IntoIterator<Item = &'n str>) -> String {
    let names: Vec<String> =
        names.into_iter().map(|name| format!("`{}`", shortened(name))).collect();
    names.join(", ")
}

/// The word that a mistyped one may have meant: few letters away, or the same but for the unit.
pub(super) fn did_you_mean<'w>(
    typed: &str,
    words: impl IntoIterator<Item = &'w str>,
) -> Option<&'w str> {
    let typed = typed.to_ascii_lowercase();
    if typed.len() > CHARS_MAX {
        return None;
    }
    let stem = |word: &str| word.rsplit_once('_').map_or(word, |(stem, _)| stem).to_owned();
    let weight = |word: &str| {
        let lower = word.to_ascii_lowercase();
        let distance = letters_apart(&typed, &lower);
        let same_stem = stem(&lower) == typed || stem(&lower) == stem(&typed);
        let limit = (typed.len().max(word.len()) + 1) / 3;
        if same_stem {
            Some(0)
        } else {
            (distance <= limit && distance < typed.len()).then_some(distance)
        }
    };
    let weighed = words.into_iter().filter_map(|word| Some((weight(word)?, word)));
    weighed.min_by_key(|(weight, _)| *weight).map(|(_, word)| word)
}

/// Levenshtein distance in characters.
fn letters_apart(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, letter) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, other) in b.iter().enumerate() {
            let changed = diagonal + usize::from(letter != *other);
            diagonal = row[j + 1];
            row[j + 1] = changed.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}
