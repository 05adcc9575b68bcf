//! A file over HTTP, in as many goes as it takes.

use std::{
    fs::{self, File, OpenOptions},
    io::{self, Read, Write},
    path::Path,
    sync::atomic::Ordering,
    thread,
    time::Duration,
};

use anyhow::{Context, Result, bail, ensure};
use indicatif::{ProgressBar, ProgressStyle};
use sha2::{Digest, Sha256};

use crate::train::INTERRUPTED;

/// Goes in a row that bring nothing before it gives up, and the pause before each.
const TRIES: u32 = 5;
const PAUSE: Duration = Duration::from_secs(1);

/// How long a server may take to answer. What it sends then has no limit.
const TIMEOUT: Duration = Duration::from_secs(30);

/// What one request came to.
enum Outcome {
    Complete,
    /// The connection ended early, for this reason; what came is kept.
    Cut(String),
}

/// Downloads `url` to `path`, going on behind what is there already, and compares its SHA-256 with `digest`, its first
/// digits in lower case.
///
/// # Errors
/// When the server refuses, when five goes in a row bring nothing, on Ctrl-C (all three keep what has come), and when the
/// checksum is another one (the file is then removed, since going on with it would not help).
pub fn download(url: &str, path: &Path, digest: &str) -> Result<()> {
    let bar = ProgressBar::new(0);
    let style =
        ProgressStyle::with_template("{bytes}/{total_bytes} [{elapsed} < {eta}] {bytes_per_sec} {wide_bar}");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    let mut failures = 0;
    loop {
        let before = length(path);
        let reason = match request(url, path, &bar)? {
            Outcome::Complete => break,
            Outcome::Cut(reason) => reason,
        };
        failures = if length(path) > before { 0 } else { failures + 1 };
        ensure!(failures < TRIES, "{url}: {reason}; {} bytes are kept in {}", length(path), path.display());
        thread::sleep(PAUSE);
    }
    bar.finish_and_clear();
    let found = sha256(path).with_context(|| format!("cannot read {}", path.display()))?;
    if !found.starts_with(digest) {
        fs::remove_file(path).with_context(|| format!("cannot remove {}", path.display()))?;
        bail!("{url}: the file's SHA-256 is {found}, expected {digest}...; it is removed");
    }
    Ok(())
}

fn length(path: &Path) -> u64 {
    fs::metadata(path).map_or(0, |found| found.len())
}

/// Asks for what is missing.
fn request(url: &str, path: &Path, bar: &ProgressBar) -> Result<Outcome> {
    let have = length(path);
    let config = ureq::Agent::config_builder()
        .http_status_as_error(false)
        .timeout_connect(Some(TIMEOUT))
        .timeout_recv_response(Some(TIMEOUT))
        .build();
    let request = ureq::Agent::from(config).get(url);
    let request = if have > 0 { request.header("Range", format!("bytes={have}-")) } else { request };
    let mut response = match request.call() {
        Ok(response) => response,
        Err(error @ (ureq::Error::BadUri(_) | ureq::Error::RequireHttpsOnly(_))) => bail!("{url}: {error}"),
        Err(error) => return Ok(Outcome::Cut(error.to_string())),
    };
    let range = response.headers().get("content-range").and_then(|value| value.to_str().ok());
    let range = range.and_then(|range| range.strip_prefix("bytes ")).unwrap_or_default().to_owned();
    let total_of_range = range.rsplit_once('/').and_then(|(_, total)| total.parse::<u64>().ok());
    let (start, total) = match response.status().as_u16() {
        // The whole file, whatever was asked for.
        200 => (0, response.body().content_length()),
        206 if range.starts_with(&format!("{have}-")) => (have, total_of_range),
        // Nothing behind what there is.
        416 if total_of_range == Some(have) => return Ok(Outcome::Complete),
        416 => {
            fs::remove_file(path).with_context(|| format!("cannot remove {}", path.display()))?;
            return Ok(Outcome::Cut(format!("the server has no byte {have}")));
        }
        status => {
            bail!("{url}: the server answers {status} {range:?}, expected 200, or 206 from byte {have}")
        }
    };
    bar.set_length(total.unwrap_or(0));
    let at = |error: io::Error| anyhow::Error::new(error).context(format!("cannot write {}", path.display()));
    let mut file = OpenOptions::new().create(true).append(true).open(path).map_err(at)?;
    file.set_len(start).map_err(at)?;
    let (mut body, mut buffer, mut have) = (response.body_mut().as_reader(), vec![0; 1 << 16], start);
    loop {
        bar.set_position(have);
        if INTERRUPTED.load(Ordering::Relaxed) {
            bail!("interrupted; {have} bytes are kept in {}, the same command goes on", path.display());
        }
        match body.read(&mut buffer) {
            Ok(0) => break,
            Ok(n) => {
                file.write_all(&buffer[..n]).map_err(at)?;
                have += n as u64;
            }
            Err(error) => return Ok(Outcome::Cut(error.to_string())),
        }
    }
    Ok(match total.filter(|&total| have < total) {
        Some(total) => Outcome::Cut(format!("the connection ended after {have} of {total} bytes")),
        None => Outcome::Complete,
    })
}

/// In hexadecimal digits.
fn sha256(path: &Path) -> io::Result<String> {
    let mut hasher = Sha256::new();
    io::copy(&mut File::open(path)?, &mut hasher)?;
    Ok(hasher.finalize().iter().map(|byte| format!("{byte:02x}")).collect())
}
