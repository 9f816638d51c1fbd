// A paper's numbers beside ours.
import { h, notes } from "../dom.js";
import { dataTable } from "../table.js";
import { short } from "../format.js";

export function published(page) {
  return page.data.published.flatMap((one) => [
    h("h2", {}, `${one.experiment}: ${one.column}`),
    h("p", { class: "lead" }, one.source),
    dataTable(one.lines, [
      { id: "method", title: "method", value: (line) => line.label, kind: "name" },
      { id: "sensor", title: "sensor", value: (line) => line.sensor },
      { id: "theirs", title: one.short, numeric: true, value: (line) => line.theirs ?? undefined, text: (line) => short(line.theirs, 4) },
      { id: "ours", title: "ours", numeric: true, value: (line) => line.ours ?? undefined, text: (line) => (line.ours === null ? "-" : line.text),
        csv: { head: ["ours", "ci_low", "ci_high"], values: (line) => [line.ours, line.low, line.high] } },
      { id: "ratio", title: `ours / ${one.short}`, numeric: true, value: (line) => line.ratio ?? undefined, text: (line) => short(line.ratio) },
      { id: "solved", title: "solved", numeric: true, value: (line) => line.solved ?? undefined, text: (line) => (line.planned ? `${line.solved}/${line.planned}` : "-"),
        csv: { head: ["solved", "planned"], values: (line) => [line.solved, line.planned] } },
      { id: "status", title: "status", value: (line) => line.status, filter: true, cell: (line) => h("span", { class: line.status === "reproduces" ? "good" : line.status === "differs" ? "bad" : "" }, line.status) },
      { id: "why", title: "why", value: (line) => line.why, kind: "text" },
    ].filter((column) => column.id !== "sensor" || new Set(one.lines.map((line) => line.sensor).filter(Boolean)).size > 1),
    { caption: `${one.experiment}, ${one.column}`, name: `${one.experiment}_${one.column}`, state: {}, search: false }),
    notes(one.notes),
  ]);
}
