// Where the town is seen from: orbit, behind the UAV, its camera's eye, or a driver's.
import { OrbitControls, PerspectiveCamera, Vector3 } from "../vendor.js";

export const MODES = ["orbit", "follow", "uav", "car"];
// Of a driver's eyes: metres up, the share of the length ahead of the middle, and how far down they look.
const DRIVER = { up_m: 1.25, ahead: 0.25, pitch_rad: -Math.atan(0.06) };

export class Cameras {
  constructor(canvas, manifest, changed) {
    this.camera = new PerspectiveCamera(50, 1, 0.4, 6000);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.maxPolarAngle = 0.49 * Math.PI;
    this.controls.minDistance = 3;
    this.controls.maxDistance = 2500;
    this.controls.addEventListener("change", changed);
    this.controls.listenToKeyEvents(canvas);
    this.mode = "orbit";
    this.options = {};
    const [west, south, east, north] = manifest.bounds;
    this.home(west, south, east, north);
  }

  // Look at a part of the town from the south-west.
  home(west, south, east, north) {
    const size = Math.hypot(east - west, north - south), far = Math.min(0.55 * size, 420);
    this.controls.target.set((south + north) / 2, 0, (west + east) / 2);
    this.camera.position.copy(this.controls.target).add(new Vector3(-0.62 * far, 0.36 * far, -0.55 * far));
    this.controls.update();
  }

  look(x, y, away) {
    this.away = this.#away().setLength(away);
    this.controls.target.set(y, 0, x);
    this.camera.position.copy(this.controls.target).add(this.away);
    this.controls.update();
  }

  // From the place that is orbited to the eye; as it was when another mode took the camera.
  #away() {
    return this.mode === "orbit" ? this.camera.position.clone().sub(this.controls.target) : this.away;
  }

  set(mode, options = {}) {
    if (!MODES.includes(mode)) throw new Error(`no camera '${mode}'; there are ${MODES.join(", ")}`);
    this.away = this.#away();
    if (mode === "orbit") this.camera.position.copy(this.controls.target).add(this.away);
    this.mode = mode;
    this.options = options;
    this.controls.enabled = mode === "orbit";
    this.camera.fov = options.fov_deg ?? (mode === "uav" ? 53 : mode === "car" ? 62 : 50);
    this.camera.up.set(0, 1, 0);
    this.camera.updateProjectionMatrix();
    if (mode === "orbit") this.controls.update();
  }

  // Follow what the mode follows; `uav` and `car` in the world frame, null where there is none.
  update(uav, car) {
    const camera = this.camera;
    if (this.mode === "orbit") return;
    const from = this.mode === "car" ? car : uav;
    if (!from) return;
    const east = Math.cos(from.yaw), north = Math.sin(from.yaw);
    if (this.mode === "follow") {
      const back = this.options.back_m ?? 14, up = this.options.up_m ?? 6;
      camera.position.set(from.y - north * back, from.z + up, from.x - east * back);
      camera.lookAt(from.y + north * 12, Math.max(0, from.z - 8), from.x + east * 12);
    } else if (this.mode === "uav") {
      const pitch = from.pitch ?? -Math.PI / 2, flat = Math.cos(pitch);
      camera.position.set(from.y, from.z, from.x);
      camera.up.set(-Math.sin(pitch) * north, flat, -Math.sin(pitch) * east);
      camera.lookAt(from.y + north * flat, from.z + Math.sin(pitch), from.x + east * flat);
    } else {
      const { ahead_m: ahead, up_m: up, pitch_rad: pitch } = this.options.eye ?? { ...DRIVER, ahead_m: DRIVER.ahead * (from.length_m ?? 4.4) };
      camera.position.set(from.y + north * ahead, up, from.x + east * ahead);
      camera.lookAt(from.y + north * (ahead + 10), up + 10 * Math.tan(pitch), from.x + east * (ahead + 10));
    }
  }

  resize(wide, tall) {
    this.camera.aspect = wide / tall;
    this.camera.updateProjectionMatrix();
  }

  dispose() {
    this.controls.dispose();
  }
}
