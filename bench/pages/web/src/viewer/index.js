// The 3-D view: input, outputs and reference side by side, with linked cameras and one scale of errors.
//
//   const viewer = mount(element, scene, state, onState);
//   viewer.getState(); viewer.setState(state); viewer.dispose(); await viewer.ready;
//
// scene: {id, title, unit, limit, panels: [{name, role, kind, geometry, note}]}; geometry is an ID (store.js) or null where
// there is nothing to show but the note. Of the kind "images" it is a picture, which no camera turns. state: a short object (state.js) that JSON holds, null for the default.
// onState is called with it after each change, at most some times a second.

import { HOME, zoomed } from "./camera.js";
import { make } from "./dom.js";
import { Drawing } from "./draw.js";
import { listen } from "./gestures.js";
import { vertexAt } from "./pick.js";
import { colorBar, words } from "./scale.js";
import { AXES, STYLES, shortState, wholeState } from "./state.js";
import { keepOnly, pictureOf, shapeOf } from "./store.js";
import { addStyle } from "./style.js";

const NARROWEST = 230; // CSS pixels of a panel
const QUIET = 250; // milliseconds without a change before onState is called
const TITLES = { surface: "Surface", edges: "With edges", points: "Points" };
const ROLES = { input: "input", reference: "reference", output: "" };
const NO_WEBGL = "The 3-D view needs WebGL 2, which this browser does not offer. Tables and charts work without it.";
const LOST = "The graphics system took this view away. It comes back by itself; if it does not, reload the page.";
const HELP =
  "Drag to rotate, with Shift or the right button to move. Click a panel, then use the wheel to zoom; or the keys: " +
  "arrows rotate, + and - zoom, R resets. Point at a surface to read its distance.";

const isShape = (panel) => Boolean(panel.geometry) && panel.kind !== "images";

export function mount(element, scene, state = null, onState = () => {}) {
  return new Viewer(element, scene, state, onState);
}

class Viewer {
  constructor(element, scene, state, onState) {
    addStyle();
    Object.assign(this, { element, scene, onState, panels: scene.panels ?? [], shapes: [], messages: [] });
    this.state = wholeState(state, this.panels);
    this.build();
    try {
      this.drawing = new Drawing(this.canvas);
    } catch {
      this.root.replaceChildren(make("p", { class: "dbv-failed", role: "status" }, NO_WEBGL));
      this.ready = Promise.resolve();
      return;
    }
    this.observe();
    this.ready = Promise.all(this.panels.map((panel, k) => this.load(panel, k))).then(() => this.drawNow());
    this.refresh();
  }

  // -- the interface ----------------------------------------------------------------------------------------------------

  getState() {
    return shortState(this.state);
  }

  setState(state) {
    this.state = wholeState(state, this.panels);
    this.refresh();
  }

  dispose() {
    this.disposed = true;
    this.watchers?.forEach((stop) => stop());
    clearTimeout(this.quiet);
    cancelAnimationFrame(this.frame);
    this.drawing?.dispose();
    keepOnly(new Set());
    this.root.remove();
  }

  // -- building ---------------------------------------------------------------------------------------------------------

  build() {
    const { scene, panels } = this;
    const hasErrors = scene.limit > 0 && panels.some((panel) => isShape(panel) && panel.role !== "reference");
    this.canvas = make("canvas", { class: "dbv-canvas", "aria-hidden": "true" });
    this.views = panels.map((panel, k) => this.buildView(panel, k));
    this.figures = panels.map((panel, k) => this.buildPanel(panel, this.views[k]));
    this.grid = make("div", { class: "dbv-grid" }, this.figures);
    this.scale = hasErrors ? colorBar("distance to the reference", scene.unit, scene.limit) : make("div");
    this.root = make("section", { class: "dbv", "aria-label": scene.title ?? "3-D view" }, [
      this.buildTools(hasErrors),
      this.buildChips(),
      this.scale,
      make("div", { class: "dbv-stage" }, [this.grid, this.canvas]),
      make("p", { class: "dbv-help" }, HELP),
    ]);
    this.element.append(this.root);
  }

  buildView(panel, k) {
    const say = make("div", { class: "dbv-say" });
    this.messages[k] = say;
    const label = `${panel.name}: ${panel.kind ?? "shape"}, ${panel.role}`;
    const empty = !isShape(panel);
    const view = make(
      "div",
      { class: "dbv-view", tabindex: empty ? null : "0", role: "img", "aria-label": label, "data-empty": empty, "aria-keyshortcuts": "ArrowLeft ArrowRight ArrowUp ArrowDown + - R" },
      say,
    );
    if (empty) return view;
    listen(view, (step) => this.move(k, step));
    const here = make("div", { class: "dbv-here", "aria-hidden": "true" });
    view.append(here);
    view.addEventListener("pointermove", (event) => (here.textContent = this.distanceAt(k, event)));
    view.addEventListener("pointerleave", () => (here.textContent = ""));
    return view;
  }

