// Flown missions as values over time. The track is interpolated as the server's Timeline does, agents as the kernel does:
// linearly between the steps of the trace, with the shorter turn. World frame: metres, radians; seconds since take-off.

import { fetchBytes, fetchJson } from './server.js';

const MINUTE_S = 60, MAGIC = 0x31415450, CENTIMETRE = 0.01, YAW_STEP = 1e-4;

/** The agents of one minute, see `pavetwin.app.agent_minutes`. */
export function decodeMinute(bytes) {
  const [magic, runs, poses] = new Uint32Array(bytes, 0, 3);
  if (magic !== MAGIC) throw new Error('This is no minute of agents.');
  let at = 12;
  const take = (Type, count) => {
    const column = new Type(bytes, at, count);
    at += column.byteLength;
    return column;
  };
  const agent = take(Uint32Array, runs), x0 = take(Int32Array, runs), y0 = take(Int32Array, runs);
  const first = take(Uint16Array, runs), count = take(Uint16Array, runs), yaw0 = take(Int16Array, runs);
  const [dx, dy, dyaw] = [0, 1, 2].map(() => take(Int16Array, poses));
  const x = new Float64Array(poses), y = new Float64Array(poses), yaw = new Float64Array(poses);
  const offset = new Uint32Array(runs);
  for (let run = 0, row = 0; run < runs; run++) {
    let [px, py, turned] = [x0[run], y0[run], yaw0[run]];
    offset[run] = row;
    for (let end = row + count[run]; row < end; row++) {
      x[row] = (px += dx[row]) * CENTIMETRE;
      y[row] = (py += dy[row]) * CENTIMETRE;
      yaw[row] = (turned += dyaw[row]) * YAW_STEP;
    }
  }
  return { agent, first, count, offset, x, y, yaw };
}

/** The agents that are there `step` steps into a minute, a fraction included. */
export function posesAt(minute, step) {
  const k = Math.floor(step + 1e-9), share = Math.max(0, step - k), found = [];
  for (let run = 0; run < minute.agent.length; run++) {
    const at = k - minute.first[run];
    if (at < 0 || at >= minute.count[run]) continue;
    const i = minute.offset[run] + at, j = at + 1 < minute.count[run] ? i + 1 : i;
    const mix = column => column[i] + (column[j] - column[i]) * share;
    found.push({ agent: minute.agent[run], x: mix(minute.x), y: mix(minute.y), yaw: mix(minute.yaw) });
  }
  return found;
}

/** One mission over time. */
export class Mission {
  constructor(values) {
    Object.assign(this, values);
    this.occlusions = this.events.filter(event => event.kind === 'occlusion').map(event => event.t_s);
    this.byId = new Map(this.defects.map(defect => [defect.id, defect]));
    this.foundAt = this.defects.filter(defect => defect.found_s !== null).map(d => d.found_s).sort((a, b) => a - b);
    this.finishedAt = new Map(this.events.filter(e => e.kind === 'finish').map(e => [e.segment, e.t_s]));
  }

  /** Flown or driven by hand, which no policy can do again. */
  get isByHand() { return this.policy === 'by-hand' || Boolean(this.car); }

  /** Segments, in the order of inspection, with a defect that was missed and is not behind a parked vehicle. */
  get missedOn() {
    const missed = new Set(this.defects.filter(({ outcome }) => outcome === 'missed').map(({ segment }) => segment));
    return this.targets.filter(target => missed.has(target));
  }

  /** The track's last sample up to a moment. */
  row(t) {
    return lastUpTo(this.track.t_s, t + 1e-9);
  }

  /** x_t, what the UAV does, and o. */
  at(t) {
    const track = this.track, i = this.row(t), j = Math.min(i + 1, track.t_s.length - 1);
    const gap = track.t_s[j] - track.t_s[i], share = gap > 0 ? Math.min(1, Math.max(0, (t - track.t_s[i]) / gap)) : 0;
    const mix = name => track[name][i] + (track[name][j] - track[name][i]) * share;
    return {
      x: mix('x_m'), y: mix('y_m'), altitude: mix('altitude_m'), speed: mix('speed_mps'), battery: track.battery[i] === null ? null : mix('battery'),
      yaw: mix('yaw_rad'), mode: this.modes[track.mode[i]], segment: track.segment[i], visibility: track.visibility[i],
      captures: lastUpTo(this.captures.t_s, t + 1e-9) + 1, row: i,
    };
  }

