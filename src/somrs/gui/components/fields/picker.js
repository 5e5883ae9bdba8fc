// A field for choosing an item by typing part of its name, label or type. The choices are passed in, or come from the API, which suits
// large maps.

const PAUSE = 80; // milliseconds without typing before the API is called
const LISTED = 100; // choices listed at once

export default {
  template: `
    <div class="somrs-pick" :class="{'somrs-pick-bad': bad}">
      <i v-if="symbol" class="material-icons somrs-pick-symbol" aria-hidden="true">{{ symbol }}</i>
      <input ref="input" type="text" role="combobox" class="somrs-pick-input" autocomplete="off" spellcheck="false" :value="shown"
        :placeholder="placeholder" :aria-label="label" :disabled="disable" aria-autocomplete="list" :aria-expanded="open"
        :aria-controls="name + '-list'" :aria-activedescendant="open && chosen >= 0 ? name + '-' + chosen : undefined"
        :aria-invalid="bad" :title="bad || undefined"
        @focus="begin" @click="begin" @input="onInput" @keydown="onKey" @blur="leave" />
      <i class="material-icons somrs-pick-turn" aria-hidden="true" @mousedown.prevent="open ? end() : $refs.input.focus()">expand_more</i>
      <ul v-show="open" ref="list" class="somrs-fe-list" role="listbox" :id="name + '-list'" :aria-label="label" :style="at">
        <template v-for="(item, index) in items" :key="item.value">
          <li v-if="item.group && item.group !== items[index - 1]?.group" class="somrs-pick-group" role="presentation">{{ item.group }}</li>
          <li role="option" :id="name + '-' + index" :aria-selected="index === chosen" :class="{'somrs-fe-chosen': index === chosen}"
            @mousedown.prevent="take(index)">
            <i v-if="item.symbol" class="material-icons" aria-hidden="true">{{ item.symbol }}</i>
            <span class="somrs-fe-word">{{ item.text ?? item.value }}</span><span class="somrs-fe-detail">{{ item.detail }}</span>
          </li>
        </template>
        <li v-if="!items.length" class="somrs-pick-none" role="presentation">{{ waiting ? 'Searching…' : lost ? 'The system does not answer.' : 'No matches.' }}</li>
        <li v-else-if="more" class="somrs-pick-none" role="presentation">More results: type part of the name.</li>
      </ul>
    </div>`,
  props: {
    value: String, label: String, placeholder: String, options: Array, source: Object, disable: Boolean, problem: String, id: String,
  },
  emits: ["pick"],
  data() {
    return { picked: this.value ?? "", typed: null, open: false, items: [], chosen: -1, at: {}, more: false, waiting: false, lost: false, known: {} };
  },
  created() {
    this.asked = 0;
    this.moved = false; // whether the user has moved in the list since typing
    this.takesFirst = false; // whether the first choice of the answer under way is taken: Enter or Tab was pressed before it came
  },
  mounted() {
    this.recognise();
    // The list follows its field. It stays open: the event of a scrolling that brought the field into view comes after the click on it.
    this.follow = (event) => event.target !== this.$refs.list && this.place();
    window.addEventListener("scroll", this.follow, true);
    window.addEventListener("resize", this.follow);
  },
  beforeUnmount() {
    clearTimeout(this.timer);
    window.removeEventListener("scroll", this.follow, true);
    window.removeEventListener("resize", this.follow);
  },
  computed: {
    name() { return `pick-${this.id}`; },
    item() { return this.options?.find((one) => one.value === this.picked) ?? this.known[this.picked]; },
    symbol() { return this.typed === null ? this.item?.symbol : "search"; },
    shown() { return this.typed ?? this.item?.text ?? this.picked; },
    bad() { return this.problem || ""; },
    searching() { return Boolean(this.waiting && this.typed); },
  },
  watch: {
    value(value) { this.picked = value ?? ""; this.recognise(); },
    source(source, sourceBefore) {
      if (JSON.stringify(source) !== JSON.stringify(sourceBefore)) this.items = [];
    },
    options() {
      // Choices may come after the user has opened the list, and typed.
      if (this.open && !this.source) this.look(this.typed ?? "");
    },
  },
  methods: {
    begin() {
      if (this.open || this.disable) return;
      this.open = true;
      this.moved = this.takesFirst = false;
      this.$refs.input.select();
      this.chosen = this.items.findIndex((one) => one.value === this.picked);
      this.look("");
    },
    leave() {
      if (this.takesFirst) this.open = false;
      else this.end();
    },
    end() {
      clearTimeout(this.timer);
      this.asked++;
      this.open = this.takesFirst = false;
      this.typed = null;
      // Show the chosen value again.
      if (this.$refs.input) this.$refs.input.value = this.shown;
    },
    onInput(event) {
      this.typed = event.target.value;
      this.open = true;
      this.moved = this.takesFirst = false;
      clearTimeout(this.timer);
      if (this.source) {
        this.narrow();
        this.timer = setTimeout(() => this.look(this.typed), PAUSE);
      } else this.look(this.typed);
    },
    narrow() {
      // Filter the list at once, and choose nothing from it: the answer may have a better match.
      this.asked++;
      this.waiting = true;
      const wanted = this.typed.toLowerCase();
      this.items = this.items.filter(({ value, detail }) => `${value} ${detail}`.toLowerCase().includes(wanted));
      this.chosen = -1;
    },
    async look(typed) {
      const asked = ++this.asked;
      let found;
      if (this.source) {
        this.waiting = true;
        found = await this.ask(typed);
        if (asked !== this.asked) return;
        this.waiting = false;
      } else {
        const wanted = typed.toLowerCase();
        const match = ({ value, text, detail }) => {
          const place = (text ?? value).toLowerCase().indexOf(wanted);
          return place >= 0 ? Math.min(place, 1) : (detail ?? "").toLowerCase().includes(wanted) ? 2 : 3;
        };
        const ranked = this.options.map((item) => [match(item), item]).filter(([rank]) => rank < 3);
        // Without a search, keep groups together.
        found = (wanted ? ranked.sort((a, b) => a[0] - b[0]) : ranked).slice(0, LISTED).map(([, item]) => item);
        this.more = ranked.length > LISTED;
      }
      const marked = this.moved ? this.items[this.chosen]?.value : undefined;
      this.items = found;
      this.chosen = found.findIndex((one) => one.value === (marked ?? this.picked));
      if (typed && (marked === undefined || this.chosen < 0)) this.chosen = found.length ? 0 : -1;
      if (this.takesFirst) {
        this.takesFirst = false;
        if (found.length) this.take(0);
        else if (document.activeElement !== this.$refs.input) this.end();
        return;
      }
      this.$nextTick(() => {
        this.place();
        this.show();
      });
    },
    async ask(typed, limit = 40) {
      try {
        const answer = await fetch(`/api/formulas/things?${new URLSearchParams({ ...this.source, typed, limit })}`);
        if (!answer.ok) throw new Error(answer.status);
        const { things, more } = await answer.json();
        Object.assign(this, { more, lost: false });
        const items = things.map(({ name, type, symbol, label, where }) => ({
          value: name, symbol, detail: [type, label, where && `at ${where}`].filter(Boolean).join(", "),
        }));
        for (const item of items) this.known[item.value] = item;
        return items;
      } catch {
        Object.assign(this, { more: false, lost: true });
        return [];
      }
    },
    recognise() {
      // Fetch the symbol of a value of which only the name is known.
      if (this.source && this.picked && !this.known[this.picked]) this.ask(this.picked, 5);
    },
    place() {
      if (!this.open || !this.$refs.list) return;
      const box = this.$el.getBoundingClientRect();
      const height = this.$refs.list.offsetHeight;
      const below = box.bottom + height + 4 < window.innerHeight || box.top < height + 8;
      const left = Math.max(8, Math.min(box.left, window.innerWidth - this.$refs.list.offsetWidth - 8));
      this.at = { left: `${left}px`, top: `${below ? box.bottom + 2 : box.top - height - 2}px`, minWidth: `${box.width}px` };
    },
    show() {
      this.$refs.list?.querySelector(".somrs-fe-chosen")?.scrollIntoView({ block: "nearest" });
    },
    take(index) {
      const item = this.items[index];
      if (!item) return;
      this.picked = item.value;
      this.end();
      this.$emit("pick", item.value);
    },
    takeSoon() {
      // Take what is chosen, or else the first match once it is known.
      if (this.chosen >= 0) this.take(this.chosen);
      else this.takesFirst = true;
    },
    onKey(event) {
      const moves = { ArrowDown: 1, ArrowUp: -1, PageDown: 8, PageUp: -8 };
      if (event.key in moves) {
        if (!this.open) this.begin();
        else [this.moved, this.chosen] = [true, Math.max(0, Math.min(this.items.length - 1, this.chosen + moves[event.key]))];
        this.$nextTick(this.show);
      } else if (event.key === "Enter" && this.open && (this.chosen >= 0 || this.searching)) this.takeSoon();
      else if (event.key === "Escape" && this.open) this.end();
      else if (event.key === "Tab" && this.open && this.typed !== null && (this.chosen >= 0 || this.searching)) {
        // Tab after typing takes the first match.
        this.takeSoon();
        return;
      } else return;
      event.preventDefault();
      event.stopPropagation();
    },
    focus() { this.$refs.input.focus(); },
  },
};
