#![no_main]

#[expect(dead_code, reason = "one of its targets")]
#[path = "../src/documents.rs"]
mod documents;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| documents::look(bytes));
