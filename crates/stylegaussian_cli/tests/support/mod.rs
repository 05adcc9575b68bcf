//! Runs the binary, and makes small files for it.

use std::{
    env, fs,
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

use glam::{Quat, Vec3};
use stylegaussian::{ChannelStatistics, Decoder, EncoderId, Features, Layer, Neighbors, Scene, scene::Sh};
use stylegaussian_files::{read_scene, write_scene, write_style};
use tempfile::TempDir;

/// Outcome of a run.
#[derive(Debug)]
pub struct Run {
    /// The exit code, or `None` after a signal.
    pub code: Option<i32>,
    pub stdout: String,
    pub stderr: String,
}

/// Runs the command line tool, without an encoder in its environment.
pub fn stylegaussian(arguments: &[&str]) -> Run {
    run(env!("CARGO_BIN_EXE_stylegaussian"), arguments)
}

/// The same, but the Vulkan loader finds no driver.
#[cfg(target_os = "linux")]
pub fn stylegaussian_without_gpu(arguments: &[&str]) -> Run {
    let mut command = Command::new(env!("CARGO_BIN_EXE_stylegaussian"));
    command.env("VK_DRIVER_FILES", "/dev/null").env("VK_ICD_FILENAMES", "/dev/null");
    finish(command, arguments)
}

/// Runs a program.
pub fn run(program: &str, arguments: &[&str]) -> Run {
    finish(Command::new(program), arguments)
}

fn finish(mut command: Command, arguments: &[&str]) -> Run {
    command
        .args(arguments)
        .stdin(Stdio::null())
        // The developer's own setting would replace the built-in encoder.
        .env_remove("STYLEGAUSSIAN_ENCODER")
        .env("RUST_BACKTRACE", "1");
    let output = command.output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    let run = Run { code: output.status.code(), stdout: text(output.stdout), stderr: text(output.stderr) };
    // Whatever the test expects: no user's data may cause a panic.
    assert!(!run.stderr.contains("panicked"), "{arguments:?}: {}", run.stderr);
    run
}

impl Run {
    #[track_caller]
    pub fn expect_success(self) -> Self {
        assert_eq!(self.code, Some(0), "{}", self.stderr);
        self
    }

    /// Exit code 1 and one line of error on stderr that contains `message`.
    #[track_caller]
    pub fn expect_error(&self, message: &str) {
        assert_eq!(self.code, Some(1), "{self:?}");
        // Warnings come first, and are not part of the one line.
        let mut errors = self.stderr.lines().skip_while(|line| line.starts_with("warning: "));
        let error = errors.next().unwrap_or_default();
        assert!(
            error.starts_with("error: ") && error.contains(message),
            "expected {message}: {}",
            self.stderr
        );
        assert_eq!(errors.next(), None, "{}", self.stderr);
    }

    #[track_caller]
    pub fn json(&self) -> serde_json::Value {
        serde_json::from_str(&self.stdout).unwrap_or_else(|error| panic!("{error}: {}", self.stdout))
    }
}

/// A folder of the shared test data, or `None`, reported loudly, if it is absent.
pub fn data(folder: &str) -> Option<PathBuf> {
    let root = env::var_os("STYLEGAUSSIAN_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"), PathBuf::from);
    let path = root.join(folder);
    if !path.is_dir() {
        eprintln!("SKIPPED: {} is absent; STYLEGAUSSIAN_DATA names another place", path.display());
        return None;
    }
    Some(path)
}

/// A folder for one test's files.
pub struct Bench(TempDir);

impl Bench {
    pub fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    pub fn dir(&self) -> &Path {
        self.0.path()
    }

    pub fn path(&self, name: &str) -> String {
        self.dir().join(name).to_str().unwrap().to_owned()
    }

    /// Checks that the folder holds exactly these files, and no partial ones.
    #[track_caller]
    pub fn expect_files(&self, expected: &[&str]) {
        let entries = fs::read_dir(self.dir()).unwrap();
        let mut found: Vec<_> =
            entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        found.sort();
        assert_eq!(found, expected);
    }

    pub fn scene(&self, name: &str) -> Scene {
        read_scene(self.path(name).as_ref()).unwrap().scene
    }

    /// The tensor `rgb` of a file.
    pub fn colors(&self, name: &str) -> Vec<[f32; 3]> {
        let bytes = fs::read(self.path(name)).unwrap();
        let tensors = safetensors::SafeTensors::deserialize(&bytes).unwrap();
        let values: Vec<f32> = bytemuck::pod_collect_to_vec(tensors.tensor("rgb").unwrap().data());
        values.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect()
    }

