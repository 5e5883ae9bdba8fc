// The states of steps and work as shown: a text, and a symbol of 16 by 16 pixels. Colour (look.css, by class) is never the only sign.

export const MARKS = {
  New: { word: "not arranged yet", path: "M8 3.2a4.8 4.8 0 1 0 0 9.6 4.8 4.8 0 0 0 0-9.6z", open: true },
  Arranging: { word: "requesting terms", path: "M3.2 8h.1M8 8h.1M12.8 8h.1", open: true, bold: true },
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
  Ended: { word: "released", path: "M3.5 8h9", open: true },
  Unreachable: { word: "stopped responding", path: "M5.2 6a2.8 2.8 0 1 1 4 2.6c-.9.5-1.2.9-1.2 1.8M8 13v.1", open: true, bold: true },
  // Recovery actions.
  Replace: { word: "replaced", path: "M12.9 6.6A5.2 5.2 0 0 0 4 4.4M3.1 9.4a5.2 5.2 0 0 0 8.9 2.2M4 1.8v2.8h2.8M12 14.2v-2.8H9.2", open: true },
  Replan: { word: "new plan", path: "M4 14V8.5c0-2 1.5-2.6 4-2.6h3.5M9.2 3.2L12 5.9 9.2 8.6M4 8V2", open: true },
  Look: { word: "observed", path: "M1.6 8S4 3.9 8 3.9 14.4 8 14.4 8 12 12.1 8 12.1 1.6 8 1.6 8zM8 6.5a1.5 1.5 0 1 0 0 3 1.5 1.5 0 0 0 0-3z", open: true },
  Wait: { word: "waited", path: "M4.5 2.5h7M4.5 13.5h7M5.5 2.5c0 3 5 4 5 5.5s-5 2.5-5 5.5M10.5 2.5c0 3-5 4-5 5.5s5 2.5 5 5.5", open: true },
};

// The class that colours a group of states.
const LOOKS = {
  New: "open", Arranging: "busy", Offered: "busy", Committed: "ready", Executing: "work", Completed: "good", Failed: "bad", Stopping: "busy",
  Stopped: "off", Compensating: "undo", Compensated: "undo", Stranded: "bad", Ended: "off", Unreachable: "bad",
};

export const look = (state) => `somrs-is-${LOOKS[state] ?? "open"}`;
export const word = (state) => MARKS[state]?.word ?? state;

// The symbol as SVG text, with its upper left corner at (x, y).
export function sign(state, x = 0, y = 0) {
  const mark = MARKS[state] ?? MARKS.New;
  const drawn = mark.open ? `fill="none" stroke-width="${mark.bold ? 2.2 : 1.5}"` : `stroke-width="0" fill="currentColor"`;
  return `<path class="somrs-sign" d="${mark.path}" transform="translate(${x} ${y})" stroke="currentColor" stroke-linecap="round" stroke-linejoin="round" ${drawn}/>`;
}

const SIGNS = { "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;", "'": "&#39;" };
export const escaped = (text) => String(text).replace(/[&<>"']/g, (letter) => SIGNS[letter]);

// As much of the text as fits, by the average width of a letter.
export function fitting(text, width, letter = 6.6) {
  const most = Math.max(1, Math.floor(width / letter));
  return text.length <= most ? text : `${text.slice(0, most - 1)}…`;
}
