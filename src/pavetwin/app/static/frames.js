// The rendered frames of captures: asked for by the moment that is shown, previews first, the next ones ahead; drawn with boxes.

import { clock, lastUpTo } from './playback.js';
import { CancelledError } from './server.js';

/** Seconds: a capture farther from a moment does not show it. */
const NEAR_S = 2;

/** Previews that are made ahead, and frames that stay in memory. */
const AHEAD = 8, KEPT = 96;

/** A moment is chosen when no other one has been for so long: then labels are made, which take ten times as long as a preview. */
const REST_MS = 400;

/** A preview that took longer than this last time is not waited for. */
const SOON_S = 1;

/** Of boxes, on any pavement: labels of the ground truth, what the mission's sensor reported, what a search found. */
const COLOURS = { label: '#ffd84d', confirmed: '#4be08a', duplicate: '#4be08a', false_alarm: '#ff6b57', ignored: '#c9c9c9', search: '#5cc8ff' };

export class Frames {
  #listeners = []; #also = [];
  #flight = null; #mission = null; #ready = new Map(); #wanted = null; #asked = null; #took = 2 * SOON_S; #search = false;
  #rate = 0; #ahead = 0; #restsAt = 0; #rest = 0; #failures = new Map();

  /** @param tasks what is asked of the server; may be set later, before the first mission */
  constructor(tasks = null) { this.tasks = tasks; }

