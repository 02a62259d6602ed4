// Flying and driving by hand: keys or buttons move a stick, the server follows the stick, and the page shows the
// flight or the drive as it grows. The server's clock leads; the page lags a tenth of a second behind the last report.

import { element } from './dom.js';
import { Flight, clock } from './playback.js';

/** By `KeyboardEvent.code`, so that they lie the same on every keyboard: what they do, and which way. */
const KEYS = {
  KeyW: ['ahead', 1], ArrowUp: ['ahead', 1], KeyS: ['ahead', -1], ArrowDown: ['ahead', -1],
  KeyA: ['left', 1], KeyD: ['left', -1], KeyQ: ['turn', 1], ArrowLeft: ['turn', 1], KeyE: ['turn', -1], ArrowRight: ['turn', -1],
};
/** In a car both keys to the left steer, and there is no sideways. */
const STEERS = { KeyA: ['turn', 1], KeyD: ['turn', -1], KeyQ: ['turn', 1], KeyE: ['turn', -1] };
const BUTTONS = [['KeyQ', '⟲', 'Turn left'], ['KeyW', '▲', 'Ahead'], ['KeyE', '⟳', 'Turn right'], ['KeyA', '◀', 'Left'], ['KeyS', '▼', 'Back'], ['KeyD', '▶', 'Right']];
const UAV = {
  title: 'You fly', end: 'Land', ends: 'Fly home and land (L)', begins: 'Taking off …',
  help: 'W A S D or the buttons: ahead, left, back, right. Q E or ← →: turn. Shift: faster. L: fly home and land.',
};
const CAR = {
  title: 'You drive', end: 'End', ends: 'Come to rest and end the drive (L)', begins: 'Getting in …',
  help: 'W or ↑: ahead; S or ↓: brake, then reverse. A D or ← →: steer. Shift: up to 50 instead of 30 km/h. L: end. The rear camera counts. The traffic is recorded and does not react to you.',
};
/** Keys of the page that change only what is seen; the others wait for the landing. */
const VIEW_KEYS = new Set(['d', 't', 'f', '+', '=', '-', '0', '1', '2', '3', '4', '?']);
/** A stick that is pushed for so long without moving the UAV faster than this meets the end of where it may fly. */
const STANDS_S = 2, STILL_MPS = 0.5;
const AGAIN_MS = 400, LAG_S = 0.1, SHOWN_STREETS = 2;

/** A flight that grows with what the server reports. */
class LiveFlight extends Flight {
  static async load(key) {
    const flight = await Flight.load(key, LiveFlight);
    flight.missions[0].isLive = true;
    return flight;
  }

  grow(state) {
    if (!this.missions[0].track.t_s.length) this.#add({ ...state, t_s: 0, captures: {}, found: [] });
    this.#add(state);
  }

  #add(state) {
    const [mission] = this.missions, { track, captures } = mission, before = track.yaw_rad.at(-1) ?? state.yaw_rad;
    const turned = state.yaw_rad - before;
    const values = {
      t_s: state.t_s, x_m: state.place_m[0], y_m: state.place_m[1], altitude_m: state.altitude_m, speed_mps: state.speed_mps,
      yaw_rad: before + Math.atan2(Math.sin(turned), Math.cos(turned)), battery: state.battery, mode: state.mode, visibility: state.visibility, segment: -1,
    };
    for (const [name, value] of Object.entries(values)) track[name].push(value);
    for (const [name, column] of Object.entries(state.captures)) captures[name].push(...column);
    mission.add(state.found);
    mission.targets = Object.keys(state.coverage);
    mission.duration_s = this.duration_s = state.t_s;
    if (state.agents) Object.assign(this, { minutes: state.minutes, agents: state.agents });
  }
}

export class Pilot {
  #root; #show; #map; #task = null; #flight = null; #state = null; #reportedMs = 0; #held = new Set(); #fast = false; #lands = false;
  #timer = 0; #movedAt = 0; #cells; #streets; #pending = []; #sent = ''; #low = false; #words = UAV;

