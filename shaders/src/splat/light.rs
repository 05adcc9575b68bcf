//! Shaders of light and air: a change of records' colors.

use bytemuck::{Pod, Zeroable};
use stylegaussian::light as twin;

use super::text::{RECORDS, source};
use crate::{Source, constants, float_constants, layers};

/// From display-referred colors to light.
pub(super) const INVERSE: &str = include_str!("../../wgsl/splat_inverse.wgsl");
/// From light to display-referred colors.
pub(super) const TONEMAPPING: &str = include_str!("../../wgsl/splat_tonemapping.wgsl");

/// `falloff`: linear between two distances.
pub const FALLOFF_LINEAR: u32 = 0;
/// `falloff`: exponential.
pub const FALLOFF_EXPONENTIAL: u32 = 1;
/// `falloff`: exponential in the square of the distance.
pub const FALLOFF_EXPONENTIAL_SQUARED: u32 = 2;
/// `falloff`: exponential, with other densities for light that is lost and light that is added.
pub const FALLOFF_ATMOSPHERIC: u32 = 3;

/// A directional light in fog.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct FogSun {
    /// Unit direction to it, in view space.
    pub direction: [f32; 3],
    /// Unused.
    pub padding_0: f32,
    /// The light that it adds to the fog's color where the eye looks into it, linear.
    pub glow: [f32; 3],
    /// Unused.
    pub padding_1: f32,
}

/// A tint within a region.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct TintVolume {
    /// Rows of the shape's space from view.
    pub shape_from_view_x: [f32; 4],
    /// The second row.
    pub shape_from_view_y: [f32; 4],
    /// The third row.
    pub shape_from_view_z: [f32; 4],
    /// Sizes of the shape.
    pub sizes: [f32; 4],
    /// Rows of the difference that it makes to linear colors; the fourth number is not used.
    pub red: [f32; 4],
    /// The second row.
    pub green: [f32; 4],
    /// The third row.
    pub blue: [f32; 4],
    /// The shape, one of the `SHAPE_` constants of layers.
    pub shape: u32,
    /// Width of the edge.
    pub softness: f32,
    /// 1 / softness, or 0 for a hard edge.
    pub inverse_softness: f32,
    /// Unused.
    pub padding: u32,
}

/// The light on one cloud as one camera sees it.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct SplatLight {
    /// View from clip, first column.
    pub view_from_clip_x: [f32; 4],
    /// View from clip, second column.
    pub view_from_clip_y: [f32; 4],
    /// View from clip, third column.
    pub view_from_clip_z: [f32; 4],
    /// View from clip, fourth column.
    pub view_from_clip_w: [f32; 4],
    /// Left, top, width and height of the viewport, in pixels of the target.
    pub viewport: [f32; 4],
    /// The tint, first row; the fourth number is not used.
    pub tint_red: [f32; 4],
    /// The tint, second row.
    pub tint_green: [f32; 4],
    /// The tint, third row.
    pub tint_blue: [f32; 4],
    /// The fog's linear color.
    pub fog_color: [f32; 3],
    /// Factor of all fog; 0 if there is none.
    pub fog_strength: f32,
    /// Density for the light behind; of linear fog its end, and its steepness.
    pub extinction: [f32; 3],
    /// One of the `FALLOFF_` constants.
    pub falloff: u32,
    /// Density for the light that is added.
    pub inscattering: [f32; 3],
    /// Exponent of the glow.
    pub exponent: f32,
    /// Lights in the fog.
    pub suns: [FogSun; twin::MAX_SUNS],
    /// Volumes that tint the cloud, one after another.
    pub volumes: [TintVolume; twin::MAX_TINT_VOLUMES],
    /// Suns that count.
    pub n_suns: u32,
    /// Index of the cloud's first record.
    pub first_record: u32,
    /// Records of the cloud.
    pub n_records: u32,
    /// 1 if the view has records of strokes, else 0.
    pub has_strokes: u32,
    /// The camera's factor on colors before tone mapping.
    pub exposure: f32,
    /// Share of its light that the cloud loses in shadow.
    pub shadow_amount: f32,
    /// Volumes that count.
    pub n_volumes: u32,
    /// Unused.
    pub padding: u32,
}

/// One shadow map, and the part of the view that it is for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct ShadowCascade {
    /// The map's clip space from view, first column; reverse z.
    pub clip_from_view_x: [f32; 4],
    /// Second column.
    pub clip_from_view_y: [f32; 4],
    /// Third column.
    pub clip_from_view_z: [f32; 4],
    /// Fourth column.
    pub clip_from_view_w: [f32; 4],
    /// Step toward the light before the comparison, in view space.
    pub offset: [f32; 3],
    /// View depth up to which the map counts.
    pub far: f32,
}

