//! Tests of the whole plugin in apps without a window. They share the scenes and apps of [`world`].
//!
//! They live here and not in `tests/`, so that tests of private state can use the same scenes and apps, and so
//! that all of them are one program to link.

mod background;
mod demo_scene;
mod diagnostics;
mod formats;
mod images;
mod lifecycle;
mod looks;
mod masks;
mod on_demand;
mod paint;
mod pictures;
mod plugins;
mod rooms_apart;
mod saves;
mod soak;
mod space;
mod still_frames;
mod strokes;
mod styles;
mod views;
mod weak_devices;
pub(crate) mod world;
