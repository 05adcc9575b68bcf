//! The header of a .ply: checked here, parsed by ply-rs.

use std::collections::HashSet;

use glam::Vec3;
use ply_rs::{
    parser::Parser,
    ply::{
        DefaultElement, ElementDef, Encoding, Header as ParsedHeader, PropertyDef, PropertyType, ScalarType,
    },
};
use stylegaussian::scene::ScreenFilter;

use super::writers;
use crate::{
    error::{Mismatch, bytes_in_words, mismatch},
    json::without_mark,
};

/// Most bytes of a header. Longer ones belong to files of other kinds, which are not searched to their end.
const LONGEST: usize = 1 << 20;

/// A parsed header. The bytes after it suffice for the declared counts.
pub(super) struct Header {
    parsed: ParsedHeader,
    /// The number of properties whose names had CloudCompare's prefix.
    n_prefixed: usize,
    /// The place in the file after the line `end_header`.
    pub(super) payload: usize,
}

impl Header {
    /// Splits off, checks and parses the header.
    pub(super) fn parse(bytes: &[u8]) -> Result<Self, Mismatch> {
        let (text, payload) = split(bytes)?;
        let n_declared = check_lines(&text)?;
        let (text, n_prefixed) = without_prefixes(&text);
        let parsed = Parser::<DefaultElement>::new().read_header(&mut text.as_bytes()).map_err(|error| {
            // ply-rs names the line, and then on further lines all that could stand there.
            let error = error.to_string();
            let line = error.split("\n\tError").next().unwrap_or_default();
            let line = line.split_whitespace().collect::<Vec<_>>().join(" ");
            mismatch(format_args!("a header that does not parse ({line})"), "a PLY header")
        })?;
        let n_parsed: usize = parsed.elements.values().map(|element| 1 + element.properties.len()).sum();
        // ply-rs keeps elements and properties in maps, so that one declared twice is lost.
        if n_parsed != n_declared {
            return Err(mismatch("an element or property declared twice", "each name once"));
        }
        let header = Self { parsed, n_prefixed, payload: bytes.len() - payload.len() };
        header.check_size(payload.len())?;
        Ok(header)
    }

    /// The element of this name.
    pub(super) fn element(&self, name: &str) -> Option<&ElementDef> {
        self.parsed.elements.get(name)
    }

    /// The elements in the file's order.
    pub(super) fn elements(&self) -> impl Iterator<Item = &ElementDef> {
        self.parsed.elements.values()
    }

    /// The words of every comment, in lower case.
    pub(super) fn comments(&self) -> impl Iterator<Item = Vec<String>> {
        let words = |comment: &String| comment.split_ascii_whitespace().map(str::to_lowercase).collect();
        self.parsed.comments.iter().map(words)
    }

    /// The up direction that the comments tell, and the reason, as a clause.
    pub(super) fn up(&self) -> Option<(Vec3, String)> {
        writers::up(&self.parsed.comments)
    }

    /// The filter that a comment names: `SplatRenderMode: mip` of gsplat, nerfstudio and Brush, `antialiased 1`
    /// of Postshot.
    pub(super) fn filter(&self, warnings: &mut Vec<String>) -> ScreenFilter {
        let named = |comment: Vec<String>| {
            let words: Vec<&str> = comment.iter().map(String::as_str).collect();
            match words[..] {
                ["splatrendermode:", "mip" | "antialiased"] | ["antialiased", "1" | "true"] => {
                    Some(ScreenFilter::Antialiased)
                }
                ["splatrendermode:", "default" | "classic"] | ["antialiased", ..] => {
                    Some(ScreenFilter::Classic)
                }
                ["splatrendermode:", other] => {
                    let other = other.escape_debug();
                    warnings.push(format!("unknown render mode `{other}`: drawn as plain 3DGS"));
                    Some(ScreenFilter::Classic)
                }
                _ => None,
            }
        };
        self.comments().find_map(named).unwrap_or_default()
    }

    /// A warning of names that are read without CloudCompare's prefix.
    pub(super) fn prefixed(&self) -> Option<String> {
        let n = self.n_prefixed;
        (n > 0).then(|| {
            format!("names of properties are read without CloudCompare's prefix `{PREFIX}` ({n} of them)")
        })
    }

    /// The encoding of the rows.
    pub(super) fn encoding(&self) -> Encoding {
        self.parsed.encoding
    }

