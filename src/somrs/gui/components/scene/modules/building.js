// Floors, walls and doors. Walls may be cut for a view inside: the cut is dark, as in an architectural section.
import { Pieces, shade } from "./pieces.js";

export const CUT = 0.6; // m above its underside where a low wall ends

function cutTo(body, low) {
  return low ? Math.min(body.height, CUT) : body.height;
}

export function wall(pieces, body, low, capColor) {
  const height = cutTo(body, low);
  const window = body.window;
  const color = body.color;
  if (body.form === "Polygon") pieces.prism(body.outline, height, 0, color);
  else if (body.form === "Cylinder") pieces.cylinder(body.radius, height, 0, 0, height / 2, color);
  else pieces.box(body.width, body.depth, height, 0, 0, height / 2, color);
  if (window) return;
  // The cap also hides the seams between walls.
  if (body.form === "Polygon") pieces.prism(body.outline, 0.012, height, capColor);
  else if (body.form === "Cylinder") pieces.cylinder(body.radius, 0.012, 0, 0, height + 0.006, capColor);
  else pieces.box(body.width, body.depth, 0.012, 0, 0, height + 0.006, capColor);
}

export function door(pieces, body, low, capColor) {
  // The frame; `leaves.js` has the leaf.
  const { width: w, depth: d, color } = body;
  const height = cutTo(body, low);
  const alongY = d >= w;
  const length = alongY ? d : w;
  const thick = alongY ? w : d;
  const piece = (along, across, z, [a, c, tall], hex) => {
    if (alongY) pieces.box(c, a, tall, across, along, z, hex);
    else pieces.box(a, c, tall, along, across, z, hex);
  };
  const frame = shade(color, 0.6);
  for (const side of [-1, 1]) {
    piece(side * (length / 2 - 0.03), 0, height / 2, [0.06, thick + 0.04, height], frame);
    if (low) piece(side * (length / 2 - 0.03), 0, height + 0.006, [0.06, thick + 0.04, 0.012], capColor);
  }
  if (!low) piece(0, 0, height - 0.03, [length, thick + 0.04, 0.06], frame);
}

export function floor(pieces, body) {
  if (body.form === "Polygon") pieces.prism(body.outline, body.height, 0, body.color);
  else if (body.form === "Cylinder") pieces.cylinder(body.radius, body.height, 0, 0, body.height / 2, body.color, { sides: 48 });
  else pieces.box(body.width, body.depth, body.height, 0, 0, body.height / 2, body.color);
}

export function shell(bodies, low, colors) {
  // The building: { floors, walls, glass }, each as pieces.
  const made = { floors: new Pieces(), walls: new Pieces(), glass: new Pieces() };
  for (const body of bodies) {
    const into = body.kind === "floor" ? made.floors : body.window ? made.glass : made.walls;
    into.owner(body.name).frame(body.x, body.y, body.z, body.yaw);
    if (body.kind === "floor") floor(into, body);
    else if (body.kind === "door") door(into, body, low, colors.cap);
    else wall(into, body, low, colors.cap);
  }
  return made;
}
