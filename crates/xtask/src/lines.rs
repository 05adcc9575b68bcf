//! Checks the length of the lines that rustfmt leaves alone: comments, strings, attributes, other languages.

use std::fs;

use anyhow::{Context, Result, ensure};

/// The most characters on a line. Two more than rustfmt's `max_width`, which a comment may use up.
const LONGEST: usize = 112;

/// Patterns of `git ls-files` for all that is code. Documents are not.
pub const CODE: &[&str] = &[
    "*.rs",
    "*.wgsl",
    "*.js",
    "*.mjs",
    "*.jsx",
    "*.ts",
    "*.html",
    "*.css",
    "*.toml",
    "*.py",
    "*.yml",
    "*.yaml",
    "*.sh",
    "*Snakefile",
    ".cargo/*",
    ".ci/*",
];

/// Reads the files and looks for longer lines.
///
/// # Errors
/// If there are any. The message has the place and length of each.
pub fn check(files: &[String]) -> Result<()> {
    let mut long = Vec::new();
    for file in files {
        let text = fs::read_to_string(file).with_context(|| format!("cannot read {file}"))?;
        long.extend(long_lines(&text).map(|(line, n)| format!("  {file}:{line}: {n} characters")));
    }
    ensure!(
        long.is_empty(),
        "found lines of more than {LONGEST} characters, expected none; break the comment, the string (with \
         `\\` at the end of a line) or the list:\n{}",
        long.join("\n")
    );
    Ok(())
}

/// The number of each line that is too long, from 1 on, and its length in characters.
fn long_lines(text: &str) -> impl Iterator<Item = (usize, usize)> {
    let lengths = text.lines().map(|line| line.chars().count());
    lengths.enumerate().map(|(i, n)| (i + 1, n)).filter(|&(_, n)| n > LONGEST)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_line_is_found_and_characters_are_counted() {
        let longest = "é".repeat(LONGEST);
        let text = format!("fn f() {{}}\r\n{longest}\r\n{longest}x\r\n");
        assert_eq!(long_lines(&text).collect::<Vec<_>>(), [(3, LONGEST + 1)]);
    }
}
