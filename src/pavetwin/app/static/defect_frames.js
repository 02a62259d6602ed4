// The captures that saw a defect: which they are, and their rendered frames cut to the defect, made while it is shown.

import { element } from './dom.js';
import { clockTenths } from './playback.js';

/** Captures that are shown, those nearest to the defect. */
const SHOWN = 6;
const SIDE_PX = 84, LEAST_M = 3;

/**
 * The captures whose image a defect's centre is in, in the order of time. `right` and `down` are the centre's place as
 * shares of the image's sides; `inWindow`: whether it is in the inspection window, of its own segment.
 */
export function capturesOf(mission, defect) {
  const { t_s, x_m, y_m, yaw_rad, segment } = mission.captures, [across, along] = mission.footprint_m, [wide, deep] = mission.window_m;
  const own = mission.segments.indexOf(defect.segment), [x, y] = defect.place_m, seen = [];
  for (let capture = 0; capture < t_s.length; capture++) {
    const dx = x - x_m[capture], dy = y - y_m[capture], yaw = yaw_rad[capture];
    const ahead = dx * Math.cos(yaw) + dy * Math.sin(yaw), left = dy * Math.cos(yaw) - dx * Math.sin(yaw);
    if (Math.abs(left) > across / 2 || Math.abs(ahead) > along / 2) continue;
    const inWindow = Math.abs(left) <= wide / 2 && Math.abs(ahead) <= deep / 2 && segment[capture] === own;
    seen.push({ capture, time: t_s[capture], right: 0.5 - left / across, down: 0.5 - ahead / along, away: Math.hypot(left, ahead), inWindow });
  }
  return seen;
}

export class DefectFrames {
  #frames; #onMoment; #root = element('div', { className: 'seen-by' }); #shown = []; #defect = null; #mission = null;

  /** @param onMoment called with the time of a clicked capture */
  constructor(frames, onMoment) {
    this.#frames = frames;
    this.#onMoment = onMoment;
    frames.listen(() => this.#draw());
  }

  /** What to put below a defect. */
  of(mission, defect) {
    this.#mission = mission;
    this.#defect = defect;
    const seen = capturesOf(mission, defect), nearest = [...seen].sort((one, other) => one.away - other.away).slice(0, SHOWN);
    const chosen = nearest.sort((one, other) => one.time - other.time), inside = seen.filter(({ inWindow }) => inWindow).length;
    const words = seen.length
      ? `In ${seen.length} image${seen.length === 1 ? '' : 's'}, in the inspection window of ${inside}${seen.length > chosen.length ? `; the ${chosen.length} nearest` : ''}:`
      : 'No image shows its place.';
    this.#shown = chosen.map(each => ({ ...each, ...this.#button(each) }));
    this.#root.replaceChildren(element('p', { className: 'remark' }, words), element('div', { className: 'thumbs' }, ...this.#shown.map(({ button }) => button)), element('p', { className: 'status' }));
    this.#frames.wantAlso(chosen.map(({ capture }) => capture));
    this.#draw();
    return this.#root;
  }

  /** Show none, and make no more. */
  clear() {
    this.#shown = [];
    this.#frames.wantAlso([]);
    this.#root.remove();
  }

  #button({ time, inWindow }) {
    const canvas = element('canvas', { width: 2 * SIDE_PX, height: 2 * SIDE_PX });
    const button = element('button', { type: 'button', title: inWindow ? 'In the inspection window' : 'Outside the inspection window' }, canvas, element('span', {}, clockTenths(time)));
    button.classList.toggle('outside', !inWindow);
    button.setAttribute('aria-label', `Go to the capture at ${clockTenths(time)}, ${button.title.toLowerCase()}`);
    button.addEventListener('click', () => this.#onMoment(time));
    return { button, canvas };
  }

  #draw() {
    const ready = this.#shown.map(shown => this.#drawOne(shown)).filter(Boolean).length, status = this.#root.querySelector('.status');
    if (status) status.textContent = this.#frames.failure || this.#frames.failureOf('labelled') || (ready < this.#shown.length ? 'Frames are being rendered …' : '');
  }

  #drawOne({ capture, right, down, canvas }) {
    const frame = this.#frames.frameOf(capture);
    if (!frame) return false;
    const { image, labels } = frame, size = Math.max(this.#defect.length_m ?? 0, this.#defect.width_m ?? 0);
    const [across] = this.#mission.footprint_m, side = Math.max(LEAST_M, 1.4 * size) / across * image.naturalWidth, scale = canvas.width / side;
    const [left, top] = [right * image.naturalWidth - side / 2, down * image.naturalHeight - side / 2];
    const pen = canvas.getContext('2d');
    pen.fillStyle = '#00000020';
    pen.clearRect(0, 0, canvas.width, canvas.height);
    pen.fillRect(0, 0, canvas.width, canvas.height);
    pen.drawImage(image, -left * scale, -top * scale, image.naturalWidth * scale, image.naturalHeight * scale);
    const label = labels?.find(({ id }) => id === `defect ${this.#defect.id}`);
    if (!label) return Boolean(labels);
    const [x0, y0, x1, y1] = label.box.map((share, at) => (share * (at % 2 ? image.naturalHeight : image.naturalWidth) - (at % 2 ? top : left)) * scale);
    for (const [style, thick] of [['#000000a0', 5], ['#ffd84d', 2.5]]) {
      pen.strokeStyle = style;
      pen.lineWidth = thick;
      pen.strokeRect(x0 - 4, y0 - 4, x1 - x0 + 8, y1 - y0 + 8);
    }
    return true;
  }
}
