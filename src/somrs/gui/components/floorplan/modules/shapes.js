// The drawing of each kind as SVG text in the object's frame: metres, x to its front, y to its left. Kinds differ by form and pattern,
// never by colour alone.

const n = (value) => +value.toFixed(4);

export function outline(solid) {
  if (solid.form === "Box") {
    const [w, d] = [n(solid.width / 2), n(solid.depth / 2)];
    return `M${-w} ${-d}H${w}V${d}H${-w}Z`;
  }
  if (solid.form === "Polygon") return `M${solid.outline.map(([x, y]) => `${n(x)} ${n(y)}`).join("L")}Z`;
  return disc(solid.radius);
}

function disc(radius) {
  const r = n(Math.max(radius, 0.01));
  return `M${-r} 0A${r} ${r} 0 1 0 ${r} 0A${r} ${r} 0 1 0 ${-r} 0Z`;
}

// Half the side lengths of the drawing inside an outline.
function halves(solid) {
  if (solid.form === "Box") return [solid.width / 2, solid.depth / 2];
  const r = solid.form === "Polygon" ? Math.min(...solid.outline.map(([x, y]) => Math.hypot(x, y))) : solid.radius;
  return [r * 0.7, r * 0.7];
}

const body = (solid, more = "") => `<path class="fp-body${more}" d="${outline(solid)}"/>`;
const mark = (d, more = "") => `<path class="fp-mark${more}" d="${d}"/>`;
const HATCH = 0.35; // metres between the lines of a zone, as far as they are not too many
const AJAR = 0.02; // share from which a leaf is not drawn shut
const DOT = '<path class="fp-dot" d="M0 0h0"/>'; // constant size on the screen, so that small things stay visible

const DRAWN = {
  floor: (solid) => body(solid),
  wall: (solid) => body(solid),
  nogo: (solid) => hatched(solid, 1) + hatched(solid, -1) + body(solid),
  slow: (solid) => hatched(solid, 1) + body(solid, " fp-dashed"),
  opening: (solid) => body(solid, " fp-dashed"),
  pillar: (solid) => {
    const [w, d] = halves(solid);
    return body(solid) + mark(`M${n(-w)} ${n(-d)}L${n(w)} ${n(d)}M${n(-w)} ${n(d)}L${n(w)} ${n(-d)}`);
  },
  window: (solid) => body(solid) + along(solid, (length) => mark(`M0 ${n(-length / 2)}V${n(length / 2)}`)),
  door: (solid, { open: [open] }) =>
    body(solid, open > AJAR ? " fp-gap" : "") + along(solid, (length, thick) => (open > AJAR ? leaf(length, open) : bar(length, thick))),
  stairs: (solid) => {
    const [w, d] = halves(solid);
    const steps = Math.max(2, Math.round((2 * w) / 0.28));
    const lines = Array.from({ length: steps - 1 }, (_, i) => `M${n(-w + (2 * w * (i + 1)) / steps)} ${n(-d)}V${n(d)}`).join("");
    return body(solid) + mark(lines) + mark(`M${n(-w * 0.8)} 0H${n(w * 0.7)}M${n(w * 0.5)} ${n(d * 0.3)}L${n(w * 0.7)} 0L${n(w * 0.5)} ${n(-d * 0.3)}`, " fp-strong");
  },
  support: (solid) => {
    const [w, d] = halves(solid);
    const inset = Math.min(w, d) * 0.22;
    return body(solid) + mark(`M${n(w - inset)} ${n(-d + inset)}V${n(d - inset)}`, " fp-strong");
  },
  cupboard: (solid, { open }) => DRAWN.support(solid) + (solid.form === "Box" ? cupboardLeaves(solid, open) : ""),
  chair: (solid) => {
    const [w, d] = halves(solid);
    return body(solid) + mark(`M${n(-w * 0.62)} ${n(-d * 0.75)}V${n(d * 0.75)}`, " fp-strong");
  },
  plant: (solid) => {
    const r = Math.min(...halves(solid));
    const leaves = [0, 60, 120, 180, 240, 300].map((deg) => {
      const a = (deg * Math.PI) / 180;
      return `M0 0Q${n(r * Math.cos(a - 0.5))} ${n(r * Math.sin(a - 0.5))} ${n(r * Math.cos(a))} ${n(r * Math.sin(a))}`;
    });
    return body(solid) + mark(leaves.join(""));
  },
  obstacle: (solid) => {
    const [w, d] = halves(solid);
    return body(solid) + mark(`M${n(-w)} ${n(-d)}L${n(w)} ${n(d)}M${n(-w)} ${n(d)}L${n(w)} ${n(-d)}`);
  },
  thing: (solid) => DOT + body(solid),
  place: (solid) => {
    const r = Math.min(...halves(solid)) * 0.9;
    return body(solid, " fp-dashed") + mark(`M${n(-r * 0.35)} ${n(-r * 0.8)}V${n(r * 0.9)}L${n(r * 0.65)} ${n(r * 0.45)}L${n(-r * 0.35)} 0`, " fp-sign");
  },
  charger: (solid) => {
    const r = Math.min(...halves(solid)) * 0.9;
    return body(solid, " fp-dashed") + mark(`M${n(r * 0.15)} ${n(r)}L${n(-r * 0.45)} ${n(-r * 0.1)}H${n(r * 0.05)}L${n(-r * 0.15)} ${n(-r)}L${n(r * 0.45)} ${n(r * 0.1)}H${n(-r * 0.05)}Z`, " fp-sign fp-full");
  },
  waypoint: () => DOT,
  station: () => `${DOT}<path class="fp-body fp-dashed" d="M-.3 -.3H.3V.3H-.3Z"/>`,
  robot: (solid) => {
    const [w, d] = halves(solid);
    const front = solid.form === "Box" ? w : solid.radius ?? w;
    return DOT + body(solid) + mark(`M${n(front * 0.95)} 0L${n(-front * 0.35)} ${n(d * 0.85)}L${n(-front * 0.05)} 0L${n(-front * 0.35)} ${n(-d * 0.85)}Z`, " fp-full");
  },
  camera: (solid, { range, view }) => sight(range, view) + DOT + body(solid) + mark("M.05 0L.22 .11V-.11Z", " fp-full"),
  arm: (solid, { range }) => {
    const r = Math.min(...halves(solid)) * 0.5;
    return (range ? `<path class="fp-sight fp-dashed" d="${disc(range)}"/>` : "") + body(solid) + mark(`${disc(r)}M0 0L${n(r * 1.9)} 0`, " fp-strong");
  },
  lift: (solid) => {
    const [w, d] = halves(solid);
    return body(solid) + mark(`M${n(-w * 0.5)} ${n(d * 0.15)}L0 ${n(d * 0.6)}L${n(w * 0.5)} ${n(d * 0.15)}M${n(-w * 0.5)} ${n(-d * 0.15)}L0 ${n(-d * 0.6)}L${n(w * 0.5)} ${n(-d * 0.15)}`, " fp-strong");
  },
  person: () => `${DOT}<path class="fp-body" d="M-.12 .24A.14 .24 0 1 0 -.12 -.24A.14 .24 0 1 0 -.12 .24Z"/><path class="fp-mark fp-full" d="${disc(0.11)}"/>`,
};

