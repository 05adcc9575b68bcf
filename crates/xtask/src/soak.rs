//! `cargo xtask soak`: an app without a window that loads, styles, fades and drops at random, for half an hour.

use anyhow::{Context, Result, bail, ensure};

use crate::{
    packages::install_graphics,
    steps::{Steps, cargo},
};

/// Seconds if none are given.
const SECONDS: u64 = 1800;

/// Runs the ignored test `soak` of the plugin. It stops after 10,000 rounds or `--seconds N`, whichever is
/// first.
pub fn run(arguments: &[String]) -> Result<()> {
    let (mut seconds, mut seed) = (SECONDS, 1_u64);
    for pair in arguments.chunks(2) {
        let [name, number] = pair else { bail!("{}: a number is missing", pair[0]) };
        let number = number.parse().with_context(|| format!("{name} {number}: expected a whole number"))?;
        match name.as_str() {
            "--seconds" => seconds = number,
            "--seed" => seed = number,
            _ => bail!("found `{name}`, expected --seconds N or --seed S"),
        }
    }
    ensure!(seconds > 0, "--seconds 0: expected at least 1");
    let mut steps = Steps::default();
    install_graphics(&mut steps, false)?;
    // The plugin alone would have Bevy compiled once more: see `features`.
    let mut command = cargo(["test", "--locked", "--workspace", "--lib", "tests::soak::soak"]);
    command.args(["--", "--ignored", "--exact", "--nocapture"]);
    command.env("STYLEGAUSSIAN_SOAK_SECONDS", seconds.to_string());
    command.env("STYLEGAUSSIAN_SOAK_SEED", seed.to_string());
    steps.run("soak", &mut command)
}
