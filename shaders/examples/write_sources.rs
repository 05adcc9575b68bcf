//! Every joined shader as a file, for compilers other than naga: `cargo run --example write_sources FOLDER`.

use std::{env, fs, io, path::PathBuf};

use stylegaussian_shaders::{layers, paint, splat, style};

fn main() -> io::Result<()> {
    let folder = env::args_os().nth(1).map(PathBuf::from);
    let folder = folder.ok_or_else(|| io::Error::other("expected a folder to write to"))?;
    fs::create_dir_all(&folder)?;
    let sources = [layers::sources(), paint::sources(), style::sources(), splat::sources()].concat();
    for (index, source) in sources.iter().enumerate() {
        // Variants of a kernel share its label.
        fs::write(folder.join(format!("{index:02}_{}.wgsl", source.label)), &source.wgsl)?;
    }
    Ok(())
}
