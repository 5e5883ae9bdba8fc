// The work of a task as bars: begin, end, device, promised time and result.

import { escaped, fitting, look, sign, word } from "./marks.js";
import { since } from "./messages.js";

const HIGH = 24;
const ENDS = { Completed: "does", Failed: "does", Stopped: "does", Compensated: "undoes", Stranded: "undoes" };

// [{device, service, step, kind, what, start, ended, state, until, fraction, base}] from messages and contracts. `until`: the promised end.
// Work that is arranged and not begun has the kind "waits".
export function works({ view, contracts, messages }) {
  const found = new Map();
  const durations = new Map();
  const base = view.submitted_at;
  const known = new Map(contracts.map((contract) => [contract.participant, contract]));
  const inputs = new Map();
  for (const message of messages) {
    const { participant, type, body, at } = message;
    if (type === "Arrange") inputs.set(participant, Object.values(body.inputs)[0] ?? "");
    else if (type === "Terms") durations.set(participant, body.duration);
    else if (type === "Execute" || type === "Compensate") {
      const kind = type === "Execute" ? "does" : "undoes";
      if (found.has(`${participant} ${kind}`)) continue; // repeated
      const until = kind === "does" && durations.has(participant) ? at + durations.get(participant) : null;
      const state = kind === "does" ? "Executing" : "Compensating";
      found.set(`${participant} ${kind}`, { ...party(message), kind, what: inputs.get(participant) ?? "", start: at, ended: null, state, until, fraction: 0, base, heard: at, participant });
    } else if (type === "Progress") {
      const work = found.get(`${participant} does`);
      if (work) Object.assign(work, { fraction: body.fraction, heard: at });
    } else if (type in ENDS) {
      const work = found.get(`${participant} ${ENDS[type]}`);
      if (work && work.ended === null) Object.assign(work, { ended: at, state: type });
    }
  }
  for (const work of found.values()) {
    // A service that stopped responding, or had not ended with the task: until its last message.
    const state = known.get(work.participant)?.state;
    if (work.ended === null && (state === "Unreachable" || view.outcome)) Object.assign(work, { ended: Math.max(work.heard, work.start), state: "Unreachable" });
  }
  for (const contract of contracts)
    if (contract.accepted && contract.state === "Committed" && !found.has(`${contract.participant} does`) && contract.start && contract.finish && !view.outcome)
      found.set(`${contract.participant} waits`, {
        device: contract.service.split(".")[0], service: contract.service, step: contract.step, kind: "waits", what: inputs.get(contract.participant) ?? "",
        start: contract.start, ended: contract.start, state: "Committed", until: contract.finish, fraction: 0, base, participant: contract.participant,
      });
  return [...found.values()].sort((one, other) => one.start - other.start);
}

const party = ({ service, step }) => ({ device: service.split(".")[0], service, step });

// A row for each piece of work, so that bars in a row do not overlap; and the devices with their rows.
export function lanes(found, now) {
  const own = new Map();
  for (const work of found) {
    if (!own.has(work.device)) own.set(work.device, []);
    const rows = own.get(work.device);
    const end = Math.max(work.ended ?? now, work.kind === "waits" ? work.until : 0);
    const free = rows.find((row) => row.end <= work.start);
    if (free) Object.assign(free, { end, works: [...free.works, work] });
    else rows.push({ end, works: [work] });
  }
  const row = new Map();
  const names = [];
  let count = 0;
  for (const [device, rows] of own) {
    names.push([device, count, rows.length]);
    for (const one of rows) {
      one.works.forEach((work) => row.set(work, count));
      count++;
    }
  }
  return { row, names, count };
}

// The seconds of the grid lines: about `most` of them.
export function ticks(seconds, most) {
  const step = [1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1800, 3600].find((one) => seconds / one <= most) ?? 7200;
  return Array.from({ length: Math.floor(seconds / step) + 1 }, (_, index) => index * step);
}

// The bar as SVG. `x`: converts a time; `room`: the limit for a text beside the bar.
export function drawn(work, index, y, x, now, room) {
  const [left, right] = [x(work.start), x(work.ended ?? now)];
  const wide = Math.max(4, right - left);
  const text = `${work.step}${work.what ? ` ${work.what}` : ""}`;
  const told = telling(work, now);
  const promise = work.until ? `<rect class="somrs-times-promised" x="${left}" y="${y}" width="${Math.max(4, x(work.until) - left)}" height="${HIGH + 4}" rx="6"/>` : "";
  const inside = wide > 90;
  const said = inside ? fitting(text, wide - 30, 6.6) : fitting(text, Math.max(0, room - left - wide - 24), 6.6);
  const at = inside ? left + 6 : left + wide + 4;
  const label = !inside && room - left - wide < 46 ? "" : `<text class="${inside ? "somrs-bar-in" : "somrs-bar-by"}" x="${at + 19}" y="${y + 18}">${escaped(said)}</text>`;
  const marked = inside || room - left - wide > 22 ? `<g class="${inside ? "somrs-bar-in" : "somrs-bar-by"}">${sign(work.state, at, y + 6)}</g>` : "";
  const bar = work.kind === "waits" ? "" : `<rect class="somrs-bar-fill" x="${left}" y="${y + 2}" width="${wide}" height="${HIGH}" rx="4"/>`;
  return `<g class="somrs-bar ${look(work.state)} somrs-bar-${work.kind}" data-bar="${index}" data-told="${escaped(told)}" role="img" aria-label="${escaped(told)}">${promise}${bar}${marked}${label}</g>`;
}

function telling(work, now) {
  const from = since(work.start - work.base);
  const promise = work.until ? `, promised until ${since(work.until - work.base)}` : "";
  const who = `${work.service}, ${work.step}${work.what ? ` (${work.what})` : ""}`;
  if (work.kind === "waits") return `${who}: arranged from ${from}${promise}`;
  const going = work.state === "Executing" ? ` ${Math.round(100 * work.fraction)} %` : "";
  return `${who}: ${word(work.state)}${going}, from ${from} to ${since((work.ended ?? now) - work.base)}${promise}`;
}
