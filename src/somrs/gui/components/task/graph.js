// A plan as a graph: a box per step, coloured and marked by its state, and a curve per ordering, which shows the fact that it provides on
// hover and focus. For a task (`task`), it follows the steps' states; for a preview (`steps`), it shows the plan.

import { curve, escaped, feed, fitting, layered, look, sign, word } from "somrs-task";

const WIDE = 212;
const HIGH = { task: 66, plan: 50 }; // a task's steps have a line for the state
const EDGE = 14; // pixels around everything
const LEGEND = ["New", "Arranging", "Committed", "Executing", "Completed", "Failed", "Compensated"];
const LEAST = 0.75; // minimum scale; below, it is scrolled

export default {
  template: `
    <div class="somrs-graph" :aria-busy="steps === null">
      <div ref="view" class="somrs-graph-view" :class="{'somrs-graph-none': !drawn}">
        <div ref="drawing" role="group" :aria-label="label" @keydown="onKey" @focusin="onFocus" @focusout="point(null)"
          @mouseover="onOver" @mouseleave="point(null)" @click="onClick"></div>
        <p v-if="!drawn" class="somrs-soft">{{ empty }}</p>
      </div>
      <div role="status">
        <dl v-if="chosen" class="somrs-graph-told">
          <div v-for="line in told" :key="line[0]"><dt>{{ line[0] }}</dt><dd>{{ line[1] }}</dd></div>
        </dl>
      </div>
      <ol v-if="beside.length" class="somrs-beside" aria-label="Work outside the plan">
        <li v-for="work in beside" :key="work.step + work.began" :class="work.look" :title="work.title">
          <svg width="16" height="16" aria-hidden="true" v-html="work.sign"></svg><b>{{ work.what }}</b> {{ work.by }}<span>{{ work.word }}</span>
        </li>
      </ol>
      <div v-if="drawn && (task || tall)" class="somrs-graph-foot">
        <ul v-if="task" class="somrs-legend" aria-label="Meaning of the symbols">
          <li v-for="one in legend" :key="one.word" :class="one.look"><svg width="16" height="16" aria-hidden="true" v-html="one.sign"></svg>{{ one.word }}</li>
        </ul>
        <div v-if="tall" class="somrs-graph-zoom">
          <button type="button" class="somrs-mini" aria-label="Smaller" title="Smaller" @click="zoom(1 / 1.25)">−</button>
          <button type="button" class="somrs-mini" aria-label="Larger" title="Larger" @click="zoom(1.25)">+</button>
          <button type="button" class="somrs-mini" aria-label="Fit to width" title="Fit to width" @click="zoom(0)">⤢</button>
        </div>
      </div>
    </div>`,
  props: { plan: Array, task: String, label: String, empty: String },
  emits: ["step"],
  data() {
    return { drawn: false, tall: false, chosen: null, told: [], beside: [], steps: null };
  },
  created() {
    this.high = this.task ? HIGH.task : HIGH.plan;
    this.scale = 0; // 0: fit to width
    this.work = [];
    this.shape = "";
    this.legend = LEGEND.map((state) => ({ look: look(state), word: word(state), sign: sign(state) }));
  },
  mounted() {
    this.sized = new ResizeObserver(() => this.size());
    this.sized.observe(this.$refs.view);
    if (this.task) this.leave = feed(this.task).listen(({ view }) => this.show(view.steps, view.work, view.outcome !== null));
    else this.show(this.plan ?? []);
  },
  unmounted() {
    this.sized.disconnect();
    this.leave?.();
  },
  watch: {
    plan(steps) {
      if (!this.task) this.show(steps ?? []);
    },
  },
  methods: {
    show(steps, work = [], over = false) {
      this.work = work;
      this.over = over;
      const shape = JSON.stringify(steps.map((step) => [step.step, step.service_type, step.inputs, step.after, step.because, step.learns, step.foreseen]));
      const same = shape === this.shape;
      this.steps = steps;
      this.shape = shape;
      this.drawn = steps.length > 0;
      const planned = new Set(steps.map(key));
      this.beside = work.filter((one) => !planned.has(key(one))).map(aside);
      if (!same) this.draw();
      else steps.forEach((step) => this.mark(step));
      if (this.chosen) this.tell(this.chosen);
    },
    draw() {
      const nodes = this.steps.map((step) => ({ id: step.step, width: WIDE, height: this.high }));
      const edges = this.steps.flatMap((step) => step.after.map((from) => ({ from, to: step.step })));
      const room = this.$refs.view.clientWidth || 600;
      const laid = [true, false].map((right) => ({ ...layered(nodes, edges, { right }), right }));
      const [beside, below] = laid.map((one) => Math.min(1, room / (one.width + 2 * EDGE)));
      const fit = beside === 1 && below === 1;
      const made = (fit ? laid[0].height < 420 : beside > below) ? laid[0] : laid[1];
      this.made = made;
      this.facts = facts(this.steps);
      const { width, height } = made;
      this.$refs.drawing.innerHTML = this.drawn
        ? `<svg viewBox="${-EDGE} ${-EDGE} ${width + 2 * EDGE} ${height + 2 * EDGE}">${made.paths.map((path) => edge(path, made.right)).join("")}${this.steps.map((step, index) => node(step, made.places.get(step.step), index, this.high)).join("")}<g class="somrs-says"></g></svg>`
        : "";
      this.steps.forEach((step) => this.mark(step));
      this.size();
    },
    mark(step) {
      // Parts that change while the plan stays.
      const box = this.box(step.step);
      if (!box) return;
      const tries = this.work.filter((one) => key(one) === key(step) && ["Failed", "Unreachable"].includes(one.result ?? one.state)).length;
      // A step without a service, or whose work was undone, has the state of its last work.
      const last = this.work.findLast((one) => key(one) === key(step));
      const undone = ["Compensating", "Compensated", "Stranded"].includes(last?.state);
      const state = last && (undone || (this.over && step.state === "New")) ? last.state : step.state;
      const said = words(step, state);
      const told = JSON.stringify([state, said, tries, step.fraction, this.chosen === step.step]);
      if (box.dataset.told === told) return;
      box.dataset.told = told;
      box.setAttribute("class", `somrs-node ${look(state)}${step.foreseen ? " somrs-node-foreseen" : ""}${this.chosen === step.step ? " somrs-node-chosen" : ""}`);
      box.querySelector(".somrs-node-part").setAttribute("width", state === "Executing" ? Math.max(4, step.fraction * WIDE) : 0);
      box.querySelector(".somrs-node-sign").innerHTML = this.task ? sign(state) : "";
      box.querySelector(".somrs-node-says").textContent = this.task ? fitting(said, tries ? WIDE - 90 : WIDE - 22, 6.3) : "";
      box.querySelector(".somrs-node-tries").textContent = tries ? `${tries} failed` : "";
      box.setAttribute("aria-label", named(box, [step.service_type, step.step, does(step), said, ...(tries ? [`${tries} failed`] : [])].join(", ")));
    },
    box(step) {
      return this.$refs.drawing?.querySelector(`[data-step="${CSS.escape(step)}"]`);
    },
    size() {
      const svg = this.$refs.drawing?.querySelector("svg");
      if (!svg) return;
      const room = this.$refs.view.clientWidth;
      const width = this.made.width + 2 * EDGE;
      const scale = this.scale || Math.min(1, Math.max(LEAST, room / width));
      svg.setAttribute("width", Math.floor(width * scale));
      svg.setAttribute("height", Math.floor((this.made.height + 2 * EDGE) * scale));
      this.now = scale;
      this.tall = width > room || this.made.height > 420 || this.scale > 0;
    },
    zoom(by) {
      this.scale = by ? Math.min(2.5, Math.max(0.25, this.now * by)) : 0;
      this.size();
    },
    point(step) {
      // The curves of a step, with their facts.
      const svg = this.$refs.drawing.querySelector("svg");
      if (!svg || this.pointed === step) return;
      this.pointed = step;
      const said = [];
      for (const drawn of svg.querySelectorAll(".somrs-edge")) {
        const own = step !== null && (drawn.dataset.from === step || drawn.dataset.to === step || drawn.dataset.edge === step);
        drawn.classList.toggle("somrs-edge-on", own);
        if (own) said.push(drawn);
      }
      svg.querySelector(".somrs-says").innerHTML = said.map((drawn) => this.saying(drawn)).join("");
    },
    saying(drawn) {
      const told = this.facts.get(`${drawn.dataset.from} ${drawn.dataset.to}`) ?? [];
      if (!told.length) return "";
      const middle = drawn.querySelector("path").getPointAtLength(drawn.querySelector("path").getTotalLength() / 2);
      const most = Math.max(...told.map((text) => text.length)) * 7.3 + 16;
      const left = Math.min(Math.max(middle.x - most / 2, 2 - EDGE), this.made.width + EDGE - most - 2);
      const top = middle.y - 9 * told.length - 3;
      const lines = told.map((text, line) => `<text x="${left + 8}" y="${top + 15 + 18 * line}">${escaped(text)}</text>`);
      return `<rect x="${left}" y="${top}" width="${most}" height="${18 * told.length + 6}" rx="5"/>${lines.join("")}`;
    },
    onOver(event) {
      const box = event.target.closest(".somrs-node");
      const drawn = event.target.closest(".somrs-edge");
      this.point(box ? box.dataset.step : drawn ? drawn.dataset.edge : null);
    },
    onFocus(event) {
      const box = event.target.closest(".somrs-node");
      if (!box) return;
      for (const other of this.$refs.drawing.querySelectorAll(".somrs-node")) other.setAttribute("tabindex", other === box ? 0 : -1);
      this.point(box.dataset.step);
    },
    onClick(event) {
      const box = event.target.closest(".somrs-node");
      if (box) this.choose(box.dataset.step);
    },
    onKey(event) {
      const at = this.steps.findIndex((step) => step.step === event.target.dataset?.step);
      if (at < 0) return;
      const next = { ArrowDown: at + 1, ArrowRight: at + 1, ArrowUp: at - 1, ArrowLeft: at - 1, Home: 0, End: this.steps.length - 1 }[event.key];
      if (next !== undefined) this.box(this.steps[Math.min(Math.max(next, 0), this.steps.length - 1)].step)?.focus();
      else if (event.key === "Enter" || event.key === " ") this.choose(this.steps[at].step);
      else if (event.key === "Escape" && this.chosen) this.choose(this.chosen);
      else return;
      event.preventDefault();
    },
    choose(step) {
      this.chosen = this.chosen === step ? null : step;
      this.told = [];
      if (this.chosen) this.tell(step);
      this.steps.forEach((one) => this.mark(one));
      this.$emit("step", this.chosen);
    },
    tell(id) {
      const step = this.steps.find((one) => one.step === id);
      if (!step) {
        this.chosen = null;
        return;
      }
      const tried = this.work.filter((one) => key(one) === key(step));
      const before = step.after.map((from) => `${from}${(this.facts.get(`${from} ${id}`) ?? []).map((fact) => ` (${fact})`).join("")}`);
      const after = this.steps.filter((one) => one.after.includes(id)).map((one) => one.step);
      this.told = [
        ["Step", `${id}: ${step.service_type}`],
        ...Object.entries(step.inputs),
        ...(this.task ? [["State", words(step, step.state)]] : []),
        ...(step.service ? [["Service", `${step.service}${step.price === null ? "" : `, ${step.price} EUR`}${step.duration === null ? "" : `, ${Math.round(step.duration)} s`}`]] : []),
        ...(step.learns.length ? [[TELLS[step.kind] ?? "Tells", step.learns.join(", ")]] : []),
        ...(step.assumed.length ? [["Assumed", step.assumed.join(", ")]] : []),
        ...Object.entries(step.outputs).map(([name, value]) => [`Output ${name}`, value]),
        ...(step.foreseen ? [["Foreseen", "planned again when it is known what the steps before it find out"]] : []),
        ...(step.condition ? [["Demanded", `${step.condition}, by ${step.demanded_by.map(device).join(", ")}`]] : []),
        ...(before.length ? [["After", before.join(", ")]] : []),
        ...(after.length ? [["Enables", after.join(", ")]] : []),
        ...tried.map((one, index) => [`Try ${index + 1}`, `${one.service}: ${word(one.state)}${one.note ? `, ${one.note}` : ""}${one.situation ? `. Resulting situation: ${one.situation}` : ""}`]),
      ];
    },
  },
};

