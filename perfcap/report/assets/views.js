// The input video of a view, with outlines, joints and detections drawn over it.

import { Outlines, drawCrosses, drawSkeleton, fitCanvas } from "./marks.js";

const MASK = "rgba(64, 224, 190, 0.38)";
const OUTLINE = "#ffec5c";

export class Views {
  constructor(elements, arrays, data, footage) {
    this.elements = elements;
    this.arrays = arrays;
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
    const view = this.views[this.current];
    return {
      outline: Boolean(view.outline),
      mask: Boolean(view.mask),
      joints: `joints2d-${this.current}` in this.arrays,
      detected: `detected-${this.current}` in this.arrays,
    };
  }

  /** The camera of the current view, or null. */
  camera() {
    const table = this.arrays[`camera-${this.current}`];
    const view = this.views[this.current];
    return table ? { table, width: view.width, height: view.height } : null;
  }

  /** All cameras, for the 3D view. */
  cameras() {
    return this.views.flatMap((view, index) => {
      const table = this.arrays[`camera-${index}`];
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
    if (this.show.mask && there.mask) this.traced("mask").fill(context, this.frame, MASK);
    if (this.show.outline && there.outline) this.traced("outline").stroke(context, this.frame, OUTLINE, size);
    if (this.show.joints && there.joints) {
      drawSkeleton(context, this.points("joints2d"), 1.5 * size);
    }
    if (this.show.detected && there.detected) {
      const certain = this.arrays[`confidence-${this.current}`];
      drawCrosses(context, this.points("detected"), certain.subarray(16 * this.frame, 16 * this.frame + 16), size);
    }
  }

  points(name) {
    const array = this.arrays[`${name}-${this.current}`];
    const points = [];
    for (let joint = 0; joint < 16; joint += 1) {
      const at = 2 * (16 * this.frame + joint);
      points.push([array[at], array[at + 1]]);
    }
    return points;
  }

  /** Outlines of the current view, unpacked when they are first drawn. */
  traced(kind) {
    const key = `${kind}-${this.current}`;
    if (!this.outlines.has(key)) {
      const part = (name) => this.arrays[`${kind}-${name}-${this.current}`];
      this.outlines.set(key, new Outlines(part("rings"), part("lengths"), part("points")));
    }
    return this.outlines.get(key);
  }
}