// Lines across a zone, at 45 degrees in one direction, as far as they are in it.
function hatched(solid, direction) {
  const corners = cornersOf(solid);
  const heights = corners.map(([x, y]) => y - direction * x);
  const [low, high] = [Math.min(...heights), Math.max(...heights)];
  const step = Math.max(HATCH, (high - low) / 60);
  const lines = [];
  for (let height = low + step / 2; height < high; height += step) {
    const crossings = corners.flatMap(([x], i) => {
      const next = (i + 1) % corners.length;
      if (heights[i] > height === heights[next] > height) return [];
      return [x + ((height - heights[i]) / (heights[next] - heights[i])) * (corners[next][0] - x)];
    });
    crossings.sort((a, b) => a - b);
    for (let i = 0; i + 1 < crossings.length; i += 2) {
      const [from, to] = [crossings[i], crossings[i + 1]];
      lines.push(`M${n(from)} ${n(height + direction * from)}L${n(to)} ${n(height + direction * to)}`);
    }
  }
  return mark(lines.join(""));
}

function cornersOf(solid) {
  if (solid.form === "Polygon") return solid.outline;
  const [w, d] = [(solid.width ?? 0) / 2, (solid.depth ?? 0) / 2];
  if (solid.form === "Box") return [[-w, -d], [w, -d], [w, d], [-w, d]];
  return Array.from({ length: 24 }, (_, i) => [solid.radius * Math.cos((i * Math.PI) / 12), solid.radius * Math.sin((i * Math.PI) / 12)]);
}

// Draw along the longer side of a box: `draw(length, thickness)` in a frame whose y axis runs along it.
function along(solid, draw) {
  const [w, d] = solid.form === "Box" ? [solid.width, solid.depth] : [0.1, 2 * (solid.radius ?? 0.4)];
  return w > d ? `<g transform="rotate(90)">${draw(w, d)}</g>` : draw(d, w);
}

// A door that is open to a share of a quarter turn, with the arc of its edge; a wide one has two leaves.
function leaf(length, open) {
  if (length > 1.6) return swung(-length / 2, length / 2, 1, open) + swung(length / 2, length / 2, -1, open);
  return swung(-length / 2, length, 1, open);
}

