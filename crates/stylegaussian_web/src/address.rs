//! Files at any address: those of worlds, which are fetched as they are needed.

use std::sync::{Mutex, PoisonError};

use bevy::prelude::*;

/// The source of the assets that lie at an address.
const SOURCE: &str = "address";

/// The folders of files that were asked for, as addresses. Paths of assets begin with their number.
static FOLDERS: Mutex<Vec<String>> = Mutex::new(Vec::new());

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
    // A query is of this file alone.
    let address = address.split(['?', '#']).next().unwrap_or(address);
    let (folder, file) = address.rsplit_once('/').unwrap_or((".", address));
    let mut folders = FOLDERS.lock().unwrap_or_else(PoisonError::into_inner);
    let known = folders.iter().position(|known| known == folder);
    let number = known.unwrap_or_else(|| {
        folders.push(folder.into());
        folders.len() - 1
    });
    format!("{SOURCE}://{number}/{file}")
}

/// The address of a path within the source.
#[cfg(any(test, target_family = "wasm"))]
fn address_of(path: &str) -> std::borrow::Cow<'_, str> {
    let folders = FOLDERS.lock().unwrap_or_else(PoisonError::into_inner);
    let found = path.split_once('/').and_then(|(number, file)| {
        let folder = folders.get(number.parse::<usize>().ok()?)?;
        Some(format!("{folder}/{file}"))
    });
    found.map_or(path.into(), Into::into)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_lead_back_to_addresses() {
        let path = path_of("https://a.org/city/lod-meta.json?v=2#x");
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
}
