// The page: wires the controls, the map, the camera, the timeline and the results to one flight and one clock.

import { Camera } from './camera.js';
import { Pilot } from './control.js';
import { by, element } from './dom.js';
import { Exhibits } from './exhibits.js';
import { MissionForm } from './form.js';
import { Frames } from './frames.js';
import { StreetMap } from './map.js';
import { Flight, clock } from './playback.js';
import { Results } from './results.js';
import { Selection } from './selection.js';
import { CancelledError, Tasks, fetchJson } from './server.js';
import { isDark, keep, kept, palette, setTheme, startTheme } from './theme.js';
import { Timeline } from './timeline.js';
import { TOWN_MODES, TownPanel } from './town_panel.js';
import { NewTown } from './upload.js';

const LAYERS = { buildings: 'buildings', trees: 'trees', names: 'street names', traffic: 'traffic', parked: 'parked vehicles', route: 'route', windows: 'seen surface', defects: 'defects' };
const KEYS = [
  ['Enter', 'start the mission'], ['C', 'compare two policies'], ['Escape', 'cancel, or choose none'], ['Space', 'play or pause'],
  ['← →', 'a second back or on (shift: ten), away from the map'], ['N P', 'next or previous occlusion'], ['[ ]', 'slower, faster'],
  ['V', 'the other policy'], ['arrows', 'move the map, when it has the focus'], ['+ − 0', 'zoom the map; the whole town'],
  ['T', 'show or hide the town in 3-D'], ['1 2 3 4', 'see the town by hand, behind the UAV, from its camera, from a car'],
  ['U', 'fly the UAV yourself'], ['M', 'build a town from a street map'], ['B', 'drag a box around streets'], ['F', 'follow the UAV'], ['D', 'light or dark'], ['?', 'these keys'],
];

startTheme();
const page = {
  flight: null, mission: null, time: 0, playing: false, last: 0, map: null, task: null, shownWorld: null,
};
const [map, camera, timeline, results, town] = [
  new StreetMap(by('map'), { pick: (ids, how) => selection?.pick(ids, how), hover: tell, defect: showDefect, view: drawScale }),
  new Camera(by('camera')),
  new Timeline(by('plots'), by('key'), seek),
  new Results(by('results'), showDefect),
  new TownPanel(by('town'), showDefect),
];
const pilot = new Pilot(by('pilot'), map, { begin: showLive, time: seek, end: () => setLive(false) });
let form = null, selection = null, tasks = null, start = null, newTown = null;

boot().catch(error => notice(error.message));

async function boot() {
  history.replaceState(null, '', location.pathname + location.hash); // the token is in a cookie now
  listen();
  setPlayer();
  showTown(kept('pavetwin-3d') !== 'no');
  tasks = new Tasks(isThere => { if (!isThere && start) notice('The server does not answer; is `pavetwin app` still running?'); });
  camera.setFrames(new Frames(tasks));
  start = await fetchJson('api/start');
  form = new MissionForm(by('mission'), start, changed);
  selection = new Selection(by('selection'), tasks, form, (chosen, drawn) => {
    map.setSelection(chosen);
    map.setDrawn(drawn);
    if (page.map) history.replaceState(null, '', form.address(selection.segments, selection.count));
  });
  new Exhibits(by('exhibits'), by('exhibit'), tasks, start.exhibits);
  newTown = new NewTown(by('new-town'), tasks, start, showNewTown);
  if (!start.worlds.length) {
    by('selection').textContent = 'There is no town yet. Build one from a street map with + above; or generate one with `pavetwin world build --generate town -o worlds/town`, and start the page again.';
    by('start').disabled = by('compare').disabled = by('control').disabled = true;
    return;
  }
  const shared = form.read(location.hash);
  await showWorld();
  selection.set(shared.segments.filter(id => map.segment(id)), shared.count);
  document.documentElement.dataset.ready = 'yes';
}

