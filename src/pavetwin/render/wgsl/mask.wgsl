// The mask of a defect in its patch, unfiltered.

fn is_inside(uv: vec2f) -> bool {
    let size = vec2f(textureDimensions(mask));
    let texel = clamp(vec2i(floor(uv * size)), vec2i(0), vec2i(size) - 1);
    return textureLoad(mask, texel, 0).r > 0.5;
}
