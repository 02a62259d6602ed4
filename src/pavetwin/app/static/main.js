// The page: wires the controls, the map, the camera, the timeline and the results to one flight and one clock.

import { Camera } from './camera.js';
import { Pilot } from './control.js';
import { DefectFrames } from './defect_frames.js';
import { by, element } from './dom.js';
import { Exhibits } from './exhibits.js';
import { Files } from './files.js';
import { MissionForm } from './form.js';
import { Frames } from './frames.js';
import { StreetMap } from './map.js';
import { drawScale, listenToMapTools, tellUnder, toggle } from './map_tools.js';
import { listenToNotice, notice } from './notice.js';
import { Flight } from './playback.js';
import { Player, arrowAct, playerKeys } from './player.js';
import { Results } from './results.js';
import { Selection } from './selection.js';
import { CancelledError, Tasks, fetchJson } from './server.js';
import { isDark, keep, kept, palette, setTheme, startTheme } from './theme.js';
import { Timeline } from './timeline.js';
import { Tour } from './tour.js';
import { TOWN_MODES, TownPanel } from './town_panel.js';
import { NewTown } from './upload.js';

const KEYS = [
  ['Enter', 'start the mission'], ['C', 'compare two policies'], ['Escape', 'cancel, or choose none'], ['Space', 'play or pause'],
  ['← →', 'a second back or on (shift: ten), away from the map'], ['N P', 'next or previous occlusion'], ['[ ]', 'slower, faster'],
  ['V', 'the other policy'], ['arrows', 'move the map, when it has the focus'], ['+ − 0', 'zoom the map; the whole town'],
  ['T', 'show or hide the town in 3-D'], ['1 2 3 4', 'see the town by hand, behind the UAV, from its camera, from a car'],
  ['U R', 'fly the UAV yourself, or drive a car'], ['M', 'build a town from a street map'], ['O', 'make the choices of a mission.yaml'],
  ['X', 'choose the street, or the defect, in the middle of the map'], ['A', 'choose all streets in view'],
  ['B', 'drag a box around streets'], ['F', 'follow the UAV'], ['D', 'light or dark'], ['?', 'these keys'],
];

startTheme();
const page = { map: null, task: null };
const seek = t => player.seek(t), showDefect = id => player.showDefect(id);
const [map, camera, timeline, results, town] = [
  new StreetMap(by('map'), { pick: (ids, how) => selection?.pick(ids, how), hover: tellUnder, defect: showDefect, view: () => drawScale(map.view), free: () => toggle('follow', false) }),
  new Camera(by('camera')),
  new Timeline(by('plots'), by('key'), seek),
  new Results(by('results'), showDefect),
  new TownPanel(by('town'), showDefect),
];
const player = new Player({ map, camera, timeline, results, town });
player.onMission = mission => {
  if (!mission || mission.isLive) files?.clear();
  else files.mission = player.flight.missions.indexOf(mission);
};
const pilot = new Pilot(by('pilot'), map, { begin: showLive, time: seek, end: () => setLive(false) });
const tour = new Tour(by('tour'));
let form = null, selection = null, tasks = null, start = null, newTown = null, files = null;

boot().catch(error => notice(error.message));

async function boot() {
  history.replaceState(null, '', location.pathname + location.hash); // the token is in a cookie now
  listen();
  showTown(kept('pavetwin-3d') !== 'no');
  tasks = new Tasks(isThere => { if (!isThere && start) notice('The server does not answer; is `pavetwin app` still running?'); });
  const frames = new Frames(tasks);
  camera.setFrames(frames);
  camera.setTown(town);
  results.frames = new DefectFrames(frames, moment => { player.play(false); seek(moment); });
  results.again = { choose: chooseAgain, fly: flyMissed };
  start = await fetchJson('api/start');
  files = new Files(by('files'), tasks, start.exports);
  form = new MissionForm(by('mission'), start, changed);
  selection = new Selection(by('selection'), tasks, form, id => map.segment(id)?.street ?? id, (chosen, drawn) => {
    map.setSelection(chosen);
    map.setDrawn(drawn);
    if (page.map) history.replaceState(null, '', form.address(selection.segments, selection.count, selection.order));
  });
  new Exhibits(by('exhibits'), by('exhibit'), tasks, start.exhibits);
  newTown = new NewTown(by('new-town'), tasks, start, showNewTown, chooseDescribed);
  if (!start.worlds.length) {
    by('selection').textContent = 'There is no town yet. Build one from a street map with + above; or generate one with `pavetwin world build --generate town -o worlds/town`, and start the page again.';
    by('start').disabled = by('compare').disabled = by('control').inert = true;
    return;
  }
  const shared = form.read(location.hash);
  await showWorld();
  selection.set(shared.segments.filter(id => map.segment(id)), shared.count, shared.order);
  document.documentElement.dataset.ready = 'yes';
  tour.first();
}

