// Strokes that move: their seeds are moved before records are made. CPU twin:
// `stylegaussian::strokes::StrokeMotion`.

/// How the strokes of some seeds move, now.
struct StrokeMotion {
    /// The unit direction of a flow, in scene space.
    toward: vec3<f32>,
    /// The first seed that moves so.
    first: u32,
    /// The number after that of the last one.
    end: u32,
    /// One of the `KIND_` constants.
    kind: u32,
    /// Number of the present drawing of strokes that are redrawn, or the bits of the part of the present run of
    /// strokes that run, an f32 of 0..1.
    phase: u32,
    /// Distance in widths of a stroke.
    amount: f32,
}

/// The change of a seed by a motion.
struct MovedSeed {
    /// The painting's axes on the scene, unit vectors.
    right: vec3<f32>,
    down: vec3<f32>,
    /// Added to its place, as a part of `PERIOD`.
    shift: vec2<f32>,
    /// Factor of its gains.
    gain: f32,
}

/// The finalizer of MurmurHash3.
fn hashed(number: u32) -> u32 {
    var h = number;
    h = (h ^ (h >> 16u)) * 0x85ebca6bu;
    h = (h ^ (h >> 13u)) * 0xc2b2ae35u;
    return h ^ (h >> 16u);
}

/// The upper 24 bits of a hash as a number of 0..1.
fn unit(hash: u32) -> f32 {
    return f32(hash >> 8u) / 16777216.0;
}

/// A seed that is moved. `own` is a number of its own, `direction` that of its strokes in the painting, and
/// `aspect` the texels in y to one in x.
fn moved(seed: MovedSeed, motion: StrokeMotion, own: u32, direction: vec2<f32>, aspect: f32) -> MovedSeed {
    let widths = STROKE * motion.amount / PERIOD * vec2(1.0, aspect);
    switch motion.kind {
        case KIND_BOIL: {
            let first = hashed(own ^ hashed(motion.phase));
            let second = hashed(first);
            let signed = 2.0 * vec3(unit(first), unit(second), unit(hashed(second))) - 1.0;
            let turn = TURN * motion.amount * signed.z;
            return MovedSeed(
                seed.right * cos(turn) + seed.down * sin(turn),
                seed.down * cos(turn) - seed.right * sin(turn),
                widths * signed.xy,
                1.0,
            );
        }
        case KIND_FLOW: {
            let part = fract(bitcast<f32>(motion.phase) + unit(own));
            let cosine = dot(seed.right * direction.x + seed.down * direction.y, motion.toward);
            let speed = clamp(cosine / ACROSS, -1.0, 1.0);
            let open = smoothstep(0.0, FADE, min(part, 1.0 - part));
            let shift = -widths * direction * ((part - 0.5) * speed);
            let gain = 1.0 - min(abs(speed) / SLOW, 1.0) * (1.0 - open);
            return MovedSeed(seed.right, seed.down, shift, gain);
        }
        default: {
            return seed;
        }
    }
}
