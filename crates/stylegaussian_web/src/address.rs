//! Files at any address: those of worlds, which are fetched as they are needed.

use std::sync::{Mutex, PoisonError};

use bevy::prelude::*;

/// The source of the assets that lie at an address.
const SOURCE: &str = "address";

/// The files that were asked for. The path of an asset begins with the index of its file.
static FILES: Mutex<Vec<File>> = Mutex::new(Vec::new());

/// A file at an address. Its query may hold a signature or a version, and files beside it have no query.
#[derive(PartialEq, Eq)]
struct File {
    folder: String,
    file: String,
    /// With its question mark; empty if there is none.
    query: String,
}

/// Lets an app load files at addresses. It must not have Bevy's assets yet. Outside of a browser, there are
/// none.
pub fn register(app: &mut App) {
    #[cfg(target_family = "wasm")]
    {
        use bevy::asset::io::{AssetSourceBuilder, wasm::HttpWasmAssetReader};
        let reader = || HttpWasmAssetReader::new("").with_request_mapper(address_of);
        app.register_asset_source(SOURCE, AssetSourceBuilder::new(move || Box::new(reader())));
    }
    #[cfg(not(target_family = "wasm"))]
    let _ = app;
}

/// The path of the file at an address, as that of an asset. Those beside it are in its folder.
pub fn path_of(address: &str) -> String {
    let address = address.split('#').next().unwrap_or(address);
    let (address, query) = address.split_at(address.find('?').unwrap_or(address.len()));
    let (folder, file) = address.rsplit_once('/').unwrap_or((".", address));
    let asked = File { folder: folder.into(), file: file.into(), query: query.into() };
    let path = |number: usize| format!("{SOURCE}://{number}/{file}");
    let mut files = FILES.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(known) = files.iter().position(|known| *known == asked) {
        return path(known);
    }
    files.push(asked);
    path(files.len() - 1)
}

/// The address of a path within the source.
#[cfg(any(test, target_family = "wasm"))]
fn address_of(path: &str) -> std::borrow::Cow<'_, str> {
    let files = FILES.lock().unwrap_or_else(PoisonError::into_inner);
    let found = path.split_once('/').and_then(|(number, file)| {
        let asked = files.get(number.parse::<usize>().ok()?)?;
        let query = if file == asked.file { &*asked.query } else { "" };
        Some(format!("{}/{file}{query}", asked.folder))
    });
    found.map_or(path.into(), Into::into)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_lead_back_to_addresses() {
        let path = path_of("https://a.org/city/lod-meta.json#x");
        assert_eq!(path, path_of("https://a.org/city/lod-meta.json"));
        let within = |path: &str| path.strip_prefix("address://").unwrap().to_owned();
        assert_eq!(address_of(&within(&path)), "https://a.org/city/lod-meta.json");
        let beside = within(&path).replace("lod-meta.json", "0_0/meta.json");
        assert_eq!(address_of(&beside), "https://a.org/city/0_0/meta.json");
        let other = path_of("https://a.org/town/lod-meta.json");
        assert_ne!(path, other);
        assert_eq!(address_of(&within(&other)), "https://a.org/town/lod-meta.json");
        assert_eq!(address_of(&within(&path_of("lod-meta.json"))), "./lod-meta.json");
        // Nobody has asked for these.
        for path in ["999999/a.json", "a.json", "x/a.json"] {
            assert_eq!(address_of(path), path);
        }
    }

    #[test]
    fn a_query_is_of_its_file_alone() {
        let asked = "https://b.org/city/lod-meta.json?v=2&key=a/b";
        let within = |address: &str| path_of(address).strip_prefix("address://").unwrap().to_owned();
        let path = within(asked);
        assert!(path.ends_with("/lod-meta.json"), "{path}");
        assert_eq!(address_of(&path), asked);
        let chunk = path.replace("lod-meta.json", "0_0/meta.json");
        assert_eq!(address_of(&chunk), "https://b.org/city/0_0/meta.json");
        // Another version is another file.
        let other = within("https://b.org/city/lod-meta.json?v=3");
        assert_ne!(path, other);
        assert_eq!(address_of(&other), "https://b.org/city/lod-meta.json?v=3");
        assert_eq!(path, within(&format!("{asked}#x")));
    }
}
