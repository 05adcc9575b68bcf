// Splats with strokes in the blend of tiles.
//
// A software adapter that runs eight invocations in lockstep skips nothing but the iterations of loops, and not
// even the first one of those: it ends a loop after an iteration in which no invocation took part. And each
// sample of a texture costs as much as the blend of a row. So strokes are put off: splats are blended until the
// pixels in which they show strokes have filled a queue, with their weights. Then a loop takes one sample of
// each texture at a time, in which every invocation has a pixel of its own until its queue is empty. Strokes
// only add to colors, so their order does not matter.

/// Splats of a full queue. With twice as many, hardly less time is lost while others' queues are not empty.
const MOST_QUEUED: u32 = 32u;
/// Strokes of less weight are left out. Detail is a difference of a few tenths, so that each changes its pixel
/// by less than a fifth of a step of eight bits.
const LEAST_WEIGHT: f32 = 2e-3;

/// Splats that show strokes.
struct Queue {
    n: u32,
    records: array<u32, MOST_QUEUED>,
    /// A bit for each of the sixteen pixels in which they do.
    pixels: array<u32, MOST_QUEUED>,
    /// The weights in the first two rows and in the others, as f16.
    weights: array<vec4<u32>, 2u * MOST_QUEUED>,
}

/// The weights that strokes have in a row: those of the splat, where it shows any.
fn stroke_weights(weight: vec4<f32>, alpha: vec4<f32>) -> vec4<f32> {
    return select(vec4(0.0), weight, (weight >= vec4(LEAST_WEIGHT)) & (alpha >= vec4(LEAST_ALPHA)));
}

/// A bit for each weight that is not 0.
fn bits_of(weight: vec4<f32>) -> u32 {
    let bits = select(vec4(0u), vec4(1u, 2u, 4u, 8u), weight > vec4(0.0));
    return bits.x | bits.y | bits.z | bits.w;
}

fn packed_weights(a: vec4<f32>, b: vec4<f32>) -> vec4<u32> {
    return vec4(pack2x16float(a.xy), pack2x16float(a.zw), pack2x16float(b.xy), pack2x16float(b.zw));
}

/// A step through the pixels of a queue, and through the octaves of each.
struct Step {
    /// Items that have begun.
    n_items: u32,
    record: u32,
    /// The pixels of the last item that are left.
    pixels: u32,
    octave: f32,
    n_octaves: f32,
    strokes: Strokes,
    /// The first pixel, from the splat's center.
    first: vec2<f32>,
}

/// Brings a step to its pixel. Returns whether there is one.
fn find_pixel(step: ptr<function, Step>, queue: ptr<function, Queue>, middle: vec2<f32>) -> bool {
    if (*step).pixels == 0u && (*step).n_items < (*queue).n {
        let record = (*queue).records[(*step).n_items];
        let strokes = unpacked_strokes(stroke_records[record]);
        (*step).record = record;
        (*step).pixels = (*queue).pixels[(*step).n_items];
        (*step).n_octaves = n_octaves_of(strokes);
        (*step).strokes = strokes;
        (*step).first = middle - geometry_halves[record].xy;
        (*step).n_items += 1u;
    }
    return (*step).pixels != 0u;
}

fn pixel_of(step: ptr<function, Step>) -> u32 {
    return firstTrailingBit((*step).pixels);
}

fn weight_of(step: ptr<function, Step>, queue: ptr<function, Queue>) -> f32 {
    let pixel = pixel_of(step);
    let pair = (*queue).weights[2u * ((*step).n_items - 1u) + (pixel >> 3u)][(pixel >> 1u) & 3u];
    return unpack2x16float(pair)[pixel & 1u];
}

/// The place in the painting.
fn place_of(step: ptr<function, Step>) -> vec2<f32> {
    let pixel = pixel_of(step);
    return place_at((*step).strokes, (*step).first + vec2(f32(pixel & 3u), f32(pixel >> 2u)));
}

/// Goes on to the next octave, up to the last one, and then to the next pixel.
fn go_on(step: ptr<function, Step>, last_octave: f32) {
    (*step).octave += 1.0;
    if (*step).octave > last_octave {
        (*step).octave = 0.0;
        (*step).pixels &= (*step).pixels - 1u;
    }
}

