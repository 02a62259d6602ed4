// One mission in one file: the page's map, camera, curves and results over what the file holds, without a server.

import { Camera } from './camera.js';
import { by, element } from './dom.js';
import { listenToKeys } from './keys.js';
import { StreetMap } from './map.js';
import { drawScale, listenToMapTools, tellUnder, toggle } from './map_tools.js';
import { listenToNotice, notice } from './notice.js';
import { Flight } from './playback.js';
import { Player, arrowAct, playerKeys } from './player.js';
import { Results } from './results.js';
import { fetchJson } from './server.js';
import { isDark, palette, setTheme, startTheme } from './theme.js';
import { Timeline } from './timeline.js';

/** What the page has for the server alone. */
const OF_SERVER = '#mission, #exhibits, #flown, #share, #solid, #find, #streets, #box, #selection, #pilot, #town, #camera .under label, #tab-files, #files, #progress, #new-town, #exhibit, #tour, #again';
const KEYS = [
  ['Space', 'play or pause'], ['← →', 'a second back or on (shift: ten), away from the map'], ['N P', 'next or previous occlusion'],
  ['[ ]', 'slower, faster'], ['V', 'the other policy'], ['arrows', 'move the map, when it has the focus'],
  ['+ − 0', 'zoom the map; the whole town'], ['F', 'follow the UAV'], ['D', 'light or dark'], ['?', 'these keys'],
];

for (const part of document.querySelectorAll(OF_SERVER)) part.remove();
document.querySelector('header').inert = false;
document.querySelector('main').classList.remove('with-town');
startTheme();
const seek = t => player.seek(t), showDefect = id => player.showDefect(id);
const map = new StreetMap(by('map'), { pick: () => {}, hover: tellUnder, defect: showDefect, view: () => drawScale(map.view), free: () => toggle('follow', false) });
const parts = { map, camera: new Camera(by('camera')), timeline: new Timeline(by('plots'), by('key'), seek), results: new Results(by('results'), showDefect) };
const player = new Player(parts);

async function boot() {
  listen();
  const town = await fetchJson('map');
  document.title = `${town.name} – PaveTwin`;
  document.querySelector('h1').after(element('span', { className: 'status' }, document.querySelector('meta[name="pavetwin-mission"]').content));
  by('credit').textContent = town.credit;
  map.setWorld(town);
  parts.camera.setWorld(town);
  setColours(town);
  const flight = await Flight.load('replay');
  await flight.fetchAgents(0);
  player.setFlight(flight);
  map.setSelection(flight.missions[0].targets);
  player.showWhole(town.base_m);
  window.pavetwin = {
    get time() { return player.time; }, get mission() { return player.mission; }, seek, fetchAgents: t => flight.fetchAgents(t),
    agentsAt: t => flight.agentsAt(t), stateAt: t => player.mission.at(t),
  };
  listenToTheme(town);
  document.documentElement.dataset.ready = 'yes';
}

function setColours(town) {
  const colours = palette(town.colours);
  for (const part of Object.values(parts)) part.setColours(colours);
}

function listenToTheme(town) {
  const change = () => { setTheme(isDark() ? 'light' : 'dark'); setColours(town); map.redraw(); };
  by('theme').addEventListener('click', change);
  keys.d = change;
}

const followUav = () => { map.following = toggle('follow'); seek(player.time); };
const keys = { f: followUav, '?': () => by('keys').showModal() };

function listen() {
  listenToNotice();
  listenToMapTools(map, followUav);
  by('help').addEventListener('click', keys['?']);
  listenToKeys(KEYS, (event, { isButton, isSlider }) => {
    const acts = { ...playerKeys(player, map, isButton), ...keys };
    return arrowAct(event, player, map, isButton || isSlider) ?? acts[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  });
}

boot().catch(error => notice(error.message));
