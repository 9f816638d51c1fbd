// What a link holds of the view. Only what differs from the defaults is in it.

import { HOME, cameraFrom, rounded } from "./camera.js";

export const STYLES = ["surface", "edges", "points"];
export const AXES = ["x", "y", "z"];

/** A whole state from a short one, which may be anybody's: what is none of ours is left out. */
export function wholeState(short, panels) {
  const given = short && typeof short === "object" ? short : {};
  const linked = given.linked !== false;
  const one = cameraFrom(given.camera) ?? HOME;
  const each = Array.isArray(given.camera) ? given.camera.map(cameraFrom) : [];
  const [axis, at, flipped] = Array.isArray(given.slice) ? given.slice : [];
  const hidden = Array.isArray(given.hidden) ? given.hidden : [];
  const shown = panels.map((_, k) => !hidden.includes(k));
  return {
    linked,
    cameras: panels.map((_, k) => (linked ? one : each[k] ?? one)),
    mode: given.mode === "plain" ? "plain" : "error",
    style: STYLES.includes(given.style) ? given.style : "surface",
    slice: AXES.includes(axis) && Number.isFinite(at) ? { axis, at: Math.min(2, Math.max(-2, at)), flipped: flipped === 1 } : null,
    shown: shown.some(Boolean) ? shown : panels.map(() => true),
  };
}

/** The short state of a whole one. */
export function shortState(state) {
  const short = {};
  const home = JSON.stringify(HOME), cameras = state.cameras.map(rounded);
  if (!state.linked) [short.linked, short.camera] = [false, cameras];
  else if (cameras.length && JSON.stringify(cameras[0]) !== home) short.camera = cameras[0];
  if (state.mode !== "error") short.mode = state.mode;
  if (state.style !== "surface") short.style = state.style;
  if (state.slice) {
    const { axis, at, flipped } = state.slice;
    short.slice = [axis, Number(at.toFixed(3)), ...(flipped ? [1] : [])];
  }
  const hidden = state.shown.flatMap((is, k) => (is ? [] : [k]));
  if (hidden.length) short.hidden = hidden;
  return short;
}
