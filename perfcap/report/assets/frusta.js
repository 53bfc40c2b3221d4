// Cameras of a capture as pyramids over the 3D view.

import { fromRows, invertRigid, multiply, transform } from "./matrix.js";

const SHARE = 0.14; // of the way to the person
const NEAR = 0.05; // m in front of the eye from which lines are drawn

/** Row of a camera's table, {K, pose} with the world moved to the stage. */
function readCamera(camera, frame, stage) {
  const row = camera.table.shape[0] > 1 ? frame : 0;
  const m = camera.table.subarray(21 * row, 21 * row + 21);
  const k = [0, 1, 2].map((r) => [...m.subarray(7 * r, 7 * r + 3)]);
  const world = fromRows([0, 1, 2].map((r) => [...m.subarray(7 * r + 3, 7 * r + 7)]));
  return { k, place: invertRigid(multiply(world, invertRigid(stage))) };
}

/** Where a camera stands on the stage. */
export function cameraCenter(camera, frame, stage) {
  return transform(readCamera(camera, frame, stage).place, [0, 0, 0]);
}

/** Its apex, and the corners of its image clockwise from the top left, `depth` ahead. */
export function frustum(camera, frame, stage, depth) {
  const { k, place } = readCamera(camera, frame, stage);
  const { width, height } = camera;
  const corners = [[0, 0], [width, 0], [width, height], [0, height]].map(([u, v]) => {
    const y = (v - 0.5 - k[1][2]) / k[1][1];
    const x = (u - 0.5 - k[0][2] - k[0][1] * y) / k[0][0];
    return transform(place, [depth * x, depth * y, depth]);
  });
  return [transform(place, [0, 0, 0]), ...corners];
}

/** Draw cameras and their names; `middle` is what they are compared with for their size. */
export function drawFrusta(context, cameras, frame, stage, middle, toScreen, style) {
  for (const camera of cameras) {
    const center = cameraCenter(camera, frame, stage);
    const away = Math.hypot(...center.map((value, k) => value - middle[k]));
    const points = frustum(camera, frame, stage, Math.min(0.8, Math.max(0.15, SHARE * away)));
    const edges = [[0, 1], [0, 2], [0, 3], [0, 4], [1, 2], [2, 3], [3, 4], [4, 1]];
    const lines = edges.map(([a, b]) => seen(toScreen, points[a], points[b], style)).filter((line) => line !== null);
    for (const [color, width] of [[style.shade, 3 * style.size], [camera.current ? style.accent : style.ink, style.size]]) {
      context.strokeStyle = color;
      context.lineWidth = width;
      context.beginPath();
      for (const [from, to] of lines) {
        context.moveTo(...from);
        context.lineTo(...to);
      }
      context.stroke();
    }
    const at = lines.length === edges.length ? lines[0][0] : null;
    if (at !== null && camera.name) drawName(context, camera.name, at, style);
  }
}

function drawName(context, name, at, style) {
  context.font = `${12 * style.size}px system-ui, sans-serif`;
  context.textAlign = "center";
  context.lineJoin = "round";
  context.lineWidth = 3 * style.size;
  context.strokeStyle = style.shade;
  context.strokeText(name, at[0], at[1] - 8 * style.size);
  context.fillStyle = style.ink;
  context.fillText(name, at[0], at[1] - 8 * style.size);
}

/** A line on the screen, cut where it passes the eye; null where none of it is ahead. */
function seen(m, a, b, { width, height }) {
  const [p, q] = [a, b].map((point) => [0, 1, 3].map((r) => m[r] * point[0] + m[4 + r] * point[1] + m[8 + r] * point[2] + m[12 + r]));
  if (p[2] < NEAR && q[2] < NEAR) return null;
  const cut = (from, to) => {
    if (from[2] >= NEAR) return from;
    const share = (NEAR - from[2]) / (to[2] - from[2]);
    return from.map((value, k) => value + share * (to[k] - value));
  };
  return [cut(p, q), cut(q, p)].map(([x, y, w]) => [(0.5 + (0.5 * x) / w) * width, (0.5 - (0.5 * y) / w) * height]);
}
