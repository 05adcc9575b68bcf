#![no_main]

#[path = "../readers/encoder.rs"]
mod reader;

libfuzzer_sys::fuzz_target!(
    // A panic that becomes an error is what is wanted. Any other ends the run.
    init: {
        let hook = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            if !stylegaussian_encoder::guard::is_guarded() {
                hook(panic);
            }
        }));
    },
    |data: &[u8]| reader::read(data)
);
