// The outputs in 3-D, beside the input and the reference.
import { h, select } from "../dom.js";
import { mount } from "../viewer/index.js";

export function shapes(page) {
  const { data, state } = page;
  const scene = data.scenes.find((one) => one.id === state.scene) ?? data.scenes[0];
  const box = h("div", { class: "viewer" });
  const parsed = () => { try { return state.viewer ? JSON.parse(state.viewer) : null; } catch { return null; } };
  const view = h("div", {},
    h("div", { class: "choice" }, data.scenes.length > 1 && select("Shape", data.scenes.map((one) => [one.id, one.title]), scene.id,
      (id) => page.go({ scene: id, viewer: "" }), { id: "choose-scene" })),
    h("h2", {}, scene.title), box);
  const mounted = mount(box, scene, parsed(), (now) => page.change({ scene: scene.id, viewer: now ? JSON.stringify(now) : "" }));
  page.onDispose(() => mounted.dispose());
  return [view];
}
