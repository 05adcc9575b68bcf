//! What commands print: results for people or programs on stdout, warnings and errors on stderr.

use std::io::{self, Write};

use anyhow::Result;
use serde::Serialize;

/// An error and its causes on one line, outermost first. Causes that the line already contains are left out, since
/// many libraries repeat them.
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

/// Prints `warning: ...` on stderr for each.
pub fn warn<S: AsRef<str>>(warnings: impl IntoIterator<Item = S>) {
    for warning in warnings {
        eprintln!("warning: {}", warning.as_ref());
    }
}

/// Prints `value` as JSON on stdout when `json` is asked for, else what `text` says.
///
/// # Errors
/// When stdout cannot be written.
pub fn print(json: bool, value: &impl Serialize, text: impl FnOnce() -> String) -> Result<()> {
    let mut line = if json { serde_json::to_string_pretty(value)? } else { text() };
    line.push('\n');
    let mut stdout = io::stdout().lock();
    stdout.write_all(line.as_bytes())?;
    stdout.flush()?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use anyhow::anyhow;

    use super::*;

    #[test]
    fn a_cause_is_told_once() {
        assert_eq!(error_chain(&anyhow!("disk full").context("a.ply: disk full")), "a.ply: disk full");
        assert_eq!(error_chain(&anyhow!("disk full").context("a.ply")), "a.ply: disk full");
    }
}
