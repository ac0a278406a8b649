//! The codec gives back what it was given and refuses everything else without a panic.

use super::samples;
use proptest::prelude::*;
use protocol::carried::{CarriedCounts, CarriedMap};
use protocol::codec::{BODY_BYTES_MAX, DecodeError, ENVELOPE_BYTES, Encoded, decode, encode};
use protocol::event::{EventAcknowledgement, EventChange};
use protocol::health::Health;
use protocol::link::{CarriedScan, Claims, EventPage, FilePage, HostHealth, PAGE_ROWS_MAX};
use protocol::ownership::Ownership;
use protocol::scan::{BEAMS_MAX, LaserScan};
use std::fmt::Debug;

/// Decoding and encoding again gives the same bytes: equality that holds for NaN, too.
fn round_trip<M: Encoded + Debug>(message: &M) -> M {
    let bytes = encode(message).unwrap();
    let decoded: M = decode(&bytes).unwrap();
    assert_eq!(encode(&decoded).unwrap(), bytes, "{message:?}");
    decoded
}

fn cut_anywhere<M: Encoded + Debug>(message: &M) {
    let bytes = encode(message).unwrap();
    for length in 0..bytes.len() {
        let found = decode::<M>(&bytes[..length]).unwrap_err();
        assert!(matches!(found, DecodeError::Cut { .. }), "{length}: {found}");
    }
    let longer = [bytes.as_slice(), &[0, 1]].concat();
    let surplus = DecodeError::Surplus { name: M::NAME, surplus: 2 };
    assert_eq!(decode::<M>(&longer).unwrap_err(), surplus);
}

/// Each flipped bit is refused or gives a message that can be encoded; a flip in the magic, the
/// kind, the version or the length is always refused.
fn flip_everywhere<M: Encoded + Debug>(message: &M) {
    let mut bytes = encode(message).unwrap();
    for bit in 0..bytes.len() * 8 {
        bytes[bit / 8] ^= 1 << (bit % 8);
        match decode::<M>(&bytes) {
            Ok(other) => {
                assert!(bit / 8 >= ENVELOPE_BYTES, "bit {bit} of the envelope went unseen");
                encode(&other).unwrap();
            }
            Err(error) => assert!(error.to_string().starts_with(M::NAME)),
        }
        bytes[bit / 8] ^= 1 << (bit % 8);
    }
}

/// Any body behind a right envelope.
fn any_body<M: Encoded + Debug>(body: &[u8]) {
    let mut bytes = vec![b'T', b'G', M::KIND, M::VERSION];
    bytes.extend((body.len() as u32).to_le_bytes());
    bytes.extend(body);
    if let Ok(message) = decode::<M>(&bytes) {
        encode(&message).unwrap();
    }
}

proptest! {
    #[test]
    fn a_scan_survives_the_wire(scan in samples::any_scan()) {
        let decoded = round_trip(&scan);
        let bits = |scan: &LaserScan| scan.ranges_m.iter().map(|r| r.to_bits()).collect::<Vec<_>>();
        prop_assert_eq!(bits(&decoded), bits(&scan));
        prop_assert_eq!(decoded.geometry, scan.geometry);
        prop_assert_eq!(decoded.stamp_ns, scan.stamp_ns);
    }

    #[test]
    fn an_event_survives_the_wire(event in samples::any_event()) {
        prop_assume!(event.text.len() <= protocol::event::TEXT_BYTES_MAX);
        prop_assert_eq!(round_trip(&event), event);
    }

    #[test]
    fn an_acknowledgement_survives_the_wire(message in samples::any_acknowledgement()) {
        prop_assert_eq!(round_trip(&message), message);
    }

    #[test]
    fn health_survives_the_wire(health in samples::any_health()) {
        prop_assert_eq!(round_trip(&health), health);
    }

    #[test]
    fn arbitrary_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        let _ = decode::<LaserScan>(&bytes);
        let _ = decode::<EventChange>(&bytes);
        let _ = decode::<EventAcknowledgement>(&bytes);
        let _ = decode::<Health>(&bytes);
        any_body::<LaserScan>(&bytes);
        any_body::<EventChange>(&bytes);
        any_body::<EventAcknowledgement>(&bytes);
        any_body::<Health>(&bytes);
        let _ = decode::<CarriedScan>(&bytes);
        let _ = decode::<EventPage>(&bytes);
        let _ = decode::<Claims>(&bytes);
        let _ = decode::<HostHealth>(&bytes);
        let _ = decode::<FilePage>(&bytes);
        let _ = decode::<Ownership>(&bytes);
        let _ = decode::<CarriedMap>(&bytes);
        let _ = decode::<CarriedCounts>(&bytes);
        any_body::<CarriedMap>(&bytes);
        any_body::<CarriedCounts>(&bytes);
        any_body::<CarriedScan>(&bytes);
        any_body::<EventPage>(&bytes);
        any_body::<Claims>(&bytes);
        any_body::<HostHealth>(&bytes);
        any_body::<FilePage>(&bytes);
        any_body::<Ownership>(&bytes);
    }
}

