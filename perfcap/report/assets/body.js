// The person's mesh: its vertices and normals in any frame, captured or skinned.

import { restoreLevels } from "./data.js";
import { Skin } from "./skinning.js";

/** Vertices are welded; `welded` says which of them each corner of the texture belongs to. */
export class Body {
  constructor(arrays) {
    this.skin = new Skin(arrays);
    this.welded = arrays.welded;
    this.faces = arrays.faces;
    this.uv = arrays.uv;
    this.corners = this.faces.map((corner) => this.welded[corner]);
    this.positions = new Float32Array(arrays.rest.length);
    this.normals = new Float32Array(arrays.rest.length);
    this.surface = null;
  }

  /** Add the captured surface. */
  addSurface(arrays, origin, step) {
    this.surface = { levels: restoreLevels(arrays.coded), origin, step };
  }

  /** Compute positions and normals of a frame. */
  pose(frame, kind) {
    if (kind === "captured" && this.surface !== null) this.read(frame);
    else this.skin.pose(frame, this.positions);
    this.shade();
  }

  read(frame) {
    const { levels, origin, step } = this.surface;
    const size = this.positions.length;
    for (let i = 0, from = frame * size; i < size; i += 1, from += 1) {
      this.positions[i] = origin[i % 3] + step * levels[from];
    }
  }

  /** Normals: of the faces around a vertex, weighted by area. */
  shade() {
    const { positions: p, normals: n, corners } = this;
    n.fill(0);
    for (let i = 0; i < corners.length; i += 3) {
      const a = 3 * corners[i];
      const b = 3 * corners[i + 1];
      const c = 3 * corners[i + 2];
      const ux = p[b] - p[a];
      const uy = p[b + 1] - p[a + 1];
      const uz = p[b + 2] - p[a + 2];
      const vx = p[c] - p[a];
      const vy = p[c + 1] - p[a + 1];
      const vz = p[c + 2] - p[a + 2];
      const x = uy * vz - uz * vy;
      const y = uz * vx - ux * vz;
      const z = ux * vy - uy * vx;
      n[a] += x; n[a + 1] += y; n[a + 2] += z;
      n[b] += x; n[b + 1] += y; n[b + 2] += z;
      n[c] += x; n[c + 1] += y; n[c + 2] += z;
    }
  }

  /** Positions and normals side by side, for every corner of the texture. */
  spread(out) {
    const { positions: p, normals: n, welded } = this;
    for (let i = 0, to = 0; i < welded.length; i += 1, to += 6) {
      const from = 3 * welded[i];
      out[to] = p[from];
      out[to + 1] = p[from + 1];
      out[to + 2] = p[from + 2];
      out[to + 3] = n[from];
      out[to + 4] = n[from + 1];
      out[to + 5] = n[from + 2];
    }
  }

  /** Edges of the mesh, each once, as pairs of indices into the spread vertices. */
  edges() {
    const seen = new Set();
    const pairs = [];
    const total = this.positions.length / 3;
    for (let i = 0; i < this.faces.length; i += 3) {
      for (const [s, t] of [[i, i + 1], [i + 1, i + 2], [i + 2, i]]) {
        const a = this.corners[s];
        const b = this.corners[t];
        const key = a < b ? a * total + b : b * total + a;
        if (!seen.has(key)) {
          seen.add(key);
          pairs.push(this.faces[s], this.faces[t]);
        }
      }
    }
    return new Uint32Array(pairs);
  }
}