const key = (step) => JSON.stringify([step.step, step.service_type, step.inputs]);
const inputs = (step) => Object.values(step.inputs).join(", ");
const TELLS = { cognitive: "Finds out", software: "Computes" };
// What a step does, in a line: what it finds out or computes, or its inputs.
const does = (step) => (step.learns.length && TELLS[step.kind] ? `${TELLS[step.kind].toLowerCase()} ${step.learns.join(", ")}` : inputs(step));
const device = (service) => service.split(".")[0];

// The accessible name of a step. It begins with the text that is seen, as speech input needs it; this may be cut.
function named(box, full) {
  const seen = [...box.querySelectorAll("text")].map((part) => part.textContent).filter(Boolean).join(", ");
  return full.startsWith(seen) ? full : `${seen}; ${full}`;
}

function words(step, state) {
  if (step.foreseen) return "foreseen";
  const going = state === "Executing" ? ` ${Math.round(step.fraction * 100)} %` : "";
  return `${word(state)}${going}${step.service ? ` · ${device(step.service)}` : ""}`;
}

// The facts that each ordering provides.
function facts(steps) {
  const found = new Map();
  for (const step of steps)
    step.after.forEach((from) => {
      const told = step.because.filter((_, index) => step.after.length === 1 || step.brought_by[index] === from);
      found.set(`${from} ${step.step}`, [...new Set(told)]);
    });
  return found;
}

