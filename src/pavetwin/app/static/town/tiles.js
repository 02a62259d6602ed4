// Tiles by distance: the coarsest everywhere, finer ones near the camera, loaded nearest first.
import { Box3, BufferAttribute, BufferGeometry, Group, LineBasicMaterial, LineSegments, Mesh, PlaneGeometry }
  from "../vendor.js";
import { Pools } from "./models.js";

const AT_ONCE = 6;
const AGAIN_MS = 5000; // So long after it failed a tile is asked for again.
const KEPT = [48, 260, Infinity]; // Tiles of each level in memory, those that are shown excepted.
// Meadows around the town, below all of its ground; nothing stands there, so they fade into the haze.
const LAND = [0.098, 0.118, 0.049], LAND_M = -1.2, LAND_FADED_M = 1400;
// What stands on a tile reaches this far over its rim, and up to this height at least.
const OVERHANG_M = 4, TALLEST_M = 25;
const EASE = 1.15; // A tile is left for a coarser one this much farther away than it was taken.

export class Tiles {
  constructor(scene, manifest, files, materials, models) {
    Object.assign(this, { manifest, files, materials, models });
    this.group = new Group();
    this.objects = new Group();
    this.outlines = new Group();
    scene.add(this.group, this.objects, this.outlines);
    const [west, south, east, north] = manifest.bounds;
    this.land = new Mesh(new PlaneGeometry(12_000, 12_000).rotateX(-Math.PI / 2), materials.plain(LAND, LAND_FADED_M));
    this.land.position.set((south + north) / 2, LAND_M, (west + east) / 2);
    scene.add(this.land);
    this.land.receiveShadow = true;
    this.pools = new Pools(this.objects, models, true);
    this.house = materials.house();
    this.far = materials.coloured();
    this.line = new LineBasicMaterial({ color: 0xd62728 });
    this.nodes = new Map();
    this.shown = new Set();
    this.placed = null; // The shown tiles whose models are placed.
    this.coarse = [];
    this.showsOutlines = false;
    this.working = new Set();
    this.arrived = false; // Whether something has come since tiles were chosen last.
    this.failures = new Map(); // By the node that did not come; it is asked for again.
    this.held = false; // While true, no more tiles are requested.
    this.time = 0;
    const levels = manifest.levels, last = levels.length - 1;
    for (const { level, tiles } of levels)
      for (const [column, row, west, south, east, north, top] of tiles)
        this.nodes.set(`${level}/${column}_${row}`, {
          level, column, row, box: [west, south, east, north, top], name: `${level}/${column}_${row}.glb.gz`,
          state: "none", shown: false, used: 0, away: 0, reliefs: null, bounds: new Box3(
            { x: south - OVERHANG_M, y: LAND_M, z: west - OVERHANG_M },
            { x: north + OVERHANG_M, y: Math.max(top, TALLEST_M), z: east + OVERHANG_M }),
        });
    const ratio = Math.round(levels[last].side_m / levels[0].side_m);
    for (const [column, row] of levels[last].tiles) {
      const node = this.nodes.get(`${last}/${column}_${row}`);
      node.children = [];
      for (let north = 0; north < ratio; north++)
        for (let east = 0; east < ratio; east++) {
          const place = `${column * ratio + east}_${row * ratio + north}`;
          node.children.push({ middle: this.nodes.get(`1/${place}`), fine: this.nodes.get(`0/${place}`) });
        }
      this.coarse.push(node);
    }
  }

