// User actions on a floor plan: select, move, turn, nudge, place, shape a zone. These methods of the element report changes to the page, which changes
// the map.

import { Sketch } from "./sketch.js";

const SETTLE = 450; // milliseconds after the last key before a nudge is reported
const TURNS = Math.PI / 12; // step of the turning handle

export const doings = {
  choose(name) {
    if (name !== (this.asked.at(-1) ?? this.selected ?? null)) {
      this.asked.push(name);
      this.$emit("select", { name });
    }
    this.plan.selected = name;
    this.plan.draw();
    this.say(name === null ? "Nothing is selected." : this.told(name));
  },
  told(name) {
    const { model } = this.plan;
    const object = model.objects.get(name);
    if (!object) return `${name} is not on the map.`;
    const [on, at] = [model.under(name), this.plan.at(name)];
    return `${name}, ${object.type}${on ? `, on ${on}` : ""}${at ? `, x ${at.x.toFixed(2)} m, y ${at.y.toFixed(2)} m` : ""}`;
  },
  deeds() {
    const { plan } = this;
    const map = (at) => plan.view.toMap(at.x, at.y);
    return {
      draggable: (name) => this.draggable(name),
      hover: (at, name) => this.hover(at && map(at), name),
      click: (name, at, { below, handle }) => this.click(below ? this.below(at) : name, map(at), handle),
      take: (name, at) => this.take(name, map(at)),
      drag: (at, free) => this.drag(map(at), free),
      grasp: () => this.take(this.plan.selected, null),
      turn: (at, free) => this.turn(map(at), free),
      graspCorner: (index) => this.graspCorner(index),
      dragCorner: (at, free) => this.dragCorner(map(at), free),
      chooseCorner: (index) => this.chooseCorner(index),
      nextCorner: (step) => this.nextCorner(step),
      release: (at) => this.release(map(at)),
      cancel: () => this.cancel(),
      pan: (dx, dy) => { plan.view.pan(dx, dy); plan.draw(); },
      zoom: (factor, at) => { plan.view.zoom(factor, at?.x, at?.y); plan.draw(); },
      fit: () => plan.fit(),
      nudge: (dx, dy, turn) => this.nudge(dx, dy, turn),
      next: (step) => this.next(step),
      enter: () => { if (this.plan.sketch) this.finishZone(); else if (this.placing) this.click(null, plan.ghost.at); else if (plan.selected) this.$emit(this.mode === "pick" ? "picked" : "open", { name: plan.selected }); },
      open: () => { if (plan.selected && this.mode !== "pick") this.$emit("open", { name: plan.selected }); },
      remove: () => { if (plan.selected && this.doing === "edit") this.$emit("remove", { name: plan.selected }); },
      undo: () => { if (this.doing === "edit") this.$emit("undo", {}); },
      escape: () => this.escape(),
    };
  },
  draggable(name) {
    const kind = this.plan.model.kind(name);
    if (!kind || this.placing || this.plan.sketch) return false;
    if (this.doing === "pick") return kind.id === "thing" || kind.id === "robot";
    return this.doing === "edit" && (kind.moves === "free" || (kind.moves === "fixed" && name === this.plan.selected));
  },
  hover(at, name) {
    const type = this.plan.model.objects.get(name)?.type;
    const what = type && this.plan.model.kind(name).moves !== "ground" ? `${name}, ${type} · ` : "";
    this.where = at ? `${what}x ${at.x.toFixed(2)} m, y ${at.y.toFixed(2)} m` : "";
    if (this.placing && at) this.tryAt(at);
    if (this.plan.sketch) {
      this.plan.sketch.pointer = at && this.snapped(at);
      this.plan.draw();
    }
  },
  // Show the new object at its position.
  tryAt({ x, y }) {
    const { plan } = this;
    plan.ghost = { at: { ...this.snapped({ x, y }), turned: this.turned }, form: plan.model.formOfType(this.placing, this.values) };
    plan.target = plan.model.targetAt(plan.ghost.at.x, plan.ghost.at.y, plan.storey);
    plan.draw();
  },
  below(at) {
    const box = this.$refs.pad.getBoundingClientRect();
    const names = this.$refs.pad.shadowRoot.elementsFromPoint(box.left + at.x, box.top + at.y).map((one) => one.closest("[data-name]")?.dataset.name).filter((one) => one);
    const distinct = [...new Set(names)];
    return distinct[(distinct.indexOf(this.plan.selected) + 1) % distinct.length] ?? null;
  },
  click(name, at, handle) {
    if (this.plan.sketch) this.corner(this.snapped(at));
    else if (this.placing) {
      const spot = this.snapped(at);
      this.$emit("placed", { type: this.placing, ...spot, turned: this.turned, target: this.plan.model.targetAt(spot.x, spot.y, this.plan.storey), storey: this.plan.storey });
      this.stopPlacing();
    } else if (!handle) {
      this.choose(name);
      if (this.doing === "pick") this.$emit("picked", { name, x: at.x, y: at.y, target: this.plan.model.targetAt(at.x, at.y, this.plan.storey) });
    }
  },
  take(name, at) {
    this.flush();
    if (this.plan.selected !== name) this.choose(name);
    const from = { ...this.plan.at(name) };
    this.carrying = { name, from, grip: at && { x: at.x - from.x, y: at.y - from.y }, version: this.plan.model.version, thing: this.plan.model.kind(name).id === "thing" };
  },
  drag(at, free) {
    const { carrying, plan } = this;
    if (!carrying) return;
    const raw = { x: at.x - carrying.grip.x, y: at.y - carrying.grip.y };
    const to = { ...this.snapped(raw, free), turned: carrying.from.turned };
    const except = new Set([carrying.name, ...plan.model.riders(carrying.name)]);
    plan.target = carrying.thing || this.doing === "pick" ? plan.model.targetAt(to.x, to.y, plan.storey, except) : null;
    this.where = `x ${to.x.toFixed(2)} m, y ${to.y.toFixed(2)} m${plan.target ? `, on ${plan.target}` : ""}`;
    carrying.to = to;
    carrying.target = plan.target;
    if (this.doing === "pick") {
      plan.ghost = { at: to, form: plan.model.form(carrying.name) };
      plan.arrows = [{ from: carrying.from, to }];
      plan.draw();
    } else plan.hold(carrying.name, to);
  },
  turn(at, free) {
    const { carrying, plan } = this;
    if (!carrying) return;
    const { from } = carrying;
    const angle = Math.atan2(at.y - from.y, at.x - from.x);
    carrying.to = { x: from.x, y: from.y, turned: free ? angle : Math.round(angle / TURNS) * TURNS };
    this.where = `turned ${Math.round((carrying.to.turned * 180) / Math.PI)}°`;
    plan.hold(carrying.name, carrying.to);
  },
  release() {
    const { carrying, plan } = this;
    const target = carrying?.target ?? null;
    this.carrying = false;
    plan.target = null;
    if (carrying?.corners) return this.tellShaped(carrying.name, carrying.corners, carrying.version);
    if (!carrying?.to) return this.cancel();
    if (this.doing === "pick") {
      plan.ghost = null;
      this.look();
      this.$emit("dropped", { thing: carrying.name, target, x: carrying.to.x, y: carrying.to.y });
    } else this.tellMoved(carrying.name, carrying.to, target, carrying.version);
  },
  tellMoved(name, to, target, version) {
    const turned = Math.atan2(Math.sin(to.turned), Math.cos(to.turned));
    this.$emit("moved", { name, x: +to.x.toFixed(4), y: +to.y.toFixed(4), turned: +turned.toFixed(6), target, version });
    this.wait(name);
  },
  // The page has been told of a move. If the connection is lost now, the page may not have heard of it; what it is told without a
  // connection is kept until there is one.
  wait(name) {
    if (!this.connection) {
      this.connection = globalThis.socket; // which is there when the page is
      this.connection?.on("disconnect", this.giveUp);
    }
    this.plan.wait(name);
    this.plan.draw();
  },
  cancel() {
    const { carrying, plan } = this;
    this.carrying = false;
    plan.target = plan.ghost = null;
    if (carrying && this.mode !== "pick") plan.giveBack(carrying.name, carrying);
    this.look();
  },
  nudge(dx, dy, turn) {
    const { plan } = this;
    const name = plan.selected;
    if (this.placing) {
      this.turned += turn;
      const { x, y } = plan.ghost.at;
      this.tryAt({ x: x + dx, y: y + dy });
      plan.view.reveal(x + dx, y + dy);
      return true;
    }
    if (this.doing !== "edit" || !name || !plan.at(name)) return false;
    if (plan.model.kind(name)?.moves === "itself") { this.say(`${name} is where it is; send it to a place on the Fleet page.`); return true; }
    if (!turn && plan.corners.chosen(name) !== null) return this.nudgeCorner(name, dx, dy);
    if (this.nudged?.name !== name || this.nudged.corners) this.beginNudge(name);
    const at = plan.at(name);
    this.nudged.to = { x: at.x + dx, y: at.y + dy, turned: at.turned + turn };
    plan.hold(name, this.nudged.to);
    this.settleNudge(at);
    return true;
  },
  beginNudge(name) {
    this.flush();
    this.nudged = { name, version: this.plan.model.version };
  },
  // Report the nudge once no other one follows.
  settleNudge({ x, y }) {
    this.plan.view.reveal(x, y, 20);
    clearTimeout(this.nudging);
    this.nudging = setTimeout(() => this.flush(), SETTLE);
  },
  flush() {
    clearTimeout(this.nudging);
    const { nudged, plan } = this;
    this.nudged = null;
    if (!nudged) return;
    const { name, to } = nudged;
    if (nudged.corners) return this.tellShaped(name, nudged.corners, nudged.version);
    const thing = plan.model.kind(name)?.id === "thing";
    const target = thing ? plan.model.targetAt(to.x, to.y, plan.storey, new Set([name, ...plan.model.riders(name)])) : null;
    this.tellMoved(name, to, target, nudged.version);
    this.say(this.told(name));
  },
  // The corners of the selected zone
  graspCorner(index) {
    const name = this.plan.selected;
    this.flush();
    this.chooseCorner(index);
    this.carrying = { name, corner: index, outline: this.plan.corners.of(name), version: this.plan.model.version };
  },
  dragCorner(at, free) {
    const { carrying, plan } = this;
    if (!carrying) return;
    const { x, y } = this.snapped(at, free);
    carrying.corners = plan.moveCorner(carrying.name, carrying.corner, [x, y]);
    this.where = `corner ${carrying.corner + 1}: x ${x.toFixed(2)} m, y ${y.toFixed(2)} m`;
  },
  chooseCorner(index) {
    const { plan } = this;
    plan.corners.choose(plan.selected, index);
    plan.draw();
    this.sayCorner();
  },
  nextCorner(step) {
    const { plan } = this;
    const corners = this.doing === "edit" && plan.selected !== null ? plan.corners.of(plan.selected) : null;
    if (!corners) return this.say("Only a zone has corners that can be moved: select one.");
    const chosen = plan.corners.chosen(plan.selected) ?? (step > 0 ? -1 : 0);
    this.chooseCorner((chosen + step + corners.length) % corners.length);
  },
  nudgeCorner(name, dx, dy) {
    const { plan } = this;
    if (this.nudged?.name !== name || !this.nudged.corners) this.beginNudge(name);
    const index = plan.corners.chosen(name);
    const [x, y] = plan.corners.of(name)[index];
    this.nudged.corners = plan.moveCorner(name, index, [x + dx, y + dy]);
    this.settleNudge({ x, y });
    return true;
  },
  tellShaped(name, corners, version) {
    this.$emit("shaped", { name, corners: corners.map(([x, y]) => [+x.toFixed(3), +y.toFixed(3)]), version });
    this.wait(name);
    this.sayCorner();
  },
  sayCorner() {
    const { plan } = this;
    const [corners, index] = [plan.corners.of(plan.selected), plan.corners.chosen(plan.selected)];
    if (index === null) return;
    const [x, y] = corners[index];
    this.say(`Corner ${index + 1} of ${corners.length} of ${plan.selected}, x ${x.toFixed(2)} m, y ${y.toFixed(2)} m`);
  },
  next(step) {
    const { plan } = this;
    const names = plan.names().filter((name) => plan.model.kind(name).moves !== "ground");
    const order = names.map((name) => ({ name, at: plan.at(name) })).sort((a, b) => b.at.y - a.at.y || a.at.x - b.at.x).map((one) => one.name);
    if (order.length === 0) return;
    const here = order.indexOf(plan.selected);
    const name = order[(here < 0 ? (step > 0 ? 0 : -1) : here + step) % order.length] ?? order.at(-1);
    this.choose(name);
    const at = plan.at(name);
    plan.view.reveal(at.x, at.y);
  },
  escape() {
    if (this.carrying) { this.hands.drop(); this.cancel(); }
    else if (this.placing) { this.stopPlacing(); this.$emit("stopped", {}); }
    else if (this.plan.sketch) this.sketchZone(false);
    else if (this.plan.corners.chosen(this.plan.selected) !== null) this.leaveCorner();
    else this.choose(null);
  },
  leaveCorner() {
    this.flush();
    this.plan.corners.choose(this.plan.selected, null);
    this.plan.draw();
    this.say(this.told(this.plan.selected));
  },
  // Begin to draw a zone, or give it up.
  sketchZone(begins) {
    this.stopPlacing();
    this.plan.sketch = begins ? new Sketch() : null;
    this.corners = begins ? 0 : null;
    if (begins) this.$refs.pad.focus({ preventScroll: true });
    this.plan.draw();
  },
  corner(point) {
    const { plan } = this;
    if (plan.sketch.add(point, plan.view)) return this.finishZone();
    this.corners = plan.sketch.corners.length;
    plan.draw();
  },
  finishZone() {
    const corners = this.plan.sketch.finished();
    if (!corners) return this.say("A zone has two corners of a box, or three and more.");
    this.$emit("outlined", { corners, storey: this.plan.storey });
    this.sketchZone(false);
  },
  stopPlacing() {
    this.placing = false;
    this.plan.ghost = this.plan.target = null;
    this.plan.draw();
  },
  snapped({ x, y }, free = false) {
    if (!this.snap || free) return { x, y };
    return { x: Math.round(x / this.snap) * this.snap, y: Math.round(y / this.snap) * this.snap };
  },
};
