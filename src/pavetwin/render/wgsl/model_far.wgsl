// Models whose triangles cover few pixels: lighting per vertex. lavapipe shades sixteen pixels for every triangle,
// however small.

struct Seen {
    @builtin(position) clip: vec4f,
    @location(0) radiance: vec3f,
}

@vertex fn vertex(at: Instance, in: Vertex) -> Seen {
    let model = model_vertex(at, in);
    return Seen(project(model.relative, at.velocity), solid_radiance(model, 0.0));
}

@fragment fn fragment(in: Seen) -> @location(0) vec4f {
    // Across a sliver seen edge-on, interpolated values exceed those of its corners a little.
    return vec4f(max(in.radiance, vec3f(0.0)), 1.0);
}
