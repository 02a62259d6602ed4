// The page: wires the controls, the map, the camera, the timeline and the results to one flight and one clock.

import { Camera } from './camera.js';
import { Pilot } from './control.js';
import { DefectFrames } from './defect_frames.js';
import { by, element } from './dom.js';
import { Exhibits } from './exhibits.js';
import { Files } from './files.js';
import { MissionForm } from './form.js';
import { Frames } from './frames.js';
import { PAGE_KEYS, closeMenu, listenToKeys } from './keys.js';
import { StreetMap } from './map.js';
import { drawScale, listenToMapTools, tellUnder, toggle } from './map_tools.js';
import { listenToNotice, notice, withdraw } from './notice.js';
import { Flight } from './playback.js';
import { Player, arrowAct, playerKeys } from './player.js';
import { Results } from './results.js';
import { Selection } from './selection.js';
import { CancelledError, Tasks, fetchJson, fetchText } from './server.js';
import { isDark, keep, kept, palette, setTheme, startTheme } from './theme.js';
import { Timeline } from './timeline.js';
import { Tour } from './tour.js';
import { TOWN_MODES, TownPanel } from './town_panel.js';
import { NewTown } from './upload.js';

const GONE = 'The server does not answer; is `pavetwin app` still running?';

startTheme();
/** `isShown`: the task's mission is there, and its pictures are being drawn. */
const page = { map: null, task: null, isShown: false };
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
  const frames = new Frames();
  tasks = frames.tasks = new Tasks(isThere => {
    if (!isThere) return start && notice(GONE);
    withdraw(GONE);
    frames.retry();
    selection?.update();
  });
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
    for (const part of [by('start'), by('compare')]) part.disabled = true;
    for (const part of [by('control'), by('share'), by('map')]) part.inert = true;
    by('flown').querySelector('ul').replaceChildren(element('li', { className: 'empty' }, 'No town, no missions.'));
    town.message('A town is drawn here in 3-D once there is one.');
    document.querySelector('header').inert = false;
    return;
  }
  await readAddress(location.hash);
  addEventListener('hashchange', ({ newURL }) => readAddress(new URL(newURL).hash).catch(error => notice(error.message)));
  document.querySelector('header').inert = false;
  document.documentElement.dataset.ready = 'yes';
  tour.first();
}

/** Make the choices of an address, and report what of it is missing here. */
async function readAddress(hash) {
  if (isBusy()) return;
  const { segments, count, order, missing } = form.read(hash);
  if (!await showWorld()) return;
  const here = missing ? [] : segments.filter(id => map.segment(id)), lacks = segments.length - here.length;
  selection.set(here, count, order);
  if (missing) notice(`This page does not have the town '${missing}' of the address; it shows ${form.worldName}.`);
  else if (lacks) notice(`The address names ${lacks} segment${lacks === 1 ? '' : 's'} that ${form.worldName} does not have.`);
}

/** Show the town that is chosen. Returns whether it is still the chosen one when its map is there. */
async function showWorld() {
  const { world } = form;
  by('selection').classList.add('busy');
  const read = await fetchJson(`api/worlds/${world}/map`);
  if (form.world !== world) return false;
  page.map = read;
  document.title = `${page.map.name} – PaveTwin`;
  by('credit').textContent = page.map.credit;
  player.setFlight(null);
  map.setWorld(page.map);
  camera.setWorld(page.map);
  town.setWorld(form.world);
  by('streets').replaceChildren(...[...new Set(page.map.segments.map(segment => segment.street))].sort().map(name => new Option(name)));
  setColours();
  await listFlown();
  return true;
}

/** A town that was just built. Where there was none before, the page starts again with it. */
async function showNewTown(world) {
  if (!page.map) {
    location.hash = new URLSearchParams({ world: world.name });
    location.reload();
    return;
  }
  form.addWorld(world, !page.task);
  if (page.task) notice(`${world.name} is built. Choose it once the mission has ended.`, true);
  else if (await showWorld()) selection.set([]);
}

async function changed(event) {
  if (!by('mission').elements) return;
  if (event?.target.name === 'world') {
    if (await showWorld().catch(error => notice(error.message))) selection.set([]);
    return;
  }
  selection.update();
}

/** Whether a mission is on its way, which other choices would disturb; shows a notice if so. */
function isBusy() {
  if (page.task) notice('A mission is running. Wait for its end, or cancel it.', true);
  return page.task !== null;
}

function setColours() {
  if (!page.map) return;
  const colours = palette(page.map.colours);
  for (const part of [map, camera, timeline, results]) part.setColours(colours);
}

// Flying.

async function fly() {
  if (!page.map || isBusy() || !form.isValid) return by('mission').reportValidity();
  await follow({ do: 'fly', world: form.world, request: form.request(selection.segments, selection.count, selection.order) });
}

