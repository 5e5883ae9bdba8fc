// What is known of a task in this page: read once, kept up to date by news, and shared by all parts of the page that show it.

import { follow } from "live";

const AGAIN = 1500; // milliseconds after which is read again what could not be

const feeds = new Map();

export function feed(task) {
  if (!feeds.has(task)) feeds.set(task, new Feed(task));
  return feeds.get(task);
}

// `seen`: {view, events, contracts, messages, life}. `messages` only grow; when they are others than before, `life` is another number.
class Feed {
  constructor(task) {
    this.task = task;
    this.seen = null;
    this.listeners = new Set();
    this.reading = false;
    this.ended = false; // nobody listens any more
    this.life = 0;
  }

  // Calls back with what is seen, at once if anything is, and whenever it changed. Gives what ends that.
  listen(listener) {
    this.listeners.add(listener);
    if (this.seen) listener(this.seen);
    this.stop ??= follow([`task ${this.task}`], { open: () => this.read(), news: (news) => this.hear(news) });
    return () => {
      this.listeners.delete(listener);
      if (this.listeners.size) return;
      this.ended = true;
      this.stop();
      clearTimeout(this.timer);
      feeds.delete(this.task);
    };
  }

  async read() {
    // Everything; what comes while it is read is read once more.
    this.wanted = true;
    if (this.reading) return;
    this.reading = true;
    try {
      while (this.wanted) {
        this.wanted = false;
        const { view, events, contracts } = await this.get("");
        const old = this.seen?.messages ?? [];
        const last = old.length ? (await this.get(`/messages?after=${old.length - 1}`)).messages[0] : null;
        const same = last !== null && last?.id === old.at(-1).id;
        if (!same) this.life++;
        this.seen = { view, events, contracts, messages: same ? old : [], life: this.life };
        this.tell();
        await this.more();
      }
    } catch (error) {
      if (error.status !== 404) this.later();
    } finally {
      this.reading = false;
    }
  }

  async more() {
    // The messages behind those that are here.
    const seen = this.seen;
    for (let more = true; more; ) {
      const page = await this.get(`/messages?after=${seen.messages.length}`);
      page.messages.forEach((message) => seen.messages.push(told(message)));
      more = page.more;
      this.tell();
    }
  }

  hear({ value, missed }) {
    if (missed || !value?.view || !this.seen) return this.read();
    const { seen } = this;
    const last = seen.events.at(-1)?.number ?? 0;
    const fresh = (value.events ?? []).filter((event) => event.number > last);
    if (fresh.length && fresh[0].number !== last + 1) return this.read();
    seen.view = value.view;
    seen.events.push(...fresh);
    for (const contract of value.contracts ?? []) {
      const at = seen.contracts.findIndex((one) => one.participant === contract.participant);
      if (at < 0) seen.contracts.push(contract);
      else seen.contracts[at] = contract;
    }
    this.tell();
    this.catchUp();
  }

  async catchUp() {
    if (this.reading) return (this.wanted = true);
    this.reading = true;
    try {
      await this.more();
    } catch {
      this.later();
    } finally {
      this.reading = false;
      if (this.wanted) this.read();
    }
  }

  later() {
    if (!this.ended) this.timer = setTimeout(() => this.read(), AGAIN);
  }

  tell() {
    // Once for all that happens before the next picture is drawn.
    if (this.telling) return;
    this.telling = true;
    setTimeout(() => {
      this.telling = false;
      for (const listener of this.listeners) listener(this.seen);
    }, 16);
  }

  async get(path) {
    const answer = await fetch(`/api/tasks/${encodeURIComponent(this.task)}${path}`);
    if (!answer.ok) throw Object.assign(new Error((await answer.json()).problem), { status: answer.status });
    return answer.json();
  }
}

const ASKED = new Set(["Arrange", "Accept", "Cancel", "Execute", "Stop", "Compensate", "Query", "End"]);

// A message as people speak of it: between the Task Manager and a service.
function told(message) {
  const [service, rest = ""] = message.participant.split("#");
  const step = /^(?:[a-z]+\d+\.)?step\d+/i.exec(rest)?.[0] ?? rest;
  const body = JSON.parse(message.body);
  delete body.type;
  const asked = ASKED.has(message.type) || (message.type === "Fault" && message.sender.includes("task-manager"));
  return { id: message.id, at: message.at, type: message.type, participant: message.participant, relates_to: message.relates_to, service, step, asked, body };
}
