// A tree, or a list (a tree of one level), with search, arrow keys, and drag and drop. Only visible rows are in the document, which keeps a
// thousand nodes fast.

const label = (node) => node.label.toLowerCase();

export default {
  template: `
    <div class="somrs-tree">
      <input ref="find" type="search" class="somrs-tree-find" v-model="wanted" :placeholder="placeholder" :aria-label="placeholder"
        autocomplete="off" spellcheck="false" @keydown="onFind" />
      <div class="somrs-tree-said" role="status">{{ said }}</div>
      <div ref="rows" class="somrs-tree-rows" role="tree" :aria-label="name" @keydown="onKey" @dragend="dragged = over = null">
        <div v-for="row in rows" :key="row.node.id" role="treeitem" class="somrs-tree-row"
          :class="{'somrs-tree-picked': row.node.id === selected, 'somrs-tree-over': row.node.id === over, 'somrs-tree-dim': row.dim}"
          :style="{paddingLeft: 4 + row.level * 16 + 'px'}" :data-id="row.node.id"
          :aria-level="row.level + 1" :aria-posinset="row.place" :aria-setsize="row.of" :aria-selected="row.node.id === selected"
          :aria-expanded="row.parent ? row.open : undefined" :tabindex="row.node.id === current ? 0 : -1"
          :draggable="movable && row.level > 0" @click="pick(row.node.id)" @focus="focused = row.node.id"
          @dragstart="onDrag($event, row.node.id)" @dragover="onOver($event, row.node.id)" @drop="onDrop($event, row.node.id)">
          <span class="somrs-tree-turn" aria-hidden="true" @click.stop="turn(row.node.id)">
            <i v-if="row.parent" class="material-icons">{{ row.open ? 'expand_more' : 'chevron_right' }}</i>
          </span>
          <span class="somrs-tree-label">{{ row.node.label }}</span>
          <i v-if="row.node.draft" class="material-icons somrs-tree-draft" role="img" aria-label="not saved" title="Not saved">edit</i>
          <i v-if="row.node.problem" class="material-icons somrs-tree-problem" role="img" :aria-label="'Problem: ' + row.node.problem"
            :title="row.node.problem">error</i>
          <span v-if="row.node.count" class="somrs-tree-count" :title="row.node.count + ' on the map'"
            :aria-label="row.node.count + ' on the map'">{{ row.node.count }}</span>
        </div>
      </div>
    </div>`,
  props: { nodes: Array, selected: String, movable: Boolean, name: String, placeholder: String },
  emits: ["pick", "move"],
  data() {
    return { wanted: "", opened: new Set(), focused: null, dragged: null, over: null, typed: "", typedAt: 0 };
  },
  created() {
    // A tree that does not fit is first expanded to two levels.
    const depth = this.nodes.length > 150 ? 1 : 2;
    const walk = (id, level) => {
      for (const node of this.below.get(id) ?? []) {
        this.opened.add(node.id);
        if (level < depth) walk(node.id, level + 1);
      }
    };
    walk(null, 0);
    this.reveal(this.selected);
  },
  mounted() {
    const rows = this.$refs.rows;
    const below = (this.row(this.selected)?.offsetTop ?? 0) - rows.offsetTop;
    if (below > rows.clientHeight - 60) rows.scrollTop = below - rows.clientHeight / 2;
  },
  watch: {
    nodes(now, before) {
      // An expanded node stays visible when its parent changes.
      const parent = (nodes) => nodes.find((node) => node.id === this.selected)?.parent;
      if (parent(now) !== parent(before)) this.reveal(this.selected);
      // So does a new node, unless a whole file is new.
      const known = new Set(before.map((node) => node.id));
      const fresh = now.filter((node) => !known.has(node.id));
      if (fresh.length < 6) fresh.forEach((node) => this.reveal(node.id));
    },
    selected(id) {
      this.focused = id;
      this.reveal(id);
      this.$nextTick(() => this.show(id));
    },
  },
  computed: {
    byId() {
      return new Map(this.nodes.map((node) => [node.id, node]));
    },
    below() {
      const below = new Map();
      for (const node of this.nodes) {
        const parent = this.byId.has(node.parent) ? node.parent : null;
        if (!below.has(parent)) below.set(parent, []);
        below.get(parent).push(node);
      }
      return below;
    },
    found() {
      // The matches and their ancestors; null without a search.
      const wanted = this.wanted.trim().toLowerCase();
      if (!wanted) return null;
      const matching = this.nodes.filter((node) => label(node).includes(wanted));
      const seen = new Set();
      for (let node of matching) for (; node && !seen.has(node.id); node = this.byId.get(node.parent)) seen.add(node.id);
      return { matching: new Set(matching.map((node) => node.id)), seen };
    },
    rows() {
      const rows = [];
      const walk = (parent, level) => {
        const nodes = (this.below.get(parent) ?? []).filter((node) => !this.found || this.found.seen.has(node.id));
        nodes.forEach((node, index) => {
          const open = this.found !== null || this.opened.has(node.id);
          const dim = this.found !== null && !this.found.matching.has(node.id);
          const parentOf = this.below.has(node.id) && (!this.found || this.below.get(node.id).some((one) => this.found.seen.has(one.id)));
          rows.push({ node, level, open, dim, parent: parentOf, place: index + 1, of: nodes.length });
          if (open && level < 60) walk(node.id, level + 1);
        });
      };
      walk(null, 0);
      return rows;
    },
    current() {
      const shown = (id) => id && this.rows.some((row) => row.node.id === id);
      return [this.focused, this.selected].find(shown) ?? this.rows[0]?.node.id;
    },
    said() {
      if (!this.found) return "";
      const count = this.found.matching.size;
      return count === 0 ? `No match for “${this.wanted.trim()}”` : `${count} of ${this.nodes.length}`;
    },
  },
  methods: {
    pick(id) {
      this.focused = id;
      this.$emit("pick", id);
    },
    turn(id, open = !this.opened.has(id)) {
      open ? this.opened.add(id) : this.opened.delete(id);
    },
    reveal(id) {
      for (let node = this.byId.get(this.byId.get(id)?.parent), steps = 0; node && steps < 60; node = this.byId.get(node.parent), steps++)
        this.opened.add(node.id);
    },
    row(id) {
      return this.$refs.rows.querySelector(`[data-id="${CSS.escape(id ?? "")}"]`);
    },
    show(id) {
      this.row(id)?.scrollIntoView({ block: "nearest" });
    },
    go(id) {
      if (!id) return;
      this.focused = id;
      this.$nextTick(() => this.row(id)?.focus());
    },
    onFind(event) {
      if (event.key === "ArrowDown") this.go(this.rows.find((row) => !row.dim)?.node.id);
      else if (event.key === "Escape" && this.wanted) this.wanted = "";
      else if (event.key === "Enter") {
        const first = this.rows.find((row) => !row.dim && label(row.node) === this.wanted.trim().toLowerCase()) ?? this.rows.find((row) => !row.dim);
        if (first && this.wanted) this.pick(first.node.id);
      } else return;
      event.preventDefault();
    },
    onKey(event) {
      if (event.altKey || event.ctrlKey || event.metaKey) return;
      const at = this.rows.findIndex((row) => row.node.id === this.current);
      const row = this.rows[at];
      if (!row) return;
      const steps = { ArrowDown: at + 1, ArrowUp: at - 1, Home: 0, End: this.rows.length - 1, PageDown: at + 12, PageUp: at - 12 };
      if (event.key in steps) this.go(this.rows[Math.min(Math.max(steps[event.key], 0), this.rows.length - 1)].node.id);
      else if (event.key === "ArrowRight") row.parent && (row.open ? this.go(this.rows[at + 1]?.node.id) : this.turn(row.node.id, true));
      else if (event.key === "ArrowLeft") row.parent && row.open && !this.found ? this.turn(row.node.id, false) : this.go(this.above(row));
      else if (event.key === "Enter" || event.key === " ") this.pick(row.node.id);
      else if (event.key === "*") this.nodes.forEach((node) => this.below.has(node.id) && this.opened.add(node.id));
      else if (event.key === "/") this.$refs.find.focus();
      else if (event.key.length === 1) this.type(event.key.toLowerCase(), at, event.timeStamp);
      else return;
      event.preventDefault();
    },
    above(row) {
      return row.level > 0 ? row.node.parent : null;
    },
    type(letter, at, now) {
      // Letters typed in quick succession form the beginning of a name.
      this.typed = now - this.typedAt < 700 ? this.typed + letter : letter;
      this.typedAt = now;
      const from = this.typed.length > 1 ? at : at + 1;
      const turned = [...this.rows.slice(from), ...this.rows.slice(0, from)];
      this.go(turned.find((row) => label(row.node).startsWith(this.typed))?.node.id);
    },
    onDrag(event, id) {
      this.dragged = id;
      event.dataTransfer.effectAllowed = "move";
      event.dataTransfer.setData("text/plain", id);
    },
    onOver(event, id) {
      if (!this.takes(id)) return;
      event.preventDefault();
      this.over = id;
    },
    onDrop(event, id) {
      event.preventDefault();
      if (this.takes(id)) this.$emit("move", { id: this.dragged, to: id });
      this.dragged = this.over = null;
    },
    takes(id) {
      // Not itself, its descendants, or its current parent.
      if (!this.dragged || this.byId.get(this.dragged)?.parent === id) return false;
      for (let node = this.byId.get(id), steps = 0; node && steps < 60; node = this.byId.get(node.parent), steps++)
        if (node.id === this.dragged) return false;
      return true;
    },
  },
};
