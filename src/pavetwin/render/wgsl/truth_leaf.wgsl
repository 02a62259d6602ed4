// Labels and depths of leaves: objects behind a gap are visible through it.

struct Seen {
    @builtin(position) clip: vec4f,
    @location(0) depth: f32,
    @location(1) @interpolate(flat) label: u32,
    @location(2) uv: vec2f,
}

struct Truth {
    @location(0) label: u32,
    @location(1) depth: f32,
}

@vertex fn vertex(at: Instance, @location(10) position: vec3f, @location(14) uv: vec2f) -> Seen {
    let relative = place(at, position);
    let clip = project(relative, at.velocity);
    let moved = vec4f(clip.xy * at.shift.xy + at.shift.zw * clip.w, clip.zw);
    return Seen(moved, dot(relative, frame.axis.xyz), at.label, uv);
}

@fragment fn fragment(in: Seen) -> Truth {
    if (is_gap(leaf_at(in.uv))) { discard; }
    return Truth(in.label, in.depth);
}
