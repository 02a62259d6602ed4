// Sun, sky and shadows, [kcd/m²].

const PI = 3.14159265;

// For images that look down from nearby, known before they are drawn: no haze, no grazing reflections. The CPU
// executes both sides of an `if`, but only one of this.
override looks_down: bool = false;

@group(0) @binding(1) var shadow_map: texture_depth_2d;
@group(0) @binding(2) var shadow_compare: sampler_comparison;
@group(0) @binding(3) var sky_map: texture_2d<f32>;     // rows from the zenith to the horizon and on to the nadir
@group(0) @binding(4) var smooth_sampler: sampler;
@group(0) @binding(5) var sky_sampler: sampler;     // wraps around the horizon
@group(0) @binding(6) var nearest_sampler: sampler;

// The image, and its ground truth at pixel centres of the same triangles.
struct Pixel {
    @location(0) light: vec4f,
    @location(1) label: u32,
    @location(2) depth: f32,     // along the camera's axis [m]
}

// Inputs of lighting from the frame. lavapipe (Mesa 22.3) reloads a uniform for every pixel: large meshes pass them on
// from their vertices.
struct Lamp {
    to_sun: vec4f,
    sun: vec4f,
    sky: array<vec4f, 7>,
}

var<private> lamp: Lamp;

fn lamp_of_frame() -> Lamp {
    return Lamp(frame.to_sun, frame.sun, frame.sky);
}

fn sky_irradiance(n: vec3f) -> vec3f {
    let first = vec4f(1.0, n.y, n.z, n.x);
    let second = vec4f(n.x * n.y, n.y * n.z, 3.0 * n.z * n.z - 1.0, n.x * n.z);
    var e = lamp.sky[6].rgb * (n.x * n.x - n.y * n.y);
    e.r += dot(lamp.sky[0], first) + dot(lamp.sky[1], second);
    e.g += dot(lamp.sky[2], first) + dot(lamp.sky[3], second);
    e.b += dot(lamp.sky[4], first) + dot(lamp.sky[5], second);
    return max(e, vec3f(0.0));
}

// A mip level, moved towards the nearest: two are mixed only near the middle between them, as lavapipe samples a single
// one in half the time.
fn mostly_one(level: f32) -> f32 {
    let whole = floor(level);
    return whole + clamp((level - whole - 0.5) * LEVEL_SLOPE + 0.5, 0.0, 1.0);
}

// Where a horizontal direction lies around the horizon, 0 … 1 from west over south; an odd polynomial for the arctangent
// of 0 … 1, to 0.04°, takes a third of the time of atan2.
fn azimuth(d: vec2f) -> f32 {
    let a = abs(d);
    let t = min(a.x, a.y) / max(max(a.x, a.y), 1e-9);
    let first = t * (0.99535 + t * t * (-0.28868 + t * t * 0.07934));
    let quarter = select(first, PI / 2.0 - first, a.y > a.x);
    let half = select(quarter, PI - quarter, d.x < 0.0);
    return select(half, -half, d.y < 0.0) / (2.0 * PI) + 0.5;
}

// Angle to the zenith of a direction by its height, 0 … 1 (Abramowitz and Stegun, formula 4.4.45: to 0.004°).
fn polar(z: f32) -> f32 {
    let x = min(abs(z), 1.0);
    let up = sqrt(1.0 - x) * (1.5707288 + x * (-0.2121144 + x * (0.0742610 - x * 0.0187293)));
    return select(up, PI - up, z < 0.0) / PI;
}

// The sky in a direction, or the lit ground below the horizon; blurred by the roughness of the reflecting surface.
fn surroundings(direction: vec3f, roughness: f32) -> vec3f {
    let at = vec2f(azimuth(direction.xy), polar(direction.z));
    return textureSampleLevel(sky_map, sky_sampler, at, mostly_one(roughness * 5.0)).rgb;
}

// Position of a shadow lookup, a little in front of the surface, against self-shadowing.
fn in_shadow_map(relative: vec3f, normal: vec3f) -> vec3f {
    let slope = max(dot(normal, frame.to_sun.xyz), 0.0);
    let lifted = relative + normal * (frame.sun.w * (1.0 + 1.5 * (1.0 - slope)));
    return (frame.to_shadow * vec4f(lifted, 1.0)).xyz;
}

// Share of the sun that reaches a point, from a single filtered sample: for terms too faint to show a shadow edge.
fn sun_tap(at: vec3f) -> f32 {
    let inside = all(at.xy > vec2f(0.002)) && all(at.xy < vec2f(0.998));
    return select(1.0, textureSampleCompareLevel(shadow_map, shadow_compare, at.xy, at.z), inside);
}

