// The map and the ontology from the API, with their news. After a lost connection, everything is read again.

import { follow } from "live";

const AGAIN = 2000; // milliseconds before a failed request is repeated

export class Live {
  // Calls `told` with { definitions, map } after reading, with { changes, version } for news, and with { lost } when the connection is
  // lost.
  constructor(told) {
    this._told = told;
    this._waiting = []; // news received while the map is being read
    this._reading = 0;
    this._close = follow(["map", "ontology"], { open: () => this._read(), news: (news) => this._hear(news), lost: () => told({ lost: true }) });
  }

  end() {
    this._reading = -1;
    clearTimeout(this._timer);
    this._close();
  }

  async _read() {
    this._waiting ??= [];
    clearTimeout(this._timer);
    const reading = ++this._reading;
    try {
      const [definitions, map] = await Promise.all([get("/api/ontology"), get("/api/map")]);
      if (reading !== this._reading) return; // another read has begun, or this one is no longer needed
      this._told({ definitions: definitions.definitions, map });
      const waiting = this._waiting;
      this._waiting = null;
      for (const news of waiting) if (news.missed || news.topic === "ontology" || news.value.read || news.value.version > map.version) this._hear(news);
    } catch {
      if (reading === this._reading) this._timer = setTimeout(() => this._read(), AGAIN);
    }
  }

  _hear(news) {
    if (this._waiting !== null) this._waiting.push(news);
    else if (news.missed || news.topic === "ontology" || news.value.read) this._read();
    else this._told({ changes: news.value.changes, version: news.value.version });
  }
}

export async function get(path) {
  const answer = await fetch(path);
  if (!answer.ok) throw new Error((await answer.json().catch(() => ({}))).problem ?? `${path} answered ${answer.status}`);
  return answer.json();
}
