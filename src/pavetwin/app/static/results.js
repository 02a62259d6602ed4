// The results of a flight: the tables of the command line, and every defect with why it was found or missed.

import { by, element } from './dom.js';
import { clock } from './playback.js';

const RESPONSES = {
  not_asked: 'enough of the window was visible, so the policy was not asked', go_on: 'the policy flew on', wait: 'the policy waited',
  displace: 'the UAV stepped aside', revisit: 'the UAV came back later',
};

export class Results {
  #panels; #onDefect; #colours = null; #mission = null; #filter = 'all'; #shown = null;
  /** The frames of a defect, where there is a server that renders them. */
  frames = null;
  /** Handlers of the segments on which a defect was missed: `choose(ids)`, `fly()`; null where nothing can be flown. */
  again = null;

  constructor(root, onDefect) {
    this.#panels = Object.fromEntries(['table', 'defects'].map(id => [id, root.querySelector(`#${id}`)]));
    this.#onDefect = onDefect;
    this.#tabs([...root.querySelectorAll('[role="tab"]')]);
    this.clear();
  }

  setColours(colours) { this.#colours = colours; this.#tellDefects(); }

  clear() {
    this.#mission = this.#shown = null;
    this.frames?.clear();
    this.#panels.table.replaceChildren(element('p', {}, 'No mission yet. Choose streets on the map, or leave the choice to the seed, and press Start.'));
    this.#panels.defects.replaceChildren(element('p', {}, 'Defects of the inspected streets are listed here after the flight: found, or missed with the reason.'));
  }

  setFlight(flight, mission) {
    this.#mission = mission;
    this.#shown = null;
    this.frames?.clear();
    const remarks = flight.remarks.map(text => element('p', { className: 'remark' }, text));
    this.#panels.table.replaceChildren(element('p', { className: 'sentence' }, flight.sentence), ...flight.tables.map(tableOf), ...remarks);
    this.#tellDefects();
  }

  showDefect(id) {
    by('tab-defects').click();
    this.#shown = id;
    this.#tellShown();
  }

  /** Mark the defect that is shown, and put its frames below it. */
  #tellShown() {
    this.frames?.clear();
    for (const button of this.#panels.defects.querySelectorAll('.list button[data-id]')) {
      const is = Number(button.dataset.id) === this.#shown;
      button.setAttribute('aria-current', is);
      if (!is) continue;
      if (this.frames && !this.#mission.car) button.after(this.frames.of(this.#mission, this.#mission.byId.get(this.#shown)));
      button.parentElement.scrollIntoView({ block: 'nearest' });
    }
  }

  #tellDefects() {
    if (!this.#mission || !this.#colours) return;
    this.frames?.clear();
    const counts = new Map();
    for (const { outcome } of this.#mission.defects) counts.set(outcome, (counts.get(outcome) ?? 0) + 1);
    const filters = [['all', this.#mission.defects.length], ...counts].map(([name, count]) => {
      const button = element('button', { type: 'button' }, `${name} ${count}`);
      button.setAttribute('aria-pressed', name === this.#filter);
      button.addEventListener('click', () => { this.#filter = name; this.#tellDefects(); });
      return button;
    });
    const shown = this.#mission.defects.filter(({ outcome }) => this.#filter === 'all' || this.#filter === outcome);
    this.#panels.defects.replaceChildren(
      element('div', { className: 'filter' }, ...filters),
      ...this.#againButtons(),
      element('ul', { className: 'list' }, ...shown.map(defect => element('li', {}, this.#row(defect)))),
    );
    if (this.#shown !== null) this.#tellShown();
  }

  /** To fly again over the streets on which a defect was missed that another flight could find. */
  #againButtons() {
    const segments = this.#mission.missedOn;
    if (!this.again || !segments.length) return [];
    const [choose, fly] = [element('button', { type: 'button' }, 'Choose'), element('button', { type: 'button' }, 'Fly them again')];
    choose.title = 'Choose these segments, to change the altitude or anything else before Start';
    fly.title = 'Fly the same mission over only these segments: pavetwin fly --again … --only-missed';
    choose.addEventListener('click', () => this.again.choose(segments));
    fly.addEventListener('click', () => this.again.fly(segments));
    return [element('div', { className: 'again' }, element('span', {}, `Missed on ${segments.length} segment${segments.length === 1 ? '' : 's'}:`), choose, ...this.#mission.isByHand ? [] : [fly])];
  }

  #row(defect) {
    const mark = element('i', { className: defect.found_s === null ? 'missed' : '' });
    mark.style.background = this.#colours.outcomes[defect.outcome];
    const moment = defect.found_s ?? defect.time_s;
    const button = element('button', { type: 'button' }, mark,
      element('span', {}, `${defect.class.replaceAll('_', ' ')}, ${sizeOf(defect)}, ${defect.severity}`),
      element('span', {}, moment === null || moment === undefined ? '' : clock(moment)),
      element('small', {}, `${defect.segment}: ${why(defect)}`));
    button.dataset.id = defect.id;
    button.addEventListener('click', () => this.#onDefect(defect.id));
    return button;
  }

  #tabs(tabs) {
    const choose = chosen => {
      for (const tab of tabs) {
        tab.setAttribute('aria-selected', tab === chosen);
        tab.tabIndex = tab === chosen ? 0 : -1;
        by(tab.getAttribute('aria-controls')).hidden = tab !== chosen;
      }
    };
    tabs.forEach((tab, at) => {
      tab.addEventListener('click', () => choose(tab));
      tab.addEventListener('keydown', event => {
        const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
        if (!step) return;
        const next = tabs[(at + step + tabs.length) % tabs.length];
        choose(next);
        next.focus();
        event.stopPropagation();
      });
    });
  }
}

function sizeOf({ class: kind, length_m, width_m, area_m2 }) {
  return kind.includes('crack') && length_m ? `${length_m.toFixed(1)} m × ${(1000 * width_m).toFixed(0)} mm` : `${area_m2.toFixed(2)} m²`;
}

/** Why a defect was found or missed, in words. */
export function why(defect) {
  if (defect.found_s !== null) {
    const seen = defect.visible === null || defect.visible === undefined ? '' : `, ${Math.round(100 * defect.visible)} % of it visible`;
    return `${defect.outcome}${seen}`;
  }
  const captures = `${defect.captures} capture${defect.captures === 1 ? '' : 's'}`;
  const shares = Object.entries(defect.hidden_by ?? {}).map(([words, share]) => `${Math.round(100 * share)} % ${words}`);
  const responses = (defect.responses ?? []).map(response => RESPONSES[response] ?? response);
  return [`missed: ${defect.reason}`, ...shares.length ? [shares.join(', ')] : [], captures, ...responses].join('; ');
}

const CAPTIONS = { policies: 'By policy', segments: 'By segment', streets: 'By street' };
/** So many fit side by side in the panel; policies are never more. */
const SIDE_BY_SIDE = 3;

/** A few policies, segments or streets stand side by side, so that their many measures need no scrolling to the side. */
function turned({ of, columns: [names, ...measures] }) {
  const hasTotal = measures.some(({ total }) => total), heads = [...names.cells, ...hasTotal ? [`all ${names.total}`] : []];
  const rows = measures.map(({ heading, cells, best, total }) => element('tr', {},
    element('th', { scope: 'row' }, heading.replaceAll('\n', ' ')),
    ...cells.map((cell, at) => element('td', { className: best.includes(at) ? 'best' : '' }, cell)),
    ...hasTotal ? [element('td', { className: 'total' }, total)] : []));
  const head = element('tr', {}, element('th', { scope: 'col', className: 'left' }), ...heads.map(name => element('th', { scope: 'col' }, name)));
  return tableWith(of, 'turned', element('thead', {}, head), element('tbody', {}, ...rows));
}

function tableWith(of, className, ...parts) {
  const table = element('table', { className }, element('caption', {}, CAPTIONS[of]), ...parts);
  table.dataset.of = of;
  return table;
}

function tableOf({ of, columns }) {
  if (of === 'policies' || columns[0].cells.length <= SIDE_BY_SIDE) return turned({ of, columns });
  const side = column => (column.is_left ? 'left' : '');
  const heads = columns.map(column => element('th', { className: side(column), scope: 'col' }, column.heading));
  const rows = columns[0].cells.map((_, row) => element('tr', {}, ...columns.map(column => {
    const classes = [side(column), column.best.includes(row) ? 'best' : ''].filter(Boolean).join(' ');
    return element('td', { className: classes }, column.cells[row]);
  })));
  const parts = [element('thead', {}, element('tr', {}, ...heads)), element('tbody', {}, ...rows)];
  if (columns.some(column => column.total)) {
    parts.push(element('tfoot', {}, element('tr', {}, ...columns.map(column => element('td', { className: side(column) }, column.total)))));
  }
  return tableWith(of, '', ...parts);
}