    /// 40 Gaussians with spherical harmonics of degree 1.
    pub fn plain_scene(&self, name: &str) -> String {
        self.write(name, &plain())
    }

    /// The same with 4 latent features of 6 channels, 3 neighbors and a decoder of two layers.
    pub fn embedded_scene(&self, name: &str) -> String {
        let mut scene = plain();
        let n = scene.len();
        scene.features = Some(Features {
            values: noise(n * 4, 1),
            n_latent: 4,
            basis: noise(6 * 4, 2),
            offset: noise(6, 3),
            extra: Vec::new(),
            n_extra: 0,
            encoder: Some(encoder("test", "00")),
        });
        scene.neighbors = Some(Neighbors::find(&scene.means, &scene.order, 3));
        scene.decoder = Some(Decoder {
            layers: vec![layer(6, 5, 4), layer(5, 3, 5)],
            k: 3,
            encoder: Some(encoder("test", "00")),
            ..Decoder::default()
        });
        self.write(name, &scene)
    }

    pub fn style(&self, name: &str) -> String {
        self.write_style(name, 6, Some(encoder("test", "00")))
    }

    pub fn other_style(&self, name: &str) -> String {
        self.write_style(name, 7, Some(encoder("test", "00")))
    }

    pub fn foreign_style(&self, name: &str) -> String {
        self.write_style(name, 6, Some(encoder("other", "11")))
    }

    pub fn unnamed_style(&self, name: &str) -> String {
        self.write_style(name, 6, None)
    }

    fn write_style(&self, name: &str, seed: u32, encoder: Option<EncoderId>) -> String {
        let std_dev = noise(6, seed + 10).iter().map(|value| value.abs() + 0.5).collect();
        let style = ChannelStatistics { mean: noise(6, seed), std_dev, covariance: None, encoder };
        let path = self.path(name);
        write_style(path.as_ref(), &style).unwrap();
        path
    }

    fn write(&self, name: &str, scene: &Scene) -> String {
        let path = self.path(name);
        write_scene(path.as_ref(), scene).unwrap();
        path
    }

    /// Checks that two files hold the same Gaussians in any order.
    #[track_caller]
    pub fn check_same_scene(&self, a: &str, b: &str) {
        let (a, b) = (self.scene(a), self.scene(b));
        assert_eq!(a.len(), b.len());
        for (i, mean) in a.means.iter().enumerate() {
            let j = b.means.iter().position(|other| other == mean).expect("the same means");
            assert!(a.rotations[i].dot(b.rotations[j]).abs() > 1.0 - 1e-5);
            assert!((a.scales[i] - b.scales[j]).length() < 1e-5);
            assert!((a.opacities[i] - b.opacities[j]).abs() < 1e-5);
            let coefficients =
                |scene: &Scene, i: usize| scene.sh.as_ref().unwrap().coefficients[i * 12..][..12].to_vec();
            assert_eq!(coefficients(&a, i), coefficients(&b, j));
        }
    }
}

fn plain() -> Scene {
    let n = 40;
    let (place, turn, other) = (noise(3 * n, 20), noise(4 * n, 21), noise(16 * n, 22));
    Scene {
        means: place.chunks_exact(3).map(Vec3::from_slice).collect(),
        rotations: turn.chunks_exact(4).map(|q| Quat::from_slice(q).normalize()).collect(),
        scales: place.chunks_exact(3).map(|s| 0.05 + 0.1 * Vec3::from_slice(s).abs()).collect(),
        opacities: other[..n].iter().map(|value| 0.5 + 0.4 * value).collect(),
        sh: Some(Sh { degree: 1, coefficients: other[n..13 * n].to_vec() }),
        order: (0..n as u32).collect(),
        n_source: n,
        ..Scene::default()
    }
}

fn layer(d_in: usize, d_out: usize, seed: u32) -> Layer {
    Layer { weight: noise(d_out * 3 * d_in, seed), bias: noise(d_out, seed + 30), d_in, d_out }
}

fn encoder(name: &str, hash: &str) -> EncoderId {
    EncoderId { name: name.into(), hash: hash.into() }
}

/// Numbers from -1 to 1 that look random, the same for the same seed: a multiplicative hash of the index.
fn noise(n: usize, seed: u32) -> Vec<f32> {
    let hash = |i: u32| {
        let mixed = (i ^ seed.wrapping_mul(0x9e37_79b9)).wrapping_mul(0x85eb_ca6b);
        (mixed ^ (mixed >> 15)).wrapping_mul(0xc2b2_ae35)
    };
    (0..n as u32).map(|i| (hash(i) >> 8) as f32 / (1 << 23) as f32 - 1.0).collect()
}
