// Keeps form drafts in this browser tab, letter by letter, so that they survive reloads and times without a server. The element is
// invisible. What is typed before the server has replied for the first time goes into the initial drafts.

export default {
  template: `<span hidden></span>`,
  props: { shelf: String, initial: Object },
  emits: ["found"],
  mounted() {
    const found = this.names().map((name) => JSON.parse(sessionStorage.getItem(name)));
    if (found.length) this.$emit("found", found);
    for (const [key, draft] of Object.entries(this.initial ?? {})) {
      if (!sessionStorage.getItem(`${this.shelf} ${key}`)) this.keep(key, draft);
    }
  },
  methods: {
    names() {
      return Object.keys(sessionStorage).filter((name) => name.startsWith(`${this.shelf} `));
    },
    keep(key, draft) {
      sessionStorage.setItem(`${this.shelf} ${key}`, JSON.stringify(draft));
    },
    forget(key) {
      sessionStorage.removeItem(`${this.shelf} ${key}`);
    },
    put(key, path, value) {
      // One field, stored also while the server cannot receive it.
      const name = `${this.shelf} ${key}`;
      const draft = JSON.parse(sessionStorage.getItem(name));
      if (!draft) return;
      const steps = path.split(".");
      const last = steps.pop();
      const holder = steps.reduce((inner, step) => inner?.[step], draft.form) ?? null;
      if (holder === null || holder[last] === value) return;
      holder[last] = value;
      sessionStorage.setItem(name, JSON.stringify(draft));
    },
  },
};