function edge(path, right) {
  const drawn = curve(path.points, right);
  const [x, y] = path.points.at(-1);
  const tip = right ? `M${x} ${y}l-9 -4.5v9z` : `M${x} ${y}l-4.5 -9h9z`;
  return `<g class="somrs-edge" data-edge="${escaped(`${path.from} ${path.to}`)}" data-from="${escaped(path.from)}" data-to="${escaped(path.to)}"><path d="${drawn}"/><path class="somrs-tip" d="${tip}"/><path class="somrs-edge-near" d="${drawn}"/></g>`;
}

function node(step, [x, y], index, high) {
  const [left, top] = [x - WIDE / 2, y - high / 2];
  const begin = high === HIGH.task ? 32 : 11; // after the state symbol
  return `<g class="somrs-node" data-step="${escaped(step.step)}" role="button" tabindex="${index === 0 ? 0 : -1}" transform="translate(${left} ${top})">
    <rect class="somrs-node-box" width="${WIDE}" height="${high}" rx="8"/><rect class="somrs-node-part" y="${high - 5}" width="0" height="5" rx="2.5"/>
    <g class="somrs-node-sign" transform="translate(10 9)"></g>
    <text class="somrs-node-type" x="${begin}" y="22">${escaped(fitting(step.service_type, WIDE - begin - 14 - 6.6 * step.step.length, 7.9))}</text>
    <text class="somrs-node-id" x="${WIDE - 10}" y="22" text-anchor="end">${escaped(step.step)}</text>
    <text class="somrs-node-what" x="11" y="40">${escaped(fitting(does(step), WIDE - 22, 6.3))}</text>
    <text class="somrs-node-says" x="11" y="56"></text>
    <text class="somrs-node-tries" x="${WIDE - 10}" y="56" text-anchor="end"></text></g>`;
}

// Work outside the current plan: of an earlier plan, or of an observation, a compensation or a handler.
function aside(work) {
  const purpose = { look: "Observation: ", undo: "Compensation: ", handler: "Handler: " }[/^[a-z]+/.exec(work.step.includes(".") ? work.step : "")?.[0]] ?? "Earlier plan: ";
  return {
    step: work.step,
    began: work.began,
    what: `${purpose}${work.service_type} ${inputs(work)}`,
    by: device(work.service),
    word: word(work.state),
    look: look(work.state),
    sign: sign(work.state),
    title: `${work.step}: ${work.service}${work.situation ? `. Resulting situation: ${work.situation}` : ""}`,
  };
}
