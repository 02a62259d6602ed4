// Foliage: lighting is computed per vertex of the cards, of which a crown has thousands; the leaf atlas adds detail.

// Transmittance of a leaf relative to its reflectance, and its colour relative to that: yellower (Jacquemoud and Baret
// 1990, PROSPECT: at 550 nm a thin leaf transmits about as much as it reflects, at 450 and 650 nm much less).
const THROUGH = vec3f(0.75, 0.85, 0.35);

// Offset of shadow lookups in front of a card [m], past the leaves of its own twig.
const CLEAR_OF_TWIG_M = 0.06;

// The leaves of a twig face all directions around the crown's normal: light at grazing angles reaches some.
const WRAP = 0.25;

struct Seen {
    @builtin(position) clip: vec4f,
    @location(0) radiance: vec3f,
    @location(1) uv: vec2f,
    @location(2) depth: f32,
    @location(3) @interpolate(flat) label: u32,
}

@vertex fn vertex(at: Instance, in: Vertex, @location(14) uv: vec2f) -> Seen {
    lamp = lamp_of_frame();
    let leaf = model_vertex(at, in);
    let l = lamp.to_sun.xyz;
    let lit = lamp.sun.rgb * sun_on(leaf.relative + CLEAR_OF_TWIG_M * l, l, 0.0);
    let slope = (dot(leaf.normal, l) + WRAP) / (1.0 + WRAP);
    let sun = lit * (max(slope, 0.0) + THROUGH * max(-slope, 0.0));
    let sky = sky_irradiance(leaf.normal) + THROUGH * sky_irradiance(-leaf.normal);
    let radiance = leaf.colour / PI * (sun + sky);
    return Seen(
        project(leaf.relative, at.velocity), through_air(radiance, leaf.relative), uv, depth_of(leaf.relative), at.label,
    );
}

@fragment fn fragment(in: Seen) -> Pixel {
    let leaf = leaf_at(in.uv);
    if (is_gap(leaf)) { discard; }
    return Pixel(vec4f(in.radiance * leaf.rgb, 1.0), in.label, in.depth);
}
