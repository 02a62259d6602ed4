// The ground's appearance: the formula of scene/ground/materials/compose.py, step by step. Its constants come from there
// (`GROUND`).

@group(1) @binding(0) var detail_colour: texture_2d_array<f32>;   // roots of reflectance, hold of paint
@group(1) @binding(1) var detail_relief: texture_2d_array<f32>;   // normal x, y, height, roughness
@group(1) @binding(2) var repeat_sampler: sampler;
@group(2) @binding(0) var weathering_map: texture_2d<f32>;        // tone, stain, dust, polish
@group(2) @binding(1) var drawn_map: texture_2d<f32>;             // to paint, which, its wear, to bitumen

struct Surface {
    albedo: vec3f,
    slope: vec2f,        // of the normal before normalising
    roughness: f32,
}

// The pavement, and what lies on it.
struct Ground {
    bare: Surface,
    paint: vec3f,        // its reflectance, with dirt
    painted: f32,        // share where there is no sealant
    sealed: f32,
    overgrown: bool,     // the paint is a plant
}

struct Detail {
    colour: vec4f,
    relief: vec4f,
}

// What the ground and the patches of defects pass from their vertices to their pixels.
struct Seen {
    @builtin(position) clip: vec4f,
    @location(0) relative: vec3f,
    // Of ground its normal; of a patch the defect's x axis, and the upper half of its label. w: tone of its finish.
    @location(1) axis: vec4f,
    @location(2) uv: vec2f,
    @location(3) local: vec2f,
    @location(4) world: vec4f,      // east, north, up, and the side of a pixel there [m]
    @location(5) shadow: vec3f,     // where it is in the shadow map
    @location(6) @interpolate(flat) kind: vec4f,        // and half its grain, the size of its detail [m], its red and blue
    @location(7) @interpolate(flat) to_sun: vec4f,      // the lamp
    @location(8) @interpolate(flat) sun: vec4f,
    @location(9) @interpolate(flat) sky0: vec4f,
    @location(10) @interpolate(flat) sky1: vec4f,
    @location(11) @interpolate(flat) sky2: vec4f,
    @location(12) @interpolate(flat) sky3: vec4f,
    @location(13) @interpolate(flat) sky4: vec4f,
    @location(14) @interpolate(flat) sky5: vec4f,
    @location(15) @interpolate(flat) sky6: vec4f,       // w: the lower half of a patch's label
}

fn seen_at(at: Instance, position: vec3f, normal: vec3f, axis: vec3f, uv: vec2f, kind: u32, finish: vec4u) -> Seen {
    let relative = place(at, position);
    return Seen(
        project(relative, vec3f(0.0)), relative, vec4f(axis, f32(finish.w) / 128.0), uv, position.xy,
        vec4f(relative + frame.camera.xyz, pixel_at(relative)), in_shadow_map(relative, normal),
        vec4f(f32(kind) + f32(finish.z) / 256.0, detail_size(kind), vec2f(finish.xy) / 128.0), frame.to_sun, frame.sun, frame.sky[0], frame.sky[1], frame.sky[2],
        frame.sky[3], frame.sky[4], frame.sky[5], vec4f(frame.sky[6].xyz, f32(at.label & 0xffffu)),
    );
}

// Distance along the camera's axis [m].
fn depth_seen(in: Seen) -> f32 {
    return in.world.w / frame.camera.w;
}

fn lamp_of(in: Seen) -> Lamp {
    return Lamp(in.to_sun, in.sun, array<vec4f, 7>(in.sky0, in.sky1, in.sky2, in.sky3, in.sky4, in.sky5, in.sky6));
}

fn level_of(footprint: f32) -> f32 {
    return mostly_one(log2(max(footprint, 1.0)));
}

