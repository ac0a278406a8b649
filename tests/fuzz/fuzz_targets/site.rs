#![no_main]
//! A text of a stranger as a site file: refused in words or read, drawn with and without colour.

use protocol::site::Site;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    match Site::parse_with_warnings(text, "fuzz.toml") {
        Ok((site, warnings)) => {
            assert!(!warnings.has_errors());
            let _ = warnings.render(true);
            for area in &site.areas {
                assert!(site.lasers_of(&area.id).count() > 0);
                assert!(area.grid().cells() > 0 && area.lattice().period_ns() > 0);
                assert!(area.prototypes().iter().all(|class| {
                    class.prototype.len() == area.timescales_s.len()
                }));
            }
        }
        Err(errors) => {
            assert!(errors.has_errors());
            assert!(!errors.to_string().contains('\u{1b}'));
            let _ = errors.render(true);
        }
    }
});
