//! Fills `fuzz/corpus` with small files of every kind: made ones, those of the repository, and the real and
//! broken ones of the test data, if they are there. Arguments: the workspace's root, and the folder of the test
//! data.

use std::{
    env, fs, io,
    path::{Path, PathBuf},
};

use glam::{Quat, Vec3};
use stylegaussian::{
    ChannelStatistics, Decoder, Features, Layer, Look, Mask, Neighbors, Scene, StoredMask,
    look::MadeFrom,
    paint::{Paint, Pin, StoredPins},
};
use stylegaussian_files::{
    Precision, world::FILE, write_decoder, write_look, write_mask, write_painted_style, write_pins,
    write_scene, write_style,
};

/// Larger files make slow runs, and the fuzzer finds sizes by itself.
const MOST_BYTES: u64 = 100_000;

/// The fuzz targets.
const TARGETS: [&str; 13] = [
    "scene",
    "decoder",
    "style",
    "paint",
    "look",
    "mask",
    "pins",
    "world",
    "pytorch",
    "image",
    "encoder",
    "cameras",
    "checkpoint",
];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = env::args_os().skip(1).map(PathBuf::from);
    let (Some(root), Some(data)) = (arguments.next(), arguments.next()) else {
        return Err("expected the workspace's root and the folder of the test data".into());
    };
    let corpus = root.join("fuzz/corpus");
    for target in TARGETS {
        fs::create_dir_all(corpus.join(target))?;
        // Files that no writer of this crate makes, and what was found once: the next fault is near.
        for kept in ["seeds", "regressions"] {
            copy_all(
                &root.join("fuzz").join(kept).join(target),
                &corpus.join(target),
                &|_| Some(Vec::new()),
            )?;
        }
    }
    made(&corpus)?;
    let extension = |path: &Path| path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    // The position of the extension in the list of the target `scene`.
    let of_scene = |path: &Path| {
        let known = ["ply", "sgs", "pth", "spz", "sog", "splat", "ksplat", "glb", "gltf", "json"];
        known.iter().position(|known| *known == extension(path)).map(|i| vec![i as u8])
    };
    copy_all(&data.join("zoo"), &corpus.join("scene"), &of_scene)?;
    let checkpoints = root.join("crates/stylegaussian_files/tests/data");
    copy_all(&checkpoints, &corpus.join("scene"), &of_scene)?;
    let with = |wanted: &'static [&str]| {
        move |path: &Path| wanted.contains(&extension(path).as_str()).then(Vec::new)
    };
    copy_all(&checkpoints, &corpus.join("pytorch"), &with(&["pth"]))?;
    copy_all(&data.join("zoo"), &corpus.join("image"), &with(&["png", "jpg", "webp"]))?;
    copy_all(&root.join("assets/styles"), &corpus.join("style"), &with(&["safetensors"]))?;
    copy_all(&data.join("splats/playbot"), &corpus.join("world"), &|path| {
        path.ends_with(FILE).then(Vec::new)
    })?;
    let cameras = |path: &Path| (extension(path) == "json").then(|| vec![0, 255]);
    copy_all(&root.join("assets"), &corpus.join("cameras"), &cameras)?;
    Ok(())
}

/// Copies the small files under `from` for which `prefix` gives the bytes to put before them. An absent folder
/// has none.
fn copy_all(from: &Path, to: &Path, prefix: &dyn Fn(&Path) -> Option<Vec<u8>>) -> io::Result<()> {
    let Ok(entries) = fs::read_dir(from) else { return Ok(()) };
    for entry in entries {
        let (path, metadata) = entry.and_then(|entry| Ok((entry.path(), entry.metadata()?)))?;
        if metadata.is_dir() {
            copy_all(&path, to, prefix)?;
        } else if metadata.len() <= MOST_BYTES
            && let Some(mut bytes) = prefix(&path)
        {
            bytes.extend(fs::read(&path)?);
            fs::write(to.join(path.file_name().unwrap_or_default()), bytes)?;
        }
    }
    Ok(())
}

