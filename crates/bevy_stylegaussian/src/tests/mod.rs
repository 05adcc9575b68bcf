//! Tests of the whole plugin in apps without a window. They share the scenes and apps of [`world`].
//!
//! They live here and not in `tests/`, so that tests of private state can use the same scenes and apps, and so
//! that all of them are one program to link.

#[cfg(feature = "pbr")]
mod air;
#[cfg(feature = "images")]
mod background;
#[cfg(feature = "pbr")]
mod cast;
mod demo_scene;
mod depth;
mod diagnostics;
mod eyes;
mod formats;
#[cfg(feature = "images")]
mod hand;
mod headset;
#[cfg(feature = "images")]
mod images;
#[cfg(feature = "images")]
mod lifecycle;
#[cfg(feature = "images")]
mod living;
mod looks;
mod masks;
#[cfg(all(feature = "images", feature = "meshes"))]
mod meshes;
#[cfg(feature = "images")]
mod on_demand;
#[cfg(feature = "images")]
mod paint;
mod pictures;
#[cfg(feature = "images")]
mod plugins;
mod rooms_apart;
#[cfg(feature = "refine")]
mod saves;
#[cfg(all(feature = "images", feature = "meshes"))]
mod skins;
mod soak;
mod space;
mod still_frames;
#[cfg(feature = "images")]
mod strokes;
mod styles;
mod views;
#[cfg(feature = "images")]
mod weak_devices;
pub(crate) mod world;
mod worlds;
