// Shadows of wires and twigs: strips of level ground, multiplied with it. In each pixel the share of the sun's disc that
// a round segment hides is computed, so that they are as soft as the sun makes them at any size of a pixel.

struct Seen {
    @builtin(position) clip: vec4f,
    @location(0) aside: f32,                        // from the plane of the segment and the sun's rays [m]
    @location(1) away: f32,                         // along the sun's ray to the segment [m]
    @location(2) shadow: vec3f,                     // where it is in the shadow map
    @location(3) @interpolate(flat) radius: f32,    // of the segment [m]
    @location(4) @interpolate(flat) half: f32,      // half of a pixel there, across the sun's rays [m]
    @location(5) @interpolate(flat) sky: vec3f,     // what level ground has of it
    @location(6) @interpolate(flat) sun: vec3f,
}

// Rows carry the segment's ends, relative to the camera, its radius and the height of the ground.
@vertex fn vertex(at: Instance, @builtin(vertex_index) k: u32) -> Seen {
    let a = at.row0.xyz;
    let b = at.row1.xyz;
    let ground = at.row1.w;
    lamp = lamp_of_frame();
    let to_sun = lamp.to_sun.xyz;
    let far_a = (a.z - ground) / to_sun.z;
    let far_b = (b.z - ground) / to_sun.z;
    let from_a = a - to_sun * far_a;
    let from_b = b - to_sun * far_b;
    let flat = from_b.xy - from_a.xy;
    let along = flat * inverseSqrt(max(dot(flat, flat), 1e-12));
    let left = vec3f(-along.y, along.x, 0.0);
    let n = normalize(cross(b - a, to_sun));
    let lean = dot(left, n);
    let pixel = pixel_at(from_a);
    let wide = at.row0.w + max(far_a, far_b) * SUN_TAN + pixel;
    let second = (k & 1u) == 1u;
    let side = select(-1.0, 1.0, k >= 2u && k <= 4u);
    var out: Seen;
    // A little above the ground, against z-fighting.
    let on_ground = select(from_a, from_b, second) + left * (side * wide / max(abs(lean), 0.05));
    let relative = on_ground + vec3f(0.0, 0.0, 0.015);
    out.clip = project(relative, vec3f(0.0));
    out.aside = dot(on_ground - a, n);
    out.away = select(far_a, far_b, second);
    out.radius = at.row0.w;
    out.half = 0.5 * pixel * abs(lean);
    let up = vec3f(0.0, 0.0, 1.0);
    out.sky = sky_irradiance(up);
    out.sun = lamp.sun.rgb * to_sun.z;
    out.shadow = in_shadow_map(relative, up);
    return out;
}

// Share of a disc of radius 1 on one side of a straight line at x.
fn disc_share(x: f32) -> f32 {
    let at = clamp(x, -1.0, 1.0);
    return 0.5 + (at * sqrt(1.0 - at * at) + asin(at)) / PI;
}

@fragment fn fragment(in: Seen) -> @location(0) vec4f {
    let sun_radius = in.away * SUN_TAN;
    let spread = sqrt(sun_radius * sun_radius + in.half * in.half + 1e-8);
    let hidden = disc_share((in.aside + in.radius) / spread) - disc_share((in.aside - in.radius) / spread);
    let sun = in.sun * sun_tap(in.shadow);
    return vec4f((sun * (1.0 - hidden) + in.sky) / (sun + in.sky), 1.0);
}
