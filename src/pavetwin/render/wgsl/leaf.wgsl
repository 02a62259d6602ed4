// The leaf atlas, whose alpha cuts leaf cards out: the same in the image, in shadows and in labels.

@group(1) @binding(0) var leaf_atlas: texture_2d<f32>;    // factors of colour, alpha
@group(1) @binding(1) var leaf_sampler: sampler;

fn leaf_at(uv: vec2f) -> vec4f {
    return textureSample(leaf_atlas, leaf_sampler, uv);
}

fn is_gap(leaf: vec4f) -> bool {
    return leaf.a < LEAF_CUT;
}
