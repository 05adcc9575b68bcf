//! `bevy_gaussian_splatting` on the same scene and cameras, by its own benchmark, which is built separately.
//!
//! The binary takes `--cloud scene --n N --w W --h H --sort radix32 --frames F --warmup W` and prints a line
//! that starts with `RESULT` and holds `median_ms=`, `min=`, `p90=` and `cpu_ms_per_frame=`. With `--png FILE`
//! it keeps the picture of its first camera.

use std::{path::Path, process::Command};

use anyhow::{Context, Result, bail};

use crate::{
    fidelity, frame,
    measure::Samples,
    plan::Plan,
    report::{Report, Row},
    scenes,
};

/// Measures the structured scene at all sizes.
pub fn run(binary: Option<&Path>, plan: &Plan, report: &mut Report) -> Result<()> {
    let Some(binary) = binary else {
        bail!("its binary is not named (--peer, or STYLEGAUSSIAN_PEER_BENCH)");
    };
    for &[width, height] in plan.pictures() {
        for &n in plan.frame_sizes() {
            let picture = tempfile::Builder::new().suffix(".png").tempfile()?;
            let samples = frames(binary, n, [width, height], plan, picture.path())?;
            report.add(Row::new(format!("frame, structured, {width}x{height}, peer"), n, &samples));
            let found = image::open(picture.path()).context("the peer's picture")?.to_rgb8();
            let found: Vec<[u8; 3]> = found.pixels().map(|pixel| pixel.0).collect();
            let pose = frame::around_structured(frame::FIRST_ANGLE);
            let expected = fidelity::reference(&scenes::structured(n), pose, frame::FOV, [width, height]);
            let psnr = fidelity::psnr(&found, &expected);
            report.add(Row::of_picture(format!("picture, structured, {width}x{height}, peer"), n, psnr));
        }
    }
    Ok(())
}

fn frames(
    binary: &Path,
    n: usize,
    [width, height]: [u32; 2],
    plan: &Plan,
    picture: &Path,
) -> Result<Samples> {
    let mut command = Command::new(binary);
    command.args(["--cloud", "scene", "--sort", "radix32", "--warmup", "6"]);
    command.args(["--frames", if plan.quick { "12" } else { "20" }]);
    for (name, value) in [("--n", n), ("--w", width as usize), ("--h", height as usize)] {
        command.args([name, &value.to_string()]);
    }
    command.arg("--png").arg(picture);
    let output = command.output().with_context(|| format!("cannot run {}", binary.display()))?;
    let text = String::from_utf8_lossy(&output.stdout);
    let line = text.lines().find(|line| line.starts_with("RESULT"));
    line.and_then(result).with_context(|| format!("{} printed no RESULT", binary.display()))
}

/// The times of a line of results.
fn result(line: &str) -> Option<Samples> {
    let field = |name: &str| line.split_whitespace().find_map(|word| word.strip_prefix(name)?.parse().ok());
    // Three numbers stand for all frames. Their median is the median; their most is the 90th percentile.
    let ms = vec![field("min=")?, field("median_ms=")?, field("p90=")?];
    Some(Samples { ms, cpu_ms: field("cpu_ms_per_frame=") })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_read() {
        let line = "RESULT peer cloud=scene n=5 median_ms=3.5 p10=3.0 p90=4.5 min=2.5 cpu_ms_per_frame=6.0 x";
        let samples = result(line).unwrap();
        assert_eq!((samples.median(), samples.least(), samples.most()), (3.5, 2.5, 4.5));
        assert_eq!(samples.cpu_ms, Some(6.0));
        assert!(result("RESULT peer").is_none());
    }
}
