#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| clerestory_fuzz::documents::wishes(bytes));
