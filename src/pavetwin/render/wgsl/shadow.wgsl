// Depths as the sun sees them.

struct Vertex {
    @location(10) position: vec3f,
}

@vertex fn vertex(at: Instance, in: Vertex) -> @builtin(position) vec4f {
    let seen = (frame.to_shadow * vec4f(place(at, in.position), 1.0)).xyz;
    return vec4f(seen.x * 2.0 - 1.0, 1.0 - seen.y * 2.0, seen.z, 1.0);
}
