// An orbit around a target, z up: [yaw, pitch, distance, x, y, z], angles in radians, lengths in the scene's unit.
//
// Six numbers are the whole state, so a link can hold them, and nothing has to run between two moves.

export const HOME = [-0.9, 0.41, 4, 0, 0, 0];
export const FIELD = 30; // degrees across the shorter side of a panel
export const FRONT = { x: 1, y: -1, z: 1 }; // the side of each axis where the camera starts: a slice takes it away
const STEEPEST = 1.553; // 89 degrees: at the pole there is no up

const clamp = (value, low, high) => Math.min(high, Math.max(low, value));

/** A camera from foreign values, or null. */
export function cameraFrom(value) {
  if (!Array.isArray(value) || value.length !== 6 || !value.every((number) => Number.isFinite(number))) return null;
  const [yaw, pitch, distance, ...target] = value;
  return [yaw, clamp(pitch, -STEEPEST, STEEPEST), clamp(distance, 0.05, 50), ...target.map((x) => clamp(x, -50, 50))];
}

/** Six numbers as short as a link wants them. */
export const rounded = (camera) => camera.map((number) => Number(number.toFixed(3)));

export function rotated([yaw, pitch, ...rest], dx, dy) {
  const turned = yaw - dx;
  return [Math.atan2(Math.sin(turned), Math.cos(turned)), clamp(pitch + dy, -STEEPEST, STEEPEST), ...rest];
}

export function zoomed([yaw, pitch, distance, ...target], factor) {
  return [yaw, pitch, clamp(distance * factor, 0.05, 50), ...target];
}

/** Moved along the picture by shares of its shorter side. */
export function panned(camera, dx, dy) {
  const [yaw, pitch, distance, x, y, z] = camera;
  const length = 2 * distance * Math.tan((FIELD * Math.PI) / 360);
  const right = [-Math.sin(yaw), Math.cos(yaw), 0];
  const up = [-Math.sin(pitch) * Math.cos(yaw), -Math.sin(pitch) * Math.sin(yaw), Math.cos(pitch)];
  const moved = [x, y, z].map((value, k) => clamp(value + length * (-dx * right[k] + dy * up[k]), -50, 50));
  return [yaw, pitch, distance, ...moved];
}

export function eyeOf([yaw, pitch, distance, x, y, z]) {
  return [
    x + distance * Math.cos(pitch) * Math.cos(yaw),
    y + distance * Math.cos(pitch) * Math.sin(yaw),
    z + distance * Math.sin(pitch),
  ];
}
