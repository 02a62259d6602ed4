// Contact shadows: the sky that objects hide from the ground, around and below a car. Drawn over the ground and
// multiplied with it.

// Share of the sky's light that still reaches the middle of the ground below a car.
const BOUNCED = 0.05;

// Texels of the shadow map larger than this are visible as such [m].
const COARSE_M = 0.025;

struct Seen {
    @builtin(position) clip: vec4f,
    @location(0) relative: vec3f,
    @location(1) local: vec2f,                        // metres from the middle of the footprint, along its axes
    @location(2) @interpolate(flat) half: vec2f,      // of the footprint [m]
    @location(3) @interpolate(flat) body: vec4f,      // height of its top, of its underside, 1 for a crown, margin [m]
    @location(4) shadow: vec3f,                       // where it is in the shadow map
    @location(5) @interpolate(flat) east: vec3f,      // what a step between looks is there, 0 for a single look
    @location(6) @interpolate(flat) north: vec3f,
    @location(7) @interpolate(flat) sky: vec3f,       // what level ground has of it
    @location(8) @interpolate(flat) sun: vec3f,
}

// Tints carry, in the model's own units: middle and half size of the footprint; top, underside, 1 for a crown, margin.
@vertex fn vertex(at: Instance, @builtin(vertex_index) k: u32) -> Seen {
    let stretch = vec3f(
        length(vec3f(at.row0.x, at.row1.x, at.row2.x)),
        length(vec3f(at.row0.y, at.row1.y, at.row2.y)),
        at.row2.z,
    );
    let corner = vec2f(select(-1.0, 1.0, (k & 1u) == 1u), select(-1.0, 1.0, k >= 2u && k <= 4u));
    let reach = at.tint1.zw + at.tint2.w / stretch.xy;
    let on_ground = vec3f(at.tint1.xy + corner * reach, 0.0);
    var out: Seen;
    // A little above the ground, against z-fighting.
    out.relative = place(at, on_ground) + vec3f(0.0, 0.0, 0.015);
    out.clip = project(out.relative, vec3f(0.0));
    out.local = corner * reach * stretch.xy;
    out.half = at.tint1.zw * stretch.xy;
    out.body = vec4f(at.tint2.xy * stretch.z, at.tint2.zw);
    lamp = lamp_of_frame();
    let up = vec3f(0.0, 0.0, 1.0);
    out.sky = sky_irradiance(up);
    out.sun = lamp.sun.rgb * lamp.to_sun.z;
    out.shadow = in_shadow_map(out.relative, up);
    // Samples one texel apart where texels are coarse: right beside a car the shadow is so dark that its edge would
    // show.
    let step = select(0.0, 1.4 * lamp.sun.w, lamp.sun.w > COARSE_M);
    out.east = frame.to_shadow[0].xyz * step;
    out.north = frame.to_shadow[1].xyz * step;
    return out;
}

// Share of the sky that level ground sees at `away` m from an upright wall of `height` m.
fn beside_wall(away: f32, height: f32, wide: f32) -> f32 {
    let hidden = 0.5 * (1.0 - away / sqrt(away * away + height * height));
    return 1.0 - hidden * (2.0 / PI) * atan(wide / max(away, 0.01));
}

// The share below and beside a disc of radius r at height h, d m off its axis.
fn below_disc(d: f32, r: f32, h: f32) -> f32 {
    let sum = h * h + d * d + r * r;
    return 1.0 - 0.5 * (1.0 - (h * h + d * d - r * r) / sqrt(max(sum * sum - 4.0 * r * r * d * d, 1e-6)));
}

@fragment fn fragment(in: Seen) -> @location(0) vec4f {
    let apart = abs(in.local) - in.half;
    let away = length(max(apart, vec2f(0.0)));
    let inside = max(-max(apart.x, apart.y), 0.0);
    let outside_open = beside_wall(away, in.body.x, max(in.half.x, in.half.y));
    // Between wheels a gap lets light in; feet and posts have no space below.
    let gap = in.body.y;
    let under_open = select(0.5, 0.5 * (1.0 - inside / sqrt(inside * inside + gap * gap + 1e-6)), gap > 0.0);
    // The lit street around a car reflects some light below it.
    let under_light = max(under_open, BOUNCED);
    var open = select(mix(outside_open, 1.0, smoothstep(0.3, 1.0, away / in.body.w)), under_light, inside > 0.0);
    // Crowns let half of the light through.
    let crown = below_disc(length(in.local), max(in.half.x, in.half.y), 0.5 * (in.body.x + in.body.y));
    let fade = 1.0 - smoothstep(0.5, 1.0, away / in.body.w);
    open = select(open, 1.0 - 0.5 * fade * (1.0 - crown), in.body.z > 0.5);
    let looks = select(1, 4, any(in.east != vec3f(0.0)));
    var lit = 0.0;
    for (var k = 0; k < looks; k++) {
        let aside = vec2f(f32(k & 1), f32(k >> 1)) - 0.5;
        lit += sun_tap(in.shadow + in.east * aside.x + in.north * aside.y) / f32(looks);
    }
    let sun = in.sun * lit;
    return vec4f((sun + in.sky * open) / (sun + in.sky), 1.0);
}
