// Where things are in 3D: y up, the ground at 0, the person facing z at first.

import { fromRows, transform } from "./matrix.js";

const MARGIN = 0.16; // m around joints: hands, hair, shoes
const SMOOTH = 0.35; // s, standard deviation of the path that the view follows

/** Matrix from the world to the stage, in the middle of the paths of everybody's joints. */
export function stageMatrix(scene, everybody) {
  const [side, up, ahead] = scene.axes;
  const turned = fromRows([[...side, 0], [...up, -scene.ground], [...ahead, 0]]);
  const roots = everybody.flatMap((joints) => rootPath(joints, turned));
  const middle = [0, 2].map((k) => {
    const values = roots.map((root) => root[k]);
    return (Math.min(...values) + Math.max(...values)) / 2;
  });
  return fromRows([
    [...side, -middle[0]],
    [...up, -scene.ground],
    [...ahead, -middle[1]],
  ]);
}

/** Joints of a frame on the stage, 16 points. */
export function stageJoints(joints, frame, stage) {
  const points = [];
  for (let joint = 0; joint < 16; joint += 1) {
    const at = 3 * (16 * frame + joint);
    points.push(transform(stage, joints.subarray(at, at + 3)));
  }
  return points;
}

/**
 * What the view looks at in every frame: above or below the smoothed root, in the middle of the
 * person; and half the height and width (m) that hold the person around it.
 */
export function framing(joints, stage, rate) {
  const frames = joints.shape[0];
  const height = middleHeight(joints, stage);
  const roots = rootPath(joints, stage);
  const path = smoothed(roots, SMOOTH * rate).map((root) => [root[0], height, root[2]]);
  const half = { height: 0.5, width: 0.3 };
  for (let frame = 0; frame < frames; frame += 1) {
    for (const joint of stageJoints(joints, frame, stage)) {
      half.height = Math.max(half.height, MARGIN + Math.abs(joint[1] - height));
      half.width = Math.max(half.width, MARGIN + Math.hypot(joint[0] - path[frame][0], joint[2] - path[frame][2]));
    }
  }
  return { path, half, middle: [0, height, 0] };
}

/** The same of several people: what lies between them, and all of them around it. */
export function framingOf(everybody, stage, rate) {
  const each = everybody.map((joints) => framing(joints, stage, rate));
  if (each.length === 1) return each[0];
  const mean = (points) => [0, 1, 2].map((k) => points.reduce((sum, point) => sum + point[k], 0) / points.length);
  const path = each[0].path.map((_, frame) => mean(each.map((own) => own.path[frame])));
  const half = { height: 0, width: 0 };
  for (const own of each) {
    own.path.forEach((point, frame) => {
      const away = Math.hypot(point[0] - path[frame][0], point[2] - path[frame][2]);
      half.width = Math.max(half.width, own.half.width + away);
      half.height = Math.max(half.height, own.half.height + Math.abs(point[1] - path[frame][1]));
    });
  }
  return { path, half, middle: mean(each.map((own) => own.middle)) };
}

/** Middle between the ground and the highest that joints usually are. */
function middleHeight(joints, stage) {
  const tops = [];
  for (let frame = 0; frame < joints.shape[0]; frame += 1) {
    tops.push(Math.max(...stageJoints(joints, frame, stage).map((joint) => joint[1])));
  }
  tops.sort((a, b) => a - b);
  return 0.5 * Math.max(0.4, tops[Math.floor(0.9 * (tops.length - 1))]);
}

function rootPath(joints, matrix) {
  const roots = [];
  for (let frame = 0; frame < joints.shape[0]; frame += 1) {
    const [right, left] = [8, 12].map((joint) => {
      const at = 3 * (16 * frame + joint);
      return transform(matrix, joints.subarray(at, at + 3));
    });
    roots.push([0, 1, 2].map((k) => (right[k] + left[k]) / 2));
  }
  return roots;
}

function smoothed(points, deviation) {
  const reach = Math.ceil(3 * deviation);
  return points.map((_, frame) => {
    const sum = [0, 0, 0];
    let total = 0;
    for (let other = Math.max(0, frame - reach); other <= Math.min(points.length - 1, frame + reach); other += 1) {
      const share = Math.exp(-0.5 * ((other - frame) / deviation) ** 2);
      total += share;
      for (let k = 0; k < 3; k += 1) sum[k] += share * points[other][k];
    }
    return sum.map((value) => value / total);
  });
}
