import { h, select } from "./dom.js";
import { chosen, keyOf, load, plainLabel } from "./data.js";
import { counted, day } from "./format.js";
import { styles } from "./colors.js";
import * as link from "./state.js";
import { about } from "./views/about.js";
import { board } from "./views/board.js";
import { cases } from "./views/cases.js";
import { cost } from "./views/cost.js";
import { duels } from "./views/duels.js";
import { failures } from "./views/failures.js";
import { published } from "./views/published.js";
import { shapes } from "./views/shapes.js";
import { hasSlices, slices } from "./views/slices.js";
import { traces } from "./views/traces.js";

const VIEWS = [
  { id: "board", title: "Leaderboard", draw: board, choice: true },
  { id: "cost", title: "Quality and cost", draw: cost, choice: true },
  { id: "traces", title: "Over time", draw: traces, present: (data) => data.traces.length > 0 },
  { id: "cases", title: "Cases", draw: cases },
  { id: "shapes", title: "Shapes", draw: shapes, present: (data) => data.scenes.length > 0 },
  { id: "duels", title: "One by one", draw: duels, choice: true },
  { id: "slices", title: "Slices", draw: slices, present: hasSlices },
  { id: "failures", title: "Failures", draw: failures, count: (data) => data.failures.length },
  { id: "published", title: "Published numbers", draw: published, present: (data) => data.published.length > 0 },
  { id: "about", title: "Provenance", draw: about },
];
const OF_A_VIEW = /^(sort|q|f\..*|case|scene|viewer)$/; // what does not outlive the view that it belongs to

function start() {
  const data = load();
  const page = { data, state: link.read() };
  page.styles = styles(data.groups.flatMap((group) => group.contenders.map((one) => one.label)));
  for (const one of data.groups.flatMap((group) => group.contenders)) { // traces go by the parameters
    const plain = plainLabel(one.method, one.variant);
    if (!page.styles.has(plain)) page.styles.set(plain, page.styles.get(one.label));
  }
  const views = VIEWS.filter((view) => !view.present || view.present(data));
  const main = h("main", { id: "content", tabindex: "-1", role: "tabpanel" });
  const tabs = h("div", { role: "tablist", "aria-label": "Views" });
  let dispose = null;

  page.link = (change) => `#${new URLSearchParams(Object.entries({ ...page.state, ...change }).filter(([, v]) => v))}`;
  page.methodPage = (method) => { // in a site, from another page
    const there = data.site && data.focus !== method && data.site.pages.find((one) => one.kind === "method" && one.name === method);
    return there ? data.site.root + there.href.split("/").map(encodeURIComponent).join("/") : null;
  };
  page.change = (change) => { // what a part of the view did by itself
    page.state = { ...page.state, ...change };
    link.write(page.state);
  };
  page.go = (change) => {
    page.change(change);
    draw();
  };
  page.onDispose = (action) => { dispose = action; };
  let after = [];
  page.shown = (action) => after.push(action); // once the view is in the page

  const current = () => views.find((view) => view.id === page.state.view) ?? views[0];

  for (const view of views) {
    tabs.append(h("button", {
      type: "button", role: "tab", id: `tab-${view.id}`, "aria-controls": "content", "data-view": view.id,
      onclick: () => leaveFor(view.id),
    }, view.title, view.count?.(data) > 0 && h("span", { class: "badge" }, String(view.count(data)))));
  }
  tabs.addEventListener("keydown", (event) => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    const at = views.indexOf(current());
    const next = step ? views[(at + step + views.length) % views.length]
      : event.key === "Home" ? views[0] : event.key === "End" ? views.at(-1) : null;
    if (!next) return;
    event.preventDefault();
    leaveFor(next.id);
    document.getElementById(`tab-${next.id}`).focus();
  });

  function leaveFor(id) {
    const kept = Object.fromEntries(Object.entries(page.state).filter(([name]) => !OF_A_VIEW.test(name)));
    page.state = { ...kept, view: id };
    link.write(page.state);
    draw();
  }

  function fields(choice) {
    const { task, ways, by, groups, group, metric } = choice;
    return h("div", { class: "choice" },
      data.tasks.length > 1 && select("Task", data.tasks.map((name) => [name, name]), task,
        (value) => page.go({ task: value, by: "", group: "", metric: "" }), { id: "choose-task" }),
      ways.length > 1 && select("Tables", ways.map((way) => [way.name, way.title]), by,
        (value) => page.go({ by: value, group: "" }), { id: "choose-by" }),
      groups.length > 1 && select("Table", groups.map((one) => [keyOf(one), one.title.split(" · ").slice(1).join(" · ")]),
        keyOf(group), (value) => page.go({ group: value }), { id: "choose-group" }),
      group.metrics.length > 1 && select("Metric", group.metrics.map((one) => [one.name, one.heading]), metric.name,
        (value) => page.go({ metric: value, sort: "" }), { id: "choose-metric" }));
  }

  function draw() {
    dispose?.();
    dispose = null;
    after = [];
    const view = current();
    for (const tab of tabs.children) {
      const mine = tab.dataset.view === view.id;
      tab.setAttribute("aria-selected", String(mine));
      tab.tabIndex = mine ? 0 : -1;
    }
    main.setAttribute("aria-labelledby", `tab-${view.id}`);
    const choice = data.groups.length ? chosen(data, page.state) : null;
    const content = view.choice && !choice ? ["There are no results."] : view.draw(page, choice);
    main.replaceChildren(...[view.choice && choice && fields(choice), ...content].filter(Boolean));
    for (const action of after) action();
    const tab = document.getElementById(`tab-${view.id}`);
    tabs.scrollLeft = Math.max(0, tab.offsetLeft + tab.offsetWidth - tabs.clientWidth + 24 - tabs.offsetLeft);
  }

  addEventListener("hashchange", () => {
    page.state = link.read();
    draw();
  });

  const about = data.about;
  document.body.append( // the data and the shapes stay where they are
    h("a", { class: "skip", href: "#content", onclick: (event) => { event.preventDefault(); main.focus(); } }, "Skip to the content"),
    h("header", {}, h("div", { class: "heading" }, h("h1", {}, data.title), themeSwitch()),
      h("p", {}, [counted(about.methods, "method"), counted(about.datasets, "dataset"), counted(about.shapes, "shape"),
        `${about.solved.toLocaleString("en-US")} of ${counted(about.rows, "case")} solved`,
        about.last && (day(about.first) === day(about.last) ? day(about.last) : `${day(about.first)} to ${day(about.last)}`)]
        .filter(Boolean).join(" · ")), siteLinks(data.site), h("nav", {}, tabs)),
    main);
  draw();
}

