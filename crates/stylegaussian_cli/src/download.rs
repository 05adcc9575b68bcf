//! Downloads over HTTP that resume after a broken connection.

use std::{
    fs::{self, File, OpenOptions},
    io::{self, Read, Write},
    path::Path,
    sync::{
        atomic::{AtomicBool, Ordering},
        mpsc::{Receiver, RecvTimeoutError, sync_channel},
    },
    thread,
    time::{Duration, Instant},
};

use anyhow::{Context, Result, bail, ensure};
use indicatif::ProgressBar;
use sha2::{Digest, Sha256};

use crate::terminal::bar;

/// Attempts in a row that may bring nothing, and the pause before each.
const TRIES: u32 = 5;
const PAUSE: Duration = Duration::from_secs(1);

/// Time that a server may take to answer, and then to send more bytes.
const TIMEOUT: Duration = Duration::from_secs(30);

/// Time after which an interruption is noticed, at the latest.
const POLL: Duration = Duration::from_millis(200);

/// Outcome of one request.
enum Outcome {
    Complete,
    /// The connection ended early, for this reason. The bytes that came are kept.
    Cut(String),
}

/// Downloads `url` to `path`, after the bytes that are there already, and compares the file's SHA-256 with
/// `digest`, its first digits in lower case.
///
/// # Errors
/// If the server refuses, five attempts in a row bring nothing, or `interrupted` is set; the bytes that came
/// are then kept. If the checksum differs; the file is then removed, because resuming would not help.
pub fn download(url: &str, path: &Path, digest: &str, interrupted: &AtomicBool) -> Result<()> {
    let bar = bar(0, "{bytes}/{total_bytes} [{elapsed} < {eta}] {bytes_per_sec} {wide_bar}");
    let mut failures = 0;
    loop {
        let before = length(path);
        let reason = match request(url, path, interrupted, &bar)? {
            Outcome::Complete => break,
            Outcome::Cut(reason) => reason,
        };
        // An attempt that leaves the file longer does not count, so a connection that breaks often still gets
        // there.
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

/// Requests the missing bytes.
fn request(url: &str, path: &Path, interrupted: &AtomicBool, bar: &ProgressBar) -> Result<Outcome> {
    let have = length(path);
    let config = ureq::Agent::config_builder()
        .http_status_as_error(false)
        .timeout_connect(Some(TIMEOUT))
        .timeout_recv_response(Some(TIMEOUT))
        .build();
    let request = ureq::Agent::from(config).get(url);
    let request = if have > 0 { request.header("Range", format!("bytes={have}-")) } else { request };
    let response = match request.call() {
        Ok(response) => response,
        Err(error @ (ureq::Error::BadUri(_) | ureq::Error::RequireHttpsOnly(_))) => bail!("{url}: {error}"),
        Err(error) => return Ok(Outcome::Cut(error.to_string())),
    };
    let range = response.headers().get("content-range").and_then(|value| value.to_str().ok());
    let range = range.and_then(|range| range.strip_prefix("bytes ")).unwrap_or_default().to_owned();
    let total_of_range = range.rsplit_once('/').and_then(|(_, total)| total.parse::<u64>().ok());
    let (start, total) = match response.status().as_u16() {
        // The whole file: this server ignores ranges.
        200 => (0, response.body().content_length()),
        // A server may answer with another range than was asked for. Its bytes would be written at the wrong
        // place.
        206 if range.starts_with(&format!("{have}-")) => (have, total_of_range),
        // There is nothing after the bytes that we have.
        416 if total_of_range == Some(have) => return Ok(Outcome::Complete),
        416 => {
            fs::remove_file(path).with_context(|| format!("cannot remove {}", path.display()))?;
            let reason = format!("the server has no byte {have}, so the file is another one");
            bar.println(format!("{url}: {reason}; beginning anew"));
            return Ok(Outcome::Cut(reason));
        }
        status => {
            bail!("{url}: the server answers {status} {range:?}, expected 200, or 206 from byte {have}")
        }
    };
    bar.set_length(total.unwrap_or(0));
    let at = |error: io::Error| anyhow::Error::new(error).context(format!("cannot write {}", path.display()));
    let mut file = OpenOptions::new().create(true).append(true).open(path).map_err(at)?;
    // Drops the old bytes if the server sends the whole file. Appending then begins at `start` in both cases.
    file.set_len(start).map_err(at)?;
    let body = chunks(response.into_body().into_reader());
    let have = match receive(&body, &mut file, start, TIMEOUT, interrupted, bar).map_err(at)? {
        Received::All(have) => have,
        Received::Cut(reason) => return Ok(Outcome::Cut(reason)),
        Received::Interrupted(have) => {
            bail!("interrupted; {have} bytes are kept in {}, the same command goes on", path.display())
        }
    };
    // Without a length the end of the body counts as the end of the file. The checksum finds out.
    Ok(match total.filter(|&total| have < total) {
        Some(total) => Outcome::Cut(format!("the connection ended after {have} of {total} bytes")),
        None => Outcome::Complete,
    })
}

/// Reads on a separate thread, so that the caller can stop waiting for a server that has stalled. The last
/// chunk is empty or an error.
fn chunks(mut body: impl Read + Send + 'static) -> Receiver<io::Result<Vec<u8>>> {
    // Bounded, so that a fast server cannot fill the memory while the disk is slow: 4 chunks of 64 KiB.
    let (sender, receiver) = sync_channel(4);
    thread::spawn(move || {
        loop {
            let mut buffer = vec![0; 1 << 16];
            let chunk = body.read(&mut buffer).map(|n| {
                buffer.truncate(n);
                buffer
            });
            let is_last = chunk.as_ref().map_or(true, Vec::is_empty);
            // The caller has stopped waiting. A thread that is still in `read` ends with the program.
            if sender.send(chunk).is_err() || is_last {
                break;
            }
        }
    });
    receiver
}

/// The end of an answer's body, and the byte of the file at which it came.
#[derive(Debug, PartialEq, Eq)]
enum Received {
    All(u64),
    Cut(String),
    Interrupted(u64),
}

/// Writes the received bytes after byte `have` of a file. Gives up if nothing comes for `timeout`.
fn receive(
    chunks: &Receiver<io::Result<Vec<u8>>>,
    file: &mut impl Write,
    mut have: u64,
    timeout: Duration,
    interrupted: &AtomicBool,
    bar: &ProgressBar,
) -> io::Result<Received> {
    let mut last = Instant::now();
    loop {
        bar.set_position(have);
        if interrupted.load(Ordering::Relaxed) {
            return Ok(Received::Interrupted(have));
        }
        // Short waits, so that Ctrl-C is noticed while the server is silent.
        match chunks.recv_timeout(POLL.min(timeout)) {
            Ok(Ok(chunk)) if chunk.is_empty() => return Ok(Received::All(have)),
            Ok(Ok(chunk)) => {
                file.write_all(&chunk)?;
                have += chunk.len() as u64;
                last = Instant::now();
            }
            Ok(Err(error)) => return Ok(Received::Cut(error.to_string())),
            Err(RecvTimeoutError::Timeout) if last.elapsed() < timeout => {}
            Err(RecvTimeoutError::Timeout) => {
                return Ok(Received::Cut(format!("nothing came for {} s", timeout.as_secs_f32())));
            }
            Err(RecvTimeoutError::Disconnected) => return Ok(Received::Cut("the connection is lost".into())),
        }
    }
}

/// In hexadecimal digits.
fn sha256(path: &Path) -> io::Result<String> {
    let mut hasher = Sha256::new();
    io::copy(&mut File::open(path)?, &mut hasher)?;
    Ok(hasher.finalize().iter().map(|byte| format!("{byte:02x}")).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A body that brings some bytes and then nothing, and never ends.
    struct Stalls(Option<Vec<u8>>);

    impl Read for Stalls {
        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            let Some(bytes) = self.0.take() else {
                // Longer than the test: the thread is left behind.
                thread::park();
                return Err(io::ErrorKind::TimedOut.into());
            };
            buffer[..bytes.len()].copy_from_slice(&bytes);
            Ok(bytes.len())
        }
    }

    #[test]
    fn a_server_that_stalls_is_left() {
        let (mut file, bar) = (Vec::new(), ProgressBar::hidden());
        let body = chunks(Stalls(Some(vec![1, 2, 3])));
        let received =
            receive(&body, &mut file, 10, Duration::from_millis(20), &AtomicBool::new(false), &bar).unwrap();
        assert_eq!(received, Received::Cut("nothing came for 0.02 s".into()));
        assert_eq!(file, [1, 2, 3]);
    }

    #[test]
    fn all_bytes_arrive_in_order() {
        let bytes: Vec<u8> = (0..200_000_u32).map(|i| i as u8).collect();
        let (mut file, bar) = (Vec::new(), ProgressBar::hidden());
        let body = chunks(io::Cursor::new(bytes.clone()));
        assert_eq!(
            receive(&body, &mut file, 5, TIMEOUT, &AtomicBool::new(false), &bar).unwrap(),
            Received::All(200_005)
        );
        assert_eq!(file, bytes);
    }
}
