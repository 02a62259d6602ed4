// A defect: where its mask is.

@group(1) @binding(0) var mask: texture_2d<f32>;

@vertex fn vertex(at: Instance, @location(10) position: vec3f, @location(12) uv: vec2f) -> Seen {
    return seen_at(at, position, uv);
}

@fragment fn fragment(in: Seen) -> @location(0) u32 {
    if (!is_inside(in.uv)) { discard; }
    return in.label;
}