async function showWorld() {
  by('selection').classList.add('busy');
  page.map = await fetchJson(`api/worlds/${form.world}/map`);
  document.title = `${page.map.name} – PaveTwin`;
  by('credit').textContent = page.map.credit;
  player.setFlight(null);
  map.setWorld(page.map);
  camera.setWorld(page.map);
  town.setWorld(form.world);
  by('streets').replaceChildren(...[...new Set(page.map.segments.map(segment => segment.street))].sort().map(name => new Option(name)));
  setColours();
  await listFlown();
}

/** A town that was just built. Where there was none before, the page starts again with it. */
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
  await follow({ do: 'fly', world: form.world, request: form.request(selection.segments, selection.count, selection.order) });
}

/** Fly or drive by hand: it is shown while it grows, and played as any other flight afterwards. */
async function takeControl(what) {
  by('control').open = false;
  if (page.task || !form.isValid) return by('mission').reportValidity();
  const isLanded = await follow({ do: what, world: form.world, request: form.request(selection.segments, selection.count, selection.order) });
  if (!isLanded) return;
  const is = what === 'drive' ? 'The drive is over. It' : 'Landed. The flight';
  notice(`${is} can be played like any other, but it is no mission of this town: what you want to keep of it is under Files.`);
  by('notice').classList.add('told');
}

