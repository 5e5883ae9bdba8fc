// A server with the answers that a test defines.

globalThis.location = new URL("http://somrs.test/");

export const server = {
  answers: {}, // by path without the query: the answer, or a function of { query, body } that returns it, or a promise of it
  asked: [], // the addresses of requests, in order
  sockets: [],
  away: false,

  reset() {
    Object.assign(this, { answers: {}, asked: [], sockets: [], away: false });
  },

  // The last connection to the path.
  socket(path) {
    return this.sockets.findLast((one) => new URL(one.url).pathname === path);
  },
};

globalThis.fetch = async (address, options) => {
  server.asked.push(address);
  if (server.away) throw new TypeError("no answer");
  const url = new URL(address, location.href);
  const found = server.answers[url.pathname];
  const body = await (typeof found === "function" ? found({ query: url.searchParams, body: options?.body && JSON.parse(options.body) }) : found);
  const status = body === undefined ? 404 : (body.status ?? 200);
  const text = JSON.stringify(body ?? { problem: "There is no such thing." });
  return { ok: status === 200, status, json: async () => JSON.parse(text) };
};

globalThis.WebSocket = class {
  constructor(url) {
    this.url = String(url);
    this.sent = [];
    this.closed = false;
    server.sockets.push(this);
  }

  send(text) {
    this.sent.push(JSON.parse(text));
  }

  close() {
    this.closed = true;
    this.onclose?.();
  }

  // Actions of the server. It confirms what is to be followed when the connection opens, unless it is `slow`.
  open({ slow = false } = {}) {
    this.onopen?.();
    if (!slow) this.confirm();
  }

  confirm() {
    const { confirm } = this.sent.at(-1) ?? {};
    if (confirm !== undefined) this.say({ confirmed: confirm });
  }

  say(news) {
    this.onmessage({ data: news instanceof ArrayBuffer ? news : JSON.stringify(news) });
  }
};
