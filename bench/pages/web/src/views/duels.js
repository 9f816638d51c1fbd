// Each two methods against each other: how often one is better, and Demšar's diagram of average ranks.
import { ranksDiagram, widthOf, winsDiagram } from "../charts.js";
import { csv, figure, fileName, h, save, svgText } from "../dom.js";
import { arrow, percent } from "../format.js";

// What the matrix says of each two methods: null where they are the same, or share no shape.
function cellsOf(duels, labels) {
  return labels.map((label, i) => labels.map((other, j) => {
    const [rate, low, high] = [duels.wins[i][j], duels.low[i][j], duels.high[i][j]];
    if (i === j || rate === null) return null;
    const known = low !== null && high !== null;
    return {
      text: percent(rate), interval: known && `${percent(low)}-${percent(high)}`, sure: known && (low > 0.5 || high < 0.5),
      color: `var(${rate > 0.5 ? "--m0" : "--m1"})`, weight: 0.7 * Math.abs(2 * rate - 1),
      words: `${label} is better than ${other} on ${percent(rate)} % of ${duels.shapes[i][j]} shapes${known ? `, interval ${percent(low)} to ${percent(high)} %` : ""}`,
    };
  }));
}

function matrix(page, group, metric) {
  const { duels } = metric;
  const labels = duels.labels.map((i) => metric.labels[i]);
  const cells = cellsOf(duels, labels);
  const head = h("tr", {}, h("th", { scope: "col" }, "better ↓ than →"), labels.map((label) => h("th", { scope: "col" }, label)));
  const body = labels.map((label, i) => h("tr", {}, h("th", { scope: "row" }, label), cells[i].map((cell, j) => {
    if (i === j) return h("td", { class: "same" });
    if (!cell) return h("td", { class: "win" }, "-");
    return h("td", { class: "win", title: cell.words, style: `background: color-mix(in srgb, ${cell.color} ${Math.round(100 * cell.weight)}%, var(--paper))` },
      h(cell.sure ? "strong" : "span", {}, cell.text), cell.interval && h("small", {}, cell.interval));
  })));
  const title = `How often one is better, in % of shapes, by ${metric.name} ${arrow(metric.better)}`;
  const name = fileName(`${group.title}_${metric.name}_wins`);
  const buttons = h("span", { class: "buttons" },
    h("button", { type: "button", onclick: () => save(`${name}.svg`, "image/svg+xml", svgOf(winsDiagram(`${title}: row better than column`, labels, cells), whole)) }, "SVG"),
    h("button", {
      type: "button",
      onclick: () => save(`${name}.csv`, "text/csv", csv(["method", "other", "rate", "ci_low", "ci_high", "shapes"],
        labels.flatMap((a, i) => labels.flatMap((b, j) => (i === j ? [] : [[a, b, duels.wins[i][j], duels.low[i][j], duels.high[i][j], duels.shapes[i][j]]]))))),
    }, "CSV"));
  const whole = h("figure", {}, h("figcaption", {}, h("span", { class: "title" }, title), buttons),
    h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": title }, h("table", { class: "matrix" }, h("thead", {}, head), h("tbody", {}, body))),
    h("p", { class: "note" }, "The share of shapes on which the method of the line is better than that of the column (the probability of improvement; ties "
      + `count half, sensors and seeds of a shape are averaged), with its ${Math.round(100 * page.data.level)} % interval over shapes below. Bold: the interval leaves out 50 %. `
      + "A failure counts as the worst score."));
  return whole;
}

// The text of a picture that the page does not show: it is in the figure for as long as its styles are looked up.
function svgOf(svg, within) {
  within.append(svg);
  const text = svgText(svg);
  svg.remove();
  return text;
}

export function duels(page, { group, metric }) {
  const found = metric.duels;
  const title = h("h2", {}, group.title);
  if (!found) return [title, h("p", {}, "Methods are compared one by one where a table has two or more of them on four or more shapes; choose another table or metric.")];
  const methods = found.labels.map((i, at) => ({ label: metric.labels[i], rank: found.ranks[at], style: page.styles.get(metric.labels[i]) }));
  const left = metric.labels.length - found.labels.length;
  const parts = [title, left > 0 && h("p", { class: "lead" }, `The first ${found.labels.length} methods; ${left} more are in the leaderboard.`), matrix(page, group, metric)];
  if (found.critical !== null && methods.every((m) => m.rank !== null) && methods.length > 2) {
    parts.push(figure(`Average ranks by ${metric.name}`, ranksDiagram(methods, found.critical, Math.max(560, widthOf())), {
      name: `${group.title}_${metric.name}_ranks`, head: ["method", "average_rank"], lines: methods.map((m) => [m.label, m.rank]),
      note: `Average rank over ${found.blocks} shapes, 1 is best. A bar joins methods whose ranks differ by less than the critical difference of Nemenyi's test `
        + `(${Math.round(100 * page.data.level)} %): it cannot tell them apart. Friedman's test that all are equal: p = ${found.p < 0.001 ? found.p.toExponential(1) : found.p.toFixed(3)}. `
        + "Demšar, JMLR 7, 2006. The leaderboard's rank intervals compare the sizes of differences too, and see more.",
    }));
  }
  return parts.filter(Boolean);
}
