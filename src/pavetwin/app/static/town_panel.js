// The panel with the town in 3-D: what it shows at a moment, from where, and the message where it cannot be drawn.

import { element } from './dom.js';
import { createTown } from './town.js';

const MODES = {
  orbit: ['Orbit', 'Turn the town by hand (1)'], follow: ['Follow', 'Behind the UAV (2)'], uav: ['UAV’s eye', 'What the camera sees (3)'],
  car: ['Car’s eye', 'From the driver’s seat of a vehicle that you click, or of the nearest (4)'],
};
/** Where a car is driven instead of a UAV flown. */
const DRIVEN = { follow: ['Follow', 'Behind the car (2)'], uav: ['Rear camera', 'View of the inspecting camera (3)'], car: ['Front camera', 'From the front bumper, or from the vehicle that you click (4)'] };
export const TOWN_MODES = Object.keys(MODES);
const LAYERS = { agents: 'traffic', parked: 'parked vehicles', uav: 'UAV', objects: 'trees and street furniture', defects: 'outlines of defects' };
/** The car that somebody drives, among the agents. */
const OWN = 'own car', PAINT = [0.75, 0.36, 0.02];
const AT_FIRST = ['agents', 'parked', 'uav', 'objects'];
const KINDS = { van: 'van', truck: 'truck', bus: 'bus', motorcycle: 'motorcycle' };
/** Above this time of a frame the camera's view is not drawn in 3-D where another follows soon: it takes a second frame. */
const QUICK_MS = 12;
/** The models and streets of a town are made for its first visit, which takes longer than this. */
const LONG_MS = 4000, LONG = 'The town is being drawn … The first time takes about a minute, to make models and streets. Map and missions do not wait for it.';
const AWAY_M = 90, BEHIND = { back_m: 9, up_m: 4 };

export class TownPanel {
  #root; #empty; #loading; #onDefect; #buttons = new Map(); #layers = new Set(AT_FIRST); #town = null; #mode = 'orbit'; #car = null;
  #flight = null; #mission = null; #parked = []; #time = 0; #world = null;
  /** Called once all tiles in view are loaded. */
  onSettled = () => {};
  /** Whether something is made that is waited for, which a picture by the processor would hold up. */
  isBusy = () => false;

