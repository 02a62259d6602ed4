// Models whose triangles cover many pixels: lighting per pixel. What varies slowly over a triangle comes from its
// vertices: the light of the sky, and where it lies in the shadow map.

struct Seen {
    @builtin(position) clip: vec4f,
    @location(0) relative: vec3f,
    @location(1) normal: vec3f,
    @location(2) colour: vec3f,
    @location(3) surface: vec3f,    // roughness, metal, side of a pixel there [m]
    @location(4) ambient: vec3f,
    @location(5) shadow: vec3f,
    @location(6) lean: vec2f,
    @location(7) depth: f32,
    @location(8) @interpolate(flat) label: u32,
}

@vertex fn vertex(at: Instance, in: Vertex) -> Seen {
    lamp = lamp_of_frame();
    let model = model_vertex(at, in);
    return Seen(
        project(model.relative, at.velocity), model.relative, model.normal, model.colour,
        vec3f(model.roughness, model.metal, pixel_at(model.relative)), solid_ambient(model),
        in_shadow_map(model.relative, model.normal), lean_of(model.normal),
        depth_of(model.relative), at.label,
    );
}

@fragment fn fragment(in: Seen) -> Pixel {
    lamp.to_sun = frame.to_sun;
    lamp.sun = frame.sun;
    let normal = normalize(in.normal + vec3f(0.0, 0.0, 1e-6));
    let solid = Solid(in.relative, normal, in.colour, in.surface.x, in.surface.y, vec3f(0.0));
    let lit = sunlight(in.shadow, normal, in.surface.z, pixel_jitter(in.clip.xy), in.lean);
    return Pixel(vec4f(solid_lit(solid, in.ambient, lit), 1.0), in.label, in.depth);
}
