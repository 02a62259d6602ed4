// Far trees for where the processor draws: crowns are closed bodies of few triangles around the leaves, in place of
// cut-out pictures; trunks are cones. Both are in the units of what they stand for, with its colours and layer.
import { BufferAttribute, CylinderGeometry, SphereGeometry, Vector3 } from "../vendor.js";

const AROUND = 7, DOWN = 5; // Sides and rings of a body.
// A body reaches as far as this share of the leaves in a cone around each direction.
const CONE_COS = 0.82, OUTER = 0.8;
const LEAST_COVER = 128; // Alpha of 255 from which a pixel is of a leaf.
// Brightness of a body beside its leaves, which shade each other, at half its height and how it grows upwards; and by
// which share that of its vertices differs, so that it does not look like a ball.
const SHADED = 0.7, UPWARDS = 0.2, UNEVEN = 0.16;
const SIDES = 5, FOOT = 0.2, TIP = 0.4; // Of a trunk; the share of its height that is its foot; the width of its tip.

const linearOf = (value) => (value <= 10.3 ? value / 3294.6 : ((value / 255 + 0.055) / 1.055) ** 2.4);

// The mean of the leaves in a part of their picture [left, top, right, bottom] as shares of its sides: linear.
function meanOf(picture, [left, top, right, bottom]) {
  const { width, height } = picture, [x, y] = [Math.floor(left * width), Math.floor(top * height)];
  const wide = Math.max(1, Math.ceil(right * width) - x), tall = Math.max(1, Math.ceil(bottom * height) - y);
  const context = new OffscreenCanvas(wide, tall).getContext("2d", { willReadFrequently: true });
  context.drawImage(picture, -x, -y);
  const { data } = context.getImageData(0, 0, wide, tall), sum = [0, 0, 0];
  let count = 0;
  for (let at = 0; at < data.length; at += 4) {
    if (data[at + 3] < LEAST_COVER) continue;
    count++;
    for (let channel = 0; channel < 3; channel++) sum[channel] += linearOf(data[at + channel]);
  }
  return sum.map((value) => value / Math.max(1, count));
}

function pointsOf({ position }) {
  return Array.from({ length: position.count }, (_, at) => new Vector3().fromBufferAttribute(position, at));
}

function meanPoint(points) {
  return points.reduce((sum, point) => sum.addScaledVector(point, 1 / points.length), new Vector3());
}

function meanColour({ color }) {
  const mean = [0, 0, 0];
  for (let at = 0; at < color.count; at++)
    for (let channel = 0; channel < 3; channel++) mean[channel] += color.getComponent(at, channel) / color.count;
  return mean;
}

function dressed(body, colours, layer) {
  body.deleteAttribute("uv");
  body.setAttribute("color", new BufferAttribute(colours, 3));
  const layers = new Float32Array(body.attributes.position.count).fill(layer.getX(0));
  body.setAttribute("layer", new BufferAttribute(layers, 1));
  return body;
}

// A cone around a trunk, from the width of its foot to a point at the height of its top.
export function coneOf(trunk) {
  const points = pointsOf(trunk.attributes), heights = points.map(({ y }) => y);
  const low = Math.min(...heights), tall = Math.max(...heights) - low;
  const foot = points.filter(({ y }) => y <= low + FOOT * tall), base = meanPoint(foot);
  const top = meanPoint(points.filter(({ y }) => y >= low + (1 - FOOT) * tall)), mean = meanColour(trunk.attributes);
  const wide = Math.max(...foot.map(({ x, z }) => Math.hypot(x - base.x, z - base.z)));
  const cone = new CylinderGeometry(TIP * wide, wide, tall, SIDES, 1, true), to = cone.attributes.position;
  for (let at = 0; at < to.count; at++) {
    const share = to.getY(at) / tall + 0.5;
    const x = base.x + share * (top.x - base.x), z = base.z + share * (top.z - base.z);
    to.setXYZ(at, to.getX(at) + x, low + share * tall, to.getZ(at) + z);
  }
  return dressed(cone, new Float32Array(3 * to.count).map((_, at) => mean[at % 3]), trunk.attributes.layer);
}

// A body around a crown of pictured leaves.
export function bodyOf(crown, picture) {
  const { uv, layer } = crown.attributes, bounds = [Infinity, Infinity, -Infinity, -Infinity];
  const points = pointsOf(crown.attributes), middle = meanPoint(points), mean = meanColour(crown.attributes);
  for (let at = 0; at < uv.count; at++) {
    bounds[0] = Math.min(bounds[0], uv.getX(at));
    bounds[1] = Math.min(bounds[1], uv.getY(at));
    bounds[2] = Math.max(bounds[2], uv.getX(at));
    bounds[3] = Math.max(bounds[3], uv.getY(at));
  }
  const leaves = meanOf(picture, bounds);
  for (const point of points) point.sub(middle);
  const longest = Math.max(...points.map((point) => point.length()));
  const body = new SphereGeometry(1, AROUND, DOWN), to = body.attributes.position, way = new Vector3();
  const colours = new Float32Array(3 * to.count);
  for (let at = 0; at < to.count; at++) {
    way.fromBufferAttribute(to, at).normalize();
    const inCone = points.filter((point) => point.dot(way) > CONE_COS * point.length());
    const reach = inCone.map((point) => point.length()).sort((one, other) => one - other);
    const far = reach.length ? reach[Math.floor(OUTER * (reach.length - 1))] : 0.6 * longest;
    const ring = Math.floor(at / (AROUND + 1)), side = at % (AROUND + 1) % AROUND; // the last of a ring is its first
    const uneven = 1 + UNEVEN * Math.sin(12.9898 * side + 78.233 * ring);
    for (let channel = 0; channel < 3; channel++)
      colours[3 * at + channel] = mean[channel] * leaves[channel] * uneven * (SHADED + UPWARDS * way.y);
    to.setXYZ(at, middle.x + far * way.x, middle.y + far * way.y, middle.z + far * way.z);
    way.multiplyScalar(0.5).y += 1; // a crown is lit like a whole, mostly from above
    way.normalize();
    body.attributes.normal.setXYZ(at, way.x, way.y, way.z);
  }
  return dressed(body, colours, layer);
}