  /**
   * @param root the panel
   * @param show `begin(flight)`, `time(t)`, `end()`: what the page does with a flight that grows
   */
  constructor(root, map, show) {
    this.#root = root;
    this.#map = map;
    this.#show = show;
    this.#cells = new Map(['time', 'speed', 'height', 'battery', 'visibility o', 'found'].map(name => [name, element('dd')]));
    this.#streets = element('ul');
    const pad = element('div', { className: 'pad' }, ...BUTTONS.map(([code, sign, words]) => this.#button(code, sign, words)));
    const land = element('button', { type: 'button', className: 'main end' });
    const giveUp = element('button', { type: 'button', title: 'End now without saving' }, 'Give up');
    land.addEventListener('click', () => this.#land());
    giveUp.addEventListener('click', () => this.#task?.cancel());
    root.append(
      element('h2'), element('p', { className: 'status' }),
      element('dl', {}, ...[...this.#cells].map(([name, cell]) => element('div', {}, element('dt', {}, name), cell))),
      this.#streets, element('div', { className: 'row' }, pad, element('div', { className: 'ends' }, land, giveUp)), element('small'),
    );
    this.#tellWords();
    addEventListener('keydown', event => this.#key(event, true), true);
    addEventListener('keyup', event => this.#key(event, false), true);
    addEventListener('blur', () => this.#letGo());
    document.addEventListener('visibilitychange', () => { if (document.hidden) this.#letGo(); });
  }

  get isFlying() { return this.#flight !== null; }

  /** The server has taken off; `task` is what was asked of it. */
  async begin({ key }, task) {
    this.#task = task;
    this.#lands = this.#low = false;
    this.#movedAt = 0;
    this.#sent = '';
    this.#pending = [];
    const flight = await LiveFlight.load(key);
    if (this.#task !== task) return;
    this.#flight = flight;
    this.#words = flight.missions[0].car ? CAR : UAV;
    this.#tellWords();
    this.#root.hidden = false;
    this.status(this.#words.begins);
    for (const state of this.#pending.splice(0)) this.#grow(state);
    this.#timer = setInterval(() => { if (this.#held.size) this.#send(true); }, AGAIN_MS);
    requestAnimationFrame(() => this.#tick());
  }

  live(state) {
    if (this.#flight) this.#grow(state);
    else this.#pending.push(state);
  }

  status(words) { this.#root.querySelector('.status').textContent = words; }

  /** What differs between flying and driving. */
  #tellWords() {
    const { title, end, ends, help } = this.#words, land = this.#root.querySelector('.end'), isCar = this.#words === CAR;
    this.#root.setAttribute('aria-label', isCar ? 'Driving by hand' : 'Flying by hand');
    this.#root.querySelector('h2').textContent = title;
    this.#root.querySelector('small').textContent = help;
    Object.assign(land, { textContent: end, title: ends });
    for (const name of ['height', 'battery']) this.#cells.get(name).parentElement.hidden = isCar;
    for (const code of ['KeyQ', 'KeyE']) this.#root.querySelector(`[data-code="${code}"]`).style.visibility = isCar ? 'hidden' : '';
  }

  end() {
    if (this.#flight) this.#show.end();
    clearInterval(this.#timer);
    this.#task = this.#flight = this.#state = null;
    this.#held.clear();
    this.#root.hidden = true;
  }

  #grow(state) {
    const isFirst = this.#state === null;
    this.#flight.grow(state);
    this.#state = state;
    this.#reportedMs = performance.now();
    if (isFirst) this.#show.begin(this.#flight);
    this.#tellState(state);
  }

  #tick() {
    if (!this.#flight) return;
    if (this.#state) this.#show.time(Math.min(this.#state.t_s, this.#state.t_s - LAG_S + (performance.now() - this.#reportedMs) / 1000));
    requestAnimationFrame(() => this.#tick());
  }

  #tellState(state) {
    const mode = this.#flight.missions[0].modes[state.mode];
    const values = {
      time: clock(state.t_s), speed: this.#words === CAR ? `${Math.round(3.6 * state.speed_mps)} km/h` : `${state.speed_mps.toFixed(1)} m/s`,
      height: `${state.altitude_m.toFixed(1)} m`, battery: state.battery === null ? '–' : `${Math.round(100 * state.battery)} %`,
      'visibility o': state.visibility === null ? '–' : state.visibility.toFixed(2), found: String(this.#flight.missions[0].defects.length),
    };
    for (const [name, text] of Object.entries(values)) this.#cells.get(name).textContent = text;
    this.status(this.#words === CAR ? this.#driven(state, mode) : this.#flown(state, mode));
    const { [state.segment]: present, ...others } = state.coverage, before = Object.entries(others).reverse();
    const latest = [...present === undefined ? [] : [[state.segment, present]], ...before].slice(0, SHOWN_STREETS);
    this.#streets.replaceChildren(...latest.map(([id, share]) => {
      const bar = element('progress', { max: 1, value: share });
      bar.setAttribute('aria-label', `Surface of ${id} seen`);
      return element('li', {}, element('span', {}, `${this.#map.segment(id)?.street ?? ''} ${id}`), bar, element('b', {}, `${Math.round(100 * share)} %`));
    }));
  }

  #flown({ is_low: isLow }, mode) {
    if (isLow) this.#low = true;
    if (this.#low && mode.name !== 'ground') return 'The battery is low: the UAV flies home and lands by itself.';
    if (mode.name !== 'inspect') return `It ${mode.words}.`;
    if (this.#lands) return 'It comes to rest.';
    return this.#stands() ? 'The flight domain ends here: turn, or fly back.' : 'You have control.';
  }

  /** Whether the stick is pushed for a while and the UAV hardly moves: where the area ends in which it may fly. */
  #stands() {
    const isPushed = [...this.#held].some(code => KEYS[code][0] !== 'turn'), now = this.#state.t_s;
    if (!isPushed || this.#state.speed_mps > STILL_MPS) this.#movedAt = now;
    return now - this.#movedAt > STANDS_S;
  }

  #driven({ is_met: isMet }, mode) {
    if (isMet) return 'Recorded traffic drives through you: it does not react.';
    if (mode.name === 'blocked') return 'Something is in the way, or the road ends: steer, or reverse.';
    return this.#lands ? 'It comes to rest.' : 'The wheel is yours.';
  }

  #button(code, sign, words) {
    const button = element('button', { type: 'button', title: words }, sign);
    button.setAttribute('aria-label', words);
    button.dataset.code = code;
    button.addEventListener('pointerdown', event => { button.setPointerCapture(event.pointerId); this.#hold(code, true); });
    for (const name of ['pointerup', 'pointercancel']) button.addEventListener(name, () => this.#hold(code, false));
    return button;
  }

  #key(event, isDown) {
    if (!this.#flight || event.ctrlKey || event.metaKey || event.altKey || event.target.matches?.('input, select, textarea, dialog *')) return;
    if (event.key === 'Shift') {
      this.#fast = isDown;
      this.#send();
      return;
    }
    if (event.code === 'KeyL' || event.code === 'Escape') {
      if (isDown) this.#land();
    } else if (event.code in KEYS) {
      this.#fast = event.shiftKey;
      this.#hold(event.code, isDown);
    } else {
      if (!VIEW_KEYS.has(event.key.toLowerCase())) event.stopImmediatePropagation();
      return;
    }
    event.preventDefault();
    event.stopImmediatePropagation();
  }

  #hold(code, isDown) {
    this.#held[isDown ? 'add' : 'delete'](code);
    this.#send();
  }

  #letGo() {
    this.#held.clear();
    this.#fast = false;
    if (this.#flight) this.#send();
  }

  #land() {
    this.#lands = true;
    this.#send();
  }

  #send(isAgain = false) {
    const stick = { ahead: 0, left: 0, turn: 0, is_fast: this.#fast, lands: this.#lands };
    for (const code of this.#held) {
      const [name, way] = (this.#words === CAR && STEERS[code]) || KEYS[code];
      stick[name] += way;
    }
    for (const name of ['ahead', 'left', 'turn']) stick[name] = Math.max(-1, Math.min(1, stick[name]));
    const text = JSON.stringify(stick);
    if (!isAgain && text === this.#sent) return; // a key that repeats
    this.#sent = text;
    this.#task?.send(stick);
  }
}
