// The palette of Okabe and Ito ("Color Universal Design", 2008), which the common kinds of colour blindness can tell
// apart; its black follows the ink of the theme, and its yellow is left out, for it vanishes on white. More methods than
// colours differ by their symbols too.
export const COLORS = 7;
const SYMBOLS = ["circle", "square", "triangle", "diamond", "cross", "star", "wye"];

export function styles(labels) {
  const known = [...new Set(labels)].sort();
  return new Map(known.map((label, i) => [label, {
    color: `var(--m${i % COLORS})`,
    symbol: SYMBOLS[(i + Math.floor(i / COLORS)) % SYMBOLS.length],
    dash: ["", "6 3", "2 3"][Math.floor(i / COLORS) % 3],
  }]));
}
