//! What holds for every text that somebody may call a site file.

use super::broken::GOOD;
use proptest::prelude::*;
use protocol::site::{Diagnostics, Severity, Site};

/// Draws both ways and holds the promises of every diagnostic.
fn holds(text: &str, report: &Diagnostics) {
    let lines = text.matches('\n').count() + 1;
    for item in report.iter() {
        assert!((1..=lines).contains(&item.line), "{item:?}");
        assert!(item.column >= 1 && !item.message.is_empty(), "{item:?}");
    }
    let plain = report.render(false);
    assert_eq!(plain, report.to_string());
    assert!(!plain.contains('\u{1b}'), "an escape code in plain text: {plain:?}");
    let coloured = report.render(true);
    assert_eq!(plain.is_empty(), report.is_empty());
    assert_eq!(coloured.is_empty(), report.is_empty());
    serde_json::to_string(report).unwrap();
}

/// Parses; a refusal has an error, an accepted file has none and is the same after a round trip.
fn parse(text: &str) {
    match Site::parse_with_warnings(text, "any.toml") {
        Ok((site, warnings)) => {
            assert!(warnings.iter().all(|item| item.severity == Severity::Warning));
            holds(text, &warnings);
            let written = toml::to_string(&site).unwrap();
            assert_eq!(Site::parse(&written, "written.toml").as_ref(), Ok(&site), "{written}");
        }
        Err(errors) => {
            assert!(errors.has_errors());
            holds(text, &errors);
        }
    }
}

/// Fragments that a site file is made of, so that chance gets past the parser.
fn fragment() -> impl Strategy<Value = String> {
    let keys = prop::sample::select(
        "name timezone area laser id x_m y_m origin_m columns rows cell_m class prototype zone \
         polygon_m context from to days source kind scene pace seed recording timescales_s x"
            .split_whitespace()
            .collect::<Vec<_>>(),
    );
    let values = prop::sample::select(vec![
        "0",
        "-1",
        "1e308",
        "nan",
        "-inf",
        "0.1",
        "120",
        "0xFFFF_FFFF_FFFF_FFFF_FF",
        "\"a\"",
        "\"foyer\"",
        "''",
        "\"\\u0000é\"",
        "[]",
        "[1, 2]",
        "[[0, 0], [1, 0], [1, 1]]",
        "{}",
        "{ kind = \"replay\" }",
        "true",
        "2020-01-01",
        "\"22:00\"",
        "[\"mon\"]",
        "[1, 15, 60]",
    ]);
    prop_oneof![
        (keys.clone(), values).prop_map(|(key, value)| format!("{key} = {value}\n")),
        keys.clone().prop_map(|key| format!("[[{key}]]\n")),
        keys.clone().prop_map(|key| format!("[[area.{key}]]\n")),
        keys.prop_map(|key| format!("[{key}]\n")),
        ".{0,12}",
    ]
}

proptest! {
    #[test]
    fn no_text_is_a_panic(text in "(?s).{0,200}") {
        parse(&text);
    }

    #[test]
    fn no_heap_of_fragments_is_a_panic(parts in prop::collection::vec(fragment(), 0..30)) {
        parse(&parts.concat());
    }

    #[test]
    fn no_change_of_a_good_file_is_a_panic(
        at in 0..GOOD.len(), length in 0_usize..40, with in fragment(), twice in any::<bool>(),
    ) {
        let end = (at + length).min(GOOD.len());
        let mut text = GOOD.to_owned();
        text.replace_range(at..end, &with);
        if twice {
            text.push_str(&text.clone());
        }
        parse(&text);
    }

    #[test]
    fn a_value_swapped_for_any_number_is_read_or_told(line in 0_usize..21, value in any::<f64>()) {
        let change = |(index, text): (usize, &str)| match text.split_once(" = ") {
            Some((key, _)) if index == line => format!("{key} = {value:?}\n"),
            _ => format!("{text}\n"),
        };
        parse(&GOOD.lines().enumerate().map(change).collect::<String>());
    }
}

