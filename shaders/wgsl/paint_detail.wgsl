// The largest level of fine or of wide detail. CPU twin: the textures of the detail of `stylegaussian::paint`.

/// The factor that evens out strong and faint places.
fn whitened(at: vec2<f32>) -> f32 {
    let n = f32(task.around.width * task.around.height);
    let typical = max(pictures[task.sums + 1u].x / n, LEAST_TYPICAL);
    let energy = sampled(task.around, at).x;
    return clamp(pow(typical / (energy + FLOOR * typical), 0.5 * WHITEN), LEAST_WHITENED, MOST_WHITENED);
}

@compute @workgroup_size(PAINT_SIDE, PAINT_SIDE)
fn paint_detail(@builtin(global_invocation_id) invocation: vec3<u32>) {
    let texel = invocation.xy;
    let size = vec2(task.output.width, task.output.height);
    if any(texel >= size) {
        return;
    }
    // The texture is the unit square.
    let place = (vec2<f32>(texel) + 0.5) / vec2<f32>(size);
    let at = place * vec2<f32>(vec2(task.copies[0].width, task.copies[0].height));
    let strokes = sampled(task.copies[2], at);
    var value: vec3<f32>;
    if hidden(task.which) == 0u {
        let sharp = sampled(task.original, place * vec2<f32>(vec2(task.original.width, task.original.height)));
        // `paint_squares` has written it.
        let finest = sampled(task.copies[1], at);
        value = (sharp + finest - strokes) * whitened(at);
    } else {
        let n = f32(task.original.width * task.original.height);
        let large = sampled(task.copies[3], at);
        value = (strokes - large) * whitened(at) + LOCAL * (large - pictures[task.sums].rgb / n);
    }
    pictures[task.output.first + texel.y * size.x + texel.x] = vec4(value, 0.0);
}
