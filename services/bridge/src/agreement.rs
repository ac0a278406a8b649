//! Do two hosts have the same site file?
//!
//! Each tells a number made of what concerns more than one of them: hosts, areas, lasers, where they are
//! and where they run. Not of the rest: a remark, a setting of one area, an address that is seen from
//! elsewhere. The text that is hashed is ours, not that of a library: hosts of two versions agree. Pure.

use protocol::site::Site;
use std::fmt::Write;

/// The name of the gauge that tells it.
pub const GAUGE: &str = "site_fingerprint";

/// A number that differs where site files differ in what concerns several hosts.
#[must_use]
pub fn fingerprint(site: &Site) -> u32 {
    let mut text = format!("{}\n", site.name);
    let mut line = |words: std::fmt::Arguments<'_>| {
        let _ = text.write_fmt(words); // into memory
        text.push('\n');
    };
    for host in &site.hosts {
        line(format_args!("host {} {} {:?} {:?}", host.id, host.desk, host.follows, host.through));
        // The first has no line, so that hosts of versions that knew one only say the same.
        if host.certificate_number != 1 {
            line(format_args!("certificate {}", host.certificate_number));
        }
    }
    for area in &site.areas {
        let (x_m, y_m, cell_m) = (area.origin_m[0], area.origin_m[1], area.cell_m);
        line(format_args!("area {} {:?} {:?}", area.id, area.host, area.standby));
        line(format_args!("{x_m} {y_m} {cell_m} {} {}", area.columns, area.rows));
        line(format_args!("{:?} {}", area.timescales_s, area.class_names().len()));
    }
    for laser in &site.lasers {
        line(format_args!("laser {} {:?} {}", laser.id, laser.host, laser.area));
        line(format_args!("{} {} {}", laser.x_m, laser.y_m, laser.yaw_deg));
    }
    crc32fast::hash(text.as_bytes())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_remark_is_no_difference_and_a_moved_laser_is_one() {
        let text = "name = \"t\"\n[[area]]\nid = \"a\"\norigin_m = [0.0, 0.0]\ncolumns = 10\nrows = 10\n\
                    [[laser]]\nid = \"l\"\narea = \"a\"\nx_m = 0.5\ny_m = 0.5\n\
                    source = { kind = \"simulator\", scene = \"room\" }\n";
        let of = |text: &str| fingerprint(&Site::parse(text, "t").unwrap());
        assert_eq!(of(text), of(&format!("# a remark\n{text}")));
        assert_ne!(of(text), of(&text.replace("x_m = 0.5", "x_m = 0.6")));
        let hosts = "[[host]]\nid = \"h\"\nendpoint = \"a:1\"\ntransport = \"tls\"\n";
        let placed =
            format!("{text}{hosts}").replace("\"a\"\norigin", "\"a\"\nhost = \"h\"\norigin");
        assert_ne!(of(&placed), of(&format!("{placed}certificate_number = 2\n")), "one is revoked");
        assert_eq!(of(text), 2_199_554_105, "hosts of other versions say the same number");
    }
}
