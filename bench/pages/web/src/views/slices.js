// One metric in all groups side by side: by dataset, sensor or tag.
import { slices as chart, widthOf } from "../charts.js";
import { figure, h, select } from "../dom.js";
import { emphasis } from "../data.js";
import { dataTable } from "../table.js";
import { arrow } from "../format.js";

const MOST_MARKS = 160; // of one chart

export const hasSlices = (data) => data.ways.length > 1;

const nameOf = (group, by) => (by === "sensor" ? group.sensor : by === "dataset,sensor" ? [group.dataset, group.sensor].filter(Boolean).join(" · ") : group.dataset)
  + (group.split === "test" ? "" : ` (${group.split})`);

export function slices(page) {
  const { data, state } = page;
  const task = data.tasks.includes(state.task) ? state.task : data.tasks[0];
  const ways = data.ways.filter((way) => way.name !== "task" && data.groups.some((g) => g.by === way.name && g.task === task));
  if (!ways.length) return [h("p", {}, "All results of this task are of one dataset and one sensor, without tags.")];
  const by = ways.find((way) => way.name === state.by)?.name ?? ways[0].name;
  const groups = data.groups.filter((group) => group.by === by && group.task === task);
  const names = [...new Set(groups.flatMap((group) => group.metrics.map((metric) => metric.name)))];
  const name = names.includes(state.metric) ? state.metric : names[0];
  const found = groups.map((group) => ({ group, title: nameOf(group, by), metric: group.metrics.find((m) => m.name === name) })).filter((one) => one.metric);
  const whole = data.groups.find((g) => g.by === "task" && g.task === task)?.metrics.find((m) => m.name === name);
  const labels = [...new Set([...(whole?.labels ?? []), ...found.flatMap((one) => one.metric.labels)])];
  const rows = labels.map((label) => ({ label }));
  const cell = (metric, label) => metric.labels.indexOf(label);
  const better = found[0].metric.better;
  const column = (id, title, metric) => ({
    id, title, descending: better === "higher", value: (row) => metric.mean[cell(metric, row.label)] ?? undefined,
    cell: (row) => {
      const i = cell(metric, row.label);
      return i < 0 ? "-" : [h(emphasis(metric, i), {}, metric.texts[i]), h("small", { class: "rank", title: "rank" }, ` ${metric.ranks[i]}`)];
    },
    csv: { head: [id, `${id} ci_low`, `${id} ci_high`, `${id} rank`], values: (row) => ["mean", "ci_low", "ci_high", "ranks"].map((key) => metric[key][cell(metric, row.label)]) },
  });
  const columns = [
    { id: "method", title: "method", value: (row) => row.label, kind: "name" },
    ...(whole ? [column("all", `all${unit(whole)}`, whole)] : []),
    ...found.map(({ title, metric, group }) => column(title, `${title}${unit(metric)} · ${group.shapes}`, metric)),
  ];
  // All slices in one chart would be metres high.
  const drawn = found.slice(0, Math.max(4, Math.floor(MOST_MARKS / Math.max(1, labels.length))));
  const cells = drawn.flatMap(({ title, metric }) => metric.labels.map((label, i) => ({
    slice: title, label, mean: metric.mean[i], low: metric.ci_low[i] ?? undefined, high: metric.ci_high[i] ?? undefined, best: metric.best[i], style: page.styles.get(label),
  }))).filter((one) => typeof one.mean === "number");
  return [
    h("div", { class: "choice" },
      data.tasks.length > 1 && select("Task", data.tasks.map((n) => [n, n]), task, (value) => page.go({ task: value, by: "", metric: "" }), { id: "choose-task" }),
      ways.length > 1 && select("Slices", ways.map((way) => [way.name, way.title]), by, (value) => page.go({ by: value, sort: "" }), { id: "choose-by" }),
      names.length > 1 && select("Metric", names.map((n) => [n, n]), name, (value) => page.go({ metric: value, sort: "" }), { id: "choose-metric" })),
    h("h2", {}, `${task}, ${ways.find((way) => way.name === by).title}: ${name} ${arrow(better)}`),
    h("p", { class: "lead" }, "Mean with its interval, and the rank's interval, within each slice; the number beside a slice's name is that of its shapes."),
    dataTable(rows, columns, { caption: `${name} by slice`, name: `${task}_${by}_${name}`, state, onState: page.change }),
    cells.length && figure(`${name} ${arrow(better)} in each slice`, chart(cells, drawn.map((one) => one.title), labels, { x: name, width: widthOf() }), {
      name: `${task}_${by}_${name}`, head: ["slice", "method", "mean", "ci_low", "ci_high"], lines: cells.map((c) => [c.slice, c.label, c.mean, c.low, c.high]),
      note: `Methods in the order of the table, from above; filled: the best mean of the slice.${drawn.length < found.length ? ` The first ${drawn.length} of ${found.length} slices; the table has all.` : ""}`,
    }),
    cells.length && legend(page, labels),
  ].filter(Boolean);
}

const unit = (metric) => (metric.exponent ? ` (1e${metric.exponent})` : "");

export function legend(page, labels) {
  return h("ul", { class: "legend" }, labels.map((label) => h("li", {}, h("span", { class: "swatch", style: `background: ${page.styles.get(label)?.color}` }), label)));
}
