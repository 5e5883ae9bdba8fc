// A field for a formula with completion and checking.
//
// A transparent textarea lies over the coloured text, so that keyboard, selection, undo and screen readers work as in any other field. The
// element calls the API itself, so that typing does not wait for the page's own connection.

import { follow } from "live";
import { counted, pieces, placed, proposals } from "somrs-formula";

const CHECK = 180; // milliseconds without typing before the text is checked
const AGAIN = 2000; // milliseconds before a failed request is repeated
const ICONS = {
  object: "category", relation: "link", attribute: "tune", value: "sell", type: "account_tree", variable: "help_outline",
  function: "functions", keyword: "join_inner", operator: "drag_handle", unit: "straighten",
};

async function ask(path, body) {
  const answer = await fetch(`/api/formulas/${path}`, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) });
  if (!answer.ok) throw new Error(`${answer.status}`);
  return answer.json();
}

// All fields of a page share one connection for news of the map and the ontology.
const fields = new Set();
let leave = null;

function join(field) {
  fields.add(field);
  leave ??= follow(["map", "ontology"], { open: () => fields.forEach((one) => one.again()), news: (news) => fields.forEach((one) => one.hear(news)) });
  return () => {
    fields.delete(field);
    if (fields.size) return;
    leave();
    leave = null;
  };
}

