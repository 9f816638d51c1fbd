// A table that can be sorted and filtered, and saved as CSV. The library keeps the order and the filters; the elements
// are those of a plain table, so that keyboards and screen readers know it.
import {
  columnFilteringFeature, constructTable, createFilteredRowModel, createSortedRowModel, filterFn_equalsString,
  filterFn_includesString, globalFilteringFeature, rowSortingFeature, sortFn_basic, tableFeatures,
} from "@tanstack/table-core";
import { storeReactivityBindings } from "@tanstack/table-core/store-reactivity-bindings";
import { csv, fileName, h, save } from "./dom.js";
import { counted } from "./format.js";

const FIRST = 200; // rows shown before all are asked for

const features = tableFeatures({
  coreReactivityFeature: storeReactivityBindings(),
  rowSortingFeature, columnFilteringFeature, globalFilteringFeature,
  sortedRowModel: createSortedRowModel(), filteredRowModel: createFilteredRowModel(),
  sortFns: { basic: sortFn_basic },
  filterFns: { includesString: filterFn_includesString, equalsString: filterFn_equalsString },
});

/*
 * columns: [{id, title, value(row), text?(row), cell?(row), numeric?, descending?, filter?, help?, csv?}]; `value` is what
 * is sorted by and saved (undefined where there is none), `filter` offers a list of the column's values.
 * options: {caption, name, state: {sort, q, f.ID}, onState(change), search?, foot?, details?(row), open?, onOpen?(row), mark?(row)}; with
 * `details` a row opens, one at a time, and shows these elements below it; `open` is the row that is open at first.
 */
