//! The terminal: results on stdout; warnings, errors and progress on stderr; Ctrl-C.

use std::{
    io::{self, Write},
    path::Path,
    process,
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
        mpsc::{RecvTimeoutError, channel},
    },
    thread,
    time::Duration,
};

use anyhow::{Context, Result};
use clap::error::ErrorKind;
use indicatif::{ProgressBar, ProgressStyle};
use serde::{Serialize, Serializer};
use stylegaussian::work::Work;
use stylegaussian_files::abandon_partial_files;
use stylegaussian_train::{Progress, Stage};

/// Exit code that shells report for a program ended by Ctrl-C.
const INTERRUPTED: i32 = 130;

/// Steps between two lines of progress if there is no terminal.
const STEPS_PER_LINE: u32 = 100;

/// An error and its causes on one line, outermost first. Causes that the line already contains are left out,
/// because many libraries repeat them.
pub fn error_chain(error: &anyhow::Error) -> String {
    let mut line = String::new();
    for cause in error.chain().map(ToString::to_string).filter(|cause| !cause.is_empty()) {
        if line.is_empty() {
            line = cause;
        } else if !line.contains(&cause) {
            line = format!("{line}: {cause}");
        }
    }
    line
}

/// Whether the reader of our output has gone, as in `stylegaussian info scene.ply | head -1`. Then nobody reads
/// a message.
pub fn is_broken_pipe(error: &anyhow::Error) -> bool {
    let of_kind = |error: &io::Error| error.kind() == io::ErrorKind::BrokenPipe;
    error.downcast_ref::<io::Error>().is_some_and(of_kind)
}

/// An error for arguments that contradict one another. The program ends as if clap had found it.
pub fn usage_error(message: impl std::fmt::Display) -> anyhow::Error {
    clap::Command::new("stylegaussian")
        .override_usage("stylegaussian <COMMAND>")
        .error(ErrorKind::ValueValidation, message)
        .into()
}

/// Prints `warning: ...` on stderr for each.
pub fn warn<S: AsRef<str>>(warnings: impl IntoIterator<Item = S>) {
    for warning in warnings {
        eprintln!("warning: {}", warning.as_ref());
    }
}

/// Warns that a checkpoint of an earlier version does not name these parts of its training.
pub fn warn_of_unnamed(checkpoint: &Path, parts: &[&str]) {
    if !parts.is_empty() {
        let (name, parts) = (checkpoint.display(), parts.join(", "));
        warn([format!("{name}: the checkpoint does not name its {parts}, so it may belong to others")]);
    }
}

/// Prints a line on stderr.
pub fn note(line: impl std::fmt::Display) {
    eprintln!("{line}");
}

/// Serializes a path as text. Names that are not UTF-8, which JSON cannot hold, get replacement characters.
///
/// # Errors
/// If the serializer fails.
pub fn lossy<P: AsRef<Path>, S: Serializer>(path: &P, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(&path.as_ref().display())
}

/// Prints `value` as JSON on stdout if `json` is set, otherwise `text`.
///
/// # Errors
/// If stdout cannot be written.
pub fn print(json: bool, value: &impl Serialize, text: impl FnOnce() -> String) -> Result<()> {
    let mut line = if json { serde_json::to_string_pretty(value)? } else { text() };
    line.push('\n');
    // Not `println!`, which panics if the reader has gone.
    let mut stdout = io::stdout().lock();
    stdout.write_all(line.as_bytes())?;
    // A buffered error would otherwise be lost at exit.
    stdout.flush()?;
    Ok(())
}

/// Ctrl-C, with one behavior for all commands. Commands that can stop early watch it: the first Ctrl-C then
/// stops them in good order, and the second ends the program at once. All other commands end at once.
pub struct Interrupt {
    state: Arc<InterruptState>,
}

#[derive(Default)]
struct InterruptState {
    is_requested: AtomicBool,
    is_watched: AtomicBool,
}

impl Interrupt {
    /// Handles Ctrl-C from now on.
    ///
    /// # Errors
    /// If the system refuses the handler.
    pub fn new() -> Result<Self> {
        let state = Arc::new(InterruptState::default());
        let seen = state.clone();
        ctrlc::set_handler(move || {
            // Relaxed is enough: the flag guards no other data.
            let again = seen.is_requested.swap(true, Ordering::Relaxed);
            if again || !seen.is_watched.load(Ordering::Relaxed) {
                abandon_partial_files();
                process::exit(INTERRUPTED);
            }
            eprintln!("stopping in good order; Ctrl-C again ends at once");
        })
        .context("cannot handle Ctrl-C")?;
        Ok(Self { state })
    }

    /// The flag that the first Ctrl-C sets. From this call on, the caller must look at it and stop.
    pub fn watch(&self) -> &AtomicBool {
        self.state.is_watched.store(true, Ordering::Relaxed);
        &self.state.is_requested
    }
}

