// The controls of a mission, and the request that they make. The same values are the page's address, so that it can be
// shared; what is as usual is left out of both.

import { by, fillSelect } from './dom.js';

const LEVELS = { A: 'A, free', B: 'B', C: 'C, stable', D: 'D', E: 'E, near capacity', F: 'F, stop and go' };
const FIELDS = ['altitude_m', 'policy', 'against', 'traffic', 'sensor', 'seed', 'date', 'time'];

export class MissionForm {
  #form; #usual; #worlds; isCompared = false;

  constructor(form, start, onChange) {
    this.#form = form;
    this.#usual = { ...start.usual, policy: start.usual.policies[0], traffic: '' };
    this.#worlds = start.worlds;
    const { elements } = form;
    fillSelect(elements.world, start.worlds.length ? start.worlds.map(({ id, name }) => [id, name]) : [['', 'none']]);
    const policies = start.policies;
    this.#usual.against = policies.find(name => name !== this.#usual.policy) ?? this.#usual.policy;
    fillSelect(elements.policy, policies, this.#usual.policy);
    fillSelect(elements.against, policies, this.#usual.against);
    fillSelect(elements.traffic, [
      ['', 'usual: C'],
      ...Object.entries(LEVELS).map(([level, words]) => [`los-${level}`, `level ${words}`]),
      ...start.densities.map(name => [name, `${name} density`]),
      ...Array.from({ length: 24 }, (_, hour) => [`hour-${String(hour).padStart(2, '0')}`, `${hour} to ${hour + 1} o'clock`]),
    ], '');
    fillSelect(elements.sensor, start.sensors, this.#usual.sensor);
    [elements.altitude_m.min, elements.altitude_m.max] = start.altitudes_m;
    for (const name of FIELDS) elements[name].value = this.#usual[name];
    form.addEventListener('change', onChange);
  }

  /** A town that was built since, chosen now. */
  addWorld({ id, name }) {
    const { world } = this.#form.elements;
    if (!this.#worlds.length) world.replaceChildren();
    this.#worlds.push({ id, name });
    world.append(new Option(name, id, true, true));
  }

  get world() { return this.#form.elements.world.value; }
  get worldName() { return this.#worlds.find(({ id }) => id === this.world)?.name ?? ''; }
  get isValid() { return this.#form.checkValidity(); }
  get policies() {
    const { policy, against } = this.#form.elements;
    return this.isCompared && against.value !== policy.value ? [policy.value, against.value] : [policy.value];
  }

  compare(on) {
    this.isCompared = on;
    by('other').hidden = !on;
    by('compare').setAttribute('aria-pressed', on);
  }

  /** The request of a mission over segments, or over `count` that are drawn. */
  request(segments, count) {
    const { elements } = this.#form, asked = { policies: this.policies };
    for (const name of ['traffic', 'sensor', 'date', 'time']) {
      if (elements[name].value && elements[name].value !== this.#usual[name]) asked[name] = elements[name].value;
    }
    asked.altitude_m = Number(elements.altitude_m.value);
    asked.seed = Number(elements.seed.value);
    if (segments.length) asked.segments = segments;
    else asked.count = count;
    return asked;
  }

  /** The page's address for what is chosen. */
  address(segments, count) {
    const values = new URLSearchParams({ world: this.worldName });
    for (const name of FIELDS) {
      const { value } = this.#form.elements[name];
      if (value !== String(this.#usual[name]) && (name !== 'against' || this.isCompared)) values.set(name, value);
    }
    if (this.isCompared) values.set('against', this.#form.elements.against.value);
    if (segments.length) values.set('segments', segments.join(','));
    else values.set('count', count);
    return `#${values}`;
  }

  /** Set the controls by an address. Returns the segments, and how many are drawn. */
  read(address) {
    const values = new URLSearchParams(address.replace(/^#/, '')), { elements } = this.#form;
    const named = this.#worlds.find(({ name }) => name === values.get('world'));
    if (named) elements.world.value = named.id;
    for (const name of FIELDS) {
      if (!values.has(name)) continue;
      const before = elements[name].value;
      elements[name].value = values.get(name);
      if (elements[name].selectedIndex === -1) elements[name].value = before;
    }
    this.compare(values.has('against'));
    const segments = values.get('segments')?.split(',').filter(Boolean) ?? [];
    return { segments, count: Math.max(1, Number(values.get('count')) || this.#usual.count) };
  }
}
