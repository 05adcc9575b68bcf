//! `cargo xtask fuzz`: runs the fuzz targets, each for a while. Needs nightly Rust and cargo-fuzz, which
//! nothing else does.

use std::process::{Command, Stdio};

use anyhow::{Context, Result, bail, ensure};

use crate::steps::{Steps, data_folder, workspace_root};

/// The targets in `fuzz/`, and the feature that builds each. The quick ones to build come first.
const TARGETS: [(&str, &str); 13] = [
    ("scene", ""),
    ("decoder", ""),
    ("style", ""),
    ("paint", ""),
    ("look", ""),
    ("mask", ""),
    ("pins", ""),
    ("world", ""),
    ("pytorch", ""),
    ("cameras", ""),
    ("checkpoint", ""),
    ("image", "encoder"),
    ("encoder", "encoder"),
];

/// Seconds for each target if none are given.
const SECONDS: u32 = 60;
/// Most memory of a run, in MiB. Reading 100 kB takes a hundredth of it.
const MEMORY: &str = "-rss_limit_mb=2048";
/// Most seconds of one input. The slowest take a tenth.
const TIMEOUT: &str = "-timeout=20";
/// Longest input, in bytes, so that runs stay quick.
const LONGEST: &str = "-max_len=65536";

/// Fills the corpora and runs the targets that `arguments` name, or all.
pub fn run(arguments: &[String]) -> Result<()> {
    let (targets, seconds) = parse(arguments)?;
    expect_tools()?;
    let mut steps = Steps::default();
    let outcome = run_all(&mut steps, &targets, seconds);
    steps.print_summary();
    outcome
}

fn run_all(steps: &mut Steps, targets: &[(&str, &str)], seconds: u32) -> Result<()> {
    let mut seeds = steps.example("fuzz_seeds")?;
    steps.run("seeds", seeds.arg(workspace_root()).arg(data_folder()))?;
    for (target, feature) in targets {
        // Of one codegen unit, which is the default, the graph engine takes 10 GB to build with sanitizers.
        let mut command = nightly(&["fuzz", "run", target, "--features", feature, "--codegen-units", "16"]);
        // Files of past findings are read first of all, with the corpus.
        command.arg("--").arg(format!("-max_total_time={seconds}")).args([MEMORY, TIMEOUT, LONGEST]);
        steps.run(target, &mut command)?;
    }
    Ok(())
}

/// The targets and the seconds for each.
fn parse(arguments: &[String]) -> Result<(Vec<(&'static str, &'static str)>, u32)> {
    let (mut targets, mut seconds) = (Vec::new(), SECONDS);
    let mut words = arguments.iter();
    while let Some(word) = words.next() {
        if word == "--seconds" {
            let number = words.next().context("--seconds: a number is missing")?;
            seconds =
                number.parse().with_context(|| format!("--seconds {number}: expected a whole number"))?;
        } else {
            let known = TARGETS.into_iter().find(|(name, _)| name == word);
            let names = TARGETS.map(|(name, _)| name).join(", ");
            targets.push(known.with_context(|| format!("found `{word}`, expected a target: {names}"))?);
        }
    }
    ensure!(seconds > 0, "--seconds 0: expected at least 1");
    Ok((if targets.is_empty() { TARGETS.into() } else { targets }, seconds))
}

/// The cargo of nightly Rust.
fn nightly(arguments: &[&str]) -> Command {
    let mut command = Command::new("rustup");
    command.args(["run", "nightly", "cargo"]).args(arguments).stdin(Stdio::null());
    // `cargo run` names its own toolchain in these, which nightly's cargo would take for its own.
    for variable in ["CARGO", "RUSTC", "RUSTDOC", "RUSTUP_TOOLCHAIN"] {
        command.env_remove(variable);
    }
    command
}

fn expect_tools() -> Result<()> {
    let works = |command: &mut Command| {
        command.stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok_and(|status| status.success())
    };
    if !works(&mut nightly(&["--version"])) {
        bail!("fuzzing needs nightly Rust, which was not found: rustup toolchain install nightly");
    }
    if !works(&mut nightly(&["fuzz", "--version"])) {
        bail!("fuzzing needs cargo-fuzz, which was not found: cargo install cargo-fuzz --locked");
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(text: &str) -> Vec<String> {
        text.split_whitespace().map(String::from).collect()
    }

    #[test]
    fn arguments() {
        let (targets, seconds) = parse(&words("scene --seconds 5 look")).unwrap();
        assert_eq!((targets, seconds), (vec![("scene", ""), ("look", "")], 5));
        assert_eq!(parse(&[]).unwrap(), (TARGETS.to_vec(), SECONDS));
        for text in ["nothing", "--seconds", "--seconds x", "--seconds 0"] {
            assert!(parse(&words(text)).is_err(), "{text}");
        }
    }

    /// Every target of the manifest is run, and has files of its own.
    #[test]
    fn targets_are_the_manifest_s() {
        let root = workspace_root();
        let manifest = std::fs::read_to_string(root.join("fuzz/Cargo.toml")).unwrap();
        let n_targets = manifest.matches("path = \"fuzz_targets/").count();
        assert_eq!(n_targets, TARGETS.len());
        for (name, _) in TARGETS {
            assert!(manifest.contains(&format!("path = \"fuzz_targets/{name}.rs\"")), "{name}");
        }
    }
}
