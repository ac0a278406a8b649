//! The layout of every header in shared memory, as it is. iceoryx2 compares name and size only: who
//! changes a line here changes the version in the name, too.

use protocol::event::EventHeader;
use protocol::frame::FrameHeader;
use protocol::grid::{ClassMapHeader, CollapsedMapHeader};
use protocol::scan::{ScanGeometry, ScanHeader};
use protocol::wire::{BytesHeader, Envelope, Header};
use std::mem::offset_of;

/// `name size: field@offset ..` of a type; fails to compile if a field is renamed or removed.
macro_rules! layout {
    ($name:expr, $type:ty, $($field:ident)+) => {{
        let fields: &[(&str, usize)] = &[$((stringify!($field), offset_of!($type, $field))),+];
        let fields: Vec<String> =
            fields.iter().map(|(field, offset)| format!("{field}@{offset}")).collect();
        format!("{} {}: {}", $name, size_of::<$type>(), fields.join(" "))
    }};
    ($type:ty, $($field:ident)+) => { layout!(<$type as Header>::TYPE_NAME, $type, $($field)+) };
}

#[test]
fn the_layout_of_every_header_is_the_one_that_its_version_names() {
    let layouts = [
        layout!("Envelope", Envelope, seq session source flags published_mono_ns),
        layout!("ScanGeometry", ScanGeometry,
            angle_min_rad angle_increment_rad range_min_m range_max_m),
        layout!(ScanHeader, envelope stamp_ns device_stamp_ns geometry),
        layout!(FrameHeader,
            envelope number period_ns lasers_present completed_by_mono_ns columns rows),
        layout!(ClassMapHeader,
            envelope number period_ns lasers_present completed_by_mono_ns context classes columns rows),
        layout!(CollapsedMapHeader, envelope number period_ns context classes columns rows),
        layout!(BytesHeader, envelope),
        layout!(EventHeader, envelope completed_by_mono_ns),
    ];
    let expected = [
        "Envelope 32: seq@0 session@8 source@16 flags@20 published_mono_ns@24",
        "ScanGeometry 32: angle_min_rad@0 angle_increment_rad@8 range_min_m@16 range_max_m@24",
        "tog.ScanHeader.v1 80: envelope@0 stamp_ns@32 device_stamp_ns@40 geometry@48",
        "tog.FrameHeader.v1 72: envelope@0 number@32 period_ns@40 lasers_present@48 \
         completed_by_mono_ns@56 columns@64 rows@68",
        "tog.ClassMapHeader.v1 80: envelope@0 number@32 period_ns@40 lasers_present@48 \
         completed_by_mono_ns@56 context@64 classes@68 columns@72 rows@76",
        "tog.CollapsedMapHeader.v1 64: envelope@0 number@32 period_ns@40 context@48 classes@52 \
         columns@56 rows@60",
        "tog.BytesHeader.v1 32: envelope@0",
        "tog.EventHeader.v1 40: envelope@0 completed_by_mono_ns@32",
    ];
    assert_eq!(layouts.join("\n"), expected.join("\n"));
}

#[test]
fn a_header_is_the_bytes_of_its_fields_in_native_order_without_padding() {
    let envelope = Envelope { seq: 1, session: 2, source: 3, flags: 4, published_mono_ns: 5 };
    let geometry = ScanGeometry {
        angle_min_rad: -1.5,
        angle_increment_rad: 0.01,
        range_min_m: 0.1,
        range_max_m: 8.0,
    };
    let header = ScanHeader { envelope, stamp_ns: 6, device_stamp_ns: 7, geometry };
    let mut fields = Vec::new();
    for word in [1_u64, 2, 3 | 4 << 32, 5, 6, 7] {
        fields.extend(word.to_le_bytes());
    }
    for number in [-1.5_f64, 0.01, 0.1, 8.0] {
        fields.extend(number.to_le_bytes());
    }
    if cfg!(target_endian = "little") {
        assert_eq!(bytemuck::bytes_of(&header), fields);
    }
}

#[test]
fn every_header_begins_with_its_envelope() {
    fn check<H: Header>() {
        let mut header = H::default();
        header.envelope_mut().seq = 0x0102_0304_0506_0708;
        let bytes = bytemuck::bytes_of(&header);
        assert_eq!(bytes[..8], 0x0102_0304_0506_0708_u64.to_ne_bytes(), "{}", H::TYPE_NAME);
        assert_eq!(header.envelope().seq, 0x0102_0304_0506_0708);
    }
    check::<ScanHeader>();
    check::<FrameHeader>();
    check::<ClassMapHeader>();
    check::<CollapsedMapHeader>();
    check::<BytesHeader>();
    check::<EventHeader>();
}

#[test]
fn no_two_topics_of_an_area_share_a_name() {
    use protocol::topic::*;
    let names = [
        scan("a").name().to_owned(),
        frame("a", 1).name().to_owned(),
        classes("a", 1).name().to_owned(),
        collapsed("a", 1, 1).name().to_owned(),
        event().name().to_owned(),
        event_acknowledgement().name().to_owned(),
        health().name().to_owned(),
        // An area may have any id: none of them makes the name of another topic.
        scan("event").name().to_owned(),
        scan("health").name().to_owned(),
    ];
    let distinct: std::collections::BTreeSet<&String> = names.iter().collect();
    assert_eq!(distinct.len(), names.len(), "{names:?}");
}
