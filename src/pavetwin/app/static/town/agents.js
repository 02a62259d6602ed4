// Vehicles and people: instances of models, at three levels of detail by their distance.
import { CanvasTexture, DynamicDrawUsage, Group, InstancedMesh, MeshBasicMaterial, PlaneGeometry, Sphere } from "../vendor.js";
import { Pools } from "./models.js";

// Distances to which levels reach; the finest one less far where the processor draws.
const NEAR_M = 60, SLOW_NEAR_M = 25, MIDDLE_M = 70, FAR_M = 900;
const MARGIN_M = 2; // Around a person.
const JUMP_M = 5; // An agent that has moved farther since the last update did not walk there.
const CARS = ["hatchback", "compact", "saloon", "suv", "van"];
const KINDS = {
  delivery: "van", truck: "light_truck", trailer: "heavy_truck", bus: "bus", coach: "bus", tram: "bus",
  motorcycle: "motorcycle", moped: "motorcycle", bicycle: "motorcycle", scooter: "motorcycle",
};
// Linear reflectances; a factor of 1 is the model's own colour.
const PAINTS = [[0.62, 0.62, 0.60], [0.02, 0.02, 0.022], [0.16, 0.165, 0.17], [0.36, 0.37, 0.375], [0.03, 0.06, 0.16],
  [0.30, 0.02, 0.02], [0.10, 0.11, 0.10], [0.42, 0.38, 0.30]];
const CLOTHES = [[0.05, 0.06, 0.10], [0.40, 0.38, 0.34], [0.02, 0.02, 0.02], [0.22, 0.06, 0.05], [0.10, 0.16, 0.09],
  [0.16, 0.20, 0.30]];
const SKINS = [[0.50, 0.33, 0.25], [0.36, 0.22, 0.15], [0.16, 0.09, 0.06]];
const HAIRS = [[0.03, 0.02, 0.015], [0.12, 0.08, 0.04], [0.30, 0.28, 0.26]];

function chance(id, turn) {
  let value = Math.imul((id + 1) ^ (turn * 0x9e3779b9), 0x85ebca6b);
  value = Math.imul(value ^ (value >>> 13), 0xc2b2ae35);
  return ((value ^ (value >>> 16)) >>> 0) / 4294967296;
}

function oneOf(values, id, turn) {
  return values[Math.floor(chance(id, turn) * values.length)];
}

export class Agents {
  constructor(scene, models) {
    this.models = models;
    this.group = new Group();
    scene.add(this.group);
    this.pools = new Pools(this.group, models);
    this.people = Object.keys(models.people).sort();
    this.appearances = new Map();
    this.walks = new Map();
    this.times = [];
    this.list = [];
    this.around = new Sphere(); // Of the agent that is placed.
    this.#prepareShades();
  }

  set(list) {
    this.list = list;
  }

  // Of another flight the same numbers are other agents.
  forget() {
    this.appearances.clear();
    this.walks.clear();
  }

  get(id) {
    return this.list.find((agent) => agent.id === id);
  }

  // Place the agents in a frustum, or all, as seen from a point in the files' axes; `hidden` is the agent whose eye the
  // camera is.
  update(eye, hidden, frustum) {
    const start = performance.now();
    const pools = this.pools, shades = this.shades, near = this.models.coarser ? SLOW_NEAR_M : NEAR_M;
    let shade = 0;
    pools.begin();
    this.#reserve(this.list.length);
    for (const agent of this.list) {
      const away = Math.hypot(agent.y - eye.x, eye.y, agent.x - eye.z);
      const appearance = this.appearance(agent);
      const phase = appearance.stride ? this.#walked(agent, appearance) : 0;
      if (away > FAR_M || agent.id === hidden) continue;
      this.around.center.set(agent.y, agent.z ?? 0, agent.x);
      this.around.radius = Math.max(...appearance.size, MARGIN_M);
      if (frustum && !frustum.intersectsSphere(this.around)) continue;
      const level = away < near ? 0 : away < MIDDLE_M ? 1 : 2;
      const part = appearance.stride ? (phase === null ? appearance.stand : appearance.steps[phase]) : appearance.body;
      const pool = pools.of(part[level]);
      if (!pool) continue;
      const index = pool.next(), to = pool.matrices, at = 16 * index, step = pool.part.step;
      const cos = Math.cos(agent.yaw), sin = Math.sin(agent.yaw);
      const [long, wide, tall] = appearance.scale;
      to.fill(0, at, at + 16);
      to[at] = cos * wide * step;
      to[at + 2] = -sin * wide * step;
      to[at + 5] = tall * step;
      to[at + 8] = sin * long * step;
      to[at + 10] = cos * long * step;
      to[at + 12] = agent.y;
      to[at + 13] = agent.z ?? 0;
      to[at + 14] = agent.x;
      to[at + 15] = 1;
      for (let slot = 0; slot < appearance.tints.length; slot++) {
        const [red, green, blue] = appearance.tints[slot];
        pool.tint(index, slot, red, green, blue, agent.brakes && slot === 1 && !appearance.stride ? 1.5 : 0);
      }
      if (level < 2) {
        const matrix = shades.instanceMatrix.array, from = 16 * shade++;
        matrix.fill(0, from, from + 16);
        const length = 1.25 * appearance.size[0], width = 1.35 * appearance.size[1];
        matrix[from] = cos * width;
        matrix[from + 2] = -sin * width;
        matrix[from + 5] = 1;
        matrix[from + 8] = sin * length;
        matrix[from + 10] = cos * length;
        matrix[from + 12] = agent.y;
        matrix[from + 13] = (agent.z ?? 0) + 0.02;
        matrix[from + 14] = agent.x;
        matrix[from + 15] = 1;
      }
    }
    pools.finish();
    shades.count = shade;
    shades.visible = shade > 0;
    shades.instanceMatrix.needsUpdate = true;
    this.times.push(performance.now() - start);
    if (this.times.length > 120) this.times.shift();
  }

