// The same for the pavement around a defect: its label is where its mask is, unfiltered.

struct Vertex {
    @location(10) position: vec3f,
    @location(12) uv: vec2f,
}

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

override amodal: bool = false;

@group(1) @binding(0) var mask: texture_2d<f32>;

@vertex fn vertex(at: Instance, in: Vertex) -> Seen {
    let relative = place(at, in.position);
    let clip = project(relative, at.velocity);
    var out: Seen;
    out.clip = vec4f(clip.xy * at.shift.xy + at.shift.zw * clip.w, clip.zw);
    out.depth = dot(relative, frame.axis.xyz);
    out.label = at.label;
    out.uv = in.uv;
    return out;
}

@fragment fn fragment(in: Seen) -> Truth {
    let size = vec2f(textureDimensions(mask));
    let texel = clamp(vec2i(floor(in.uv * size)), vec2i(0), vec2i(size) - 1);
    let inside = textureLoad(mask, texel, 0).r > 0.5;
    if (amodal && !inside) { discard; }
    return Truth(select(0u, in.label, inside), in.depth);
}