// A leaf of this width, hinged at a point of the y axis; when it is shut, it points along the axis in this direction.
function swung(hinge, width, direction, open) {
  const [x, y] = [width * Math.sin((open * Math.PI) / 2), hinge + direction * width * Math.cos((open * Math.PI) / 2)];
  const arc = `M${n(x)} ${n(y)}A${n(width)} ${n(width)} 0 0 ${direction > 0 ? 1 : 0} 0 ${n(hinge + direction * width)}`;
  return mark(`M0 ${n(hinge)}L${n(x)} ${n(y)}`, " fp-strong") + mark(arc);
}

const LARGEST_LEAF = 0.7; // m; a wider cupboard has two leaves

// The leaves of a cupboard that are not shut, hinged at the ends of its front.
function cupboardLeaves(solid, open) {
  const sides = solid.depth <= LARGEST_LEAF ? [-1] : [-1, 1];
  const wide = solid.depth / sides.length;
  const leaves = sides.map((side, i) => ((open[i] ?? open[0]) > AJAR ? swung((side * solid.depth) / 2, wide, -side, open[i] ?? open[0]) : ""));
  return leaves.some(Boolean) ? `<g transform="translate(${n(solid.width / 2)} 0)">${leaves.join("")}</g>` : "";
}

function bar(length, thick) {
  const [h, t] = [n(length / 2), n(Math.max(thick, 0.1))];
  return mark(`M0 ${-h}V${h}`, " fp-strong") + mark(`M${-t} ${-h}H${t}M${-t} ${h}H${t}`);
}

function sight(range, view) {
  if (!range || !view) return "";
  if (view >= 2 * Math.PI - 0.01) return `<path class="fp-sight" d="${disc(range)}"/>`;
  const [x, y] = [n(range * Math.cos(view / 2)), n(range * Math.sin(view / 2))];
  return `<path class="fp-sight" d="M0 0L${x} ${-y}A${n(range)} ${n(range)} 0 ${view > Math.PI ? 1 : 0} 1 ${x} ${y}Z"/>`;
}

// The drawing of an object. The same text means that no redraw is needed.
export function look(kind, solid, seen) {
  const classes = [`fp-object fp-${kind.id}`];
  if (seen.color) classes.push(`fp-c-${seen.color.toLowerCase()}`);
  if (seen.unknown) classes.push("fp-unknown");
  if (seen.broken) classes.push("fp-broken");
  return { classes: classes.join(" "), content: DRAWN[kind.id](solid, seen) };
}

export function pose(at) {
  return `translate(${n(at.x)} ${n(at.y)}) rotate(${n((at.turned * 180) / Math.PI)})`;
}

const SAMPLES = {
  wall: { form: "Box", width: 1, depth: 0.22 },
  door: { form: "Box", width: 0.1, depth: 0.8 },
  window: { form: "Box", width: 0.2, depth: 1 },
  stairs: { form: "Box", width: 1, depth: 0.6 },
  support: { form: "Box", width: 0.6, depth: 0.9 },
  cupboard: { form: "Box", width: 0.5, depth: 0.6 },
  obstacle: { form: "Box", width: 0.7, depth: 0.7 },
  chair: { form: "Box", width: 0.6, depth: 0.6 },
  plant: { form: "Cylinder", radius: 0.4 },
  thing: { form: "Cylinder", radius: 0.14 },
  robot: { form: "Cylinder", radius: 0.42 },
  arm: { form: "Box", width: 0.6, depth: 0.6 },
  camera: { form: "Box", width: 0.16, depth: 0.12 },
  lift: { form: "Box", width: 0.9, depth: 0.9 },
  person: {},
  nogo: { form: "Box", width: 1, depth: 0.8 },
  slow: { form: "Box", width: 1, depth: 0.8 },
  place: { form: "Cylinder", radius: 0.45 },
  charger: { form: "Cylinder", radius: 0.45 },
};

// A symbol of the kind for the legend, one metre wide.
export function sample(kind, more = {}) {
  const shown = look(kind, more.unknown ? SAMPLES.place : SAMPLES[kind.id], { open: [1], range: kind.id === "camera" ? 0.5 : 0, view: 1.2, ...more });
  const moved = { door: "translate(-.4 0)", cupboard: "translate(-.3 0)", camera: "translate(-.25 0)" }[kind.id] ?? "";
  return `<svg viewBox="-.6 -.6 1.2 1.2" aria-hidden="true"><g transform="scale(1 -1) ${moved}" class="${shown.classes}">${shown.content}</g></svg>`;
}
