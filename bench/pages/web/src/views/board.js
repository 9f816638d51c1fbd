// The leaderboard: the numbers of `detailbench leaderboard`, one metric in full and the others beside it.
import { dataTable } from "../table.js";
import { emphasis, plainLabel } from "../data.js";
import { h, notes, s } from "../dom.js";
import { arrow, counted, megabytes, seconds } from "../format.js";

// The mean and its interval on a line that all methods share.
function whisker(metric, i, range) {
  const [low, high] = range;
  const mean = metric.mean[i];
  if (mean === null || !(high > low)) return "";
  const x = (value) => 2 + 116 * Math.min(1, Math.max(0, (value - low) / (high - low)));
  const known = metric.ci_low[i] !== null && metric.ci_high[i] !== null;
  return s("svg", { class: "whisker", viewBox: "0 0 120 14", width: 120, height: 14, "aria-hidden": "true" },
    known && s("line", { x1: x(metric.ci_low[i]), x2: x(metric.ci_high[i]), y1: 7, y2: 7 }),
    s("circle", { cx: x(mean), cy: 7, r: 3.5 }));
}

function rangeOf(metric) {
  const known = [...metric.mean, ...metric.ci_low, ...metric.ci_high].filter((value) => typeof value === "number");
  if (!known.length) return [0, 0];
  // A single wide interval would squeeze all others together: the line ends at twice the largest mean.
  const means = metric.mean.filter((value) => typeof value === "number");
  const top = Math.max(...means) * (Math.max(...means) > 0 ? 2 : 0.5);
  return [Math.min(0, ...known), Math.min(Math.max(...known), top)];
}

const middle = (text) => (text === "-" ? undefined : text.split("-").map(Number).reduce((a, b) => a + b / 100, 0));

export function lines(group, metric) {
  const marked = new Map(group.contenders.map((one) => [one.label, one]));
  const own = metric.labels.map((label, i) => ({ label, i, ...marked.get(label) }));
  const others = group.contenders.filter((one) => !metric.labels.includes(one.label)).map((one) => ({ ...one, i: -1 }));
  return [...own, ...others];
}

export function board(page, choice) {
  const { group, metric } = choice;
  const range = rangeOf(metric);
  const at = (name) => (row) => (row.i < 0 ? undefined : metric[name][row.i] ?? undefined);
  const place = (other, row) => other.labels.indexOf(row.label);
  const columns = [
    { id: "rank", title: "rank", value: (row) => (row.i < 0 ? undefined : middle(metric.ranks[row.i])),
      text: (row) => (row.i < 0 ? "-" : metric.ranks[row.i]),
      help: `the ${Math.round(100 * page.data.level)} % confidence interval of the rank`,
      csv: { head: ["rank_low", "rank_high"], values: (row) => [at("rank_low")(row), at("rank_high")(row)] } },
    { id: "method", title: "method", header: true, value: (row) => row.marked, kind: "name",
      cell: (row) => h("a", { href: page.methodPage(row.method) ?? page.link({ view: "cases", "f.method": plainLabel(row.method, row.variant), sort: "", q: "" }), title: `${row.label}: all cases` }, row.marked) },
    { id: "mean", title: metric.heading, value: at("mean"), descending: metric.better === "higher",
      help: "mean, with its interval over shapes; bold: the best mean",
      cell: (row) => h(row.i >= 0 ? emphasis(metric, row.i) : "span", {}, row.i < 0 ? "-" : metric.texts[row.i]),
      csv: { head: [metric.name, "ci_low", "ci_high"], values: (row) => [at("mean")(row), at("ci_low")(row), at("ci_high")(row)] } },
    { id: "interval", title: "interval", plain: true, csv: false, value: () => undefined,
      cell: (row) => (row.i < 0 ? "" : whisker(metric, row.i, range)) },
    { id: "solved", title: "solved", numeric: true, descending: true, value: at("solved"),
      text: (row) => (row.i < 0 ? "-" : `${metric.solved[row.i]}/${metric.planned[row.i]}`),
      csv: { head: ["solved", "planned"], values: (row) => [at("solved")(row), at("planned")(row)] } },
    { id: "seconds", title: "seconds", numeric: true, value: at("seconds_median"), text: (row) => seconds(at("seconds_median")(row)),
      help: "median over solved cases" },
    { id: "peak_mb", title: "peak MB", numeric: true, value: at("peak_rss_mb"), text: (row) => megabytes(at("peak_rss_mb")(row)),
      help: "largest over solved cases" },
    ...group.metrics.filter((other) => other.name !== metric.name && other.name).map((other) => ({
      id: other.name, title: other.heading, numeric: false, kind: "other", descending: other.better === "higher",
      value: (row) => other.mean[place(other, row)] ?? undefined,
      cell: (row) => {
        const i = place(other, row);
        return h(emphasis(other, i), {}, i < 0 ? "-" : other.texts[i]);
      },
    })),
  ];
  if (metric.front.some((value) => value === 1)) {
    columns.splice(1, 0, { id: "front", title: "front", value: at("front"), text: (row) => (at("front")(row) ? "1" : "") });
  }
  const floors = metric.floor_text ? h("tfoot", {}, h("tr", {}, columns.map((column) => {
    const other = column.id === "mean" ? metric : group.metrics.find((m) => m.name === column.id);
    return h("td", {}, column.id === "method" ? "floor / reference" : other?.floor_text ?? "");
  }))) : null;
  return [
    h("h2", {}, group.title),
    h("p", { class: "lead" }, `${counted(group.shapes, "shape")}, ${counted(group.cells, "cell")}. Ranked by ${metric.name} ${arrow(metric.better)}.`),
    dataTable(lines(group, metric), columns, {
      caption: `${group.title}, by ${metric.name}`, name: `${group.title}_${metric.name}`, state: page.state,
      onState: page.change, foot: floors, mark: (row) => Boolean(page.data.focus) && row.method === page.data.focus,
    }),
    notes([...metric.notes, ...group.notes]),
  ];
}
