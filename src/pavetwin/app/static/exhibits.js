// Studies and datasets that were given to the command: the report of one, the contact sheet of the other.

import { element } from './dom.js';
import { CancelledError } from './server.js';

const KINDS = { study: 'study', captured: 'dataset', photographs: 'dataset' };

export class Exhibits {
  #menu; #dialog; #tasks; #asked = null;

  constructor(menu, dialog, tasks, exhibits) {
    this.#menu = menu;
    this.#dialog = dialog;
    this.#tasks = tasks;
    menu.hidden = !exhibits.length;
    menu.querySelector('ul').append(...exhibits.map(exhibit => {
      const button = element('button', { type: 'button' }, `${exhibit.name} (${KINDS[exhibit.kind]})`);
      button.addEventListener('click', () => this.#show(exhibit));
      return element('li', {}, button);
    }));
    dialog.querySelector('.end').addEventListener('click', () => dialog.close());
    dialog.addEventListener('close', () => this.#close());
  }

  async #show({ id, name, kind }) {
    const [title, link, status, bar] = ['h2', 'a', '.status', 'progress'].map(selector => this.#dialog.querySelector(selector));
    this.#menu.open = false;
    title.textContent = name;
    status.textContent = 'Starting …';
    status.classList.remove('bad');
    link.hidden = true;
    status.hidden = bar.hidden = false;
    bar.removeAttribute('value');
    this.#dialog.showModal();
    const asked = this.#asked = this.#tasks.ask({ do: 'show', exhibit: id }, ({ share, what }) => {
      status.textContent = `${what} …`;
      if (share > 0) bar.value = share;
    });
    try {
      const { key, file } = await asked.promise, address = `api/exhibits/${key}/${file}`;
      if (asked !== this.#asked) return;
      link.href = address;
      link.hidden = false;
      status.hidden = bar.hidden = true;
      const shown = kind === 'study' ? element('iframe', { src: address, title: `Report of ${name}` }) : element('img', { src: address, alt: `Images of ${name} with their labels` });
      this.#dialog.querySelector('.shown').replaceChildren(shown);
    } catch (error) {
      if (error instanceof CancelledError || asked !== this.#asked) return;
      bar.hidden = true;
      status.textContent = error.message;
      status.classList.add('bad');
    }
  }

  #close() {
    this.#asked?.cancel();
    this.#asked = null;
    this.#dialog.querySelector('.shown').replaceChildren();
  }
}
