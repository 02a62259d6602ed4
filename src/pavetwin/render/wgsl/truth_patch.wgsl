// The pavement around a defect: its label is where its mask is, unfiltered.

override amodal: bool = false;

@group(1) @binding(0) var mask: texture_2d<f32>;

@vertex fn vertex(at: Instance, @location(10) position: vec3f, @location(12) uv: vec2f) -> Seen {
    return seen_at(at, position, uv);
}

@fragment fn fragment(in: Seen) -> Truth {
    let size = vec2f(textureDimensions(mask));
    let texel = clamp(vec2i(floor(in.uv * size)), vec2i(0), vec2i(size) - 1);
    let inside = textureLoad(mask, texel, 0).r > 0.5;
    if (amodal && !inside) { discard; }
    return Truth(select(0u, in.label, inside), in.depth);
}
