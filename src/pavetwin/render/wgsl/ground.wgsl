// Ground of all kinds in one tile.

struct Vertex {
    @location(10) position: vec3f,
    @location(11) normal: vec4u,    // and the kind
    @location(12) uv: vec2f,
    @location(13) finish: vec4u,    // red, blue, grain and tone, 128 for 1
}

@vertex fn vertex(at: Instance, in: Vertex) -> Seen {
    let normal = unpack_normal(in.normal);
    return seen_at(at, in.position, normalize(normal), normal, in.uv, in.normal.w, in.finish);
}

@fragment fn fragment(in: Seen) -> Pixel {
    lamp = lamp_of(in);
    let flat_n = normalize(in.axis.xyz);
    let kind = u32(in.kind.x);
    let footprint = footprint_of(in.relative, flat_n, in.world.w);
    let surface = covered(bare_ground(in.kind, in.axis.w, in.uv, in.local, in.world.xy, footprint), 0.0);
    var axes = grain_axes(in.relative, in.uv, flat_n);
    // Texture axes of loose ground are the world's, which avoids differences of large numbers.
    if ((LOOSE_KINDS >> kind & 1u) == 1u) { axes = mat2x3f(1.0, 0.0, 0.0, 0.0, 1.0, 0.0); }
    let n = normalize(flat_n + axes * surface.slope);
    let lit = sunlight(in.shadow, flat_n, in.world.w, pixel_jitter(in.clip.xy), vec2f(0.0));
    return Pixel(vec4f(ground_radiance(surface, n, in.relative, lit, 1.0), 1.0), 0u, depth_seen(in));
}

// Directions of u and v over a face: stones and slabs are aligned with their street.
fn grain_axes(relative: vec3f, uv: vec2f, n: vec3f) -> mat2x3f {
    let right = dpdx(relative);
    let down = dpdy(relative);
    let a = cross(down, n);
    let b = cross(n, right);
    // Where the image's axes and the normal are left-handed, both are reversed.
    let way = sign(dot(a, right));
    let u = way * (a * dpdx(uv.x) + b * dpdy(uv.x));
    let v = way * (a * dpdx(uv.y) + b * dpdy(uv.y));
    return mat2x3f(u * inverseSqrt(max(dot(u, u), 1e-30)), v * inverseSqrt(max(dot(v, v), 1e-30)));
}
