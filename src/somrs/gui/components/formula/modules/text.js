// What a formula's text is made of, for showing it: pieces with their colours, and places counted as Python counts them.

const LEXEMES = /"(?:[^"\\\n]|\\.)*"?|#[^\n]*|\?[\p{L}_][\p{L}\p{N}_-]*|[\p{L}_][\p{L}\p{N}_-]*|\d+(?:\.\d*)?/gu;
const KEYWORDS = new Set(["AND", "OR", "NOT"]);
const TRUTHS = new Set(["TRUE", "FALSE"]);

function kind(lexeme) {
  if (lexeme[0] === '"') return "text";
  if (lexeme[0] === "#") return "comment";
  if (lexeme[0] === "?") return "variable";
  if (KEYWORDS.has(lexeme)) return "keyword";
  if (TRUTHS.has(lexeme) || /^\d/.test(lexeme)) return "number";
  return "";
}

// The text in pieces: {text, kind, wrong, mark}. `wrong` ranges [{from, to}] are underlined; a piece with `mark` begins at `mark`.
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
  // Something that is missing at the end is underlined there, and the last piece is where a completion behind everything begins.
  made.push({ text: "", kind: "", wrong: wrong.some((one) => one.from >= text.length), mark: mark === text.length, end: true });
  return made;
}

// Python counts whole characters, JavaScript halves of some.
export function counted(text, at) {
  return [...text.slice(0, at)].length;
}

export function placed(text, count) {
  return [...text].slice(0, count).join("").length;
}

// The names that a hint proposes: "did you mean Jar002 or Jar003?".
export function proposals(hint) {
  const found = /^did you mean (.+)\?$/.exec(hint);
  return found ? found[1].split(" or ") : [];
}
