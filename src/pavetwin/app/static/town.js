// A town in 3-D on a canvas: tiles by distance, traffic, the UAV, four cameras. Places are metres of the world frame
// (x east, y north, z up), yaw is counter-clockwise from east in radians; see docs/reference/town-client.md.
import { Frustum, Matrix4, NeutralToneMapping, PCFShadowMap, PerspectiveCamera, Raycaster, Scene, Vector2, Vector3,
  WebGLRenderer } from "./vendor.js";
import { Agents } from "./town/agents.js";
import { Cameras } from "./town/cameras.js";
import { Files } from "./town/files.js";
import { Materials } from "./town/materials.js";
import { Models, Pools } from "./town/models.js";
import { Sky } from "./town/sky.js";
import { Tiles } from "./town/tiles.js";

const FORMAT = 1;
const MOVED_M = 1.0;
const CLICK_PX = 4;
const ARRIVED_MS = 300; // Least time between two pictures for tiles that have arrived alone.
// Where the processor draws: pixels along a side while pictures follow each other within a time, of those while nothing
// moves.
const MOVING_SCALE = 0.6, MOVING_MS = 700;
const WAITS_MS = 400; // There a picture waits so long at most for what else is made meanwhile.
const SHADOW_M = 90, MOST_SHADOW_M = 600; // Half the side of the square with shadows.
const SHADOW_WAIT_MS = 700; // Least time between two drawings of shadows while tiles arrive.
const NO_WEBGL = "This browser offers no WebGL 2, so the town cannot be drawn in 3-D. Everything else works.";

// What stands in for a town where none can be drawn: every call does nothing.
function nothing(message) {
  const idle = () => {};
  return {
    available: false, message, ready: Promise.resolve(false), setAgents: idle, forgetAgents: idle, setUav: idle, setCamera: idle,
    setLayers: idle, setLight: idle, lookAt: idle, hold: idle, resize: idle, render: idle, dispose: idle, drawDown: () => false,
    stats: () => ({ available: false, message }),
  };
}

// The name of what draws.
function rendererName(gl) {
  return gl.getParameter(gl.getExtension("WEBGL_debug_renderer_info")?.UNMASKED_RENDERER_WEBGL ?? gl.RENDERER);
}

// Whether WebGL is drawn by the processor, which has no time for smooth edges.
function isSoftware() {
  const gl = new OffscreenCanvas(1, 1).getContext("webgl2");
  const named = gl ? rendererName(gl) : "";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(named);
}

export function createTown(canvas, { base, fetch = globalThis.fetch.bind(globalThis), onPick, onMessage, onSettled, onMissing, isBusy } = {}) {
  let renderer;
  const isSlow = isSoftware(), options = { antialias: !isSlow, powerPreference: "high-performance" };
  try {
    if (!canvas.getContext("webgl2", options)) throw new Error();
    renderer = new WebGLRenderer({ canvas, ...options });
  } catch {
    onMessage?.(NO_WEBGL);
    return nothing(NO_WEBGL);
  }
  const handlers = { isSlow, onPick, onMessage, onSettled, onMissing, isBusy };
  return new Town(canvas, renderer, base.endsWith("/") ? base : `${base}/`, fetch, handlers);
}

