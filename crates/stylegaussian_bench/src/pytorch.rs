//! The literal method in PyTorch, if Python has it.

use std::{
    io::Write,
    process::{Command, Stdio},
};

use anyhow::{Context, Result, bail};
use serde::Deserialize;

use crate::{
    measure::Samples,
    plan::Plan,
    report::{Report, Row, names},
    scenes::{self, N_CHANNELS},
};

const SCRIPT: &str = include_str!("../benches/literal.py");

/// The script's output.
#[derive(Debug, Deserialize)]
struct Found {
    device: String,
    torch: String,
    f32: Vec<f64>,
    #[serde(default)]
    tf32: Vec<f64>,
}

/// Measures the literal method without TF32 and, on a GPU, with it.
pub fn run(plan: &Plan, report: &mut Report) -> Result<()> {
    let n = plan.literal_size();
    let found = ask(n)?;
    eprintln!("   PyTorch {} on {}", found.torch, found.device);
    for (name, ms) in [(names::PYTORCH, found.f32), ("style pass, literal, PyTorch TF32", found.tf32)] {
        if !ms.is_empty() {
            let samples = Samples { ms, cpu_ms: None };
            report.add(Row { flops: Some(scenes::flops(n, N_CHANNELS)), ..Row::new(name, n, &samples) });
        }
    }
    Ok(())
}

fn ask(n: usize) -> Result<Found> {
    let torch = Command::new("python3").args(["-c", "import torch"]).stderr(Stdio::null()).status();
    if !torch.is_ok_and(|status| status.success()) {
        bail!("python3 with torch was not found");
    }
    let mut python = Command::new("python3");
    let mut child =
        python.args(["-", &n.to_string()]).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn()?;
    // The pipe is dropped at the end of the statement, which ends the script's text.
    child.stdin.take().context("python3 has no input")?.write_all(SCRIPT.as_bytes())?;
    let output = child.wait_with_output()?;
    serde_json::from_slice(&output.stdout).context("the script did not tell times")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_script_prints_is_read() {
        let on_cpu: Found =
            serde_json::from_str(r#"{"device": "cpu", "torch": "2.9", "f32": [1.5]}"#).unwrap();
        assert_eq!((on_cpu.f32, on_cpu.tf32), (vec![1.5], vec![]));
    }
}