export default {
  template: `
    <div class="somrs-fe" :class="{'somrs-fe-bad': bad, 'somrs-fe-off': disable}">
      <label v-if="label" class="somrs-fe-label" :for="name">{{ label }}</label>
      <div class="somrs-fe-box" @click="$refs.area.focus()">
        <pre ref="back" class="somrs-fe-back somrs-formula" aria-hidden="true"><span v-for="piece in shown" :class="look(piece)"
          :ref="piece.mark ? 'mark' : undefined">{{ piece.end && piece.wrong ? '\\u00a0' : piece.text }}</span>{{ '\\n' }}</pre>
        <textarea ref="area" class="somrs-fe-area somrs-formula" :id="name" v-model="text" :rows="rows" :placeholder="placeholder"
          :disabled="disable" spellcheck="false" autocomplete="off" autocapitalize="off" autocorrect="off" wrap="soft"
          aria-autocomplete="list" :aria-controls="name + '-list'" :aria-activedescendant="open && chosen >= 0 ? name + '-' + chosen : undefined"
          :aria-invalid="bad" :aria-describedby="name + '-said'" :aria-label="label ? undefined : 'Formula'"
          @input="onInput" @keydown="onKey" @blur="close" @click="close"></textarea>
      </div>
      <ul v-show="open" ref="list" class="somrs-fe-list" role="listbox" :id="name + '-list'" aria-label="Completions" :style="at">
        <li v-for="(item, index) in items" role="option" :id="name + '-' + index" :aria-selected="index === chosen"
          :class="{'somrs-fe-chosen': index === chosen}" @mousedown.prevent="accept(index)">
          <i class="material-icons" :class="'somrs-fe-' + item.kind" aria-hidden="true">{{ icon(item.kind) }}</i>
          <span class="somrs-fe-word somrs-formula">{{ item.text }}</span><span class="somrs-fe-detail">{{ item.detail }}</span>
        </li>
      </ul>
      <div class="somrs-fe-heard" aria-live="polite">{{ heard }}</div>
      <div class="somrs-fe-said" :id="name + '-said'" role="status">
        <div v-if="lost" class="somrs-fe-soft"><i class="material-icons" aria-hidden="true">cloud_off</i>
          <span>Not checked: the system does not answer. Your input is kept.</span></div>
        <div v-else-if="text.trim() && found.unfinished && found.problems.length && !open" class="somrs-fe-soft"><i class="material-icons" aria-hidden="true">more_horiz</i>
          <span>Incomplete: {{ found.problems[0].hint }}.</span></div>
        <div v-else-if="bad" v-for="one in wrong" class="somrs-fe-problem"><i class="material-icons" aria-hidden="true">error</i>
          <span><button type="button" class="somrs-fe-place" @click="go(one)">{{ one.problem }}</button><template v-if="one.proposals.length">; did you mean
              <template v-for="(word, index) in one.proposals">{{ index ? ' or ' : '' }}<button type="button" class="somrs-fe-use somrs-formula"
                :aria-label="'Write ' + word + ' instead'" @click="mend(one, word)">{{ word }}</button></template>?</template>
            <span v-else-if="one.hint" class="somrs-fe-hint">; {{ one.hint }}</span></span></div>
        <div v-else-if="found.ok && hindrances.length" v-for="one in hindrances" class="somrs-fe-hindrance">
          <i class="material-icons" aria-hidden="true">warning</i>
          <span>The formula is valid, but {{ one.problem }}<span v-if="one.hint" class="somrs-fe-hint">; {{ one.hint }}</span>.</span></div>
        <div v-else-if="found.ok" class="somrs-fe-good"><i class="material-icons" aria-hidden="true">check_circle</i>
          <span>{{ good }}</span></div>
      </div>
    </div>`,
  props: {
    value: String, label: String, placeholder: String, rows: Number, variables: Object, types: Array, good: String, goal: Boolean, disable: Boolean, id: String,
  },
  emits: ["update:value", "checked", "submit"],
  data() {
    return {
      text: this.value ?? "", found: { ok: false, unfinished: true, problems: [] }, checkedText: null, lost: false,
      open: false, items: [], chosen: -1, from: 0, to: 0, at: {}, heard: "",
    };
  },
  created() {
    this.asked = 0; // number of completion requests; only the last reply counts
    this.given = false; // whether a completion wrote the blank before the cursor
    this.moved = false; // whether the user has moved in the list since the last input
    this.written = null; // what the server has just written
  },
  mounted() {
    this.check();
    this.stop = join({ hear: (news) => this.hear(news), again: () => this.again() });
    // The list follows the word being completed.
    this.follow = (event) => event.target !== this.$refs.list && this.place();
    window.addEventListener("resize", this.follow);
    window.addEventListener("scroll", this.follow, true);
  },
  beforeUnmount() {
    this.stop();
    clearTimeout(this.timer);
    window.removeEventListener("resize", this.follow);
    window.removeEventListener("scroll", this.follow, true);
    // Keep the input when the field is shown again.
    const element = window.mounted_app?.elements?.[String(this.id).slice(1)];
    if (element) element.props.value = this.text;
  },
  computed: {
    hindrances() { return this.found.unachievable ?? []; },
    name() { return `fe-${this.id}`; },
    wrong() {
      if (this.checkedText === null) return [];
      const found = this.found.problems.map((one) => ({
        ...one, from: placed(this.checkedText, one.position), to: placed(this.checkedText, one.end), proposals: proposals(one.hint),
      }));
      // A name that is being completed is not an error yet.
      return this.open && this.chosen >= 0 ? found.filter((one) => one.to < this.from || one.from > this.to) : found;
    },
    bad() { return !this.lost && this.wrong.length > 0 && !this.found.unfinished; },
    shown() {
      // Keep the underlines before the change while the user types.
      const same = this.checkedText ?? "";
      const whole = this.text === same;
      const kept = this.bad ? this.wrong.filter((one) => whole || this.text.slice(0, one.to) === same.slice(0, one.to)) : [];
      return pieces(this.text, whole ? kept : kept.filter((one) => one.to > one.from), this.open ? this.from : null);
    },
  },
  watch: {
    variables() { this.check(); },
    text(text) {
      // What the server has written is not told to it again: it may have written something else since.
      if (text !== this.written) this.$emit("update:value", text);
      this.written = null;
    },
  },
  methods: {
    icon(kind) { return ICONS[kind] ?? "chevron_right"; },
    look(piece) { return [piece.kind && `somrs-fe-${piece.kind}`, piece.wrong && "somrs-fe-wrong"]; },

    // Checking

    hear(news) {
      // Moves do not affect formulas; added and removed objects do.
      const changes = news.value?.changes ?? [];
      const matters = news.topic === "ontology" || news.missed || news.value?.read || changes.some(({ type }) => /^Object/.test(type));
      if (matters) this.later(CHECK);
    },
    again() {
      // The connection is open, perhaps again: earlier results may be outdated.
      if (this.checkedText !== null || this.lost) this.check();
    },
    later(pause) {
      clearTimeout(this.timer);
      this.timer = setTimeout(() => this.check(), pause);
    },
    async check() {
      clearTimeout(this.timer);
      const text = this.text;
      try {
        const found = await ask("check", { text, variables: this.variables ?? {}, types: this.types ?? [], goal: this.goal });
        if (text !== this.text) return;
        Object.assign(this, { found, checkedText: text, lost: false });
        this.$emit("checked", { ...found, text });
      } catch {
        this.lost = true;
        this.later(AGAIN);
      }
    },
    recheck() { return this.check(); },
    go(one) {
      this.$refs.area.focus();
      this.$refs.area.setSelectionRange(one.from, Math.max(one.to, one.from));
    },
    mend(one, word) { this.replace(one.from, one.to, word); },

    // Typing

    onInput(event) {
      this.later(CHECK);
      if (event.isComposing) return;
      if (this.given && [".", ",", ")"].includes(event.data)) this.joinUp(event.data);
      this.given = this.moved = false;
      this.narrow();
      if (event.inputType?.startsWith("history")) this.close();
      else this.complete();
    },
    joinUp(sign) {
      // Remove the blank of a completion before a character that joins on.
      const at = this.$refs.area.selectionStart;
      if (this.$refs.area.value.slice(at - 2, at) === ` ${sign}`) this.replace(at - 2, at, sign);
    },
    replace(from, to, word) {
      const area = this.$refs.area;
      area.focus();
      area.setSelectionRange(from, to);
      // Unlike a new value, an insertion can be undone by the keyboard.
      if (!document.execCommand("insertText", false, word)) area.setRangeText(word, from, to, "end");
      this.text = area.value;
      this.later(CHECK);
    },
    insert(word) {
      const area = this.$refs.area;
      this.replace(area.selectionStart, area.selectionEnd, word);
    },
    focus() { this.$refs.area.focus(); },
    write(value, previous) {
      // The server writes `value` in place of `previous`. If the user has typed something else since, that stays: it is on its way.
      if (this.text !== previous || value === previous) return;
      this.text = this.written = value;
      this.close();
      this.check();
    },

    // Completion

    async complete() {
      const asked = ++this.asked;
      const text = this.$refs.area.value;
      const cursor = this.$refs.area.selectionStart;
      let found;
      try {
        found = await ask("complete", { text, cursor: counted(text, cursor), variables: this.variables ?? {}, types: this.types ?? [] });
      } catch {
        return this.close();
      }
      if (asked !== this.asked || document.activeElement !== this.$refs.area) return;
      if (!found.items.length) return this.close();
      this.from = placed(text, found.start);
      this.to = placed(text, found.end);
      // What the user has chosen in the list that was shown meanwhile stays chosen: Enter takes it.
      const kept = this.open && this.moved ? found.items.findIndex((item) => item.text === this.items[this.chosen]?.text) : -1;
      this.items = found.items;
      // Without input, Enter and Tab keep their usual meaning until the user moves into the list.
      this.chosen = kept >= 0 ? kept : cursor > this.from ? 0 : -1;
      this.open = true;
      if (kept >= 0) return this.$nextTick(() => this.place());
      this.heard = `${found.items.length} completions${this.chosen === 0 ? `, ${found.items[0].text} first` : ""}`;
      this.$nextTick(() => {
        this.place();
        if (this.$refs.list) this.$refs.list.scrollTop = 0;
      });
    },
    narrow() {
      // Filter the list at once, so that Enter never takes a choice for an earlier input.
      if (!this.open) return;
      const { value, selectionStart: cursor } = this.$refs.area;
      const typed = value.slice(this.from, cursor).toLowerCase();
      this.items = cursor > this.from ? this.items.filter((item) => item.text.toLowerCase().includes(typed)) : [];
      this.to = cursor;
      this.chosen = 0;
      if (!this.items.length) this.close();
    },
    place() {
      const mark = this.$refs.mark;
      const span = Array.isArray(mark) ? mark[0] : mark;
      if (!this.open || !span) return;
      const box = span.getBoundingClientRect();
      const list = this.$refs.list.getBoundingClientRect();
      const left = Math.max(8, Math.min(box.left - 8, window.innerWidth - list.width - 8));
      const below = box.top + 22 + list.height < window.innerHeight || box.top < list.height + 8;
      this.at = { left: `${left}px`, top: `${below ? box.top + 22 : box.top - list.height - 4}px` };
    },
    close() {
      this.asked++;
      if (!this.open) return;
      this.open = false;
      this.heard = "";
    },
    accept(index) {
      const item = this.items[index];
      const behind = this.text[this.to];
      const after = item.after === " " && behind === " " ? "" : item.after;
      this.given = after === " ";
      this.moved = false;
      this.replace(this.from, this.to, item.text + after);
      if (item.after === " " && behind === " ") this.$refs.area.setSelectionRange(this.from + item.text.length + 1, this.from + item.text.length + 1);
      const given = this.given;
      this.complete().then(() => (this.given = given));
    },
    move(by) {
      this.moved = true;
      const last = this.items.length - 1;
      this.chosen = this.chosen < 0 ? (by > 0 ? 0 : last) : Math.max(0, Math.min(last, this.chosen + by));
      const { text, detail } = this.items[this.chosen];
      this.heard = `${text}, ${detail}`;
      this.$nextTick(() => this.$refs.list.children[this.chosen]?.scrollIntoView({ block: "nearest" }));
    },
    onKey(event) {
      if (event.key === "Enter" && (event.ctrlKey || event.metaKey)) {
        event.preventDefault();
        this.close();
        this.$emit("submit", this.text);
      } else if (event.key === " " && event.ctrlKey) {
        event.preventDefault();
        this.complete();
      } else if (this.open && !event.altKey && !event.ctrlKey && !event.metaKey) {
        this.onListKey(event);
      } else if (event.key === "Escape") {
        this.asked++; // do not open when the reply arrives
      } else if (event.key === "ArrowDown" && !this.text) {
        event.preventDefault();
        this.complete();
      }
    },
    onListKey(event) {
      const moves = { ArrowDown: 1, ArrowUp: -1, PageDown: 8, PageUp: -8 };
      if (event.key in moves && (this.chosen >= 0 || moves[event.key] > 0)) this.move(moves[event.key]);
      else if (["Enter", "Tab"].includes(event.key) && this.chosen >= 0 && !event.shiftKey) this.accept(this.chosen);
      else if (event.key === "Escape") {
        this.close();
        event.stopPropagation();
      } else {
        if (["ArrowLeft", "ArrowRight", "ArrowUp", "Home", "End", "Tab"].includes(event.key)) this.close();
        return;
      }
      event.preventDefault();
    },
  },
};
