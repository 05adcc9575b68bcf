//! The Snakemake workflows: their settings, and the commands that they call.

use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
    process::Command,
};

#[expect(dead_code, reason = "written for the tests of the command line, of which these use a part")]
mod support;

use support::{Bench, stylegaussian};

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// A file of a workflow.
fn file(workflow: &str, name: &str) -> String {
    fs::read_to_string(repository().join("workflows").join(workflow).join(name)).unwrap()
}

/// The shell commands of a Snakefile's rules, each in one line.
fn commands(snakefile: &str) -> Vec<String> {
    let blocks = snakefile.split("    shell:\n").skip(1);
    let texts = |block: &str| -> String {
        let lines = block.lines().map_while(|line| line.trim().strip_prefix('"')?.strip_suffix('"'));
        lines.collect()
    };
    blocks.map(texts).collect()
}

/// The subcommand that comes after `before`, and all options of a line.
fn call<'a>(line: &'a str, before: &str) -> (&'a str, Vec<&'a str>) {
    let subcommand = line.split_once(before).unwrap_or_else(|| panic!("no {before} in {line}")).1;
    let is_of_name = |c: char| c.is_ascii_alphanumeric() || c == '-';
    let words = |text: &'a str| text.split(move |c: char| !is_of_name(c)).filter(|word| !word.is_empty());
    (words(subcommand).next().unwrap(), words(line).filter(|word| word.starts_with('-')).collect())
}

/// Checks that the help of a subcommand has these options.
fn check((subcommand, options): (&str, Vec<&str>)) {
    let help = stylegaussian(&[subcommand, "--help"]).expect_success().stdout;
    let known: BTreeSet<&str> = help
        .split(|c: char| !c.is_ascii_alphanumeric() && c != '-')
        .filter(|word| !word.is_empty())
        .collect();
    assert!(!options.is_empty() && !known.contains("--no-such-option"));
    for option in options {
        assert!(known.contains(option), "`stylegaussian {subcommand}` has no {option}");
    }
}

#[test]
fn workflows_call_commands_and_options_that_exist() {
    for (workflow, n_commands) in [("bake", 2), ("world", 1)] {
        let commands = commands(&file(workflow, "Snakefile"));
        assert_eq!(commands.len(), n_commands, "{workflow}");
        for command in &commands {
            check(call(command, "{params.program:q} "));
        }
        // Examples of further options.
        let config = file(workflow, "config.yaml");
        for line in config.lines().filter(|line| line.contains("Further options")) {
            check(call(line, "`stylegaussian "));
        }
    }
}

#[test]
fn workflows_use_the_settings_of_their_files() {
    for workflow in ["bake", "world"] {
        let (snakefile, config) = (file(workflow, "Snakefile"), file(workflow, "config.yaml"));
        let used = snakefile.split("config[\"").skip(1).map(|rest| rest.split('"').next().unwrap());
        let is_setting = |line: &&str| line.starts_with(|c: char| c.is_ascii_lowercase());
        let settings = config.lines().filter(is_setting).map(|line| line.split(':').next().unwrap());
        assert_eq!(used.collect::<BTreeSet<_>>(), settings.collect::<BTreeSet<_>>(), "{workflow}");
    }
}

#[test]
fn snakemake_plans_a_job_for_each_look() {
    if Command::new("snakemake").arg("--version").output().is_err() {
        eprintln!("SKIPPED: snakemake is not installed, which plans the workflows (`pip install snakemake`)");
        return;
    }
    let bench = Bench::new();
    let scene = bench.plain_scene("a.ply");
    // The world of `config.yaml`.
    stylegaussian(&["tile", &scene, "-o", &bench.path("city"), "--chunk", "64"]).expect_success();
    for (workflow, look) in
        [("bake", "baked/demo/ink.look.safetensors"), ("world", "city_in_mosaic/0_0.look.safetensors")]
    {
        let assets = repository().join("assets").canonicalize().unwrap();
        let config = file(workflow, "config.yaml").replace("assets/", &format!("{}/", assets.display()));
        fs::write(bench.path("my.yaml"), config).unwrap();
        let snakefile = repository().join("workflows").join(workflow).join("Snakefile");
        let output = Command::new("snakemake")
            .args(["--dry-run", "--cores", "1", "--configfile", &bench.path("my.yaml"), "--directory"])
            .arg(bench.dir())
            .arg("--snakefile")
            .arg(snakefile)
            .output()
            .unwrap();
        let told = [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned());
        assert!(output.status.success() && told.concat().contains(look), "{workflow}: {}", told.concat());
    }
}