class Town {
  constructor(canvas, renderer, base, fetch, handlers) {
    Object.assign(this, { canvas, renderer, ...handlers });
    this.available = true;
    this.message = "";
    renderer.toneMapping = NeutralToneMapping;
    renderer.shadowMap.enabled = true;
    renderer.shadowMap.type = PCFShadowMap;
    renderer.shadowMap.autoUpdate = false;
    this.scene = new Scene();
    this.files = new Files(base, fetch);
    this.materials = new Materials();
    this.sky = new Sky(this.scene, this.materials);
    this.uav = null;
    this.scale = 1;
    this.dirty = true;
    this.frames = [];
    this.started = performance.now();
    this.ready = this.#open().catch((error) => {
      this.message = `The town cannot be shown: ${error.message}`;
      this.onMessage?.(this.message);
      return false;
    });
  }

  async #open() {
    const manifest = await this.files.json("manifest.json");
    if (manifest.format !== FORMAT) throw new Error(`its files have format ${manifest.format}, not ${FORMAT}`);
    const [models, facades, leaves] = await Promise.all([
      this.files.meshes(manifest.models.file), this.files.layers(manifest.facades.file),
      this.files.texture(manifest.leaves.file),
    ]);
    if (this.gone) return false;
    this.manifest = manifest;
    this.materials.facades.value = facades;
    this.materials.facadeSteps = manifest.facades.steps;
    leaves.flipY = false;
    this.models = new Models(models, leaves, manifest.leaves.cut, this.materials, this.isSlow);
    this.sky.set(manifest.light);
    this.cameras = new Cameras(this.canvas, manifest, () => (this.dirty = true));
    if (this.asked) this.cameras.set(...this.asked);
    this.tiles = new Tiles(this.scene, manifest, this.files, this.materials, this.models);
    this.tiles.held = this.held;
    this.tiles.setOutlines(Boolean(this.layers?.defects));
    this.agents = new Agents(this.scene, this.models);
    this.agents.set(this.list ?? []);
    this.craft = new Pools(this.scene, this.models);
    this.#listen();
    this.resize();
    this.setLayers(this.layers ?? {});
    this.request = requestAnimationFrame(this.#frame);
    return true;
  }

  // All agents of a moment: {id, x, y, yaw, z?, kind?, pedestrian?, length_m?, width_m?, height_m?, model?, tints?,
  // moving?, brakes?}. What an agent looks like is settled the first time that its id appears.
  setAgents(list) {
    this.list = list;
    this.agents?.set(list);
    this.moved = this.dirty = true;
  }

  // Other agents come, whose ids may be those of agents before.
  forgetAgents() {
    this.agents?.forget();
  }

  // {x, y, z, yaw, pitch}: pitch of the camera, −π/2 straight down. null for none.
  setUav(pose) {
    this.uav = pose;
    this.dirty = true;
  }

  // "orbit", "follow", "uav", "car"; options {agent} for the car and {eye: {ahead_m, up_m, pitch_rad}} for a camera on
  // it in place of its driver, {fov_deg}, {back_m, up_m} to follow.
  setCamera(mode, options = {}) {
    this.asked = [mode, options];
    this.cameras?.set(mode, options);
    this.moved = this.dirty = true;
  }

  // Orbit around a place, from a distance.
  lookAt(x, y, away_m = 60) {
    this.cameras?.look(x, y, away_m);
    this.dirty = true;
  }

  // {defects, agents, uav, objects}: outlines of defects, traffic, the UAV, trees and street furniture.
  setLayers(layers) {
    this.layers = { defects: false, agents: true, uav: true, objects: true, ...this.layers, ...layers };
    if (this.tiles) {
      this.tiles.setOutlines(this.layers.defects);
      if (this.tiles.objects.visible !== this.layers.objects) this.shaded = false;
      this.tiles.objects.visible = this.layers.objects;
      this.agents.group.visible = this.layers.agents;
    }
    this.dirty = true;
  }

  // The light of other conditions, as `light` of a manifest.
  setLight(light) {
    this.sky.set(light);
    this.shaded = false;
    this.dirty = true;
  }

  // Load and draw nothing while nobody sees it.
  hold(on) {
    this.held = on;
    if (this.tiles) this.tiles.held = on;
    this.dirty = true;
  }

  resize() {
    const { clientWidth: wide, clientHeight: tall } = this.canvas;
    if (!wide || !tall) return;
    this.renderer.setPixelRatio(this.scale * Math.min(globalThis.devicePixelRatio ?? 1, 2));
    this.renderer.setSize(wide, tall, false);
    this.cameras?.resize(wide, tall);
    this.dirty = true;
  }

  stats() {
    const { render } = this.renderer.info;
    return {
      available: true, message: this.message, renderer: rendererName(this.renderer.getContext()),
      drawCalls: render.calls, triangles: render.triangles, tiles: this.tiles?.counts() ?? [0, 0, 0],
      pending: this.tiles ? this.tiles.pending : 1, failed: this.tiles?.failed?.message ?? null,
      bytes: this.files.bytes, agents: this.list?.length ?? 0, agents_ms: this.agents?.median ?? 0,
      frame_ms: this.frames.length ? [...this.frames].sort((a, b) => a - b)[this.frames.length >> 1] : 0,
      ready_ms: this.settled ?? null,
    };
  }

  // Draw at once.
  render() {
    if (!this.tiles || this.lost) return;
    const start = performance.now();
    this.#update();
    this.#placeUav();
    this.#drawFrom(this.cameras.camera);
    this.frames.push(performance.now() - start);
    if (this.frames.length > 60) this.frames.shift();
    const failed = this.tiles.failed ? `Parts of the town could not be loaded and are requested again: ${this.tiles.failed.message}` : "";
    if (failed !== (this.failed ?? "")) this.onMessage?.(this.message = failed);
    this.failed = failed;
    const isSettled = !this.tiles.pending, { missing } = this.tiles;
    if (missing !== (this.missing ?? 0)) this.onMissing?.(missing);
    this.missing = missing;
    if (isSettled) this.settled ??= performance.now() - this.started;
    if (isSettled && !this.isSettled) queueMicrotask(() => this.onSettled?.());
    this.isSettled = isSettled;
  }

  // The camera, the tiles and the agents of now.
  #update() {
    this.cameras.update(this.uav, this.#car());
    const eye = this.cameras.camera.position;
    if (!this.last || this.last.distanceTo(eye) > MOVED_M || this.tiles.pending) {
      if (this.tiles.update(eye)) this.shaded = false;
      this.last = eye.clone();
      this.moved = true;
    }
    this.#shade(eye);
  }

  // Draw with a camera the models and agents that it may see; where shadows are drawn, all models cast theirs.
  #drawFrom(camera) {
    const { mode, options } = this.cameras, { frustum, view } = this.seen ??= { frustum: new Frustum(), view: new Matrix4() };
    camera.updateMatrixWorld();
    const now = new Matrix4().multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse);
    if (this.moved || !now.equals(view)) {
      frustum.setFromProjectionMatrix(view.copy(now));
      this.agents.update(camera.position, mode === "car" ? options.agent : undefined, frustum);
    }
    this.moved = false;
    this.tiles.place(this.renderer.shadowMap.needsUpdate ? null : frustum);
    this.renderer.render(this.scene, camera);
  }

  // Draw what a camera sees that looks straight down from {x, y, z}, with the yaw up, into a rectangle [left, top, width,
  // height] of a 2D context, in its units. Returns whether it could: not before the town is there.
  drawDown(pen, [left, top, width, height], { x, y, z, yaw }, fov_deg) {
    if (!this.tiles || this.lost || !this.canvas.width || !this.canvas.height) return false;
    const down = this.down ??= new PerspectiveCamera(), { canvas, renderer } = this;
    const across = pen.getTransform().a * width / canvas.width, up = pen.getTransform().d * height / canvas.height;
    const fit = Math.min(1, 1 / across, 1 / up) / renderer.getPixelRatio();
    const [wide, tall] = [across * canvas.width * fit, up * canvas.height * fit].map(Math.floor);
    down.fov = fov_deg;
    down.aspect = width / height;
    down.position.set(y, z, x);
    down.up.set(Math.sin(yaw), 0, Math.cos(yaw));
    down.lookAt(y, 0, x);
    down.updateProjectionMatrix();
    renderer.setViewport(0, 0, wide, tall);
    renderer.setScissor(0, 0, wide, tall);
    renderer.setScissorTest(true);
    this.#update();
    this.craft.begin(); // the UAV does not see itself
    this.craft.finish();
    this.#drawFrom(down);
    const [pixels, rows] = [wide, tall].map((each) => each * renderer.getPixelRatio());
    pen.drawImage(canvas, 0, canvas.height - rows, pixels, rows, left, top, width, height);
    renderer.setScissorTest(false);
    renderer.setViewport(0, 0, canvas.width / renderer.getPixelRatio(), canvas.height / renderer.getPixelRatio());
    this.render(); // what the browser shows of the canvas is its own view
    this.dirty = false;
    return true;
  }

  dispose() {
    this.gone = true;
    cancelAnimationFrame(this.request);
    this.listening?.abort();
    for (const part of [this.tiles, this.agents, this.craft, this.models, this.cameras, this.sky]) part?.dispose();
    this.materials.facades.value?.dispose();
    this.renderer.dispose();
  }

  #frame = () => {
    this.request = requestAnimationFrame(this.#frame);
    if (this.held) return;
    const now = performance.now(), since = now - (this.drawnAt ?? -Infinity), isRecent = since < MOVING_MS;
    if (this.tiles.arrived && since > ARRIVED_MS) this.dirty = true;
    if (!this.dirty && (isRecent || this.scale === 1)) return;
    this.dueAt ??= now;
    if (this.isSlow && now - this.dueAt < WAITS_MS && this.isBusy?.()) return;
    this.dueAt = undefined;
    this.#setScale(this.isSlow && this.dirty && isRecent ? MOVING_SCALE : 1);
    this.dirty = false;
    this.render();
    this.drawnAt = performance.now();
  };

  #setScale(scale) {
    if (scale === this.scale) return;
    this.scale = scale;
    this.resize();
  }

  #car() {
    return this.cameras.mode === "car" ? this.agents.get(this.cameras.options.agent) ?? null : null;
  }

  // Shadows of what stands still: drawn again when it changes, and when the camera leaves their middle.
  #shade(eye) {
    const { mode, controls } = this.cameras, middle = mode === "orbit" ? controls.target : eye;
    const reach = mode === "orbit" ? 1.3 * eye.distanceTo(controls.target) : SHADOW_M;
    const isMoved = this.sky.shade(middle, Math.min(MOST_SHADOW_M, Math.max(SHADOW_M, reach)));
    const isWaiting = this.tiles.pending && performance.now() - (this.shadedAt ?? -Infinity) < SHADOW_WAIT_MS;
    if (!isMoved && (this.shaded || isWaiting)) return;
    this.shaded = !this.tiles.pending;
    this.shadedAt = performance.now();
    this.renderer.shadowMap.needsUpdate = true;
  }

  #placeUav() {
    this.craft.begin();
    if (this.uav && this.layers.uav && this.cameras.mode !== "uav") {
      const { x, y, z, yaw } = this.uav, cos = Math.cos(yaw), sin = Math.sin(yaw);
      this.craft.add("quadrotor:body:0", [cos, 0, -sin, 0, 1, 0, sin, 0, cos, y, z, x]);
    }
    this.craft.finish();
  }

  #listen() {
    this.listening = new AbortController();
    const { signal } = this.listening;
    let down = null;
    this.canvas.addEventListener("pointerdown", (event) => (down = [event.clientX, event.clientY]), { signal });
    this.canvas.addEventListener("pointerup", (event) => {
      if (down && Math.hypot(event.clientX - down[0], event.clientY - down[1]) < CLICK_PX) this.#pick(event);
      down = null;
    }, { signal });
    this.canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      this.lost = true;
      this.message = "The graphics processor was reset; the town comes back when it is ready.";
      this.onMessage?.(this.message);
    }, { signal });
    this.canvas.addEventListener("webglcontextrestored", () => {
      this.lost = false;
      this.message = "";
      this.onMessage?.("");
      this.dirty = true;
    }, { signal });
  }

  // The place on the ground under the pointer, and the agent and the defect there.
  #pick(event) {
    if (!this.onPick) return;
    const box = this.canvas.getBoundingClientRect(), caster = new Raycaster();
    caster.setFromCamera(new Vector2(2 * (event.clientX - box.left) / box.width - 1,
      1 - 2 * (event.clientY - box.top) / box.height), this.cameras.camera);
    const { origin, direction } = caster.ray;
    let agent = null, nearest = Infinity;
    const middle = new Vector3();
    for (const each of this.list ?? []) {
      const { size, scale } = this.agents.appearance(each), half = each.pedestrian ? 0.9 * scale[2] : 0.8;
      middle.set(each.y, (each.z ?? 0) + half, each.x);
      const away = origin.distanceTo(middle), reach = each.pedestrian ? 0.6 : 0.5 * Math.min(size[0], 2 * size[1]);
      if (away >= nearest || caster.ray.distanceToPoint(middle) > Math.max(reach, 0.004 * away)) continue;
      [agent, nearest] = [each.id, away];
    }
    const ahead = direction.y < -1e-6 ? -origin.y / direction.y : null;
    if (ahead === null && agent === null) return;
    const x = ahead === null ? null : origin.z + ahead * direction.z;
    const y = ahead === null ? null : origin.x + ahead * direction.x;
    let defect = null;
    if (ahead !== null)
      for (const each of this.tiles.defects()) if (within(each.outline, x, y)) defect = each.id;
    this.onPick({ x, y, agent, defect: agent === null || nearest > (ahead ?? 0) ? defect : null });
  }
}

// Whether a point is inside an outline, or 0.2 m from one of its corners.
function within(outline, x, y) {
  let inside = false;
  for (let index = 0, last = outline.length - 1; index < outline.length; last = index++) {
    const [ax, ay] = outline[index], [bx, by] = outline[last];
    if (ay > y !== by > y && x < ((bx - ax) * (y - ay)) / (by - ay) + ax) inside = !inside;
    if (Math.hypot(ax - x, ay - y) < 0.2) return true;
  }
  return inside;
}
