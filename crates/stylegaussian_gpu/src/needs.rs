//! The limits that a device must have for the passes, in one table.

/// A limit that a device must have.
#[derive(Clone, Copy, Debug)]
pub struct Need {
    /// The limit's name in [`wgpu::Limits`].
    pub limit: &'static str,
    /// The least value that serves.
    pub value: u64,
    /// The part that needs it.
    pub why: &'static str,
    of: fn(&wgpu::Limits) -> u64,
    set: fn(&mut wgpu::Limits, u64),
}

/// A limit of a device that does not reach its [`Need`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shortage {
    /// The limit's name in [`wgpu::Limits`].
    pub limit: &'static str,
    /// The least value that serves.
    pub needed: u64,
    /// The device's value.
    pub found: u64,
    /// The part that needs it.
    pub why: &'static str,
}

impl std::fmt::Display for Shortage {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { limit, needed, found, why } = self;
        write!(f, "found {limit} = {found}, expected at least {needed} ({why})")
    }
}

/// A device that cannot run the passes.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the GPU's limits are too small for splats: {}", listed(.0))]
pub struct TooWeak(
    /// The limits that are too small; at least one.
    pub Vec<Shortage>,
);

fn listed(shortages: &[Shortage]) -> String {
    shortages.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
}

macro_rules! needs {
    ($($limit:ident $value:literal $why:literal)*) => {
        /// The limits that a device must have for splats and styles. WebGPU's default limits are enough. Limits
        /// of which WebGL 2 has enough, such as the size of textures, are left out.
        ///
        /// | limit | at least | for |
        /// | --- | --- | --- |
        $(#[doc = concat!("| `", stringify!($limit), "` | ", $value, " | ", $why, " |")])*
        pub const NEEDS: &[Need] = &[$(Need {
            limit: stringify!($limit),
            value: $value,
            why: $why,
            of: |limits| u64::from(limits.$limit),
            // The fields are of different types; no need exceeds them.
            set: |limits, value| limits.$limit = value.try_into().unwrap_or(limits.$limit),
        }),*];
    };
}

needs! {
    max_storage_buffers_per_shader_stage 8 "mixes of a scene's layers"
    max_storage_textures_per_shader_stage 1 "tables of tonemappings, and drawing on software adapters"
    max_storage_buffer_binding_size 1_048_576 "65,536 splats; a larger scene needs more, or is refused"
    max_compute_workgroup_storage_size 14_336 "convolutions of the decoder"
    max_compute_invocations_per_workgroup 256 "projecting and sorting splats"
    max_compute_workgroup_size_x 256 "projecting and sorting splats"
    max_compute_workgroup_size_y 4 "tables of tonemappings"
    max_compute_workgroup_size_z 4 "tables of tonemappings"
    max_compute_workgroups_per_dimension 65_535 "scenes of any size"
}

/// Checks a device's limits against [`NEEDS`]. Nothing of this crate may be made on a device that fails: wgpu
/// would report an error for every pipeline.
///
/// # Errors
/// If a limit is too small. The error names all that are.
pub fn check(limits: &wgpu::Limits) -> Result<(), TooWeak> {
    let short = NEEDS.iter().filter_map(|&Need { limit, value: needed, why, of, .. }| {
        let found = of(limits);
        (found < needed).then_some(Shortage { limit, needed, found, why })
    });
    let short: Vec<_> = short.collect();
    if short.is_empty() { Ok(()) } else { Err(TooWeak(short)) }
}

/// The least limits that serve: those of WebGL 2, with all [`NEEDS`].
pub fn least_limits() -> wgpu::Limits {
    let mut limits = wgpu::Limits::downlevel_webgl2_defaults();
    NEEDS.iter().for_each(|need| (need.set)(&mut limits, need.value));
    limits
}

#[cfg(test)]
mod tests;
