//! Distillation end to end, from a made-up teacher of 8 channels.

#[expect(dead_code, reason = "written for the tests of the command line, of which these use a part")]
mod support;

use std::{fs, path::Path};

use stylegaussian_encoder::{
    Encoder,
    chain::{Chain, Convolution, Kernel, Operation, Padding},
};
use support::{Bench, Run, stylegaussian};

/// A teacher that any student can follow: the mean of 4x4 pixels, mixed into `n_channels`.
fn teacher(bench: &Bench, name: &str, n_channels: usize, stride: usize) -> String {
    let number = |i: usize| ((i * 7919) % 13) as f32 / 13.0 - 0.3;
    let weight = (0..n_channels * 48).map(|i| number(i / 16) / 16.0).collect();
    let mix = Kernel { shape: [n_channels, 3, 4, 4], weight, bias: vec![0.2; n_channels] };
    let mix = Convolution::strided(&mix, Padding::Zeros(0), stride).unwrap().rectified();
    let network = Chain::new(3, vec![Operation::Convolution(mix)]).unwrap().to_bytes(None, &[]);
    let path = bench.path(name);
    fs::write(&path, network).unwrap();
    path
}

/// Four pictures of stripes in one folder, and a broken picture in another.
fn images(bench: &Bench) -> [String; 2] {
    let [good, bad] = ["good", "bad"].map(|name| bench.path(name));
    fs::create_dir_all(&good).unwrap();
    fs::create_dir_all(&bad).unwrap();
    for step in [3_u32, 9, 17, 40] {
        let color =
            |x: u32, y: u32| image::Rgb([((x / step) % 2 * 200) as u8, (y / step * 40 % 256) as u8, 90]);
        let path = Path::new(&good).join(format!("{step}.png"));
        image::RgbImage::from_fn(160, 132, color).save(path).unwrap();
    }
    fs::write(Path::new(&bad).join("broken.png"), "no picture").unwrap();
    [good, bad]
}

fn distill(teacher: &str, images: &str, out: &str, more: &[&str]) -> Run {
    let common = ["distill", "--teacher", teacher, "--images", images, "-o", out];
    stylegaussian(&[&common, more].concat())
}

#[test]
fn a_student_learns_resumes_and_is_judged() {
    let bench = Bench::new();
    let teacher = teacher(&bench, "teacher.encoder.safetensors", 8, 4);
    let ([images, _], out) = (images(&bench), bench.path("small.encoder.safetensors"));
    let unexplained = |run: Run| run.expect_success().json()["unexplained"].as_f64().unwrap();

    let first = unexplained(distill(&teacher, &images, &out, &["--iterations", "2", "--json"]));
    assert!(Path::new(&bench.path("small.checkpoint.safetensors")).is_file());
    let more = ["--iterations", "30", "--resume", "--json"];
    let resumed = distill(&teacher, &images, &out, &more);
    let last = unexplained(resumed);
    assert!(last < 0.5 * first, "{first} after 2 steps, {last} after 30");

    let student = Encoder::open(out.as_ref()).unwrap();
    assert_eq!((student.n_channels(), student.id().name.as_str()), (8, "small"));
    let judge = ["distill", "--teacher", &teacher, "--held-out", &images, "--judge", &out];
    let judged = stylegaussian(&judge).expect_success().stdout;
    assert!(judged.contains("correlation, median channel"), "{judged}");
    let itself = ["distill", "--teacher", &teacher, "--held-out", &images, "--judge", &teacher, "--json"];
    let itself = stylegaussian(&itself).expect_success().json();
    assert!((itself["correlation_least"].as_f64().unwrap() - 1.0).abs() < 1e-6, "{itself}");
    assert_eq!((itself["mean_error"].as_f64(), itself["n_images"].as_f64()), (Some(0.0), Some(4.0)));

    // A distillation does not continue with another teacher.
    let other = self::teacher(&bench, "other.encoder.safetensors", 6, 4);
    distill(&other, &images, &out, &["--resume"])
        .expect_error("expected stylegaussian-distillation of other@");
}

#[test]
fn what_cannot_be_learned_from_is_named() {
    let bench = Bench::new();
    let teacher = teacher(&bench, "teacher.encoder.safetensors", 8, 4);
    let ([good, bad], out) = (images(&bench), bench.path("small.encoder.safetensors"));
    let fails_with = |run: Run, message: &str| {
        run.expect_error(message);
        assert!(!Path::new(&out).exists());
    };
    fails_with(distill(&teacher, bench.path("nowhere").as_str(), &out, &[]), "nowhere");
    fails_with(distill(&teacher, bench.dir().to_str().unwrap(), &out, &[]), "found no painting");
    fails_with(distill(&teacher, &bad, &out, &["--held-out", &good]), "broken.png");
    fails_with(distill(&teacher, &bad, &out, &[]), "found 1 image");
    fails_with(distill(&good, &good, &out, &[]), "good: not an encoder's file");
    let run = distill(&teacher, &good, &bench.path("small.bin"), &[]);
    assert_eq!(run.code, Some(2));
    assert!(run.stderr.contains("small.bin: expected extension .encoder.safetensors"), "{}", run.stderr);
    fails_with(distill(&teacher, &good, &out, &["--resume"]), "small.checkpoint.safetensors");
    let half = self::teacher(&bench, "half.encoder.safetensors", 8, 2);
    fails_with(distill(&half, &good, &out, &[]), "expected 32x32");

    let other = self::teacher(&bench, "other.encoder.safetensors", 6, 4);
    let judge = ["distill", "--teacher", &teacher, "--held-out", &good, "--judge", &other];
    stylegaussian(&judge).expect_error("gives 6 channels, expected the teacher's 8");
    let nothing = stylegaussian(&["distill", "--teacher", &teacher]);
    assert_eq!(nothing.code, Some(2), "{nothing:?}");
}
