//! Scenes in any format: reading from a path, from bytes, or file by file; writing by the extension.

use std::{borrow::Cow, io, path::Path};

use stylegaussian::{scene::Scene, work::Work};

use super::{
    atomic::write_atomically,
    bytes::read_bytes,
    check::check_scene,
    distant,
    error::{FileError, Loaded, mismatch},
    files::{Files, Unread},
    format::{ReadOptions, Unwritten, WriteOptions, WriteScene},
    formats::{format_of, writable, writer_of},
    sog,
    world::World,
};

/// A scene whose files come one after another: some formats keep a scene in several.
#[derive(Debug)]
pub struct SceneReader {
    files: Files,
    name: String,
    options: ReadOptions,
}

/// The outcome of an attempt to read a scene.
#[derive(Debug)]
pub enum Reading {
    /// The scene.
    Scene(Box<Loaded>),
    /// Files that are needed first, by their paths relative to the one that was named, with `/` between the
    /// parts. [`SceneReader::add`] takes them.
    Needs(Vec<String>),
}

impl SceneReader {
    /// A reader of the file called `name`. Its extension counts only if the bytes do not tell the format.
    pub fn new(bytes: Vec<u8>, name: &str, options: ReadOptions) -> Self {
        Self { files: Files::new(bytes, extension(Path::new(name))), name: name.into(), options }
    }

    /// Adds a file that [`Reading::Needs`] asked for.
    pub fn add(&mut self, name: String, bytes: Vec<u8>) {
        self.files.add(name, bytes);
    }

    /// Reads the scene, or says which files it needs. Memory of large files is given back while they are read,
    /// so a scene is read once.
    ///
    /// # Errors
    /// If the files are no scene, contradict themselves, or hold no Gaussian.
    pub fn read(&mut self) -> Result<Reading, FileError> {
        self.read_if_wanted(&Work::default())
    }

    /// As [`read`](Self::read). One image, or one stream of zstd, is unpacked to its end once it has begun.
    ///
    /// # Errors
    /// As [`read`](Self::read), or [`FileError::Canceled`] if `work` is canceled.
    pub fn read_if_wanted(&mut self, work: &Work) -> Result<Reading, FileError> {
        work.check()?;
        self.files.work = work.clone();
        let reading = self.reading();
        // Whatever a canceled reader has stopped at.
        work.check()?;
        reading
    }

    fn reading(&mut self) -> Result<Reading, FileError> {
        let at = Path::new(&self.name);
        let mut loaded = match read_as_told(&mut self.files, &self.options) {
            Ok(loaded) => loaded,
            Err(Unread::Needs(names)) => return Ok(Reading::Needs(names)),
            Err(Unread::Mismatch(mismatch)) => return Err(mismatch.at(at)),
        };
        if loaded.scene.is_empty() {
            return Err(match loaded.scene.n_source {
                0 => mismatch("no Gaussian", "at least one"),
                n => {
                    let why = match &loaded.warnings[..] {
                        [] => String::new(),
                        warnings => format!(" ({})", warnings.join("; ")),
                    };
                    mismatch(format_args!("no usable Gaussian among {n}{why}"), "at least one")
                }
            }
            .at(at));
        }
        loaded.warnings.extend(distant::rounded(&loaded.scene));
        Ok(Reading::Scene(Box::new(loaded)))
    }
}

/// Reads a scene in any format. The format is recognized by the content where it has a mark, and by the
/// extension if it has none.
///
/// Gaussians that are not finite or have a zero quaternion are dropped, and a warning counts them.
///
/// # Errors
/// If the file cannot be read, is no scene, contradicts itself, or holds no Gaussian.
pub fn read_scene(path: &Path) -> Result<Loaded, FileError> {
    read_scene_with(path, ReadOptions::default())
}

/// Reads a scene as [`read_scene`] does, with choices. A folder is read by the `lod-meta.json` or `meta.json`
/// of a SOG scene in it.
///
/// # Errors
/// As [`read_scene`].
pub fn read_scene_with(path: &Path, options: ReadOptions) -> Result<Loaded, FileError> {
    let path = &*file_of(path)?;
    read_beside(path, read_bytes(path)?, options)
}

/// Reads parts of a world as one scene: each node at the level of `levels` `[nodes]`, and none of those that
/// have none there. `path` is the world's `lod-meta.json`. The surroundings come with them.
///
/// # Errors
/// As [`read_scene`].
pub fn read_world_at(
    path: &Path,
    world: &World,
    levels: &[Option<usize>],
    options: ReadOptions,
) -> Result<Loaded, FileError> {
    read_beside(path, world.only(levels).write(), options)
}

