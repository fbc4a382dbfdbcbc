#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| pirouette_fuzz::photos(bytes));
