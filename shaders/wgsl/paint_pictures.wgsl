// Pictures of a painting that changes, all in one buffer, and the step that works on them. CPU twin:
// `stylegaussian::paint::redraw`.

/// A picture in the buffer.
struct PaintPicture {
    /// Its first pixel.
    first: u32,
    width: u32,
    height: u32,
    /// Its sides, as shares of those of the picture that it is a copy of.
    shrunk: f32,
}

/// One task.
struct PaintStep {
    /// The picture that is read.
    input: PaintPicture,
    /// The picture that is written.
    output: PaintPicture,
    /// The painting.
    original: PaintPicture,
    /// Energies of detail around each pixel.
    around: PaintPicture,
    /// Copies of the painting at the size at which it is read: itself, by 1, 4 and 24 pixels blurred.
    copies: array<PaintPicture, 4>,
    /// Standard deviation of a blur, in pixels.
    sigma: f32,
    /// Pixels on each side that it reads.
    reach: u32,
    /// 0 for a blur along rows, 1 for one along columns. 0 for fine detail, 1 for wide detail.
    which: u32,
    /// First packed texel, or the number of channels of an image.
    packed: u32,
    /// Packed texels to a row.
    stride: u32,
    /// Where the sum of the painting's pixels is, and behind it that of the energies.
    sums: u32,
    /// Whether the image's colors are linear.
    is_linear: u32,
    padding: u32,
}

@group(0) @binding(0) var<uniform> task: PaintStep;
@group(0) @binding(1) var<storage, read_write> pictures: array<vec4<f32>>;
/// Texels of 8 bits.
@group(0) @binding(2) var<storage, read_write> packed: array<u32>;

/// A number of the uniforms that branches depend on, as for `flags` of `splat_footprint`.
fn hidden(number: u32) -> u32 {
    return select(number, 0u, arrayLength(&pictures) == 0u);
}

/// The place of a pixel in the buffer, or of the nearest one.
fn pixel_at(picture: PaintPicture, at: vec2<i32>) -> u32 {
    let within = vec2<u32>(clamp(at, vec2<i32>(0), vec2<i32>(vec2(picture.width, picture.height)) - 1));
    return picture.first + within.y * picture.width + within.x;
}

/// A coordinate folded into 0 to `size`, as in a mirror at each end.
fn folded(at: vec2<f32>, size: vec2<f32>) -> vec2<f32> {
    let period = 2.0 * size;
    let within = at - period * floor(at / period);
    return min(within, period - within);
}

/// The value at a position in pixels of the picture that `picture` is a copy of, mirrored and interpolated.
fn sampled(picture: PaintPicture, position: vec2<f32>) -> vec3<f32> {
    let size = vec2<f32>(vec2(picture.width, picture.height));
    let at = folded(picture.shrunk * position, size) - 0.5;
    let corner = vec2<i32>(floor(at));
    let part = at - floor(at);
    let upper = mix(
        pictures[pixel_at(picture, corner)].rgb,
        pictures[pixel_at(picture, corner + vec2(1, 0))].rgb,
        part.x,
    );
    let lower = mix(
        pictures[pixel_at(picture, corner + vec2(0, 1))].rgb,
        pictures[pixel_at(picture, corner + vec2(1, 1))].rgb,
        part.x,
    );
    return mix(upper, lower, part.y);
}
