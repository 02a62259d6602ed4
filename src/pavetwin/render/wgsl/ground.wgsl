// Ground of all kinds in one tile.

struct Vertex {
    @location(10) position: vec3f,
    @location(11) normal: vec4u,    // and the kind
    @location(12) uv: vec2f,
}

struct Seen {
    @builtin(position) clip: vec4f,
    @location(0) relative: vec3f,
    @location(1) normal: vec3f,
    @location(2) uv: vec2f,
    @location(3) local: vec2f,
    @location(4) @interpolate(flat) kind: u32,
}

@vertex fn vertex(at: Instance, in: Vertex) -> Seen {
    var out: Seen;
    out.relative = place(at, in.position);
    out.clip = project(out.relative, vec3f(0.0));
    out.normal = unpack_normal(in.normal);
    out.uv = in.uv;
    out.local = in.position.xy;
    out.kind = in.normal.w;
    return out;
}

@fragment fn fragment(in: Seen) -> @location(0) vec4f {
    let flat_n = normalize(in.normal);
    let footprint = footprint_of(in.relative, flat_n);
    let world = in.relative.xy + frame.camera.xy;
    let surface = ground_surface(in.kind, in.uv, in.local, world, footprint);
    // The relief's x lies along the world's, or on upright faces along the face.
    let along = normalize(select(vec3f(flat_n.z, 0.0, -flat_n.x), vec3f(-flat_n.y, flat_n.x, 0.0), abs(flat_n.z) < 0.5));
    let n = normalize(flat_n + along * surface.slope.x + cross(flat_n, along) * surface.slope.y);
    return vec4f(ground_radiance(surface, n, flat_n, in.relative, 1.0, in.clip.xy), 1.0);
}
