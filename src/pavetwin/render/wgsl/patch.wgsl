// The pavement around a defect: asphalt as elsewhere, with the relief, reflectance and shade of the heightfield.

@group(3) @binding(0) var relief_map: texture_2d<f32>;    // normal x, y, reflectance, openness

const WALL_LEVEL = 2.0;    // of the relief's texels of 5 mm: 2 cm

struct Vertex {
    @location(10) position: vec3f,
    @location(11) normal: vec4u,
    @location(12) uv: vec2f,
    @location(13) along: vec2f,      // the defect's x axis in the world
}

struct Seen {
    @builtin(position) clip: vec4f,
    @location(0) relative: vec3f,
    @location(1) uv: vec2f,
    @location(2) local: vec2f,
    @location(3) along: vec2f,
}

@vertex fn vertex(at: Instance, in: Vertex) -> Seen {
    var out: Seen;
    out.relative = place(at, in.position);
    out.clip = project(out.relative, vec3f(0.0));
    out.uv = in.uv;
    out.local = in.position.xy;
    out.along = in.along;
    return out;
}

@fragment fn fragment(in: Seen) -> @location(0) vec4f {
    let up = vec3f(0.0, 0.0, 1.0);
    let footprint = footprint_of(in.relative, up);
    let world = in.relative.xy + frame.camera.xy;
    let relief = textureSample(relief_map, smooth_sampler, in.uv);
    let across = vec2f(-in.along.y, in.along.x);
    // Grain lies on walls as on floors: it is laid on from the side where the surface is steep over a few centimetres.
    let mean = (textureSampleLevel(relief_map, smooth_sampler, in.uv, WALL_LEVEL).xy * 255.0 - 128.0) / 127.0;
    let facing = abs(in.along * mean.x + across * mean.y);
    let beside = select(world.x, world.y, facing.x > facing.y);
    let grain = select(world, vec2f(beside, in.relative.z + frame.camera.z), length(facing) > 0.55);
    var surface = ground_surface(0u, grain, in.local, world, footprint);
    let bent = (relief.xy * 255.0 - 128.0) / 127.0;
    // Back from a unit normal to a slope, which adds.
    let slope = bent / sqrt(max(1.0 - dot(bent, bent), 0.02));
    let total = surface.slope + in.along * slope.x + across * slope.y;
    let n = normalize(vec3f(total, 1.0));
    surface.albedo = clamp(surface.albedo * (relief.z * (255.0 / 128.0)), vec3f(0.0), vec3f(1.0));
    return vec4f(ground_radiance(surface, n, up, in.relative, relief.w, in.clip.xy), 1.0);
}