/// Reads a scene of the bytes of a file and of those beside it.
fn read_beside(path: &Path, bytes: Vec<u8>, options: ReadOptions) -> Result<Loaded, FileError> {
    let mut reader = SceneReader::new(bytes, &path.to_string_lossy(), options);
    loop {
        match reader.read()? {
            Reading::Scene(loaded) => return Ok(*loaded),
            Reading::Needs(names) => {
                for name in names {
                    let bytes = read_bytes(&path.with_file_name(&name))?;
                    reader.add(name, bytes);
                }
            }
        }
    }
}

/// The file that names the others of a scene: the one in the folder if `path` is one.
fn file_of(path: &Path) -> Result<Cow<'_, Path>, FileError> {
    if !path.is_dir() {
        return Ok(path.into());
    }
    let mut files = [sog::LEVELS, sog::META].map(|name| path.join(name)).into_iter();
    files.find(|file| file.is_file()).map(Cow::Owned).ok_or_else(|| {
        let found = format_args!("a folder without {} and {}", sog::META, sog::LEVELS).to_string();
        mismatch(found, "a file, or the folder of a SOG scene").at(path)
    })
}

/// Reads a scene from the bytes of any file that holds all of it. Errors call the file `name`.
///
/// # Errors
/// As [`read_scene`], or if the scene is spread over several files.
pub fn scene_from_bytes(bytes: &[u8], name: &str) -> Result<Loaded, FileError> {
    match SceneReader::new(bytes.into(), name, ReadOptions::default()).read()? {
        Reading::Scene(loaded) => Ok(*loaded),
        Reading::Needs(names) => {
            let found = format_args!("a scene of several files, among them {}", names[0]).to_string();
            Err(mismatch(found, "a scene in one file").at(Path::new(name)))
        }
    }
}

/// Writes a scene. The extension chooses the format: `.sgs` keeps everything, the others Gaussians and colors
/// only. Of `.ply` files, those named `.compressed.ply` are PlayCanvas' compressed ones.
///
/// # Errors
/// If the extension is another, the scene contradicts itself, or the file cannot be written.
pub fn write_scene(path: &Path, scene: &Scene) -> Result<(), FileError> {
    write_scene_with(path, scene, WriteOptions::default()).map(drop)
}

/// Writes a scene as [`write_scene`] does, with choices. Returns warnings of clamped values, and of an offset
/// that the format cannot hold, one sentence each.
///
/// # Errors
/// As [`write_scene`].
pub fn write_scene_with(path: &Path, scene: &Scene, options: WriteOptions) -> Result<Vec<String>, FileError> {
    let write = writer_for(path, scene)?;
    let scene = scene.with_sh_degree_at_most(options.sh_degree);
    let (mut warnings, mut refused) = (Vec::new(), None);
    let written = write_atomically(path, |out| match write(out, &scene, &options) {
        Ok(clamped) => {
            warnings = clamped;
            Ok(())
        }
        Err(Unwritten::Io(error)) => Err(error),
        Err(Unwritten::Mismatch(mismatch)) => {
            refused = Some(mismatch);
            // Only stops the writing: the mismatch is reported instead.
            Err(io::ErrorKind::InvalidInput.into())
        }
    });
    match refused {
        Some(mismatch) => Err(mismatch.at(path)),
        None => written.map(|()| warnings),
    }
}

/// The bytes of a scene's file, for those who have no files. `name` is the file's, whose extension chooses the
/// format; errors call the file that.
///
/// # Errors
/// If the extension is another, or the scene contradicts itself.
pub fn scene_to_bytes(name: &str, scene: &Scene) -> Result<Vec<u8>, FileError> {
    let path = Path::new(name);
    let mut bytes = Vec::new();
    match writer_for(path, scene)?(&mut bytes, scene, &WriteOptions::default()) {
        Ok(_) => Ok(bytes),
        Err(Unwritten::Io(source)) => Err(FileError::Io { path: path.into(), source }),
        Err(Unwritten::Mismatch(mismatch)) => Err(mismatch.at(path)),
    }
}

/// The writer of a scene that is sound, by its file's extension.
fn writer_for(path: &Path, scene: &Scene) -> Result<WriteScene, FileError> {
    if scene.is_empty() {
        return Err(mismatch("no Gaussian", "at least one").at(path));
    }
    check_scene(scene).map_err(|mismatch| mismatch.at(path))?;
    let extension = extension(path);
    let write = writer_of(&path.to_string_lossy().to_lowercase(), &extension);
    write.ok_or_else(|| mismatch(format_args!("extension `{extension}`"), writable()).at(path))
}

/// The extension in lower case, or an empty text if there is none.
pub(super) fn extension(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default()
}

/// The scene of the files by their format and the options.
pub(super) fn read_as_told(files: &mut Files, options: &ReadOptions) -> Result<Loaded, Unread> {
    let format = format_of(&files.main, &files.extension)?;
    let mut loaded = (format.read)(files, options)?;
    loaded.format = format.name;
    if let Some(axes) = options.axes {
        loaded.retell(axes);
    }
    Ok(loaded)
}