  /** Where the camera is of a vehicle at a moment: the UAV's is where that is, the car's is behind it. */
  cameraOf(now) {
    const ahead = this.car?.camera_ahead_m ?? 0;
    return { ...now, x: now.x + ahead * Math.cos(now.yaw), y: now.y + ahead * Math.sin(now.yaw) };
  }

  /** What a defect is at a moment: `found`, `found on return`, `missed` …, or null while it is open. */
  outcomeAt(defect, t) {
    if (defect.found_s !== null) return t >= defect.found_s ? defect.outcome : null;
    return t >= (this.finishedAt.get(defect.segment) ?? Infinity) ? defect.outcome : null;
  }

  /** Defects that were found since, of a mission in flight. */
  add(defects) {
    for (const defect of defects) {
      this.defects.push(defect);
      this.byId.set(defect.id, defect);
      this.foundAt.push(defect.found_s);
    }
  }

  foundUpTo(t) {
    return lastUpTo(this.foundAt, t) + 1;
  }

  /** Unbroken stretches of the track: [from, to, what] by the mode, or where o is below the threshold. */
  spans() {
    const { t_s, mode, visibility } = this.track, spans = [], lanes = { wait: 'wait', displace: 'displace', revisit: 'revisit', swap: 'swap' };
    const collect = (of, what) => {
      for (let i = 0, from = -1; i <= t_s.length; i++) {
        const inside = i < t_s.length && of(i);
        if (inside && from < 0) from = i;
        if (!inside && from >= 0) {
          spans.push({ from: t_s[from], to: t_s[Math.min(i, t_s.length - 1)], what });
          from = -1;
        }
      }
    };
    collect(i => visibility[i] !== null && visibility[i] < this.threshold, 'occlusion');
    for (const [name, what] of Object.entries(lanes)) collect(i => this.modes[mode[i]].name === name, what);
    return spans;
  }
}

/** Missions over the same traffic. */
export class Flight {
  #minutes = new Map();
  #decoded = new Map();

  constructor(key, values) {
    Object.assign(this, values);
    this.key = key;
    this.missions = values.missions.map(mission => new Mission(mission));
    this.duration_s = Math.max(...this.missions.map(mission => mission.duration_s));
  }

  /** @param Kind of flight that is made of it */
  static async load(key, Kind = Flight) {
    return new Kind(key, await fetchJson(`api/played/${key}/flight.json.gz`));
  }

  #minuteOf(t) {
    return Math.max(0, Math.min(this.minutes - 1, Math.floor(t / MINUTE_S)));
  }

  /** Fetch the minute of a moment, and the next one ahead. Returns whether it was not there yet. */
  async fetchAgents(t) {
    const number = this.#minuteOf(t), isNew = !this.#decoded.has(number);
    if (number + 1 < this.minutes) this.#fetch(number + 1).catch(() => {});
    await this.#fetch(number);
    return isNew;
  }

  #fetch(number) {
    if (!this.#minutes.has(number)) {
      const name = `agents-${String(number).padStart(4, '0')}.bin.gz`;
      const fetched = fetchBytes(`api/played/${this.key}/${name}`).then(bytes => this.#decoded.set(number, decodeMinute(bytes)));
      fetched.catch(() => this.#minutes.delete(number));
      this.#minutes.set(number, fetched);
    }
    return this.#minutes.get(number);
  }

  /** A_t: every moving agent in the town; none before its minute is fetched, which `fetchAgents` waits for. */
  agentsAt(t) {
    const number = this.#minuteOf(t), minute = this.#decoded.get(number);
    if (!minute) return [];
    const { length_m, width_m, height_m, group, groups } = this.agents;
    return posesAt(minute, (t - number * MINUTE_S) / this.step_s).map(pose => ({
      ...pose, length: length_m[pose.agent], width: width_m[pose.agent], height: height_m[pose.agent],
      group: groups[group[pose.agent]],
    }));
  }
}

/** Index of the last value that is not above `limit` in a rising column; -1 where none is. */
export function lastUpTo(column, limit) {
  let low = 0, high = column.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (column[middle] <= limit) low = middle + 1;
    else high = middle;
  }
  return low - 1;
}

/** `0:09.7`. */
export function clockTenths(t) {
  const tenths = Math.round(10 * t);
  return `${Math.floor(tenths / 600)}:${((tenths % 600) / 10).toFixed(1).padStart(4, '0')}`;
}

/** `0:09`. */
export function clock(t) {
  const seconds = Math.floor(t + 1e-6);
  return `${Math.floor(seconds / 60)}:${String(seconds % 60).padStart(2, '0')}`;
}
