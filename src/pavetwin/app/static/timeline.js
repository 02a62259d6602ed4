// Visibility, battery and what was found over time, with occlusions, waits, displacements, revisits and swaps.

import { uPlot } from './vendor.js';
import { clock } from './playback.js';

const LANES = { occlusion: 'hides', wait: 'wait', displace: 'displace', revisit: 'revisit', swap: 'battery' };
const WORDS = { occlusion: 'hidden', wait: 'waits', displace: 'steps aside', revisit: 'revisits', swap: 'swaps the battery' };
const LANE_PX = 5;
/** Beside the curves; the slider above them lies between the same two. */
const LEFT_PX = 44, RIGHT_PX = 20;

export class Timeline {
  #root; #key; #onSeek; #plot = null; #mission = null; #colours = null; #head = null; #spans = []; #time = 0;

  constructor(root, key, onSeek) {
    this.#root = root;
    this.#key = key;
    this.#onSeek = onSeek;
    new ResizeObserver(() => this.#plot?.setSize(this.#size())).observe(root);
  }

  setColours(colours) { this.#colours = colours; this.#draw(); }

  setMission(mission) {
    this.#mission = mission;
    this.#spans = mission ? mission.spans() : [];
    this.#draw();
  }

  setTime(t) {
    this.#time = t;
    if (!this.#plot || !this.#head) return;
    this.#head.style.left = `${this.#plot.valToPos(t, 'x')}px`;
  }

  #size() { return { width: Math.max(200, this.#root.clientWidth), height: Math.max(60, this.#root.clientHeight) }; }

  #draw() {
    this.#plot?.destroy();
    this.#plot = this.#head = null;
    this.#key.replaceChildren();
    if (!this.#mission || !this.#colours) return;
    const { track, defects } = this.#mission, colours = this.#colours, all = defects.length;
    const ink = getComputedStyle(document.documentElement).getPropertyValue('--soft').trim();
    const line = getComputedStyle(document.documentElement).getPropertyValue('--line').trim();
    const percent = share => (share === null ? null : 100 * share);
    const shown = [
      ['battery', colours.battery, track.battery.map(percent)],
      ['defects found', colours.outcomes.found, track.t_s.map(t => (all ? (100 * this.#mission.foundUpTo(t)) / all : null))],
      ['visibility o', colours.seeing, track.visibility.map(percent)],
    ].filter(([, , values]) => values.some(value => value !== null));
    const curves = shown.map(([label, colour]) => [label, colour]), data = [track.t_s, ...shown.map(([, , values]) => values)];
    const font = '11px system-ui, "DejaVu Sans", sans-serif';
    const axis = { stroke: ink, font, grid: { stroke: line, width: 1 }, ticks: { stroke: line, width: 1, size: 4 } };
    this.#plot = new uPlot({
      ...this.#size(), legend: { show: false }, cursor: { show: false }, padding: [LANE_PX * 5 + 2, RIGHT_PX, 0, 0],
      scales: { x: { time: false, range: [0, this.#mission.duration_s] }, y: { range: [0, 103] } },
      axes: [
        { ...axis, size: 24, gap: 2, values: (_, ticks) => ticks.map(clock), incrs: [5, 10, 15, 30, 60, 120, 300, 600, 1200, 1800, 3600] },
        { ...axis, size: LEFT_PX, gap: 3, splits: () => [0, 50, 100], values: (_, ticks) => ticks.map(tick => `${tick} %`) },
      ],
      series: [{}, ...curves.map(([label, stroke]) => ({ label, stroke, width: 1.5, points: { show: false }, spanGaps: false }))],
      hooks: { drawClear: [plot => this.#drawSpans(plot)], draw: [() => this.setTime(this.#time)] },
    }, data, this.#root);
    this.#head = document.createElement('div');
    this.#head.className = 'head';
    this.#plot.over.append(this.#head);
    this.#listen(this.#plot.over);
    this.#tellKey(curves);
    this.setTime(this.#time);
  }

  /** A lane for each kind of event above the curves, and bands behind them while the window is hidden. */
  #drawSpans(plot) {
    const pen = plot.ctx, ratio = devicePixelRatio || 1, { left, top, height, width } = plot.bbox;
    const threshold = plot.valToPos(100 * this.#mission.threshold, 'y', true);
    pen.save();
    pen.strokeStyle = this.#colours.hides;
    pen.globalAlpha = 0.6;
    pen.setLineDash([3 * ratio, 3 * ratio]);
    pen.beginPath();
    pen.moveTo(left, threshold);
    pen.lineTo(left + width, threshold);
    pen.stroke();
    pen.setLineDash([]);
    const kinds = Object.keys(LANES);
    for (const { from, to, what } of this.#spans) {
      const x = plot.valToPos(from, 'x', true), end = plot.valToPos(to, 'x', true), lane = kinds.indexOf(what);
      pen.fillStyle = this.#colour(what);
      if (what === 'occlusion') {
        pen.globalAlpha = 0.13;
        pen.fillRect(x, top, Math.max(ratio, end - x), height);
      }
      pen.globalAlpha = 1;
      pen.fillRect(x, top - (5 - lane) * LANE_PX * ratio - 2 * ratio, Math.max(2 * ratio, end - x), (LANE_PX - 1) * ratio);
    }
    pen.restore();
  }

  #colour(what) { return this.#colours[LANES[what]]; }

  #tellKey(curves) {
    const there = new Set(this.#spans.map(span => span.what));
    const entries = [
      ...curves.map(([label, colour]) => [label, colour, 'line']),
      ['threshold of o', this.#colours.hides, 'dashes'],
      ...Object.keys(LANES).filter(what => there.has(what)).map(what => [WORDS[what], this.#colour(what), '']),
    ];
    for (const [label, colour, form] of entries) {
      const entry = document.createElement('span'), mark = document.createElement('i');
      mark.className = form;
      mark.style.background = colour;
      entry.append(mark, label);
      this.#key.append(entry);
    }
  }

  #listen(over) {
    const seek = event => {
      const { left } = over.getBoundingClientRect();
      this.#onSeek(Math.min(this.#mission.duration_s, Math.max(0, this.#plot.posToVal(event.clientX - left, 'x'))));
    };
    over.addEventListener('pointerdown', event => { over.setPointerCapture(event.pointerId); seek(event); });
    over.addEventListener('pointermove', event => { if (over.hasPointerCapture(event.pointerId)) seek(event); });
  }
}
