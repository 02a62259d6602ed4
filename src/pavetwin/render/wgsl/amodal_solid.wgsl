// All triangles of a mesh.

@vertex fn vertex(at: Instance, @location(10) position: vec3f) -> Seen {
    return seen_at(at, position, vec2f(0.0));
}

@fragment fn fragment(in: Seen) -> @location(0) u32 {
    return in.label;
}