function showLive(flight) {
  setLive(true);
  player.setFlight(flight);
  const { x, y } = player.mission.at(0);
  map.showPlace(x, y, 7);
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
  const isLive = task.do === 'pilot' || task.do === 'drive', asked = page.task = tasks.ask(task, told => {
    if (told.live) return pilot.live(told.live);
    if (told.ready) {
      clearTimeout(late);
      busy.hidden = true;
      shown = (isLive ? pilot.begin(told.ready, asked) : showFlight(told.ready)).catch(error => notice(error.message));
      return;
    }
    if (shown) return isLive ? pilot.tell(`${told.what} …`) : files.tell(`${told.what} …`);
    words.textContent = told.what;
    if (told.share > 0) bar.value = told.share;
  });
  try {
    const done = await asked.promise;
    pilot.end();
    await (isLive || !shown ? showFlight(done) : shown);
    setFiles(done);
    files.tell('');
    await listFlown();
    isDone = true;
  } catch (error) {
    if (isLive && pilot.isFlying) player.setFlight(null);
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

async function showFlight(made) {
  const flight = await Flight.load(made.key);
  await flight.fetchAgents(0);
  player.setFlight(flight);
  setFiles(made);
  player.showWhole(page.map.base_m);
}

/** Let a mission.yaml be chosen. */
function openDescribed() {
  by('flown').open = false;
  const file = element('input', { type: 'file', accept: '.yaml,.yml' });
  file.addEventListener('change', () => { if (file.files[0]) chooseDescribed(file.files[0]); });
  file.click();
}

/** Make the choices of a mission.yaml that was chosen or dropped. */
async function chooseDescribed(file) {
  try {
    const { world, values, segments, left_out: left } = await tasks.ask({ do: 'choose', text: await file.text() }).promise;
    const isOther = world !== form.world;
    form.choose(world, values);
    if (isOther || !page.map) await showWorld();
    selection.set(segments);
    if (left.length) notice(`Chosen as ${file.name} says, but for what the page has no field for: ${left.join(', ')}. \`pavetwin fly --again\` flies it as it was.`);
    else notice(`Chosen as ${file.name} says. Start flies it.`, true);
  } catch (error) {
    notice(`${file.name}: ${error.message}`);
  }
}

function setFiles({ key, folder, files: names }) {
  files.set(key, folder, names, player.flight.missions.map(({ policy }) => policy), !player.mission.isByHand);
}

/** Choose the segments on which the mission missed something, to fly over them with other settings. */
function chooseAgain(segments) {
  selection.set(segments);
  notice('Chosen. Change the altitude or anything else, and press Start.', true);
}

async function flyMissed(segments) {
  if (page.task) return;
  const { flight, mission } = player;
  if (await follow({ do: 'fly_missed', world: form.world, key: flight.key, mission: flight.missions.indexOf(mission) })) selection.set(segments);
}

async function listFlown() {
  const { missions } = await tasks.ask({ do: 'missions', world: form.world }).promise;
  const entries = missions.map(name => {
    const button = element('button', { type: 'button' }, name);
    button.addEventListener('click', () => { by('flown').open = false; follow({ do: 'play', world: form.world, mission: name }); });
    return element('li', {}, button);
  });
  const other = element('button', { type: 'button', title: 'Make the choices of a mission.yaml (O); or drop the file on the page' }, 'From a mission.yaml …');
  other.addEventListener('click', openDescribed);
  by('flown').querySelector('ul').replaceChildren(element('li', {}, other), ...entries.length ? entries : [element('li', { className: 'empty' }, 'No mission of this town yet.')]);
}

// What is shown of the map.

/** Choose a street by its name or the only one that has a text in its name, or a segment by its id. */
function find(text) {
  if (!text) return;
  const found = map.named(text), streets = [...new Set(found.map(({ street }) => street))];
  if (!found.length) return notice(`No street here is named '${text}'.`);
  if (streets.length > 1) return notice(`Several streets have '${text}' in their names: ${streets.slice(0, 5).join(', ')}${streets.length > 5 ? ' …' : ''}.`);
  by('notice').hidden = true;
  selection.pick(found.map(segment => segment.id), { toggle: false });
  const boxes = found.map(segment => segment.box);
  map.show(...[0, 1].map(i => Math.min(...boxes.map(box => box[i]))), ...[2, 3].map(i => Math.max(...boxes.map(box => box[i]))), 1.8);
}

function box(on) { map.boxing = toggle('box', on); by('map').classList.toggle('boxing', map.boxing); }

function followUav(on) { map.following = toggle('follow', on); seek(player.time); }

function theme() { setTheme(isDark() ? 'light' : 'dark'); setColours(); map.redraw(); }

function showTown(on) {
  toggle('solid', on);
  keep('pavetwin-3d', on ? 'yes' : 'no');
  document.querySelector('main').classList.toggle('with-town', on);
  town.show(on);
}

async function share() {
  const address = location.origin + location.pathname + form.address(selection.segments, selection.count, selection.order);
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
    again: () => { by('keys').close(); tour.begin(); },
    build: () => newTown?.open(), 'control-uav': () => takeControl('pilot'), 'control-car': () => takeControl('drive'), cancel: () => page.task?.cancel(), box: () => box(),
  };
  for (const [id, act] of Object.entries(actions)) by(id).addEventListener('click', act);
  by('find').addEventListener('change', () => { find(by('find').value.trim()); by('find').value = ''; });
  listenToNotice();
  listenToMapTools(map, () => followUav());
  by('keys').querySelector('dl').append(...KEYS.flatMap(([key, words]) => [element('dt', {}, element('kbd', {}, key)), element('dd', {}, words)]));
  document.addEventListener('keydown', key);
}

function key(event) {
  const typed = event.target.matches('input:not([type="checkbox"], [type="range"]), select, textarea, dialog *');
  if (event.ctrlKey || event.metaKey || event.altKey || typed || !form || document.querySelector('dialog[open]')) return;
  const onTown = event.target === by('town').querySelector('canvas'), onButton = event.target.matches('button, summary, a, [type="range"], [role="tab"]');
  const acts = {
    ...playerKeys(player, map, onButton), Enter: onButton ? null : fly, Escape: escape, c: () => by('compare').click(), b: () => box(), f: () => followUav(), d: theme,
    m: () => newTown?.open(), o: openDescribed, x: () => map.clickMiddle(), a: () => map.pickView(), u: () => takeControl('pilot'), r: () => takeControl('drive'), t: () => showTown(!town.isShown), '?': () => by('keys').showModal(),
    ...Object.fromEntries(TOWN_MODES.map((mode, i) => [i + 1, () => town.setMode(mode)])),
  };
  const act = arrowAct(event, player, map, onButton || onTown) ?? acts[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (!act) return;
  event.preventDefault();
  act();
}

function escape() {
  if (page.task) page.task.cancel();
  else if (selection.segments.length) selection.set([]);
}

// For tests and for the console: the state at a moment, as it is drawn.
window.pavetwin = {
  get time() { return player.time; },
  seek,
  fetchAgents: t => player.flight.fetchAgents(t),
  agentsAt: t => player.flight.agentsAt(t),
  stateAt: t => player.mission.at(t),
  get mission() { return player.mission; },
  get flight() { return player.flight; },
  get frame() { return camera.frame; },
  map,
  screenOf: id => map.screenOf(id),
  get town() { return town.town; },
};
