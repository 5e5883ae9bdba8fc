// Layout of a directed acyclic graph: layers along the edges, each ordered to reduce crossings, and every node as near to its neighbours as
// possible. An edge over several layers has a bend in each layer between.

const BEND = 12; // pixels for an edge that passes through a layer
const SWEEPS = 8;

// `nodes`: [{id, width, height}]; `edges`: [{from, to}]. Returns the centre of each node by id, the points of each edge, and the total
// size. `right`: layers side by side instead of one below the other.
export function layered(nodes, edges, { gap = 26, rise = 44, right = false } = {}) {
  const sized = (node) => (right ? { breadth: node.height, depth: node.width } : { breadth: node.width, depth: node.height });
  const cells = new Map(nodes.map((node) => [node.id, { id: node.id, ...sized(node), before: [], after: [], at: 0 }]));
  const known = edges.filter((edge) => cells.has(edge.from) && cells.has(edge.to) && edge.from !== edge.to);
  const level = levels([...cells.keys()], known);
  const layers = [];
  for (const [id, cell] of cells) (layers[level.get(id)] ??= []).push(cell);
  const chains = known.map((edge) => chained(cells.get(edge.from), cells.get(edge.to), level, layers));
  ordered(layers);
  settled(layers, gap);
  return measured(layers, chains, known, rise, right);
}

// The layer of each node: after all its predecessors; a source just before its first successor.
function levels(ids, edges) {
  const level = new Map(ids.map((id) => [id, 0]));
  const following = new Map(ids.map((id) => [id, []]));
  const open = new Map(ids.map((id) => [id, 0]));
  for (const edge of edges) {
    following.get(edge.from).push(edge.to);
    open.set(edge.to, open.get(edge.to) + 1);
  }
  const firsts = ids.filter((id) => open.get(id) === 0);
  const ready = [...firsts];
  for (let id = ready.pop(); id !== undefined; id = ready.pop())
    for (const next of following.get(id)) {
      level.set(next, Math.max(level.get(next), level.get(id) + 1));
      open.set(next, open.get(next) - 1);
      if (open.get(next) === 0) ready.push(next);
    }
  for (const id of firsts) if (following.get(id).length) level.set(id, Math.min(...following.get(id).map((next) => level.get(next))) - 1);
  return level;
}

// The cells of an edge from the first to the last, linked as neighbours.
function chained(from, to, level, layers) {
  const chain = [from];
  for (let at = level.get(from.id) + 1; at < level.get(to.id); at++) {
    const bend = { id: null, breadth: BEND, depth: 0, before: [], after: [], at: 0 };
    layers[at].push(bend);
    chain.push(bend);
  }
  chain.push(to);
  for (let at = 1; at < chain.length; at++) {
    chain[at - 1].after.push(chain[at]);
    chain[at].before.push(chain[at - 1]);
  }
  return chain;
}

const mean = (cells, key) => cells.reduce((sum, cell) => sum + cell[key], 0) / cells.length;

// Each layer in the order of the mean positions of its neighbours, down and up until it is good enough.
function ordered(layers) {
  const number = (layer) => layer.forEach((cell, place) => (cell.place = place));
  layers.forEach(number);
  let best = null;
  for (let sweep = 0; sweep < SWEEPS; sweep++) {
    const down = sweep % 2 === 0;
    for (const layer of down ? layers : [...layers].reverse()) {
      for (const cell of layer) {
        const near = down ? cell.before : cell.after;
        cell.preferred = near.length ? mean(near, "place") : cell.place;
      }
      layer.sort((one, other) => one.preferred - other.preferred || one.place - other.place);
      number(layer);
    }
    const crossing = crossings(layers);
    if (best === null || crossing < best.crossing) best = { crossing, order: layers.map((layer) => [...layer]) };
    if (crossing === 0) break;
  }
  best?.order.forEach((order, index) => {
    layers[index].splice(0, order.length, ...order);
    number(order);
  });
}

