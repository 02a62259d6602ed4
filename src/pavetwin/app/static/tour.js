// Five steps through the page, shown on the first visit and from the help: a small card next to the explained part.

import { by, element } from './dom.js';
import { keep, kept } from './theme.js';

const SEEN = 'pavetwin-tour', GAP_PX = 10, EDGE_PX = 8;
const STEPS = [
  ['#map', 'Choose streets', 'Click streets on the map, drag a box around them, or find one by its name. Without a choice, the seed selects them.'],
  ['#selection', 'Check the cost', 'Minutes, batteries, images, and the largest share of the surface that can be seen: all before the flight.'],
  ['#mission .actions', 'Fly', 'Start flies the whole mission. Compare flies two policies through the same traffic.'],
  ['footer', 'Watch', 'Play, or drag the slider. Coloured lanes show when traffic hid the road and what the policy did; N goes to the next occlusion.'],
  ['#results', 'Find the reasons', 'Defects lists each one with the reason why it was found or missed. A click shows the moment and its image.'],
];

export class Tour {
  #card; #title; #words; #back; #next; #step = -1; #before = null;

  constructor(card) {
    this.#card = card;
    this.#title = element('h2', { id: 'tour-title' });
    this.#words = element('p', { id: 'tour-words' });
    this.#back = element('button', { type: 'button' }, 'Back');
    this.#next = element('button', { type: 'button', className: 'main' }, 'Next');
    const skip = element('button', { type: 'button', className: 'skip' }, 'Skip');
    card.append(this.#title, this.#words, element('div', { className: 'actions' }, skip, this.#back, this.#next));
    this.#back.addEventListener('click', () => this.#show(this.#step - 1));
    this.#next.addEventListener('click', () => this.#show(this.#step + 1));
    skip.addEventListener('click', () => this.end());
    card.addEventListener('keydown', event => {
      const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      event.stopPropagation(); // the page's own keys are for when the card is left
      if (event.key === 'Escape') this.end();
      else if (step && this.#step + step >= 0) this.#show(this.#step + step);
    });
    addEventListener('resize', () => this.#place());
  }

  /** The first time in this browser; a browser that a program drives is not shown around. */
  first() {
    if (kept(SEEN) === null && !navigator.webdriver) this.begin();
  }

  begin() {
    this.#before = document.activeElement;
    this.#card.hidden = false;
    this.#show(0);
  }

  end() {
    keep(SEEN, 'seen');
    this.#card.hidden = true;
    this.#mark(null);
    this.#step = -1;
    (this.#before?.isConnected ? this.#before : by('help')).focus();
  }

  #show(step) {
    if (step >= STEPS.length) return this.end();
    const [target, title, words] = STEPS[step];
    this.#step = step;
    this.#title.textContent = `${step + 1} of ${STEPS.length}: ${title}`;
    this.#words.textContent = words;
    this.#back.disabled = step === 0;
    this.#next.textContent = step === STEPS.length - 1 ? 'Done' : 'Next';
    this.#mark(document.querySelector(target));
    this.#place();
    this.#next.focus();
  }

  #mark(part) {
    for (const marked of document.querySelectorAll('.toured')) marked.classList.remove('toured');
    part?.classList.add('toured');
  }

  /** Beside the part, within the window: below it where there is room, else above, else over its lower end. */
  #place() {
    const part = document.querySelector('.toured');
    if (!part) return;
    const box = part.getBoundingClientRect(), { offsetWidth: wide, offsetHeight: tall } = this.#card;
    const below = box.bottom + GAP_PX, above = box.top - GAP_PX - tall;
    const top = below + tall < innerHeight ? below : above > EDGE_PX ? above : box.bottom - tall - 2 * GAP_PX;
    const left = Math.min(Math.max(EDGE_PX, box.left + GAP_PX), innerWidth - wide - EDGE_PX);
    Object.assign(this.#card.style, { left: `${left}px`, top: `${Math.max(EDGE_PX, top)}px` });
  }
}
