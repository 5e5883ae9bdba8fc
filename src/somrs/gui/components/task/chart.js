// Sequence chart of a task's messages between Task Manager and services: a lifeline each, an arrow per message, growing at the end. Rows
// are drawn once, in blocks that the browser skips while they are out of sight, which keeps thousands of them fast.

import { clock, escaped, feed, fitting, said, saidOf, since } from "somrs-task";

const ROW = 38; // pixels from one message to the next
const BLOCK = 40; // messages per picture
const GUTTER = 64; // width of the times
const FIRST = 126; // the Task Manager's lifeline
const LAST = 96; // maximum width right of the last lifeline
const COLUMN = [148, 400]; // minimum and maximum between lifelines
const BAD = new Set(["Failed", "Refuse", "Stranded", "Fault", "Stop"]);
const GOOD = new Set(["Completed", "Compensated", "Accept"]);

let charts = 0; // on this page, so that ids are unique

export default {
  template: `
    <div class="somrs-chart">
      <div class="somrs-chart-tools">
        <label><input type="checkbox" v-model="beats" /> All heartbeats</label>
        <span class="somrs-soft" role="status">{{ counted }}</span>
      </div>
      <div ref="view" class="somrs-chart-view" tabindex="0" :role="count ? 'listbox' : 'group'" aria-label="Messages" :aria-activedescendant="active"
        @scroll.passive="onScroll" @keydown="onKey" @click="onClick">
        <svg ref="heads" class="somrs-chart-heads" height="50" aria-hidden="true"></svg>
        <div ref="rows"></div>
        <p v-if="!count" class="somrs-soft somrs-chart-none">{{ empty }}</p>
      </div>
      <button v-if="behind" type="button" class="somrs-chart-behind" @click="toEnd">{{ behind }} new <span aria-hidden="true">↓</span></button>
      <section v-if="open" class="somrs-chart-body" aria-label="The message">
        <header><b :class="{'somrs-bad-text': open.bad}">{{ open.message.type }}</b> <span>{{ open.from }} → {{ open.to }}</span>
          <button type="button" class="somrs-mini" aria-label="Close" @click="close">×</button></header>
        <dl>
          <div><dt>passed</dt><dd>{{ open.at }}</dd></div>
          <div v-if="open.message.step"><dt>step</dt><dd>{{ open.message.step }}</dd></div>
          <div v-if="open.answers"><dt>answers</dt><dd><button type="button" class="somrs-link" @click="choose(open.answers.number, true)">{{ open.answers.text }}</button></dd></div>
          <div v-for="line in open.lines" :key="line[0]"><dt>{{ line[0] }}</dt><dd class="somrs-chart-value">{{ line[1] }}</dd></div>
        </dl>
      </section>
    </div>`,
  props: { task: String, empty: String },
  data() {
    return { beats: false, count: 0, shown: 0, behind: 0, active: null, open: null };
  },
  computed: {
    counted() {
      if (!this.count) return "";
      return this.shown === this.count ? `${this.count} messages` : `${this.shown} of ${this.count} messages`;
    },
  },
  watch: {
    beats() {
      this.redraw();
    },
  },
  created() {
    this.own = ++charts;
    this.messages = [];
    this.life = 0;
    this.wide = 0;
    this.watched = null; // whether the task was running when first seen; for an ended one, the beginning is shown first
    this.tail = null; // whether the end is in view and stays there
    this.forget();
  },
  mounted() {
    this.sized = new ResizeObserver(() => this.resized());
    this.sized.observe(this.$refs.view);
    this.leave = feed(this.task).listen((seen) => this.show(seen));
  },
  unmounted() {
    this.sized.disconnect();
    this.leave();
  },
  methods: {
    forget() {
      this.parties = new Map(); // the column of each service
      this.notes = new Map(); // the last progress note of each participant
      this.drawn = 0; // number of messages drawn
      this.rows = []; // numbers of the messages with a row
      this.column = 0;
    },
    show({ view, messages, life }) {
      this.watched ??= !view.outcome;
      this.tail ??= this.watched;
      if (life !== this.life) {
        this.life = life;
        this.messages = messages;
        this.close();
        this.redraw();
      } else this.append();
      if (!this.watched) this.behind = 0;
    },
    redraw() {
      const { rows } = this.$refs;
      if (!rows) return;
      const current = this.current;
      this.forget();
      rows.textContent = "";
      this.shown = this.behind = 0;
      this.append();
      this.behind = 0;
      if (current !== undefined && this.row(current)) this.mark(current);
    },
    append() {
      const fresh = [];
      const known = this.parties.size;
      for (; this.drawn < this.messages.length; this.drawn++) {
        const message = this.messages[this.drawn];
        const beat = this.isBeat(message);
        if (!this.parties.has(message.service)) this.parties.set(message.service, this.parties.size);
        if (this.beats || !beat) fresh.push(this.drawn);
      }
      this.count = this.messages.length;
      if (this.columnNow() !== this.column || this.parties.size !== known) {
        this.column = this.columnNow();
        const all = [...this.rows, ...fresh];
        this.rows = [];
        this.$refs.rows.textContent = "";
        this.head();
        this.add(all);
      } else this.add(fresh);
      if (this.tail) this.toEnd();
      else this.behind += fresh.length;
    },
    isBeat(message) {
      // A heartbeat without news.
      if (message.type !== "Progress") return false;
      const { note, situation } = message.body;
      const old = this.notes.get(message.participant);
      this.notes.set(message.participant, note || old);
      return !situation && (!note || note === old);
    },
    columnNow() {
      const count = Math.max(1, this.parties.size);
      const room = (this.wide || 640) - FIRST;
      const fits = Math.max((room - LAST) / count, (room - 2) / (count + 0.5));
      return Math.floor(Math.min(COLUMN[1], Math.max(COLUMN[0], fits)));
    },
    place(service) {
      return FIRST + (this.parties.get(service) + 1) * this.column;
    },
    width() {
      return FIRST + this.parties.size * this.column + Math.min(LAST, this.column / 2);
    },
    head() {
      const { heads } = this.$refs;
      const half = Math.min(LAST - 6, this.column / 2 - 6);
      heads.setAttribute("width", this.width());
      const boxes = [["Task Manager", "", FIRST, 58], ...[...this.parties.keys()].map((name) => [...name.split("."), this.place(name), half])];
      heads.innerHTML = this.parties.size
        ? boxes.map(([name, type, x, wide]) => `<g><title>${escaped(type ? `${name}.${type}` : name)}</title><rect x="${x - wide}" y="4" width="${2 * wide}" height="40" rx="6"/>
            <text x="${x}" y="${type ? 21 : 28}">${escaped(fitting(name, 2 * wide - 8, 7.2))}</text>${type ? `<text class="somrs-chart-type" x="${x}" y="36">${escaped(fitting(type, 2 * wide - 8, 6.2))}</text>` : ""}</g>`).join("")
        : "";
    },
    add(numbers) {
      for (let at = 0; at < numbers.length; ) {
        const free = BLOCK - (this.rows.length % BLOCK);
        const part = numbers.slice(at, at + free);
        const block = free === BLOCK ? this.block() : this.$refs.rows.lastElementChild;
        const first = this.rows.length % BLOCK;
        const svg = block.firstElementChild;
        svg.lastElementChild.insertAdjacentHTML("beforeend", part.map((number, index) => this.arrow(number, first + index)).join(""));
        this.rows.push(...part);
        const high = (first + part.length) * ROW;
        svg.setAttribute("height", high);
        block.style.containIntrinsicSize = `${this.width()}px ${high}px`;
        at += part.length;
      }
      this.shown = this.rows.length;
    },
    block() {
      const block = document.createElement("div");
      block.className = "somrs-chart-block";
      const lives = [FIRST, ...[...this.parties.keys()].map((name) => this.place(name))];
      block.innerHTML = `<svg width="${this.width()}" height="0">${lives.map((x) => `<line class="somrs-chart-life" x1="${x}" y1="0" x2="${x}" y2="100%"/>`).join("")}<g></g></svg>`;
      this.$refs.rows.append(block);
      return block;
    },
    arrow(number, place) {
      const message = this.messages[number];
      const y = place * ROW + 20;
      const x = this.place(message.service);
      const [from, to] = message.asked ? [FIRST, x - 1] : [x, FIRST + 1];
      const middle = x - this.column / 2;
      const note = fitting(said(message), this.column - 22, 5.9);
      const kind = BAD.has(message.type) ? "somrs-msg-bad" : GOOD.has(message.type) ? "somrs-msg-good" : "";
      const start = this.messages[0].at;
      return `<g class="somrs-msg ${kind}" id="${this.name(number)}" data-n="${number}" role="option" aria-selected="false" aria-label="${escaped(saidOf(message, start, note))}">
        <rect class="somrs-msg-row" x="0" y="${y - 20}" width="${this.width()}" height="${ROW}"/><text class="somrs-msg-time" x="${GUTTER - 8}" y="${y + 4}">${since(message.at - start)}</text>
        <path d="M${from} ${y}H${to}"/><path class="somrs-tip" d="M${to} ${y}l${message.asked ? -9 : 9} -4.5v9z"/>
        <text class="somrs-msg-type" x="${middle}" y="${y - 6}">${escaped(message.type)}</text>
        ${note ? `<text class="somrs-msg-note" x="${middle}" y="${y + 12}">${escaped(note)}</text>` : ""}</g>`;
    },
    name(number) {
      return `somrs-msg-${this.own}-${number}`;
    },
    row(number) {
      return document.getElementById(this.name(number));
    },
    resized() {
      this.wide = this.$refs.view.clientWidth;
      if (this.wide && this.columnNow() !== this.column) this.redraw();
      if (this.tail) this.toEnd();
    },
    toEnd() {
      const { view } = this.$refs;
      if (view) view.scrollTop = view.scrollHeight;
      this.tail = true;
      this.behind = 0;
    },
    onScroll() {
      const { view } = this.$refs;
      this.tail = view.scrollTop + view.clientHeight > view.scrollHeight - ROW;
      if (this.tail) this.behind = 0;
    },
    onClick(event) {
      const row = event.target.closest("[data-n]");
      if (row) this.choose(Number(row.dataset.n));
    },
    onKey(event) {
      const at = this.rows.indexOf(this.current);
      const page = Math.max(1, Math.floor(this.$refs.view.clientHeight / ROW) - 2);
      const steps = { ArrowDown: at + 1, ArrowUp: at - 1, PageDown: at + page, PageUp: at - page, Home: 0, End: this.rows.length - 1 };
      if (event.key in steps && this.rows.length) {
        const next = this.rows[Math.min(Math.max(steps[event.key], 0), this.rows.length - 1)];
        if (this.open) this.choose(next, true);
        else this.mark(next, true);
      } else if ((event.key === "Enter" || event.key === " ") && at >= 0) this.choose(this.current);
      else if (event.key === "Escape" && this.open) this.close();
      else return;
      event.preventDefault();
    },
    mark(number, reveal = false) {
      this.row(this.current)?.setAttribute("aria-selected", "false");
      this.current = number;
      const row = this.row(number);
      row?.setAttribute("aria-selected", "true");
      this.active = row ? this.name(number) : null;
      if (reveal) this.reveal(number);
    },
    reveal(number) {
      // Computed, as rows out of sight may not be laid out yet.
      const { view } = this.$refs;
      const top = this.rows.indexOf(number) * ROW;
      const room = view.clientHeight - 50 - ROW;
      if (top < view.scrollTop) view.scrollTop = top;
      else if (top > view.scrollTop + room) view.scrollTop = top - room;
    },
    choose(number, reveal = false) {
      if (!reveal && this.open && this.current === number) {
        this.close();
        return;
      }
      if (!this.rows.includes(number)) this.beats = true;
      const message = this.messages[number];
      const other = message.relates_to ? this.messages.findIndex((one) => one.id === message.relates_to) : -1;
      const parties = ["Task Manager", message.service];
      this.open = {
        message,
        bad: BAD.has(message.type),
        from: parties[message.asked ? 0 : 1],
        to: parties[message.asked ? 1 : 0],
        at: `${clock(message.at)}, ${since(message.at - this.messages[0].at)} after the first`,
        answers: other >= 0 ? { number: other, text: `${this.messages[other].type}, ${since(this.messages[other].at - this.messages[0].at)}` } : null,
        lines: lines(message.body),
      };
      this.$nextTick(() => this.mark(number, reveal));
    },
    close() {
      this.open = null;
    },
  },
};

const MOMENTS = new Set(["earliest_start", "latest_finish", "reply_by", "start_from", "start_until", "valid_until", "begin_by"]);

// A message's body, a line for each part.
function lines(body) {
  return Object.entries(body)
    .filter(([, value]) => value !== null && value !== "" && !(typeof value === "object" && !Object.keys(value).length))
    .map(([name, value]) => {
      const text = MOMENTS.has(name)
        ? clock(value)
        : typeof value === "object"
          ? Object.entries(value).map(([key, one]) => `${key}: ${one}`).join("\n")
          : String(value).replaceAll(" AND ", "\nAND ");
      return [name.replaceAll("_", " "), text];
    });
}
