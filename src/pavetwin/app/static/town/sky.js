// Sun, sky and surroundings, by the light that the manifest or the page gives.
import { BackSide, Color, DirectionalLight, LightProbe, Mesh, ShaderMaterial, SphereGeometry, Vector3, Vector4 }
  from "../vendor.js";

const WHITE = 2.2; // What a white, level surface reflects, before tones are mapped.
const STOPS = 7;
const SHADOW_PX = 2048;
const SUN_M = 700; // From the middle of the shadows; what casts them is no higher.

export class Sky {
  constructor(scene, materials) {
    this.materials = materials;
    this.sun = new DirectionalLight();
    this.sun.castShadow = true;
    this.sun.shadow.mapSize.set(SHADOW_PX, SHADOW_PX);
    this.sun.shadow.camera.near = 1;
    this.sun.shadow.camera.far = 2 * SUN_M;
    this.reach = 0;
    this.probe = new LightProbe();
    this.stops = Array.from({ length: STOPS }, () => new Vector4());
    this.toSun = new Vector3(0, 1, 0);
    this.glow = new Color();
    this.dome = new Mesh(new SphereGeometry(1, 32, 24), new ShaderMaterial({
      side: BackSide, depthWrite: false,
      uniforms: { stops: { value: this.stops }, toSun: { value: this.toSun }, glow: { value: this.glow } },
      vertexShader: `varying vec3 vWay;
        void main() {
          vWay = position;
          gl_Position = (projectionMatrix * vec4(mat3(viewMatrix) * position, 1.0)).xyww; // behind all else
        }`,
      fragmentShader: `uniform vec4 stops[${STOPS}];
        uniform vec3 toSun, glow;
        varying vec3 vWay;
        void main() {
          vec3 way = normalize(vWay);
          float up = degrees(asin(clamp(way.y, 0.0, 1.0)));
          vec3 colour = stops[0].yzw;
          for (int i = 1; i < ${STOPS}; i++)
            colour = mix(colour, stops[i].yzw, smoothstep(stops[i - 1].x, stops[i].x, up));
          float near = max(dot(way, toSun), 0.0);
          colour += glow * (0.02 * pow(near, 24.0) + 0.25 * pow(near, 900.0)) + 2.0 * glow * step(0.99996, near);
          gl_FragColor = vec4(colour, 1.0);
          #include <tonemapping_fragment>
          #include <colorspace_fragment>
        }`,
    }));
    this.dome.frustumCulled = false;
    this.dome.renderOrder = 1; // drawn last of what is opaque: only where nothing else is
    this.dome.matrixAutoUpdate = false;
    scene.add(this.dome, this.probe, this.sun, this.sun.target);
  }

  set(light) {
    const scale = WHITE * Math.PI / light.ground_klux;
    this.toSun.fromArray(light.to_sun);
    this.sun.position.copy(this.sun.target.position).addScaledVector(this.toSun, SUN_M);
    const [red, green, blue] = light.sun_klux;
    const most = Math.max(red, green, blue, 1e-6);
    this.sun.color.setRGB(red / most, green / most, blue / most);
    this.sun.intensity = most * scale;
    this.glow.setRGB(red, green, blue).multiplyScalar(scale);
    light.irradiance.forEach((row, index) => this.probe.sh.coefficients[index].fromArray(row).multiplyScalar(scale));
    light.sky.forEach(([up, r, g, b], index) => this.stops[index].set(up, r * scale, g * scale, b * scale));
    const { y, z, w } = this.stops[1];
    this.materials.haze.hazeColour.value.setRGB(y, z, w);
    this.materials.haze.hazePerM.value = 1 / light.haze_m;
  }

  // Centre the shadows on a place, `reach` metres to each side; true where they must be drawn again.
  shade(middle, reach) {
    const { camera } = this.sun.shadow, target = this.sun.target.position;
    const isNear = Math.hypot(middle.x - target.x, middle.z - target.z) < 0.3 * this.reach;
    if (isNear && reach < 1.4 * this.reach && reach > this.reach / 1.4) return false;
    this.reach = reach;
    target.set(middle.x, 0, middle.z);
    this.sun.position.copy(target).addScaledVector(this.toSun, SUN_M);
    Object.assign(camera, { left: -reach, right: reach, top: reach, bottom: -reach });
    camera.updateProjectionMatrix();
    this.sun.shadow.normalBias = 3 * reach / SHADOW_PX;
    this.sun.target.updateMatrixWorld();
    return true;
  }

  dispose() {
    this.sun.shadow.dispose();
    this.dome.geometry.dispose();
    this.dome.material.dispose();
  }
}