  /** @param listener called once a frame is ready, or cannot be rendered */
  listen(listener) { this.#listeners.push(listener); }

  /** Why no frame can be rendered of this mission, if so. */
  get failure() { return this.failureOf('preview'); }

  /** Why a part of frames cannot be made of this mission, if so: it is not asked for any more, others are. */
  failureOf(part) { return this.#failures.get(part) ?? ''; }

  /** Captures whose frames are requested besides that of the moment, such as those of a defect. */
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
    this.#failures.clear();
  }

  /** Ask again for what could not be made: the server is there again. */
  retry() {
    this.#failures.clear();
    for (const listener of this.#listeners) listener();
    this.#next();
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

  /** Whether a preview of the moment is on its way and will be there before a slow browser has drawn the town. */
  get isSoon() { return !this.#rate && this.#asked?.part === 'preview' && this.#asked.capture === this.#wanted && this.#took < SOON_S; }

  /** Ask for the frame of a moment; while time passes, for that of the moment at which it will be ready. */
  want(t, rate, search) {
    if (!search) this.#failures.delete('searched'); // a repeated request may succeed
    if (!this.#mission || this.failure) return;
    const times = this.#mission.captures.t_s, capture = this.nearest(Math.min(t + rate * this.#took, times.at(-1) ?? 0)), wanted = capture < 0 ? this.nearest(t) : capture;
    if (wanted !== this.#wanted || rate) this.#wait();
    [this.#search, this.#rate, this.#wanted, this.#ahead] = [search, rate, wanted, Math.max(wanted, lastUpTo(times, t) + 1)];
    this.#next();
  }

  /** No labels until the moment has been the same for a while. */
  #wait() {
    this.#restsAt = performance.now() + REST_MS;
    clearTimeout(this.#rest);
    this.#rest = setTimeout(() => this.#next(), REST_MS + 1);
  }

  /** What is to be made, the first first: [capture, part]. */
  *#pending() {
    const wanted = this.#wanted ?? -1, count = this.#mission.captures.t_s.length;
    if (wanted >= 0) yield [wanted, 'preview'];
    if (performance.now() >= this.#restsAt) {
      if (wanted >= 0) yield [wanted, 'labelled'];
      if (wanted >= 0 && this.#search) yield [wanted, 'searched'];
      for (const part of ['preview', 'labelled']) for (const capture of this.#also) yield [capture, part];
    }
    for (let capture = this.#ahead; capture < Math.min(this.#ahead + AHEAD, count); capture++) yield [capture, 'preview'];
  }

  /** Ask for the first that is not there. What is being made is waited for, but for the preview of a moment; while time
   * passes for that as well, as dropping each would leave none. */
  #next() {
    if (!this.#mission || this.failure) return;
    const [capture, part] = [...this.#pending()].find(([capture, part]) => !this.#failures.has(part) && !this.#has(capture, part)) ?? [];
    if (part === undefined || (capture === this.#asked?.capture && part === this.#asked.part)) return;
    const isUrgent = part === 'preview' && capture === this.#wanted && !this.#rate;
    if (this.#asked === null || isUrgent) this.#ask(capture, part);
  }

  async #ask(capture, part) {
    const mission = this.#mission, flight = this.#flight, begun = performance.now();
    const asked = this.#asked = { capture, part };
    try {
      const frame = { do: 'frame', key: flight.key, mission: flight.missions.indexOf(mission), capture, part };
      const { jpeg, ...values } = await this.tasks.ask(frame).promise;
      if (jpeg) {
        values.image = new Image();
        values.image.src = `data:image/jpeg;base64,${jpeg}`;
        await values.image.decode();
      }
      if (flight === this.#flight) this.#keep(this.#name(mission, capture), { ...values, capture, time: mission.captures.t_s[capture] });
      if (part === 'preview') this.#took = (this.#took + (performance.now() - begun) / 1000) / 2;
    } catch (error) {
      if (!(error instanceof CancelledError) && mission === this.#mission && (part !== 'searched' || this.#search)) this.#failures.set(part, error.message);
    }
    const isLatest = this.#asked === asked;
    if (isLatest) this.#asked = null;
    for (const listener of this.#listeners) listener();
    if (isLatest) this.#next();
  }

  #name(mission, capture) { return `${this.#flight.missions.indexOf(mission)}/${capture}`; }

  /** Keep what is new of a frame; a preview that comes after the labels is not. */
  #keep(name, values) {
    const before = this.#ready.get(name);
    if (values.image ? before?.labels && !values.labels : !before) return;
    this.#ready.delete(name);
    this.#ready.set(name, { ...before, ...values });
    if (this.#ready.size > KEPT) this.#ready.delete(this.#ready.keys().next().value);
  }

  #known(capture) { return this.#ready.get(this.#name(this.#mission, capture)); }

  #has(capture, part) {
    const frame = this.#known(capture);
    return Boolean({ preview: frame, labelled: frame?.labels, searched: frame?.searched }[part]);
  }
}

/** What the panel shows, in words. */
export function frameLine(frames, frame, isLabelled, is3d = false) {
  if (!frame) return `Drawn ${is3d ? 'in 3-D' : 'from the map'}.${frames?.failure ? ` ${frames.failure}` : ''}`;
  const count = (number, what) => `${number} ${what}${number === 1 ? '' : 's'}`, parts = [`Rendered: capture ${frame.capture}, ${clock(frame.time)}`];
  if (isLabelled) parts.push(frame.labels ? count(frame.labels.length, 'label') : frames.failureOf('labelled') ? 'no labels' : 'labels follow');
  if (frame.detections.length) parts.push(`${count(frame.detections.length, 'detection')} of the sensor '${frame.sensor}'`);
  if (frame.searched) parts.push(`${count(frame.searched.length, 'box').replace('boxs', 'boxes')} of the shipped detector`);
  const failures = [...new Set(['labelled', 'searched'].map(part => frames.failureOf(part)).filter(Boolean))];
  return [`${parts.join(' · ')}.`, ...failures].join(' ');
}

/** Boxes over a frame that is drawn at [left, top, width, height]. */
export function drawBoxes(pen, frame, [left, top, width, height], isLabelled) {
  const boxes = isLabelled ? (frame.labels ?? []).map(label => ({ ...label, colour: COLOURS.label, words: label.class })) : [];
  const label = ({ class: kind, confidence }) => `${kind} ${Math.round(100 * confidence)} %`;
  boxes.push(...frame.detections.map(each => ({ ...each, colour: COLOURS[each.outcome], words: label(each), isDashed: true })));
  boxes.push(...(frame.searched ?? []).map(each => ({ ...each, colour: COLOURS.search, words: label(each), isDashed: true })));
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
