// The sky behind everything, for views that see it.

struct Seen {
    @builtin(position) clip: vec4f,
    @location(0) ray: vec3f,
}

@vertex fn vertex(@builtin(vertex_index) k: u32) -> Seen {
    let corner = vec2f(f32(k & 1u) * 4.0 - 1.0, f32(k >> 1u) * 4.0 - 1.0);
    var out: Seen;
    out.clip = vec4f(corner, 0.0, 1.0);
    // Rows of the projection hold the camera's axes times the focal length, and of a crop some of its forward axis: the
    // ray is their sum.
    let m = transpose(frame.to_clip);
    let centre = frame.shutter.zw;
    let x = m[0].xyz - centre.x * frame.axis.xyz; let y = m[1].xyz - centre.y * frame.axis.xyz;
    let beside = corner - centre;
    out.ray = frame.axis.xyz + x * (beside.x / dot(x, x)) + y * (beside.y / dot(y, y));
    return out;
}

@fragment fn fragment(in: Seen) -> @location(0) vec4f {
    lamp = lamp_of_frame();
    let ray = normalize(in.ray);
    // Not so near to the horizon that the map mixes in what lies below it.
    let sky = surroundings(vec3f(ray.xy, max(ray.z, 0.025)), 0.0);
    // Below the horizon: ground that is not drawn, beyond the world or too far.
    let distance = frame.camera.z / max(-ray.z, 1e-4);
    let up = vec3f(0.0, 0.0, 1.0);
    let mirror = mirrored(max(-ray.z, 0.02), 0.9, vec3f(0.04)) * surroundings(reflect(ray, up), 0.9);
    let lawn = BEYOND / PI * (lamp.sun.rgb * max(lamp.to_sun.z, 0.0) + sky_irradiance(up)) + mirror;
    let ground = mix(sky, lawn, through(distance));
    return vec4f(select(sky, ground, ray.z < 0.0), 1.0);
}
