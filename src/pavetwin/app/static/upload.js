// A new town from a street map: the file is chosen or dropped, sent, and built by the server, which the page can cancel.

import { fillSelect } from './dom.js';
import { CancelledError } from './server.js';

const RULES = { europe: 'as in Europe', north_america: 'as in North America', none: 'none' };

export class NewTown {
  #dialog; #form; #tasks; #maps; #onTown; #onMission; #file = null; #asked = null;

  /**
   * @param start what the server can build, as `api/start` lists it
   * @param onTown called with the new town once it is built
   * @param onMission called with a dropped mission.yaml
   */
  constructor(dialog, tasks, start, onTown, onMission) {
    this.#dialog = dialog;
    this.#form = dialog.querySelector('form');
    this.#tasks = tasks;
    this.#maps = start.maps;
    this.#onTown = onTown;
    this.#onMission = onMission;
    const { elements } = this.#form;
    fillSelect(elements.parking_rule, start.parking_rules.map(name => [name, RULES[name] ?? name.replaceAll('_', ' ')]), 'europe');
    this.#part('.drop span').textContent = 'Choose a file, or drop it here';
    this.#part('.status').textContent = `OpenStreetMap (.osm, .osm.pbf) or a SUMO network (.net.xml), up to ${this.#maps.largest_bytes / 1e6} MB and ${this.#maps.largest_km2} km². Defects are placed as surveys of city streets find them.`;
    elements.file.addEventListener('change', () => this.#choose(elements.file.files[0]));
    this.#form.addEventListener('submit', event => { event.preventDefault(); this.#build(); });
    this.#part('.end').addEventListener('click', () => this.#end());
    dialog.addEventListener('cancel', event => { event.preventDefault(); this.#end(); }); // the Escape key
    for (const name of ['dragover', 'drop']) document.addEventListener(name, event => this.#drag(event));
    this.#showStatus();
  }

  open() { if (!this.#dialog.open) this.#dialog.showModal(); }

  /** Anywhere on the page: a file that is dropped is a map, or a mission.yaml. */
  #drag(event) {
    if (!event.dataTransfer?.types.includes('Files')) return;
    event.preventDefault();
    if (event.type !== 'drop' || this.#asked) return;
    const [file] = event.dataTransfer.files;
    if (/\.ya?ml$/i.test(file.name)) return this.#onMission(file);
    this.open();
    this.#choose(file);
  }

  #part(selector) { return this.#form.querySelector(selector); }

  #kind() { return this.#maps.kinds.filter(kind => this.#file?.name.toLowerCase().endsWith(kind)).at(-1); }

  #choose(file) {
    if (!file) return;
    this.#file = file;
    const kind = this.#kind(), { name } = this.#form.elements;
    this.#part('.drop span').textContent = `${file.name}, ${(file.size / 1e6).toFixed(1)} MB`;
    if (kind) name.value = file.name.slice(0, -kind.length).replace(/[^\p{L}\p{N}_-]+/gu, '-').replace(/^-+|-+$/g, '').slice(0, 60);
    this.#showStatus();
  }

  /** Why nothing can be built of what is chosen; empty where it can. */
  #refusal() {
    if (!this.#file) return 'Choose a file first.';
    if (!this.#kind()) return `A town is built from ${this.#maps.kinds.join(', ')}; '${this.#file.name}' is none of these.`;
    if (this.#file.size > this.#maps.largest_bytes) return `The map has ${Math.round(this.#file.size / 1e6)} MB; the page takes up to ${this.#maps.largest_bytes / 1e6} MB.`;
    return this.#file.size ? '' : `'${this.#file.name}' is empty.`;
  }

  #showStatus(words = '') {
    const isBusy = this.#asked !== null;
    this.#part('.bad').textContent = words || (this.#file ? this.#refusal() : '');
    this.#part('.busy').hidden = !isBusy;
    for (const control of this.#form.elements) if (!control.matches('.end')) control.disabled = isBusy;
    this.#part('.main').disabled = isBusy || Boolean(this.#refusal());
    this.#part('.end').textContent = isBusy ? 'Cancel' : 'Close';
  }

  #end() {
    if (this.#asked) this.#asked.cancel();
    else this.#dialog.close();
  }

  async #build() {
    if (this.#asked || this.#refusal()) return;
    const { name, parking_rule: rule, left_hand: left } = this.#form.elements, sending = new AbortController();
    const town = { name: name.value, kind: this.#kind(), bytes: this.#file.size, parking_rule: rule.value, left_hand: left.checked };
    const [words, bar] = ['.busy span', '.busy progress'].map(selector => this.#part(selector));
    let failure = '';
    words.textContent = 'Starting …';
    bar.removeAttribute('value');
    const asked = this.#asked = this.#tasks.ask({ do: 'build', town }, report => {
      if (report.ready) {
        send(report.ready.upload, this.#file, sending.signal).catch(error => { failure ||= error.message; asked.cancel(); });
        return;
      }
      words.textContent = `${report.what} …`;
      if (report.share > 0) bar.value = report.share;
      else bar.removeAttribute('value');
    });
    this.#showStatus();
    try {
      const { world } = await asked.promise;
      this.#asked = null;
      this.#file = null;
      this.#form.reset();
      this.#part('.drop span').textContent = 'Choose a file, or drop it here';
      this.#showStatus();
      this.#dialog.close();
      await this.#onTown(world);
    } catch (error) {
      this.#asked = null;
      this.#showStatus(error instanceof CancelledError ? failure || 'Cancelled; nothing was kept.' : error.message);
    } finally {
      sending.abort();
    }
  }
}

async function send(key, file, signal) {
  try {
    const answer = await fetch(`api/maps/${key}`, { method: 'POST', body: file, signal });
    if (!answer.ok) throw new Error((await answer.json()).error ?? answer.statusText);
  } catch (error) {
    if (error.name !== 'AbortError') throw error;
  }
}
