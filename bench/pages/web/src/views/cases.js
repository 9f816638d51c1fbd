// Every row of the results: scores, parameters, tags, time, memory, message; one opens with all that is known of it.
import { h } from "../dom.js";
import { dataTable } from "../table.js";
import { arrow, megabytes, seconds, short } from "../format.js";

export function cases(page) {
  const { data, state } = page;
  const rows = Array.from({ length: data.cases.count }, (_, row) => row);
  const at = (name) => (row) => data.value(name, row) ?? undefined;
  const first = data.groups.filter((g) => !state.task || g.task === state.task).map((g) => g.metrics[0].name).filter(Boolean);
  const preferred = [...new Set([state.metric, ...first].filter((name) => data.scoreNames.includes(name)))].slice(0, 3);
  const columns = [
    { id: "case", title: "case", value: at("case") },
    data.tasks.length > 1 && { id: "task", title: "task", value: at("task"), filter: true },
    { id: "method", title: "method", value: data.label, filter: true, csv: { head: ["method", "variant"], values: (row) => [at("method")(row), at("variant")(row)] } },
    { id: "dataset", title: "dataset", value: at("dataset"), filter: true },
    { id: "sensor", title: "sensor", value: at("sensor"), filter: true },
    { id: "split", title: "split", value: at("split"), filter: true },
    { id: "seed", title: "seed", value: at("seed"), numeric: true },
    { id: "status", title: "status", value: at("status"), filter: true, cell: (row) => status(data.value("status", row)) },
    ...preferred.map((name) => ({
      id: name, title: `${name} ${arrow(data.cases.better[name])}`, numeric: true, descending: data.cases.better[name] !== "higher",
      value: at(`score.${name}`), text: (row) => short(data.value(`score.${name}`, row)),
    })),
    { id: "seconds", title: "seconds", numeric: true, descending: true, value: at("seconds"), text: (row) => seconds(data.value("seconds", row)) },
    { id: "peak_mb", title: "peak MB", numeric: true, descending: true, value: at("peak_rss_mb"), text: (row) => megabytes(data.value("peak_rss_mb", row)) },
    { id: "tags", title: "tags", value: (row) => (data.value("tags", row) ?? "").split(",").join(", "), kind: "text" },
    { id: "message", title: "message", value: (row) => data.value("message", row), kind: "text", text: (row) => cut(data.value("message", row) ?? "") },
    { id: "cell", title: "cell", value: at("cell"), kind: "code" },
  ].filter(Boolean).filter((column) => !["split", "seed"].includes(column.id) || new Set(rows.map(column.value)).size > 1)
    .filter((column) => column.id !== "message" || rows.some((row) => data.value("message", row)));
  const others = data.scoreNames.filter((name) => !preferred.includes(name));
  columns.at(-1).csv = { head: ["cell", ...others], values: (row) => [data.value("cell", row), ...others.map((name) => data.value(`score.${name}`, row))] };
  const open = /^\d+$/.test(state.case ?? "") && Number(state.case) < rows.length ? Number(state.case) : null;
  const table = dataTable(rows, columns, {
    caption: "Cases", name: `${data.title}_cases`, state, onState: page.change, open,
    details: (row) => details(page, row), onOpen: (row) => page.change({ case: row === null ? "" : String(row) }),
  });
  page.shown(() => {
    const line = table.querySelector("tr.selected");
    if (line) line.closest(".scroll").scrollTop = line.offsetTop - 40;
  });
  return [h("h2", {}, "Cases"), h("p", { class: "lead" }, "One row per shape and cell; a row opens with everything that is known of it."), table];
}

const cut = (text) => (text.length > 160 ? `${text.slice(0, 159)}…` : text);

export const status = (text) => h("span", { class: text === "ok" ? "good" : "bad" }, text);

function details(page, row) {
  const { data } = page;
  const value = (name) => data.value(name, row);
  const cell = value("cell");
  const about = data.cases.cells[cell] ?? {};
  const scores = data.scoreNames.filter((name) => value(`score.${name}`) !== null);
  const inputs = Object.keys(data.cases.columns).filter((name) => name.startsWith("input.") && value(name) !== null);
  const pairs = [
    ["task", value("task")], ["dataset", value("dataset")], ["sensor", value("sensor")], ["split", value("split")], ["seed", value("seed")],
    ["tags", (value("tags") ?? "").split(",").join(", ")], ["status", [value("status"), value("stage")].filter(Boolean).join(", in ")],
    ["seconds", `${seconds(value("seconds"))}${value("cpu_seconds") === null ? "" : ` (processor: ${seconds(value("cpu_seconds"))})`}`],
    ["memory", value("peak_rss_mb") === null ? "" : `${megabytes(value("peak_rss_mb"))} MB at its peak${value("peak_device_mb") ? `, ${megabytes(value("peak_device_mb"))} MB on the device` : ""}`],
    ["output", [value("output_points") !== null && `${short(value("output_points"))} points`, value("output_faces") && `${short(value("output_faces"))} faces`].filter(Boolean).join(", ")],
    ["run", [value("finished"), value("host"), value("device"), value("threads") && `${value("threads")} ${value("threads") === 1 ? "thread" : "threads"}`].filter(Boolean).join(" · ")],
    ["limits", about.limit && [about.limit.seconds && `${about.limit.seconds} s`, about.limit.memory_gb && `${about.limit.memory_gb} GB`].filter(Boolean).join(", ")],
    ...Object.entries(about.parameters ?? {}).map(([kind, text]) => [`${kind} parameters`, text]),
    ["message", value("message")],
  ].filter(([, text]) => text !== null && text !== undefined && text !== "");
  const scene = sceneOf(data, row);
  return [
    h("h3", {}, `${data.label(row)} on ${value("case")}`),
    scene && h("p", {}, h("a", { href: page.link({ view: "shapes", scene: scene.id, viewer: "", sort: "", q: "" }) }, "Show the shapes")),
    h("dl", {}, pairs.flatMap(([name, text]) => [h("dt", {}, name), h("dd", {}, String(text))])),
    scores.length > 0 && h("dl", { class: "scores" }, scores.flatMap((name) => [h("dt", {}, `${name} ${arrow(data.cases.better[name])}`), h("dd", {}, short(value(`score.${name}`), 4))])),
    inputs.length > 0 && h("dl", { class: "scores" }, inputs.flatMap((name) => [h("dt", {}, name.replace("input.", "input, ")), h("dd", {}, short(value(name), 4))])),
    command(page, row),
  ].filter(Boolean);
}

export function sceneOf(data, row) {
  const wanted = ["task", "dataset", "sensor", "split", "seed", "case"];
  return data.scenes.find((scene) => wanted.every((name) => scene[name] === undefined || scene[name] === data.value(name, row)));
}

function command(page, row) {
  const cell = page.data.value("cell", row);
  const about = page.data.cases.cells[cell];
  return code(about?.command ?? `detailbench reproduce ${cell} results=DIR`);
}

// A command that can be copied.
export function code(text) {
  const button = h("button", { type: "button", onclick: async () => {
    try {
      await navigator.clipboard.writeText(text);
      button.textContent = "Copied";
    } catch {
      getSelection().selectAllChildren(line);
      button.textContent = "Selected";
    }
    setTimeout(() => { button.textContent = "Copy"; }, 1500);
  } }, "Copy");
  const line = h("code", {}, text);
  return h("div", { class: "command" }, line, button);
}