// The same with soft edges: the penumbra widens with the distance of the caster (Fernando 2005,
// Percentage-Closer Soft Shadows), `jitter` turns the samples from pixel to pixel, 0 … 1. `pixel`: its side there [m].
// `lean`: by how much the surface itself changes depth over the map, 0 for what casts no shadow: what lies in one plane
// with a point does not hide the sun from it.
fn sunlight(at: vec3f, normal: vec3f, pixel: f32, jitter: f32, lean: vec2f) -> f32 {
    if (dot(normal, lamp.to_sun.xyz) <= 0.0) { return 0.0; }
    if (any(at.xy < vec2f(0.002)) || any(at.xy > vec2f(0.998))) { return 1.0; }
    let texel = 1.0 / f32(textureDimensions(shadow_map).x);
    // Points of Vogel's disc, the first in its centre, so that thin casters are not missed there.
    var way = circle(jitter);
    var nearer = 0.0;
    var blockers = 0.0;
    for (var k = 0; k < 5; k++) {
        let tap = way * (6.0 * sqrt(f32(k) / 5.0) * texel);
        let depth = textureSampleLevel(shadow_map, nearest_sampler, at.xy + tap, 0);
        let own = at.z + dot(lean, tap);
        if (depth < own) { nearer += own - depth; blockers += 1.0; }
        way = goldenly(way);
    }
    // In the open the loop does not run: the CPU skips loops, but executes both sides of an `if`.
    let taps = select(0, 6, blockers > 0.0);
    // Where a texel covers many pixels a smaller radius would show jagged edges, a larger one self-shadowing.
    let least = clamp(0.3 * lamp.sun.w / pixel, 0.6, 1.4);
    let radius = clamp(nearer / max(blockers, 1.0) * lamp.to_sun.w, least, 12.0) * texel;
    var dark = 0.0;
    for (var k = 0; k < taps; k++) {
        let tap = way * (sqrt((f32(k) + 0.5) / 6.0) * radius);
        dark += 1.0 - textureSampleCompareLevel(shadow_map, shadow_compare, at.xy + tap, at.z);
        way = goldenly(way);
    }
    return 1.0 - dark / 6.0;
}

// The same with the frame's inputs.
fn sun_on(relative: vec3f, normal: vec3f, jitter: f32) -> f32 {
    return sunlight(in_shadow_map(relative, normal), normal, pixel_at(relative), jitter, lean_of(normal));
}

// By how much a surface with that normal changes depth over the shadow map; faces along the sun's rays less than they do.
fn lean_of(normal: vec3f) -> vec2f {
    let turned = frame.to_shadow * vec4f(normal, 0.0);
    let along = vec3f(frame.to_shadow[0].z, frame.to_shadow[1].z, frame.to_shadow[2].z);
    let across = vec3f(frame.to_shadow[0].x, frame.to_shadow[1].x, frame.to_shadow[2].x);
    let deep = dot(along, along);
    return turned.xy * (deep / (dot(across, across) * max(-turned.z, 0.2 * sqrt(deep))));
}

// A direction rotated by the golden angle.
fn goldenly(way: vec2f) -> vec2f {
    return vec2f(-0.737369 * way.x - 0.675490 * way.y, 0.675490 * way.x - 0.737369 * way.y);
}

// A direction after that many turns, on a circle made of parabolas: up to 6 % too far, and cheaper than sines.
fn circle(turns: f32) -> vec2f {
    let ahead = 1.0 - 2.0 * fract(vec2f(turns + 0.25, turns));
    return 4.0 * ahead * (1.0 - abs(ahead));
}

// Interleaved gradient noise (Jimenez 2014) as turns.
fn pixel_jitter(pixel: vec2f) -> f32 {
    return fract(52.9829189 * fract(dot(pixel, vec2f(0.06711056, 0.00583715))));
}

// Specular reflection of the sun: GGX with Smith's visibility in Hammon's approximation, as a share of its illuminance.
fn glint(n: vec3f, v: vec3f, roughness: f32, f0: vec3f) -> vec3f {
    let l = lamp.to_sun.xyz;
    let h = normalize(l + v + 1e-5 * n);
    let nl = max(dot(n, l), 0.0);
    let nv = max(dot(n, v), 0.05);
    let nh = max(dot(n, h), 0.0);
    let a = max(roughness * roughness, 0.003);
    let d = nh * nh * (a * a - 1.0) + 1.0;
    let spread = a * a / (PI * d * d);
    let visible = 0.5 / mix(2.0 * nl * nv, nl + nv, a);
    let away = clamp(1.0 - dot(v, h), 0.0, 1.0);
    let fresnel = f0 + (1.0 - f0) * (away * away * (away * away) * away);
    return fresnel * (spread * visible * nl);
}

// Specular reflectance of the surroundings (Karis 2014, Physically Based Shading on Mobile).
fn mirrored(nv: f32, roughness: f32, f0: vec3f) -> vec3f {
    let r = roughness * vec4f(-1.0, -0.0275, -0.572, 0.022) + vec4f(1.0, 0.0425, 1.04, -0.04);
    let a = min(r.x * r.x, exp2(-9.28 * nv)) * r.x + r.y;
    let ab = vec2f(-1.04, 1.04) * a + r.zw;
    return max(f0 * ab.x + ab.y, vec3f(0.0));
}

// Transmittance of the air over a distance; short distances count as clear.
fn through(distance: f32) -> f32 {
    return exp(min(CLEAR_SHARE - distance / frame.axis.w, 0.0));
}

// Haze between the camera and a point; limited to the range of half floats.
fn through_air(radiance: vec3f, relative: vec3f) -> vec3f {
    var seen = radiance;
    if (!looks_down) {
        let air = textureSampleLevel(sky_map, sky_sampler, vec2f(azimuth(relative.xy), 0.49), 2.0).rgb;
        seen = mix(air, radiance, through(length(relative)));
    }
    return clamp(seen, vec3f(0.0), vec3f(60000.0));
}
