// The scene as text, for screen readers and for search by name.
import { faultText } from "./labels.js";

const DOING = {
  DriveTo: "drives",
  Approach: "approaches something",
  Grip: "takes something",
  Place: "puts something down",
  PutDown: "puts something down",
  Sense: "looks",
  LookAt: "looks",
  LookAround: "looks around",
  Stop: "stops",
};
const RELATIONS = { isOn: "on", isIn: "in", isHeldBy: "held by" };

function holder(world, name) {
  for (const [robot, work] of world.works) if (work.holding === name) return robot;
  return null;
}

function where(world, body) {
  const { x, y, z } = world.where(body.name);
  const room = world.room(x, y, z);
  return `at ${x.toFixed(1)}, ${y.toFixed(1)}${room ? ` in ${room}` : ""}`;
}

export function described(world, name) {
  // Describe an object in one sentence without its name.
  const body = world.bodies.get(name);
  if (!body) return "";
  if (body.unknown) return "position unknown; shown at its last known position";
  const parts = [];
  const work = world.works.get(name);
  const by = holder(world, name);
  if (by) parts.push(`held by ${by}`);
  else if (body.kind === "thing" && body.at) parts.push(`${RELATIONS[body.at.relation]} ${body.at.object}`);
  else parts.push(where(world, body));
  if (work?.holding) parts.push(`carries ${work.holding}`);
  if (work?.doing) parts.push(DOING[work.doing] ?? work.doing);
  const faults = faultText(work);
  if (faults) parts.push(faults);
  return parts.join("; ");
}

export function summary(title, world) {
  // Describe the picture in one sentence.
  const count = (kind, one, many) => {
    const found = [...world.bodies.values()].filter((body) => body.kind === kind).length;
    return found ? `${found} ${found === 1 ? one : many}` : null;
  };
  const what = [count("robot", "robot", "robots"), count("thing", "thing", "things"), count("furniture", "piece of furniture", "pieces of furniture")];
  const busy = [...world.works].filter(([, work]) => work.holding || work.faults?.length);
  const told = busy.slice(0, 6).map(([name]) => `${name}: ${described(world, name)}.`);
  return [`3D view of ${title}: ${what.filter(Boolean).join(", ") || "nothing to see"}.`, ...told].join(" ");
}

export function listed(world, wanted, most) {
  // Robots and things whose name contains the text, with their descriptions.
  const order = { robot: 0, thing: 1, camera: 2, place: 3, furniture: 4 };
  const text = wanted.trim().toLowerCase();
  const found = [...world.bodies.values()].filter(
    (body) => body.kind in order && (text ? `${body.name} ${body.label ?? ""} ${body.type}`.toLowerCase().includes(text) : order[body.kind] < 2),
  );
  found.sort((a, b) => order[a.kind] - order[b.kind] || a.name.localeCompare(b.name, "en", { numeric: true }));
  return { rows: found.slice(0, most).map((body) => ({ name: body.name, type: body.type, words: described(world, body.name) })), more: Math.max(0, found.length - most) };
}
