// The pavement around a defect: asphalt as elsewhere, with the relief, reflectance and shade of the heightfield.

@group(3) @binding(0) var relief_map: texture_2d<f32>;    // normal x, y, reflectance, openness

const LUMINANCE = vec3f(0.2126, 0.7152, 0.0722);
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
    @location(4) world: vec4f,      // east, north, up, and the side of a pixel there [m]
    @location(5) shadow: vec3f,     // where it is in the shadow map
    @location(6) @interpolate(flat) size: f32,          // of the asphalt's detail [m]
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
    out.uv = in.uv;
    out.local = in.position.xy;
    out.world = vec4f(out.relative + frame.camera.xyz, pixel_at(out.relative));
    out.shadow = in_shadow_map(out.relative, vec3f(0.0, 0.0, 1.0));
    out.size = detail_size(0u);
    out.to_sun = frame.to_sun;
    out.sun = frame.sun;
    out.sky0 = frame.sky[0];
    out.sky1 = frame.sky[1];
    out.sky2 = frame.sky[2];
    out.sky3 = frame.sky[3];
    out.sky4 = frame.sky[4];
    out.sky5 = frame.sky[5];
    out.sky6 = frame.sky[6];
    out.along = in.along;
    return out;
}

@fragment fn fragment(in: Seen) -> @location(0) vec4f {
    lamp = Lamp(in.to_sun, in.sun, array<vec4f, 7>(in.sky0, in.sky1, in.sky2, in.sky3, in.sky4, in.sky5, in.sky6));
    let up = vec3f(0.0, 0.0, 1.0);
    let footprint = footprint_of(in.relative, up, in.world.w);
    let world = in.world.xy;
    let relief = textureSample(relief_map, smooth_sampler, in.uv);
    let across = vec2f(-in.along.y, in.along.x);
    // Walls have the same grain as floors: it is projected from the side where the surface is steep over a few centimetres.
    let mean = (textureSampleLevel(relief_map, smooth_sampler, in.uv, WALL_LEVEL).xy * 255.0 - 128.0) / 127.0;
    let facing = abs(in.along * mean.x + across * mean.y);
    let beside = select(world.x, world.y, facing.x > facing.y);
    let grain = select(world, vec2f(beside, in.world.z), length(facing) > 0.55);
    var surface = ground_surface(0u, in.size, grain, in.local, world, footprint);
    let lit = sunlight(in.shadow, up, in.world.w, pixel_jitter(in.clip.xy));
    let defect_free = ground_radiance(surface, normalize(vec3f(surface.slope, 1.0)), in.relative, lit, 1.0);
    let bent = (relief.xy * 255.0 - 128.0) / 127.0;
    // From a unit normal back to a slope, as slopes can be added.
    let slope = bent / sqrt(max(1.0 - dot(bent, bent), 0.02));
    let total = surface.slope + in.along * slope.x + across * slope.y;
    let n = normalize(vec3f(total, 1.0));
    surface.albedo = clamp(surface.albedo * (relief.z * (255.0 / 128.0)), vec3f(0.0), vec3f(1.0));
    let damaged = ground_radiance(surface, n, in.relative, lit, relief.w);
    return vec4f(damaged, dot(damaged, LUMINANCE) / dot(defect_free, LUMINANCE));
}
