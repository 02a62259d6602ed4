// Models whose triangles cover many pixels: lighting per pixel.

struct Seen {
    @builtin(position) clip: vec4f,
    @location(0) relative: vec3f,
    @location(1) normal: vec3f,
    @location(2) colour: vec3f,
    @location(3) surface: vec2f,
    @location(4) glow: vec3f,
}

@vertex fn vertex(at: Instance, in: Vertex) -> Seen {
    let model = model_vertex(at, in);
    let clip = project(model.relative, at.velocity);
    return Seen(clip, model.relative, model.normal, model.colour, vec2f(model.roughness, model.metal), model.glow);
}

@fragment fn fragment(in: Seen) -> @location(0) vec4f {
    let normal = normalize(in.normal + vec3f(0.0, 0.0, 1e-6));
    let solid = Solid(in.relative, normal, in.colour, in.surface.x, in.surface.y, in.glow);
    return vec4f(solid_radiance(solid, pixel_jitter(in.clip.xy)), 1.0);
}