/// Adds the strokes of a queue to the detail of sixteen pixels.
fn paint(queue: ptr<function, Queue>, detail: ptr<function, array<vec3<f32>, 16>>, middle: vec2<f32>) {
    var step: Step;
    while find_pixel(&step, queue, middle) {
        let at = place_of(&step);
        var sum = step.strokes.gains.x * fine_octave(step.strokes, at, step.octave);
        sum += step.strokes.gains.y * wide_octave(step.strokes, at, step.octave);
        (*detail)[pixel_of(&step)] += weight_of(&step, queue) * sum;
        go_on(&step, step.n_octaves);
    }
}

/// Adds the light on them. It comes with the first octave, or with each of those that are stable on screen.
///
/// In a loop of its own: one iteration of it for each queue is spent where there is no light.
fn light(queue: ptr<function, Queue>, detail: ptr<function, array<vec3<f32>, 16>>, middle: vec2<f32>) {
    var step: Step;
    let n_lights = hidden(stroke_draw.n_lights);
    while n_lights > 0u && find_pixel(&step, queue, middle) {
        let splat = unpacked(geometry_halves[step.record], color_halves[step.record]);
        let relief = unpacked_relief(relief_records[step.record]);
        let added = lit(step.strokes, relief, place_of(&step), step.octave, splat.color);
        (*detail)[pixel_of(&step)] += weight_of(&step, queue) * added;
        go_on(&step, select(0.0, step.n_octaves, is_stable()));
    }
}

/// Adds the detail of four pixels to a row.
fn add_detail(row: ptr<function, Row>, a: vec3<f32>, b: vec3<f32>, c: vec3<f32>, d: vec3<f32>) {
    (*row).red += vec4(a.r, b.r, c.r, d.r);
    (*row).green += vec4(a.g, b.g, c.g, d.g);
    (*row).blue += vec4(a.b, b.b, c.b, d.b);
}

/// Blends the entries from `first` to `end` into four rows. `middle` is the middle of the first pixel.
fn blend_list(
    row_0: ptr<function, Row>,
    row_1: ptr<function, Row>,
    row_2: ptr<function, Row>,
    row_3: ptr<function, Row>,
    first: u32,
    end: u32,
    middle: vec2<f32>,
) {
    var detail: array<vec3<f32>, 16>;
    var queue: Queue;
    var i = first;
    while i < end {
        queue.n = 0u;
        for (; i < end && queue.n < MOST_QUEUED; i++) {
            let record = entries[i];
            let splat = splat_of(record);
            let d = middle - splat.center;
            let dx = d.x + vec4(0.0, 1.0, 2.0, 3.0);
            let alpha_0 = alphas(splat, dx, d.y);
            let alpha_1 = alphas(splat, dx, d.y + 1.0);
            let alpha_2 = alphas(splat, dx, d.y + 2.0);
            let alpha_3 = alphas(splat, dx, d.y + 3.0);
            let weight_0 = stroke_weights(blend(row_0, splat, alpha_0), alpha_0);
            let weight_1 = stroke_weights(blend(row_1, splat, alpha_1), alpha_1);
            let weight_2 = stroke_weights(blend(row_2, splat, alpha_2), alpha_2);
            let weight_3 = stroke_weights(blend(row_3, splat, alpha_3), alpha_3);
            let pixels = bits_of(weight_0)
                | (bits_of(weight_1) << 4u)
                | (bits_of(weight_2) << 8u)
                | (bits_of(weight_3) << 12u);
            if pixels != 0u && has_strokes(stroke_records[record]) {
                queue.records[queue.n] = record;
                queue.pixels[queue.n] = pixels;
                queue.weights[2u * queue.n] = packed_weights(weight_0, weight_1);
                queue.weights[2u * queue.n + 1u] = packed_weights(weight_2, weight_3);
                queue.n += 1u;
            }
            if are_finished((*row_0).light, (*row_1).light, (*row_2).light, (*row_3).light) {
                i = end;
            }
        }
        paint(&queue, &detail, middle);
        light(&queue, &detail, middle);
    }
    add_detail(row_0, detail[0], detail[1], detail[2], detail[3]);
    add_detail(row_1, detail[4], detail[5], detail[6], detail[7]);
    add_detail(row_2, detail[8], detail[9], detail[10], detail[11]);
    add_detail(row_3, detail[12], detail[13], detail[14], detail[15]);
}
