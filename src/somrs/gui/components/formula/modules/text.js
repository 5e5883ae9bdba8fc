// Pieces of a formula's text for display, and conversion of positions to Python's.

const LEXEMES = /"(?:[^"\\\n]|\\.)*"?|#[^\n]*|\?[\p{L}_][\p{L}\p{N}_-]*|[\p{L}_][\p{L}\p{N}_-]*|\d+(?:\.\d*)?/gu;
const KEYWORDS = new Set(["AND", "OR", "NOT", "FORALL", "EXISTS"]);
const TRUTHS = new Set(["TRUE", "FALSE"]);

function kind(lexeme) {
  if (lexeme[0] === '"') return "text";
  if (lexeme[0] === "#") return "comment";
  if (lexeme[0] === "?") return "variable";
  if (KEYWORDS.has(lexeme)) return "keyword";
  if (TRUTHS.has(lexeme) || /^\d/.test(lexeme)) return "number";
  return "";
}

// The text in pieces: {text, kind, wrong, mark}. Ranges `wrong` [{from, to}] are underlined; a piece begins at `mark`.
export function pieces(text, wrong, mark) {
  const spans = [];
  for (const found of text.matchAll(LEXEMES)) {
    const named = kind(found[0]);
    if (named) spans.push({ from: found.index, to: found.index + found[0].length, kind: named });
  }
  const cuts = new Set([0, text.length, mark ?? 0]);
  for (const { from, to } of [...spans, ...wrong]) cuts.add(Math.min(from, text.length)).add(Math.min(to, text.length));
  const places = [...cuts].sort((a, b) => a - b);
  const made = places.slice(0, -1).map((from, index) => ({
    text: text.slice(from, places[index + 1]),
    kind: spans.find((span) => span.from <= from && from < span.to)?.kind ?? "",
    wrong: wrong.some((one) => one.from <= from && from < one.to),
    mark: from === mark,
  }));
  // An error at the end of the text is underlined there; the last piece is also the start of a completion at the end.
  made.push({ text: "", kind: "", wrong: wrong.some((one) => one.from >= text.length), mark: mark === text.length, end: true });
  return made;
}

// Python counts code points, JavaScript UTF-16 code units.
export function counted(text, at) {
  return [...text.slice(0, at)].length;
}

export function placed(text, count) {
  return [...text].slice(0, count).join("").length;
}

// The names proposed by a hint such as "did you mean Jar002 or Jar003?".
export function proposals(hint) {
  const found = /^did you mean (.+)\?$/.exec(hint);
  return found ? found[1].split(" or ") : [];
}