fn detail_at(kind: u32, uv: vec2f, footprint: f32) -> Detail {
    let layer = i32(kind);
    let lod = level_of(footprint * f32(textureDimensions(detail_colour).x));
    var found: Detail;
    found.colour = textureSampleLevel(detail_colour, repeat_sampler, uv, layer, lod);
    found.colour = vec4f(found.colour.rgb * found.colour.rgb, found.colour.a);
    found.relief = textureSampleLevel(detail_relief, repeat_sampler, uv, layer, lod);
    found.relief = vec4f((found.relief.xy * 255.0 - 128.0) / 127.0, found.relief.zw);
    return found;
}

fn second_share(p: vec2f) -> f32 {
    let turns = vec3f(
        0.068 * p.x + 0.049 * p.y,
        -0.094 * p.x + 0.123 * p.y + 0.207,
        0.180 * p.x - 0.059 * p.y + 0.653,
    );
    let ahead = 1.0 - 2.0 * fract(turns);
    return smoothstep(0.4, 0.6, 0.5 + 0.68 * dot(ahead, 1.0 - abs(ahead)));
}

fn grain_noise(local: vec2f) -> f32 {
    let cell = vec2u(vec2i(floor(local / GRAIN_M)));
    var mixed = (cell.x * 1597334677u) ^ (cell.y * 3812015801u);
    mixed = (mixed ^ (mixed >> 16u)) * 2246822519u;
    return f32(mixed >> 8u) / 16777216.0;
}

fn paint_of(coded: f32) -> vec3f {
    var paints = PAINTS;
    let at = coded * f32(LAST_PAINT);
    let below = min(u32(at), LAST_PAINT - 1u);
    return mix(paints[below], paints[below + 1u], at - f32(below));
}

fn metres(coded: f32) -> f32 {
    return (coded * 255.0 - 128.0) / 127.0 * SIGNED_DISTANCE_M;
}

fn edge_share(distance: f32, height: f32, edge: f32, footprint: f32) -> f32 {
    let e = max(edge, 0.5 * footprint);
    return smoothstep(-e, e, distance + RAGGED_M * (height - 0.5));
}

// `of_kind`, and `of_tone`, that of its finish: as `Seen` has them.
fn bare_ground(of_kind: vec4f, of_tone: f32, uv: vec2f, local: vec2f, world: vec2f, footprint: f32) -> Ground {
    let kind = u32(of_kind.x);
    // One sample or the other, never both: texture samples dominate the cost of the ground.
    let second = (LOOSE_KINDS >> kind & 1u) == 1u && second_share(world) > grain_noise(local);
    let turn = select(vec2f(1.0, 0.0), vec2f(SECOND_COS, SECOND_SIN), second);
    let scale = select(1.0, SECOND_SCALE, second) / of_kind.y;
    let turned = vec2f(turn.x * uv.x - turn.y * uv.y, turn.y * uv.x + turn.x * uv.y);
    var detail = detail_at(kind, turned * scale, footprint * scale);
    let n = detail.relief.xy;
    detail.relief = vec4f(turn.x * n.x + turn.y * n.y, -turn.y * n.x + turn.x * n.y, detail.relief.zw);
    let at = (local + MAP_MARGIN_M) / MAP_SIDE_M;
    let lod = level_of(footprint / MAP_SIDE_M * f32(textureDimensions(weathering_map).x));
    let weathering = textureSampleLevel(weathering_map, smooth_sampler, at, lod);
    let drawn = textureSampleLevel(drawn_map, smooth_sampler, at, lod);
    let tone = of_tone * weathering.x * (255.0 / 128.0);
    let stain = weathering.y;
    let dust = weathering.z;
    let polish = weathering.w;
    let height = detail.relief.z;

    var found: Ground;
    var out: Surface;
    let grain = 2.0 * fract(of_kind.x);
    let mean = mean_reflectance(kind);
    let shade = vec3f(of_kind.z, 1.0, of_kind.w) * (1.0 + WARMING * (tone - 1.0));
    out.albedo = max(mean + (detail.colour.rgb - mean) * grain, vec3f(0.0)) * shade * tone;
    out.albedo = mix(out.albedo, DUST, clamp(dust * (1.15 - 0.5 * height), 0.0, 1.0));
    out.albedo *= 1.0 - 0.8 * stain;
    out.slope = detail.relief.xy * (grain * (1.0 - 0.45 * polish) * (1.0 - 0.5 * dust));
    out.roughness = detail.relief.w - 0.15 * polish - 0.25 * stain;

    found.bare = out;
    found.sealed = edge_share(metres(drawn.w), height, BITUMEN_EDGE_M, footprint);

    let wear = drawn.z;
    let hold = detail.colour.a;
    let least = wear * (1.0 + 2.0 * KEPT_SOFT) - KEPT_SOFT;
    let near = smoothstep(least - KEPT_SOFT, least + KEPT_SOFT, hold);
    let far = clamp(1.0 - wear + 5.0 * wear * (1.0 - wear) * (hold - 0.5), 0.0, 1.0);
    let kept = mix(near, far, smoothstep(GRAINS_SEEN_M, GRAINS_MELTED_M, footprint));
    found.painted = edge_share(metres(drawn.x), height, PAINT_EDGE_M, footprint) * kept;
    let grime = (1.0 - 0.3 * polish) * (1.0 + 0.35 * (height - MEAN_HEIGHT));
    let dirt = (1.0 - 0.35 * wear) * mix(1.0, tone, 0.5) * (1.0 - 0.5 * stain) * grime;
    found.paint = paint_of(drawn.y) * dirt;
    found.overgrown = drawn.y > FIRST_PLANT;
    return found;
}

