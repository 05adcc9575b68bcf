//! The compiler for browsers: rustup's target, or the one that Debian packages.

use std::{
    env, fs,
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Context, Result, bail};

use crate::steps::cargo;

/// The target of browsers.
pub const TARGET: &str = "wasm32-unknown-unknown";

/// Debian's `rustc-web` and `cargo-web`, which do not take the place of rustup's.
const DEBIAN: [&str; 2] = ["/usr/bin/rustc", "/usr/bin/cargo"];

/// The standard library's source in Debian's `rust-web-src`. There is no compiled one for browsers.
const DEBIAN_SOURCE: &str = "/usr/lib/rustlib/src/rust/library";

/// A compiler for browsers.
pub enum Toolchain {
    /// The toolchain that runs this program has the target.
    Rustup,
    /// Debian's compiler. It builds the standard library too, and needs this linker.
    Debian(PathBuf),
}

impl Toolchain {
    /// The toolchain of this machine.
    ///
    /// # Errors
    /// If there is none. The message says how to get one.
    pub fn find() -> Result<Self> {
        if has_target()? {
            return Ok(Self::Rustup);
        }
        let is_there = DEBIAN.iter().all(|program| Path::new(program).is_file());
        if is_there
            && Path::new(DEBIAN_SOURCE).is_dir()
            && let Some(linker) = debian_linker()
        {
            return Ok(Self::Debian(linker));
        }
        bail!(
            "no Rust compiler for browsers was found. Run: rustup target add {TARGET}\n\
             On Debian without rustup's server: apt-get install rustc-web cargo-web rust-web-src lld-22"
        )
    }

    /// `cargo SUBCOMMAND` for browsers.
    pub fn cargo(&self, subcommand: &str) -> Command {
        match self {
            Self::Rustup => cargo([subcommand, "--target", TARGET]),
            Self::Debian(linker) => {
                let mut command = Command::new(DEBIAN[1]);
                command.args([subcommand, "--target", TARGET, "-Zbuild-std=std,panic_abort"]);
                // `-Z` is for nightly compilers, unless this says otherwise.
                command.env("RUSTC_BOOTSTRAP", "1").env("RUSTC", DEBIAN[0]);
                command.env("CARGO_TARGET_WASM32_UNKNOWN_UNKNOWN_LINKER", linker);
                // rustup's cargo, which runs this program, names its own.
                command.env_remove("CARGO").env_remove("RUSTUP_TOOLCHAIN");
                command
            }
        }
    }
}

/// Whether rustup has installed the target's standard library.
fn has_target() -> Result<bool> {
    let rustc = env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let mut command = Command::new(rustc);
    command.args(["--print", "target-libdir", "--target", TARGET]);
    let output = command.output().context("cannot run `rustc`")?;
    let folder = PathBuf::from(String::from_utf8_lossy(&output.stdout).trim());
    // The folder's name is printed whether it exists or not.
    Ok(output.status.success() && folder.is_dir())
}

/// The newest `wasm-ld-N` of Debian's `lld-N`.
fn debian_linker() -> Option<PathBuf> {
    let version = |path: &PathBuf| -> Option<u32> {
        path.file_name()?.to_str()?.strip_prefix("wasm-ld-")?.parse().ok()
    };
    let entries = fs::read_dir("/usr/bin").ok()?.flatten().map(|entry| entry.path());
    entries.filter(|path| version(path).is_some()).max_by_key(|path| version(path))
}
