// The states of steps and of work as people see them: a word, and a sign drawn in 16 by 16 pixels. Colour (look.css, by the class) is
// never the only sign.

export const MARKS = {
  New: { word: "not asked yet", path: "M8 3.2a4.8 4.8 0 1 0 0 9.6 4.8 4.8 0 0 0 0-9.6z", open: true },
  Arranging: { word: "asking for terms", path: "M3.2 8h.1M8 8h.1M12.8 8h.1", open: true, bold: true },
  Offered: { word: "terms offered", path: "M3.2 8h.1M8 8h.1M12.8 8h.1", open: true, bold: true },
  Committed: { word: "arranged", path: "M3.5 2.5h9v11h-9zM6 6h4M6 9h4", open: true },
  Executing: { word: "at work", path: "M4.5 2.8v10.4L13 8z" },
  Completed: { word: "done", path: "M2.8 8.4l3.4 3.6 7-8", open: true, bold: true },
  Failed: { word: "failed", path: "M3.6 3.6l8.8 8.8M12.4 3.6l-8.8 8.8", open: true, bold: true },
  Stopping: { word: "stopping", path: "M4 4h8v8H4z", open: true },
  Stopped: { word: "stopped", path: "M4 4h8v8H4z" },
  Compensating: { word: "being undone", path: "M6.5 3L3 6.5 6.5 10M3.2 6.5H10a3.2 3.2 0 0 1 0 6.5H7", open: true },
  Compensated: { word: "undone", path: "M6.5 3L3 6.5 6.5 10M3.2 6.5H10a3.2 3.2 0 0 1 0 6.5H7", open: true, bold: true },
  Stranded: { word: "could not be undone", path: "M8 2.5v7M8 12.8v.1", open: true, bold: true },
  Ended: { word: "left", path: "M3.5 8h9", open: true },
  Unreachable: { word: "fell silent", path: "M5.2 6a2.8 2.8 0 1 1 4 2.6c-.9.5-1.2.9-1.2 1.8M8 13v.1", open: true, bold: true },
};

// What groups of states look alike: the class that colours them.
const LOOKS = {
  New: "open", Arranging: "busy", Offered: "busy", Committed: "ready", Executing: "work", Completed: "good", Failed: "bad", Stopping: "busy",
  Stopped: "off", Compensating: "undo", Compensated: "undo", Stranded: "bad", Ended: "off", Unreachable: "bad",
};

export const look = (state) => `somrs-is-${LOOKS[state] ?? "open"}`;
export const word = (state) => MARKS[state]?.word ?? state;

// The sign as SVG elements' text, its upper left corner at (x, y).
export function sign(state, x = 0, y = 0) {
  const mark = MARKS[state] ?? MARKS.New;
  const drawn = mark.open ? `fill="none" stroke-width="${mark.bold ? 2.2 : 1.5}"` : `stroke-width="0" fill="currentColor"`;
  return `<path class="somrs-sign" d="${mark.path}" transform="translate(${x} ${y})" stroke="currentColor" stroke-linecap="round" stroke-linejoin="round" ${drawn}/>`;
}

const SIGNS = { "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;", "'": "&#39;" };
export const escaped = (text) => String(text).replace(/[&<>"']/g, (letter) => SIGNS[letter]);

// As much of the text as fits, by the width that a letter has on average.
export function fitting(text, width, letter = 6.6) {
  const most = Math.max(1, Math.floor(width / letter));
  return text.length <= most ? text : `${text.slice(0, most - 1)}…`;
}
