// Pointer, touch, wheel and keys of one panel, as moves of a camera.
//
// A finger that strokes a panel up or down scrolls the page, and so does the wheel, until the panel has the focus (a tap
// or a click gives it): a wide view on a phone must not catch the page.

import { HOME, panned, rotated, zoomed } from "./camera.js";

const TURN = 0.009; // radians a pixel
const KEY_TURN = 0.12, KEY_MOVE = 0.06, KEY_ZOOM = 1.15;

const KEYS = {
  ArrowLeft: (camera, shift) => (shift ? panned(camera, -KEY_MOVE, 0) : rotated(camera, -KEY_TURN, 0)),
  ArrowRight: (camera, shift) => (shift ? panned(camera, KEY_MOVE, 0) : rotated(camera, KEY_TURN, 0)),
  ArrowUp: (camera, shift) => (shift ? panned(camera, 0, -KEY_MOVE) : rotated(camera, 0, -KEY_TURN)),
  ArrowDown: (camera, shift) => (shift ? panned(camera, 0, KEY_MOVE) : rotated(camera, 0, KEY_TURN)),
  "+": (camera) => zoomed(camera, 1 / KEY_ZOOM),
  "=": (camera) => zoomed(camera, 1 / KEY_ZOOM),
  "-": (camera) => zoomed(camera, KEY_ZOOM),
  _: (camera) => zoomed(camera, KEY_ZOOM),
  r: () => HOME,
  R: () => HOME,
};

/** Let an element move a camera: ``move`` takes a function from a camera to the next. */
export function listen(element, move) {
  const pointers = new Map();

  const spread = () => {
    const [a, b] = [...pointers.values()];
    return { x: (a.x + b.x) / 2, y: (a.y + b.y) / 2, size: Math.max(1, Math.hypot(a.x - b.x, a.y - b.y)) };
  };

  const down = (event) => {
    if (pointers.size >= 2) return;
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    element.setPointerCapture(event.pointerId);
  };

  const moved = (event) => {
    const last = pointers.get(event.pointerId);
    if (!last) return;
    const short = Math.max(1, Math.min(element.clientWidth, element.clientHeight));
    const next = { x: event.clientX, y: event.clientY };
    if (pointers.size === 2) {
      const before = spread();
      pointers.set(event.pointerId, next);
      const after = spread();
      move((camera) => panned(zoomed(camera, before.size / after.size), (after.x - before.x) / short, (after.y - before.y) / short));
      return;
    }
    const [dx, dy] = [next.x - last.x, next.y - last.y];
    const pans = event.shiftKey || event.buttons & 2 || event.buttons & 4;
    move((camera) => (pans ? panned(camera, dx / short, dy / short) : rotated(camera, dx * TURN, dy * TURN)));
    pointers.set(event.pointerId, next);
  };

  const up = (event) => pointers.delete(event.pointerId);

  const wheel = (event) => {
    if (document.activeElement !== element && !event.ctrlKey) return;
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 16 : 1;
    move((camera) => zoomed(camera, Math.exp(Math.min(200, Math.max(-200, event.deltaY * lines)) * 0.0015)));
  };

  const key = (event) => {
    const step = KEYS[event.key];
    if (!step || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    event.stopPropagation();
    move((camera) => step(camera, event.shiftKey));
  };

  element.addEventListener("pointerdown", down);
  element.addEventListener("pointermove", moved);
  element.addEventListener("pointerup", up);
  element.addEventListener("pointercancel", up);
  element.addEventListener("wheel", wheel, { passive: false });
  element.addEventListener("keydown", key);
  element.addEventListener("contextmenu", (event) => event.preventDefault());
}
