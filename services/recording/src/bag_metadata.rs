//! `metadata.yaml` of a directory of recordings, as rosbag2 writes it (format version 9).
//!
//! Written by hand: five levels of a format that does not change, read by `ros2 bag` and `rosbags`.

use crate::mcap_writer::{FileFacts, TopicFacts};
use crate::ros2::MessageType;
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// The text for these files, in their order.
#[must_use]
pub(crate) fn metadata_yaml(files: &[FileFacts]) -> String {
    let with_messages = || files.iter().filter(|file| file.messages > 0);
    let first_ns = with_messages().map(|file| file.first_ns).min().unwrap_or(0);
    let last_ns = with_messages().map(|file| file.last_ns).max().unwrap_or(0);
    let messages: u64 = files.iter().map(|file| file.messages).sum();
    let mut text = format!(
        "rosbag2_bagfile_information:\n  version: 9\n  storage_identifier: mcap\n  duration:\n    \
         nanoseconds: {}\n  starting_time:\n    nanoseconds_since_epoch: {first_ns}\n  \
         message_count: {messages}\n",
        last_ns - first_ns
    );
    list(&mut text, "topics_with_message_count", topics(files).values(), topic);
    text += "  compression_format: \"\"\n  compression_mode: \"\"\n";
    list(&mut text, "relative_file_paths", files, |text, file| {
        let _ = writeln!(text, "    - {}", quoted(&file.name));
    });
    list(&mut text, "files", files, |text, file| {
        let _ = write!(
            text,
            "    - path: {}\n      starting_time:\n        nanoseconds_since_epoch: {}\n      \
             duration:\n        nanoseconds: {}\n      message_count: {}\n",
            quoted(&file.name),
            file.first_ns,
            file.last_ns - file.first_ns,
            file.messages
        );
    });
    text += "  custom_data: ~\n  ros_distro: tog\n";
    text
}

fn list<T>(
    text: &mut String,
    key: &str,
    items: impl IntoIterator<Item = T>,
    mut item: impl FnMut(&mut String, T),
) {
    let mut items = items.into_iter().peekable();
    if items.peek().is_none() {
        let _ = writeln!(text, "  {key}: []");
        return;
    }
    let _ = writeln!(text, "  {key}:");
    items.for_each(|entry| item(text, entry));
}

/// Topics of all files with the sum of their messages.
fn topics(files: &[FileFacts]) -> BTreeMap<&str, TopicFacts> {
    let mut topics: BTreeMap<&str, TopicFacts> = BTreeMap::new();
    for topic in files.iter().flat_map(|file| &file.topics) {
        let entry = topics
            .entry(&topic.name)
            .or_insert_with(|| TopicFacts { messages: 0, ..topic.clone() });
        entry.messages += topic.messages;
    }
    topics
}

fn topic(text: &mut String, topic: &TopicFacts) {
    let hash = MessageType::of_name(&topic.message_type).map_or("", MessageType::hash);
    let _ = write!(
        text,
        "    - topic_metadata:\n        name: {}\n        type: {}\n        \
         serialization_format: {}\n        offered_qos_profiles:",
        quoted(&topic.name),
        quoted(&topic.message_type),
        quoted(&topic.encoding),
    );
    if topic.qos.is_empty() {
        text.push_str(" []\n");
    } else {
        text.push('\n');
        for line in topic.qos.lines() {
            let _ = writeln!(text, "          {line}");
        }
    }
    let _ = write!(
        text,
        "        type_description_hash: \"{hash}\"\n      message_count: {}\n",
        topic.messages
    );
}

/// A double-quoted scalar of YAML.
fn quoted(value: &str) -> String {
    let mut text = String::from("\"");
    for c in value.chars() {
        match c {
            '"' | '\\' => text.extend(['\\', c]),
            c if c.is_control() => {
                let _ = write!(text, "\\u{:04X}", u32::from(c));
            }
            c => text.push(c),
        }
    }
    text.push('"');
    text
}
