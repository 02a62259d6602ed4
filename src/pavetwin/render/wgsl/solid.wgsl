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
    let v = normalize(-solid.relative);
    let n = solid.normal;
    let lit = sun_on(solid.relative, n, jitter);
    let nv = max(dot(n, v), 0.02);
    let sun = lamp.sun.rgb * (lit * max(dot(n, lamp.to_sun.xyz), 0.0));
    var radiance = solid.colour * (1.0 - solid.metal) / PI * (sun + sky_irradiance(n)) + solid.glow;
    let f0 = mix(vec3f(0.04), solid.colour, solid.metal);
    radiance += mirrored(nv, solid.roughness, f0) * surroundings(reflect(-v, n), solid.roughness);
    radiance += glint(n, v, solid.roughness, f0) * lamp.sun.rgb * lit;
    return through_air(radiance, solid.relative);
}
