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
    @location(4) world: vec3f,      // east, north, and the side of a pixel there [m]
    @location(5) shadow: vec3f,     // where it is in the shadow map
    @location(6) @interpolate(flat) kind: vec2f,        // and the size of its detail [m]
    @location(7) @interpolate(flat) to_sun: vec4f,      // the lamp
    @location(8) @interpolate(flat) sun: vec4f,
    @location(9) @interpolate(flat) sky0: vec4f,
    @location(10) @interpolate(flat) sky1: vec4f,
    @location(11) @interpolate(flat) sky2: vec4f,
    @location(12) @interpolate(flat) sky3: vec4f,
    @location(13) @interpolate(flat) sky4: vec4f,
    @location(14) @interpolate(flat) sky5: vec4f,
    @location(15) @interpolate(flat) sky6: vec4f,
}

@vertex fn vertex(at: Instance, in: Vertex) -> Seen {
    var out: Seen;
    out.relative = place(at, in.position);
    out.clip = project(out.relative, vec3f(0.0));
    out.normal = unpack_normal(in.normal);
    out.world = vec3f(out.relative.xy + frame.camera.xy, pixel_at(out.relative));
    out.shadow = in_shadow_map(out.relative, normalize(out.normal));
    out.uv = in.uv;
    out.local = in.position.xy;
    out.kind = vec2f(f32(in.normal.w), detail_size(in.normal.w));
    out.to_sun = frame.to_sun;
    out.sun = frame.sun;
    out.sky0 = frame.sky[0];
    out.sky1 = frame.sky[1];
    out.sky2 = frame.sky[2];
    out.sky3 = frame.sky[3];
    out.sky4 = frame.sky[4];
    out.sky5 = frame.sky[5];
    out.sky6 = frame.sky[6];
    return out;
}

@fragment fn fragment(in: Seen) -> @location(0) vec4f {
    lamp = Lamp(in.to_sun, in.sun, array<vec4f, 7>(in.sky0, in.sky1, in.sky2, in.sky3, in.sky4, in.sky5, in.sky6));
    let flat_n = normalize(in.normal);
    let kind = u32(in.kind.x);
    let footprint = footprint_of(in.relative, flat_n, in.world.z);
    let surface = ground_surface(kind, in.kind.y, in.uv, in.local, in.world.xy, footprint);
    var axes = grain_axes(in.relative, in.uv, flat_n);
    // Texture axes of loose ground are the world's, which avoids differences of large numbers.
    if ((LOOSE_KINDS >> kind & 1u) == 1u) { axes = mat2x3f(1.0, 0.0, 0.0, 0.0, 1.0, 0.0); }
    let n = normalize(flat_n + axes * surface.slope);
    let lit = sunlight(in.shadow, flat_n, in.world.z, pixel_jitter(in.clip.xy));
    return vec4f(ground_radiance(surface, n, in.relative, lit, 1.0), 1.0);
}

// Directions of u and v over a face: stones and slabs are aligned with their street.
fn grain_axes(relative: vec3f, uv: vec2f, n: vec3f) -> mat2x3f {
    let right = dpdx(relative);
    let down = dpdy(relative);
    let a = cross(down, n);
    let b = cross(n, right);
    // Where the picture's axes and the normal are left-handed, both are reversed.
    let way = sign(dot(a, right));
    let u = way * (a * dpdx(uv.x) + b * dpdy(uv.x));
    let v = way * (a * dpdx(uv.y) + b * dpdy(uv.y));
    return mat2x3f(u * inverseSqrt(max(dot(u, u), 1e-30)), v * inverseSqrt(max(dot(v, v), 1e-30)));
}
