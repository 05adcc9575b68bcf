//! Films, with a program in the place of `ffmpeg` that does what a test wants.

#[expect(dead_code, reason = "written for the tests of the command line, of which these use a part")]
mod support;

use std::{
    fs,
    process::{Command, Output, Stdio},
};

use support::{Bench, stylegaussian};

/// A call of `render` for three small frames of `a.ply`, and the film `output`.
fn render(bench: &Bench, output: &str, more: &[&str]) -> Vec<String> {
    let (scene, output) = (bench.path("a.ply"), bench.path(output));
    let fixed = ["render", &scene, "--size", "32x24", "--backend", "cpu", "--video", &output];
    fixed.iter().chain(more).map(|&word| word.into()).collect()
}

#[test]
fn an_animated_webp_needs_no_other_program() {
    let bench = Bench::new();
    bench.plain_scene("a.ply");
    let arguments = render(&bench, "a.webp", &["--frames", "3", "--fps", "10", "--json"]);
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let json = stylegaussian(&arguments).expect_success().json();
    assert_eq!((&json["n_frames"], &json["pictures"][0]["size"]), (&3.into(), &serde_json::json!([32, 24])));
    let bytes = fs::read(bench.path("a.webp")).unwrap();
    assert_eq!(bytes.windows(4).filter(|name| name == b"ANMF").count(), 3);
    bench.expect_files(&["a.ply", "a.webp"]);
    // Words that contradict one another.
    let scene = bench.path("a.ply");
    let (film, folder) = (bench.path("b.webp"), bench.path("b"));
    for wrong in [
        vec!["render", &scene],
        vec!["render", &scene, "--video", &film, "-o", &folder],
        vec!["render", &scene, "--video", &folder],
        vec!["render", &scene, "--video", &film, "--frames", "0"],
        vec!["render", &scene, "--video", &film, "--fps", "0"],
    ] {
        let run = stylegaussian(&wrong);
        assert_eq!(run.code, Some(2), "{wrong:?}: {}", run.stderr);
    }
    bench.expect_files(&["a.ply", "a.webp"]);
}

/// A folder of programs with an `ffmpeg` of these lines of shell, in which `$out` is the file that it is to
/// write.
#[cfg(unix)]
fn programs(lines: &str) -> Bench {
    use std::os::unix::fs::PermissionsExt;
    let folder = Bench::new();
    let script = format!(
        "#!/bin/sh\n[ \"$1\" = -version ] && exit 0\nfor last; do :; done\nout=\"${{last#file:}}\"\n{lines}\n"
    );
    fs::write(folder.path("ffmpeg"), script).unwrap();
    fs::set_permissions(folder.path("ffmpeg"), fs::Permissions::from_mode(0o755)).unwrap();
    folder
}

/// The command, with only `programs` and the usual ones to find.
fn command(arguments: &[String], programs: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_stylegaussian"));
    command.args(arguments).env("PATH", programs).stdin(Stdio::null());
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

#[track_caller]
fn expect_error(output: &Output, message: &str) {
    let text = String::from_utf8_lossy(&output.stderr);
    let errors: Vec<&str> = text.lines().filter(|line| line.starts_with("error: ")).collect();
    assert_eq!((output.status.code(), errors.len()), (Some(1), 1), "{text}");
    assert!(errors[0].contains(message) && !text.contains("panicked"), "expected {message}: {text}");
}

#[test]
fn what_is_missing_is_named() {
    let bench = Bench::new();
    bench.plain_scene("a.ply");
    let empty = Bench::new();
    for name in ["a.mp4", "a.webm"] {
        let output = command(&render(&bench, name, &[]), &empty.path("")).output().unwrap();
        expect_error(&output, &format!("{name}: found no program `ffmpeg`, expected one"));
    }
    bench.expect_files(&["a.ply"]);
}

#[test]
#[cfg(unix)]
fn frames_are_handed_over_and_the_film_is_complete_or_absent() {
    let bench = Bench::new();
    bench.plain_scene("a.ply");
    let run = |lines: &str| {
        let folder = programs(lines);
        let paths = format!("{}:/usr/bin:/bin", folder.path(""));
        command(&render(&bench, "a.mp4", &["--frames", "3"]), &paths).output().unwrap()
    };
    let failed = run("cat > /dev/null; echo one >&2; echo 'Unknown encoder' >&2; exit 3");
    expect_error(&failed, "a.mp4: ffmpeg failed (exit status: 3): Unknown encoder");
    let gone = run("echo half > \"$out\"; exit 1");
    expect_error(&gone, "ffmpeg failed (exit status: 1): without a message");
    expect_error(&run("head -c 100 > \"$out\"; kill -9 $$"), "ffmpeg failed (signal: 9");
    bench.expect_files(&["a.ply"]);
    let done = run("cat > \"$out\"");
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    // An MP4 is opaque: pixels that show nothing of the scene are black.
    let bytes = fs::read(bench.path("a.mp4")).unwrap();
    let pixels = bytes.as_chunks::<4>().0;
    assert_eq!((bytes.len(), pixels.len()), (4 * pixels.len(), 3 * 32 * 24));
    assert!(pixels.iter().all(|[.., alpha]| *alpha == 255) && pixels.contains(&[0, 0, 0, 255]));
    bench.expect_files(&["a.mp4", "a.ply"]);
}

/// The film is only begun when Ctrl-C comes.
#[test]
#[cfg(unix)]
fn an_interrupted_film_leaves_nothing_behind() {
    use std::{
        thread,
        time::{Duration, Instant},
    };
    let bench = Bench::new();
    bench.plain_scene("a.ply");
    let folder = programs("echo begun > \"$out\"; cat > /dev/null");
    let paths = format!("{}:/usr/bin:/bin", folder.path(""));
    let mut child = command(&render(&bench, "a.webm", &["--frames", "900000"]), &paths).spawn().unwrap();
    let began = Instant::now();
    let is_begun = || {
        let mut files = fs::read_dir(bench.dir()).unwrap().map(|file| file.unwrap());
        files.any(|file| file.path().extension().is_some_and(|name| name == "partial"))
    };
    while !is_begun() {
        assert!(child.try_wait().unwrap().is_none(), "ended before its first frame");
        assert!(began.elapsed() < Duration::from_secs(120));
        thread::sleep(Duration::from_millis(5));
    }
    Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    let output = child.wait_with_output().unwrap();
    expect_error(&output, "interrupted after");
    bench.expect_files(&["a.ply"]);
}