  // Median time of an update in milliseconds.
  get median() {
    const sorted = [...this.times].sort((one, other) => one - other);
    return sorted.length ? sorted[sorted.length >> 1] : 0;
  }

  // Model, colours and scale of an agent, the same at every moment; those that it brings, else drawn by its number.
  appearance(agent) {
    let appearance = this.appearances.get(agent.id);
    if (appearance) return appearance;
    const number = typeof agent.id === "number" ? agent.id : [...String(agent.id)].reduce((sum, sign) =>
      (Math.imul(sum, 31) + sign.charCodeAt(0)) | 0, 7);
    const given = agent.model && this.models.has(`${agent.model}:body:0`);
    if (agent.pedestrian || this.models.people[agent.model]) {
      const model = this.models.people[agent.model] ? agent.model : oneOf(this.people, number, 1);
      const tall = (agent.height_m ?? 1.7) / 1.72;
      const steps = this.models.steps.get(model) ?? 0;
      const names = (part) => [0, 1, 2].map((level) => `${model}:${part}:${level}`);
      appearance = {
        stride: this.models.people[model].stride_m * tall, stand: names("stand"), phase: chance(number, 6),
        steps: Array.from({ length: steps }, (_, step) => names(`walk_${step}`)),
        scale: [tall, tall, tall], size: [0.6, 0.6],
        tints: agent.tints ?? [oneOf(CLOTHES, number, 2), oneOf(CLOTHES, number, 3), oneOf(HAIRS, number, 4),
          oneOf(SKINS, number, 5)],
      };
    } else {
      const kind = agent.kind ?? "";
      const ours = given ? agent.model : this.models.has(`${kind}:body:0`) ? kind : null;
      const model = ours ?? KINDS[kind] ?? oneOf(CARS, number, 1), own = this.#sizeOf(model);
      const size = [agent.length_m ?? own[0], agent.width_m ?? own[1], agent.height_m ?? own[2]];
      appearance = {
        stride: 0, body: [0, 1, 2].map((level) => `${model}:body:${level}`), size,
        scale: agent.scale ?? size.map((value, axis) => value / own[axis]),
        tints: agent.tints ?? [oneOf(PAINTS, number, 2)],
      };
    }
    this.appearances.set(agent.id, appearance);
    return appearance;
  }

  #sizeOf(model) {
    const { geometry, step } = this.models.parts.get(`${model}:body:0`);
    geometry.computeBoundingBox();
    const { min, max } = geometry.boundingBox;
    return [(max.z - min.z) * step, (max.x - min.x) * step, (max.y - min.y) * step];
  }

  // The phase of a person's gait by the way walked since the first update; null for one who stands.
  #walked(agent, appearance) {
    const last = this.walks.get(agent.id) ?? { x: agent.x, y: agent.y, way: appearance.phase * appearance.stride };
    const moved = Math.hypot(agent.x - last.x, agent.y - last.y);
    const way = last.way + (moved < JUMP_M ? moved : 0);
    this.walks.set(agent.id, { x: agent.x, y: agent.y, way });
    if (!(agent.moving ?? moved > 0.002) || !appearance.steps.length) return null;
    return Math.floor(way / appearance.stride * appearance.steps.length) % appearance.steps.length;
  }

  // Soft shades on the ground below vehicles and people: one draw call.
  #prepareShades() {
    const canvas = new OffscreenCanvas(64, 64), context = canvas.getContext("2d");
    const fade = context.createRadialGradient(32, 32, 6, 32, 32, 32);
    fade.addColorStop(0, "rgba(0, 0, 0, 0.62)");
    fade.addColorStop(0.55, "rgba(0, 0, 0, 0.42)");
    fade.addColorStop(1, "rgba(0, 0, 0, 0)");
    context.fillStyle = fade;
    context.fillRect(0, 0, 64, 64);
    this.shade = {
      geometry: new PlaneGeometry(1, 1).rotateX(-Math.PI / 2),
      material: new MeshBasicMaterial({ map: new CanvasTexture(canvas), transparent: true, depthWrite: false }),
    };
    this.#reserve(64);
  }

  #reserve(count) {
    if (this.shades && count <= this.shades.instanceMatrix.count) return;
    const most = 2 ** Math.ceil(Math.log2(Math.max(64, count)));
    if (this.shades) {
      this.group.remove(this.shades);
      this.shades.dispose();
    }
    this.shades = new InstancedMesh(this.shade.geometry, this.shade.material, most);
    this.shades.instanceMatrix.setUsage(DynamicDrawUsage);
    this.shades.frustumCulled = false;
    this.shades.renderOrder = 1;
    this.group.add(this.shades);
  }

  dispose() {
    this.pools.dispose();
    this.shades.dispose();
    this.shade.geometry.dispose();
    this.shade.material.map.dispose();
    this.shade.material.dispose();
  }
}