#[test]
fn hostile_texts_are_refused_in_words() {
    let deep = format!("a = {}{}", "[".repeat(5000), "]".repeat(5000));
    let dotted = format!("{} = 1", vec!["a"; 5000].join("."));
    let long = format!("name = \"{}\"", "é".repeat(200_000));
    let huge = "#".repeat((1 << 20) + 1);
    let many = "x = [1, 2\n".repeat(5000);
    let keys: String = (0..5000).map(|n| format!("key{n} = {n}\n")).collect();
    let lines = "\r\n\u{feff}name = 'a'\r\n\u{2028}";
    let wide = "name = \"\u{1b}[31mred\"\n\tcell\u{200f} = 1";
    let days = format!(
        "{}[{}]\nfrom = '00:00'\nto = '00:00'\n",
        "[[area]]\n[[area.context]]\ndays = ",
        "'mon', ".repeat(100_000)
    );
    let areas = "[[area]]\n[[laser]]\narea='a'\n".repeat(30_000);
    let texts: [&str; 10] =
        [&deep, &dotted, &long, &huge, &many, &keys, &days, &areas, lines, wide];
    for text in texts {
        parse(text);
    }
    let errors = Site::parse(&keys, "keys.toml").unwrap_err();
    assert_eq!(errors.iter().count(), 50);
    assert!(errors.to_string().contains("more are not shown"), "{errors}");
}

#[test]
fn a_line_that_nobody_can_read_is_told_by_its_place() {
    let text = format!("name = 'a' #{}\nflavour = '{}'", "-".repeat(99), "e".repeat(70_000));
    let errors = Site::parse(&text, "long.toml").unwrap_err().to_string();
    let told = "error: there is no key `flavour` in the site file\n--> long.toml:2:1\n";
    assert!(errors.contains(told), "{errors}");
    assert!(errors.len() < 1000, "{errors}");
}

#[test]
fn a_diagnostic_can_be_read_by_a_program() {
    let text = GOOD.replace("rows = 80", "rows = 80.5");
    let errors = Site::parse(&text, "lab.toml").unwrap_err();
    let json = serde_json::to_value(&errors).unwrap();
    let expected = serde_json::json!({
        "file_name": "lab.toml",
        "omitted": 0,
        "items": [{
            "severity": "error",
            "line": 8,
            "column": 8,
            "path": "area[0].rows",
            "message": "`area[0].rows` is 80.5, expected a whole number from 1 to 4096",
            "found": "80.5",
            "expected": "a whole number from 1 to 4096",
            "help": "Cells along y.",
        }],
    });
    assert_eq!(json, expected);
}

#[test]
fn colour_changes_the_look_and_not_the_words() {
    let errors = Site::parse("", "lab.toml").unwrap_err();
    let coloured = errors.render(true);
    let mut words = String::new();
    let mut escape = false;
    for letter in coloured.chars() {
        match letter {
            '\u{1b}' => escape = true,
            'm' if escape => escape = false,
            _ if !escape => words.push(letter),
            _ => {}
        }
    }
    assert!(coloured.contains('\u{1b}'));
    assert_eq!(words, errors.to_string());
}

#[test]
fn what_is_left_out_has_the_default_of_the_schema() {
    let site = Site::parse(GOOD, "lab.toml").unwrap();
    let schema = Site::json_schema();
    let of_site = &schema["properties"];
    let of_area = &schema["$defs"]["Area"]["properties"];
    let area = serde_json::to_value(&site.areas[0]).unwrap();
    let whole = serde_json::to_value(&site).unwrap();
    let mut seen = 0;
    for (value, properties) in [(&whole, of_site), (&area, of_area)] {
        for (key, property) in properties.as_object().unwrap() {
            if let Some(default) = property.get("default") {
                assert_eq!(&value[key], default, "{key}");
                seen += 1;
            }
        }
    }
    assert!(seen >= 16, "{seen}");
}
