// What was not solved, by kind of message, and the line that runs the cell again.
import { h } from "../dom.js";
import { code, status } from "./cases.js";

export function failures(page) {
  const found = page.data.failures;
  if (!found.length) return [h("h2", {}, "Failures"), h("p", {}, "Every case was solved.")];
  const total = found.reduce((sum, one) => sum + one.count, 0);
  return [
    h("h2", {}, "Failures"),
    h("p", { class: "lead" }, `${total.toLocaleString("en-US")} cases were not solved; messages that differ only in numbers and file names are one line. A failure enters means and ranks with the worst score.`),
    ...found.map((one) => h("section", { class: "failure" },
      h("h3", {}, one.variant ? `${one.method} (${one.variant.split(",").join(", ")})` : one.method, " ", status(one.status), h("span", { class: "times" }, ` × ${one.count}`)),
      h("p", { class: "lead" }, [one.task, one.dataset, one.sensor, one.split === "test" ? "" : `split ${one.split}`, one.case].filter(Boolean).join(" · ")),
      one.message && h("pre", {}, one.message),
      one.traceback && h("details", {}, h("summary", {}, "Traceback"), h("pre", {}, one.traceback)),
      one.command && code(one.command))),
  ];
}
