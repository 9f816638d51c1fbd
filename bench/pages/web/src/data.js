// The JSON of the page, with its columns unpacked on demand.

export function load() {
  const data = globalThis.detailbenchData ?? JSON.parse(document.getElementById("detailbench-data").textContent);
  const packed = data.cases.columns;
  const cache = new Map();
  const column = (name) => {
    if (!cache.has(name)) {
      const found = packed[name];
      cache.set(name, !found ? null : Array.isArray(found) ? found : found.codes.map((code) => found.values[code]));
    }
    return cache.get(name);
  };
  data.column = column;
  data.value = (name, row) => column(name)?.[row] ?? null;
  data.label = (row) => plainLabel(data.value("method", row), data.value("variant", row));
  data.scoreNames = Object.keys(packed).filter((name) => name.startsWith("score.")).map((name) => name.slice(6));
  data.tasks = [...new Set(data.groups.map((group) => group.task))];
  return data;
}

// A method with its parameters; tables may call it by the name of a preset.
export const plainLabel = (method, variant) => (variant ? `${method} (${variant.split(",").join(", ")})` : method);

// How a mean stands out in its table: the best one, the second best one.
export const emphasis = (metric, i) => (metric.best[i] ? "strong" : metric.second?.[i] ? "em" : "span");

export const keyOf = (group) => [group.dataset, group.sensor, group.split].join(" · ");

// Which tables the choice shows: the task, the way to make tables, the table of it, and the metric.
export function chosen(data, state) {
  const task = data.tasks.includes(state.task) ? state.task : data.tasks[0];
  const ways = data.ways.filter((way) => data.groups.some((g) => g.by === way.name && g.task === task));
  const by = ways.some((way) => way.name === state.by) ? state.by : ways[0].name;
  const groups = data.groups.filter((group) => group.by === by && group.task === task);
  const group = groups.find((g) => keyOf(g) === state.group) ?? groups[0];
  const metric = group.metrics.find((m) => m.name === state.metric) ?? group.metrics[0];
  return { task, ways, by, groups, group, metric };
}
