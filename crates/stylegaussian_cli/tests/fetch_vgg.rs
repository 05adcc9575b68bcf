//! `fetch-vgg` with a local server that behaves like real ones.

#[expect(dead_code, reason = "written for the tests of the command line, of which these use a part")]
mod support;

use std::{
    collections::HashMap,
    fs,
    io::{BufRead, BufReader, Write},
    net::{TcpListener, TcpStream},
    sync::{Arc, Mutex},
    thread,
};

use safetensors::{Dtype, SafeTensors, tensor::TensorView};
use sha2::{Digest, Sha256};
use stylegaussian_encoder::{Encoder, Image};
use support::{Bench, stylegaussian};

/// Indices of torchvision's modules, and channels, of VGG-19's convolutions up to conv4_1.
const MODULES: [(usize, usize); 9] =
    [(0, 64), (2, 64), (5, 128), (7, 128), (10, 256), (12, 256), (14, 256), (16, 256), (19, 512)];

/// Behavior of a server.
#[derive(Clone, Copy)]
enum Server {
    Sound,
    /// Closes the connection after so many bytes of each answer.
    Cuts(usize),
    /// Ignores the requested range and sends everything.
    IgnoresRanges,
    Refuses,
}

/// Serves `bytes`; gives its address and the first byte of every answer.
fn serve(bytes: Vec<u8>, server: Server) -> (String, Arc<Mutex<Vec<usize>>>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("http://{}", listener.local_addr().unwrap());
    let starts = Arc::new(Mutex::new(Vec::new()));
    let seen = starts.clone();
    thread::spawn(move || {
        for stream in listener.incoming() {
            // If the client went away, the server goes on.
            let _ = answer(&stream.unwrap(), &bytes, server, &seen);
        }
    });
    (address, starts)
}

fn answer(
    stream: &TcpStream,
    bytes: &[u8],
    server: Server,
    starts: &Mutex<Vec<usize>>,
) -> std::io::Result<()> {
    let mut lines = BufReader::new(stream).lines();
    let mut from = None;
    while let Some(line) = lines.next().transpose()?.filter(|line| !line.is_empty()) {
        if let Some(range) = line.to_lowercase().strip_prefix("range: bytes=") {
            from = range.trim_end_matches('-').parse::<usize>().ok();
        }
    }
    let n = bytes.len();
    let from = from.filter(|_| !matches!(server, Server::IgnoresRanges));
    let start = from.unwrap_or(0);
    starts.lock().unwrap().push(start);
    let mut out = stream;
    if matches!(server, Server::Refuses) {
        return write!(out, "HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\nConnection: close\r\n\r\n");
    }
    if start >= n {
        let head = "HTTP/1.1 416 Range Not Satisfiable\r\nContent-Length: 0\r\nConnection: close\r\n";
        return write!(out, "{head}Content-Range: bytes */{n}\r\n\r\n");
    }
    match from {
        Some(_) => {
            write!(out, "HTTP/1.1 206 Partial Content\r\nContent-Range: bytes {start}-{}/{n}\r\n", n - 1)?
        }
        None => write!(out, "HTTP/1.1 200 OK\r\n")?,
    }
    write!(out, "Content-Length: {}\r\nConnection: close\r\n\r\n", n - start)?;
    let sent = if let Server::Cuts(after) = server { after.min(n - start) } else { n - start };
    out.write_all(&bytes[start..start + sent])
}

/// Random weights under torchvision's names, scaled so that activations neither vanish nor explode.
fn weights() -> (HashMap<String, Vec<f32>>, Vec<u8>) {
    let mut seed = 7_u64;
    let mut next = move || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 40) as f32 / (1 << 23) as f32 - 1.0
    };
    let (mut tensors, mut shapes, mut d_in) = (HashMap::new(), Vec::new(), 3);
    for (module, d_out) in MODULES {
        // He et al. 2015. Uniform numbers in -1..1 have deviation 1 / sqrt(3), which the 1.7 below undoes.
        let scale = (2.0 / (9 * d_in) as f32).sqrt();
        let shape = vec![d_out, d_in, 3, 3];
        for (name, n, shape) in [("weight", d_out * d_in * 9, shape), ("bias", d_out, vec![d_out])] {
            let name = format!("features.{module}.{name}");
            tensors.insert(name.clone(), (0..n).map(|_| scale * 1.7 * next()).collect::<Vec<f32>>());
            shapes.push((name, shape));
        }
        d_in = d_out;
    }
    let views = shapes.into_iter().map(|(name, shape)| {
        let view = TensorView::new(Dtype::F32, shape, bytemuck::cast_slice(&tensors[&name])).unwrap();
        (name, view)
    });
    let bytes = safetensors::serialize(views.collect::<Vec<_>>(), None).unwrap();
    (tensors, bytes)
}

fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

fn tensor(file: &[u8], name: &str) -> Vec<f32> {
    bytemuck::pod_collect_to_vec(SafeTensors::deserialize(file).unwrap().tensor(name).unwrap().data())
}

