// The kinds of things that a floor plan tells apart, by their types. The first that fits decides, so special ones come before general ones.
//
// layer: what is drawn on top of what. carries: whether things can be put on it, the best first. moves: `free` is dragged at once,
// `fixed` only when it was chosen before, `ground` never by the mouse, for whoever drags a floor wants to move the plan.
// label: how soon it gets its name when there is not room for all. from: with how many pixels across it gets one.
// solid: what is a part of it moves along with it.

const KINDS = [
  { id: "none", types: ["AbstractObject", "Ceiling"] },
  { id: "opening", types: ["Opening"], title: "Opening", layer: "walls", moves: "fixed", label: 5, from: 60 },
  { id: "charger", types: ["Charger"], title: "Place to charge", layer: "places", moves: "free", label: 60, from: 14, carries: 2 },
  { id: "place", types: ["Place"], title: "Place", layer: "places", moves: "free", label: 62, from: 12, carries: 2 },
  { id: "floor", types: ["Floor"], title: "Floor", layer: "floors", moves: "ground", label: 1, from: 1e9, carries: 1 },
  { id: "door", types: ["Door"], title: "Door", layer: "walls", moves: "fixed", label: 20, from: 40 },
  { id: "window", types: ["Window"], title: "Window", layer: "walls", moves: "fixed", label: 6, from: 80 },
  { id: "stairs", types: ["Stairs"], title: "Stairs", layer: "walls", moves: "fixed", label: 30, from: 40 },
  { id: "pillar", types: ["Pillar"], title: "Pillar", layer: "walls", moves: "fixed", label: 4, from: 80 },
  { id: "wall", types: ["Wall", "BuildingElement"], title: "Wall", layer: "walls", moves: "fixed", label: 3, from: 1600 },
  { id: "support", types: ["Support"], title: "Furniture to put things on", layer: "furniture", moves: "free", label: 50, from: 38, carries: 3 },
  { id: "chair", types: ["Chair"], title: "Chair", layer: "furniture", moves: "free", label: 30, from: 56 },
  { id: "plant", types: ["Plant"], title: "Plant", layer: "furniture", moves: "free", label: 30, from: 30 },
  { id: "camera", types: ["Camera"], title: "Camera, and what it sees", layer: "devices", moves: "free", label: 70, from: 0 },
  { id: "robot", types: ["MobileRobot"], title: "Robot, and where it looks", layer: "robots", moves: "free", label: 90, from: 0 },
  { id: "person", types: ["Person"], title: "Person", layer: "devices", moves: "free", label: 80, from: 0 },
  { id: "lift", types: ["Lift"], title: "Lift", layer: "walls", moves: "free", label: 70, from: 20 },
  { id: "arm", types: ["StationaryDevice"], title: "Device that stays, and its reach", layer: "furniture", moves: "free", label: 75, from: 0, carries: 3 },
  { id: "thing", types: ["Graspable"], title: "Thing to carry", layer: "things", moves: "free", label: 55, from: 3.2 },
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

// The layers from the ground up, by the sheets that they are drawn on: when a robot moves, the sheet with the walls need not be painted anew.
export const SHEETS = { ground: ["floors", "places", "walls", "furniture"], things: ["things"], movers: ["devices", "robots"] };
export const LAYERS = Object.values(SHEETS).flat();

// What the legend explains, in the order in which it does.
export const LEGEND = ["wall", "door", "window", "stairs", "support", "obstacle", "chair", "plant", "thing", "place", "charger", "robot", "camera", "arm", "lift", "person"];
