// A mission on the map at a moment: what it has taken, its route, its reactions, traffic, defects, and every UAV or car
// of the flight.

import { drawAgents, drawCar, drawDefect, drawUav, rectangle } from './shapes.js';
import { visibilityColour } from './theme.js';

const REACTIONS = ['wait', 'displace', 'revisit', 'battery'];

/**
 * @param viewport has the canvas's transforms
 * @param shown `{ flight, mission, parked, time, defect, layers, surfaceOf, colours }`: agents that are parked, the id of
 *     the defect that is chosen, and the path of a segment's surface by its id
 */
export function drawMission(pen, viewport, shown) {
  const { mission, time, layers, colours } = shown, pixel = viewport.pixel, now = mission.at(time);
  viewport.metres(pen);
  if (layers.has('windows')) drawWindows(pen, mission, now.captures, shown);
  if (layers.has('route')) drawRoute(pen, mission, now, pixel, colours);
  if (layers.has('parked')) drawAgents(pen, shown.parked, colours, 1.5 * pixel);
  if (layers.has('traffic')) drawAgents(pen, shown.flight.agentsAt(time), colours, 3.2 * pixel);
  viewport.pixels(pen);
  if (layers.has('defects')) drawDefects(pen, viewport, shown);
  drawReactions(pen, viewport, mission, time, colours);
  viewport.metres(pen);
  drawCarriers(pen, pixel, shown);
}

function drawWindows(pen, mission, count, { surfaceOf, colours }) {
  const { x_m, y_m, yaw_rad } = mission.captures, [across, along] = mission.window_m, path = new Path2D();
  for (let i = 0; i < count; i++) rectangle(path, x_m[i], y_m[i], yaw_rad[i], along, across);
  pen.save();
  const inside = new Path2D();
  for (const surface of mission.targets.map(surfaceOf)) if (surface) inside.addPath(surface);
  pen.clip(inside, 'evenodd');
  pen.fillStyle = colours.seen;
  pen.globalAlpha = 0.75;
  pen.fill(path);
  pen.restore();
}

function drawRoute(pen, mission, now, pixel, colours) {
  const { x_m, y_m, visibility } = mission.track;
  pen.lineCap = 'round';
  pen.lineJoin = 'round';
  let from = 0;
  const isSeen = i => visibility[i] !== null, shade = i => (isSeen(i) ? visibilityColour(colours, visibility[i]) : null);
  for (let i = 1; i <= now.row + 1; i++) {
    if (i <= now.row && shade(i) === shade(from)) continue;
    pen.beginPath();
    pen.moveTo(x_m[from], y_m[from]);
    for (let j = from + 1; j <= Math.min(i, now.row); j++) pen.lineTo(x_m[j], y_m[j]);
    if (i > now.row) pen.lineTo(now.x, now.y);
    pen.strokeStyle = shade(from) ?? colours.ink;
    pen.lineWidth = (isSeen(from) ? 2.6 : 1) * pixel;
    pen.globalAlpha = isSeen(from) ? 1 : 0.55;
    pen.stroke();
    from = i;
  }
  pen.globalAlpha = 1;
  pen.lineCap = 'butt';
}

function drawDefects(pen, viewport, { mission, time, defect: chosen, colours }) {
  const radius = Math.max(2.6, Math.min(6, 0.5 / viewport.pixel));
  for (const defect of mission.defects) {
    const [x, y] = viewport.toScreen(...defect.place_m), outcome = mission.outcomeAt(defect, time);
    drawDefect(pen, x, y, defect.id === chosen ? radius * 1.5 : radius, outcome, colours);
    if (defect.id !== chosen) continue;
    pen.beginPath();
    pen.arc(x, y, radius * 2.4, 0, 2 * Math.PI);
    pen.strokeStyle = colours.accent;
    pen.lineWidth = 2;
    pen.stroke();
  }
}

function drawReactions(pen, viewport, mission, time, colours) {
  for (const event of mission.events) {
    if (event.t_s > time) break;
    if (!REACTIONS.includes(event.kind) || !event.place_m) continue;
    const [x, y] = viewport.toScreen(...event.place_m);
    pen.beginPath();
    pen.arc(x, y, 6, 0, 2 * Math.PI);
    pen.strokeStyle = colours[event.kind];
    pen.lineWidth = 1.6;
    pen.stroke();
    pen.globalAlpha = 0.2;
    pen.fillStyle = colours[event.kind];
    pen.fill();
    pen.globalAlpha = 1;
  }
}

/** The UAVs and cars of all missions of the flight, that of the mission last, with what its camera sees. */
function drawCarriers(pen, pixel, { flight, mission, time, colours }) {
  const others = flight.missions.filter(other => other !== mission), size = Math.max(1.9, 17 * pixel);
  for (const one of [...others, mission]) {
    const state = one.at(Math.min(time, one.duration_s)), { x, y, yaw, visibility } = state;
    if (one === mission && visibility !== null) {
      const path = new Path2D(), eye = one.cameraOf(state);
      rectangle(path, eye.x, eye.y, yaw, mission.window_m[1], mission.window_m[0]);
      for (const [colour, width] of [[colours.halo, 4.5], [visibilityColour(colours, visibility), 2.6]]) {
        pen.strokeStyle = colour;
        pen.lineWidth = width * pixel;
        pen.stroke(path);
      }
    }
    const colour = others.length ? colours.policies[one.policy] ?? colours.uav : colours.uav;
    pen.globalAlpha = one === mission ? 1 : 0.65;
    if (one.car) drawCar(pen, x, y, yaw, one.car, pixel, colours.uav, colours.halo);
    else drawUav(pen, x, y, yaw, size, colour, colours.halo);
    pen.globalAlpha = 1;
  }
}