#[test]
fn a_connection_that_breaks_is_taken_up_where_it_ended() {
    let (tensors, bytes) = weights();
    let bench = Bench::new();
    let (address, starts) = serve(bytes.clone(), Server::Cuts(6_000_000));
    // PyTorch's way: the first digits of the checksum are in the name.
    let url = format!("{address}/vgg19-{}.safetensors", &sha256(&bytes)[..8]);
    stylegaussian(&["fetch-vgg", "-o", &bench.path("vgg.safetensors"), "--url", &url]).expect_success();
    // 14 MB in answers of at most 6 MB.
    assert_eq!(*starts.lock().unwrap(), [0, 6_000_000, 12_000_000]);
    bench.expect_files(&["vgg.safetensors"]);
    let file = fs::read(bench.path("vgg.safetensors")).unwrap();
    assert_eq!(tensor(&file, "conv1_1.weight"), tensors["features.0.weight"]);
    assert_eq!(tensor(&file, "conv4_1.bias"), tensors["features.19.bias"]);
    let encoder = Encoder::open(bench.path("vgg.safetensors").as_ref()).unwrap();
    assert_eq!(encoder.n_channels(), 256);
}

#[test]
fn what_an_earlier_go_has_brought_is_not_fetched_again() {
    let (_, bytes) = weights();
    for (have, server, expected) in [
        (9_000_000, Server::Sound, vec![9_000_000]),
        (9_000_000, Server::IgnoresRanges, vec![0]),
        (bytes.len(), Server::Sound, vec![bytes.len()]),
    ] {
        let bench = Bench::new();
        let (address, starts) = serve(bytes.clone(), server);
        fs::write(bench.path("vgg19.safetensors.part.safetensors"), &bytes[..have]).unwrap();
        let (url, digest) = (format!("{address}/vgg19.safetensors"), sha256(&bytes).to_uppercase());
        let out = bench.path("out.safetensors");
        stylegaussian(&["fetch-vgg", "-o", &out, "--url", &url, "--sha256", &digest]).expect_success();
        assert_eq!(*starts.lock().unwrap(), expected);
        bench.expect_files(&["out.safetensors"]);
    }
}

#[test]
fn failures_name_the_address_and_what_came() {
    let (_, bytes) = weights();
    let bench = Bench::new();
    let fetch = |url: &str, more: &[&str]| {
        stylegaussian(&[&["fetch-vgg", "-o", &bench.path("vgg.safetensors"), "--url", url], more].concat())
    };
    let (address, _) = serve(bytes.clone(), Server::Refuses);
    fetch(&format!("{address}/vgg19-00000000.pth"), &[]).expect_error("answers 404");
    fetch(&format!("{address}/vgg19.pth"), &[]).expect_error("--sha256");
    // Nobody listens at a port that was just given back.
    let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    fetch(&format!("http://{port}/vgg19-00000000.pth"), &[]).expect_error("0 bytes are kept in");
    bench.expect_files(&[]);
    // Another file than expected: kept bytes would spoil every later attempt.
    let (address, _) = serve(bytes.clone(), Server::Sound);
    fetch(&format!("{address}/vgg19-00000000.safetensors"), &[]).expect_error("expected 00000000");
    bench.expect_files(&[]);
    // The right bytes, but no VGG-19.
    let (address, _) = serve(b"not weights".to_vec(), Server::Sound);
    let digest = sha256(b"not weights");
    fetch(&format!("{address}/vgg19.pth"), &["--sha256", &digest]).expect_error("vgg19.pth");
}

#[test]
fn channels_of_mean_one_tell_the_same_apart() {
    let (_, bytes) = weights();
    let bench = Bench::new();
    let (address, _) = serve(bytes.clone(), Server::Sound);
    let url = format!("{address}/vgg19-{}.safetensors", &sha256(&bytes)[..12]);
    fs::create_dir(bench.path("images")).unwrap();
    let picture = image::RgbImage::from_fn(256, 256, |x, y| {
        image::Rgb([(x ^ y) as u8, (x * y / 97) as u8, if (x / 24 + y / 24) % 2 == 0 { 220 } else { 30 }])
    });
    picture.save(bench.path("images/a.png")).unwrap();
    let (plain, scaled) = (bench.path("plain.safetensors"), bench.path("scaled.safetensors"));
    stylegaussian(&["fetch-vgg", "-o", &plain, "--url", &url]).expect_success();
    let images = bench.path("images");
    stylegaussian(&["fetch-vgg", "-o", &scaled, "--url", &url, "--images", &images]).expect_success();
    let image = Image::open(bench.path("images/a.png").as_ref()).unwrap();
    let [plain, scaled] = [plain, scaled]
        .map(|path| Encoder::open(path.as_ref()).unwrap().encode(&image).unwrap().statistics());
    // Random layers have channels that are 0 everywhere, which are not scaled.
    let alive: Vec<usize> = (0..256).filter(|&i| plain.mean[i] > 1e-3).collect();
    assert!(alive.len() > 100, "{} channels live", alive.len());
    for i in alive {
        assert!((scaled.mean[i] - 1.0).abs() < 1e-3, "channel {i}: mean {}", scaled.mean[i]);
        let [plain, scaled] = [&plain, &scaled].map(|found| found.std_dev[i] / found.mean[i]);
        assert!((plain - scaled).abs() < 1e-3 * plain.max(1.0), "channel {i}: {plain} and {scaled}");
    }
}
