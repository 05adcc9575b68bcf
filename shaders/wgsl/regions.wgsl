// Shapes of regions by their signed distance, and the weight across their edges. CPU twins:
// `stylegaussian::layers`, modules `shape` and `lattice`.

/// Whether any region is noise. The others take about three quarters of the time without it: a processor that
/// masks lanes instead of branching evaluates every shape.
override has_noise: bool = false;

/// A random number of a whole point, 0..1: the first of pcg3d's three (Jarzynski and Olano, 2020).
fn lattice_hash(at: vec3<u32>) -> f32 {
    var v = at * 1664525u + 1013904223u;
    v.x += v.y * v.z;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v ^= v >> vec3(16u);
    v.x += v.y * v.z;
    return f32(v.x >> 8u) / 16777216.0;
}

/// Value noise, 0..1.
fn lattice_noise(at: vec3<f32>) -> f32 {
    let cell = floor(at);
    let linear = at - cell;
    let t = linear * linear * (3.0 - 2.0 * linear);
    let base = bitcast<vec3<u32>>(vec3<i32>(cell));
    let x00 = mix(lattice_hash(base), lattice_hash(base + vec3(1u, 0u, 0u)), t.x);
    let x10 = mix(lattice_hash(base + vec3(0u, 1u, 0u)), lattice_hash(base + vec3(1u, 1u, 0u)), t.x);
    let x01 = mix(lattice_hash(base + vec3(0u, 0u, 1u)), lattice_hash(base + vec3(1u, 0u, 1u)), t.x);
    let x11 = mix(lattice_hash(base + vec3(0u, 1u, 1u)), lattice_hash(base + vec3(1u)), t.x);
    return mix(mix(x00, x10, t.y), mix(x01, x11, t.y), t.z);
}

/// The distance from an ellipsoid, to first order.
fn ellipsoid_distance(at: vec3<f32>, radii: vec3<f32>) -> f32 {
    let scaled = at / radii;
    let size = length(scaled);
    if size > 0.0 {
        return size * (size - 1.0) / length(scaled / radii);
    }
    return -min(radii.x, min(radii.y, radii.z));
}

/// The distance from a cone in the plane of its axis.
fn cone_distance(at: vec2<f32>, radius: f32, height: f32) -> f32 {
    let tip = vec2(0.0, 0.5 * height);
    let side = vec2(radius, -height);
    let from_tip = at - tip;
    let along = clamp(dot(from_tip, side) / dot(side, side), 0.0, 1.0);
    let to_side = length(from_tip - along * side);
    let to_bottom = length(vec2(max(at.x - radius, 0.0), at.y + 0.5 * height));
    let is_inside = dot(from_tip, vec2(height, radius)) < 0.0 && at.y > -0.5 * height;
    let nearest = min(to_side, to_bottom);
    return select(nearest, -nearest, is_inside);
}

/// The distance from the surface of a shape, negative within it.
fn shape_distance(shape: u32, sizes: vec4<f32>, at: vec3<f32>) -> f32 {
    // The distance from the axis, and the place along it.
    let plane = vec2(length(at.xz), at.y);
    switch shape {
        case SHAPE_HALF_SPACE: { return at.y; }
        case SHAPE_ELLIPSOID: { return ellipsoid_distance(at, sizes.xyz); }
        case SHAPE_CUBOID: {
            let outside = abs(at) - sizes.xyz;
            return length(max(outside, vec3(0.0))) + min(max(outside.x, max(outside.y, outside.z)), 0.0);
        }
        case SHAPE_CYLINDER: {
            let outside = vec2(plane.x, abs(plane.y)) - sizes.xy;
            return length(max(outside, vec2(0.0))) + min(max(outside.x, outside.y), 0.0);
        }
        case SHAPE_CAPSULE: {
            let along = clamp(plane.y, -sizes.y, sizes.y);
            return length(vec2(plane.x, plane.y - along)) - sizes.x;
        }
        case SHAPE_CONE: { return cone_distance(plane, sizes.x, sizes.y); }
        case SHAPE_TORUS: { return length(vec2(plane.x - sizes.x, plane.y)) - sizes.y; }
        default: {
            if has_noise {
                return sizes.x * (lattice_noise(at / sizes.x) - sizes.y);
            }
            return 0.0;
        }
    }
}

/// The weight at a distance from a shape: 1 within it, 0 outside, a smooth step across the edge of this width.
fn weight_at(distance: f32, softness: f32, inverse_softness: f32) -> f32 {
    let half_width = 0.5 * softness;
    // A comparison with NaN is false.
    if !(distance < half_width) {
        return 0.0;
    }
    if distance <= -half_width {
        return 1.0;
    }
    let t = 0.5 - distance * inverse_softness;
    return t * t * (3.0 - 2.0 * t);
}