  buildPanel(panel, view) {
    const role = ROLES[panel.role] && ROLES[panel.role] !== panel.name ? [" ", make("span", { class: "dbv-role" }, ROLES[panel.role])] : [];
    const name = make("figcaption", {}, [make("span", { class: "dbv-name" }, panel.name), ...role]);
    const note = panel.note && panel.geometry ? [make("span", { class: "dbv-note" }, panel.note)] : [];
    return make("figure", { class: "dbv-panel" }, [name, view, ...note]);
  }

  buildTools(hasErrors) {
    const choice = (label, key, titles) =>
      make("div", { class: "dbv-joined", role: "group", "aria-label": label },
        Object.entries(titles).map(([value, title]) =>
          make("button", { type: "button", "data-key": key, "data-value": value, onclick: () => this.change({ [key]: value }) }, title)));
    const press = (title, label, action) => make("button", { type: "button", "aria-label": label, title: label, onclick: action }, title);
    const all = (step) => () => this.change({ cameras: this.state.cameras.map(step) });
    this.linked = make("input", { type: "checkbox", onchange: () => this.link(this.linked.checked) });
    return make("div", { class: "dbv-tools", role: "toolbar", "aria-label": "3-D view" }, [
      ...(hasErrors ? [choice("Colours", "mode", { error: "Distance", plain: "Plain" })] : []),
      choice("Style", "style", Object.fromEntries(STYLES.map((style) => [style, TITLES[style]]))),
      this.buildSlice(),
      make("label", {}, [this.linked, "Linked cameras"]),
      make("div", { class: "dbv-joined", role: "group", "aria-label": "Camera" }, [
        press("−", "Zoom out", all((camera) => zoomed(camera, 1.25))),
        press("+", "Zoom in", all((camera) => zoomed(camera, 0.8))),
        press("Reset", "Reset the camera", all(() => HOME)),
      ]),
    ]);
  }

  buildSlice() {
    const changed = () =>
      this.change({
        slice: this.axis.value ? { axis: this.axis.value, at: Number(this.at.value), flipped: this.side.getAttribute("aria-pressed") === "true" } : null,
      });
    const options = [make("option", { value: "" }, "no slice"), ...AXES.map((axis) => make("option", { value: axis }, `slice along ${axis}`))];
    this.axis = make("select", { "aria-label": "Slice", onchange: changed }, options);
    this.at = make("input", { type: "range", min: "-1.05", max: "1.05", step: "0.01", value: "0", "aria-label": "Place of the slice", oninput: changed });
    const turn = () => {
      this.side.setAttribute("aria-pressed", String(this.side.getAttribute("aria-pressed") !== "true"));
      changed();
    };
    this.side = make("button", { type: "button", "aria-pressed": "false", title: "Show the other side of the slice", onclick: turn }, "Other side");
    return make("div", { class: "dbv-group" }, [this.axis, this.at, this.side]);
  }

  buildChips() {
    const chip = (panel, k) =>
      make("button", { type: "button", onclick: () => this.toggle(k) }, panel.name);
    this.chips = this.panels.map(chip);
    return make("div", { class: "dbv-group dbv-shapes", role: "group", "aria-label": "Shapes that are shown" }, ["Show", ...this.chips]);
  }

  // -- changes ----------------------------------------------------------------------------------------------------------

  move(k, step) {
    const cameras = this.state.linked ? this.state.cameras.map(() => step(this.state.cameras[k])) : this.state.cameras.map((c, i) => (i === k ? step(c) : c));
    this.change({ cameras });
  }

  link(linked) {
    const first = this.state.cameras[this.state.shown.indexOf(true)];
    this.change({ linked, cameras: linked ? this.state.cameras.map(() => first) : this.state.cameras });
  }

  toggle(k) {
    const shown = this.state.shown.map((is, i) => (i === k ? !is : is));
    if (shown.some(Boolean)) this.change({ shown });
  }

  change(part) {
    Object.assign(this.state, part);
    this.refresh();
    clearTimeout(this.quiet);
    this.quiet = setTimeout(() => this.onState(this.getState()), QUIET);
  }

