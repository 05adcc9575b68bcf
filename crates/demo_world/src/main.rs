//! Writes the demo scene: `demo_world OUT.(sgs|ply)`.

use std::{path::PathBuf, process::ExitCode};

use anyhow::{Context, Result};

fn main() -> ExitCode {
    let mut arguments = std::env::args_os().skip(1);
    let (Some(path), None) = (arguments.next(), arguments.next()) else {
        eprintln!("usage: demo_world OUT.(sgs|ply)");
        return ExitCode::from(2);
    };
    match write(&PathBuf::from(path)) {
        Ok(n) => {
            println!("{n} gaussians");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn write(path: &std::path::Path) -> Result<usize> {
    let scene = demo_world::build();
    stylegaussian_files::write_scene(path, &scene).context("the demo scene was not written")?;
    Ok(scene.len())
}
