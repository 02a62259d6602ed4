// Models whose triangles cover few pixels: lighting per vertex. lavapipe shades sixteen pixels for every triangle,
// however small.

struct Seen {
    @builtin(position) clip: vec4f,
    @location(0) radiance: vec3f,
    @location(1) depth: f32,
    @location(2) @interpolate(flat) label: u32,
}

@vertex fn vertex(at: Instance, in: Vertex) -> Seen {
    let model = model_vertex(at, in);
    return Seen(
        project(model.relative, at.velocity), solid_radiance(model, 0.0), depth_of(model.relative), at.label,
    );
}

@fragment fn fragment(in: Seen) -> Pixel {
    // Across a sliver seen edge-on, interpolated values exceed those of its corners a little.
    return Pixel(vec4f(max(in.radiance, vec3f(0.0)), 1.0), in.label, in.depth);
}
