// Labels and depths at pixel centres, of the same triangles as the picture.

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

fn seen_at(at: Instance, position: vec3f, uv: vec2f) -> Seen {
    let relative = place(at, position);
    let clip = project(relative, at.velocity);
    let moved = vec4f(clip.xy * at.shift.xy + at.shift.zw * clip.w, clip.zw);
    return Seen(moved, dot(relative, frame.axis.xyz), at.label, uv);
}