async function showWorld() {
  page.shownWorld = form.world;
  by('selection').classList.add('busy');
  page.map = await fetchJson(`api/worlds/${form.world}/map`);
  document.title = `${page.map.name} – PaveTwin`;
  by('credit').textContent = page.map.credit;
  setFlight(null);
  map.setWorld(page.map);
  camera.setWorld(page.map);
  town.setWorld(form.world);
  by('streets').replaceChildren(...[...new Set(page.map.segments.map(segment => segment.street))].sort().map(name => new Option(name)));
  setColours();
  await listFlown();
}

/** A town that was just built. Where there was none before, the page begins anew with it. */
async function showNewTown(world) {
  if (!page.map) {
    location.hash = new URLSearchParams({ world: world.name });
    location.reload();
    return;
  }
  form.addWorld(world);
  await showWorld();
  selection.set([]);
}

async function changed(event) {
  if (!by('mission').elements) return;
  if (event?.target.name === 'world') {
    await showWorld().catch(error => notice(error.message));
    selection.set([]);
    return;
  }
  selection.update();
}

function setColours() {
  if (!page.map) return;
  const colours = palette(page.map.colours);
  for (const part of [map, camera, timeline, results]) part.setColours(colours);
}

// Flying.

async function fly() {
  if (page.task || !form.isValid) return by('mission').reportValidity();
  await follow({ do: 'fly', world: form.world, request: form.request(selection.segments, selection.count) });
}

/** Fly by hand: the flight is shown while it grows, and played as any other once the UAV has landed. */
async function takeControl() {
  if (page.task || !form.isValid) return by('mission').reportValidity();
  const isLanded = await follow({ do: 'pilot', world: form.world, request: form.request(selection.segments, selection.count) });
  if (!isLanded) return;
  notice('Landed. The flight can be played like any other, but it is no mission of this town: what you want to keep of it is under Files.');
  by('notice').classList.add('told');
}

function showLive(flight) {
  setLive(true);
  setFlight(flight);
  map.showPlace(...page.map.base_m, 7);
  followUav(true);
}

/** Nothing else can be started while the UAV is flown by hand. */
function setLive(on) {
  for (const part of [by('mission'), by('flown'), by('share'), document.querySelector('footer')]) part.inert = on;
}

/** Start a task that ends in a flight, and show it as soon as it can be played. */
async function follow(task) {
  let shown = null;
  const busy = by('progress'), [words, bar] = [busy.querySelector('span'), busy.querySelector('progress')];
  words.textContent = 'Starting …';
  bar.removeAttribute('value');
  const late = setTimeout(() => { busy.hidden = false; }, 300);
  by('start').disabled = true;
  let isDone = false;
  const isLive = task.do === 'pilot', asked = page.task = tasks.ask(task, told => {
    if (told.live) return pilot.live(told.live);
    if (told.ready) {
      clearTimeout(late);
      busy.hidden = true;
      shown = (isLive ? pilot.begin(told.ready, asked) : showFlight(told.ready)).catch(error => notice(error.message));
      return;
    }
    if (shown) return isLive ? pilot.tell(`${told.what} …`) : results.tellFiles(`${told.what} …`);
    words.textContent = told.what;
    if (told.share > 0) bar.value = told.share;
  });
  try {
    const done = await asked.promise;
    pilot.end();
    await (isLive || !shown ? showFlight(done) : shown);
    results.setFiles(done.key, done.folder, done.files);
    await listFlown();
    isDone = true;
  } catch (error) {
    if (isLive && pilot.isFlying) setFlight(null);
    notice(error instanceof CancelledError ? 'Cancelled.' : error.message, error instanceof CancelledError);
  } finally {
    clearTimeout(late);
    busy.hidden = true;
    by('start').disabled = false;
    page.task = null;
    pilot.end();
  }
  return isDone;
}