// The pavement with its sealant and paint, but for a share that was lost with its surface; plants grow in it.
fn covered(ground: Ground, lost: f32) -> Surface {
    var out = ground.bare;
    let sealed = ground.sealed * (1.0 - lost);
    out.albedo = mix(out.albedo, BITUMEN, 0.92 * sealed);
    out.slope *= 1.0 - 0.75 * sealed;
    out.roughness = mix(out.roughness, 0.55, sealed);
    let painted = ground.painted * (1.0 - 0.8 * sealed) * (1.0 - select(lost, 0.0, ground.overgrown));
    out.albedo = mix(out.albedo, ground.paint, painted);
    out.slope *= 1.0 - 0.4 * painted;
    out.roughness = clamp(mix(out.roughness, 0.6, painted), 0.05, 1.0);
    out.albedo = clamp(out.albedo, vec3f(0.0), vec3f(1.0));
    return out;
}

// Radiance of a rough, nearly level surface towards the camera. `lit`: share of the sun that reaches it.
fn ground_radiance(surface: Surface, n: vec3f, relative: vec3f, lit: f32, open: f32) -> vec3f {
    let v = normalize(-relative);
    let facing = max(dot(n, lamp.to_sun.xyz), 0.0);
    var radiance = surface.albedo / PI * (lamp.sun.rgb * (lit * facing) + sky_irradiance(n) * open);
    let f0 = vec3f(0.04);
    if (lit > 0.0) { radiance += glint(n, v, surface.roughness, f0) * lamp.sun.rgb * lit; }
    let nv = max(dot(n, v), 0.02);
    if (!looks_down && nv < 0.5) {
        radiance += mirrored(nv, surface.roughness, f0) * surroundings(reflect(-v, n), surface.roughness) * open;
    } else {
        radiance += mirrored(nv, surface.roughness, f0) * sky_irradiance(n) * (open / PI);
    }
    return through_air(radiance, relative);
}

// Side of a pixel's footprint on the ground [m]: between its short and its long side where the view is slanted.
fn footprint_of(relative: vec3f, n: vec3f, pixel: f32) -> f32 {
    let slant = max(abs(dot(relative, n)) / length(relative), 0.02);
    return pixel * inverseSqrt(slant);
}
