// Packed shapes: the container that bench/pages/packing.py describes, read in the browser.

const FACES = 1, ERRORS = 2, NORMALS = 4;

/** The bytes of base64 text. */
export function bytesOf(base64) {
  const text = atob(base64.replace(/\s+/g, ""));
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  return bytes;
}

async function inflated(bytes) {
  if (typeof DecompressionStream === "undefined") {
    throw new Error("This browser is too old to unpack shapes: it has no DecompressionStream.");
  }
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/**
 * The shape in a container.
 * @param {Uint8Array} data
 * @returns {Promise<{count: number, low: number[], step: number, quantised: Uint16Array, positions: Float32Array,
 *   faces: Uint32Array|null, errors: Uint8Array|null, normals: Float32Array|null}>}
 */
export async function unpack(data) {
  const head = new DataView(data.buffer, data.byteOffset);
  if (data.length < 8 || String.fromCharCode(...data.subarray(0, 4)) !== "dtbs" || head.getUint32(4, true) !== 1) {
    throw new Error("The stored shape has another format than this page reads.");
  }
  const body = await inflated(data.subarray(8));
  const view = new DataView(body.buffer);
  const [flags, n, m, r] = [0, 4, 8, 12].map((at) => view.getUint32(at, true));
  const [x, y, z, step] = [16, 20, 24, 28].map((at) => view.getFloat32(at, true));
  let at = 32;
  const numbers = (count, width) => {
    const found = new Int32Array(count);
    for (let k = 0; k < width; k++, at += count) {
      for (let i = 0; i < count; i++) found[i] |= body[at + i] << (8 * k);
    }
    return found;
  };
  const residuals = [0, 1, 2].map(() => numbers(n, 2));
  const errors = flags & ERRORS ? Uint8Array.from(numbers(n, 1)) : null;
  const normals = flags & NORMALS ? unfolded(numbers(n, 1), numbers(n, 1)) : null;
  const tree = flags & FACES ? readFaces(numbers, m, r, n) : null;
  const quantised = new Uint16Array(3 * n);
  for (let v = 0; v < n; v++) {
    const gate = tree && tree.gates[3 * v] >= 0;
    const [a, b, d] = gate ? tree.gates.subarray(3 * v, 3 * v + 3) : [v - 1, v - 1, v - 1];
    for (let k = 0; k < 3; k++) {
      const code = residuals[k][v];
      const predicted = v ? quantised[3 * a + k] + quantised[3 * b + k] - quantised[3 * d + k] : 0;
      quantised[3 * v + k] = predicted + ((code >> 1) ^ -(code & 1)); // modulo 65536
    }
    if (errors && v) errors[v] += (errors[a] + errors[b] + 1) >> 1; // modulo 256
  }
  const positions = new Float32Array(3 * n);
  const low = [x, y, z];
  for (let i = 0; i < 3 * n; i++) positions[i] = low[i % 3] + quantised[i] * step;
  return { count: n, low, step, quantised, positions, faces: tree && tree.faces, errors, normals };
}

function readFaces(numbers, m, r, n) {
  const steps = numbers(m - r, 3), edges = numbers(m - r, 1), codes = numbers(m + 2 * r, 3);
  const faces = new Uint32Array(3 * m), gates = new Int32Array(3 * n).fill(-1);
  let newest = -1, next = 0, parent = 0;
  const corner = () => {
    const code = codes[next++];
    return code ? newest - code + 1 : ++newest;
  };
  for (let i = 0; i < 3 * r; i++) faces[i] = corner();
  for (let f = r; f < m; f++) {
    parent = (parent + steps[f - r]) & 0xffffff;
    const edge = edges[f - r], k = edge % 3;
    const a = faces[3 * parent + k], b = faces[3 * parent + (k + 1) % 3], d = faces[3 * parent + (k + 2) % 3];
    const before = newest, last = corner();
    faces.set(edge < 3 ? [b, a, last] : [a, b, last], 3 * f);
    if (newest > before) gates.set([a, b, d], 3 * last);
  }
  return { faces, gates };
}

function unfolded(xs, ys) {
  const normals = new Float32Array(3 * xs.length);
  for (let i = 0; i < xs.length; i++) {
    let x = xs[i] / 127 - 1, y = ys[i] / 127 - 1;
    const z = 1 - Math.abs(x) - Math.abs(y);
    if (z < 0) [x, y] = [(1 - Math.abs(y)) * (x < 0 ? -1 : 1), (1 - Math.abs(x)) * (y < 0 ? -1 : 1)];
    const length = Math.hypot(x, y, z) || 1;
    normals.set([x / length, y / length, z / length], 3 * i);
  }
  return normals;
}

const CREASE = Math.cos(Math.PI / 6); // faces that meet at more than 30 degrees have an edge between them

/**
 * The corners of all faces, one after the other, with normals that are smooth within a crease angle: at each corner the
 * sum of the normals, weighted by area, of those faces around the vertex that are nearly parallel to its own.
 */
export function corners({ positions, faces, errors, count }) {
  const m = faces.length / 3;
  const areas = new Float32Array(3 * m), units = new Float32Array(3 * m);
  const first = new Uint32Array(count + 1), around = new Uint32Array(3 * m);
  for (let f = 0; f < m; f++) {
    const [a, b, c] = [3 * faces[3 * f], 3 * faces[3 * f + 1], 3 * faces[3 * f + 2]];
    const ux = positions[b] - positions[a], uy = positions[b + 1] - positions[a + 1], uz = positions[b + 2] - positions[a + 2];
    const vx = positions[c] - positions[a], vy = positions[c + 1] - positions[a + 1], vz = positions[c + 2] - positions[a + 2];
    const normal = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
    const length = Math.hypot(...normal) || 1;
    for (let k = 0; k < 3; k++) {
      areas[3 * f + k] = normal[k];
      units[3 * f + k] = normal[k] / length;
      first[faces[3 * f + k] + 1]++;
    }
  }
  for (let v = 0; v < count; v++) first[v + 1] += first[v];
  const next = first.slice();
  for (let i = 0; i < 3 * m; i++) around[next[faces[i]]++] = Math.floor(i / 3);
  const found = { positions: new Float32Array(9 * m), normals: new Float32Array(9 * m), errors: new Uint8Array(3 * m) };
  for (let i = 0; i < 3 * m; i++) {
    const own = 3 * Math.floor(i / 3), vertex = faces[i];
    let x = 0, y = 0, z = 0;
    for (let k = first[vertex]; k < first[vertex + 1]; k++) {
      const other = 3 * around[k];
      const cosine = units[own] * units[other] + units[own + 1] * units[other + 1] + units[own + 2] * units[other + 2];
      if (cosine < CREASE) continue;
      x += areas[other];
      y += areas[other + 1];
      z += areas[other + 2];
    }
    const length = Math.hypot(x, y, z) || 1;
    found.normals.set([x / length, y / length, z / length], 3 * i);
    found.positions.set(positions.subarray(3 * vertex, 3 * vertex + 3), 3 * i);
    if (errors) found.errors[i] = errors[vertex];
  }
  return found;
}

/** The edges of a mesh, each once: pairs of vertices. */
export function edgesOf(faces, count) {
  const seen = new Set(), edges = [];
  for (let f = 0; f < faces.length; f += 3) {
    for (let k = 0; k < 3; k++) {
      const a = faces[f + k], b = faces[f + (k + 1) % 3];
      const key = Math.min(a, b) * count + Math.max(a, b);
      if (!seen.has(key)) {
        seen.add(key);
        edges.push(a, b);
      }
    }
  }
  return Uint32Array.from(edges);
}
