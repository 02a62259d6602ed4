// Shared by all passes: frame uniforms, instances, vertex transforms. Positions are relative to the camera, so that
// 32-bit numbers stay exact far from the world's origin.

struct FrameInfo {
    to_clip: mat4x4f,         // from positions relative to the camera
    to_shadow: mat4x4f,       // from positions relative to the camera to the shadow map: u, v, depth
    to_sun: vec4f,            // xyz unit, w: spread of the sun's half shadow [texels a metre between caster and ground]
    sun: vec4f,               // rgb [klx], w: texel of the shadow map [m]
    // irradiance [klx] by the normal x, y, z: for r, g, b each (1, y, z, x), (xy, yz, 3z² − 1, xz); rgb of x² − y²
    sky: array<vec4f, 7>,
    camera: vec4f,            // world position, w: metres a pixel at 1 m along the axis
    axis: vec4f,              // the camera's axis in the world, w: 1/e distance of haze [m]
    drift: vec4f,             // clip-space change for each second the camera moves on, w of it too
    // x: seconds from the first row's exposure to the last's; y: 1 when drawing into an atlas; zw: where the camera's
    // axis goes through the image, in clip space (0, 0 unless it is a crop)
    shutter: vec4f,
}

struct Instance {
    @location(0) row0: vec4f,
    @location(1) row1: vec4f,
    @location(2) row2: vec4f,
    @location(3) tint1: vec4f,
    @location(4) tint2: vec4f,
    @location(5) tint3: vec4f,
    @location(6) tint4: vec4f,
    @location(7) label: u32,
    @location(8) velocity: vec3f,   // [m/s]
    @location(9) shift: vec4f,      // clip-space scale and offset into an atlas
}

@group(0) @binding(0) var<uniform> frame: FrameInfo;

fn place(at: Instance, position: vec3f) -> vec3f {
    let p = vec4f(position, 1.0);
    return vec3f(dot(at.row0, p), dot(at.row1, p), dot(at.row2, p));
}

// The transform may scale unevenly: normals go by its cofactors.
fn turn(at: Instance, normal: vec3f) -> vec3f {
    let r = at.row0.xyz; let s = at.row1.xyz; let t = at.row2.xyz;
    return vec3f(dot(cross(s, t), normal), dot(cross(t, r), normal), dot(cross(r, s), normal));
}

// Clip position of a point under a rolling shutter, each row at its own time. No early return for a global shutter:
// lavapipe (Mesa 22.3) recompiles vertex shaders that branch on a uniform for every frame, and never frees the code.
fn project(relative: vec3f, velocity: vec3f) -> vec4f {
    let still = frame.to_clip * vec4f(relative, 1.0);
    let drift = frame.drift + frame.to_clip * vec4f(velocity, 0.0);
    var at = still;
    for (var round = 0; round < 3; round++) {
        let row = clamp(-at.y / max(at.w, 0.05), -1.5, 1.5) * 0.5;   // −½ upper edge … ½ lower edge
        at = still + drift * (row * frame.shutter.x);
    }
    return at;
}

// Distance of a point along the camera's axis [m].
fn depth_of(relative: vec3f) -> f32 {
    return dot(relative, frame.axis.xyz);
}

// Side of a pixel where a point is [m].
fn pixel_at(relative: vec3f) -> f32 {
    return depth_of(relative) * frame.camera.w;
}

fn unpack_normal(packed: vec4u) -> vec3f {
    return (vec3f(packed.xyz) - 128.0) / 127.0;
}