async function showFlight({ key, folder, files }) {
  const flight = await Flight.load(key);
  await flight.fetchAgents(0);
  setFlight(flight);
  results.setFiles(key, folder, files);
  const targets = flight.missions[0].targets.map(id => map.segment(id)).filter(Boolean), base = page.map.base_m;
  const boxes = [...targets.map(segment => segment.box), [...base, ...base]];
  map.show(...[0, 1].map(i => Math.min(...boxes.map(box => box[i]))), ...[2, 3].map(i => Math.max(...boxes.map(box => box[i]))), 1.3);
}

async function listFlown() {
  const { missions } = await tasks.ask({ do: 'missions', world: form.world }).promise;
  const entries = missions.map(name => {
    const button = element('button', { type: 'button' }, name);
    button.addEventListener('click', () => { by('flown').open = false; follow({ do: 'play', world: form.world, mission: name }); });
    return element('li', {}, button);
  });
  by('flown').querySelector('ul').replaceChildren(...entries.length ? entries : [element('li', { className: 'empty' }, 'No mission of this town yet.')]);
}

function setFlight(flight) {
  page.flight = flight;
  page.playing = false;
  page.time = 0;
  setMission(flight?.missions[0] ?? null);
  const choices = flight && flight.missions.length > 1 ? flight.missions : [];
  by('policies').hidden = !choices.length;
  by('policies').replaceChildren(...choices.map(mission => {
    const button = element('button', { type: 'button' }, mission.policy);
    button.setAttribute('role', 'radio');
    button.addEventListener('click', () => setMission(mission));
    return button;
  }));
  tellPolicy();
}

function setMission(mission) {
  page.mission = mission;
  map.setFlight(page.flight, mission);
  camera.setFlight(page.flight, mission);
  town.setFlight(page.flight, mission);
  const flown = mission?.isLive ? null : mission;
  timeline.setMission(flown);
  if (flown) results.setFlight(page.flight, flown);
  else results.clear();
  document.querySelector('footer .empty').hidden = Boolean(flown);
  by('scrub').max = mission?.duration_s ?? 0;
  setPlayer();
  tellPolicy();
  seek(Math.min(page.time, mission?.duration_s ?? 0));
}

function tellPolicy() {
  for (const button of by('policies').children) button.setAttribute('aria-checked', button.textContent === page.mission?.policy);
}

// The clock.

function seek(t) {
  page.time = Math.max(0, Math.min(t, page.mission?.duration_s ?? 0));
  showTime();
  const { flight, time } = page;
  flight?.fetchAgents(time).then(isNew => { if (isNew && page.flight === flight) showTime(); }, error => notice(error.message));
  by('scrub').value = page.time;
  const words = `${clock(page.time)} / ${clock(page.mission?.duration_s ?? 0)}`;
  by('clock').textContent = words;
  by('scrub').setAttribute('aria-valuetext', words);
}

function showTime() {
  map.setTime(page.time);
  town.setTime(page.time);
  camera.setTime(page.time, page.playing ? Number(by('speed').value) : 0);
  timeline.setTime(page.time);
}

function play(on) {
  page.playing = on && Boolean(page.mission);
  if (page.playing && page.time >= page.mission.duration_s - 0.05) seek(0);
  page.last = performance.now();
  setPlayer();
  if (!page.playing) camera.setTime(page.time);
  if (page.playing) requestAnimationFrame(tick);
}

function tick(now) {
  if (!page.playing) return;
  const t = page.time + ((now - page.last) / 1000) * Number(by('speed').value);
  page.last = now;
  seek(t);
  if (t >= page.mission.duration_s) return play(false);
  requestAnimationFrame(tick);
}

function jump(direction) {
  const moments = page.mission?.occlusions ?? [];
  const found = direction > 0 ? moments.find(t => t > page.time + 0.05) : moments.findLast(t => t < page.time - 0.05);
  if (found !== undefined) seek(found);
  else if (page.mission) notice(`There is no ${direction > 0 ? 'later' : 'earlier'} occlusion.`, true);
}

