// The files of a mission: those that the command line wrote, and those that are made of it when asked for.

import { element } from './dom.js';
import { CancelledError } from './server.js';

/** The commands that make the same files; of plans by the format's name. */
const COMMANDS = { html: 'pavetwin replay MISSION', rrd: 'pavetwin replay MISSION -o mission.rrd' };

const WORDS = {
  'mission.yaml': 'all that the mission depends on, to fly it again', 'captures.geojson': 'found defects, GeoJSON',
  'defects.gpkg': 'all defects, found or missed and why, GeoPackage for QGIS', 'defects.csv': 'all defects as a table',
  'mission.parquet': 'a row for each segment', 'track.parquet': 'the UAV every 0.3 s', 'detections.parquet': 'a row for each detection',
  'streets.csv': 'a row for each street', 'map.png': 'the mission as a map', 'comparison.png': 'the policies side by side',
  'by-hand.json': 'when the stick moved', 'by-car.json': 'when the pedals and the wheel moved',
  'segments.csv': 'what the camera saw of each segment', 'track.csv': 'the car every 0.1 s', 'looks.parquet': 'what each capture showed of each defect',
};

export class Files {
  #root; #tasks; #made = element('ul', { className: 'list' }); #status = element('p', { className: 'status' }); #asked = null; #key = null; #mission = 0;
  #showCommand = () => {};

  /** @param exports what the server can make, see `pavetwin.app.exports` */
  constructor(root, tasks, exports) {
    this.#root = root;
    this.#tasks = tasks;
    this.exports = exports;
    this.clear();
  }

  clear() {
    this.#key = null;
    this.#showCommand = () => {};
    this.#root.replaceChildren(element('p', {}, 'The files of a mission are listed here after the flight.'));
  }

  /**
   * @param policies of the missions; each has a folder of its own where there are several
   * @param isMission whether it can be flown again
   */
  set(key, folder, names, policies, isMission) {
    if (this.#key !== key) {
      this.#asked?.cancel();
      this.#made.replaceChildren();
      this.#status.textContent = '';
    }
    this.#key = key;
    const links = names.map(name => this.#link(`api/played/${key}/files/${name}`, name, WORDS[name.split('/').at(-1)]));
    this.#root.replaceChildren(
      this.#status, ...this.#makers(folder, policies, isMission), this.#made,
      element('p', { className: 'remark' }, isMission ? `In ${folder}, written as by \`pavetwin fly\`:` : `In ${folder}, until the server ends:`), element('ul', { className: 'list' }, ...links),
    );
  }

  /** Which mission of the flight is shown. */
  set mission(number) {
    this.#mission = number;
    this.#showCommand();
  }

  /** What is being written. */
  status(words) { this.#status.textContent = words; }

  #link(href, name, words = '') {
    return element('li', {}, element('a', { href, download: name.replaceAll('/', '-') }, name, element('small', {}, words)));
  }

  #makers(folder, policies, isMission) {
    const choices = this.exports.filter(({ of_missions: only }) => isMission || !only);
    if (!choices.length) return [];
    const select = element('select', {}, ...choices.map(({ name, words }) => new Option(words, name)));
    select.setAttribute('aria-label', 'Exports of this mission');
    const button = element('button', { type: 'button' }, 'Make'), command = element('small');
    const showCommand = () => {
      const { name, of_one: isOfOne } = choices.find(each => each.name === select.value);
      command.textContent = (COMMANDS[name] ?? `pavetwin plan export MISSION --format ${name}`).replace('MISSION', isOfOne && policies.length > 1 ? `${folder}/${policies[this.#mission]}` : folder);
    };
    select.addEventListener('change', showCommand);
    this.#showCommand = showCommand;
    button.addEventListener('click', () => this.#make(select.value, button));
    showCommand();
    return [element('div', { className: 'make' }, select, button, command)];
  }

  async #make(what, button) {
    const key = this.#key;
    button.disabled = true;
    this.status('Making it …');
    const asked = this.#asked = this.#tasks.ask({ do: 'export', key, mission: this.#mission, what }, ({ what: words }) => { if (words) this.status(`${words} …`); });
    try {
      const { files, remark } = await asked.promise;
      if (this.#key !== key) return;
      const links = files.map(name => this.#link(`api/played/${key}/made/${name}`, name));
      const there = new Set(links.map(item => item.querySelector('a').href)), kept = [...this.#made.children].filter(item => !there.has(item.querySelector('a').href));
      this.#made.replaceChildren(...kept, ...links);
      this.status(remark);
      if (links.length === 1) links[0].querySelector('a').click();
    } catch (error) {
      if (this.#key === key) this.status(error instanceof CancelledError ? '' : error.message);
    } finally {
      button.disabled = false;
      this.#asked = null;
    }
  }
}
