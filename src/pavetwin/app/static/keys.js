// The keys of the page: their table in the help, and which of them are the focused control's own.

import { by, element } from './dom.js';

/** Of the page that asks a server. */
export const PAGE_KEYS = [
  ['Enter', 'start the mission'], ['C', 'compare two policies'], ['Escape', 'cancel, or choose none'], ['Space', 'play or pause'],
  ['← →', 'a second back or on (shift: ten), away from the map'], ['N P', 'next or previous occlusion'], ['[ ]', 'slower, faster'],
  ['V', 'the other policy'], ['arrows', 'move the map, when it has the focus'], ['+ − 0', 'zoom the map; the whole town'],
  ['T', 'show or hide the town in 3-D'], ['1 2 3 4', 'see the town by hand, behind the UAV, from its camera, from a car'],
  ['U R', 'fly the UAV yourself, or drive a car'], ['M', 'build a town from a street map'], ['O', 'make the choices of a mission.yaml'],
  ['X', 'choose the street, or the defect, in the middle of the map'], ['A', 'choose all streets in view'],
  ['B', 'drag a box around streets'], ['F', 'follow the UAV'], ['D', 'light or dark'], ['?', 'these keys'],
];

/**
 * @param table of the help: keys, and what they do
 * @param actOf what a key event does, called with whether a button or a slider has the focus; nothing where null
 */
export function listenToKeys(table, actOf) {
  by('keys').querySelector('dl').append(...table.flatMap(([key, words]) => [element('dt', {}, element('kbd', {}, key)), element('dd', {}, words)]));
  document.addEventListener('keydown', event => {
    const isTyped = event.target.matches('input:not([type="checkbox"], [type="range"]), select, textarea, dialog *');
    if (event.ctrlKey || event.metaKey || event.altKey || isTyped || document.querySelector('dialog[open]')) return;
    const act = actOf(event, { isButton: event.target.matches('button, summary, a, [role="tab"]'), isSlider: event.target.matches('[type="range"]') });
    if (!act) return;
    event.preventDefault();
    act();
  });
  for (const group of document.querySelectorAll('[role="radiogroup"]')) group.addEventListener('keydown', event => turnTo(event, group));
}

/** Close the menu that is open, if one is, and go back to what opened it. */
export function closeMenu() {
  const menu = document.querySelector('details[open]');
  if (!menu) return false;
  menu.open = false;
  menu.querySelector('summary').focus();
  return true;
}

/** Arrow keys go from choice to choice, as in a group of radio buttons. */
function turnTo(event, group) {
  const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key], choices = [...group.querySelectorAll('[role="radio"]:not(:disabled)')];
  if (!step || choices.length < 2) return;
  const next = choices[(choices.indexOf(event.target) + step + choices.length) % choices.length];
  next.click();
  next.focus();
  event.preventDefault();
  event.stopPropagation();
}
