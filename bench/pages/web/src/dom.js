// Elements from text: names and messages are foreign, so nothing here takes markup.

const SVG = "http://www.w3.org/2000/svg";

function fill(element, properties, children) {
  for (const [name, value] of Object.entries(properties ?? {})) {
    if (value === undefined || value === null || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name === "value" || name === "checked" || name === "selected") element[name] = value;
    else element.setAttribute(name, value === true ? "" : String(value));
  }
  element.append(...children.flat(Infinity).filter((child) => child !== null && child !== undefined && child !== false));
  return element;
}

export const h = (tag, properties, ...children) => fill(document.createElement(tag), properties, children);
export const s = (tag, properties, ...children) => fill(document.createElementNS(SVG, tag), properties, children);

export function select(label, options, value, onChange, properties = {}) {
  const list = h("select", { onchange: (event) => onChange(event.target.value), ...properties });
  for (const [key, text] of options) list.append(h("option", { value: key, selected: key === value }, text));
  return h("label", { class: "field" }, h("span", {}, label), list);
}

export function save(name, type, text) {
  const url = URL.createObjectURL(new Blob([text], { type }));
  const link = h("a", { href: url, download: name });
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(url), 10000);
}

// What spreadsheets take for the beginning of a formula gets an apostrophe before it, as in `leaderboard --format csv`.
function cell(value) {
  let text = value === undefined || value === null ? "" : String(value);
  if (/^[=+\-@＝＋－＠]/.test(text) && (text.trim() === "" || Number.isNaN(Number(text)))) text = `'${text}`;
  return /[",\n\r]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}

export function csv(head, lines) {
  return `${[head, ...lines].map((line) => line.map(cell).join(",")).join("\n")}\n`;
}

export const fileName = (text) => text.replace(/[^\w.-]+/g, "_").replace(/^_+|_+$/g, "").slice(0, 80) || "detailbench";

const DRAWN = ["fill", "stroke", "stroke-width", "stroke-dasharray", "stroke-linecap", "stroke-opacity", "fill-opacity",
  "opacity", "font-family", "font-size", "font-weight", "font-style", "text-anchor", "paint-order"];

// A picture that stands alone: the colours and letters of the page's style are written into it.
export function svgText(svg) {
  const copy = svg.cloneNode(true);
  const from = [svg, ...svg.querySelectorAll("*")];
  const to = [copy, ...copy.querySelectorAll("*")];
  from.forEach((element, i) => {
    const style = getComputedStyle(element);
    const kept = DRAWN.map((name) => `${name}:${style.getPropertyValue(name)}`).join(";");
    to[i].removeAttribute("class");
    for (const { name, value } of [...to[i].attributes]) if (value.includes("var(")) to[i].removeAttribute(name);
    to[i].setAttribute("style", kept);
  });
  copy.querySelectorAll("style").forEach((element) => element.remove());
  const { width, height } = svg.viewBox.baseVal ?? {};
  const box = width ? [width, height] : [svg.clientWidth, svg.clientHeight];
  copy.setAttribute("xmlns", SVG);
  copy.setAttribute("width", box[0]);
  copy.setAttribute("height", box[1]);
  copy.style.background = getComputedStyle(document.body).backgroundColor;
  return `<?xml version="1.0" encoding="UTF-8"?>\n${new XMLSerializer().serializeToString(copy)}\n`;
}

// A chart with its title, its buttons and what there is to say of it.
export function figure(title, svg, { name, head, lines, note } = {}) {
  const buttons = h("span", { class: "buttons" },
    h("button", { type: "button", onclick: () => save(`${fileName(name ?? title)}.svg`, "image/svg+xml", svgText(svg)) }, "SVG"),
    head && h("button", { type: "button", onclick: () => save(`${fileName(name ?? title)}.csv`, "text/csv", csv(head, lines)) }, "CSV"));
  svg.setAttribute("role", "img");
  svg.setAttribute("aria-label", title);
  return h("figure", {}, h("figcaption", {}, h("span", { class: "title" }, title), buttons),
    h("div", { class: "scroll" }, svg), note && h("p", { class: "note" }, note));
}

export function notes(list) {
  return list.length ? h("ul", { class: "notes" }, list.map((text) => h("li", {}, text))) : null;
}
