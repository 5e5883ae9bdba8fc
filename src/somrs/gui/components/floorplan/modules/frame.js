// Overlays of single objects, in pixels: frame and turning handle of the selected object, and rings around search results.

import { reach } from "./model.js";
import { outline, pose } from "./shapes.js";

const SMALL = 9; // pixels; smaller objects have a ring instead of a frame
const AWAY = 0.3; // metres; an object displayed farther from its map position has an outline there
const HANDLE = 26; // pixels from the object's edge to its turning handle

export class Frame {
  // `world`: a group drawn in metres; `screen`: one in pixels.
  constructor(world, screen) {
    this._world = world;
    this._screen = screen;
  }

  show({ model, view, at, selected, turnable, target, found, ghost, moving, unknown }) {
    const inMetres = [];
    const inPixels = [];
    const put = (name, cls) => {
      const [solid, place] = [model.solid(name), at(name)];
      if (solid && place) inMetres.push(`<path class="${cls}" transform="${pose(place)}" d="${outline(solid)}"/>`);
      return solid && place;
    };
    for (const name of moving) {
      const [solid, place] = [model.solid(name), at(name)];
      if (solid && place && Math.hypot(solid.x - place.x, solid.y - place.y) > AWAY) inMetres.push(`<path class="fp-known" transform="${pose(solid)}" d="${outline(solid)}"/>`);
    }
    for (const name of unknown) {
      const p = view.toScreen(at(name).x, at(name).y);
      inPixels.push(`<g class="fp-question" transform="translate(${p.x.toFixed(1)} ${p.y.toFixed(1)})"><circle r="10"/><text y="4.5">?</text></g>`);
    }
    for (const name of found) {
      const place = put(name, "fp-found") && at(name);
      if (place) inPixels.push(this._ring(view, place, model.solid(name)));
    }
    if (target) put(target, "fp-target");
    if (ghost) inMetres.push(`<g transform="${pose(ghost.at)}"><path class="fp-ghost" d="${outline(ghost.form)}"/><path class="fp-ghost" d="M0 0H${(reach(ghost.form) * 0.8).toFixed(3)}"/></g>`);
    const chosen = selected ? model.solid(selected) : null;
    if (chosen && at(selected)) {
      if (reach(chosen) * view.scale < SMALL) inPixels.push(this._ring(view, at(selected), chosen, "fp-chosen-ring"));
      else put(selected, "fp-chosen");
      if (turnable) inPixels.push(this._handle(view, at(selected), chosen));
    }
    this._world.innerHTML = inMetres.join("");
    this._screen.innerHTML = inPixels.join("");
  }

  _ring(view, place, solid, cls = "fp-ring") {
    const p = view.toScreen(place.x, place.y);
    const r = Math.max(11, Math.min(reach(solid) * view.scale + 5, 400));
    return `<circle class="${cls}" cx="${p.x.toFixed(1)}" cy="${p.y.toFixed(1)}" r="${r.toFixed(1)}"/>`;
  }

  _handle(view, place, solid) {
    const [a, b] = [handleAt(view, place, solid, 0), handleAt(view, place, solid, HANDLE)];
    return (
      `<path class="fp-stem" d="M${a.x.toFixed(1)} ${a.y.toFixed(1)}L${b.x.toFixed(1)} ${b.y.toFixed(1)}"/>` +
      `<g class="fp-handle" data-handle="turn" transform="translate(${b.x.toFixed(1)} ${b.y.toFixed(1)})"><title>Drag to turn it</title>` +
      '<circle class="fp-grip" r="15"/><circle r="8"/><path d="M-3.2 1.5A3.6 3.6 0 1 1 1.5 3.2M1.5 3.2L4.6 2.1M1.5 3.2L2.2 .1"/></g>'
    );
  }
}

// The position of an object's turning handle: in front of it, at a distance from its edge.
function handleAt(view, place, solid, pixels) {
  const front = solid.form === "Box" ? solid.width / 2 : solid.form === "Polygon" ? Math.max(...solid.outline.map(([x]) => x)) : solid.radius;
  const out = Math.max(front * view.scale, 11) + pixels;
  const p = view.toScreen(place.x, place.y);
  return { x: p.x + Math.cos(place.turned) * out, y: p.y - Math.sin(place.turned) * out };
}