  // Choose what is shown from a place in the files' axes, and load what is missing; true if anything changed.
  update(eye) {
    this.time++;
    this.arrived = false;
    this.wanted = [];
    const shown = new Set();
    const [toFine, toMiddle] = [this.manifest.levels[0].to_m, this.manifest.levels[1].to_m];
    for (const node of this.coarse) {
      const away = this.#away(node, eye);
      if (away > toMiddle * (node.split ? EASE : 1)) {
        node.split = false;
        this.#want(node, away);
        if (node.state === "ready") shown.add(node);
        continue;
      }
      let ready = true;
      const parts = node.children.map(({ middle, fine }) => {
        const near = this.#away(middle, eye) < toFine * (fine.shown ? EASE : 1);
        this.#want(middle, this.#away(middle, eye) + 1000);
        if (near) this.#want(fine, this.#away(fine, eye) + 2000);
        if (near && fine.state === "ready") return fine;
        ready &&= middle.state === "ready";
        return middle;
      });
      if (ready) {
        node.split = true;
        for (const part of parts) shown.add(part);
      } else {
        this.#want(node, away);
        if (node.state === "ready") shown.add(node);
        else for (const part of parts) if (part.state === "ready") shown.add(part);
      }
    }
    let changed = this.#show(shown);
    for (const node of shown) if (node.level === 0) changed = this.#relieve(node, eye) || changed;
    this.shown = shown;
    if (changed) this.placed = null;
    this.#load();
    this.#forget();
    return changed;
  }

  // Why a tile did not come, of the first of them; null where all came.
  get failed() {
    return this.failures.values().next().value ?? null;
  }

  get pending() {
    return this.missing + (this.arrived ? 1 : 0);
  }

  // Files that are loading or waited for.
  get missing() {
    return this.working.size + (this.wanted?.length ?? 0);
  }

  counts() {
    const counts = [0, 0, 0];
    for (const node of this.nodes.values()) if (node.shown) counts[node.level]++;
    return counts;
  }

  // The defects of the finest tiles that are shown: their numbers, classes, outlines.
  *defects() {
    for (const node of this.nodes.values()) if (node.shown && node.extras) yield* node.extras.defects;
  }

  setOutlines(on) {
    this.showsOutlines = on;
    this.outlines.visible = on;
  }

