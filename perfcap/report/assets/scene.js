// The 3D view: everybody in the current frame, seen from an orbit or as filmed.

import { cameraCenter, drawFrusta } from "./frusta.js";
import { drawSkeleton, fitCanvas } from "./marks.js";
import { fromRows, invertRigid, multiply, project } from "./matrix.js";
import { Orbit } from "./orbit.js";
import { Renderer } from "./renderer.js";
import { framingOf, stageJoints, stageMatrix } from "./stage.js";

export class Scene {
  /** `people` are bodies with their arrays. */
  constructor(canvas, above, graphics, people, data) {
    this.canvas = canvas;
    this.above = above;
    this.bodies = people.map(({ body }) => body);
    this.joints = people.map(({ arrays }) => arrays.joints);
    this.stage = stageMatrix(data.scene, this.joints);
    this.framing = framingOf(this.joints, this.stage, data.rate);
    this.renderer = new Renderer(canvas, graphics, this.bodies, this.stage);
    this.orbit = new Orbit(canvas, this.framing.half, () => this.invalidate());
    this.orbit.onTouch = () => this.setCamera(null);
    this.onCamera = () => {};
    this.camera = null; // intrinsics and pose of a view, while it is looked at as filmed
    this.show = { kind: "captured", texture: true, wireframe: false, skeleton: false, follow: true, cameras: false };
    this.cameras = [];
    this.view = 0;
    this.frame = 0;
    this.posed = "";
    this.middle = [...this.framing.path[0]];
    this.request = 0;
    this.last = 0;
    this.started = false;
    new ResizeObserver(() => this.invalidate()).observe(canvas);
  }

  /** Everything is set up: draw from now on. */
  start() {
    this.started = true;
    this.invalidate();
  }

  /** Draw soon. */
  invalidate() {
    if (this.request !== 0) return;
    this.last = performance.now();
    this.request = requestAnimationFrame((now) => {
      this.request = 0;
      if (!this.started) return; // one picture of everything, not one of every part that is set up
      this.draw(1e-3 * Math.min(100, Math.max(8, now - this.last)));
    });
  }

  setFrame(frame) {
    this.frame = frame;
    this.invalidate();
  }

  set(change) {
    Object.assign(this.show, change);
    if ("cameras" in change) this.orbit.hold(change.cameras ? this.reach() : null);
    this.invalidate();
  }

  /** Look as a view filmed, `{ table, width, height }`; null for the orbit. */
  setCamera(camera) {
    if (this.camera === camera) return;
    this.camera = camera;
    this.onCamera(camera !== null);
    this.invalidate();
  }

  /** Which of the cameras the video is of. */
  setView(index) {
    this.view = index;
    this.invalidate();
  }

  /** How far the farthest camera stands from the middle, m. */
  reach() {
    const centers = this.cameras.map((camera) => cameraCenter(camera, this.frame, this.stage));
    return Math.max(0, ...centers.map((center) => Math.hypot(...center.map((value, k) => value - this.middle[k]))));
  }

  draw(seconds) {
    if (!fitCanvas(this.canvas) || !fitCanvas(this.above)) return;
    this.pose();
    const moving = this.orbit.settle(seconds);
    this.middle = this.show.follow ? this.framing.path[this.frame] : this.framing.middle;
    const aspect = this.canvas.width / this.canvas.height;
    const look = this.camera === null ? this.orbit.camera(this.middle, aspect) : this.filmed(aspect);
    const around = this.framing.path[this.frame];
    this.renderer.draw(look, [around[0], around[1], around[2]], this.framing.half.width + 0.6, this.style());
    this.drawAbove(look);
    if (moving) this.invalidate();
  }

  pose() {
    const wanted = `${this.frame} ${this.show.kind}`;
    if (this.posed === wanted) return;
    this.bodies.forEach((body) => body.pose(this.frame, this.show.kind));
    this.renderer.upload();
    this.posed = wanted;
  }

  style() {
    const dark = getComputedStyle(this.canvas).getPropertyValue("--dark").trim() === "1";
    const bright = dark ? 0.62 : 0.36;
    return {
      texture: this.show.texture,
      wireframe: this.show.wireframe,
      line: [bright, bright, bright].map((value) => 0.55 * value),
      ink: this.show.texture ? [0, 0, 0, 0.42] : [0, 0, 0, 0.3],
      shadow: dark ? 0.62 : 0.34,
    };
  }

  /** The projection of a filmed view, fitted into the canvas. */
  filmed(aspect) {
    const { table, width, height } = this.camera;
    const rows = table.shape[0] > 1 ? this.frame : 0;
    const m = table.subarray(21 * rows, 21 * rows + 21);
    const k = [0, 1, 2].map((r) => [...m.subarray(7 * r, 7 * r + 3)]);
    const world = fromRows([0, 1, 2].map((r) => [...m.subarray(7 * r + 3, 7 * r + 7)]));
    const fit = width / height > aspect ? [1, aspect * (height / width)] : [width / height / aspect, 1];
    const [near, far] = [0.1, 60];
    // pixels (u, v) of the camera's x right, y down, z forward, to -1 ... 1 right and up
    const screen = new Float32Array(16);
    for (let c = 0; c < 3; c += 1) {
      const shift = c === 2 ? 1 : 0;
      screen[4 * c] = fit[0] * ((2 * (k[0][c] + 0.5 * shift)) / width - shift);
      screen[4 * c + 1] = -fit[1] * ((2 * (k[1][c] + 0.5 * shift)) / height - shift);
    }
    screen[10] = (far + near) / (far - near);
    screen[14] = (-2 * far * near) / (far - near);
    screen[11] = 1;
    const view = multiply(world, invertRigid(this.stage));
    const back = invertRigid(view);
    return { eye: [back[12], back[13], back[14]], toScreen: multiply(screen, view) };
  }

  drawAbove(look) {
    const context = this.above.getContext("2d");
    const { width, height } = this.above;
    context.clearRect(0, 0, width, height);
    if (this.show.cameras) this.drawCameras(context, look);
    if (!this.show.skeleton) return;
    for (const joints of this.joints) {
      const points = stageJoints(joints, this.frame, this.stage).map((joint) => {
        const [x, y, w] = project(look.toScreen, joint);
        return w > 0 ? [(0.5 + (0.5 * x) / w) * width, (0.5 - (0.5 * y) / w) * height] : null;
      });
      drawSkeleton(context, points, Math.max(2, 0.006 * height));
    }
  }

  drawCameras(context, look) {
    const { width, height } = this.above;
    const colors = getComputedStyle(this.canvas);
    const color = (name) => colors.getPropertyValue(`--${name}`).trim();
    const style = { width, height, size: width / this.above.clientWidth, ink: color("ink"), accent: color("accent"), shade: color("card") };
    const cameras = this.cameras
      .filter((camera) => this.camera === null || camera.index !== this.view)
      .map((camera) => ({ ...camera, current: camera.index === this.view }));
    drawFrusta(context, cameras, this.frame, this.stage, this.middle, look.toScreen, style);
  }
}
