// Numbers as a reader wants them.

export const number = (value) => (value === "Infinity" ? Infinity : value === "-Infinity" ? -Infinity : value);

export function short(value, digits = 3) {
  value = number(value);
  if (value === null || value === undefined || Number.isNaN(value)) return "-";
  if (!Number.isFinite(value)) return value > 0 ? "∞" : "-∞";
  if (Number.isInteger(value) && Math.abs(value) < 1e6) return value.toLocaleString("en-US");
  const size = Math.abs(value);
  if (size >= 1e5 || (size < 1e-3 && size > 0)) return value.toExponential(digits - 1).replace("e+", "e");
  return size >= 1000 ? Math.round(value).toLocaleString("en-US") : String(Number(value.toPrecision(digits)));
}

export function seconds(value) {
  if (value === null || value === undefined) return "-";
  return value < 1 ? value.toFixed(3) : short(value);
}

export const megabytes = (value) => (value === null || value === undefined ? "-" : Math.round(value).toLocaleString("en-US"));

export const percent = (value) => (value === null || value === undefined ? "-" : `${Math.round(100 * value)}`);

export const day = (text) => (text ? text.slice(0, 10) : "");

export const counted = (n, word) => `${n.toLocaleString("en-US")} ${word}${n === 1 ? "" : "s"}`;

const ARROWS = { lower: "↓", higher: "↑", reference: "→ ref" };
export const arrow = (better) => ARROWS[better] ?? "";
