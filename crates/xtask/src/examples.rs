//! Starts the examples: a system that Bevy refuses panics when its schedule first runs, which building does not
//! show.

use std::{
    fs,
    io::{BufRead, BufReader},
    path::Path,
    process::{Child, Command, Stdio},
    sync::mpsc::{Receiver, RecvTimeoutError, channel},
    thread,
    time::{Duration, Instant},
};

use anyhow::{Context, Result, bail};

use crate::steps::target_folder;

/// The X server without a screen.
const SERVER: &str = "Xvfb";

/// Examples without a window: `cargo xtask fly` gives the first a world, and `cargo xtask demo` and
/// `cargo xtask pictures` run the others.
const WITHOUT_WINDOW: [&str; 3] = ["fly", "headless", "pictures"];

/// A line that Bevy logs once it has a GPU, right before its first frame.
const HAS_GPU: &str = "AdapterInfo";

/// The longest time until then. Software Vulkan on a busy machine takes a few seconds.
const START: Duration = Duration::from_secs(120);

/// The time in which an example draws. The first frame comes within a second, with its schedules.
const DRAWING: Duration = Duration::from_secs(4);

/// Starts each example that was built, in a display without a screen, and ends it after a few seconds.
///
/// # Errors
/// If an example ends by itself, or panics in any thread. The error has its last lines.
pub fn start_all(display: &Display) -> Result<()> {
    for name in names()? {
        let start = Instant::now();
        start_one(&name, &display.name).with_context(|| format!("the example `{name}` does not run"))?;
        eprintln!("   {name} drew, {:.1} s", start.elapsed().as_secs_f64());
    }
    Ok(())
}

/// The examples of the workspace's own package that open a window, in order.
fn names() -> Result<Vec<String>> {
    let mut names = Vec::new();
    for entry in fs::read_dir("examples").context("cannot list examples/")? {
        let path = entry.context("cannot list examples/")?.path();
        let is_example =
            path.extension().is_some_and(|extension| extension == "rs") || path.join("main.rs").is_file();
        if let (true, Some(stem)) = (is_example, path.file_stem()) {
            names.push(stem.to_string_lossy().into_owned());
        }
    }
    names.retain(|name| !WITHOUT_WINDOW.contains(&name.as_str()));
    names.sort();
    Ok(names)
}

fn start_one(name: &str, display: &str) -> Result<()> {
    let program = target_folder().join("debug").join("examples").join(name);
    let mut example = Ended(spawn(&program, display)?);
    let lines = lines_of(&mut example.0);
    let mut last_lines = Vec::new();
    let mut until = Instant::now() + START;
    let mut draws = false;
    loop {
        match lines.recv_timeout(until.saturating_duration_since(Instant::now())) {
            Ok(line) => {
                if !draws && line.contains(HAS_GPU) {
                    draws = true;
                    until = Instant::now() + DRAWING;
                }
                last_lines.push(line);
            }
            // It runs, unless a thread of it is gone.
            Err(RecvTimeoutError::Timeout) if draws => break,
            Err(RecvTimeoutError::Timeout) => {
                bail!("no GPU within {} s\n{}", START.as_secs(), tail(&last_lines))
            }
            Err(RecvTimeoutError::Disconnected) => {
                let status = example.0.wait().context("cannot wait for it")?;
                bail!("it ended by itself: {status}\n{}", tail(&last_lines));
            }
        }
    }
    if last_lines.iter().any(|line| line.contains("panicked at")) {
        bail!("a thread panicked\n{}", tail(&last_lines));
    }
    Ok(())
}

fn spawn(program: &Path, display: &str) -> Result<Child> {
    let mut command = Command::new(program);
    command
        .env("DISPLAY", display)
        .env_remove("WAYLAND_DISPLAY")
        .env("RUST_LOG", "info")
        .env("NO_COLOR", "1");
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
    command.spawn().with_context(|| format!("cannot start {}", program.display()))
}

/// The lines that a child writes to its standard error, until it ends.
fn lines_of(child: &mut Child) -> Receiver<String> {
    let (sender, receiver) = channel();
    if let Some(stderr) = child.stderr.take() {
        thread::spawn(move || {
            let mut reader = BufReader::new(stderr);
            let mut line = Vec::new();
            while reader.read_until(b'\n', &mut line).is_ok_and(|n_bytes| n_bytes > 0) {
                // Nobody receives once the child is to end.
                if sender.send(String::from_utf8_lossy(&line).trim_end().into()).is_err() {
                    return;
                }
                line.clear();
            }
        });
    }
    receiver
}

/// The last twenty lines.
fn tail(lines: &[String]) -> String {
    lines[lines.len().saturating_sub(20)..].join("\n")
}

/// A child that is ended when this is dropped.
struct Ended(Child);

impl Drop for Ended {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A display without a screen.
pub struct Display {
    /// The value of `DISPLAY`.
    name: String,
    _server: Ended,
}

impl Display {
    /// Starts the server with a number that is free.
    ///
    /// # Errors
    /// If the server does not run here.
    pub fn start() -> Result<Self> {
        let mut command = Command::new(SERVER);
        command.args(["-displayfd", "1", "-screen", "0", "1280x720x24", "-nolisten", "tcp"]);
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::null());
        let mut server = Ended(command.spawn().with_context(|| format!("cannot start `{SERVER}`"))?);
        let mut number = String::new();
        let stdout = server.0.stdout.take().context("the display has no output")?;
        BufReader::new(stdout).read_line(&mut number).context("the display told no number")?;
        match number.trim() {
            "" => bail!("`{SERVER}` ended without telling a display's number"),
            number => Ok(Self { name: format!(":{number}"), _server: server }),
        }
    }
}
