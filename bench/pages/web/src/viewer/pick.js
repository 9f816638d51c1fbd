// Which vertex is under the pointer: the one nearest to the eye among those that are drawn close to it.

import { FIELD, FRONT, eyeOf } from "./camera.js";

const NEAR = 7; // CSS pixels around the pointer

/**
 * @param {object} shape as unpack gives it
 * @param {{camera: number[], slice: object|null}} view
 * @param {{x: number, y: number, width: number, height: number}} at the pointer in a panel, and the panel's size
 * @returns {number} the number of the vertex, or -1
 */
export function vertexAt({ positions, count }, { camera, slice }, { x, y, width, height }) {
  const [yaw, pitch] = camera, eye = eyeOf(camera);
  const forward = [-Math.cos(pitch) * Math.cos(yaw), -Math.cos(pitch) * Math.sin(yaw), -Math.sin(pitch)];
  const right = [-Math.sin(yaw), Math.cos(yaw), 0];
  const up = [-Math.sin(pitch) * Math.cos(yaw), -Math.sin(pitch) * Math.sin(yaw), Math.cos(pitch)];
  const scale = Math.min(width, height) / 2 / Math.tan((FIELD * Math.PI) / 360);
  const axis = slice ? ["x", "y", "z"].indexOf(slice.axis) : -1;
  const sign = slice ? FRONT[slice.axis] * (slice.flipped ? -1 : 1) : 0;
  let found = -1, closest = Infinity;
  for (let v = 0; v < count; v++) {
    if (axis >= 0 && sign * (positions[3 * v + axis] - slice.at) > 0) continue;
    const dx = positions[3 * v] - eye[0], dy = positions[3 * v + 1] - eye[1], dz = positions[3 * v + 2] - eye[2];
    const depth = dx * forward[0] + dy * forward[1] + dz * forward[2];
    if (depth <= 0 || depth >= closest) continue;
    const across = (scale * (dx * right[0] + dy * right[1])) / depth + width / 2 - x;
    const down = height / 2 - (scale * (dx * up[0] + dy * up[1] + dz * up[2])) / depth - y;
    if (across * across + down * down < NEAR * NEAR) [found, closest] = [v, depth];
  }
  return found;
}
