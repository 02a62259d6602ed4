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
    var axes = grain_axes(in.relative, in.uv, flat_n);
    // Loose ground lies along the world's, which needs no differences of large numbers.
    if ((LOOSE_KINDS >> in.kind & 1u) == 1u) { axes = mat2x3f(1.0, 0.0, 0.0, 0.0, 1.0, 0.0); }
    let n = normalize(flat_n + axes * surface.slope);
    return vec4f(ground_radiance(surface, n, flat_n, in.relative, 1.0, in.clip.xy), 1.0);
}

// Which way u and v grow over a face: stones and slabs lie along their streets.
fn grain_axes(relative: vec3f, uv: vec2f, n: vec3f) -> mat2x3f {
    let right = dpdx(relative);
    let down = dpdy(relative);
    let a = cross(down, n);
    let b = cross(n, right);
    // Where the picture's axes and the normal are left-handed, both are turned round.
    let way = sign(dot(a, right));
    let u = way * (a * dpdx(uv.x) + b * dpdy(uv.x));
    let v = way * (a * dpdx(uv.y) + b * dpdy(uv.y));
    return mat2x3f(u * inverseSqrt(max(dot(u, u), 1e-30)), v * inverseSqrt(max(dot(v, v), 1e-30)));
}
