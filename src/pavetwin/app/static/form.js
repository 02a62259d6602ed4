// The controls of a mission, and the request that they make. The same values are the page's address, so that it can be
// shared; what is as usual is left out of both.

import { by, element, fillSelect } from './dom.js';

const LEVELS = { A: 'A, free', B: 'B', C: 'C, stable', D: 'D', E: 'E, near capacity', F: 'F, stop and go' };
/** Fields whose values are texts, and those that are numbers; what is as usual is left out of a request. */
const TEXTS = ['traffic', 'mix', 'sensor', 'aircraft', 'date', 'time'], NUMBERS = ['clouds', 'wind_mps', 'wind_from_deg'];
const FIELDS = ['altitude_m', 'policy', 'against', 'seed', ...TEXTS, ...NUMBERS];

export class MissionForm {
  #form; #usual; #worlds; isCompared = false;

  constructor(form, start, onChange) {
    this.#form = form;
    this.#usual = { ...start.usual, policy: start.usual.policies[0], traffic: '' };
    this.#worlds = start.worlds;
    this.orders = start.orders;
    const { elements } = form;
    this.#addMore(start);
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
    elements.altitude_m.step = 'any';
    [elements.altitude_m.min, elements.altitude_m.max] = start.altitudes_m;
    for (const name of FIELDS) elements[name].value = this.#usual[name];
    form.addEventListener('change', onChange);
  }

  /** What is chosen less often, in a menu of its own. */
  #addMore(start) {
    const number = (name, max) => element('input', { name, type: 'number', min: 0, max, step: 'any', required: true });
    const select = (name, choices) => { const made = element('select', { name }); fillSelect(made, choices, this.#usual[name]); return made; };
    const fields = [
      ['Vehicles', select('mix', start.mixes)], ['Aircraft', select('aircraft', start.aircraft)], ['Clouds, 0 to 1', number('clouds', 1)],
      ['Wind, m/s', number('wind_mps', 30)], ['Wind from, degrees', number('wind_from_deg', 359)],
    ];
    const items = fields.map(([words, field]) => element('li', {}, element('label', {}, words, field)));
    const more = element('details', { className: 'menu', id: 'more' }, element('summary', { title: 'More: vehicles, aircraft, clouds and wind', ariaLabel: 'More settings' }, '⋯'), element('ul', {}, ...items));
    this.#form.querySelector('.actions').before(more);
  }

  /** A town that was built since; `isChosen` now. */
  addWorld({ id, name }, isChosen) {
    const { world } = this.#form.elements;
    if (!this.#worlds.length) world.replaceChildren();
    this.#worlds.push({ id, name });
    world.append(new Option(name, id, isChosen, isChosen));
  }

  get world() { return this.#form.elements.world.value; }
  get worldName() { return this.#worlds.find(({ id }) => id === this.world)?.name ?? ''; }
  get isValid() { return this.#form.checkValidity(); }
  /** Which field cannot be flown with, and why; empty where all can. */
  get refusal() {
    const field = [...this.#form.elements].find(({ validity }) => validity && !validity.valid);
    return field ? `${field.closest('label').firstChild.textContent}: ${field.validationMessage}` : '';
  }
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
  request(segments, count, order) {
    const { elements } = this.#form, asked = { policies: this.policies };
    const changed = name => elements[name].value && elements[name].value !== String(this.#usual[name]);
    for (const name of TEXTS) if (changed(name)) asked[name] = elements[name].value;
    for (const name of NUMBERS) if (changed(name)) asked[name] = Number(elements[name].value);
    asked.altitude_m = Number(elements.altitude_m.value);
    asked.seed = Number(elements.seed.value);
    if (segments.length) asked.segments = segments;
    else Object.assign(asked, { count, order });
    return asked;
  }

  /** The page's address for what is chosen. */
  address(segments, count, order) {
    const values = new URLSearchParams({ world: this.worldName });
    for (const name of FIELDS) {
      const { value } = this.#form.elements[name];
      if (value !== String(this.#usual[name]) && (name !== 'against' || this.isCompared)) values.set(name, value);
    }
    if (this.isCompared) values.set('against', this.#form.elements.against.value);
    if (segments.length) values.set('segments', segments.join(','));
    else values.set('count', count);
    if (!segments.length && order !== this.#usual.order) values.set('order', order);
    return `#${values}`;
  }

  /** Set the controls to those of a mission: a town by its key, and values by the names of the controls. */
  choose(world, values) {
    const { elements } = this.#form;
    elements.world.value = world;
    for (const name of FIELDS) {
      const value = values[name] ?? this.#usual[name];
      elements[name].value = value;
      if (elements[name].selectedIndex === -1) elements[name].append(new Option(value, value, true, true));
    }
    elements.time.step = elements.time.value.length > 5 ? 1 : 60; // to the second where it has seconds
    this.compare('against' in values);
  }

  /** Set the controls by an address. Returns the segments, or how many are drawn and in which order; and `missing`, the
   * name of its town where there is none of it. */
  read(address) {
    const values = new URLSearchParams(address.replace(/^#/, '')), { elements } = this.#form;
    const town = values.get('world'), named = this.#worlds.find(({ name }) => name === town);
    if (named) elements.world.value = named.id;
    for (const name of FIELDS) {
      if (!values.has(name)) {
        elements[name].value = this.#usual[name];
        continue;
      }
      const before = elements[name].value;
      elements[name].value = values.get(name);
      if (elements[name].selectedIndex === -1) elements[name].value = before;
    }
    this.compare(values.has('against'));
    const segments = values.get('segments')?.split(',').filter(Boolean) ?? [];
    const order = this.orders.includes(values.get('order')) ? values.get('order') : this.#usual.order;
    return { missing: town && !named ? town : null, segments, count: Math.max(1, Number(values.get('count')) || this.#usual.count), order };
  }
}
