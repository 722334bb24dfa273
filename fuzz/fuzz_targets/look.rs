#![no_main]

use clerestory::look::Look;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let text = String::from_utf8_lossy(bytes);
    let _ = Look::from_json(&text);
    if let Ok((look, _)) = Look::recover(&text) {
        assert!(Look::from_json(&look.to_json()).is_ok_and(|(_, warnings)| warnings.is_empty()));
    }
});
