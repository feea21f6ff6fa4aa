#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| volpm_fuzz::reads(bytes, "hdr"));