    /// Checks that the file is long enough for the declared elements, if every list were empty.
    fn check_size(&self, n_bytes: usize) -> Result<(), Mismatch> {
        // In u128, in which no product of two 64-bit counts overflows.
        let least: u128 = self.elements().map(|e| e.count as u128 * self.least_row(e) as u128).sum();
        // The last ascii number needs no separator after it.
        let available = n_bytes as u128 + u128::from(self.encoding() == Encoding::Ascii);
        if least <= available {
            return Ok(());
        }
        let counts: Vec<String> = self.elements().map(|e| format!("{} {}", e.count, e.name)).collect();
        Err(mismatch(
            format_args!("{} after the header", bytes_in_words(n_bytes as u64)),
            format_args!("at least {least} for {}", counts.join(", ")),
        ))
    }

    /// The bytes of each row of a binary `element`, or `None` if they have no common size.
    pub(super) fn fixed_row(&self, element: &ElementDef) -> Option<usize> {
        let size = |property: &PropertyDef| match &property.data_type {
            PropertyType::Scalar(scalar) => Some(size_of_scalar(scalar)),
            PropertyType::List(..) => None,
        };
        element.properties.values().map(size).sum()
    }

    /// The fewest bytes that a row of `element` takes. In ascii that is a digit and a separator for each
    /// number.
    fn least_row(&self, element: &ElementDef) -> usize {
        let ascii = self.encoding() == Encoding::Ascii;
        let sizes = element.properties.values().map(|property| match &property.data_type {
            _ if ascii => 2,
            PropertyType::Scalar(scalar) | PropertyType::List(scalar, _) => size_of_scalar(scalar),
        });
        sizes.sum()
    }
}

/// Size of a binary scalar, in bytes.
pub(super) fn size_of_scalar(scalar: &ScalarType) -> usize {
    match scalar {
        ScalarType::Char | ScalarType::UChar => 1,
        ScalarType::Short | ScalarType::UShort => 2,
        ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
        ScalarType::Double => 8,
    }
}

/// The header as text up to and including `end_header`, with uniform line ends, and the payload.
fn split(bytes: &[u8]) -> Result<(String, &[u8]), Mismatch> {
    let mut text = String::new();
    let mut rest = without_mark(bytes);
    while bytes.len() - rest.len() <= LONGEST {
        let Some(end) = rest.iter().position(|&byte| byte == b'\n') else { break };
        // Comments may be in any encoding; nothing else needs more than ascii.
        let line = String::from_utf8_lossy(&rest[..end]);
        let line = line.trim_ascii_end();
        rest = &rest[end + 1..];
        if !line.is_empty() {
            text.push_str(line);
            text.push('\n');
        }
        if line == "end_header" {
            return Ok((text, rest));
        }
    }
    Err(mismatch("a header without an end", "a line `end_header`"))
}

/// The prefix that CloudCompare puts before the name of every property that it does not know.
const PREFIX: &str = "scalar_";

/// The header with CloudCompare's prefix taken off the names of properties, unless the element has one of the
/// name already, and the number of these properties.
fn without_prefixes(text: &str) -> (String, usize) {
    let mut elements = vec![HashSet::new()];
    for line in text.lines() {
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        match words[..] {
            ["element", ..] => elements.push(HashSet::new()),
            ["property", .., name] => {
                if let Some(names) = elements.last_mut() {
                    names.insert(name);
                }
            }
            _ => {}
        }
    }
    let mut names = elements.into_iter();
    let mut taken = names.next().unwrap_or_default();
    let (mut plain, mut n) = (String::with_capacity(text.len()), 0);
    for line in text.lines() {
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        match words[..] {
            ["element", ..] => taken = names.next().unwrap_or_default(),
            // A file that was saved several times has several.
            ["property", kind, name] => {
                let short = name.trim_start_matches(PREFIX);
                if !short.is_empty() && short != name && taken.insert(short) {
                    plain += &format!("property {kind} {short}\n");
                    n += 1;
                    continue;
                }
            }
            _ => {}
        }
        plain.push_str(line);
        plain.push('\n');
    }
    (plain, n)
}

/// Checks lines with numbers that would make ply-rs panic, and counts the declarations.
fn check_lines(text: &str) -> Result<usize, Mismatch> {
    let mut n_declared = 0;
    for line in text.lines() {
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        match words[..] {
            ["format", _, "1.0"] => {}
            ["format", ..] => return Err(mismatch(format_args!("`{line}`"), "format version 1.0")),
            ["element", _, count] if count.parse::<u64>().is_ok() => n_declared += 1,
            ["element", ..] => return Err(mismatch(format_args!("`{line}`"), "`element name count`")),
            ["property", ..] => n_declared += 1,
            _ => {}
        }
    }
    Ok(n_declared)
}
