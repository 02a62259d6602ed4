// The streets that are chosen, what inspecting them takes and shows at best, and how many are drawn where none is chosen.

import { element, inWordsOfPage } from './dom.js';
import { CancelledError } from './server.js';

const PATIENCE_MS = 250;

/** Streets that are named; others are counted. */
const NAMED = 3;
const ORDERS = { random: 'anywhere, by the seed', near: 'in a short tour' };

export class Selection {
  #root; #tasks; #form; #changed; #timer = 0; #streetOf; #asked = null; #numbers; #words; #row; #note;
  segments = [];
  count = 8;
  order = 'random';
  isDrawable = true;

  /**
   * @param streetOf the name of a segment's street
   * @param changed called with the segments that a mission would inspect: the chosen ones, or those drawn
   */
  constructor(root, tasks, form, streetOf, changed) {
    this.#streetOf = streetOf;
    this.#root = root;
    this.#tasks = tasks;
    this.#form = form;
    this.#changed = changed;
    this.#words = element('div');
    this.#numbers = element('div', { className: 'numbers' });
    this.#note = element('small');
    this.#row = element('div', { className: 'row' });
    root.append(this.#words, this.#row, this.#numbers, this.#note);
  }

  set(segments, count = this.count, order = this.order) {
    Object.assign(this, { segments, count, order });
    this.update();
  }

  pick(ids, { toggle }) {
    const chosen = new Set(this.segments);
    for (const id of ids) {
      if (toggle && chosen.has(id)) chosen.delete(id);
      else chosen.add(id);
    }
    this.set([...chosen]);
  }

  /** Show what is chosen, and request its estimate. */
  update() {
    this.#tellChoice();
    this.#changed(this.segments, []);
    this.#root.classList.add('busy');
    clearTimeout(this.#timer);
    this.#timer = setTimeout(() => this.#estimate(), PATIENCE_MS);
  }

  #tellChoice() {
    const { segments, count } = this;
    this.#words.replaceChildren(...segments.length
      ? [element('b', {}, `${segments.length} segment${segments.length === 1 ? '' : 's'} chosen`), ...this.#streets()]
      : [element('b', {}, `${count} segment${count === 1 ? '' : 's'} chosen by the seed.`), ' Click streets on the map to choose them yourself.']);
    if (segments.length) {
      const clear = element('button', { type: 'button', title: 'Choose none (Escape)' }, 'Clear');
      clear.addEventListener('click', () => this.set([]));
      this.#row.replaceChildren(clear);
      return;
    }
    const number = element('input', { type: 'number', min: 1, max: 2000, value: count, id: 'count' });
    number.addEventListener('change', () => { if (number.checkValidity()) this.set([], Number(number.value)); });
    const order = element('select', {}, ...this.#form.orders.map(name => new Option(ORDERS[name] ?? name, name, name === this.order, name === this.order)));
    order.setAttribute('aria-label', 'How they are chosen');
    order.addEventListener('change', () => this.set([], this.count, order.value));
    this.#row.replaceChildren(element('label', { htmlFor: 'count' }, 'Number of segments'), number, order);
  }

  /** The names of the chosen streets, in their order; each with its own direction of writing. */
  #streets() {
    const names = [...new Set(this.segments.map(this.#streetOf))], more = names.length - NAMED;
    const shown = names.slice(0, NAMED).flatMap((name, at) => [at ? ', ' : ': ', element('bdi', {}, name)]);
    return more > 0 ? [...shown, ` and ${more} more`] : shown;
  }

  async #estimate() {
    this.#asked?.cancel();
    if (!this.#form.world || !this.#form.isValid) {
      this.#asked = null;
      return this.#refuse(this.#form.refusal);
    }
    const asked = this.#asked = this.#tasks.ask({
      do: 'estimate', world: this.#form.world, request: this.#form.request(this.segments, this.count, this.order),
    });
    try {
      const known = await asked.promise;
      if (asked !== this.#asked) return;
      this.#tellEstimate(known);
      this.#changed(this.segments, known.targets);
    } catch (error) {
      if (error instanceof CancelledError || asked !== this.#asked) return;
      this.#refuse(error.message);
    } finally {
      if (asked === this.#asked) {
        this.#asked = null;
        this.#root.classList.remove('busy');
      }
    }
  }

  #refuse(words) {
    this.#numbers.replaceChildren(element('span', { className: 'bad' }, inWordsOfPage(words)));
    this.#note.textContent = '';
    this.#root.classList.remove('busy');
  }

  #tellEstimate(known) {
    const minutes = known.time_s / 60, batteries = known.batteries > 1 ? `${known.batteries} batteries` : `${Math.round(100 * known.energy)} % of a battery`;
    const numbers = [
      ['', `${Math.round(known.length_m)} m`], ['', `${minutes.toFixed(1)} min`], ['', batteries], ['', `${known.images} images`],
      ['', `${known.pixel_mm.toFixed(1)} mm a pixel`], ['at most', `${(100 * known.surface_coverage).toFixed(1)} % of the surface`],
    ];
    this.#numbers.replaceChildren(...numbers.map(([words, value]) => element('span', {}, words ? `${words} ` : '', element('strong', {}, value))));
    this.#note.textContent = 'Estimated over empty streets: traffic adds time and hides some of the surface.';
  }
}
