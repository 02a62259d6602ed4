// Colours of the map. Those that mean something (visibility, outcomes, policies) are the same as on maps and in reports,
// and in light and dark; the town's own are darkened.

const DARK = {
  ground: '#141618', park: '#1c271b', sidewalk: '#23262a', carriageway: '#33373c', casing: '#565b63', marking: '#5d636b',
  building: '#292521', building_edge: '#4a433b', tree: '#2c4229', base: '#7db8ea', ink: '#ebe8e3', halo: '#141618',
  uav: '#ffffff', seen: '#2f5878', hidden: '#0c0a0d', open_defect: '#ff9250', wait: '#b48ae0', revisit: '#5ba8ee',
  displace: '#ee80bd', battery: '#d9b24a', seeing: '#5ba8ee', hides: '#e0567a',
  policies: { baseline: '#b9b9b9', hover: '#4db2ee', micro: '#ffb13d', skip: '#3fd0a3' },
  agents: { car: '#9fb2c6', van: '#c3ccd4', truck: '#c4a58f', bus: '#d9bd73', motorcycle: '#8b97a3', pedestrian: '#e3e7eb', aircraft: '#c47ad9', parked: '#6b6f75' },
  outcomes: { found: '#2fbf9c', missed: '#ff8b3d', 'found on return': '#5ba8ee', 'behind parked vehicle': '#a7a29c' },
};

export const isDark = () => document.documentElement.dataset.theme === 'dark';

/** Keep a choice for the next time; private windows keep nothing. */
export function keep(name, value) {
  try { localStorage.setItem(name, value); } catch { /* as above */ }
}

/** A choice that was kept, or null. */
export function kept(name) {
  try { return localStorage.getItem(name); } catch { return null; }
}

export function setTheme(name) {
  document.documentElement.dataset.theme = name;
  keep('pavetwin-theme', name);
}

export function startTheme() {
  setTheme(kept('pavetwin-theme') ?? (matchMedia('(prefers-color-scheme: dark)').matches ? 'dark' : 'light'));
}

/** The colours of now. */
export function palette(colours) {
  const [hides, seeing] = [0, 1].map(o => visibilityColour(colours, o));
  const light = { ...colours, ink: '#2b2b2b', halo: '#ffffff', seeing, hides };
  const chosen = isDark() ? { ...light, ...DARK } : light;
  return { ...chosen, accent: getComputedStyle(document.documentElement).getPropertyValue('--accent').trim() };
}

/** The colour of o ∈ [0, 1]. */
export function visibilityColour(colours, o) {
  const ramp = colours.visibility;
  return ramp[Math.round(Math.min(1, Math.max(0, o)) * (ramp.length - 1))];
}
