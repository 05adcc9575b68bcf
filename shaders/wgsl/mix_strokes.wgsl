// Lays strokes of looks over one another. CPU twin, for layers of any number:
// `stylegaussian::strokes::mix_strokes`.

/// Words `[N]`: seed, protection, share.
@group(0) @binding(1) var<storage, read_write> words: array<u32>;
/// Words of looks.
@group(0) @binding(5) var<storage, read> look_0: array<u32>;
@group(0) @binding(6) var<storage, read> look_1: array<u32>;
@group(0) @binding(7) var<storage, read> look_2: array<u32>;
@group(0) @binding(8) var<storage, read> look_3: array<u32>;

/// The strokes of a Gaussian.
struct StrokeWord {
    seed: u32,
    /// How much it stands out, 0..1.
    protection: f32,
    /// Share of its strokes that are shown, 0..1.
    share: f32,
}

fn unpacked_word(word: u32) -> StrokeWord {
    return StrokeWord(
        word & ((1u << SEED_BITS) - 1u),
        f32((word >> SEED_BITS) & SEVEN_BITS) / f32(SEVEN_BITS),
        f32((word >> (SEED_BITS + 7u)) & SEVEN_BITS) / f32(SEVEN_BITS),
    );
}

/// A number of 0..1 in seven bits.
fn seven(x: f32) -> u32 {
    return u32(clamp(x, 0.0, 1.0) * f32(SEVEN_BITS) + 0.5);
}

fn packed_word(word: StrokeWord) -> u32 {
    return (word.seed & ((1u << SEED_BITS) - 1u))
        | (seven(word.protection) << SEED_BITS)
        | (seven(word.share) << (SEED_BITS + 7u));
}

/// The strokes of a Gaussian in a look.
fn look_word(look: u32, gaussian: u32) -> StrokeWord {
    switch look {
        case 0u: { return unpacked_word(look_0[gaussian]); }
        case 1u: { return unpacked_word(look_1[gaussian]); }
        case 2u: { return unpacked_word(look_2[gaussian]); }
        case 3u: { return unpacked_word(look_3[gaussian]); }
        default: { return StrokeWord(0u, 0.0, 0.0); }
    }
}

/// The strokes of a Gaussian if a share of those `below` is replaced by those `above`: spots change one after
/// another.
fn mixed(below: StrokeWord, above: StrokeWord, share: f32) -> StrokeWord {
    if above.share <= 0.0 {
        return StrokeWord(below.seed, below.protection, below.share * (1.0 - share));
    }
    if below.share <= 0.0 {
        return StrokeWord(above.seed, above.protection, above.share * share);
    }
    if below.seed == above.seed {
        return StrokeWord(above.seed, above.protection, mix(below.share, above.share, share));
    }
    // Multiples of the golden ratio.
    let random = f32((above.seed * 2654435769u) >> 8u) / 16777216.0;
    let turn = EDGE + (1.0 - 2.0 * EDGE) * random;
    let open = min(abs(share - turn) / EDGE, 1.0);
    if share > turn {
        return StrokeWord(above.seed, above.protection, above.share * open);
    }
    return StrokeWord(below.seed, below.protection, below.share * open);
}

/// The strokes of a Gaussian if a share of those `below` is changed. CPU twin:
/// `stylegaussian::strokes::StrokeFactors::word`.
fn changed(below: StrokeWord, layer: u32, share: f32) -> StrokeWord {
    let factors = 1.0 + share * (unpack2x16float(stack.layers[layer].factors) - 1.0);
    let squared = factors.y * factors.y * below.protection;
    let protection = squared / max(1.0 - below.protection + squared, 1e-6);
    let word = StrokeWord(below.seed, protection, below.share * factors.x);
    let first_seed = stack.layers[layer].first_seed;
    if first_seed == 0u {
        return word;
    }
    return mixed(word, StrokeWord(word.seed + first_seed, word.protection, word.share), share);
}

@compute @workgroup_size(MIX_WORKGROUP)
fn mix_strokes(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) n_workgroups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let item = item_of(workgroup.y * n_workgroups.x + workgroup.x, lane);
    if !item.exists {
        return;
    }
    var word = StrokeWord(0u, 0.0, 0.0);
    if !starts(item) {
        word = unpacked_word(words[item.gaussian]);
    }
    for (var touches = item.block.touches; touches != 0u; touches &= touches - 1u) {
        let layer = firstTrailingBit(touches);
        if stack.layers[layer].look == BELOW {
            word = changed(word, layer, share_of(layer, item));
            continue;
        }
        var above = look_word(stack.layers[layer].look, item.gaussian);
        above.seed += stack.layers[layer].first_seed;
        word = mixed(word, above, share_of(layer, item));
    }
    words[item.gaussian] = packed_word(word);
}