  #away({ box: [west, south, east, north, top] }, eye) {
    const across = Math.max(west - eye.z, 0, eye.z - east), along = Math.max(south - eye.x, 0, eye.x - north);
    return Math.hypot(across, along, Math.max(0, eye.y - top));
  }

  #want(node, rank) {
    node.used = this.time;
    if (node.state === "none") this.wanted.push({ node, rank });
  }

  #show(shown) {
    let changed = false;
    for (const node of this.nodes.values()) {
      const now = shown.has(node);
      if (now) node.used = this.time;
      if (node.shown === now) continue;
      node.shown = now;
      changed = true;
      if (now) this.group.add(node.group);
      else this.group.remove(node.group);
      if (node.outline) (now ? this.outlines.add(node.outline) : this.outlines.remove(node.outline));
    }
    return changed;
  }

  // The relief of a fine tile's defects, in place of the level ground over them, once all of it is there.
  #relieve(node, eye) {
    const { parts, to_m } = this.manifest.defects, count = parts[`${node.column}_${node.row}`];
    if (!count || node.reliefs === "shown") return false;
    if (this.#away(node, eye) > to_m) return false;
    if (!node.reliefs) {
      node.reliefs = Array.from({ length: count }, () => null);
      for (let part = 0; part < count; part++) {
        node.reliefs[part] = {
          name: `defects/${node.column}_${node.row}_${part}.glb.gz`, state: "none", level: 0, group: null,
        };
      }
    }
    for (const relief of node.reliefs) if (relief.state === "none") this.wanted.push({ node: relief, rank: 3000 });
    if (!node.reliefs.every((relief) => relief.state === "ready")) return false;
    for (const relief of node.reliefs) node.group.add(relief.group);
    if (node.fills) node.fills.visible = false;
    node.reliefs = "shown";
    return true;
  }

  // Place the models of the shown tiles in a frustum, which are fewer than all; of all of them where there is none, as
  // for shadows.
  place(frustum) {
    const seen = [...this.shown].filter((node) => !frustum || frustum.intersectsBox(node.bounds));
    if (this.placed?.size === seen.length && seen.every((node) => this.placed.has(node))) return;
    this.placed = new Set(seen);
    this.pools.begin();
    for (const node of seen)
      for (const [name, rows] of Object.entries(node.extras.instances))
        for (const row of rows) this.pools.add(this.models.standing(name, node.level), row);
    this.pools.finish();
  }

  #load() {
    this.wanted.sort((one, other) => one.rank - other.rank);
    while (this.working.size < AT_ONCE && this.wanted.length && !this.held) {
      const { node } = this.wanted.shift();
      node.state = "loading";
      const work = this.#fetch(node).finally(() => {
        this.working.delete(work);
        this.arrived = true;
        if (!this.gone) this.#load();
      });
      this.working.add(work);
    }
  }

  async #fetch(node) {
    try {
      const { nodes, extras } = await this.files.meshes(node.name);
      if (this.gone) return;
      node.group = new Group();
      node.group.matrixAutoUpdate = false;
      for (const [name, mesh] of nodes) node.group.add(this.#dressed(name, mesh, node));
      node.extras = { instances: {}, defects: [], ...extras };
      if (extras.level === 0 && extras.defects.length) node.outline = this.#outlined(extras.defects);
      if (node.fills) node.fills.material = node.ground?.material ?? node.fills.material;
      node.state = "ready";
      this.failures.delete(node);
    } catch (error) {
      node.state = "failed";
      if (this.gone) return;
      this.failures.set(node, error);
      setTimeout(() => { node.state = "none"; this.arrived = true; }, AGAIN_MS);
    }
  }

  #dressed(name, mesh, node) {
    const geometry = mesh.geometry, map = mesh.material.map;
    for (const attribute of ["layer", "facade"])
      if (geometry.hasAttribute(`_${attribute}`)) {
        geometry.setAttribute(attribute, geometry.getAttribute(`_${attribute}`));
        geometry.deleteAttribute(`_${attribute}`);
      }
    mesh.material.dispose();
    if (name === "houses") mesh.material = this.house;
    else if (name === "town") {
      mesh.material = this.far;
      this.materials.bakeFacades(geometry);
    }
    else mesh.material = this.materials.pictured(map);
    mesh.castShadow = name === "houses" || name === "town";
    mesh.receiveShadow = true;
    if (name === "fills") node.fills = mesh;
    if (name === "ground") node.ground = mesh;
    mesh.updateMatrix();
    mesh.matrixAutoUpdate = false;
    return mesh;
  }

  #outlined(defects) {
    const points = [];
    for (const { outline } of defects)
      outline.forEach(([x, y], index) => {
        const [toX, toY] = outline[(index + 1) % outline.length];
        points.push(y, 0.03, x, toY, 0.03, toX);
      });
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(new Float32Array(points), 3));
    return new LineSegments(geometry, this.line);
  }

  #forget() {
    for (const [level, most] of KEPT.entries()) {
      const idle = [...this.nodes.values()].filter(
        (node) => node.level === level && node.state === "ready" && !node.shown);
      idle.sort((one, other) => other.used - one.used);
      for (const node of idle.slice(most)) {
        if (node.used < this.time) this.#drop(node);
      }
    }
  }

  #drop(node) {
    node.group?.traverse((mesh) => {
      mesh.geometry?.dispose();
      mesh.material?.map?.dispose();
      if (mesh.material && mesh.material !== this.house && mesh.material !== this.far) mesh.material.dispose();
    });
    node.outline?.geometry.dispose();
    Object.assign(node, {
      state: "none", group: null, extras: null, outline: null, fills: null, ground: null, reliefs: null,
    });
  }

  dispose() {
    this.gone = true;
    for (const node of this.nodes.values()) if (node.state === "ready") this.#drop(node);
    this.pools.dispose();
    this.land.geometry.dispose();
    for (const material of [this.house, this.far, this.line, this.land.material]) material.dispose();
  }
}
