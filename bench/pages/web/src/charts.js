// Charts as SVG by Observable Plot; colours are those of the page's style, so that a change of theme needs no new chart.
import * as Plot from "@observablehq/plot";
import { s } from "./dom.js";

export const FONT = 12;
const WIDEST = 980; // of a chart, as in page.css
const PLACES = [["start", 8, 0], ["end", -8, 0], ["middle", 0, -11], ["middle", 0, 12], ["start", 7, -11], ["start", 7, 11], ["end", -7, -11], ["end", -7, 11]];

// Where labels of points stand: each takes the first place beside its point that covers no other label or point.
function placed(points, width) {
  const taken = points.map(({ x, y }) => [x - 5, y - 5, x + 5, y + 5]);
  return points.map((point, i) => {
    const long = 6.6 * point.label.length;
    const boxOf = ([anchor, dx, dy]) => {
      const left = point.x + dx - (anchor === "start" ? 0 : anchor === "end" ? long : long / 2);
      return [left, point.y + dy - 6, left + long, point.y + dy + 6];
    };
    const cost = (place) => {
      const box = boxOf(place);
      const out = box[0] < 50 || box[2] > width ? 3 : 0;
      return out + taken.filter((other, j) => j !== i && box[0] < other[2] && other[0] < box[2] && box[1] < other[3] && other[1] < box[3]).length;
    };
    const best = PLACES.reduce((a, b) => (cost(b) < cost(a) ? b : a));
    taken.push(boxOf(best));
    return { ...point, place: best };
  });
}

// A plot with the labels of these points, where they cover least.
function labelled(base, marks, points) {
  const first = Plot.plot({ ...base, marks });
  const [sx, sy] = [first.scale("x"), first.scale("y")];
  const labels = placed(points.map((p) => ({ ...p, x: sx.apply(p.x), y: sy.apply(p.y), at: p })), base.width);
  return Plot.plot({ ...base, marks: [...marks, ...labels.map(({ at, place: [anchor, dx, dy], label }) =>
    Plot.text([at], { x: "x", y: "y", text: () => label, textAnchor: anchor, dx, dy, fill: "var(--ink)", stroke: "var(--paper)", strokeWidth: 3 }))] });
}

const log = (values) => values.every((v) => v > 0) && Math.max(...values) / Math.min(...values) > 8;
const axis = { labelArrow: "none", labelOffset: 38 };

// Points with intervals, labels, and the front; points: [{label, x, y, low, high, front, style}].
export function scatter(points, { x, y, width, higher }) {
  const height = Math.round(Math.min(520, Math.max(320, 0.5 * width)));
  const logX = log(points.map((p) => p.x));
  const ys = points.flatMap((p) => [p.y, p.low, p.high]).filter((v) => typeof v === "number");
  const logY = log(points.map((p) => p.y)) && ys.every((v) => v > 0);
  const front = points.filter((p) => p.front).sort((a, b) => a.x - b.x);
  // The front as the steps between its points: what is above (or below, where higher is better) is worse than one of them.
  const base = {
    width, height, marginLeft: 62, marginBottom: 46, marginTop: 30, marginRight: 24, style: { fontSize: `${FONT}px`, background: "none" },
    x: { type: logX ? "log" : "linear", label: x, grid: true, nice: !logX, insetLeft: 16, insetRight: 24, ...axis, ...(logX ? { ticks: 6, tickFormat: "~g" } : {}) },
    y: { type: logY ? "log" : "linear", label: y, grid: true, nice: !logY, labelArrow: "none", ...(logY ? { ticks: 6, tickFormat: "~g" } : { zero: !higher }) },
    color: { type: "identity" }, symbol: { type: "identity" },
  };
  const marks = [
    front.length > 1 ? Plot.line(front, { x: "x", y: "y", curve: "step-after", stroke: "var(--soft)", strokeDasharray: "4 3" }) : null,
    Plot.ruleX(points.filter((p) => typeof p.low === "number"), { x: "x", y1: "low", y2: "high", stroke: (p) => p.style.color, strokeWidth: 1.5, strokeOpacity: 0.55 }),
    Plot.dot(points, { x: "x", y: "y", stroke: (p) => p.style.color, fill: (p) => (p.front ? p.style.color : "var(--paper)"), symbol: (p) => p.style.symbol, r: 5, strokeWidth: 2 }),
  ];
  return labelled(base, marks, points);
}