  /** Bring the controls to the state, and draw. */
  refresh() {
    const { state } = this;
    for (const button of this.root.querySelectorAll("[data-key]")) {
      button.setAttribute("aria-pressed", String(state[button.dataset.key] === button.dataset.value));
    }
    this.linked.checked = state.linked;
    this.axis.value = state.slice?.axis ?? "";
    for (const control of [this.at, this.side]) control.disabled = control.hidden = !state.slice;
    if (state.slice) this.at.value = String(state.slice.at);
    this.side.setAttribute("aria-pressed", String(Boolean(state.slice?.flipped)));
    this.scale.style.visibility = state.mode === "error" ? "visible" : "hidden";
    this.chips.forEach((chip, k) => chip.setAttribute("aria-pressed", String(state.shown[k])));
    this.figures.forEach((figure, k) => (figure.hidden = !state.shown[k]));
    this.layOut();
    this.draw();
  }

  // -- shapes -----------------------------------------------------------------------------------------------------------

  async load(panel, k) {
    if (!panel.geometry) return this.say(k, panel.note || "There is nothing to show.");
    this.say(k, "Loading …");
    try {
      if (panel.kind === "images") return await this.showPicture(panel, k);
      const shape = await shapeOf(panel.geometry);
      if (this.disposed) return;
      this.shapes[k] = shape;
      this.say(k, shape.count ? "" : "This shape is empty.");
      this.draw();
    } catch (error) {
      this.say(k, `This shape cannot be shown. ${error.message}`);
    }
  }

  async showPicture(panel, k) {
    const picture = make("img", { class: "dbv-picture", alt: `${panel.name}: ${panel.note}`, src: await pictureOf(panel.geometry) });
    await picture.decode();
    if (this.disposed) return;
    this.say(k, "");
    this.views[k].append(picture);
  }

  say(k, text) {
    this.messages[k].textContent = text;
  }

  /** The distance at a pointer that presses nothing, as text; none beside the shape and where no colours say it. */
  distanceAt(k, { buttons, clientX, clientY }) {
    const shape = this.shapes[k];
    if (buttons || this.state.mode !== "error" || !shape?.errors || !(this.scene.limit > 0)) return "";
    const box = this.views[k].getBoundingClientRect();
    const at = { x: clientX - box.x, y: clientY - box.y, width: box.width, height: box.height };
    const vertex = vertexAt(shape, { camera: this.state.cameras[k], slice: this.state.slice }, at);
    if (vertex < 0) return "";
    const byte = shape.errors[vertex];
    return `${byte === 255 ? "≥ " : ""}${words(Number(((byte / 255) * this.scene.limit).toPrecision(2)))}`;
  }

  // -- drawing ----------------------------------------------------------------------------------------------------------

  observe() {
    const sizes = new ResizeObserver(() => {
      this.layOut();
      this.draw();
    });
    sizes.observe(this.grid);
    const lost = (event) => {
      event.preventDefault();
      this.drawing = null;
      if (!this.disposed) this.panels.forEach((panel, k) => isShape(panel) && this.say(k, LOST));
    };
    const restored = () => {
      this.drawing = new Drawing(this.canvas);
      this.panels.forEach((panel, k) => this.shapes[k] && this.say(k, ""));
      this.draw();
    };
    this.canvas.addEventListener("webglcontextlost", lost);
    this.canvas.addEventListener("webglcontextrestored", restored);
    this.watchers = [() => sizes.disconnect()];
  }

  /** As many columns as fit, and rows that are as full as they can be. */
  layOut() {
    const count = this.state.shown.filter(Boolean).length;
    const most = Math.max(1, Math.floor((this.grid.clientWidth + 12) / (NARROWEST + 12)));
    const columns = Math.ceil(count / Math.ceil(count / Math.min(most, 6)));
    this.grid.style.gridTemplateColumns = `repeat(${columns}, minmax(0, 1fr))`;
  }

  /** Draw soon: once a frame at most, and only when something changed. */
  draw() {
    this.frame ??= requestAnimationFrame(() => this.drawNow());
  }

  drawNow() {
    this.frame = null;
    if (!this.drawing || this.disposed || !this.grid.clientWidth) return;
    this.drawing.resize(this.grid.clientWidth, this.grid.clientHeight);
    this.drawing.clear();
    const origin = this.grid.getBoundingClientRect();
    this.panels.forEach((_, k) => {
      if (!this.state.shown[k] || !this.shapes[k]?.count) return;
      const rect = this.views[k].getBoundingClientRect();
      const box = { x: rect.x - origin.x + 1, y: rect.y - origin.y + 1, width: rect.width - 2, height: rect.height - 2 };
      this.drawing.draw(this.shapes[k], box, { ...this.state, camera: this.state.cameras[k] });
    });
  }
}

globalThis.detailbenchViewer = { mount, shapeOf };
