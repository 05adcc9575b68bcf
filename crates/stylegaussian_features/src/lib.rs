//! Features of dependencies, and no code.
//!
//! Cargo unites the features of a dependency over the crates that one command builds. `cargo build --workspace`
//! and `cargo build -p CRATE` would therefore compile the same dependency twice if their unions differ. Inside
//! the workspace every crate asks, through this one, for the union over all of them. Elsewhere nobody sets the
//! configuration `stylegaussian_workspace` (this repository's `.cargo/config.toml` does), so a game that
//! depends on the plugin compiles neither this crate nor its features. The crate is not published: `cargo xtask
//! package` leaves out what depends on it.
