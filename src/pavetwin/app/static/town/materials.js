// Materials of a town: matt surfaces in the light of sun, sky and surroundings, and haze before them.
import { BufferAttribute, Color, DoubleSide, FrontSide, MeshLambertMaterial } from "../vendor.js";

const WHITE = [1, 1, 1];
const EVERY = 7; // Of the pixels of a layer, for its mean.

// The mean of each layer of a texture whose pixels are sRGB with four channels: linear.
function meansOf({ data, width, height, depth }) {
  const linear = Float64Array.from({ length: 256 }, (_, value) => {
    const share = value / 255;
    return share <= 0.04045 ? share / 12.92 : ((share + 0.055) / 1.055) ** 2.4;
  });
  return Array.from({ length: depth }, (_, layer) => {
    const sum = [0, 0, 0], first = layer * width * height;
    let count = 0;
    for (let pixel = 0; pixel < width * height; pixel += EVERY, count++)
      for (let channel = 0; channel < 3; channel++) sum[channel] += linear[data[4 * (first + pixel) + channel]];
    return sum.map((value) => value / count);
  });
}

export class Materials {
  constructor() {
    this.haze = { hazeColour: { value: new Color() }, hazePerM: { value: 0 } };
    this.facades = { value: null };
    this.facadeSteps = 512;
  }

  // Of a mesh with a picture.
  pictured(map) {
    return this.#matt({ map });
  }

  // Of empty land of one colour, linear, which has faded to a third at a distance.
  plain(colour, faded_m) {
    const material = this.#matt({ color: new Color(...colour) }, (shader) => {
      shader.fragmentShader = shader.fragmentShader.replace("exp(-hazePerM * length(vViewPosition))",
        `exp(-hazePerM * length(vViewPosition) - dot(vViewPosition, vViewPosition) / ${(faded_m * faded_m).toFixed(1)})`);
    });
    material.customProgramCacheKey = () => `plain ${faded_m}`;
    return material;
  }

  // Of houses: vertex colours times a layer of the façade textures.
  house() {
    const material = this.#matt({ vertexColors: true }, (shader) => {
      shader.uniforms.facades = this.facades;
      this.#facade(shader);
    });
    material.customProgramCacheKey = () => "house";
    return material;
  }

  // Of houses far away: their vertices have the mean colour of their façade, see `bakeFacades`.
  coloured() {
    return this.#matt({ vertexColors: true });
  }

  // Multiply the colours of vertices by the mean of their layer of the façade textures.
  bakeFacades(geometry) {
    const { color, layer } = geometry.attributes, means = (this.means ??= meansOf(this.facades.value.image));
    const baked = new Float32Array(3 * color.count);
    for (let vertex = 0; vertex < color.count; vertex++) {
      const of = Math.round(layer.getX(vertex)), mean = of > 0 ? means[of - 1] : WHITE;
      for (let channel = 0; channel < 3; channel++)
        baked[3 * vertex + channel] = color.getComponent(vertex, channel) * mean[channel];
    }
    geometry.setAttribute("color", new BufferAttribute(baked, 3));
    geometry.deleteAttribute("layer");
    geometry.deleteAttribute("facade");
  }

  #facade(shader) {
    shader.vertexShader = shader.vertexShader
      .replace("#include <common>", `#include <common>
        attribute vec2 facade;
        attribute float layer;
        varying vec3 vFacade;`)
      .replace("#include <begin_vertex>", `#include <begin_vertex>
        vFacade = vec3(facade / ${this.facadeSteps.toFixed(1)}, layer);`);
    shader.fragmentShader = shader.fragmentShader
      .replace("#include <common>", `#include <common>
        uniform sampler2DArray facades;
        varying vec3 vFacade;`)
      .replace("#include <color_fragment>", `#include <color_fragment>
        vec3 facade = texture(facades, vec3(vFacade.x, -vFacade.y, floor(vFacade.z + 0.5) - 1.0)).rgb;
        if (vFacade.z > 0.5) diffuseColor.rgb *= facade;`);
  }

  // Of instanced models: vertex colours, of which slots 1 to 4 are multiplied by an instance's own; leaves are cut out.
  model(leaves, cut) {
    const options = leaves ? { map: leaves, alphaTest: cut, side: DoubleSide } : { side: DoubleSide };
    const material = this.#matt({ vertexColors: true, ...options }, (shader) => {
      shader.vertexShader = shader.vertexShader
        .replace("#include <common>", `#include <common>
          attribute float layer;
          attribute vec4 tint1, tint2, tint3, tint4;
          varying float vGlow;`)
        .replace("#include <color_vertex>", `#include <color_vertex>
          vec4 tint = layer < 0.5 ? vec4(0.5, 0.5, 0.5, 0.0) : layer < 1.5 ? tint1 : layer < 2.5 ? tint2
            : layer < 3.5 ? tint3 : tint4;
          vColor.rgb *= 2.0 * tint.rgb;
          vGlow = tint.a;`);
      shader.fragmentShader = shader.fragmentShader
        .replace("#include <common>", "#include <common>\nvarying float vGlow;")
        // A crown is lit like a whole, mostly from above, not like single cards.
        .replace("#include <normal_fragment_maps>", leaves ? `#include <normal_fragment_maps>
          normal = normalize(0.4 * normal + (viewMatrix * vec4(0.0, 1.0, 0.0, 0.0)).xyz);` : "")
        .replace("#include <emissivemap_fragment>", "totalEmissiveRadiance += 2.0 * vGlow * diffuseColor.rgb;");
    });
    material.customProgramCacheKey = () => `model ${Boolean(leaves)}`;
    return material;
  }

  #matt(options, adapt = () => {}) {
    const material = new MeshLambertMaterial({ side: FrontSide, ...options });
    material.onBeforeCompile = (shader) => {
      Object.assign(shader.uniforms, this.haze);
      shader.fragmentShader = shader.fragmentShader
        .replace("#include <common>", `#include <common>
          uniform vec3 hazeColour;
          uniform float hazePerM;`)
        .replace("#include <opaque_fragment>", `#include <opaque_fragment>
          gl_FragColor.rgb = mix(hazeColour, gl_FragColor.rgb, exp(-hazePerM * length(vViewPosition)));`);
      adapt(shader);
    };
    material.customProgramCacheKey = () => "matt";
    return material;
  }
}
