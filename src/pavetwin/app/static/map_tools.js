// The tools over the map: layers, zoom, following the UAV, its scale, and what lies under the pointer.

import { by, element } from './dom.js';

const LAYERS = { buildings: 'buildings', trees: 'trees', names: 'street names', traffic: 'traffic', parked: 'parked vehicles', route: 'route', windows: 'seen surface', defects: 'defects' };

/** @param follow what the button that follows the UAV does */
export function listenToMapTools(map, follow) {
  const actions = { in: () => map.zoom(1.4), out: () => map.zoom(1 / 1.4), fit: () => map.fit(), follow };
  for (const [id, act] of Object.entries(actions)) by(id).addEventListener('click', act);
  by('layers').querySelector('ul').append(...Object.entries(LAYERS).map(([layer, words]) => {
    const check = element('input', { type: 'checkbox', checked: map.layers.has(layer) });
    check.addEventListener('change', () => { map.layers[check.checked ? 'add' : 'delete'](layer); map.redraw(); });
    return element('li', {}, element('label', {}, check, words));
  }));
  document.addEventListener('pointerdown', event => {
    for (const menu of document.querySelectorAll('details[open]')) if (!menu.contains(event.target)) menu.open = false;
  });
}

/** Press or release a button that stays pressed. Returns whether it is. */
export function toggle(id, on = by(id).getAttribute('aria-pressed') !== 'true') {
  by(id).setAttribute('aria-pressed', on);
  return on;
}

/** What lies under the pointer: a segment or a defect. */
export function tellUnder(segment, defect, x, y) {
  const tip = by('tip'), root = by('map');
  tip.hidden = !segment && !defect;
  if (defect) tip.textContent = `${defect.class.replaceAll('_', ' ')} ${defect.id}\n${defect.outcome}${defect.reason ? `: ${defect.reason}` : ''}`;
  if (segment) tip.textContent = `${segment.street}, ${segment.id}\n${segment.length_m.toFixed(0)} m × ${segment.width_m} m, ${segment.lanes} lane${segment.lanes === 1 ? '' : 's'}, ${segment.area_m2} m²`;
  tip.style.left = `${Math.min(x + 14, root.clientWidth - tip.offsetWidth - 6)}px`;
  tip.style.top = `${Math.min(y + 14, root.clientHeight - tip.offsetHeight - 6)}px`;
}

export function drawScale({ k }) {
  const power = 10 ** Math.floor(Math.log10(110 / k)), metres = [5, 2, 1].find(factor => factor * power * k <= 110) * power;
  by('scale').style.width = `${metres * k}px`;
  by('scale').firstElementChild.textContent = metres >= 1000 ? `${metres / 1000} km` : `${+metres.toPrecision(3)} m`;
}
