//! A server of one folder on this machine, for trying the page. It is for one person: not a server for the
//! world.

use std::{
    fs,
    io::{self, BufRead, BufReader, Write},
    net::{Ipv4Addr, TcpListener, TcpStream},
    path::{Component, Path, PathBuf},
    thread,
    time::Duration,
};

use anyhow::{Context, Result};

/// Port if it is free; otherwise the system chooses one.
const PORT: u16 = 8080;

/// Longest line of a request in bytes. Browsers send paths and headers far below it.
const LONGEST_LINE: u64 = 16 << 10;

/// Time for a request to arrive.
const PATIENCE: Duration = Duration::from_secs(10);

/// Serves a folder on localhost until the program is ended.
///
/// # Errors
/// If no port can be opened.
pub fn serve(folder: &Path) -> Result<()> {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, PORT))
        .or_else(|_| TcpListener::bind((Ipv4Addr::LOCALHOST, 0)))
        .context("cannot open a port on localhost")?;
    println!("\nhttp://{} (Ctrl-C ends it)", listener.local_addr()?);
    for stream in listener.incoming().flatten() {
        let folder = folder.to_owned();
        // A browser keeps connections open that it does not use yet, so one must not wait for another. A
        // visitor who hangs up early is no error.
        thread::spawn(move || answer(stream, &folder));
    }
    Ok(())
}

/// Answers one request and closes the connection.
fn answer(mut stream: TcpStream, folder: &Path) -> io::Result<()> {
    stream.set_read_timeout(Some(PATIENCE))?;
    let mut lines = io::Read::take(BufReader::new(stream.try_clone()?), LONGEST_LINE);
    let mut request = String::new();
    lines.read_line(&mut request)?;
    // The headers are read and ignored: a connection that is closed before would look broken to the browser.
    let mut header = String::new();
    while lines.read_line(&mut header)? > 2 {
        header.clear();
    }
    let file = file(&request).map(|path| folder.join(path));
    let bytes = file.as_deref().and_then(|path| fs::read(path).ok());
    let (status, kind, bytes) = match (file, bytes) {
        (Some(path), Some(bytes)) => ("200 OK", mime(&path), bytes),
        _ => ("404 Not Found", "text/plain", b"not found".to_vec()),
    };
    write!(
        stream,
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {}\r\nCache-Control: no-cache\r\n\
         Connection: close\r\n\r\n",
        bytes.len()
    )?;
    stream.write_all(&bytes)
}

/// The file that a request's first line asks for, relative to the folder; `None` if it is no `GET` or leads
/// elsewhere.
fn file(request: &str) -> Option<PathBuf> {
    let path = request.strip_prefix("GET /")?.split([' ', '?', '#']).next()?;
    let path = Path::new(if path.is_empty() { "index.html" } else { path });
    let is_inside = path.components().all(|part| matches!(part, Component::Normal(_)));
    is_inside.then(|| path.to_owned())
}

/// The media type of a file. Browsers compile a module while it arrives only if it comes as `application/wasm`.
fn mime(path: &Path) -> &'static str {
    match path.extension().and_then(|extension| extension.to_str()) {
        Some("html") => "text/html; charset=utf-8",
        Some("js" | "mjs") => "text/javascript",
        Some("css") => "text/css",
        Some("wasm") => "application/wasm",
        Some("json") => "application/json",
        Some("jpg") => "image/jpeg",
        Some("png") => "image/png",
        Some("svg") => "image/svg+xml",
        _ => "application/octet-stream",
    }
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use super::*;

    #[test]
    fn requests_lead_to_files_inside_of_the_folder() {
        let file = |line: &str| file(line).map(|path| path.to_string_lossy().into_owned());
        assert_eq!(file("GET / HTTP/1.1\r\n").as_deref(), Some("index.html"));
        assert_eq!(file("GET /?style=ink HTTP/1.1\r\n").as_deref(), Some("index.html"));
        assert_eq!(file("GET /assets/demo.sgs HTTP/1.1\r\n").as_deref(), Some("assets/demo.sgs"));
        assert_eq!(file("GET /../Cargo.toml HTTP/1.1\r\n"), None);
        assert_eq!(file("GET //etc/passwd HTTP/1.1\r\n"), None);
        assert_eq!(file("POST /index.html HTTP/1.1\r\n"), None);
        assert_eq!(file(""), None);
    }

    #[test]
    fn a_module_arrives_whole_and_with_its_type() {
        let folder = std::env::temp_dir().join(format!("stylegaussian-serve-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        fs::write(folder.join("app.wasm"), [0; 100_000]).unwrap();
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let mut client = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        client.write_all(b"GET /app.wasm HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
        answer(listener.accept().unwrap().0, &folder).unwrap();
        let mut reply = Vec::new();
        client.read_to_end(&mut reply).unwrap();
        fs::remove_dir_all(folder).unwrap();
        let end = reply.windows(4).position(|bytes| bytes == b"\r\n\r\n").unwrap() + 4;
        let head = String::from_utf8_lossy(&reply[..end]);
        assert!(head.starts_with("HTTP/1.1 200 OK\r\nContent-Type: application/wasm\r\n"), "{head}");
        assert_eq!(reply.len() - end, 100_000);
    }
}
