// The input video of a view, with outlines, joints and detections drawn over it.

import { Outlines, drawCrosses, drawSkeleton, fitCanvas } from "./marks.js";

// of each person; more than these begin again
const MASKS = ["rgba(64, 224, 190, 0.38)", "rgba(255, 140, 90, 0.38)", "rgba(150, 130, 255, 0.38)", "rgba(120, 200, 80, 0.38)"];
const OUTLINES = ["#ffec5c", "#5ce1ff", "#ff8ad8", "#9dff7a"];

export class Views {
  /** `everybody` has the arrays of each person. */
  constructor(elements, everybody, data, footage) {
    this.elements = elements;
    this.everybody = everybody;
    this.views = data.views;
    this.footage = footage;
    this.show = { outline: true, mask: false, joints: false, detected: false };
    this.current = 0;
    this.frame = 0;
    this.outlines = new Map();
    this.request = 0;
    new ResizeObserver(() => this.fit()).observe(elements.screen);
  }

  /** Show a view; its video becomes the clock. */
  open(index) {
    this.current = index;
    const view = this.views[index];
    this.fit();
    if (view.video) this.footage.open(view.video);
    else this.footage.close();
    this.elements.video.hidden = !view.video;
    this.invalidate();
  }

  /** What there is to draw over the current view. */
  available() {
    const some = (name) => this.everybody.some((arrays) => `${name}-${this.current}` in arrays);
    return { outline: some("outline-rings"), mask: some("mask-rings"), joints: some("joints2d"), detected: some("detected") };
  }

  /** The camera of the current view, or null. */
  camera() {
    const table = this.everybody[0][`camera-${this.current}`];
    const view = this.views[this.current];
    return table ? { table, width: view.width, height: view.height } : null;
  }

  /** All cameras, for the 3D view. */
  cameras() {
    return this.views.flatMap((view, index) => {
      const table = this.everybody[0][`camera-${index}`];
      return table ? [{ table, width: view.width, height: view.height, name: view.name, index }] : [];
    });
  }

  setFrame(frame) {
    this.frame = frame;
    this.invalidate();
  }

  set(change) {
    Object.assign(this.show, change);
    this.invalidate();
  }

  /** Make the picture as large as its place allows, in its own shape. */
  fit() {
    const { screen, fit } = this.elements;
    const view = this.views[this.current];
    const scale = Math.min(screen.clientWidth / view.width, screen.clientHeight / view.height);
    fit.style.width = `${Math.floor(view.width * scale)}px`;
    fit.style.height = `${Math.floor(view.height * scale)}px`;
    this.invalidate();
  }

  invalidate() {
    if (this.request !== 0) return;
    this.request = requestAnimationFrame(() => {
      this.request = 0;
      this.draw();
    });
  }

  draw() {
    const canvas = this.elements.marks;
    if (!fitCanvas(canvas)) return;
    const view = this.views[this.current];
    const context = canvas.getContext("2d");
    const scale = canvas.width / view.width;
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, canvas.width, canvas.height);
    context.setTransform(scale, 0, 0, scale, 0, 0);
    const size = Math.max(1.1, 0.0032 * view.height, 1.6 / scale);
    const there = this.available();
    const each = (name, action) => {
      if (!this.show[name] || !there[name]) return;
      this.everybody.forEach((arrays, number) => action(arrays, number % OUTLINES.length, number));
    };
    each("mask", (_, color, number) => this.traced("mask", number)?.fill(context, this.frame, MASKS[color]));
    each("outline", (_, color, number) => this.traced("outline", number)?.stroke(context, this.frame, OUTLINES[color], size));
    each("joints", (arrays) => drawSkeleton(context, this.points(arrays, "joints2d"), 1.5 * size));
    each("detected", (arrays) => {
      const certain = arrays[`confidence-${this.current}`];
      if (!certain) return;
      drawCrosses(context, this.points(arrays, "detected"), certain.subarray(16 * this.frame, 16 * this.frame + 16), size);
    });
  }

  points(arrays, name) {
    const array = arrays[`${name}-${this.current}`];
    const points = [];
    if (!array) return points;
    for (let joint = 0; joint < 16; joint += 1) {
      const at = 2 * (16 * this.frame + joint);
      points.push([array[at], array[at + 1]]);
    }
    return points;
  }

  /** Outlines of a person in the current view, unpacked when they are first drawn. */
  traced(kind, number) {
    const key = `${kind}-${this.current}-${number}`;
    if (!this.outlines.has(key)) {
      const part = (name) => this.everybody[number][`${kind}-${name}-${this.current}`];
      this.outlines.set(key, part("rings") ? new Outlines(part("rings"), part("lengths"), part("points")) : null);
    }
    return this.outlines.get(key);
  }
}
