// Materials of a town: matt surfaces in the light of sun, sky and surroundings, and haze before them.
import { Color, DoubleSide, FrontSide, MeshLambertMaterial } from "../vendor.js";

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

  // Of houses: vertex colours times a layer of the façade textures; `mean` takes the mean of the layer, at each vertex.
  house(mean) {
    const material = this.#matt({ vertexColors: true }, (shader) => {
      shader.uniforms.facades = this.facades;
      if (mean) this.#meanFacade(shader);
      else this.#facade(shader);
    });
    material.customProgramCacheKey = () => `house ${mean}`;
    return material;
  }

  #meanFacade(shader) {
    shader.vertexShader = shader.vertexShader
      .replace("#include <common>", `#include <common>
        uniform sampler2DArray facades;
        attribute float layer;`)
      .replace("#include <color_vertex>", `#include <color_vertex>
        if (layer > 0.5) vColor.rgb *= textureLod(facades, vec3(0.5, 0.5, floor(layer + 0.5) - 1.0), 9.0).rgb;`);
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