// Curves over time; series: [{label, points: [[x, y]], style}].
export function curves(series, { x, y, width }) {
  const points = series.flatMap((one) => one.points.map(([a, b]) => ({ x: a, y: b, label: one.label })));
  const logX = log(points.map((p) => p.x));
  const logY = log(points.map((p) => p.y));
  const ends = series.filter((one) => !one.faint).map((one) => ({ label: one.label, x: one.points.at(-1)[0], y: one.points.at(-1)[1], style: one.style }));
  const base = {
    width, height: Math.min(460, Math.max(320, 0.48 * width)), marginLeft: 62, marginBottom: 46, marginTop: 30, marginRight: 24,
    style: { fontSize: `${FONT}px`, background: "none" },
    x: { type: logX ? "log" : "linear", label: x, grid: true, ...axis, ...(logX ? { ticks: 6, tickFormat: "~g" } : {}) },
    y: { type: logY ? "log" : "linear", label: y, grid: true, labelArrow: "none", ...(logY ? { ticks: 6, tickFormat: "~g" } : {}) },
    color: { type: "identity" }, symbol: { type: "identity" },
  };
  const marks = [
    ...series.map((one) => Plot.line(one.points, { curve: "step-after", stroke: one.style.color, strokeWidth: one.faint ? 0.8 : 2, strokeOpacity: one.faint ? 0.5 : 1, strokeDasharray: one.style.dash || undefined })),
    Plot.dot(ends, { x: "x", y: "y", stroke: (p) => p.style.color, symbol: (p) => p.style.symbol, r: 4, fill: "var(--paper)", strokeWidth: 2 }),
  ];
  return labelled(base, marks, ends);
}

// Means with intervals of all methods in each slice; cells: [{slice, label, mean, low, high, style}].
export function slices(cells, names, labels, { x, width }) {
  const band = 14 * labels.length + 16;
  const logX = log(cells.map((c) => c.mean));
  const shown = cells.map((cell) => ({ ...cell, low: cell.low > 0 || !logX ? cell.low : undefined }));
  return Plot.plot({
    width, height: 60 + band * names.length, marginLeft: 150, marginTop: 8, marginBottom: 46, style: { fontSize: `${FONT}px`, background: "none" },
    x: { type: logX ? "log" : "linear", label: x, grid: true, ...axis, ...(logX ? { ticks: 6, tickFormat: "~g" } : {}) },
    fy: { domain: names, label: null, padding: 0.12, axis: null }, y: { domain: labels, axis: null },
    color: { type: "identity" }, symbol: { type: "identity" },
    marks: [
      Plot.axisFy({ anchor: "left", label: null, dx: -6, fontSize: FONT, lineWidth: 11 }),
      Plot.frame({ stroke: "var(--line)" }),
      Plot.ruleY(shown.filter((c) => typeof c.low === "number"), { fy: "slice", y: "label", x1: "low", x2: "high", stroke: (c) => c.style.color, strokeWidth: 1.5, strokeOpacity: 0.6 }),
      Plot.dot(shown, { fy: "slice", y: "label", x: "mean", stroke: (c) => c.style.color, fill: (c) => (c.best ? c.style.color : "var(--paper)"), symbol: (c) => c.style.symbol, r: 4, strokeWidth: 2 }),
    ],
  });
}

