// The viewer's style sheet, in the page's colours: --ink, --paper and --line, with defaults for a page that has none.

const TEXT = `
.dbv { --dbv-ink: var(--ink, CanvasText); --dbv-paper: var(--paper, Canvas); --dbv-line: var(--line, color-mix(in srgb, CanvasText 25%, Canvas));
  color: var(--dbv-ink); font-size: 0.875rem; line-height: 1.4; }
.dbv * { box-sizing: border-box; }
.dbv-tools { display: flex; flex-wrap: wrap; gap: 0.4rem 1rem; align-items: center; margin-bottom: 0.5rem; }
.dbv-group { display: inline-flex; flex-wrap: wrap; align-items: center; gap: 0.3rem; border: 0; margin: 0; padding: 0; min-width: 0; }
.dbv button, .dbv select { font: inherit; color: inherit; background: var(--dbv-paper); border: 1px solid var(--dbv-line); border-radius: 4px;
  padding: 0.2rem 0.6rem; min-height: 1.9rem; cursor: pointer; }
.dbv button:hover { border-color: var(--dbv-ink); }
.dbv button[aria-pressed="true"] { background: var(--dbv-ink); color: var(--dbv-paper); border-color: var(--dbv-ink); }
.dbv-joined { display: inline-flex; }
.dbv-joined button { border-radius: 0; margin-left: -1px; }
.dbv-joined button:first-child { border-radius: 4px 0 0 4px; margin-left: 0; }
.dbv-joined button:last-child { border-radius: 0 4px 4px 0; }
.dbv button:focus-visible, .dbv select:focus-visible, .dbv input:focus-visible { outline: 2px solid #0072b2; outline-offset: 2px; }
.dbv label { display: inline-flex; align-items: center; gap: 0.35rem; }
.dbv input[type="range"] { width: 9rem; max-width: 40vw; accent-color: var(--dbv-ink); }
.dbv input[type="checkbox"] { accent-color: var(--dbv-ink); width: 1rem; height: 1rem; }
.dbv-shapes { margin-bottom: 0.6rem; }
.dbv-scale { display: flex; flex-wrap: wrap; align-items: flex-start; gap: 0.2rem 0.8rem; margin: 0 0 0.6rem; }
.dbv-bar { flex: 0 1 22rem; min-width: 12rem; margin-right: 1.5rem; }
.dbv-ramp { height: 0.8rem; border: 1px solid var(--dbv-line); border-radius: 2px; forced-color-adjust: none; }
.dbv-ticks { position: relative; height: 1.3rem; font-variant-numeric: tabular-nums; }
.dbv-ticks span { position: absolute; transform: translateX(-50%); white-space: nowrap; }
.dbv-ticks span:first-child { transform: none; }
.dbv-ticks span::before { content: ""; position: absolute; left: 50%; top: -0.25rem; height: 0.25rem; border-left: 1px solid var(--dbv-ink); }
.dbv-ticks span:first-child::before { left: 0; }
.dbv-stage { position: relative; }
.dbv-canvas { position: absolute; left: 0; top: 0; pointer-events: none; }
.dbv-grid { display: grid; gap: 0.75rem; }
.dbv-panel { margin: 0; min-width: 0; display: flex; flex-direction: column; }
.dbv-panel[hidden] { display: none; }
.dbv-panel figcaption { padding: 0 0 0.25rem; overflow-wrap: anywhere; }
.dbv-name { font-weight: 600; }
.dbv-role, .dbv-note { opacity: 0.75; }
.dbv-note { display: block; padding-top: 0.2rem; font-size: 0.8125rem; overflow-wrap: anywhere; }
.dbv-view { position: relative; aspect-ratio: 1; max-height: 75vh; background: color-mix(in srgb, var(--dbv-ink) 9%, var(--dbv-paper)); width: 100%; border: 1px solid var(--dbv-line); border-radius: 4px; cursor: grab;
  touch-action: pan-y; user-select: none; -webkit-user-select: none; }
.dbv-view:focus { outline: 2px solid #0072b2; outline-offset: 1px; touch-action: none; }
.dbv-view:active { cursor: grabbing; }
.dbv-view[data-empty] { cursor: default; }
.dbv-picture { position: absolute; inset: 0; width: 100%; height: 100%; object-fit: contain; padding: 0.3rem; }
.dbv-say { position: absolute; inset: 0; display: flex; align-items: center; justify-content: center; padding: 1rem; text-align: center; overflow: auto;
  overflow-wrap: anywhere; }
.dbv-say:empty { display: none; }
.dbv-here { position: absolute; left: 0.4rem; bottom: 0.3rem; padding: 0 0.35rem; border-radius: 3px; background: var(--dbv-paper);
  font-variant-numeric: tabular-nums; pointer-events: none; z-index: 1; }
.dbv-here:empty { display: none; }
.dbv-failed { border: 1px solid var(--dbv-line); border-radius: 4px; padding: 1rem; }
.dbv-help { opacity: 0.75; font-size: 0.8125rem; margin: 0.5rem 0 0; }
`;

export function addStyle() {
  if (document.getElementById("dbv-style")) return;
  const style = document.createElement("style");
  style.id = "dbv-style";
  style.textContent = TEXT;
  document.head.append(style);
}
