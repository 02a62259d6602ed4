// Paths in metres of the world frame, and what is drawn with them on a canvas whose transform is in metres, y up.

/** Rings of x, y in centimetres as one path; filled by the rule of even and odd. */
export function pathOf(rings, close = true) {
  const path = new Path2D();
  for (const ring of rings) {
    for (let i = 0; i < ring.length; i += 2) {
      if (i) path.lineTo(ring[i] / 100, ring[i + 1] / 100);
      else path.moveTo(ring[0] / 100, ring[1] / 100);
    }
    if (close) path.closePath();
  }
  return path;
}

export function townPaths(map) {
  return {
    parks: pathOf(map.parks.flat()),
    sidewalks: pathOf(map.sidewalks.flat()),
    carriageway: pathOf(map.carriageway.flat()),
    crossings: pathOf(map.crossings.flat()),
    laneLines: pathOf(map.lane_lines, false),
    buildings: pathOf(map.buildings.flat()),
  };
}

/** The ground of a town. `pixel` is the size of one on the screen, in metres. */
export function drawTown(pen, paths, colours, { pixel, trees = [], layers }) {
  const fill = (path, colour, edge, width) => {
    pen.fillStyle = colour;
    pen.fill(path, 'evenodd');
    if (!edge) return;
    pen.strokeStyle = edge;
    pen.lineWidth = width;
    pen.stroke(path);
  };
  fill(paths.parks, colours.park);
  fill(paths.sidewalks, colours.sidewalk);
  fill(paths.carriageway, colours.carriageway, colours.casing, Math.min(0.35, 1.2 * pixel));
  if (pixel < 0.5) {
    pen.strokeStyle = colours.marking;
    pen.lineWidth = 0.15;
    pen.setLineDash([3, 3]);
    pen.stroke(paths.laneLines);
    pen.setLineDash([]);
    pen.fillStyle = colours.marking;
    pen.globalAlpha = 0.5;
    pen.fill(paths.crossings);
    pen.globalAlpha = 1;
  }
  if (layers.has('buildings')) fill(paths.buildings, colours.building, colours.building_edge, Math.min(0.3, pixel));
  if (layers.has('trees')) {
    pen.fillStyle = colours.tree;
    pen.globalAlpha = 0.6;
    pen.beginPath();
    for (const [x, y, radius] of trees) {
      pen.moveTo((x + radius) / 100, y / 100);
      pen.arc(x / 100, y / 100, radius / 100, 0, 2 * Math.PI);
    }
    pen.fill();
    pen.globalAlpha = 1;
  }
}

/** A rectangle around a place: `along` in the direction of the yaw, `across` beside it. */
export function rectangle(path, x, y, yaw, along, across) {
  const [c, s, a, b] = [Math.cos(yaw), Math.sin(yaw), along / 2, across / 2];
  path.moveTo(x + a * c - b * s, y + a * s + b * c);
  for (const [m, n] of [[a, -b], [-a, -b], [-a, b]]) path.lineTo(x + m * c - n * s, y + m * s + n * c);
  path.closePath();
}

/** Vehicles and pedestrians, one fill for each group. `least` is the smallest side that is drawn, in metres. */
export function drawAgents(pen, agents, colours, least) {
  const paths = new Map();
  for (const { x, y, yaw, length, width, group } of agents) {
    if (!paths.has(group)) paths.set(group, new Path2D());
    const path = paths.get(group);
    if (group === 'pedestrian') {
      const radius = Math.max(width, least) / 2;
      path.moveTo(x + radius, y);
      path.arc(x, y, radius, 0, 2 * Math.PI);
    } else rectangle(path, x, y, yaw, Math.max(length, 1.4 * least), Math.max(width, least));
  }
  for (const [group, path] of paths) {
    pen.fillStyle = colours.agents[group] ?? colours.agents.car;
    pen.fill(path);
  }
}

export function parkedAgents(parked) {
  return parked.x_m.map((x, i) => ({
    x, y: parked.y_m[i], yaw: parked.yaw_rad[i], length: parked.length_m[i], width: parked.width_m[i], group: 'parked',
  }));
}

/** The car that is driven, from above, its front marked; not smaller than a few pixels. */
export function drawCar(pen, x, y, yaw, { length_m: length, width_m: width }, pixel, colour, halo) {
  const long = Math.max(length, 13 * pixel), wide = Math.max(width, 7 * pixel), c = Math.cos(yaw), s = Math.sin(yaw);
  const outline = new Path2D(), front = new Path2D(), at = (ahead, left) => [x + ahead * c - left * s, y + ahead * s + left * c];
  rectangle(outline, x, y, yaw, long, wide);
  rectangle(front, ...at(0.24 * long, 0), yaw, 0.16 * long, 0.8 * wide);
  pen.fillStyle = colour;
  pen.strokeStyle = halo;
  pen.lineWidth = 1.5 * pixel;
  pen.fill(outline);
  pen.stroke(outline);
  pen.fillStyle = halo;
  pen.fill(front);
}

/** A quadrotor from above, its front marked; `size` in metres from rotor to rotor. */
export function drawUav(pen, x, y, yaw, size, colour, halo) {
  const arm = size / 2, rotor = size * 0.24;
  pen.save();
  pen.translate(x, y);
  pen.rotate(yaw);
  for (const [stroke, width] of [[halo, size * 0.26], [colour, size * 0.12]]) {
    pen.strokeStyle = stroke;
    pen.lineWidth = width;
    pen.beginPath();
    for (const turn of [0.785, 2.356]) {
      pen.moveTo(arm * Math.cos(turn), arm * Math.sin(turn));
      pen.lineTo(-arm * Math.cos(turn), -arm * Math.sin(turn));
    }
    for (const turn of [0.785, 2.356, 3.927, 5.498]) {
      const [a, b] = [arm * Math.cos(turn), arm * Math.sin(turn)];
      pen.moveTo(a + rotor, b);
      pen.arc(a, b, rotor, 0, 2 * Math.PI);
    }
    pen.moveTo(0, 0);
    pen.lineTo(arm * 1.15, 0);
    pen.stroke();
  }
  pen.restore();
}

/** The mark of a defect in pixels around the origin: a disc when found, a cross when missed, a ring while open. */
export function drawDefect(pen, x, y, radius, outcome, colours) {
  pen.beginPath();
  if (outcome === null) {
    pen.arc(x, y, radius * 0.8, 0, 2 * Math.PI);
    pen.strokeStyle = colours.open_defect;
    pen.lineWidth = radius * 0.4;
    pen.stroke();
    return;
  }
  pen.fillStyle = pen.strokeStyle = colours.outcomes[outcome];
  if (outcome.startsWith('found')) {
    if (outcome === 'found') pen.arc(x, y, radius, 0, 2 * Math.PI);
    else rectangle(pen, x, y, Math.PI / 4, 1.7 * radius, 1.7 * radius);
    pen.fill();
    pen.strokeStyle = colours.halo;
    pen.lineWidth = radius * 0.25;
    pen.stroke();
    return;
  }
  for (const sign of [1, -1]) {
    pen.moveTo(x - radius, y - sign * radius);
    pen.lineTo(x + radius, y + sign * radius);
  }
  pen.lineWidth = radius * 0.9;
  pen.strokeStyle = colours.halo;
  pen.stroke();
  pen.lineWidth = radius * 0.5;
  pen.strokeStyle = colours.outcomes[outcome];
  pen.stroke();
}
