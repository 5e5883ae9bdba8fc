// Keeps form drafts in this browser tab, letter by letter, so that they survive reloads and times without a server. The element is
// invisible. What is typed before the server has replied for the first time goes into the initial drafts. If there are others, which the
// server is about to put into the forms, nothing can be typed before it has.

export default {
  template: `<span hidden></span>`,
  props: { shelf: String, initial: Object },
  emits: ["found"],
  mounted() {
    const initial = Object.entries(this.initial ?? {}).map(([key, draft]) => [`${this.shelf} ${key}`, JSON.stringify(draft)]);
    for (const [name, draft] of initial) if (!sessionStorage.getItem(name)) sessionStorage.setItem(name, draft);
    const stored = this.names().map((name) => sessionStorage.getItem(name));
    const found = stored.filter((draft) => !initial.some(([, one]) => one === draft));
    if (!found.length) return;
    this.page().inert = true;
    this.$emit("found", found.map((draft) => JSON.parse(draft)));
  },
  methods: {
    page() { return document.querySelector(".somrs-main"); },
    restored() { this.page().inert = false; },
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
