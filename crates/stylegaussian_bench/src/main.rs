//! Speed of all parts, relative to limits and references: `cargo xtask bench`.
//!
//! A row is one measurement at one size: the median, minimum and maximum of some runs after a warm-up. Ratios
//! compare rows of the same run; see [`report::Report::compare`].

mod ceilings;
mod cpu;
#[cfg(feature = "offline")]
mod encode;
mod fidelity;
mod files;
mod frame;
mod gpu;
mod light;
mod literal;
mod measure;
mod memory;
#[cfg(feature = "offline")]
mod offline;
mod peer;
mod plan;
mod pytorch;
mod report;
mod scenes;
mod style;

use std::{env, path::PathBuf};

use anyhow::{Context, Result};
use clap::Parser;

use gpu::Gpu;
use plan::Plan;
use report::Report;

/// Measures the style pass, the splat pass, the CPU's decoder and the offline steps, and prints a table.
#[derive(Debug, Parser)]
#[command(name = "cargo xtask bench")]
struct Arguments {
    /// Measure only a part, which takes about five minutes on two idle cores.
    #[arg(long)]
    quick: bool,
    /// Also write the rows and ratios to this file.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// The benchmark of `bevy_gaussian_splatting`, to run beside ours [default: $STYLEGAUSSIAN_PEER_BENCH].
    #[arg(long, value_name = "BINARY")]
    peer: Option<PathBuf>,
    /// VGG-19 weights (safetensors) for a step of training.
    #[cfg(feature = "offline")]
    #[arg(long, value_name = "FILE")]
    vgg: Option<PathBuf>,
    /// Run only groups with this in their name: ceilings, encode, style, memory, literal, cpu, files, pytorch,
    /// frame, light, peer, offline.
    #[arg(long, value_name = "WORD")]
    only: Option<String>,
}

fn main() -> Result<()> {
    let mut arguments = Arguments::parse();
    arguments.peer = arguments.peer.or_else(|| env::var_os("STYLEGAUSSIAN_PEER_BENCH").map(PathBuf::from));
    let gpu = Gpu::open()?;
    let plan = Plan::new(arguments.quick, gpu.as_ref().is_some_and(|gpu| !gpu.is_software()));
    let mut report = Report::new(gpu.as_ref());
    eprintln!("{}; {}", report.adapter, report.machine);
    for (name, group) in groups(&arguments) {
        if arguments.only.as_ref().is_some_and(|word| !name.contains(word.as_str())) {
            continue;
        }
        eprintln!("── {name}");
        // If a group fails, the others still run.
        if let Err(error) = group(gpu.as_ref(), &plan, &mut report) {
            report.not_run(name, &format!("{error:#}"));
        }
        report.compare();
        // Written after each group, so that nothing is lost if the rest takes too long.
        if let Some(path) = &arguments.json {
            std::fs::write(path, report.json()?)
                .with_context(|| format!("cannot write {}", path.display()))?;
        }
    }
    print!("{}", report.table());
    Ok(())
}

type Group<'a> = Box<dyn Fn(Option<&Gpu>, &Plan, &mut Report) -> Result<()> + 'a>;

fn groups(arguments: &Arguments) -> Vec<(&'static str, Group<'_>)> {
    let needs_gpu = |run: fn(&Gpu, &Plan, &mut Report) -> Result<()>| -> Group<'_> {
        Box::new(move |gpu, plan, report| match gpu {
            Some(gpu) => run(gpu, plan, report),
            None => anyhow::bail!("found no adapter (Vulkan, Metal or DirectX 12)"),
        })
    };
    vec![
        ("ceilings", needs_gpu(ceilings::run)),
        #[cfg(feature = "offline")]
        ("encode", Box::new(|_, plan, report| encode::run(plan, report))),
        ("style", needs_gpu(style::run)),
        ("literal", needs_gpu(literal::run)),
        ("memory", Box::new(|_, plan, report| style::memory(plan, report))),
        ("cpu", Box::new(|_, plan, report| cpu::run(plan, report))),
        ("files", Box::new(|_, plan, report| files::run(plan, report))),
        ("pytorch", Box::new(|_, plan, report| pytorch::run(plan, report))),
        ("frame", needs_gpu(frame::run)),
        ("light", needs_gpu(light::run)),
        ("peer", Box::new(|_, plan, report| peer::run(arguments.peer.as_deref(), plan, report))),
        #[cfg(feature = "offline")]
        ("offline", Box::new(|_, plan, report| offline::run(arguments.vgg.as_deref(), plan, report))),
    ]
}
