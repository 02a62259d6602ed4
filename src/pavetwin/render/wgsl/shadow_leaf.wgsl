// Depths of leaves as the sun sees them.

struct Seen {
    @builtin(position) clip: vec4f,
    @location(0) uv: vec2f,
}

@vertex fn vertex(at: Instance, @location(10) position: vec3f, @location(14) uv: vec2f) -> Seen {
    let seen = (frame.to_shadow * vec4f(place(at, position), 1.0)).xyz;
    return Seen(vec4f(seen.x * 2.0 - 1.0, 1.0 - seen.y * 2.0, seen.z, 1.0), uv);
}

@fragment fn fragment(in: Seen) {
    if (is_gap(leaf_at(in.uv))) { discard; }
}