/** Fly or drive by hand: it is shown while it grows, and played as any other flight afterwards. */
async function takeControl(what) {
  by('control').open = false;
  if (!page.map || isBusy() || !form.isValid) return by('mission').reportValidity();
  const isLanded = await follow({ do: what, world: form.world, request: form.request(selection.segments, selection.count, selection.order) });
  if (!isLanded) return;
  const is = what === 'drive' ? 'The drive is over. It' : 'Landed. The flight';
  notice(`${is} can be played like any other, but it is not a mission of this town; its files are under Files.`);
  by('notice').classList.add('status');
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

/** While a task runs its town stays the chosen one. */
function setTask(task) {
  page.task = task;
  page.isShown = false;
  by('start').disabled = by('mission').elements.world.disabled = task !== null;
}

/** Start a task that ends in a flight, and show it as soon as it can be played. Returns whether it came to its end. */
async function follow(task) {
  if (isBusy()) return false;
  let shown = null;
  const busy = by('progress'), [words, bar] = [busy.querySelector('span'), busy.querySelector('progress')];
  words.textContent = 'Starting …';
  bar.removeAttribute('value');
  const late = setTimeout(() => { busy.hidden = false; }, 300);
  let isDone = false;
  const isLive = task.do === 'pilot' || task.do === 'drive', asked = tasks.ask(task, report => {
    if (report.live) return pilot.live(report.live);
    if (report.ready) {
      clearTimeout(late);
      page.isShown = !isLive;
      busy.hidden = true;
      shown = (isLive ? pilot.begin(report.ready, asked) : showFlight(report.ready)).catch(error => notice(error.message));
      return;
    }
    if (shown) return isLive ? pilot.status(`${report.what} …`) : files.status(`${report.what} …`);
    words.textContent = report.what;
    if (report.share > 0) bar.value = report.share;
  });
  setTask(asked);
  try {
    const done = await asked.promise;
    pilot.end();
    await (isLive || !shown ? showFlight(done) : shown);
    setFiles(done);
    files.status('');
    await listFlown();
    isDone = true;
  } catch (error) {
    if (isLive && pilot.isFlying) player.setFlight(null);
    notice(error instanceof CancelledError ? 'Cancelled.' : error.message, error instanceof CancelledError);
  } finally {
    clearTimeout(late);
    busy.hidden = true;
    setTask(null);
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
  if (isBusy()) return;
  try {
    const left = await choose(await file.text());
    if (left.length) notice(`Selected the choices of ${file.name}, except those without a field on the page: ${left.join(', ')}. \`pavetwin fly --again\` repeats the mission exactly.`);
    else notice(`Selected the choices of ${file.name}. Press Start to fly.`, true);
  } catch (error) {
    notice(`${file.name}: ${error.message}`);
  }
}

/** Make the choices of the text of a mission.yaml. Returns those for which the page has no field. */
async function choose(text, against = null) {
  const { world, values, segments, left_out: left } = await tasks.ask({ do: 'choose', text }).promise;
  const isOther = world !== form.world;
  form.choose(world, { ...values, ...against && { against } });
  if (isOther || !page.map) await showWorld();
  selection.set(segments);
  return left;
}

/** Play a mission that was flown before, with its choices, so that the page's address is that of what is shown. */
async function playAgain(name) {
  by('flown').open = false;
  if (!await follow({ do: 'play', world: form.world, mission: name })) return;
  const { flight } = player, [first, second] = flight.missions;
  const path = second ? `${first.policy}/mission.yaml` : 'mission.yaml';
  await choose(await fetchText(`api/played/${flight.key}/files/${path}`), second?.policy).catch(() => {});
}

function setFiles({ key, folder, files: names }) {
  files.set(key, folder, names, player.flight.missions.map(({ policy }) => policy), !player.mission.isByHand);
}

/** Choose the segments on which the mission missed something, to fly over them with other settings. */
function chooseAgain(segments) {
  selection.set(segments);
  notice('Selected. Change the altitude or anything else, and press Start.', true);
}

async function flyMissed(segments) {
  const { flight, mission } = player;
  if (await follow({ do: 'fly_missed', world: form.world, key: flight.key, mission: flight.missions.indexOf(mission) })) selection.set(segments);
}

async function listFlown() {
  const { missions } = await tasks.ask({ do: 'missions', world: form.world }).promise;
  const entries = missions.map(name => {
    const button = element('button', { type: 'button' }, name);
    button.addEventListener('click', () => playAgain(name));
    return element('li', {}, button);
  });
  const other = element('button', { type: 'button', title: 'Load the choices of a mission.yaml (O); or drop the file on the page' }, 'From a mission.yaml …');
  other.addEventListener('click', openDescribed);
  by('flown').querySelector('ul').replaceChildren(element('li', {}, other), ...entries.length ? entries : [element('li', { className: 'empty' }, 'No mission of this town yet.')]);
}

// What is shown of the map.

/** Choose a street by its name or the only one that has a text in its name, or a segment by its id. */
function find(text) {
  if (!text) return;
  const found = map.named(text), streets = [...new Set(found.map(({ street }) => street))];
  if (!found.length) return notice(`There is no street named '${text}'.`);
  if (streets.length > 1) return notice(`Several streets have '${text}' in their names: ${streets.slice(0, 5).join('; ')}${streets.length > 5 ? '; …' : '.'}`);
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
    notice('Copied the address of this mission.', true);
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
  listenToKeys(PAGE_KEYS, keyAct);
}

/** What a key does, where it is not the focused control's own; see keys.js. */
function keyAct(event, { isButton, isSlider }) {
  if (!form) return null;
  const onTown = event.target === by('town').querySelector('canvas');
  const acts = {
    ...playerKeys(player, map, isButton), Enter: isButton || isSlider ? null : fly, Escape: escape, c: () => by('compare').click(), b: () => box(), f: () => followUav(), d: theme,
    m: () => newTown?.open(), o: openDescribed, x: () => map.clickMiddle(), a: () => map.pickView(), u: () => takeControl('pilot'), r: () => takeControl('drive'), t: () => showTown(!town.isShown), '?': () => by('keys').showModal(),
    ...Object.fromEntries(TOWN_MODES.map((mode, i) => [i + 1, () => town.setMode(mode)])),
  };
  return arrowAct(event, player, map, isButton || isSlider || onTown) ?? acts[event.key.length === 1 ? event.key.toLowerCase() : event.key];
}

/** Close a menu, give up a task, or choose none: the first of these that there is. */
function escape() {
  if (closeMenu()) return;
  if (!page.task) {
    if (selection.segments.length) selection.set([]);
  } else if (!page.isShown) page.task.cancel(); // else its maps are being drawn
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
