//! The commands, one module each. They share the modules beside this one, and do not import one another.

mod bake;
mod convert;
mod distill;
mod embed;
mod eval;
mod fetch_vgg;
mod info;
mod render;
mod style;
mod stylize;
mod tile;
mod train;

use anyhow::Result;
use clap::{Parser, Subcommand};
use stylegaussian_files::{readable_extensions, writable_extensions};

use crate::terminal::Interrupt;

/// Restyle 3D Gaussian Splatting scenes with any painting: embed a scene once, then stylize it in an instant.
#[derive(Debug, Parser)]
#[command(name = "stylegaussian", version, after_help = formats())]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Info(info::InfoArgs),
    Convert(convert::ConvertArgs),
    Tile(tile::TileArgs),
    Embed(embed::EmbedArgs),
    Train(Box<train::TrainArgs>),
    Style(style::StyleArgs),
    Bake(bake::BakeArgs),
    Stylize(stylize::StylizeArgs),
    Render(render::RenderArgs),
    Eval(eval::EvalArgs),
    Distill(distill::DistillArgs),
    FetchVgg(fetch_vgg::FetchVggArgs),
}

/// The formats of scenes, for the help.
fn formats() -> String {
    let list = |extensions: Vec<&str>| {
        extensions.iter().map(|extension| format!(".{extension}")).collect::<Vec<_>>().join(", ")
    };
    let (read, written) = (list(readable_extensions()), list(writable_extensions()));
    format!(
        "Scenes are read from {read}; they are known by their content where it has a mark. \
         They are written as {written}."
    )
}

impl Cli {
    /// Runs the command.
    ///
    /// # Errors
    /// A [`clap::Error`] if the arguments contradict one another; otherwise an error that names the file or the
    /// value.
    pub fn run(self, interrupt: &Interrupt) -> Result<()> {
        match self.command {
            Command::Info(arguments) => info::run(&arguments),
            Command::Convert(arguments) => convert::run(&arguments),
            Command::Tile(arguments) => tile::run(&arguments, interrupt),
            Command::Embed(arguments) => embed::run(&arguments, interrupt),
            Command::Train(arguments) => train::run(&arguments, interrupt),
            Command::Style(arguments) => style::run(&arguments),
            Command::Bake(arguments) => bake::run(&arguments, interrupt),
            Command::Stylize(arguments) => stylize::run(&arguments),
            Command::Render(arguments) => render::run(&arguments, interrupt),
            Command::Eval(arguments) => eval::run(&arguments, interrupt),
            Command::Distill(arguments) => distill::run(&arguments, interrupt),
            Command::FetchVgg(arguments) => fetch_vgg::run(&arguments, interrupt),
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

    /// A parser of another type than its field would panic when the option is given.
    #[test]
    fn numbers_have_the_types_of_their_fields() {
        let style = "--style s.jpg --content 0.5 --stroke-scale 2 --paint-amount 2 --protection 2";
        for arguments in [
            &format!(
                "stylize a.ply {style} --palette ff0000,00ff00 --palette-strength 1 --split-paint=3 -o b.ply"
            ),
            &format!("render a.ply {style} --relief 1 --fps 12 --boil 8 --motion-amount 1 -o d"),
            &format!("render a.ply {style} --flow 0.5 -o d"),
            "bake a.ply --style s.jpg --strength 2 -o a.look.safetensors",
            "embed a.ply --split=3 -o a.sgs",
            "eval a.ply --styles d --split-paint=3",
            "train a.sgs --styles d --average 0.1 --noise 1 --smoothing 0 -k 8 -o a.decoder.safetensors",
        ] {
            let words = ["stylegaussian"].into_iter().chain(arguments.split(' '));
            assert!(Cli::try_parse_from(words).is_ok(), "{arguments}");
        }
    }
}
