// 4x4 matrices, column by column, and vectors of three.

/** Product of two matrices. */
export function multiply(a, b) {
  const out = new Float32Array(16);
  for (let column = 0; column < 4; column += 1) {
    for (let row = 0; row < 4; row += 1) {
      let sum = 0;
      for (let k = 0; k < 4; k += 1) sum += a[4 * k + row] * b[4 * column + k];
      out[4 * column + row] = sum;
    }
  }
  return out;
}

/** From three rows [x, y, z, shift]. */
export function fromRows(rows) {
  const out = new Float32Array(16);
  rows.forEach((row, r) => row.forEach((value, c) => { out[4 * c + r] = value; }));
  out[15] = 1;
  return out;
}

/** Inverse of a rotation with a shift. */
export function invertRigid(m) {
  const rows = [0, 1, 2].map((r) => [m[4 * r], m[4 * r + 1], m[4 * r + 2]]);
  const shift = [m[12], m[13], m[14]];
  return fromRows(rows.map((row) => [...row, -dot(row, shift)]));
}

/** Perspective of a vertical angle of view. */
export function perspective(angle, aspect, near, far) {
  const f = 1 / Math.tan(angle / 2);
  const out = new Float32Array(16);
  out[0] = f / aspect;
  out[5] = f;
  out[10] = (far + near) / (near - far);
  out[11] = -1;
  out[14] = (2 * far * near) / (near - far);
  return out;
}

/** A box of half width `side`, from `near` to `far`. */
export function orthographic(side, near, far) {
  return fromRows([
    [1 / side, 0, 0, 0],
    [0, 1 / side, 0, 0],
    [0, 0, 2 / (near - far), (far + near) / (near - far)],
  ]);
}

/** World to camera of an eye that looks at a target. */
export function lookAt(eye, target, up) {
  const back = normalize(subtract(eye, target));
  const side = normalize(cross(up, back));
  const top = cross(back, side);
  return fromRows([side, top, back].map((axis) => [...axis, -dot(axis, eye)]));
}

/** A point moved by a rigid or affine matrix. */
export function transform(m, p) {
  return [0, 1, 2].map((r) => m[r] * p[0] + m[4 + r] * p[1] + m[8 + r] * p[2] + m[12 + r]);
}

/** Clip coordinates [x, y, w] of a point, w negative behind the eye. */
export function project(m, p) {
  return [0, 1, 3].map((r) => m[r] * p[0] + m[4 + r] * p[1] + m[8 + r] * p[2] + m[12 + r]);
}

export function dot(a, b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

export function cross(a, b) {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}

export function subtract(a, b) {
  return [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
}

export function normalize(a) {
  const length = Math.hypot(...a) || 1;
  return a.map((x) => x / length);
}
