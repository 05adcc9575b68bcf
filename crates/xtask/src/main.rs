//! Set-up and chores of the workspace: `cargo xtask test | demo | pictures | bench | world | fly | assets |
//! fuzz | soak | web | package`.

mod assets;
mod bench;
mod demo;
mod examples;
mod features;
mod files;
mod fuzz;
mod lines;
mod packages;
mod publish;
mod soak;
mod steps;
mod test;
mod web;

use std::{env, process::ExitCode};

use anyhow::{Context, Result, bail};

const USAGE: &str = "\
Usage: cargo xtask <COMMAND>

  test     everything CI runs: formatting, lints, docs, tests, examples, packages
  demo     the demo scene in every shipped style, in a window; without a display, as pictures in out/demo
  pictures a picture of each feature, in docs/features, for docs/features.md; minutes without a GPU
  bench    how fast everything is, beside what it could be: [--quick] [--json FILE] \
           [--peer BINARY] [--only WORD]
  world    a world of any size, copies of scenes on hills, in chunks that are streamed: --gaussians N \
           -o FOLDER, of N Gaussians at the finest level; [SCENE...]
  fly      a flight through a world, without a window: what its frames cost, memory, holes and popping: \
           FOLDER [--frames N] [--budget N] [--style IMAGE] [--against-full] [--cpu-time] [--json FILE]
  assets   make everything in assets/ and the default decoder anew; needs the test data, and hours
  fuzz     every reader of files against made-up files: [TARGET...] [--seconds N], 60 each; needs nightly \
           and cargo-fuzz
  soak     the plugin for half an hour or 10,000 rounds of random changes: [--seconds N] [--seed S]
  web      the page for browsers in web/dist: [--test] tests it in Chromium, [--serve] serves it on localhost, \
           [--example NAME] builds
           an example instead
  package  the published crates: packs each, builds it from its package, and builds its docs; takes long";

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<()> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let root = steps::workspace_root();
    env::set_current_dir(&root).with_context(|| format!("cannot enter {}", root.display()))?;
    match arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["test"] => test::run(),
        ["demo"] => demo::run(),
        ["pictures"] => demo::pictures(),
        ["bench", ..] => bench::run(&arguments[1..]),
        ["world", ..] => bench::world(&arguments[1..]),
        ["fly", ..] => bench::fly(&arguments[1..]),
        ["assets"] => assets::run(),
        ["fuzz", ..] => fuzz::run(&arguments[1..]),
        ["soak", ..] => soak::run(&arguments[1..]),
        ["web", ..] => web::run(&arguments[1..]),
        ["package"] => publish::run(),
        ["help" | "--help" | "-h"] => {
            println!("{USAGE}");
            Ok(())
        }
        [] => bail!("a command is missing\n\n{USAGE}"),
        _ => bail!("unknown arguments: {}\n\n{USAGE}", arguments.join(" ")),
    }
}