function crossings(layers) {
  let found = 0;
  for (const layer of layers) {
    const ends = layer.flatMap((cell) => cell.after.map((next) => next.place).sort((one, other) => one - other));
    if (ends.length > 400) return found; // no order makes a picture of so many edges readable
    for (let one = 0; one < ends.length; one++) for (let other = one + 1; other < ends.length; other++) if (ends[one] > ends[other]) found++;
  }
  return found;
}

// Positions across the layers: as near to the neighbours as possible without overlaps.
function settled(layers, gap) {
  for (const layer of layers) pooled(layer, layer.map(() => 0), gap);
  for (let sweep = 0; sweep < SWEEPS; sweep++) {
    const down = sweep % 2 === 1;
    for (const layer of down ? layers : [...layers].reverse()) {
      const preferences = layer.map((cell) => {
        const near = down ? cell.before : cell.after;
        return near.length ? mean(near, "at") : cell.at;
      });
      pooled(layer, preferences, gap);
    }
  }
}

// The positions nearest to the preferred ones, by least squares, that keep order and distances: overlapping neighbours move as one block
// ("pool adjacent violators").
function pooled(layer, preferences, gap) {
  let offset = 0;
  const offsets = layer.map((cell, index) => {
    if (index > 0) offset += (layer[index - 1].breadth + cell.breadth) / 2 + gap;
    return offset;
  });
  const blocks = [];
  preferences.forEach((preferred, index) => {
    let block = { sum: preferred - offsets[index], count: 1 };
    while (blocks.length && blocks.at(-1).sum / blocks.at(-1).count > block.sum / block.count) {
      const last = blocks.pop();
      block = { sum: last.sum + block.sum, count: last.count + block.count };
    }
    blocks.push(block);
  });
  let index = 0;
  for (const block of blocks)
    for (let member = 0; member < block.count; member++, index++) layer[index].at = block.sum / block.count + offsets[index];
}

function measured(layers, chains, edges, rise, right) {
  const all = layers.flat();
  if (!all.length) return { places: new Map(), paths: [], width: 0, height: 0 };
  const low = Math.min(...all.map((cell) => cell.at - cell.breadth / 2));
  const breadth = Math.max(...all.map((cell) => cell.at + cell.breadth / 2)) - low;
  const tops = [];
  let depth = 0;
  for (const layer of layers) {
    const deep = Math.max(...layer.map((cell) => cell.depth));
    tops.push({ top: depth, deep });
    depth += deep + rise;
  }
  depth -= rise;
  layers.forEach((layer, index) => layer.forEach((cell) => Object.assign(cell, tops[index])));
  const point = (across, along) => (right ? [along, across - low] : [across - low, along]);
  const places = new Map(all.filter((cell) => cell.id !== null).map((cell) => [cell.id, point(cell.at, cell.top + cell.deep / 2)]));
  const paths = chains.map((chain, index) => {
    const points = chain.flatMap((cell) => {
      const [first, last] = cell.id === null ? [cell.top, cell.top + cell.deep] : [cell.top + (cell.deep - cell.depth) / 2, cell.top + (cell.deep + cell.depth) / 2];
      return [point(cell.at, first), point(cell.at, last)];
    });
    return { ...edges[index], points: points.slice(1, -1) };
  });
  return { places, paths, width: right ? depth : breadth, height: right ? breadth : depth };
}

// A path through the points that leaves and reaches them in the edges' direction.
export function curve(points, right = false) {
  let drawn = `M${points[0].map(round).join(" ")}`;
  for (let index = 1; index < points.length; index++) {
    const [x1, y1] = points[index - 1];
    const [x2, y2] = points[index];
    const bend = right ? [(x1 + x2) / 2, y1, (x1 + x2) / 2, y2] : [x1, (y1 + y2) / 2, x2, (y1 + y2) / 2];
    drawn += ` C${[...bend, x2, y2].map(round).join(" ")}`;
  }
  return drawn;
}

const round = (number) => Math.round(number * 10) / 10;
