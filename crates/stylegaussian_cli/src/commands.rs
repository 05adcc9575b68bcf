//! The command line `stylegaussian`: its commands, what they print, and how they fail.

pub(crate) mod arguments;
pub(crate) mod compute;
mod convert;
mod info;
pub(crate) mod output;
mod render;
mod style;
mod stylization;
mod stylize;

use anyhow::Result;
use clap::{Parser, Subcommand};

pub use arguments::{Backend, WeightedPath};
pub use output::error_chain;
pub(crate) use stylization::default_decoder;

use crate::{distill, embed, eval, fetch_vgg, train};

/// Restyle 3D Gaussian Splatting scenes with any painting: embed once, then stylize in a moment.
#[derive(Debug, Parser)]
#[command(name = "stylegaussian", version)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Info(info::InfoArgs),
    Convert(convert::ConvertArgs),
    Embed(embed::EmbedArgs),
    Train(train::TrainArgs),
    Style(style::StyleArgs),
    Stylize(stylize::StylizeArgs),
    Render(render::RenderArgs),
    Eval(eval::EvalArgs),
    Distill(distill::DistillArgs),
    FetchVgg(fetch_vgg::FetchVggArgs),
}

impl Cli {
    /// Runs the command.
    ///
    /// # Errors
    /// A [`clap::Error`] where the arguments contradict one another; anything else names the file or the value at fault.
    pub fn run(self) -> Result<()> {
        match self.command {
            Command::Info(arguments) => info::run(&arguments),
            Command::Convert(arguments) => convert::run(&arguments),
            Command::Embed(arguments) => embed::run(&arguments),
            Command::Train(arguments) => train::run(&arguments),
            Command::Style(arguments) => style::run(&arguments),
            Command::Stylize(arguments) => stylize::run(&arguments),
            Command::Render(arguments) => render::run(&arguments),
            Command::Eval(arguments) => eval::run(&arguments),
            Command::Distill(arguments) => distill::run(&arguments),
            Command::FetchVgg(arguments) => fetch_vgg::run(&arguments),
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_arguments_are_consistent() {
        Cli::command().debug_assert();
    }
}