export function dataTable(rows, columns, options) {
  const { state = {}, onState = () => {} } = options;
  const defined = (value) => (value === null || value === "" ? undefined : value);
  const filters = columns.filter((column) => column.filter && state[`f.${column.id}`])
    .map((column) => ({ id: column.id, value: state[`f.${column.id}`] }));
  const sort = state.sort && columns.some((column) => column.id === state.sort.replace(/^-/, ""))
    ? [{ id: state.sort.replace(/^-/, ""), desc: state.sort.startsWith("-") }] : [];
  const table = constructTable({
    features, data: rows,
    columns: columns.map((column) => ({
      id: column.id, accessorFn: (row) => defined(column.value(row)), sortFn: "basic", sortUndefined: "last",
      sortDescFirst: Boolean(column.descending), filterFn: "equalsString", enableSorting: !column.plain,
    })),
    initialState: { sorting: sort, globalFilter: state.q ?? "", columnFilters: filters },
    globalFilterFn: "includesString", getColumnCanGlobalFilter: (column) => !column.columnDef.plain,
  });
  const byId = new Map(columns.map((column) => [column.id, column]));
  const textOf = (column, row) => (column.text ? column.text(row) : column.value(row) ?? "");
  let all = false;

  const head = h("tr", {});
  const body = h("tbody", {});
  const count = h("span", { class: "count", role: "status" });
  const more = h("button", { type: "button", hidden: true, onclick: () => { all = true; fill(); } }, "");

  function turn(id) {
    const [now] = table.atoms.sorting.get();
    const first = Boolean(byId.get(id).descending);
    const next = !now || now.id !== id ? { id, desc: first } : now.desc === first ? { id, desc: !first } : null;
    table.setSorting(next ? [next] : []);
    onState({ sort: next ? `${next.desc ? "-" : ""}${next.id}` : "" });
    fill();
  }

  for (const column of columns) {
    const cell = h("th", { scope: "col", class: column.numeric ? "number" : "", title: column.help, "data-id": column.id });
    cell.append(column.plain ? column.title : h("button", { type: "button", onclick: () => turn(column.id) }, column.title,
      h("span", { class: "sort", "aria-hidden": "true" })));
    head.append(cell);
  }

  let opened = options.open ?? null;

  function line(row) {
    const mine = row === opened;
    const element = h("tr", {
      class: options.details ? (mine ? "opens selected" : "opens") : options.mark?.(row) && "selected", tabindex: options.details && "-1", "aria-expanded": options.details && String(mine),
      onclick: options.details && ((event) => { if (!event.target.closest("a, button")) turnRow(row); }),
    });
    columns.forEach((column, i) => {
      const content = column.cell ? column.cell(row) : String(textOf(column, row) ?? "");
      element.append(h(i === 0 || column.header ? "th" : "td",
        { scope: i === 0 || column.header ? "row" : undefined, class: column.numeric ? "number" : column.kind }, content));
    });
    return mine ? [element, h("tr", { class: "details" }, h("td", { colspan: columns.length }, h("div", {}, options.details(row))))] : [element];
  }

  function turnRow(row) {
    opened = opened === row ? null : row;
    options.onOpen?.(opened);
    fill();
    body.querySelector(".opens[tabindex='0']")?.focus();
  }

  function fill() {
    const found = table.getRowModel().rows;
    const shown = all ? found : found.slice(0, FIRST);
    body.replaceChildren(...shown.flatMap((row) => line(row.original)));
    if (options.details && body.firstChild) (body.querySelector(".selected") ?? body.firstChild).tabIndex = 0;
    if (!found.length) body.append(h("tr", {}, h("td", { colspan: columns.length, class: "empty" }, "No row passes the filters.")));
    more.hidden = shown.length === found.length;
    more.textContent = `Show all ${found.length.toLocaleString("en-US")} rows`;
    count.textContent = found.length === rows.length ? counted(rows.length, "row")
      : `${found.length.toLocaleString("en-US")} of ${counted(rows.length, "row")}`;
    const [now] = table.atoms.sorting.get();
    for (const cell of head.children) {
      const mine = now && now.id === cell.dataset.id;
      cell.toggleAttribute("data-sorted", Boolean(mine));
      if (mine) cell.setAttribute("aria-sort", now.desc ? "descending" : "ascending");
      else cell.removeAttribute("aria-sort");
    }
  }

  // Up and down walk through rows that open something; Enter opens.
  body.addEventListener("keydown", (event) => {
    const row = event.target.closest("tr.opens");
    if (!row || event.target !== row) return;
    const lines = [...body.querySelectorAll("tr.opens")];
    const next = lines[lines.indexOf(row) + ({ ArrowDown: 1, ArrowUp: -1 }[event.key] ?? 0)];
    if (next && next !== row) {
      row.tabIndex = -1;
      next.tabIndex = 0;
      next.focus();
      event.preventDefault();
    } else if (event.key === "Enter" || event.key === " ") {
      row.click();
      event.preventDefault();
    }
  });

  const tools = h("div", { class: "tools" });
  if (options.search !== false) {
    tools.append(h("input", {
      type: "search", placeholder: "Filter rows", "aria-label": "Filter rows", value: state.q ?? "",
      oninput: (event) => { table.setGlobalFilter(event.target.value); onState({ q: event.target.value }); fill(); },
    }));
  }
  for (const column of columns.filter((column) => column.filter)) {
    const values = [...new Set(rows.map((row) => column.value(row)).filter((value) => defined(value) !== undefined))].sort();
    if (values.length < 2) continue;
    const list = h("select", {
      "aria-label": `Filter by ${column.title}`,
      onchange: (event) => {
        table.getColumn(column.id).setFilterValue(event.target.value || undefined);
        onState({ [`f.${column.id}`]: event.target.value });
        fill();
      },
    }, h("option", { value: "" }, `${column.title}: all`));
    for (const value of values) list.append(h("option", { value, selected: value === state[`f.${column.id}`] }, value));
    tools.append(list);
  }
  const saved = columns.filter((column) => column.csv !== false);
  tools.append(count, h("span", { class: "buttons" }, h("button", {
    type: "button",
    onclick: () => save(`${fileName(options.name ?? options.caption)}.csv`, "text/csv", csv(
      saved.flatMap((column) => column.csv?.head ?? [column.id]),
      table.getRowModel().rows.map((row) => saved.flatMap((column) => column.csv?.values(row.original) ?? [column.value(row.original)])))),
  }, "CSV")));

  fill();
  return h("div", { class: options.search === false ? "table small" : "table" }, tools,
    h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": options.caption },
      h("table", {}, h("caption", { class: "hidden" }, options.caption), h("thead", {}, head), body, options.foot)),
    more);
}