/// A progress bar of `total` parts, such as `{pos}/{len} pictures`.
pub fn bar(total: u64, template: &str) -> ProgressBar {
    let style = ProgressStyle::with_template(template);
    ProgressBar::new(total).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}

/// Parts of the bar of [`with_bar`], and the time between two looks at the share that is done.
const SHARES: u64 = 1000;
const LOOK_EVERY: Duration = Duration::from_millis(100);

/// Runs a computation under a bar of the share that is done, such as `{bar:40} {percent}%, {eta} left`.
pub fn with_bar<T>(template: &str, compute: impl FnOnce(&Work) -> T) -> T {
    with_bar_until(template, &AtomicBool::new(false), compute)
}

/// As [`with_bar`]. The computation is canceled soon after `stop` is set.
pub fn with_bar_until<T>(template: &str, stop: &AtomicBool, compute: impl FnOnce(&Work) -> T) -> T {
    let (work, bar) = (Work::default(), bar(SHARES, template));
    let show = || {
        bar.set_position((work.done() * SHARES as f32) as u64);
        if stop.load(Ordering::Relaxed) {
            work.cancel();
        }
    };
    let result = thread::scope(|scope| {
        // Closed at the end of the computation, even if it panics.
        let (_end, ended) = channel::<()>();
        scope.spawn(move || {
            while ended.recv_timeout(LOOK_EVERY) == Err(RecvTimeoutError::Timeout) {
                show();
            }
        });
        compute(&work)
    });
    bar.finish_and_clear();
    result
}

/// Shows progress of the library: a bar on a terminal, otherwise a line every hundred training steps.
pub struct ProgressLine {
    bar: ProgressBar,
    stage: Mutex<Option<Stage>>,
}

impl ProgressLine {
    /// An invisible bar until there is progress.
    pub fn new() -> Self {
        Self { bar: ProgressBar::no_length(), stage: Mutex::new(None) }
    }

    /// Shows the progress.
    pub fn show(&self, progress: Progress) {
        let Progress { stage, done, total, losses } = progress;
        let (name, template) = display(stage);
        let mut shown = self.stage.lock().unwrap_or_else(PoisonError::into_inner);
        // A new stage counts anew, so its time left must not include the stage before.
        if shown.replace(stage) != Some(stage) {
            self.bar.reset();
            self.bar.set_length(u64::from(total));
            self.bar.set_prefix(name);
            if let Ok(style) = ProgressStyle::with_template(template) {
                self.bar.set_style(style);
            }
        }
        let losses: Vec<String> =
            losses.iter().flatten().map(|(name, mean)| format!("{name} {mean:.4}")).collect();
        self.bar.set_position(u64::from(done));
        self.bar.set_message(losses.join(" "));
        // Logs and pipes get lines in place of the bar.
        if self.bar.is_hidden() && !losses.is_empty() && done.is_multiple_of(STEPS_PER_LINE) {
            eprintln!("{name} {done}/{total} {}", losses.join(" "));
        }
    }

    /// Removes the bar.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

/// The name of a stage and the template of its bar.
fn display(stage: Stage) -> (&'static str, &'static str) {
    const STEPS: &str = "{prefix} {pos}/{len} [{elapsed} < {eta}] {msg} {wide_bar}";
    match stage {
        Stage::Views => ("views", "{bar:40} {pos}/{len} views encoded, {eta} left"),
        Stage::Refine => ("steps", "{bar:40} {pos}/{len} steps, {eta} left"),
        Stage::WarmStart => ("warm start", STEPS),
        Stage::Training => ("training", STEPS),
        Stage::Distillation => ("distilling", STEPS),
        Stage::Evaluation => ("pictures", "{bar:40} {pos}/{len} pictures, {eta} left"),
    }
}

#[cfg(test)]
mod tests {
    use anyhow::anyhow;

    use super::*;

    #[test]
    fn a_cause_is_printed_once() {
        assert_eq!(error_chain(&anyhow!("disk full").context("a.ply: disk full")), "a.ply: disk full");
        assert_eq!(error_chain(&anyhow!("disk full").context("a.ply")), "a.ply: disk full");
    }

    #[test]
    fn a_bar_ends_with_what_is_computed_under_it() {
        assert_eq!(with_bar("{percent}", |work| work.at(0.5)), Ok(()));
    }

    #[test]
    fn what_is_computed_under_a_bar_is_canceled() {
        let stop = AtomicBool::new(false);
        with_bar_until("{percent}", &stop, |work| {
            assert_eq!(work.check(), Ok(()));
            stop.store(true, Ordering::Relaxed);
            while work.check().is_ok() {
                thread::sleep(LOOK_EVERY / 10);
            }
        });
    }

    #[test]
    fn usage_errors_point_to_the_help() {
        assert!(usage_error("a and b").to_string().contains("--help"));
    }
}
