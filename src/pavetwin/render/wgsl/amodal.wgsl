// Labels without occlusion: each object in its own cell of an atlas, with the triangles and pixel centres of the image.

struct Seen {
    @builtin(position) clip: vec4f,
    @location(0) @interpolate(flat) label: u32,
    @location(1) uv: vec2f,
}

fn seen_at(at: Instance, position: vec3f, uv: vec2f) -> Seen {
    let clip = project(place(at, position), at.velocity);
    return Seen(vec4f(clip.xy * at.shift.xy + at.shift.zw * clip.w, clip.zw), at.label, uv);
}
