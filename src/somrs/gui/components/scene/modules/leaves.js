// The leaves of doors and cupboards, which move on their own. Their motion follows the simulator (leaves.py): the leaf of a door slides into
// its wall, those of a cupboard swing out by a quarter turn. A share of 0 is shut, 1 is open.
import { CUT } from "./building.js";
import { METAL } from "./forms.js";
import { Pieces, shade } from "./pieces.js";

const LARGEST_LEAF = 0.7; // m; a wider cupboard has two leaves
const STRIP = 0.14; // m of the leaf of an open door that stay in the doorway, with its handles

export function leavesOf(body, isCupboard, low) {
  // Each leaf as { pieces, place }: its pieces in its own frame, and where that is in the body's frame: place(share) is { x, y, yaw }.
  if (body.kind === "door") return [sliding(body, low)];
  return isCupboard && body.form === "Box" ? hinged(body) : [];
}

function sliding({ width: w, depth: d, height, color }, low) {
  const tall = (low ? Math.min(height, CUT) : height) - (low ? 0.02 : 0.08);
  const length = Math.max(w, d);
  const thick = Math.min(w, d);
  const handle = Math.min(1.0, tall - 0.08);
  const pieces = new Pieces();
  pieces.box(length - 0.12, 0.045, tall, 0, 0, tall / 2 + 0.01, color);
  for (const side of [-1, 1]) pieces.box(0.016, 0.016, 0.12, length / 2 - 0.084, side * (thick / 2 + 0.045), handle, "#8b9097");
  const yaw = d >= w ? Math.PI / 2 : 0;
  const place = (share) => {
    const shift = share * (STRIP - length);
    return { x: d >= w ? 0 : shift, y: d >= w ? shift : 0, yaw };
  };
  return { pieces, place };
}

function hinged({ width: w, depth: d, height: h, color }) {
  const plinth = Math.min(0.06, h / 6);
  const tall = h - plinth - Math.min(0.03, h / 6);
  const thick = 0.02;
  const sides = d <= LARGEST_LEAF ? [-1] : [-1, 1];
  const wide = d / sides.length;
  return sides.map((side) => {
    const pieces = new Pieces();
    pieces.box(wide - 0.01, thick, tall - 0.01, wide / 2, 0, plinth + tall / 2, shade(color, 1.1));
    pieces.box(0.016, 0.016, 0.12, wide - 0.05, side * 0.055, Math.min(0.65 * h, 0.95), METAL);
    return { pieces, place: (share) => ({ x: w / 2 - thick / 2, y: (side * d) / 2, yaw: (-side * (1 - share) * Math.PI) / 2 }) };
  });
}
