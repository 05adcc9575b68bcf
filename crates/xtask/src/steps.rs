//! Runs other programs, one step after another, and reports the outcome of each.

use std::{
    env,
    ffi::OsStr,
    io::{self, BufRead, BufReader, IsTerminal, Write},
    path::{Path, PathBuf},
    process::{Command, Stdio},
    time::{Duration, Instant},
};

use anyhow::{Context, Result, bail};

/// The workspace's root folder.
pub fn workspace_root() -> PathBuf {
    // Cargo says where it runs. What was compiled may come from a cache that another checkout shares.
    let here =
        env::var_os("CARGO_MANIFEST_DIR").map_or_else(|| env!("CARGO_MANIFEST_DIR").into(), PathBuf::from);
    here.ancestors().nth(2).unwrap_or(&here).to_path_buf()
}

/// The folder in which tests look for real captures and photos, which are not in the repository.
pub fn data_folder() -> PathBuf {
    env::var_os("STYLEGAUSSIAN_DATA").map_or_else(
        || {
            let root = workspace_root();
            root.parent().unwrap_or(Path::new("/")).join("shared").join("data")
        },
        PathBuf::from,
    )
}

/// The folder into which cargo builds.
pub fn target_folder() -> PathBuf {
    env::var_os("CARGO_TARGET_DIR").map_or_else(|| PathBuf::from("target"), PathBuf::from)
}

