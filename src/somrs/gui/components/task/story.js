// The story of a task in chapters: events, recovery actions and results. And all events, as a list that grows.

import { clock, feed, since } from "somrs-task";

const SHOWN = 300; // events shown at first, the latest; the others on demand

export default {
  template: `
    <div class="somrs-telling">
      <div class="somrs-telling-tabs" role="tablist" aria-label="The story, or all events" @keydown="onKey">
        <button v-for="one in tabs" :key="one.name" type="button" role="tab" :id="one.id" :aria-selected="tab === one.name"
          :tabindex="tab === one.name ? 0 : -1" :aria-controls="own" @click="tab = one.name"><i class="material-icons" aria-hidden="true">{{ one.icon }}</i>{{ one.label }}</button>
      </div>
      <div ref="view" class="somrs-telling-view" :id="own" role="tabpanel" tabindex="0" :aria-label="tab" @scroll.passive="onScroll">
        <ol v-if="tab === 'Story'" class="somrs-story">
          <li v-for="(one, index) in chapters" :key="index" class="somrs-chapter" :class="['somrs-tone-' + one.tone, {'somrs-failure': one.failure}]">
            <i class="material-icons somrs-chapter-icon" aria-hidden="true">{{ one.icon }}</i>
            <div class="somrs-chapter-head"><span class="somrs-chapter-title">{{ one.title }}</span><span class="somrs-moment" :title="one.clock">{{ one.moment }}</span></div>
            <div v-if="one.text" class="somrs-chapter-text">{{ one.text }}</div>
            <div v-for="wait in one.waits" :key="wait.href" class="somrs-chapter-text somrs-waits">Waits for
              <a class="somrs-formula" :href="wait.href">{{ wait.goal }}</a>, which {{ wait.reserved }}.</div>
            <div v-if="one.left" class="somrs-chapter-text"><span class="somrs-soft">Resulting situation: </span><span class="somrs-formula">{{ one.left }}</span></div>
            <ul v-if="one.lines.length" class="somrs-answers">
              <li v-for="(line, place) in one.lines" :key="place"><span v-if="line.recovery" class="somrs-recovery">{{ line.recovery }}</span><span>{{ line.text }}</span>
                <span v-if="line.moment" class="somrs-moment" :title="line.clock">{{ line.moment }}</span></li>
            </ul>
            <div v-if="one.failure" class="somrs-result" :class="'somrs-tone-' + one.result_tone"><i class="material-icons" aria-hidden="true">{{ one.result_icon }}</i>
              <span>{{ one.result }}</span><span v-if="one.took" class="somrs-moment">{{ one.took }}</span></div>
          </li>
        </ol>
        <ol v-else class="somrs-events">
          <li v-if="hidden"><button type="button" class="somrs-link" @click="most = Infinity">Show {{ hidden }} earlier events</button></li>
          <li v-for="event in latest" :key="event.number" class="somrs-event" :class="'somrs-tone-' + event.tone">
            <span class="somrs-moment" :title="event.clock">{{ event.moment }}</span>
            <i class="material-icons" role="img" :aria-label="event.kind" :title="event.kind">{{ event.icon }}</i><span>{{ event.text }}</span>
          </li>
        </ol>
      </div>
    </div>`,
  props: { task: String, chapters: Array },
  data() {
    return { tab: "Story", count: 0, most: SHOWN };
  },
  computed: {
    tabs() {
      return [
        { name: "Story", label: "Story", icon: "auto_stories", id: `${this.own}-story` },
        { name: "Events", label: this.count ? `All events (${this.count})` : "All events", icon: "list", id: `${this.own}-events` },
      ];
    },
    hidden() {
      return Math.max(0, this.count - this.most);
    },
    latest() {
      return this.count ? this.events.slice(-this.most).map((event) => told(event, this.start)) : [];
    },
  },
  watch: {
    chapters() {
      this.$nextTick(this.stay);
    },
    count() {
      this.$nextTick(this.stay);
    },
    tab() {
      this.tail = this.running;
      this.$nextTick(this.stay);
    },
  },
  created() {
    this.own = `somrs-telling-${this.task.slice(-12)}`;
    this.events = [];
    this.running = false;
    this.tail = null; // whether the end is in view and stays there
  },
  mounted() {
    this.leave = feed(this.task).listen(({ view, events }) => {
      this.running = !view.outcome;
      this.tail ??= this.running;
      this.start = view.submitted_at;
      this.events = events;
      this.count = events.length;
    });
  },
  unmounted() {
    this.leave();
  },
  methods: {
    stay() {
      const { view } = this.$refs;
      if (this.tail && view) view.scrollTop = view.scrollHeight;
    },
    onScroll() {
      const { view } = this.$refs;
      this.tail = this.running && view.scrollTop + view.clientHeight > view.scrollHeight - 30;
    },
    onKey(event) {
      if (event.key !== "ArrowLeft" && event.key !== "ArrowRight") return;
      this.tab = this.tab === "Story" ? "Events" : "Story";
      this.$nextTick(() => this.$el.querySelector('[aria-selected="true"]').focus());
      event.preventDefault();
    },
  },
};

const ICONS = {
  news: "chevron_right", setback: "error", handler: "rule", replace: "sync", replan: "alt_route", wait: "hourglass_empty", look: "visibility", undo: "undo", end: "flag",
};

function told(event, start) {
  return {
    number: event.number,
    kind: event.kind,
    icon: ICONS[event.kind] ?? "chevron_right",
    tone: event.kind === "setback" ? "bad" : event.kind === "news" || event.kind === "end" ? "plain" : "busy",
    moment: `+${since(event.at - start)}`,
    clock: clock(event.at),
    text: event.step ? `${event.step}: ${event.text}` : event.text,
  };
}
