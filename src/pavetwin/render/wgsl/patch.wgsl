// The pavement around a defect: as beside it, with the relief, reflectance and shade of the heightfield.

@group(3) @binding(0) var relief_map: texture_2d<f32>;    // normal x, y, reflectance, openness
@group(3) @binding(1) var mask: texture_2d<f32>;          // label, lost share of the surface

const LUMINANCE = vec3f(0.2126, 0.7152, 0.0722);
const WALL_LEVEL = 2.0;    // of the relief's texels of 5 mm: 2 cm

struct Vertex {
    @location(10) position: vec3f,
    @location(11) normal: vec4u,
    @location(12) uv: vec2f,
    @location(13) along: vec2f,      // the defect's x axis in the world
    @location(14) finish: vec4u,
}

@vertex fn vertex(at: Instance, in: Vertex) -> Seen {
    return seen_at(at, in.position, vec3f(0.0, 0.0, 1.0), vec3f(in.along, f32(at.label >> 16u)), in.uv, in.normal.w, in.finish);
}

@fragment fn fragment(in: Seen) -> Pixel {
    lamp = lamp_of(in);
    let up = vec3f(0.0, 0.0, 1.0);
    let footprint = footprint_of(in.relative, up, in.world.w);
    let world = in.world.xy;
    let relief = textureSample(relief_map, smooth_sampler, in.uv);
    let along = in.axis.xy;
    let across = vec2f(-along.y, along.x);
    // Walls have the same grain as floors: it is projected from the side where the surface is steep over a few
    // centimetres.
    let mean = (textureSampleLevel(relief_map, smooth_sampler, in.uv, WALL_LEVEL).xy * 255.0 - 128.0) / 127.0;
    let facing = abs(along * mean.x + across * mean.y);
    let beside = select(world.x, world.y, facing.x > facing.y);
    let grain = select(world, vec2f(beside, in.world.z), length(facing) > 0.55);
    let ground = bare_ground(in.kind, in.axis.w, grain, in.local, world, footprint);
    let before = covered(ground, 0.0);
    var surface = covered(ground, textureSample(mask, smooth_sampler, in.uv).g);
    let lit = sunlight(in.shadow, up, in.world.w, pixel_jitter(in.clip.xy), vec2f(0.0));
    let defect_free = ground_radiance(before, normalize(vec3f(before.slope, 1.0)), in.relative, lit, 1.0);
    let bent = (relief.xy * 255.0 - 128.0) / 127.0;
    // From a unit normal back to a slope, as slopes can be added.
    let slope = bent / sqrt(max(1.0 - dot(bent, bent), 0.02));
    let total = surface.slope + along * slope.x + across * slope.y;
    let n = normalize(vec3f(total, 1.0));
    surface.albedo = clamp(surface.albedo * (relief.z * (255.0 / 128.0)), vec3f(0.0), vec3f(1.0));
    let damaged = ground_radiance(surface, n, in.relative, lit, relief.w);
    let light = vec4f(damaged, dot(damaged, LUMINANCE) / dot(defect_free, LUMINANCE));
    let label = (u32(round(in.axis.z)) << 16u) | u32(in.sky6.w);
    return Pixel(light, select(0u, label, is_inside(in.uv)), depth_seen(in));
}
