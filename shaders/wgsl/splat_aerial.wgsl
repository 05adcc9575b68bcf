// Views by cameras in an atmosphere, for `splat_light`: aerial perspective. CPU twin:
// `stylegaussian::light::Atmosphere`, which has the equation.

/// The air of a planet as one camera sees it. Lengths are in meters.
struct SplatAtmosphere {
    /// Rows of the clip space that the table of light is for, from view, without that of depth.
    clip_from_view_x: vec4<f32>,
    clip_from_view_y: vec4<f32>,
    clip_from_view_w: vec4<f32>,
    /// Columns of meters from view; the fourth number is not used.
    meters_from_view_x: vec4<f32>,
    meters_from_view_y: vec4<f32>,
    meters_from_view_z: vec4<f32>,
    /// Unit vector from the planet's center to the eye, in view space.
    up: vec3<f32>,
    /// Height of the eye above the ground.
    altitude: f32,
    /// Radius of the planet.
    inner_radius: f32,
    /// Height of the top of the air above the ground.
    thickness: f32,
    /// Distance of the end of the last slice of the table of light.
    max_distance: f32,
    /// Number of slices of that table.
    n_slices: f32,
    /// The camera's factor on the light of that table.
    exposure: f32,
    /// 1 if each channel passes by the mean of the three, else 0.
    grayness: f32,
    padding_0: f32,
    padding_1: f32,
}

@group(0) @binding(8) var<uniform> atmosphere: SplatAtmosphere;
@group(0) @binding(9) var aerial_table: texture_3d<f32>;
@group(0) @binding(10) var transmittance_table: texture_2d<f32>;

/// The length of a ray of view space in meters.
fn meters_along(ray: vec3<f32>) -> f32 {
    let along = atmosphere.meters_from_view_x.xyz * ray.x + atmosphere.meters_from_view_y.xyz * ray.y
        + atmosphere.meters_from_view_z.xyz * ray.z;
    return min(length(along), FARTHEST_AIR);
}

/// The place in the table of light of the end of a ray, and the share of what is there.
fn aerial_place(ray: vec3<f32>) -> vec4<f32> {
    let seen = vec4(ray, 1.0);
    let clip = vec2(dot(atmosphere.clip_from_view_x, seen), dot(atmosphere.clip_from_view_y, seen));
    let uv = clip / dot(atmosphere.clip_from_view_w, seen) * vec2(0.5, -0.5) + 0.5;
    let share = meters_along(ray) / atmosphere.max_distance;
    // A texel holds what is before the end of its slice. Before the first end, light grows from 0.
    let w = saturate(share - 0.5 / atmosphere.n_slices);
    return vec4(uv, w, saturate(share * atmosphere.n_slices));
}

/// The place in the table of transmittance of a height and a cosine.
fn transmittance_place(at: f32, mu: f32) -> vec2<f32> {
    let outer_radius = atmosphere.inner_radius + atmosphere.thickness;
    let height = clamp(at, 0.0, atmosphere.thickness);
    let along = (atmosphere.inner_radius + height) * mu;
    // Squares of radii differ by less than f32 tells apart, so their differences are products.
    let to_horizon = sqrt(height * (height + 2.0 * atmosphere.inner_radius));
    let longest = sqrt(atmosphere.thickness * (atmosphere.thickness + 2.0 * atmosphere.inner_radius));
    let shortest = atmosphere.thickness - height;
    let above = shortest * (outer_radius + atmosphere.inner_radius + height);
    let distance = max(sqrt(along * along + above) - along, 0.0);
    return vec2((distance - shortest) / (to_horizon + longest - shortest), to_horizon / longest);
}

/// The places in the table of transmittance of the numerator and the denominator of the share that passes along
/// a ray.
fn segment_places(ray: vec3<f32>) -> vec4<f32> {
    let meters = meters_along(ray);
    let altitude = atmosphere.altitude;
    let radius = atmosphere.inner_radius + altitude;
    let along = radius * dot(ray / max(length(ray), 1e-20), atmosphere.up);
    // By how much the square of the radius grows.
    let growth = meters * (meters + 2.0 * along);
    let radius_there = sqrt(max(radius * radius + growth, 0.0));
    let height_there = altitude + growth / (radius + radius_there);
    let mu_there = clamp((along + meters) / max(radius_there, 1e-20), -1.0, 1.0);
    // The cosine at which a ray touches the ground.
    let meets_ground =
        along < 0.0 && along * along >= altitude * (altitude + 2.0 * atmosphere.inner_radius);
    let sign = select(1.0f, -1.0f, meets_ground);
    let here = transmittance_place(altitude, sign * along / radius);
    let there = transmittance_place(height_there, sign * mu_there);
    return select(vec4(here, there), vec4(there, here), meets_ground);
}

/// The air between the eye and the end of a ray of view space: that of the atmosphere before `air`.
fn behind_atmosphere(air: Air, ray: vec3<f32>) -> Air {
    let place = aerial_place(ray);
    let logarithm = textureSampleLevel(aerial_table, table_sampler, place.xyz, 0.0).rgb;
    let added = atmosphere.exposure * place.w * exp(logarithm);
    let places = segment_places(ray);
    let part = textureSampleLevel(transmittance_table, table_sampler, places.xy, 0.0).rgb;
    let whole = textureSampleLevel(transmittance_table, table_sampler, places.zw, 0.0).rgb;
    // Where nothing passes to the top, nothing is known.
    let passed = select(vec3(1.0), min(part / whole, vec3(1.0)), whole > vec3(0.0));
    let share = mix(passed, vec3(dot(passed, vec3(1.0 / 3.0))), atmosphere.grayness);
    return Air(air.shade, share * air.transmission, share * air.light + added);
}
