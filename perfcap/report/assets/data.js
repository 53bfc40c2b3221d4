// Data of the page: JSON, and arrays in deflated base64.

const TYPES = {
  uint8: Uint8Array,
  uint16: Uint16Array,
  int16: Int16Array,
  uint32: Uint32Array,
  float32: Float32Array,
};

/** The page's JSON. */
export function readData() {
  return JSON.parse(document.getElementById("data").textContent);
}

/** Bytes of a blob; its text is removed from the page, since nothing reads it twice. */
export function takeBytes(name) {
  const element = document.getElementById(`blob-${name}`);
  const text = element.textContent;
  element.remove();
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  const binary = atob(text);
  const bytes = new Uint8Array(binary.length);
  for (let i = 0; i < binary.length; i += 1) bytes[i] = binary.charCodeAt(i);
  return bytes;
}

/** Arrays of a pack by name, each with its `shape`. */
export async function takeArrays(name, entries) {
  const stream = new Blob([takeBytes(name)]).stream();
  const inflated = stream.pipeThrough(new DecompressionStream("deflate"));
  const buffer = await new Response(inflated).arrayBuffer();
  const arrays = {};
  for (const [key, entry] of Object.entries(entries)) {
    const count = entry.shape.reduce((product, size) => product * size, 1);
    arrays[key] = new TYPES[entry.type](buffer, entry.start, count);
    arrays[key].shape = entry.shape;
  }
  return arrays;
}

/**
 * Levels of a surface, (F, V, 3) 16 bit, from their coded differences (2, 3, F, V).
 *
 * Each is the difference to the vertex before, of the difference to the frame before, modulo 2^16.
 */
export function restoreLevels(coded) {
  const [, , frames, vertices] = coded.shape;
  const plane = 3 * frames * vertices;
  const levels = new Uint16Array(plane);
  for (let axis = 0; axis < 3; axis += 1) {
    for (let frame = 0; frame < frames; frame += 1) {
      let from = (axis * frames + frame) * vertices;
      let to = frame * vertices * 3 + axis;
      let before = to - vertices * 3;
      let change = 0;
      for (let vertex = 0; vertex < vertices; vertex += 1) {
        const folded = coded[from] | (coded[from + plane] << 8);
        change += (folded >>> 1) ^ -(folded & 1);
        levels[to] = frame === 0 ? change : levels[before] + change;
        from += 1;
        to += 3;
        before += 3;
      }
    }
  }
  return levels;
}
