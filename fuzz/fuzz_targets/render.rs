#![no_main]

libfuzzer_sys::fuzz_target!(|text: &str| volpm_fuzz::renders(text));
