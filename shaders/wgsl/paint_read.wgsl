// An image as a painting: display-referred colors over white, in 8 bits, each the mean of the area that a pixel
// covers. CPU twin: `stylegaussian::paint::redraw::read`.

@group(1) @binding(0) var image: texture_2d<f32>;

/// A display-referred value of a linear one.
fn encoded(linear: vec3<f32>) -> vec3<f32> {
    let curved = 1.055 * pow(linear, vec3(1.0 / 2.4)) - 0.055;
    return select(curved, 12.92 * linear, linear <= vec3(0.0031308));
}

/// A pixel of the image over white.
fn over_white(at: vec2<u32>) -> vec3<f32> {
    let texel = textureLoad(image, at, 0);
    // No number counts as 0.
    let found = select(vec4(0.0), texel, texel == texel);
    let rgba = clamp(found, vec4(0.0), vec4(1.0));
    // `packed` holds the number of channels.
    var color = select(rgba.rgb, rgba.rrr, task.packed < 3u);
    let alpha = select(rgba.a, rgba.g, task.packed == 2u);
    if hidden(task.is_linear) != 0u {
        color = encoded(color);
    }
    return color * alpha + 1.0 - alpha;
}

@compute @workgroup_size(PAINT_SIDE, PAINT_SIDE)
fn paint_read(@builtin(global_invocation_id) invocation: vec3<u32>) {
    let at = invocation.xy;
    let size = vec2(task.output.width, task.output.height);
    if any(at >= size) {
        return;
    }
    let of_image = textureDimensions(image);
    let width = vec2<f32>(of_image) / vec2<f32>(size);
    let low = vec2<f32>(at) * width;
    let high = vec2<f32>(at + 1u) * width;
    let first = min(vec2<u32>(low), of_image - 1u);
    // In floats the last pixel may end beside the last one of the image.
    let end = clamp(vec2<u32>(ceil(high)), first + 1u, of_image);
    var sum = vec3(0.0);
    var area = 0.0;
    for (var y = first.y; y < end.y; y++) {
        let covered_y = min(high.y, f32(y + 1u)) - max(low.y, f32(y));
        for (var x = first.x; x < end.x; x++) {
            let covered = covered_y * (min(high.x, f32(x + 1u)) - max(low.x, f32(x)));
            sum += covered * over_white(vec2(x, y));
            area += covered;
        }
    }
    let bytes = floor(sum / area * 255.0 + 0.5);
    let i = at.y * size.x + at.x;
    pictures[task.output.first + i] = vec4(bytes / 255.0, 1.0);
    packed[i] = pack4x8unorm(vec4(bytes / 255.0, 1.0));
}
