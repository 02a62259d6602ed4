// Labels and depths at pixel centres, of the same triangles as the picture.

struct Vertex {
    @location(10) position: vec3f,
}

struct Seen {
    @builtin(position) clip: vec4f,
    @location(0) depth: f32,
    @location(1) @interpolate(flat) label: u32,
}

struct Truth {
    @location(0) label: u32,
    @location(1) depth: f32,
}

@vertex fn vertex(at: Instance, in: Vertex) -> Seen {
    let relative = place(at, in.position);
    let clip = project(relative, at.velocity);
    var out: Seen;
    out.clip = vec4f(clip.xy * at.shift.xy + at.shift.zw * clip.w, clip.zw);
    out.depth = dot(relative, frame.axis.xyz);
    out.label = at.label;
    return out;
}

@fragment fn fragment(in: Seen) -> Truth {
    return Truth(in.label, in.depth);
}
