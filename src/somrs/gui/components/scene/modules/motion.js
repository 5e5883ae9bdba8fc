// Interpolation between received poses: the picture shows the state of a tenth of a second ago. If poses arrive irregularly, the delay
// grows up to a limit, so that motion stays smooth.

const BEHIND = 0.1; // s
const MOST_BEHIND = 0.6;
const TICK = 0.05; // s between poses while something moves
const MOST = 12; // poses kept per object
const ANGLES = { 4: [3], 6: [3, 4, 5], 9: [3, 4, 7] };

export class Motion {
  constructor() {
    this.tracks = new Map();
    this.restart();
  }

  restart() {
    this.movers = [];
    this.moving = new Set();
    this.tracks.clear();
    this.offset = null;
    this.late = 0;
    this.behind = BEHIND;
    this.played = null;
  }

  set(movers) {
    // Change the set of moving objects. Those that stay keep their pose until the next frame.
    this.movers = movers.map(({ name, numbers }) => {
      const known = this.tracks.get(name);
      const track = known && known.numbers === numbers ? known : { name, numbers, poses: [], drawn: null };
      return track;
    });
    this.tracks = new Map(this.movers.map((track) => [track.name, track]));
    this.moving = new Set([...this.moving].filter((track) => this.tracks.get(track.name) === track));
  }

  hear(clock, which, values, now) {
    this.tune(now - clock);
    let at = 0;
    for (const i of which) {
      const track = this.movers[i];
      const pose = values.slice(at, at + track.numbers);
      at += track.numbers;
      this.add(track, clock, pose);
    }
  }

  add(track, clock, pose) {
    const poses = track.poses;
    const last = poses[poses.length - 1];
    if (last && clock - last.clock > 1.5 * TICK) {
      // It stood still until a tick ago: otherwise there would be a pose.
      poses.push({ clock: clock - TICK, pose: last.pose });
    }
    poses.push({ clock, pose });
    if (poses.length > MOST) poses.splice(0, poses.length - MOST);
    this.moving.add(track);
  }

  tune(offset) {
    // The offset between the clocks: the minimum seen, as larger values come from transmission delays.
    if (this.offset === null || Math.abs(offset - this.offset) > 5) this.offset = offset;
    else if (offset < this.offset) this.offset += 0.2 * (offset - this.offset);
    else this.offset += 0.002 * (offset - this.offset);
    this.late = Math.max(0.98 * this.late, offset - this.offset);
  }

  time(now) {
    // The time to draw, on the server's clock: it neither jumps nor goes back.
    const wanted = Math.min(Math.max(BEHIND, this.late + TICK), MOST_BEHIND);
    const passed = this.played === null ? Infinity : now - this.played;
    this.played = now;
    const change = wanted - this.behind;
    // Slow down to half speed at once; speed up slowly.
    this.behind += Math.max(Math.min(change, 0.5 * passed), -0.1 * passed);
    return now - this.offset - this.behind;
  }

  get active() {
    return this.moving.size > 0;
  }

  // Call `draw(name, numbers)` for all objects that moved since the last call.
  play(now, draw) {
    if (!this.moving.size) return;
    const clock = this.time(now);
    for (const track of this.moving) {
      const poses = track.poses;
      while (poses.length > 1 && poses[1].clock <= clock) poses.shift();
      const [from, to] = poses;
      if (!to) this.moving.delete(track);
      const share = to ? Math.min(1, Math.max(0, (clock - from.clock) / (to.clock - from.clock))) : 0;
      track.drawn = to ? between(from.pose, to.pose, share) : from.pose;
      draw(track.name, track.drawn);
    }
  }

  drawn(name) {
    return this.tracks.get(name)?.drawn ?? null;
  }
}

function between(from, to, share) {
  const pose = from.map((value, i) => value + share * (to[i] - value));
  for (const i of ANGLES[from.length] ?? []) pose[i] = from[i] + share * turn(to[i] - from[i]);
  return pose;
}

function turn(angle) {
  // The shorter way.
  return angle - 2 * Math.PI * Math.round(angle / (2 * Math.PI));
}
