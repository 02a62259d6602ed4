// Instanced models: one draw call for all instances of a model's part at a level of detail.
import { DynamicDrawUsage, InstancedBufferAttribute, InstancedMesh } from "../vendor.js";
import { bodyOf, coneOf } from "./far_trees.js";

const COARSEST = 2;
// What stands for parts of trees beyond the coarsest level where the processor draws.
const FAR_TREES = { crown: bodyOf, trunk: coneOf };

export class Models {
  // `isSlow`: what stands is drawn a level coarser than its distance asks for; far trees have no leaves.
  constructor(file, leaves, cut, materials, isSlow) {
    this.coarser = isSlow ? 1 : 0;
    this.people = file.extras.people;
    this.plain = materials.model(null, 0);
    this.leafy = materials.model(leaves, cut);
    this.parts = new Map();
    for (const [name, node] of file.nodes) {
      const geometry = node.geometry;
      geometry.setAttribute("layer", geometry.getAttribute("_layer"));
      geometry.deleteAttribute("_layer");
      const part = { geometry, step: node.scale.x, leafy: geometry.hasAttribute("uv") };
      const [model, kind, level] = name.split(":"), far = isSlow && Number(level) === COARSEST && FAR_TREES[kind];
      this.parts.set(name, part);
      if (!far) continue;
      const body = { ...part, geometry: far(geometry, leaves.image), leafy: false };
      this.parts.set(`${model}:${kind}:${COARSEST + 1}`, body);
    }
    this.steps = new Map();
    for (const name of this.parts.keys()) {
      const [model, part] = name.split(":");
      if (!part.startsWith("walk_")) continue;
      this.steps.set(model, Math.max(this.steps.get(model) ?? 0, Number(part.slice(5)) + 1));
    }
  }

  // The name of the part that is drawn of what stands on a tile of a level.
  standing(name, level) {
    const drawn = `${name}:${level + this.coarser}`;
    return this.parts.has(drawn) ? drawn : `${name}:${Math.min(COARSEST, level + this.coarser)}`;
  }

  has(name) {
    return this.parts.has(name);
  }

  dispose() {
    for (const { geometry } of this.parts.values()) geometry.dispose();
    this.plain.dispose();
    this.leafy.dispose();
  }
}

// The instances of one part at one level; grows as needed.
class Pool {
  constructor(group, models, name, casts) {
    this.casts = casts;
    this.part = models.parts.get(name);
    this.material = this.part.leafy ? models.leafy : models.plain;
    this.group = group;
    this.mesh = null;
    this.capacity = 0;
    this.count = 0;
  }

  reserve(count) {
    if (count <= this.capacity) return;
    const capacity = Math.max(8, 2 ** Math.ceil(Math.log2(count)));
    const geometry = this.part.geometry.clone();
    this.tints = new Uint8Array(16 * capacity);
    for (let slot = 0; slot < 4; slot++) {
      const view = new InstancedBufferAttribute(new Uint8Array(4 * capacity), 4, true);
      view.setUsage(DynamicDrawUsage);
      geometry.setAttribute(`tint${slot + 1}`, view);
    }
    const mesh = new InstancedMesh(geometry, this.material, capacity);
    mesh.instanceMatrix.setUsage(DynamicDrawUsage);
    mesh.frustumCulled = false;
    mesh.castShadow = this.casts;
    mesh.receiveShadow = true;
    if (this.mesh) {
      this.group.remove(this.mesh);
      mesh.instanceMatrix.array.set(this.mesh.instanceMatrix.array);
      for (let slot = 1; slot <= 4; slot++)
        geometry.attributes[`tint${slot}`].array.set(this.mesh.geometry.attributes[`tint${slot}`].array);
      this.free();
    }
    this.mesh = mesh;
    this.slots = [1, 2, 3, 4].map((slot) => geometry.attributes[`tint${slot}`].array);
    this.matrices = mesh.instanceMatrix.array;
    this.capacity = capacity;
    this.group.add(mesh);
  }

  // The index of a new instance, whose colours are its model's own.
  next() {
    this.reserve(this.count + 1);
    const index = this.count++;
    for (const slot of this.slots) slot.fill(128, 4 * index, 4 * index + 3).fill(0, 4 * index + 3, 4 * index + 4);
    return index;
  }

  tint(index, slot, red, green, blue, glow = 0) {
    const tints = this.slots[slot], at = 4 * index;
    tints[at] = Math.min(255, 127.5 * red);
    tints[at + 1] = Math.min(255, 127.5 * green);
    tints[at + 2] = Math.min(255, 127.5 * blue);
    tints[at + 3] = Math.min(255, 127.5 * glow);
  }

  finish() {
    if (!this.mesh) return;
    this.mesh.count = this.count;
    this.mesh.visible = this.count > 0;
    this.mesh.instanceMatrix.needsUpdate = true;
    for (let slot = 1; slot <= 4; slot++) this.mesh.geometry.attributes[`tint${slot}`].needsUpdate = true;
  }

  free() {
    this.mesh?.geometry.dispose();
    this.mesh?.dispose();
  }
}

// Pools by name, refilled together.
export class Pools {
  // `casts`: whether they cast shadows, which only what stands still does.
  constructor(group, models, casts = false) {
    this.group = group;
    this.models = models;
    this.casts = casts;
    this.pools = new Map();
  }

  begin() {
    for (const pool of this.pools.values()) pool.count = 0;
  }

  // The pool of a part; null where the model has none.
  of(name) {
    let pool = this.pools.get(name);
    if (!pool && this.models.has(name)) this.pools.set(name, (pool = new Pool(this.group, this.models, name, this.casts)));
    return pool ?? null;
  }

  // One instance of a row of a tile: twelve numbers of its matrix, column by column, then its colours.
  add(name, row) {
    const pool = this.of(name);
    if (!pool) return;
    const index = pool.next(), at = 16 * index, to = pool.matrices, step = pool.part.step;
    for (let column = 0; column < 3; column++) {
      for (let axis = 0; axis < 3; axis++) to[at + 4 * column + axis] = row[3 * column + axis] * step;
      to[at + 4 * column + 3] = 0;
    }
    to[at + 12] = row[9];
    to[at + 13] = row[10];
    to[at + 14] = row[11];
    to[at + 15] = 1;
    for (let slot = 0; 12 + 3 * slot < row.length; slot++)
      pool.tint(index, slot, row[12 + 3 * slot], row[13 + 3 * slot], row[14 + 3 * slot]);
  }

  finish() {
    for (const pool of this.pools.values()) pool.finish();
  }

  dispose() {
    for (const pool of this.pools.values()) {
      if (pool.mesh) this.group.remove(pool.mesh);
      pool.free();
    }
  }
}
