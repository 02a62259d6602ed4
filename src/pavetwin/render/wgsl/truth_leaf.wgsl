// Leaves: objects behind a gap are visible through it.

@vertex fn vertex(at: Instance, @location(10) position: vec3f, @location(14) uv: vec2f) -> Seen {
    return seen_at(at, position, uv);
}

@fragment fn fragment(in: Seen) -> Truth {
    if (is_gap(leaf_at(in.uv))) { discard; }
    return Truth(in.label, in.depth);
}
