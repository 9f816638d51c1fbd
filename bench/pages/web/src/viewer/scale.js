// The colour bar: one scale for all panels, with numbers and their unit.

import { COLORS } from "./colors.js";
import { make } from "./dom.js";

/** Round numbers from 0 to below the limit, and the limit. */
export function ticks(limit) {
  const rough = limit / 3.5, unit = 10 ** Math.floor(Math.log10(rough));
  const step = unit * ([1, 2, 5].find((s) => s * unit >= rough) ?? 10);
  const found = [];
  for (let k = 0; k * step < limit - 0.6 * step; k++) found.push(k * step);
  return [...found, limit];
}

export const words = (number) => String(Number(number.toPrecision(3)));

export function colorBar(title, unit, limit) {
  const stops = COLORS.filter((_, k) => k % 15 === 0).map((rgb) => `rgb(${rgb.join(" ")})`);
  const marks = ticks(limit).map((value) =>
    make("span", { style: `left: ${((100 * value) / limit).toFixed(2)}%` }, value === limit ? `≥ ${words(value)}` : words(value)),
  );
  const bar = make("div", { class: "dbv-bar", "aria-hidden": "true" }, [
    make("div", { class: "dbv-ramp", style: `background: linear-gradient(to right, ${stops.join(", ")})` }),
    make("div", { class: "dbv-ticks" }, marks),
  ]);
  const text = make("span", {}, `${title}${unit ? `, in ${unit}` : ""}`);
  const spoken = `Colours: ${title}, from 0 to ${words(limit)} ${unit} and beyond, light to dark.`;
  return make("div", { class: "dbv-scale", role: "img", "aria-label": spoken }, [bar, text]);
}
