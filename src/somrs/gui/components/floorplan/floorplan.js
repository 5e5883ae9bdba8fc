// The floor plan as an element: its tools, and its interface to the page and the map. `modules/plan.js` draws it; `modules/doings.js`
// handles user actions.

import { doings, get, Hands, kindById, LEGEND, Live, Plan, Poses, sample, TrafficNews } from "somrs-floorplan";

const TRAFFIC = "somrs-traffic"; // set while traffic is shown, per browser tab
const KEPT = "somrs-plan"; // the visible part, stored per browser tab for reloads

export default {
  template: `
    <div class="somrs-plan" :class="['fp-mode-' + doing, { 'fp-carrying': carrying, 'fp-placing': placing }]">
      <div ref="pad" class="fp-pad" tabindex="0" role="application" aria-roledescription="floor plan"
        :aria-label="'Floor plan' + (storey ? ' of ' + storey : '') + ', ' + shown + ' objects'" :aria-describedby="id + '-help'"></div>
      <p :id="id + '-help'" class="fp-unseen">{{ help }}</p>
      <p class="fp-unseen" role="status" aria-live="polite">{{ said }}</p>
      <div class="fp-tools fp-tools-left" v-if="storeys.length > 1">
        <label class="fp-storeys"><span class="fp-unseen">Storey</span>
          <select :value="storey" @change="goTo($event.target.value)" aria-label="Storey">
            <option v-for="one in storeys" :key="one.name" :value="one.name">{{ one.label }}</option>
          </select>
        </label>
      </div>
      <div class="fp-tools fp-tools-right" role="toolbar" aria-label="Plan">
        <button type="button" @click="zoomBy(1.4)" aria-label="Zoom in" title="Zoom in (+)"><q-icon name="add" /></button>
        <button type="button" @click="zoomBy(1 / 1.4)" aria-label="Zoom out" title="Zoom out (-)"><q-icon name="remove" /></button>
        <button type="button" @click="fit()" aria-label="Show all" title="Show all (0)"><q-icon name="fit_screen" /></button>
        <button type="button" v-if="!past()" @click="showTraffic(!traffic)" :aria-pressed="traffic" aria-label="Traffic" title="Ways of robots, and who waits for whom"><q-icon name="route" /></button>
        <button type="button" @click="legend = !legend" :aria-pressed="legend" aria-label="Legend" title="Meaning of the symbols"><q-icon name="legend_toggle" /></button>
      </div>
      <div v-if="legend" class="fp-legend" role="region" aria-label="Legend">
        <span v-for="one in legendOf" :key="one.title" class="fp-legend-row"><span v-html="one.picture"></span>{{ one.title }}</span>
      </div>
      <div v-if="traffic && !past()" class="fp-traffic" role="region" aria-label="Traffic">
        <p v-if="hold" class="fp-traffic-hold"><q-icon name="front_hand" /> Traffic is held: {{ hold }}</p>
        <p v-if="!waiting.length" role="status">{{ unknown ? "Traffic cannot be read." : "No robot waits for another." }}</p>
        <ul v-else>
          <li v-for="one in waiting.slice(0, 8)" :key="one.robot"><button type="button" class="somrs-link" @click="choose(one.robot); show(one.robot)">{{ one.robot }}</button> {{ one.waiting }}</li>
          <li v-if="waiting.length > 8">and {{ waiting.length - 8 }} more</li>
        </ul>
        <p class="fp-traffic-key"><span class="fp-key-granted"></span>granted <span class="fp-key-planned"></span>planned <span class="fp-key-wait"></span>waits for</p>
      </div>
      <div class="fp-foot">
        <div class="fp-scale" :style="{ width: bar.pixels + 'px' }" :aria-label="'Scale: ' + bar.text"><span>{{ bar.text }}</span></div>
        <div class="fp-where" v-if="where">{{ where }}</div>
        <div class="fp-unplaced" v-if="unplaced.length" role="group" aria-label="Without a position on the map">
          <span>Without a position:</span>
          <button type="button" v-for="name in unplaced.slice(0, 6)" :key="name" @click="choose(name)"><q-icon name="help_outline" />{{ name }}</button>
          <span v-if="unplaced.length > 6">and {{ unplaced.length - 6 }} more</span>
        </div>
      </div>
      <div class="fp-hint" v-if="hint" role="note">{{ hint }}</div>
      <div class="fp-hint fp-late" v-if="late.length" role="status">{{ late.join(", ") }}: the move is on its way …</div>
      <div class="fp-hint fp-sketching" v-if="corners !== null" role="group" aria-label="New zone">
        <span role="status">{{ corners < 2 ? "Click the corners of the zone: two for a box." : corners + " corners. Click the first one, or:" }}</span>
        <button type="button" v-if="corners > 1" @click="finishZone()">Finish</button>
        <button type="button" @click="sketchZone(false)">Cancel</button>
      </div>
      <div class="fp-lost" v-if="lost" role="alert"><q-icon name="cloud_off" /> The connection is lost. The data may be outdated. Reconnecting…</div>
      <div class="fp-lost" v-if="trouble" role="alert"><q-icon name="error_outline" /> {{ trouble }}</div>
      <div class="fp-loading" v-if="loading" role="status">Reading the map…</div>
    </div>
  `,
  props: {
    mode: { type: String, default: "view" },
    storey_name: String,
    selected: String,
    highlighted: { type: Array, default: () => [] },
    relations: { type: Array, default: () => [] },
    arrows: { type: Array, default: () => [] },
    version: Number,
    snap: { type: Number, default: 0 },
    show_legend: Boolean,
  },
  emits: ["select", "moved", "placed", "dropped", "picked", "open", "remove", "undo", "storey", "loaded", "unanswered", "stopped", "outlined", "shaped"],
  data() {
    return {
      id: `fp${Math.random().toString(36).slice(2, 8)}`, storeys: [], storey: "", bar: { pixels: 60, text: "" }, where: "", said: "", loading: true, lost: false,
      trouble: "", legend: this.show_legend, unplaced: [], carrying: false, placing: false, shown: 0, kinds: [], corners: null, traffic: false, waiting: [], hold: "", unknown: false, late: [],
    };
  },
  computed: {
    doing() {
      return this.version === undefined || this.version === null ? this.mode : "view";
    },
    hint() {
      if (this.past()) return "A past version of the map. Go back to now to edit it.";
      return this.placing ? "Click the new position, or use the arrow keys and press Enter. Escape cancels." : "";
    },
    help() {
      const common = "Page down and page up select the next and the previous object, plus and minus zoom, 0 shows all.";
      if (this.doing !== "edit") return common;
      return `${common} Arrow keys move the selected object, with Shift in small steps; R turns it, Shift R the other way; C and Shift C choose a corner of a selected zone for the arrow keys; Delete removes it; Enter opens it; Control Z undoes.`;
    },
    legendOf() {
      const rows = LEGEND.filter((id) => this.kinds.includes(id)).map((id) => ({ title: kindById(id).title, picture: sample(kindById(id)) }));
      const doors = rows.findIndex((row) => row.title === "Door");
      const door = kindById("door");
      if (doors >= 0) rows.splice(doors, 1, { title: "Door, open", picture: sample(door) }, { title: "Door, closed", picture: sample(door, { open: [0] }) });
      return [...rows, { title: "State unknown", picture: sample(kindById("thing"), { unknown: true }) }];
    },
  },
  mounted() {
    const plan = new Plan(this.$refs.pad, (names) => { this.late = names; });
    this.plan = plan;
    this.revealed = null; // object to scroll into view once the map has been read
    this.asked = []; // selections sent to the page and not yet confirmed
    plan.turnable = (name) => this.doing === "edit" && !["ground", "itself"].includes(plan.model.kind(name)?.moves);
    plan.cornered = (name) => this.doing === "edit" && !this.placing && !plan.sketch && plan.corners.of(name) !== null;
    plan.offered = (name) => this.doing === "pick" && this.draggable(name);
    plan.drawn = (view) => this.drawn(view);
    plan.storey = this.storey_name ?? null;
    this.look();
    this.hands = new Hands(this.$refs.pad, this.deeds());
    this.watching = new ResizeObserver(([entry]) => plan.resize(entry.contentRect.width, entry.contentRect.height));
    this.watching.observe(this.$refs.pad);
    this.live = new Live((news) => this.hear(news));
    this.poses = new Poses((poses) => plan.see(poses), (shares) => plan.swing(shares));
    if (!this.past()) this.poses.follow();
    this.trafficNews = new TrafficNews((news) => this.hearTraffic(news));
    if (sessionStorage.getItem(TRAFFIC) && !this.past()) this.showTraffic(true);
  },
  unmounted() {
    this.connection?.off("disconnect", this.giveUp);
    this.live.end();
    this.trafficNews.end();
    this.poses.end();
    this.watching.disconnect();
    this.hands.end();
    this.plan.end();
    clearTimeout(this.nudging);
    clearTimeout(this.keeping);
  },
  watch: {
    selected(name) {
      // The page's confirmations of earlier selections must not replace a later one.
      const answered = this.asked.indexOf(name ?? null);
      this.asked = answered < 0 ? [] : this.asked.slice(answered + 1);
      if (this.asked.length === 0) this.look();
    },
    highlighted: { deep: true, handler() { this.look(); } },
    arrows: { deep: true, handler() { this.look(); } },
    relations: { deep: true, handler() { this.look(); this.plan.refresh(); } },
    storey_name(name) { if (name && name !== this.plan.storey) this.goTo(name); },
    doing() { this.cancel(); this.plan.draw(); },
    version() { this.turnTo(); },
  },
  methods: {
    // Calls from the page

    fit() { this.plan.fit(); },
    show(name) {
      if (this.loading) { this.revealed = name; return; }
      if (!this.plan.reveal(name)) this.say(`${name} has no position on the map.`);
      this.after();
    },
    settled(name, version) { this.plan.settle(name, version); },
    back(name) { this.plan.back(name); },
    giveUp() {
      const names = this.plan.giveUp();
      if (names.length) this.$emit("unanswered", { names });
    },
    place(type, values = {}) {
      if (!type && !this.placing) return; // a late cancel must not stop a drag
      this.placing = type ?? false;
      this.plan.sketch = this.corners = null;
      this.values = values;
      this.plan.ghost = null;
      this.turned = 0;
      this.plan.target = null;
      if (type) {
        this.$refs.pad.focus({ preventScroll: true });
        this.tryAt(this.plan.view);
      }
      this.plan.draw();
    },
    focus() { this.$refs.pad.focus({ preventScroll: true }); },
    say(text) { this.said = text; },

    // Traffic

    showTraffic(shown) {
      this.traffic = shown;
      if (shown) {
        sessionStorage.setItem(TRAFFIC, "shown");
        this.trafficNews.begin();
        return;
      }
      sessionStorage.removeItem(TRAFFIC);
      this.hideTraffic();
    },
    hideTraffic() {
      this.trafficNews.end();
      this.plan.showRoads(null);
      this.plan.showWays([]);
      [this.waiting, this.hold] = [[], ""];
    },
    hearTraffic({ traffic, roadmap, lost }) {
      this.unknown = lost === true;
      if (roadmap) this.plan.showRoads(roadmap);
      if (!traffic) return;
      this.plan.showWays(traffic.robots);
      this.waiting = traffic.robots.filter((robot) => robot.waiting);
      this.hold = traffic.hold;
    },

    // News of the map

    hear(news) {
      if (news.lost) { this.lost = true; return; }
      this.lost = false;
      if (news.definitions) {
        this.definitions = news.definitions;
        if (this.past()) this.turnTo();
        else this.read(news.map, news.definitions);
      } else if (!this.past()) {
        this.plan.apply(news.changes, news.version);
        this.after();
      }
    },
    read(map, definitions) {
      this.plan.learn(definitions);
      const kept = this.loading && this.mode === "edit" ? JSON.parse(sessionStorage.getItem(KEPT)) : null;
      if (kept) this.plan.storey ??= kept.storey;
      this.plan.read(map, this.loading);
      if (kept && kept.storey === this.plan.storey && !kept.view.fitted) Object.assign(this.plan.view, kept.view);
      this.loading = false;
      if (this.revealed !== null) this.show(this.revealed);
      this.revealed = null;
      this.after();
      this.$emit("loaded", { version: map.version, objects: map.objects.length });
    },
    past() { return this.version !== undefined && this.version !== null; },
    async turnTo() {
      if (!this.definitions) return;
      const wanted = this.version;
      this.plan.forget();
      if (this.past()) {
        this.poses.rest();
        this.hideTraffic();
      } else {
        this.poses.follow();
        if (this.traffic) this.trafficNews.begin();
      }
      try {
        // A past map is drawn with the ontology of its time.
        const then = this.past() ? `?version=${wanted}` : "";
        const [map, known] = await Promise.all([get(`/api/map${then}`), then ? get(`/api/ontology${then}`) : { definitions: this.definitions }]);
        if (wanted === this.version) { this.read(map, known.definitions); this.trouble = ""; }
      } catch (error) {
        if (wanted === this.version) this.trouble = error.message;
      }
    },
    after() {
      const { model } = this.plan;
      this.storeys = model.storeys();
      if (this.storey !== this.plan.storey) {
        this.storey = this.plan.storey;
        this.$emit("storey", { name: this.storey, alone: this.storeys.length < 2 });
      }
      this.unplaced = this.plan.unplaced();
      this.shown = this.plan.names().length;
      this.kinds = [...new Set(this.plan.names().map((name) => model.kind(name).id))];
    },
    look() {
      const { plan } = this;
      if (this.asked.length === 0) plan.selected = this.selected ?? null;
      plan.found = new Map(this.highlighted.map((one) => (typeof one === "string" ? [one, ""] : [one.name, one.mark ?? ""])));
      plan.relations = this.relations;
      plan.arrows = this.arrows.map((one) => ({ from: plan.spot(one.thing), to: one.target ? plan.spot(one.target) : { x: one.x, y: one.y } }));
      plan.draw();
    },
    drawn(view) {
      this.bar = view.bar();
      if (this.mode !== "edit" || this.loading) return;
      clearTimeout(this.keeping);
      this.keeping = setTimeout(() => {
        const { x, y, scale, fitted } = view;
        sessionStorage.setItem(KEPT, JSON.stringify({ storey: this.plan.storey, view: { x, y, scale, fitted } }));
      }, 300);
    },
    goTo(storey) { this.plan.choose(storey); this.after(); },
    zoomBy(factor) { this.plan.view.zoom(factor); this.plan.draw(); },

    ...doings,
  },
};
