// Walls and roofs: vertex colours × a texture of an array, or plain.

@group(1) @binding(0) var facades: texture_2d_array<f32>;    // reflectance, roughness
@group(1) @binding(1) var repeat_sampler: sampler;

struct Vertex {
    @location(10) position: vec3f,
    @location(11) normal: vec4u,
    @location(12) colour: vec4f,
    @location(13) surface: vec4u,    // roughness, metallic, 0, layer + 1
    @location(14) uv: vec2f,
}

struct Seen {
    @builtin(position) clip: vec4f,
    @location(0) relative: vec3f,
    @location(1) normal: vec3f,
    @location(2) colour: vec3f,
    @location(3) @interpolate(flat) surface: vec4u,
    @location(4) uv: vec2f,
    @location(5) depth: f32,
}

@vertex fn vertex(at: Instance, in: Vertex) -> Seen {
    var out: Seen;
    out.relative = place(at, in.position);
    out.clip = project(out.relative, vec3f(0.0));
    out.normal = unpack_normal(in.normal);
    out.colour = in.colour.rgb;
    out.surface = in.surface;
    out.uv = in.uv;
    out.depth = depth_of(out.relative);
    return out;
}

@fragment fn fragment(in: Seen) -> Pixel {
    let texel = textureSample(facades, repeat_sampler, in.uv / FACADE_REPEAT_M, max(i32(in.surface.w), 1) - 1);
    let textured = in.surface.w > 0u;
    let colour = in.colour * select(vec3f(1.0), texel.rgb, textured);
    let rough = clamp(select(f32(in.surface.x) / 255.0, texel.a, textured), 0.05, 1.0);
    let wall = Solid(in.relative, normalize(in.normal), colour, rough, 0.0, vec3f(0.0));
    return Pixel(vec4f(solid_radiance(wall, pixel_jitter(in.clip.xy)), 1.0), 0u, in.depth);
}
