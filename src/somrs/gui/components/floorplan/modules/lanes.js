// The lanes of a storey, as lines from waypoint to waypoint. An arrow in the middle shows that a lane leads in one direction only.

import { svg } from "./layers.js";

const TIP = 0.28; // metres
const n = (value) => +value.toFixed(3);

export class Lanes {
  // `sheet`: the group of a sheet with layers; lanes are drawn above the floors.
  constructor(sheet) {
    this._drawn = new Set(); // lanes and their waypoints
    this._group = svg("g", { class: "fp-lanes" });
    sheet.insertBefore(this._group, sheet.querySelector(".fp-layer-places"));
  }

  // Draw the lanes anew if these objects concern them; `spot(name)` is the position of a waypoint on the storey, or null.
  refresh(model, spot, names) {
    if (names !== undefined && ![...names].some((name) => this._drawn.has(name) || this._lane(model, name))) return;
    const ends = new Map([...model.facts("endsAt")].map((fact) => fact.arguments));
    const [lines, tips] = [[], []];
    this._drawn.clear();
    for (const fact of model.facts("startsAt")) {
      const [lane, start] = fact.arguments;
      const end = ends.get(lane);
      if (end === undefined || !this._lane(model, lane)) continue;
      this._drawn.add(lane).add(start).add(end);
      const [from, to] = [spot(start), spot(end)];
      if (!from || !to) continue;
      lines.push(`M${n(from.x)} ${n(from.y)}L${n(to.x)} ${n(to.y)}`);
      if (model.value(lane, "Bidirectional") !== true) tips.push(tip(from, to));
    }
    this._group.innerHTML = lines.length ? `<path class="fp-lane" d="${lines.join("")}"/><path class="fp-lane-tip" d="${tips.join("")}"/>` : "";
  }

  _lane(model, name) {
    return model.isA(model.objects.get(name)?.type, "Lane");
  }
}

// A triangle in the middle of the line that points to its end.
function tip(from, to) {
  const length = Math.hypot(to.x - from.x, to.y - from.y);
  if (length === 0) return "";
  const [ux, uy] = [(to.x - from.x) / length, (to.y - from.y) / length];
  const [x, y] = [(from.x + to.x) / 2, (from.y + to.y) / 2];
  const corner = (ahead, aside) => `${n(x + TIP * (ahead * ux - aside * uy))} ${n(y + TIP * (ahead * uy + aside * ux))}`;
  return `M${corner(0.6, 0)}L${corner(-0.6, 0.5)}L${corner(-0.6, -0.5)}Z`;
}
