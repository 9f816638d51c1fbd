// The error of iterative methods over time, as their traces have it.
import { curves, widthOf } from "../charts.js";
import { figure, h, select } from "../dom.js";
import { arrow, number } from "../format.js";

function median(values) {
  const sorted = [...values].sort((a, b) => a - b);
  const middle = sorted.length >> 1;
  return sorted.length % 2 ? sorted[middle] : (sorted[middle - 1] + sorted[middle]) / 2;
}

// The median over cases of what each had reached, at every time when one of them had a new state; from when all had one.
function summary(traces) {
  const start = Math.max(...traces.map((trace) => trace[0][0]));
  const times = [...new Set(traces.flatMap((trace) => trace.map(([x]) => x)))].filter((x) => x >= start).sort((a, b) => a - b);
  const reached = (trace, now) => trace.findLast(([x]) => x <= now)[1];
  return times.map((now) => [now, median(traces.map((trace) => reached(trace, now)))]);
}

const WHO = ["method", "variant", "threads", "device", "host"];

// What tables call the methods of some rows: as the first table has it that knows all of them.
function called(data, rows) {
  const same = (row) => (one) => WHO.every((name) => (data.value(name, row) ?? one[name]) === one[name]);
  const task = data.value("task", rows[0]);
  const found = data.groups.filter((group) => group.task === task).map((group) => rows.map((row) => group.contenders.find(same(row))?.label))
    .find((labels) => labels.every(Boolean));
  return new Map(rows.map((row, i) => [row, found ? found[i] : data.label(row)]));
}

export function traces(page) {
  const { data } = page;
  const metrics = new Map(data.groups.flatMap((one) => one.metrics.map((metric) => [metric.name, metric])));
  const order = (name) => [...metrics.keys(), name].indexOf(name); // that of the tables: what ranks comes first
  const names = [...new Set(data.traces.flatMap((trace) => Object.keys(trace.scores)))].sort().sort((a, b) => order(a) - order(b));
  const metric = names.includes(page.state.metric) ? page.state.metric : names[0];
  const titled = [metric, arrow(metrics.get(metric)?.better)].filter(Boolean).join(" ");
  const where = (trace) => [data.value("task", trace.row), data.value("dataset", trace.row), data.value("sensor", trace.row)].filter(Boolean).join(" · ");
  const known = data.traces.filter((trace) => trace.scores[metric]);
  const groups = [...new Set(known.map(where))].sort();
  const group = groups.includes(page.state.group) ? page.state.group : groups[0];
  const shown = known.filter((one) => where(one) === group);
  const labels = called(data, shown.map((trace) => trace.row));
  const byMethod = new Map();
  for (const trace of shown) {
    const points = trace.seconds.map((x, i) => [x, number(trace.scores[metric][i])]).filter(([x, y]) => Number.isFinite(x) && Number.isFinite(y));
    const label = labels.get(trace.row);
    if (points.length) byMethod.set(label, [...(byMethod.get(label) ?? []), points]);
  }
  const style = (label) => page.styles.get(label) ?? [...page.styles].find(([name]) => name.startsWith(label))?.[1] ?? { color: "var(--m0)", symbol: "circle" };
  const series = [...byMethod].flatMap(([label, all]) => [
    ...(all.length > 1 ? all.map((points) => ({ label, points, style: style(label), faint: true })) : []),
    { label, points: all.length > 1 ? summary(all) : all[0], style: style(label) },
  ]);
  return [
    h("div", { class: "choice" },
      groups.length > 1 && select("Table", groups.map((g) => [g, g]), group, (value) => page.go({ group: value }), { id: "choose-trace" }),
      names.length > 1 && select("Metric", names.map((n) => [n, n]), metric, (value) => page.go({ metric: value }), { id: "choose-metric" })),
    h("h2", {}, group),
    figure(`${titled} over time`, curves(series, { x: "seconds of the method", y: titled, width: widthOf() }), {
      name: `${group}_${metric}_over_time`, head: ["method", "seconds", metric],
      lines: series.filter((one) => !one.faint).flatMap((one) => one.points.map(([x, y]) => [one.label, x, y])),
      note: "Thin: one case each, on its own states; thick: the median over cases of what each had reached. Scores of states are "
        + "those that the method's trace offers, and may be cheaper ones than the final scores.",
    }),
  ];
}
