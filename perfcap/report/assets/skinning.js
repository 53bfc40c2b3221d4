// Dual quaternion skinning (Kavan et al. 2007), as the capture itself skins.

/** Moves rest vertices with the bones of a frame. */
export class Skin {
  constructor(arrays) {
    this.rest = arrays.rest;
    this.bones = arrays.weight_bones;
    this.weights = arrays.weights;
    this.rotations = arrays.rotations;
    this.translations = arrays.translations;
    this.count = arrays.rotations.shape[1];
    this.table = new Float32Array(8 * this.count);
  }

  /** Write the vertices of a frame into `out`, metres in the world. */
  pose(frame, out) {
    this.fill(frame);
    const { rest, bones, weights, table } = this;
    const blend = new Float64Array(8);
    for (let vertex = 0; vertex < rest.length / 3; vertex += 1) {
      blend.fill(0);
      const pivot = 8 * bones[4 * vertex];
      for (let k = 4 * vertex; k < 4 * vertex + 4; k += 1) {
        if (weights[k] === 0) continue;
        const row = 8 * bones[k];
        const same = table[row] * table[pivot] + table[row + 1] * table[pivot + 1]
          + table[row + 2] * table[pivot + 2] + table[row + 3] * table[pivot + 3];
        const share = same < 0 ? -weights[k] : weights[k];
        for (let i = 0; i < 8; i += 1) blend[i] += share * table[row + i];
      }
      move(blend, rest, 3 * vertex, out);
    }
  }

  /** Dual quaternions of the bones: real part q = (w, x, y, z), dual part t q / 2. */
  fill(frame) {
    const { table, rotations, translations } = this;
    for (let bone = 0; bone < this.count; bone += 1) {
      const at = frame * this.count + bone;
      const [w, x, y, z] = rotations.subarray(4 * at, 4 * at + 4);
      const [a, b, c] = translations.subarray(3 * at, 3 * at + 3);
      table.set([
        w, x, y, z,
        -0.5 * (a * x + b * y + c * z),
        0.5 * (a * w + b * z - c * y),
        0.5 * (b * w + c * x - a * z),
        0.5 * (c * w + a * y - b * x),
      ], 8 * bone);
    }
  }
}

/** Move the vertex at `at` by a dual quaternion of any length. */
function move(blend, rest, at, out) {
  const [w, a, b, c, u, e, f, g] = blend;
  const scale = 2 / (w * w + a * a + b * b + c * c);
  const x = rest[at];
  const y = rest[at + 1];
  const z = rest[at + 2];
  // x + 2 (a × s + w e - u a), s = a × x + w x + e, all over the squared length
  const p = b * z - c * y + w * x + e;
  const q = c * x - a * z + w * y + f;
  const r = a * y - b * x + w * z + g;
  out[at] = x + scale * (b * r - c * q + w * e - u * a);
  out[at + 1] = y + scale * (c * p - a * r + w * f - u * b);
  out[at + 2] = z + scale * (a * q - b * p + w * g - u * c);
}