/// The cargo that runs this program, with `arguments`.
pub fn cargo<S: AsRef<OsStr>>(arguments: impl IntoIterator<Item = S>) -> Command {
    // `cargo xtask` sets it. It is the cargo of the same toolchain.
    let mut command = Command::new(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    // A step that asked a question would hang where nobody can answer.
    command.args(arguments).stdin(Stdio::null());
    // `cargo run` describes xtask in these variables. Some build scripts (ring's) watch them, so with them
    // cargo would compile more than it does when it is called by hand.
    for (name, _) in env::vars_os() {
        let text = name.to_string_lossy();
        if text.starts_with("CARGO_PKG_") || text.starts_with("CARGO_MANIFEST_") {
            command.env_remove(&name);
        }
    }
    command
}

/// Whether `program --version` runs.
pub fn is_installed(program: &str) -> bool {
    let mut probe = Command::new(program);
    probe.arg("--version").stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    probe.status().is_ok_and(|status| status.success())
}

enum Outcome {
    Passed(Duration),
    Failed(Duration),
    NotRun(String),
}

/// The steps so far. The summary names every one of them.
#[derive(Default)]
pub struct Steps {
    done: Vec<(String, Outcome)>,
    closing_lines: Vec<String>,
}

impl Steps {
    /// Runs `command` with its output on the terminal.
    ///
    /// # Errors
    /// If it cannot start or fails.
    pub fn run(&mut self, name: &str, command: &mut Command) -> Result<()> {
        self.time(name, command, |command| Ok(command.status()?.success()))
    }

    /// Like [`Steps::run`], and repeats in the summary the lines of its output that `is_closing` picks: the
    /// closing lines of a test runner. The step fails if there are none, because then no test ran.
    pub fn run_keeping(
        &mut self,
        name: &str,
        command: &mut Command,
        is_closing: fn(&str) -> bool,
    ) -> Result<()> {
        let mut kept = Vec::new();
        let outcome = self.time(name, command, |command| {
            let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn()?;
            // Both pipes are read at the same time: a child blocks once the one that is not read is full.
            let (stdout, stderr) = (child.stdout.take(), child.stderr.take());
            std::thread::scope(|scope| {
                let from_stderr = scope.spawn(|| forward(stderr, io::stderr(), is_closing));
                kept = forward(stdout, io::stdout(), is_closing);
                kept.extend(from_stderr.join().unwrap_or_default());
            });
            if kept.is_empty() {
                eprintln!("{name}: nothing ran");
            }
            Ok(child.wait()?.success() && !kept.is_empty())
        });
        self.closing_lines.append(&mut kept);
        outcome
    }

    /// Builds an example of any member. Returns its program.
    ///
    /// # Errors
    /// If it cannot be built.
    pub fn example(&mut self, name: &str) -> Result<Command> {
        // `cargo run` would select one member, and compile dependencies once more: see `features`.
        let build = ["build", "--locked", "--workspace", "--example", name];
        self.run(&format!("example {name}"), &mut cargo(build))?;
        Ok(Command::new(target_folder().join("debug").join("examples").join(name)))
    }

    /// Runs `check` in this process, as a step.
    pub fn check(&mut self, name: &str, check: impl FnOnce() -> Result<()>) -> Result<()> {
        eprintln!("\n── {name}");
        let start = Instant::now();
        let outcome = check();
        let passed = if outcome.is_ok() { Outcome::Passed } else { Outcome::Failed };
        self.done.push((name.into(), passed(start.elapsed())));
        outcome.with_context(|| format!("{name} failed"))
    }

    /// Notes that a step does not run here, and the reason.
    pub fn not_run(&mut self, name: &str, reason: &str) {
        eprintln!("\n── {name}: NOT RUN, {reason}");
        self.done.push((name.into(), Outcome::NotRun(reason.into())));
    }

    fn time(
        &mut self,
        name: &str,
        command: &mut Command,
        run: impl FnOnce(&mut Command) -> io::Result<bool>,
    ) -> Result<()> {
        let line = command_line(command);
        eprintln!("\n── {name}: {line}");
        let start = Instant::now();
        let passed = run(command).with_context(|| format!("{name}: cannot run `{line}`"))?;
        let elapsed = start.elapsed();
        if passed {
            self.done.push((name.into(), Outcome::Passed(elapsed)));
            return Ok(());
        }
        self.done.push((name.into(), Outcome::Failed(elapsed)));
        bail!("{name} failed; its messages are above. To run it alone: {line}")
    }

    /// Prints every step with its time, and the test runners' closing lines.
    pub fn print_summary(&self) {
        eprintln!("\n── summary");
        for (name, outcome) in &self.done {
            match outcome {
                Outcome::Passed(time) => eprintln!("   passed  {:>7.1} s  {name}", time.as_secs_f64()),
                Outcome::Failed(time) => eprintln!("   FAILED  {:>7.1} s  {name}", time.as_secs_f64()),
                Outcome::NotRun(reason) => eprintln!("   not run            {name}: {reason}"),
            }
        }
        for line in &self.closing_lines {
            eprintln!("   {}", line.trim());
        }
    }
}

/// Copies `from` to `to` line by line. Returns the closing lines.
fn forward(from: Option<impl io::Read>, mut to: impl Write, is_closing: fn(&str) -> bool) -> Vec<String> {
    let mut kept = Vec::new();
    let Some(from) = from else { return kept };
    let mut reader = BufReader::new(from);
    let mut line = Vec::new();
    // Bytes and not `lines`: a test may print what is not UTF-8.
    while reader.read_until(b'\n', &mut line).is_ok_and(|n_bytes| n_bytes > 0) {
        // If the terminal is closed, go on reading: otherwise the child would block.
        let _ = to.write_all(&line);
        let text = String::from_utf8_lossy(&line);
        if is_closing(&text) {
            kept.push(text.into_owned());
        }
        line.clear();
    }
    kept
}

/// Asks a child with piped output for colors if a person watches.
pub fn keep_colors(command: &mut Command) -> &mut Command {
    if io::stderr().is_terminal() {
        // cargo sees a pipe and would leave colors out.
        command.env("CARGO_TERM_COLOR", "always");
    }
    command
}

/// The command as typed in a shell.
fn command_line(command: &Command) -> String {
    let program = Path::new(command.get_program());
    let program = program.file_stem().filter(|&name| name == "cargo").unwrap_or(program.as_os_str());
    let variables = command.get_envs().filter_map(|(name, value)| {
        let value = value?.to_string_lossy();
        // It changes nothing but colors, and the line is there to be typed again.
        (name != "CARGO_TERM_COLOR").then(|| format!("{}={}", name.to_string_lossy(), quoted(&value)))
    });
    let words = std::iter::once(program).chain(command.get_args());
    variables.chain(words.map(|word| quoted(&word.to_string_lossy()))).collect::<Vec<_>>().join(" ")
}

// Only for people to copy: the words of these commands have no other special characters.
fn quoted(word: &str) -> String {
    if word.contains([' ', '"', '*']) { format!("'{word}'") } else { word.into() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failing_step_fails_and_is_in_the_summary() {
        let mut steps = Steps::default();
        let failure = steps.run("no such command", &mut cargo(["no-such-command"])).unwrap_err();
        assert!(failure.to_string().contains("cargo no-such-command"), "{failure}");
        assert!(matches!(steps.done[..], [(_, Outcome::Failed(_))]));
    }

    #[test]
    fn a_program_that_does_not_exist_is_named() {
        let failure = Steps::default().run("x", &mut Command::new("no-such-program")).unwrap_err();
        assert!(failure.to_string().contains("no-such-program"), "{failure}");
    }

    #[test]
    fn closing_lines_are_kept() {
        let mut steps = Steps::default();
        steps.run_keeping("version", &mut cargo(["--version"]), |line| line.starts_with("cargo ")).unwrap();
        assert_eq!(steps.closing_lines.len(), 1);
    }

    #[test]
    fn a_step_without_closing_lines_fails() {
        let mut steps = Steps::default();
        let outcome =
            steps.run_keeping("version", &mut cargo(["--version"]), |line| line.starts_with("test "));
        assert!(outcome.is_err() && matches!(steps.done[..], [(_, Outcome::Failed(_))]));
    }

    #[test]
    fn commands_are_printed_as_typed() {
        let mut command = cargo(["doc", "a b"]);
        command.env("RUSTDOCFLAGS", "-D warnings");
        assert!(command_line(&command).ends_with("RUSTDOCFLAGS='-D warnings' cargo doc 'a b'"));
    }
}
