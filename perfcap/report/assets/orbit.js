// Where the 3D view is looked at from: turned, zoomed and moved by mouse, touch or keys.

import { lookAt, multiply, perspective } from "./matrix.js";

const ANGLE = 0.5; // of view, vertical, radians
const TURN = 0.008; // radians a pixel
const SETTLE = 0.12; // s in which most of a move is done
const LOOKS = { front: [0, 0.12], side: [Math.PI / 2, 0.12], back: [Math.PI, 0.12] };

export class Orbit {
  /** `half` (height and width, m) must fit into the view; `onChange` asks for a picture. */
  constructor(canvas, half, onChange) {
    this.canvas = canvas;
    this.half = half;
    this.onChange = onChange;
    this.still = matchMedia("(prefers-reduced-motion: reduce)");
    this.farthest = 0.25;
    this.aspect = 1;
    this.at = { yaw: 0.45, pitch: 0.14, zoom: 1, x: 0, y: 0, z: 0 };
    this.goal = { ...this.at };
    this.onTouch = () => {};
    this.onAim = () => {};
    this.pointers = new Map();
    this.listen();
  }

  /** Turn to a named side and undo zoom and moves. */
  look(name) {
    const [yaw, pitch] = LOOKS[name];
    const turns = Math.round((this.at.yaw - yaw) / (2 * Math.PI));
    this.aim({ yaw: yaw + 2 * Math.PI * turns, pitch, zoom: 1, x: 0, y: 0, z: 0 });
  }

  aim(change) {
    Object.assign(this.goal, change);
    this.goal.pitch = Math.min(1.5, Math.max(-0.25, this.goal.pitch));
    this.goal.zoom = Math.min(12, Math.max(this.farthest, this.goal.zoom));
    this.onChange();
    this.onAim();
  }

  /** Step back until everything within `reach` (m) of the middle is seen; null for the person alone. */
  hold(reach) {
    const needed = reach === null ? 1 : this.distance() / (1.2 * reach / (Math.tan(ANGLE / 2) * Math.min(1, this.aspect)));
    this.farthest = Math.min(0.25, needed);
    this.aim({ zoom: Math.min(1, needed) });
  }

  /** Distance from the middle at which the person fits, m. */
  distance() {
    const slope = Math.tan(ANGLE / 2);
    return Math.max(this.half.height / slope, this.half.width / (slope * this.aspect)) + 0.5 * this.half.width;
  }

  /** Go towards the goal; true while there is a way left. */
  settle(seconds) {
    const share = this.still.matches ? 1 : 1 - Math.exp(-seconds / SETTLE);
    let left = 0;
    for (const key of Object.keys(this.at)) {
      const way = this.goal[key] - this.at[key];
      left = Math.max(left, Math.abs(way));
      this.at[key] += Math.abs(way) < 1e-4 ? way : way * share;
    }
    return left >= 1e-4;
  }

  /** Eye, distance and matrix for a view around `middle`. */
  camera(middle, aspect) {
    const { yaw, pitch, zoom, x, y, z } = this.at;
    const target = [middle[0] + x, middle[1] + y, middle[2] + z];
    this.aspect = aspect;
    const distance = this.distance() / zoom;
    const eye = [
      target[0] + distance * Math.sin(yaw) * Math.cos(pitch),
      target[1] + distance * Math.sin(pitch),
      target[2] + distance * Math.cos(yaw) * Math.cos(pitch),
    ];
    const near = Math.max(0.05, distance - 8);
    const toScreen = multiply(perspective(ANGLE, aspect, near, distance + 12), lookAt(eye, target, [0, 1, 0]));
    return { eye, toScreen, distance };
  }

  turn(dx, dy) {
    this.onTouch();
    this.aim({ yaw: this.goal.yaw - TURN * dx, pitch: this.goal.pitch + TURN * dy });
  }

  zoom(factor) {
    this.onTouch();
    this.aim({ zoom: this.goal.zoom * factor });
  }

  /** Move the middle by pixels of the screen. */
  move(dx, dy) {
    this.onTouch();
    const scale = (2.2 * this.half.height) / this.goal.zoom / this.canvas.clientHeight;
    const { yaw, pitch } = this.at;
    this.aim({
      x: this.goal.x - scale * (dx * Math.cos(yaw) + dy * Math.sin(yaw) * Math.sin(pitch)),
      y: this.goal.y + scale * dy * Math.cos(pitch),
      z: this.goal.z + scale * (dx * Math.sin(yaw) - dy * Math.cos(yaw) * Math.sin(pitch)),
    });
  }

  listen() {
    const { canvas } = this;
    canvas.addEventListener("pointerdown", (event) => {
      event.preventDefault(); // the keyboard stays where it was
      canvas.setPointerCapture(event.pointerId);
      this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
    });
    canvas.addEventListener("pointermove", (event) => this.drag(event));
    for (const end of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(end, (event) => this.pointers.delete(event.pointerId));
    }
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(-0.0015 * event.deltaY * (event.deltaMode === 1 ? 20 : 1)));
    }, { passive: false });
    canvas.addEventListener("dblclick", () => this.look("front"));
    canvas.addEventListener("keydown", (event) => this.key(event));
  }

  drag(event) {
    const from = this.pointers.get(event.pointerId);
    if (from === undefined) return;
    const to = [event.clientX, event.clientY];
    if (this.pointers.size === 2) this.pinch(event.pointerId, from, to);
    else if (event.buttons & 6 || event.shiftKey) this.move(to[0] - from[0], to[1] - from[1]);
    else this.turn(to[0] - from[0], to[1] - from[1]);
    this.pointers.set(event.pointerId, to);
  }

  /** One of two fingers moves: zoom by their distance, move by their middle. */
  pinch(id, from, to) {
    const other = [...this.pointers].find(([key]) => key !== id)[1];
    const before = Math.hypot(from[0] - other[0], from[1] - other[1]);
    const after = Math.hypot(to[0] - other[0], to[1] - other[1]);
    if (before > 0 && after > 0) this.zoom(after / before);
    this.move((to[0] - from[0]) / 2, (to[1] - from[1]) / 2);
  }

  key(event) {
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (step && event.shiftKey) this.move(24 * step[0], 24 * step[1]);
    else if (step) this.turn(24 * step[0], 24 * step[1]);
    else if (event.key === "+" || event.key === "=") this.zoom(1.15);
    else if (event.key === "-") this.zoom(1 / 1.15);
    else return;
    event.preventDefault();
    event.stopPropagation();
  }
}
