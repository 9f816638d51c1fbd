// Quality against what it costs, with the front: methods of which no other is better in both.
import { scatter, widthOf } from "../charts.js";
import { figure, h, select } from "../dom.js";
import { arrow } from "../format.js";

const COSTS = [["seconds_median", "seconds (median)", "seconds"], ["peak_rss_mb", "peak memory in MB (largest)", "peak_mb"]];

export function onFront(points, higher) {
  const sign = higher ? -1 : 1;
  return points.map((a) => !points.some((b) => b.x < a.x && sign * b.y < sign * a.y));
}

export function cost(page, { group, metric }) {
  const key = COSTS.find(([, , name]) => name === page.state.cost) ?? COSTS[0];
  const marked = new Map(group.contenders.map((one) => [one.label, one.marked]));
  const points = metric.labels.map((label, i) => ({
    label: marked.get(label) ?? label, x: metric[key[0]][i], y: metric.mean[i], low: metric.ci_low[i] ?? undefined, high: metric.ci_high[i] ?? undefined,
    style: page.styles.get(label),
  })).filter((point) => typeof point.x === "number" && typeof point.y === "number");
  const higher = metric.better === "higher";
  onFront(points, higher).forEach((on, i) => { points[i].front = on; });
  const content = [
    h("h2", {}, group.title),
    h("div", { class: "choice" }, select("Cost", COSTS.map(([, title, name]) => [name, title]), key[2], (value) => page.go({ cost: value }), { id: "choose-cost" })),
  ];
  if (!points.length) return [...content, h("p", {}, "No method has both a score and a cost here.")];
  const title = `${metric.name} ${arrow(metric.better)} against ${key[1]}`;
  return [...content, figure(title, scatter(points, { x: key[1], y: `${metric.name} ${arrow(metric.better)}`, width: widthOf(), higher }), {
    name: `${group.title}_${metric.name}_${key[2]}`, head: ["method", key[2], metric.name, "ci_low", "ci_high", "front"],
    lines: points.map((p) => [p.label, p.x, p.y, p.low, p.high, p.front ? 1 : ""]),
    note: "Filled: on the front; of no other method both are better. The dashed line joins the front; vertical lines are the "
      + `${Math.round(100 * page.data.level)} % intervals of the means. The front compares means, not how sure their order is.`,
  })];
}
