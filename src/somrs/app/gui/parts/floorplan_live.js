// The map and the ontology from the API, and the news of them, for as long as one wants: after a lost connection, everything is read again.

const AGAIN = [500, 1000, 2000, 4000]; // milliseconds

export class Live {
  // `told` is called with { definitions, map } when something was read, with { changes, version } for news, with { lost } otherwise.
  constructor(told) {
    this._told = told;
    this._socket = null;
    this._tries = 0;
    this._ended = false;
    this._waiting = null; // news that came while the map is being read
  }

  async start() {
    if (this._ended) return;
    const url = new URL("/api/live", location.href);
    url.protocol = url.protocol.replace("http", "ws");
    this._waiting = [];
    const socket = (this._socket = new WebSocket(url));
    socket.onopen = async () => {
      socket.send(JSON.stringify({ follow: ["map", "ontology"] }));
      await this._read(socket);
    };
    socket.onmessage = (message) => this._hear(JSON.parse(message.data), socket);
    socket.onclose = () => this._lost(socket);
  }

  end() {
    this._ended = true;
    clearTimeout(this._timer);
    this._socket?.close();
  }

  async _read(socket) {
    this._waiting ??= [];
    try {
      const [definitions, map] = await Promise.all([get("/api/ontology"), get("/api/map")]);
      if (socket !== this._socket) return;
      this._tries = 0;
      this._told({ definitions: definitions.definitions, map });
      const waiting = this._waiting;
      this._waiting = null;
      for (const news of waiting) this._hear(news, socket);
    } catch {
      socket.close(); // and everything begins again
    }
  }

  _hear(news, socket) {
    if (socket !== this._socket || this._ended) return;
    if (this._waiting !== null) this._waiting.push(news);
    else if (news.missed || news.topic === "ontology" || news.value.read) this._read(socket);
    else this._told({ changes: news.value.changes, version: news.value.version });
  }

  _lost(socket) {
    if (socket !== this._socket || this._ended) return;
    this._told({ lost: true });
    this._timer = setTimeout(() => this.start(), AGAIN[Math.min(this._tries++, AGAIN.length - 1)]);
  }
}

export async function get(path) {
  const answer = await fetch(path);
  if (!answer.ok) throw new Error((await answer.json().catch(() => ({}))).problem ?? `${path} answered ${answer.status}`);
  return answer.json();
}