/// Files of our own writers.
fn made(corpus: &Path) -> Result<(), Box<dyn std::error::Error>> {
    let scene = scene();
    // Kinds are positions in the list of extensions above.
    for (name, kind) in
        [("made.ply", 0), ("made.sgs", 1), ("made.spz", 3), ("made.splat", 5), ("made.glb", 7)]
    {
        let path = corpus.join("scene").join(name);
        write_scene(&path, &scene)?;
        let bytes = fs::read(&path)?;
        fs::write(&path, [&[kind][..], &bytes].concat())?;
    }
    let decoder = scene.decoder.clone().unwrap_or_default();
    let decoders = corpus.join("decoder");
    write_decoder(&decoders.join("f16"), &decoder, Precision::F16)?;
    write_decoder(&decoders.join("f32"), &decoder, Precision::F32)?;
    let style = ChannelStatistics {
        mean: vec![0.5; 6],
        std_dev: vec![1.0; 6],
        covariance: Some(vec![0.1; 36]),
        encoder: None,
    };
    write_style(&corpus.join("style/made"), &style)?;
    let paint = Paint::new(16, 16, &vec![0.5; 3 * 256]);
    write_painted_style(&corpus.join("paint/made"), &style, &paint)?;
    fs::copy(corpus.join("paint/made"), corpus.join("style/painted"))?;
    let colors: Vec<[f32; 3]> = (0..scene.len()).map(|i| [i as f32, 0.5, 0.0]).collect();
    write_look(&corpus.join("look/made"), &Look::new(&scene, &colors, MadeFrom::default()))?;
    let mask = StoredMask::new(&scene, &scene.mask.clone().unwrap_or_default());
    write_mask(&corpus.join("mask/made"), &mask)?;
    write_pins(&corpus.join("pins/made"), &StoredPins::new(&scene, vec![Pin::default(); 2]))?;
    let pose = "[[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]";
    let transforms =
        format!(r#"{{"camera_angle_x":0.8,"w":9,"h":9,"frames":[{{"transform_matrix":{pose}}}]}}"#);
    let captured = r#"[{"id":0,"img_name":"a","width":9,"height":9,"position":[0,0,4],
        "rotation":[[1,0,0],[0,1,0],[0,0,1]],"fy":9.0,"fx":9.0}]"#;
    let cameras = "1 PINHOLE 9 9 9 9 4.5 4.5\n";
    let text = format!("{cameras}1 1 0 0 0 0 0 4 1 a.png\n\n");
    let share = (256 * cameras.len()).div_ceil(text.len()) as u8;
    for (name, kind, share, text) in [
        ("transforms", 0, 255, transforms),
        ("captured", 1, 255, captured.into()),
        ("colmap", 2, share, text),
    ] {
        fs::write(corpus.join("cameras").join(name), [&[kind, share][..], text.as_bytes()].concat())?;
    }
    Ok(())
}

/// Twelve Gaussians with everything that a scene can have.
fn scene() -> Scene {
    const N: usize = 12;
    let number = |i: usize| (i as f32 * 0.618_034) % 1.0;
    let layer = |d_in: usize, d_out: usize| Layer {
        weight: (0..d_out * 3 * d_in).map(number).collect(),
        bias: vec![0.5; d_out],
        d_in,
        d_out,
    };
    let mut scene = Scene {
        means: (0..N).map(|i| Vec3::new(number(i), number(i + 5), number(3 * i))).collect(),
        rotations: vec![Quat::IDENTITY; N],
        scales: vec![Vec3::splat(0.1); N],
        opacities: vec![0.5; N],
        order: (0..N as u32).collect(),
        n_source: N,
        features: Some(Features {
            values: (0..2 * N).map(number).collect(),
            n_latent: 2,
            basis: (0..12).map(number).collect(),
            offset: vec![0.5; 6],
            extra: Vec::new(),
            n_extra: 0,
            encoder: None,
        }),
        decoder: Some(Decoder { layers: vec![layer(6, 4), layer(4, 3)], k: 3, ..Decoder::default() }),
        mask: Some(Mask::new(N)),
        ..Scene::default()
    };
    scene.neighbors = Some(Neighbors::find(&scene.means, &scene.order, 3));
    scene.set_colors(&[[0.2, 0.4, 0.6]; N]);
    scene
}
