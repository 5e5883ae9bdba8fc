// The kinds of objects on a floor plan, by type. The first match decides, so special kinds come before general ones.
//
// layer: drawing order. carries: whether things can be put on it, by preference. moves: `free` objects can be dragged at once,
// `fixed` ones only when selected, those that move `itself` never on the map, `ground` never by mouse, since dragging a floor pans the plan.
// label: priority of its label. from: size in pixels from which it has a label.
// solid: its parts move with it. cornered: its corners can be dragged.

const KINDS = [
  { id: "none", types: ["AbstractObject", "Ceiling", "FurnitureLeg", "TableTop"] },
  { id: "opening", types: ["Opening"], title: "Opening", layer: "walls", moves: "fixed", label: 5, from: 60 },
  { id: "charger", types: ["Charger"], title: "Charging place", layer: "places", moves: "free", label: 60, from: 14, carries: 2 },
  { id: "nogo", types: ["NoGoZone"], title: "No-go zone: robots do not enter it", layer: "zones", moves: "fixed", label: 61, from: 24, cornered: true },
  { id: "slow", types: ["SlowZone", "Zone"], title: "Slow zone", layer: "zones", moves: "fixed", label: 61, from: 24, cornered: true },
  { id: "place", types: ["Place"], title: "Place", layer: "places", moves: "free", label: 62, from: 12, carries: 2 },
  { id: "waypoint", types: ["Waypoint"], title: "Waypoint of lanes", layer: "places", moves: "fixed", label: 2, from: 1e9 },
  { id: "station", types: ["Station"], title: "Where robots load and unload", layer: "places", moves: "free", label: 58, from: 0 },
  { id: "floor", types: ["Floor"], title: "Floor", layer: "floors", moves: "ground", label: 1, from: 1e9, carries: 1 },
  { id: "door", types: ["Door"], title: "Door", layer: "walls", moves: "fixed", label: 20, from: 40 },
  { id: "window", types: ["Window"], title: "Window", layer: "walls", moves: "fixed", label: 6, from: 80 },
  { id: "stairs", types: ["Stairs"], title: "Stairs", layer: "walls", moves: "fixed", label: 30, from: 40 },
  { id: "pillar", types: ["Pillar"], title: "Pillar", layer: "walls", moves: "fixed", label: 4, from: 80 },
  { id: "wall", types: ["Wall", "BuildingElement"], title: "Wall", layer: "walls", moves: "fixed", label: 3, from: 1600 },
  { id: "cupboard", types: ["Cupboard"], title: "Cupboard, open", layer: "furniture", moves: "free", label: 50, from: 38, carries: 3 },
  { id: "support", types: ["Support"], title: "Furniture to put things on", layer: "furniture", moves: "free", label: 50, from: 38, carries: 3 },
  { id: "chair", types: ["Chair"], title: "Chair", layer: "furniture", moves: "free", label: 30, from: 56 },
  { id: "plant", types: ["Plant"], title: "Plant", layer: "furniture", moves: "free", label: 30, from: 30 },
  { id: "camera", types: ["Camera"], title: "Camera and its field of view", layer: "devices", moves: "free", label: 70, from: 0 },
  { id: "robot", types: ["MobileRobot"], title: "Robot and its heading", layer: "robots", moves: "itself", label: 90, from: 0 },
  { id: "person", types: ["Person"], title: "Person", layer: "devices", moves: "free", label: 80, from: 0 },
  { id: "lift", types: ["Lift"], title: "Lift", layer: "walls", moves: "free", label: 70, from: 20 },
  { id: "arm", types: ["StationaryDevice"], title: "Stationary device and its reach", layer: "furniture", moves: "free", label: 75, from: 0, carries: 3 },
  { id: "thing", types: ["Graspable"], title: "Graspable thing", layer: "things", moves: "free", label: 55, from: 3.2 },
  { id: "obstacle", types: ["PhysicalObject"], title: "Other furniture", layer: "furniture", moves: "free", label: 40, from: 44 },
];

const UNKNOWN_TYPE = { id: "obstacle", title: "Other", layer: "furniture", moves: "free", label: 10, from: 30, solid: true };

for (const kind of KINDS) {
  kind.solid = kind.id !== "none";
  Object.freeze(kind);
}

export function kindOf(isA) {
  return KINDS.find((kind) => kind.types.some(isA)) ?? UNKNOWN_TYPE;
}

export function kindById(id) {
  return KINDS.find((kind) => kind.id === id);
}

// Layers from bottom to top, by sheet: when a robot moves, the sheet with the walls is not repainted.
export const SHEETS = { ground: ["floors", "zones", "places", "walls", "furniture"], things: ["things"], movers: ["devices", "robots"] };
export const LAYERS = Object.values(SHEETS).flat();

// The legend's rows, in order.
export const LEGEND = ["wall", "door", "window", "stairs", "support", "cupboard", "obstacle", "chair", "plant", "thing", "place", "charger", "waypoint", "station", "nogo", "slow", "robot", "camera", "arm", "lift", "person"];