// Demšar's diagram: methods on an axis of average ranks, bars over those that the test cannot tell apart.
export function ranksDiagram(methods, critical, width) {
  const ordered = [...methods].sort((a, b) => a.rank - b.rank);
  const k = ordered.length;
  const groups = [];
  for (let i = 0; i < k; i++) {
    let j = i;
    while (j + 1 < k && ordered[j + 1].rank - ordered[i].rank < critical) j++;
    if (j > i && !groups.some(([, end]) => end >= j)) groups.push([i, j]);
  }
  const half = Math.ceil(k / 2);
  const long = 7 * Math.max(...ordered.map((m) => m.label.length + 5)) + 14;
  const side = Math.min(long, width * 0.34);
  const inner = width - 2 * side;
  const x = (rank) => side + (inner * (rank - 1)) / Math.max(1, k - 1);
  const top = 58;
  const step = 9;
  const below = top + 14 + step * groups.length;
  const height = below + 20 * half + 12;
  const svg = s("svg", { viewBox: `0 0 ${width} ${height}`, width, height, "font-size": FONT, class: "diagram" });
  const line = (x1, y1, x2, y2, stroke = "var(--ink)", wide = 1) => s("line", { x1, y1, x2, y2, stroke, "stroke-width": wide });
  const text = (at, y, content, anchor = "middle") => s("text", { x: at, y, "text-anchor": anchor, "dominant-baseline": "middle" }, content);
  svg.append(line(x(1), top, x(k), top));
  for (let rank = 1; rank <= k; rank++) svg.append(line(x(rank), top - 5, x(rank), top), text(x(rank), top - 14, String(rank)));
  const bar = Math.min(critical, k - 1) * (inner / Math.max(1, k - 1));
  svg.append(line(x(1), 16, x(1) + bar, 16), line(x(1), 12, x(1), 20), line(x(1) + bar, 12, x(1) + bar, 20),
    text(x(1) + bar + 8, 16, `critical difference ${critical.toFixed(2)}`, "start"));
  groups.forEach(([i, j], n) => svg.append(line(x(ordered[i].rank) - 4, top + 10 + step * n, x(ordered[j].rank) + 4, top + 10 + step * n, "var(--ink)", 4)));
  ordered.forEach((method, i) => {
    const left = i < half;
    const y = below + 20 * (left ? i : k - 1 - i) + 8;
    const end = left ? side - 4 : width - side + 4;
    svg.append(line(x(method.rank), top, x(method.rank), y, method.style.color), line(x(method.rank), y, end, y, method.style.color),
      text(left ? end - 4 : end + 4, y, left ? `${method.label} ${method.rank.toFixed(2)}` : `${method.rank.toFixed(2)} ${method.label}`, left ? "end" : "start"));
  });
  return svg;
}

// The matrix of how often the method of a row is better than that of a column, as the page's table has it: `cells[i][j]`
// is null or {text, interval, sure, color, weight}, with the share of the colour in `weight`.
export function winsDiagram(title, labels, cells) {
  const long = 7 * Math.max(...labels.map((label) => label.length)) + 14;
  const [wide, high] = [64, 36];
  const slope = Math.PI / 5; // of the names above the columns
  const top = Math.ceil(long * Math.sin(slope)) + 10;
  const width = Math.max(long + wide * labels.length + Math.ceil(long * Math.cos(slope)) - wide / 2 + 6, 7 * title.length + 16);
  const height = top + high * labels.length + 28;
  const svg = s("svg", { viewBox: `0 0 ${width} ${height}`, width, height, "font-size": FONT });
  const text = (x, y, content, more = {}) => s("text", { x, y, "text-anchor": "middle", "dominant-baseline": "middle", ...more }, content);
  svg.append(text(8, height - 12, title, { "text-anchor": "start" }));
  labels.forEach((label, i) => {
    const [x, y] = [long + wide * i, top + high * i];
    svg.append(text(long - 8, y + high / 2, label, { "text-anchor": "end" }),
      text(0, 0, label, { "text-anchor": "start", transform: `translate(${x + wide / 2} ${top - 8}) rotate(${(-180 * slope) / Math.PI})` }));
    cells[i].forEach((cell, j) => {
      const left = long + wide * j;
      const box = { x: left, y, width: wide, height: high };
      svg.append(s("rect", { ...box, fill: i === j ? "var(--shade)" : cell?.color ?? "none", "fill-opacity": i === j || !cell ? 1 : cell.weight, stroke: "var(--line)" }));
      if (i === j) return;
      svg.append(text(left + wide / 2, y + (cell?.interval ? 12 : high / 2), cell?.text ?? "-", { "font-weight": cell?.sure ? "bold" : "normal" }));
      if (cell?.interval) svg.append(text(left + wide / 2, y + 26, cell.interval, { "font-size": FONT - 2 }));
    });
  });
  return svg;
}

export function widthOf() {
  return Math.max(340, Math.min(WIDEST, document.documentElement.clientWidth - (innerWidth < 640 ? 24 : 48)));
}
