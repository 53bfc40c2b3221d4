// Lines over pictures: skeleton, outlines, detections. The right side is orange, the left blue.

const RIGHT = "#ff8a24";
const LEFT = "#3aa0ff";
const MIDDLE = "#ece4ff";
const STICKS = [
  [MIDDLE, [[0, 1], [1, 16]]],
  [RIGHT, [[1, 2], [2, 3], [3, 4], [16, 8], [8, 9], [9, 10], [10, 11]]],
  [LEFT, [[1, 5], [5, 6], [6, 7], [16, 12], [12, 13], [13, 14], [14, 15]]],
];
const SUBPIXEL = 8; // parts of a pixel that outlines are in

/** Size a canvas to its place on the screen; false while it has none. */
export function fitCanvas(canvas) {
  const scale = Math.min(2, window.devicePixelRatio || 1);
  const width = Math.round(canvas.clientWidth * scale);
  const height = Math.round(canvas.clientHeight * scale);
  if (width === 0 || height === 0) return false;
  if (canvas.width !== width || canvas.height !== height) {
    canvas.width = width;
    canvas.height = height;
  }
  return true;
}

/** Sticks and dots of 16 joints [x, y], those that are null left out, `size` px wide. */
export function drawSkeleton(context, joints, size) {
  const hips = joints[8] && joints[12];
  const points = [...joints, hips ? [0, 1].map((k) => (joints[8][k] + joints[12][k]) / 2) : null];
  context.lineCap = "round";
  for (const [style, width] of [["rgba(0, 0, 0, 0.5)", 2.2 * size], [null, size]]) {
    context.lineWidth = width;
    for (const [color, sticks] of STICKS) {
      context.strokeStyle = style ?? color;
      context.beginPath();
      for (const [a, b] of sticks) {
        if (!points[a] || !points[b]) continue;
        context.moveTo(...points[a]);
        context.lineTo(...points[b]);
      }
      context.stroke();
    }
  }
  context.fillStyle = "#fff";
  for (const point of joints) {
    if (!point) continue;
    context.beginPath();
    context.arc(point[0], point[1], 0.85 * size, 0, 2 * Math.PI);
    context.fill();
  }
}

/** Crosses at detected joints, fainter where they are less certain. */
export function drawCrosses(context, points, confidence, size) {
  context.lineCap = "round";
  points.forEach(([x, y], joint) => {
    const opacity = Math.min(1, Math.max(0, confidence[joint]));
    for (const [color, width] of [["#000", 2 * size], ["#fff", size]]) {
      context.globalAlpha = opacity * (color === "#000" ? 0.5 : 1);
      context.strokeStyle = color;
      context.lineWidth = width;
      context.beginPath();
      context.moveTo(x - 2.6 * size, y);
      context.lineTo(x + 2.6 * size, y);
      context.moveTo(x, y - 2.6 * size);
      context.lineTo(x, y + 2.6 * size);
      context.stroke();
    }
  });
  context.globalAlpha = 1;
}

/** Polygons of every frame as paths. */
export class Outlines {
  constructor(rings, lengths, points) {
    this.frames = [];
    let ring = 0;
    let at = 0;
    let x = 0;
    let y = 0;
    for (const count of rings) {
      const path = new Path2D();
      for (const last = ring + count; ring < last; ring += 1) {
        for (let i = 0; i < lengths[ring]; i += 1, at += 2) {
          x += points[at];
          y += points[at + 1];
          if (i === 0) path.moveTo(x / SUBPIXEL, y / SUBPIXEL);
          else path.lineTo(x / SUBPIXEL, y / SUBPIXEL);
        }
        path.closePath();
      }
      this.frames.push(path);
    }
  }

  fill(context, frame, color) {
    context.fillStyle = color;
    context.fill(this.frames[frame], "evenodd");
  }

  stroke(context, frame, color, width) {
    context.lineJoin = "round";
    for (const [style, size] of [["rgba(0, 0, 0, 0.55)", 2 * width], [color, width]]) {
      context.strokeStyle = style;
      context.lineWidth = size;
      context.stroke(this.frames[frame]);
    }
  }
}
