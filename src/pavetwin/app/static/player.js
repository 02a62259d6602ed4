// The player: a flight and its clock, shown by the map, the camera, the curves, the results and the town in 3-D. It
// needs no server: the page that plays one mission offline has the same.

import { by, element } from './dom.js';
import { clock } from './playback.js';
import { notice } from './notice.js';

export class Player {
  flight = null; mission = null; time = 0; playing = false; #last = 0; #parts;
  onMission = () => {};

  /** @param parts `map`, `camera`, `timeline`, `results`, and `town` where there is one */
  constructor(parts) {
    this.#parts = parts;
    const actions = { play: () => this.play(!this.playing), previous: () => this.jump(-1), next: () => this.jump(1) };
    for (const [id, act] of Object.entries(actions)) by(id).addEventListener('click', act);
    by('scrub').addEventListener('input', () => { this.play(false); this.seek(Number(by('scrub').value)); });
    this.#tellPlayer();
  }

  setFlight(flight) {
    this.flight = flight;
    this.playing = false;
    this.time = 0;
    const choices = flight && flight.missions.length > 1 ? flight.missions : [];
    by('policies').hidden = !choices.length;
    by('policies').replaceChildren(...choices.map(mission => {
      const button = element('button', { type: 'button' }, mission.policy);
      button.setAttribute('role', 'radio');
      button.addEventListener('click', () => this.setMission(mission));
      return button;
    }));
    this.setMission(flight?.missions[0] ?? null);
  }

  setMission(mission) {
    const { map, camera, timeline, results, town } = this.#parts, { flight } = this;
    this.mission = mission;
    for (const part of [map, camera, town]) part?.setFlight(flight, mission);
    const flown = mission?.isLive ? null : mission;
    timeline.setMission(flown);
    if (flown) results.setFlight(flight, flown);
    else results.clear();
    document.querySelector('footer .empty').hidden = Boolean(flown);
    by('scrub').max = mission?.duration_s ?? 0;
    this.#tellPlayer();
    for (const button of by('policies').children) button.setAttribute('aria-checked', button.textContent === mission?.policy);
    this.onMission(mission);
    this.seek(Math.min(this.time, mission?.duration_s ?? 0));
  }

  /** The other one of two policies. */
  otherPolicy() {
    const { missions = [] } = this.flight ?? {};
    if (missions.length > 1) this.setMission(missions[(missions.indexOf(this.mission) + 1) % missions.length]);
  }

  /** Show on the map all that is inspected, and the place of take-off. */
  showWhole(base) {
    const { map } = this.#parts, targets = this.mission.targets.map(id => map.segment(id)).filter(Boolean);
    const boxes = [...targets.map(segment => segment.box), [...base, ...base]];
    map.show(...[0, 1].map(i => Math.min(...boxes.map(box => box[i]))), ...[2, 3].map(i => Math.max(...boxes.map(box => box[i]))), 1.3);
  }

  seek(t) {
    this.time = Math.max(0, Math.min(t, this.mission?.duration_s ?? 0));
    this.#show();
    const { flight, time } = this;
    flight?.fetchAgents(time).then(isNew => { if (isNew && this.flight === flight) this.#show(); }, error => notice(error.message));
    by('scrub').value = time;
    const words = `${clock(time)} / ${clock(this.mission?.duration_s ?? 0)}`;
    by('clock').textContent = words;
    by('scrub').setAttribute('aria-valuetext', words);
  }

  #show() {
    const { map, camera, timeline, town } = this.#parts;
    map.setTime(this.time);
    town?.setTime(this.time);
    camera.setTime(this.time, this.playing ? Number(by('speed').value) : 0);
    timeline.setTime(this.time);
  }

  play(on) {
    this.playing = on && Boolean(this.mission);
    if (this.playing && this.time >= this.mission.duration_s - 0.05) this.seek(0);
    this.#last = performance.now();
    this.#tellPlayer();
    if (this.playing) requestAnimationFrame(now => this.#tick(now));
    else this.#parts.camera.setTime(this.time);
  }

  #tick(now) {
    if (!this.playing) return;
    const t = this.time + ((now - this.#last) / 1000) * Number(by('speed').value);
    this.#last = now;
    this.seek(t);
    if (t >= this.mission.duration_s) this.play(false);
    else requestAnimationFrame(later => this.#tick(later));
  }

  jump(direction) {
    const moments = this.mission?.occlusions ?? [];
    const found = direction > 0 ? moments.find(t => t > this.time + 0.05) : moments.findLast(t => t < this.time - 0.05);
    if (found !== undefined) this.seek(found);
    else if (this.mission) notice(`There is no ${direction > 0 ? 'later' : 'earlier'} occlusion.`, true);
  }

  speed(step) {
    const { options } = by('speed');
    by('speed').selectedIndex = Math.max(0, Math.min(options.length - 1, by('speed').selectedIndex + step));
  }

  /** Go to a defect, and to the moment at which it was found, or else seen best. */
  showDefect(id) {
    const { map, results, town } = this.#parts, defect = this.mission?.byId.get(id);
    if (!defect) return;
    map.setDefect(id);
    results.showDefect(id);
    map.showPlace(...defect.place_m);
    town?.showPlace(...defect.place_m);
    const moment = defect.found_s ?? defect.time_s;
    if (moment !== null && moment !== undefined) { this.play(false); this.seek(moment); }
  }

  #tellPlayer() {
    for (const id of ['play', 'previous', 'next', 'speed', 'scrub']) by(id).disabled = !this.mission;
    by('play').textContent = this.playing ? '❚❚' : '▶';
    by('play').setAttribute('aria-label', this.playing ? 'Pause' : 'Play');
  }
}

/** What keys do to a player and its map, by `KeyboardEvent.key`; null where the key is the focused control's own. */
export function playerKeys(player, map, onButton) {
  return {
    ' ': onButton ? null : () => player.play(!player.playing), n: () => player.jump(1), p: () => player.jump(-1), v: () => player.otherPolicy(),
    '+': () => map.zoom(1.4), '=': () => map.zoom(1.4), '-': () => map.zoom(1 / 1.4), 0: () => map.fit(), '[': () => player.speed(-1), ']': () => player.speed(1),
  };
}

/** What an arrow key does: it moves the map where that has the focus, and the clock elsewhere. */
export function arrowAct(event, player, map, isTaken) {
  const arrow = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
  if (!arrow) return null;
  if (event.target === by('map').querySelector('.moving')) return () => map.move(0.12 * arrow[0], 0.12 * arrow[1]);
  if (!arrow[0] || isTaken) return null;
  return () => { player.play(false); player.seek(player.time + arrow[0] * (event.shiftKey ? 10 : 1)); };
}
