// The data of a task, read once, updated by news, and shared by all elements of the page that show it.

import { follow } from "live";

const AGAIN = 1500; // milliseconds before a failed request is repeated

const feeds = new Map();

export function feed(task) {
  if (!feeds.has(task)) feeds.set(task, new Feed(task));
  return feeds.get(task);
}

// `seen`: {view, events, contracts, messages, life}. `messages` only grow; if they are replaced, `life` changes.
class Feed {
  constructor(task) {
    this.task = task;
    this.seen = null;
    this.listeners = new Set();
    this.reading = false;
    this.ended = false; // no listeners left
    this.life = 0;
  }

  // Calls back with the data at once, if there is any, and after each change. Returns a function that unsubscribes.
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
    // Read everything; news during the read cause another read.
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
    // Read the messages after the known ones.
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
    // One call for all changes before the next frame.
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

// A message for display: between the Task Manager and a service.
function told(message) {
  const [service, rest = ""] = message.participant.split("#");
  const step = /^(?:[a-z]+\d+\.)?step\d+/i.exec(rest)?.[0] ?? rest;
  const body = JSON.parse(message.body);
  delete body.type;
  const asked = ASKED.has(message.type) || (message.type === "Fault" && message.sender.includes("task-manager"));
  return { id: message.id, at: message.at, type: message.type, participant: message.participant, relates_to: message.relates_to, service, step, asked, body };
}
