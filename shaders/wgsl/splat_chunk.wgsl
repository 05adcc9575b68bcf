// The Gaussians of a chunk, as the kernels that run once for each of them read them.

/// One chunk of one cloud as one camera sees it. View space is x right, y up, z backward.
struct SplatChunk {
    /// Rows of view from scene; any affine map.
    view_from_scene_x: vec4<f32>,
    view_from_scene_y: vec4<f32>,
    view_from_scene_z: vec4<f32>,
    /// Rows of clip from view; reverse z.
    clip_from_view_x: vec4<f32>,
    clip_from_view_y: vec4<f32>,
    clip_from_view_z: vec4<f32>,
    clip_from_view_w: vec4<f32>,
    /// Left, top, width and height of the viewport, in pixels of the target.
    viewport: vec4<f32>,
    /// Origin of the rays in the scene's space: (eye, 1), or (-direction, 0) if they are parallel.
    eye: vec4<f32>,
    /// The point where the image axis (view -z) meets the picture, in normalized device coordinates.
    axis: vec2<f32>,
    /// Gaussians at this view depth or nearer are culled, in world units.
    near: f32,
    /// The unit of stored scales, in scene units.
    scale_unit: f32,
    /// Gaussians in this chunk.
    n_gaussians: u32,
    /// Index of the chunk's first Gaussian in its scene.
    first_gaussian: u32,
    /// Index of the chunk's first record.
    first_record: u32,
    /// Degree of the spherical harmonics, or `NO_SH`.
    sh_degree: u32,
    /// `CAPTURED_COLORS`, `BY_DISTANCE`, `ANTIALIASED`, `CROPPED`, `UNCLIPPED`.
    flags: u32,
    /// Position of the mask's channel in a word, in bits.
    mask_shift: u32,
    /// Splats with a smaller sum of their variances along x and y are culled, in px^2.
    least_variance: f32,
    /// Splats of less opacity are culled.
    least_opacity: f32,
    /// Half a picture from `axis`, splats are culled if their opacity times the root of the determinant of
    /// their covariance is less, in px^2. The bound grows with the square of that distance.
    least_at_edge: f32,
    padding_0: u32,
    padding_1: u32,
    padding_2: u32,
}

/// One Gaussian, 32 bytes.
struct PackedGaussian {
    mean: vec3<f32>,
    opacity: f32,
    /// Unit quaternion (x, y, z, w) as 16-bit signed fractions.
    rotation: vec2<u32>,
    /// Standard deviations along the local axes as f16, in `scale_unit`.
    scales: vec2<u32>,
}

/// The unit quaternion of a Gaussian.
fn rotation_of(gaussian: PackedGaussian) -> vec4<f32> {
    // Rounding to 16 bits leaves the length slightly off 1.
    return normalize(vec4(unpack2x16snorm(gaussian.rotation.x), unpack2x16snorm(gaussian.rotation.y)));
}

/// Standard deviations along the local axes, in the chunk's `scale_unit`.
fn scales_of(gaussian: PackedGaussian) -> vec3<f32> {
    return vec3(unpack2x16float(gaussian.scales.x), unpack2x16float(gaussian.scales.y).x);
}

/// The vector that `rotation` turns into `v`: the inverse rotation of `v`.
fn unrotated(rotation: vec4<f32>, v: vec3<f32>) -> vec3<f32> {
    // v + 2 w (q x v) + 2 q x (q x v), the rotation of v, with -q in place of q.
    let t = 2.0 * cross(v, rotation.xyz);
    return v + rotation.w * t + cross(t, rotation.xyz);
}

/// A gradient `j` of view space in the scene's space. `x`, `y` and `z` are the rows of view from scene.
fn in_scene(j: vec3<f32>, x: vec4<f32>, y: vec4<f32>, z: vec4<f32>) -> vec3<f32> {
    return j.x * x.xyz + j.y * y.xyz + j.z * z.xyz;
}
