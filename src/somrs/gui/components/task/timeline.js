// Work in a task over time: a lane per device, a bar per piece of work, which grows while the work continues; outlined, the promised time;
// at the top, the events of the task.

import { drawn, escaped, feed, fitting, lanes, sign, since, span, ticks, works } from "somrs-task";

const LANE = 38;
const TOP = 58;
const NAMES = 96; // pixels for the names of devices
const RIGHT = 44;
const TICK = 500; // milliseconds between two updates of the bars
const MARKED = { setback: "Failed", handler: "Committed", replace: "Replace", replan: "Replan", wait: "Wait", look: "Look", undo: "Compensated", end: "Stopped" };

export default {
  template: `
    <div class="somrs-times">
      <div ref="view" class="somrs-times-view" tabindex="0" role="group" aria-label="Steps by device, over time" @keydown="onKey"
        @focusin="onPoint" @mouseover="onPoint" @mouseleave="told = ''">
        <svg ref="drawing" v-show="any"></svg>
        <p v-if="!any" class="somrs-soft">{{ empty }}</p>
      </div>
      <p v-if="any" class="somrs-times-told" role="status">{{ told || hint }}</p>
      <div v-if="any" class="somrs-times-foot">
        <ul class="somrs-legend" aria-label="What the bars mean">
          <li><i class="somrs-times-key somrs-is-work"></i>at work</li><li><i class="somrs-times-key somrs-is-undo"></i>undoing</li>
          <li><i class="somrs-times-key somrs-times-promised"></i>promised</li>
        </ul>
        <span class="somrs-graph-zoom"><button type="button" class="somrs-mini" aria-label="Shorter" title="Shorter" @click="zoom(1 / 1.5)">−</button>
        <button type="button" class="somrs-mini" aria-label="Longer" title="Longer" @click="zoom(1.5)">+</button></span>
      </div>
    </div>`,
  props: { task: String, empty: String },
  data() {
    return { any: false, told: "", hint: "" };
  },
  created() {
    this.times = 1; // zoom factor relative to the available width
    this.wide = 0;
    this.pointed = null;
  },
  mounted() {
    this.sized = new ResizeObserver(() => {
      if (this.$refs.view.clientWidth !== this.wide) this.draw();
    });
    this.sized.observe(this.$refs.view);
    this.leave = feed(this.task).listen((seen) => {
      this.seen = seen;
      this.found = null;
      this.later();
    });
    this.timer = setInterval(() => this.seen && !this.seen.view.outcome && !document.hidden && this.draw(), TICK);
  },
  unmounted() {
    this.sized.disconnect();
    this.leave();
    clearInterval(this.timer);
    clearTimeout(this.waiting);
  },
  methods: {
    later() {
      // Many messages in a row cause one redraw.
      this.waiting ??= setTimeout(() => {
        this.waiting = null;
        this.draw();
      }, 60);
    },
    zoom(by) {
      this.times = Math.min(40, Math.max(1, this.times * by));
      this.draw();
    },
    draw() {
      const { view, drawing } = this.$refs;
      if (!this.seen || !view) return;
      const { view: task, events, messages } = this.seen;
      this.found ??= works(this.seen);
      this.any = this.found.length > 0;
      if (!this.any) return;
      this.wide = view.clientWidth;
      const start = task.submitted_at;
      const heard = Math.max(messages.at(-1)?.at ?? start, events.at(-1)?.at ?? start);
      const now = task.ended_at ?? Math.max(heard, Date.now() / 1000);
      const promised = this.found.filter((work) => !work.ended && work.until).map((work) => work.until);
      const due = task.deadline ? start + task.deadline : null;
      const end = Math.max(now, ...promised.filter((until) => until < now + 10 * (now - start) + 60), start + 1);
      const rows = lanes(this.found, now);
      const width = Math.max(260, (this.wide - 4) * this.times);
      const scale = (width - NAMES - RIGHT) / (end - start);
      const x = (at) => NAMES + (Math.min(Math.max(at, start), end) - start) * scale;
      const height = TOP + LANE * rows.count + 8;
      const parts = [];
      for (const seconds of ticks(end - start, (width - NAMES) / 70))
        parts.push(`<line class="somrs-times-grid" x1="${x(start + seconds)}" y1="${TOP - 8}" x2="${x(start + seconds)}" y2="${height}"/><text class="somrs-times-tick" x="${x(start + seconds)}" y="13">${span(seconds)}</text>`);
      rows.names.forEach(([name, row, high]) => {
        const y = TOP + LANE * row;
        parts.push(`<line class="somrs-times-lane" x1="0" y1="${y - 3}" x2="${width}" y2="${y - 3}"/><text class="somrs-times-who" x="${NAMES - 10}" y="${y + 20 + (LANE * (high - 1)) / 2}">${escaped(fitting(name, NAMES - 14, 7))}<title>${escaped(name)}</title></text>`);
      });
      parts.push(...this.found.map((work, index) => drawn(work, index, TOP + LANE * rows.row.get(work), x, now, this.room(work, rows, x, now, width))));
      if (!task.outcome) parts.push(`<line class="somrs-times-now" x1="${x(now)}" y1="${TOP - 10}" x2="${x(now)}" y2="${height}"/>`);
      if (due !== null && due <= end) parts.push(`<line class="somrs-times-due" x1="${x(due)}" y1="${TOP - 10}" x2="${x(due)}" y2="${height}"/><text class="somrs-times-due-text" x="${x(due) - 4}" y="${TOP + 2}" text-anchor="end">deadline</text>`);
      parts.push(`<text class="somrs-times-who" x="${NAMES - 10}" y="38">Task</text>`);
      let [last, kind] = [-99, ""];
      for (const event of events.filter((one) => one.kind in MARKED)) {
        const at = Math.max(x(event.at), last + 15);
        if (kind === event.kind && x(event.at) < last + 12) continue;
        if (event.kind === "setback") parts.push(`<line class="somrs-times-setback" x1="${x(event.at)}" y1="42" x2="${x(event.at)}" y2="${height}"/>`);
        [last, kind] = [at, event.kind];
        const state = event.kind === "end" ? { accomplished: "Completed", failed: "Failed", cancelled: "Stopped" }[task.outcome] : MARKED[event.kind];
        const text = `${since(event.at - start)}: ${event.step ? `${event.step}: ` : ""}${event.text}`;
        parts.push(`<g class="somrs-times-mark somrs-mark-${event.kind}" role="img" aria-label="${escaped(text)}" data-told="${escaped(text)}"><rect x="${at - 8}" y="25" width="16" height="18"/>${sign(state, at - 8, 26)}</g>`);
      }
      drawing.setAttribute("width", width);
      drawing.setAttribute("height", height);
      drawing.innerHTML = parts.join("");
      const left = due === null ? "" : task.outcome ? `; the deadline was ${span(task.deadline)}` : `; the deadline is ${due > now ? `in ${span(due - now)}` : "over"}`;
      this.hint = `${task.outcome ? "Took" : "So far"} ${span(now - start)}${left}. Point at a bar, or move along the bars with the arrow keys.`;
      if (this.pointed !== null) drawing.querySelector(`[data-bar="${this.pointed}"]`)?.classList.add("somrs-bar-on");
    },
    room(work, rows, x, now, width) {
      // The limit for a text beside the bar.
      const next = Math.min(...this.found.filter((other) => other !== work && rows.row.get(other) === rows.row.get(work) && other.start >= (work.ended ?? now)).map((other) => x(other.start)), width);
      return next - 4;
    },
    onPoint(event) {
      const told = event.target.closest("[data-told]");
      if (told) this.told = told.dataset.told;
    },
    onKey(event) {
      if (!this.found?.length) return;
      const at = this.pointed ?? -1;
      const next = { ArrowRight: at + 1, ArrowDown: at + 1, ArrowLeft: at - 1, ArrowUp: at - 1, Home: 0, End: this.found.length - 1 }[event.key];
      if (next === undefined) return;
      event.preventDefault();
      this.pointed = Math.min(Math.max(next, 0), this.found.length - 1);
      for (const bar of this.$refs.drawing.querySelectorAll("[data-bar]")) {
        const own = Number(bar.dataset.bar) === this.pointed;
        bar.classList.toggle("somrs-bar-on", own);
        if (own) this.told = bar.dataset.told;
      }
    },
  },
};