function setPlayer() {
  const has = Boolean(page.mission);
  for (const id of ['play', 'previous', 'next', 'speed', 'scrub']) by(id).disabled = !has;
  by('play').textContent = page.playing ? '❚❚' : '▶';
  by('play').setAttribute('aria-label', page.playing ? 'Pause' : 'Play');
}

// What is shown of the map.

function showDefect(id) {
  const defect = page.mission?.byId.get(id);
  if (!defect) return;
  map.setDefect(id);
  results.showDefect(id);
  map.showPlace(...defect.place_m);
  town.showPlace(...defect.place_m);
  const moment = defect.found_s ?? defect.time_s;
  if (moment !== null && moment !== undefined) { play(false); seek(moment); }
}

function tell(segment, defect, x, y) {
  const tip = by('tip'), root = by('map');
  tip.hidden = !segment && !defect;
  if (defect) tip.textContent = `${defect.class.replaceAll('_', ' ')} ${defect.id}\n${defect.outcome}${defect.reason ? `: ${defect.reason}` : ''}`;
  if (segment) tip.textContent = `${segment.street}, ${segment.id}\n${segment.length_m.toFixed(0)} m × ${segment.width_m} m, ${segment.lanes} lane${segment.lanes === 1 ? '' : 's'}, ${segment.area_m2} m²`;
  tip.style.left = `${Math.min(x + 14, root.clientWidth - tip.offsetWidth - 6)}px`;
  tip.style.top = `${Math.min(y + 14, root.clientHeight - tip.offsetHeight - 6)}px`;
}

function drawScale() {
  const { k } = map.view, power = 10 ** Math.floor(Math.log10(110 / k)), metres = [5, 2, 1].find(factor => factor * power * k <= 110) * power;
  by('scale').style.width = `${metres * k}px`;
  by('scale').firstElementChild.textContent = metres >= 1000 ? `${metres / 1000} km` : `${+metres.toPrecision(3)} m`;
}

function find(name) {
  const found = map.segments.filter(segment => segment.street === name || segment.id === name || segment.latin === name);
  if (!found.length) return;
  selection.pick(found.map(segment => segment.id), { toggle: false });
  const boxes = found.map(segment => segment.box);
  map.show(...[0, 1].map(i => Math.min(...boxes.map(box => box[i]))), ...[2, 3].map(i => Math.max(...boxes.map(box => box[i]))), 1.8);
}

function notice(words, isTold = false) {
  by('notice').firstElementChild.textContent = words;
  by('notice').classList.toggle('told', isTold);
  by('notice').hidden = false;
  clearTimeout(notice.timer);
  if (isTold) notice.timer = setTimeout(() => { by('notice').hidden = true; }, 3500);
}

function toggle(id, on = by(id).getAttribute('aria-pressed') !== 'true') {
  by(id).setAttribute('aria-pressed', on);
  return on;
}

function box(on) { map.boxing = toggle('box', on); by('map').classList.toggle('boxing', map.boxing); }

function followUav(on) { map.following = toggle('follow', on); seek(page.time); }

function theme() { setTheme(isDark() ? 'light' : 'dark'); setColours(); map.redraw(); }

function showTown(on) {
  toggle('solid', on);
  keep('pavetwin-3d', on ? 'yes' : 'no');
  document.querySelector('main').classList.toggle('with-town', on);
  town.show(on);
}

async function share() {
  const address = location.origin + location.pathname + form.address(selection.segments, selection.count);
  try {
    await navigator.clipboard.writeText(address);
    notice('The address of this mission is copied.', true);
  } catch {
    notice(address, false);
  }
}