#[test]
fn a_message_that_is_cut_anywhere_says_that_it_is_cut() {
    cut_anywhere(&samples::scan());
    cut_anywhere(&samples::event());
    cut_anywhere(&samples::acknowledgement());
    cut_anywhere(&samples::health());
    cut_anywhere(&samples::carried_scan());
    cut_anywhere(&samples::event_page());
    cut_anywhere(&samples::carried_map());
    cut_anywhere(&samples::carried_counts());
}

#[test]
fn a_flipped_bit_is_never_a_panic_and_in_the_envelope_never_unseen() {
    flip_everywhere(&samples::scan());
    flip_everywhere(&samples::event());
    flip_everywhere(&samples::acknowledgement());
    flip_everywhere(&samples::health());
    flip_everywhere(&samples::carried_scan());
    flip_everywhere(&samples::event_page());
}

#[test]
fn a_refusal_says_what_was_found_and_what_was_expected() {
    let good = encode(&samples::acknowledgement()).unwrap();
    let say = |at: usize, byte: u8| {
        let mut bytes = good.clone();
        bytes[at] = byte;
        decode::<EventAcknowledgement>(&bytes).unwrap_err().to_string()
    };
    assert_eq!(
        say(0, b'P'),
        "EventAcknowledgement: found magic [80, 71], expected [84, 71]: \
         these bytes are not a tog message"
    );
    assert_eq!(say(2, 9), "EventAcknowledgement: found message kind 9, expected 3");
    assert_eq!(
        say(3, 2),
        "EventAcknowledgement: found version 2, this tog reads 1: update the older host"
    );
    assert_eq!(say(4, 200), "EventAcknowledgement: message is cut: found 8 bytes, expected 200");
    assert_eq!(
        say(7, 1),
        format!(
            "EventAcknowledgement: body of {} bytes, at most {BODY_BYTES_MAX} are read",
            (1 << 24) + 8
        )
    );
    assert_eq!(
        decode::<Health>(&good).unwrap_err().to_string(),
        "Health: found message kind 3, expected 4"
    );
    assert_eq!(
        decode::<Health>(&[]).unwrap_err().to_string(),
        "Health: message is cut: found 0 bytes, expected 8"
    );
}

#[test]
fn no_message_out_of_its_bounds_is_written_or_read() {
    let refused = |error: DecodeError| match error {
        DecodeError::Body { reason, .. } => reason,
        other => panic!("{other}"),
    };
    let mut scan = samples::scan();
    scan.ranges_m = vec![0.0; BEAMS_MAX + 1];
    assert_eq!(refused(encode(&scan).unwrap_err()), "4097 beams, expected at most 4096");
    let mut scan = samples::scan();
    scan.geometry.angle_increment_rad = f64::NAN;
    assert!(refused(encode(&scan).unwrap_err()).contains("not finite"));
    let mut event = samples::event();
    event.text = "a".repeat(2001);
    assert!(refused(encode(&event).unwrap_err()).contains("2001 bytes, expected at most 2000"));
    let mut event = samples::event();
    event.bounds_m[2] = f64::INFINITY;
    assert!(refused(encode(&event).unwrap_err()).contains("not finite"));
    // The same bounds hold for bytes of a stranger: a NaN written over the score.
    let mut bytes = encode(&samples::event()).unwrap();
    let score = samples::event().score.to_le_bytes();
    let at = bytes.windows(8).position(|window| window == score).unwrap();
    bytes[at..at + 8].copy_from_slice(&f64::NAN.to_le_bytes());
    assert!(refused(decode::<EventChange>(&bytes).unwrap_err()).contains("not finite"));
}

#[test]
fn a_body_that_claims_a_list_longer_than_itself_is_refused() {
    // stamp, device stamp, geometry, then a length of 2^63 in postcard's variable-length code.
    let mut body = vec![0, 0];
    body.extend([0; 32]);
    body.extend([0xff; 9]);
    body.push(0x01);
    any_body::<LaserScan>(&body);
    let mut bytes = vec![b'T', b'G', LaserScan::KIND, LaserScan::VERSION];
    bytes.extend((body.len() as u32).to_le_bytes());
    bytes.extend(&body);
    assert!(matches!(decode::<LaserScan>(&bytes), Err(DecodeError::Body { .. })));
}

#[test]
fn a_page_whose_rows_do_not_follow_each_other_is_refused() {
    let refused = |edit: fn(&mut EventPage)| {
        let mut page = samples::event_page();
        edit(&mut page);
        encode(&page).unwrap_err().to_string()
    };
    let told = refused(|page| page.after = 8);
    assert!(told.contains("row 8 behind row 8 of a journal that ends at 9"), "{told}");
    assert!(refused(|page| page.head = 7).contains("ends at 7"));
    assert!(refused(|page| page.rows.push(page.rows[0].clone())).contains("row 8 behind row 8"));
    let told = refused(|page| page.rows = vec![page.rows[0].clone(); PAGE_ROWS_MAX + 1]);
    assert!(told.contains("65 rows in a page, expected at most 64"), "{told}");
    assert!(refused(|page| page.rows[0].change.sequence = 0).contains("numbers from 1"));
}
