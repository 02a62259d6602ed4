// What stands on the ground: lit by sun and sky, reflecting its surroundings.

struct Solid {
    relative: vec3f,
    normal: vec3f,
    colour: vec3f,
    roughness: f32,
    metal: f32,
    glow: vec3f,
}

// Both faces use the normals as they are: leaves are single-layered.
fn solid_radiance(solid: Solid, jitter: f32) -> vec3f {
    lamp = lamp_of_frame();
    return solid_lit(solid, solid_ambient(solid), sun_on(solid.relative, solid.normal, jitter));
}

// What it sends out without sun and reflections: the light of the sky that it scatters, and its own.
fn solid_ambient(solid: Solid) -> vec3f {
    return solid.colour * (1.0 - solid.metal) / PI * sky_irradiance(solid.normal) + solid.glow;
}

// With the share of the sun that reaches it.
fn solid_lit(solid: Solid, ambient: vec3f, lit: f32) -> vec3f {
    let v = normalize(-solid.relative);
    let n = solid.normal;
    let nv = max(dot(n, v), 0.02);
    let sun = lamp.sun.rgb * (lit * max(dot(n, lamp.to_sun.xyz), 0.0));
    var radiance = ambient + solid.colour * (1.0 - solid.metal) / PI * sun;
    let f0 = mix(vec3f(0.04), solid.colour, solid.metal);
    radiance += mirrored(nv, solid.roughness, f0) * surroundings(reflect(-v, n), solid.roughness);
    radiance += glint(n, v, solid.roughness, f0) * lamp.sun.rgb * lit;
    return through_air(radiance, solid.relative);
}