function listen() {
  by('mission').addEventListener('submit', event => { event.preventDefault(); fly(); });
  const actions = {
    compare: () => { form.compare(!form.isCompared); selection.update(); }, share, theme, solid: () => showTown(!town.isShown), help: () => by('keys').showModal(),
    build: () => newTown?.open(), control: takeControl, play: () => play(!page.playing), previous: () => jump(-1), next: () => jump(1), cancel: () => page.task?.cancel(),
    in: () => map.zoom(1.4), out: () => map.zoom(1 / 1.4), fit: () => map.fit(), box: () => box(), follow: () => followUav(),
  };
  for (const [id, act] of Object.entries(actions)) by(id).addEventListener('click', act);
  by('scrub').addEventListener('input', () => { play(false); seek(Number(by('scrub').value)); });
  by('find').addEventListener('change', () => { find(by('find').value.trim()); by('find').value = ''; });
  by('notice').querySelector('button').addEventListener('click', () => { by('notice').hidden = true; });
  by('layers').querySelector('ul').append(...Object.entries(LAYERS).map(([layer, words]) => {
    const check = element('input', { type: 'checkbox', checked: map.layers.has(layer) });
    check.addEventListener('change', () => { map.layers[check.checked ? 'add' : 'delete'](layer); map.redraw(); });
    return element('li', {}, element('label', {}, check, words));
  }));
  by('keys').querySelector('dl').append(...KEYS.flatMap(([key, words]) => [element('dt', {}, element('kbd', {}, key)), element('dd', {}, words)]));
  document.addEventListener('pointerdown', event => {
    for (const menu of document.querySelectorAll('details[open]')) if (!menu.contains(event.target)) menu.open = false;
  });
  document.addEventListener('keydown', key);
}

function key(event) {
  const typed = event.target.matches('input:not([type="checkbox"], [type="range"]), select, textarea, dialog *');
  if (event.ctrlKey || event.metaKey || event.altKey || typed || !form || document.querySelector('dialog[open]')) return;
  const onMap = event.target === by('map').querySelector('.moving'), onTown = event.target === by('town').querySelector('canvas'), onButton = event.target.matches('button, summary, a, [type="range"], [role="tab"]');
  const arrow = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
  const acts = {
    Enter: onButton ? null : fly, ' ': onButton ? null : () => play(!page.playing), Escape: escape, n: () => jump(1), p: () => jump(-1),
    c: () => by('compare').click(), v: otherPolicy, b: () => box(), f: () => followUav(), d: theme, m: () => newTown?.open(), u: takeControl, t: () => showTown(!town.isShown), '?': () => by('keys').showModal(),
    '+': () => map.zoom(1.4), '=': () => map.zoom(1.4), '-': () => map.zoom(1 / 1.4), 0: () => map.fit(), '[': () => speed(-1), ']': () => speed(1),
    ...Object.fromEntries(TOWN_MODES.map((mode, i) => [i + 1, () => town.setMode(mode)])),
  };
  let act = acts[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (arrow && onMap) act = () => map.move(0.12 * arrow[0], 0.12 * arrow[1]);
  else if (arrow && arrow[0] && !onButton && !onTown) act = () => { play(false); seek(page.time + arrow[0] * (event.shiftKey ? 10 : 1)); };
  if (!act) return;
  event.preventDefault();
  act();
}

function escape() {
  if (page.task) page.task.cancel();
  else if (selection.segments.length) selection.set([]);
}

function speed(step) {
  const { options } = by('speed');
  by('speed').selectedIndex = Math.max(0, Math.min(options.length - 1, by('speed').selectedIndex + step));
}

function otherPolicy() {
  const { missions = [] } = page.flight ?? {};
  if (missions.length > 1) setMission(missions[(missions.indexOf(page.mission) + 1) % missions.length]);
}

// For tests and for the console: the state at a moment, as it is drawn.
window.pavetwin = {
  get time() { return page.time; },
  seek,
  fetchAgents: t => page.flight.fetchAgents(t),
  agentsAt: t => page.flight.agentsAt(t),
  stateAt: t => page.mission.at(t),
  get mission() { return page.mission; },
  get frame() { return camera.frame; },
  screenOf: id => map.screenOf(id),
  get town() { return town.town; },
};
