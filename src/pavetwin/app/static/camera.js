// What the camera covers at a moment, from above and in the camera's own orientation: the image's rows run along the track.

import { drawBoxes, frameLine } from './frames.js';
import { clockTenths } from './playback.js';
import { drawAgents, drawDefect, drawTown, drawUav, parkedAgents, rectangle, townPaths } from './shapes.js';
import { visibilityColour } from './theme.js';

export class Camera {
  #root; #canvas; #readings; #doing; #map = null; #paths = null; #colours = null; #flight = null; #mission = null; #parked = [];
  #time = 0; #cells = new Map(); #frames = null; #shown; #town = null; #rate = 0;

  constructor(root) {
    this.#root = root;
    this.#canvas = root.querySelector('canvas');
    this.#readings = root.querySelector('#readings');
    this.#doing = root.querySelector('#doing');
    this.#shown = root.querySelector('#shown');
    for (const name of ['labels', 'search']) root.querySelector(`[name="${name}"]`)?.addEventListener('change', () => this.#want());
    for (const name of ['time', 'speed', 'height', 'battery', 'visibility o']) {
      const cell = document.createElement('div'), term = document.createElement('dt'), value = document.createElement('dd');
      term.textContent = name;
      cell.append(term, value);
      this.#readings.append(cell);
      this.#cells.set(name, value);
    }
    new ResizeObserver(() => this.#draw()).observe(this.#canvas);
    this.setFlight(null, null);
  }

  setWorld(map) { this.#map = map; this.#paths = townPaths(map); this.setFlight(null, null); }
  setColours(colours) { this.#colours = colours; this.#draw(); }

  /** Show the rendered frames of captures where they are ready. */
  setFrames(frames) {
    this.#frames = frames;
    frames.listen(() => this.#draw());
  }

  /** Show the town in 3-D, where that is drawn, until a rendered frame is ready. */
  setTown(town) {
    this.#town = town;
    town.onSettled = () => this.#draw();
    town.isBusy = () => this.#frames?.isSoon ?? false;
  }

  setFlight(flight, mission) {
    this.#frames?.setMission(flight, mission?.isLive || mission?.car ? null : mission);
    this.#flight = flight;
    this.#mission = mission;
    this.#parked = mission ? parkedAgents(mission.parked) : [];
    this.#root.querySelector('.empty').hidden = Boolean(mission);
    this.#canvas.hidden = this.#readings.hidden = this.#shown.parentElement.hidden = !mission;
    this.#doing.textContent = '';
    this.#draw();
  }

  /** @param rate how many seconds of the mission pass in a second; 0 while it stands */
  setTime(t, rate = 0) {
    this.#time = t;
    this.#rate = rate;
    this.#frames?.want(t, rate, this.#checked('search'));
    this.#draw();
  }

  #want() {
    this.setTime(this.#time);
  }

  /** The rendered frame that is shown, if any. */
  get frame() { return this.#frames?.at(this.#time) ?? null; }

  /** Whether a box is ticked; it is not there where no server renders frames. */
  #checked(name) { return this.#root.querySelector(`[name="${name}"]`)?.checked ?? false; }

  #draw() {
    if (!this.#mission || !this.#colours || !this.#map || !this.#canvas.clientWidth) return;
    const now = this.#mission.cameraOf(this.#mission.at(this.#time)), colours = this.#colours;
    this.#report(now);
    const ratio = devicePixelRatio || 1, width = this.#canvas.clientWidth, height = this.#canvas.clientHeight;
    if (this.#canvas.width !== Math.round(width * ratio) || this.#canvas.height !== Math.round(height * ratio)) {
      this.#canvas.width = Math.round(width * ratio);
      this.#canvas.height = Math.round(height * ratio);
    }
    const pen = this.#canvas.getContext('2d'), share = Math.max(0.05, now.altitude / this.#mission.altitude_m);
    const [across, along] = this.#mission.footprint_m.map(side => side * share);
    const k = Math.min(width / across, height / along) * 0.97;
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.fillStyle = colours.ground;
    pen.fillRect(0, 0, width, height);
    const frame = this.#frames?.at(this.#time) ?? null, isLabelled = this.#checked('labels');
    const box = [(width - across * k) / 2, (height - along * k) / 2, across * k, along * k];
    const is3d = !frame && (this.#town?.drawDown(pen, box, now, this.#rate > 0 || Boolean(this.#frames?.isSoon)) ?? false);
    this.#shown.textContent = frameLine(this.#frames, frame, isLabelled, is3d);
    if (frame) return this.#drawFrame(pen, frame, width, height, isLabelled);
    if (is3d) return this.#drawWindow(pen, box, now);
    pen.translate(width / 2, height / 2);
    pen.scale(k, -k);
    pen.rotate(Math.PI / 2 - now.yaw);
    pen.translate(-now.x, -now.y);
    drawTown(pen, this.#paths, colours, { pixel: 1 / k, trees: this.#map.trees, layers: new Set(['buildings', 'trees']) });
    for (const defect of this.#mission.defects) {
      const radius = Math.max(6 / k, Math.min(1, Math.sqrt(defect.area_m2) / 2));
      drawDefect(pen, ...defect.place_m, radius, this.#mission.outcomeAt(defect, this.#time), colours);
    }
    drawAgents(pen, this.#parked, colours, 0);
    drawAgents(pen, this.#flight.agentsAt(this.#time), colours, 0);
    this.#frame(pen, now, across, along, k);
  }

  /** The rendered frame of a capture with boxes, and the inspection window in the colour of o at that capture. */
  #drawFrame(pen, frame, width, height, isLabelled) {
    const { naturalWidth, naturalHeight } = frame.image, scale = Math.min(width / naturalWidth, height / naturalHeight);
    const [wide, high] = [naturalWidth * scale, naturalHeight * scale], [left, top] = [(width - wide) / 2, (height - high) / 2];
    pen.drawImage(frame.image, left, top, wide, high);
    const shares = this.#mission.window_m.map((side, at) => side / this.#mission.footprint_m[at]);
    const window = [left + wide * (1 - shares[0]) / 2, top + high * (1 - shares[1]) / 2, wide * shares[0], high * shares[1]];
    pen.strokeStyle = visibilityColour(this.#colours, this.#mission.captures.visibility[frame.capture]);
    pen.lineWidth = 2;
    pen.strokeRect(...window);
    drawBoxes(pen, frame, [left, top, wide, high], isLabelled);
  }

  /** The inspection window over what is drawn of the town in 3-D. */
  #drawWindow(pen, [left, top, width, height], now) {
    if (now.visibility === null) return;
    const [wide, high] = this.#mission.window_m.map((side, at) => [width, height][at] * side / this.#mission.footprint_m[at]);
    pen.strokeStyle = visibilityColour(this.#colours, now.visibility);
    pen.lineWidth = 2;
    pen.strokeRect(left + (width - wide) / 2, top + (height - high) / 2, wide, high);
  }

  #frame(pen, now, across, along, k) {
    const footprint = new Path2D(), around = new Path2D(), [wide, deep] = this.#mission.window_m;
    rectangle(around, now.x, now.y, now.yaw, 20 * along, 20 * across);
    rectangle(footprint, now.x, now.y, now.yaw, along, across);
    around.addPath(footprint);
    pen.fillStyle = this.#colours.ground;
    pen.globalAlpha = 0.8;
    pen.fill(around, 'evenodd');
    pen.globalAlpha = 1;
    if (now.visibility === null && !this.#mission.car) {
      drawUav(pen, now.x, now.y, now.yaw, 26 / k, this.#colours.uav, this.#colours.halo);
      return;
    }
    if (now.visibility === null) return;
    const window = new Path2D();
    rectangle(window, now.x, now.y, now.yaw, deep, wide);
    pen.strokeStyle = this.#colours.halo;
    pen.lineWidth = 5 / k;
    pen.stroke(window);
    pen.strokeStyle = visibilityColour(this.#colours, now.visibility);
    pen.lineWidth = 3 / k;
    pen.stroke(window);
  }

  #report(now) {
    const values = {
      time: clockTenths(this.#time),
      speed: `${now.speed.toFixed(1)} m/s`,
      height: `${now.altitude.toFixed(1)} m`,
      battery: now.battery === null ? '–' : `${Math.round(100 * now.battery)} %`,
      'visibility o': now.visibility === null ? '–' : now.visibility.toFixed(2),
    };
    for (const [name, text] of Object.entries(values)) this.#cells.get(name).textContent = text;
    this.#doing.textContent = now.mode.words;
    this.#canvas.setAttribute('aria-label', `Area that the camera covers, from above: the ${this.#mission.car ? 'car' : 'UAV'} ${now.mode.words}, visibility ${values['visibility o']}`);
  }
}
