//! The binary `stylegaussian`: see `stylegaussian --help`.

use std::{env, io, process::ExitCode};

use clap::Parser;
use stylegaussian_tools::cli::{Cli, error_chain};

/// 0 on success, 1 on an error, 2 on a usage error.
fn main() -> ExitCode {
    quiet_headless_vulkan();
    match Cli::parse().run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // Arguments that contradict one another are found only after parsing.
            if let Some(usage) = error.downcast_ref::<clap::Error>() {
                usage.exit();
            }
            if !is_broken_pipe(&error) {
                eprintln!("error: {}", error_chain(&error));
            }
            ExitCode::FAILURE
        }
    }
}

/// On Linux without a session, Mesa's device-selection layer, which every Vulkan program loads, prints an error about a
/// display that nobody asked for. It has nothing to select there, so it stays out.
fn quiet_headless_vulkan() {
    if cfg!(target_os = "linux") && env::var_os("XDG_RUNTIME_DIR").is_none() {
        #[expect(unsafe_code, reason = "sound before the first thread starts, and nothing has run yet")]
        unsafe {
            env::set_var("NODEVICE_SELECT", "1");
        }
    }
}

/// Whether whoever read our output has gone, as in `stylegaussian info scene.ply | head -1`: nobody is there to tell.
fn is_broken_pipe(error: &anyhow::Error) -> bool {
    let of_kind = |error: &io::Error| error.kind() == io::ErrorKind::BrokenPipe;
    error.downcast_ref::<io::Error>().is_some_and(of_kind)
}
