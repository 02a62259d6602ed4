// The map: the town on a canvas that is drawn again when the view changes, and above it what moves and what is chosen.

import { drawAgents, drawCar, drawDefect, drawTown, drawUav, parkedAgents, pathOf, rectangle, townPaths } from './shapes.js';
import { visibilityColour } from './theme.js';

const TOOLS_PX = 44; // Of the map below its buttons.
const CLOSEST = 60, DRAG_PX = 4, NEAR_PX = 12;

export class StreetMap {
  #root; #still; #moving; #events; #view = null; #map = null; #paths = null; #colours = null; #segments = [];
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
    new ResizeObserver(() => this.#resize()).observe(root);
    this.#listen();
  }

  get view() { return this.#view; }

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
    if (this.following && this.#mission && this.#view) {
      const { x, y } = this.#mission.at(t);
      if (Math.hypot(x - this.#view.x, y - this.#view.y) > 1e-3) {
        this.#view = { ...this.#view, x, y };
        this.redraw();
        return;
      }
    }
    this.redrawMoving();
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
  screenOf(id) { return this.#toScreen(...this.segment(id).middle); }

  fit() {
    if (!this.#map) return;
    const [west, south, east, north] = this.#map.bounds_m, { height } = this.#size();
    this.show(west, south, east, north + (north - south) * TOOLS_PX / Math.max(1, height - TOOLS_PX), 1);
  }

  /** Show an area. */
  show(west, south, east, north, margin = 1.25) {
    const { width, height } = this.#size();
    const k = Math.min(CLOSEST, Math.min(width / (east - west), height / (north - south)) / margin);
    this.#view = { x: (west + east) / 2, y: (south + north) / 2, k };
    this.redraw();
  }

  showPlace(x, y, k = 12) {
    this.#view = { x, y, k: Math.max(this.#view?.k ?? k, k) };
    this.redraw();
  }

  zoom(factor, x, y) {
    const { width, height } = this.#size(), [left, top] = [x ?? width / 2, y ?? height / 2];
    const [mx, my] = this.#toWorld(left, top), k = Math.min(CLOSEST, Math.max(0.02, this.#view.k * factor));
    this.#view = { k, x: mx - (left - width / 2) / k, y: my + (top - height / 2) / k };
    this.redraw();
  }

  move(right, up) {
    const { width, height } = this.#size();
    this.#view = { ...this.#view, x: this.#view.x + right * width / this.#view.k, y: this.#view.y + up * height / this.#view.k };
    this.redraw();
  }

  redraw() { this.#pending.still = true; this.redrawMoving(); }

  redrawMoving() {
    if (this.#pending.moving) return;
    this.#pending.moving = true;
    requestAnimationFrame(() => {
      this.#pending.moving = false;
      if (!this.#view || !this.#colours || !this.#map) return;
      if (this.#pending.still) {
        this.#pending.still = false;
        this.#drawStill();
        this.#events.view();
      }
      this.#drawMoving();
    });
  }

  // Drawing.

  #size() { return { width: this.#root.clientWidth || 1, height: this.#root.clientHeight || 1 }; }

  #resize() {
    const { width, height } = this.#size(), ratio = devicePixelRatio || 1;
    for (const canvas of [this.#still, this.#moving]) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    if (!this.#view) this.fit();
    this.redraw();
  }

  #metres(pen) {
    const { width, height } = this.#size(), ratio = devicePixelRatio || 1, { x, y, k } = this.#view;
    pen.setTransform(k * ratio, 0, 0, -k * ratio, (width / 2 - x * k) * ratio, (height / 2 + y * k) * ratio);
  }

  #pixels(pen) { const ratio = devicePixelRatio || 1; pen.setTransform(ratio, 0, 0, ratio, 0, 0); }

  #toScreen(x, y) {
    const { width, height } = this.#size(), { x: cx, y: cy, k } = this.#view;
    return [width / 2 + (x - cx) * k, height / 2 - (y - cy) * k];
  }

  #toWorld(left, top) {
    const { width, height } = this.#size(), { x, y, k } = this.#view;
    return [x + (left - width / 2) / k, y - (top - height / 2) / k];
  }

  #drawStill() {
    const pen = this.#still.getContext('2d'), colours = this.#colours;
    this.#pixels(pen);
    pen.fillStyle = colours.ground;
    pen.fillRect(0, 0, this.#still.width, this.#still.height);
    this.#metres(pen);
    drawTown(pen, this.#paths, colours, { pixel: 1 / this.#view.k, trees: this.#map.trees, layers: this.layers });
    this.#pixels(pen);
    if (this.layers.has('names')) this.#drawNames(pen);
    this.#drawBase(pen);
  }

  #drawNames(pen) {
    const { k } = this.#view, { width, height } = this.#size(), size = Math.max(9, Math.min(14, 6 * k)), taken = [];
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
      const [x, y] = this.#toScreen(...pointAlong(line, 0.5));
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
    const [x, y] = this.#toScreen(...this.#map.base_m);
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
    this.#metres(pen);
    this.#drawChosen(pen);
    if (this.#mission) this.#drawMission(pen);
    this.#pixels(pen);
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
    const chosen = this.#selection.length ? this.#selection : this.#drawn, pixel = 1 / this.#view.k;
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
      const [x, y] = this.#toScreen(...segment.middle);
      pen.beginPath();
      pen.arc(x, y, 9, 0, 2 * Math.PI);
      pen.fillStyle = this.#colours.accent;
      pen.fill();
      pen.fillStyle = this.#colours.halo;
      pen.fillText(number + 1, x, y + 0.5);
    });
  }

  #drawMission(pen) {
    const { k } = this.#view, pixel = 1 / k, mission = this.#mission, t = this.#time, now = mission.at(t), c = this.#colours;
    const { layers } = this;
    if (layers.has('windows')) this.#drawWindows(pen, mission, now.captures);
    if (layers.has('route')) this.#drawRoute(pen, mission, now);
    if (layers.has('parked')) drawAgents(pen, this.#parked, c, 1.5 * pixel);
    if (layers.has('traffic')) drawAgents(pen, this.#flight.agentsAt(t), c, 3.2 * pixel);
    this.#pixels(pen);
    if (layers.has('defects')) {
      const radius = Math.max(2.6, Math.min(6, 0.5 * k));
      for (const defect of mission.defects) {
        const [x, y] = this.#toScreen(...defect.place_m), is = mission.outcomeAt(defect, t);
        drawDefect(pen, x, y, defect.id === this.#defect ? radius * 1.5 : radius, is, c);
        if (defect.id === this.#defect) {
          pen.beginPath();
          pen.arc(x, y, radius * 2.4, 0, 2 * Math.PI);
          pen.strokeStyle = c.accent;
          pen.lineWidth = 2;
          pen.stroke();
        }
      }
    }
    this.#drawReactions(pen, mission, t);
    this.#metres(pen);
    const others = this.#flight.missions.filter(other => other !== mission);
    for (const other of [...others, mission]) {
      const state = other.at(Math.min(t, other.duration_s)), { x, y, yaw, visibility } = state, eye = other.cameraOf(state);
      const size = Math.max(1.9, 17 * pixel), several = this.#flight.missions.length > 1;
      if (other === mission && visibility !== null) {
        const path = new Path2D();
        rectangle(path, eye.x, eye.y, yaw, mission.window_m[1], mission.window_m[0]);
        for (const [colour, width] of [[c.halo, 4.5], [visibilityColour(c, visibility), 2.6]]) {
          pen.strokeStyle = colour;
          pen.lineWidth = width * pixel;
          pen.stroke(path);
        }
      }
      pen.globalAlpha = other === mission ? 1 : 0.65;
      if (other.car) drawCar(pen, x, y, yaw, other.car, pixel, c.uav, c.halo);
      else drawUav(pen, x, y, yaw, size, several ? c.policies[other.policy] ?? c.uav : c.uav, c.halo);
      pen.globalAlpha = 1;
    }
  }

  #drawWindows(pen, mission, count) {
    const { x_m, y_m, yaw_rad } = mission.captures, [across, along] = mission.window_m, path = new Path2D();
    for (let i = 0; i < count; i++) rectangle(path, x_m[i], y_m[i], yaw_rad[i], along, across);
    pen.save();
    const inside = new Path2D();
    for (const id of mission.targets) if (this.segment(id)) inside.addPath(this.segment(id).path);
    pen.clip(inside, 'evenodd');
    pen.fillStyle = this.#colours.seen;
    pen.globalAlpha = 0.75;
    pen.fill(path);
    pen.restore();
  }

  #drawRoute(pen, mission, now) {
    const { x_m, y_m, visibility } = mission.track, pixel = 1 / this.#view.k, c = this.#colours;
    pen.lineCap = 'round';
    pen.lineJoin = 'round';
    let from = 0;
    const isSeen = i => visibility[i] !== null, shade = i => (isSeen(i) ? visibilityColour(c, visibility[i]) : null);
    for (let i = 1; i <= now.row + 1; i++) {
      if (i <= now.row && shade(i) === shade(from)) continue;
      pen.beginPath();
      pen.moveTo(x_m[from], y_m[from]);
      for (let j = from + 1; j <= Math.min(i, now.row); j++) pen.lineTo(x_m[j], y_m[j]);
      if (i > now.row) pen.lineTo(now.x, now.y);
      pen.strokeStyle = shade(from) ?? c.ink;
      pen.lineWidth = (isSeen(from) ? 2.6 : 1) * pixel;
      pen.globalAlpha = isSeen(from) ? 1 : 0.55;
      pen.stroke();
      from = i;
    }
    pen.globalAlpha = 1;
    pen.lineCap = 'butt';
  }

  #drawReactions(pen, mission, t) {
    for (const event of mission.events) {
      if (event.t_s > t) break;
      const colour = { wait: 'wait', displace: 'displace', revisit: 'revisit', battery: 'battery' }[event.kind];
      if (!colour || !event.place_m) continue;
      const [x, y] = this.#toScreen(...event.place_m);
      pen.beginPath();
      pen.arc(x, y, 6, 0, 2 * Math.PI);
      pen.strokeStyle = this.#colours[colour];
      pen.lineWidth = 1.6;
      pen.stroke();
      pen.globalAlpha = 0.2;
      pen.fillStyle = this.#colours[colour];
      pen.fill();
      pen.globalAlpha = 1;
    }
  }

  // What the user does.

  #at(left, top) {
    const [x, y] = this.#toWorld(left, top), reach = NEAR_PX / this.#view.k, pen = this.#moving.getContext('2d');
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
      const [x, y] = this.#toScreen(...defect.place_m);
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
      if (this.#view) this.zoom(1.0015 ** -event.deltaY, ...place(event));
    }, { passive: false });
    canvas.addEventListener('pointerdown', event => {
      if (event.button > 0 || !this.#view) return;
      canvas.setPointerCapture(event.pointerId);
      this.#pointers.set(event.pointerId, place(event));
      this.#dragged = 0;
      if (this.#pointers.size === 1 && (event.shiftKey || this.boxing)) this.#box = [...place(event), ...place(event)];
      this.#root.classList.add('held');
    });
    canvas.addEventListener('pointermove', event => {
      const now = place(event), was = this.#pointers.get(event.pointerId);
      if (!this.#view) return;
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
      const { k } = this.#view;
      this.#view = { ...this.#view, x: this.#view.x - (now[0] - was[0]) / k, y: this.#view.y + (now[1] - was[1]) / k };
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
    const { width, height } = this.#size();
    if (this.#view) this.#click([width / 2, height / 2]);
  }

  /** Pick all segments in view. */
  pickView() {
    const { width, height } = this.#size();
    if (this.#view) this.#pickBox([0, 0, width, height]);
  }

  #pickBox([x0, y0, x1, y1]) {
    const [west, north] = this.#toWorld(Math.min(x0, x1), Math.min(y0, y1));
    const [east, south] = this.#toWorld(Math.max(x0, x1), Math.max(y0, y1));
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
