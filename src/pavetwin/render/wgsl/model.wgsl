// Vehicles, people, trees, lamps: vertex colours, tints of the instance, reflected sky.

struct Vertex {
    @location(10) position: vec3f,
    @location(11) normal: vec4u,
    @location(12) colour: vec4f,
    @location(13) surface: vec4u,    // roughness, metallic, slot
}

fn model_vertex(at: Instance, in: Vertex) -> Solid {
    var out: Solid;
    out.relative = place(at, in.position);
    out.normal = normalize(turn(at, unpack_normal(in.normal)) + vec3f(0.0, 0.0, 1e-6));
    var tint = vec4f(1.0, 1.0, 1.0, 0.0);
    switch (in.surface.z) {
        case 1u: { tint = at.tint1; }
        case 2u: { tint = at.tint2; }
        case 3u: { tint = at.tint3; }
        case 4u: { tint = at.tint4; }
        default: {}
    }
    out.colour = in.colour.rgb * tint.rgb;
    // Emission is in units of white paper in full sun: 100 klx / π.
    out.glow = out.colour * (tint.a * 31.8);
    out.roughness = clamp(f32(in.surface.x) / 255.0, 0.05, 1.0);
    out.metal = f32(in.surface.y) / 255.0;
    return out;
}
