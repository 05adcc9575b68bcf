//! Names of files that a file gives: they must lead nowhere else.

use super::error::{Mismatch, mismatch};

/// Names that Windows gives to devices, in any folder and with any extension.
const DEVICES: [&str; 6] = ["con", "prn", "aux", "nul", "com", "lpt"];

/// Checks that `name` is the name of a file beside the one that gives it: no path, no device, nothing that a
/// system could read in another way.
pub(super) fn check_plain(name: &str) -> Result<(), Mismatch> {
    // A dot or a space at the end is dropped by Windows, so that `..` and `nul.` are covered too.
    let is_plain = !name.is_empty()
        && !name.contains(|c: char| c.is_control() || "/\\:*?\"<>|".contains(c))
        && !name.ends_with(['.', ' '])
        && !is_device(name);
    match is_plain {
        true => Ok(()),
        false => Err(mismatch(format_args!("file name `{}`", name.escape_debug()), "a plain file name")),
    }
}

/// Checks that `path` is a path from the file that gives it down: plain names with `/` between them.
pub(super) fn check_downward(path: &str) -> Result<(), Mismatch> {
    path.split('/').try_for_each(check_plain).map_err(|_| {
        mismatch(format_args!("file path `{}`", path.escape_debug()), "a path from here down, of plain names")
    })
}

/// Whether Windows opens a device by this name: `NUL`, `com1.webp`.
fn is_device(name: &str) -> bool {
    let stem = name.split('.').next().unwrap_or(name).trim_end().to_ascii_lowercase();
    let (word, digits) = stem.split_at(stem.find(|c: char| !c.is_ascii_lowercase()).unwrap_or(stem.len()));
    let is_numbered = matches!(word, "com" | "lpt");
    DEVICES.contains(&word) && if is_numbered { digits.chars().count() == 1 } else { digits.is_empty() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plain_names_stay_in_their_folder() {
        for name in
            ["means_l.webp", "shN_labels.webp", "a b.png", "ü", ".x", "common", "com10.a", "nulls.webp"]
        {
            assert!(check_plain(name).is_ok(), "{name}");
            assert!(check_downward(&format!("0_0/{name}")).is_ok(), "{name}");
        }
        for name in [
            "", ".", "..", "a/b", "/a", "a\\b", "c:a", "a\0", "a.", "a ", "NUL.webp", "com1", "Lpt9.x", "aux",
        ] {
            assert!(check_plain(name).is_err(), "{name:?}");
        }
        for path in ["../a", "a/../b", "/a", "a//b", "a/", "a/nul", "c:/a"] {
            assert!(check_downward(path).is_err(), "{path:?}");
        }
    }
}
