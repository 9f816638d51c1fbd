// The state of the page in its link: view, table, metric, sort, filters, case, scene.

export function read() {
  return Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
}

export function write(state) {
  const kept = Object.entries(state).filter(([, value]) => value !== "" && value !== undefined && value !== null);
  const text = `#${new URLSearchParams(kept)}`;
  if (text !== location.hash) history.replaceState(null, "", text === "#" ? location.pathname + location.search : text);
}