  constructor(root, onDefect) {
    this.#root = root;
    this.#empty = root.querySelector('.empty');
    this.#loading = root.querySelector('.loading');
    this.#onDefect = onDefect;
    const modes = root.querySelector('[role="radiogroup"]');
    for (const [mode, [words, title]] of Object.entries(MODES)) {
      const button = element('button', { type: 'button', title }, words);
      button.setAttribute('role', 'radio');
      button.addEventListener('click', () => this.setMode(mode));
      modes.append(button);
      this.#buttons.set(mode, button);
    }
    root.querySelector('ul').append(...Object.entries(LAYERS).map(([layer, words]) => {
      const check = element('input', { type: 'checkbox', checked: this.#layers.has(layer) });
      check.addEventListener('change', () => { this.#layers[check.checked ? 'add' : 'delete'](layer); this.#show(); });
      return element('li', {}, element('label', {}, check, words));
    }));
    new ResizeObserver(() => this.#town?.resize()).observe(root);
    this.#tellMode();
  }

  get town() { return this.#town; }
  get isShown() { return !this.#root.hidden; }

  /** Show or hide the panel. A hidden one loads and draws nothing. */
  show(on) {
    this.#root.hidden = !on;
    this.#town?.hold(!on);
    this.#open();
  }

  /** The town of a world by its id, without a flight. */
  setWorld(id) {
    this.#world = id;
    this.setFlight(null, null);
    this.#open();
  }

  setFlight(flight, mission) {
    const isFirst = mission && !this.#mission;
    if (flight !== this.#flight) {
      this.#car = mission?.car ? OWN : null;
      this.#town?.forgetAgents();
    }
    this.#flight = flight;
    this.#mission = mission;
    this.#parked = mission ? parkedVehicles(mission.parked) : [];
    if (isFirst && this.#mode === 'orbit') this.#mode = 'follow';
    if (!mission) this.#mode = 'orbit';
    this.#tellMode();
    this.#show();
  }

  setTime(t) {
    this.#time = t;
    this.#draw();
  }

  /** `orbit`, or `follow`, `uav` and `car` once a mission is flown. */
  setMode(mode) {
    if (!this.#mission && mode !== 'orbit') return;
    if (mode === 'orbit' && this.#mode !== 'orbit') {
      const { x, y } = this.#mission.at(this.#time);
      this.#town?.lookAt(x, y, AWAY_M);
    }
    this.#mode = mode;
    this.#tellMode();
    this.#show();
  }

  /**
   * Draw what the UAV's camera sees at the moment into a rectangle of a 2D context, [left, top, width, height].
   * Returns whether it could; what is seen only briefly is not drawn where that takes long.
   */
  drawDown(pen, box, now, isBrief) {
    if (!this.#town?.available || !this.isShown || !this.#mission || now.altitude < 1) return false;
    const { pending, frame_ms: took } = this.#town.stats();
    if (pending || (isBrief && took > QUICK_MS)) return false;
    const { footprint_m: [, along], altitude_m: altitude } = this.#mission;
    return this.#town.drawDown(pen, box, { x: now.x, y: now.y, z: now.altitude, yaw: now.yaw }, 2 * Math.atan(along / 2 / altitude) * 180 / Math.PI);
  }

  /** Look at a place, where the camera is turned by hand. */
  showPlace(x, y) {
    if (this.#mode === 'orbit') this.#town?.lookAt(x, y, 25);
  }

  /** Load the world that is to be shown, once the panel is shown. */
  #open() {
    if (!this.isShown || this.#world === null || this.#town?.world === this.#world) return;
    this.#close();
    this.#showMessage('The town is being drawn …');
    setTimeout(() => { if (this.#town === town && this.#empty.textContent === 'The town is being drawn …') this.#showMessage(LONG); }, LONG_MS);
    const town = this.#town = createTown(this.#root.querySelector('canvas'), {
      base: `town/${this.#world}/`, onMessage: text => this.#showMessage(text), onPick: pick => this.#picked(pick), onSettled: () => this.onSettled(),
      onMissing: count => this.#tellLoading(count), isBusy: () => this.isBusy(),
    });
    town.world = this.#world;
    if (!town.available) return this.#showMessage(town.message);
    town.ready.then(isShown => {
      if (this.#town !== town || !isShown) return;
      this.#showMessage(town.message);
      this.#show();
    });
    this.#show();
  }

  /** End what is drawn; the next town gets a canvas of its own. */
  #close() {
    if (!this.#town) return;
    this.#town.dispose();
    this.#town = null;
    this.#tellLoading(0);
    const canvas = this.#root.querySelector('canvas');
    canvas.getContext('webgl2')?.getExtension('WEBGL_lose_context')?.loseContext();
    canvas.replaceWith(canvas.cloneNode());
  }

  /** What stands in place of the town. */
  message(words) { this.#showMessage(words); }

  #showMessage(words) {
    this.#empty.textContent = words;
    this.#empty.hidden = !words;
    const isDrawn = this.#town?.available !== false;
    for (const part of this.#root.querySelectorAll('canvas, .tools')) part.hidden = !isDrawn;
  }

  #tellLoading(count) {
    this.#loading.hidden = !count;
    this.#loading.textContent = `${count} tile${count === 1 ? '' : 's'} still loading`;
  }

  #tellMode() {
    for (const [mode, button] of this.#buttons) {
      const [words, title] = (this.#mission?.car && DRIVEN[mode]) || MODES[mode];
      Object.assign(button, { textContent: words, title });
      button.disabled = !this.#mission && mode !== 'orbit';
      button.setAttribute('aria-checked', mode === this.#mode);
    }
  }

  /** All that does not change with the time alone, and then the moment. */
  #show() {
    if (!this.#town) return;
    const has = layer => this.#layers.has(layer);
    this.#town.setLayers({ agents: has('agents') || has('parked') || Boolean(this.#mission?.car), uav: has('uav') && !this.#mission?.car, objects: has('objects'), defects: has('defects') });
    this.#setCamera();
    this.#draw();
  }

  #setCamera() {
    const options = { agent: this.#car, ...BEHIND }, front = this.#mission?.car?.front;
    if (this.#mode === 'car' && this.#car === OWN) Object.assign(options, { eye: front, fov_deg: front.fov_deg });
    if (this.#mode === 'uav') {
      const { footprint_m, altitude_m } = this.#mission;
      options.fov_deg = 2 * Math.atan(footprint_m[1] / 2 / altitude_m) * 180 / Math.PI;
    }
    this.#town.setCamera(this.#mode, options);
  }

  #draw() {
    if (!this.#town || !this.isShown) return;
    if (!this.#mission) {
      this.#town.setAgents([]);
      this.#town.setUav(null);
      return;
    }
    const now = this.#mission.at(this.#time), moving = this.#flight.agentsAt(this.#time).filter(({ group }) => group !== 'aircraft');
    const { car } = this.#mission, own = car ? [{ ...car, id: OWN, x: now.x, y: now.y, yaw: now.yaw, model: 'hatchback', tints: [PAINT] }] : [];
    const agents = [...this.#layers.has('agents') ? moving.map(asAgent) : [], ...own], parked = this.#layers.has('parked') ? this.#parked : [];
    if (this.#mode === 'car' && !agents.some(({ id }) => id === this.#car)) {
      this.#car = nearest(agents, now);
      this.#setCamera();
    }
    this.#town.setAgents([...agents, ...parked]);
    const { x, y } = this.#mode === 'uav' ? this.#mission.cameraOf(now) : now, z = car && this.#mode !== 'uav' ? 0 : now.altitude;
    this.#town.setUav({ x, y, z, yaw: now.yaw, pitch: -Math.PI / 2 });
  }

  #picked({ agent, defect }) {
    const isMoving = this.#flight && typeof agent === 'number';
    if (isMoving) {
      this.#car = agent;
      this.setMode('car');
    } else if (defect !== null && this.#mission) this.#onDefect(defect);
  }
}

function asAgent({ agent, x, y, yaw, length, width, height, group }) {
  return { id: agent, x, y, yaw, length_m: length, width_m: width, height_m: height, pedestrian: group === 'pedestrian', kind: KINDS[group] };
}

function parkedVehicles(parked) {
  return parked.x_m.map((x, i) => ({
    id: `parked ${i}`, x, y: parked.y_m[i], yaw: parked.yaw_rad[i], moving: false,
    length_m: parked.length_m[i], width_m: parked.width_m[i], height_m: parked.height_m[i],
  }));
}

/** The vehicle next to a place; null where there is none. */
function nearest(agents, { x, y }) {
  let found = null, least = Infinity;
  for (const agent of agents) {
    const away = Math.hypot(agent.x - x, agent.y - y);
    if (agent.pedestrian || away >= least) continue;
    [found, least] = [agent.id, away];
  }
  return found;
}
