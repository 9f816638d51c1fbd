// Where the rows come from.
import { h } from "../dom.js";
import { dataTable } from "../table.js";
import { day } from "../format.js";

export function about(page) {
  const { provenance, about: size } = page.data;
  const machines = [
    ["host", "host"], ["processor", "processor"], ["processors", "processors", true], ["memory_gb", "memory GB", true], ["system", "system"], ["python", "Python"],
    ["cells", "cells", true], ["first", "from"], ["last", "to"],
  ].map(([id, title, numeric]) => ({ id, title, numeric, value: (row) => row[id] ?? undefined, text: ["first", "last"].includes(id) ? (row) => day(row[id]) : undefined }));
  const plain = (names) => names.map(([id, title, numeric]) => ({ id, title, numeric, value: (row) => row[id] ?? undefined }));
  const licences = document.getElementById("detailbench-licences");
  return [
    h("h2", {}, "Where the rows come from"),
    h("p", { class: "lead" }, `${size.rows.toLocaleString("en-US")} rows of ${size.cells.toLocaleString("en-US")} cells, run from ${size.first || "an unknown time"} to ${size.last || "an unknown time"}.`),
    h("h3", {}, "Machines"), dataTable(provenance.machines, machines, { caption: "Machines", search: false }),
    h("h3", {}, "detailbench"), dataTable(provenance.versions, plain([["version", "version"], ["cells", "cells", true]]), { caption: "Versions", search: false }),
    h("h3", {}, "Packages that results depend on"),
    dataTable(provenance.packages, plain([["name", "package"], ["version", "version"], ["cells", "cells", true]]), { caption: "Packages", search: false }),
    h("h3", {}, "How to read the page"),
    h("ul", { class: "notes" },
      h("li", {}, `Means have ${Math.round(100 * page.data.level)} % intervals over shapes; a rank 2-4 is the ${Math.round(100 * page.data.level)} % confidence interval of the rank. They are the numbers of detailbench leaderboard.`),
      h("li", {}, "A failed case enters means and ranks with the score of the worst pseudo-method."),
      h("li", {}, "The link of the page restores its view, its tables, its order and its filters."),
      h("li", {}, "Keys: left and right change the view while a tab has the focus; up, down and Enter walk through cases.")),
    licences && h("details", {}, h("summary", {}, "Licences of the script of this page"), h("pre", {}, unescaped(licences.textContent))),
  ].filter(Boolean);
}

const unescaped = (text) => text.replaceAll("&lt;", "<").replaceAll("&gt;", ">").replaceAll("&amp;", "&");