/// A spot light or a point light with shadow maps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct ShadowLamp {
    /// The lamp's space from view, first row; rigid.
    pub light_from_view_x: [f32; 4],
    /// Second row.
    pub light_from_view_y: [f32; 4],
    /// Third row.
    pub light_from_view_z: [f32; 4],
    /// Distance at which its light ends.
    pub range: f32,
    /// Near plane of its maps.
    pub near: f32,
    /// Step toward the lamp before the comparison.
    pub depth_bias: f32,
    /// The same for each unit of the distance along the map's axis.
    pub normal_bias: f32,
    /// Scale and offset of the cosine of the angle from a spot light's axis.
    pub cone: [f32; 2],
    /// Half the width of a spot light's map at distance 1; 0 of a point light.
    pub half_width: f32,
    /// Layer of a spot light's map, or number of a point light's cube.
    pub map: u32,
}

/// The shadow maps of a view.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct SplatShadows {
    /// From near to far.
    pub cascades: [ShadowCascade; twin::MAX_CASCADES],
    /// In any order.
    pub lamps: [ShadowLamp; twin::MAX_LAMPS],
    /// Cascades that count.
    pub n_cascades: u32,
    /// Lamps that count.
    pub n_lamps: u32,
    /// Unused.
    pub padding_0: u32,
    /// Unused.
    pub padding_1: u32,
}

/// The air of a planet as one camera sees it. Lengths are in meters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct SplatAtmosphere {
    /// The clip space that the table of light is for, from view, first row.
    pub clip_from_view_x: [f32; 4],
    /// Second row.
    pub clip_from_view_y: [f32; 4],
    /// Fourth row.
    pub clip_from_view_w: [f32; 4],
    /// Meters from view, first column; the fourth number is not used.
    pub meters_from_view_x: [f32; 4],
    /// Second column.
    pub meters_from_view_y: [f32; 4],
    /// Third column.
    pub meters_from_view_z: [f32; 4],
    /// Unit vector from the planet's center to the eye, in view space.
    pub up: [f32; 3],
    /// Height of the eye above the ground.
    pub altitude: f32,
    /// Radius of the planet.
    pub inner_radius: f32,
    /// Height of the top of the air above the ground.
    pub thickness: f32,
    /// Distance of the end of the last slice of the table of light.
    pub max_distance: f32,
    /// Number of slices of that table.
    pub n_slices: f32,
    /// The camera's factor on the light of that table.
    pub exposure: f32,
    /// 1 if each channel passes by the mean of the three, else 0.
    pub grayness: f32,
    /// Unused.
    pub padding_0: f32,
    /// Unused.
    pub padding_1: f32,
}

/// The constants of the CPU twin.
pub(super) fn twin_constants() -> String {
    let integers = constants(&[
        ("FALLOFF_LINEAR", FALLOFF_LINEAR),
        ("FALLOFF_EXPONENTIAL_SQUARED", FALLOFF_EXPONENTIAL_SQUARED),
        ("FALLOFF_ATMOSPHERIC", FALLOFF_ATMOSPHERIC),
        ("MAX_SUNS", twin::MAX_SUNS as u32),
        ("MAX_CASCADES", twin::MAX_CASCADES as u32),
        ("MAX_LAMPS", twin::MAX_LAMPS as u32),
        ("MAX_TINT_VOLUMES", twin::MAX_TINT_VOLUMES as u32),
    ]);
    let floats = float_constants(&[
        ("BRIGHTEST_SHOWN", twin::BRIGHTEST_SHOWN),
        ("KNEE", twin::KNEE),
        ("CONTRAST_STEP", twin::CONTRAST_STEP),
        ("FARTHEST_AIR", twin::FARTHEST_AIR),
    ]);
    let [r, g, b] = twin::LINEAR_LUMINANCE.to_array();
    integers + &floats + &format!("const LINEAR_LUMINANCE = vec3<f32>({r:?}, {g:?}, {b:?});\n")
}

/// Changes the colors of records, in views with shadows on splats or without, and by cameras in an atmosphere
/// or outside of any.
pub fn light(shadowed: bool, aerial: bool) -> Source {
    let sun = match shadowed {
        false => include_str!("../../wgsl/splat_sunless.wgsl"),
        true => include_str!("../../wgsl/splat_sunlit.wgsl"),
    };
    let air = match aerial {
        false => include_str!("../../wgsl/splat_airless.wgsl"),
        true => include_str!("../../wgsl/splat_aerial.wgsl"),
    };
    // Those of the atmosphere come first, and bindings have no gaps.
    let bindings = constants(&[("SHADOW_BINDINGS", if aerial { 11 } else { 8 })]);
    let kernel = include_str!("../../wgsl/splat_light.wgsl");
    let (shared, regions) = (twin_constants(), layers::regions());
    source("splat_light", &[&bindings, &shared, &regions, RECORDS, INVERSE, TONEMAPPING, sun, air, kernel])
}
