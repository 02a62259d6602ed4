// The rendered frames of captures: asked for by the moment that is shown, the next ones ahead, and drawn with boxes.

import { clock, lastUpTo } from './playback.js';
import { CancelledError } from './server.js';

/** Seconds: a capture farther from a moment does not show it. */
const NEAR_S = 2;

/** Frames that are made ahead, and those that stay in memory. */
const AHEAD = 4, KEPT = 48;

/** Of boxes, on any pavement: labels of the ground truth, what the mission's sensor reported, what a search found. */
const COLOURS = { label: '#ffd84d', confirmed: '#4be08a', duplicate: '#4be08a', false_alarm: '#ff6b57', ignored: '#c9c9c9', search: '#5cc8ff' };

export class Frames {
  #listeners = []; #also = [];
  #tasks; #flight = null; #mission = null; #ready = new Map(); #wanted = null; #asked = null; #took = 1; #search = false;
  /** Why no frame can be rendered of this mission, if so. */
  failure = '';

  constructor(tasks) { this.#tasks = tasks; }

  /** @param told that a frame is ready, or that none can be */
  listen(told) { this.#listeners.push(told); }

  /** Captures whose frames are asked for beside that of the moment, such as those of a defect. */
  wantAlso(captures) {
    this.#also = captures;
    this.#next();
  }

  /** The frame of a capture, if it is ready. */
  frameOf(capture) { return this.#mission ? this.#known(capture) : undefined; }

  setMission(flight, mission) {
    if (this.#flight !== flight) this.#ready.clear();
    this.#flight = flight;
    this.#mission = mission;
    this.#wanted = this.#asked = null;
    this.#also = [];
    this.failure = '';
  }

  /** The capture nearest to a moment; -1 where none is near. */
  nearest(t) {
    const times = this.#mission?.captures.t_s ?? [], before = lastUpTo(times, t), gap = i => Math.abs((times[i] ?? Infinity) - t);
    const found = gap(before) <= gap(before + 1) ? before : before + 1;
    return gap(found) <= NEAR_S ? found : -1;
  }

  /** The frame that shows a moment: of the nearest capture, or while that is rendered of the nearest one that is ready. */
  at(t) {
    const times = this.#mission?.captures.t_s ?? [], nearest = this.nearest(t);
    for (let away = 0; nearest >= 0 && away < times.length; away++) {
      const around = [nearest - away, nearest + away].filter(i => i >= 0 && i < times.length && Math.abs(times[i] - t) <= NEAR_S);
      if (!around.length) return null;
      for (const capture of around) if (this.#known(capture)) return this.#known(capture);
    }
    return null;
  }

  /** Ask for the frame of a moment; while time passes, for that of the moment at which it will be ready. */
  want(t, rate, search) {
    if (!this.#mission || this.failure) return;
    this.#search = search;
    const lead = rate * this.#took, last = this.#mission.captures.t_s.length - 1;
    const capture = this.nearest(Math.min(t + lead, this.#mission.captures.t_s[last] ?? 0));
    this.#wanted = capture < 0 ? this.nearest(t) : capture;
    if (this.#asked?.capture !== this.#wanted) this.#next(rate > 0);
  }

  /** Ask for what is wanted, or else for the first of the others and of the next captures that is not there yet.
   * Before it asks for another one while time passes it waits for the one before: dropping each would leave none. */
  #next(isPlaying = false) {
    if (!this.#mission || this.failure || (isPlaying && this.#asked !== null)) return;
    const count = this.#mission.captures.t_s.length, now = this.#wanted ?? -1;
    const isMissing = capture => capture < count && !this.#known(capture, this.#search);
    const ahead = now < 0 ? [] : [...Array(AHEAD + 1).keys()].map(i => now + i);
    const capture = [...ahead.slice(0, 1), ...this.#also, ...ahead].find(isMissing);
    if (capture !== undefined && capture !== this.#asked?.capture && (capture === this.#wanted || this.#asked === null)) this.#ask(capture);
  }

  async #ask(capture) {
    const mission = this.#mission, flight = this.#flight, search = this.#search, begun = performance.now();
    const asked = this.#asked = { capture };
    try {
      const frame = { do: 'frame', key: flight.key, mission: flight.missions.indexOf(mission), capture, search };
      const { jpeg, ...values } = await this.#tasks.ask(frame).promise;
      const image = new Image();
      image.src = `data:image/jpeg;base64,${jpeg}`;
      await image.decode();
      if (flight === this.#flight) this.#keep(this.#name(mission, capture), { ...values, image, capture, time: mission.captures.t_s[capture] });
      this.#took += 0.3 * ((performance.now() - begun) / 1000 - this.#took);
    } catch (error) {
      if (!(error instanceof CancelledError) && mission === this.#mission) this.failure = error.message;
    }
    const isLatest = this.#asked === asked;
    if (isLatest) this.#asked = null;
    for (const told of this.#listeners) told();
    if (isLatest) this.#next();
  }

  #name(mission, capture) { return `${this.#flight.missions.indexOf(mission)}/${capture}`; }

  #keep(name, frame) {
    this.#ready.delete(name);
    this.#ready.set(name, frame);
    if (this.#ready.size > KEPT) this.#ready.delete(this.#ready.keys().next().value);
  }

  #known(capture, isSearched = false) {
    const frame = this.#ready.get(this.#name(this.#mission, capture));
    return isSearched && !frame?.searched ? undefined : frame;
  }
}

/** What the panel shows, in words. */
export function frameLine(frames, frame, isLabelled, is3d = false) {
  if (!frame) return `Drawn ${is3d ? 'in 3-D' : 'from the map'}.${frames?.failure ? ` ${frames.failure}` : ''}`;
  const count = (number, what) => `${number} ${what}${number === 1 ? '' : 's'}`, told = [`Rendered: capture ${frame.capture}, ${clock(frame.time)}`];
  if (isLabelled) told.push(count(frame.labels.length, 'label'));
  if (frame.detections.length) told.push(`${count(frame.detections.length, 'detection')} of the sensor '${frame.sensor}'`);
  if (frame.searched) told.push(`${count(frame.searched.length, 'box').replace('boxs', 'boxes')} of the shipped detector`);
  return `${told.join(' · ')}.`;
}

/** Boxes over a frame that is drawn at [left, top, width, height]. */
export function drawBoxes(pen, frame, [left, top, width, height], isLabelled) {
  const boxes = isLabelled ? frame.labels.map(label => ({ ...label, colour: COLOURS.label, words: label.class })) : [];
  const told = ({ class: kind, confidence }) => `${kind} ${Math.round(100 * confidence)} %`;
  boxes.push(...frame.detections.map(each => ({ ...each, colour: COLOURS[each.outcome], words: told(each), isDashed: true })));
  boxes.push(...(frame.searched ?? []).map(each => ({ ...each, colour: COLOURS.search, words: told(each), isDashed: true })));
  pen.save();
  pen.font = '10px system-ui, "DejaVu Sans", sans-serif';
  pen.textBaseline = 'bottom';
  for (const { box: [x0, y0, x1, y1], colour, words, isDashed } of boxes) {
    const x = left + x0 * width, y = top + y0 * height, text = words.replaceAll('_', ' ');
    pen.setLineDash(isDashed ? [4, 3] : []);
    for (const [style, thick] of [['#000000a0', 3], [colour, 1.5]]) {
      pen.strokeStyle = style;
      pen.lineWidth = thick;
      pen.strokeRect(x, y, (x1 - x0) * width, (y1 - y0) * height);
    }
    const lower = y - top < 13 ? y + 13 : y, wide = pen.measureText(text).width + 4, from = Math.min(x, left + width - wide);
    pen.fillStyle = '#000000b0';
    pen.fillRect(from, lower - 12, wide, 12);
    pen.fillStyle = colour;
    pen.fillText(text, from + 2, lower);
  }
  pen.restore();
}
