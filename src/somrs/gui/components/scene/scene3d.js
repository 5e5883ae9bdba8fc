// The 3D view: scene, motion and camera. `__init__.py` documents its use.
import { Feed, Labels, Marks, Motion, Pilot, Stage, World, described, listed, summary, template } from "somrs-scene";

const LISTED = 200;

export default {
  template,

  props: {
    height: { type: String, default: "60vh" },
    follow: { type: String, default: null },
    chosen: { type: String, default: null },
    highlighted: { type: Array, default: () => [] },
    version: { type: Number, default: null },
    storey: { type: String, default: null },
  },
  emits: ["select", "storey"],

  data() {
    return {
      id: `scene${Math.random().toString(36).slice(2)}`,
      none: false,
      words: "3D view",
      trouble: null,
      alive: true,
      problems: [],
      storeys: [],
      shownStorey: null, // one of them; null: all
      robots: [],
      following: null,
      selected: this.chosen,
      card: null,
      listOpen: false,
      wanted: "",
      rows: { rows: [], more: 0 },
      named: true,
      low: true,
    };
  },

  computed: {
    tools() {
      const button = (icon, label, tip, act, pressed) => ({ icon, label, tip, act, pressed });
      return [
        button("fit_screen", "Show all", "Show all (F)", () => this.fit()),
        button("map", "From above", "Look from above (T)", () => this.fit({ fromAbove: true })),
        button("add", "Zoom in", "Zoom in (+)", () => this.pilot.zoom(0.8)),
        button("remove", "Zoom out", "Zoom out (-)", () => this.pilot.zoom(1.25)),
        button("label", "Names", "Names of things", () => this.setNamed(!this.named), this.named),
        button("carpenter", "Low walls", "Cut walls low, to see inside", () => this.setLow(!this.low), this.low),
        button("list", "List", "List of objects", () => this.setList(!this.listOpen), this.listOpen),
      ];
    },
  },

  watch: {
    follow(name) {
      this.setFollowed(name);
    },
    chosen(name) {
      if (name === this.selected) return;
      this.selected = name;
      this.mark();
      this.tell();
    },
    highlighted() {
      this.mark();
    },
    storey() {
      this.toStorey();
    },
    version() {
      this.feed.stop();
      this.motion.restart();
      this.world.works.clear();
      this.alive = true;
      this.begin();
    },
  },

  mounted() {
    // Not reactive: Vue would wrap thousands of objects.
    this.motion = new Motion();
    try {
      this.stage = new Stage(this.$refs.canvas, (now) => this.step(now));
    } catch {
      this.none = true;
    }
    this.world = new World(this.stage?.scene ?? { add() {} });
    if (this.stage) this.equip();
    this.begin();
    window.somrsScene = {
      where: (name) => this.world.where(name),
      names: () => [...this.world.bodies.keys()],
      frames: () => this.stage?.frames ?? 0,
      at: (name) => this.onScreen(name),
      drawn: () => Boolean(this.shown),
      refined: () => Boolean(this.stage?.refined),
    };
    this.timer = setInterval(() => {
      if (this.none) this.step(performance.now() / 1000); // without a picture, the list shows the positions
      if (this.toldLate) this.tell();
    }, 500);
  },

  beforeUnmount() {
    clearInterval(this.timer);
    this.feed.stop();
    this.resizing?.disconnect();
    this.seeing?.disconnect();
    this.theming?.disconnect();
    document.removeEventListener("visibilitychange", this.looked);
    this.marks?.dispose();
    this.world.dispose();
    this.pilot?.dispose();
    this.stage?.dispose();
  },

  methods: {
    equip() {
      const view = this.$refs.view;
      this.pilot = new Pilot(this.stage, view);
      this.labels = new Labels(this.$refs.labels, this.stage, this.world);
      this.marks = new Marks(this.stage.scene, this.world);
      this.stage.drawn = () => this.labels.draw(view.clientWidth, view.clientHeight);
      this.resizing = new ResizeObserver(() => {
        this.stage.resize(view.clientWidth, view.clientHeight);
        if (this.shown && !this.pilot.moved && !this.following) this.fit({ at_once: true });
      });
      this.resizing.observe(view);
      this.seeing = new IntersectionObserver(([entry]) => {
        this.inSight = entry.isIntersecting;
        this.looked();
      });
      this.seeing.observe(view);
      document.addEventListener("visibilitychange", this.looked);
      this.theming = new MutationObserver(() => this.theme());
      this.theming.observe(document.body, { attributes: true, attributeFilter: ["class"] });
      view.addEventListener("pointerdown", (event) => (this.pressed = [event.clientX, event.clientY]));
      view.addEventListener("pointerup", (event) => this.clicked(event));
      this.theme();
    },

    begin() {
      this.feed = new Feed(
        {
          scene: (scene) => this.show(scene),
          changed: (scene, names) => this.change(scene, names),
          placed: (name, relation, object, is) => this.placed(name, relation, object, is),
          movers: (movers) => {
            this.motion.set(movers);
            this.world.works.clear();
            this.labels?.clear();
            this.stage?.want();
          },
          robots: (works) => this.work(works),
          frame: (clock, which, values) => {
            this.motion.hear(clock, which, values, performance.now() / 1000);
            if (which.length) this.stage?.want();
          },
          alive: (alive) => (this.alive = alive),
          trouble: (text) => (this.trouble = text),
        },
        this.version,
      );
      this.feed.isMover = (name) => this.world.drawn.has(name) && this.motion.tracks.has(name);
    },

    // News from the server

    show(scene) {
      this.title = scene.title;
      this.problems = scene.problems;
      this.world.show(scene);
      if (!this.shown) this.toStorey();
      this.replay();
      this.settle();
      if (this.pilot && !this.shown) {
        this.shown = true;
        if (this.following === null && this.follow) this.setFollowed(this.follow);
        if (!this.following) this.fit({ at_once: true });
      }
      this.shown = true;
    },

    change(scene, names) {
      this.world.change(scene, names);
      this.problems = [...this.problems.filter((text) => !names.some((name) => text.startsWith(`${name}:`))), ...scene.problems];
      for (const name of names) this.labels?.changed(name);
      this.replay();
      this.settle();
    },

    replay() {
      // Known poses are newer than those of the map.
      for (const track of this.motion.movers) if (track.drawn) this.world.move(track.name, track.drawn);
    },

    settle() {
      // Objects were added, removed or changed.
      this.robots = [...this.world.bodies.values()].filter((body) => body.kind === "robot").map((body) => body.name).sort();
      this.storeys = this.world.storeys;
      this.turnTo(this.storeys.find((one) => one.name === this.shownStorey?.name && one.z === this.world.level) ?? this.world.level);
      this.labels?.clear();
      this.mark();
      this.stage?.enclose(this.world.bounds());
      this.tell();
    },

    placed(name, relation, object, is) {
      const body = this.world.bodies.get(name);
      if (!body) return;
      if (is) body.at = { relation, object };
      else if (body.at?.relation === relation && body.at.object === object) body.at = null;
      this.toldLate = true;
    },

    work(works) {
      for (const [name, work] of Object.entries(works)) {
        this.world.works.set(name, work);
        this.labels?.changed(name);
      }
      this.toldLate = true;
      this.stage?.want();
    },

    tell() {
      // Not at every frame: update the texts.
      this.toldLate = false;
      this.words = summary(this.title, this.world);
      if (this.listOpen || this.none) this.rows = listed(this.world, this.wanted, LISTED);
      const body = this.selected && this.world.bodies.get(this.selected);
      this.card = body ? { name: body.name, title: body.label ?? body.name, type: body.type, words: described(this.world, this.selected) } : null;
    },

    // Drawing

    step(now) {
      if (this.motion.active) {
        this.motion.play(now, (name, pose) => this.world.move(name, pose));
        this.toldLate = true;
        this.stage?.moved();
      }
      const goes = this.pilot?.step(now);
      this.marks?.place();
      return this.motion.active || goes;
    },

    theme() {
      const dark = document.body.classList.contains("body--dark");
      const color = (name) => getComputedStyle(document.body).getPropertyValue(name).trim();
      this.world.colors.cap = color("--wall") || "#5b7083";
      this.marks.color(color("--accent") || "#1f5f99");
      this.stage.theme(dark);
      if (this.shown) this.world.build();
    },

    looked() {
      const seen = this.inSight !== false && !document.hidden;
      this.stage.rest(!seen);
      if (this.version !== null) return;
      clearTimeout(this.leaving);
      if (seen) this.feed.follow();
      else this.leaving = setTimeout(() => this.feed.rest(), 5000);
    },

    mark() {
      if (!this.marks) return;
      const marked = new Map(this.highlighted.map(({ name, mark }) => [name, mark]));
      for (const name of new Set([...marked.keys(), ...this.labels.marked.keys(), this.selected, this.labels.selected])) this.labels.changed(name);
      this.labels.marked = marked;
      this.labels.selected = this.selected;
      this.marks.set(new Set([...marked.keys(), ...(this.selected ? [this.selected] : [])]));
      this.stage.want();
    },

    // User actions

    fit(how = {}) {
      this.setFollowed(null);
      this.pilot.fit(this.world.bounds(), how);
    },

    setNamed(named) {
      this.named = this.labels.on = named;
      this.stage.want();
    },

    setLow(low) {
      this.low = this.world.low = low;
      this.world.build();
      this.stage.enclose(this.world.bounds());
    },

    setStorey(number) {
      this.turnTo(this.storeys[number] ?? null);
      this.tellStorey();
      this.fit();
    },

    tellStorey() {
      this.$emit("storey", { name: this.shownStorey?.name ?? null });
    },

    toStorey() {
      // The page's search; an empty text means all.
      if (this.world.storeys.length < 2) return;
      const storey = this.storey === "" ? null : this.world.storeys.find((one) => one.name === this.storey);
      if (storey !== undefined) this.turnTo(storey);
    },

    turnTo(storey) {
      // A storey, with the others of its height; a level stands for the first storey at that height, null for all.
      this.shownStorey = typeof storey === "number" ? (this.world.storeys.find((one) => one.z === storey) ?? null) : storey;
      const level = this.shownStorey?.z ?? null;
      if (level === this.world.level) return;
      this.world.level = level;
      this.world.build();
      this.stage?.enclose(this.world.bounds());
    },

    reveal(name) {
      // Show the storey of the object, if another one is shown.
      const at = this.world.where(name);
      if (!at || this.world.visible(name)) return;
      this.turnTo(this.world.levelAt(at.z));
      this.tellStorey();
    },

    setList(open) {
      this.listOpen = open;
      this.tell();
    },

    setFollowed(name) {
      this.following = name;
      if (!this.pilot) return;
      if (name !== null) this.reveal(name);
      this.pilot.follow(name === null ? null : () => this.point(name));
    },

    point(name) {
      // The point that the camera targets for the object.
      const at = this.world.where(name);
      if (!at) return null;
      const Vector3 = this.stage.camera.position.constructor;
      return new Vector3(at.x, at.y, at.z + Math.min(this.world.top(name) / 2, 0.6));
    },

    find(name) {
      this.select(name);
      this.reveal(name);
      const point = this.pilot && this.point(name);
      if (point && !this.following) this.pilot.look(point, Math.max(3, 5 * this.world.bodies.get(name).size));
    },

    select(name) {
      if (name === this.selected) return;
      this.selected = name;
      this.mark();
      this.tell();
      this.$emit("select", { name });
    },

    clicked(event) {
      if (!this.pressed || Math.hypot(event.clientX - this.pressed[0], event.clientY - this.pressed[1]) > 5) return;
      const area = this.$refs.view.getBoundingClientRect();
      const x = ((event.clientX - area.left) / area.width) * 2 - 1;
      const y = 1 - ((event.clientY - area.top) / area.height) * 2;
      const found = this.world.pick(this.stage.ray(x, y));
      this.select(found && !["floor", "wall"].includes(this.world.bodies.get(found).kind) ? found : null);
    },

    key(event) {
      if (this.pilot.key(event)) this.pilot.moved = true;
      else if (event.key === "f" || event.key === "F") this.fit();
      else if (event.key === "t" || event.key === "T") this.fit({ fromAbove: true });
      else if (event.key === "Escape") {
        this.setFollowed(null);
        this.select(null);
      } else return;
      event.preventDefault();
    },

    onScreen(name) {
      // For tests: the position of the object in the picture, in px.
      this.stage.camera.updateMatrixWorld();
      const point = this.point(name)?.project(this.stage.camera);
      const { clientWidth, clientHeight } = this.$refs.view;
      return point ? { x: ((point.x + 1) / 2) * clientWidth, y: ((1 - point.y) / 2) * clientHeight } : null;
    },
  },
};
