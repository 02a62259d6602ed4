// The map: the town on a canvas that is drawn again when the view changes, and above it what moves and what is chosen.

import { drawMission } from './mission_layer.js';
import { drawTown, parkedAgents, pathOf, townPaths } from './shapes.js';
import { Viewport } from './viewport.js';

const TOOLS_PX = 44; // Of the map below its buttons.
const DRAG_PX = 4, NEAR_PX = 12;

export class StreetMap {
  #root; #still; #moving; #events; #viewport; #map = null; #paths = null; #colours = null; #segments = [];
  #selection = []; #drawn = []; #hovered = null; #flight = null; #mission = null; #time = 0; #defect = null; #parked = [];
  #box = null; #pointers = new Map(); #dragged = 0; #pending = { still: false, moving: false };
  layers = new Set(['buildings', 'trees', 'names', 'traffic', 'parked', 'route', 'windows', 'defects']);
  boxing = false;
  following = false;

  /** @param events `pick(ids, { toggle })`, `hover(segment | null, defect | null, x, y)`, `defect(id)`, `view()`, and `free()`: it was dragged away from the UAV */
  constructor(root, events) {
    this.#root = root;
    [this.#still, this.#moving] = root.querySelectorAll('canvas');
    this.#events = events;
    this.#viewport = new Viewport(root);
    new ResizeObserver(() => this.#resize()).observe(root);
    this.#listen();
  }

  get view() { return this.#viewport.view; }

  setWorld(map) {
    this.#map = map;
    this.#paths = townPaths(map);
    this.#segments = map.segments.map(segment => {
      const xs = segment.line.filter((_, i) => i % 2 === 0), ys = segment.line.filter((_, i) => i % 2);
      const middle = pointAlong(segment.line, 0.5);
      return {
        ...segment, path: pathOf(segment.surface), middle,
        box: [Math.min(...xs) / 100, Math.min(...ys) / 100, Math.max(...xs) / 100, Math.max(...ys) / 100],
      };
    });
    this.setFlight(null, null);
    this.fit();
  }

  setColours(colours) { this.#colours = colours; this.redraw(); }
  setSelection(ids) { this.#selection = ids; this.redrawMoving(); }
  /** Segments that the automator drew. */
  setDrawn(ids) { this.#drawn = ids; this.redrawMoving(); }
  setDefect(id) { this.#defect = id; this.redrawMoving(); }

  setFlight(flight, mission) {
    this.#flight = flight;
    this.#mission = mission;
    this.#parked = mission ? parkedAgents(mission.parked) : [];
    this.redrawMoving();
  }

  setTime(t) {
    this.#time = t;
    const place = this.following && this.#mission && this.view ? this.#mission.at(t) : null;
    if (place && this.#viewport.centre(place.x, place.y)) this.redraw();
    else this.redrawMoving();
  }

  segment(id) { return this.#segments.find(segment => segment.id === id); }
  /** The segments of a street's name, or of an id; else those whose street has the text in its name. */
  named(text) {
    const plain = name => (name ?? '').normalize('NFKD').replace(/\p{M}/gu, '').toLowerCase(), part = plain(text);
    if (!part) return [];
    const given = is => this.#segments.filter(({ street, latin, id }) => [street, latin, id].some(is));
    const same = given(name => name === text), exact = same.length ? same : given(name => plain(name) === part);
    return exact.length ? exact : this.#segments.filter(({ street, latin }) => [street, latin].some(name => plain(name).includes(part)));
  }

  /** Where the middle of a segment is on the canvas, in pixels. */
  screenOf(id) { return this.#viewport.toScreen(...this.segment(id).middle); }

  fit() {
    if (!this.#map) return;
    const [west, south, east, north] = this.#map.bounds_m, { height } = this.#viewport.size;
    this.show(west, south, east, north + (north - south) * TOOLS_PX / Math.max(1, height - TOOLS_PX), 1);
  }

  /** Show an area. */
  show(west, south, east, north, margin = 1.25) {
    this.#viewport.show(west, south, east, north, margin);
    this.redraw();
  }

  showPlace(x, y, k = 12) {
    this.#viewport.showPlace(x, y, k);
    this.redraw();
  }

  zoom(factor, x, y) {
    this.#viewport.zoom(factor, x, y);
    this.redraw();
  }

  /** Move by shares of the map's width and height. */
  move(right, up) {
    const { width, height } = this.#viewport.size;
    this.#viewport.drag(-right * width, up * height);
    this.redraw();
  }

  redraw() { this.#pending.still = true; this.redrawMoving(); }

  redrawMoving() {
    if (this.#pending.moving) return;
    this.#pending.moving = true;
    requestAnimationFrame(() => {
      this.#pending.moving = false;
      if (!this.view || !this.#colours || !this.#map) return;
      if (this.#pending.still) {
        this.#pending.still = false;
        this.#drawStill();
        this.#events.view();
      }
      this.#drawMoving();
    });
  }

  // Drawing.

  #resize() {
    for (const canvas of [this.#still, this.#moving]) this.#viewport.fill(canvas);
    if (!this.view) this.fit();
    this.redraw();
  }

  #drawStill() {
    const pen = this.#still.getContext('2d'), colours = this.#colours;
    this.#viewport.pixels(pen);
    pen.fillStyle = colours.ground;
    pen.fillRect(0, 0, this.#still.width, this.#still.height);
    this.#viewport.metres(pen);
    drawTown(pen, this.#paths, colours, { pixel: this.#viewport.pixel, trees: this.#map.trees, layers: this.layers });
    this.#viewport.pixels(pen);
    if (this.layers.has('names')) this.#drawNames(pen);
    this.#drawBase(pen);
  }

  #drawNames(pen) {
    const { k } = this.view, { width, height } = this.#viewport.size, size = Math.max(9, Math.min(14, 6 * k)), taken = [];
    if (k < 0.5) return;
    pen.font = `${size}px system-ui, "DejaVu Sans", sans-serif`;
    pen.textAlign = 'center';
    pen.textBaseline = 'middle';
    pen.lineJoin = 'round';
    const longest = new Map();
    for (const segment of this.#segments) {
      if (segment.named && segment.length_m > (longest.get(segment.street)?.length_m ?? 0)) longest.set(segment.street, segment);
    }
    const ordered = [...this.#segments].filter(s => s.named && (longest.get(s.street) === s || s.length_m * k > 320));
    for (const { street, length_m, line } of ordered.sort((a, b) => b.length_m - a.length_m)) {
      const wide = pen.measureText(street).width;
      if (wide > 0.95 * length_m * k) continue;
      const [x, y] = this.#viewport.toScreen(...pointAlong(line, 0.5));
      if (x < -50 || y < -50 || x > width + 50 || y > height + 50) continue;
      if (taken.some(([a, b, r]) => Math.hypot(a - x, b - y) < (r + wide) / 2)) continue;
      taken.push([x, y, wide]);
      const [[ax, ay], [bx, by]] = [pointAlong(line, 0.4), pointAlong(line, 0.6)];
      let turn = Math.atan2(-(by - ay), bx - ax);
      if (Math.abs(turn) > Math.PI / 2) turn += Math.PI;
      pen.save();
      pen.translate(x, y);
      pen.rotate(turn);
      pen.strokeStyle = this.#colours.halo;
      pen.lineWidth = 3;
      pen.strokeText(street, 0, 0);
      pen.fillStyle = this.#colours.ink;
      pen.fillText(street, 0, 0);
      pen.restore();
    }
  }

  #drawBase(pen) {
    const [x, y] = this.#viewport.toScreen(...this.#map.base_m);
    pen.beginPath();
    pen.arc(x, y, 8, 0, 2 * Math.PI);
    pen.fillStyle = this.#colours.base;
    pen.fill();
    pen.strokeStyle = this.#colours.halo;
    pen.lineWidth = 1.5;
    pen.stroke();
    pen.fillStyle = this.#colours.halo;
    pen.font = 'bold 10px system-ui, sans-serif';
    pen.textAlign = 'center';
    pen.textBaseline = 'middle';
    pen.fillText('H', x, y + 0.5);
  }

  #drawMoving() {
    const pen = this.#moving.getContext('2d');
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.clearRect(0, 0, this.#moving.width, this.#moving.height);
    this.#viewport.metres(pen);
    this.#drawChosen(pen);
    if (this.#mission) this.#drawMission(pen);
    this.#viewport.pixels(pen);
    if (!this.#mission) this.#drawNumbers(pen);
    if (this.#box) {
      const [x0, y0, x1, y1] = this.#box;
      pen.fillStyle = pen.strokeStyle = this.#colours.accent;
      pen.globalAlpha = 0.15;
      pen.fillRect(x0, y0, x1 - x0, y1 - y0);
      pen.globalAlpha = 1;
      pen.strokeRect(x0, y0, x1 - x0, y1 - y0);
    }
  }

  #drawChosen(pen) {
    const chosen = this.#selection.length ? this.#selection : this.#drawn, pixel = this.#viewport.pixel;
    const outline = (id, alpha, width) => {
      const segment = this.segment(id);
      if (!segment) return;
      pen.fillStyle = pen.strokeStyle = this.#colours.accent;
      pen.globalAlpha = alpha;
      pen.fill(segment.path, 'evenodd');
      pen.globalAlpha = 1;
      pen.lineWidth = width * pixel;
      pen.stroke(segment.path);
    };
    if (!this.#selection.length) pen.setLineDash([5 * pixel, 4 * pixel]);
    for (const id of chosen) outline(id, this.#mission ? 0.08 : 0.3, this.#mission ? 1 : 1.6);
    pen.setLineDash([]);
    if (this.#hovered && !chosen.includes(this.#hovered)) outline(this.#hovered, 0.18, 1.2);
  }

  #drawNumbers(pen) {
    const chosen = this.#selection.length ? this.#selection : this.#drawn;
    pen.font = 'bold 11px system-ui, sans-serif';
    pen.textAlign = 'center';
    pen.textBaseline = 'middle';
    chosen.forEach((id, number) => {
      const segment = this.segment(id);
      if (!segment) return;
      const [x, y] = this.#viewport.toScreen(...segment.middle);
      pen.beginPath();
      pen.arc(x, y, 9, 0, 2 * Math.PI);
      pen.fillStyle = this.#colours.accent;
      pen.fill();
      pen.fillStyle = this.#colours.halo;
      pen.fillText(number + 1, x, y + 0.5);
    });
  }

  #drawMission(pen) {
    drawMission(pen, this.#viewport, {
      flight: this.#flight, mission: this.#mission, parked: this.#parked, time: this.#time, defect: this.#defect,
      layers: this.layers, colours: this.#colours, surfaceOf: id => this.segment(id)?.path,
    });
  }

  // What the user does.

  #at(left, top) {
    const [x, y] = this.#viewport.toWorld(left, top), reach = NEAR_PX * this.#viewport.pixel;
    const pen = this.#moving.getContext('2d');
    pen.setTransform(1, 0, 0, 1, 0, 0);
    let best = null, nearest = reach;
    for (const segment of this.#segments) {
      const [west, south, east, north] = segment.box, room = reach + segment.width_m;
      if (x < west - room || x > east + room || y < south - room || y > north + room) continue;
      if (pen.isPointInPath(segment.path, x, y, 'evenodd')) return segment;
      const away = distance(segment.line, x, y) - segment.width_m / 2;
      if (away < nearest) [best, nearest] = [segment, away];
    }
    return best;
  }

  #defectAt(left, top) {
    if (!this.#mission || !this.layers.has('defects')) return null;
    const near = this.#mission.defects.map(defect => {
      const [x, y] = this.#viewport.toScreen(...defect.place_m);
      return [Math.hypot(x - left, y - top), defect];
    }).filter(([away]) => away < 8).sort((a, b) => a[0] - b[0]);
    return near.length ? near[0][1] : null;
  }

  #listen() {
    const canvas = this.#moving, place = event => {
      const { left, top } = canvas.getBoundingClientRect();
      return [event.clientX - left, event.clientY - top];
    };
    canvas.addEventListener('wheel', event => {
      event.preventDefault();
      if (this.view) this.zoom(1.0015 ** -event.deltaY, ...place(event));
    }, { passive: false });
    canvas.addEventListener('pointerdown', event => {
      if (event.button > 0 || !this.view) return;
      canvas.setPointerCapture(event.pointerId);
      this.#pointers.set(event.pointerId, place(event));
      this.#dragged = 0;
      if (this.#pointers.size === 1 && (event.shiftKey || this.boxing)) this.#box = [...place(event), ...place(event)];
      this.#root.classList.add('held');
    });
    canvas.addEventListener('pointermove', event => {
      const now = place(event), was = this.#pointers.get(event.pointerId);
      if (!this.view) return;
      if (was) this.#drag(event, was, now);
      else this.#hover(now);
    });
    for (const end of ['pointerup', 'pointercancel']) canvas.addEventListener(end, event => {
      const held = this.#pointers.delete(event.pointerId);
      this.#root.classList.toggle('held', this.#pointers.size > 0);
      if (!held || this.#pointers.size) return;
      const box = this.#box;
      this.#box = null;
      if (end === 'pointerup' && box && this.#dragged > DRAG_PX) this.#pickBox(box);
      else if (end === 'pointerup' && this.#dragged <= DRAG_PX) this.#click(place(event));
      this.redrawMoving();
    });
    canvas.addEventListener('pointerleave', () => this.#hover(null));
    canvas.addEventListener('dblclick', event => this.zoom(2, ...place(event)));
  }

  #drag(event, was, now) {
    this.#dragged += Math.hypot(now[0] - was[0], now[1] - was[1]);
    const other = [...this.#pointers].find(([key]) => key !== event.pointerId)?.[1];
    if (other) this.zoom(Math.hypot(now[0] - other[0], now[1] - other[1]) / Math.max(1, Math.hypot(was[0] - other[0], was[1] - other[1])), ...other);
    else if (this.#box) this.#box = [this.#box[0], this.#box[1], ...now];
    else if (this.#dragged > DRAG_PX) {
      if (this.following) {
        this.following = false;
        this.#events.free();
      }
      this.#viewport.drag(now[0] - was[0], now[1] - was[1]);
      this.redraw();
    }
    this.#pointers.set(event.pointerId, now);
    this.redrawMoving();
  }

  #hover(place) {
    const segment = place && this.#at(...place), defect = place && this.#defectAt(...place);
    this.#root.classList.toggle('over', Boolean(segment || defect));
    this.#events.hover(defect ? null : segment, defect, ...(place ?? [0, 0]));
    if ((segment?.id ?? null) === this.#hovered) return;
    this.#hovered = segment?.id ?? null;
    this.redrawMoving();
  }

  #click(place) {
    const defect = this.#defectAt(...place);
    if (defect) return this.#events.defect(defect.id);
    const segment = this.#at(...place);
    if (segment) this.#events.pick([segment.id], { toggle: true });
  }

  /** As a click on the middle of the map, for the keyboard. */
  clickMiddle() {
    const { width, height } = this.#viewport.size;
    if (this.view) this.#click([width / 2, height / 2]);
  }

  /** Pick all segments in view. */
  pickView() {
    const { width, height } = this.#viewport.size;
    if (this.view) this.#pickBox([0, 0, width, height]);
  }

  #pickBox([x0, y0, x1, y1]) {
    const [west, north] = this.#viewport.toWorld(Math.min(x0, x1), Math.min(y0, y1));
    const [east, south] = this.#viewport.toWorld(Math.max(x0, x1), Math.max(y0, y1));
    const inside = this.#segments.filter(({ middle: [x, y] }) => x > west && x < east && y > south && y < north);
    if (inside.length) this.#events.pick(inside.map(segment => segment.id), { toggle: false });
  }
}

/** The point a share of the way along a line of x, y in centimetres; in metres. */
export function pointAlong(line, share) {
  const lengths = [];
  let whole = 0;
  for (let i = 2; i < line.length; i += 2) lengths.push(whole += Math.hypot(line[i] - line[i - 2], line[i + 1] - line[i - 1]));
  const wanted = share * whole, leg = Math.max(0, lengths.findIndex(length => length >= wanted));
  const before = leg ? lengths[leg - 1] : 0, part = (wanted - before) / Math.max(1e-9, lengths[leg] - before), i = 2 * leg;
  return [line[i] + (line[i + 2] - line[i]) * part, line[i + 1] + (line[i + 3] - line[i + 1]) * part].map(each => each / 100);
}

function distance(line, x, y) {
  let nearest = Infinity;
  for (let i = 0; i + 3 < line.length; i += 2) {
    const [ax, ay, bx, by] = line.slice(i, i + 4).map(each => each / 100), [dx, dy] = [bx - ax, by - ay];
    const share = Math.min(1, Math.max(0, ((x - ax) * dx + (y - ay) * dy) / Math.max(1e-9, dx * dx + dy * dy)));
    nearest = Math.min(nearest, Math.hypot(x - ax - share * dx, y - ay - share * dy));
  }
  return nearest;
}
