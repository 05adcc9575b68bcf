//! The binary `stylegaussian`: see `stylegaussian --help`.

mod arguments;
mod choose;
mod commands;
mod compute;
mod download;
mod hand;
mod knobs;
mod masks;
mod motion;
mod outputs;
mod relief;
mod scenes;
mod stylization;
mod terminal;
mod video;

use std::{env, panic, process::ExitCode};

use clap::Parser;
use stylegaussian_encoder::guard::is_guarded;

use commands::Cli;
use terminal::{Interrupt, error_chain, is_broken_pipe};

/// 0 on success, 1 on an error, 2 on a usage error.
fn main() -> ExitCode {
    // First of all: setting a variable is sound only while there is one thread, and `Interrupt` starts another.
    quiet_headless_vulkan();
    keep_quiet_about_caught_panics();
    let cli = Cli::parse();
    match Interrupt::new().and_then(|interrupt| cli.run(&interrupt)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // Some contradictions between arguments are found only after parsing.
            if let Some(usage) = error.downcast_ref::<clap::Error>() {
                usage.exit();
            }
            // The exit code tells of the failure all the same.
            if !is_broken_pipe(&error) {
                eprintln!("error: {}", error_chain(&error));
            }
            ExitCode::FAILURE
        }
    }
}

/// Prints no panic that becomes an error: the error's line says all that its reader can use.
fn keep_quiet_about_caught_panics() {
    let default = panic::take_hook();
    panic::set_hook(Box::new(move |panic| {
        if !is_guarded() {
            default(panic);
        }
    }));
}

/// Keeps Mesa's device-selection layer out of Vulkan on Linux without a session. Every Vulkan program loads
/// this layer, and without a display it prints an error although it has nothing to select.
fn quiet_headless_vulkan() {
    if cfg!(target_os = "linux") && env::var_os("XDG_RUNTIME_DIR").is_none() {
        #[expect(unsafe_code, reason = "sound before the first thread starts, and nothing has run yet")]
        unsafe {
            env::set_var("NODEVICE_SELECT", "1");
        }
    }
}