// In a site: back to the index, and on to any other page.
function siteLinks(site) {
  if (!site) return null;
  const kinds = [...new Set(site.pages.map((one) => one.kind))].filter((kind) => kind !== "index");
  const path = (href) => site.root + href.split("/").map(encodeURIComponent).join("/");
  return h("nav", { class: "site", "aria-label": "Pages" },
    site.kind === "index" ? h("strong", {}, "All results") : h("a", { href: path("index.html") }, "All results"),
    kinds.map((kind) => {
      const pages = site.pages.filter((one) => one.kind === kind);
      const here = pages.find((one) => one.kind === site.kind && one.name === site.name);
      const list = h("select", { "aria-label": `Pages by ${kind}`, onchange: (event) => { if (event.target.value) location.href = event.target.value; } },
        h("option", { value: "" }, kind));
      for (const one of pages) list.append(h("option", { value: path(one.href), selected: one === here }, one.name));
      return list;
    }));
}

function themeSwitch() {
  const stored = () => { try { return localStorage.getItem("detailbench-theme"); } catch { return null; } };
  const root = document.documentElement;
  const dark = () => (root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches);
  if (stored()) root.dataset.theme = stored();
  const button = h("button", { type: "button", class: "theme", onclick: () => {
    root.dataset.theme = dark() ? "light" : "dark";
    try { localStorage.setItem("detailbench-theme", root.dataset.theme); } catch { /* a page from a file may store nothing */ }
    name();
  } });
  const name = () => { button.textContent = dark() ? "Light" : "Dark"; };
  name();
  return button;
}

// A page without data is one that only uses the 3-D view.
if (globalThis.detailbenchData || document.getElementById("detailbench-data")) start();
